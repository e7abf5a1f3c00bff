"""What the page on your own data shows of a reader's own file: words, charts, tables, and a file.

So its charts are drawn as all others are (``moving.py``), and the script of the page words nothing.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from inswsn_book.live.own_data import Examined, examine
from inswsn_book.show.moving import Chart, Moving
from inswsn_lib.checks import Array
from inswsn_lib.evaluation.consistency import FALSE_ALARM, mean_square
from inswsn_lib.filters.expected_ratio import MISFIT, likely_interval
from inswsn_lib.logs.columns import INS, TIME
from inswsn_lib.logs.filter_checks import say_noise
from inswsn_lib.logs.findings import verdict
from inswsn_lib.logs.ins_wsn import TrackPair

_POINTS = 1500  # of a series that is drawn
_GROUPS = 400  # of the chart of the NIS, each the mean of some fixes
_OUTAGES = 100  # that are listed
_CLOCK = "time since the first row (s)"
#: Innovations are of the Kalman filter: one colour, and dashes for their components
_STROKES = {"x": "kalman", "y": "coloured", "v_x": "federated", "v_y": "correlated"}


def look(text: str, options: Mapping[str, Any]) -> dict[str, Any]:
    """Return what the page shows of a recording: sentences, a figure, tables and a file.

    Parameters
    ----------
    text, options
        As `examine` takes them, which says what is refused.

    Returns
    -------
    dict
        Of what JSON has: the ``name``, ``sentences``, a ``figure`` as a `Moving` has it, ``tables``
        with ``caption``, ``header`` and ``rows``, and the corrected track as ``csv``.

    Examples
    --------
    >>> from inswsn_book.live.own_page import look
    >>> from inswsn_lib.files import data_file
    >>> found = look(data_file("examples/ins-wsn.csv").read_text(), {"name": "my.csv"})
    >>> found["sentences"][0]
    'my.csv has 301 steps of 0.2000 s; its time stamps are off the grid by 2.1 ms (1 sigma).'
    """
    found = examine(text, options)
    sentences = [*_told(found)]
    shown = _figure(found)
    shown.sentence(lambda: " ".join(sentences))
    return {
        "name": found.name,
        "sentences": sentences,
        "figure": shown.content(),
        "tables": [*_tables(found)],
        "csv": _corrected(found.data.time, found.corrected),
    }


# Words --------------------------------------------------------------------------------------------


def _told(found: Examined) -> Iterator[str]:
    data = found.data
    yield (
        f"{found.name} has {len(data.time)} steps of {data.period:.4f} s; its time stamps are off "
        f"the grid by {1000 * data.jitter:.1f} ms (1 sigma)."
    )
    yield _outages_told(data)
    yield from _fit_told(found)
    yield verdict(found.findings)
    if found.expected:
        yield _expected_told(found)


def _expected_told(found: Examined) -> str:
    """Say what a filter is expected to leave of the errors of fixes, or why that is unknown."""
    if isinstance(found.expected, str):
        return found.expected
    position, velocity = (
        "{:.0%} ({:.0%} to {:.0%})".format(*likely_interval(*each))
        for each in zip(found.expected, MISFIT, strict=True)
    )
    return (
        "By how long errors of fixes last and the INS holds their accuracy, a filter is expected "
        f"to have {position} of their error in position and {velocity} in velocity (90 %)."
    )


def _outages_told(data: TrackPair) -> str:
    lengths = [(end - first) * data.period for first, end in data.outages]
    if not lengths:
        return "The network has no outage."
    if len(lengths) == 1:
        return f"The network has one outage, of {lengths[0]:.1f} s."
    return f"The network has {len(lengths)} outages, the longest of {max(lengths):.1f} s."


def _fit_told(found: Examined) -> Iterator[str]:
    """Say what the innovations tell of the noise figures."""
    told = found.of_filter
    often = f"{1 - FALSE_ALARM:.1%}"
    size, colour = told["size"], told.get("colour")
    if size.fits is not None:
        yield (
            f"The mean NIS of {np.isfinite(found.filtered.innovations).sum()} measured components "
            f"is {size.value:.3f}; {often} of filters that fit have it between {size.low:.3f} and "
            f"{size.high:.3f}."
        )
    _, value, least, most, group = _grouped(found)
    inside = f"{np.mean((least <= value) & (value <= most)):.1%}"
    what = "fixes" if group == 1 else f"means of {group} fixes"
    yield f"Of the {len(value)} {what} in the chart of NIS {inside} are in the band of {often}."
    if value.max() > _top(value, most):
        yield "What lies above that chart is drawn at its upper end."
    if colour and colour.fits is not None:
        yield (
            f"The largest autocorrelation of neighbouring innovations is {colour.value:.2f}, up to "
            f"{colour.high:.2f} by chance."
        )
    yield f"The verdict on the noise figures: {say_noise([*told.values()])}."


def _tables(found: Examined) -> Iterator[dict[str, Any]]:
    data = found.data
    if doubtful := [each for each in found.findings if not each.fits]:
        yield {
            "caption": "Checks of the recording that fail, or that the data cannot decide.",
            "header": ["check", "of", "found", "fits from", "to", "in words"],
            "rows": [
                [x.name, x.subject, *(_number(v) for v in (x.value, x.low, x.high)), x.says]
                for x in doubtful
            ],
        }
    if data.outages:
        yield {
            "caption": "Outages of the network.",
            "header": ["begins at (s)", "lasts (s)"],
            "rows": [
                [f"{time:.1f}" for time in (data.time[i] - data.time[0], (j - i) * data.period)]
                for i, j in data.outages[:_OUTAGES]
            ],
        }
    if found.errors:
        yield {
            "caption": "Root mean square errors by the reference of the file.",
            "header": ["track", "when", "position (m)", "velocity (m/s)"],
            "rows": [
                [row["track"], row["when"], *map(_number, (row["position"], row["velocity"]))]
                for row in found.errors
            ],
        }


def _number(value: float | None) -> str:
    return "–" if value is None or value != value else f"{value:.3f}"  # noqa: PLR0124


def _corrected(time: Array, corrected: Array) -> str:
    """Return the corrected track as the CSV file that the page on your own data writes."""
    header = [TIME, *(name.replace("ins_", "corrected_") for name in INS)]
    table = np.column_stack([time, corrected]).round(6).tolist()
    rows = [",".join("" if x != x else repr(x) for x in row) for row in table]  # noqa: PLR0124
    return "\n".join([",".join(header), *rows, ""])


# Charts -------------------------------------------------------------------------------------------


def _figure(found: Examined) -> Moving:
    """Return the charts: no slider moves them."""
    shown = Moving(f"What the filter finds in {found.name}")
    _draw_tracks(shown, found)
    _draw_error(shown, found)
    _draw_nis(shown, found)
    if found.white["components"] and len(found.of_filter) > 1:
        _draw_whiteness(shown, found)
    return shown


def _draw_tracks(shown: Moving, found: Examined) -> None:
    """Draw them from the first place of the INS on: coordinates of maps have seven digits."""
    data = found.data
    start = data.ins[np.isfinite(data.ins[:, 0])][0, :2]
    fixes = data.wsn[np.isfinite(data.wsn[:, :2]).all(axis=1)]
    ins, network, corrected = (track[:, :2] - start for track in (data.ins, fixes, found.corrected))
    x, y = (_ends(ins[:, k], network[:, k], corrected[:, k]) for k in (0, 1))
    apart = 0.3 * (x[1] - x[0]) - (y[1] - y[0])  # a straight track has some room about it
    if apart > 0:
        y = y[0] - apart / 2, y[1] + apart / 2
    chart = shown.map("The track, from where the INS begins", xlim=x, ylim=y)
    _draw_line(shown, chart, "ins", "INS alone", *ins.T)
    shown.draw(chart, "network", "network", _thinned(*network.T), style="points", at=0)
    _draw_line(shown, chart, "kalman", "INS corrected", *corrected.T)


def _draw_error(shown: Moving, found: Examined) -> None:
    data, sigma = found.data, found.sigma
    clock, size = data.time - data.time[0], np.linalg.norm(found.filtered.states[:, :2], axis=1)
    low, high = np.maximum(size - sigma, 0), size + sigma
    chart = shown.chart(
        "Error of the INS, ± 1 sigma", x=_CLOCK, y="estimate (m)",
        xlim=_ends(clock), ylim=(0, _ends(high)[1]),
    )  # fmt: skip
    _shade_outages(shown, chart, data, "no fixes")
    shown.draw(chart, "kalman", "", _thinned(clock, low, high), style="band")
    _draw_line(shown, chart, "kalman", "", clock, size)


def _draw_nis(shown: Moving, found: Examined) -> None:
    """Draw the NIS of a component of each fix, or the mean of some fixes, and its bounds."""
    data = found.data
    time, value, low, high, group = _grouped(found)
    clock, top = data.time - data.time[0], _top(value, high)
    what = "of each fix" if group == 1 else f"of each {group} fixes"
    chart = shown.chart(
        f"NIS of a component, {what}", x=_CLOCK, y="NIS (1)", xlim=_ends(clock), ylim=(0, top)
    )
    _shade_outages(shown, chart, data)
    shown.draw(chart, "kalman", "", (time, low, high), style="band")
    shown.draw(chart, "kalman", "", (time, value), style="points")


def _top(value: Array, high: Array) -> float:
    """Return where the chart of the NIS ends: one fix far off would make it flat."""
    return min(4 * float(high.max()), 1.05 * float(max(value.max(), high.max())))


def _grouped(found: Examined) -> tuple[Array, Array, Array, Array, int]:
    """Return times, the NIS of a component of each fix or mean of some, bounds, and how many."""
    counts = np.isfinite(found.filtered.innovations).sum(axis=1)
    fixes = np.flatnonzero(counts)
    group = -(-len(fixes) // _GROUPS)
    begins = np.arange(0, len(fixes), group)
    degrees = np.add.reduceat(counts[fixes], begins)
    value = np.add.reduceat(found.filtered.nis[fixes], begins) / degrees
    low, high = np.array([mean_square(1.0, d)[1:] for d in degrees.tolist()]).T
    time = found.data.time[fixes[begins]] - found.data.time[0]
    return time, value, low, high, group


def _draw_whiteness(shown: Moving, found: Examined) -> None:
    white = found.white
    limit = min(1.0, found.of_filter["colour"].high)
    lags = np.array(white["lags"])
    chart = shown.chart(
        "Are the innovations white?",
        x=f"lag ({white['interval']:.3g} s each)", y="autocorrelation (1)",
        xlim=(0.5, len(lags) + 0.5), ylim=_ends([-limit, limit], *white["components"].values()),
    )  # fmt: skip
    band = chart.xlim, [-limit] * 2, [limit] * 2
    shown.draw(chart, "kalman", "", band, style="band")
    for name, values in white["components"].items():
        label = name.replace("v_", "velocity ")
        _draw_line(shown, chart, _STROKES[name], label, lags, np.array(values))


def _shade_outages(shown: Moving, chart: Chart, data: TrackPair, label: str = "") -> None:
    """Shade the times without fixes; the label is at the longest."""
    outages = data.outages[:_OUTAGES]
    longest = max(outages, key=lambda outage: outage[1] - outage[0], default=None)
    for i, j in outages:
        begins = data.time[i] - data.time[0]
        times = begins, begins + (j - i) * data.period
        shade = times, [chart.ylim[0]] * 2, [chart.ylim[1]] * 2
        said = label if (i, j) == longest else ""
        shown.draw(chart, "published", said, shade, style="band", at=0)


def _draw_line(shown: Moving, chart: Chart, method: str, label: str, x: Array, y: Array) -> None:
    """Draw a line in pieces, so that no number stands in a gap; the label is at the last."""
    x, y = _thinned(x, y)
    missing = np.flatnonzero(~np.isfinite(x + y))
    pieces = [slice(i + 1, j) for i, j in pairwise([-1, *missing, len(x)]) if j > i + 1]
    for piece in pieces:
        last = piece is pieces[-1]
        shown.draw(chart, method, label if last else "", (x[piece], y[piece]))


def _thinned(*columns: Array) -> list[Array]:
    """Return columns of one length at some even places, the first and the last among them."""
    kept = np.linspace(0, len(columns[0]) - 1, min(len(columns[0]), _POINTS)).astype(int)
    return [column[kept] for column in columns]


def _ends(*columns: ArrayLike) -> tuple[float, float]:
    """Return the least and the greatest number, and a little room."""
    values = np.concatenate([np.ravel(column) for column in columns])
    low, high = float(np.nanmin(values)), float(np.nanmax(values))
    room = 0.03 * (high - low) or max(1e-6, 1e-6 * abs(low))
    return low - room, high + room
