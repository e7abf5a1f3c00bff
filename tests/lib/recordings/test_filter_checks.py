"""Checks of a filter: on innovations whose size and correlation are known."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import chi2

from inswsn_lib.recordings import Finding, check_errors, check_innovations
from inswsn_lib.recordings.filter_checks import check_outliers, inside

N = 1000


def told(values: np.ndarray, series: np.ndarray | None = None) -> dict[str, Finding]:
    which = np.zeros(len(values), dtype=int) if series is None else series
    return {each.name: each for each in check_innovations(values**2, values, which)}


def test_white_innovations_of_the_right_size_fit() -> None:
    rng = np.random.default_rng(1)
    for _ in range(5):
        found = told(rng.normal(size=N), np.arange(N) % 3)
        assert {name: each.fits for name, each in found.items()} == {
            "size": True, "colour": True, "whiteness": True,
        }  # fmt: skip


def test_the_bounds_of_the_size_are_those_of_many_squares() -> None:
    """By the central limit the mean of n squares is within 3.29 sqrt(2/n) of 1."""
    found = told(np.random.default_rng(1).normal(size=20_000))["size"]
    assert [found.low, found.high] == pytest.approx([1 - 0.0329, 1 + 0.0329], abs=2e-3)


@pytest.mark.parametrize(("factor", "says"), [(1.2, "too small"), (0.8, "too large")])
def test_innovations_of_another_size_are_told(factor: float, says: str) -> None:
    found = told(factor * np.random.default_rng(2).normal(size=N))["size"]
    assert found.fits is False
    assert says in found.says
    assert found.value == pytest.approx(factor**2, rel=0.1)


def test_coloured_innovations_are_told_whichever_series_they_are_of() -> None:
    """One of three series keeps half of its value from row to row."""
    rng = np.random.default_rng(3)
    values = rng.normal(size=(N, 3))
    for k in range(1, N):
        values[k, 1] = 0.5 * values[k - 1, 1] + np.sqrt(0.75) * values[k, 1]
    found = told(values.ravel(), np.tile(np.arange(3), N))
    assert found["size"].fits
    assert found["colour"].fits is False
    assert found["colour"].value == pytest.approx(0.5, abs=0.1)
    assert found["whiteness"].fits is False


def test_a_correlation_at_a_later_lag_is_seen_by_ljung_and_box_alone() -> None:
    values = np.random.default_rng(4).normal(size=N)
    later = values.copy()
    later[5:] = np.sqrt(0.5) * (values[5:] + values[:-5])
    found = told(later)
    assert found["colour"].fits
    assert found["whiteness"].fits is False


def test_a_series_that_changes_its_sign_at_every_step() -> None:
    """Its autocorrelations are (-1)^k, so that Q = (n + 2)/n * sum (n - k)."""
    n = 100
    values = (-1.0) ** np.arange(n)
    k = np.arange(1, 11)
    found = told(values)
    assert found["colour"].value == pytest.approx(-1.0)
    assert found["whiteness"].value == pytest.approx((n + 2) / n * np.sum(n - k))
    assert found["whiteness"].high == pytest.approx(chi2.isf(1e-3, 10))


def test_few_innovations_tell_nothing() -> None:
    assert [each.fits for each in told(np.ones(29)).values()] == [None]
    found = told(np.random.default_rng(5).normal(size=60), np.arange(60) % 3)
    assert {name: each.fits for name, each in found.items()} == {"size": True, "colour": None}


def test_outliers_are_counted_by_measurement() -> None:
    values = [np.zeros(2), np.array([0.0, 4.1]), np.array([3.9, 3.9]), np.zeros(1)]
    near = inside(values, [np.ones(len(value)) for value in values])
    assert near.tolist() == [True, False, True, True]
    found = check_outliers(near)
    assert (found.value, found.fits) == (0.25, False)
    assert check_outliers(np.arange(1000) >= 9).fits
    assert check_outliers(np.empty(0, dtype=bool)).fits


def test_errors_of_ten_seconds_count_as_one() -> None:
    """50 s of squares: five blocks of 4 degrees, chi-square of 20."""
    found = check_errors(np.full(250, 1.0), 4, 0.2)
    assert [found.low, found.high] == pytest.approx(chi2.ppf([5e-4, 1 - 5e-4], 20) / 20)
    assert found.fits
    assert check_errors(np.full(250, 6.0), 4, 0.2).fits is False
    assert check_errors(np.full(250, 0.05), 4, 0.2).fits is False
