"""The compiled recursion of a filter with shared gains is the plain one."""

from __future__ import annotations

import numpy as np
import pytest

from inswsn_lib.filters import kalman
from inswsn_lib.kernels import choose

compiled = choose("linear_recursion", kalman._recursion)


@pytest.mark.parametrize("seed", range(20))
def test_it_is_the_plain_recursion(seed: int) -> None:
    """With sparse matrices, rows of zeros, and no steps or runs."""
    rng = np.random.default_rng(seed)
    n, m, steps = rng.integers(1, 6), rng.integers(1, 6), rng.choice([0, 1, 12])
    runs, share = rng.choice([0, 1, 7, 100]), rng.choice([0.1, 0.5, 1.0])
    F, G = (
        rng.normal(size=(steps, n, size)) * (rng.random((steps, n, size)) < share)
        for size in (n, m)
    )
    given = F, G, rng.normal(size=(n, runs)), rng.normal(size=(steps, m, runs))
    before = [each.copy() for each in given]
    ours, theirs = np.full((2, steps + 1, n, runs), np.nan)
    compiled(*given, ours)
    kalman._recursion(*given, theirs)
    assert all(np.array_equal(a, b) for a, b in zip(given, before, strict=True))
    assert ours == pytest.approx(theirs, rel=1e-10, abs=1e-12)
