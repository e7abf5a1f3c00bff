"""Scores of many runs, and of hypotheses on cells: numbers worked out by hand."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from scipy.stats import norm

from inswsn_lib.errors import ParameterError
from inswsn_lib.evaluation import (
    Finding,
    Prediction,
    Scores,
    crps,
    paired_lead,
    quotient,
    score_hypothesis,
)


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
    assert row["mean":"high"].tolist() == pytest.approx([4.0, 4.0, 3.5155, 4.4845])
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


def test_a_ratio_whose_tuning_was_drawn() -> None:
    """All runs are alike, so that the interval is of the tuning alone: 1 as tuned, 1 to 3 drawn."""
    runs = np.ones(50)
    drawn = np.outer([1.0, 3.0, 2.0, 3.0], runs)
    assert quotient([drawn], [np.outer(np.ones(4), runs)], "1", "")[:3] == (1.0, 1.0, 3.0)
    assert Finding.of_runs(drawn, "1", "")[:3] == (1.0, 1.0, 3.0)


def test_the_interval_of_a_lead() -> None:
    # differences 2 + 2 u, u evenly spaced 1/100 apart, of variance n (n + 1) / (12 (n - 1)^2)
    u = np.linspace(-0.5, 0.5, 101)
    deviation = (101 * 102 / (12 * 100**2)) ** 0.5
    lead = paired_lead(2 - u, 4 + u)
    assert lead.percent == pytest.approx(50)
    assert lead.within == pytest.approx(25 * 1.98397 * 2 * deviation / 101**0.5, rel=1e-5)
    with pytest.raises(ParameterError, match=r"others .* not of shape"):
        paired_lead(u, u[1:])


@pytest.mark.parametrize(
    ("values", "headline"),
    [({"one.time": np.ones(50)}, "error"), ({"one.error": np.ones(50)}, "time")],
)
def test_values_of_others_are_refused(values: dict[str, np.ndarray], headline: str) -> None:
    with pytest.raises(ParameterError, match="values must be"):
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
        ([1.0], [1.0, 2.0], 0, "printed .* not of shape"), ([], [], 0, "positive numbers"),
        ([0.0], [1.0], 0, "positive numbers"), ([1.0], [0.0], 0, "positive numbers"),
        ([1.0], [np.nan], 0, "printed .* not NaN or inf"), ([1.0], [1.0], -1, "free .* not -1"),
    ],
)  # fmt: skip
def test_what_does_not_pair_is_refused(
    rebuilt: list[Any], printed: list[Any], free: int, said: str
) -> None:
    with pytest.raises(ParameterError, match=said):
        score_hypothesis(rebuilt, printed, free)


def test_the_score_of_a_normal_prediction_is_its_closed_form() -> None:
    # of N(m, s) at x: s (z (2 Phi(z) - 1) + 2 phi(z) - 1/sqrt(pi)), z = (x - m) / s
    quantiles = norm.ppf((np.arange(20_000) + 0.5) / 20_000)
    for mean, deviation, found in ((0.0, 1.0, 0.0), (1.0, 0.5, 2.0), (-3.0, 4.0, 1.0)):
        z = (found - mean) / deviation
        closed = deviation * (z * (2 * norm.cdf(z) - 1) + 2 * norm.pdf(z) - 1 / np.sqrt(np.pi))
        assert crps([mean + deviation * quantiles], [found]) == pytest.approx(closed, rel=1e-3)


def test_a_certain_prediction_is_scored_by_its_distance() -> None:
    predicted = np.full((2, 7), [[3.0], [-1.0]])
    assert crps(predicted, [5.0, -1.0]) == pytest.approx([2.0, 0.0])
    # all pairs, one by one
    drawn, found = np.array([4.0, 1.0, 2.5]), 2.0
    spread = np.mean([abs(a - b) for a in drawn for b in drawn])
    assert crps([drawn], [found])[0] == pytest.approx(np.mean(abs(drawn - found)) - spread / 2)


def test_the_score_is_proper() -> None:
    """Who says what is so has the least mean score, against one too wide and one too narrow."""
    rng = np.random.default_rng(8)
    found = rng.standard_normal(400)
    said = norm.ppf((np.arange(500) + 0.5) / 500)
    true, wide, narrow = (
        crps(np.tile(said * size, (400, 1)), found).mean() for size in (1.0, 2.0, 0.5)
    )
    assert true < wide
    assert true < narrow


def test_a_prediction_by_hand() -> None:
    even = np.linspace(0.0, 1.0, 1001)  # its 95 % are from 0.025 to 0.975
    prediction = Prediction(np.array([0.5 + even, 1 + even, 0.97 * 2**even]))
    assert prediction.interval[:, 0] == pytest.approx([0.525, 1.475])
    assert prediction.inside == 2
    widths = [1.475 / 0.525, 1.975 / 1.025, 2**0.95]
    assert prediction.width == pytest.approx(np.prod(widths) ** (1 / 3))
    assert prediction.scores == pytest.approx(crps(np.log(prediction.ratios), [0.0] * 3))
    assert prediction.score == pytest.approx(prediction.scores.mean())
    with pytest.raises(ParameterError, match="ratios"):
        Prediction(np.array([[1.0, 0.0]]))
    with pytest.raises(ParameterError, match="observed"):
        crps([[1.0, 2.0]], [1.0, 2.0])


def test_a_quotient_covers_what_it_says() -> None:
    """Of 200 ratios of medians of normal numbers, 95 % of intervals hold the true one, 0.5."""
    rng, held = np.random.default_rng(11), 0
    for _ in range(200):
        runs = 10 + rng.standard_normal((2, 101))
        found = quotient([runs[0]], [2 * runs[1]], "1", "Half of it.")
        held += found.low <= 0.5 <= found.high
    assert 0.90 <= held / 200 <= 0.99  # five standard deviations of a share of 0.95, and of 0.96
    assert quotient([runs[0], runs[0]], [runs[0]], "%", "Twice.").value == pytest.approx(200)


@pytest.mark.parametrize(
    ("low", "high", "level"),
    [
        (1.0, 1.0, True),
        (1 / 1.05, 1.05, True),
        (0.952, 1.05, False),  # 1/1.05 is 0.95238
        (0.96, 1.051, False),
        (0.5, 2.0, False),  # holds one, and tells nothing
        (1.06, 1.07, False),  # surely apart
        (float("nan"), 1.0, False),
    ],
)
def test_level_is_an_interval_within_a_twentieth_of_one(
    low: float, high: float, level: bool
) -> None:
    assert Finding(1.0, low, high, "1", "A ratio of two errors.").is_level is level
