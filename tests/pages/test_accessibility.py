"""Every page for readers who do not see it, have no mouse, or have a small screen.

The structure of each page is looked at. One page of each kind is opened, with INSWSN_TESTS=whole
every page, as weekly: axe-core looks at it, and what axe cannot know is checked, such as that text
never needs sideways scrolling, and that the keyboard does what the mouse does.

All rules run on a page in the light theme, 1300 px wide. In the dark theme those run whose answer
depends on colours, at 360 px those that depend on sizes; the rest would read the same document.
"""

from __future__ import annotations

import ast
import re
from functools import cache
from io import BytesIO
from itertools import pairwise
from pathlib import Path
from typing import Any

import axe_playwright_python
import nbformat
import numpy as np
import pytest
import yaml
from bs4 import BeautifulSoup, Tag
from conftest import ROOT, weekly_but
from inswsn_book.record.project import Project
from inswsn_book.run.store import book_runs
from PIL import Image
from playwright.sync_api import Browser, Page
from visiting import (
    CHAPTER_00,
    LESSON,
    OWN_DATA,
    PAGES,
    Open,
    boxes,
    contrast_of,
    it_is_whole,
    set_theme,
    settled,
    unfold,
)  # fmt: skip

from inswsn_lib.plotting import COLOURS

pytestmark = pytest.mark.page

FIRST = "chapters/1-drift-and-fixes.html"
IN_TEN_LINES = next(name for name in PAGES if "/64-" in name)
# What is looked at daily: the front page, a lesson, evidence, a form
ONE_OF_EACH_KIND = {"index.html", FIRST, IN_TEN_LINES, OWN_DATA}
# WCAG 2.0 to 2.2, levels A and AA, and axe's own advice, as axe-core names them
TAGS = ("wcag2a", "wcag2aa", "wcag21a", "wcag21aa", "wcag22aa", "best-practice")
ALL_RULES = {"type": "tag", "values": list(TAGS)}
ON_COLOURS = ["color-contrast", "link-in-text-block"]
BY_COLOUR: dict[str, Any] = {"runOnly": {"type": "rule", "values": ON_COLOURS}}
OTHERS = {"runOnly": ALL_RULES, "rules": {rule: {"enabled": False} for rule in ON_COLOURS}}
BY_SIZE = {"runOnly": {"type": "rule", "values": ["scrollable-region-focusable", "target-size"]}}
#: The screens on which a page is checked: theme, width in px, and what is run there
SCREENS: tuple[tuple[str, int, list[dict[str, Any]]], ...] = (
    ("light", 1300, [OTHERS, BY_COLOUR]), ("dark", 1300, [BY_COLOUR]), ("light", 360, [BY_SIZE]),
)  # fmt: skip
WIDTH = "document.documentElement.scrollWidth"

RUN_AXE = """async (options) => {
  // what passes is not described; that would take as long again
  const found = await axe.run({ ...options, resultTypes: ["violations"] });
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

# access.js waits after each change of size, as the theme does
MEASURED = "() => Number(document.documentElement.dataset.measured) === window.innerWidth"
# as access.js says it: what scrolls sideways is a tab stop
REACHABLE = """() => [...document.querySelectorAll(
    ".bd-content figure, .bd-content pre, .bd-content .pst-scrollable-table-container")]
  .filter((box) => box.scrollWidth > box.clientWidth + 1)
  .filter((box) => getComputedStyle(box).overflowX !== "visible")
  .every((box) => box.tabIndex === 0 && box.getAttribute("aria-label"))"""

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

# What is drawn around what has the focus, its only child or its parent; and what was there before
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

# Each page --------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", weekly_but(ONE_OF_EACH_KIND, PAGES))
def test_a_page(open_page: Open, name: str) -> None:
    """All that is asked of a page in a browser; it is loaded once, since that takes long."""
    # a change of theme fades, and a colour on its way is none of the page's
    seen = open_page(name, color_scheme="light", reduced_motion="reduce")
    it_is_whole(seen, name)
    assert settled(seen.page).evaluate(WIDTH) <= 1300, name
    text_is_read_without_sideways_scrolling(seen.page, name)
    axe_finds_nothing(seen.page, name)


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
    page.wait_for_function(MEASURED)
    settled(page)
    assert page.evaluate(WIDTH) <= 320, name
    assert page.evaluate(TEXT_OUTSIDE) == [], name
    figures = boxes(page.locator("main figure, main figure img, main section.moving"))
    assert max((box["right"] for box in figures), default=0) <= 320, name
    page.add_style_tag(content=SPACED).evaluate("(style) => style.classList.add('spaced')")
    settled(page)
    assert page.evaluate(CLIPPED) == [], name
    assert page.evaluate(TEXT_OUTSIDE) == [], f"{name}, spaced out"
    assert page.evaluate(WIDTH) <= 320, f"{name}, spaced out"


def axe_finds_nothing(page: Page, name: str) -> None:
    page.evaluate(AS_IT_WAS)
    page.evaluate(axe_script())
    for theme, width, rules in SCREENS:
        page.set_viewport_size({"width": width, "height": 900})
        set_theme(page, theme)
        page.wait_for_function(MEASURED)
        assert page.evaluate(REACHABLE), f"{name}, {theme}, {width} px"
        assert page.evaluate(WIDTH) <= width, f"{name}, {theme}"
        for options in rules:
            assert page.evaluate(RUN_AXE, options) == [], f"{name}, {theme}, {width} px"


@cache
def axe_script() -> str:
    """Return axe-core, a script that is run in a page; the lock has the package that carries it."""
    return Path(axe_playwright_python.__file__).with_name("axe.min.js").read_text(encoding="utf-8")


def test_axe_finds_what_is_there(browser: Browser) -> None:
    """A check that finds nothing is worth something only if it can find something."""
    page = browser.new_page()
    page.set_content(
        "<html><title>x</title><main><h1>x</h1><img src='data:,'>"
        "<p style='color: #999; background: #fff'>pale</p></main></html>"
    )
    page.evaluate(axe_script())
    found = {said.split(":")[0] for rules in (OTHERS, BY_COLOUR)
             for said in page.evaluate(RUN_AXE, rules)}  # fmt: skip
    assert {"image-alt", "color-contrast", "html-has-lang"} <= found
    page.close()


# Structure ---------------------------------------------------------------------------------------


@cache
def main_of(path: Path) -> tuple[BeautifulSoup, Tag]:
    """Return a page without its code, which is most of it and holds none of what is looked for."""
    text = re.sub(r"<pre>.*?</pre>", "<pre></pre>", path.read_text(encoding="utf-8"), flags=re.S)
    soup = BeautifulSoup(text, "html.parser")
    main = soup.find("main")
    assert isinstance(main, Tag)
    return soup, main


@pytest.mark.parametrize("name", PAGES)
def test_structure(built_site: Path, name: str) -> None:
    """Headings in order, tables with headers and a name, no id twice, a language."""
    soup, main = main_of(built_site / name)
    assert soup.html["lang"] == "en"
    headings = main.find_all(re.compile(r"^h[1-6]$"))
    levels = [int(h.name[1]) for h in headings if h.find_parent(id="jb-print-docs-body") is None]
    assert (levels[0], levels.count(1)) == (1, 1)
    assert all(b <= a + 1 for a, b in pairwise(levels)), levels
    ids = [tag["id"] for tag in soup.find_all(id=True)]
    assert len(ids) == len(set(ids))
    index = name in ("genindex.html", "prf-prf.html", "py-modindex.html")
    for table in main.find_all("table"):
        # only an index lays out by a table
        assert (table.get("role") == "presentation") is index
        if not index:
            check_table(table)
    assert all(str(link["href"]).endswith(".svg") for link in main.select("figure a.full-size"))


def check_table(table: Tag) -> None:
    headers = table.find_all("th")
    assert headers
    assert all(header.get_text(strip=True) for header in headers)
    for header in headers:  # what heads several columns heads their group
        kind = str(header["scope"])
        assert kind in ("col", "row", "colgroup", "rowgroup")
        spans = {"col": "colspan", "row": "rowspan"}[kind.removesuffix("group")]
        assert (int(str(header.get(spans, "1"))) > 1) is kind.endswith("group")
    name = table.caption.get_text() if table.caption else table.get("aria-label")
    assert len(str(name or "")) > 1


def test_the_pages_are_those_that_are_listed_and_have_titles_of_their_own(built_site: Path) -> None:
    found = sorted(p.relative_to(built_site) for p in built_site.rglob("*.html"))
    renamed = yaml.safe_load((ROOT / "book/renamed.yaml").read_text())["pages"]
    moved = {f"{name}.html" for name in renamed}
    found = [p for p in found if "_static" not in p.parts and p.as_posix() not in moved]
    assert [p.as_posix() for p in found] == PAGES
    titles = [str(main_of(built_site / name)[0].title) for name in PAGES]
    assert len(titles) == len(set(titles))


# Alternative texts -------------------------------------------------------------------------------


def spelt_out(code: str) -> list[str]:
    """Return texts of a source with a digit, the longest first.

    A label such as "area 1" may be part of an alternative text; a lone digit is a key of something.
    """
    nodes = (node for node in ast.walk(ast.parse(code)) if isinstance(node, ast.Constant))
    spelt = {node.value for node in nodes if isinstance(node.value, str)}
    found = (s for s in spelt if re.search(r"\d", s) and re.search(r"[A-Za-z]", s))
    return sorted(found, key=len, reverse=True)


def computed_part(alt: str, spelt: list[str]) -> str:
    """Return what is left of an alternative text without what the source spells out."""
    for text in spelt:
        alt = alt.replace(text, " … ")
    return alt


def test_alternative_texts_have_numbers_of_the_run(built_site: Path, project: Project) -> None:
    shown = set()
    for run in book_runs(project):
        notebook = nbformat.reads(run.notebook, as_version=4)
        cells = [cell.source for cell in notebook.cells if cell.cell_type == "code"]
        spelt = spelt_out("\n".join(cells))
        outputs = [o for cell in notebook.cells for o in cell.get("outputs", [])]
        for figure in filter(None, (o.get("metadata", {}).get("inswsn") for o in outputs)):
            name, alt = figure["name"], figure["alt"]
            shown.add(name)
            assert len(alt) > 60, name
            assert re.search(r"\d", computed_part(alt, spelt)), f"{name}: {alt}"
    assert len(shown) > 30
    # and as the reader gets them, those of other pages too
    images = [i for name in PAGES for i in main_of(built_site / name)[1].find_all("img")]
    without = [i.find_parent("figure") for i in images if not re.search(r"\d", str(i.get("alt")))]
    assert [figure and figure.get("id") for figure in without] == []


def test_a_text_that_is_typed_in_is_no_number_of_a_run() -> None:
    code = 'alt = "A map of 700 m."\nother = f"A path of {length:.0f} m."'
    assert not re.search(r"\d", computed_part("A map of 700 m.", code))
    assert re.search(r"\d", computed_part("A path of 12 m.", code))


# Contrast of what is not text --------------------------------------------------------------------


def rgb(colour: str) -> str:
    """Return a colour as a browser gives it."""
    return f"rgb({', '.join(str(int(colour[i : i + 2], 16)) for i in (1, 3, 5))})"


def test_inks_of_figures_stand_out_in_both_themes(browser: Browser, open_page: Open) -> None:
    """In the dark one by the filter that the style has for figures, as the browser paints it."""
    filters = open_page(LESSON, color_scheme="dark").page.evaluate(
        """[...document.querySelectorAll(".bd-content img[src$='.svg']")]
          .map((image) => getComputedStyle(image).filter)"""
    )
    (dark,) = set(filters)
    inks = [*COLOURS.values(), "#000000"]
    inked = "".join(f"<i style='background: {ink}'></i>" for ink in inks)
    page = browser.new_page(viewport={"width": 20 * len(inks), "height": 20})
    page.set_content(f"<style>* {{ margin: 0 }} i {{ float: left; width: 20px; height: 20px; "
                     f"filter: {dark} }}</style>{inked}")  # fmt: skip
    painted = np.asarray(Image.open(BytesIO(page.screenshot())).convert("RGB"))
    page.close()
    for ink, pixel in zip(inks, painted[10, 10::20], strict=True):
        assert contrast_of(rgb(ink), "rgb(255, 255, 255)") >= 3
        assert contrast_of(f"rgb({', '.join(map(str, pixel))})", rgb("#121212")) >= 3


def test_text_marks_and_figures_stand_out_in_both_themes(open_page: Open) -> None:
    pages = [open_page(name).page for name in (CHAPTER_00, "claims.html")]
    unfold(pages[0])
    for theme, expected in (("light", "#ffffff"), ("dark", "#121212")):
        for page in pages:
            set_theme(page, theme)
            ground = colour(page, "body", "backgroundColor")
            assert contrast_of(ground, rgb(expected)) < 1.001
            assert contrast_of(colour(page, "main p", "color"), ground) >= 7
        for verdict in ("reproduced", "not-reproduced", "contradicted-by-the-paper-itself"):
            mark = colour(pages[1], f".claim.verdict-{verdict}", "borderLeftColor")
            assert contrast_of(mark, ground) >= 3, verdict
        assert contrast_of(colour(pages[0], "main figcaption p", "color"), ground) >= 4.5
        # the ink of a figure, as it is painted: its darkest or lightest pixel against its ground
        figure = pages[0].locator("main figure img").first
        figure.scroll_into_view_if_needed()
        settled(pages[0])
        pixels = np.asarray(Image.open(BytesIO(figure.screenshot())).convert("L"), dtype=float)
        paper = np.median(pixels)
        assert (paper > 200) == (theme == "light")
        assert np.abs(pixels - paper).max() > 150


def colour(page: Page, selector: str, what: str) -> str:
    words = f"getComputedStyle(document.querySelector('{selector}')).{what}"
    return str(page.evaluate(words))


# The keyboard ------------------------------------------------------------------------------------


def test_the_first_tab_leads_past_the_contents_and_none_to_a_formula(open_page: Open) -> None:
    page = open_page("notation.html").page
    page.keyboard.press("Tab")
    link = page.locator(":focus")
    assert link.inner_text() == "Skip to main content"
    assert link.is_visible()
    page.keyboard.press("Enter")
    page.wait_for_url("**#main-content")
    page.keyboard.press("Tab")
    assert page.evaluate("document.activeElement.closest('main') !== null")
    page.wait_for_function(
        "document.querySelectorAll('mjx-container:not([display])[tabindex=\"0\"]').length === 0"
    )
    # a screen reader has their MathML
    formulas = page.locator("mjx-container").count()
    assert page.locator("mjx-container > mjx-assistive-mml > math").count() == formulas > 0


@pytest.mark.parametrize(
    ("name", "kinds"),
    [
        pytest.param(OWN_DATA, {"a", "button", "summary"}, marks=pytest.mark.whole),
        (LESSON, {"a", "button", "summary", "input"}),
    ],
)
def test_focus_is_seen_and_nothing_moves(open_page: Open, name: str, kinds: set[str]) -> None:
    """Whatever a tab leads to gets an outline, or a shadow as an outline, that it had not.

    For a reader who has asked for that nothing moves.
    """
    page = open_page(name, reduced_motion="reduce").page
    moving = page.evaluate(
        """() => [...document.querySelectorAll("*")].filter((e) => {
          const style = getComputedStyle(e);
          return [style.transitionDuration, style.animationDuration]
            .some((d) => d.split(",").some((t) => parseFloat(t) > 0));
        }).length"""
    )
    assert moving == 0
    assert page.evaluate("getComputedStyle(document.documentElement).scrollBehavior") == "auto"
    for theme in ("light", "dark"):
        set_theme(page, theme)
        page.evaluate("document.querySelector('a').focus()")  # from the top on
        reached = set()
        for _ in range(120):
            page.keyboard.press("Tab")
            kind, said, marked = page.evaluate(MARKED)
            if kind == "body":  # after the last one, before the window is left
                break
            assert marked, f"{kind} {said}, {theme}"
            reached.add(kind)
        assert kinds <= reached


def test_a_solution_opens_by_keyboard_without_scripts(browser: Browser, served: str) -> None:
    page = browser.new_page(java_script_enabled=False)
    page.goto(served + OWN_DATA)
    solution = page.locator("details.solution").first
    body = solution.locator(".solution-body")
    assert not body.is_visible()
    solution.locator("summary").press("Enter")
    assert body.is_visible()
    page.close()
