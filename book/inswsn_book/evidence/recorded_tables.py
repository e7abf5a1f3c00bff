"""The evidence on recorded data: tables and drawings of what is judged on recordings."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.figure import Figure
from scipy.stats import norm, t

from inswsn_book.show.legible import label_lines
from inswsn_lib.checks import Array
from inswsn_lib.plotting import COLOURS, STROKES, figure


def written(ratio: float, low: float, high: float) -> str:
    """Write a ratio and its interval."""
    return f"{ratio:.2f} ({low:.2f} to {high:.2f})"


def over_network(row: pd.Series, of: str) -> str:
    """Write the ratio of a row to the network's; that of the network itself is one."""
    if row.name == "network alone":
        return "1"
    return written(*(row[f"{of}_{end}"] for end in ("ratio", "low", "high")))


def plain(value: float, digits: int) -> str:
    """Write a number that may not be there."""
    return "–" if pd.isna(value) else f"{value:.{digits}f}"


def method(row: pd.Series) -> str:
    """Return the name of a method: in italics if it uses later fixes."""
    return str(row.name) if row["causal"] else f"*{row.name}*"


def room_table(room: pd.DataFrame) -> pd.DataFrame:
    """Return the errors and the consistency of all filters in the room."""
    rows = {}
    for _, row in room.iterrows():
        rows[method(row) + ("" if row["settled"] else " (not settled)")] = {
            "position, cm": f"{100 * row['position']:.1f}",
            "velocity, cm/s": f"{100 * row['velocity']:.1f}",
            "position over network": over_network(row, "position"),
            "velocity over network": over_network(row, "velocity"),
            "NEES/4": plain(row["nees"], 1),
            "NIS": plain(row["nis"], 2),
            "lag-1": plain(row["lag1"], 2),
        }
    return pd.DataFrame.from_dict(rows, orient="index").rename_axis("method")


def outage_table(
    table: pd.DataFrame, names: Sequence[str], lengths: Sequence[str], before: str = ""
) -> pd.DataFrame:
    """Return RMS errors in outages of some lengths (s) with their ratio to going straight on."""
    rows = {
        f"{before}{name}": {
            f"{s} s": f"{row[f'rms {s} s']:.2f} m, "
            + written(*(row[f"{end} {s} s"] for end in ("ratio", "low", "high")))
            for s in lengths
        }
        for name, row in table.loc[list(names)].iterrows()
    }
    return pd.DataFrame.from_dict(rows, orient="index").rename_axis("method")


def mean_ratio(ratios: Sequence[float]) -> tuple[float, float, float]:
    """Return the geometric mean of a ratio over recordings, and Student's 95 % interval."""
    logs = np.log(np.array(ratios, dtype=float))
    within = t.ppf(0.975, len(logs) - 1) * logs.std(ddof=1) / np.sqrt(len(logs))
    mean, low, high = np.exp(logs.mean() + np.array([0.0, -within, within]))
    return float(mean), float(low), float(high)


def replication_table(
    planned: Sequence[Mapping[str, str]], outcomes: Sequence[Mapping[str, Any]]
) -> pd.DataFrame:
    """Return the sentences of a registered replication, and what came of each."""

    def numbers(found: Mapping[str, float] | None) -> str:
        each = (found or {}).items()
        return "; ".join(f"{what.replace('_', ' ')} {x:.3g}" for what, x in each) or "–"

    rows = [
        {
            "sentence": said["sentence"].rstrip("."),
            "recording": "–" if said["applies_to"] == "neither" else said["applies_to"],
            "what came of it": outcome["came_of_it"],
            "in 2.0.0": numbers(outcome.get("published")),
            "replicated": numbers(outcome.get("replicated")),
        }
        for said, outcome in zip(planned, outcomes, strict=True)
    ]
    return pd.DataFrame(rows).set_index("sentence")


def memory_of(series: pd.Series) -> float:
    """Return the lag at which an autocorrelation first falls to 1/e, s."""
    lags, values = series.index.to_numpy(dtype=float), series.to_numpy(dtype=float)
    below = np.flatnonzero(values < np.exp(-1))
    if not len(below) or not below[0]:
        return float(lags[below[0]] if len(below) else lags[-1])
    i = below[0]
    share = (values[i - 1] - np.exp(-1)) / (values[i - 1] - values[i])
    return float(lags[i - 1] + share * (lags[i] - lags[i - 1]))


def draw_errors(scaled: Array, autocorrelation: pd.Series) -> Figure:
    """Draw the sizes of errors, in their standard deviations, and how they hang together."""
    fig, (left, right) = figure(1, 2, height=2.9)
    bins, colour = np.linspace(-4, 4, 49), STROKES["network"].colour
    left.hist(scaled.ravel(), bins, density=True, color=colour, alpha=0.6, label="fixes")
    left.plot(bins, norm.pdf(bins), "--", color=COLOURS["published"], label="normal")
    left.set(xlabel="error (its standard deviations)", ylabel="density")
    left.legend()
    lags = autocorrelation.index.to_numpy(dtype=float)
    right.plot(lags, autocorrelation, color=colour, label="fixes")
    white = [0, 0.2, lags[-1]], [1, 0, 0]
    right.plot(*white, "--", color=COLOURS["published"], label="white noise")
    right.axhline(np.exp(-1), color=COLOURS["published"], lw=0.8, ls=":")
    right.set(xlabel="lag (s)", ylabel="autocorrelation")
    label_lines(right)
    return fig


def law_table(gains: pd.DataFrame) -> pd.DataFrame:
    """Return what filters gain on recordings beside what the law expects, as of `gains`."""
    rows = {
        name: {
            "holds, s": f"{row['hold']:.2g}",
            "expected": f"{row['expected_position']:.2f}",
            "found": written(*(row[f"position{end}"] for end in ("", "_low", "_high"))),
            "error-state": f"{row['state_position']:.2f}",
            "velocity: expected": f"{row['expected_velocity']:.2f}",
            "found ": written(*(row[f"velocity{end}"] for end in ("", "_low", "_high"))),
            "error-state ": f"{row['state_velocity']:.2f}",
        }
        for name, row in gains.iterrows()
    }
    return pd.DataFrame.from_dict(rows, orient="index").rename_axis("recording")


def draw_law(gains: pd.DataFrame, source: Sequence[str], simulated: pd.DataFrame) -> Figure:
    """Draw what filters gain over what the law expects, by recording.

    Parameters
    ----------
    gains, simulated : DataFrame
        With columns ``expected_position``, ``position``, and of velocity.
    source : sequence of str
        The recording of each row of `gains`.
    """
    fig, axes = figure(1, 2, height=3.4)
    for ax, of in zip(axes, ("position", "velocity"), strict=True):
        both = pd.concat([gains, simulated])
        low = 0.9 * float(both[[of, f"expected_{of}"]].min(axis=None))
        ax.plot([low, 1.1], [low, 1.1], "--", lw=0.8, color=COLOURS["published"])
        for mark, name in zip("os^vDPX", sorted(set(source)), strict=False):
            part = gains[[each == name for each in source]]
            label = name.removeprefix("rtklib/")
            ax.plot(part[f"expected_{of}"], part[of], mark, ms=5, mfc="none", label=label)
        ax.plot(simulated[f"expected_{of}"], simulated[of], "x", color="k", label="simulated")
        ax.set(xscale="log", yscale="log", xlabel=f"{of}: expected", ylabel="found")
        ticks = [tick for tick in (0.05, 0.1, 0.2, 0.5, 1) if tick > low]
        ax.set_xticks(ticks, [f"{tick:g}" for tick in ticks], minor=False)
        ax.set_yticks(ticks, [f"{tick:g}" for tick in ticks], minor=False)
        ax.minorticks_off()
    axes[1].legend(fontsize="small")
    return fig
