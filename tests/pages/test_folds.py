"""Evidence folds its sections below what it found: links open them, a button opens all."""

from __future__ import annotations

import pytest
from playwright.sync_api import expect
from visiting import CHAPTER_00, Open

pytestmark = pytest.mark.page


def test_a_link_into_a_folded_section_opens_it_and_the_others_stay(open_page: Open) -> None:
    for place in ("fig-printed-numbers-drift", "printed-numbers-period"):
        page = open_page(f"{CHAPTER_00}#{place}").page
        page.locator("#fig-printed-numbers-drift").wait_for(state="visible")
        assert page.locator("details.fold[open]").count() == 1


def test_all_is_folded_at_first_but_what_it_found(open_page: Open) -> None:
    page = open_page(CHAPTER_00).page
    folds = page.locator("details.fold")
    assert folds.count() >= 10
    assert page.locator("details.fold[open]").count() == 0
    assert page.locator(".bd-article > section > .admonition").first.is_visible()
    page.get_by_role("button", name="Unfold all").click()
    assert page.locator("details.fold[open]").count() == folds.count()
    page.get_by_role("button", name="Fold all").click()
    assert page.locator("details.fold[open]").count() == 0


def test_a_heading_of_a_folded_section_is_still_one(open_page: Open) -> None:
    """By the keyboard, too: the tab reaches it and Enter opens it."""
    page = open_page(CHAPTER_00).page
    summary = page.locator("details.fold > summary").first
    assert summary.locator("h2").count() == 1
    summary.focus()
    page.keyboard.press("Enter")
    expect(page.locator("details.fold").first).to_have_attribute("open", "")
