"""The built book in a real browser: its front page, lessons, folds, claims and numbers."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import pytest
from conftest import WHOLE, weekly_but
from inswsn_book.judge.claims import judge_claims
from inswsn_book.record.project import Project
from inswsn_book.record.results import Results
from playwright.sync_api import Browser, expect
from visiting import CHAPTER_00, LESSON, PAGES, Open, boxes, settled, unfold

pytestmark = pytest.mark.page


def test_the_first_screen_says_what_the_book_is(open_page: Open) -> None:
    """In 120 words at most, beside the picture, each result by name; the slider comes second."""
    page = settled(open_page("index.html", viewport=DESKTOP).page)
    first = page.locator(".front-first")
    assert len(first.inner_text().split()) <= 120
    for name in ("LMI", "Kalman against H-infinity", "LS-SVM", "Federated", "car"):
        assert name in first.inner_text()
    assert first.get_by_role("link", name="lesson").count() == 5
    assert first.get_by_role("link", name="evidence").count() == 5
    (text,), (picture,) = boxes(first), boxes(page.locator("img[src*='front']"))
    assert max(text["bottom"], picture["bottom"]) < 900
    slider = page.locator("section.moving input[type=range]").first
    assert boxes(slider)[0]["top"] > max(text["bottom"], picture["bottom"])
    chart, said = (
        page.locator("section.moving svg[role=img]").first,
        page.locator("section.moving dd"),
    )
    before = chart.inner_html(), said.all_inner_texts()
    slider.press("End")
    assert before[0] != chart.inner_html()
    assert before[1] != said.all_inner_texts()


def test_an_engineer_has_code_for_each_of_three_filters_in_two_clicks(open_page: Open) -> None:
    page = open_page("index.html").page
    page.locator("article").get_by_role("link", name="Which filter?").first.click()
    for place in ("which-kalman", "which-lasting", "which-worst"):
        section = page.locator(f"section:has(> #{place}), section#{place}").first
        code = section.locator(".highlight-python, .highlight-ipython3").first
        code.scroll_into_view_if_needed()
        assert "import inswsn_lib as iw" in code.inner_text()


def test_which_filter_is_two_clicks_from_anywhere(built_site: Path) -> None:
    for name in PAGES:
        page = (built_site / name).read_text(encoding="utf-8")
        assert re.search(r'<a [^>]*href="[^"]*(which-filter|index)\.html', page), name


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


@pytest.mark.parametrize("name", weekly_but({LESSON}, LESSONS))
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


@pytest.mark.parametrize("name", weekly_but({LESSON, CHAPTER_00}, CHAPTERS))
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
    summary = folds.locator("> summary").first  # still a heading; by the keyboard, too
    assert summary.locator("h2").count() == 1
    summary.focus()
    page.keyboard.press("Enter")
    expect(folds.first).to_have_attribute("open", "")


def test_claims_are_filtered_by_styles(browser: Browser, served: str, project: Project) -> None:
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


def test_a_chapter_shows_its_figures_tables_and_numbers(
    open_page: Open, published: dict[str, Results]
) -> None:
    page = open_page(CHAPTER_00).page
    kinds = [name.split("-")[0] for name in published["printed-numbers"].words]
    captions = page.locator("figcaption .caption-number").all_text_contents()
    of_page = [*range(1, kinds.count("fig") + 1)]
    assert [int(text.removeprefix("Fig.")) for text in captions] == of_page
    assert page.locator("table caption .caption-number").count() == kinds.count("tbl")
    # a number in a sentence is the recorded one, and no name of one is left
    unfold(page)
    text = page.locator("main").inner_text()
    assert "1,108,800" in text
    assert not any(word in text for word in ("glue", "Quantity(", "<Verdict"))
