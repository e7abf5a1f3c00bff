"""The figure of the crossed study: headline results as distributions, and what they rest on."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

from inswsn_book.run.assumptions import Headline
from inswsn_book.show import svg_of
from matplotlib.axes import Axes
from matplotlib.lines import Line2D

from inswsn_lib.plotting import COLOURS, figure

if TYPE_CHECKING:
    from crossed import Crossed, Spread
    from indices import Share

_MOST = 4  # bars of a result


def crossed_svg(study: Crossed, headlines: Mapping[str, Headline]) -> str:
    """Draw the distribution of each result and its largest total indices, as SVG."""
    names = list(study.shares)
    fig, axes = figure(len(names), 2, height=0.95 * len(names) + 0.6, squeeze=False)
    for (left, right), name in zip(axes, names, strict=True):
        _distribution(left, study.spreads[name], headlines[name])
        _totals(right, study.shares[name])
    axes[-1, 0].set_xlabel("result")
    axes[-1, 1].set_xlabel("total share of the variance")
    marks = [
        Line2D([], [], color=COLOURS["rebuilt"], lw=5, alpha=0.9, label="50 % of points"),
        Line2D([], [], color=COLOURS["rebuilt"], lw=1.5, label="95 %"),
        Line2D([], [], color=COLOURS["published"], marker="D", ls="", label="published"),
        Line2D([], [], color=COLOURS["contradicted"], ls="--", label="turns"),
    ]
    fig.legend(handles=marks, loc="outside upper left", ncols=4, fontsize=8.5)
    return svg_of(fig)


def _distribution(ax: Axes, spread: Spread, headline: Headline) -> None:
    low, lower, middle, upper, high = spread.quantiles
    ax.plot([low, high], [0, 0], color=COLOURS["rebuilt"], lw=1.5)
    ax.plot([lower, upper], [0, 0], color=COLOURS["rebuilt"], lw=7, solid_capstyle="butt")
    ax.plot([middle], [0], "|", color=COLOURS["reproduced"], ms=16, mew=2)
    ax.plot([spread.published], [0], "D", color=COLOURS["published"], ms=5)
    if headline.turns is not None:
        ax.axvline(headline.turns, color=COLOURS["contradicted"], ls="--", lw=1.2)
    ax.set_yticks([])
    ax.set_ylim(-1, 1)
    ax.margins(x=0.08)
    ax.set_title(f"{headline.chapter}, {headline.short}", loc="left", fontsize=9)
    ax.tick_params(labelsize=8.5)


def _totals(ax: Axes, shares: Mapping[str, Share]) -> None:
    found = sorted(shares.items(), key=lambda item: -item[1].total)[:_MOST]
    places = range(len(found))[::-1]
    # an estimate may lie above 1, where its interval ends
    ends = [(max(s.total - s.total_low, 0), max(s.total_high - s.total, 0)) for _, s in found]
    ax.barh(
        places,
        [share.total for _, share in found],
        xerr=list(zip(*ends, strict=True)),
        color=COLOURS["rebuilt"],
        ecolor=COLOURS["published"],
        height=0.65,
    )
    ax.set_yticks(places, [name for name, _ in found], fontsize=8)
    ax.set_xlim(0, 1.25)
    ax.tick_params(axis="x", labelsize=8.5)
    ax.grid(axis="y", visible=False)
