"""The one type of recordings: what its streams ask for, and parts of it."""

from __future__ import annotations

import numpy as np
import pytest

from inswsn_lib.errors import InswsnError
from inswsn_lib.streams import Fixes, Imu, Odometry, Ranges, Recording, Reference


def walk() -> Recording:
    imu = Imu(time=np.arange(0.0, 5.0, 0.5), rate=np.zeros((10, 3)), force=np.ones((10, 3)))
    ranges = Ranges(np.array([0.25, 0.25, 6.0]), np.array([0, 1, 0]), np.array([1.0, 2.0, 3.0]),
                    np.eye(2), ("A", "B"))  # fmt: skip
    fixes = Fixes(time=np.array([1.0, 2.0]), position=np.zeros((2, 2)), good=np.ones(2, bool))
    return Recording("walk", imu=imu, ranges=ranges, fixes=fixes)


def test_a_recording_spans_all_its_streams() -> None:
    assert walk().span == (0.0, 6.0)
    assert walk().duration == 6.0
    assert [*walk().streams] == ["imu", "ranges", "fixes"]
    with pytest.raises(InswsnError, match="The recording nothing is empty"):
        Recording("nothing").span  # noqa: B018


def test_a_part_begins_with_its_begin_and_ends_before_its_end() -> None:
    part = walk().part(0.25, 2.0)
    assert part.imu is not None
    assert part.imu.time.tolist() == [0.5, 1.0, 1.5]
    assert part.imu.force.shape == (3, 3)
    assert part.ranges is not None
    assert part.ranges.distance.tolist() == [1.0, 2.0]
    assert part.ranges.names == ("A", "B")  # all anchors stay
    assert part.fixes is not None
    assert part.fixes.good is not None
    assert part.fixes.good.tolist() == [True]
    assert part.fixes.velocity is None


def test_streams_can_be_left_out() -> None:
    assert [*walk().without("imu", "fixes", "reference").streams] == ["ranges"]
    with pytest.raises(InswsnError, match='stream must be one of "imu", "odom'):
        walk().without("name")


def test_streams_ask_for_a_row_for_each_time_that_increases() -> None:
    with pytest.raises(InswsnError, match="force must be of 3 rows, as time is"):
        Imu(time=np.arange(3.0), rate=np.zeros((3, 3)), force=np.zeros((2, 3)))
    with pytest.raises(InswsnError, match="Odometry: the time stamp repeats in row 3; time"):
        Odometry(time=np.array([0.0, 1.0, 1.0]), speed=np.zeros(3), rate=np.zeros(3))
    with pytest.raises(InswsnError, match=r"Reference: .* goes back by 0\.5 s in row 2"):
        Reference(time=np.array([0.0, -0.5]), position=np.zeros((2, 2)))
