"""The pictures of the lesson on blending two bad instruments, and its record."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np

from inswsn_book import record as book
from inswsn_book.show.moving import Moving, Slider, ellipse
from inswsn_lib.checks import Array
from inswsn_lib.evaluation import mean_bounds, normalised_squares
from inswsn_lib.filters import run_hinfinity
from inswsn_lib.models import ErrorModel
from inswsn_lib.navigation import ExampleRun
from inswsn_lib.papers import read_rows

if TYPE_CHECKING:
    from inswsn_lib.navigation import TrainingAreas

#: A filter by hand: estimates of the error of the INS (samples, 4), by a gain
ByGain = Callable[[float], Array]
#: Estimates and their covariances, of measurements and a factor on Q
Filter = Callable[[Array, float], tuple[Array, Array]]

GAINS = np.linspace(0, 1, 41)
FACTORS = 10.0 ** np.arange(-4, 4.5, 0.5)


def _bell(x: Array, middle: float, size: float) -> Array:
    return np.asarray(np.exp(-(((x - middle) / size) ** 2) / 2) / (size * np.sqrt(2 * np.pi)))


def centimetres(metres: float) -> str:
    """Write a distance in centimetres."""
    return f"{100 * metres:.1f} cm"


def show_map(run: ExampleRun, *, start: float) -> None:
    """Show INS, fixes and blend on the map and near the vehicle, by a constant gain and time."""
    model, y = ErrorModel.p1(run.period), run.ins - run.network
    found = {
        g: run.ins - run_hinfinity((model, g * model.A), y, initial_state=y[0], predicted=False)
        for g in GAINS
    }
    shown = Moving(
        "One gain between two instruments",
        Slider("g", "gain g", [*GAINS], GAINS[np.argmin(abs(GAINS - start))], "g = {:.3f}"),
        Slider("t", "time", [*range(1, 20)], 12, "{:d} s", plays=True),
    )

    def until(track: Array, t: int, last: int = 100) -> Array:
        return track[: int(t / run.period) + 1, :2][-last:].T

    drifting = run.ins - (run.ins - run.truth)[0] * [1, 1, 0, 0]  # it starts on the path
    place = shown.map("Map", xlim=(355, 525), ylim=(10, 80))
    shown.draw(place, "ins", "INS", lambda t: until(drifting, t))
    shown.draw(place, "network", "", lambda t: until(run.network, t), style="points")
    shown.draw(place, "truth", "true path", run.truth[:, :2].T)
    shown.draw(place, "constant", "", lambda g: found[g][:, :2].T)
    shown.draw(place, "truth", "", lambda t: until(run.truth, t, 1), style="handle")
    near = shown.chart(
        "Error of the last four seconds: the vehicle is at the centre", x="error in x (m)",
        y="error in y (m)", xlim=(-1.2, 1.2), ylim=(-0.6, 0.6), equal=True,
    )  # fmt: skip
    shown.draw(near, "truth", "", ([0], [0]), style="points")
    shown.draw(
        near, "network", "fixes", lambda t: until(run.network - run.truth, t, 20), style="points"
    )
    shown.draw(near, "constant", "blend", lambda g, t: until(found[g] - run.truth, t, 20), at=0)
    mean = {g: float(run.distances(estimates).mean()) for g, estimates in found.items()}
    shown.number("ins", "INS, correct at the start", f"{run.distances(drifting).mean():.1f} m")
    shown.number("network", "fixes alone", centimetres(float(run.distances(run.network).mean())))
    shown.number("constant", "blend", lambda g: centimetres(mean[g]))
    shown.goal("mean error of the blend below 10 cm", lambda g: mean[g] < 0.1)
    shown.sentence(
        lambda g: f"With a gain of {g:.3f}, the mean error of the blend is {centimetres(mean[g])}."
    )
    shown.show(
        "fig-l2-map",
        "Drag the gain, and the vehicle. At 0, the INS is corrected once, by the first "
        "fix, and the blend drifts away. At 1, the blend equals the fixes. The best gain is in "
        "between. Numbers are means over 20 seconds.",
    )


def show_instruments(run: ExampleRun) -> None:
    """Show the errors of both instruments on one axis, each at its own scale."""
    ins, network = ((what - run.truth)[:, 0] for what in (run.ins, run.network))
    shown = Moving("Two kinds of error")
    axes = {"y": "error in x (m)", "xlim": (0, 20)}
    smooth = shown.chart("INS: smooth, but it grows", ylim=(-16, 0), **axes)
    rough = shown.chart("Fixes: rough, but it does not grow", ylim=(-0.5, 0.5), **axes)
    shown.draw(smooth, "ins", "INS", (run.time, ins))
    shown.draw(rough, "network", "fixes", (run.time, network), style="points")
    shown.number("ins", "mean step of the INS error", f"{abs(np.diff(ins)).mean():.2f} m")
    shown.number("network", "mean step of the fix error", f"{abs(np.diff(network)).mean():.2f} m")
    ends = f"from {ins[0]:.1f} to {ins[-1]:.1f} m; that of the fixes jumps about zero"
    shown.sentence(lambda: f"The error of the INS in x changes smoothly {ends}.")
    shown.show(
        "fig-l2-instruments",
        "The same 20 seconds and the same axis; note the different scales. The error of "
        "the INS is a smooth curve that a model can follow. The error of each fix is new.",
    )


def show_gains(run: ExampleRun, by_gain: ByGain) -> None:
    """Show the mean error over the gain."""
    mean = np.array([run.distances(run.ins - by_gain(float(g))).mean() for g in GAINS])
    low = int(mean.argmin())
    shown = Moving(
        "Error against the gain", Slider("g", "gain g", [*GAINS], GAINS[2], "g = {:.3f}")
    )
    chart = shown.chart("Mean error", x="gain g", xlim=(0, 1), ylim=(0, 0.6))
    seen = np.minimum(mean, 0.6)
    shown.draw(chart, "ins", "drift gets in", (GAINS[: low + 1], seen[: low + 1]), at=4)
    shown.draw(chart, "network", "noise gets in", (GAINS[low:], seen[low:]))
    at = dict(zip(GAINS, mean, strict=True))
    shown.draw(chart, "constant", "", lambda g: ([g], [min(at[g], 0.6)]), style="handle")
    shown.number("constant", "mean error", lambda g: centimetres(at[g]))
    shown.sentence(lambda g: f"With g = {g:.3f}, the mean error is {at[g]:.3f} m.")
    shown.show(
        "fig-l2-gains",
        "Drag the dot. Left of the lowest point, the error is mostly drift; right of it, "
        "mostly noise.",
    )


def show_bells(*, start: float = 0.2, measured: float = 0.3, R: float = 0.1**2) -> None:
    """Show a prediction, a fix and their blend as bells, by how sure the prediction is."""
    x = np.linspace(-0.6, 0.8, 141)
    sizes = np.round(np.arange(0.04, 0.41, 0.02), 2)
    shown = Moving(
        "Two bells make a narrower one",
        Slider("s", "uncertainty of the prediction", [*sizes], start, "± {:.2f} m"),
    )
    axes = {"x": "error of the INS (m)", "y": "1/m", "xlim": (-0.6, 0.8), "ylim": (0, 12)}
    chart = shown.chart("Probability density", **axes)

    K = {s: s**2 / (s**2 + R) for s in sizes}
    size = {s: float((K[s] * R) ** 0.5) for s in sizes}  # (1 - K) s² = K R
    shown.draw(chart, "ins", "prediction", lambda s: (x, _bell(x, 0, s)), at=52)
    shown.draw(chart, "network", "fix", (x, _bell(x, measured, R**0.5)), at=100)
    shown.draw(chart, "kalman", "blend", lambda s: (x, _bell(x, K[s] * measured, size[s])), at=82)
    shown.number("constant", "gain K = M/(M + R)", lambda s: f"{K[s]:.2f}")
    shown.number("kalman", "uncertainty of the blend", lambda s: f"± {size[s]:.3f} m")
    shown.sentence(lambda s: f"The gain is {K[s]:.2f}. The blend is uncertain by {size[s]:.3f} m.")
    shown.show(
        "fig-l2-bells",
        "The blend lies between the two, closer to the narrower one, and is the narrowest.",
    )


def show_outage(run: ExampleRun, run_filter: Filter) -> None:
    """Show the covariance on the map and the band of two sigma in x, with an outage."""
    lengths, seconds, k = [0, 10, 20, 40], [*range(4, 20)], np.arange(len(run.time))
    shown = Moving(
        "A filter that knows its own uncertainty",
        Slider("n", "fixes lost", lengths, 20, "{:d}"),
        Slider("t", "time", seconds, 11, "{:d} s", plays=True),
    )
    kept = {n: (k < 40) | (k >= 40 + n) for n in lengths}
    found = {
        n: run_filter(np.where(kept[n][:, None], run.ins - run.network, np.nan), 1.0)
        for n in lengths
    }

    def around(n: int, t: int) -> Array:
        estimate, P = found[n][0][5 * t], found[n][1][5 * t]
        return np.asarray((run.ins[5 * t] - estimate)[:2, None] + ellipse(P[:2, :2], 10 * 2))

    place = shown.map("Map (ellipse ten times its size)", xlim=(370, 530), ylim=(5, 65))
    shown.draw(place, "truth", "", run.truth[:, :2].T)
    shown.draw(
        place, "network", "fixes", lambda n, t: run.network[kept[n] & (k <= 5 * t), :2].T,
        style="points",
    )  # fmt: skip
    shown.draw(place, "kalman", "", around)
    shown.draw(place, "truth", "", lambda t: run.truth[5 * t, :2, None], style="handle")
    chart = shown.chart("Error in x", xlim=(0, 20), ylim=(-2, 2))
    error = {n: (run.ins - x - run.truth)[:, 0] for n, (x, _) in found.items()}
    band = {n: 2 * np.sqrt(P[:, 0, 0]) for n, (_, P) in found.items()}
    shown.draw(chart, "kalman", "", lambda n: (run.time, -band[n], band[n]), style="band")
    shown.draw(chart, "kalman", "error", lambda n: (run.time, error[n]))
    shown.draw(chart, "truth", "", lambda n, t: ([t], [error[n][5 * t]]), style="points")
    inside = {n: np.mean(abs(error[n]) < band[n]) for n in lengths}
    shown.number("kalman", "inside its band", lambda n: f"{inside[n]:.0%} of the time")
    shown.number("kalman", "band now", lambda n, t: f"± {band[n][5 * t]:.2f} m")
    shown.sentence(lambda n, t: (
        f"With {n} fixes lost, the band is ± {band[n][5 * t]:.2f} m after {t} s, and the error is "
        f"in its band for {inside[n]:.0%} of the time."
    ))  # fmt: skip
    shown.show(
        "fig-l2-outage",
        "The band and the ellipse are 2 standard deviations, as computed by the filter. "
        "They widen while fixes are lost, and the next fixes narrow them again.",
    )


def show_told(run: ExampleRun, run_filter: Filter, *, start: float) -> None:
    """Show the error over the factor on Q, and whether the innovations fit what is assumed."""
    y = run.ins - run.network
    low, high = mean_bounds(len(y) - 1, 4)
    error = [float(run.distances(run.ins - run_filter(y, q)[0]).mean()) for q in FACTORS]
    fit = [mean_nis(run, run_filter, y, q) for q in FACTORS]
    told = dict(zip(FACTORS, zip(error, fit, strict=True), strict=True))

    def verdict(nis: float) -> str:
        return "overconfident" if nis > high else "too cautious" if nis < low else "consistent"

    shown = Moving(
        "What the filter assumes", Slider("q", "assumed Q / matched Q", [*FACTORS], start, "{:g}")
    )
    axes = {"x": "factor on Q (power of ten)", "xlim": (-4.2, 4.2), "ylim": (0, 0.5)}
    chart = shown.chart("Mean error", **axes)
    powers = np.log10(FACTORS)
    shown.draw(chart, "kalman", "Kalman filter", (powers, error), at=3)
    network = float(run.distances(run.network).mean())
    shown.draw(chart, "network", "fixes", (powers, np.full(len(powers), network)), at=13)
    shown.draw(chart, "kalman", "", lambda q: ([np.log10(q)], [told[q][0]]), style="handle")
    shown.number("kalman", "mean error", lambda q: centimetres(told[q][0]))
    shown.number("kalman", f"NIS (expect {low:.1f} to {high:.1f})", lambda q: f"{told[q][1]:.1f}")
    shown.number("kalman", "the filter is", lambda q: verdict(told[q][1]))
    shown.sentence(
        lambda q: f"The mean error is {told[q][0]:.3f} m, and the filter is {verdict(told[q][1])}."
    )
    shown.show(
        "fig-l2-told",
        "With too small a Q, the drift remains; with too large a Q, the filter follows the "
        "fixes. Without the truth, the NIS (below) still shows whether innovations are as large "
        "as assumed.",
    )


def mean_nis(run: ExampleRun, run_filter: Filter, y: Array, factor: float) -> float:
    """Return the mean of v' S^-1 v over all samples but the first: 4 if the assumptions hold."""
    A = np.kron([[1, run.period], [0, 1]], np.eye(2))
    noise = np.diag(np.repeat(factor * run.process**2 + run.measurement**2, 2))  # Q + R
    estimates, covariances = run_filter(y, factor)
    innovations = y[1:] - estimates[:-1] @ A.T
    return float(normalised_squares(innovations, A @ covariances[:-1] @ A.T + noise).mean())


def show_weights(weights: Callable[[float], Array], *, start: float) -> None:
    """Show the weight of each past fix in the present position, by the factor on Q."""
    past = np.arange(13)
    of = {factor: weights(factor)[:13] for factor in FACTORS}
    shown = Moving(
        "How far back a filter remembers",
        Slider("q", "assumed Q / matched Q", [*FACTORS], start, "{:g}"),
    )
    axes = {"x": "fixes ago", "y": "weight", "xlim": (-0.6, 12.6), "ylim": (-0.1, 1.05)}
    chart = shown.chart("Weights of past fixes", **axes)
    shown.draw(chart, "kalman", "", lambda q: (past, of[q]), style="bars")
    shown.draw(chart, "hinfinity", "P1", (past, (past == 0) * 1.0), style="points", at=0)
    shown.number("kalman", "weight of the latest fix", lambda q: f"{of[q][0]:.2f}")
    shown.number("hinfinity", "the same in P1's filter", "1.00")
    shown.sentence(
        lambda q: f"The latest fix has a weight of {of[q][0]:.2f}. In P1's filter its weight is 1."
    )
    shown.show(
        "fig-l2-weights",
        "Bars: the Kalman filter. Dots: P1's filter as published, which has no memory.",
    )


def hold(record: book.ChapterRecord, run: ExampleRun, by_gain: ByGain, run_filter: Filter) -> None:
    """Record what the lesson found, and hold its sentences."""
    for name in ("p1", "p1-inertial"):
        record.data(f"scenarios/{name}.yaml")
    printed = read_rows(record.data("papers/p1-table2.csv"), index="method")
    record.quote("p1-training", "kf.taken.unit")
    record.quote("recorded-data", "room.memory")
    record.quote("lesson-8", "room.white")
    record.crossed("p1-training", "headline.kf-share")
    y = run.ins - run.network
    off = [run.distances(run.ins - x).mean() for x in (y, *map(by_gain, GAINS))]
    fixes, by_hand = off[0], min(off[1:])
    best = min(run.distances(run.ins - run_filter(y, q)[0]).mean() for q in FACTORS)
    too_sure = mean_nis(run, run_filter, y, 1) > mean_bounds(len(y) - 1, 4)[1]
    worse = [float(printed["KF"][cell]) > float(printed["HF"][cell]) for cell in printed["HF"]]
    record.note("fixes", 100 * fixes, "cm", "Mean distance of the fixes from the true positions.")
    record.holds("A constant gain gets below 10 cm.", by_hand < 0.1)
    words = "At its best the Kalman filter is better than any filter with a constant gain."
    record.holds(words, best < by_hand)
    record.holds("With the right size of Q it is too sure of itself.", too_sure)
    record.holds("P1's Kalman filter is worse in all cells.", all(worse))
    record.write()


def show_table2(record: book.ChapterRecord, areas: TrainingAreas) -> None:
    """Show P1's Table 2 beside what the scene gives for it."""
    # none of it is there in the page, where all else of this lesson runs
    from inswsn_book.evidence import training_table as core  # noqa: PLC0415
    from inswsn_book.lessons.printed import Cell, show_printed  # noqa: PLC0415
    from inswsn_lib.navigation import FilterContest  # noqa: PLC0415

    printed = read_rows(record.data("papers/p1-table2.csv"), index="method")
    radio = record.data("recorded/uwb-fixes.json")
    filters = {"KF": "kalman", "HF": "hf-exact-lmi"}
    rebuilt = dict(zip(printed, core.REBUILT, strict=True))

    def cell(method: str, column: str, text: str) -> Cell:
        kind = filters.get(method)
        equal = f"fair.cells.{kind}.{column}" if kind else "the same"
        place = f"recorded.cells.{kind}.{column}" if kind and column[0] == "r" else "none"
        what = f"{method}, ${column[0]}_{column[1]}$, No. {column[2]}"
        return Cell(what, text, f"table2.{rebuilt[method]}.{column}", equal, place)

    found = show_printed(
        record, "p1-training",
        [cell(m, c, text) for m, row in printed.items() for c, text in row.items()],
        lambda: core.rebuild_table2(FilterContest(areas), core.recorded_errors(radio)),
        by=("range_noise", "correlation_time", "inertial_scale"),
        name="tbl-l2-table2",
        caption="P1's Table 2, mean absolute errors (m, m/s), medians and 95 % of runs. Rebuilt: a "
        "Kalman filter that knows the noise, and the printed matrices. On equal terms: both kinds "
        "of filter tuned alike. Recorded: the same in the simulation with the errors of recorded "
        "fixes, which have no velocities.",
        first=(
            "headline.kf-share", "headline.identity-share", "fair.cells.hf-over-kalman",
            "fair.cells.hf-over-network", "recorded.cells.hf-over-kalman",
            "recorded.cells.hf-over-network",
        ),
    )  # fmt: skip
    less = found["headline.kf-share"].value < 100
    record.holds("A Kalman filter that knows the noise has less error than P1's filter.", less)
