"""The front page: a figure that moves on its first screen, and code two clicks away."""

from __future__ import annotations

import pytest
from playwright.sync_api import Browser
from visiting import PAGES, boxes, settled, visit

pytestmark = pytest.mark.page
FILTERS = ("which-kalman", "which-lasting", "which-worst")


def test_the_first_screen_has_a_figure_that_moves(browser: Browser, served: str) -> None:
    page = visit(browser, served, "index.html", viewport={"width": 1440, "height": 900}).page
    slider = page.locator("section.moving input[type=range]")
    settled(page)
    (box,) = boxes(slider)
    assert box["bottom"] < 900
    chart = page.locator("section.moving svg[role=img]").first
    before, said = chart.inner_html(), page.locator("section.moving dd").all_inner_texts()
    slider.press("End")
    assert chart.inner_html() != before
    assert page.locator("section.moving dd").all_inner_texts() != said
    page.close()


def test_an_engineer_has_code_for_each_of_three_filters_in_two_clicks(
    browser: Browser, served: str
) -> None:
    for place in FILTERS:
        page = visit(browser, served, "index.html").page
        page.locator("article").get_by_role("link", name="Which filter?").first.click()
        section = page.locator(f"section:has(> #{place}), section#{place}").first
        code = section.locator(".highlight-python, .highlight-ipython3").first
        code.scroll_into_view_if_needed()
        assert "import inswsn_lib as iw" in code.inner_text()
        page.close()


def test_which_filter_is_two_clicks_from_anywhere(browser: Browser, served: str) -> None:
    for name in PAGES[:: len(PAGES) // 8]:
        page = visit(browser, served, name).page
        links = page.locator("a[href*='which-filter']")
        home = page.locator("a[href*='index.html'], a[href='#'].navbar-brand, a.navbar-brand")
        assert links.count() + home.count() > 0, name
        page.close()
