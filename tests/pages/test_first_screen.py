"""What a lesson loads before anything is scrolled, and that none of its code is cut."""

from __future__ import annotations

from typing import Any

import pytest
from conftest import weekly_but
from playwright.sync_api import Browser
from visiting import CHAPTER_00, PAGES, Open, settled, unfold

pytestmark = pytest.mark.page
CHAPTERS = [name for name in PAGES if name.startswith("chapters/")]
LESSONS = [name for name in CHAPTERS if "/evidence/" not in name]
DESKTOP, PHONE = {"width": 1440, "height": 900}, {"width": 360, "height": 740}
MOST = 1_500_000  # bytes

# all code and formulas that do not fit, and whether a shadow shows it
CUT = """() => [...document.querySelectorAll(
    "main :is(pre, mjx-container[display], mjx-container[data-scrolls])")]
  .filter((box) => box.checkVisibility() && box.scrollWidth > box.clientWidth + 1)
  .map((box) => [box, getComputedStyle(box)])
  .map(([box, style]) => [`${box.localName}: ${box.textContent.trim().slice(0, 60)}`,
    style.overflowX === "auto" && style.backgroundImage.includes("gradient")])"""


@pytest.mark.parametrize("name", LESSONS)
def test_a_lesson_loads_at_most_that_much(browser: Browser, served: str, name: str) -> None:
    page = browser.new_page(viewport=DESKTOP)
    session, loaded = page.context.new_cdp_session(page), list[int]()
    session.send("Network.enable")
    session.on("Network.loadingFinished", lambda end: loaded.append(end["encodedDataLength"]))
    page.goto(served + name)
    page.evaluate("document.fonts.ready.then(() => window.MathJax?.startup?.promise)")
    page.wait_for_load_state("networkidle")
    assert page.evaluate("scrollY") == 0
    assert 100_000 < sum(loaded) <= MOST
    page.close()


@pytest.mark.parametrize("name", weekly_but({*LESSONS, CHAPTER_00}, CHAPTERS))
def test_code_fits_on_a_desktop_and_shows_that_it_scrolls_on_a_phone(
    open_page: Open, name: str
) -> None:
    page = open_page(name, viewport=DESKTOP).page
    unfold(page)
    page.evaluate("for (const box of document.querySelectorAll('details')) box.open = true")
    assert [said for said, is_seen in cut(page) if said.startswith("pre") or not is_seen] == []
    page.set_viewport_size(PHONE)
    page.wait_for_function("document.documentElement.dataset.measured === '360'")
    assert [said for said, is_seen in cut(page) if not is_seen] == []


def cut(page: Any) -> list[tuple[str, bool]]:
    found: list[tuple[str, bool]] = settled(page).evaluate(CUT)
    return found
