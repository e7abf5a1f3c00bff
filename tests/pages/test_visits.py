"""Every page of the built book in a real browser."""

from __future__ import annotations

from io import BytesIO
from pathlib import Path

import numpy as np
import pytest
from inswsn_book.judging import judge_claims
from inswsn_book.project import Project
from PIL import Image
from playwright.sync_api import Browser, Page
from visiting import contrast, it_is_whole, page_names, visit

pytestmark = pytest.mark.page


def test_every_page_of_the_contents_is_there(built_site: Path) -> None:
    expected = {
        "index.html",
        "chapters/00-the-published-numbers.html",
        "chapters/90-your-own-data.html",
        "claims.html",
        "cite.html",
        "notation.html",
        "reproduce.html",
        "api.html",
        "bibliography.html",
    }
    assert expected <= set(page_names(built_site))


def test_pages_that_are_opened_dark_and_narrow(
    browser: Browser, served: str, built_site: Path, whole: bool
) -> None:
    """Some pages, all with INSWSN_TESTS=whole; test_accessibility.py opens each light and wide."""
    some = {
        "index.html",
        "claims.html",
        "chapters/02-kalman-against-h-infinity.html",
        "chapters/71-two-filters-become-one.html",
    }
    names = page_names(built_site)
    assert some <= set(names)
    size = {"width": 360, "height": 740}
    for name in names if whole else sorted(some):
        seen = visit(browser, served, name, color_scheme="dark", viewport=size)
        it_is_whole(seen, name)
        assert seen.page.evaluate("document.documentElement.dataset.theme") == "dark"
        assert seen.page.evaluate("document.documentElement.scrollWidth") <= 360, name
        seen.page.close()


def shown_claims(page: Page) -> list[str]:
    return list(
        page.locator(".claim").evaluate_all(
            "claims => claims.filter((claim) => claim.checkVisibility()).map((claim) => claim.id)"
        )
    )


def test_claims_are_filtered_without_scripts(
    browser: Browser, served: str, project: Project
) -> None:
    judged = judge_claims(project)
    page = browser.new_page(java_script_enabled=False)
    page.goto(served + "claims.html")
    assert shown_claims(page) == [entry.claim.anchor for entry in judged]
    assert page.locator(".claims-shown").is_visible()
    for group, word, chosen in (
        ("paper", "P3", {"paper": "P3"}),
        ("verdict", "reproduced", {"paper": "P3", "verdict": "reproduced"}),
        ("kind", "numeric", {"paper": "P3", "verdict": "reproduced", "kind": "numeric"}),
    ):
        page.locator(f"fieldset:has(legend:text-is('{group}'))").get_by_label(
            word, exact=True
        ).check()
        expected = [entry.claim.anchor for entry in judge_claims(project, **chosen)]
        assert shown_claims(page) == expected
        assert expected
    page.close()


@pytest.mark.parametrize("scripts", [True, False], ids=["with scripts", "without scripts"])
def test_a_claim_and_its_cell_lead_to_each_other(
    browser: Browser, served: str, project: Project, scripts: bool, whole: bool
) -> None:
    # one claim of each cell; the inspection of the site has followed all links
    entries = {e.cell: e for e in judge_claims(project) if e.cell is not None}
    if scripts or not whole:  # takes long: one of each chapter
        entries = {cell[:4]: entry for cell, entry in entries.items()}
    if scripts and not whole:  # typesetting takes longer
        entries = {chapter: entries[chapter] for chapter in ("ch00", "ch03")}
    page = browser.new_page(java_script_enabled=scripts)
    page.goto(f"{served}claims.html")
    for entry in entries.values():
        claim = page.locator(f"#{entry.claim.anchor}")
        assert str(entry.verdict) in claim.inner_text()
        claim.get_by_role("link", name=f"cell {entry.cell}").click()
        page.wait_for_url(f"**#cell-{entry.cell}")
        note = page.locator(f"#cell-{entry.cell}")
        if note.locator("summary").count():  # many claims are folded
            note.locator("summary").click()
        note.get_by_role("link", name=entry.claim.id, exact=True).click()
        page.wait_for_url(f"**/claims.html#{entry.claim.anchor}")
    page.close()


def test_chapter_00_shows_its_figures_tables_and_numbers(browser: Browser, served: str) -> None:
    page = visit(browser, served, "chapters/00-the-published-numbers.html").page
    captions = page.locator("figcaption .caption-number").all_inner_texts()
    assert [text.strip() for text in captions] == ["Fig. 1", "Fig. 2", "Fig. 3", "Fig. 4"]
    assert page.locator("table caption .caption-number").count() == 8
    assert page.locator("main table:not(:has(th))").count() == 0
    assert page.locator("mjx-container").count() > 0
    # a number in a sentence is the recorded one, and no name of one is left
    text = page.locator("main").inner_text()
    assert "1,108,800" in text
    assert "glue" not in text
    assert "Quantity(" not in text
    assert "<Verdict" not in text
    page.close()


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_text_and_figures_stand_out(browser: Browser, served: str, scheme: str) -> None:
    name = "chapters/00-the-published-numbers.html"
    page = visit(browser, served, name, color_scheme=scheme).page
    assert contrast(page, "main p") >= 7
    assert contrast(page, "main figcaption p, main figcaption") >= 4.5
    # the ink of a figure, as it is painted: its darkest or lightest pixel against its ground
    figure = page.locator("main figure img").first
    figure.scroll_into_view_if_needed()
    pixels = np.asarray(Image.open(BytesIO(figure.screenshot())).convert("L"), dtype=float)
    ground = np.median(pixels)
    assert (ground > 200) == (scheme == "light")
    assert np.abs(pixels - ground).max() > 150
    page.close()
