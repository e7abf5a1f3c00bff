"""P3's equations against differences of the full mechanisation, and closed forms."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st
from inswsn_book.evidence.p3_equations import (
    compass_row,
    discretise,
    error_dynamics,
    lateral_row,
    sequential_update,
)
from lib.vehicle.made_drive import TURN
from pyins import earth
from pyins.strapdown import integrate
from scipy.linalg import expm
from scipy.spatial.transform import Rotation

from inswsn_lib.inertial import metres
from inswsn_lib.vehicle import STATES
from inswsn_lib.vehicle.state import ACCELEROMETER_BIAS, ATTITUDE, GYRO_DRIFT, POSITION, VELOCITY

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
    told = [(m.position, m.velocity, m.attitude, m.attitude @ m.force) for m in parts]
    p, v, C, f = (np.stack(x).reshape(2, 3, *x[0].shape) for x in zip(*told, strict=True))
    stacks = error_dynamics(p, v, C, f), compass_row(C), lateral_row(C, v)
    for i, motion in enumerate(parts):
        C, v = motion.attitude, motion.velocity
        for whole, part in zip(
            stacks, (motion.dynamics(), compass_row(C), lateral_row(C, v)), strict=True
        ):
            assert whole[np.unravel_index(i, (2, 3))] == pytest.approx(part, rel=1e-12, abs=1e-18)


@given(st.integers(0, 2**32 - 1))
def test_rows_are_derivatives_of_yaw_and_lateral_velocity(seed: int) -> None:
    motion, h = Motion(seed), 1e-5
    C, v = motion.attitude, motion.velocity
    turned = [Rotation.from_rotvec(-h * np.vstack([e, -e])).as_matrix() @ C for e in np.eye(3)]
    expected = np.zeros((2, STATES))
    expected[1, VELOCITY] = C[:, 1]  # of what is linear
    for i, X in enumerate(turned):
        angles = np.arctan2(X[:, 0, 0], X[:, 1, 0])
        expected[0, 6 + i] = np.angle(np.exp(1j * (angles[0] - angles[1]))) / (2 * h)
        expected[1, 6 + i] = (X[0].T @ v - X[1].T @ v)[1] / (2 * h)
    assert lateral_row(C, v)[0] == pytest.approx(expected[1], rel=1e-6, abs=1e-6)
    if np.abs(C[2, 0]) < 0.95:  # a car that stands on its nose has no yaw
        assert compass_row(C)[0] == pytest.approx(expected[0], rel=1e-6, abs=1e-6)


@settings(max_examples=25)
@given(st.integers(0, 2**32 - 1))
def test_discretise_errs_with_the_next_power_of_the_step(seed: int) -> None:
    """The transition is right to the third power, the covariance, a trapezium, to the second.

    Exact is the way of Van Loan; each matrix of a stack has a step of its own.
    """
    rng, steps, errors = np.random.default_rng(seed), [0.02, 0.01], []
    F, root = rng.normal(size=(2, 5, 5))
    S, size = root @ root.T, np.linalg.norm(F, 2)
    for step, *found in zip(steps, *discretise(np.stack([F, F]), S, steps), strict=True):
        block = expm(np.block([[-F, S], [np.zeros((5, 5)), F.T]]) * step)
        exact = block[5:, 5:].T, block[5:, 5:].T @ block[:5, 5:]
        errors.append([np.abs(a - b).max() for a, b in zip(found, exact, strict=True)])
        assert errors[-1][0] < step**4 * size**4 / 20
        assert errors[-1][1] < step**3 * size**2 * np.linalg.norm(S, 2)
    ratio = np.array(errors[0]) / errors[1]
    assert 12 < ratio[0] < 21
    assert 6 < ratio[1] < 11


@given(st.integers(0, 2**32 - 1), st.integers(1, 4))
def test_group_after_group_is_all_at_once(seed: int, first: int) -> None:
    """P3 Section 3.3: for a block-diagonal R the sequence gives the centralised update.

    That in the form in which information adds, of the measurements that are used.
    """
    rng = np.random.default_rng(seed)
    x, z, H, R = (rng.normal(size=s) for s in ((3, 6), (3, 5), (3, 5, 6), 5))
    R, root, used = 0.1 + R**2, rng.normal(size=(3, 6, 6)), rng.random((3, 5)) < 0.7
    P = root @ np.swapaxes(root, 1, 2) + 0.1 * np.eye(6)
    xs, Ps = x, P
    for part in (slice(0, first), slice(first, 5)):
        told = np.where(used, z, 1e9)[:, part], H[:, part], R[part]
        before = xs, Ps
        xs, Ps, nu, S = sequential_update(xs, Ps, *told, used[:, part])
        assert nu == pytest.approx(told[0] - (told[1] @ before[0][..., None])[..., 0])
        expected = told[1] @ before[1] @ np.swapaxes(told[1], 1, 2) + np.diag(told[2])
        assert np.allclose(S, expected)
    for r, rows in enumerate(used):
        weighed = (H[r][rows].T / R[rows]) @ np.column_stack([H[r][rows], z[r][rows]])
        information = np.linalg.inv(P[r])
        covariance = np.linalg.inv(information + weighed[:, :6])
        expected = covariance @ (information @ x[r] + weighed[:, 6])
        assert xs[r] == pytest.approx(expected, rel=1e-6, abs=1e-6)
        assert Ps[r] == pytest.approx(covariance, rel=1e-6, abs=1e-6)
