r"""The motion of a vehicle on a plane by its odometry: dead reckoning, and the errors it makes.

.. math::
    \dot x = (1 + s)\, u \cos\psi, \qquad \dot y = (1 + s)\, u \sin\psi, \qquad
    \dot\psi = \omega - b ,

with the speed u and the rate :math:`\omega` of the odometry, the error s of its scale, the bias b
of its rate, and white noise on speed and rate. Over an interval, in which both are constant, the
way is taken along the middle heading, which is exact to the third power of the turn.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import ClassVar

import numpy as np

from inswsn_lib.checks import Array
from inswsn_lib.inertial.steps import Steps
from inswsn_lib.streams import Odometry

_X, _Y, _HEADING, _SCALE, _BIAS = range(5)


@dataclass(frozen=True)
class OdometryNoise:
    """What a filter assumes of an odometry.

    Attributes
    ----------
    speed, rate : float
        White noise, m/s/Hz^0.5 and rad/s/Hz^0.5.
    scale_walk, rate_walk : float
        By which the error of the scale walks, 1/s^0.5, and the bias of the rate, rad/s/s^0.5.
    """

    speed: float
    rate: float
    scale_walk: float
    rate_walk: float


@dataclass(frozen=True, eq=False)
class PlanarState:
    """Where a vehicle is on a plane, its heading, and the errors of its odometry.

    Attributes
    ----------
    position : ndarray, (2,)
        m.
    heading : float
        Against the x axis, to the left, rad.
    scale : float
        By which share more it moves than its odometry says.
    rate_bias : float
        rad/s.
    speed : float
        By the odometry, m/s.
    own : ndarray, (states,)
        States of the observations.
    """

    errors: ClassVar[int] = 5

    position: Array
    heading: float
    scale: float = 0.0
    rate_bias: float = 0.0
    speed: float = 0.0
    own: Array = field(default_factory=lambda: np.zeros(0))

    @classmethod
    def of_row(cls, row: Array) -> PlanarState:
        """Return the state whose numbers, one after the other, are a row (6 + own,)."""
        heading, scale, rate_bias, speed = row[2:6].tolist()
        return cls(row[:2], heading, scale, rate_bias, speed, row[6:])

    @property
    def row(self) -> Array:
        """All numbers, one after the other, (6 + own,)."""
        rest = [self.heading, self.scale, self.rate_bias, self.speed]
        return np.concatenate([self.position, rest, self.own])

    @property
    def velocity(self) -> Array:
        """By speed and heading, (2,), m/s."""
        return self.speed * (1 + self.scale) * self.forward

    @property
    def forward(self) -> Array:
        """The unit vector ahead, (2,)."""
        return np.array([np.cos(self.heading), np.sin(self.heading)])

    def plus(self, error: Array) -> PlanarState:
        """Return the state that lies an error, (5 + own,), from this one."""
        return replace(
            self,
            position=self.position + error[:2],
            heading=self.heading + error[_HEADING],
            scale=self.scale + error[_SCALE],
            rate_bias=self.rate_bias + error[_BIAS],
            own=self.own + error[5:],
        )

    def minus(self, other: PlanarState) -> Array:
        """Return by what error, (5 + own,), this state lies from the other."""
        turn = np.angle(np.exp(1j * (self.heading - other.heading)))
        rest = [turn, self.scale - other.scale, self.rate_bias - other.rate_bias]
        return np.concatenate([self.position - other.position, rest, self.own - other.own])


@dataclass(frozen=True, eq=False)
class OdometryMotion:
    """Dead reckoning by an odometry between events.

    Attributes
    ----------
    odometry : Odometry
    noise : OdometryNoise
    """

    odometry: Odometry
    noise: OdometryNoise

    def between(self, begin: float, events: Array) -> Steps:
        """Return the steps from a time to the first event, and from each to the next.

        :meta private:
        """
        time = self.odometry.time
        edges = np.union1d(time[(time > begin) & (time < events[-1])], np.append(events, begin))
        # a row speaks of the interval that ends with it; after the last one it goes on
        of = np.minimum(np.searchsorted(time, edges[1:]), len(time) - 1)
        names = ("speed", "rate", "scale_walk", "rate_walk")
        rates = np.column_stack([self.odometry.speed[of], self.odometry.rate[of]])[None]
        return Steps(
            np.diff(edges), rates, rates, np.searchsorted(edges, events),
            np.array([getattr(self.noise, name) for name in names]),
        )  # fmt: skip
