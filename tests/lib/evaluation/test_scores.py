"""Scores of many runs, and of hypotheses on cells: numbers worked out by hand."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from inswsn_lib.errors import ParameterError
from inswsn_lib.evaluation import Scores, paired_lead, score_hypothesis


def scores(one: float, two: float, count: int = 101) -> Scores:
    """Return evenly spread errors with these means."""
    spread = np.linspace(-0.5, 0.5, count)
    values = {
        "one.error": one + spread, "one.time": spread, "two.error": two + spread,
        "two.time": spread,
    }  # fmt: skip
    return Scores({"one": "the one", "two": "it"}, {"error": "m", "time": "s"}, values, "error")


def test_a_table_by_hand() -> None:
    table = scores(3.0, 4.0).table()
    assert list(zip(table["method"], table["column"], strict=True)) == [
        ("one", "error"), ("one", "time"), ("two", "error"), ("two", "time"),
    ]  # fmt: skip
    row = table.loc[2]
    assert (row["unit"], row["runs"]) == ("m", 101)
    assert row["mean":"high"].tolist() == pytest.approx([4.0, 4.0, 3.525, 4.475])
    with pytest.raises(ParameterError, match="40 or more"):
        scores(3.0, 4.0, count=39).table()


def test_the_leader_and_its_lead() -> None:
    even = scores(4.0, 3.0)
    found = even.leader()
    assert (found.best, found.error, found.next) == ("two", pytest.approx(3.0), "one")
    # both are equally lucky in each run: the lead is certain
    assert found.lead == pytest.approx((25.0, 0.0))
    assert (even.runs, even.of("two", "time")[0], even.of("two")[0]) == (101, -0.5, 2.5)
    alone = Scores({"one": "the one"}, {"error": "m"}, {"one.error": np.arange(50.0)}, "error")
    assert alone.leader().next is None
    assert np.isnan(alone.leader().lead.percent)


def test_the_interval_of_a_lead() -> None:
    # differences 2 + 2 u, u evenly spaced 1/100 apart, of variance n (n + 1) / (12 (n - 1)^2)
    u = np.linspace(-0.5, 0.5, 101)
    deviation = (101 * 102 / (12 * 100**2)) ** 0.5
    lead = paired_lead(2 - u, 4 + u)
    assert lead.percent == pytest.approx(50)
    assert lead.within == pytest.approx(25 * 1.96 * 2 * deviation / 101**0.5, rel=1e-9)
    with pytest.raises(ParameterError, match="others is of shape"):
        paired_lead(u, u[1:])


@pytest.mark.parametrize(
    ("values", "headline"),
    [({"one.time": np.ones(50)}, "error"), ({"one.error": np.ones(50)}, "time")],
)
def test_values_of_others_are_refused(values: dict[str, np.ndarray], headline: str) -> None:
    with pytest.raises(ParameterError, match="values is"):
        Scores({"one": "the one"}, {"error": "m"}, values, headline)


def test_a_hypothesis_by_hand() -> None:
    score = score_hypothesis([1.05, 0.95, 2.0], [1.0, 1.0, 4.0], free=1)
    assert score.ratios == pytest.approx([1.05, 0.95, 0.5])
    assert (score.met, score.explained, score.worst, score.free) == (2, False, 0.5, 1)
    assert score.spread == pytest.approx(
        np.sqrt((np.log(1.05) ** 2 + np.log(0.95) ** 2 + np.log(0.5) ** 2) / 3)
    )
    # within a tenth, and no farther; as many free numbers as cells explain nothing
    edge = score_hypothesis([1.099, 0.901, 1.101, 0.899], [1.0] * 4, free=0)
    assert (edge.met, edge.explained) == (2, False)
    for free, explained in ((1, True), (2, False)):
        assert score_hypothesis([1.0, 2.0], [1.0, 2.0], free=free).explained is explained


@pytest.mark.parametrize(
    ("rebuilt", "printed", "free", "said"),
    [
        ([1.0], [1.0, 2.0], 0, "printed is of shape"), ([], [], 0, "positive numbers"),
        ([0.0], [1.0], 0, "positive numbers"), ([1.0], [0.0], 0, "positive numbers"),
        ([1.0], [np.nan], 0, "printed is not finite"), ([1.0], [1.0], -1, "free is -1"),
    ],
)  # fmt: skip
def test_what_does_not_pair_is_refused(
    rebuilt: list[Any], printed: list[Any], free: int, said: str
) -> None:
    with pytest.raises(ParameterError, match=said):
        score_hypothesis(rebuilt, printed, free)
