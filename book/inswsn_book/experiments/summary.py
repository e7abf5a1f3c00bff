"""What many runs of an experiment come to: one tidy table, the leaders, and a figure."""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping, Sequence
from typing import Any, cast

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FormatStrFormatter, LogLocator
from numpy.typing import NDArray

from inswsn_book.experiments.experiment import Experiment
from inswsn_book.parameters import Value
from inswsn_lib.errors import ParameterError
from inswsn_lib.evaluation import spread
from inswsn_lib.plotting import COLOURS, figure

Array = NDArray[np.float64]
Cell = Mapping[str, Value]

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
_NORMAL_95 = 1.959963984540054


def tidy_results(experiment: Experiment, cell: Cell, results: Mapping[str, Array]) -> pd.DataFrame:
    """Return the rows of one cell of a grid: one for each method and column.

    Parameters
    ----------
    experiment : Experiment
        The experiment.
    cell : mapping of str to value
        What stands for the cell: its values on the axes of the grid.
    results : mapping of str to ndarray
        For each of `Experiment.quantities`, (runs,); 40 runs or more.

    Returns
    -------
    pandas.DataFrame
        The columns of the cell, then ``method``, ``quantity``, ``unit``, ``runs``; ``mean`` and its
        ``standard_error``; ``median`` and the quantiles ``low`` (2.5 %) and ``high`` (97.5 %) of
        the runs.

    Raises
    ------
    ParameterError
        If there are fewer than 40 runs.

    Examples
    --------
    >>> import numpy as np
    >>> from inswsn_book.experiments.networked import NETWORKED
    >>> from inswsn_book.experiments.summary import tidy_results
    >>> runs = {name: np.arange(101.0) for name in NETWORKED.quantities}
    >>> frame = tidy_results(NETWORKED, {"period": 0.2}, runs)
    >>> print(*frame.loc[0, ["period", "method", "quantity", "unit", "median", "high"]])
    0.2 ins rx1 m 50.0 97.5
    """
    rows = []
    for method, (column, unit) in itertools.product(experiment.methods, experiment.columns.items()):
        values = results[f"{method}.{column}"]
        (median,), (low,), (high,) = spread(values[None])
        rows.append(
            {
                **cell,
                "method": method,
                "quantity": column,
                "unit": unit,
                "runs": len(values),
                "mean": float(values.mean()),
                "standard_error": float(values.std(ddof=1) / math.sqrt(len(values))),
                "median": float(median),
                "low": float(low),
                "high": float(high),
            }
        )
    return pd.DataFrame(rows)


def leading_methods(
    experiment: Experiment, cell: Cell, results: Mapping[str, Array]
) -> dict[str, Any]:
    r"""Return which method has the least mean of the headline, and by how much.

    All methods judge the same runs, so the lead over the next is a mean of paired differences; its
    interval is :math:`\bar d \pm 1.96\, s_d / \sqrt{n}`.

    Parameters
    ----------
    experiment : Experiment
        The experiment.
    cell : mapping of str to value
        What stands for the cell.
    results : mapping of str to ndarray
        For each of `Experiment.quantities`, (runs,).

    Returns
    -------
    dict
        The cell, ``best`` and ``next`` (methods), ``error`` (the mean of the best), ``lead`` and
        its half-width ``within``, both in per cent of the mean of the next.

    Examples
    --------
    Two methods that differ by one tenth in every run:

    >>> import numpy as np
    >>> from inswsn_book.experiments.networked import NETWORKED
    >>> from inswsn_book.experiments.summary import leading_methods
    >>> runs = {name: np.full(100, 3.0) for name in NETWORKED.quantities}
    >>> runs |= {"kf.position": np.full(100, 0.9), "network.position": np.full(100, 1.0)}
    >>> found = leading_methods(NETWORKED, {}, runs)
    >>> found["best"], found["next"], round(found["lead"], 6), round(found["within"], 6)
    ('kf', 'network', 10.0, 0.0)
    """
    headline = {method: results[f"{method}.{experiment.headline}"] for method in experiment.methods}
    best, *others = sorted(headline, key=lambda method: headline[method].mean())
    found: dict[str, Any] = {**cell, "best": best, "error": float(headline[best].mean())}
    if not others:
        return found | {"next": None, "lead": math.nan, "within": math.nan}
    gain = headline[others[0]] - headline[best]
    scale = 100 / headline[others[0]].mean()
    within = _NORMAL_95 * gain.std(ddof=1) / math.sqrt(len(gain))
    return found | {
        "next": others[0],
        "lead": float(scale * gain.mean()),
        "within": float(scale * within),
    }


def draw_summary(experiment: Experiment, frame: pd.DataFrame, axes: Sequence[str]) -> Figure:
    """Draw the headline over a grid: a line a method, with the band that holds 95 % of the runs.

    The last axis of the grid runs along the charts; each combination of values of the others has a
    chart of its own.

    Parameters
    ----------
    experiment : Experiment
        The experiment.
    frame : pandas.DataFrame
        Rows of `tidy_results`, of all cells.
    axes : sequence of str
        The names of the axes of the grid, in order.

    Returns
    -------
    matplotlib.figure.Figure

    Raises
    ------
    ParameterError
        If the last axis is no axis of at least two numbers, or there would be more than 12 charts.

    Examples
    --------
    >>> import numpy as np
    >>> import pandas as pd
    >>> from matplotlib import pyplot as plt
    >>> from inswsn_book.experiments.networked import NETWORKED
    >>> from inswsn_book.experiments.summary import draw_summary, tidy_results
    >>> runs = {name: np.arange(1.0, 102.0) for name in NETWORKED.quantities}
    >>> frame = pd.concat(
    ...     [tidy_results(NETWORKED, {"q_scale": q}, runs) for q in (0.1, 1.0)], ignore_index=True
    ... )
    >>> fig = draw_summary(NETWORKED, frame, ["q_scale"])
    >>> len(fig.axes), fig.axes[0].get_xscale()
    (1, 'log')
    >>> plt.close(fig)
    """
    along = axes[-1] if axes else ""
    if not axes or experiment.schema[along].kind not in ("int", "float"):
        raise ParameterError("the last axis", along, "a parameter that is a number, for a figure")
    shown = frame[
        (frame["quantity"] == experiment.headline) & frame["method"].isin(experiment.drawn)
    ]
    if shown[along].nunique() < 2:
        raise ParameterError("the last axis", along, "one of at least two values, for a figure")
    others = list(axes[:-1])
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
    charts = list(grid.flat)
    for ax in charts[len(panels) :]:
        ax.remove()
    for number, (ax, (values, part)) in enumerate(zip(charts, panels, strict=False)):
        _draw_panel(ax, experiment, part, along)
        told = zip(others, cast("tuple[Value, ...]", values), strict=True)
        ax.set_title(", ".join(_told(experiment, name, value) for name, value in told))
        if number + across >= len(panels):  # the lowest of its column
            ax.tick_params(labelbottom=True)
            ax.set_xlabel(_labelled(along, experiment.schema[along].unit))
    for row in grid:
        row[0].set_ylabel(_labelled(experiment.headline, experiment.columns[experiment.headline]))
    handles, labels = grid[0, 0].get_legend_handles_labels()
    fig.legend(handles, labels, loc="outside upper center", ncols=2)
    return fig


def _draw_panel(ax: Axes, experiment: Experiment, part: pd.DataFrame, along: str) -> None:
    for method, (colour, style) in zip(experiment.drawn, itertools.cycle(_STROKES), strict=False):
        line = part[part["method"] == method].sort_values(along)
        ax.plot(
            line[along], line["median"], style, color=colour, marker=".",
            label=experiment.methods[method],
        )  # fmt: skip
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


def _told(experiment: Experiment, name: str, value: Value) -> str:
    unit = experiment.schema[name].unit
    text = f"{value:g}" if isinstance(value, float) else str(value)
    return f"{name.replace('_', ' ')} {text}" + ("" if unit == "1" else f" {unit}")


def _labelled(name: str, unit: str) -> str:
    words = name.replace("_", " ")
    return words if unit == "1" else f"{words} ({unit})"
