"""A reader's own recording on its page, with the library in the place of Pyodide.

The section of the chapter stands on a page of its own, so that the book need not be built.
"""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from mimetypes import guess_type
from pathlib import Path
from typing import Any

import pydata_sphinx_theme
import pytest
from conftest import ROOT
from inswsn_book.live.html import SCRIPTS
from inswsn_book.live.own_data import FIGURES
from inswsn_book.live.own_page import look
from playwright.sync_api import Browser, Locator, Page, Route, expect
from test_accessibility import BY_COLOUR, OTHERS, RUN_AXE, axe_script
from visiting import OWN_DATA, boxes, settled

from inswsn_lib.errors import InswsnError

pytestmark = pytest.mark.page

SITE = "http://own.test/"
EXAMPLE = ROOT / "data" / "examples" / "ins-wsn.csv"
CHAPTER = (ROOT / "chapters" / "your-own-data.md").read_text(encoding="utf-8")
STATIC = ROOT / "book" / "_static"
THEME = Path(pydata_sphinx_theme.__file__).parent / (
    "theme/pydata_sphinx_theme/static/styles/pydata-sphinx-theme.css"
)
PAGE = """<!doctype html>
<html lang="en" data-theme="light"><head><meta charset="utf-8"><title>Your own data</title>
<meta name="viewport" content="width=device-width">
<link rel="stylesheet" href="../_static/pydata-sphinx-theme.css">
<link rel="stylesheet" href="../_static/inswsn.css">
<link rel="stylesheet" href="../_static/moving.css">
<link rel="stylesheet" href="../_static/own-data.css">
<style>body { display: block; margin: 1rem }</style>
<script src="../_static/moving.js"></script>
<script src="../_static/own-data.js"></script></head>
<body><main class="bd-content"><h1>Your own data</h1>SECTION</main></body></html>"""
LIVE = """window.inswsnLive = { noise: NOISE, call: async (what, given) => {
  const [answer, error] = await window.nativeLook(what, JSON.stringify(given));
  if (error) throw new Error(error);
  return JSON.parse(answer);
} };""".replace("NOISE", json.dumps([{"name": n} | f._asdict() for n, f in FIGURES.items()]))
DROP = """([name, text]) => {
  const data = new DataTransfer();
  data.items.add(new File([text], name));
  const zone = document.querySelector(".own-data-drop");
  for (const kind of ["dragenter", "dragover", "drop"])
    zone.dispatchEvent(
      new DragEvent(kind, { dataTransfer: data, bubbles: true, cancelable: true }));
}"""


def native_look(what: str, given: str) -> tuple[str, str]:
    assert what == "inswsn_book.live.own_page:look"
    try:
        return json.dumps(look(*json.loads(given)), allow_nan=False), ""
    except InswsnError as error:
        return "", str(error)


def fulfil(route: Route) -> None:
    """Answer from the sources of the book, as the site does."""
    name = route.request.url.removeprefix(SITE)
    (section,) = re.findall(
        r"```\{raw\} html\n(<section id=\"own-data\".*?)```", CHAPTER, re.DOTALL
    )
    if name == OWN_DATA:
        route.fulfill(body=PAGE.replace("SECTION", section), content_type="text/html")
        return
    file = Path(name).name
    known = {path.name: path for path in [*STATIC.iterdir(), *SCRIPTS.iterdir(), EXAMPLE, THEME]}
    assert name == f"_static/{file}"
    route.fulfill(path=known[file], content_type=guess_type(file)[0])


@pytest.fixture(scope="module", autouse=True)
def _loaded() -> None:
    """What Python loads the first time takes longer than a page is waited for."""
    look(EXAMPLE.read_text(encoding="utf-8"), {})


@pytest.fixture
def page(browser: Browser) -> Iterator[Page]:
    """The page, with Python; nothing may go wrong on it."""
    page, wrong = browser.new_page(), []
    page.route(f"{SITE}**", fulfil)
    page.on("console", lambda message: wrong.append(message.text))
    page.on("pageerror", lambda error: wrong.append(str(error)))
    page.expose_function("nativeLook", native_look)
    page.add_init_script(LIVE)
    page.goto(SITE + OWN_DATA)
    yield page
    page.close()
    assert wrong == []


def results(page: Page) -> Locator:
    return page.locator(".own-data-results")


def drop(page: Page, text: str, name: str = "my.csv") -> None:
    page.evaluate(DROP, [name, text])


def say(page: Page, said: str) -> None:
    """Wait until an error is said, and nothing is shown."""
    expect(page.get_by_role("alert")).to_have_text(said)
    expect(results(page)).to_be_hidden()


def test_a_file_that_is_dropped_is_filtered_and_drawn(page: Page) -> None:
    text = EXAMPLE.read_text(encoding="utf-8")
    found: dict[str, Any] = look(text, {"name": "my.csv"})
    drop(page, text)
    expect(page.get_by_role("status")).to_have_text("Done: what was found in my.csv is below.")
    assert results(page).locator("ul").first.locator("li").all_inner_texts() == found["sentences"]
    for chart, wanted in zip(
        results(page).get_by_role("img").all(), found["figure"]["charts"], strict=True
    ):
        assert chart.locator("title").text_content() == wanted["title"]
        styles = [series["style"] for series in wanted["series"]]
        assert chart.locator("polygon").count() == styles.count("band")
        assert chart.locator("polyline").count() == styles.count("line")
    for table, wanted in zip(results(page).locator("table").all(), found["tables"], strict=True):
        rows = [row.locator("th, td").all_inner_texts() for row in table.locator("tr").all()]
        assert rows == [wanted["header"], *wanted["rows"]]


def test_the_download_is_what_python_gives(page: Page) -> None:
    text = EXAMPLE.read_text(encoding="utf-8")
    drop(page, text)
    with page.expect_download() as download:
        page.get_by_role("link", name="Download the corrected track").click()
    assert download.value.suggested_filename == "my-corrected.csv"
    assert download.value.path().read_text(encoding="utf-8") == look(text, {})["csv"]


def test_a_wrong_file_is_told_in_a_sentence_and_the_next_is_shown(page: Page) -> None:
    text = EXAMPLE.read_text(encoding="utf-8")
    drop(page, "", "empty.csv")
    say(page, "empty.csv is empty; it must be a CSV file with a header.")
    drop(page, text)
    expect(results(page)).to_be_visible()
    expect(page.get_by_role("alert")).to_have_text("")
    drop(page, text.replace("0.8288", "<img src=x onerror=alert(1)>"), "<b>.csv")
    said = (
        "<b>.csv has '<img src=x onerror=alert(1)>' in column wsn_x_m, row 6; it must be a finite "
    )
    say(page, f"{said}number below 1e+15.")
    assert page.locator("#own-data :is(img, b)").count() == 0
    file = {"name": "my.csv", "mimeType": "text/csv", "buffer": b"\xff\xfe"}
    page.locator("input[type=file]").set_input_files(file)
    say(page, "my.csv is not a CSV file: it is not UTF-8.")
    page.locator("summary").click()
    expect(page.get_by_role("button", name="Compute again")).to_be_disabled()


def test_the_keyboard_does_it_all(page: Page) -> None:
    with page.expect_file_chooser() as chooser:
        page.keyboard.press("Tab")
        assert page.evaluate("document.activeElement.labels[0].textContent").startswith("Choose a")
        page.keyboard.press("Enter")
    chooser.value.set_files(EXAMPLE)
    expect(results(page).locator("h3")).to_have_text("What the filter finds in ins-wsn.csv")
    page.keyboard.press("Tab")
    assert page.evaluate("document.activeElement.textContent") == "Show an example"
    page.keyboard.press("Tab")
    page.keyboard.press("Enter")  # unfolds the figures
    page.keyboard.press("Tab")
    page.keyboard.type("0")
    for _ in FIGURES:
        page.keyboard.press("Tab")
    page.keyboard.press("Enter")
    expect(page.get_by_role("alert")).to_contain_text("wsn_position_noise must be a number above 0")
    say(page, "wsn_position_noise must be a number above 0 and below 1000, not 0.")


def test_other_figures_are_taken(page: Page) -> None:
    page.get_by_role("button", name="Show an example").click()
    expect(results(page)).to_contain_text("they fit: innovations are as large")
    page.locator("summary").click()
    page.get_by_label("Noise of network positions").fill("0.05")
    page.get_by_role("button", name="Compute again").click()
    expect(results(page)).to_contain_text("too small, or the model is wrong")
    page.get_by_label("Noise of network positions").fill("")
    page.get_by_role("button", name="Compute again").click()
    expect(page.get_by_role("alert")).to_contain_text("wsn_position_noise must be")


def test_it_fits_a_phone_and_any_theme(page: Page) -> None:
    page.evaluate(axe_script())
    page.locator("summary").evaluate("(summary) => { summary.parentElement.open = true; }")
    page.get_by_role("button", name="Show an example").click()
    expect(results(page)).to_be_visible()
    for width in (1300, 390, 320):
        page.set_viewport_size({"width": width, "height": 844})
        settled(page)
        assert page.evaluate("document.documentElement.scrollWidth") <= width
        for chart in results(page).get_by_role("img").all():
            (outer,) = boxes(chart)
            texts = boxes(chart.locator("text"))
            assert len(texts) == chart.locator("text").count()
            for box in texts:
                assert outer["left"] - 1 <= box["left"]
                assert box["right"] <= min(outer["right"], width) + 1
    for colours in ("light", "dark"):
        page.evaluate("(theme) => { document.documentElement.dataset.theme = theme; }", colours)
        settled(page)
        for options in (OTHERS, BY_COLOUR):
            assert page.evaluate(RUN_AXE, options) == [], colours


def test_without_python_nothing_is_shown(browser: Browser) -> None:
    page = browser.new_page()
    page.route(f"{SITE}**", fulfil)
    page.goto(SITE + OWN_DATA)
    expect(page.locator("#own-data")).to_be_hidden()
    page.evaluate(f"{LIVE} inswsnOwnData.start(); inswsnOwnData.start();")  # which comes later
    expect(page.locator("#own-data")).to_be_visible()
    assert page.locator("#own-data h2").count() == 1
    page.close()
