"""Mean sizes of normal numbers, compiled and not, are those of scipy's folded normal."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from scipy.stats import foldnorm, norm

from inswsn_lib.kernels import choose
from inswsn_lib.kernels.mean_sizes import mean_sizes

FORMS = [choose("mean_sizes"), mean_sizes]


@pytest.mark.parametrize("run", FORMS)
@pytest.mark.parametrize("seed", range(20))
def test_they_are_the_means_of_folded_normals(seed: int, run: Any) -> None:
    """The slope of each by its mean is the probability of + less that of -."""
    rng = np.random.default_rng(seed)
    errors, numbers, cells = rng.integers(1, 40), rng.integers(1, 8), rng.integers(1, 7)
    # from errors that are small beside their noise to those of which it is nothing
    deviation = 10.0 ** rng.uniform(-12, 3, errors)
    mean = rng.random((cells, errors)) * (rng.random((cells, errors)) < 0.5)
    given = rng.normal(size=(errors, numbers)), deviation, mean, rng.normal(size=numbers)
    before = [each.copy() for each in given]
    sizes, slopes = run(*given)
    assert all(np.array_equal(a, b) for a, b in zip(given, before, strict=True))
    error = given[0] @ given[3]
    ratio = np.minimum(np.abs(error) / deviation, 30)  # beyond, scipy loses it
    folded = np.where(ratio < 30, deviation * foldnorm.mean(ratio), np.abs(error))
    assert sizes == pytest.approx(mean @ folded, rel=1e-12, abs=1e-12)
    sign = norm.cdf(error / deviation) - norm.sf(error / deviation)
    assert slopes == pytest.approx((mean * sign) @ given[0], rel=1e-12, abs=1e-12)


@pytest.mark.parametrize("run", FORMS)
@pytest.mark.parametrize("number", [0.0, np.nan, np.inf, 39.9999, 40.0001, -41.0])
def test_a_single_error_far_out_is_its_own_size(number: float, run: Any) -> None:
    size, slope = run(np.ones((1, 1)), np.ones(1), np.ones((1, 1)), np.array([number]))
    wanted = (2 / np.pi) ** 0.5 if number == 0 else abs(number)
    assert size.item() == pytest.approx(wanted, rel=1e-15, nan_ok=True)
    assert slope.item() == pytest.approx(np.sign(number), rel=1e-15, nan_ok=True)
