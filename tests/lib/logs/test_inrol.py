"""Ranges of a tag, an IMU and motion capture: made files, spoilt ones and the original."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from made_folders import HALF, make_inrol, needs
from scipy.spatial.transform import Rotation

from inswsn_lib import logs
from inswsn_lib.logs.radio_kinds import read_inrol
from inswsn_lib.streams import Recording


def test_made_files_are_read_as_they_are(tmp_path: Path) -> None:
    make_inrol(tmp_path)
    read = read_inrol(tmp_path)
    assert read.imu is not None
    assert read.imu.time.tolist() == [0.0, 0.01, 0.02, 0.03, 0.04]
    assert read.imu.rate[3].tolist() == [0.1, 0.2, 0.3]
    assert read.imu.force[3].tolist() == [0.0, 0.0, 9.8]
    assert read.reference is not None
    assert read.reference.position[2].tolist() == [1, 2, 2]
    assert read.reference.attitude is not None
    assert np.array_equal(read.reference.attitude, np.tile([0, 0, HALF, HALF], (6, 1)))
    assert read.lever_arm.tolist() == [0, 0, 0.01]
    assert list(read.streams) == ["imu", "ranges", "reference"]


def test_a_late_range_is_put_in_its_place(tmp_path: Path) -> None:
    make_inrol(tmp_path)
    ranges = read_inrol(tmp_path).ranges
    assert ranges is not None
    assert ranges.time.tolist() == [0.001, 0.001, 0.019, 0.02, 0.03]
    assert ranges.distance.tolist() == [3.0, 2.0, 3.5, 1.0, 2.5]
    assert ranges.names == ("7", "2", "4")
    assert [ranges.names[i] for i in ranges.anchor] == ["7", "4", "7", "2", "4"]
    assert ranges.anchors.tolist() == [[1, 2, 0.5], [-1, 2, 2.5], [0, -2, 1.5]]


# --- the original ---


@pytest.fixture(scope="module")
def inrol() -> Recording:
    return logs.load("inrol/1")


@needs("inrol/1")
def test_ranges_are_distances_to_the_tag(inrol: Recording) -> None:
    """As the study of radio fixes found them: a median of -5 mm, and 10 cm of deviation."""
    ranges, reference = inrol.ranges, inrol.reference
    assert ranges is not None
    assert reference is not None
    tag = reference.position + Rotation.from_quat(reference.attitude).apply(inrol.lever_arm)
    at = np.column_stack([np.interp(ranges.time, reference.time, x) for x in tag.T])
    error = ranges.distance - np.linalg.norm(at - ranges.anchors[ranges.anchor], axis=1)
    assert np.median(error) == pytest.approx(-0.0053, abs=2e-4)
    assert np.median(np.abs(error)) == pytest.approx(0.066, abs=1e-3)


@needs("inrol/1")
def test_the_axes_of_the_imu_are_those_of_the_reference(inrol: Recording) -> None:
    """The mean force is upwards in the room, and the gyroscope turns as the motion capture does."""
    imu, reference = inrol.imu, inrol.reference
    assert imu is not None
    assert reference is not None
    nearest = np.searchsorted(reference.time, imu.time).clip(max=len(reference) - 1)
    attitude = Rotation.from_quat(reference.attitude)
    up = attitude[nearest].apply(imu.force).mean(axis=0)
    assert up == pytest.approx([0.0, 0.0, 9.81], abs=0.05)
    rows = np.searchsorted(reference.time, np.arange(1.0, 190.0, 0.2))
    turned = (attitude[rows[:-1]].inv() * attitude[rows[1:]]).as_rotvec()
    sums = np.vstack([np.zeros(3), np.cumsum(imu.rate[:-1] * np.diff(imu.time)[:, None], axis=0)])
    at = np.column_stack([np.interp(reference.time[rows], imu.time, x) for x in sums.T])
    # the capture tells another attitude for a row or two, now and then
    assert np.median(np.abs(turned - np.diff(at, axis=0)), axis=0).max() < 0.005
    assert np.median(np.abs(turned), axis=0).min() > 0.01
