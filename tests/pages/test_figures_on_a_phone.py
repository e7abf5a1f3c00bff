"""No figure is wider than a phone, folded or not; the full size is a link away."""

from __future__ import annotations

import pytest
from conftest import weekly_but
from playwright.sync_api import Browser
from visiting import CHAPTER_00, PAGES, boxes, settled, visit

pytestmark = pytest.mark.page
CHAPTERS = [name for name in PAGES if name.startswith("chapters/")]
LESSONS = {name for name in CHAPTERS if name.startswith("chapters/0")}


@pytest.mark.parametrize("name", weekly_but({*LESSONS, CHAPTER_00}, CHAPTERS))
def test_no_figure_is_wider_than_a_phone(browser: Browser, served: str, name: str) -> None:
    options = {"width": 390, "height": 844}
    page = visit(browser, served, name, viewport=options).page
    page.evaluate("for (const box of document.querySelectorAll('details')) box.open = true")
    settled(page)
    parts = page.locator("main figure, main figure img, main section.moving")
    assert max((box["right"] for box in boxes(parts)), default=0) <= options["width"]
    for link in page.locator("figure a.full-size").all():
        assert str(link.get_attribute("href")).endswith(".svg")
    page.close()
