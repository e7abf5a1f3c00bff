"""Metrics by hand, and the bootstrap of clusters against what is known of it."""

from __future__ import annotations

from itertools import product
from typing import Any

import numpy as np
import pytest
from hypothesis import given, strategies as st
from scipy.stats import norm

from inswsn_lib.errors import ParameterError
from inswsn_lib.evaluation import (
    cluster_interval,
    largest_error,
    mean_absolute_error,
    root_mean_square_error,
    spread,
)

ERRORS = np.array([[[3.0, 1.0]], [[-4.0, np.nan]], [[0.0, -1.0]]])


def test_errors_over_a_window_by_hand() -> None:
    assert mean_absolute_error(ERRORS)[0] == pytest.approx([7 / 3, 1])
    assert root_mean_square_error(ERRORS)[0] == pytest.approx([(25 / 3) ** 0.5, 1])
    assert largest_error(ERRORS)[0] == pytest.approx([4, 1])


def test_spread_of_a_ramp_and_of_too_few_runs() -> None:
    found = spread(np.vstack([np.arange(1001.0), -np.arange(1001.0)]))
    assert found.median == pytest.approx([500, -500])
    assert found.low == pytest.approx([25, -975])
    assert found.high == pytest.approx([975, -25])
    assert spread(np.zeros((2, 40))).low.tolist() == [0, 0]
    with pytest.raises(ParameterError, match="40 or more runs"):
        spread(np.zeros((2, 39)))
    with pytest.raises(ParameterError, match="values is of shape"):
        spread(np.zeros(40))


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


@pytest.mark.parametrize("statistic", ["mean", "median"])
def test_of_few_clusters_all_resamples_can_be_written_down(statistic: Any) -> None:
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


def covered(statistic: Any, clustered: bool, trials: int) -> float:
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
            statistic=statistic,
        )  # fmt: skip
        hits += low <= 0 <= high
    return hits / trials


def test_the_interval_holds_the_truth_in_95_of_100_cases() -> None:
    """Of 400, less three standard errors and 1 % by which 40 clusters are few.

    Without clusters the half-width is too small by the root of 1 + 4 / 2, and a share of
    2 Phi(1.96 / sqrt(3)) - 1 = 0.742 is held. Of the median 100 are tried.
    """
    error = np.sqrt(0.95 * 0.05 / 400)
    assert 0.94 - 3 * error < covered("mean", True, 400) < 0.95 + 3 * error
    ignored = 2 * norm.cdf(1.96 / np.sqrt(3)) - 1
    slack = 4 * np.sqrt(0.742 * 0.258 / 400)
    assert covered("mean", False, 400) == pytest.approx(ignored, abs=slack)
    assert 0.94 - 6 * error < covered("median", True, 100) <= 1


@given(st.floats(-100, 100), st.floats(0.01, 100), st.permutations(range(30)))
def test_moved_and_stretched_with_its_values_in_any_order(
    shift: float, scale: float, order: list[int]
) -> None:
    rng = np.random.default_rng(1)
    values, labels = rng.normal(size=30), np.array(list("abcdef"))[rng.integers(0, 6, 30)]
    for statistic in ("mean", "median"):
        options: dict[str, Any] = {"seed": 2, "statistic": statistic, "resamples": 100}
        plain = cluster_interval(values, labels, **options)
        moved = cluster_interval((shift + scale * values)[order], labels[order], **options)
        assert moved == pytest.approx(shift + scale * np.array(plain), abs=1e-9 * (1 + abs(shift)))
        assert plain[1] <= plain[0] <= plain[2]


@pytest.mark.parametrize(
    ("changed", "said"),
    [
        ({"values": np.zeros(9)}, "clusters is of shape"),
        ({"values": [*range(9), np.nan]}, "values is not finite"),
        ({"clusters": np.arange(10) % 4}, "clusters is .* of 5 kinds or more"),
        ({"statistic": "mode"}, 'statistic is .* "mean", "median"'),
        ({"resamples": 0}, "resamples is 0"),
    ],
)
def test_what_has_no_interval(changed: dict[str, Any], said: str) -> None:
    right: dict[str, Any] = {"values": np.zeros(10), "clusters": np.arange(10) % 5, "seed": 0}
    assert cluster_interval(**right, resamples=1) == (0, 0, 0)
    with pytest.raises(ParameterError, match=said):
        cluster_interval(**right | changed)
