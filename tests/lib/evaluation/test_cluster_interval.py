"""The bootstrap of clusters: by hand, against the normal law, and how often it holds the truth."""

from __future__ import annotations

from itertools import product

import numpy as np
import pytest
from hypothesis import given, strategies as st
from scipy.stats import norm

from inswsn_lib.errors import ParameterError
from inswsn_lib.evaluation import cluster_interval


@given(st.floats(-1e6, 1e6), st.integers(5, 12), st.integers(1, 4), st.booleans())
def test_equal_values_give_a_point(value: float, clusters: int, size: int, mean: bool) -> None:
    labels = np.repeat(np.arange(clusters), size)
    found = cluster_interval(
        np.full(len(labels), value), labels, seed=0, statistic="mean" if mean else "median",
        resamples=50,
    )  # fmt: skip
    assert found == pytest.approx((value,) * 3, rel=1e-12, abs=1e-12)


def test_one_value_a_cluster_is_the_ordinary_bootstrap() -> None:
    """400 values: mean plus and minus 1.96 deviations (of the sample) over the root of 400.

    The quantiles of 20,000 resamples are within 1.5 % of the width (4 standard errors).
    """
    values = np.random.default_rng(2).gamma(3, 2, 400)
    mean, low, high = cluster_interval(values, np.arange(400), seed=1, resamples=20_000)
    error = values.std() / 20
    assert mean == pytest.approx(values.mean())
    assert (low, high) == pytest.approx(
        (mean + norm.ppf(0.025) * error, mean + norm.ppf(0.975) * error), abs=0.12 * error
    )


def test_clusters_of_equal_size_are_the_bootstrap_of_their_means() -> None:
    rng = np.random.default_rng(6)
    means = rng.normal(size=30)
    values = (means[:, None] + rng.normal(size=(30, 8))).ravel()
    whole = cluster_interval(values, np.repeat(np.arange(30), 8), seed=9)
    alone = cluster_interval(values.reshape(30, 8).mean(axis=1), np.arange(30), seed=9)
    assert whole == pytest.approx(alone)


@pytest.mark.parametrize("statistic", ["mean", "median"])
def test_of_few_clusters_all_resamples_can_be_written_down(statistic: str) -> None:
    """Five clusters of unequal size have 3,125 resamples; 20,000 draws find their quantiles.

    A cluster of more values counts for more.
    """
    groups = [[0.0, 1.0], [4.0], [2.5, 3.5, 9.0], [-6.0, 0.5], [7.0, 7.5, 8.0, 1.5]]
    labels = np.repeat(["d", "a", "c", "e", "b"], [len(g) for g in groups])
    values = np.concatenate(groups)
    how = np.mean if statistic == "mean" else np.median
    every = [how(np.concatenate([groups[i] for i in row])) for row in product(range(5), repeat=5)]
    found = cluster_interval(values, labels, seed=3, statistic=statistic, resamples=20_000)
    assert found[0] == how(values)
    # between the neighbours of the quantile, at 4 standard errors of its rank
    for end, share in zip(found[1:], (0.025, 0.975), strict=True):
        slack = 4 * np.sqrt(share * (1 - share) / 20_000)
        assert np.quantile(every, share - slack) <= end <= np.quantile(every, share + slack)


def covered(statistic: str, clustered: bool, trials: int = 400) -> float:
    """Return how often the interval holds the truth, zero.

    40 clusters of five, half of the variance between them.
    """
    rng = np.random.default_rng(77)
    labels = np.repeat(np.arange(40), 5)
    hits = 0
    for trial in range(trials):
        values = rng.normal(size=40)[labels] + rng.normal(size=200)
        _, low, high = cluster_interval(
            values, labels if clustered else np.arange(200), seed=trial, resamples=400,
            statistic=statistic,  # type: ignore[arg-type]
        )  # fmt: skip
        hits += low <= 0 <= high
    return hits / trials


def test_the_interval_holds_the_truth_in_95_of_100_cases() -> None:
    """Of 400, less three standard errors and 1 % by which 40 clusters are few.

    Without clusters the half-width is too small by the root of 1 + 4 / 2, and a share of
    2 Phi(1.96 / sqrt(3)) - 1 = 0.742 is held.
    """
    error = np.sqrt(0.95 * 0.05 / 400)
    assert 0.94 - 3 * error < covered("mean", True) < 0.95 + 3 * error
    ignored = 2 * norm.cdf(1.96 / np.sqrt(3)) - 1
    assert covered("mean", False) == pytest.approx(ignored, abs=4 * np.sqrt(0.742 * 0.258 / 400))


def test_the_interval_of_the_median_holds_it_too() -> None:
    error = np.sqrt(0.95 * 0.05 / 100)
    assert 0.94 - 3 * error < covered("median", True, 100) <= 1
    assert covered("median", False, 100) < 0.9


def test_the_median_is_not_moved_by_one_that_is_far_off() -> None:
    values = np.random.default_rng(4).normal(size=60)
    far = values.copy()
    far[np.argmax(far)] = 1e9
    labels = np.repeat(np.arange(20), 3)
    plain = cluster_interval(values, labels, seed=5, statistic="median")
    assert cluster_interval(far, labels, seed=5, statistic="median") == plain
    assert cluster_interval(far, labels, seed=5)[0] > 1e6
    assert plain[0] == np.median(values)


@given(st.floats(-100, 100), st.floats(0.01, 100))
def test_moved_and_stretched_with_its_values(shift: float, scale: float) -> None:
    rng = np.random.default_rng(1)
    values, labels = rng.normal(size=30), rng.integers(0, 6, 30)
    for statistic in ("mean", "median"):
        plain = cluster_interval(values, labels, seed=2, statistic=statistic, resamples=100)
        moved = cluster_interval(
            shift + scale * values, labels, seed=2, statistic=statistic, resamples=100
        )
        assert moved == pytest.approx(shift + scale * np.array(plain), abs=1e-9 * (1 + abs(shift)))
        assert plain[1] <= plain[0] <= plain[2]


def test_labels_are_names_and_the_order_of_values_does_not_matter() -> None:
    rng = np.random.default_rng(8)
    values, labels = rng.normal(size=40), rng.integers(0, 7, 40)
    order = rng.permutation(40)
    plain = cluster_interval(values, labels, seed=3)
    assert cluster_interval(values[order], labels[order], seed=3) == pytest.approx(plain)
    named = np.array(list("abcdefg"))[labels]
    assert cluster_interval(values, named, seed=3) == plain
    assert cluster_interval(values, labels, seed=4) != plain


@pytest.mark.parametrize(
    ("values", "clusters", "what"),
    [
        (np.zeros(10), np.zeros(9), "values"),
        (np.zeros((5, 2)), np.zeros((5, 2)), "values"),
        (np.array([0, 1, 2, 3, np.nan]), np.arange(5), "finite"),
        (np.array([0, 1, 2, 3, np.inf]), np.arange(5), "finite"),
        (np.zeros(10), np.arange(10) % 4, "4 of them.*5 or more"),
        (np.zeros(0), np.zeros(0), "clusters"),
    ],
)
def test_what_has_no_interval(values: np.ndarray, clusters: np.ndarray, what: str) -> None:
    with pytest.raises(ParameterError, match=what):
        cluster_interval(values, clusters, seed=0)


def test_another_statistic() -> None:
    with pytest.raises(ParameterError, match="mean or median"):
        cluster_interval(np.zeros(9), np.arange(9), seed=0, statistic="mode")  # type: ignore[arg-type]
