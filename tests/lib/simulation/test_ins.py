"""The INS against analytic trajectories and errors."""

from __future__ import annotations

import numpy as np
import pytest

from inswsn_lib.errors import ParameterError
from inswsn_lib.simulation import InertialErrors, Path, simulate_ins

STRAIGHT = Path.through([(0.0, 0.0), (300.0, 400.0)], 1.0)
BENDS = Path.through([(650.0, 0.0), (500.0, 100.0), (300.0, 90.0), (130.0, 400.0)], 20.0)
TIME = np.linspace(0, 60, 6001)


def errors_of(path: Path, errors: InertialErrors, time: np.ndarray = TIME) -> np.ndarray:
    motion = path.drive(7.5, time)
    ins = simulate_ins(motion, errors)[:, :, 0]
    return ins - np.hstack([motion.position, motion.velocity])


def test_ideal_sensors_give_the_truth() -> None:
    found = errors_of(BENDS, InertialErrors())
    assert np.abs(found[:, :2]).max() < 2e-3
    assert np.abs(found[:, 2:]).max() < 1e-9


def test_it_converges_as_the_square_of_the_interval() -> None:
    coarse = np.abs(errors_of(BENDS, InertialErrors(), np.linspace(0, 60, 1501))).max()
    fine = np.abs(errors_of(BENDS, InertialErrors(), np.linspace(0, 60, 3001))).max()
    assert coarse / fine > 3  # where an arc begins within an interval matters as well


def test_constant_biases_on_a_straight_road() -> None:
    """Along (0.6, 0.8): p = p0 + v0 t + b t^2 / 2."""
    found = errors_of(
        STRAIGHT,
        InertialErrors(accelerometer_bias=(0.02, -0.01), position=(1.0, 2.0), velocity=(0.3, -0.1)),
    )
    b = 0.02 * np.array([0.6, 0.8]) - 0.01 * np.array([-0.8, 0.6])
    t = TIME[:, None]
    assert found[:, 2:] == pytest.approx(np.array([0.3, -0.1]) + b * t, abs=1e-9)
    assert found[:, :2] == pytest.approx(
        np.array([1.0, 2.0]) + np.array([0.3, -0.1]) * t + b * t**2 / 2, abs=1e-6
    )


def test_a_heading_error_turns_what_is_added_to_the_velocity() -> None:
    """On a bend the velocity change is turned by the heading error; start and end differ by it."""
    found = errors_of(BENDS, InertialErrors(heading=0.01))
    motion = BENDS.drive(7.5, TIME)
    change = motion.velocity - motion.velocity[0]
    c, s = np.cos(0.01) - 1, np.sin(0.01)
    expected = np.stack(
        [c * change[:, 0] - s * change[:, 1], s * change[:, 0] + c * change[:, 1]], 1
    )
    assert found[:, 2:] == pytest.approx(expected, abs=1e-9)


def test_a_scale_error_shows_in_the_turns_only() -> None:
    straight = errors_of(STRAIGHT, InertialErrors(accelerometer_scale=(0.1, 0.1), gyro_scale=0.1))
    assert np.abs(straight).max() < 1e-9
    bent = errors_of(BENDS, InertialErrors(accelerometer_scale=(0.1, 0.1)))
    assert np.abs(bent[-1, 2:]).max() > 0.1


def test_velocity_random_walk_has_its_variance() -> None:
    """2,000 runs; a true simulation leaves the bounds once in 10,000 times per component."""
    motion = STRAIGHT.drive(7.5, np.linspace(0, 10, 101))
    noise = np.random.default_rng(8).standard_normal((100, 3, 2000))
    ins = simulate_ins(motion, InertialErrors(accelerometer_noise=0.05), noise)
    # velocity: 0.05^2 t; position: 0.05^2 t^3 / 3, to the order of the interval
    spread = ins[-1].std(axis=1, ddof=1)
    expected = 0.05 * np.array([(1000 / 3) ** 0.5] * 2 + [10**0.5] * 2)
    assert spread == pytest.approx(expected, rel=3.9 / (2 * 2000) ** 0.5 + 0.005)


def test_noise_that_does_not_fit_is_refused() -> None:
    motion = STRAIGHT.drive(7.5, TIME)
    with pytest.raises(ParameterError, match="noise is 'of shape"):
        simulate_ins(motion, InertialErrors(), np.zeros((6001, 3, 1)))
