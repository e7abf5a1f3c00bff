"""A path in the plane: straight legs joined by arcs, driven at constant speed."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from inswsn_lib.checks import Array, array, number
from inswsn_lib.errors import ParameterError


@dataclass(frozen=True, eq=False)
class Motion:
    """A motion in the plane, sampled.

    Attributes
    ----------
    time : ndarray, (steps,)
        s, from 0.
    position, velocity : ndarray, (steps, 2)
        m and m/s, in the frame of the scene (x right, y up).
    heading : ndarray, (steps,)
        Of the velocity, radians from x towards y, continuous.

    Examples
    --------
    On an arc of 20 m at 10 m/s the heading turns by half a radian a second:

    >>> from inswsn_lib.simulation import Path
    >>> path = Path.through([(0, 0), (100, 0), (100, 100)], radius=20)
    >>> path.drive(10.0, [0.0, 9.0]).heading.round(6).tolist()  # the arc begins after 8 s
    [0.0, 0.5]
    """

    time: Array
    position: Array
    velocity: Array
    heading: Array


@dataclass(frozen=True, eq=False)
class Path:
    r"""Straight legs and arcs, one after the other.

    Attributes
    ----------
    lengths, curvatures : ndarray, (pieces,)
        m; 1/m, positive to the left, zero on a straight leg.
    start : ndarray, (2,)
        m.
    heading : float
        At the start, radians.

    Examples
    --------
    An arc cuts the corner: of 200 m it leaves :math:`200 - (2 - \pi/2)\,r`.

    >>> from inswsn_lib.simulation import Path
    >>> path = Path.through([(0, 0), (100, 0), (100, 100)], radius=20)
    >>> print(f"{path.length:.3f} {200 - (2 - 3.14159 / 2) * 20:.3f}")
    191.416 191.416
    """

    lengths: Array
    curvatures: Array
    start: Array
    heading: float

    @classmethod
    def through(cls, waypoints: ArrayLike, radius: float) -> Path:
        """Return the polygon through waypoints, its corners rounded by arcs.

        Parameters
        ----------
        waypoints : array_like, (points, 2)
            m, two or more; the first and the last are met, the others are corners.
        radius : float
            Of the arcs, m; each has to fit between its neighbours.
        """
        points = array("waypoints", waypoints, ("points", 2))
        number("radius", radius, above=0)
        if len(points) < 2:
            raise ParameterError("waypoints", waypoints, "at least two points")
        sides = np.diff(points, axis=0)
        headings = np.arctan2(sides[:, 1], sides[:, 0])
        turns = (np.diff(headings) + np.pi) % (2 * np.pi) - np.pi
        cut = np.concatenate([[0.0], radius * np.tan(np.abs(turns) / 2), [0.0]])
        straight = np.hypot(*sides.T) - cut[:-1] - cut[1:]
        if (straight < 0).any():
            raise ParameterError("radius", radius, "small enough for arcs to fit between corners")
        lengths, curvatures = [straight[0]], [0.0]
        for turn, leg in zip(turns, straight[1:], strict=True):
            lengths += [radius * abs(turn), leg]
            curvatures += [np.sign(turn) / radius, 0.0]
        return cls(np.array(lengths), np.array(curvatures), points[0], float(headings[0]))

    @property
    def length(self) -> float:
        """The whole length, m."""
        return float(self.lengths.sum())

    def drive(self, speed: float, time: ArrayLike) -> Motion:
        """Return the motion at constant speed, m/s, at times (steps,) since the start, s.

        After the end of the path the motion goes straight on.
        """
        t = array("time", time, ("steps",))
        number("speed", speed, above=0)
        number("time", t.min(initial=0.0), least=0)
        ends = np.concatenate([[0.0], np.cumsum(self.lengths)])
        piece = np.minimum(
            np.searchsorted(ends, speed * t, side="right") - 1, len(self.lengths) - 1
        )
        within = speed * t - ends[piece]
        curvature = self.curvatures[piece]
        headings, points = self._joints()
        heading = headings[piece] + curvature * within
        # the chord of an arc: its length times sinc of half the turn, along the mean heading
        middle = headings[piece] + curvature * within / 2
        chord = within * np.sinc(curvature * within / (2 * np.pi))
        position = points[piece] + chord[:, None] * _direction(middle)
        return Motion(t, position, speed * _direction(heading), heading)

    def _joints(self) -> tuple[Array, Array]:
        """Return heading and position at the beginning of each piece."""
        turns = self.curvatures * self.lengths
        headings = self.heading + np.concatenate([[0.0], np.cumsum(turns)])
        chords = self.lengths * np.sinc(turns / (2 * np.pi))
        steps = chords[:, None] * _direction(headings[:-1] + turns / 2)
        return headings[:-1], np.vstack([self.start, self.start + np.cumsum(steps, axis=0)])[:-1]


def _direction(heading: Array) -> Array:
    return np.stack([np.cos(heading), np.sin(heading)], axis=-1)
