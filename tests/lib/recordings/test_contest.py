"""Filters on one recording: pieces with known answers, a made recording, and INRoL's first."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from made_folders import needs
from made_recording import made, made_imu

from inswsn_lib import recordings
from inswsn_lib.errors import InswsnError
from inswsn_lib.inertial import Innovations, Solution
from inswsn_lib.recordings import RecordedContest
from inswsn_lib.recordings.difference_filters import FAMILIES, DifferenceFilters
from inswsn_lib.recordings.estimates import Estimate, lag_one, line_through, scores
from inswsn_lib.streams import Recording

COLOURED = "loosely coupled, coloured fixes"


def test_a_line_gives_position_and_velocity_of_a_straight_way_between_its_rows_alone() -> None:
    time = np.arange(0.0, 2.0, 0.02)
    track = np.column_stack([1 + 3 * time, 2 - time])
    found = line_through(time, track, np.array([0.5, 1.013, 3.0]), 0.075)
    assert found[:2] == pytest.approx(np.array([[2.5, 1.5, 3, -1], [4.039, 0.987, 3, -1]]))
    assert np.isnan(found[2]).all()


def test_scores_of_known_errors() -> None:
    # 3 and 4 cm, and 6 and 8 cm/s, against twice as much; the covariance is that of the errors
    n, error = 60, np.array([0.03, 0.04, 0.06, 0.08])
    P = np.tile(np.diag(error**2), (n, 1, 1))
    found = scores(
        Estimate(np.tile(error, (n, 1)), P), np.zeros((n, 4)), 2 * error + np.zeros((n, 4)), 1.0
    )
    assert (found["position"], found["velocity"]) == pytest.approx((0.05, 0.1))
    assert found["position_ratio"] == found["velocity_high"] == pytest.approx(0.5)
    assert found["nees"] == pytest.approx(1.0)


def test_lag_one_is_of_neighbours_of_one_series() -> None:
    # the first series alternates, the second is constant; together they would look white
    count = 101
    values = [np.array([(-1.0) ** k, 1.0]) for k in range(count)]
    told = Innovations(
        np.arange(float(count)), values, [np.ones(2)] * count, [np.ones(2, bool)] * count,
        np.ones(count),
    )  # fmt: skip
    solution = Solution(*[None] * 6, [told], 0.0, None, None)  # type: ignore[arg-type]
    found = lag_one(solution, np.tile([0, 1], count), -1.0)
    assert found == {"nis": 1.0, "lag1": pytest.approx(1.0)}
    alone = lag_one(solution, np.tile([0, 0], count), -1.0)
    assert alone["lag1"] < 0.02


@pytest.fixture(scope="module")
def drifting() -> DifferenceFilters:
    """An INS with a steady error of acceleration, and a network without an error."""
    time = 0.2 * np.arange(300)[:, None]
    true = np.hstack([np.sin(time), np.cos(time), np.cos(time), -np.sin(time)])
    drift = np.hstack([time**2 / 20, -(time**2) / 20, time / 10, -time / 10])
    return DifferenceFilters(true + drift, true, 0.2)


def test_the_published_filter_predicted_is_the_last_fix_carried_on_by_the_ins(
    drifting: DifferenceFilters,
) -> None:
    # what it leaves is the drift of one step: a T^2 / 2 and a T
    left = drifting.published.state[1:] - drifting.network[1:]
    assert left == pytest.approx(np.tile([0.002, -0.002, 0.02, -0.02], (299, 1)))


@pytest.mark.parametrize("name", FAMILIES)
def test_filters_of_differences_follow_a_drift_within_what_they_are_told(
    drifting: DifferenceFilters, name: str
) -> None:
    numbers = (10.0, 1.0, *FAMILIES[name].begin[2:])
    left = drifting.run(name, *numbers).state[50:] - drifting.network[50:]
    assert np.abs(left).max() < 0.05
    slow = drifting.run(name, 0.01, *numbers[1:]).state[50:] - drifting.network[50:]
    assert np.abs(slow).max() > 0.1


def made_walk(seed: int) -> Recording:
    return replace(made(seed, seconds=60.0, lasting=0.1), imu=made_imu(seed))


def test_on_a_made_recording_the_filters_beat_the_network_and_the_smoother_beats_them() -> None:
    contest = RecordedContest(made_walk(4), share=0.4, alignment=15.0, trials=1)
    table = contest.table()
    assert table.index[0] == "network alone"
    assert table.loc["network alone", ["position_ratio", "velocity_ratio"]].tolist() == [1.0, 1.0]
    assert table.loc[COLOURED, "velocity_ratio"] < 0.5
    assert table.loc["smoother", "position"] < table.loc[COLOURED, "position"]
    assert 0.3 < table.loc[COLOURED, "nees"] < 3
    assert not table.loc["smoother", "causal"]
    assert contest.compare("network alone", "network alone")["position"] == (1.0, 1.0, 1.0)
    # without the rest of the recording all is the same, but for the scale of the fixes' robust loss
    shorter = RecordedContest(
        contest.recording.part(end=45.0), share=0.4 * 60 / 45, alignment=15.0, trials=1
    )
    early = contest.fixes.time < 44
    both = [c.estimates[COLOURED].state[: early.sum()] for c in (contest, shorter)]
    assert both[0] == pytest.approx(both[1], abs=2e-3, nan_ok=True)


def test_what_is_missing_is_told() -> None:
    recording = made(5)
    with pytest.raises(InswsnError, match=r"^The recording made has no imu: "):
        RecordedContest(recording).table()
    with pytest.raises(InswsnError, match=r"has no reference: "):
        RecordedContest(replace(recording, imu=made_imu(5), reference=None)).table()


@needs("inrol/1")
def test_on_the_recorded_walk_one_causal_filter_meets_all_that_was_asked() -> None:
    contest = RecordedContest(recordings.load("inrol/1"))
    coloured = contest.contestants[COLOURED]
    contest.__dict__["contestants"] = {COLOURED: coloured}
    table = contest.table()
    row = table.loc[COLOURED]
    assert row["position_ratio"] <= 1.02
    assert row["velocity_ratio"] <= 0.7
    assert 0.4 <= row["nees"] <= 2.5
    assert row["lag1"] <= 0.3
    found = contest.compare("smoother", COLOURED)
    assert found["position"][2] < 1
    assert found["velocity"][2] < 1
    # P1's own form has no sure gain in position on this recording
    assert table.loc["KF", "position_high"] >= 1
