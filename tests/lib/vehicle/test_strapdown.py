"""What the filter integrates against pyins' public class, and corrections against known errors."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, strategies as st
from lib.vehicle.made_drive import DV, PERIOD, THETA, TURN, driven, flown
from pyins import earth, transform
from scipy.spatial.transform import Rotation

from inswsn_lib.inertial import Earth, InertialState, metres
from inswsn_lib.inertial.runs import AFTER, Table, run_table
from inswsn_lib.inertial.sensors import position
from inswsn_lib.inertial.steps import Steps
from inswsn_lib.kernels import PLAIN
from inswsn_lib.vehicle import VehicleState


def state(position: np.ndarray, velocity: np.ndarray, attitude: np.ndarray) -> VehicleState:
    """Return what one run knows, or several."""
    lead = position.shape[:-1]
    return VehicleState(
        position, velocity, attitude, np.zeros((*lead, 3)), np.zeros((*lead, 3)),
        np.zeros((*lead, 15)), np.zeros((*lead, 15, 15)),
    )  # fmt: skip


def integrate(begun: VehicleState, theta: np.ndarray, dv: np.ndarray) -> VehicleState:
    """Let the filter go on from some runs without a measurement."""
    earth, runs, samples = Earth(*begun.position[0]), *theta.shape[:2]
    place = earth.local(begun.position)
    axes = earth.ground(place).axes
    turned = (axes @ begun.velocity[..., None])[..., 0], (axes @ begun.attitude).reshape(-1, 9)
    x = np.hstack([place, *turned, begun.accelerometer_bias, begun.gyro_drift])
    steps = Steps(
        np.full(samples, PERIOD), theta, dv, np.array([samples]), np.zeros(4), increments=True,
        earth=earth.numbers, which=np.arange(runs), offsets=np.zeros(runs, dtype=int),
    )  # fmt: skip
    none, no = np.zeros(0, dtype=int), np.zeros((0, 3))
    table = Table(
        np.zeros(2, dtype=int), none, none, none, no, no, no, no[:, :2], np.zeros((runs, 0))
    )
    begin = x, np.zeros((runs, 15, 15)), np.zeros((runs, 15))
    empty = np.zeros((1, 0)), np.zeros((1, 0))
    found = run_table(InertialState, steps, begin, empty, [position], table, mode=AFTER, kept=0)
    x, back = found.state, np.swapaxes(earth.ground(found.state[:, :3]).axes, 1, 2)
    return replace(
        begun, position=earth.geodetic(x[:, :3]), velocity=(back @ x[:, 3:6, None])[..., 0],
        attitude=back @ x[:, 6:15].reshape(-1, 3, 3),
    )  # fmt: skip


@pytest.mark.parametrize("plain", ["", "1"])
def test_it_is_what_pyins_integrates(plain: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Two runs with other starts and other biases, over two stretches of a winding drive.

    pyins turns with the place and counts gravity for each sample; here the frame is fixed to the
    Earth, and gravity is that of the middle of a step.
    """
    monkeypatch.setenv(PLAIN, plain)
    rng = np.random.default_rng(1)
    made = driven(60)
    stretches = [made.increments.iloc[s : s + 700] for s in (1500, 4000)]
    truth = made.trajectory.iloc[[1500, 4000]]
    begun = VehicleState(
        np.column_stack([np.deg2rad(truth.lat), np.deg2rad(truth.lon), truth.alt]),
        truth[["VN", "VE", "VD"]].to_numpy() @ TURN + rng.normal(size=(2, 3)),
        TURN @ transform.mat_from_rph(truth[["roll", "pitch", "heading"]]),
        rng.normal(0, 0.1, (2, 3)), rng.normal(0, 0.01, (2, 3)),
        np.zeros((2, 15)), np.zeros((2, 15, 15)),
    )  # fmt: skip
    theta, dv = (np.stack([x[names] for x in stretches]) for names in (THETA, DV))
    found, expected = integrate(begun, theta, dv), flown(begun, theta, dv)
    assert np.abs((found.position - expected.position) * metres(begun.position)).max() < 1e-4
    assert found.velocity == pytest.approx(expected.velocity, abs=2e-5)
    assert found.attitude == pytest.approx(expected.attitude, abs=1e-8)


@pytest.mark.parametrize("latitude", [-60.0, 0.0, 32.0])
def test_a_car_at_rest_stays_at_rest(latitude: float) -> None:
    """It feels its weight and the turning of the Earth, in whatever attitude it stands."""
    place = np.array([np.deg2rad(latitude), 2.0, 55.0])
    C = TURN @ Rotation.from_euler("ZYX", [2.0, 0.1, -0.2]).as_matrix()
    rate = C.T @ (earth.RATE * np.array([0, np.cos(place[0]), np.sin(place[0])]))
    force = C.T @ [0, 0, float(earth.gravity(latitude, 55.0))]
    theta = np.tile(rate * PERIOD, (1, 6000, 1))
    # in the axes of the sample's beginning, from which the Earth turns away meanwhile
    dv = np.tile(force * PERIOD + 0.5 * np.cross(rate, force) * PERIOD**2, (1, 6000, 1))
    begun = state(place[None], np.zeros((1, 3)), C[None])
    found = integrate(begun, theta, dv)
    assert np.abs(found.velocity).max() < 1e-6
    assert np.abs((found.position[0] - place) * metres(place)).max() < 1e-5
    assert found.attitude[0] == pytest.approx(C, abs=1e-9)


@given(st.integers(0, 2**32 - 1), st.integers(0, 2))
def test_a_known_error_is_undone(seed: int, extra: int) -> None:
    """INS that is wrong by a known error, corrected by it, is the truth again, not only nearly.

    C' = (I - [phi x]) C: the attitude error turns the true frame into the computed one.
    """
    rng = np.random.default_rng(seed)
    true = state(
        *rng.normal(size=(2, 2, 4, 3)), Rotation.random(8, rng=rng).as_matrix().reshape(2, 4, 3, 3)
    )
    x = rng.normal(size=(2, 4, 15 + extra)) * 0.3
    turned = Rotation.from_rotvec(-x[..., 6:9].reshape(-1, 3)).as_matrix().reshape(2, 4, 3, 3)
    bias, drift = rng.normal(size=(2, 2, 4, 3))
    wrong = VehicleState(
        true.position + x[..., 0:3], true.velocity + x[..., 3:6], turned @ true.attitude,
        bias - x[..., 9:12], drift - x[..., 12:15],  # what of the bias is not yet taken off
        x, rng.normal(size=(2, 4, 15 + extra, 15 + extra)),
    )  # fmt: skip
    kept, found = x.copy(), wrong.corrected()
    right = replace(true, accelerometer_bias=bias, gyro_drift=drift)
    for name in ("position", "velocity", "attitude", "accelerometer_bias", "gyro_drift"):
        assert getattr(found, name) == pytest.approx(getattr(right, name))
    assert not found.error[..., :15].any()
    assert np.array_equal(found.error[..., 15:], x[..., 15:])  # of other states it stays
    assert np.array_equal(found.covariance, wrong.covariance)
    assert np.array_equal(wrong.error, kept)  # and the old state is as it was
