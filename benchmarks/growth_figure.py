"""The figure of how time grows with the size of the work, from what `growth` has measured."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from inswsn_book.show import svg_of
from matplotlib.ticker import NullFormatter

from inswsn_lib.plotting import COLOURS, figure

_ORDER = ("rebuilt", "contradicted", "reproduced", "rival")


def growth_svg(found: Mapping[str, Any]) -> str:
    """Draw the curves, a panel for each thing that grows; their limits are dashed. As SVG."""
    panels: dict[str, list[Any]] = {}
    for curve in found["curves"]:
        panels.setdefault(curve["over"], []).append(curve)
    columns = 2
    rows = -(-len(panels) // columns)
    fig, axes = figure(rows, columns, height=3.4 * rows, squeeze=False)
    for ax in axes.flat[len(panels) :]:
        ax.remove()
    for ax, (over, curves) in zip(axes.flat, panels.items(), strict=False):
        for curve, name in zip(curves, _ORDER, strict=False):
            sizes = [point["size"] for point in curve["points"]]
            for field, line, label in (("seconds", "o-", curve["name"]), ("limit", "--", None)):
                values = [point[field] for point in curve["points"]]
                ax.plot(sizes, values, line, ms=4, color=COLOURS[name], label=label)
        base = 2 if all(size & (size - 1) == 0 for size in sizes) else 10
        ax.set_xscale("log", base=base)
        ax.set(yscale="log", xlabel=over, ylabel="s")
        ax.xaxis.set_minor_formatter(NullFormatter())
        ax.legend(loc="lower center", bbox_to_anchor=(0.5, 1.0), fontsize=9)
    return svg_of(fig)
