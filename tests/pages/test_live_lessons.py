"""Lessons whose cells run in the page, in a browser that reaches nothing but this machine."""

from __future__ import annotations

import json
import shutil
from collections.abc import Iterator
from http import HTTPStatus
from pathlib import Path
from typing import Any, ClassVar

import pytest
from axe_playwright_python.sync_playwright import Axe
from conftest import FLAGS, PATIENCE, QuietHandler, same, serving
from inswsn_book.live.site import lessons, put_in
from inswsn_book.record.progress import Quiet
from inswsn_book.record.project import Project
from playwright.sync_api import Browser, Locator, Page
from visiting import LESSON, OWN_DATA, WHICH, Open, opening, settled

pytestmark = pytest.mark.whole
MINUTES = 60_000
PHONE = {"viewport": {"width": 390, "height": 844}, "has_touch": True, "is_mobile": True}
sizes = pytest.mark.parametrize("size", [{}, PHONE], ids=["desk", "phone"])
NAMES = [chapter.name for chapter in lessons(Project(Path(__file__).parents[2]))]


@pytest.fixture(scope="module")
def live_site(project: Project, built_site: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A site with Python in it, as `make live` makes it.

    What `make wasm` makes has to be there: where these tests run, its lack is a failure.
    """
    site = tmp_path_factory.mktemp("live") / "html"
    shutil.copytree(built_site, site)
    if not project.live.exists():  # else the book has been built so
        put_in(project, site, Quiet())
    return site


@pytest.fixture(scope="module")
def live(live_site: Path) -> Iterator[str]:
    """Its address, served from this machine alone."""
    with serving(live_site, _Told) as address:
        yield address


@pytest.fixture
def open_live(live: str, browser: Browser) -> Iterator[Open]:
    """Open pages of it, which are closed when the test ends."""
    with opening(browser, live) as opened:
        yield opened


@pytest.fixture
def box(open_live: Open) -> Locator:
    """The cell K = 0.09 / (0.09 + 0.04) of a lesson."""
    return cells_of(open_live(LESSON).page)[-3][1]


class _Told(QuietHandler):
    """Remembers what it has sent."""

    sent: ClassVar[list[str]] = []

    def log_request(self, code: int | str = "-", size: int | str = "-") -> None:
        """Remember an answer that has a body."""
        if int(code) == HTTPStatus.OK:
            self.sent.append(self.path)


def cells_of(page: Page) -> list[tuple[int, Locator]]:
    """Return the numbers and boxes of the cells that run."""
    page.evaluate("for (const box of document.querySelectorAll('details')) box.open = true")
    known = json.loads(page.locator("#live").text_content() or "")
    boxes = page.locator(".cell:has(> .cell_input)")
    return [(i, boxes.nth(i)) for i, cell in enumerate(known["cells"]) if not cell["needs"]]


def press(box: Locator, minutes: float = 4) -> str:
    """Run a cell, and return what its status says at the end."""
    box.get_by_role("button", name="Run", exact=False).click()
    status = box.locator(".live-status")
    box.page.wait_for_function(
        "node => /^(took|failed|This needs|Stopped)/.test(node.textContent)"
        " && !document.querySelector('.live-button[disabled]')",
        arg=status.element_handle(), timeout=minutes * MINUTES,
    )  # fmt: skip
    return status.inner_text()


def write(box: Locator, text: str) -> None:
    """Have the code of a cell be a text, as if a reader had typed it."""
    code = box.locator("pre[contenteditable]")
    code.evaluate("(node, text) => { node.textContent = text }", text)
    code.dispatch_event("input")


def said(box: Locator) -> str:
    out = box.locator(".live-out")
    return (out.text_content() or "") if out.is_visible() else ""


def figures(page: Page) -> dict[str, Any]:
    script = """() => Object.fromEntries([...document.querySelectorAll("section.moving")].map(
        (root) => [root.id, inswsnMoving.read(root)]))"""
    return dict(page.evaluate(script))


@pytest.mark.parametrize("name", NAMES)
@sizes
def test_each_cell_prints_what_the_page_prints(
    name: str, size: dict[str, Any], open_live: Open
) -> None:
    seen = open_live(f"chapters/{name}.html", **size)
    page, drawn = seen.page, figures(seen.page)
    for number, box in cells_of(page):
        printed = "".join(box.locator(".cell_output > .output.stream pre").all_text_contents())
        press(box)
        assert said(box).strip() == printed.strip(), f"cell {number + 1}"
        again = press(box)  # at most a second, or it says why not
        at_once = float(again.split()[1]) < 1
        assert at_once or "computed all its numbers again" in again, f"cell {number + 1}"
    after = figures(page)
    assert all(same(after[key]["charts"], drawn[key]["charts"]) for key in drawn)
    assert seen.wrong == []


def test_a_changed_number_gives_the_changed_answer(box: Locator) -> None:
    code = box.locator("pre[contenteditable]")
    first = code.text_content() or ""
    assert "K = 0.09" in first
    write(box, first.replace("0.04", "0.09"))
    press(box)
    assert said(box).startswith("K = 0.500, blend 1.150 m")
    box.get_by_role("button", name="Reset").click()
    assert code.text_content() == first
    assert not said(box)


def test_it_is_typed_and_run_by_the_keyboard(box: Locator) -> None:
    page = box.page
    box.locator("pre[contenteditable]").focus()
    page.keyboard.press("Control+End")
    page.keyboard.type("\nprint(2 +\n 40)")
    page.keyboard.press("Control+Enter")
    box.locator(".live-out", has_text="42").wait_for(timeout=2 * MINUTES)
    for _ in range(2):  # out of the code, by its button for copying
        page.keyboard.press("Tab")
    assert page.evaluate("document.activeElement.textContent") == "Run"


def test_a_run_can_be_stopped(box: Locator) -> None:
    write(box, "while True: pass")
    box.get_by_role("button", name="Run").click()
    box.locator(".live-status", has_text="runs").wait_for(timeout=2 * MINUTES)
    box.get_by_role("button", name="Stop").click()
    box.locator(".live-status", has_text="Stopped").wait_for()
    write(box, "print(6 * 7)")
    press(box)
    assert said(box) == "42\n"


def test_a_parameter_runs_what_needs_it(open_live: Open) -> None:
    page = open_live(LESSON).page
    before = figures(page)
    field = page.get_by_label("seed")
    field.fill("1")
    field.press("Enter")
    page.wait_for_function(
        """() => document.querySelector(".live-button[disabled]") === null
        && /^took/.test([...document.querySelectorAll(".live-status")].at(-1).textContent)""",
        timeout=4 * MINUTES,
    )
    after = figures(page)
    changed = {key for key in after if after[key]["charts"] != before[key]["charts"]}
    assert {"fig-l2-map-moving", "fig-l2-instruments-moving"} <= changed
    assert "fig-l2-bells-moving" not in changed
    assert "seed: int = 1 " in (page.locator("pre[contenteditable]").first.text_content() or "")


def test_what_is_missing_is_said_and_the_next_offered(open_live: Open) -> None:
    page = open_live("chapters/3-plan-for-the-worst.html").page
    bar = page.locator(".live-bar", has_text="it needs cvxpy").first
    link = bar.get_by_role("link", name="To the next that runs.")
    target = page.locator(link.get_attribute("href") or "")
    assert target.get_attribute("contenteditable") == "plaintext-only"


LESS_SURE = ("+ q * Q", "+ 50 * q * Q")  # in the Kalman filter of lesson 2


def test_what_is_out_of_date_is_marked_and_what_is_untrue_is_named(open_live: Open) -> None:
    page = open_live(LESSON).page
    cells = dict(cells_of(page))
    number = next(n for n, box in cells.items() if LESS_SURE[0] in (box.inner_text() or ""))
    box = cells[number]
    write(box, (box.locator("pre[contenteditable]").text_content() or "").replace(*LESS_SURE))
    status = press(box)  # a cell below fails, and what does not need it runs all the same
    failed = [n for n in cells if "failed" in cells[n].locator(".live-status").inner_text()]
    assert failed == [number + 2]  # the library agrees no longer
    assert "Failed: 1 other cell. No longer true: With the right size of Q it is too" in status
    told = box.locator(".live-told")  # the error stands where the cause is, with links both ways
    assert "AssertionError" in told.inner_text()
    link = cells[number + 2].locator(".live-bar a")
    code = box.locator("pre[contenteditable]")
    assert link.get_attribute("href") == f"#{code.get_attribute('id')}"
    assert told.locator("a").inner_text() == f"cell {number + 3}"
    assert said(cells[number + 2]) == "AssertionError"
    assert "Out of date" not in status
    box.get_by_role("button", name="Reset").click()
    told = [cells[n].locator(".live-status").inner_text() for n in cells if n >= number]
    assert set(told) <= {"as in the book", ""}
    assert page.locator(".live-out:visible").count() == 0


def test_all_cells_are_run_and_put_back(open_live: Open) -> None:
    page = open_live(LESSON).page
    cells = [box for _, box in cells_of(page)]
    write(cells[-3], "x = 'a word'  # changed\nfor k in range(3): print(k)")
    page.get_by_role("button", name="Run all", exact=True).click()
    page.get_by_text("All have run").wait_for(timeout=4 * MINUTES)
    assert all(box.locator(".live-status").inner_text().startswith("took") for box in cells)
    counts = (
        "() => Object.fromEntries([...CSS.highlights].map(([name, found]) => [name, found.size]))"
    )
    kinds = {f"live-{kind}": n for kind, n in (("comment", 1), ("string", 1), ("number", 1))}
    assert page.evaluate(counts) == kinds | {"live-keyword": 2}
    page.get_by_role("button", name="Reset all", exact=True).click()
    assert {box.locator(".live-status").inner_text() for box in cells} == {"as in the book"}
    assert set(page.evaluate(counts).values()) == {0}


def test_boxes_keep_their_names_on_a_phone(open_live: Open) -> None:
    page = open_live(LESSON, **PHONE).page
    page.wait_for_function("() => document.documentElement.dataset.measured")
    boxes = page.locator("pre[contenteditable]")
    names = boxes.evaluate_all("nodes => nodes.map((node) => node.getAttribute('aria-label'))")
    assert len(names) > 10
    assert all(name.startswith("Code of cell ") for name in names)


@pytest.mark.parametrize(
    ("name", "said"), [(OWN_DATA, "Recording and figures fit"), (WHICH, "Take the Kalman filter")]
)
def test_a_file_is_looked_at_by_the_python_of_the_page(
    name: str, said: str, open_live: Open
) -> None:
    page = open_live(name).page
    page.get_by_role("button", name="Show an example").click()
    page.locator(".own-data-results", has_text=said).wait_for(timeout=4 * MINUTES)
    assert cells_of(page)


def test_cells_that_do_not_run_say_whose_numbers_they_show(open_live: Open) -> None:
    page = open_live(f"chapters/{NAMES[5]}.html").page
    bars = page.locator(".live-bar", has_text="not yours")
    assert bars.count() == 0
    page.get_by_label("seed").fill("7")
    page.get_by_label("seed").press("Enter")
    told = page.locator(".live-status", has_text="since not in the page")
    told.wait_for(timeout=8 * MINUTES)
    assert f"{bars.count()} other cells" in told.inner_text()
    page.get_by_role("button", name="Reset cell 1", exact=True).click()
    assert bars.count() == 0
    field = page.get_by_label("lateral")
    field.fill("-1")
    field.press("Enter")
    assert not field.evaluate("field => field.validity.valid")


def test_the_first_press_loads_at_most_20_mb(live_site: Path) -> None:
    files = (live_site / "_static" / "live").iterdir()
    assert sum(path.stat().st_size for path in files) < 20e6


def test_nothing_is_loaded_before_the_first_press_nor_twice(
    live: str, browser: Browser, chromium: str, tmp_path: Path
) -> None:
    """In a browser that keeps files on disk, as a reader's does."""
    context = browser.browser_type.launch_persistent_context(
        tmp_path, executable_path=chromium, args=FLAGS
    )
    context.set_default_timeout(PATIENCE)
    loaded = []
    for name in (LESSON, f"chapters/{NAMES[0]}.html"):
        page = context.new_page()
        _Told.sent.clear()
        page.goto(live + name)
        page.wait_for_load_state("networkidle")
        assert not [path for path in _Told.sent if "/live/" in path or "worker" in path]
        press(cells_of(page)[0][1])
        loaded.append([path for path in _Told.sent if "/live/" in path])
    context.close()
    first, second = loaded
    assert len(first) > 5
    assert second == []


@sizes
@pytest.mark.parametrize("name", [LESSON, OWN_DATA])
def test_axe_finds_nothing(name: str, size: dict[str, Any], open_live: Open) -> None:
    page = open_live(name, **size).page
    if name == LESSON:
        press(cells_of(page)[-3][1])
    found = Axe().run(settled(page))
    assert found.violations_count == 0, found.generate_report()


def test_from_a_file_it_names_a_server(live_site: Path, browser: Browser) -> None:
    page = browser.new_page()
    page.goto((live_site / LESSON).as_uri())
    assert "python -m http.server" in page.locator(".live-bar").inner_text()
    assert page.get_by_role("button", name="Run cell").count() == 0
    page.close()


def test_what_a_reader_types_reaches_neither_page_nor_other_hosts(box: Locator) -> None:
    write(box, "import js\nprint(hasattr(js, 'document'), '<b>bold</b>')")
    press(box)
    assert said(box) == "False <b>bold</b>\n"
    assert box.locator(".live-out b").count() == 0
    policy = box.page.locator("meta[http-equiv=Content-Security-Policy]")
    assert "connect-src 'self'" in (policy.get_attribute("content") or "")
    blocked = "() => fetch('http://localhost:1/').then(() => 'reached', (error) => error.message)"
    assert box.page.evaluate(blocked) != "reached"
