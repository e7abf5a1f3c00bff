"""Strapdown integration and dead reckoning on exact paths, their derivatives by differences."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st
from lib.inertial.made import Path, ahead, imu_of
from scipy.spatial.transform import Rotation

from inswsn_lib import inertial as nav
from inswsn_lib.inertial.mechanization import rotation_vector, turned
from inswsn_lib.streams import Imu, Odometry

QUIET = nav.ImuNoise(0.0, 0.0, 0.0, 0.0)
STILL = nav.OdometryNoise(0.0, 0.0, 0.0, 0.0)


def test_it_follows_an_exact_path() -> None:
    """Samples of 100 Hz, means of neighbours taken as constant: an error of second order."""
    path, seconds = Path(), 10.0
    start = path.state(0.0)
    end, _, _ = ahead(nav.InertialMotion(imu_of(path, seconds), QUIET), 0.0, seconds, start)
    assert end.position == pytest.approx(path.position(np.array(seconds)), abs=2e-3)
    assert end.velocity == pytest.approx(path.velocity(np.array(seconds)), abs=5e-4)
    apart = Rotation.from_matrix(end.attitude.T) * path.attitude(np.array(seconds))
    assert apart.magnitude() < 1e-4


def test_events_between_samples_do_not_change_the_way() -> None:
    path = Path()
    motion = nav.InertialMotion(imu_of(path, 2.0), QUIET)
    start = path.state(0.0)
    once, _, _ = ahead(motion, 0.0, 2.0, start)
    events = np.sort(np.append(np.random.default_rng(1).uniform(0, 2, 50), 2.0))
    state = start
    for begin, end in pairwise([0.0, *events]):
        state, _, _ = ahead(motion, begin, end, state)
    assert state.minus(once) == pytest.approx(np.zeros(15), abs=2e-5)


@pytest.mark.parametrize("seed", range(3))
def test_the_transition_is_the_derivative(seed: int) -> None:
    rng = np.random.default_rng(seed)
    path = Path(float(seed))
    motion = nav.InertialMotion(imu_of(path, 1.0), QUIET)
    biases = rng.normal(0, 0.1, 3), rng.normal(0, 0.01, 3)
    start = replace(path.state(0.0), force_bias=biases[0], rate_bias=biases[1])
    end, Phi, _ = ahead(motion, 0.0, 1.0, start)
    for column in range(15):
        step = np.zeros(15)
        step[column] = 1e-5
        one, two = (ahead(motion, 0.0, 1.0, start.plus(s))[0].minus(end) for s in (step, -step))
        # of second order in the length of a sample
        assert (one - two) / 2e-5 == pytest.approx(Phi[:, column], abs=1e-3)


@pytest.mark.parametrize("size", [0.0, 1e-12, 1e-7, 0.1, 3.0, np.pi - 1e-9, np.pi])
def test_turns_and_their_vectors_are_those_of_scipy(size: float) -> None:
    rng = np.random.default_rng(6)
    for axis in (*rng.standard_normal((20, 3)), *np.eye(3), *-np.eye(3)):
        vector = size * axis / np.linalg.norm(axis)
        turn = Rotation.from_rotvec(vector).as_matrix()
        found = rotation_vector(turn)
        np.testing.assert_allclose(turned(vector), turn, atol=1e-12)
        np.testing.assert_allclose(Rotation.from_rotvec(found).as_matrix(), turn, atol=1e-12)
        assert abs(np.linalg.norm(found) - size) < 1e-12 + 1e-7 * (size > 3.1)


@settings(max_examples=50, deadline=None)
@given(st.integers(0, 10**6))
def test_plus_undoes_minus(seed: int) -> None:
    rng = np.random.default_rng(seed)
    one, other = (
        nav.InertialState(
            *rng.normal(size=(2, 3)), turn, *rng.normal(size=(2, 3)), rng.normal(size=2)
        )
        for turn in Rotation.random(2, rng=rng).as_matrix()
    )
    again = other.plus(one.minus(other))
    assert again.attitude == pytest.approx(one.attitude, abs=1e-9)
    assert again.minus(one) == pytest.approx(np.zeros(17), abs=1e-9)
    flat, level = (
        nav.PlanarState(
            rng.normal(size=2), rng.uniform(-3, 3), *rng.normal(size=2), 1.0, rng.normal(size=2)
        )
        for _ in range(2)
    )
    assert level.plus(flat.minus(level)).minus(flat) == pytest.approx(np.zeros(7), abs=1e-9)


def test_dead_reckoning_of_a_circle() -> None:
    """A mean heading over each piece is exact to the third power of the turn."""
    t = np.arange(0, 2 * np.pi + 0.05, 0.05)
    odometry = Odometry(t, np.full(len(t), 2.0), np.full(len(t), 1.0))
    motion = nav.OdometryMotion(odometry, STILL)
    half, _, _ = ahead(motion, 0.0, np.pi, nav.PlanarState(np.zeros(2), 0.0))
    assert half.position == pytest.approx([0.0, 4.0], abs=2e-3)
    full, _, _ = ahead(motion, np.pi, 2 * np.pi, half)
    assert full.position == pytest.approx([0.0, 0.0], abs=2e-3)
    assert full.velocity == pytest.approx([2.0, 0.0], abs=1e-9)


def test_the_transition_of_dead_reckoning_is_the_derivative() -> None:
    rng = np.random.default_rng(3)
    t = np.arange(0, 2, 0.1)
    motion = nav.OdometryMotion(
        Odometry(t, rng.uniform(0, 2, len(t)), rng.normal(0, 0.5, len(t))), STILL
    )
    start = nav.PlanarState(np.array([1.0, 2.0]), 0.4, 0.05, 0.02)
    end, Phi, Q = ahead(motion, 0.0, 1.77, start)
    assert not Q.any()
    for column in range(5):
        step = np.zeros(5)
        step[column] = 1e-6
        one, two = (ahead(motion, 0.0, 1.77, start.plus(s))[0].minus(end) for s in (step, -step))
        assert (one - two) / 2e-6 == pytest.approx(Phi[:, column], abs=1e-6)


def test_the_noise_of_dead_reckoning_is_that_of_many_runs() -> None:
    """White noise on speed and rate, 4000 runs; deviations have a relative error of 1.1 %."""
    rng, t = np.random.default_rng(5), np.arange(0, 10.01, 0.1)
    speed, rate = np.full(len(t), 1.5), np.full(len(t), 0.2)
    noise = nav.OdometryNoise(0.02, 0.01, 0.0, 0.0)
    motion = nav.OdometryMotion(Odometry(t, speed, rate), noise)
    _, _, Q = ahead(motion, 0.0, 10.0, nav.PlanarState(np.zeros(2), 0.0))
    runs = 4000
    u = speed[1:, None] + 0.02 / 0.1**0.5 * rng.standard_normal((100, runs))
    w = rate[1:, None] + 0.01 / 0.1**0.5 * rng.standard_normal((100, runs))
    heading = np.cumsum(0.1 * w, axis=0)
    middle = heading - 0.05 * w
    ends = np.stack(
        [(0.1 * u * np.cos(middle)).sum(0), (0.1 * u * np.sin(middle)).sum(0), heading[-1]]
    )
    assert np.sqrt(np.diag(np.cov(ends))) == pytest.approx(np.sqrt(np.diag(Q)[:3]), rel=0.06)


def test_what_was_cut_is_of_these_samples_alone() -> None:
    """Another noise has the same pieces; other samples at the same times have their own."""
    time, events = 0.01 * np.arange(200), np.array([0.5, 1.0])
    one = Imu(time, np.ones((200, 3)), np.zeros((200, 3)))
    motion = nav.InertialMotion(one, nav.ImuNoise(0.1, 0.1, 0.1, 0.1))
    steps = motion.between(0.0, events)
    louder = replace(motion, noise=nav.ImuNoise(0.2, 0.1, 0.1, 0.1)).between(0.0, events)
    assert (louder.forces is steps.forces, louder.densities[0]) == (True, 0.2)
    other = replace(motion, imu=replace(one, rate=2 * one.rate)).between(0.0, events)
    assert other.rates == pytest.approx(2 * steps.rates)
    assert motion.between(0.5, events[1:]).rates.shape[1] == 50
