"""Every page of the built book in a real browser."""

from __future__ import annotations

from io import BytesIO
from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from playwright.sync_api import Browser, Page
from visiting import Visit, contrast, page_names, visit

from inswsn_lib.artefact.judging import judge_claims, select_claims
from inswsn_lib.artefact.project import Project

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


@pytest.mark.parametrize(
    ("scheme", "width", "height"),
    [("light", 1300, 900), ("dark", 360, 740)],
    ids=["light and wide", "dark and narrow"],
)
def test_every_page(
    browser: Browser, served: str, built_site: Path, scheme: str, width: int, height: int
) -> None:
    """All that is asked of every page; each is loaded once, since that takes longest."""
    with_mathematics = []
    for name in page_names(built_site):
        size = {"width": width, "height": height}
        seen = visit(browser, served, name, color_scheme=scheme, viewport=size)
        no_error_no_foreign_request_no_broken_image(seen, name)
        theme = seen.page.evaluate("document.documentElement.dataset.theme")
        assert theme == scheme, name
        if mathematics_is_rendered(seen.page, name):
            with_mathematics.append(name)
        # it never scrolls sideways
        needed = seen.page.evaluate("document.documentElement.scrollWidth")
        assert needed <= width, f"{name} is {needed} px wide"
        it_says_what_it_was_built_from(seen.page, name)
        seen.page.close()
    assert "chapters/00-the-published-numbers.html" in with_mathematics
    assert "api.html" in with_mathematics


def no_error_no_foreign_request_no_broken_image(seen: Visit, name: str) -> None:
    assert seen.errors == [], name
    assert seen.foreign == [], name
    assert seen.failed == [], name
    images = seen.page.evaluate(
        "Array.from(document.images, i => [i.currentSrc, i.naturalWidth > 0, i.alt])"
    )
    for source, loaded, alt in images:
        assert loaded, f"{name}: {source}"
        assert alt.strip(), f"{name}: {source}"


def mathematics_is_rendered(page: Page, name: str) -> bool:
    """Check it, and tell whether there is any."""
    asked = page.locator(".math").count()
    assert page.locator("mjx-container").count() >= asked, name
    assert page.locator("mjx-merror, .merror").count() == 0, name
    return asked > 0


def it_says_what_it_was_built_from(page: Page, name: str) -> None:
    assert "Built by inswsn" in page.locator(".extra_footer").inner_text(), name
    if name.startswith("chapters/"):
        words = page.locator("table.provenance").inner_text()
        for word in ("parameters", "seed", "commit", "locks", "data", "solvers", "thread"):
            assert word in words, name
        for word in ("Python", "cores", " s, ended "):
            assert word in words, name


def shown_claims(page: Page) -> list[str]:
    return [c.get_attribute("id") or "" for c in page.locator(".claim").all() if c.is_visible()]


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
        expected = [entry.claim.anchor for entry in select_claims(judged, **chosen)]
        assert shown_claims(page) == expected
        assert expected
    page.close()


@pytest.mark.parametrize("scripts", [True, False], ids=["with scripts", "without scripts"])
def test_a_claim_and_its_cell_lead_to_each_other(
    browser: Browser, served: str, project: Project, scripts: bool
) -> None:
    # one claim of each cell; the inspection of the site has followed all links
    entries = {e.cell: e for e in judge_claims(project) if e.cell is not None}
    if scripts:  # typesetting takes long: one of each chapter
        entries = {cell[:4]: entry for cell, entry in entries.items()}
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
