"""The pictures of the lesson on blending two bad instruments."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from inswsn_book.live.chi_square import bounds
from inswsn_book.moving import Moving, Slider
from inswsn_lib.evaluation import normalised_squares
from inswsn_lib.filters import run_hinfinity
from inswsn_lib.models import ErrorModel
from inswsn_lib.navigation import ExampleRun

Array = NDArray[np.float64]
#: A filter by hand: estimates of the error of the INS (samples, 4), by a gain
ByGain = Callable[[float], Array]
#: Estimates and their covariances, of measurements and a factor on Q
Filter = Callable[[Array, float], tuple[Array, Array]]

GAINS = np.linspace(0, 1, 41)
FACTORS = 10.0 ** np.arange(-4, 4.5, 0.5)


def _bell(x: Array, middle: float, size: float) -> Array:
    return np.asarray(np.exp(-(((x - middle) / size) ** 2) / 2) / (size * np.sqrt(2 * np.pi)))


def centimetres(metres: float) -> str:
    """Write a distance of less than a metre or so."""
    return f"{100 * metres:.1f} cm"


def by_library(run: ExampleRun, g: float) -> Array:
    """Return what a filter of a constant gain estimates of the error of the INS, (samples, 4)."""
    model, y = ErrorModel.p1(run.period), run.ins - run.network
    return run_hinfinity((model, g * model.A), y, initial_state=y[0], predicted=False)


def show_map(run: ExampleRun, *, start: float) -> None:
    """Show the vehicle on the map, and how far it is from the truth, by a constant gain."""
    found = {g: by_library(run, float(g)) for g in GAINS}
    shown = Moving(
        "One gain between two instruments",
        Slider("g", "gain g", [*GAINS], GAINS[np.argmin(abs(GAINS - start))], "g = {:.3f}"),
    )
    middle = run.truth[:, :2].mean(axis=0)
    ends = [(float(m - r), float(m + r)) for m, r in zip(middle, (90, 45), strict=True)]
    track = shown.chart("The map", x="x (m)", y="y (m)", xlim=ends[0], ylim=ends[1], equal=True)
    shown.draw(track, "truth", "true path", run.truth[:, :2].T, at=12)
    shown.draw(track, "ins", "INS", run.ins[:, :2].T, at=55)
    shown.draw(track, "constant", "", lambda g: (run.ins - found[g])[:, :2].T)
    error = shown.chart(
        "Distance from the true position", x="time (s)", y="off by (m)", xlim=(0, 20), ylim=(0, 0.6)
    )
    fixes = run.distances(run.network)
    shown.draw(error, "network", "fixes", (run.time, fixes), style="points")
    shown.draw(error, "constant", "blend", lambda g: (run.time, run.distances(run.ins - found[g])))
    ins = run.distances(run.ins).mean()
    mean = {g: float(run.distances(run.ins - estimates).mean()) for g, estimates in found.items()}
    shown.number("ins", "INS alone", f"{ins:.1f} m")
    shown.number("network", "fixes alone", centimetres(float(fixes.mean())))
    shown.number("constant", "blend", lambda g: centimetres(mean[g]))
    shown.sentence(
        lambda g: (
            f"With the gain {g:.3f} the blend is off by {centimetres(mean[g])} on average; the "
            f"fixes alone by {centimetres(float(fixes.mean()))}, the INS alone by {ins:.1f} m."
        )
    )
    shown.show(
        name="fig-l2-map",
        caption="Drag the gain. At 0 the INS is set right once, by the first fix, and goes on by "
        "itself: the blend drifts off. At 1 the blend is the fixes. The best lies between.",
        alt=f"Two charts. On the map the path of the INS leaves the true one by {ins:.1f} m on "
        f"average. Below, over 20 seconds, the fixes are off by "
        f"{centimetres(float(fixes.mean()))}; with the gain {start:g} the blend is off by "
        f"{centimetres(mean[shown.sliders['g'].start])} on average.",
    )


def show_instruments(run: ExampleRun) -> None:
    """Show the errors of both instruments on one axis, each at its own scale."""
    ins, network = ((what - run.truth)[:, 0] for what in (run.ins, run.network))
    shown = Moving("Two kinds of error")
    time = {"x": "time (s)", "y": "error in x (m)", "xlim": (0, 20)}
    smooth = shown.chart("INS: smooth, and it grows", ylim=(-16, 0), **time)
    rough = shown.chart("Fixes: rough, and it stays", ylim=(-0.5, 0.5), **time)
    shown.draw(smooth, "ins", "INS", (run.time, ins))
    shown.draw(rough, "network", "fixes", (run.time, network), style="points")
    shown.number("ins", "from one sample to the next", f"{abs(np.diff(ins)).mean():.2f} m")
    shown.number("network", "from one sample to the next", f"{abs(np.diff(network)).mean():.2f} m")
    shown.show(
        name="fig-l2-instruments",
        caption="The same 20 seconds, the same axis; mind the two scales. The error of the INS is "
        "a smooth curve that a rule can follow. That of these simulated fixes is new each time.",
        alt=f"Two charts over 20 seconds. The error of the INS in x runs smoothly from "
        f"{ins[0]:.1f} to {ins[-1]:.1f} m; that of the fixes jumps between {network.min():.2f} and "
        f"{network.max():.2f} m.",
    )


def show_gains(run: ExampleRun, by_gain: ByGain) -> None:
    """Show the mean distance over the gain."""
    mean = np.array([run.distances(run.ins - by_gain(float(g))).mean() for g in GAINS])
    low = int(mean.argmin())
    shown = Moving(
        "Error against the gain", Slider("g", "gain g", [*GAINS], GAINS[2], "g = {:.3f}")
    )
    chart = shown.chart("Mean distance", x="gain g", y="off by (m)", xlim=(0, 1), ylim=(0, 0.6))
    seen = np.minimum(mean, 0.6)
    shown.draw(chart, "ins", "drift gets in", (GAINS[: low + 1], seen[: low + 1]), at=4)
    shown.draw(chart, "network", "noise gets in", (GAINS[low:], seen[low:]), at=low)
    at = dict(zip(GAINS, mean, strict=True))
    shown.draw(
        chart, "constant", "you are here", lambda g: ([g], [min(at[g], 0.6)]), style="points", at=0
    )
    shown.number("constant", "off by", lambda g: centimetres(at[g]))
    shown.sentence(lambda g: f"With g = {g:.3f} it is off by {at[g]:.3f} m.")
    shown.show(
        name="fig-l2-gains",
        caption="Left of the lowest point the drift gets in, right of it the noise of the fixes.",
        alt=f"Mean distance against the gain: {mean[1]:.2f} m at {GAINS[1]:.3f}, least "
        f"{mean[low]:.3f} m at {GAINS[low]:.3f}, {mean[-1]:.3f} m at 1.",
    )


def show_bells(*, start: float = 0.2, measured: float = 0.3, R: float = 0.1**2) -> None:
    """Show a prediction, a fix and their blend as bells, by how sure the prediction is."""
    x = np.linspace(-0.6, 0.8, 141)
    sizes = np.round(np.arange(0.04, 0.41, 0.02), 2)
    shown = Moving(
        "Two bells make a narrower one",
        Slider("s", "prediction is sure to", [*sizes], start, "± {:.2f} m"),
    )
    chart = shown.chart(
        "How likely each error is", x="error of the INS (m)", y="per metre", xlim=(-0.6, 0.8),
        ylim=(0, 12),
    )  # fmt: skip

    def blend(s: float) -> tuple[float, float]:
        K = s**2 / (s**2 + R)
        return K, float(np.sqrt((1 - K) * s**2))

    shown.draw(chart, "ins", "prediction", lambda s: (x, _bell(x, 0, s)), at=52)
    shown.draw(chart, "network", "fix", (x, _bell(x, measured, R**0.5)), at=100)
    shown.draw(
        chart, "kalman", "blend",
        lambda s: (x, _bell(x, blend(s)[0] * measured, blend(s)[1])), at=82,
    )  # fmt: skip
    shown.number("kalman", "gain K = M/(M + R)", lambda s: f"{blend(s)[0]:.2f}")
    shown.number("kalman", "blend is sure to", lambda s: f"± {blend(s)[1]:.3f} m")
    shown.sentence(
        lambda s: (
            f"A prediction that is sure to {s:.2f} m and a fix that is sure to {R**0.5:.1f} m: the "
            f"gain is {blend(s)[0]:.2f}, and the blend is sure to {blend(s)[1]:.3f} m."
        )
    )
    K, size = blend(start)
    shown.show(
        name="fig-l2-bells",
        caption="The blend lies between the two, nearer to the surer one, and is narrower "
        "than both.",
        alt=f"Three bells: a prediction at 0 with a standard deviation of {start:g} m, a "
        f"fix at {measured} m with {R**0.5:.1f} m, and their blend at {K * measured:.2f} m with "
        f"{size:.3f} m. The gain is {K:.2f}.",
    )


def show_outage(run: ExampleRun, run_filter: Filter) -> None:
    """Show the error on one axis inside its band of two sigma, with an outage of some length."""
    lengths = [*range(0, 41, 2)]
    shown = Moving(
        "A filter that knows how sure it is", Slider("n", "fixes lost", lengths, 20, "{:d}")
    )
    found = {}
    for n in lengths:
        y = run.ins - run.network
        y[40 : 40 + n] = np.nan
        estimates, covariances = run_filter(y, 1.0)
        error = (run.ins - estimates - run.truth)[:, 0]
        found[n] = error, 2 * np.sqrt(covariances[:, 0, 0])
    chart = shown.chart(
        "Error of the corrected position in x", x="time (s)", y="error (m)", xlim=(0, 20),
        ylim=(-2, 2),
    )  # fmt: skip
    shown.draw(chart, "kalman", "", lambda n: (run.time, -found[n][1], found[n][1]), style="band")
    shown.draw(chart, "kalman", "error", lambda n: (run.time, found[n][0]))
    inside = {n: np.mean(abs(error) < band) for n, (error, band) in found.items()}
    shown.number("kalman", "inside its band", lambda n: f"{inside[n]:.0%} of the time")
    shown.number("kalman", "band at its widest", lambda n: f"± {found[n][1][1:].max():.2f} m")
    shown.sentence(
        lambda n: (
            f"With {n} fixes lost the band opens to {found[n][1][1:].max():.2f} m; the error is "
            f"inside for {inside[n]:.0%} of the time."
        )
    )
    shown.show(
        name="fig-l2-outage",
        caption="The band is two standard deviations that the filter computes itself. While "
        "fixes are lost it opens; the next ones close it again.",
        alt=f"The error in x over 20 seconds and a band around nought. With 20 fixes lost from "
        f"second 8 on, the band opens to {found[20][1][1:].max():.2f} m and closes with the "
        "next fixes.",
    )


def show_told(run: ExampleRun, run_filter: Filter, *, start: float) -> None:
    """Show the error over the factor on Q, and whether the innovations fit what is assumed."""
    y = run.ins - run.network
    error, fit = [], []
    low, high = nis_interval(len(y) - 1)
    for factor in FACTORS:
        estimates, _ = run_filter(y, factor)
        error.append(float(run.distances(run.ins - estimates).mean()))
        fit.append(mean_nis(run, run_filter, y, factor))
    told = dict(zip(FACTORS, zip(error, fit, strict=True), strict=True))

    def light(nis: float) -> str:
        return "too sure" if nis > high else "too cautious" if nis < low else "fits"

    shown = Moving(
        "What the filter assumes", Slider("q", "assumed Q, as a factor", [*FACTORS], start, "{:g}")
    )
    chart = shown.chart(
        "Mean distance against the assumed Q", x="factor on Q, as a power of ten", y="off by (m)",
        xlim=(-4.2, 4.2), ylim=(0, 0.5),
    )  # fmt: skip
    powers = np.log10(FACTORS)
    shown.draw(chart, "kalman", "Kalman filter", (powers, error), at=3)
    network = float(run.distances(run.network).mean())
    shown.draw(chart, "network", "fixes", (powers, np.full(len(powers), network)), at=13)
    shown.draw(chart, "kalman", "", lambda q: ([np.log10(q)], [told[q][0]]), style="points")
    shown.number("kalman", "off by", lambda q: centimetres(told[q][0]))
    shown.number("kalman", f"NIS (4 fits, {low:.1f} to {high:.1f})", lambda q: f"{told[q][1]:.1f}")
    shown.number("kalman", "so it is", lambda q: light(told[q][1]))
    shown.sentence(
        lambda q: (
            f"With {q:g} times the right Q the filter is off by {told[q][0]:.3f} m, and its mean "
            f"NIS is {told[q][1]:.1f}: {light(told[q][1])}."
        )
    )
    shown.show(
        name="fig-l2-told",
        caption="Too small a Q lets the drift in, too large a Q makes the filter the fixes. The "
        "numbers beside the slider say, without the truth, whether the innovations fit.",
        alt=f"Mean distance against the factor on Q from 1e-4 to 1e4: {error[0]:.2f} m at the left "
        f"end, least {min(error):.3f} m, {error[-1]:.3f} m at the right end; the fixes alone "
        f"{network:.3f} m.",
    )


def nis_interval(samples: int) -> tuple[float, float]:
    """Return what 95 % of the means of as many chi-square variables of 4 degrees lie in."""
    low, high = 4 * np.array(bounds(4 * samples))
    return float(low), float(high)


def mean_nis(run: ExampleRun, run_filter: Filter, y: Array, factor: float) -> float:
    """Return the mean of v' S^-1 v over all samples but the first: 4 if what is assumed fits."""
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
        Slider("q", "assumed Q, as a factor", [*FACTORS], start, "{:g}"),
    )
    charts = [
        shown.chart(title, x="fixes ago", y="weight", xlim=(-0.6, 12.6), ylim=(-0.1, 1.05))
        for title in ("Kalman filter", "P1's filter as published")
    ]
    shown.draw(charts[0], "kalman", "Kalman", lambda q: (past, of[q]), style="bars", at=8)
    shown.draw(charts[1], "hinfinity", "P1", (past, (past == 0) * 1.0), style="bars", at=8)
    shown.number("kalman", "weight of this fix", lambda q: f"{of[q][0]:.2f}")
    shown.number("hinfinity", "weight of this fix", "1.00")
    shown.sentence(
        lambda q: (
            f"With {q:g} times the right Q the present fix has the weight {of[q][0]:.2f}, the one "
            f"before {of[q][1]:.2f}. In P1's filter it has the weight 1, and all others none."
        )
    )
    shown.show(
        name="fig-l2-weights",
        caption="The weight of past fixes in the corrected position. P1's filter has one bar: it "
        "has no memory.",
        alt=f"Two bar charts of weights on the last 13 fixes. Kalman filter, matched: "
        f"{of[1.0][0]:.2f}, {of[1.0][1]:.2f}, {of[1.0][2]:.2f} and falling. P1's filter: 1, then "
        "none.",
    )
