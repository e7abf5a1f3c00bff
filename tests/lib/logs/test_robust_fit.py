"""Deviations by blocks against estimates that really leave a block out, and fits against scipy."""

from __future__ import annotations

import numpy as np
from made_recording import coloured
from numpy.typing import NDArray
from scipy.optimize import least_squares

from inswsn_lib.logs.blocks import block_starts, block_sums, covariance, fit, jackknife

Array = NDArray[np.float64]


def test_blocks_are_as_long_as_asked_or_a_tenth_of_a_short_time() -> None:
    assert block_starts(np.arange(0, 60.0), 5.0).tolist() == list(range(0, 55, 5))
    assert block_starts(np.linspace(0, 1, 101), 5.0).tolist() == list(range(0, 100, 10))
    gap = np.concatenate([np.arange(0, 20.0), np.arange(70, 91.0)])
    assert block_starts(gap, 5.0).tolist() == list(range(0, 40, 5))


def test_the_jackknife_is_that_of_estimates_without_a_block() -> None:
    rng = np.random.default_rng(0)
    X, y = rng.normal(size=(90, 3)), rng.normal(size=90)
    starts = np.arange(0, 90, 9)
    best = np.linalg.lstsq(X, y, rcond=None)[0]
    ones = np.ones(90)
    found, lost = jackknife(*block_sums(-X, y - X @ best, ones, starts))
    assert not lost.any()
    moved = []
    for first in starts:
        kept = np.ones(90, dtype=bool)
        kept[first : first + 9] = False
        moved.append(np.linalg.lstsq(X[kept], y[kept], rcond=None)[0] - best)
    expected = 9 / 10 * np.array(moved).T @ np.array(moved)
    np.testing.assert_allclose(found, expected, rtol=1e-9)


def test_what_one_block_alone_tells_is_lost() -> None:
    rng = np.random.default_rng(1)
    X = rng.normal(size=(60, 2))
    X[10:, 1] = 0.0
    _, lost = jackknife(*block_sums(-X, rng.normal(size=60), np.ones(60), np.arange(0, 60, 10)))
    assert lost.tolist() == [False, True]


class Line:
    """What is linear in its unknowns, as a problem to be fitted."""

    def __init__(self, columns: Array, values: Array) -> None:
        self.columns, self.values = columns, values

    def residual(self, state: Array) -> Array:
        return np.asarray(self.values - self.columns @ state)

    def jacobian(self, state: Array) -> Array:
        return -self.columns

    def moved(self, state: Array, by: Array) -> Array:
        return np.asarray(state + by)


def test_a_line_is_that_of_scipy() -> None:
    rng = np.random.default_rng(2)
    X = np.column_stack([np.ones(500), np.sin(np.arange(0, 100, 0.2))])
    y = X @ [0.3, 1.2] + 0.1 * rng.standard_t(2, 500)
    state, noise = fit(Line(X, y), np.zeros(2), 1.0, lambda _: np.ones(2))
    found = least_squares(
        lambda b: y - X @ b, [0.0, 0.0], loss="soft_l1", f_scale=noise, xtol=1e-12
    )
    np.testing.assert_allclose(state, found.x, atol=2e-4)


def test_errors_that_last_are_known_of() -> None:
    """Errors last for a second: of 200 intervals of 95 %, 2 to 21 miss, but for once in 1000."""
    missed = 0
    time, one = np.arange(0, 60, 0.1), np.ones(1)
    starts = block_starts(time, 5.0)
    for seed in range(200):
        line = Line(np.ones((600, 1)), coloured(np.random.default_rng(seed), time, 1.0))
        state, noise = fit(line, np.zeros(1), 1.0, lambda _: one)
        found, lost = covariance(line, state, noise, starts)
        assert not lost.any()
        missed += abs(state[0]) > 2.23 * np.sqrt(found[0, 0])  # Student's with 10 degrees
    assert 2 <= missed <= 21


def test_what_nothing_tells_is_lost() -> None:
    time = np.arange(100.0)
    line = Line(np.column_stack([np.ones(100), np.zeros(100)]), np.ones(100))
    _, lost = covariance(line, np.zeros(2), 1.0, block_starts(time, 5.0))
    assert lost.tolist() == [False, True]
