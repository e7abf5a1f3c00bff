"""Ratios and normalised squares, against cases that are worked by hand."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from inswsn_lib.benchmark import Answer, Result, mean_ratio
from inswsn_lib.benchmark.running import Scored
from inswsn_lib.benchmark.scoring import Errors, errors_of
from inswsn_lib.evaluation import block_ratio

TRUTH = np.array([[0.0, 0.0, 1.0, 0.0], [1.0, 1.0, 1.0, 0.0]])


def test_errors_of_two_answers() -> None:
    """Errors 5 and 0 m, and 0 and 1 m/s; normalised squares 25/4 and 1/4 of four."""
    answers = [
        Answer([3.0, 4.0], [1.0, 0.0], np.eye(4)),
        Answer([1.0, 1.0], [1.0, 1.0], np.eye(4)),
    ]
    found = errors_of(answers, TRUTH)
    assert found.position.tolist() == [25.0, 0.0]
    assert found.rms == pytest.approx(np.sqrt(12.5))
    assert found.velocity == pytest.approx(np.sqrt(0.5))
    assert found.nees == pytest.approx((25 / 4 + 1 / 4) / 2)


def test_a_covariance_of_the_position_alone_judges_it_alone() -> None:
    answers = [Answer([2.0, 0.0], [9.0, 9.0], np.diag([4.0, 1.0]))] * 2
    assert errors_of(answers, np.zeros((2, 4))).nees == pytest.approx(0.5)


def test_normalised_squares_of_normal_errors_are_one() -> None:
    rng = np.random.default_rng(0)
    P = np.diag([4.0, 1.0, 0.25, 0.01]) + 0.005
    draws = rng.multivariate_normal(np.zeros(4), P, 4000)
    answers = [Answer(draw[:2], draw[2:], P) for draw in draws]
    # four standard errors of the mean of chi-square over its number
    assert errors_of(answers, np.zeros((4000, 4))).nees == pytest.approx(1, abs=4 / np.sqrt(8000))


def test_without_a_covariance_or_a_velocity_there_is_no_number() -> None:
    found = errors_of([Answer([0.0, 0.0], [0.0, 0.0], np.eye(2)), Answer([0.0, 0.0])], TRUTH)
    assert np.isnan([found.nees, found.velocity]).all()


def test_of_one_recording_the_ratio_is_that_of_the_block_bootstrap() -> None:
    rng = np.random.default_rng(1)
    mine, theirs = rng.chisquare(2, (2, 200))
    assert mean_ratio([(mine, theirs)], [1.0]) == pytest.approx(block_ratio(mine, theirs, 10))


def test_over_recordings_the_mean_is_geometric() -> None:
    rng = np.random.default_rng(2)
    squares = rng.chisquare(2, (4, 300))
    ratios = [np.sqrt(squares[i].sum() / squares[i + 1].sum()) for i in (0, 2)]
    ratio, low, high = mean_ratio([tuple(squares[:2]), tuple(squares[2:])], [0.5, 2.0])
    assert ratio == pytest.approx(np.sqrt(ratios[0] * ratios[1]))
    assert low < ratio < high
    # two recordings tell it better than one of them
    _, one_low, one_high = mean_ratio([tuple(squares[:2])], [0.5])
    assert high / low < one_high / one_low


def test_a_short_recording_has_shorter_blocks() -> None:
    assert mean_ratio([(np.ones(9), np.ones(9))], [1.0]) == (1.0, 1.0, 1.0)


def result(low: float, high: float, *nees: float) -> Result:
    judged = tuple(
        Scored("made", Errors(np.ones(3), 0.1, each), {}, (), 1.0, causal=True) for each in nees
    )
    return Result("mine", "network", "abc", 24, 0, judged, ("other",) * len(nees), 1.0, low, high)


@pytest.mark.parametrize(
    ("low", "high", "word"),
    [(0.9, 1.1, "level"), (1.0, 1.1, "level"), (0.8, 0.99, "ahead"), (1.01, 1.2, "behind")],
)
def test_the_word_follows_from_the_interval(low: float, high: float, word: str) -> None:
    assert result(low, high, 1.0).word == word


def test_consistency_is_asked_of_every_recording() -> None:
    assert result(1, 1, 0.5, 2.0).consistency == "consistent"
    assert result(1, 1, 1.0, 2.1).consistency == "inconsistent"
    assert result(1, 1, 0.4, 1.0).consistency == "inconsistent"
    assert result(1, 1, np.nan, 1.0).consistency == "no covariance"
    assert result(1, 1, 0.4, 1.5).nees == 0.4  # farther from 1, as a factor
    row = result(1, 1, np.nan).row()
    assert row["nees"] is None
    assert row["recordings"][0]["nees"] is None
    one = result(1, 1, 1.0).judged[0]
    assert not replace(result(1, 1, 1.0), judged=(replace(one, causal=False),)).causal
