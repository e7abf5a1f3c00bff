"""Scores of many runs: numbers worked out by hand."""

from __future__ import annotations

import numpy as np
import pytest

from inswsn_lib.errors import ParameterError
from inswsn_lib.evaluation import Scores

# the variance of 101 evenly spaced numbers 1/100 apart is n (n+1) / (12 (n-1)^2)
DEVIATION = (101 * 102 / (12 * 100**2)) ** 0.5


def scores(one: float, two: float, count: int = 101) -> Scores:
    """Return evenly spread errors with these means."""
    spread = np.linspace(-0.5, 0.5, count)
    values = {
        "one.error": one + spread, "one.time": spread, "two.error": two + spread,
        "two.time": spread,
    }  # fmt: skip
    return Scores({"one": "the one", "two": "it"}, {"error": "m", "time": "s"}, values, "error")


def test_a_row_by_hand() -> None:
    table = scores(3.0, 4.0).table()
    assert list(zip(table["method"], table["column"], strict=True)) == [
        ("one", "error"), ("one", "time"), ("two", "error"), ("two", "time"),
    ]  # fmt: skip
    row = table.loc[2]
    assert (row["unit"], row["runs"]) == ("m", 101)
    assert (row["mean"], row["median"]) == pytest.approx((4.0, 4.0))
    assert (row["low"], row["high"]) == pytest.approx((3.525, 4.475))


def test_too_few_runs_have_no_interval() -> None:
    with pytest.raises(ParameterError):
        scores(3.0, 4.0, count=39).table()


def test_the_leader_and_its_lead() -> None:
    found = scores(4.0, 3.0).leader()
    assert (found.best, found.error, found.next) == ("two", pytest.approx(3.0), "one")
    # both are equally lucky in each run: the lead is certain
    assert found.lead == pytest.approx((25.0, 0.0))


def test_the_interval_of_a_lead() -> None:
    even = scores(4.0, 3.0)
    against = even.values | {"two.error": 3.0 - np.linspace(-0.5, 0.5, 101)}
    found = Scores(even.methods, even.columns, against, "error").leader()
    # differences 1 + 2 u: twice the deviation of u
    expected = 25 * 1.96 * 2 * DEVIATION / 101**0.5
    assert found.lead.within == pytest.approx(expected, rel=1e-9)


def test_one_method_leads_nobody() -> None:
    alone = Scores({"one": "the one"}, {"error": "m"}, {"one.error": np.arange(50.0)}, "error")
    assert alone.leader().next is None
    assert np.isnan(alone.leader().lead.percent)


@pytest.mark.parametrize(
    ("values", "headline"),
    [({"one.time": np.ones(50)}, "error"), ({"one.error": np.ones(50)}, "time")],
)
def test_values_of_others_are_refused(values: dict[str, np.ndarray], headline: str) -> None:
    with pytest.raises(ParameterError):
        Scores({"one": "the one"}, {"error": "m"}, values, headline)
