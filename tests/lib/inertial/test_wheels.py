"""Wheels in an outage: what a speed and the road leave of the drift of an INS."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from inswsn_lib.inertial import (
    ImuNoise,
    InertialMotion,
    InertialState,
    PositionFixes,
    Start,
    WheelSpeeds,
    run_error_state,
)
from inswsn_lib.inertial.mechanization import GRAVITY
from inswsn_lib.streams import Fixes, Imu

Array = NDArray[np.float64]
NOISE = ImuNoise(5e-3, 3e-4, 1e-4, 1e-6)
PERIOD, OUTAGE = 0.01, (60.0, 90.0)


def speed_of(t: Array) -> Array:
    return 10 + 4 * np.sin(0.2 * t)


def drive(seed: int) -> tuple[Imu, Array, Array]:
    """Return what an IMU says in a car on a flat road, and time and position, exactly.

    The IMU looks 5 degrees to the left of the car's nose.
    """
    rng = np.random.default_rng(seed)
    t = np.arange(0, 100 + PERIOD / 2, PERIOD)
    heading, rate = 0.8 * np.sin(0.1 * t), 0.08 * np.cos(0.1 * t)
    way = speed_of(t)[:, None] * np.stack([np.cos(heading), np.sin(heading)], -1)
    # Simpson's rule by midpoints is exact to 1e-9 here
    middle = t[:-1] + PERIOD / 2
    turn = 0.8 * np.sin(0.1 * middle)
    half = speed_of(middle)[:, None] * np.stack([np.cos(turn), np.sin(turn)], -1)
    position = np.vstack(
        [np.zeros(2), np.cumsum(PERIOD / 6 * (way[:-1] + 4 * half + way[1:]), axis=0)]
    )
    force = np.stack([0.8 * np.cos(0.2 * t), speed_of(t) * rate, np.full(len(t), GRAVITY)], -1)
    mounted = Rotation.from_euler("z", 5, degrees=True)
    force = mounted.inv().apply(force) + NOISE.force / PERIOD**0.5 * rng.standard_normal(
        force.shape
    )
    rates = np.column_stack([np.zeros((len(t), 2)), rate])
    rates = mounted.inv().apply(rates) + NOISE.rate / PERIOD**0.5 * rng.standard_normal(rates.shape)
    force, rates = force + 0.03 * rng.standard_normal(3), rates + 1e-3 * rng.standard_normal(3)
    return Imu(t, rates, force), t, position


def run(seed: int, white: tuple[float, float, float] | None) -> tuple[float, float]:
    """Return the horizontal error at the end of the outage and what the filter says of it, m."""
    imu, t, position = drive(seed)
    rng = np.random.default_rng([seed, 1])
    times = np.arange(0.5, 100, 1.0)
    truth = np.column_stack(
        [np.interp(times, t, column) for column in position.T] + [np.zeros(len(times))]
    )
    measured = truth + rng.standard_normal(truth.shape)
    measured[(times > OUTAGE[0]) & (times < OUTAGE[1])] = np.nan
    mounted = Rotation.from_euler("z", 5, degrees=True).as_matrix()
    start = InertialState(np.zeros(3), np.array([10.0, 0.0, 0.0]), mounted)
    spread = np.repeat([1.0, 0.1, 0.01, 0.05, 2e-3], 3)
    observed: list = [PositionFixes(Fixes(times, measured), np.zeros(3), np.ones(3))]
    if white is not None:
        seconds = np.arange(0.2, 100, 0.2)
        wheels = speed_of(seconds) + white[0] * rng.standard_normal(len(seconds))
        observed.append(WheelSpeeds(seconds, wheels, mounted, np.array(white)))
    solution = run_error_state(
        InertialMotion(imu, NOISE), Start(0.0, start, np.diag(spread**2)), observed
    )
    k = int(np.searchsorted(solution.time, OUTAGE[1] - 0.5, side="right")) - 1
    true = [np.interp(solution.time[k], t, column) for column in position.T]
    said = np.sqrt(np.trace(solution.covariances[k, :2, :2]))
    return float(np.linalg.norm(solution.states[k].position[:2] - true)), float(said)


def test_a_speed_and_a_road_hold_the_drift_of_half_a_minute() -> None:
    """Five drives: metres without wheels, a tenth of it with; both as large as the filter says."""
    free = np.array([run(seed, None) for seed in range(5)])
    held = np.array([run(seed, (0.1, 0.05, 0.05)) for seed in range(5)])
    assert np.sqrt((free[:, 0] ** 2).mean()) > 4 * np.sqrt((held[:, 0] ** 2).mean())
    for found in (free, held):
        ratio = np.sqrt(((found[:, 0] / found[:, 1]) ** 2).mean())
        assert 0.25 < ratio < 2  # of five, twice two components: false alarms of 1e-4
    assert held[:, 0].max() < 3
