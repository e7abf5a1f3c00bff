"""Odometry, ranges and filters of both on a plane: made drives, and two recordings."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from made_folders import needs
from made_recording import YARD, made_drive

from inswsn_lib import recordings
from inswsn_lib.errors import InswsnError
from inswsn_lib.inertial import (
    OdometryMotion,
    OdometryNoise,
    RangesToAnchors,
    align_planar,
)
from inswsn_lib.recordings import PlanarContest
from inswsn_lib.streams import Odometry

TIGHT = "tightly coupled, biases and a scale"


def test_the_heading_is_found_from_all_directions() -> None:
    drive = made_drive(1, seconds=20.0)
    assert drive.odometry is not None
    assert drive.ranges is not None
    assert drive.reference is not None
    assert drive.reference.attitude is not None
    motion = OdometryMotion(drive.odometry, OdometryNoise(0.05, 0.02, 1e-3, 1e-4))
    place = drive.reference.position[0]
    *_, z, w = drive.reference.attitude[-1]
    true = 2 * np.arctan2(z, w)
    for turned in np.arange(4) * np.pi / 2:  # the whole yard is turned, the odometry is not
        R = np.array([[np.cos(turned), -np.sin(turned)], [np.sin(turned), np.cos(turned)]])
        ranges = replace(drive.ranges, anchors=YARD @ R.T)
        heard = RangesToAnchors(ranges, np.zeros(2), white=0.1)
        start = align_planar(motion, [heard], 0.0, 19.9, R @ place)
        off = start.state.heading - true - turned
        assert np.angle(np.exp(1j * off)) == pytest.approx(0.0, abs=0.05)
        assert abs(np.angle(np.exp(1j * off))) < 4 * np.sqrt(start.covariance[2, 2])


def test_who_stands_still_has_no_heading() -> None:
    drive = made_drive(2, seconds=20.0)
    assert drive.odometry is not None
    assert drive.ranges is not None
    still = Odometry(drive.odometry.time, 0 * drive.odometry.speed, 0 * drive.odometry.rate)
    motion = OdometryMotion(still, OdometryNoise(0.001, 0.001, 1e-3, 1e-4))
    heard = RangesToAnchors(drive.ranges, np.zeros(2), white=10.0)
    with pytest.raises(InswsnError, match=r"^The heading cannot be told between 0 and 19.9 s"):
        align_planar(motion, [heard], 0.0, 19.9, np.zeros(2))


def test_on_a_made_drive_both_together_beat_each_alone() -> None:
    contest = PlanarContest(made_drive(3), period=0.5, trials=1)
    table = contest.table()
    assert table.loc[TIGHT, "position_high"] < 1
    assert table.loc[TIGHT, "position"] < table.loc["odometry alone", "position"]
    assert table.loc["smoother", "position"] < table.loc[TIGHT, "position"]
    assert table.loc[TIGHT, "lag1"] < 0.3
    assert not table.loc["smoother", "causal"]


def test_a_scale_of_all_ranges_is_found() -> None:
    drive = made_drive(4)
    assert drive.ranges is not None
    longer = replace(drive, ranges=replace(drive.ranges, distance=1.05 * drive.ranges.distance))
    contest = PlanarContest(longer, period=0.5, trials=1)
    scale = contest.solutions[TIGHT].states[-1].own[0]
    assert scale == pytest.approx(0.05, abs=0.01)
    assert contest.table().loc[TIGHT, "position_high"] < 0.5


@needs("labyrinth/1")
def test_in_the_labyrinth_ranges_do_not_better_its_odometry_in_half_a_minute() -> None:
    table = PlanarContest(recordings.load("labyrinth/1"), alignment=5.0).table()
    assert table.loc["odometry alone", "position_high"] < 1
    assert table.loc[TIGHT, "position_high"] < 0.5
    assert 0.3 < table.loc[TIGHT, "nees"] < 2.5
