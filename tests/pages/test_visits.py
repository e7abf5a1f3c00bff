"""The built book in a real browser: dark and narrow, its claims, its numbers."""

from __future__ import annotations

import pytest
from conftest import WHOLE
from inswsn_book.judging import judge_claims
from inswsn_book.project import Project
from playwright.sync_api import Browser
from visiting import CHAPTER_00, Open, unfold

pytestmark = pytest.mark.page


def test_claims_are_filtered_without_scripts(
    browser: Browser, served: str, project: Project
) -> None:
    page = browser.new_page(java_script_enabled=False)
    page.goto(served + "claims.html")
    chosen: dict[str, str] = {}
    for group, word in (
        (None, ""),
        ("paper", "P3"),
        ("verdict", "not reproduced"),
        ("kind", "numeric"),
    ):
        if group is not None:
            box = page.locator(f"fieldset:has(legend:text-is('{group}'))")
            box.get_by_label(word, exact=True).check()
            chosen[group] = word
        shown = page.locator(".claim").evaluate_all(
            "claims => claims.filter((claim) => claim.checkVisibility()).map((claim) => claim.id)"
        )
        assert shown == [entry.claim.anchor for entry in judge_claims(project, **chosen)]
        assert shown
    assert page.locator(".claims-shown").is_visible()
    page.close()


@pytest.mark.parametrize(
    "scripts",
    [pytest.param(True, marks=pytest.mark.whole, id="with scripts"),
     pytest.param(False, id="without scripts")],
)  # fmt: skip
def test_a_claim_and_its_cell_lead_to_each_other(
    browser: Browser, served: str, project: Project, scripts: bool
) -> None:
    """One claim of two chapters; weekly one of each chapter, and without scripts of each cell."""
    entries = {e.cell: e for e in judge_claims(project) if e.cell is not None}
    if scripts or not WHOLE:
        entries = {cell.rpartition("-")[0]: entry for cell, entry in entries.items()}
    if not WHOLE:  # the inspection of the site has followed all links
        entries = {chapter: entries[chapter] for chapter in ("printed-numbers", "p1-outages")}
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


def test_a_chapter_shows_its_figures_tables_and_numbers(open_page: Open) -> None:
    page = open_page(CHAPTER_00).page
    captions = page.locator("figcaption .caption-number").all_text_contents()
    assert [int(text.removeprefix("Fig.")) for text in captions] == [1, 2, 3, 4]  # in the page
    assert page.locator("table caption .caption-number").count() == 9
    # a number in a sentence is the recorded one, and no name of one is left
    unfold(page)
    text = page.locator("main").inner_text()
    assert "1,108,800" in text
    assert not any(word in text for word in ("glue", "Quantity(", "<Verdict"))
