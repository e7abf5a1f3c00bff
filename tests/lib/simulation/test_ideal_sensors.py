"""Ideal sensors against the simulator of pyins."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st
from pyins import sim, strapdown, transform
from pyins.util import ACCEL_COLS, DV_COLS, GYRO_COLS, LLA_COLS, RPH_COLS, THETA_COLS

from inswsn_lib.simulation import ideal_sensors as module, vehicle_sensors
from inswsn_lib.simulation.ideal_sensors import as_increments, ideal_sensors


@given(st.integers(0, 2**32 - 1), st.floats(0.0, 2.0), st.sampled_from([0.01, 0.1]))
@settings(max_examples=25, deadline=None)
def test_they_are_what_pyins_simulates(seed: int, size: float, period: float) -> None:
    """Motions of all kinds, from a standstill to a tumbling body, anywhere but at a pole."""
    rng = np.random.default_rng(seed)
    time = np.arange(400) * period
    start = rng.uniform([-75, -180, -300], [75, 180, 9000])

    def wave(offset: float, height: float) -> np.ndarray:
        rate, phase = rng.uniform(0.1, 1.0, (2, 3))
        return offset + height * np.sin(rate * time[:, None] + 6 * phase)

    attitude, velocity = wave(rng.uniform(-1, 1), size), wave(0.0, 20 * size)
    place, body, rotation, push = ideal_sensors(time, start, attitude, velocity)
    track, imu = sim.generate_imu(time, start, np.degrees(attitude), velocity, "increment")
    assert place == pytest.approx(track[LLA_COLS].to_numpy(), rel=1e-14, abs=1e-12)
    assert body == pytest.approx(transform.mat_from_rph(track[RPH_COLS]), abs=1e-14)
    # scipy's spline stops at 1e-9 rad/s
    assert np.abs(rotation - imu[GYRO_COLS].to_numpy().T).max() < 1e-10 * period
    assert np.abs(push - imu[ACCEL_COLS].to_numpy().T).max() < 1e-10

    told = strapdown.compute_increments_from_imu(imu, "increment")
    theta, dv = as_increments(*(imu[names].to_numpy().T for names in (GYRO_COLS, ACCEL_COLS)))
    assert theta == pytest.approx(told[THETA_COLS].to_numpy().T, rel=1e-14, abs=1e-18)
    assert dv == pytest.approx(told[DV_COLS].to_numpy().T, rel=1e-14, abs=1e-18)


def test_with_numpy_alone_they_are_the_same(monkeypatch: pytest.MonkeyPatch) -> None:
    """As in a page of the book: a car that leaves a standstill and turns, on a slope."""
    time = 0.01 * np.arange(3000)
    course = 0.2 * np.sin(0.3 * time) ** 2
    speed = 10 * (1 - np.cos(0.2 * time))
    velocity = speed[:, None] * np.stack([np.cos(course), np.sin(course), 0.02 + 0 * time], 1)
    attitude = np.stack([0.01 * np.sin(time), -0.02 + 0 * time, course], axis=1)
    walk = np.random.default_rng(3).standard_normal((2, 500))
    motion = time, np.array([32.0, 118.0, 20.0]), attitude, velocity
    place, _, rotation, push = ideal_sensors(*motion)
    process = vehicle_sensors.gauss_markov(walk, 2.0, 30.0, 0.1)

    def absent(*_: object) -> None:
        raise ModuleNotFoundError

    monkeypatch.setattr(module, "CubicSpline", absent)
    monkeypatch.setattr(module, "solve_banded", absent)
    monkeypatch.setattr(vehicle_sensors, "lfilter", absent)
    alone = ideal_sensors(*motion)
    assert np.abs(alone[0] - place).max() < 1e-9  # degrees, and m
    assert np.abs(alone[2] - rotation).max() < 1e-13
    assert np.abs(alone[3] - push).max() < 1e-7  # a car gathers 1e-2 m/s in a sample
    assert (vehicle_sensors.gauss_markov(walk, 2.0, 30.0, 0.1) == process).all()
