"""The compiled update of many filters is the plain one."""

from __future__ import annotations

import numpy as np
import pytest
from random_filters import random_covariances

from inswsn_lib.filters import kalman
from inswsn_lib.kernels import choose

compiled = choose("kalman_updates", kalman._updated)


@pytest.mark.parametrize("seed", range(20))
def test_it_is_the_plain_update(seed: int) -> None:
    rng = np.random.default_rng(seed)
    n, m, count = rng.integers(1, 7), rng.integers(1, 7), rng.choice([0, 1, 5])
    C, P = rng.normal(size=(m, n)), random_covariances(rng, n, count)
    R = random_covariances(rng, m, rng.choice([1, max(count, 1)]))
    given = C, P, C @ P @ C.T + R[: max(count, 1)], R, rng.random((count, m)) < 0.7
    before = [each.copy() for each in given]
    *found, certain = compiled(*given)
    *theirs, _ = kalman._updated(*given)
    assert all(np.array_equal(a, b) for a, b in zip(given, before, strict=True))
    assert not certain
    for ours, plain in zip(found, theirs, strict=True):
        assert ours == pytest.approx(plain, rel=1e-9, abs=1e-11 * (1 + np.abs(P).max(initial=0)))


def test_a_certain_innovation_is_told() -> None:
    C, there = np.eye(2), np.ones((1, 2), dtype=bool)
    S, R = np.diag([1.0, 0.0])[None], np.zeros((1, 2, 2))
    assert compiled(C, S, S, R, there)[-1]
    assert not compiled(C, S, S, R, np.array([[True, False]]))[-1]
