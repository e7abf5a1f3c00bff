"""Ratios of errors along a recording: exact ones, and intervals that hold what they say."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from scipy.signal import lfilter
from scipy.stats import binom

from inswsn_lib.checks import Array
from inswsn_lib.errors import ParameterError
from inswsn_lib.evaluation import block_ratio

Pair = tuple[Array, Array]


def test_a_constant_factor_is_known_exactly() -> None:
    theirs = np.random.default_rng(1).exponential(size=500)
    assert block_ratio(0.09 * theirs, theirs) == pytest.approx((0.3, 0.3, 0.3))


def test_of_independent_squares_the_width_is_that_of_the_delta_method() -> None:
    # the log of a ratio of two sums of n squared normal values has the variance 2 * 2 / n, that of
    # the ratio of RMS a quarter of it; 20 blocks have Student's 2.09 for 1.96
    rng, n = np.random.default_rng(2), 4000
    widths = []
    for _ in range(40):
        mine, theirs = np.square(rng.normal(size=(2, n)))
        ratio, low, high = block_ratio(mine, theirs)
        assert ratio == pytest.approx(np.sqrt(mine.sum() / theirs.sum()))
        widths.append(np.log(high / low) / (2 * 2.093))
    assert np.mean(widths) == pytest.approx(np.sqrt(1 / n), rel=0.1)


def lasting(rng: np.random.Generator, rows: int, step: float, time: float, of: int) -> Array:
    """Return errors of a first-order Gauss-Markov process of unit size, (rows, of)."""
    kept = np.exp(-step / time)
    pushed = np.sqrt(1 - kept**2) * rng.normal(size=(rows, of))
    pushed[0] = rng.normal(size=of)
    return np.asarray(lfilter([1], [1, -kept], pushed, axis=0))


def series(rows: int, step: float, time: float) -> Callable[[np.random.Generator], Pair]:
    """Return what draws squared errors of two methods that share most of them."""

    def draw(rng: np.random.Generator) -> Pair:
        theirs, other = np.split(lasting(rng, rows, step, time, 4), 2, axis=1)
        mine = 0.7 * theirs + np.sqrt(1 - 0.7**2) * other
        return np.sum(mine**2, axis=1), np.sum(theirs**2, axis=1)

    return draw


def outages(length: float, every: float, total: float) -> Callable[[np.random.Generator], Pair]:
    """Return what draws mean squares over outages that overlap: velocities are wrong, for 2 s."""

    def draw(rng: np.random.Generator) -> Pair:
        step = 0.2
        wrong = lasting(rng, round(total / step), step, 2.0, 4)
        begins = np.arange(0, round((total - length) / step), round(every / step))
        away = [np.cumsum(wrong[k : k + round(length / step)], axis=0) * step for k in begins]
        theirs = np.array([np.mean(np.sum(each[:, :2] ** 2, axis=1)) for each in away])
        mixed = [0.7 * x[:, :2] + np.sqrt(1 - 0.7**2) * x[:, 2:] for x in away]
        return np.array([np.mean(np.sum(each**2, axis=1)) for each in mixed]), theirs

    return draw


#: Length, spacing and memory of each use: a room, a mower, a robot, and outages on foot and by car
USES = {
    "room, 0.5 s": series(475, 0.2, 0.5),
    "room, 1.5 s": series(475, 0.2, 1.5),
    "room, 3.2 s": series(475, 0.2, 3.2),
    "room, 8 s": series(475, 0.2, 8.0),
    "mower": series(200, 1.0, 8.0),
    "robot": series(30, 0.5, 1.0),
    "outages of 10 s every 4 s": outages(10, 4, 95),
    "outages of 10 s every 3 s": outages(10, 3, 67),
    "outages of 20 s every 8 s": outages(20, 8, 270),
}


def held(use: str, trials: int) -> float:
    rng = np.random.default_rng(53)
    found = [block_ratio(*USES[use](rng)) for _ in range(trials)]
    # both methods have errors of one size
    return float(np.mean([low <= 1 <= high for _, low, high in found]))


@pytest.mark.parametrize("use", USES)
def test_the_interval_holds_the_ratio(use: str) -> None:
    """Of 200 trials with 93 %, fewer than this hold it once in ten thousand times."""
    assert held(use, 200) >= binom.ppf(1e-4, 200, 0.93) / 200


@pytest.mark.whole
@pytest.mark.parametrize("use", USES)
def test_the_interval_holds_the_ratio_at_least_93_times_of_100(use: str) -> None:
    assert held(use, 2000) >= 0.93


def test_rows_that_share_data_are_in_one_block() -> None:
    rng = np.random.default_rng(4)
    mine, theirs = np.square(rng.normal(size=(2, 60)))
    free, third, half = (block_ratio(mine, theirs, block) for block in (1, 20, 30))
    # never fewer than three blocks
    assert third == half != free


def test_what_cannot_be_told_is_said() -> None:
    with pytest.raises(ParameterError, match=r"^squares must be 3 rows or more, not 2"):
        block_ratio(np.ones(2), np.ones(2))
    assert np.isnan(block_ratio(np.ones(9), np.zeros(9))).all()
    # one block has all that the other does wrong
    theirs = np.append(np.zeros(8), 1.0)
    assert block_ratio(np.ones(9), theirs)[1:] == (0.0, np.inf)
