"""The front page: what the book is, a figure that moves, and code two clicks away."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
from visiting import PAGES, Open, boxes, settled

pytestmark = pytest.mark.page
FILTERS = ("which-kalman", "which-lasting", "which-worst")


def test_the_first_screen_says_what_the_book_is(open_page: Open) -> None:
    """In 120 words at most, beside the picture, each result by name; the slider comes second."""
    page = open_page("index.html", viewport={"width": 1440, "height": 900}).page
    settled(page)
    first = page.locator(".front-first")
    assert len(first.inner_text().split()) <= 120
    for name in ("LMI", "Kalman against H-infinity", "LS-SVM", "Federated", "car"):
        assert name in first.inner_text()
    assert first.get_by_role("link", name="lesson").count() == 5
    assert first.get_by_role("link", name="evidence").count() == 5
    (text,), (picture,) = boxes(first), boxes(page.locator("img[src*='front']"))
    assert max(text["bottom"], picture["bottom"]) < 900
    (slider,) = boxes(page.locator("section.moving input[type=range]"))
    assert slider["top"] > max(text["bottom"], picture["bottom"])


def test_the_figure_of_the_front_page_moves(open_page: Open) -> None:
    page = open_page("index.html", viewport={"width": 1440, "height": 900}).page
    slider = page.locator("section.moving input[type=range]")
    chart = page.locator("section.moving svg[role=img]").first
    before, said = chart.inner_html(), page.locator("section.moving dd").all_inner_texts()
    slider.press("End")
    assert chart.inner_html() != before
    assert page.locator("section.moving dd").all_inner_texts() != said


def test_an_engineer_has_code_for_each_of_three_filters_in_two_clicks(open_page: Open) -> None:
    for place in FILTERS:
        page = open_page("index.html").page
        page.locator("article").get_by_role("link", name="Which filter?").first.click()
        section = page.locator(f"section:has(> #{place}), section#{place}").first
        code = section.locator(".highlight-python, .highlight-ipython3").first
        code.scroll_into_view_if_needed()
        assert "import inswsn_lib as iw" in code.inner_text()


def test_which_filter_is_two_clicks_from_anywhere(built_site: Path) -> None:
    for name in PAGES:
        page = (built_site / name).read_text(encoding="utf-8")
        assert re.search(r'<a [^>]*href="[^"]*(which-filter|index)\.html', page), name
