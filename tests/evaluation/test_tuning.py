"""Tuning by trials: the best is found, and every trial is counted."""

from __future__ import annotations

import pytest

from inswsn_lib.errors import ParameterError
from inswsn_lib.evaluation import tune


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
