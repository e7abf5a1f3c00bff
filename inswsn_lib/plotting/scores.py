"""The figure of scores over a grid of parameters."""

from __future__ import annotations

import itertools
from collections.abc import Mapping

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FormatStrFormatter, LogLocator

from inswsn_lib.errors import ParameterError
from inswsn_lib.plotting.figures import COLOURS, figure

# In this order a method takes the next colour and style: as chapter 02 draws network, Kalman filter
# and H-infinity filters. Lines that are not solid can be told apart without colours.
_STROKES = tuple(
    (COLOURS[name], style)
    for name, style in (
        *(("reproduced", ":"), ("rival", "-"), ("rebuilt", "-"), ("rebuilt", "--")),
        *(("contradicted", "-."), ("published", "-"), ("reproduced", "-"), ("rival", "--")),
    )
)
_MOST_PANELS = 12


def draw_scores(
    frame: pd.DataFrame, axes: Mapping[str, str], headline: str, methods: Mapping[str, str]
) -> Figure:
    """Draw one column over a grid: a line a method, with the band that holds 95 % of the runs.

    The last axis of the grid runs along the charts; each combination of values of the others has a
    chart of its own.

    Parameters
    ----------
    frame : pandas.DataFrame
        Rows of `inswsn_lib.evaluation.Scores.table` with the axes as columns.
    axes : mapping of str to str
        The axes of the grid in order, with their units.
    headline : str
        The column.
    methods : mapping of str to str
        The methods that are drawn, and what the legend calls them.

    Returns
    -------
    matplotlib.figure.Figure

    Raises
    ------
    ParameterError
        If the last axis is no axis of at least two numbers, or there would be more than 12 charts.

    Examples
    --------
    >>> import pandas as pd
    >>> from matplotlib import pyplot as plt
    >>> from inswsn_lib.plotting import draw_scores
    >>> row = {"method": "kf", "column": "error", "unit": "m", "median": 2.0}
    >>> frame = pd.DataFrame([row | {"q": q, "low": 1.0, "high": 3.0} for q in (0.1, 1.0)])
    >>> fig = draw_scores(frame, {"q": "1"}, "error", {"kf": "Kalman"})
    >>> len(fig.axes), fig.axes[0].get_xscale()
    (1, 'log')
    >>> plt.close(fig)
    """
    *others, along = axes or [""]
    if along not in frame or frame[along].dtype.kind not in "if":
        raise ParameterError("the last axis", along, "a parameter that is a number, for a figure")
    shown = frame[(frame["column"] == headline) & frame["method"].isin(list(methods))]
    if shown[along].nunique() < 2:
        raise ParameterError("the last axis", along, "one of at least two values, for a figure")
    panels = list(shown.groupby(others, sort=False)) if others else [((), shown)]
    if len(panels) > _MOST_PANELS:
        raise ParameterError(
            "the grid", f"one of {len(panels)} charts", f"one of {_MOST_PANELS}, for a figure"
        )
    across = len(panels) if len(panels) < 4 else 2 if len(panels) == 4 else 3
    down = -(-len(panels) // across)
    fig, grid = figure(
        down, across, height=1.2 + 2.5 * down, sharex=True, sharey=True, squeeze=False
    )
    for ax in list(grid.flat)[len(panels) :]:
        ax.remove()
    for number, (ax, (values, part)) in enumerate(zip(grid.flat, panels, strict=False)):
        _draw_panel(ax, part, along, methods)
        ax.set_title(", ".join(_named(n, v, axes[n]) for n, v in zip(others, values, strict=True)))
        if number + across >= len(panels):  # the lowest of its column
            ax.tick_params(labelbottom=True)
            ax.set_xlabel(_labelled(along, axes[along]))
    for row in grid:
        row[0].set_ylabel(_labelled(headline, shown["unit"].iloc[0]))
    fig.legend(*grid[0, 0].get_legend_handles_labels(), loc="outside upper center", ncols=2)
    return fig


def _draw_panel(ax: Axes, part: pd.DataFrame, along: str, methods: Mapping[str, str]) -> None:
    strokes = itertools.cycle(_STROKES)
    for (method, label), (colour, style) in zip(methods.items(), strokes, strict=False):
        line = part[part["method"] == method].sort_values(along)
        ax.plot(line[along], line["median"], style, color=colour, marker=".", label=label)
        ax.fill_between(line[along], line["low"], line["high"], color=colour, alpha=0.15, lw=0)
    values = np.unique(part[along])
    if (part["low"] > 0).all():
        ax.set_yscale("log")
        ax.yaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
        ax.yaxis.set_major_formatter(FormatStrFormatter("%g"))
    if values[0] > 0 and values[-1] >= 10 * values[0]:
        ax.set_xscale("log")
    if len(values) <= 6:
        ax.set_xticks(values, [f"{value:g}" for value in values])
    ax.minorticks_off()


def _named(name: str, value: object, unit: str) -> str:
    text = f"{value:g}" if isinstance(value, float) else str(value)
    return f"{name.replace('_', ' ')} {text}" + ("" if unit == "1" else f" {unit}")


def _labelled(name: str, unit: str) -> str:
    words = name.replace("_", " ")
    return words if unit == "1" else f"{words} ({unit})"
