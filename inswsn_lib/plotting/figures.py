"""Figures: one style that reads on light and dark pages, with captions and alternative text.

Figures are drawn as SVG on a transparent ground in mid-lightness colours that colour-blind readers
can tell apart (Okabe and Ito). On a dark page the book's style sheet inverts their lightness and
keeps their hues.
"""

from __future__ import annotations

import io
from typing import Any

import matplotlib as mpl
from IPython.display import display
from matplotlib import pyplot as plt
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from inswsn_lib.errors import ParameterError

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


def show_figure(fig: Figure, *, name: str, caption: str, alt: str) -> None:
    """Show a figure with its caption and alternative text; the last thing a cell does.

    Parameters
    ----------
    fig : Figure
        The figure; it is closed.
    name : str
        The label that ``{numref}`` uses, for example ``"fig-table1-shifts"``.
    caption : str
        What to see in it, in MyST Markdown.
    alt : str
        What a reader who cannot see it needs: the message and its numbers.

    Raises
    ------
    ParameterError
        If the name, the caption or the alternative text is empty.

    Examples
    --------
    In a notebook the figure is shown; a plain interpreter prints what is sent to it, and a missing
    caption or alternative text is refused:

    >>> from inswsn_lib.plotting import figure, show_figure
    >>> fig, axes = figure()
    >>> line = axes.plot([0, 1], [0, 2])
    >>> show_figure(fig, name="fig-line", caption="A line.", alt=" ")
    Traceback (most recent call last):
        ...
    inswsn_lib.errors.ParameterError: alt is ' '; it may be a text that is not empty.
    >>> show_figure(  # doctest: +ELLIPSIS
    ...     fig, name="fig-line", caption="A line.", alt="A line from 0 to 2."
    ... )
    {'image/svg+xml': ...<svg..., 'text/plain': 'A line from 0 to 2.'}
    """
    for field, text in (("name", name), ("caption", caption), ("alt", alt)):
        if not text.strip():
            raise ParameterError(field, text, "a text that is not empty")
    stream = io.StringIO()
    fig.savefig(stream, format="svg", metadata={"Date": None, "Creator": None})
    plt.close(fig)
    # the build moves this metadata to the cell, where the book's renderer looks for it
    display(
        {"image/svg+xml": stream.getvalue(), "text/plain": alt},
        metadata={"inswsn": {"name": name, "caption": caption, "alt": alt}},
        raw=True,
    )
