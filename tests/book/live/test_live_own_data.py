"""A reader's own file in the page: what chapter 90 finds, with numpy alone."""

from __future__ import annotations

import json
import re
import subprocess
import sys
from collections.abc import Callable
from contextlib import suppress
from io import StringIO
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd
import pytest
from hypothesis import given, strategies as st
from inswsn_book.live.own_data import FIGURES, MOST, Examined, examine
from inswsn_book.live.own_page import look
from inswsn_book.record.parameters import chapter_schema
from scipy.stats import chi2

import inswsn_lib as iw
from inswsn_lib.errors import InswsnError, ParameterError
from inswsn_lib.evaluation import normalised_squares

if TYPE_CHECKING:
    from inswsn_book.record.results import Results

EXAMPLE = iw.data_file("examples/ins-wsn.csv")
TEXT = EXAMPLE.read_text(encoding="utf-8")
# A file with numpy alone, as in a page; what is found goes to the standard output
ALONE = """
import json, sys
from inswsn_book.live import absent
absent.block()
from inswsn_book.live import own_page, which_page
text, options = json.load(sys.stdin)
look = which_page.decide if options.pop("which", False) else own_page.look
print(json.dumps(look(text, options), allow_nan=False))
"""


@pytest.fixture(scope="module")
def found() -> Examined:
    return examine(TEXT, {"name": "ins-wsn.csv"})


@pytest.fixture(scope="module")
def shown() -> dict[str, Any]:
    return look(TEXT, {"name": "ins-wsn.csv"})


def series(chart: dict[str, Any], method: str, style: str = "line") -> np.ndarray:
    """Return what a chart has of a method: the pieces of its line one after the other."""
    pieces = [
        each["values"][0]
        for each in chart["series"]
        if (each["method"], each["style"]) == (method, style)
    ]
    return np.concatenate([np.array(piece, dtype=float) for piece in pieces], axis=1)


# It is what chapter 90 finds ----------------------------------------------------------------------


def test_it_is_what_the_library_finds(found: Examined) -> None:
    """By the steps of chapter 90, with scipy, pandas and compiled loops."""
    data = iw.read_recording(EXAMPLE, resample=True)
    T, a = data.period, 0.05
    model = iw.ErrorModel.p1(T, process_noise=(a * T**2 / 2, a * T), measurement_noise=(0.2, 0.1))
    initial = np.diag([1, 1, 0.01, 0.01])
    y = data.ins - data.wsn
    design = iw.design_kalman(model, ~np.isnan(y), initial_covariance=initial)
    errors = iw.run_kalman(model, y, initial_covariance=initial)
    innovations = y - iw.run_kalman(model, y, initial_covariance=initial, predicted=True)
    stated = np.sqrt(design.filtered[:, [0, 1], [0, 1]].sum(axis=1))
    for ours, usual in (
        (found.data.time, data.time),
        (found.corrected, data.ins - errors),
        (found.filtered.innovations, innovations),
        (found.filtered.nis, normalised_squares(innovations, design.innovation)),
        (found.sigma, stated),
    ):
        np.testing.assert_allclose(ours, usual, rtol=1e-9, atol=1e-9)
    assert found.data.outages == data.outages


def test_what_is_drawn_is_what_is_found(found: Examined, shown: dict[str, Any]) -> None:
    """To a ten-thousandth of the axes."""
    data, filtered = found.data, found.filtered
    track, error, nis, white = shown["figure"]["charts"]
    clock, fixed = data.time - data.time[0], np.isfinite(data.wsn[:, 0])
    there = np.isfinite(data.ins[:, 0])
    far = max(high - low for low, high in (track["x"]["ends"], track["y"]["ends"]))
    for method, style, values in (
        ("ins", "line", data.ins[there]),
        ("kalman", "line", found.corrected[there]),
        ("network", "points", data.wsn[fixed]),
    ):
        drawn = series(track, method, style)
        wanted = (values - data.ins[0])[:, :2].T  # from where the INS begins
        np.testing.assert_allclose(drawn, wanted, atol=1e-4 * far)
    size = np.linalg.norm(filtered.states[:, :2], axis=1)
    wanted = [clock, np.maximum(size - found.sigma, 0), size + found.sigma]
    np.testing.assert_allclose(series(error, "kalman", "band"), wanted, atol=0.01)
    np.testing.assert_allclose(series(error, "kalman"), [clock, size], atol=0.01)
    time, value = series(nis, "kalman", "points")
    seen = fixed & there
    np.testing.assert_allclose(time, clock[seen], atol=0.01)
    np.testing.assert_allclose(value, filtered.nis[seen] / 4, atol=0.001)
    for chart in (error, nis):
        shades = [each["values"][0] for each in chart["series"] if each["method"] == "published"]
        assert [shade[0] for shade in shades] == [
            pytest.approx([clock[i], clock[i] + (j - i) * data.period], abs=0.01)
            for i, j in data.outages
        ]
    assert [each["label"] for each in white["series"][1:]] == [
        "x", "y", "velocity x", "velocity y",
    ]  # fmt: skip


def test_no_line_is_drawn_over_a_gap(found: Examined, shown: dict[str, Any]) -> None:
    missing = np.flatnonzero(np.isnan(found.data.ins[:, 0]))
    (pieces,) = {int((np.diff(missing) > 1).sum()) + 2}
    lines = [s for s in shown["figure"]["charts"][0]["series"] if s["method"] == "ins"]
    assert len(lines) == pieces > 1
    assert [bool(line["label"]) for line in lines] == [False] * (pieces - 1) + [True]


def test_it_is_what_the_chapter_published(found: Examined, published: dict[str, Results]) -> None:
    results = published["your-own-data"]
    expected = {quantity.name: quantity.value for quantity in results.quantities}
    data = found.data
    size, colour = (found.of_filter[name] for name in ("size", "colour"))
    ours = {"nis.mean": size.value, "nis.lag1": abs(colour.value)}
    ours |= {"nis.low": size.low, "nis.high": size.high, "recording.steps": len(data.time)}
    ours |= {"recording.period": data.period, "recording.outages": len(data.outages)}
    for row in found.errors:
        for what in ("position", "velocity"):
            name = f"rms.{row['track']}.{what}.{row['when']}".lower().replace(" ", "-")
            ours[name] = row[what]
    assert {name for name in expected if name.startswith(("nis.", "rms."))} <= set(ours)
    for name, value in ours.items():
        assert value == pytest.approx(expected[name], abs=2e-6), name


def test_the_file_is_that_of_the_chapter(found: Examined, shown: dict[str, Any]) -> None:
    table = pd.read_csv(StringIO(shown["csv"]))
    assert list(table) == ["time_s", *(name.replace("ins", "corrected") for name in iw.logs.INS)]
    np.testing.assert_allclose(table["time_s"], found.data.time, atol=1e-6)
    np.testing.assert_allclose(
        table.iloc[:, 1:].to_numpy(), found.corrected, atol=1e-6, equal_nan=True
    )
    assert table.to_csv(index=False) == shown["csv"]


def test_the_figures_are_those_of_the_chapter(root: Path) -> None:
    schema = chapter_schema(root, "your-own-data")
    for name, figure in FIGURES.items():
        assert schema.defaults[name] == figure.usual
        (declared,) = (each for each in schema.parameters if each.name == name)
        assert re.search(rf"0, {figure.below}\b", declared.allowed)
        assert declared.unit.replace("^2", "²") == figure.unit


def test_nothing_but_numpy_is_needed(shown: dict[str, Any]) -> None:
    """Also by plain loops the same is found."""
    alone = looked_at_alone(TEXT)
    assert alone["sentences"] == shown["sentences"]
    assert alone["tables"] == shown["tables"]
    for one, other in zip(alone["figure"]["charts"], shown["figure"]["charts"], strict=True):
        for here, there in zip(one["series"], other["series"], strict=True):
            np.testing.assert_allclose(here["values"][0], there["values"][0], atol=0.01)


def looked_at_alone(text: str, **options: Any) -> dict[str, Any]:
    done = subprocess.run(
        [sys.executable, "-c", ALONE],
        input=json.dumps([text, {"name": "ins-wsn.csv"} | options]),
        capture_output=True, text=True, check=True, timeout=120,
    )  # fmt: skip
    return dict(json.loads(done.stdout))


def exchanged() -> pd.DataFrame:
    names = ["wsn_x_m", "wsn_y_m", "wsn_vx_mps", "wsn_vy_mps"]
    return table().rename(columns=dict(zip(names, [names[i] for i in (1, 0, 3, 2)], strict=True)))


def late() -> pd.DataFrame:
    made = table()
    made[list(iw.logs.WSN)] = made[list(iw.logs.WSN)].shift(4)
    return made


def lasting(tau: float = 3.0, wilder: float = 1.0) -> pd.DataFrame:
    """Of 400 s: errors of fixes that last, and an INS whose drift is as wild from 80 s on."""
    rng, T, n = np.random.default_rng(3), 0.2, 2000
    fades = np.exp(-T / tau) if tau else 0.0
    errors = rng.normal(size=(n, 4)) * [0.2, 0.2, 0.1, 0.1]
    for k in range(1, n):
        errors[k] = fades * errors[k - 1] + np.sqrt(1 - fades**2) * errors[k]
    sizes = np.where(np.arange(n) < 80 / T, 0.02, 0.02 * wilder)
    off = np.cumsum(rng.normal(size=(n, 2)) * sizes[:, None], axis=0)
    drift = np.hstack([np.cumsum(off, axis=0) * T, off])
    t = T * np.arange(n)
    way = np.column_stack([9 * np.sin(t / 9), 7 * np.cos(t / 7), np.cos(t / 9), -np.sin(t / 7)])
    names = [*iw.logs.INS, *iw.logs.WSN, *iw.logs.REFERENCE]
    made = pd.DataFrame(np.hstack([way + drift, way + errors, way]), columns=names)
    return made.assign(time_s=t).round(4)


def wild() -> pd.DataFrame:
    return lasting(tau=0.0, wilder=50.0)


@pytest.mark.parametrize(
    ("made", "said"),
    [
        (exchanged, "it is mirrored: x and y are exchanged"),
        (late, "it is 0.8"),
        (lasting, "neighbours are correlated"),
    ],
)
def test_mistakes_are_told_with_numpy_alone(made: Callable[[], pd.DataFrame], said: str) -> None:
    shown = looked_at_alone(made().to_csv(index=False))
    (checks,) = (each for each in shown["tables"] if each["header"][0] == "check")
    assert any(said in row[-1] for row in checks["rows"])
    assert any(said.startswith("Recording and figures do not fit") for said in shown["sentences"])
    # how long errors last is told of errors of fixes alone, not of other axes or clocks
    assert any("rrors of fixes last" in said for said in shown["sentences"]) == (made is lasting)


def test_what_a_filter_is_expected_to_gain_is_told() -> None:
    """The law of lesson 8 has 0.83 for errors that last 3 s, and an INS that holds them 3.9 s."""
    (said,) = (s for s in look(lasting().to_csv(index=False), {})["sentences"] if "expected" in s)
    share = int(re.findall(r"have (\d+)%", said)[0])
    assert share == pytest.approx(83, abs=12)
    assert "too short to tell" in look(TEXT, {})["sentences"][-1]


# Other files --------------------------------------------------------------------------------------


def table() -> pd.DataFrame:
    return pd.read_csv(StringIO(TEXT), comment="#")


def without(*names: str) -> str:
    return str(table().drop(columns=list(names)).to_csv(index=False))


def test_figures_that_do_not_fit_are_told() -> None:
    small = look(TEXT, {"wsn_position_noise": 0.05})["sentences"]
    large = look(TEXT, {"wsn_position_noise": 5, "wsn_velocity_noise": 5})["sentences"]
    lazy = examine(
        TEXT, {"acceleration_noise": 1e-4, "wsn_velocity_noise": 9, "wsn_position_noise": 9}
    )
    assert any("the noise figures are too small" in said for said in small)
    assert any("the noise figures are too large" in said for said in large)
    assert lazy.of_filter["colour"].fits is False


def test_a_network_without_velocities_and_no_reference() -> None:
    velocities = ("wsn_vx_mps", "wsn_vy_mps")
    references = ("ref_x_m", "ref_y_m", "ref_vx_mps", "ref_vy_mps")
    text = without(*velocities, *references)
    found, shown = examine(text, {}), look(text, {})
    assert set(found.white["components"]) == {"x", "y"}
    assert found.errors == []
    assert "The file has no reference, so that the errors are unknown." in shown["sentences"]
    assert shown["tables"][-1]["header"][0] == "begins at (s)"
    few = table()
    few.loc[few.index > 0, ["wsn_x_m", "wsn_y_m", *velocities]] = np.nan
    text = few.drop(columns=list(references)).to_csv(index=False)
    found, shown = examine(text, {}), look(text, {})
    assert [each.fits for each in found.of_filter.values()] == [None]
    assert any(said.endswith("fixes are too few to tell size.") for said in shown["sentences"])
    assert len(shown["figure"]["charts"]) == 3


def test_a_slow_network_has_lags_of_its_own() -> None:
    slow = table()
    slow.loc[slow.index % 5 != 0, list(iw.logs.WSN)] = np.nan
    found = examine(slow.to_csv(index=False), {})
    assert found.white["interval"] == pytest.approx(1.0, abs=0.01)
    assert all(each.fits is not False for each in found.findings)
    assert found.of_filter["colour"].high > 0.3  # 60 fixes tell little


def test_the_nis_over_time_is_a_mean_of_some_fixes() -> None:
    made = table()
    long = pd.concat([made] * 4, ignore_index=True)
    long["time_s"] = 0.2 * np.arange(len(long))
    for name in ("ins_x_m", "wsn_x_m", "ref_x_m"):  # a walk that goes on
        long[name] += np.repeat(np.arange(4), len(made)) * 5.0
    chart = look(long.to_csv(index=False), {})["figure"]["charts"][2]
    assert chart["title"] == "NIS of a component, of each 2 fixes"
    assert series(chart, "kalman", "points").shape[1] <= 400
    _, low, high = series(chart, "kalman", "band")
    assert [low[0], high[0]] == pytest.approx(chi2.ppf([0.0005, 0.9995], 8) / 8, abs=1e-3)


Change = Callable[[str], str]
#: What is refused here alone, and one file of those that `read_recording` refuses
WRONG: list[tuple[str, Change, str]] = [
    ("a word", lambda text: text.replace("0.8288", "n/a", 1), "'n/a' in column wsn_x_m, row 6"),
    ("no text", lambda text: "\ud800", "my.csv is not a CSV file: it is not UTF-8."),
    ("too long", lambda text: "1\n" * MOST, f"{MOST + 1} lines; this page takes at most {MOST}"),
    ("a wide gap", lambda text: sparse(), f"spans {2 * MOST} steps; this page takes"),
]


def sparse() -> str:
    """Return a file of half as many rows as there may be steps, with a gap of three times that."""
    rows = MOST // 2
    time = np.arange(rows) + np.where(np.arange(rows) < rows // 2, 0, 3 * rows)
    columns = ["time_s", *iw.logs.INS, *iw.logs.WSN[:2]]
    return str(pd.DataFrame({c: time * (c == "time_s") for c in columns}).to_csv(index=False))


@pytest.mark.parametrize(
    ("change", "said"), [each[1:] for each in WRONG], ids=[w[0] for w in WRONG]
)
def test_a_wrong_file_is_refused_in_one_sentence(change: Change, said: str) -> None:
    with pytest.raises(InswsnError) as caught:
        look(change(TEXT), {"name": "my.csv"})
    assert said in str(caught.value)


def test_figures_that_may_not_be_are_refused() -> None:
    for value in (0, -1, 1e9, float("nan"), None, "0.2", True):
        with pytest.raises(ParameterError, match="wsn_position_noise must be"):
            look(TEXT, {"wsn_position_noise": value})


@given(
    st.fixed_dictionaries(
        {name: st.floats(of.below * 1e-12, of.below * 0.99) for name, of in FIGURES.items()}
    ),
    st.lists(
        st.tuples(st.integers(0, len(TEXT) - 1), st.text(",;.-\n\"e0 aN#", max_size=3)), max_size=3
    ),
)  # fmt: skip
def test_any_figures_and_any_damage_give_json_or_a_sentence(
    figures: dict[str, float], damages: list[tuple[int, str]]
) -> None:
    text = TEXT
    for place, new in damages:
        text = text[:place] + new + text[place + 1 :]
    with suppress(InswsnError):  # whose message is one line
        json.dumps(look(text, figures), allow_nan=False)


def test_as_many_rows_as_it_takes_are_done(monkeypatch: pytest.MonkeyPatch) -> None:
    """By plain loops, as in a page."""
    monkeypatch.setenv("INSWSN_PLAIN", "1")
    time = 0.1 * np.arange(MOST - 2)
    way = np.column_stack([time, 10 * np.sin(time / 10), np.ones_like(time), np.cos(time / 10)])
    fixes = np.where((np.arange(len(time)) % 5 == 0)[:, None], way, np.nan)
    fixes[1000:3000] = np.nan
    columns = ["time_s", *iw.logs.INS, *iw.logs.WSN]
    made = pd.DataFrame(np.column_stack([time, way, fixes]), columns=columns)
    text = made.round(4).to_csv(index=False)
    found = look(text, {})
    assert f"has {MOST - 2} steps" in found["sentences"][0]
    assert series(found["figure"]["charts"][0], "ins").shape[1] <= 1500
    assert len(json.dumps(found)) < 5e6
