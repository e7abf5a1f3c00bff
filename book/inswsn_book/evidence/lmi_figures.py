"""The figures of evidence p1-lmi."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from inswsn_lib.checks import Array
from inswsn_lib.plotting import COLOURS, STROKES, figure, stroke


def draw_cost(gammas: pd.DataFrame) -> Figure:
    """Draw least gammas, rows by measurements, axis and value, a column for each inequality."""
    fig, axes = figure(1, 2, height=3.4, sharey=True)
    names = {"period": "period $T$ (s)", "ratio": "process noise / measurement noise"}
    for ax, (axis, xlabel) in zip(axes, names.items(), strict=True):
        for label, marker in (("position and velocity", ""), ("position alone", "o")):
            for form, method in (("exact", "hinfinity"), ("printed", "published")):
                course, look = gammas[form][label, axis], stroke(method)
                ax.loglog(course, marker=marker, ms=4, label=f"{label}, {form}", **look)
        ax.set(xlabel=xlabel)
    axes[0].set(ylabel=r"least $\gamma$")
    axes[0].legend(fontsize=8.5)
    return fig


def draw_built(
    built: Mapping[int, float], known: Mapping[int, float], pushed: Array, level: float
) -> Figure:
    """Draw gains over N steps, the jitter not known and known, over that of a sum of pushes."""
    fig, ax = figure(height=3.2)
    grey, steps = COLOURS["published"], [*built]
    for gains, marker, line, label in (
        (built, "o", "-", "jitter not known, as built"),
        (known, "s", "--", "jitter known, as in the theorem"),
    ):
        look = stroke("hinfinity", line)
        ax.loglog(steps, [*gains.values()], marker=marker, ms=6, mfc="none", label=label, **look)
    label = r"$\delta t$ times the gain of a sum of $N$ pushes"
    ax.loglog(steps, pushed, "--", color=grey, lw=1.2, label=label)
    ax.axhline(level, color=grey, lw=1, ls=":", label=r"$\gamma$ of the design")
    low = 0.7 * min(known.values())
    ax.set(xlabel="number of steps $N$", ylabel="gain over $N$ steps", ylim=(low, None))
    ax.set_yticks([1.5, 2, 3, 5, 8], ["1.5", "2", "3", "5", "8"])
    ax.minorticks_off()
    ax.legend(fontsize=9, loc="upper left")
    return fig


def draw_curves(curves: Mapping[str, Mapping[str, Any]]) -> Figure:
    """Draw worst-case gain against error under white noise, a panel for each process noise."""
    fig, axes = figure(1, 2, height=3.6)
    colours = {name: STROKES[name].colour for name in ("hinfinity", "kalman", "network")}
    titles = ("process noise of this page", "a tenth of it")
    for ax, curve, title in zip(axes, curves.values(), titles, strict=True):
        ours = colours["hinfinity"]
        ax.plot(*np.transpose(curve["exact"]), label="exact inequality", **stroke("hinfinity"))
        ax.plot(*np.transpose(curve["printed"]), label="printed inequality", **stroke("published"))
        ax.plot(*curve["here"], "o", color=ours, ms=7, label="margin of this page")
        ax.plot(*curve["Kalman"], "s", color=colours["kalman"], label="Kalman")
        ax.plot(*curve["deadbeat"], "D", color=colours["network"], ms=6, label="deadbeat")
        ax.set(xlabel="worst-case gain", title=title)
        ax.margins(0.06, 0.08)
    axes[0].set(ylabel="RMS error under white noise")
    axes[1].legend(fontsize=8.5, loc="upper right")
    return fig
