"""The labs in a browser: their numbers are those of the library, wherever a slider stands."""

from __future__ import annotations

import json
import re
from collections.abc import Callable, Iterator
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from bs4 import BeautifulSoup
from numpy.typing import NDArray
from playwright.sync_api import Browser, Locator
from visiting import Visit, contrast_of, luminance, visit

from inswsn_lib.evaluation import mean_absolute_error
from inswsn_lib.filters import run_hinfinity, run_kalman
from inswsn_lib.learning import BackpropRegressor, LSSVMRegressor, Scale
from inswsn_lib.lmi import design_filter
from inswsn_lib.models import ErrorModel

pytestmark = pytest.mark.page

Array = NDArray[np.float64]
Numbers = dict[str, Array]  # by the key of a row: position and velocity
KINDS = ("gain", "kernel")
SEED = 2012  # of the published run of both chapters
CLOSE = {"rtol": 1e-6, "atol": 1e-12}

# What the library says ---------------------------------------------------------------------------


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


# What the page says ------------------------------------------------------------------------------


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
        assert seen.wrong == []
        seen.page.close()


def reset(opened: dict[str, Visit], kind: str) -> Locator:
    lab = opened[kind].page.locator(".lab")
    lab.get_by_role("button", name="Reset").click()
    return lab


@pytest.fixture(params=KINDS)
def kind(request: pytest.FixtureRequest) -> str:
    return str(request.param)


@pytest.fixture
def lab(kind: str, opened: dict[str, Visit]) -> Locator:
    return reset(opened, kind)


def slider(lab: Locator, name: str) -> Locator:
    return lab.locator(f"input[data-name={name}]")


def state_of(lab: Locator) -> dict[str, Any]:
    """Return where all controls stand."""
    pairs = lab.evaluate(
        """lab => [
          ...[...lab.querySelectorAll('input[type=range]')]
            .map(i => [i.dataset.name, Number(i.value)]),
          ...[...lab.querySelectorAll('fieldset')]
            .map(f => [f.dataset.name, f.querySelector(':checked').value])
        ]"""
    )
    return dict(pairs)


def numbers_of(lab: Locator) -> Numbers:
    """Return the numbers of the table with all their digits; each is shown rounded to three."""
    found: Numbers = {}
    rows = lab.locator(".lab-numbers tbody tr").evaluate_all(
        "rows => rows.map(r => [r.dataset.key,"
        "  [...r.cells].slice(1).map(c => [c.textContent, c.dataset])])"
    )
    for key, cells in rows:
        found[key] = np.array([float(data["value"]) for _, data in cells])
        shown = [float(text.split()[0].replace(",", "")) for text, _ in cells]
        assert shown == pytest.approx(found[key], rel=5e-3)
        for end in ("low", "high") if "low" in cells[0][1] else ():
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


# Numbers -----------------------------------------------------------------------------------------


def test_by_keyboard_every_end_is_that_of_the_library(
    kind: str, lab: Locator, library: dict[str, Any], labs: dict[str, Any]
) -> None:
    began = agrees(lab, library[kind])
    assert began == {c["name"]: c["start"] for c in labs[kind]["sliders"] + labs[kind]["choices"]}
    for spec in labs[kind]["sliders"]:
        moved = slider(lab, spec["name"])
        for keys, place in (
            (["Home"], spec["low"]),
            (["ArrowRight"] * 2, spec["low"] + 2 * spec["step"]),
            (["End"], spec["high"]),
            (["ArrowLeft", "ArrowDown", "ArrowUp"], spec["high"] - spec["step"]),
            (["PageDown"], None),
        ):
            before = state_of(lab)[spec["name"]]
            for key in keys:
                moved.press(key)
            now = agrees(lab, library[kind])[spec["name"]]
            assert now == pytest.approx(place) if place is not None else now < before
        lab.get_by_role("button", name="Reset").press("Enter")
        assert state_of(lab) == began


def test_every_choice_and_every_corner_is_that_of_the_library(
    kind: str, lab: Locator, library: dict[str, Any], labs: dict[str, Any]
) -> None:
    """By keyboard; then all sliders at an end at once, in the other area."""
    for spec in labs[kind]["choices"]:
        seen = []
        for _ in spec["options"]:  # the arrow keys go round
            lab.locator(f"fieldset[data-name={spec['name']}] input:checked").press("ArrowRight")
            seen.append(agrees(lab, library[kind])[spec["name"]])
        assert sorted(seen) == sorted(value for value, _ in spec["options"])
        assert seen[-1] == spec["start"]
    area, last = labs[kind]["choices"][0]["name"], labs[kind]["choices"][0]["options"][-1][0]
    lab.locator(f"input[type=radio][value='{last}']").first.check()
    for key in ("Home", "End"):
        for each in lab.locator("input[type=range]").all():
            each.press(key)
        assert agrees(lab, library[kind])[area] == last


def test_a_gain_of_one_is_the_network_and_of_zero_the_first_measurement(
    opened: dict[str, Visit], labs: dict[str, Any]
) -> None:
    lab = reset(opened, "gain")
    slider(lab, "gain").press("End")
    found = numbers_of(lab)
    np.testing.assert_allclose(found["constant"], found["network"], rtol=1e-12)
    slider(lab, "gain").press("Home")
    run = labs["gain"]["data"]["runs"]["1x"]
    ins, first = np.array(run["ins"]), np.array(run["ins"][0]) - np.array(run["network"][0])
    clock = run["period"] * np.arange(len(ins))
    carried = np.column_stack([first[0] + clock * first[1], np.full(len(ins), first[1])])
    left = np.abs(ins - carried).mean(axis=0)
    np.testing.assert_allclose(numbers_of(lab)["constant"], left, rtol=1e-9)


# Words -------------------------------------------------------------------------------------------

# what a slider says at its ends
AT_THE_ENDS = {
    "ratio": ("0.0001 times the matched Q", "10,000 times the matched Q"), "gain": ("0", "1"),
    "width": ("0.01 deviations", "100,000 deviations"), "eta": ("1", "1,000,000"),
    "length": ("1 sample, 0.2 s", "50 samples, 10 s"),
}  # fmt: skip


def test_controls_are_named_and_say_their_values(
    kind: str, lab: Locator, labs: dict[str, Any]
) -> None:
    for spec in labs[kind]["sliders"]:
        named = lab.get_by_role("slider", name=spec["label"], exact=True)
        for key, said in zip(("Home", "End"), AT_THE_ENDS[spec["name"]], strict=True):
            named.press(key)
            assert named.get_attribute("aria-valuetext") == said
            assert lab.locator(f"output[for='{named.get_attribute('id')}']").inner_text() == said
    for spec in labs[kind]["choices"]:
        group = lab.get_by_role("group", name=spec["label"], exact=True)
        for _, text in spec["options"]:
            assert group.get_by_role("radio", name=text, exact=True).count() == 1
    assert lab.page.get_by_role("region", name=labs[kind]["title"]).count() == 1
    table = lab.get_by_role("table")
    assert table.get_by_role("columnheader").count() == 3
    assert table.get_by_role("rowheader").count() == len(numbers_of(lab)) - (kind == "kernel") * 2
    assert table.locator("caption").inner_text().startswith("Mean absolute error")


# how each row of the table is called beside a chart, and below all of them
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
    place = "c => document.getElementById(c.getAttribute('aria-describedby')).textContent"
    return str(chart.evaluate(place))


def test_it_says_in_words_what_has_changed(kind: str, lab: Locator) -> None:
    lab.locator("input[type=range]").first.press("Home")
    status, number = lab.locator(".lab-status"), "0.0001" if kind == "gain" else "0.01"
    lab.locator(f".lab-status:has-text('{number} ')").wait_for()  # once the slider has rested
    found, text = numbers_of(lab), status.inner_text()
    base = found["network" if kind == "gain" else "ins"][0]
    for key, words in IN_STATUS[kind].items():
        assert number_after(text, words) == pytest.approx(100 * found[key][0] / base, rel=5e-3)
    for chart, column in zip(lab.get_by_role("img").all(), (0, 1, 0), strict=True):
        said = description(chart)
        for key, words in CALLED[kind].items():
            assert number_after(said, words) == pytest.approx(found[key][column], rel=5e-3), key
        assert chart.locator("title").text_content()
    assert f"{number} " in lab.locator(".lab-shown").inner_text()


# Charts ------------------------------------------------------------------------------------------


def ticks_of(chart: Locator) -> list[tuple[float, float]]:
    """Return the values and the heights of the ticks of the upright axis."""
    found = chart.evaluate(
        """svg => [...svg.querySelectorAll('text[text-anchor=end]')].map(t => [
             Number(t.textContent.replace('−', '-').replace(',', '')),
             Number(t.getAttribute('y')) - 4])"""
    )
    return [(float(value), float(y)) for value, y in found]


def test_the_dots_and_the_lines_are_where_the_numbers_are(
    kind: str, lab: Locator, labs: dict[str, Any]
) -> None:
    """The lowest chart has a dot for each number of the table, on a logarithmic axis.

    The upper ones, position and velocity, have the line that is not filtered, point by point.
    """
    *upper, lowest = lab.get_by_role("img").all()
    (low, below), (high, above) = ticks_of(lowest)[:2]
    found = numbers_of(lab)
    for key in CALLED[kind]:
        y = float(lowest.locator(f"circle.lab-{key}").get_attribute("cy") or "nan")
        read = low * (high / low) ** ((y - below) / (above - below))
        assert read == pytest.approx(found[key][0], rel=1e-6)
    data, name = labs[kind]["data"], "network" if kind == "gain" else "ins"
    known = data["runs"]["1x"]["network"] if kind == "gain" else data["areas"]["1"]["ins"]
    for chart, column in zip(upper, (0, 1) if kind == "gain" else (0, 2), strict=True):
        points = (chart.locator(f"polyline.lab-{name}").get_attribute("points") or "").split()
        drawn = np.array([float(point.split(",")[1]) for point in points])
        where = dict(ticks_of(chart))
        linear, top = 0.1, max(where)  # as the chapters have it
        scale = (where[top] - where[0.0]) / np.arcsinh(top / linear)
        truth = np.clip(np.array(known)[:, column], -top, top)
        expected = where[0.0] + scale * np.arcsinh(truth / linear)
        np.testing.assert_allclose(drawn, expected, atol=0.06)  # a tenth of a pixel is written


# Other screens, no scripts, no server ------------------------------------------------------------

LOOK = """lab => ({
  ground: getComputedStyle(document.body).backgroundColor,
  lines: [...lab.querySelectorAll('.lab-numbers .lab-line')].map(e => {
    const style = getComputedStyle(e); return [style.stroke, style.strokeDasharray]; }),
  texts: [...lab.querySelectorAll('svg text')].map(e => {
    const { left, right, height } = e.getBoundingClientRect();
    const chart = e.closest('svg').getBoundingClientRect();
    const inside = chart.left - 1 <= left && left < right && right <= chart.right + 1;
    return [e.textContent, getComputedStyle(e).fill, inside, height]; }),
})"""


def test_narrow_screens_and_colours(
    browser: Browser, served: str, labs: dict[str, Any], kind: str
) -> None:
    """What axe does not look at: what is drawn."""
    seen = visit(browser, served, labs[kind]["page"], viewport={"width": 360, "height": 740})
    page, lab = seen.page, seen.page.locator(".lab")
    for key in ("Home", "End"):
        for each in lab.locator("input[type=range]").all():
            each.press(key)
        assert page.evaluate("document.documentElement.scrollWidth") <= 360
    for theme in ("light", "dark"):
        page.evaluate("theme => { document.documentElement.dataset.theme = theme; }", theme)
        look = lab.evaluate(LOOK)
        assert (luminance(look["ground"]) > 0.5) is (theme == "light")
        assert all(contrast_of(stroke, look["ground"]) >= 3 for stroke, _ in look["lines"])
        # told apart without colour
        assert len({dash for _, dash in look["lines"]}) == len(look["lines"]) > 2
        assert look["texts"]
        for text, fill, inside, height in look["texts"]:
            assert contrast_of(fill, look["ground"]) >= 4.5, text
            assert inside, text
            assert height >= 12, text
    assert seen.wrong == []
    page.close()


def test_the_lab_or_its_still_picture_is_seen(
    browser: Browser, served: str, built_site: Path, labs: dict[str, Any], kind: str
) -> None:
    """The picture without scripts and in print; the lab also from a file, as in the archive."""
    number, name = {"gain": "71", "kernel": "72"}[kind], labs[kind]["page"]
    for scripts, address in (
        (False, served + name), (True, served + name), (True, (built_site / name).as_uri()),
    ):  # fmt: skip
        page = browser.new_page(java_script_enabled=scripts)
        errors: list[str] = []
        page.on("pageerror", lambda error, told=errors: told.append(str(error)))
        page.goto(address, wait_until="domcontentloaded")
        page.locator(".lab .lab-numbers td" if scripts else "figure img").first.wait_for()
        for media in ("screen", "print"):
            page.emulate_media(media=media)
            lab_is_seen = scripts and media == "screen"
            assert page.locator(".lab").is_visible() is lab_is_seen
            assert page.locator(f"figure#fig-{number}-lab img").is_visible() is not lab_is_seen
            assert page.locator(f"figure#fig-{number}-lab figcaption").is_visible()
            assert page.locator(f"table#tbl-{number}-ends").is_visible()
        assert errors == []
        page.close()


@pytest.mark.parametrize(
    "broken",
    ["data", pytest.param("figure", marks=pytest.mark.whole),
     pytest.param("JSON", marks=pytest.mark.whole)],
)  # fmt: skip
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
    assert section.script is not None
    if broken == "figure":
        section["data-figure"] = "fig-that-is-not-there"
    else:
        content = json.loads(str(section.script.string))
        content["data"]["runs"]["1x"]["designs"] = None
        section.script.string = "{" if broken == "JSON" else json.dumps(content)
    for moved in ("figure#fig-72-lab", "section.lab"):
        first.select("article section")[-1].append(second.select_one(moved) or "")
    page, said, address = browser.new_page(), list[str](), served + labs["gain"]["page"]
    page.on("console", lambda m: said.append(m.text) if m.type == "error" else None)
    page.route(address, lambda route: route.fulfill(body=str(first), content_type="text/html"))
    page.goto(address, wait_until="domcontentloaded")
    other = page.locator("#lab-kernel")
    other.locator(".lab-numbers td").first.wait_for()
    assert page.locator("figure#fig-71-lab img").is_visible()
    assert not page.locator("#lab-gain").is_visible()
    assert not page.locator("figure#fig-72-lab > img").is_visible()
    slider(other, "width").press("Home")
    assert state_of(other)["width"] == -2
    assert len(other.get_by_role("img").all()) == 3
    assert any("The lab lab-gain does not start." in text for text in said)
    page.close()
