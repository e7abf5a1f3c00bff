"""The figure of scores over a grid."""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from typing import Any

import pandas as pd
import pytest
from matplotlib import pyplot as plt

from inswsn_lib.errors import ParameterError
from inswsn_lib.plotting import draw_scores

METHODS = {"one": "the one", "two": "the other"}
UNITS = {"size": "m", "told": "1", "word": "1"}


@pytest.fixture(autouse=True)
def _closed() -> Iterator[None]:
    yield
    plt.close("all")


def draw(*axes: str, values: tuple[Any, ...] = (1.0, 10.0)) -> Any:
    rows = [
        dict(zip(axes, place, strict=True))
        | {"method": method, "column": "error", "unit": "m", "median": median}
        | {"low": median - 1, "high": median + 1}
        for place in itertools.product(values, repeat=len(axes))
        for method, median in (("one", 3.0), ("two", 4.0), ("third", 1e6))
    ]
    return draw_scores(pd.DataFrame(rows), {a: UNITS[a] for a in axes}, "error", METHODS)


def test_a_chart_for_each_value_of_the_other_axes() -> None:
    fig = draw("size", "told")
    assert [ax.get_title() for ax in fig.axes] == ["size 1 m", "size 10 m"]
    assert [ax.get_xlabel() for ax in fig.axes] == ["told", "told"]
    assert fig.axes[0].get_ylabel() == "error (m)"
    (ax, _), (line, other) = fig.axes, fig.axes[0].get_lines()
    assert (ax.get_xscale(), ax.get_yscale()) == ("log", "log")
    assert line.get_ydata().tolist() == pytest.approx([3.0, 3.0])
    assert other.get_ydata().tolist() == pytest.approx([4.0, 4.0])


def test_charts_that_do_not_fill_the_last_row() -> None:
    fig = draw("size", "told", values=(1.0, 2.0, 3.0, 4.0, 5.0))
    assert len(fig.axes) == 5
    assert [bool(ax.get_xlabel()) for ax in fig.axes] == [False, False, True, True, True]


@pytest.mark.parametrize(
    ("axes", "values"),
    [([], ()), (["size"], (1.0,)), (["size", "told"], tuple(range(1, 14))), (["word"], ("a", "b"))],
)
def test_what_cannot_be_drawn(axes: list[str], values: tuple[Any, ...]) -> None:
    with pytest.raises(ParameterError):
        draw(*axes, values=values)
