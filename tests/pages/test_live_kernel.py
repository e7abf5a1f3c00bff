"""The book on the reader's own machine, as `make serve LIVE=1` serves it, in a browser."""

from __future__ import annotations

import time
from collections.abc import Iterator
from pathlib import Path

import pytest
from inswsn_book.live.measured import sources_of
from inswsn_book.live.serve import Served
from inswsn_book.project import Project
from playwright.sync_api import Browser, Page, expect
from serving import serving
from test_accessibility import axe_finds_nothing
from visiting import LESSON, OWN_DATA, Visit, unfold, visit, weekly_but

pytestmark = pytest.mark.page

TEN_LINES = "chapters/evidence/61-the-column-that-slipped.html"
EVIDENCE = "chapters/evidence/p1-training.html"
LONG = 120_000  # ms, for a kernel that starts on a busy machine, and what it imports


@pytest.fixture(scope="module")
def live(project: Project, built_site: Path) -> Iterator[Served]:
    """The built book, served with kernels."""
    assert built_site == project.site
    with serving(project) as served:
        yield served


def site_of(live: Served) -> str:
    return live.address.partition("#")[0]


def opened(browser: Browser, live: Served, name: str) -> Visit:
    """Come to a page by the address that was printed, and a link from there."""
    seen = visit(browser, site_of(live), "#" + live.address.partition("#")[2])
    assert seen.page.url == site_of(live)  # the token is not left in the address
    seen.page.locator(f"nav a[href$='{name}'], a[href$='{name}']").first.click()
    seen.page.wait_for_url(f"**/{name}")
    return seen


def run(page: Page, cell: int, code: str | None = None) -> None:
    """Press Run at a cell, by its number from 1, with other code if that is given."""
    if code is not None:
        page.get_by_role("textbox", name=f"Code of cell {cell}", exact=True).fill(code)
    page.get_by_role("button", name=f"Run cell {cell}", exact=True).click()


def says(page: Page, cell: int, text: str) -> None:
    said = page.get_by_label(f"What cell {cell} says", exact=True)
    expect(said).to_contain_text(text, timeout=LONG)


def took(page: Page, cell: int) -> None:
    button = page.get_by_role("button", name=f"Run cell {cell}", exact=True)
    status = page.locator(".live-bar").filter(has=button).get_by_role("status")
    expect(status).to_contain_text("took", timeout=LONG)


def begins(page: Page, flag: Path) -> None:
    """Wait until a cell has written a file: what it prints is shown at its end."""
    end = time.monotonic() + LONG / 1000
    while not flag.exists():
        assert time.monotonic() < end
        page.wait_for_timeout(50)


def test_cells_run_on_this_machine_with_all_that_is_installed(
    browser: Browser, live: Served, tmp_path: Path
) -> None:
    seen = opened(browser, live, LESSON)
    run(seen.page, 2, "import cvxpy, scipy, torch\nprint(6 * 7, torch.ones(2).sum())")
    says(seen.page, 2, "42 tensor(2.)")
    run(seen.page, 2, "1 / 0")
    says(seen.page, 2, "ZeroDivisionError: division by zero")
    page, flag = seen.page, tmp_path / "begun"
    run(page, 2, f"open({str(flag)!r}, 'w').close()\nimport time\ntime.sleep(600)")
    expect(page.locator(".live-status").filter(has_text="runs")).to_have_count(1, timeout=LONG)
    begins(page, flag)
    page.get_by_role("button", name="Stop cell 2", exact=True).click()
    says(page, 2, "KeyboardInterrupt")
    run(page, 2, "%matplotlib inline\nfrom matplotlib import pyplot\npyplot.plot([1, 2]);")
    expect(page.locator("img.live-image")).to_have_count(1, timeout=LONG)
    assert page.locator("img.live-image").evaluate("(image) => image.decode()") is None
    page.get_by_role("button", name="Reset cell 2", exact=True).click()
    assert page.locator("img.live-image").count() == 0
    assert seen.wrong == []
    page.close()


def test_a_page_sends_the_cells_that_are_folded_or_not_shown(
    browser: Browser, live: Served, project: Project
) -> None:
    seen = opened(browser, live, OWN_DATA)
    page = seen.page
    with page.expect_request("**/live/run") as sent:
        run(page, 4)
    posted = sent.value.post_data_json
    assert posted["wanted"] == [3]
    own = sources_of(project, OWN_DATA.removeprefix("chapters/").removesuffix(".html"))
    assert [source.strip() for source in posted["sources"]] == own
    took(page, 4)
    assert seen.wrong == []
    page.close()


def test_another_tab_has_no_token_and_runs_nothing(browser: Browser, live: Served) -> None:
    page = browser.new_page()
    page.goto(site_of(live) + LESSON)
    run(page, 1)
    expect(page.get_by_role("status").first).to_contain_text("make serve LIVE=1")
    page.close()


def moves(page: Page) -> None:
    chart = page.locator("section.moving svg[role=img]").first
    before = chart.inner_html()
    page.locator("section.moving input[type=range]").first.press("End")
    assert chart.inner_html() != before


@pytest.mark.parametrize("name", weekly_but({LESSON}, ["index.html", LESSON, EVIDENCE]))
def test_a_page_does_all_that_it_does_elsewhere(browser: Browser, live: Served, name: str) -> None:
    """Its policy keeps nothing of it away: figures, formulas, the themes."""
    seen = visit(browser, site_of(live), name)
    page = seen.page
    unfold(page)
    if page.locator("section.moving").count():
        moves(page)
    assert page.locator("mjx-container").count() > 0
    before = page.evaluate("document.documentElement.dataset.mode")
    page.locator("button.theme-switch-button:visible").first.click()
    assert page.evaluate("document.documentElement.dataset.mode") != before
    assert seen.wrong == []
    page.close()


@pytest.mark.parametrize("name", weekly_but({LESSON}, ["index.html", LESSON, TEN_LINES]))
def test_axe_finds_nothing_at_the_buttons(browser: Browser, live: Served, name: str) -> None:
    # the driver of the browser waits by scripts that no policy lets run
    seen = visit(
        browser, site_of(live), name, bypass_csp=True, color_scheme="light", reduced_motion="reduce"
    )
    axe_finds_nothing(seen.page, name)
    seen.page.close()


def test_the_search_finds(browser: Browser, live: Served) -> None:
    seen = visit(browser, site_of(live), "search.html?q=Kalman")
    expect(seen.page.locator("#search-results li").first).to_be_visible(timeout=LONG)
    assert seen.wrong == []
    seen.page.close()
