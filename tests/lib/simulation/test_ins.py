"""Paths against geometry, and the INS against analytic trajectories and errors."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from inswsn_lib.errors import ParameterError
from inswsn_lib.scenario import Setting, from_settings
from inswsn_lib.simulation import InertialErrors, Path, simulate_ins
from inswsn_lib.simulation.ins import inertial_errors

STRAIGHT = Path.through([(0.0, 0.0), (300.0, 400.0)], 1.0)
CORNERS = [(650.0, 0.0), (500.0, 100.0), (300.0, 90.0), (130.0, 400.0)]
BENDS = Path.through(CORNERS, 20.0)
TIME = np.linspace(0, 60, 6001)


def test_a_quarter_turn_by_hand() -> None:
    path = Path.through([(0.0, 0.0), (20.0, 0.0), (20.0, 30.0)], radius=10.0)
    assert path.length == pytest.approx(10 + 10 * np.pi / 2 + 20)
    motion = path.drive(2.0, [0.0, 5.0, 5.0 + 2.5 * np.pi / 2, 5 + 2.5 * np.pi, 10 + 2.5 * np.pi])
    assert motion.position == pytest.approx(
        np.array([
            (0, 0), (10, 0), (10 + 10 / 2**0.5, 10 - 10 / 2**0.5), (20, 10), (20, 20)
        ])
    )  # fmt: skip
    assert motion.heading == pytest.approx([0, 0, np.pi / 4, np.pi / 2, np.pi / 2])
    # the other way round
    right = Path.through([(0.0, 0.0), (20.0, 0.0), (20.0, -30.0)], radius=10.0)
    assert right.drive(2.0, motion.time).position == pytest.approx(motion.position * [1, -1])


def test_it_starts_and_ends_where_it_should_at_its_speed() -> None:
    path = BENDS
    motion = path.drive(7.5, np.linspace(0, path.length / 7.5, 4001))
    assert motion.position[0] == pytest.approx(CORNERS[0])
    assert motion.position[-1] == pytest.approx(CORNERS[-1])
    assert np.hypot(*motion.velocity.T) == pytest.approx(7.5)
    # velocity is the derivative of position, and heading its direction
    moved = np.diff(motion.position, axis=0) / motion.time[1]
    assert moved == pytest.approx((motion.velocity[1:] + motion.velocity[:-1]) / 2, abs=2e-2)
    assert np.exp(1j * motion.heading) * 7.5 == pytest.approx(motion.velocity @ [1, 1j])
    assert np.abs(np.diff(motion.heading)).max() < 0.01  # no jump by a turn


def test_it_goes_straight_on_after_its_end() -> None:
    path = Path.through([(0.0, 0.0), (3.0, 4.0)], 1.0)
    assert path.drive(1.0, [10.0]).position[0] == pytest.approx((6.0, 8.0))


@pytest.mark.parametrize(
    ("points", "radius", "said"),
    [
        ([(0, 0)], 1.0, "waypoints must be .*at least two points"),
        ([(0, 0, 0), (1, 0, 0)], 1.0, "waypoints"),
        ([(0, 0), (1, 0)], 0.0, "radius"),
        ([(0, 0), (10, 0), (10, 10)], 10.1, "small enough for arcs to fit"),
    ],
)
def test_paths_that_cannot_be(points: list[Any], radius: float, said: str) -> None:
    with pytest.raises(ParameterError, match=said):
        Path.through(points, radius)
    assert Path.through([(0, 0), (10, 0), (10, 10)], 9.9).lengths[0] == pytest.approx(0.1)


@pytest.mark.parametrize(("speed", "time"), [(0.0, [0.0]), (1.0, [0.0, -0.1]), (1.0, [[0.0]])])
def test_drives_that_cannot_be(speed: float, time: list[Any]) -> None:
    with pytest.raises(ParameterError, match="speed must be" if speed == 0 else "time must be"):
        Path.through([(0, 0), (1, 0)], 1.0).drive(speed, time)


# The INS ------------------------------------------------------------------------------------------


def errors_of(path: Path, errors: InertialErrors, time: np.ndarray = TIME) -> np.ndarray:
    motion = path.drive(7.5, time)
    ins = simulate_ins(motion, errors)[:, :, 0]
    return ins - np.hstack([motion.position, motion.velocity])


def test_ideal_sensors_give_the_truth_to_the_square_of_the_interval() -> None:
    found = errors_of(BENDS, InertialErrors())
    assert np.abs(found[:, :2]).max() < 2e-3
    assert np.abs(found[:, 2:]).max() < 1e-9
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


@pytest.mark.parametrize(("heading", "scale"), [(0.01, 0.0), (0.0, 0.05)])
def test_a_heading_or_scale_error_turns_or_stretches_what_is_added_to_the_velocity(
    heading: float, scale: float
) -> None:
    """On a bend the velocity changes by that of the truth times (1 + scale) e^(i heading)."""
    errors = InertialErrors(heading=heading, accelerometer_scale=(scale, scale))
    found = errors_of(BENDS, errors)
    motion = BENDS.drive(7.5, TIME)
    change = (motion.velocity - motion.velocity[0]) @ [1, 1j]
    expected = ((1 + scale) * np.exp(1j * heading) - 1) * change
    assert found[:, 2:] @ [1, 1j] == pytest.approx(expected, abs=1e-9)
    # on a straight way there is no change
    assert np.abs(errors_of(STRAIGHT, errors)).max() < 1e-9


def test_a_gyro_that_is_wrong_turns_the_pushes_of_a_bias_on_a_circle() -> None:
    """A bias b along the body under the rate w that the gyro tells: v = b (e^(iwt) - 1) / iw."""
    circle = Path(np.array([1000.0]), np.array([0.05]), np.zeros(2), 0.0)
    motion = circle.drive(2.0, np.linspace(0, 20, 20001))
    for errors in (InertialErrors(gyro_bias=0.02), InertialErrors(gyro_scale=0.2)):
        plain, biased = (
            simulate_ins(motion, InertialErrors(**{**vars(errors), "accelerometer_bias": bias}))
            for bias in ((0.0, 0.0), (0.1, 0.0))
        )
        rate = 0.1 * (1 + errors.gyro_scale) + errors.gyro_bias
        pushed = 0.1 * (np.exp(1j * rate * motion.time) - 1) / (1j * rate)
        assert (biased - plain)[:, 2:, 0] @ [1, 1j] == pytest.approx(pushed, abs=1e-6)


def test_random_walks_have_their_variance() -> None:
    """2,000 runs; a true simulation leaves the bounds once in 10,000 times per component."""
    motion = STRAIGHT.drive(7.5, np.linspace(0, 10, 101))
    walk = InertialErrors(accelerometer_noise=0.05)
    errors = inertial_errors(motion, walk, np.random.default_rng(8), 2000)
    # velocity: 0.05^2 t; position: 0.05^2 t^3 / 3, to the order of the interval
    expected = 0.05 * np.array([(1000 / 3) ** 0.5] * 2 + [10**0.5] * 2)
    bound = 3.9 / (2 * 2000) ** 0.5 + 0.005
    assert errors[-1].std(axis=1, ddof=1) == pytest.approx(expected, rel=bound)
    assert np.abs(errors[0]).max() == 0
    # a heading that walks by 0.01 sqrt(t) turns what a bias pushes; of the first run by ones
    noise = np.zeros((100, 3, 2000))
    noise[:, 2] = np.random.default_rng(9).standard_normal((100, 2000))
    noise[:, 2, 0] = 1
    biased = InertialErrors(gyro_noise=0.01, accelerometer_bias=(1.0, 0.0))
    last = np.diff(simulate_ins(motion, biased, noise)[:, 2:], axis=0)[-1] / 0.1
    turned = np.angle(last[0] + 1j * last[1]) - np.arctan2(4, 3)
    assert turned[0] == pytest.approx(99.5 * 0.01 * 0.1**0.5)
    assert turned[1:].std() == pytest.approx(0.01 * 9.95**0.5, rel=bound)


def made(values: dict[str, Any]) -> InertialErrors:
    settings = {name: Setting(value, "1", "assumed", "So.") for name, value in values.items()}
    return from_settings(InertialErrors, settings)


def test_errors_are_none_unless_told_have_either_sign_and_noise_has_none() -> None:
    pairs = ("accelerometer_bias", "accelerometer_scale", "position", "velocity")
    noises = ("accelerometer_noise", "gyro_noise")
    values = {name: [-0.1, -0.2] for name in pairs} | dict.fromkeys(noises, 0.3)
    values |= dict.fromkeys(("gyro_bias", "gyro_scale", "heading"), -0.4)
    as_tuples = {n: tuple(v) if isinstance(v, list) else v for n, v in values.items()}
    assert vars(made(values)) == as_tuples
    assert made({n: [0, 0] if n in pairs else 0 for n in values}) == InertialErrors()
    for name in noises:
        with pytest.raises(ParameterError, match=rf"^{name} .* not -0.1"):
            made(values | {name: -0.1})


def test_noise_that_does_not_fit_is_refused() -> None:
    with pytest.raises(ParameterError, match=r"noise .* not of shape"):
        simulate_ins(STRAIGHT.drive(7.5, TIME), InertialErrors(), np.zeros((6001, 3, 1)))
