"""Figures: one style that reads on light and dark pages, with captions and alternative text.

Figures are drawn as SVG on a transparent ground in mid-lightness colours that colour-blind readers
can tell apart (Okabe and Ito). On a dark page the book's style sheet inverts their lightness and
keeps their hues.
"""

from __future__ import annotations

from typing import Any

import matplotlib as mpl
from matplotlib import pyplot as plt
from matplotlib.axes import Axes
from matplotlib.figure import Figure

#: The colours, by what they stand for in every chapter.
COLOURS = {
    "published": "#4d4d4d",
    "rebuilt": "#0072b2",
    "contradicted": "#d55e00",
    "reproduced": "#00805f",
    "rival": "#a6558a",
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
    "lines.linewidth": 1.8,
    "figure.constrained_layout.use": True,
    "figure.facecolor": "none",
    "axes.facecolor": "none",
    "savefig.facecolor": "none",
    "svg.fonttype": "path",
    "svg.hashsalt": "inswsn",
}


def figure(
    rows: int = 1, columns: int = 1, *, height: float = 3.2, **options: Any
) -> tuple[Figure, Any]:
    """Make an empty figure in the book's style, 7.2 inches wide.

    Parameters
    ----------
    rows, columns : int
        The grid of axes.
    height : float
        Height in inches.
    **options
        Passed on to ``matplotlib.pyplot.subplots``.

    Returns
    -------
    fig : Figure
    axes : Axes or ndarray of Axes

    Examples
    --------
    >>> from matplotlib import pyplot as plt
    >>> from inswsn_lib.plotting import figure
    >>> fig, axes = figure(1, 2, height=2.5, sharey=True)
    >>> fig.get_size_inches().tolist(), len(axes)
    ([7.2, 2.5], 2)
    >>> plt.close(fig)
    """
    mpl.rcParams.update(_STYLE)
    fig, axes = plt.subplots(rows, columns, figsize=(7.2, height), **options)
    return fig, axes


def percent_axis(axes: Axes, which: str = "x") -> None:
    """Write the ticks of an axis as per cent.

    Parameters
    ----------
    axes : matplotlib.axes.Axes
        The axes, with values in per cent.
    which : {"x", "y"}
        The axis.

    Examples
    --------
    >>> from matplotlib import pyplot as plt
    >>> from inswsn_lib.plotting import figure, percent_axis
    >>> fig, axes = figure()
    >>> percent_axis(axes, "y")
    >>> axes.yaxis.get_major_formatter()(25)
    '25%'
    >>> plt.close(fig)
    """
    axis = axes.xaxis if which == "x" else axes.yaxis
    axis.set_major_formatter(mpl.ticker.PercentFormatter(decimals=0))
