"""The frame on the Earth against pyins' places, axes and gravity."""

from __future__ import annotations

import numpy as np
import pytest
from lib.vehicle.made_drive import TURN
from pyins import earth, transform

from inswsn_lib.errors import ParameterError
from inswsn_lib.inertial import Earth, metres
from inswsn_lib.inertial.earth import radii

ORIGINS = [Earth(0.56, 2.07, 20.0), Earth(-1.2, -3.0, 3000.0), Earth(0.0), Earth(1.4, 0.1, -400.0)]


def around(origin: Earth, seed: int) -> np.ndarray:
    """Return places within about 20 km and 5 km of height, (100, 3), rad, rad, m."""
    rng = np.random.default_rng(seed)
    away = rng.uniform(-20e3, 20e3, (100, 2)) / 6.37e6 / [1.0, np.cos(origin.latitude)]
    height = origin.height + rng.uniform(-500, 5000, 100)
    return np.column_stack([np.array([origin.latitude, origin.longitude]) + away, height])


@pytest.mark.parametrize("origin", ORIGINS)
def test_places_are_those_of_pyins(origin: Earth) -> None:
    there = around(origin, 1)
    degrees = np.array([180 / np.pi, 180 / np.pi, 1.0])
    begin = np.array([origin.latitude, origin.longitude, origin.height]) * degrees
    earthly = transform.lla_to_ecef(there * degrees) - transform.lla_to_ecef(begin)
    expected = earthly @ transform.mat_en_from_ll(*begin[:2]) @ TURN
    assert origin.local(there) == pytest.approx(expected, abs=1e-7)
    back = origin.geodetic(expected)
    assert back[:, :2] == pytest.approx(there[:, :2], abs=1e-13)
    assert back[:, 2] == pytest.approx(there[:, 2], abs=1e-7)


@pytest.mark.parametrize("origin", ORIGINS)
def test_axes_and_gravity_are_those_of_pyins(origin: Earth) -> None:
    """To a tenth of a micro-g."""
    there = around(origin, 2)
    degrees = np.degrees(there[:, :2])
    begin = transform.mat_en_from_ll(*np.degrees([origin.latitude, origin.longitude]))
    axes = TURN @ begin.T @ transform.mat_en_from_ll(*degrees.T) @ TURN
    ground = origin.ground(origin.local(there))
    assert ground.axes == pytest.approx(axes, abs=1e-10)
    down = earth.gravity_n(degrees[:, 0], there[:, 2])
    assert ground.gravity == pytest.approx((axes @ TURN @ down[..., None])[..., 0], abs=1e-6)
    assert origin.rate == pytest.approx(TURN @ earth.rate_n(np.degrees(origin.latitude)))


@pytest.mark.parametrize("origin", ORIGINS)
def test_metres_are_those_of_the_ellipsoid(origin: Earth) -> None:
    """By differences of places, and by the radii of pyins."""
    there, h = around(origin, 3), 1e-5
    steps = np.diag([h, h, 1.0])
    ends = (origin.local(there[:, None] + sign * steps) for sign in (1, -1))
    size = np.linalg.norm(next(ends) - next(ends), axis=-1) / (2 * np.diag(steps))
    assert metres(there) == pytest.approx(size, rel=1e-6)
    expected = earth.principal_radii(np.degrees(there[:, 0]), there[:, 2])[:2]
    assert np.array(radii(there)) == pytest.approx(np.array(expected), rel=1e-13)


def test_a_latitude_is_within_a_quarter_turn() -> None:
    with pytest.raises(ParameterError, match=r"latitude .* not 32\.0"):
        Earth(32.0)
