"""The labs in a browser: their numbers are those of the library, wherever a slider stands."""

from __future__ import annotations

import json
import re
from collections.abc import Callable, Iterator
from functools import cache
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from bs4 import BeautifulSoup
from numpy.typing import NDArray
from PIL import Image
from playwright.sync_api import Browser, Locator, Page
from scipy.spatial.distance import cdist
from visiting import Visit, contrast_of, luminance, visit

from inswsn_lib.evaluation import mean_absolute_error
from inswsn_lib.filters import design_kalman, run_hinfinity, run_kalman
from inswsn_lib.learning import BackpropRegressor, LSSVMRegressor, Scale
from inswsn_lib.lmi import design_filter
from inswsn_lib.models import ErrorModel

pytestmark = pytest.mark.page

Array = NDArray[np.float64]
Numbers = dict[str, Array]  # by the key of a row: position and velocity
KINDS = ("gain", "kernel")
SEED = 2012  # of the published run of both chapters
CLOSE = {"rtol": 1e-6, "atol": 1e-12}


# ---------------------------------------------------------------- what the library says


class GainByLibrary:
    """Chapter 71's four methods by the library, from the data of the page."""

    def __init__(self, data: dict[str, Any]) -> None:
        self.data = data
        self.designed = cache(self._designed)

    def _model(self, name: str, place: float) -> ErrorModel:
        run = self.data["runs"][name]
        process = 10 ** (place / 2) * np.array(run["noise"]["process"])
        return ErrorModel(
            A=np.array([[1, run["period"]], [0, 1]]), B=np.diag(process), C=np.eye(2),
            D=np.diag(run["noise"]["measurement"]), L=np.eye(2), E=np.zeros((2, 2)),
            period=run["period"],
        )  # fmt: skip

    def _designed(self, area: str, place: float) -> Any:
        return design_filter(self._model(f"{area}x", place))

    def __call__(self, state: dict[str, Any]) -> Numbers:
        run = self.data["runs"][state["run"]]
        ins, network = (np.array(run[key])[:, :, None] for key in ("ins", "network"))
        y, model = ins - network, self._model(state["run"], state["ratio"])
        by_hand = (model, state["gain"] * model.A)
        at_once: dict[str, Any] = {"initial_state": y[0], "predicted": False}
        design = self.designed(state["run"][0], state["ratio"])
        left = {
            "kf": ins - run_kalman(model, y, initial_covariance=1e6 * np.eye(2)),
            "hf": ins - run_hinfinity(design, y, **at_once),
            "constant": ins - run_hinfinity(by_hand, y, **at_once),
            "network": network,
        }
        return {key: mean_absolute_error(errors)[:, 0] for key, errors in left.items()}


class KernelByLibrary:
    """Chapter 72's learners by the library, trained anew on the data of the page."""

    def __init__(self, data: dict[str, Any]) -> None:
        self.data = data
        self.prepared = cache(self._prepared)

    def _prepared(self, area: str, name: str) -> tuple[Array, Array, Array, Array]:
        """Return the errors of the INS, inputs, targets, and what the networks leave."""
        half = self.data["areas"][area]
        ins, targets = np.array(half["ins"]), np.array(half["targets"])
        source = {"time": np.array(half["time"])[:, None], "oracle": ins}.get(name)
        source = np.array(half["motion"]) if source is None else source
        scale = Scale.of(source[: len(targets)], "standard" if name == "motion" else "none")
        X = scale.transform(source)
        network = BackpropRegressor(
            hidden=10, validation_share=0.15, epochs=100, random_state=SEED,
            networks=len(half["networks"][name]["weights"]),
        ).fit(X[: len(targets)], targets)  # fmt: skip
        return ins, X, targets, ins - network.predict_each(X)

    def __call__(self, state: dict[str, Any]) -> Numbers:
        ins, X, targets, networks = self.prepared(state["area"], state["input"])
        machine = LSSVMRegressor(10 ** state["width"], 10 ** state["eta"])
        left = ins - machine.fit(X[: len(targets)], targets).predict(X)
        rows = slice(len(targets), len(targets) + int(state["length"]))
        columns = [int(state["axis"]), int(state["axis"]) + 2]

        def mean(errors: Array) -> Array:
            return np.asarray(np.abs(errors[..., rows, :][..., columns]).mean(axis=-2))

        return {
            "lssvm": mean(left),
            "bp": np.median(mean(networks), axis=0),
            "ins": mean(ins),
            "low": mean(networks).min(axis=0),
            "high": mean(networks).max(axis=0),
        }


# ---------------------------------------------------------------- what the page says


@pytest.fixture(scope="module")
def library(labs: dict[str, Any]) -> dict[str, Callable[[dict[str, Any]], Numbers]]:
    return {
        "gain": GainByLibrary(labs["gain"]["data"]),
        "kernel": KernelByLibrary(labs["kernel"]["data"]),
    }


@pytest.fixture(scope="module")
def opened(browser: Browser, served: str, labs: dict[str, Any]) -> Iterator[dict[str, Visit]]:
    """Both pages, opened once; a test begins with a reset."""
    found = {kind: visit(browser, served, labs[kind]["page"]) for kind in KINDS}
    yield found
    for seen in found.values():
        seen.page.close()


@pytest.fixture(params=KINDS)
def kind(request: pytest.FixtureRequest) -> str:
    return str(request.param)


@pytest.fixture
def lab(kind: str, opened: dict[str, Visit]) -> Locator:
    found = opened[kind].page.locator(".lab")
    found.get_by_role("button", name="Reset").click()
    return found


def state_of(lab: Locator) -> dict[str, Any]:
    """Return where all controls stand."""
    pairs = lab.evaluate(
        """lab => [
          ...[...lab.querySelectorAll('input[type=range]')].map(i => [i.dataset.name, Number(i.value)]),
          ...[...lab.querySelectorAll('fieldset')].map(f => [f.dataset.name, f.querySelector(':checked').value])
        ]"""  # noqa: E501
    )
    return dict(pairs)


def numbers_of(lab: Locator) -> Numbers:
    """Return the numbers of the table with all their digits; each is shown rounded to three."""
    found: Numbers = {}
    rows = lab.locator(".lab-numbers tbody tr").evaluate_all(
        "rows => rows.map(r => [r.dataset.key, [...r.cells].slice(1).map(c => [c.textContent, c.dataset])])"  # noqa: E501
    )
    for key, cells in rows:
        found[key] = np.array([float(data["value"]) for _, data in cells])
        for text, data in cells:
            assert float(text.split()[0].replace(",", "")) == pytest.approx(
                float(data["value"]), rel=5e-3
            )
        if "low" in cells[0][1]:
            for end in ("low", "high"):
                found[end] = np.array([float(data[end]) for _, data in cells])
    return found


def agrees(lab: Locator, library: Callable[[dict[str, Any]], Numbers]) -> dict[str, Any]:
    """Compare the table with the library; return where the controls stand."""
    state, page = state_of(lab), numbers_of(lab)
    expected = library(state)
    assert page.keys() == expected.keys()
    for key, values in expected.items():
        np.testing.assert_allclose(page[key], values, **CLOSE, err_msg=f"{key} at {state}")
    return state


# ---------------------------------------------------------------- tests


def test_by_keyboard_every_end_is_that_of_the_library(
    kind: str, lab: Locator, library: dict[str, Any], labs: dict[str, Any]
) -> None:
    began = agrees(lab, library[kind])
    assert began == {c["name"]: c["start"] for c in labs[kind]["sliders"] + labs[kind]["choices"]}
    for spec in labs[kind]["sliders"]:
        slider = lab.locator(f"input[data-name={spec['name']}]")
        for keys, place in (
            (["Home"], spec["low"]),
            (["ArrowRight"] * 2, spec["low"] + 2 * spec["step"]),
            (["End"], spec["high"]),
            (["ArrowLeft", "ArrowDown", "ArrowUp"], spec["high"] - spec["step"]),
            (["PageDown"], None),
        ):
            before = state_of(lab)[spec["name"]]
            for key in keys:
                slider.press(key)
            now = agrees(lab, library[kind])[spec["name"]]
            assert now == pytest.approx(place) if place is not None else now < before
        lab.get_by_role("button", name="Reset").press("Enter")
        assert agrees(lab, library[kind]) == began


def test_by_keyboard_every_choice_is_that_of_the_library(
    kind: str, lab: Locator, library: dict[str, Any], labs: dict[str, Any]
) -> None:
    for spec in labs[kind]["choices"]:
        seen = []
        for _ in spec["options"]:  # the arrow keys go round
            lab.locator(f"fieldset[data-name={spec['name']}] input:checked").press("ArrowRight")
            seen.append(agrees(lab, library[kind])[spec["name"]])
        assert sorted(seen) == sorted(value for value, _ in spec["options"])
        assert seen[-1] == spec["start"]


def test_corners_are_those_of_the_library(
    kind: str, lab: Locator, library: dict[str, Any], labs: dict[str, Any]
) -> None:
    """All sliders at an end at once, in the other area."""
    last = labs[kind]["choices"][0]["options"][-1][0]
    lab.locator(f"input[type=radio][value='{last}']").first.check()
    for key in ("Home", "End"):
        for slider in lab.locator("input[type=range]").all():
            slider.press(key)
        assert agrees(lab, library[kind])[labs[kind]["choices"][0]["name"]] == last


def test_a_gain_of_one_is_the_network_and_of_zero_the_first_measurement(
    opened: dict[str, Visit], labs: dict[str, Any]
) -> None:
    lab = opened["gain"].page.locator(".lab")
    lab.get_by_role("button", name="Reset").click()
    lab.locator("input[data-name=gain]").press("End")
    found = numbers_of(lab)
    np.testing.assert_allclose(found["constant"], found["network"], rtol=1e-12)
    lab.locator("input[data-name=gain]").press("Home")
    run = labs["gain"]["data"]["runs"]["1x"]
    ins, first = np.array(run["ins"]), np.array(run["ins"][0]) - np.array(run["network"][0])
    clock = run["period"] * np.arange(len(ins))
    carried = np.column_stack([first[0] + clock * first[1], np.full(len(ins), first[1])])
    np.testing.assert_allclose(
        numbers_of(lab)["constant"], np.abs(ins - carried).mean(axis=0), rtol=1e-9
    )


def test_controls_are_named_and_say_their_values(
    kind: str, lab: Locator, labs: dict[str, Any]
) -> None:
    for spec in labs[kind]["sliders"]:
        slider = lab.get_by_role("slider", name=spec["label"], exact=True)
        slider.press("End")
        said = slider.get_attribute("aria-valuetext") or ""
        assert said == AT_THE_TOP[spec["name"]]
        output = lab.locator(f"output[for='{slider.get_attribute('id')}']")
        assert output.inner_text() == said
    for spec in labs[kind]["choices"]:
        group = lab.get_by_role("group", name=spec["label"], exact=True)
        for _, text in spec["options"]:
            assert group.get_by_role("radio", name=text, exact=True).count() == 1
    region = lab.page.get_by_role("region", name=labs[kind]["title"])
    assert region.count() == 1
    table = lab.get_by_role("table")
    assert table.get_by_role("columnheader").count() == 3
    assert table.get_by_role("rowheader").count() == len(numbers_of(lab)) - (kind == "kernel") * 2
    assert table.locator("caption").inner_text().startswith("Mean absolute error")


# what a slider says at its upper end
AT_THE_TOP = {
    "ratio": "10,000 times the matched Q", "gain": "1", "width": "100,000 deviations",
    "eta": "1,000,000", "length": "50 samples, 10 s",
}  # fmt: skip


def test_sliders_say_what_they_stand_for(opened: dict[str, Visit]) -> None:
    for kind, name, keys, said in (
        ("gain", "ratio", [], "the matched Q"),
        ("gain", "ratio", ["Home"], "0.0001 times the matched Q"),
        ("kernel", "length", ["Home"], "1 sample, 0.2 s"),
        ("kernel", "length", ["Home", "ArrowRight"], "2 samples, 0.4 s"),
    ):
        lab = opened[kind].page.locator(".lab")
        lab.get_by_role("button", name="Reset").click()
        slider = lab.locator(f"input[data-name={name}]")
        for key in keys:
            slider.press(key)
        assert slider.get_attribute("aria-valuetext") == said


# how each row of the table is called in the text
CALLED = {
    "gain": {"kf": "KF", "hf": "HF", "constant": "g = 0.3", "network": "network"},
    "kernel": {"ins": "INS", "lssvm": "LS-SVM", "bp": "networks"},
}
IN_STATUS = {
    "gain": {
        "kf": "the Kalman filter has", "hf": "the H-infinity filter",
        "constant": "the constant gain",
    },
    "kernel": {"lssvm": "the LS-SVM leaves", "bp": "the networks"},
}  # fmt: skip


def number_after(text: str, words: str) -> float:
    """Return the number that follows some words."""
    match = re.search(rf"(?<!\w){re.escape(words)} ([\d.,]*\d)", text)
    assert match, f"{words}: {text}"
    return float(match[1].replace(",", ""))


def description(chart: Locator) -> str:
    """Return what a screen reader is told beside the title: what aria-describedby leads to."""
    return str(
        chart.evaluate(
            "c => document.getElementById(c.getAttribute('aria-describedby')).textContent"
        )
    )


def test_it_says_in_words_what_has_changed(kind: str, lab: Locator) -> None:
    lab.locator("input[type=range]").first.press("Home")
    status, number = lab.locator(".lab-status"), "0.0001" if kind == "gain" else "0.01"
    lab.locator(f".lab-status:has-text('{number} ')").wait_for()  # once the slider has rested
    found, text = numbers_of(lab), status.inner_text()
    base = found["network" if kind == "gain" else "ins"][0]
    for key, words in IN_STATUS[kind].items():
        assert number_after(text, words) == pytest.approx(100 * found[key][0] / base, rel=5e-3)
    charts = lab.get_by_role("img").all()
    assert len(charts) == 3
    for chart, column in zip(charts, (0, 1, 0), strict=True):
        said = description(chart)
        for key, words in CALLED[kind].items():
            assert number_after(said, words) == pytest.approx(found[key][column], rel=5e-3), key
        assert chart.locator("title").text_content()
    assert f"{number} " in lab.locator(".lab-shown").inner_text()


def test_the_lowest_chart_tells_the_ends_and_the_least_of_its_lines(
    kind: str, lab: Locator, library: dict[str, Any], labs: dict[str, Any]
) -> None:
    spec = labs[kind]["sliders"][0]
    count = round((spec["high"] - spec["low"]) / spec["step"])
    places = spec["low"] + spec["step"] * np.arange(count + 1)
    state, said = state_of(lab), description(lab.get_by_role("img").last)
    over = said[said.index("Over the ") :]
    lines = [library[kind](state | {spec["name"]: float(place)}) for place in places]
    for key in ("kf", "hf") if kind == "gain" else ("lssvm",):
        course = np.array([found[key][0] for found in lines])
        words = re.search(rf"{CALLED[kind][key]}: (.*?)[;.](?: |$)", over)
        assert words, over
        told = [float(n.replace(",", "")) for n in re.findall(r"[\d.,]*\d", words[1])]
        least = int(course.argmin())
        expected = [
            course[0], 10 ** places[0], course[least], 10 ** places[least], course[-1],
            10 ** places[-1],
        ]  # fmt: skip
        np.testing.assert_allclose(told, expected, rtol=6e-3)


def test_what_coincides_is_said(opened: dict[str, Visit]) -> None:
    lab = opened["gain"].page.locator(".lab")
    lab.get_by_role("button", name="Reset").click()
    status = lab.locator(".lab-status:has-text('the matched Q, g = 0.3')")
    status.wait_for()
    assert "coincide" not in status.inner_text()
    for slider in lab.locator("input[type=range]").all():
        slider.press("End")
    said = lab.locator(".lab-status:has-text('10,000 times')")
    said.wait_for()
    lab.locator(".lab-status:has-text('g = 1.')").wait_for()
    assert "Lines that coincide: KF and HF; g = 1 and network." in said.inner_text()


def ticks_of(chart: Locator) -> list[tuple[float, float]]:
    """Return the values and the heights of the ticks of the upright axis."""
    found = chart.evaluate(
        """svg => [...svg.querySelectorAll('text[text-anchor=end]')].map(t => [
             Number(t.textContent.replace('−', '-').replace(',', '')),
             Number(t.getAttribute('y')) - 4])"""
    )
    return [(float(value), float(y)) for value, y in found]


def test_the_dots_are_where_the_numbers_are(kind: str, lab: Locator) -> None:
    """The lowest chart: the dot of each line at the mark is its number of the table."""
    chart = lab.get_by_role("img").last
    (low, below), (high, above) = ticks_of(chart)[:2]
    found = numbers_of(lab)
    for key in CALLED[kind]:
        y = float(chart.locator(f"circle.lab-{key}").get_attribute("cy") or "nan")
        share = (y - below) / (above - below)
        read = np.exp(np.log(low) + share * (np.log(high) - np.log(low)))
        assert read == pytest.approx(found[key][0], rel=1e-6)


def test_the_lines_are_where_the_errors_are(kind: str, lab: Locator, labs: dict[str, Any]) -> None:
    """The upper charts: the line that is not filtered, point by point, position and velocity."""
    data = labs[kind]["data"]
    known = data["runs"]["1x"]["network"] if kind == "gain" else data["areas"]["1"]["ins"]
    columns = (0, 1) if kind == "gain" else (0, 2)
    for chart, column in zip(lab.get_by_role("img").all()[:2], columns, strict=True):
        line = chart.locator(f"polyline.lab-{'network' if kind == 'gain' else 'ins'}")
        points = (line.get_attribute("points") or "").split()
        drawn = np.array([float(point.split(",")[1]) for point in points])
        where = dict(ticks_of(chart))
        linear, top = 0.1, max(where)  # as the chapters have it
        scale = (where[top] - where[0.0]) / np.arcsinh(top / linear)
        truth = np.array(known)[: len(drawn), column]
        expected = where[0.0] + scale * np.arcsinh(np.clip(truth, -top, top) / linear)
        assert len(drawn) == len(known)
        np.testing.assert_allclose(drawn, expected, atol=0.06)  # a tenth of a pixel is written


def test_the_axis_of_time_stays_when_the_outage_is_short(opened: dict[str, Visit]) -> None:
    lab = opened["kernel"].page.locator(".lab")
    lab.get_by_role("button", name="Reset").click()
    chart = lab.get_by_role("img").first

    def look() -> tuple[list[str], float, int]:
        words = chart.locator("text[text-anchor=middle]").all_text_contents()
        band = float(chart.locator(".lab-shade").get_attribute("width") or 0)
        line = chart.locator("polyline.lab-lssvm").get_attribute("points") or ""
        return words, band, len(line.split())

    whole, band, points = look()
    lab.locator("input[data-name=length]").press("Home")
    words, narrow, fewer = look()
    assert words == whole
    assert band > 20 * narrow
    assert narrow >= 2
    assert fewer == points - 49
    names = chart.locator(".lab-bp.lab-label").all_text_contents()
    assert names == ["BP, 8 networks"]
    assert lab.get_by_role("img").last.locator(".lab-bp.lab-label").inner_html().count("median")


def pixels(figure: Locator) -> Array:
    return np.asarray(Image.open(BytesIO(figure.screenshot())).convert("L"), dtype=float)


# in the window's corner, whatever room the words above the charts take
NAILED = """.lab-charts { background: #fff; left: 0; position: fixed; top: 0; width: 680px;
  z-index: 9999; }"""


@pytest.fixture
def nailed_lab(lab: Locator) -> Iterator[Locator]:
    style = lab.page.add_style_tag(content=NAILED)
    yield lab
    style.evaluate("style => style.remove()")


def test_charts_are_painted_and_move(nailed_lab: Locator) -> None:
    lab = nailed_lab
    slider = lab.locator("input[type=range]").first
    before = [pixels(chart) for chart in lab.get_by_role("img").all()]
    for picture in before:
        dark = np.abs(picture - np.median(picture)) > 60
        assert dark.any(axis=0).mean() > 0.8  # ink from the left to the right
    slider.press("Home")
    for chart, old in zip(lab.get_by_role("img").all(), before, strict=True):
        assert np.abs(pixels(chart) - old).max() > 60


GEOMETRY = """lab => {
  const box = e => {
    const r = e.getBoundingClientRect(); return [r.left, r.right, r.width, r.height]; };
  const all = what => [...lab.querySelectorAll(what)];
  return {
    controls: all('input[type=range], fieldset label, button').map(box),
    charts: all('svg[role=img]').map(svg => ({
      box: box(svg), width: Number(svg.getAttribute('width')),
      texts: [...svg.querySelectorAll('text')].map(t => [t.textContent, ...box(t)]),
    })),
  };
}"""
COLOURS = """lab => ({
  ground: getComputedStyle(document.body).backgroundColor,
  lines: [...lab.querySelectorAll('.lab-numbers .lab-line')].map(e => {
    const style = getComputedStyle(e); return [style.stroke, style.strokeDasharray]; }),
  texts: [...lab.querySelectorAll('svg text')].map(e => getComputedStyle(e).fill),
})"""


def test_narrow_screens_and_colours(
    browser: Browser, served: str, labs: dict[str, Any], kind: str
) -> None:
    seen = visit(browser, served, labs[kind]["page"], viewport={"width": 360, "height": 740})
    page, lab = seen.page, seen.page.locator(".lab")
    for key in ("Home", "End"):
        for slider in lab.locator("input[type=range]").all():
            slider.press(key)
        assert page.evaluate("document.documentElement.scrollWidth") <= 360
    found = lab.evaluate(GEOMETRY)
    for _, _, width, height in found["controls"]:
        assert min(width, height) >= 24  # WCAG 2.2, target size
    for chart in found["charts"]:
        left, right, width, _ = chart["box"]
        assert 0 <= left < right <= 360
        assert chart["width"] == pytest.approx(width, abs=0.5)  # its text has the size it is given
        for text, start, end, _, height in chart["texts"]:
            assert left - 1 <= start < end <= right + 1, text
            assert height >= 12, text
    grounds = []
    for theme in ("light", "dark"):
        page.evaluate("theme => { document.documentElement.dataset.theme = theme; }", theme)
        shown = lab.evaluate(COLOURS)
        ground = shown["ground"]
        grounds.append(luminance(ground))
        for stroke, _ in shown["lines"]:
            assert contrast_of(stroke, ground) >= 3
        # told apart without colour
        assert len({dash for _, dash in shown["lines"]}) == len(shown["lines"]) > 2
        assert shown["texts"]
        for fill in shown["texts"]:
            assert contrast_of(fill, ground) >= 4.5
    assert grounds[0] > 0.9
    assert grounds[1] < 0.1
    assert (seen.errors, seen.foreign, seen.failed) == ([], [], [])
    page.close()


def still(page: Page, kind: str) -> tuple[bool, bool]:
    """Tell whether the picture is seen, and the lab."""
    number = {"gain": "71", "kernel": "72"}[kind]
    picture = page.locator(f"figure#fig-{number}-lab img")
    assert page.locator(f"figure#fig-{number}-lab figcaption").is_visible()
    assert page.locator(f"table#tbl-{number}-ends").is_visible()
    return picture.is_visible(), page.locator(".lab").is_visible()


def test_without_scripts_and_in_print_there_is_a_still_picture(
    browser: Browser, served: str, labs: dict[str, Any], kind: str, opened: dict[str, Visit]
) -> None:
    bare = browser.new_page(java_script_enabled=False)
    bare.goto(served + labs[kind]["page"], wait_until="domcontentloaded")
    bare.locator("figure img").first.wait_for()
    assert still(bare, kind) == (True, False)
    bare.close()
    page = opened[kind].page
    assert still(page, kind) == (False, True)
    page.emulate_media(media="print")
    assert still(page, kind) == (True, False)
    page.emulate_media(media="screen")


def test_it_works_from_a_file(
    browser: Browser, built_site: Path, labs: dict[str, Any], kind: str
) -> None:
    """As in the archive, without any server."""
    page = browser.new_page()
    errors: list[str] = []
    page.on("pageerror", lambda error: errors.append(str(error)))
    page.goto((built_site / labs[kind]["page"]).as_uri(), wait_until="domcontentloaded")
    page.locator(".lab .lab-numbers td").first.wait_for()
    assert still(page, kind) == (False, True)
    assert errors == []
    page.close()


def test_the_pages_of_labs_have_no_error_and_ask_nobody(opened: dict[str, Visit]) -> None:
    for seen in opened.values():
        assert (seen.errors, seen.foreign, seen.failed) == ([], [], [])


@pytest.mark.parametrize("broken", ["data", "figure", "JSON"])
def test_a_lab_that_fails_leaves_its_picture_and_the_next_lab_works(
    browser: Browser, served: str, built_site: Path, labs: dict[str, Any], broken: str
) -> None:
    """A page with both labs, of which the first cannot start."""
    first, second = (
        BeautifulSoup((built_site / labs[kind]["page"]).read_text(encoding="utf-8"), "html.parser")
        for kind in KINDS
    )
    section = first.select_one("section.lab")
    assert section is not None
    if broken == "figure":
        section["data-figure"] = "fig-that-is-not-there"
    else:
        content = json.loads(section.script.string)  # type: ignore[union-attr, arg-type]
        content["data"]["runs"]["1x"]["designs"] = None
        section.script.string = "{" if broken == "JSON" else json.dumps(content)  # type: ignore[union-attr]
    for moved in ("figure#fig-72-lab", "section.lab"):
        first.select("article section")[-1].append(second.select_one(moved) or "")
    page = browser.new_page()
    said: list[str] = []
    page.on("console", lambda m: said.append(m.text) if m.type == "error" else None)
    address = served + labs["gain"]["page"]
    page.route(address, lambda route: route.fulfill(body=str(first), content_type="text/html"))
    page.goto(address, wait_until="domcontentloaded")
    other = page.locator("#lab-kernel")
    other.locator(".lab-numbers td").first.wait_for()
    assert page.locator("figure#fig-71-lab img").is_visible()
    assert not page.locator("#lab-gain").is_visible()
    assert not page.locator("figure#fig-72-lab > img").is_visible()
    other.locator("input[data-name=width]").press("Home")
    assert state_of(other)["width"] == -2
    assert len(other.get_by_role("img").all()) == 3
    assert any("The lab lab-gain does not start." in text for text in said)
    page.close()


# ---------------------------------------------------------------- the script's functions


@pytest.fixture(scope="module")
def script(opened: dict[str, Visit]) -> Callable[..., Any]:
    """Call a function of the script with numbers."""
    page = opened["gain"].page

    def call(expression: str, *values: Any) -> Any:
        plain = [v.tolist() if isinstance(v, np.ndarray) else v for v in values]
        return page.evaluate(f"v => {{ const L = window.inswsnLabs; return {expression}; }}", plain)

    return call


@pytest.mark.parametrize("size", [1, 2, 7, 40])
def test_cholesky_and_its_solutions(script: Callable[..., Any], size: int) -> None:
    rng = np.random.default_rng(size)
    root = rng.standard_normal((size, size))
    H, b = root @ root.T + 0.1 * np.eye(size), rng.standard_normal(size)
    L = np.array(script("L.cholesky(v[0]).map(row => [...row])", H))
    np.testing.assert_allclose(L, np.linalg.cholesky(H), rtol=1e-9, atol=1e-12)
    x = np.array(script("L.solveFactored(L.cholesky(v[0]), v[1])", H, b))
    np.testing.assert_allclose(x, np.linalg.solve(H, b), rtol=1e-8, atol=1e-10)


def test_cholesky_refuses_what_is_not_positive_definite(script: Callable[..., Any]) -> None:
    tried = (
        "(() => { try { L.cholesky(v[0]); return 'factored'; } catch (e) { return e.message; }})()"
    )
    said = script(tried, [[1.0, 2.0], [2.0, 1.0]])
    assert "not positive definite" in said


@pytest.mark.parametrize("seed", range(5))
def test_kalman_gains_and_runs(script: Callable[..., Any], seed: int) -> None:
    rng = np.random.default_rng(seed)
    A = np.eye(2) + 0.3 * rng.standard_normal((2, 2))
    Q, R, P0 = (m @ m.T + 0.05 * np.eye(2) for m in rng.standard_normal((3, 2, 2)))
    y = rng.standard_normal((60, 2))
    model = ErrorModel(
        A=A, B=np.linalg.cholesky(Q), C=np.eye(2), D=np.linalg.cholesky(R), L=np.eye(2),
        E=np.zeros((2, 2)), period=1.0,
    )  # fmt: skip
    design = design_kalman(model, np.ones((60, 2), dtype=bool), initial_covariance=P0)
    gains = np.array(script("L.kalmanGains(...v)", A, Q, R, P0, 60))
    np.testing.assert_allclose(gains, design.gains, rtol=1e-9, atol=1e-12)
    states = np.array(script("L.runFilter(...v)", A, gains, y, [0.0, 0.0]))
    expected = run_kalman(model, y[:, :, None], initial_covariance=P0)[:, :, 0]
    np.testing.assert_allclose(states, expected, rtol=1e-8, atol=1e-10)


@pytest.mark.parametrize(("sigma", "eta"), [(0.1, 1.0), (1.0, 1e3), (30.0, 1e6)])
def test_the_support_vector_machine_solves_its_own_equations(
    script: Callable[..., Any], sigma: float, eta: float
) -> None:
    """By the bordered system itself, not by the library."""
    rng = np.random.default_rng(3)
    X, Y, Z = (rng.standard_normal(shape) for shape in ((25, 3), (25, 2), (9, 3)))
    machine = script("L.fitLssvm(v[0], v[1], v[2], v[3])", X, Y, sigma, eta)
    K = np.exp(-cdist(X, X, "sqeuclidean") / (2 * sigma**2))
    bordered = np.block([[np.zeros((1, 1)), np.ones((1, 25))], [np.ones((25, 1)), K + np.eye(25) / eta]])  # noqa: E501  # fmt: skip
    solved = np.linalg.solve(bordered, np.vstack([np.zeros((1, 2)), Y]))
    answers = np.exp(-cdist(Z, X, "sqeuclidean") / (2 * sigma**2)) @ solved[1:] + solved[0]
    found = np.array(script("L.predictLssvm(v[0], v[1])", machine, Z))
    np.testing.assert_allclose(found, answers, rtol=1e-6, atol=1e-8)


def test_a_network_is_its_formula(script: Callable[..., Any]) -> None:
    rng = np.random.default_rng(4)
    W1, b1, W2, b2 = (rng.standard_normal(shape) for shape in ((5, 3), 5, (2, 5), 2))
    X = rng.standard_normal((6, 3))
    weights = np.concatenate([W1.ravel(), b1, W2.ravel(), b2])
    shape = {"inputs": 3, "hidden": 5, "outputs": 2}
    found = np.array(script("L.forward(v[0], v[1], v[2])", weights, shape, X))
    np.testing.assert_allclose(found, np.tanh(X @ W1.T + b1) @ W2.T + b2, rtol=1e-12)


@pytest.mark.parametrize(
    ("value", "text"),
    [(0.04123, "0.0412"), (0.1, "0.100"), (10.86, "10.9"), (0.9996, "1.00"), (123.4, "123"), (0.0, "0")],  # noqa: E501
)  # fmt: skip
def test_numbers_are_shown_with_three_digits(
    script: Callable[..., Any], value: float, text: str
) -> None:
    assert script("L.shown(v[0])", value) == text
