"""The error model by finite differences: against closed forms at rest, and what it can tell."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, strategies as st
from numpy.typing import NDArray
from pyins import earth
from scipy.spatial.transform import Rotation

from inswsn_lib.vehicle import (
    compass_row,
    error_dynamics,
    gps_rows,
    lateral_row,
    numeric_dynamics,
    numeric_rows,
    row_difference,
)

Array = NDArray[np.float64]

LATITUDE, HEIGHT = 0.56, 20.0
PLACE = np.array([LATITUDE, 2.07, HEIGHT])
OMEGA = 7.292115e-5  # rad/s, WGS 84
A, E2 = 6378137.0, 6.69437999014e-3  # m, 1
W = np.sqrt(1 - E2 * np.sin(LATITUDE) ** 2)
EAST, NORTH = A / W + HEIGHT, A * (1 - E2) / W**3 + HEIGHT  # radii across and along the meridian
# Somigliana, falling by 2 / A of itself a metre, as pyins has it
G0 = (
    9.7803253359
    * (1 + 0.00193185265241 * np.sin(LATITUDE) ** 2)
    / np.sqrt(1 - 0.00669437999013 * np.sin(LATITUDE) ** 2)
)
GRAVITY = G0 * (1 - 2 * HEIGHT / A)
P, V, PHI, ACC, GYRO = (slice(i, i + 3) for i in range(0, 15, 3))
SIZES = np.concatenate([[NORTH, EAST * np.cos(LATITUDE)], np.ones(13)])


def cross(v: Array) -> Array:
    """Return the matrix of a cross product, column by column."""
    return np.column_stack([np.cross(v, unit) for unit in np.eye(3)])


def turned(yaw: float, pitch: float, roll: float) -> Array:
    """Return body (forward, right, down) to east-north-up."""
    down = Rotation.from_euler("ZYX", [yaw, pitch, roll]).as_matrix()
    return np.array([[0, 1, 0], [1, 0, 0], [0, 0, -1]]) @ down


# sensors of a car that stands: gravity's opposite, and the earth's rotation
ATTITUDE = turned(0.7, 0.1, -0.05)
EARTH = OMEGA * np.array([0, np.cos(LATITUDE), np.sin(LATITUDE)])
FORCE = np.array([0, 0, GRAVITY])


@pytest.fixture(scope="module")
def at_rest() -> Array:
    return numeric_dynamics(PLACE, np.zeros(3), ATTITUDE, ATTITUDE.T @ FORCE, ATTITUDE.T @ EARTH)


def test_gravity_is_that_of_pyins() -> None:
    """The closed forms below have their own constants."""
    assert earth.gravity(np.rad2deg(LATITUDE), HEIGHT) == pytest.approx(GRAVITY, rel=1e-7)
    assert earth.RATE == OMEGA


def test_a_tilt_pulls_gravity_to_the_side(at_rest: Array) -> None:
    """f x phi with f = (0, 0, g): east -g phi_N, north g phi_E, up nothing."""
    expected = GRAVITY * np.array([[0, -1, 0], [1, 0, 0], [0, 0, 0]])
    assert at_rest[V, PHI] == pytest.approx(expected, abs=1e-4)
    assert expected == pytest.approx(cross(FORCE))


def test_the_horizontal_channel_swings_with_schulers_period(at_rest: Array) -> None:
    """A velocity tilts the level by v / R, the tilt brakes it by g: 2 pi sqrt(R / g), 84 min."""
    for velocity, tilt, radius in ((4, 6, NORTH), (3, 7, EAST)):
        product = at_rest[velocity, tilt] * at_rest[tilt, velocity]
        assert product < 0
        period = 2 * np.pi / np.sqrt(-product) / 60
        assert period == pytest.approx(2 * np.pi * np.sqrt(radius / GRAVITY) / 60, rel=1e-4)
        assert period == pytest.approx(84.4, abs=0.5)
    # the east-west channel tilts the azimuth as well
    assert at_rest[8, 3] == pytest.approx(np.tan(LATITUDE) / EAST, rel=1e-4)
    still = at_rest[PHI, V] - np.array(
        [[0, -1 / NORTH, 0], [1 / EAST, 0, 0], [np.tan(LATITUDE) / EAST, 0, 0]]
    )
    assert np.abs(still).max() < 1e-6 / EAST * 100


def test_positions_grow_by_velocities(at_rest: Array) -> None:
    expected = np.array([[0, 1 / NORTH, 0], [1 / (EAST * np.cos(LATITUDE)), 0, 0], [0, 0, 1]])
    assert at_rest[P, V] * SIZES[P, None] == pytest.approx(expected * SIZES[P, None], abs=1e-5)


def test_the_earth_turns_velocity_and_attitude(at_rest: Array) -> None:
    """-2 omega x dv and -omega x phi, the latter with the error of latitude in omega."""
    assert at_rest[V, V] == pytest.approx(-2 * cross(EARTH), abs=1e-9)
    assert at_rest[PHI, PHI] == pytest.approx(-cross(EARTH), abs=1e-9)
    expected = np.zeros((3, 3))
    expected[1:, 0] = OMEGA * np.array([-np.sin(LATITUDE), np.cos(LATITUDE)])
    assert at_rest[PHI, P] / SIZES[P] == pytest.approx(expected / SIZES[P], abs=1e-3 * OMEGA / A)


def test_height_is_unstable(at_rest: Array) -> None:
    """Gravity falls by twice g over the radius; in free air it is 3.086e-6 1/s^2."""
    assert at_rest[5, 2] == pytest.approx(2 * G0 / A, rel=1e-3)
    assert at_rest[5, 2] == pytest.approx(3.086e-6, rel=1e-2)


def test_biases_are_turned_into_the_frame_and_stay(at_rest: Array) -> None:
    assert at_rest[V, ACC] == pytest.approx(ATTITUDE, abs=1e-6)
    assert at_rest[PHI, GYRO] == pytest.approx(-ATTITUDE, abs=1e-6)
    assert not at_rest[9:].any()
    assert np.abs(at_rest[PHI, ACC]).max() < 1e-9
    assert np.abs(at_rest[P, ACC] * SIZES[P, None]).max() < 1e-5


# --- in motion: F against it block by block ---


MOVING = {
    "straight": (np.array([9.0, 8.0, 0.2]), np.array([0.1, 0.0, -9.8]), np.zeros(3)),
    "in a turn": (np.array([-4.0, 5.0, -0.1]), np.array([0.5, 2.2, -9.9]), np.array([0, 0, 0.35])),
    "braking": (np.array([2.0, -12.0, 0.1]), np.array([-2.0, 0.1, -9.7]), np.array([0.0, 0.03, 0])),
}


def blocks(found: Array, expected: Array) -> Array:
    """Return the largest difference in each block of three by three, over its largest entry."""
    scale = np.outer(SIZES, 1 / SIZES)
    cells = [np.abs(x * scale).reshape(5, 3, 5, 3) for x in (found - expected, expected)]
    gap, size = (x.max(axis=(1, 3)) for x in cells)
    return np.divide(gap, size, out=np.zeros((5, 5)), where=size > 0)


@pytest.fixture(scope="module", params=list(MOVING))
def pair(request: pytest.FixtureRequest) -> tuple[Array, Array]:
    velocity, force, rate = MOVING[request.param]
    numeric = numeric_dynamics(PLACE, velocity, ATTITUDE, force, rate)
    return numeric, error_dynamics(PLACE, velocity, ATTITUDE, ATTITUDE @ force)


def test_the_error_model_agrees_block_by_block(pair: tuple[Array, Array]) -> None:
    """Each block has its own scale, so that Coriolis counts as much as gravity.

    The columns of position hold what the standard form leaves out, the change of gravity and of the
    radii with latitude: of one size with what it has.
    """
    apart = blocks(*pair)
    assert apart[:, 1:].max() < 1e-4
    assert apart[1:, 0].max() < 1e-2
    assert apart[0, 0] < 0.5
    # what is not zero in the one is not zero in the other
    assert row_difference(*pair, PLACE) < 2e-4


@pytest.mark.parametrize("change", [-1.0, 0.0], ids=["wrong sign", "left out"])
def test_a_term_that_is_wrong_shows(pair: tuple[Array, Array], change: float) -> None:
    """Of every entry but those of position's columns, however small it is in its row."""
    numeric, F = pair
    places = [(i, j) for i, j in zip(*np.nonzero(F), strict=True) if j >= 3]
    assert len(places) >= 40
    right = blocks(numeric, F)
    for i, j in places:
        wrong = F.copy()
        wrong[i, j] *= change
        shown = blocks(numeric, wrong)[i // 3, j // 3]
        assert shown > max(10 * right[i // 3, j // 3], 1e-5), (i, j)


def test_the_rows_agree_and_a_wrong_one_shows() -> None:
    velocity = MOVING["in a turn"][0]
    found = numeric_rows(PLACE, velocity, ATTITUDE)
    rows = [compass_row(ATTITUDE), lateral_row(ATTITUDE, velocity), gps_rows()]
    expected = np.concatenate(rows)
    for part in (slice(0, 1), slice(1, 2), slice(2, 8)):
        assert row_difference(found[part], expected[part], PLACE) < 1e-5
    for i, j in zip(*np.nonzero(expected[:2]), strict=True):
        wrong = expected.copy()
        wrong[i, j] *= -1
        assert row_difference(found[[i]], wrong[[i]], PLACE) > 1e-2


# --- the measure ---


def test_a_difference_is_a_share_of_the_largest_entry_of_its_row() -> None:
    expected = np.zeros((2, 15))
    expected[0, 3:6] = [2.0, -8.0, 1.0]
    expected[1, 12] = 0.01
    found = expected.copy()
    assert row_difference(found, expected, PLACE) == 0
    found[0, 5] += 0.4
    assert row_difference(found, expected, PLACE) == pytest.approx(0.4 / 8)
    found[1, 0] += 0.001 * NORTH  # a latitude of so much a metre
    assert row_difference(found, expected, PLACE) == pytest.approx(0.001 / 0.01)
    found[1, 12] = -0.01
    assert row_difference(found, expected, PLACE) == pytest.approx(2)


@given(st.integers(0, 10**6), st.floats(1e-6, 1e6))
def test_the_units_of_a_row_do_not_matter(seed: int, size: float) -> None:
    rng = np.random.default_rng(seed)
    expected = rng.normal(size=(4, 15)) * SIZES
    found = expected + 0.01 * rng.normal(size=(4, 15)) * SIZES
    scale = np.array([size, 1.0, 1 / size, 7.0])[:, None]
    plain = row_difference(found, expected, PLACE)
    assert row_difference(scale * found, scale * expected, PLACE) == pytest.approx(plain)
    by_hand = max(
        max(abs((found[i, j] - expected[i, j]) / SIZES[j]) for j in range(15))
        / max(abs(expected[i, j] / SIZES[j]) for j in range(15))
        for i in range(4)
    )
    assert plain == pytest.approx(by_hand, rel=1e-6)


def test_something_where_nothing_is_expected_shows() -> None:
    expected = np.eye(2, 15)
    expected[1] = 0
    found = expected.copy()
    found[1, 7] = 100.0
    assert row_difference(found, expected, PLACE) > 1
