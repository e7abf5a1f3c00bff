"""A recorded drive: emulated GPS and compass, and an IMU whose mounting and noise are known."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import pandas as pd
import pytest
from hypothesis import given, strategies as st
from lib.vehicle.made_drive import DV, KNOWN, PERIOD, THETA, TURN, driven, logged
from made_folders import needs
from numpy.typing import ArrayLike
from pyins import strapdown, transform
from pyins.util import ACCEL_COLS, GYRO_COLS
from scipy.spatial.transform import Rotation

from inswsn_lib.checks import Array
from inswsn_lib.errors import InswsnError, ParameterError
from inswsn_lib.logs import load_drive
from inswsn_lib.simulation import Drive, Place
from inswsn_lib.streams import Fixes, Imu, Recording
from inswsn_lib.vehicle import (
    VehicleRun,
    VehicleState,
    calibrate_inertial_noise,
    emulate_sensors,
    estimate_mounting,
    run_vehicle_filter,
)

# degrees for a metre east and north at 40 degrees north, from WGS84's radii there:
# a (1 - e^2) / w^3 = 6361815.8 and a / w = 6387001.9 m, and 1600 m of height
NORTHWARDS = 180 / np.pi / (6361815.8 + 1600)
EASTWARDS = 180 / np.pi / ((6387001.9 + 1600) * np.cos(np.deg2rad(40.0)))
QUIET = {"gps_position_sd": 0.0, "gps_velocity_sd": 0.0, "compass_sd": 0.0}

# --- emulation ---


ORIGIN = np.array([np.deg2rad(40.0), np.deg2rad(-105.0), 1600.0])


def recording(velocity: ArrayLike | None = None) -> Recording:
    """A recording of a car that stays, with these velocities (epochs, 3), and any uneven IMU."""
    v = np.tile([-6.0, 8.0, 0.2], (50, 1)) if velocity is None else np.array(velocity, dtype=float)
    rng = np.random.default_rng(5)
    time = np.cumsum(rng.uniform(0.004, 0.012, 130 * len(v))) - 0.5
    imu = Imu(time, *rng.normal(size=(2, len(time), 3)))
    fixes = Fixes(np.arange(float(len(v))), 0 * v, v)
    return Recording("any", imu=imu, fixes=fixes, origin=ORIGIN)


def increments(recording: Recording, first: float, seconds: int) -> Array:
    """Return those of even samples from a time on, (samples, 6): piece by piece, and by pyins.

    Between two stamps, of the IMU or the grid, rate and force are the mean of the rows around.
    """
    time = recording.imu.time - first
    sensed = np.hstack([recording.imu.rate, recording.imu.force])
    grid = PERIOD * np.arange(-1, 100 * seconds + 1)
    ends = np.union1d(grid, time[(time > grid[0]) & (time < grid[-1])])
    after = np.searchsorted(time, (ends[1:] + ends[:-1]) / 2)
    pieces = (sensed[after] + sensed[after - 1]) / 2 * np.diff(ends)[:, None]
    sums = np.add.reduceat(pieces, np.searchsorted(ends, grid[:-1]))
    samples = pd.DataFrame(sums, grid[1:], [*GYRO_COLS, *ACCEL_COLS])
    told = strapdown.compute_increments_from_imu(samples, "increment")
    return told[[*THETA, *DV]].to_numpy()


@pytest.mark.parametrize(
    ("read", "first", "seconds"),
    [
        (recording, 0.0, 49),
        pytest.param(load_drive, 1752003261.999, 545, marks=needs("rtklib/drive-0708")),
    ],
)
def test_sensors_without_noise_are_those_of_the_recording(
    read: Callable[[], Recording], first: float, seconds: int
) -> None:
    made = read()
    drive = emulate_sensors(made, runs=1, seed=1, **QUIET)
    found = np.concatenate([drive.rotation_increments, drive.velocity_increments], axis=1)
    assert found[..., 0] == pytest.approx(increments(made, first, seconds), rel=0, abs=1e-11)
    fixes = made.fixes
    rows = [np.argmin(np.abs(fixes.time - first - k)) for k in range(seconds + 1)]
    assert np.array_equal(drive.gps_velocity[..., 0], fixes.velocity[rows])
    degrees = np.array([180 / np.pi, 180 / np.pi, 1.0])
    ned = transform.lla_to_ned(drive.gps_position[..., 0] * degrees, made.origin * degrees)
    assert ned == pytest.approx(fixes.position[rows] @ TURN, rel=0, abs=1e-6)


def test_the_period_and_where_epochs_are() -> None:
    """Fixes at 4 Hz, the third nearest to a whole second, and an IMU to 12.15 s."""
    time = 7.48 + 0.25 * np.arange(30)
    fixes = Fixes(time, np.outer(time, [0, 0, 1]), np.outer(time, [1, 0, 0]))
    imu = Imu(np.linspace(8.4, 12.15, 42), np.zeros((42, 3)), np.ones((42, 3)))
    made = Recording("4 Hz", imu=imu, fixes=fixes, origin=ORIGIN)
    drive = emulate_sensors(made, runs=1, seed=0, period=0.25, **QUIET)
    assert drive.gps_velocity[:, 0, 0] == pytest.approx([8.98, 9.98, 10.98, 11.98])
    assert drive.reference.position[:, 2] - 1600 == pytest.approx([8.98, 9.98, 10.98, 11.98])
    assert drive.velocity_increments == pytest.approx(np.full((12, 3, 1), 0.25))
    assert drive.period == 0.25
    assert len(emulate_sensors(made, runs=1, seed=0, period=0.5).time) == 2
    with pytest.raises(ParameterError, match="a whole number of IMU samples per step"):
        emulate_sensors(made, runs=1, seed=0, period=0.4)


def test_what_a_recording_lacks_is_told() -> None:
    whole, there = recording(), np.arange(50) != 7
    fixes = whole.fixes
    gap = Fixes(fixes.time[there], fixes.position[there], fixes.velocity[there])
    unknown = replace(fixes, position=np.where(there[:, None], fixes.position, np.nan))
    for other, said in (
        (whole.without("imu"), "The recording any has no imu: a drive needs it."),
        (replace(whole, imu=whole.imu.part(end=-9)), "any has no imu: a drive needs it."),
        (whole.without("fixes"), "any has no fixes: a drive needs it."),
        (replace(whole, fixes=replace(fixes, velocity=None)), "any has no velocities of fixes: a"),
        (replace(whole, origin=None), "any has no origin: a drive needs it."),
        (replace(whole, fixes=gap), "any has no fix each second of its IMU."),
        (whole.part(end=1.0), "any has no fix each second of its IMU."),
        (replace(whole, fixes=unknown), "fixes must be finite numbers of shape (epochs, 3), not"),
    ):
        with pytest.raises(InswsnError, match=re.escape(said)):
            emulate_sensors(other, runs=1, seed=0)


def test_the_noise_is_as_asked_and_white() -> None:
    made = recording()
    drive = emulate_sensors(made, runs=400, seed=1)
    moved = np.rad2deg(drive.gps_position[:, :2] - ORIGIN[:2, None])
    metres = [moved[:, 0] / NORTHWARDS, moved[:, 1] / EASTWARDS, drive.gps_position[:, 2] - 1600.0]
    speeds = np.moveaxis(drive.gps_velocity - made.fixes.velocity[:, :, None], 1, 0)
    angles = drive.compass - np.arctan2(-6.0, 8.0)
    # 20000 numbers: five of their standard errors are 2.5 per cent of a deviation
    sizes = [3.0] * 3 + [0.05] * 3 + [np.deg2rad(0.15)]
    for errors, size in zip([*metres, *speeds, angles], sizes, strict=True):
        assert errors.shape == (50, 400)
        assert errors.std() == pytest.approx(size, rel=0.025)
        assert abs(errors.mean()) < 5 * size / np.sqrt(20000)
        assert abs(np.mean(errors[1:] * errors[:-1])) < 5 * size**2 / np.sqrt(19600)
        assert abs(np.mean(errors[:, 1:] * errors[:, :-1])) < 5 * size**2 / np.sqrt(19950)
    for one, other in ((metres[0], metres[1]), (metres[1], metres[2]), (metres[0], speeds[0])):
        assert abs(np.corrcoef(one.ravel(), other.ravel())[0, 1]) < 5 / np.sqrt(20000)


def test_without_noise_gps_is_rtk_and_the_compass_the_course() -> None:
    made = recording()
    drive = emulate_sensors(made, runs=3, seed=1, places=[Place("bend", 7)], **QUIET)
    assert np.array_equal(drive.gps_position[..., 2], drive.reference.position)
    assert drive.compass == pytest.approx(np.full((50, 3), np.arctan2(-6.0, 8.0)))
    assert drive.reference.position == pytest.approx(np.tile(ORIGIN, (50, 1)), rel=1e-12)
    assert np.array_equal(drive.reference.velocity, made.fixes.velocity)
    assert drive.reference.attitude is None
    assert (drive.origin, drive.places, drive.period) == ("recorded", (Place("bend", 7),), 0.01)


def test_sizes_are_taken_one_by_one_and_the_seed_tells_the_draws() -> None:
    made = recording()
    for name, size in (("compass_sd", 0.01), ("gps_velocity_sd", 0.7)):
        drive = emulate_sensors(made, runs=300, seed=1, **(QUIET | {name: size}))
        off = {
            "compass_sd": drive.compass - np.arctan2(-6.0, 8.0),
            "gps_velocity_sd": drive.gps_velocity - made.fixes.velocity[:, :, None],
            "gps_position_sd": drive.gps_position - ORIGIN[:, None],
        }
        assert off.pop(name).std() == pytest.approx(size, rel=0.03)
        assert all(np.abs(x).max() < 1e-9 for x in off.values())
    one, same, other = (emulate_sensors(made, runs=2, seed=s) for s in (4, 4, 5))
    for name in ("gps_position", "gps_velocity", "compass"):
        assert np.array_equal(getattr(one, name), getattr(same, name))
        assert (getattr(one, name) != getattr(other, name)).all()


def test_the_course_is_held_at_low_speed() -> None:
    """Rest, east too slow, east, north at the limit, slow, south-west."""
    velocity = [[0, 0, 0], [0.1, -0.5, 0], [3, 0, 0], [-0.7, 0.7, 5], [0, 1, 0], [0, -0.99, 0],
                [-2, -2, 0]]  # fmt: skip
    for hold_below, degrees in (
        (1.0, [90.0, 90.0, 90.0, 90.0, 0.0, 0.0, -135.0]),
        (2.5, [90.0] * 6 + [-135.0]),
    ):
        drive = emulate_sensors(
            recording(velocity), runs=2, seed=1, hold_below=hold_below, compass_sd=0.0
        )
        assert np.rad2deg(drive.compass) == pytest.approx(np.tile(degrees, (2, 1)).T, abs=1e-9)
    still = np.zeros((300, 3))
    still[0] = [0, 5, 0]  # a held course is measured anew each second
    assert emulate_sensors(recording(still), runs=1, seed=1, compass_sd=0.01).compass.std() > 0.008


def test_the_compass_is_wrapped() -> None:
    south = recording(np.tile([0.0, -5.0, 0.0], (200, 1)))
    assert (emulate_sensors(south, runs=1, seed=1, compass_sd=0.0).compass == np.pi).all()
    for size in (0.1, 5e-16):  # a last digit beyond pi must not become -pi
        noisy = emulate_sensors(south, runs=1, seed=1, compass_sd=size).compass
        assert ((noisy > -np.pi) & (noisy <= np.pi)).all()
        assert np.abs(noisy).min() > 2.5
        assert 60 < (noisy < 0).sum() < 140 or size < 1e-9


def test_a_mounting_turns_both_increments_of_each_run() -> None:
    """Axes that are turned to the left by 90 degrees; by 30; x taken to -z."""
    made, c, s = recording(), np.sqrt(0.75), 0.5
    left, some, tilt = (
        np.array(rows, dtype=float)
        for rows in (
            [[0, -1, 0], [1, 0, 0], [0, 0, 1]],
            [[c, -s, 0], [s, c, 0], [0, 0, 1]],
            [[0, 0, 1], [0, 1, 0], [-1, 0, 0]],
        )
    )
    each = emulate_sensors(made, runs=4, seed=1, mounting=[np.eye(3), left, tilt, some])
    shared = emulate_sensors(made, runs=2, seed=1, mounting=left)
    for name in ("rotation_increments", "velocity_increments"):
        x, y, z = source = getattr(emulate_sensors(made, runs=1, seed=1), name)[..., 0].T
        turned = [source, [-y, x, z], [z, y, -x], [c * x - s * y, s * x + c * y, z]]
        expected = np.moveaxis(np.array(turned), 0, 2).swapaxes(0, 1)
        assert getattr(each, name) == pytest.approx(expected, abs=1e-12)
        assert getattr(shared, name) == pytest.approx(expected[..., [1, 1]], abs=1e-12)


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("runs", 0), ("seed", -1), ("gps_position_sd", -1.0), ("gps_velocity_sd", np.nan),
        ("gps_velocity_sd", -0.1), ("compass_sd", np.inf), ("compass_sd", -0.1),
        ("hold_below", -0.1), ("hold_below", 10.1), ("period", 0.0),
        ("mounting", np.eye(2)), ("mounting", np.tile(np.eye(3), (3, 1, 1))),
        ("places", [Place("late", 50)]),
    ],
)  # fmt: skip
def test_what_a_parameter_may_not_be(name: str, value: Any) -> None:
    with pytest.raises(ParameterError) as error:
        emulate_sensors(recording(), **({"runs": 2, "seed": 1} | {name: value}))
    assert error.value.name == name


# --- the mounting ---


def forward_axis(yaw: ArrayLike, pitch: ArrayLike) -> Array:
    """Return a unit vector, turned to the right and then up, in axes forward, right, down."""
    yaw, pitch = np.broadcast_arrays(yaw, pitch)
    return np.stack(
        [np.cos(pitch) * np.cos(yaw), np.cos(pitch) * np.sin(yaw), -np.sin(pitch)], axis=-1
    )


def made_run(body: Array, error: Array | None = None) -> VehicleRun:
    """A run whose velocity in the IMU's axes is `body`, (epochs, runs, 3), in any attitudes.

    `error` is what the filter knows of its velocity's.
    """
    epochs, runs = body.shape[:2]
    rng = np.random.default_rng(0)
    attitude = Rotation.random(epochs * runs, random_state=rng).as_matrix()
    attitude = attitude.reshape(epochs, runs, 3, 3)
    zero, known = np.zeros((epochs, runs, 3)), np.zeros((epochs, runs, 15))
    known[..., 3:6] = 0.0 if error is None else error
    velocity = np.einsum("krij,krj->kri", attitude, body) + known[..., 3:6]
    states = VehicleState(zero, velocity, attitude, zero, zero, known, np.zeros((epochs, runs)))
    epoch = np.tile(np.arange(epochs)[:, None], runs)
    return VehicleRun(epoch, np.arange(runs), states, zero, zero, zero)


def straight(yaw: ArrayLike, pitch: ArrayLike, speeds: ArrayLike) -> Array:
    """Return velocities along one axis, (epochs, runs, 3)."""
    return np.asarray(speeds)[:, None, None] * np.atleast_2d(forward_axis(yaw, pitch))[None]


def angles(rotation: Array) -> Array:
    """Return yaw and pitch of the forward axis, (2, runs)."""
    x, y, z = rotation[:, 0].T
    return np.stack([np.arctan2(y, x), -np.arcsin(z)])


@given(
    st.lists(
        st.tuples(st.floats(-np.pi + 1e-3, np.pi), st.floats(-1.4, 1.4)), min_size=1, max_size=4
    ),
    st.lists(st.floats(5.01, 40), min_size=1, max_size=6),
)
def test_any_mounting_is_found(mounted: list[tuple[float, float]], speeds: list[float]) -> None:
    yaw, pitch = np.array(mounted).T
    found = estimate_mounting(made_run(straight(yaw, pitch, speeds)), len(speeds) - 1)
    for R, axis in zip(found, forward_axis(yaw, pitch), strict=True):
        assert pytest.approx(np.eye(3), abs=1e-9) == R @ R.T
        assert np.linalg.det(R) == pytest.approx(1)
        assert R @ axis == pytest.approx([1, 0, 0], abs=1e-9)
        # no turn about the forward axis: what is to the right stays level in the IMU's axes
        assert R[1, 2] == pytest.approx(0, abs=1e-12)
        assert R[2, 2] >= 0


def test_slow_and_later_epochs_do_not_count() -> None:
    body = np.concatenate([straight(0.3, 0.1, [8, 5.01]), straight(-1.0, 0.5, [4.99, 20])])
    run = made_run(body)
    assert angles(estimate_mounting(run, 2))[:, 0] == pytest.approx([0.3, 0.1])
    assert angles(estimate_mounting(run, 3))[0, 0] < -0.3
    assert angles(estimate_mounting(run, 2, slowest=4.0))[0, 0] < 0.2


def test_side_slip_cancels_speed_weighs_and_known_errors_are_taken_off() -> None:
    both = np.concatenate([straight(0.25, 0.0, [10]), straight(0.15, 0.0, [10])])
    assert angles(estimate_mounting(made_run(both), 1))[0] == pytest.approx(0.2)
    body = np.concatenate([straight(0.0, 0.0, [18]), straight(0.4, 0.0, [6])])
    expected = np.arctan2(6 * np.sin(0.4), 18 + 6 * np.cos(0.4))
    assert angles(estimate_mounting(made_run(body), 1))[0] == pytest.approx(expected)
    body = straight([0.3, -0.2], [0.1, 0.0], [8, 9, 7])
    error = np.random.default_rng(1).normal(0, 3, body.shape)
    assert angles(estimate_mounting(made_run(body, error), 2))[0] == pytest.approx([0.3, -0.2])


@pytest.mark.parametrize("until", [-1, 0, 3, 4])
def test_who_has_not_moved_is_told(until: int) -> None:
    body = straight([0.1, 0.1], 0.0, [1, 2, 3, 9])
    body[3, 1] /= 3  # one run is fast by the last epoch, the other never
    with pytest.raises(ParameterError, match="until"):
        estimate_mounting(made_run(body), until)
    with pytest.raises(ParameterError, match="until must be a whole number between 0 and 1"):
        estimate_mounting(made_run(straight(0.1, 0.0, [9, 9])), 2)


# --- the noise ---

#: White noise that GPS velocity of 0.05 m/s can see in one second
TOLD = replace(
    KNOWN,
    accelerometer_noise=0.1,
    gyro_noise=float(np.deg2rad(0.3)),
    accelerometer_walk=1e-5,
    gyro_walk=1e-6,
)
INERTIAL = ("gyro_noise", "accelerometer_noise", "gyro_walk", "accelerometer_walk")


def louder(level: float) -> Any:
    return replace(TOLD, **{name: level * getattr(TOLD, name) for name in INERTIAL})


@cache
def noisy(level: float) -> Drive:
    """Four draws of GPS with an IMU that has `level` times the noise that the settings tell."""
    made, rng = driven(90), np.random.default_rng(14)
    noise = np.repeat([TOLD.gyro_noise, TOLD.accelerometer_noise], 3)
    sizes = level * np.sqrt(PERIOD) * noise
    noisy = made.integrals + sizes * rng.normal(size=made.integrals.shape)
    return emulate_sensors(logged(made, noisy), runs=4, seed=3)


@pytest.mark.parametrize("level", [0.5, 3.0])
def test_the_factor_is_found_again(level: float) -> None:
    """61 seconds of 3 components: the mean square is 1 within 0.1 (1 sigma), levels are 3 apart.

    The runs share the IMU, whose noise is most of the innovation, so they are not counted.
    """
    levels = (level / 3, level, 3 * level)
    settings, means = calibrate_inertial_noise(noisy(level), TOLD, (20, 80), levels=levels)
    assert settings == louder(level)
    assert list(means) == list(levels)
    assert means[level] == pytest.approx(1, abs=4 * np.sqrt(2 / (61 * 3)))
    # what is expected to be noisier surprises less
    assert means[levels[0]] > means[level] > means[levels[2]]


def test_the_mean_is_that_of_velocity_innovations_in_the_rows_and_of_no_other() -> None:
    """Written out in loops for one level, from a run of the filter over the whole drive."""
    drive = noisy(3.0)
    run = run_vehicle_filter(drive, louder(2.0), aiding=False)
    squares = [
        run.innovations[k, i, r] ** 2 / run.innovation_covariances[k, i, i, r]
        for k in range(30, 51)
        for i in (5, 6, 7)
        for r in range(4)
    ]
    settings, means = calibrate_inertial_noise(drive, TOLD, (30, 50), levels=[2.0])
    assert means == {2.0: pytest.approx(np.mean(squares))}
    assert settings == louder(2.0)


@pytest.mark.parametrize("rows", [(0, 10), (10, 10), (20, 10), (10, 91)])
def test_rows_and_levels_that_are_none(rows: tuple[int, int]) -> None:
    with pytest.raises(ParameterError, match="rows"):
        calibrate_inertial_noise(noisy(3.0), TOLD, rows)
    with pytest.raises(ParameterError, match="levels"):
        calibrate_inertial_noise(noisy(3.0), TOLD, (5, 6), levels=[-1.0])
