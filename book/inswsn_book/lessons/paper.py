"""The pictures of the lesson on reading a paper with a computer, and its record."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from inswsn_book.record import ChapterRecord
from inswsn_book.show.moving import Moving, Slider
from inswsn_lib.checks import Array
from inswsn_lib.papers import about, admits, bounds, derive, interval, reduction

Texts = Sequence[str]  # cells of a column, as printed

#: What the text has of the evidence: its name, the quantity, its unit and its form
EVIDENCE = (
    ("rank", "table1.selected.position-rank", 1, ".0f"), ("odds", "table1.chance.odds", 1e6, ".1f"),
    ("claims", "score.claims", 1, ".0f"), ("contradicted", "score.contradicted", 1, ".0f"),
)  # fmt: skip
OFFSETS = range(-9, 10)
DIGITS = (1, 2, 3, 4)
ORDERS = 2000  # random orders of the cells of a column
POINTS = np.arange(0, 30.5, 0.5)  # what "about" may allow
GROWTHS = np.round(np.arange(0, 2.05, 0.1), 1)
TURNS = np.round(np.arange(0, 1.01, 0.05), 2)  # when the velocity error changes sign
STARTS = np.arange(-2, 17) / 32  # the position error at the beginning
PERIODS = np.round(np.arange(0.1, 1.21, 0.05), 2)
TIME = np.linspace(0, 1, 2001)


def rows_met(x: Texts, y: Texts, mean: Texts, offset: int) -> int:
    """Count the means of P1's Table 1 that x of a row and y of the row `offset` below give."""
    other = dict(enumerate(map(interval, y)))
    return sum(
        admits((interval(cell) + other.get(row + offset, 0)) / 2, printed)
        for row, (cell, printed) in enumerate(zip(x, mean, strict=True))
    )


def _numbers(*columns: Texts) -> list[Array]:
    return [np.array(column, dtype=float) for column in columns]


def _below(y: Array, offset: int) -> Array:
    rows = np.arange(len(y)) + offset
    return np.where((rows >= 0) & (rows < len(y)), y[np.clip(rows, 0, len(y) - 1)], 0.0)


def show_slip(xs: Texts, ys: Texts, means: Texts) -> None:
    """Show ten printed means, and those that x and y give by the offset between them."""
    met = {s: rows_met(xs, ys, means, s) for s in OFFSETS}
    x, y, mean = _numbers(xs, ys, means)
    row = np.arange(1, len(x) + 1)
    shown = Moving("Ten printed means", Slider("s", "offset of y", [*OFFSETS], -1, "{:+d}"))
    axes = {"x": "row of the table", "y": "mean", "xlim": (0.5, 10.5), "ylim": (0.1, 0.45)}
    chart = shown.chart("“Mean error” of position (m)", **axes)
    shown.draw(chart, "published", "printed", (row, mean))
    shown.draw(chart, "computed", "", lambda s: (row, (x + _below(y, s)) / 2))
    shown.draw(chart, "computed", "", lambda s: (row, (x + _below(y, s)) / 2), style="points")
    shown.number("computed", "rows that agree to the last digit", lambda s: f"{met[s]} of 10")
    shown.goal("all ten rows agree", lambda s: met[s] == 10)
    shown.sentence(lambda s: f"With an offset of {s:+d}, {met[s]} of the 10 printed means agree.")
    shown.show(
        "fig-l7-slip",
        "The mean of x in a row and y so many rows below it (above, if the offset is negative), "
        "and the mean that is printed. A y from beyond the table counts as zero.",
    )


@cache
def _orders(cells: int) -> NDArray[np.int64]:
    rng = np.random.default_rng(2012)
    return np.array([rng.permutation(cells + 1)[:cells] for _ in range(ORDERS)])


def by_digits(xs: Texts, ys: Texts, means: Texts) -> dict[int, tuple[Array, Array]]:
    """Return how many rows agree, by offset and in random orders, if cells have fewer digits.

    In units of the last digit, the rounding of each of x, y and the mean is half at most, so that
    of x + y - 2 mean is two at most.
    """
    x, y, mean = _numbers(xs, ys, means)
    found = {}
    for digits in DIGITS:
        unit = 10.0**digits
        X, Y, M = (np.rint(cells * unit + 1e-9) for cells in (x, y, mean))
        fits = np.array([np.sum(abs(X + _below(Y, s) - 2 * M) <= 2) for s in OFFSETS])
        dealt = np.append(Y, 0)[_orders(len(Y))]
        orders = np.sum(abs(X + dealt - 2 * M) <= 2, axis=1)
        found[digits] = fits.astype(float), orders.astype(float)
    return found


def show_digits(xs: Texts, ys: Texts, means: Texts) -> None:
    """Show how many rows agree by offset and by chance, if fewer digits were printed."""
    found = by_digits(xs, ys, means)
    rows = np.arange(11)
    shares = {
        d: np.bincount(f[1].astype(int), minlength=11) / ORDERS * 100 for d, f in found.items()
    }
    perfect = {d: int(np.sum(f[0] == 10)) for d, f in found.items()}
    most = {d: int(max(f[1])) for d, f in found.items()}
    shown = Moving("What the digits are worth", Slider("d", "decimals", [*DIGITS], 1, "{:d}"))
    axes = {"x": "offset", "y": "rows", "xlim": (-9.6, 9.6), "ylim": (0, 10.5)}
    offsets = shown.chart("Rows that agree, by offset", **axes)
    shown.draw(offsets, "computed", "", lambda d: ([*OFFSETS], found[d][0]), style="bars")
    axes = {"x": "rows", "y": "share (%)", "xlim": (-0.6, 10.6), "ylim": (0, 100)}
    chance = shown.chart(f"Rows that agree, in {ORDERS:,} shuffles", **axes)
    shown.draw(chance, "published", "", lambda d: (rows, shares[d]), style="bars")
    shown.number("computed", "offsets with all ten", lambda d: f"{perfect[d]} of 19")
    shown.number("published", "the luckiest order explains", lambda d: f"{most[d]} of 10")
    shown.sentence(lambda d: (
        f"Decimals kept: {d}. Offsets that explain all ten rows: {perfect[d]} of 19. The luckiest "
        f"random order explains {most[d]} of 10."
    ))  # fmt: skip
    shown.show(
        "fig-l7-digits",
        "All cells are rounded. How many decimals are needed before only one offset "
        "explains the table, and no random order does?",
    )


def stated(text: str, points: float) -> Any:
    """Return what a printed percentage stands for: a multiple of 5 is "about"."""
    return about(text, points) if float(text) % 5 == 0 else interval(text)


def ends(reductions: Mapping[str, str], points: float) -> tuple[float, float]:
    """Return the least and the largest ratio that two percentages allow."""
    a, b = (bounds(stated(text, points)) for text in reductions.values())
    low, high = ((100 - a[1]) / (100 - b[0]), (100 - a[0]) / max(100 - b[1], 1e-9))
    return max(low, 0.0), high


def points_needed(reductions: Mapping[str, str]) -> float:
    """Return how many points "about" must allow for the other filter to be no worse than the INS.

    Beyond 30 points it is infinite.
    """
    for points in POINTS:
        if ends(reductions, points)[0] <= 1 + 1e-9:
            return float(points)
    return float("inf")


def show_third(results: Mapping[str, Mapping[str, str]], allowed: float) -> None:
    """Show the error of P2's federated filter over that of the INS, by what "about" allows."""
    names, top = {"r": "position", "v": "velocity"}, 8.0
    pairs = {f"{names[of]} in {axis}": results[of + axis] for of in names for axis in "xy"}

    @cache
    def band(axis: str) -> tuple[Array, Array, Array]:
        found = [ends(pairs[axis], points) for points in POINTS]
        low, high = np.minimum(found, top).T
        return POINTS, low, high

    def plain(axis: str) -> float:
        a, b = (float(text) / 100 for text in pairs[axis].values())
        return (1 - a) / (1 - b)

    need = {axis: points_needed(pair) for axis, pair in pairs.items()}
    shown = Moving(
        "Two comparisons imply a third", Slider("axis", "error of", [*pairs], "position in x", "{}")
    )
    axes = {"x": "points that “about” allows", "y": "ratio of errors", "xlim": (0, 30)}
    chart = shown.chart("Federated filter over INS alone", ylim=(0, top), **axes)
    shown.draw(chart, "federated", "", band, style="band")
    shown.draw(chart, "federated", "as printed", lambda axis: ([0.0, 30.0], [plain(axis)] * 2))
    shown.draw(chart, "ins", "INS alone", ([0.0, 30.0], [1.0, 1.0]))
    shown.draw(chart, "published", "", ([allowed, allowed], [0.0, top]))
    shown.number("federated", "ratio as printed", lambda axis: f"{plain(axis):.2f}")
    shown.number("published", "“about” must allow", lambda axis: f"{need[axis]:g} points")
    shown.sentence(lambda axis: (
        f"For the {axis}, the federated filter has {plain(axis):.2f} times the error of the INS "
        f"alone; “about” must allow {need[axis]:g} points to bring this ratio down to one."
    ))  # fmt: skip
    shown.show(
        "fig-l7-third",
        "The band shows every ratio that P2's two percentages allow. The vertical "
        "line marks the tolerance that the papers' round figures suggest.",
    )


def show_growth(*, least: float) -> None:
    """Show an error that grows as a power of time, its RMS and its maximum."""
    rms = {a: (2 * a + 1) ** -0.5 for a in GROWTHS}
    shown = Moving("A maximum and a mean", Slider("a", "growth", [*GROWTHS], 2.0, "t to the {:g}"))
    axes = {"x": "time in the outage (share)", "y": "error", "xlim": (0, 1), "ylim": (0, 1.05)}
    chart = shown.chart("Error, as a share of its maximum", **axes)
    shown.draw(chart, "kalman", "error", lambda a: (TIME[::40], TIME[::40] ** a))
    shown.draw(chart, "kalman", "", lambda a: ([0.0, 1.0], [rms[a]] * 2))
    shown.draw(chart, "published", "P3 needs this RMS", ([0.0, 1.0], [least] * 2), at=0)
    shown.number("kalman", "RMS over maximum", lambda a: f"{rms[a]:.2f}")
    shown.number("published", "P3, outage 4, at least", f"{least:.2f}")
    shown.goal("as large an RMS as P3 needs", lambda a: rms[a] >= least)
    shown.sentence(lambda a: f"Growth as t to the {a:g}: RMS over maximum {rms[a]:.2f}.")
    shown.show(
        "fig-l7-growth",
        "One horizontal line is the RMS of the curve, the other the least RMS that P3's "
        "numbers allow. Which growth makes them meet?",
    )


def motion(turn: float, start: float) -> tuple[Array, Array]:
    """Return the position and velocity error over a window, of a constant acceleration error."""
    return TIME**2 / 2 - turn * TIME + start, TIME - turn


def ratio(turn: float, start: float) -> float:
    """Return the mean size of the position error over that of the velocity error."""
    p, v = motion(turn, start)
    return float(abs(p).mean() / abs(v).mean())


def show_motion() -> None:
    """Show both errors, by when that of velocity is zero and where that of position starts."""
    shown = Moving(
        "How small can the position error stay?",
        Slider("r", "zero of v", [*TURNS], 0.0, "{:.2f}"),
        Slider("c", "start of p", [*STARTS], 0.0, "{:+.3f}"),
    )
    thin = slice(None, None, 50)
    axes = {"x": "time (share of the window)", "xlim": (0, 1)}
    upper = shown.chart("Velocity error", y="v", ylim=(-1, 1), **axes)
    shown.draw(upper, "ins", "", lambda r: (TIME[thin], motion(r, 0)[1][thin]))
    lower = shown.chart("Position error", y="p", ylim=(-0.5, 1), **axes)
    shown.draw(lower, "ins", "", lambda r, c: (TIME[thin], motion(r, c)[0][thin]))
    for chart in (upper, lower):
        shown.draw(chart, "published", "", ([0.0, 1.0], [0.0, 0.0]))
    shown.number("ins", "mean |p| over mean |v|", lambda r, c: f"{ratio(r, c):.3f}")
    shown.goal("a ratio below 0.126", lambda r, c: ratio(r, c) < 0.126)
    shown.sentence(lambda r, c: f"v zero at {r:g}, p from {c:.3f}: the ratio is {ratio(r, c):.3f}.")
    shown.show(
        "fig-l7-motion",
        "Time is measured in windows, and so is the ratio. Make it as small as you can.",
    )


def periods(pairs: Iterable[tuple[str, str, int]]) -> Array:
    """Return the longest sampling period that each pair of printed mean errors allows, s."""
    return np.array([
        8 * bounds(interval(p))[1] / (samples * bounds(interval(v))[0]) for p, v, samples in pairs
    ])  # fmt: skip


def show_periods(longest: Array, *, matrices: float) -> None:
    """Show the least position error that the printed velocity errors allow, by the period."""
    pair, top = np.arange(1, len(longest) + 1), 5.0
    out = {T: int(np.sum(longest < T)) for T in PERIODS}
    shown = Moving(
        "Which period do the tables allow?", Slider("T", "period T", [*PERIODS], 1.0, "{:.2f} s")
    )
    ends = (0.5, len(pair) + 0.5)
    axes = {"x": "pair of cells", "y": "times the printed one", "xlim": ends, "ylim": (0, top)}
    chart = shown.chart("Least possible mean position error", **axes)
    shown.draw(chart, "published", "printed", (ends, [1.0, 1.0]))
    shown.draw(
        chart, "computed", "", lambda T: (pair, np.minimum(T / longest, top)), style="points"
    )
    shown.number("computed", "pairs that are impossible", lambda T: f"{out[T]} of {len(pair)}")
    shown.number("published", "the matrices print", f"{matrices:g} s")
    shown.sentence(lambda T: (
        f"With a period of {T:g} s, {out[T]} of {len(pair)} pairs of cells are impossible."
    ))  # fmt: skip
    shown.show(
        "fig-l7-periods",
        "Dots above the line are impossible: the position error cannot be as small as "
        "printed. Pairs 1 to 4 are from P1 Table 2 (x, y in area 1; x, y in area 2), pairs 5 to 8 "
        "from P1 Table 3.",
    )


def hold(
    x: Texts, y: Texts, mean: Texts, p2: Mapping[str, Any], p3: Mapping[str, Any], least: float,
    longest: Array, **parameters: Any,
) -> None:  # fmt: skip
    """Record what the lesson found, and hold its sentences against it."""
    record = ChapterRecord("lesson-7", parameters)
    for name in ("1-table1.csv", "1-table2.csv", "1-table3.csv", "1.yaml", "2.yaml", "3.yaml"):
        record.data(f"papers/p{name}")
    for name, of, unit, form in EVIDENCE:
        record.quote("printed-numbers", of, form, name, unit=unit)
    needed = points_needed(p2["results"]["vx"])
    a, b = map(float, p2["results"]["vx"].values())
    record.holds("Six times.", (100 - a) / (100 - b) == 6)
    gain = derive(reduction, p3["outage1"]["proposed_max"], p3["outage1"]["kf_max"])
    possible = f"{gain.value:.3f}" == "48.248" and gain.limits[1] > 48.25
    record.holds("48.248, and 48.3 is possible.", possible)
    record.note("needed", needed, "points", "For a ratio of one in vx.")
    record.note("growth", (1 / least**2 - 1) / 2, "1", "Largest power of time.")
    record.say("impossible", str(sum(longest < 1)))
    record.note("longest", min(longest), "s", "Longest period that all pairs allow.")
    fits = by_digits(x, y, mean)
    record.holds("Offset 1 explains ten rows.", rows_met(x, y, mean, 1) == 10)
    record.holds("With one digit most offsets do.", sum(fits[1][0] == 10) > 9)
    alone = all(sum(fits[d][0] == 10) == 1 for d in (2, 3, 4))
    record.holds("From two digits on, only one does.", alone)
    record.holds("With four no order comes near.", max(fits[4][1]) < 8 < max(fits[2][1]))
    record.holds("No reading of about mends vx.", needed > 10)
    record.holds("1 s is impossible, 0.2 s is not.", min(longest) < 1 and min(longest) > 0.2)
    record.write()
