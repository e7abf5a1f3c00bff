"""The noise of an IMU, multiplied by a known factor, is found again."""

from __future__ import annotations

from dataclasses import fields, replace
from functools import cache

import numpy as np
import pytest
from hypothesis import given, strategies as st
from lib.vehicle.made_drive import DV, KNOWN, PERIOD, THETA, TURN, driven

from inswsn_lib.errors import ParameterError
from inswsn_lib.vehicle import (
    FilterSettings,
    RecordedDrive,
    calibrate_inertial_noise,
    emulate_sensors,
    run_vehicle_filter,
)
from inswsn_lib.vehicle.calibration import LEVELS, louder
from inswsn_lib.vehicle.recorded import Track

#: White noise that GPS velocity of 0.05 m/s can see in one second
TOLD = replace(
    KNOWN,
    accelerometer_noise=0.1,
    gyro_noise=float(np.deg2rad(0.3)),
    accelerometer_walk=1e-5,
    gyro_walk=1e-6,
)
ROWS, RUNS = (20, 80), 4


@cache
def recording(level: float) -> RecordedDrive:
    """A recording whose IMU has `level` times the noise that the settings tell."""
    made, rng = driven(90), np.random.default_rng(14)
    epochs = made.trajectory.iloc[::100]
    position = np.column_stack([np.deg2rad(epochs.lat), np.deg2rad(epochs.lon), epochs.alt])
    velocity = epochs[["VN", "VE", "VD"]].to_numpy() @ TURN
    time = np.arange(len(epochs)) * 1.0
    theta, dv = (
        made.increments[names].to_numpy()
        + level * noise * np.sqrt(PERIOD) * rng.normal(size=(len(made.increments), 3))
        for names, noise in ((THETA, TOLD.gyro_noise), (DV, TOLD.accelerometer_noise))
    )
    track = Track(time, position, velocity, np.ones(len(time), dtype=np.int64))
    return RecordedDrive(0.0, time, PERIOD, theta, dv, position, velocity, track)


@pytest.mark.parametrize("level", [0.5, 3.0])
def test_the_factor_is_found_again(level: float) -> None:
    """61 seconds of 3 components: the mean square is 1 within 0.1 (1 sigma), levels are 3 apart.

    The runs share the IMU, whose noise is most of the innovation, so they are not counted.
    """
    levels = (level / 3, level, 3 * level)
    settings, means = calibrate_inertial_noise(
        recording(level), TOLD, ROWS, runs=RUNS, seed=3, levels=levels
    )
    assert settings == louder(TOLD, level)
    assert list(means) == list(levels)
    assert means[level] == pytest.approx(1, abs=4 * np.sqrt(2 / (61 * 3)))
    # what is expected to be noisier surprises less
    assert means[levels[0]] > means[level] > means[levels[2]]


def test_the_mean_is_that_of_velocity_innovations_in_the_rows() -> None:
    """Written out in loops for one level, from a run of the filter."""
    drive = emulate_sensors(recording(3.0), runs=2, seed=5)
    run = run_vehicle_filter(drive, louder(TOLD, 2.0), aiding=False)
    squares = [
        run.innovations[k, i, r] ** 2 / run.innovation_covariances[k, i, i, r]
        for k in range(30, 51)
        for i in (5, 6, 7)
        for r in range(2)
    ]
    settings, means = calibrate_inertial_noise(
        recording(3.0), TOLD, (30, 50), runs=2, seed=5, levels=[2.0]
    )
    assert means == {2.0: pytest.approx(np.mean(squares))}
    assert settings == louder(TOLD, 2.0)


def test_rows_after_the_last_are_not_used() -> None:
    plain = recording(3.0)
    later: dict[str, np.ndarray] = {}
    for name in ("rotation_increments", "velocity_increments", "position", "velocity"):
        x = getattr(plain, name).copy()
        x[41 * (100 if "increments" in name else 1) :] += 1e-3
        later[name] = x
    other = replace(plain, **later)
    for rows, same in (((20, 40), True), ((20, 60), False)):
        means = [
            calibrate_inertial_noise(d, TOLD, rows, runs=2, seed=1, levels=(1.0, 2.0))[1]
            for d in (plain, other)
        ]
        assert (means[0] == means[1]) is same


@pytest.mark.parametrize("rows", [(0, 10), (10, 10), (20, 10), (10, 91), (-5, 10), (91, 95)])
def test_rows_that_are_none(rows: tuple[int, int]) -> None:
    with pytest.raises(ParameterError, match="rows"):
        calibrate_inertial_noise(recording(3.0), TOLD, rows, runs=1, seed=0)


def test_no_candidates() -> None:
    with pytest.raises(ParameterError, match="levels"):
        calibrate_inertial_noise(recording(3.0), TOLD, ROWS, runs=1, seed=0, levels=())


def test_the_candidates_grow() -> None:
    assert list(LEVELS) == sorted(set(LEVELS))
    assert 1.0 in LEVELS


@given(st.floats(1e-3, 1e3))
def test_louder_multiplies_the_four_inertial_noises(level: float) -> None:
    four = {"gyro_noise", "accelerometer_noise", "gyro_walk", "accelerometer_walk"}
    changed = louder(TOLD, level)
    for field in fields(FilterSettings):
        before, after = getattr(TOLD, field.name), getattr(changed, field.name)
        assert after == (before * level if field.name in four else before)
