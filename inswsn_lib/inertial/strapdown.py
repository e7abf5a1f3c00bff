"""The motion of an inertial navigation system: its state, and the errors that its IMU makes."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import ClassVar

import numpy as np

from inswsn_lib.checks import Array
from inswsn_lib.inertial.earth import Earth
from inswsn_lib.inertial.mechanization import ERRORS, cut, rotation_vector, turned
from inswsn_lib.inertial.steps import Steps
from inswsn_lib.streams import Imu, Recording, Whole

POSITION, VELOCITY, ATTITUDE = slice(0, 3), slice(3, 6), slice(6, 9)
_KEPT = 200_000  # pieces of a motion that is cut, whose numbers take 11 MB
FORCE_BIAS, RATE_BIAS = slice(9, 12), slice(12, 15)


@dataclass(frozen=True)
class ImuNoise:
    """What a filter assumes of an IMU, the same for its three axes.

    Attributes
    ----------
    force, rate : float
        White noise, m/s^2/Hz^0.5 and rad/s/Hz^0.5.
    force_walk, rate_walk : float
        By which the biases walk, m/s^2/s^0.5 and rad/s/s^0.5.
    """

    force: float
    rate: float
    force_walk: float
    rate_walk: float


@dataclass(frozen=True, eq=False)
class InertialState:
    """Where the IMU is, how it moves, how it is turned, and the biases of its sensors.

    Its errors are those of position, velocity, attitude (a turn about axes of the body, rad) and of
    the biases, 3 each, and those of the states that observations bring along.

    Attributes
    ----------
    position, velocity : ndarray, (3,)
        m and m/s, in the frame of the recording.
    attitude : ndarray, (3, 3)
        Turns vectors of the body into the frame.
    force_bias, rate_bias : ndarray, (3,)
        m/s^2 and rad/s, along the axes of the body.
    own : ndarray, (states,)
        States of the observations.

    Examples
    --------
    >>> import numpy as np
    >>> from inswsn_lib.inertial import InertialState
    >>> rest = InertialState(np.zeros(3), np.zeros(3), np.eye(3))
    >>> moved = rest.plus(np.arange(15) / 100)
    >>> np.round(moved.minus(rest) * 100, 9).tolist() == list(range(15))
    True
    """

    errors: ClassVar[int] = ERRORS

    position: Array
    velocity: Array
    attitude: Array
    force_bias: Array = field(default_factory=lambda: np.zeros(3))
    rate_bias: Array = field(default_factory=lambda: np.zeros(3))
    own: Array = field(default_factory=lambda: np.zeros(0))

    @classmethod
    def of_row(cls, row: Array) -> InertialState:
        """Return the state whose numbers, one after the other, are a row (21 + own,)."""
        return cls(row[:3], row[3:6], row[6:15].reshape(3, 3), row[15:18], row[18:21], row[21:])

    @property
    def row(self) -> Array:
        """All numbers, one after the other, (21 + own,)."""
        turned, biases = self.attitude.ravel(), (self.force_bias, self.rate_bias)
        return np.concatenate([self.position, self.velocity, turned, *biases, self.own])

    def plus(self, error: Array) -> InertialState:
        """Return the state that lies an error, (15 + own,), from this one."""
        return InertialState(
            self.position + error[POSITION],
            self.velocity + error[VELOCITY],
            self.attitude @ turned(error[ATTITUDE]),
            self.force_bias + error[FORCE_BIAS],
            self.rate_bias + error[RATE_BIAS],
            self.own + error[ERRORS:],
        )

    def minus(self, other: InertialState) -> Array:
        """Return by what error, (15 + own,), this state lies from the other."""
        return np.concatenate([
            self.position - other.position,
            self.velocity - other.velocity,
            rotation_vector(other.attitude.T @ self.attitude),
            self.force_bias - other.force_bias,
            self.rate_bias - other.rate_bias,
            self.own - other.own,
        ])  # fmt: skip


@dataclass(frozen=True, eq=False)
class InertialMotion:
    r"""Strapdown integration of an IMU between events; see `mechanization`.

    Attributes
    ----------
    imu : Imu
    noise : ImuNoise
    earth : Earth, optional
        Without one the frame is flat and does not turn.
    substep : float
        How long a step of the covariance is, s, or as long as there is to the next event; states
        are integrated sample by sample. White noise comes half before a step and half after it,
        which errs with the square: of 0.2 s, deviations of a car and of a tag in a hand by 0.05 %.
    """

    imu: Imu
    noise: ImuNoise
    earth: Earth | None = None
    substep: float = 0.2
    # what was cut last, which a search over noises asks for again and again
    _cuts: dict[tuple[float, bytes], tuple[Imu, Array, Whole, Array, Array]] = field(
        default_factory=dict, repr=False, compare=False
    )

    @classmethod
    def of(cls, recording: Recording, noise: ImuNoise) -> InertialMotion:
        """Return that of a recording's IMU, on the Earth where its origin is known.

        Parameters
        ----------
        recording : Recording
        noise : ImuNoise
        """
        assert recording.imu is not None
        earth = None if recording.origin is None else Earth(*recording.origin.tolist())
        return cls(recording.imu, noise, earth)

    def between(self, begin: float, events: Array) -> Steps:
        """Return the steps from a time to the first event, and from each to the next.

        :meta private:
        """
        key = begin, events.tobytes()
        found = self._cuts.get(key)
        if found is None or found[0] is not self.imu:
            lengths, of, ends = cut(self.imu.time, begin, events)
            values = self.imu.rate, self.imu.force
            rates, forces = (0.5 * (each[of - 1] + each[of])[None] for each in values)
            found = self.imu, lengths, ends, rates, forces
            if len(lengths) <= _KEPT:
                for old in [*self._cuts][:-1]:  # two are kept
                    del self._cuts[old]
                self._cuts[key] = found
        _, lengths, ends, rates, forces = found
        names = ("force", "rate", "force_walk", "rate_walk")
        return Steps(
            lengths, rates, forces, ends, np.array([getattr(self.noise, n) for n in names]),
            substep=self.substep, earth=np.zeros(4) if self.earth is None else self.earth.numbers,
        )  # fmt: skip
