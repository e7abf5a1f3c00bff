"""Tuning by trials: the best is found, and every trial is counted."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from inswsn_lib.errors import ParameterError
from inswsn_lib.evaluation import search_pattern, tune


def test_a_parabola_has_its_least_candidate_in_the_middle() -> None:
    seen: list[float] = []

    def loss(x: float) -> float:
        seen.append(x)
        return (x - 2) ** 2 + 1

    found = tune("parabola", [0, 1, 2.5, 4], loss)
    assert (found.name, found.best, found.loss, found.trials) == ("parabola", 2.5, 1.25, 4)
    assert seen == [0, 1, 2.5, 4]
    assert found.losses == pytest.approx([5, 2, 1.25, 5])


def test_the_first_of_equals_is_taken() -> None:
    assert tune("flat", [3, 1, 2], lambda _: 7.0).best == 3


@pytest.mark.parametrize(
    ("candidates", "value", "said"),
    [
        ([], 1.0, "candidates"),
        ([1, float("inf")], 1.0, "candidates"),
        ([1, 2], float("nan"), "at 1"),
    ],
)
def test_what_cannot_be_is_refused(candidates: list[float], value: float, said: str) -> None:
    with pytest.raises(ParameterError, match=said):
        tune("none", candidates, lambda _: value)


def bowl(x: float, y: float) -> float:
    """Least at 8 and 1/10, in logarithms."""
    return float(np.log2(x / 8) ** 2 + np.log10(y * 10) ** 2)


def test_a_pattern_search_ends_at_the_least_point_of_its_lattice() -> None:
    found = search_pattern("bowl", (1.0, 1.0), (2.0, 10.0), bowl, most=40)
    assert found.best == pytest.approx((8.0, 0.1))
    assert found.loss == pytest.approx(0.0)
    assert found.settled
    # three steps in x and one in y, with all neighbours on the way, each tried once
    assert len(set(found.points)) == found.trials < 20
    assert found.losses == tuple(bowl(*point) for point in found.points)


def test_a_pattern_search_ends_when_its_trials_do() -> None:
    found = search_pattern("bowl", (1.0, 1.0), (2.0, 10.0), bowl, most=6)
    assert found.trials == 6
    assert not found.settled
    assert found.points[0] == (1.0, 1.0)
    assert not search_pattern("one", (8.0, 0.1), (2.0, 10.0), bowl, most=1).settled


def test_a_pattern_search_goes_around_what_cannot_be_had() -> None:
    def walled(x: float) -> float:
        return np.inf if x > 3 else -x

    found = search_pattern("wall", (1.0,), (2.0,), walled)
    assert found.best == (2.0,)
    assert found.settled


def nan(*_: float) -> float:
    return float("nan")


@pytest.mark.parametrize(
    ("start", "ratios", "loss", "most", "complaint"),
    [
        ((1.0,), (2.0, 3.0), bowl, 9, "ratios is"),
        ((), (), bowl, 9, "ratios is"),
        ((0.0, 1.0), (2.0, 2.0), bowl, 9, "start is"),
        ((1.0, 1.0), (2.0, 1.0), bowl, 9, "ratios is"),
        ((1.0, 1.0), (2.0, 2.0), bowl, 0, "most is"),
        ((1.0, 1.0), (2.0, 2.0), nan, 9, "loss is"),
        ((1.0,), (2.0,), lambda _: float("inf"), 9, "loss is"),
    ],
)
def test_what_a_pattern_search_refuses(
    start: tuple[float, ...],
    ratios: tuple[float, ...],
    loss: Callable[..., float],
    most: int,
    complaint: str,
) -> None:
    with pytest.raises(ParameterError, match=complaint):
        search_pattern("bad", start, ratios, loss, most)
