r"""A route on roads: a sequence of pieces in time.

Along a piece the acceleration along the road :math:`a` and the rate of the course :math:`\omega` go
from one value to another by the step

.. math::
    S(u) = 6 u^5 - 15 u^4 + 10 u^3, \qquad 0 \le u \le 1,

whose first two derivatives vanish at both ends, so that both are twice continuously differentiable
all along the drive. Curves are driven at constant speed :math:`v`: brake, turn, accelerate. So the
curvature :math:`\omega / v` is as smooth, and grows from a straight into an arc as on a clothoid,
but without its corners. Speed, course and distance are the exact integrals.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from inswsn_lib.checks import Array
from inswsn_lib.errors import Described, ParameterError
from inswsn_lib.scenario import Range
from inswsn_lib.simulation.drive import Place

#: s: what sums of times may be off by
ROUNDING = 1e-9
#: A pair that stays zero
NONE = (0.0, 0.0)


class Piece(NamedTuple):
    """Some seconds of a drive, from a speed (m/s) on.

    Acceleration (m/s^2, along the road) and rate of the course (rad/s, to the right) at the
    beginning and the end.
    """

    duration: float
    speed: float
    acceleration: Range = NONE
    course_rate: Range = NONE


@dataclass(frozen=True, eq=False)
class Kinematics:
    """The motion along a route, sampled, (steps,).

    Time (s), distance along the road (m), speed and acceleration along it, course (rad, clockwise
    from north, continuous) and its rate, slope of the road (rad, positive uphill).
    """

    time: Array
    distance: Array
    speed: Array
    acceleration: Array
    course: Array
    course_rate: Array
    grade: Array

    @property
    def lateral_acceleration(self) -> Array:
        r""":math:`v\,\omega`, which is :math:`v^2` times the curvature; to the right, m/s^2."""
        return self.speed * self.course_rate


@dataclass(frozen=True, eq=False)
class Route:
    """Pieces one after the other.

    Attributes
    ----------
    pieces : tuple of Piece
    course : float
        At the start, rad, clockwise from north.
    places : tuple of Place
        Where outages are to begin; the start is a second of the drive.
    waves : ndarray, (waves, 3)
        Amplitude (rad), wavenumber (rad/m) and phase (rad) of the sines of the distance whose sum
        is the slope of the road.
    seed : int
        That it was planned with.

    Examples
    --------
    Ten seconds at 12 m/s, and five in which the car brakes to a standstill:

    >>> import inswsn_lib as iw
    >>> piece = iw.simulation.Piece
    >>> braking = piece(2.5, 12.0, (0, -4.8)), piece(2.5, 6.0, (-4.8, 0))
    >>> route = iw.simulation.Route((piece(10.0, 12.0), *braking))
    >>> route.kinematics([10, 15]).distance.round(6)
    array([120., 150.])
    """

    pieces: tuple[Piece, ...]
    course: float = 0.0
    places: tuple[Place, ...] = ()
    waves: Array = field(default_factory=lambda: np.zeros((0, 3)))
    seed: int = 0

    @property
    def duration(self) -> float:
        """Of the whole drive, s."""
        return float(np.array([piece.duration for piece in self.pieces]).sum())

    def kinematics(self, time: ArrayLike) -> Kinematics:
        r"""Return the motion at some times, s since the start.

        With :math:`u` the share of a piece of duration T that has passed, and
        :math:`S_1, S_2` the first two integrals of the step S,

        .. math::
            a = a_0 + (a_1 - a_0) S(u), \quad
            v = v_0 + T (a_0 u + (a_1 - a_0) S_1(u)), \quad
            s = s_0 + v_0 T u + T^2 (a_0 u^2 / 2 + (a_1 - a_0) S_2(u)),

        and the same for the rate of the course and the course.
        """
        t = np.asarray(time, dtype=float)
        if not ((t >= 0) & (t <= self.duration + ROUNDING)).all():
            raise ParameterError(
                "time", Described("outside the drive"), f"between 0 and {self.duration:g} s"
            )
        spans, speeds, accelerations, rates = (np.array(x) for x in zip(*self.pieces, strict=True))
        (a0, a1), (w0, w1) = accelerations.T, rates.T
        lengths = speeds * spans + spans**2 * (a0 / 2 + (a1 - a0) / 7)
        starts, distances, angles = (
            np.concatenate([[0.0], np.cumsum(x)[:-1]])
            for x in (spans, lengths, spans * (w0 + w1) / 2)
        )
        piece = np.searchsorted(starts, t, side="right") - 1
        span, v, a, w = (x[piece] for x in (spans, speeds, a0, w0))
        da, dw = (a1 - a0)[piece], (w1 - w0)[piece]
        u = np.clip((t - starts[piece]) / span, 0.0, 1.0)
        S = u**3 * (10 + u * (6 * u - 15))
        S1 = u**4 * (2.5 + u * (u - 3))
        S2 = u**5 * (0.5 + u * (u / 7 - 0.5))
        distance = distances[piece] + v * span * u + span**2 * (a * u**2 / 2 + da * S2)
        amplitude, wavenumber, phase = self.waves.T[:, :, None]
        return Kinematics(
            time=t,
            distance=distance,
            speed=np.maximum(v + span * (a * u + da * S1), 0.0),  # no rounding below rest
            acceleration=a + da * S,
            course=self.course + angles[piece] + span * (w * u + dw * S1),
            course_rate=w + dw * S,
            grade=(amplitude * np.sin(wavenumber * distance + phase)).sum(axis=0),
        )
