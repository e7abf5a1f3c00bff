"""Every page for readers who do not see it, have no mouse, or have a small screen.

axe-core looks at each page of the book. What it cannot know is checked beside it: that an
alternative text holds numbers of the run, that each table has headers and a name, that text never
needs sideways scrolling, that the keyboard does what the mouse does.

All rules run on each page in the light theme, 1300 px wide. In the dark theme those run whose
answer depends on colours, at 360 px those that depend on sizes; the rest would read the same
document.

Before that, what is repeated is thinned: of all tokens of one kind in one kind of box one keeps its
own element, since the same style rules paint the others; of the formulas the first few stay, of a
long table and of the contents the first rows, of claims and of entries of the reference some of
each kind. The longest page has 60,000 elements before that, and axe would need minutes for it. And
of all texts whose colours, sizes and boxes are computed to be the same, the contrast of one is
looked at. With INSWSN_TESTS=whole nothing is left out; the weekly run on the public host does so.
"""

from __future__ import annotations

import ast
import re
from io import BytesIO
from itertools import pairwise
from pathlib import Path
from typing import Any

import nbformat
import numpy as np
import pytest
from axe import AXE_TAGS, MADE_PAGES, SCREENS, axe_script
from bs4 import BeautifulSoup, Tag
from inswsn_book.project import Project
from inswsn_book.runs import book_runs
from PIL import Image
from playwright.sync_api import Browser, Page
from visiting import contrast_of, it_is_whole, page_names, visit

from inswsn_lib.plotting import COLOURS

pytestmark = pytest.mark.page

ROOT = Path(__file__).resolve().parents[2]
ALL_RULES = {"type": "tag", "values": list(AXE_TAGS)}
ON_COLOURS = ["color-contrast", "link-in-text-block"]
BY_COLOUR: dict[str, Any] = {"runOnly": {"type": "rule", "values": ON_COLOURS}}
OTHERS = {"runOnly": ALL_RULES, "rules": {rule: {"enabled": False} for rule in ON_COLOURS}}
BY_SIZE = {"runOnly": {"type": "rule", "values": ["scrollable-region-focusable", "target-size"]}}
# what is run on each of SCREENS
RULES: list[list[dict[str, Any]]] = [[OTHERS, BY_COLOUR], [BY_COLOUR], [BY_SIZE]]

WIDTH = "document.documentElement.scrollWidth"

RUN_AXE = """async ([context, options]) => {
  // what passes is not described; that would take as long again
  const found = await axe.run(context, { ...options, resultTypes: ["violations"] });
  // axe does not count a formula as text, though its MathML is read
  const formula = (rule, node) => rule.id === "empty-table-header"
    && document.querySelector(node.target.flat()[0])?.querySelector("mjx-container math");
  return found.violations.flatMap((rule) => rule.nodes
    .filter((node) => !formula(rule, node)).map((node) => {
    const checks = [...node.any, ...node.all, ...node.none];
    const why = checks.map((check) => check.message).join(" ");
    return `${rule.id}: ${node.target.flat().join(" ")}: ${why}`;
  }));
}"""

# Undoes what was done to read the text.
AS_IT_WAS = """() => {
  document.querySelectorAll("style.spaced").forEach((style) => style.remove());
  document.querySelectorAll("main details.opened").forEach((box) => {
    box.open = false;
    box.classList.remove("opened");
  });
}"""

THIN = """() => {
  // apart from the document, since there each change has the browser look for what it may restyle
  const body = document.body;
  body.remove();
  const leave = (boxes, count) => [...boxes].slice(count).forEach((box) => box.remove());
  // a header that is a formula would be empty without it
  [...body.querySelectorAll("mjx-container")].slice(10)
    .forEach((box) => box.replaceWith(box.closest("th") ? "formula" : ""));
  for (const rows of body.querySelectorAll("main tbody")) leave(rows.children, 3);
  for (const list of body.querySelectorAll("main ul, main ol")) leave(list.children, 6);
  for (const kind of new Set([...body.querySelectorAll(".claim")].map((c) => c.className)))
    leave(body.getElementsByClassName(kind), 2);
  for (const list of body.querySelectorAll("main section"))
    leave(list.querySelectorAll(":scope > dl.py"), 2);
  const seen = new Set();
  for (const token of body.querySelectorAll(".highlight span, .sig span, .sig em, code span")) {
    const box = token.closest(".cell_input, .output, .sig, code, .highlight");
    const kind = `${box.className}/${token.parentElement.localName}/${token.className}`;
    if (seen.has(kind)) token.replaceWith(...token.childNodes);
    else seen.add(kind);
  }
  document.documentElement.append(body);
}"""

# Marks one text of each look. Contrast comes from what is computed for a text and for the boxes
# that it stands in; where all of that is the same, so is the contrast.
MARK = """() => {
  const looks = new Map([[document.documentElement, ""]]);
  const look = (box) => {
    if (!looks.has(box)) {
      const style = getComputedStyle(box);
      looks.set(box, [look(box.parentElement), style.color, style.backgroundColor,
        style.backgroundImage, style.opacity, style.filter, style.fontSize, style.fontWeight,
        style.textShadow, style.textDecorationLine, style.position, box.localName].join());
    }
    return looks.get(box);
  };
  const seen = new Set();
  for (const box of document.body.querySelectorAll("*")) {
    // axe does not look at a hidden one, which so stands for no other
    const own = [...box.childNodes].some((node) => node.nodeType === 3 && node.data.trim())
      && box.checkVisibility({visibilityProperty: true});
    box.toggleAttribute("data-look", own && !seen.has(look(box)));
    if (own) seen.add(look(box));
  }
}"""
MARKED_TEXTS = {"include": [["[data-look]"]]}

# as access.js says it: what scrolls sideways is a tab stop
REACHABLE = """() => [...document.querySelectorAll(
    ".bd-content figure, .bd-content pre, .bd-content .pst-scrollable-table-container")]
  .filter((box) => box.scrollWidth > box.clientWidth + 1)
  .filter((box) => getComputedStyle(box).overflowX !== "visible")
  .every((box) => box.tabIndex === 0 && box.getAttribute("aria-label"))"""


def listed_pages() -> list[str]:
    """Return the pages of the table of contents, and those that Sphinx adds."""
    toc = (ROOT / "book" / "_toc.yml").read_text(encoding="utf-8")
    names = re.findall(r"^\s*-?\s*(?:root|file): (\S+)", toc, re.MULTILINE)
    return sorted(f"{name}.html" for name in [*names, *MADE_PAGES])


PAGES = listed_pages()


def opened(browser: Browser, served: str, name: str, **options: Any) -> Page:
    """Open a page, and wait until all of it is there and typeset."""
    page = visit(browser, served, name, **options).page
    page.wait_for_load_state("load")
    page.evaluate("() => window.MathJax?.startup?.promise")
    return page


def parsed(built_site: Path, name: str) -> BeautifulSoup:
    """Return a page without its code, which is most of it and holds none of what is looked for."""
    text = (built_site / name).read_text(encoding="utf-8")
    return BeautifulSoup(re.sub(r"<pre>.*?</pre>", "<pre></pre>", text, flags=re.S), "html.parser")


def test_each_page_of_the_site_is_looked_at(built_site: Path) -> None:
    assert page_names(built_site) == PAGES


@pytest.mark.parametrize("name", PAGES)
def test_a_page(browser: Browser, served: str, name: str, whole: bool) -> None:
    """All that is asked of each page in a browser; it is loaded once, since that takes long."""
    # a change of theme fades, and a colour on its way is none of the page's
    seen = visit(browser, served, name, color_scheme="light", reduced_motion="reduce")
    page = seen.page
    it_is_whole(seen, name)
    assert name != "api.html" or page.locator("mjx-container").count() > 0
    assert page.evaluate(WIDTH) <= 1300, name
    text_is_read_without_sideways_scrolling(page, name)
    axe_finds_nothing(page, name, whole)
    page.close()


def axe_finds_nothing(page: Page, name: str, whole: bool) -> None:
    page.evaluate(AS_IT_WAS)
    if not whole:
        page.evaluate(THIN)
    page.evaluate(axe_script())
    for (theme, width), rules in zip(SCREENS, RULES, strict=True):
        page.emulate_media(color_scheme=theme)  # type: ignore[arg-type]
        page.set_viewport_size({"width": width, "height": 900})
        page.wait_for_function(f"document.documentElement.dataset.theme === '{theme}'")
        page.wait_for_function(REACHABLE)
        assert page.evaluate(WIDTH) <= width, f"{name}, {theme}"
        for options in rules:
            found = page.evaluate(RUN_AXE, [context_of(page, options, whole), options])
            assert found == [], f"{name}, {theme}, {width} px"


def context_of(page: Page, options: dict[str, Any], whole: bool) -> dict[str, Any]:
    """Return what axe is to look at: all, or for colours one text of each look."""
    if whole or options is not BY_COLOUR:
        return {"include": [["html"]]}
    page.evaluate(MARK)
    return MARKED_TEXTS


def test_axe_finds_what_is_there(browser: Browser) -> None:
    """A check that finds nothing is worth something only if it can find something."""
    page = browser.new_page()
    page.set_content(
        "<html><title>x</title><main><h1>x</h1><img src='data:,'>"
        "<p style='color: #999; background: #fff'>pale</p></main></html>"
    )
    page.evaluate(axe_script())
    everything = [{"include": [["html"]]}, {"runOnly": ALL_RULES}]
    found = {said.split(":")[0] for said in page.evaluate(RUN_AXE, everything)}
    assert {"image-alt", "color-contrast", "html-has-lang"} <= found
    page.close()


def test_a_pale_text_is_found_among_many_of_its_kind(browser: Browser) -> None:
    """By its own colour, by what is behind a box that it stands in, or by its size.

    Also if the first of its look is hidden.
    """
    page = browser.new_page()
    same = 50 * "<p><b>some words</b></p>"
    pale = "<p><b style='color: #999'>pale</b></p><p style='background: #666'><b>dark</b></p>"
    hidden = "<details{}><summary>words</summary><p><i style='color: #aaa'>pale</i></p></details>"
    heading = "<h2 style='color: #888; font-size: {}px'>size</h2>"
    page.set_content(
        "<html lang='en'><title>x</title><main style='color: #444; background: #fff'>"
        f"<h1>title</h1>{same}{pale}{same}{heading.format(30)}{heading.format(9)}"
        f"{hidden.format('')}{hidden.format(' open')}"
    )
    page.evaluate(axe_script())
    found = page.evaluate(RUN_AXE, [context_of(page, BY_COLOUR, whole=False), BY_COLOUR])
    assert page.locator("[data-look]").count() == 8
    assert len(found) == 4
    assert found == page.evaluate(RUN_AXE, [context_of(page, BY_COLOUR, whole=True), BY_COLOUR])
    page.close()


@pytest.mark.parametrize("name", PAGES)
def test_structure(built_site: Path, name: str) -> None:
    """Headings in order, tables with headers and a name, no id twice, a language, a title."""
    soup = parsed(built_site, name)
    main = soup.find("main")
    assert isinstance(main, Tag)
    assert soup.html is not None
    assert soup.html["lang"] == "en"
    levels = [
        int(heading.name[1])
        for heading in main.find_all(re.compile(r"^h[1-6]$"))
        if heading.find_parent(id="jb-print-docs-body") is None
    ]
    assert levels[0] == 1
    assert levels.count(1) == 1
    assert all(b <= a + 1 for a, b in pairwise(levels)), levels
    ids = [tag["id"] for tag in soup.find_all(id=True)]
    assert len(ids) == len(set(ids))
    for table in main.find_all("table"):
        if table.get("role") != "presentation":
            check_table(table)


def check_table(table: Tag) -> None:
    headers = table.find_all("th")
    assert headers
    assert {header.get("scope") for header in headers} <= {"col", "row", "colgroup", "rowgroup"}
    for header in headers:  # what heads several columns heads their group
        for spans, kind in (("colspan", "col"), ("rowspan", "row")):
            if header.get("scope") in (kind, f"{kind}group"):
                several = int(str(header.get(spans, "1"))) > 1
                assert header["scope"] == f"{kind}group" * several + kind * (not several)
    assert all(header.get_text(strip=True) for header in headers)
    name = table.caption.get_text() if table.caption else table.get("aria-label")
    assert isinstance(name, str)
    assert len(name) > 1


def test_only_an_index_lays_out_by_a_table(built_site: Path) -> None:
    laid_out = [
        name
        for name in PAGES
        if re.search(r'<table[^>]* role="presentation"', (built_site / name).read_text("utf-8"))
    ]
    assert laid_out == ["genindex.html", "prf-prf.html", "py-modindex.html"]


def test_titles_tell_the_pages_apart(built_site: Path) -> None:
    titles = [
        re.findall("<title>.*?</title>", (built_site / name).read_text("utf-8"), re.S)[0]
        for name in PAGES
    ]
    assert len(titles) == len(set(titles))


# Alternative texts

# figures that show no data
DIAGRAMS = {"fig-03-modes": "two block diagrams of the hybrid"}


def figures(project: Project) -> list[tuple[str, dict[str, str], str]]:
    """Return chapter, name with alternative text, and all string literals, of each figure."""
    found = []
    for run in book_runs(project):
        notebook = nbformat.reads(run.notebook, as_version=4)
        code = "\n".join(cell.source for cell in notebook.cells if cell.cell_type == "code")
        for cell in notebook.cells:
            for output in cell.get("outputs", []):
                if shown := output.get("metadata", {}).get("inswsn"):
                    found.append((run.request.chapter, dict(shown), code))
    return found


def computed_part(alt: str, code: str) -> str:
    """Return what is left of an alternative text without what the source spells out."""
    spelt = {
        node.value
        for node in ast.walk(ast.parse(code))
        if isinstance(node, ast.Constant) and isinstance(node.value, str)
    }
    # a label such as "area 1" may be part of it; a lone digit is a key of something
    for text in sorted(spelt, key=len, reverse=True):
        if re.search(r"\d", text) and re.search(r"[A-Za-z]", text):
            alt = alt.replace(text, " … ")
    return alt


def test_figures_have_alternative_texts_with_numbers_of_the_run(
    built_site: Path, project: Project
) -> None:
    shown = figures(project)
    assert len(shown) > 30
    for chapter, figure, code in shown:
        name, alt = figure["name"], figure["alt"]
        assert len(alt) > 60, f"{chapter}: {name}"
        if name not in DIAGRAMS:
            assert re.search(r"\d", computed_part(alt, code)), f"{chapter}: {name}: {alt}"
    assert {figure["name"] for _, figure, _ in shown} > set(DIAGRAMS)


def test_a_text_that_is_typed_in_is_no_number_of_a_run() -> None:
    code = 'alt = "A map of 700 m."\nother = f"A path of {length:.0f} m."'
    assert not re.search(r"\d", computed_part("A map of 700 m.", code))
    assert re.search(r"\d", computed_part("A path of 12 m.", code))


def test_every_image_of_a_page_tells_numbers(built_site: Path) -> None:
    """Those of generated pages too, as the reader gets them."""
    without = []
    for name in PAGES:
        main = parsed(built_site, name).find("main")
        assert isinstance(main, Tag)
        for image in main.find_all("img"):
            figure = image.find_parent("figure")
            if not re.search(r"\d", str(image.get("alt"))):
                without.append(figure.get("id") if figure is not None else name)
    assert without == list(DIAGRAMS)


# Contrast of what is not text


def channels(colour: str) -> np.ndarray:
    return np.array([int(colour[i : i + 2], 16) for i in (1, 3, 5)]) / 255


def css(colour: np.ndarray) -> str:
    return f"rgb({', '.join(f'{255 * channel:.3f}' for channel in colour)})"


def filtered(colour: np.ndarray) -> np.ndarray:
    """Return what ``invert(0.9) hue-rotate(180deg)`` makes of a colour (Filter Effects 1)."""
    inverted = 0.9 + colour * (0.1 - 0.9)
    parts = np.array([0.213, 0.715, 0.072])
    # the matrix of the specification at 180 degrees, where the cosine is -1 and the sine is 0
    turned = (2 * np.outer(np.ones(3), parts) - np.eye(3)) @ inverted
    return np.clip(turned, 0, 1)


@pytest.mark.parametrize("name", COLOURS)
def test_inks_of_figures_stand_out_in_both_themes(name: str) -> None:
    ink = channels(COLOURS[name])
    assert contrast_of(css(ink), css(channels("#ffffff"))) >= 3
    assert contrast_of(css(filtered(ink)), css(channels("#121212"))) >= 3


@pytest.fixture(scope="module")
def dark_filter(browser: Browser, served: str) -> str:
    """What the book's style does to its figures in the dark theme; all of them alike."""
    page = opened(browser, served, "chapters/71-two-filters-become-one.html", color_scheme="dark")
    found = page.evaluate(
        """[...document.querySelectorAll(".bd-content img[src$='.svg']")]
          .map((image) => getComputedStyle(image).filter)"""
    )
    page.close()
    assert len(set(found)) == 1
    return str(found[0])


@pytest.mark.parametrize("ink", [*COLOURS.values(), "#000000"])
def test_the_filter_is_what_the_browser_does(browser: Browser, dark_filter: str, ink: str) -> None:
    page = browser.new_page(viewport={"width": 20, "height": 20})
    page.set_content(
        f"<body style='margin: 0'><div style='width: 20px; height: 20px; background: {ink}; "
        f"filter: {dark_filter}'></div>"
    )
    painted = Image.open(BytesIO(page.screenshot())).convert("RGB").getpixel((10, 10))
    np.testing.assert_allclose(np.array(painted) / 255, filtered(channels(ink)), atol=2 / 255)
    page.close()


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_the_grounds_and_the_marks_of_verdicts(browser: Browser, served: str, scheme: str) -> None:
    page = opened(browser, served, "claims.html", color_scheme=scheme)
    ground = rgb(page, "getComputedStyle(document.body).backgroundColor")
    expected = {"light": "#ffffff", "dark": "#121212"}[scheme]
    np.testing.assert_allclose(ground, channels(expected), atol=1e-3)
    for verdict in ("reproduced", "not-reproduced", "contradicted-by-the-paper-itself"):
        mark = rgb(
            page,
            f"getComputedStyle(document.querySelector('.claim.verdict-{verdict}')).borderLeftColor",
        )
        assert contrast_of(css(mark), css(ground)) >= 3, verdict
    page.close()


def rgb(page: Page, expression: str) -> np.ndarray:
    words = re.findall(r"[\d.]+", page.evaluate(expression))
    return np.array([float(word) for word in words[:3]]) / 255


# Small screens and large letters

# Text that leaves the window, or is in a box that scrolls sideways. Tables, code, formulas on
# lines of their own and the images of figures may scroll in their boxes; captions may not.
TEXT_OUTSIDE = """() => {
  const main = document.querySelector(".bd-article") ?? document.querySelector("main");
  const wide = document.documentElement.clientWidth;
  const boxed = "table, pre, mjx-container[display], .math mjx-container, svg, .sr-only";
  const outside = [];
  const known = new Map([[main, false]]);  // most texts share the boxes that they are in
  const inABoxThatScrolls = (box) => {
    if (!known.has(box)) known.set(box, scrolls(box) || inABoxThatScrolls(box.parentElement));
    return known.get(box);
  };
  const scrolls = (box) => {
    if (box.matches("figure, .pst-scrollable-table-container, .cell_output")) return false;
    const style = getComputedStyle(box);
    return style.overflowX !== "visible" && style.display !== "inline"
      && box.scrollWidth > box.clientWidth + 1;
  };
  const walker = document.createTreeWalker(main, NodeFilter.SHOW_TEXT);
  for (let text; (text = walker.nextNode()); ) {
    const parent = text.parentElement;
    if (!text.data.trim() || parent.closest("mjx-container, script, style, .headerlink"))
      continue;
    if (parent.closest(boxed) && !parent.closest("caption")) continue;
    const range = document.createRange();
    range.selectNodeContents(text);
    for (const box of range.getClientRects())
      if (box.width > 1 && (box.right > wide + 1 || box.left < -1)) {
        outside.push(text.data.trim().slice(0, 60));
        break;
      }
    if (inABoxThatScrolls(parent))
      outside.push(`in a box that scrolls: ${text.data.trim().slice(0, 60)}`);
  }
  for (const formula of main.querySelectorAll("mjx-container:not([display])"))
    if (!formula.closest("table") && formula.getBoundingClientRect().right > wide + 1)
      outside.push(`formula: ${formula.parentElement.textContent.trim().slice(0, 60)}`);
  return outside;
}"""

# the text spacing of WCAG 2.2, 1.4.12
SPACED = """
* { letter-spacing: 0.12em !important; line-height: 1.5 !important;
  word-spacing: 0.16em !important; }
p { margin-bottom: 2em !important; }
mjx-container, mjx-container * { letter-spacing: normal !important; line-height: 0 !important;
  word-spacing: normal !important; }
"""

CLIPPED = """() => [...document.querySelectorAll("main *")]
  .filter((box) => [...box.childNodes].some((n) => n.nodeType === 3 && n.data.trim()))
  .filter((box) => !box.closest("mjx-container, script, style, noscript, .visually-hidden"))
  .filter((box) => box.checkVisibility({visibilityProperty: true, opacityProperty: true}))
  .filter((box) => ["hidden", "clip"].includes(getComputedStyle(box).overflowY))
  .filter((box) => box.scrollHeight > box.clientHeight + 2)
  .map((box) => `${box.localName}.${box.className}: ${box.textContent.trim().slice(0, 60)}`)"""


def text_is_read_without_sideways_scrolling(page: Page, name: str) -> None:
    """At 320 px, which is also a window of 1280 px at 400 %; and with text spaced out.

    The page is left so: it takes long to lay it out once more.
    """
    page.set_viewport_size({"width": 320, "height": 800})
    page.evaluate(
        """() => document.querySelectorAll("main details:not([open])").forEach((box) => {
          box.open = true;
          box.classList.add("opened");
        })"""
    )
    page.wait_for_function("document.documentElement.dataset.measured === '320'")
    assert page.evaluate(WIDTH) <= 320, name
    assert page.evaluate(TEXT_OUTSIDE) == [], name
    page.add_style_tag(content=SPACED).evaluate("(style) => style.classList.add('spaced')")
    assert page.evaluate(CLIPPED) == [], name
    assert page.evaluate(TEXT_OUTSIDE) == [], f"{name}, spaced out"
    assert page.evaluate(WIDTH) <= 320, f"{name}, spaced out"


# The keyboard


def test_the_first_tab_leads_past_the_contents(browser: Browser, served: str) -> None:
    page = opened(browser, served, "claims.html")
    page.keyboard.press("Tab")
    link = page.locator(":focus")
    assert link.inner_text() == "Skip to main content"
    assert link.is_visible()
    page.keyboard.press("Enter")
    page.wait_for_url("**#main-content")
    page.keyboard.press("Tab")
    assert page.evaluate("document.activeElement.closest('main') !== null")
    page.close()


# what is drawn around what has the focus, its only child or its parent; and what was there before
MARKED = """() => {
  const at = document.activeElement;
  const seen = [at, at.querySelector("*") ?? at, at.parentElement];
  const marks = () => seen.map((e) => getComputedStyle(e)).map((s) => [
    s.boxShadow, s.outlineStyle === "none" ? "0px" : s.outlineWidth + s.outlineColor]);
  const focused = marks();
  at.blur();
  const plain = marks();
  at.focus({focusVisible: true, preventScroll: true});
  return [at.localName, `${at.className}: ${at.textContent.trim().slice(0, 40)}`,
    focused.some((mark, i) => mark.some((m, j) => m !== plain[i][j]))];
}"""


@pytest.mark.parametrize("scheme", ["light", "dark"])
@pytest.mark.parametrize(
    ("name", "kinds"),
    [
        ("90-your-own-data", {"a", "button", "summary", "pre"}),
        ("71-two-filters-become-one", {"a", "button", "summary", "input", "mjx-container"}),
    ],
)
def test_focus_is_seen(
    browser: Browser, served: str, name: str, kinds: set[str], scheme: str
) -> None:
    """Whatever a tab leads to gets an outline, or a shadow as an outline, that it had not."""
    page = opened(
        browser, served, f"chapters/{name}.html", color_scheme=scheme, reduced_motion="reduce"
    )
    reached = set()
    for _ in range(60):
        page.keyboard.press("Tab")
        kind, said, marked = page.evaluate(MARKED)
        if kind == "body":  # after the last one, before the window is left
            break
        assert marked, f"{kind} {said}"
        reached.add(kind)
    assert kinds <= reached
    page.close()


def test_a_solution_opens_by_the_keyboard_and_without_scripts(
    browser: Browser, served: str
) -> None:
    page = browser.new_page(java_script_enabled=False)
    page.goto(f"{served}chapters/90-your-own-data.html")
    solution = page.locator("details.solution").first
    body = solution.locator(".solution-body")
    assert not body.is_visible()
    solution.locator("summary").press("Enter")
    assert body.is_visible()
    page.close()


def test_formulas_in_the_text_are_no_tab_stops(browser: Browser, served: str) -> None:
    page = opened(browser, served, "notation.html")
    page.wait_for_function(
        "document.querySelectorAll('mjx-container:not([display])[tabindex=\"0\"]').length === 0"
    )
    # a screen reader has their MathML
    formulas = page.locator("mjx-container").count()
    assert page.locator("mjx-container > mjx-assistive-mml > math").count() == formulas > 0
    page.close()


def test_nothing_moves_for_who_has_asked_for_that(browser: Browser, served: str) -> None:
    page = opened(browser, served, "index.html", reduced_motion="reduce")
    moving = page.evaluate(
        """() => [...document.querySelectorAll("*")].filter((e) => {
          const style = getComputedStyle(e);
          return [style.transitionDuration, style.animationDuration]
            .some((d) => d.split(",").some((t) => parseFloat(t) > 0));
        }).length"""
    )
    assert moving == 0
    assert page.evaluate("getComputedStyle(document.documentElement).scrollBehavior") == "auto"
    page.close()
