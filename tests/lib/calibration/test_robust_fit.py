"""Deviations by blocks against estimates that really leave a block out, and fits against scipy."""

from __future__ import annotations

import numpy as np
from made_recording import coloured
from scipy.optimize import least_squares

from inswsn_lib.calibration.blocks import block_starts, block_sums, jackknife
from inswsn_lib.calibration.linear_fit import fit_linear


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


def test_a_line_is_that_of_scipy() -> None:
    rng = np.random.default_rng(2)
    time = np.arange(0, 100, 0.2)
    X = np.column_stack([np.ones(500), np.sin(time)])
    y = X @ [0.3, 1.2] + 0.1 * rng.standard_t(2, 500)
    line = fit_linear(X, y, time, 5.0)
    assert line is not None
    found = least_squares(
        lambda b: y - X @ b, [0.0, 0.0], loss="soft_l1", f_scale=line.noise, xtol=1e-12
    )
    np.testing.assert_allclose(line.values, found.x, atol=2e-4)


def test_errors_that_last_are_known_of() -> None:
    """Errors last for a second: of 200 intervals of 95 %, 2 to 21 miss, but for once in 1000."""
    missed = 0
    time = np.arange(0, 60, 0.1)
    one = np.ones((600, 1))
    for seed in range(200):
        error = coloured(np.random.default_rng(seed), time, 1.0)
        line = fit_linear(one, error, time, 5.0)
        assert line is not None
        missed += abs(line.values[0]) > 2.23 * line.deviations[0]  # Student's with 10 degrees
    assert 2 <= missed <= 21


def test_too_little_is_no_line() -> None:
    assert fit_linear(np.ones((3, 1)), np.ones(3), np.arange(3.0), 1.0) is None
    assert fit_linear(np.ones((0, 1)), np.ones(0), np.zeros(0), 1.0) is None
    flat = fit_linear(np.zeros((100, 1)), np.ones(100), np.arange(100.0), 5.0)
    assert flat is not None
    assert np.isinf(flat.deviations[0])
