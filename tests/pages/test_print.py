"""Pages as they come out on paper, from the light theme and from the dark one."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
from playwright.sync_api import Browser, Page
from visiting import visit

pytestmark = pytest.mark.page

# one of each kind: text and tables, many figures, the longest list, wide tables, signatures
PRINTED = [
    "index.html",
    "chapters/00-the-published-numbers.html",
    "chapters/90-your-own-data.html",
    "claims.html",
    "assumptions.html",
    "errata.html",
]
# A4 is 210 mm wide, less two margins of 15 mm, at 96 px to the inch
PAPER = round(180 / 25.4 * 96)

TOO_WIDE = """paper => [...document.querySelectorAll("main *")]
  .filter((e) => e.checkVisibility() && !e.closest("mjx-assistive-mml, svg, .sd-sr-only"))
  .filter((e) => e.getBoundingClientRect().right > paper + 2)
  .map((e) => `${e.localName}.${e.className} ${e.textContent.trim().slice(0, 50)}`)"""

CUT_OFF = """() => [...document.querySelectorAll("main *")]
  .filter((e) => e.checkVisibility() && !e.closest("mjx-container, .visually-hidden"))
  .filter((e) => getComputedStyle(e).display !== "inline")
  .filter((e) => getComputedStyle(e).overflowX !== "visible" && e.scrollWidth > e.clientWidth + 2)
  .map((e) => `${e.localName}.${e.className} ${e.textContent.trim().slice(0, 50)}`)"""


def on_paper(browser: Browser, served: str, name: str, scheme: str) -> Page:
    size = {"width": PAPER, "height": 1000}
    page = visit(browser, served, name, viewport=size, color_scheme=scheme).page
    page.wait_for_load_state("load")
    page.emulate_media(media="print")
    return page


@pytest.mark.parametrize("name", PRINTED)
def test_a_page_on_paper(browser: Browser, served: str, name: str) -> None:
    page = on_paper(browser, served, name, "light")
    for screen in (
        ".bd-sidebar-primary",
        ".bd-sidebar-secondary",
        ".bd-header-article",
        ".prev-next-footer",
        "#pst-back-to-top",
        ".headerlink",
        ".copybtn",
    ):
        assert page.locator(screen).filter(visible=True).count() == 0, screen
    assert page.locator("main p").filter(visible=True).count() > 3
    assert page.evaluate(TOO_WIDE, PAPER) == []
    assert page.evaluate(CUT_OFF) == []
    black_on_white(page)
    page.emulate_media(media="print", color_scheme="dark")
    page.wait_for_function("document.documentElement.dataset.theme === 'dark'")
    black_on_white(page)
    page.close()


def black_on_white(page: Page) -> None:
    grounds = page.evaluate(
        """() => [...document.querySelectorAll("html, body, .bd-main, .bd-content, article")]
          .map((e) => getComputedStyle(e).backgroundColor)"""
    )
    assert set(grounds) <= {"rgb(255, 255, 255)", "rgba(0, 0, 0, 0)"}
    inks = page.evaluate(
        "() => [...document.querySelectorAll('main p, main td, main pre, main h2, main code')]"
        ".filter((e) => e.checkVisibility()).map((e) => getComputedStyle(e).color)"
    )
    brightest = max(max(map(int, ink[4:-1].split(", ")[:3])) for ink in set(inks))
    assert brightest <= 0x44
    filters = page.evaluate(
        "[...document.querySelectorAll('main img')].map(i => getComputedStyle(i).filter)"
    )
    assert set(filters) <= {"none"}


def test_what_is_folded_is_printed_but_for_code(browser: Browser, served: str) -> None:
    page = on_paper(browser, served, "chapters/90-your-own-data.html", "light")
    code = page.locator("details.above-input")
    assert code.count() > 0
    assert code.locator(".cell_input").filter(visible=True).count() == 0
    said = page.evaluate(
        "getComputedStyle(document.querySelector('.above-input > summary'), '::after').content"
    )
    assert "left out" in said
    solution = page.locator("details.solution .solution-body").first
    assert solution.is_visible()
    page.close()


def test_addresses_are_written_out(browser: Browser, served: str) -> None:
    page = on_paper(browser, served, "bibliography.html", "light")
    written = page.evaluate(
        """() => [...document.querySelectorAll("article a.reference.external:not(.bare)")]
          .map((a) => [a.getAttribute("href"), getComputedStyle(a, "::after").content])"""
    )
    assert written
    for address, shown in written:
        assert "attr(href)" in shown or address in shown
    page.close()


def test_a_table_over_several_sheets_repeats_its_head(browser: Browser, served: str) -> None:
    page = on_paper(browser, served, "errata.html", "light")
    heads = page.evaluate(
        "[...document.querySelectorAll('main thead')].map(t => getComputedStyle(t).display)"
    )
    assert set(heads) == {"table-header-group"}
    page.close()


def test_a_sheet_is_made(browser: Browser, served: str, tmp_path: Path) -> None:
    page = on_paper(browser, served, "index.html", "dark")
    sheet = tmp_path / "index.pdf"
    page.pdf(path=sheet, format="A4")
    content = sheet.read_bytes()
    assert content.startswith(b"%PDF")
    boxes = re.findall(rb"/MediaBox \[([\d. ]+)\]", content)
    size = np.array([box.split() for box in boxes], dtype=float)[:, 2:]
    # a point is 1/72 inch; the front page needs more than one sheet, and fewer than ten
    assert 1 < len(size) < 10
    np.testing.assert_allclose(size, [[210 / 25.4 * 72, 297 / 25.4 * 72]] * len(size), atol=1)
    page.close()
