"""Pages as they come out on paper, from the light theme and from the dark one."""

from __future__ import annotations

from urllib.parse import unquote

import pytest
from conftest import weekly_but
from playwright.sync_api import Page
from visiting import CHAPTER_00, LESSON, OWN_DATA, Open, luminance, settled

pytestmark = pytest.mark.page

# one of each kind: text and tables, many figures, the longest list, wide tables, signatures
PRINTED = weekly_but(
    {"index.html", LESSON, OWN_DATA, "reproduce.html"},
    ("index.html", CHAPTER_00, LESSON, OWN_DATA, "claims.html", "assumptions.html", "errata.html",
     "reproduce.html"),
)  # fmt: skip
# A4 is 210 mm wide, less two margins of 15 mm, at 96 px to the inch
PAPER = round(180 / 25.4 * 96)
# what is of use on a screen alone
ON_SCREEN = (
    ".bd-sidebar-primary, .bd-sidebar-secondary, .bd-header-article, .prev-next-footer, "
    "#pst-back-to-top, .headerlink, .copybtn"
)

TOO_WIDE = """paper => [...document.querySelectorAll("main *")]
  .filter((e) => e.checkVisibility() && !e.closest("mjx-assistive-mml, svg, .sd-sr-only"))
  .filter((e) => e.getBoundingClientRect().right > paper + 2)
  .map((e) => `${e.localName}.${e.className} ${e.textContent.trim().slice(0, 50)}`)"""

CUT_OFF = """() => [...document.querySelectorAll("main *")]
  .filter((e) => e.checkVisibility() && !e.closest("mjx-container, .visually-hidden"))
  .filter((e) => getComputedStyle(e).display !== "inline")
  .filter((e) => getComputedStyle(e).overflowX !== "visible" && e.scrollWidth > e.clientWidth + 2)
  .map((e) => `${e.localName}.${e.className} ${e.textContent.trim().slice(0, 50)}`)"""


# all that has text of its own, each token of code too: its colour, and one that has it
INKS = """() => Object.fromEntries([...document.querySelectorAll("main *")]
  .filter((e) => e.checkVisibility() && !e.closest("svg, script, style, mjx-assistive-mml"))
  .filter((e) => [...e.childNodes].some((n) => n.nodeType === 3 && n.data.trim()))
  .map((e) => [getComputedStyle(e).color.match(/[\\d.]+/g).slice(0, 3).join(", "),
    `${e.localName}.${e.className} ${e.textContent.trim().slice(0, 30)}`]))"""

# what is painted behind anything, code too, and one box that has it
GROUNDS = """() => Object.fromEntries([...document.querySelectorAll("main *")]
  .filter((e) => e.checkVisibility() && !e.closest("svg, mjx-container"))
  .map((e) => {
    const [r, g, b, alpha = 1] = getComputedStyle(e).backgroundColor.match(/[\\d.]+/g).map(Number);
    const onWhite = [r, g, b].map((c) => alpha * c + (1 - alpha) * 255);
    return [`rgb(${onWhite.join(", ")})`, `${e.localName}.${e.className}`];
  }))"""

# words of the heads of tables that are on two lines
BROKEN = """() => {
  const broken = [];
  for (const head of document.querySelectorAll("main th")) {
    const walker = document.createTreeWalker(head, NodeFilter.SHOW_TEXT);
    for (let text; (text = walker.nextNode()); ) {
      if (text.parentElement.closest("mjx-container, code")) continue;
      for (const word of text.data.matchAll(/\\p{L}{3,}/gu)) {
        const range = document.createRange();
        range.setStart(text, word.index);
        range.setEnd(text, word.index + word[0].length);
        const lines = [...range.getClientRects()].map((box) => Math.round(box.top));
        if (new Set(lines).size > 1) broken.push(word[0]);
      }
    }
  }
  return broken;
}"""


def on_paper(open_page: Open, name: str) -> Page:
    size = {"width": PAPER, "height": 1000}
    page = open_page(name, viewport=size, color_scheme="light").page
    page.emulate_media(media="print")
    return settled(page)


@pytest.mark.parametrize("name", PRINTED)
def test_a_page_on_paper(open_page: Open, name: str) -> None:
    page = on_paper(open_page, name)
    assert page.locator(ON_SCREEN).filter(visible=True).count() == 0
    assert page.locator("main p").filter(visible=True).count() > 3
    assert page.evaluate(TOO_WIDE, PAPER) == []
    assert page.evaluate(CUT_OFF) == []
    assert page.evaluate(BROKEN) == []
    # a table over several sheets repeats its head
    heads = "[...document.querySelectorAll('main thead')].map(t => getComputedStyle(t).display)"
    assert set(page.evaluate(heads)) <= {"table-header-group"}
    black_on_white(page)
    page.emulate_media(media="print", color_scheme="dark")
    page.wait_for_function("document.documentElement.dataset.theme === 'dark'")
    settled(page)
    black_on_white(page)


def black_on_white(page: Page) -> None:
    grounds = page.evaluate(
        """() => [...document.querySelectorAll("html, body, .bd-main, .bd-content, article")]
          .map((e) => getComputedStyle(e).backgroundColor)"""
    )
    assert set(grounds) <= {"rgb(255, 255, 255)", "rgba(0, 0, 0, 0)"}
    inks = page.evaluate(INKS)
    assert inks
    pale = {ink: said for ink, said in inks.items() if max(map(int, ink.split(", "))) > 0x44}
    assert pale == {}
    behind = page.evaluate(GROUNDS)
    assert {ground: said for ground, said in behind.items() if luminance(ground) < 0.8} == {}
    filters = "[...document.querySelectorAll('main img')].map(i => getComputedStyle(i).filter)"
    assert set(page.evaluate(filters)) <= {"none"}


def test_what_is_folded_is_printed_but_for_code(open_page: Open) -> None:
    page = on_paper(open_page, OWN_DATA)
    code = page.locator("details.above-input")
    assert code.count() > 0
    assert code.locator(".cell_input").filter(visible=True).count() == 0
    said = page.evaluate(
        "getComputedStyle(document.querySelector('.above-input > summary'), '::after').content"
    )
    assert "left out" in said
    assert page.locator("details.solution .solution-body").first.is_visible()


def test_addresses_are_written_out(open_page: Open) -> None:
    page = on_paper(open_page, "bibliography.html")
    written = page.evaluate(
        """() => [...document.querySelectorAll("article a.reference.external")]
          .map((a) => [a.href, a.textContent, getComputedStyle(a, "::after").content])"""
    )
    assert written
    for address, said, shown in written:
        # behind the words, unless they are the address, and then once
        bare = unquote(address).endswith(said.removeprefix("doi:"))
        assert ("attr(href)" in shown or address in shown) != bare, address
