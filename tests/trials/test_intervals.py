"""How often the intervals of the book hold the truth, each in the layouts in which it is used.

A trial draws what an interval is made of from a population whose truth is known. The truth of an
interval of runs is one more run; that of a tuned method, one more run under one more tuning.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from itertools import product
from typing import Any

import indices
import numpy as np
import pytest
from effects import band_of
from indices import sobol_places, sobol_shares
from inswsn_book.evidence.outage_page import turning_time
from inswsn_book.evidence.outage_tables import median_findings
from inswsn_book.evidence.recorded_tables import mean_ratio
from scipy.signal import lfilter
from scipy.stats import binomtest, norm

from inswsn_lib.checks import Array
from inswsn_lib.evaluation import (
    Finding,
    block_ratio,
    cluster_mean,
    cluster_median,
    cluster_share,
    paired_lead,
    quotient,
)
from inswsn_lib.navigation.bridged_outages import judge_best

WHOLE, LEAST = 2000, 0.93
#: Draws what gives the low end, the truth and the high end
Trial = Callable[[np.random.Generator], tuple[float, float, float]]
Draw = Callable[[np.random.Generator, Any], Array]
POPULATIONS: dict[str, Draw] = {
    "normal": lambda rng, size: rng.normal(size=size),
    "exponential": lambda rng, size: rng.exponential(size=size),
    "heavy-tailed": lambda rng, size: rng.standard_t(3, size=size),
}
MEANS = {"normal": 0.0, "exponential": 1.0, "heavy-tailed": 0.0}
# of the sum of two exponentials: x with (1 + x) exp(-x) = 1/2
MEDIANS = {"normal": 0.0, "exponential": 1.6783469900166606, "heavy-tailed": 0.0}


# Clusters ----------------------------------------------------------------------------------------


def clustered(rng: np.random.Generator, draw: Draw, labels: Array) -> Array:
    """Return values half of whose variance is between clusters."""
    return np.asarray(draw(rng, labels.max() + 1)[labels] + draw(rng, len(labels)))


def mean_of(rng: np.random.Generator, name: str, labels: Array) -> tuple[float, float, float]:
    _, low, high = cluster_mean(clustered(rng, POPULATIONS[name], labels), labels)
    return low, 2 * MEANS[name], high


def median_of(rng: np.random.Generator, name: str, labels: Array) -> tuple[float, float, float]:
    values = clustered(rng, POPULATIONS[name], labels)
    _, low, high = cluster_median(values, labels, seed=int(rng.integers(2**31)), resamples=400)
    return low, MEDIANS[name], high


def share_of(rng: np.random.Generator, name: str, labels: Array) -> tuple[float, float, float]:
    """A part, and a whole of eight and values of their own."""
    part, rest = (clustered(rng, POPULATIONS[name], labels) for _ in range(2))
    _, low, high = cluster_share(part, 8 + rest, labels)
    return low, MEANS[name] / (4 + MEANS[name]), high


def held_of(rng: np.random.Generator, labels: Array) -> tuple[float, float, float]:
    """What holds in nine of ten outages, in some clusters more often than in others."""
    often = rng.beta(9, 1, labels.max() + 1)[labels]
    _, low, high = cluster_mean((rng.random(len(labels)) < often).astype(float), labels)
    return low, 0.9, high


def of_clusters(trial: Callable[..., Any], *layouts: tuple[int, int]) -> dict[str, Trial]:
    """Return trials of so many clusters of so many values."""
    return {
        f"{count} x {each}, {name}": partial(
            trial, name=name, labels=np.repeat(np.arange(count), each)
        )
        for (count, each), name in product(layouts, POPULATIONS)
    }


# Blocks of time ----------------------------------------------------------------------------------


def lasting(rng: np.random.Generator, rows: int, step: float, time: float, of: int) -> Array:
    """Return errors of a first-order Gauss-Markov process of unit size, (rows, of)."""
    kept = np.exp(-step / time)
    pushed = np.sqrt(1 - kept**2) * rng.normal(size=(rows, of))
    pushed[0] = rng.normal(size=of)
    return np.asarray(lfilter([1], [1, -kept], pushed, axis=0))


def series(
    rng: np.random.Generator, rows: int, step: float, time: float
) -> tuple[float, float, float]:
    """Two methods that share most of their errors, which are of one size."""
    theirs, other = np.split(lasting(rng, rows, step, time, 4), 2, axis=1)
    mine = 0.7 * theirs + np.sqrt(1 - 0.7**2) * other
    _, low, high = block_ratio(np.sum(mine**2, axis=1), np.sum(theirs**2, axis=1))
    return low, 1.0, high


def outages(
    rng: np.random.Generator, length: float, every: float, total: float
) -> tuple[float, float, float]:
    """Mean squares over outages that overlap: velocities are wrong, for 2 s."""
    step = 0.2
    wrong = lasting(rng, round(total / step), step, 2.0, 4)
    begins = np.arange(0, round((total - length) / step), round(every / step))
    away = [np.cumsum(wrong[k : k + round(length / step)], axis=0) * step for k in begins]
    theirs = np.array([np.mean(np.sum(each[:, :2] ** 2, axis=1)) for each in away])
    mixed = [0.7 * x[:, :2] + np.sqrt(1 - 0.7**2) * x[:, 2:] for x in away]
    mine = np.array([np.mean(np.sum(each**2, axis=1)) for each in mixed])
    _, low, high = block_ratio(mine, theirs)
    return low, 1.0, high


# Runs --------------------------------------------------------------------------------------------


def columns(rng: np.random.Generator, runs: int, count: int) -> list[tuple[Array, Array]]:
    """Return errors of two methods in some columns, whose medians are both the column's number."""
    shared = rng.normal(size=(count, runs))
    own = rng.normal(size=(2, count, runs))
    return [
        tuple((1 + i) * np.exp(0.4 * shared[i] + 0.2 * each[i]) for each in own)
        for i in range(count)
    ]


def ratio_of(rng: np.random.Generator, runs: int, count: int) -> tuple[float, float, float]:
    found = quotient(*zip(*columns(rng, runs, count), strict=True), "1", "")
    return found.low, 1.0, found.high


def lead_of(rng: np.random.Generator, name: str, runs: int) -> tuple[float, float, float]:
    """The lead of one that is a tenth below, of a mean of ten."""
    gain = 1 + POPULATIONS[name](rng, runs) - MEANS[name]
    percent, within = paired_lead(np.full(runs, 9.0), 9 + gain)
    truth = 100 / (9 + gain).mean()
    return percent - within, truth, percent + within


def run_of(rng: np.random.Generator, routes: int, draws: int) -> tuple[float, float, float]:
    """One more drive on one more route; or one more run, if a route has one draw."""
    drives = clustered(rng, POPULATIONS["normal"], np.repeat(np.arange(routes), draws))
    found = Finding.of_runs(drives, "1", "")
    return found.low, float(rng.normal() + rng.normal()), found.high


def middle_of(rng: np.random.Generator, runs: int) -> tuple[float, float, float]:
    found = median_findings("", ["rx"], [rng.exponential(size=runs)])["median..rx"]
    return found.low, float(np.log(2)), found.high


def crossing(rng: np.random.Generator, runs: int) -> tuple[float, float, float]:
    """Two areas, where the squares of one filter are the time over 1.2 s of those of the other."""
    shared = rng.gamma(5.0, 0.2, (2, runs))
    squares = {}
    for time in (0.5, 1.0, 1.5, 3.2):
        own = rng.gamma(20.0, 0.05, (2, 2, runs)) * shared
        squares[time] = own * np.array([1.0, time / 1.2])[:, None, None]
    _, (low, high) = turning_time(squares, seed=int(rng.integers(2**31)))
    return low, 1.2, high


def recordings(rng: np.random.Generator, name: str, count: int) -> tuple[float, float, float]:
    _, low, high = mean_ratio(np.exp(POPULATIONS[name](rng, count)).tolist())
    return low, 1.0, high


def chance(rng: np.random.Generator, name: str, seeds: int) -> tuple[float, float, float]:
    """How far two runs are apart, by the runs of some seeds."""
    band = band_of(POPULATIONS[name](rng, seeds).tolist())
    return -band, float(np.subtract(*POPULATIONS[name](rng, 2))), band


# Tuned methods -----------------------------------------------------------------------------------


@dataclass
class Rehearsal:
    """Shares of the error by runs that stand in for `Passage`, of settings that are their places.

    Settings are apart by a few per cent, runs by far more, and what suits an outage is not quite
    what suits its rehearsal.
    """

    share: Array  # (settings, runs)

    @classmethod
    def of(cls, rng: np.random.Generator, typical: Array, runs: int) -> Rehearsal:
        hard = rng.normal(size=runs) + rng.normal(size=(len(typical), runs))
        return cls(typical[:, None] * np.exp(0.4 * hard))

    def sizes(self, place: int) -> Array:
        left = np.broadcast_to(self.share[place], (4, self.share.shape[1]))
        return np.stack([left, np.ones_like(left)])

    def shares(self, place: int) -> Array:
        return np.broadcast_to(self.share[place], (4, self.share.shape[1]))


def tuned(rng: np.random.Generator, judged: Array, runs: int) -> Array:
    """Return shares of one that 48 runs tune, in % of the INS, (1 + draws, runs)."""
    level = np.linspace(-1, 1, 12) ** 2 * 0.1 + 1
    rehearsed = [Rehearsal.of(rng, level, 48) for _ in range(2)]
    bridges = [lambda _, place=place: place for place in range(12)]
    passages = [Rehearsal.of(rng, judged, runs)]
    return judge_best("", bridges, passages, rehearsed).by_run  # type: ignore[arg-type]


def tuned_run(rng: np.random.Generator, apart: float) -> tuple[float, float, float]:
    judged = np.exp(apart * rng.normal(size=12))
    found = Finding.of_runs(tuned(rng, judged, 256), "%", "")
    return found.low, float(tuned(rng, judged, 1)[0, 0]), found.high


def tuned_ratio(rng: np.random.Generator, apart: float) -> tuple[float, float, float]:
    """Two methods, each tuned; the truth is the ratio of what other tunings take of both."""
    judged = np.exp(apart * rng.normal(size=(2, 12)))
    one, other = (tuned(rng, each, 256) for each in judged)
    found = quotient([one], [other], "1", "")
    again = [np.median(tuned(rng, each, 4000)[0]) for each in judged]
    return found.low, float(again[0] / again[1]), found.high


# Total indices -----------------------------------------------------------------------------------

NAMES = [f"{i}" for i in range(11)]
GROUPS = [*NAMES[:3], *["others"] * 8]


def tailed(places: Array) -> Array:
    """The exponential of normal numbers with deviations .9, .6, .3, and .1 of all others."""
    deviations = np.full(places.shape[1], 0.1)
    deviations[:3] = 0.9, 0.6, 0.3
    return np.asarray(np.exp(norm.ppf(np.clip(places, 5e-7, 1 - 5e-7)) @ deviations))


def product_of(places: Array) -> Array:
    """Sobol's g function with coefficients 0, 1, 4.5, and 9 of all others."""
    coefficients = np.full(places.shape[1], 9.0)
    coefficients[:3] = 0.0, 1.0, 4.5
    return np.prod((np.abs(4 * places - 2) + coefficients) / (1 + coefficients), axis=1)


def indices_of(
    rng: np.random.Generator, function: Callable[[Array], Array], variances: Array
) -> tuple[Array, Array, Array]:
    """Of a product of independent factors they are known; the layout is that of p1-outages."""
    all_of, own = np.prod(1 + variances), np.prod(1 + variances[:3])
    without = np.append(all_of / (1 + variances[:3]), own)
    seed = int(rng.integers(2**31))
    with pytest.MonkeyPatch.context() as fewer:
        fewer.setattr(indices, "RESAMPLES", 200)
        values = function(sobol_places(NAMES, GROUPS, 256, seed))
        found = sobol_shares(NAMES, GROUPS, values, seed).values()
    low, high = np.array([(share.total_low, share.total_high) for share in found]).T
    return low, 1 - (without - 1) / (all_of - 1), high


# All of them -------------------------------------------------------------------------------------

LONG_TAIL = np.exp([0.81, 0.36, 0.09, *[0.01] * 8]) - 1
G_FUNCTION = 1 / 3 / (1 + np.array([0.0, 1.0, 4.5, *[9.0] * 8])) ** 2
#: Trials of a day, and the layouts, by the interval
USES: dict[str, tuple[int, dict[str, Trial]]] = {
    # blocks, places, routes, places of the routes with some draws and with one
    "cluster means": (200, of_clusters(mean_of, (6, 8), (8, 4), (12, 4), (96, 4), (96, 1)) | {
        "96 x 4, held": partial(held_of, labels=np.repeat(np.arange(96), 4))}),
    "cluster medians": (100, of_clusters(median_of, (12, 4))),
    "cluster shares": (100, of_clusters(share_of, (6, 8), (96, 4))),
    # a room, a mower, a robot, and outages on foot and by car
    "block ratios": (200, {
        **{f"room, {time} s": partial(series, rows=475, step=0.2, time=time)
           for time in (0.5, 1.5, 3.2, 8.0)},
        "mower": partial(series, rows=200, step=1.0, time=8.0),
        "robot": partial(series, rows=30, step=0.5, time=1.0),
        **{f"outages of {length} s every {every} s":
           partial(outages, length=length, every=every, total=total)
           for length, every, total in ((10, 4, 95), (10, 3, 67), (20, 8, 270))}}),
    "quotients of medians": (20, {
        f"{runs} runs, {count} columns": partial(ratio_of, runs=runs, count=count)
        for runs, count in ((1024, 4), (512, 1), (256, 1))}),
    "leads": (200, {f"{runs} runs, {name}": partial(lead_of, name=name, runs=runs)
                    for runs, name in product((40, 256), POPULATIONS)}),
    "runs": (200, {f"{routes} x {draws}": partial(run_of, routes=routes, draws=draws)
                   for routes, draws in ((40, 1), (256, 1), (1024, 1), (12, 4))}),
    "medians of runs": (200, {"256 runs": partial(middle_of, runs=256)}),
    "a crossing": (20, {"256 runs": partial(crossing, runs=256)}),
    "recordings": (200, {f"{count}, {name}": partial(recordings, name=name, count=count)
                         for count, name in product((3, 4), ("normal", "heavy-tailed"))}),
    "chance": (200, {f"{seeds} seeds, normal": partial(chance, name="normal", seeds=seeds)
                     for seeds in (2, 4)}),
    "tuned methods": (50, {f"settings {apart} apart": partial(tuned_run, apart=apart)
                           for apart in (0.02, 0.1)}),
    "ratios of tuned methods": (20, {f"settings {apart} apart": partial(tuned_ratio, apart=apart)
                                     for apart in (0.02, 0.1)}),
    "total indices": (4, {
        "long tail": partial(indices_of, function=tailed, variances=LONG_TAIL),
        "product": partial(indices_of, function=product_of, variances=G_FUNCTION)}),
}  # fmt: skip


@pytest.mark.parametrize("use", USES)
def test_intervals(
    use: str, size: Callable[[int, int], int], seed: int, tell: Callable[[str], None]
) -> None:
    """Of few trials: not refuted, where each layout would be once in 10,000 by chance."""
    (daily, layouts), held = USES[use], {}
    trials = size(daily, WHOLE)
    for layout, trial in layouts.items():
        rng, hits = np.random.default_rng(seed), np.zeros(1)
        for _ in range(trials):
            low, truth, high = trial(rng)
            hits = hits + (np.less_equal(low, truth) & np.less_equal(truth, high))
        held[layout] = int(hits.min())
    shares = np.array([*held.values()]) / trials
    tell(f"of {len(held)} layouts, {trials} trials each, intervals of 95 % hold "
         f"{100 * shares.min():.1f} to {100 * shares.max():.1f} %")  # fmt: skip
    for layout, hits in held.items():
        assert binomtest(hits, trials, LEAST, "less").pvalue > 1e-4, layout
    if trials == WHOLE:
        assert shares.min() >= LEAST, held
