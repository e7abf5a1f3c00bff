"""Summaries of many runs: numbers worked out by hand, and figures that are refused."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pandas as pd
import pytest
from inswsn_book.experiments import Experiment, find_experiment
from inswsn_book.experiments.summary import draw_summary, leading_methods, tidy_results
from inswsn_book.parameters import read_schema
from matplotlib import pyplot as plt

from inswsn_lib.errors import ParameterError

SCHEMA = read_schema(
    """
# Seed.
seed: int = 1  # 1; in [0, inf)
# A number.
size: float = 1.0  # m; in (0, inf)
# Another.
told: float = 1.0  # 1; in (0, inf)
# A word.
word: str = "a"  # 1; one of a, b
"""
)
EXPERIMENT = Experiment(
    title="Numbers",
    schema=SCHEMA,
    begin=lambda values, inputs: None,  # type: ignore[arg-type,return-value]
    methods={"one": "the one", "two": "the other"},
    columns={"error": "m", "time": "s"},
    headline="error",
)


@pytest.fixture(autouse=True)
def _closed() -> Iterator[None]:
    yield
    plt.close("all")


def runs(one: float, two: float, count: int = 101) -> dict[str, np.ndarray]:
    """Return evenly spread errors with these means."""
    spread = np.linspace(-0.5, 0.5, count)
    return {
        "one.error": one + spread, "one.time": spread, "two.error": two + spread,
        "two.time": spread,
    }  # fmt: skip


def test_a_row_by_hand() -> None:
    frame = tidy_results(EXPERIMENT, {"size": 2.0}, runs(3.0, 4.0))
    assert list(zip(frame["method"], frame["quantity"], strict=True)) == [
        ("one", "error"), ("one", "time"), ("two", "error"), ("two", "time"),
    ]  # fmt: skip
    row = frame.loc[2]
    assert (row["size"], row["unit"], row["runs"]) == (2.0, "m", 101)
    assert (row["mean"], row["median"]) == pytest.approx((4.0, 4.0))
    assert (row["low"], row["high"]) == pytest.approx((3.525, 4.475))
    # the variance of n evenly spaced numbers 1/(n-1) apart is n (n+1) / (12 (n-1)^2)
    assert row["standard_error"] == pytest.approx((102 / (12 * 100**2)) ** 0.5)


def test_too_few_runs_have_no_interval() -> None:
    with pytest.raises(ParameterError):
        tidy_results(EXPERIMENT, {}, runs(3.0, 4.0, count=39))


def test_the_leader_and_its_lead() -> None:
    found = leading_methods(EXPERIMENT, {"size": 2.0}, runs(4.0, 3.0))
    assert (found["size"], found["best"], found["next"]) == (2.0, "two", "one")
    # both are equally lucky in each run: the lead is certain
    assert (found["lead"], found["within"]) == pytest.approx((25.0, 0.0))
    lucky = runs(4.0, 3.0) | {"two.error": 3.0 - np.linspace(-0.5, 0.5, 101)}
    found = leading_methods(EXPERIMENT, {}, lucky)
    # differences 1 + 2 u: four times the variance of u
    assert found["within"] == pytest.approx(25 * 1.96 * 2 * (102 / (12 * 100**2)) ** 0.5, rel=1e-4)


def table(*axes: str, values: tuple[float, ...] = (1.0, 10.0)) -> pd.DataFrame:
    cells: list[dict[str, float]] = [{}]
    for axis in axes:
        cells = [cell | {axis: value} for cell in cells for value in values]
    return pd.concat([tidy_results(EXPERIMENT, cell, runs(3.0, 4.0)) for cell in cells])


def test_a_chart_for_each_value_of_the_other_axes() -> None:
    fig = draw_summary(EXPERIMENT, table("size", "told"), ["size", "told"])
    assert [ax.get_title() for ax in fig.axes] == ["size 1 m", "size 10 m"]
    assert [ax.get_xlabel() for ax in fig.axes] == ["told", "told"]
    (ax, _), (line, other) = fig.axes, fig.axes[0].get_lines()
    assert (ax.get_xscale(), ax.get_yscale()) == ("log", "log")
    assert line.get_ydata().tolist() == pytest.approx([3.0, 3.0])
    assert other.get_ydata().tolist() == pytest.approx([4.0, 4.0])


def test_charts_that_do_not_fill_the_last_row() -> None:
    frame = table("size", "told", values=(1.0, 2.0, 3.0, 4.0, 5.0))
    fig = draw_summary(EXPERIMENT, frame, ["size", "told"])
    assert len(fig.axes) == 5
    assert [bool(ax.get_xlabel()) for ax in fig.axes] == [False, False, True, True, True]


@pytest.mark.parametrize(
    ("axes", "values"),
    [([], ()), (["size"], (1.0,)), (["size", "told"], tuple(range(1, 14))), (["word"], (1.0, 2.0))],
)
def test_what_cannot_be_drawn(axes: list[str], values: tuple[float, ...]) -> None:
    with pytest.raises(ParameterError):
        draw_summary(EXPERIMENT, table(*axes, values=values), axes)


@pytest.mark.parametrize("word", ["03", "nothing", "math:tau", "no_such_module:EXPERIMENT"])
def test_what_is_no_experiment(word: str) -> None:
    with pytest.raises(ParameterError, match="NAME is"):
        find_experiment(word)
