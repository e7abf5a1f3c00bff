"""The compiled gains of a filter are the plain ones."""

from __future__ import annotations

import numpy as np
import pytest
from random_filters import random_covariances

from inswsn_lib.filters import kalman
from inswsn_lib.kernels import choose

compiled = choose("kalman_gains", kalman._gains)


@pytest.mark.parametrize("seed", range(20))
def test_they_are_the_plain_gains(seed: int) -> None:
    rng = np.random.default_rng(seed)
    n, m, steps = rng.integers(1, 7), rng.integers(1, 7), rng.choice([0, 1, 30])
    A, C = rng.normal(size=(n, n)) / n, rng.normal(size=(m, n))
    (Q,), (R,), (P,) = (random_covariances(rng, size, 1) for size in (n, m, n))
    # a far innovation ends some of them at the start, or on the way
    limits = np.full(m, rng.choice([np.inf, 1.2, 0.1])) * np.diag(C @ P @ C.T + R)
    given = A, C, Q, R, limits, P, rng.random((steps, m)) < 0.7
    before = [each.copy() for each in given]
    ours, theirs = np.zeros((2, steps, n, m + n))
    done, *ahead, certain = compiled(*given, ours)
    as_done, *as_ahead, _ = kalman._gains(*given, theirs)
    assert all(np.array_equal(a, b) for a, b in zip(given, before, strict=True))
    assert done == as_done
    assert not certain
    assert ours == pytest.approx(theirs, rel=1e-9, abs=1e-11)
    for one, other in zip(ahead, as_ahead, strict=True):
        assert one == pytest.approx(other, rel=1e-9, abs=1e-11 * (1 + np.abs(P).max()))


def test_a_certain_innovation_is_told() -> None:
    A, none, there = np.eye(2), np.zeros((2, 2)), np.ones((1, 2), dtype=bool)
    P, limits, out = np.diag([1.0, 0.0]), np.full(2, np.inf), np.empty((1, 2, 4))
    assert compiled(A, A, none, none, limits, P, there, out)[-1]
    assert not compiled(A, A, none, none, limits, P, np.array([[True, False]]), out)[-1]
