"""What a filter can be given: fixes, ranges, velocities, headings, wheels, and a user's own."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, NamedTuple, Protocol

import numpy as np

from inswsn_lib.checks import Array
from inswsn_lib.inertial import sensors
from inswsn_lib.inertial.plain import expected, wrapped
from inswsn_lib.streams import Fixes, Ranges, Whole

_NONE = np.zeros(0)


class Innovation(NamedTuple):
    """A measurement less what was expected of it.

    Attributes
    ----------
    value : ndarray, (m,)
    rows : ndarray, (m, errors)
        Derivatives of what is expected by the errors of the motion.
    own : ndarray, (m, states)
        The same by the observation's own states.
    noise : ndarray, (m, m)
        Covariance of the measurement.
    """

    value: Array
    rows: Array
    own: Array
    noise: Array


class Components(NamedTuple):
    """Measurements as a table of their components, which the filter reads."""

    first: Whole  # (measurements + 1,), of the components of each
    sensor: Callable[..., Any]  # of `sensors`, or a user's
    data: Array  # (components, numbers), for the sensor
    arm: Array  # (3,), the lever arm
    told: Array  # (components,); NaN where missing
    noise: Array  # (components, 3): variance, gate, and after what a value repeats, or 0


class Observation(Protocol):
    """Measurements of one kind, and the states that they need for themselves.

    A user's own is a `Sensor`.
    """

    @property
    def time(self) -> Array:
        """When there is one, s, increasing."""

    @property
    def initial(self) -> Array:
        """Variances of its own states at the start, (states,)."""

    @property
    def components(self) -> Components:
        """The measurements as a table.

        :meta private:
        """

    def transition(self, dt: Any) -> tuple[Array, Array]:
        """Return by what its own states are multiplied, and the variance they gain, in a time."""

    def innovation(self, k: int, state: Any, own: Array) -> Innovation | None:
        """Return the innovation of its measurement k, or None if nothing was measured."""


class _Observed:
    """What follows from a table."""

    @property
    def initial(self) -> Array:
        """Variances of its own states at the start, (states,)."""
        return _NONE

    def transition(self, dt: Any) -> tuple[Array, Array]:
        """Return by what its own states are multiplied, and the variance they gain, in a time."""
        constant = np.full(len(self.initial), np.inf)
        return gauss_markov(dt, getattr(self, "times", constant), np.sqrt(self.initial))

    def innovation(self: Any, k: int, state: Any, own: Array) -> Innovation | None:
        """Return the innovation of its measurement k, or None if nothing was measured."""
        table, d = self.components, state.errors
        part = np.arange(*table.first[k : k + 2])
        part = part[~np.isnan(table.told[part])]
        if not part.size:
            return None
        count = len(state.row) - len(state.own)
        x = np.concatenate([state.row[:count], own])[None]
        owns = np.tile([0.0, len(own)], (len(part), 1))
        arms = np.tile(table.arm, (len(part), 1))
        found, H = expected(
            x, d, d + len(own), [table.sensor] * len(part), table.data[part], arms, owns
        )
        value = wrapped(table.told[part] - found[0], table.noise[part, 2])
        return Innovation(value, H[0, :, :d], H[0, :, d:], np.diag(table.noise[part, 0]))


@dataclass(frozen=True, eq=False)
class Sensor(_Observed):
    """Measurements by a user's own sensor: a function; see `inswsn_lib.inertial.sensors`.

    Attributes
    ----------
    function : callable
        From the state, the sensor's own states, data and a row to be filled, to what is expected of
        a component. It is compiled where there is numba, so it stands in a module.
    time : ndarray, (rows,)
        s.
    told : ndarray, (rows, m)
        What was measured; NaN where missing.
    white : ndarray, (m,) or (rows, m)
        Standard deviations.
    data : ndarray, (m, numbers) or (rows, m, numbers)
        What the function is told of each component.
    deviations, times : ndarray, (states,)
        Of its own states at the start, and their correlation times, s: infinite for constants.
    lever_arm : ndarray, (3,)
        From the IMU, in axes of the body, m.
    gate : float
        As that of `run_error_state`, for this sensor.
    period : float
        After what a value repeats, such as a whole turn; 0 for none.

    Examples
    --------
    A barometer, whose height has a lasting error:

    >>> import numpy as np
    >>> from inswsn_lib import inertial as nav
    >>> def height(x, own, data, row):
    ...     row[2] = row[15] = 1.0
    ...     return x[2] + own[0]
    >>> t, bias = np.arange(1.0, 5.0), {"deviations": np.array([3.0]), "times": np.array([1e3])}
    >>> heard = nav.Sensor(height, t, np.full((4, 1), 20.0), np.array([0.5]), **bias)
    >>> state = nav.InertialState(np.array([0.0, 0.0, 18.5]), np.zeros(3), np.eye(3))
    >>> got = heard.innovation(0, state, own=np.array([1.0]))
    >>> got.value.tolist(), got.own.tolist()
    ([0.5], [[1.0]])
    """

    function: Callable[..., Any]
    time: Array
    told: Array
    white: Array
    data: Array = field(default_factory=lambda: np.zeros((1, 0)))
    deviations: Array = field(default_factory=lambda: _NONE)
    times: Array = field(default_factory=lambda: _NONE)
    lever_arm: Array = field(default_factory=lambda: np.zeros(3))
    gate: float = np.inf
    period: float = 0.0

    @property
    def initial(self) -> Array:
        """Variances of its own states."""
        return np.square(self.deviations)

    @property
    def components(self) -> Components:
        """The measurements as a table.

        :meta private:
        """
        shape = *self.told.shape, self.data.shape[-1]
        data = np.broadcast_to(self.data, shape).reshape(self.told.size, shape[2])
        return _table(
            self.function, self.told, self.white, data, self.lever_arm, self.gate, self.period
        )


@dataclass(frozen=True, eq=False)
class PositionFixes(_Observed):
    r"""Fixes of the tag or antenna, whose errors are white, or coloured, or both.

    The coloured error is a Gauss-Markov process for each axis, a state of the filter,

    .. math:: e_{k+1} = \varphi e_k + w_k, \qquad \varphi = e^{-\Delta t/\tau}, \qquad
              \mathrm{var}\, w_k = \sigma^2 (1 - \varphi^2) .

    Attributes
    ----------
    fixes : Fixes
    lever_arm : ndarray, (d,)
        From the IMU to the antenna, in axes of the body, m.
    white, coloured : ndarray, (d,)
        Standard deviations by axis, m; without coloured errors there is no state.
    times : ndarray, (d,)
        Correlation times of the coloured errors, s.
    """

    fixes: Fixes
    lever_arm: Array
    white: Array
    coloured: Array = field(default_factory=lambda: _NONE)
    times: Array = field(default_factory=lambda: _NONE)

    @property
    def time(self) -> Array:
        """When there is a fix, s."""
        return self.fixes.time

    @property
    def initial(self) -> Array:
        """Variances of the coloured errors."""
        return np.square(self.coloured)

    @property
    def components(self) -> Components:
        """The measurements as a table.

        :meta private:
        """
        axes = np.eye(self.fixes.position.shape[1], 3)
        own = np.where(len(self.coloured), np.arange(len(axes)), -1)
        return _table(
            sensors.position, self.fixes.position, self.white,
            np.column_stack([axes, own]), self.lever_arm,
        )  # fmt: skip


@dataclass(frozen=True, eq=False)
class RangesToAnchors(_Observed):
    """Ranges from the tag to anchors: what a tightly coupled filter takes.

    Ranges of one time stamp are one measurement. Each anchor may have a constant bias and a
    coloured error, a Gauss-Markov process, and all together a scale, as states of the filter:

    .. math:: r = (1 + s) |p - a_j| + b_j + e_j + w .

    Attributes
    ----------
    ranges : Ranges
    lever_arm : ndarray, (d,)
        From the IMU to the tag, in axes of the body, m.
    white : float
        Standard deviation, m.
    bias, coloured : float
        Of the bias and of the coloured error of each anchor, m; 0 for none, and no state.
    correlation_time : float
        Of the coloured errors, s.
    scale : float
        Of the scale's error, 1; 0 for none.

    Examples
    --------
    A tag at (3, 4) and an anchor at the origin, whose range is 0.1 m too long:

    >>> import numpy as np
    >>> from inswsn_lib import inertial as nav
    >>> from inswsn_lib.streams import Ranges
    >>> ranges = Ranges(np.array([1.0]), np.array([0]), np.array([5.1]), np.zeros((1, 2)), ("a",))
    >>> heard = nav.RangesToAnchors(ranges, np.zeros(2), white=0.05, bias=0.2)
    >>> tag = nav.PlanarState(np.array([3.0, 4.0]), heading=0.0)
    >>> got = heard.innovation(0, tag, own=np.zeros(1))
    >>> got.value.round(3).tolist(), got.rows[0, :2].tolist(), got.own.tolist()
    ([0.1], [0.6, 0.8], [[1.0]])
    """

    ranges: Ranges
    lever_arm: Array
    white: float
    bias: float = 0.0
    coloured: float = 0.0
    correlation_time: float = 1.0
    scale: float = 0.0

    @cached_property
    def _stamps(self) -> tuple[Array, Whole]:
        stamps, first = np.unique(self.ranges.time, return_index=True)
        return stamps, np.append(first, len(self.ranges)).astype(np.int64)

    @property
    def time(self) -> Array:
        """When there are ranges, s."""
        return self._stamps[0]

    @property
    def _deviations(self) -> list[float]:
        return [deviation for deviation in (self.bias, self.coloured) if deviation]

    @cached_property
    def initial(self) -> Array:
        """Variances of the scale, the biases and the coloured errors."""
        each = np.repeat(self._deviations, len(self.ranges.anchors))
        return np.asarray(np.square(np.append([self.scale] * bool(self.scale), each)))

    @cached_property
    def times(self) -> Array:
        """Correlation times of the same, s."""
        times = [np.inf] * bool(self.bias) + [self.correlation_time] * bool(self.coloured)
        each = np.repeat(times, len(self.ranges.anchors))
        return np.append([np.inf] * bool(self.scale), each)

    @property
    def components(self) -> Components:
        """The measurements as a table.

        :meta private:
        """
        of, count = self.ranges.anchor, len(self.ranges.anchors)
        scaled = int(bool(self.scale))
        data = np.full((len(of), 6), -1.0)
        data[:, :3] = _wide(self.ranges.anchors)[of]
        data[:, 3] += scaled
        for k in range(len(self._deviations)):
            data[:, 4 + k] = scaled + k * count + of
        noise = np.zeros((len(of), 3))
        noise[:, 0], noise[:, 1] = self.white**2, np.inf
        return Components(
            self._stamps[1], sensors.distance, data, _wide(self.lever_arm), self.ranges.distance,
            noise,
        )  # fmt: skip


@dataclass(frozen=True, eq=False)
class Velocities(_Observed):
    """Velocities that were measured, white; with zeros, that the body stands still (ZUPT).

    Attributes
    ----------
    time : ndarray, (rows,)
        s.
    velocity : ndarray, (rows, d)
        m/s, in the frame of the recording; NaN where missing.
    white : ndarray, (d,)
        Standard deviations, m/s.
    rate : ndarray, (rows, 3), optional
        What the gyroscopes said then, rad/s; with it the velocity is that of an antenna.
    lever_arm : ndarray, (3,), optional
        From the IMU to the antenna, in axes of the body, m.

    Examples
    --------
    A body that stands still, and of which a filter thinks otherwise:

    >>> import numpy as np
    >>> from inswsn_lib import inertial as nav
    >>> still = nav.Velocities(np.arange(1.0, 3.0), np.zeros((2, 3)), white=np.full(3, 0.01))
    >>> thought = nav.InertialState(np.zeros(3), np.array([0.2, 0.0, 0.0]), np.eye(3))
    >>> still.innovation(0, thought, own=np.zeros(0)).value.tolist()
    [-0.2, 0.0, 0.0]
    """

    time: Array
    velocity: Array
    white: Array
    rate: Array | None = None
    lever_arm: Array | None = None

    @property
    def components(self) -> Components:
        """The measurements as a table.

        :meta private:
        """
        rows, d = self.velocity.shape
        arm, turned = np.zeros(3), np.zeros((rows, 3))
        if self.rate is not None and self.lever_arm is not None:
            arm, turned = self.lever_arm, np.cross(self.rate, self.lever_arm)
        moved = np.column_stack([turned, np.tile(arm, (rows, 1))])
        data = np.hstack([np.tile(np.eye(d, 3), (rows, 1)), np.repeat(moved, d, axis=0)])
        return _table(sensors.velocity, self.velocity, self.white, data)


@dataclass(frozen=True, eq=False)
class WheelSpeeds(_Observed):
    """Speeds by wheels, and that these do not slip to the side nor leave the ground.

    A vehicle's velocity in its own axes is (speed, 0, 0): the odometer's update and the
    non-holonomic constraint (Dissanayake et al., IEEE Trans. RA 17(5), 2001).

    Attributes
    ----------
    time : ndarray, (rows,)
        s.
    speed : ndarray, (rows,)
        m/s; NaN for the constraint alone.
    axes : ndarray, (3, 3)
        Turns vectors of the body into the vehicle's axes forward, left, up.
    white : ndarray, (3,)
        Standard deviations along these axes, m/s.

    Examples
    --------
    A car that a filter thinks to slip by 0.3 m/s to the left, and whose wheels say 10 m/s:

    >>> import numpy as np
    >>> from inswsn_lib import inertial as nav
    >>> wheels = nav.WheelSpeeds(np.ones(1), np.array([10.0]), np.eye(3), np.full(3, 0.1))
    >>> thought = nav.InertialState(np.zeros(3), np.array([10.2, 0.3, 0.0]), np.eye(3))
    >>> wheels.innovation(0, thought, own=np.zeros(0)).value.round(3).tolist()
    [-0.2, -0.3, 0.0]
    """

    time: Array
    speed: Array
    axes: Array
    white: Array

    @property
    def components(self) -> Components:
        """The measurements as a table.

        :meta private:
        """
        told = np.column_stack([self.speed, np.zeros((len(self.speed), 2))])
        data = np.column_stack([self.axes, np.zeros((3, 3)), np.full(3, -1.0)])
        return _table(sensors.body_velocity, told, self.white, data)


def _table(
    sensor: Callable[..., Any], told: Array, white: Array, data: Array,
    arm: Array = _NONE, gate: float = np.inf, period: float = 0.0,
) -> Components:  # fmt: skip
    """Return components of what was told, (rows, m); data of each, or of one row for all."""
    rows, m = told.shape
    noise = np.empty((rows * m, 3))
    noise[:, 0] = np.broadcast_to(np.square(white), told.shape).ravel()
    noise[:, 1], noise[:, 2] = gate, period
    every = data if len(data) == rows * m else np.tile(data, (rows, 1))
    return Components(
        m * np.arange(rows + 1), sensor, every.astype(float), _wide(arm), told.ravel(), noise
    )


def _wide(vectors: Array) -> Array:
    """Return vectors (..., up to 3) with three coordinates, of which the rest are zero."""
    wide = np.zeros((*vectors.shape[:-1], 3))
    wide[..., : vectors.shape[-1]] = vectors
    return wide


def gauss_markov(dt: float, times: Array, deviations: Array) -> tuple[Array, Array]:
    """Return the factors and the gained variances of Gauss-Markov errors over a time.

    One of infinite correlation time is constant, one of time zero is new each time.

    Parameters
    ----------
    dt : float
        s.
    times, deviations : ndarray, (states,)
        Correlation times, s, and standard deviations.

    Examples
    --------
    >>> import numpy as np
    >>> from inswsn_lib.inertial import gauss_markov
    >>> [each.tolist() for each in gauss_markov(1.0, np.array([0.0, np.inf]), np.ones(2))]
    [[0.0, 1.0], [1.0, 0.0]]
    """
    with np.errstate(divide="ignore"):
        factor = np.exp(-dt / np.asarray(times, dtype=float))
    return factor, np.square(deviations) * (1 - factor**2)
