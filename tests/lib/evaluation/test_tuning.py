"""Tuning by trials: the best is found, and every trial is counted."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from scipy.optimize import brentq

from inswsn_lib.errors import ParameterError
from inswsn_lib.evaluation import Tuning, most_likely, search_pattern, tune


def test_every_candidate_is_tried_once_in_order() -> None:
    seen: list[float] = []

    def loss(x: float) -> float:
        seen.append(x)
        return (x - 2) ** 2 + 1

    found = tune("parabola", [0, 1, 2.5, 4], loss)
    assert found == Tuning("parabola", (0.0, 1.0, 2.5, 4.0), (5.0, 2.0, 1.25, 5.0), settled=True)
    assert (found.best, found.loss, found.trials) == (2.5, 1.25, 4)
    assert seen == [0, 1, 2.5, 4]
    assert tune("flat", [3, 1, 2], lambda _: 7.0).best == 3  # the first of equals


@pytest.mark.parametrize(
    ("candidates", "value", "said"),
    [
        ([], 1.0, "candidates must be"), ([1, float("inf")], 1.0, "candidates must be"),
        ([1, 2], float("nan"), "loss at 1 .* nan"), ([1, 2], float("inf"), "loss at 1 .* inf"),
    ],
)  # fmt: skip
def test_what_cannot_be_tuned(candidates: list[float], value: float, said: str) -> None:
    with pytest.raises(ParameterError, match=said):
        tune("none", candidates, lambda _: value)


def bowl(x: float, y: float) -> float:
    """Least at 8 and 1/10, in logarithms."""
    return float(np.log2(x / 8) ** 2 + np.log10(y * 10) ** 2)


def test_a_pattern_search_ends_at_the_least_point_of_its_lattice() -> None:
    found = search_pattern("bowl", (1.0, 1.0), (2.0, 10.0), bowl, most=40)
    assert found.best == pytest.approx((8.0, 0.1))
    assert found.settled
    # three steps in x and one in y, with all neighbours on the way, each tried once
    assert len(set(found.candidates)) == found.trials < 20
    assert found.losses == tuple(bowl(*point) for point in found.candidates)


def test_a_pattern_search_ends_when_its_trials_do() -> None:
    found = search_pattern("slope", [1.0], [2.0], lambda x: 1 / x, most=4)
    assert found.candidates == ((1.0,), (2.0,), (0.5,), (4.0,))
    assert (found.best, found.settled) == ((4.0,), False)
    assert search_pattern("slope", [1.0], [2.0], lambda x: 1 / x).trials == 16
    assert search_pattern("one", (8.0, 0.1), (2.0, 10.0), bowl, most=1).trials == 1
    assert not search_pattern("one", (8.0, 0.1), (2.0, 10.0), bowl, most=4).settled
    assert search_pattern("one", (8.0, 0.1), (2.0, 10.0), bowl, most=5).settled


@pytest.mark.parametrize(("drop", "settled"), [(1e-5, True), (1e-4, False)])
def test_a_flat_valley_is_no_way(drop: float, settled: bool) -> None:
    """Each step is better by a share; the least that was tried is the best either way."""
    found = search_pattern("valley", (1.0,), (2.0,), lambda x: (1 - drop) ** np.log2(x), most=9)
    assert found.settled is settled
    assert found.trials == (3 if settled else 9)
    assert found.best == ((2.0,) if settled else (128.0,))


def test_a_pattern_search_goes_around_what_cannot_be_had() -> None:
    def walled(x: float) -> float:
        return np.inf if x > 3 else -x

    found = search_pattern("wall", (1.0,), (2.0,), walled)
    assert (found.best, found.settled) == ((2.0,), True)


@pytest.mark.parametrize(
    ("start", "ratios", "loss", "most", "said"),
    [
        ((1.0,), (2.0, 3.0), bowl, 9, "ratios must be"), ((), (), bowl, 9, "start must be"),
        ((0.0, 1.0), (2.0, 2.0), bowl, 9, "start must be"),
        ((1.0, 1.0), (2.0, 1.0), bowl, 9, "ratios must be"),
        ((1.0, 1.0), (2.0, 2.0), bowl, 0, "most must be"),
        ((1.0,), (2.0,), lambda _: float("nan"), 9, r"loss .* not nan at \(1.0,\)"),
        ((1.0,), (2.0,), lambda _: float("inf"), 9, "loss .* not inf"),
        ((1.0,), (2.0,), lambda x: 1.0 if x == 1 else float("nan"), 9, r"loss .* nan at \(2.0,\)"),
    ],
)  # fmt: skip
def test_what_a_pattern_search_refuses(
    start: tuple[float, ...], ratios: Any, loss: Callable[..., float], most: int, said: str
) -> None:
    with pytest.raises(ParameterError, match=said):
        search_pattern("bad", start, ratios, loss, most)


def test_the_most_likely_size_is_between_the_data_and_the_prior() -> None:
    """With n values and the mean square q: n (q / s^2 - 1) = ln(s / s0) / ln(3)^2."""
    for n, square in ((3, 9.0), (1000, 0.04)):
        found = most_likely(
            "size", [1.0], lambda s, n=n, q=square: -n * np.log(s) - n * q / (2 * s**2)
        )
        right = brentq(
            lambda z, n=n, q=square: n * (q * np.exp(-2 * z) - 1) - z / np.log(3) ** 2, -9, 9
        )
        assert found.best[0] == pytest.approx(np.exp(right), rel=1e-3)
        assert found.settled


def test_in_a_valley_the_prior_decides_and_all_begins_end_there() -> None:
    """The data tell the product alone; each factor takes half of it, in logarithms."""
    told = []

    def valley(x: float, y: float) -> float:
        told.append((x, y))
        return float(-500 * np.log(x * y / 4) ** 2)

    found = most_likely("valley", [1.0, 1.0], valley, begins=4)
    assert found.trials == len(told) - 1  # at the begin it was asked once more, before the search
    ends = np.array(found.candidates)
    assert ends == pytest.approx(np.full((4, 2), 2.0), rel=2e-3)
    assert found.settled


def test_begins_that_end_apart_have_not_settled() -> None:
    def hills(x: float) -> float:
        """A low one at 1, and a high one at 5, which one begin of three is near to."""
        z = np.log(x)
        return float(50 * np.exp(-8 * z**2) + 90 * np.exp(-8 * (z - np.log(5)) ** 2))

    found = most_likely("hills", [1.0], hills)
    assert not found.settled
    assert found.best[0] == pytest.approx(5.0, rel=0.05)


def test_the_impossible_is_gone_around_but_no_place_to_begin() -> None:
    found = most_likely("wall", [1.0], lambda x: -np.inf if x > 5 else x)
    assert 1.5 < found.best[0] <= 5
    with pytest.raises(ParameterError, match=r"log_likelihood must be finite at the begin, not"):
        most_likely("bad", [1.0], lambda _: np.nan)
    for begin in ([], [0.0], [1.0, -2.0]):
        with pytest.raises(ParameterError, match="begin must be"):
            most_likely("bad", begin, lambda *_: 0.0)
