"""The mounting of an IMU from made runs whose forward axis is known."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, strategies as st
from lib.vehicle.made_drive import KNOWN, make_drive
from numpy.typing import ArrayLike, NDArray
from scipy.spatial.transform import Rotation

from inswsn_lib.errors import ParameterError
from inswsn_lib.vehicle import (
    Mounting,
    VehicleRun,
    VehicleState,
    estimate_mounting,
    run_vehicle_filter,
)

Array = NDArray[np.float64]


def forward_axis(yaw: ArrayLike, pitch: ArrayLike) -> Array:
    """Return a unit vector, turned to the right and then up, in axes forward, right, down."""
    yaw, pitch = np.broadcast_arrays(yaw, pitch)
    return np.stack(
        [np.cos(pitch) * np.cos(yaw), np.cos(pitch) * np.sin(yaw), -np.sin(pitch)], axis=-1
    )


def made_run(body: Array, seed: int = 0, error: Array | None = None) -> VehicleRun:
    """Return a run whose velocity in the IMU's axes is `body`, (epochs, runs, 3).

    The attitude is a new one at each epoch; `error` is what the filter knows of its velocity's.
    """
    epochs, runs = body.shape[:2]
    rng = np.random.default_rng(seed)
    attitude = Rotation.random(epochs * runs, random_state=rng).as_matrix()
    attitude = attitude.reshape(epochs, runs, 3, 3)
    zero, known = np.zeros((epochs, runs, 3)), np.zeros((epochs, runs, 15))
    known[..., 3:6] = 0.0 if error is None else error
    states = VehicleState(
        position=zero,
        velocity=np.einsum("krij,krj->kri", attitude, body) + known[..., 3:6],
        attitude=attitude,
        accelerometer_bias=zero,
        gyro_drift=zero,
        error=known,
        covariance=np.zeros((epochs, runs, 15, 15)),
    )
    return VehicleRun(
        epochs=np.tile(np.arange(epochs)[:, None], runs),
        which=np.arange(runs),
        states=states,
        first=np.zeros((epochs, 3, runs)),
        innovations=np.full((epochs, 8, runs), np.nan),
        innovation_covariances=np.zeros((epochs, 8, 8, runs)),
    )


def straight(yaw: ArrayLike, pitch: ArrayLike, speeds: ArrayLike) -> Array:
    """Return velocities along one axis, (epochs, runs, 3)."""
    return np.asarray(speeds)[:, None, None] * np.atleast_2d(forward_axis(yaw, pitch))[None]


def found(body: Array, until: int | None = None) -> Mounting:
    return estimate_mounting(made_run(body), len(body) - 1 if until is None else until)


@given(
    st.lists(
        st.tuples(st.floats(-np.pi + 1e-3, np.pi), st.floats(-1.4, 1.4)), min_size=1, max_size=4
    ),
    st.lists(st.floats(5.01, 40), min_size=1, max_size=6),
)
def test_any_mounting_is_found(angles: list[tuple[float, float]], speeds: list[float]) -> None:
    yaw, pitch = np.array(angles).T
    mounting = found(straight(yaw, pitch, speeds))
    assert mounting.yaw == pytest.approx(yaw, abs=1e-9)
    assert mounting.pitch == pytest.approx(pitch, abs=1e-9)
    assert mounting.epochs.tolist() == [len(speeds)] * len(angles)
    for R, axis in zip(mounting.rotation, forward_axis(yaw, pitch), strict=True):
        assert pytest.approx(np.eye(3), abs=1e-9) == R @ R.T
        assert np.linalg.det(R) == pytest.approx(1)
        assert R @ axis == pytest.approx([1, 0, 0], abs=1e-9)
        # no turn about the forward axis: what is to the right stays level in the IMU's axes
        assert R[1, 2] == pytest.approx(0, abs=1e-12)
        assert R[2, 2] >= 0


def test_signs_by_hand() -> None:
    """Forward axis 30 degrees to the right of the IMU's: it moves to its right by a half."""
    body = np.array([[[np.sqrt(3) / 2, 0.5, 0.0], [np.sqrt(3) / 2, 0.0, -0.5]]]) * 10
    mounting = found(body)
    assert np.rad2deg(mounting.yaw) == pytest.approx([30, 0])
    assert np.rad2deg(mounting.pitch) == pytest.approx([0, 30])
    c, s = np.sqrt(3) / 2, 0.5
    assert mounting.rotation[0] == pytest.approx(np.array([[c, s, 0], [-s, c, 0], [0, 0, 1]]))
    assert mounting.rotation[1] == pytest.approx(np.array([[c, 0, -s], [0, 1, 0], [s, 0, c]]))


def test_slow_epochs_do_not_count() -> None:
    body = np.concatenate([straight(0.3, 0.1, [8, 9, 7]), straight(-1.0, 0.5, [4.9, 1.0])])
    mounting = found(body)
    assert mounting.yaw == pytest.approx(0.3)
    assert mounting.pitch == pytest.approx(0.1)
    assert mounting.epochs.tolist() == [3]
    slower = estimate_mounting(made_run(body), 4, slowest=0.5)
    assert slower.epochs.tolist() == [5]
    assert slower.yaw[0] < 0.2


def test_later_epochs_do_not_count() -> None:
    body = np.concatenate([straight(0.3, 0.1, [8, 9]), straight(-1.0, 0.5, [20, 20])])
    mounting = found(body, until=1)
    assert mounting.yaw == pytest.approx(0.3)
    assert mounting.epochs.tolist() == [2]
    assert found(body, until=2).yaw[0] < -0.3


def test_side_slip_to_both_sides_cancels_and_speed_weighs() -> None:
    """Directions to the right and left by the same angle, at one speed: their middle."""
    slip = 0.05
    both = np.concatenate([straight(0.2 + slip, 0.0, [10]), straight(0.2 - slip, 0.0, [10])])
    assert found(both).yaw == pytest.approx(0.2)
    # at 6 and 18 m/s: the direction of the sum of the vectors
    body = np.concatenate([straight(0.0, 0.0, [18]), straight(0.4, 0.0, [6])])
    assert found(body).yaw == pytest.approx(np.arctan2(6 * np.sin(0.4), 18 + 6 * np.cos(0.4)))


def test_what_is_known_of_the_error_of_velocity_is_taken_off() -> None:
    body = straight([0.3, -0.2], [0.1, 0.0], [8, 9, 7])
    error = np.random.default_rng(1).normal(0, 3, body.shape)
    mounting = estimate_mounting(made_run(body, error=error), 2)
    assert mounting.yaw == pytest.approx([0.3, -0.2])


@pytest.mark.parametrize("until", [0, 2])
def test_who_has_not_moved_is_told(until: int) -> None:
    body = straight([0.1, 0.1], 0.0, [1, 2, 3, 9])
    body[3, 1] /= 3
    with pytest.raises(ParameterError, match=r"until.*faster than 5\.0 m/s"):
        found(body, until)
    # one run is fast by the last epoch, the other never
    with pytest.raises(ParameterError, match="faster than"):
        found(body, 3)


def test_of_a_filter_that_runs_over_a_made_drive() -> None:
    """An IMU turned by 4 degrees to the left of the car: the forward axis is to its right."""
    drive = make_drive(100, 2, seed=3, mounting=float(np.deg2rad(4)), errors=0.2)
    run = run_vehicle_filter(drive, KNOWN, aiding=False)
    mounting = estimate_mounting(run, 100)
    assert np.rad2deg(mounting.yaw) == pytest.approx([4, 4], abs=0.5)
    assert np.rad2deg(mounting.pitch) == pytest.approx([0, 0], abs=0.3)
