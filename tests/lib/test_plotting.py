"""The style of figures, and the figure of scores over a grid."""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from typing import Any

import pandas as pd
import pytest
from matplotlib import pyplot as plt
from matplotlib.colors import to_rgb

from inswsn_lib.errors import ParameterError
from inswsn_lib.plotting import COLOURS, STROKES, draw_scores, figure, percent_axis, stroke

METHODS = {"one": "the one", "two": "the other"}
UNITS = {"size": "m", "told": "1", "word": "1"}


@pytest.fixture(autouse=True)
def _closed() -> Iterator[None]:
    yield
    plt.close("all")


@pytest.mark.parametrize("colour", COLOURS.values(), ids=COLOURS)
def test_colours_stand_out_from_a_white_page(colour: str) -> None:
    linear = [c / 12.92 if c <= 0.04045 else ((c + 0.055) / 1.055) ** 2.4 for c in to_rgb(colour)]
    luminance = 0.2126 * linear[0] + 0.7152 * linear[1] + 0.0722 * linear[2]
    assert 1.05 / (luminance + 0.05) >= 3.0  # WCAG 2 for graphics


def test_a_figure_in_the_style_of_the_book() -> None:
    fig, axes = figure(2, 3, height=4)
    assert (axes.shape, fig.get_size_inches().tolist()) == ((2, 3), [7.2, 4.0])
    assert fig.get_facecolor()[3] == axes[0, 0].get_facecolor()[3] == 0  # no ground of its own
    visible = {side: spine.get_visible() for side, spine in axes[0, 0].spines.items()}
    assert visible == {"left": True, "right": False, "top": False, "bottom": True}
    assert axes[0, 0].get_axisbelow() is True
    for which, axis in (("x", axes[0, 0].xaxis), ("y", axes[0, 0].yaxis)):
        percent_axis(axes[0, 0], which)
        assert axis.get_major_formatter()(12.4) == "12%"


def draw(
    *axes: str, values: tuple[Any, ...] = (1.0, 10.0), low: float = -1, looks: Any = None
) -> Any:
    rows = [
        dict(zip(axes, place, strict=True))
        | {"method": method, "column": column, "unit": "m", "median": factor * median}
        | {"low": median + low, "high": median + 1}
        for place in itertools.product(values, repeat=len(axes))
        for column, factor in (("error", 1.0), ("time", 7.0))
        for method, median in (("one", 3.0), ("two", 4.0), ("third", 1e6))
    ]
    return draw_scores(pd.DataFrame(rows), {a: UNITS[a] for a in axes}, "error", METHODS, looks)


def test_a_chart_for_each_value_of_the_other_axes() -> None:
    fig = draw("size", "told")
    assert [ax.get_title() for ax in fig.axes] == ["size 1 m", "size 10 m"]
    assert [ax.get_xlabel() for ax in fig.axes] == ["told", "told"]
    assert fig.axes[0].get_ylabel() == "error (m)"
    (ax, _), (line, other) = fig.axes, fig.axes[0].get_lines()
    assert (ax.get_xscale(), ax.get_yscale()) == ("log", "log")
    assert line.get_xydata().tolist() == [[1, 3], [10, 3]]
    assert other.get_xydata().tolist() == [[1, 4], [10, 4]]
    assert (line.get_color(), line.get_linestyle()) == (COLOURS["reproduced"], ":")
    assert [text.get_text() for text in fig.legends[0].get_texts()] == list(METHODS.values())
    (band, _) = ax.collections
    assert (band.get_paths()[0].get_extents().ymin, band.get_paths()[0].get_extents().ymax) == (
        2,
        4,
    )
    # linear, where an end of a band is no positive number, or values are near to one another
    for values in ((1.0, 9.9), (0.0, 10.0)):
        near = draw("told", values=values, low=-3).axes[0]
        assert (near.get_xscale(), near.get_yscale()) == ("linear", "linear")
        assert near.get_xticks().tolist() == list(values)


@pytest.mark.parametrize(
    ("count", "columns"), [(2, 2), (3, 3), (4, 2), (5, 3), (7, 3)]
)  # charts, and how many stand side by side
def test_charts_in_rows_of_which_the_lowest_have_labels(count: int, columns: int) -> None:
    fig = draw("size", "told", values=tuple(map(float, range(1, count + 1))))
    assert len(fig.axes) == count
    assert len({round(ax.get_position().x0, 3) for ax in fig.axes}) == columns
    labelled = [bool(ax.get_xlabel()) for ax in fig.axes]
    assert labelled == [number + columns >= count for number in range(count)]


@pytest.mark.parametrize(
    ("axes", "values"),
    [([], ()), (["size"], (1.0,)), (["size", "told"], tuple(range(1, 14))), (["word"], ("a", "b"))],
)
def test_what_cannot_be_drawn(axes: list[str], values: tuple[Any, ...]) -> None:
    with pytest.raises(ParameterError, match=r"^(the last axis|a figure) must be"):
        draw(*axes, values=values)


def test_a_method_with_a_stroke_of_its_own() -> None:
    fig = draw("told", looks={"two": stroke("coloured")})
    one, two = fig.axes[0].get_lines()
    assert (one.get_color(), one.get_linestyle()) == (COLOURS["reproduced"], ":")
    assert (two.get_color(), two.get_linestyle()) == (STROKES["kalman"].colour, "--")
    with pytest.raises(ParameterError, match="method must be one of truth, ins"):
        stroke("other")
