"""Sensors: derivatives by differences, what they expect by other ways, and a user's own."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from lib.inertial.made import LEVER_ARM, Path, compass, fixes_of, motion_on
from scipy.spatial.transform import Rotation

from inswsn_lib import inertial as nav
from inswsn_lib.checks import Array
from inswsn_lib.inertial import sensors
from inswsn_lib.inertial.plain import expected
from inswsn_lib.streams import Fixes

EARTH = nav.Earth(0.56, 2.07, 20.0)
#: A sensor, what it is told, and how exact its row is: a heading leaves out how east turns
CASES: list[tuple[Any, list[float]]] = [
    (sensors.position, [0.6, 0.0, 0.8, 1]),
    (sensors.velocity, [0.6, 0.0, 0.8, 0.3, -0.2, 0.5, 0.4, 0.1, -0.3]),
    (sensors.distance, [3.0, -4.0, 1.0, 0, 1, 2]),
    (sensors.body_velocity, [0.0, -1.0, 0.1, 1.0, 0.0, 0.2, 2]),
    (sensors.body_velocity, [0.6, 0.8, 0.0, 0.0, 0.0, 0.0, -1]),
    (sensors.heading, [1.0, 0.1, 0.0, *EARTH.numbers, 0, 2]),
    (sensors.heading, [0.0, 1.0, 0.1, 0.0, 0.0, 0.0, 0.0, -1, 1]),
]


def told(sensor: Any, state: nav.InertialState, data: list[float]) -> tuple[Array, Array]:
    found, rows = expected(
        state.row[None], 15, 15 + len(state.own), [sensor], np.array([data]), LEVER_ARM[None],
        np.array([[0.0, len(state.own)]]),
    )  # fmt: skip
    return found[0], rows[0]


@pytest.mark.parametrize(("sensor", "data"), CASES)
def test_derivatives_are_differences(sensor: Any, data: list[float]) -> None:
    rng = np.random.default_rng(1)
    state = nav.InertialState(
        *rng.normal(size=(2, 3)), Rotation.from_euler("ZYX", [2.0, 0.3, -0.2]).as_matrix(),
        own=0.1 * rng.normal(size=3),
    )  # fmt: skip
    _, rows = told(sensor, state, data)
    for column in range(18):
        step = 1e-6 * np.eye(18)[column]
        ahead, behind = (told(sensor, state.plus(s), data)[0] for s in (step, -step))
        assert (ahead - behind) / 2e-6 == pytest.approx(rows[:, column], abs=1e-6)


@pytest.mark.parametrize("away", [0.0, 15e3])
def test_a_heading_is_that_at_its_place(away: float) -> None:
    """Forward by roll, pitch and yaw in axes east, north, up of a place 15 km off."""
    there = np.array([EARTH.latitude + away / 6.37e6, EARTH.longitude + away / 5e6, 400.0])
    place = EARTH.local(there)
    body = Rotation.from_euler("ZYX", [2.5, -0.2, 0.3]).as_matrix()
    state = nav.InertialState(place, np.zeros(3), EARTH.ground(place).axes @ body)
    found, _ = told(sensors.heading, state, [1.0, 0.0, 0.0, *EARTH.numbers, -1, -1])
    assert found[0] == pytest.approx(2.5, abs=1e-7)


def test_velocities_of_antenna_and_wheels_are_those_of_the_body() -> None:
    """The way of the antenna, by differences; a car whose IMU is turned in it."""
    path, t = Path(), np.array([0.7])
    moved = (path.antenna(t + 1e-4) - path.antenna(t - 1e-4)) / 2e-4
    state = path.state(0.7)
    turned = state.attitude
    seen = nav.Velocities(t, moved, np.ones(3), path.rate(t), LEVER_ARM)
    axes = Rotation.from_euler("ZYX", [0.4, 0.2, -0.1]).as_matrix()
    car = nav.InertialState(np.zeros(3), turned @ axes.T @ [9.0, 0.0, 0.0], turned)
    wheels = nav.WheelSpeeds(t, np.array([9.0]), axes, np.ones(3))
    for one, where in ((seen, state), (wheels, car)):
        got = one.innovation(0, where, np.zeros(0))
        assert got is not None
        assert got.value == pytest.approx(np.zeros(3), abs=1e-6)


def along(x: Any, own: Any, data: Any, row: Any) -> Any:
    """Return the position along an axis, as a user would write it."""
    found = 0.0 * x[0]
    for i in range(3):
        row[i] = data[i]
        found = found + data[i] * x[i]
    return found


def case() -> tuple[Any, nav.Start, Fixes]:
    rng, path = np.random.default_rng(3), Path()
    fixes = fixes_of(path, 10.0, 0.1 * rng.standard_normal((49, 3)))
    motion = motion_on(path, 10.0, rng, earth=EARTH)
    spread = np.repeat([0.1, 0.05, 0.05, 0.05, 0.003], 3)
    return motion, nav.Start(0.0, path.state(0.0), np.diag(spread**2)), fixes


def test_a_users_own_sensor_is_as_good_as_one_of_the_library() -> None:
    motion, start, fixes = case()
    own = nav.Sensor(
        along, fixes.time, fixes.position, np.full(3, 0.1), np.eye(3), lever_arm=LEVER_ARM
    )
    built_in = nav.PositionFixes(fixes, LEVER_ARM, np.full(3, 0.1))
    one, other = (nav.run_error_state(motion, start, [each]) for each in (own, built_in))
    assert np.array_equal(one.position, other.position)
    assert one.log_likelihood == other.log_likelihood


def test_each_measurement_may_have_its_own_deviation() -> None:
    """Those that are worth nothing are as good as missing."""
    motion, start, fixes = case()
    white = np.full(fixes.position.shape, 0.1)
    white[::2] = 1e6
    some = Fixes(fixes.time[1::2], fixes.position[1::2])
    one, other = (
        nav.run_error_state(motion, start, [nav.PositionFixes(f, LEVER_ARM, w)])
        for f, w in ((fixes, white), (some, white[1::2]))
    )
    assert one.position[1::2] == pytest.approx(other.position, abs=1e-6)


def test_a_gate_may_be_of_one_sensor_alone() -> None:
    motion, start, fixes = case()
    headings = np.where(np.arange(len(fixes)) % 5, 0.6 * fixes.time, 3.0)
    seen = compass(fixes.time, headings, 0.05, EARTH, gate=25.0)
    false = Fixes(fixes.time, fixes.position + (np.arange(len(fixes)) == 30)[:, None])
    fixed = nav.PositionFixes(false, LEVER_ARM, np.full(3, 0.1))
    found = nav.run_error_state(motion, start, [fixed, seen])
    assert np.concatenate(found.innovations[0].used).all()
    used = np.concatenate(found.innovations[1].used)
    assert np.array_equal(used, np.abs(np.angle(np.exp(1j * (headings - 0.6 * fixes.time)))) < 0.3)


def test_a_start_may_share_errors_with_the_sensors_own_states() -> None:
    """A compass that made the heading: the same again says nothing new of their common bias."""
    motion, start, fixes = case()
    bias = {"deviations": np.array([0.1]), "times": np.array([np.inf])}
    seen = compass(fixes.time[:1], 0.6 * fixes.time[:1], 1e-3, EARTH, **bias)
    P = np.zeros((16, 16))
    P[:15, :15] = start.covariance
    about = start.state.attitude[2]  # the vertical, in the body
    P[6:9, 6:9], P[15, 15] = 0.01 * np.outer(about, about) + 1e-10 * np.eye(3), 0.01
    P[6:9, 15] = P[15, 6:9] = -0.01 * about
    shared = nav.Start(0.0, start.state, P)
    found = nav.run_error_state(motion, shared, [seen])
    after = found.covariances[0]
    assert about @ after[6:9, 6:9] @ about == pytest.approx(0.01, rel=0.01)
    blind = nav.run_error_state(motion, nav.Start(0.0, start.state, P[:15, :15]), [seen])
    assert about @ blind.covariances[0][6:9, 6:9] @ about == pytest.approx(0.005, rel=0.01)
