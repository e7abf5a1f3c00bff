"""Intervals over clusters against Student's, Hall's cubic, and resamples that are written down."""

from __future__ import annotations

from itertools import product
from typing import Any

import numpy as np
import pytest
from hypothesis import given, strategies as st
from scipy.stats import norm, t

from inswsn_lib.errors import ParameterError
from inswsn_lib.evaluation import cluster_mean, cluster_median, cluster_share

GROUPS = [[0.0, 1.0], [4.0], [2.5, 3.5, 9.0], [-6.0, 0.5], [7.0, 7.5, 8.0, 1.5]]
LABELS = np.repeat(["d", "a", "c", "e", "b"], [len(g) for g in GROUPS])
VALUES = np.concatenate(GROUPS)
#: What five clusters stretch the bootstrap by.
STRETCH = np.sqrt(5 / 4) * t.ppf(0.975, 4) / norm.ppf(0.975)


def test_values_without_skewness_have_students_interval() -> None:
    values = np.array([-3.0, -1.0, -0.5, 0.5, 1.0, 3.0]) + 7
    for level in (0.8, 0.95, 0.999):
        found = cluster_mean(values, range(6), level=level)
        expected = t.interval(level, 5, loc=7, scale=values.std(ddof=1) / np.sqrt(6))
        assert found == pytest.approx((7, *expected), rel=1e-12)
    with pytest.raises(ParameterError, match="level"):
        cluster_mean(values, range(6), level=1.0)


def test_ends_are_students_or_where_halls_cubic_is_its_quantile_whatever_is_farther() -> None:
    """With the variance and the skewness of clusters of unequal size, as for a ratio of sums."""
    mean, low, high = cluster_mean(VALUES, LABELS)
    assert mean == pytest.approx(VALUES.mean())
    apart = np.array([sum(g) - mean * len(g) for g in GROUPS]) * 5 / len(VALUES)
    error = np.sqrt(np.sum(apart**2) / 4 / 5)
    bend = np.mean(apart**3) / np.mean(apart**2) ** 1.5
    assert bend < 0  # so that the cubic lowers both ends
    assert high == pytest.approx(mean + t.ppf(0.975, 4) * error)
    T = (mean - low) / error
    cubic = T + bend * T**2 / (3 * 5**0.5) + bend**2 * T**3 / (27 * 5) + bend / (6 * 5**0.5)
    assert cubic == pytest.approx(t.ppf(0.975, 4), rel=1e-9)


def test_more_skewness_than_that_of_a_single_value_is_not_believed() -> None:
    """One of a hundred clusters stands out: its skewness, 9.8, is held to 1.5."""
    mean, low, high = cluster_mean([1.0, *[0.0] * 99], range(100))
    error = np.std([1.0, *[0.0] * 99], ddof=1) / 10
    assert low == pytest.approx(mean - t.ppf(0.975, 99) * error)
    T = (mean - high) / error
    cubic = T + 1.5 * T**2 / 30 + 1.5**2 * T**3 / 2700 + 1.5 / 60
    assert cubic == pytest.approx(t.ppf(0.025, 99), rel=1e-9)


def test_a_share_of_what_is_always_two_is_half_of_the_mean() -> None:
    for sign in (1.0, -1.0):
        expected = np.sort(sign * np.array(cluster_mean(VALUES, LABELS)) / 2)[[1, 0, 2]]
        found = cluster_share(VALUES, np.full(len(VALUES), 2 * sign), LABELS)
        assert found == pytest.approx(expected, rel=1e-9)


def test_at_the_ends_of_a_share_the_rest_may_be_nothing() -> None:
    """Fieller's: in a - q b the mean is then just told from zero. Of what may be zero, no end."""
    whole = 5 + VALUES[::-1]
    share, low, high = cluster_share(VALUES, whole, LABELS)
    assert share == pytest.approx(VALUES.sum() / whole.sum())
    assert cluster_mean(VALUES - low * whole, LABELS)[1] == pytest.approx(0, abs=1e-9)
    assert cluster_mean(VALUES - high * whole, LABELS)[2] == pytest.approx(0, abs=1e-9)
    assert low < share < high
    assert cluster_share(np.ones(6), [1.0, -1.0, 1.0, -1.0, 1.0, -0.5], range(6))[2] == np.inf


def test_of_few_clusters_all_resamples_can_be_written_down() -> None:
    """Five clusters of unequal size have 3,125 resamples; 20,000 draws find their quantiles."""
    every = [
        np.median(np.concatenate([GROUPS[i] for i in row])) for row in product(range(5), repeat=5)
    ]
    median, *ends = cluster_median(VALUES, LABELS, seed=3, resamples=20_000)
    assert median == np.median(VALUES)
    # between the neighbours of the quantile, at 4 standard errors of its rank
    for end, share in zip(ends, (0.025, 0.975), strict=True):
        plain, slack = median + (end - median) / STRETCH, 4 * np.sqrt(0.025 * 0.975 / 20_000)
        assert np.quantile(every, share - slack) <= plain <= np.quantile(every, share + slack)


@given(st.floats(-100, 100), st.floats(0.01, 100), st.permutations(range(30)))
def test_moved_and_stretched_with_its_values_in_any_order(
    shift: float, scale: float, order: list[int]
) -> None:
    rng = np.random.default_rng(1)
    values, labels = rng.normal(size=30), np.array(list("abcdef"))[rng.integers(0, 6, 30)]

    def found(values: np.ndarray, labels: np.ndarray) -> list[tuple[float, float, float]]:
        return [cluster_mean(values, labels), cluster_median(values, labels, seed=2, resamples=100)]

    moved = found((shift + scale * values)[order], labels[order])
    for plain, other in zip(found(values, labels), moved, strict=True):
        assert other == pytest.approx(shift + scale * np.array(plain), abs=1e-9 * (1 + abs(shift)))
        assert plain[1] <= plain[0] <= plain[2]


@pytest.mark.parametrize(
    ("changed", "said"),
    [
        ({"values": np.zeros(9)}, "clusters .* not of shape"),
        ({"values": [*range(9), np.nan]}, "values .* not NaN or infinite"),
        ({"clusters": np.arange(10) % 4}, "clusters must be of at least 5 kinds"),
    ],
)
def test_what_has_no_interval(changed: dict[str, Any], said: str) -> None:
    right: dict[str, Any] = {"values": np.zeros(10), "clusters": np.arange(10) % 5}
    assert cluster_mean(**right) == (0, 0, 0)
    assert cluster_median(**right, seed=0, resamples=1) == (0, 0, 0)
    for interval in (cluster_mean, lambda **given: cluster_median(**given, seed=0)):
        with pytest.raises(ParameterError, match=said):
            interval(**right | changed)
    with pytest.raises(ParameterError, match=r"resamples .* not 0"):
        cluster_median(**right, seed=0, resamples=0)
