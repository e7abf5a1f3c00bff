"""The compiled mean sizes of errors are the plain ones."""

from __future__ import annotations

import numpy as np
import pytest

from inswsn_lib.evaluation import drift_family
from inswsn_lib.kernels import choose

compiled = choose("mean_sizes", drift_family._mean_sizes)


@pytest.mark.parametrize("seed", range(20))
def test_they_are_the_plain_ones(seed: int) -> None:
    rng = np.random.default_rng(seed)
    errors, numbers, cells = rng.integers(1, 40), rng.integers(1, 8), rng.integers(1, 7)
    # from errors that are nothing beside their noise to those that have none
    deviation = 10.0 ** rng.uniform(-12, 3, errors)
    mean = rng.random((cells, errors)) * (rng.random((cells, errors)) < 0.5)
    given = rng.normal(size=(errors, numbers)), deviation, mean, rng.normal(size=numbers)
    before = [each.copy() for each in given]
    found, wanted = compiled(*given), drift_family._mean_sizes(*given)
    assert all(np.array_equal(a, b) for a, b in zip(given, before, strict=True))
    for ours, plain in zip(found, wanted, strict=True):
        assert ours == pytest.approx(plain, rel=1e-12, abs=1e-12)


@pytest.mark.parametrize("number", [0.0, np.nan, np.inf, 39.9999, 40.0001, -41.0])
def test_a_single_error_is_what_it_is_in_numpy(number: float) -> None:
    given = np.ones((1, 1)), np.ones(1), np.ones((1, 1)), np.array([number])
    for ours, plain in zip(compiled(*given), drift_family._mean_sizes(*given), strict=True):
        assert ours == pytest.approx(plain, rel=1e-15, nan_ok=True)
