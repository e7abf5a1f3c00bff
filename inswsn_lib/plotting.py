"""Figures: one style that reads on light and dark pages, and the figure of scores over a grid.

Figures are drawn as SVG on a transparent ground in mid-lightness colours that colour-blind readers
can tell apart (Okabe and Ito). On a dark page the book's style sheet inverts their lightness and
keeps their hues.
"""

from __future__ import annotations

import itertools
from collections.abc import Mapping
from typing import Any, NamedTuple

import matplotlib as mpl
import numpy as np
import pandas as pd
from matplotlib import pyplot as plt
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FormatStrFormatter, LogLocator, PercentFormatter

from inswsn_lib.errors import ParameterError

#: The colours, by what they stand for in every chapter.
COLOURS = {
    "published": "#4d4d4d",
    "rebuilt": "#0072b2",
    "contradicted": "#d55e00",
    "reproduced": "#00805f",
    "rival": "#a6558a",
}


class Stroke(NamedTuple):
    """How a method is drawn: its colour, and dashes and gaps in points; none for a full line.

    Examples
    --------
    >>> import inswsn_lib as iw
    >>> iw.plotting.STROKES["kalman"]
    Stroke(colour='#0072b2', dashes=())
    """

    colour: str
    dashes: tuple[float, ...] = ()


#: How each method is drawn in the whole book: one colour a method, and what is akin in dashes.
STROKES = {
    "truth": Stroke("#4d4d4d"),
    "ins": Stroke("#c65200"),
    "network": Stroke("#007a5a", (2, 3)),
    "constant": Stroke("#8a6d00", (9, 3, 2, 3)),
    "kalman": Stroke("#0072b2"),
    "coloured": Stroke("#0072b2", (9, 3)),
    "federated": Stroke("#0072b2", (2, 3)),
    "correlated": Stroke("#0072b2", (9, 3, 2, 3)),
    "independent": Stroke("#8a6d00"),
    "hinfinity": Stroke("#8f4676"),
    "distributed": Stroke("#8f4676", (9, 3)),
    "lssvm": Stroke("#5f4bb6"),
    "backprop": Stroke("#a8123e", (5, 2)),
    "rbf": Stroke("#5d7000"),
    "smoother": Stroke("#0072b2", (14, 4)),
    "computed": Stroke("#b0187e"),
    "published": Stroke("#4d4d4d", (9, 3)),
}

_STYLE: Any = {  # a dict; matplotlib types its keys one by one
    "font.family": "DejaVu Sans",
    "font.size": 10.5,
    "axes.titlesize": 10.5,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.axisbelow": True,
    "axes.grid": True,
    "grid.color": "#bbbbbb",
    "grid.linewidth": 0.6,
    "grid.alpha": 0.6,
    "legend.frameon": False,
    "legend.handlelength": 3,  # for the dashes of all strokes
    "lines.linewidth": 1.8,
    "figure.constrained_layout.use": True,
    "figure.facecolor": "none",
    "axes.facecolor": "none",
    "savefig.facecolor": "none",
    "svg.fonttype": "path",
    "svg.hashsalt": "inswsn",
}

# In this order a method takes the next colour and style: as p1-training draws network, Kalman
# and H-infinity filters. Lines that are not solid can be told apart without colours.
_STROKES = (
    *(("reproduced", ":"), ("rival", "-"), ("rebuilt", "-"), ("rebuilt", "--")),
    *(("contradicted", "-."), ("published", "-"), ("reproduced", "-"), ("rival", "--")),
)
_MOST_PANELS = 12


def figure(
    rows: int = 1, columns: int = 1, *, height: float = 3.2, **options: Any
) -> tuple[Figure, Any]:
    """Return an empty figure in the book's style, 7.2 by `height` inches, and its axes.

    Options are those of ``matplotlib.pyplot.subplots``.

    Examples
    --------
    >>> from matplotlib import pyplot as plt
    >>> import inswsn_lib as iw
    >>> fig, axes = iw.plotting.figure(1, 2, height=2.5, sharey=True)
    >>> fig.get_size_inches().tolist(), len(axes)
    ([7.2, 2.5], 2)
    >>> plt.close(fig)
    """
    mpl.rcParams.update(_STYLE)
    fig, axes = plt.subplots(rows, columns, figsize=(7.2, height), **options)
    return fig, axes


def stroke(method: str, dashes: str | None = None) -> dict[str, Any]:
    """Return how the line of a method is drawn, as keywords of ``Axes.plot``.

    Parameters
    ----------
    method : str
        One of `STROKES`.
    dashes : str, optional
        A line style of matplotlib instead of the method's own, for a variant of it.

    Examples
    --------
    >>> import inswsn_lib as iw
    >>> iw.plotting.stroke("coloured")
    {'color': '#0072b2', 'ls': (0, (9, 3))}
    >>> iw.plotting.stroke("kalman", ":")
    {'color': '#0072b2', 'ls': ':'}
    """
    if method not in STROKES:
        raise ParameterError("method", method, "one of " + ", ".join(STROKES))
    colour, own = STROKES[method]
    return {"color": colour, "ls": dashes or ((0, own) if own else "-")}


def percent_axis(axes: Axes, which: str = "x") -> None:
    """Write the ticks of an axis, ``"x"`` or ``"y"``, as per cent.

    Examples
    --------
    >>> from matplotlib import pyplot as plt
    >>> import inswsn_lib as iw
    >>> fig, axes = iw.plotting.figure()
    >>> iw.plotting.percent_axis(axes, "y")
    >>> axes.yaxis.get_major_formatter()(25)
    '25%'
    >>> plt.close(fig)
    """
    axis = axes.xaxis if which == "x" else axes.yaxis
    axis.set_major_formatter(PercentFormatter(decimals=0))


def draw_scores(
    frame: pd.DataFrame,
    axes: Mapping[str, str],
    headline: str,
    methods: Mapping[str, str],
    strokes: Mapping[str, Mapping[str, Any]] | None = None,
    published: Mapping[str, Any] | None = None,
) -> Figure:
    """Draw one column over a grid: a line per method, with the band that holds 95 % of the runs.

    The last axis of the grid runs along the charts; each combination of values of the others has a
    chart of its own.

    Parameters
    ----------
    frame : pandas.DataFrame
        Rows of `inswsn_lib.evaluation.Scores.table` with the axes as columns.
    axes, methods : mapping of str to str
        The axes in order with their units, the last of numbers; the methods and their words.
    headline : str
        The column.
    strokes : mapping of str to mapping, optional
        How the line of a method is drawn, as `stroke` returns it; the others take the next look.
    published : mapping of str to value, optional
        Where on the axes a dotted line marks the published value.

    Examples
    --------
    >>> import pandas as pd
    >>> from matplotlib import pyplot as plt
    >>> import inswsn_lib as iw
    >>> row = {"method": "kf", "column": "error", "unit": "m", "median": 2.0}
    >>> frame = pd.DataFrame([row | {"q": q, "low": 1.0, "high": 3.0} for q in (0.1, 1.0)])
    >>> fig = iw.plotting.draw_scores(frame, {"q": "1"}, "error", {"kf": "Kalman"})
    >>> fig.axes[0].get_xscale()
    'log'
    >>> plt.close(fig)
    """
    *others, along = axes or [""]
    if along not in frame or frame[along].dtype.kind not in "if" or frame[along].nunique() < 2:
        raise ParameterError("the last axis", along, "a parameter with at least two numbers")
    shown = frame[(frame["column"] == headline) & frame["method"].isin(list(methods))]
    panels = list(shown.groupby(others, sort=False)) if others else [((), shown)]
    if len(panels) > _MOST_PANELS:
        raise ParameterError("a figure", len(panels), f"of at most {_MOST_PANELS} charts")
    across = len(panels) if len(panels) < 4 else 2 if len(panels) == 4 else 3
    down = -(-len(panels) // across)
    fig, grid = figure(
        down, across, height=1.2 + 2.5 * down, sharex=True, sharey=True, squeeze=False
    )
    for ax in list(grid.flat)[len(panels) :]:
        ax.remove()
    for number, (ax, (values, part)) in enumerate(zip(grid.flat, panels, strict=False)):
        _draw_panel(ax, part, along, methods, strokes or {})
        if published and along in published:
            ax.axvline(published[along], color=COLOURS["published"], lw=1, ls=":")
        ax.set_title(", ".join(_named(n, v, axes[n]) for n, v in zip(others, values, strict=True)))
        if number + across >= len(panels):  # the lowest of its column
            ax.tick_params(labelbottom=True)
            ax.set_xlabel(_labelled(along, axes[along]))
    for row in grid:
        row[0].set_ylabel(_labelled(headline, shown["unit"].iloc[0]))
    fig.legend(*grid[0, 0].get_legend_handles_labels(), loc="outside upper center", ncols=2)
    return fig


def _draw_panel(
    ax: Axes,
    part: pd.DataFrame,
    along: str,
    methods: Mapping[str, str],
    strokes: Mapping[str, Mapping[str, Any]],
) -> None:
    looks = itertools.cycle(_STROKES)
    for (method, label), (name, style) in zip(methods.items(), looks, strict=False):
        line = part[part["method"] == method].sort_values(along)
        look = {"color": COLOURS[name], "ls": style} | dict(strokes.get(method, {}))
        ax.plot(line[along], line["median"], marker=".", label=label, **look)
        ax.fill_between(
            line[along], line["low"], line["high"], color=look["color"], alpha=0.15, lw=0
        )
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
