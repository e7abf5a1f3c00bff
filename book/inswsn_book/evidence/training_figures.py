"""The figures of evidence p1-training."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from inswsn_book.evidence.filter_map import GROUNDS
from inswsn_lib.checks import Array
from inswsn_lib.plotting import COLOURS, STROKES, figure, stroke
from inswsn_lib.simulation import Scene

#: The filters of the map: label, look, and the letters of the strips
MAP_LOOKS = {
    "network": ("network", stroke("network"), "net"),
    "kalman": ("Kalman, tuned", stroke("kalman"), "KF"),
    "hf": ("HF, margin tuned", stroke("hinfinity"), "HF"),
    "hf-least": ("HF, 1 % above least γ", stroke("hinfinity", "--"), "HF1"),
    "told": ("Kalman, knows the change", stroke("kalman", "-."), ""),
}
_GROUNDS = dict(
    zip(
        GROUNDS,
        (
            "acceleration error (m/s²)",
            "correlation time of fixes (s)",
            "assumed over matched $Q$",
            "late ranges (%)",
            "energy placed to harm (%)",
        ),
        strict=True,
    )
)
#: The filters of the figure of lasting errors: their looks, and the mark of recorded errors
LASTING_LOOKS: dict[str, tuple[dict[str, Any], str]] = {
    "Kalman, matched": (stroke("kalman"), "o"),
    "HF, tuned for white": (stroke("hinfinity"), "s"),
    "Kalman, tuned again": (stroke("kalman", "-."), ""),
    "HF, tuned again": (stroke("hinfinity", "-."), ""),
    "Schmidt": (stroke("kalman", ":"), ""),
    "Kalman, coloured state": (stroke("coloured"), "^"),
}


def draw_scene(scene: Scene, inside: Mapping[str, Array]) -> Figure:
    """Draw the path, the nodes of the areas, and where there are fixes and outages."""
    fig, ax = figure(height=4.6)
    whole = inside["path"]
    ax.plot(*whole.T, lw=1, label="path", **stroke("truth"))
    for number in "12":
        first, nodes = number == "1", scene.nodes[f"area{number}"]
        dots = {"ms": 1.6, "color": COLOURS["published"], "alpha": 0.6}
        ax.plot(*nodes.T, ".", **dots, label="reference nodes" if first else None)
        for window, look, label in (
            ("area", "network", "samples with fixes"),
            ("outage", "ins", "outage"),
        ):
            thick = {"lw": 3, "color": STROKES[look].colour, "label": label if first else None}
            ax.plot(*inside[window + number].T, **thick)
        place = {"xytext": (3, -10), "textcoords": "offset points"}
        ax.annotate(f"No. {number}", nodes.max(axis=0), **place)
    ax.plot(*whole[0], "o", color=COLOURS["published"])
    for label, end, shift in (("start", whole[0], -34), ("end", whole[-1], -8)):
        ax.annotate(label, end, xytext=(shift, 8), textcoords="offset points")
    ax.set(xlabel="$x$ (m)", ylabel="$y$ (m)", xlim=(0, 700), ylim=(-20, 450), aspect="equal")
    ax.legend(loc="lower left")
    return fig


def draw_errors(time: Array, errors: Mapping[str, Array]) -> tuple[Figure, str]:
    """Draw P1's Figures 4 to 7, the errors of one run by method, and tell their means."""
    looks = (stroke("ins"), stroke("kalman", "--"), stroke("hinfinity"), stroke("kalman"))
    fig, axes = figure(2, 2, height=5.6, sharex=True)
    words = []
    for i, (ax, name) in enumerate(zip(axes.flat, ("r_x", "r_y", "v_x", "v_y"), strict=True)):
        for (label, error), look in zip(errors.items(), looks, strict=True):
            ax.plot(time[-len(error) :], error[:, i], lw=1.2, label=label, **look)
            words.append(f"Figure {4 + i}, {label}: {np.abs(error[:, i]).mean():.2f}")
        ax.set_yscale("symlog", linthresh=0.5 if i < 2 else 0.25, linscale=1.2)
        marks = (-10, -1, 0, 1, 10) if i < 2 else (-1, -0.25, 0, 0.25, 1)
        ax.set_yticks(marks, map(str, marks))
        ax.minorticks_off()
        ax.set_title(f"Figure {4 + i}: ${name}$ ({'m' if i < 2 else 'm/s'})")
    for ax in axes[1]:
        ax.set_xlabel("time in area 1 (s)")
    fig.legend(*axes[0, 0].get_legend_handles_labels(), loc="outside upper center", ncols=2)
    return fig, "; ".join(words)


def draw_lasting(
    shares: Mapping[tuple[float, str], float],
    recorded: Mapping[tuple[str, str], float],
    correlation: Array,
    fits: Sequence[tuple[float, float]],
) -> tuple[Figure, str]:
    """Draw position errors over correlation times, and the correlation of recorded fixes; tell."""
    times = sorted({time for time, _ in shares})
    places, period = np.arange(len(times)), 0.2
    fig, (ax, right) = figure(1, 2, height=4.8, width_ratios=(1.5, 1))
    for name, (look, mark) in LASTING_LOOKS.items():
        ax.plot(places, [shares[t, name] for t in times], label=name, **look)
        if mark:
            place = len(times) + {"o": 0.2, "s": 0.6, "^": 1.0}[mark]
            ax.plot(place, recorded["recorded", name], mark, color=look["color"], ms=7)
    ax.axhline(1, **stroke("network"), label="network = published HF, filtered")
    labels = ["white", *(f"{t:g}" for t in times[1:]), "recorded"]
    ax.set_xticks([*places, len(times) + 0.6], labels)
    ax.set_xlabel("correlation time of the errors of fixes (s)")
    ax.set_ylabel("position error over the network's")
    fig.legend(*ax.get_legend_handles_labels(), fontsize=9, loc="outside lower center", ncols=3)
    lag = period * np.arange(1, len(correlation) + 1)
    for i, (share, time) in enumerate(fits):
        assumed, first = share * np.exp(-lag / time), i == 0
        line = {"color": STROKES["network"].colour, "label": "recorded" if first else None}
        right.plot(lag, correlation[:, i], **line)
        line = {"color": COLOURS["published"], "label": "assumed" if first else None}
        right.plot(lag, assumed, "--", **line)
        middle = len(lag) // 4
        told = f"${'xy'[i]}$: {time:.1f} s,\n{100 * (1 - share):.0f} % white"
        beside = {"xytext": (6, 6), "textcoords": "offset points", "fontsize": 9}
        right.annotate(told, (lag[middle], assumed[middle]), **beside)
    right.axhline(0, color=COLOURS["published"], lw=0.6)
    right.set(xlabel="lag (s)", title="autocorrelation of fix errors", ylim=(-0.1, 1))
    right.legend(fontsize=9)
    words = [
        f"{name}: "
        + ", ".join(f"{shares[t, name]:.2f} at {t:g} s" for t in times)
        + (f", with recorded errors {recorded['recorded', name]:.2f}" if mark else "")
        for name, (_, mark) in LASTING_LOOKS.items()
    ]
    told = ", ".join(
        f"{correlation[lag, i]:.2f} in {axis} at {period * (lag + 1):.1f} s"
        for lag in (0, 4)
        for i, axis in enumerate("xy")
    )
    return fig, "; ".join(words) + f". Right: autocorrelation of recorded errors, {told}."


def draw_map(at: Mapping[tuple[str, str], pd.DataFrame]) -> tuple[Figure, str]:
    """Draw the errors over the sizes of each ground, by ground and part; tell the best filters."""
    fig, axes = figure(3, 2, height=9)
    words = []
    for ax, (ground, title) in zip(axes.flat, _GROUNDS.items(), strict=False):
        table = at[ground, "position"]
        for name, (label, look, _) in MAP_LOOKS.items():
            if name in table and not table[name].isna().any():  # nobody knows of an adversary
                ax.plot(range(len(table)), table[name], label=label, lw=1.6, **look)
        ax.set(yscale="log", ylim=(0.15, 4), xlim=(-0.5, len(table) - 0.5), xlabel=title)
        for low, part in ((0.25, "position"), (0.185, "velocity")):
            ax.text(-0.62, low, f"${'r' if part == 'position' else 'v'}$", ha="right", va="center")
            best = best_untold(at[ground, part])
            for k, name in enumerate(best):
                look = {"color": MAP_LOOKS[name][1]["color"], "lw": 12, "alpha": 0.35}
                ax.plot([k - 0.48, k + 0.48], [low, low], **look, solid_capstyle="butt")
                ax.text(k, low, MAP_LOOKS[name][2], ha="center", va="center", fontsize=8.5)
            told = (
                f"at {x:g} {MAP_LOOKS[n][0]} ({error:.2f})"
                for x, n, error in zip(
                    table.index,
                    best,
                    at[ground, part].drop(columns="told", errors="ignore").min(axis=1),
                    strict=True,
                )
            )
            words.append(f"{title.replace('$', '')}, {part}: " + ", ".join(told))
        ax.set_yticks([0.5, 0.7, 1, 2, 4], ["0.5", "0.7", "1", "2", "4"])
        ax.minorticks_off()
        every = 2 if len(table) > 6 else 1  # powers of ten need room
        marks = [
            f"{x:g}" if 0.01 < x < 1000 or x == 0 else f"$10^{{{np.log10(x):.0f}}}$"
            for x in table.index[::every]
        ]
        ax.set_xticks(range(0, len(table), every), marks)
    for ax in axes[:, 0]:
        ax.set_ylabel("error over the network's")
    axes[2, 1].axis("off")
    axes[2, 1].legend(*axes[0, 0].get_legend_handles_labels(), loc="center", frameon=False)
    return fig, "; ".join(words)


def best_untold(table: pd.DataFrame) -> list[str]:
    """Return the filter with the least error at each size, of those not told of the change."""
    names = [name for name in MAP_LOOKS if name != "told"]
    return [names[k] for k in table[names].to_numpy().argmin(axis=1)]
