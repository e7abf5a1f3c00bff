"""How late an IMU is, of recordings whose IMU is late by what is known."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from made_recording import made, made_drive, made_imu
from scipy.spatial.transform import Rotation
from scipy.stats import binom, t

from inswsn_lib.errors import InswsnError, ParameterError
from inswsn_lib.logs import imu_clock, slope_velocity
from inswsn_lib.streams import Fixes, Imu, Recording

MOUNTED = (0.05, -0.1, 1.5)


def with_imu(seed: int, clock: float = 0.03, jitter: float = 0.004) -> Recording:
    """A recording whose attitude has noise of its own, rad."""
    recording = made(seed, seconds=40)
    reference = recording.reference
    rng = np.random.default_rng(seed)
    off = Rotation.from_rotvec(jitter * rng.normal(size=(len(reference), 3)))
    noisy = (Rotation.from_quat(reference.attitude) * off).as_quat()
    imu = made_imu(seed, seconds=40, clock=clock, mounted=MOUNTED)
    return replace(recording, reference=replace(reference, attitude=noisy), imu=imu)


def test_offset_and_rotation_are_found_as_well_as_told() -> None:
    """Of 12 seeds, intervals of 95 % miss more only once in 10 000 times, for each of four."""
    missed = []
    for seed in range(12):
        found = imu_clock(with_imu(seed))
        assert found.by == "attitude"
        off = Rotation.from_matrix(found.rotation) * Rotation.from_rotvec(MOUNTED).inv()
        errors = np.append(found.offset - 0.03, off.as_rotvec())
        deviations = np.append(found.deviation, found.rotation_deviation)
        missed.append(np.abs(errors) > t.ppf(0.975, found.blocks - 1) * deviations)
        assert found.deviation < 0.003
        assert found.rotation_deviation.max() < 0.01
        assert found.gyro_bias == pytest.approx(0.01, abs=0.005)
    assert np.sum(missed, axis=0).max() <= binom.isf(1e-4 / 4, 12, 0.05)
    assert np.mean(missed) < 0.15


def test_what_was_found_is_made_good() -> None:
    recording = with_imu(3, jitter=0.0)
    right = imu_clock(recording).apply(recording)
    again = imu_clock(right)
    assert again.offset == pytest.approx(0.0, abs=1e-4)
    assert Rotation.from_matrix(again.rotation).magnitude() < 2e-3
    plain = made_imu(3, seconds=40)  # neither late nor turned
    np.testing.assert_allclose(right.imu.time, plain.time, atol=2e-3)
    assert np.median(np.abs(right.imu.force - plain.force)) < 0.1


@pytest.mark.parametrize("clock", [-0.8, -0.05, 0.0, 0.6])
def test_also_an_offset_of_most_of_a_second_is_found(clock: float) -> None:
    assert imu_clock(with_imu(1, clock=clock)).offset == pytest.approx(clock, abs=0.003)


def test_jumps_of_the_attitude_do_not_lead_astray() -> None:
    """One stamp in a hundred is turned by half a turn, as where markers are exchanged."""
    recording = with_imu(5)
    reference = recording.reference
    attitude = Rotation.from_quat(reference.attitude).as_quat()
    flip = Rotation.from_rotvec([np.pi, 0, 0])
    attitude[::100] = (Rotation.from_quat(attitude[::100]) * flip).as_quat()
    found = imu_clock(replace(recording, reference=replace(reference, attitude=attitude)))
    assert found.offset == pytest.approx(0.03, abs=0.01)


def level_drive(seed: int, clock: float) -> Recording:
    """A vehicle whose IMU, tilted by 10 degrees, feels its heading rate."""
    drive = made_drive(seed)
    odometry, rng = drive.odometry, np.random.default_rng(seed)
    assert odometry is not None
    time = np.arange(0.0, 119.0, 0.01)
    up = Rotation.from_rotvec([0.17, 0.0, 0.0]).apply([0.0, 0.0, 1.0])
    rate = (0.4 * np.sin(0.17 * time) + 0.2)[:, None] * up + 0.02
    rate = rate + 0.01 * rng.normal(size=rate.shape)
    force = 9.8 * up + 0.1 * rng.normal(size=rate.shape)
    return replace(drive, imu=Imu(time + clock, rate, force))


def test_a_body_that_turns_about_the_vertical_alone_is_compared_by_its_heading() -> None:
    found = imu_clock(level_drive(1, 0.04))
    assert found.by == "heading"
    assert found.rotation is None
    assert np.isnan(found.rotation_deviation).all()
    assert abs(found.offset - 0.04) < 4 * found.deviation
    assert found.deviation < 0.01


def test_a_course_tells_the_clock() -> None:
    """The course of velocities, by positions of the reference or by fixes."""
    drive = level_drive(2, -0.06)
    reference = drive.reference
    headless = replace(drive, reference=replace(reference, attitude=None))
    found = imu_clock(headless)
    assert found.by == "course"
    assert abs(found.offset + 0.06) < 4 * found.deviation + 0.005
    noise = np.random.default_rng(0).normal(0, 0.001, reference.position.shape)
    fixes = slope_velocity(Fixes(reference.time, reference.position + noise), 3)
    by_fixes = imu_clock(replace(headless, reference=None, fixes=fixes))
    # a slope over three fixes is a period late
    assert abs(by_fixes.offset + 0.06 + 0.1) < 4 * by_fixes.deviation + 0.005
    slow = replace(reference, position=0.01 * reference.position, attitude=None)
    with pytest.raises(InswsnError, match="never moves at 1 m/s"):
        imu_clock(replace(drive, reference=slow))


def test_what_cannot_be_told_is_refused() -> None:
    still = made(1, still=True, seconds=40)
    rng = np.random.default_rng(0)
    size = (4000, 3)
    imu = Imu(np.arange(0, 40, 0.01), 0.01 * rng.normal(size=size), np.ones(size))
    with pytest.raises(
        InswsnError, match=r"0% of the variance of its rates is explained: it turns too little"
    ):
        imu_clock(replace(still, imu=imu))
    with pytest.raises(InswsnError, match="has no IMU"):
        imu_clock(still)
    with pytest.raises(InswsnError, match="neither a reference nor fixes, by which"):
        imu_clock(Recording("alone", imu=imu))
    with pytest.raises(InswsnError, match="share too little time"):
        imu_clock(replace(still, imu=Imu(imu.time + 500, imu.rate, imu.force)))
    mirrored = with_imu(1)
    other = replace(mirrored.imu, rate=mirrored.imu.rate * [1.0, 1.0, -1.0])
    with pytest.raises(InswsnError, match="has other axes, or is of another run"):
        imu_clock(replace(mirrored, imu=other))
    with pytest.raises(ParameterError):
        imu_clock(mirrored, limit=0.0)
