"""The error model against differences of the full mechanisation, ellipsoids, and closed forms."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st
from inswsn_book.evidence.p3_equations import (
    compass_row,
    discretise,
    earth_rate,
    error_dynamics,
    gps_rows,
    lateral_row,
    transport_rate,
)
from lib.vehicle.made_drive import TURN
from pyins import earth, transform
from pyins.strapdown import integrate
from scipy.linalg import expm
from scipy.spatial.transform import Rotation

from inswsn_lib.inertial import metres
from inswsn_lib.inertial.earth import radii
from inswsn_lib.inertial.mechanization import skew
from inswsn_lib.simulation.drive import wrapped
from inswsn_lib.vehicle import STATES, yaw
from inswsn_lib.vehicle.state import (
    ACCELEROMETER_BIAS,
    ATTITUDE,
    GYRO_DRIFT,
    POSITION,
    VELOCITY,
)

DEGREES = np.array([180 / np.pi, 180 / np.pi, 1.0])
# steps of the differences: large, for what is smooth, so that rounding stays small
STEPS = np.array(
    [5e-3, 5e-3, 3e3, *[3.0] * 3, *[1e-2] * 3, *[1.0] * 3, *[3e-2] * 3]
)  # rad, rad, m, m/s, rad, m/s^2, rad/s
TIMES = (0.02, 0.01, 0.005, 0.0025)


class Motion:
    """A moment: position, velocity, attitude, what the sensors feel (body axes)."""

    def __init__(self, seed: int) -> None:
        rng = np.random.default_rng(seed)
        self.position = np.array([rng.uniform(-1.2, 1.2), rng.uniform(-3, 3), rng.uniform(0, 3e3)])
        self.velocity = rng.uniform(-40, 40, 3)
        self.attitude = Rotation.random(rng=rng).as_matrix()
        self.force, self.rate = rng.uniform(-20, 20, 3), rng.uniform(-0.5, 0.5, 3)

    def dynamics(self) -> np.ndarray:
        return error_dynamics(
            self.position, self.velocity, self.attitude, self.attitude @ self.force
        )


def mechanise(motion: Motion, error: np.ndarray, time: float) -> tuple[np.ndarray, ...]:
    """Let pyins integrate one sample from a state that is wrong by `error`."""
    lla, velocity, matrix = np.empty((2, 3)), np.empty((2, 3)), np.empty((2, 3, 3))
    lla[0] = (motion.position + error[POSITION]) * DEGREES
    velocity[0] = TURN @ (motion.velocity + error[VELOCITY])
    matrix[0] = TURN @ Rotation.from_rotvec(-error[ATTITUDE]).as_matrix() @ motion.attitude
    theta = (motion.rate + error[GYRO_DRIFT])[None] * time
    dv = (motion.force + error[ACCELEROMETER_BIAS])[None] * time
    integrate(np.array([time]), lla, velocity, matrix, theta, dv, 0, True)
    return lla[1] / DEGREES, TURN @ velocity[1], TURN @ matrix[1]


def growth(motion: Motion, time: float) -> np.ndarray:
    """Return (J - I)/T, J the central difference of the mechanisation over one sample."""
    J = np.zeros((STATES, STATES))
    _, _, C = mechanise(motion, np.zeros(STATES), time)
    for i in range(STATES):
        halves = []
        for size in (STEPS[i], STEPS[i] / 2):
            error = np.zeros(STATES)
            error[i] = size
            (pa, va, Ca), (pb, vb, Cb) = (mechanise(motion, s * error, time) for s in (1, -1))
            phi = [-Rotation.from_matrix(X @ C.T).as_rotvec() for X in (Ca, Cb)]
            halves.append(np.concatenate([pa - pb, va - vb, phi[0] - phi[1]]) / (2 * size))
        J[:9, i] = (4 * halves[1] - halves[0]) / 3
    J[9:, 9:] = np.eye(6)
    return (J - np.eye(STATES)) / time


def by_differences(motion: Motion) -> np.ndarray:
    """Return F: `growth` for samples of no length, by Richardson's extrapolation."""
    table = [growth(motion, time) for time in TIMES]
    for order in range(1, len(TIMES)):
        table = [(2**order * b - a) / (2**order - 1) for a, b in pairwise(table)]
    return table[0]


def left_out(motion: Motion) -> np.ndarray:
    """Return what the model leaves out by intent: radii and gravity change with latitude."""
    (latitude, _, height), (east, north, _) = motion.position, motion.velocity
    h = 1e-4
    ends = [np.rad2deg(latitude + s * h) for s in (1, -1)]
    (Ma, Na, _), (Mb, Nb, _) = (earth.principal_radii(end, height) for end in ends)
    M, N, _ = earth.principal_radii(np.rad2deg(latitude), height)
    m, n = (Ma - Mb) / (2 * h) / M**2, (Na - Nb) / (2 * h) / N**2
    rate = np.array([north * m, -east * n, -east * n * np.tan(latitude)])
    F = np.zeros((STATES, STATES))
    F[0, 0], F[1, 0] = -north * m, -east * n / np.cos(latitude)
    F[ATTITUDE, 0] = rate
    F[VELOCITY, 0] = np.cross(motion.velocity, rate)
    ga, gb = (earth.gravity(end, height) for end in ends)
    F[5, 0] -= (ga - gb) / (2 * h)
    return F


@settings(max_examples=40)
@given(st.integers(0, 2**32 - 1))
def test_the_dynamics_are_the_derivative_of_the_mechanisation(seed: int) -> None:
    """All 15 columns, each entry to 3e-4 of itself or to what rounding leaves of a difference."""
    motion = Motion(seed)
    found, expected = by_differences(motion), motion.dynamics() + left_out(motion)
    rounding = np.array([2e-16, 5e-16, 5e-13, *[1e-14] * 3, *[3e-16] * 3, *[0.0] * 6])
    floor = 60 * rounding[:, None] / (STEPS * TIMES[-1])
    assert (np.abs(found - expected) <= 3e-4 * np.abs(expected) + floor).all()
    # in metres the whole agrees far closer than what P3's sensors could show
    size = np.concatenate([metres(motion.position), np.ones(12)])
    error = ((found - expected) * size[:, None] / size)[3:]
    assert np.abs(error).max() < 1e-6 * np.linalg.norm(motion.force)


def test_stacks_are_what_their_parts_are() -> None:
    parts = [Motion(seed) for seed in range(6)]
    stack = [
        np.stack(x).reshape(2, 3, *x[0].shape)
        for x in (
            [m.position for m in parts], [m.velocity for m in parts],
            [m.attitude for m in parts], [m.attitude @ m.force for m in parts],
        )
    ]  # fmt: skip
    F = error_dynamics(*stack)
    assert F.shape == (2, 3, 15, 15)
    rows = compass_row(stack[2]), lateral_row(stack[2], stack[1])
    for i, motion in enumerate(parts):
        at = np.unravel_index(i, (2, 3))
        assert F[at] == pytest.approx(motion.dynamics(), rel=1e-12, abs=1e-18)
        alone = (
            compass_row(motion.attitude), lateral_row(motion.attitude, motion.velocity),
        )  # fmt: skip
        for whole, part in zip(rows, alone, strict=True):
            assert np.array_equal(whole[at], part)


def test_at_rest_on_the_equator() -> None:
    """v = 0, L = 0, level and facing north: what is left of F can be counted on the fingers."""
    position, g = np.array([0.0, 0.3, 0.0]), 9.7803253359
    forward_right_down = np.array([[0.0, 1, 0], [1, 0, 0], [0, 0, -1]])
    found = error_dynamics(position, np.zeros(3), forward_right_down, np.array([0, 0, g]))
    A, E2, rate = 6378137.0, 6.6943799901413e-3, 7.292115e-5
    R = A * (1 - E2)  # along the meridian; along the equator it is A
    expected = np.zeros((15, 15))
    expected[0, 4], expected[1, 3], expected[2, 5] = 1 / R, 1 / A, 1
    expected[3, 7], expected[4, 6] = -g, g
    expected[3, 5], expected[5, 3] = -2 * rate, 2 * rate  # the vertical plane turns with the Earth
    expected[5, 2] = 2 * g / A
    expected[6, 4], expected[7, 3] = -1 / R, 1 / A
    expected[6, 8], expected[8, 6] = -rate, rate
    expected[8, 0] = rate
    expected[3:6, 9:12], expected[6:9, 12:15] = forward_right_down, -forward_right_down
    assert found == pytest.approx(expected, rel=1e-12, abs=1e-25)


@given(st.floats(-85, 85), st.floats(-180, 180), st.floats(-100, 9e3))
def test_metres_are_those_of_the_ellipsoid(
    latitude: float, longitude: float, height: float
) -> None:
    place, h = np.array([latitude, longitude, height]), 1e-3
    size = []
    for i, step in enumerate((h, h, 1.0)):
        ends = np.stack([place, place])
        ends[0, i], ends[1, i] = place[i] + step, place[i] - step
        a, b = transform.lla_to_ecef(ends)
        size.append(np.linalg.norm(a - b) / (2 * step))
    position = place / DEGREES
    assert metres(position) == pytest.approx(np.array(size) * DEGREES, rel=1e-6)
    meridian, transverse = radii(position)
    assert [meridian, transverse] == pytest.approx(
        np.array(earth.principal_radii(latitude, height))[:2], rel=1e-13
    )


@given(st.integers(0, 2**32 - 1))
def test_the_two_rates_are_those_of_pyins(seed: int) -> None:
    motion = Motion(seed)
    latitude, height = np.rad2deg(motion.position[0]), motion.position[2]
    assert earth_rate(motion.position) == pytest.approx(TURN @ earth.rate_n(latitude), rel=1e-12)
    by_curvature = earth.curvature_matrix(latitude, height) @ (TURN @ motion.velocity)
    found = transport_rate(motion.position, motion.velocity)
    assert found == pytest.approx(TURN @ by_curvature, rel=1e-12, abs=1e-20)


@given(st.integers(0, 2**32 - 1))
def test_skew_is_the_cross_product(seed: int) -> None:
    a, b = np.random.default_rng(seed).normal(size=(2, 4, 2, 3))
    assert (skew(a) @ b[..., None])[..., 0] == pytest.approx(np.cross(a, b))


def difference_by_attitude(motion: Motion, sensed: object) -> np.ndarray:
    """Return the derivative of `sensed(attitude)` by the attitude error."""
    columns = []
    for axis in np.eye(3):
        ends = [
            sensed(expm(-skew(sign * 1e-5 * axis)) @ motion.attitude)  # type: ignore[operator]
            for sign in (1, -1)
        ]
        columns.append(np.angle(np.exp(1j * (ends[0] - ends[1]))) / 2e-5)
    return np.array(columns)


@given(st.integers(0, 2**32 - 1))
def test_the_compass_row_is_the_derivative_of_the_yaw(seed: int) -> None:
    motion = Motion(seed)
    pitch = np.arcsin(motion.attitude[2, 0])
    if abs(pitch) > 1.3:  # a car that stands on its nose has no yaw
        return
    expected = np.zeros(STATES)
    expected[ATTITUDE] = difference_by_attitude(motion, lambda C: np.arctan2(C[0, 0], C[1, 0]))
    assert compass_row(motion.attitude)[0] == pytest.approx(expected, rel=1e-6, abs=1e-6)


def test_yaw_is_clockwise_from_north() -> None:
    headings = np.deg2rad([0.0, 37.0, 90.0, -90.0, 179.0])
    for heading in headings:
        C = TURN @ Rotation.from_euler("ZYX", [heading, 0.3, -0.4]).as_matrix()
        assert yaw(C) == pytest.approx(heading)


def test_angles_are_wrapped_to_a_half_open_turn() -> None:
    angles = np.array([0.0, 3.0, np.pi, -np.pi, 4.0, -4.0, 20.0, -np.nextafter(np.pi, 4)])
    found = wrapped(angles)
    assert found[:4].tolist() == [0.0, 3.0, np.pi, np.pi]
    assert found[4:7] == pytest.approx([4 - 2 * np.pi, 2 * np.pi - 4, 20 - 6 * np.pi])
    assert ((found > -np.pi) & (found <= np.pi)).all()


@given(st.integers(0, 2**32 - 1))
def test_the_lateral_row_is_the_derivative_of_the_lateral_velocity(seed: int) -> None:
    motion = Motion(seed)

    def lateral(C: np.ndarray, v: np.ndarray = motion.velocity) -> float:
        return float((C.T @ v)[1])

    expected = np.zeros(STATES)
    expected[VELOCITY] = [
        lateral(motion.attitude, motion.velocity + e) - lateral(motion.attitude) for e in np.eye(3)
    ]  # linear: the step may be large
    # of angles no more than 1e-3 rad apart, so the wrapping above does nothing
    expected[ATTITUDE] = difference_by_attitude(motion, lateral)
    row = lateral_row(motion.attitude, motion.velocity)[0]
    assert row == pytest.approx(expected, rel=1e-6, abs=1e-6)


def test_gps_sees_position_and_velocity() -> None:
    assert np.array_equal(gps_rows() @ np.arange(15), np.arange(6))


def van_loan(F: np.ndarray, S: np.ndarray, step: float) -> tuple[np.ndarray, np.ndarray]:
    n = len(F)
    block = expm(np.block([[-F, S], [np.zeros((n, n)), F.T]]) * step)
    transition = block[n:, n:].T
    return transition, transition @ block[:n, n:]


def test_discretise_takes_a_step_of_its_own_for_each_matrix() -> None:
    F, S = np.random.default_rng(5).normal(size=(2, 3, 4, 4))
    steps = [0.1, 0.2, 0.4]
    found = discretise(F, S, steps)
    for i, step in enumerate(steps):
        for several, one in zip(found, discretise(F[i], S[i], step), strict=True):
            np.testing.assert_array_equal(several[i], one)


@settings(max_examples=25)
@given(st.integers(0, 2**32 - 1))
def test_discretise_errs_with_the_next_power_of_the_step(seed: int) -> None:
    """The transition is right to the third power, the covariance, a trapezium, to the second."""
    rng = np.random.default_rng(seed)
    F, root = rng.normal(size=(2, 5, 5))
    S = root @ root.T
    errors = []
    for step in (0.02, 0.01):
        found, exact = discretise(F, S, step), van_loan(F, S, step)
        errors.append([np.abs(a - b).max() for a, b in zip(found, exact, strict=True)])
        assert errors[-1][0] < step**4 * np.linalg.norm(F, 2) ** 4 / 20
        assert errors[-1][1] < step**3 * np.linalg.norm(F, 2) ** 2 * np.linalg.norm(S, 2)
    ratio = np.array(errors[0]) / errors[1]
    assert 12 < ratio[0] < 21
    assert 6 < ratio[1] < 11
