r"""The Earth about an origin: a level frame that is fixed to it, its turn, and gravity.

The axes point east, north and up at the origin. Since the frame is fixed to the Earth there is no
transport rate, and positions are metres however far one goes; what turns with the place is gravity,

.. math::
    \dot v = R f + g(p) - 2\,\Omega \times v, \qquad
    \dot R = R\,[\omega]_\times - [\Omega]_\times R

(Groves, "Principles of GNSS, Inertial, and Multisensor Integrated Navigation Systems", 2013,
section 5.3). Gravity is Somigliana's at the ellipsoid of WGS84, along its normal, and falls by
:math:`2 h / a` with the height.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from inswsn_lib.checks import Array, number

#: WGS84: rate of turn (rad/s), semi-major axis (m), squared eccentricity
RATE, AXIS, ECCENTRICITY = 7.292115e-5, 6378137.0, 6.6943799901413e-3
# Gravity at the equator (m/s^2), and by which share it grows to the pole beside the radius
_EQUATOR = 9.7803253359
_GROWTH = np.sqrt(1 - ECCENTRICITY) * 9.8321849378 / _EQUATOR - 1
_MINOR = AXIS * np.sqrt(1 - ECCENTRICITY)
#: North-east-down to east-north-up and back: it is its own inverse
TURN = np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]])


class Ground(NamedTuple):
    """Where a place is over the ellipsoid, and how it is turned there.

    Attributes
    ----------
    sine, cosine : ndarray, (...)
        Of the geodetic latitude.
    height : ndarray, (...)
        m.
    axes : ndarray, (..., 3, 3)
        Turns vectors east, north, up of the place into the frame of an `Earth`.
    """

    sine: Array
    cosine: Array
    height: Array
    axes: Array

    @property
    def gravity(self) -> Array:
        """Normal gravity in the frame, (..., 3), m/s^2."""
        return -normal_gravity(self.sine, self.height)[..., None] * self.axes[..., :, 2]


def normal_gravity(sine: Array, height: Array | float) -> Array:
    """Return normal gravity, (...), m/s^2, by the sine of the latitude and the height, m."""
    size = _EQUATOR * (1 + _GROWTH * sine**2) / np.sqrt(1 - ECCENTRICITY * sine**2)
    return np.asarray(size * (1 - 2 * height / AXIS))


def radii(position: Array) -> tuple[Array, Array]:
    r"""Return the radii of curvature with the height, :math:`R_M + h` and :math:`R_N + h` (m)."""
    square = 1 - ECCENTRICITY * np.sin(position[..., 0]) ** 2
    transverse: Array = AXIS / np.sqrt(square)
    meridian: Array = transverse * (1 - ECCENTRICITY) / square
    return meridian + position[..., 2], transverse + position[..., 2]


def metres(position: Array) -> Array:
    r"""Return the metres of a radian north and east and of a metre up, (..., 3).

    They take a small difference of positions, in the order latitude, longitude, height, to metres.

    Examples
    --------
    On the equator a minute of longitude is a geographical mile:

    >>> import numpy as np, inswsn_lib as iw
    >>> print(f"{iw.inertial.metres(np.zeros(3))[1] * np.radians(1 / 60):.1f} m")
    1855.3 m
    """
    meridian, transverse = radii(position)
    return np.stack(
        [meridian, transverse * np.cos(position[..., 0]), np.ones_like(meridian)], axis=-1
    )


@dataclass(frozen=True)
class Earth:
    """The Earth about the origin of a level frame.

    Attributes
    ----------
    latitude, longitude : float
        Geodetic, of the origin, rad.
    height : float
        Of the origin above the ellipsoid, m.

    Raises
    ------
    ParameterError
        If a latitude is not in -pi/2 to pi/2, or a number is not finite.

    Examples
    --------
    A degree to the north of Nanjing is 110.9 km away, and a kilometre below its horizon:

    >>> import numpy as np
    >>> from inswsn_lib.inertial import Earth
    >>> here = Earth(np.radians(32.0), np.radians(118.8))
    >>> np.round(here.local(np.radians([33.0, 118.8, 0.0])) / 1000, 1).tolist()
    [0.0, 110.9, -1.0]
    """

    latitude: float
    longitude: float = 0.0
    height: float = 0.0

    def __post_init__(self) -> None:
        number("latitude", self.latitude, least=-np.pi / 2, most=np.pi / 2)
        number("longitude", self.longitude)
        number("height", self.height)

    @cached_property
    def numbers(self) -> Array:
        """Polar axis and the way from the centre to the origin, each north and up, (4,).

        :meta private:
        """
        sine, cosine = np.sin(self.latitude), np.cos(self.latitude)
        radius = AXIS / np.sqrt(1 - ECCENTRICITY * sine**2)
        flat = -ECCENTRICITY * radius * sine
        return np.array([cosine, sine, flat * cosine, radius + self.height + flat * sine])

    @property
    def rate(self) -> Array:
        """The turn of the frame, (3,), rad/s."""
        return np.array([0.0, *(RATE * self.numbers[:2])])

    def local(self, position: Array) -> Array:
        """Return places in the frame, (..., 3), m, of latitudes, longitudes (rad) and heights (m).

        Parameters
        ----------
        position : ndarray, (..., 3)
        """
        latitude, turn = position[..., 0], position[..., 1] - self.longitude
        radius = AXIS / np.sqrt(1 - ECCENTRICITY * np.sin(latitude) ** 2)
        across = (radius + position[..., 2]) * np.cos(latitude)
        along = (radius * (1 - ECCENTRICITY) + position[..., 2]) * np.sin(latitude)
        cosine, sine, north, up = self.numbers
        outward = across * np.cos(turn)
        return np.stack(
            [across * np.sin(turn), cosine * along - sine * outward - north,
             sine * along + cosine * outward - up], axis=-1,
        )  # fmt: skip

    def geodetic(self, place: Array) -> Array:
        """Return latitudes, longitudes (rad) and heights (m) of places in the frame, (..., 3).

        Parameters
        ----------
        place : ndarray, (..., 3)
            m.

        Examples
        --------
        >>> import numpy as np
        >>> from inswsn_lib.inertial import Earth
        >>> here, there = Earth(0.5, 2.0, 50.0), np.array([0.51, 1.99, 3000.0])
        >>> np.abs(here.geodetic(here.local(there)) - there).max() < 1e-9
        np.True_
        """
        ground, east, outward = over(place, self.numbers)
        return np.stack(
            [np.arctan2(ground.sine, ground.cosine), self.longitude + np.arctan2(east, outward),
             ground.height], axis=-1,
        )  # fmt: skip

    def ground(self, place: Array) -> Ground:
        """Return latitude, height and axes of places in the frame, (..., 3), m.

        Parameters
        ----------
        place : ndarray, (..., 3)

        Examples
        --------
        Gravity in Nanjing, and how far it leans to the south a kilometre to the north:

        >>> import numpy as np
        >>> from inswsn_lib.inertial import Earth
        >>> ground = Earth(np.radians(32.0)).ground(np.array([[0.0, 0.0, 0.0], [0.0, 1e3, 0.0]]))
        >>> ground.gravity.round(5).tolist()
        [[-0.0, -0.0, -9.79484], [-0.0, -0.00154, -9.79485]]
        """
        return over(place, self.numbers)[0]


def over(place: Array, numbers: Array) -> tuple[Ground, Array, Array]:
    """Return the ground by Bowring's closed form (Survey Review 23, 1976), and two coordinates.

    Those are from the polar axis, east and outward in the origin's meridian, m; `numbers` are
    those of an `Earth`.
    """
    polar, level, flat, up = numbers
    north, high = place[..., 1] + flat, place[..., 2] + up
    east, along, outward = place[..., 0], polar * north + level * high, polar * high - level * north
    across = np.hypot(east, outward)
    reduced = np.hypot(AXIS * along, _MINOR * across)
    s = along + ECCENTRICITY / (1 - ECCENTRICITY) * _MINOR * (AXIS * along / reduced) ** 3
    c = across - ECCENTRICITY * AXIS * (_MINOR * across / reduced) ** 3
    size = np.hypot(s, c)
    s, c = s / size, c / size
    height = across * c + along * s - AXIS * np.sqrt(1 - ECCENTRICITY * s**2)
    sine, cosine, zero = east / across, outward / across, np.zeros_like(s)
    axes = np.empty((*s.shape, 3, 3))
    for i, (x, y, z) in enumerate((
        (cosine, -sine, zero), (-s * sine, -s * cosine, c), (c * sine, c * cosine, s),
    )):  # fmt: skip
        axes[..., 0, i] = x
        axes[..., 1, i], axes[..., 2, i] = polar * z - level * y, level * z + polar * y
    return Ground(s, c, height, axes), east, outward
