"""What a filter can be given: fixes, ranges, velocities, and that a body stands still or rolls."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, ClassVar

import numpy as np

from inswsn_lib.checks import Array
from inswsn_lib.estimation.error_state import Components, Innovation
from inswsn_lib.streams import Fixes, Ranges, Whole

_NONE = np.zeros(0)
# Kinds of components
_PLACE, _RANGE, _VELOCITY, _ACROSS = range(4)


@dataclass(frozen=True, eq=False)
class PositionFixes:
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

    def transition(self, dt: float) -> tuple[Array, Array]:
        """Return factors and gained variances of the coloured errors."""
        return gauss_markov(dt, self.times, self.coloured)

    @property
    def components(self) -> Components:
        """The measurements as a table.

        :meta private:
        """
        found = _along(_PLACE, self.fixes.position, np.eye(len(self.white)), self.white)
        if len(self.coloured):
            found.own[:, 1] = np.argmax(found.vector, axis=1)
        return found._replace(arm=self.lever_arm)

    def innovation(self, k: int, state: Any, own: Array) -> Innovation | None:
        """Return the innovation of fix k; components that are NaN are left out."""
        value, rows = state.antenna(self.lever_arm)
        value = self.fixes.position[k] - value
        there = ~np.isnan(value)
        if not there.any():
            return None
        colours = np.eye(len(value))[:, : len(own)]
        if len(own):
            value = value - own
        return Innovation(
            value[there], rows[there], colours[there], np.diag(np.square(self.white)[there])
        )


@dataclass(frozen=True, eq=False)
class RangesToAnchors:
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
    >>> from inswsn_lib import estimation as est
    >>> from inswsn_lib.streams import Ranges
    >>> ranges = Ranges(np.array([1.0]), np.array([0]), np.array([5.1]), np.zeros((1, 2)), ("a",))
    >>> heard = est.RangesToAnchors(ranges, np.zeros(2), white=0.05, bias=0.2)
    >>> tag = est.PlanarState(np.array([3.0, 4.0]), heading=0.0)
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

    def transition(self, dt: float) -> tuple[Array, Array]:
        """Return factors and gained variances of the same."""
        return gauss_markov(dt, self._times, np.sqrt(self.initial))

    @cached_property
    def _times(self) -> Array:
        times = [np.inf] * bool(self.bias) + [self.correlation_time] * bool(self.coloured)
        each = np.repeat(times, len(self.ranges.anchors))
        return np.append([np.inf] * bool(self.scale), each)

    @property
    def components(self) -> Components:
        """The measurements as a table.

        :meta private:
        """
        count, scaled = len(self.ranges), int(bool(self.scale))
        own = np.full((count, 3), -1)
        own[:, 0] += scaled
        for k in range(len(self._deviations)):
            own[:, 1 + k] = scaled + k * len(self.ranges.anchors) + self.ranges.anchor
        return Components(
            self._stamps[1], _RANGE, self.ranges.anchors[self.ranges.anchor], self.lever_arm,
            self.ranges.distance, np.full(count, self.white**2), own,
        )  # fmt: skip

    def innovation(self, k: int, state: Any, own: Array) -> Innovation | None:
        """Return the innovation of the ranges of stamp k."""
        part = slice(*self._stamps[1][k : k + 2])
        anchor = self.ranges.anchor[part]
        tag, rows = state.antenna(self.lever_arm)
        away = tag - self.ranges.anchors[anchor]
        distance = np.linalg.norm(away, axis=1)
        errors = np.zeros((len(anchor), len(own)))
        first, factor = int(bool(self.scale)), 1.0
        if first:
            errors[:, 0], factor = distance, 1 + own[0]
        for begin in range(first, len(own), len(self.ranges.anchors)):
            errors[np.arange(len(anchor)), begin + anchor] = 1.0
        value = self.ranges.distance[part] - distance - errors @ own
        noise = self.white**2 * np.eye(len(anchor))
        return Innovation(value, factor * away / distance[:, None] @ rows, errors, noise)


@dataclass(frozen=True, eq=False)
class Velocities:
    """Velocities that were measured, white; with zeros, that the body stands still (ZUPT).

    Attributes
    ----------
    time : ndarray, (rows,)
        s.
    velocity : ndarray, (rows, d)
        m/s, in the frame of the recording; NaN where missing.
    white : ndarray, (d,)
        Standard deviations, m/s.

    Examples
    --------
    A body that stands still, and of which a filter thinks otherwise:

    >>> import numpy as np
    >>> from inswsn_lib import estimation as est
    >>> still = est.Velocities(np.arange(1.0, 3.0), np.zeros((2, 3)), white=np.full(3, 0.01))
    >>> thought = est.InertialState(np.zeros(3), np.array([0.2, 0.0, 0.0]), np.eye(3))
    >>> still.innovation(0, thought, own=np.zeros(0)).value.tolist()
    [-0.2, 0.0, 0.0]
    """

    time: Array
    velocity: Array
    white: Array
    initial: Array = field(default_factory=lambda: _NONE, init=False)

    def transition(self, dt: float) -> tuple[Array, Array]:
        """Return nothing: there is no state."""
        return _NONE, _NONE

    @property
    def components(self) -> Components:
        """The measurements as a table.

        :meta private:
        """
        return _along(_VELOCITY, self.velocity, np.eye(len(self.white)), self.white)

    def innovation(self, k: int, state: Any, own: Array) -> Innovation | None:
        """Return the innovation of row k."""
        value, rows = state.moving()
        value = self.velocity[k] - value
        there = ~np.isnan(value)
        if not there.any():
            return None
        noise = np.diag(np.square(self.white)[there])
        return Innovation(value[there], rows[there], np.zeros((there.sum(), 0)), noise)


@dataclass(frozen=True, eq=False)
class WheelSpeeds:
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
    >>> from inswsn_lib import estimation as est
    >>> wheels = est.WheelSpeeds(np.ones(1), np.array([10.0]), np.eye(3), np.full(3, 0.1))
    >>> thought = est.InertialState(np.zeros(3), np.array([10.2, 0.3, 0.0]), np.eye(3))
    >>> wheels.innovation(0, thought, own=np.zeros(0)).value.round(3).tolist()
    [-0.2, -0.3, 0.0]
    """

    time: Array
    speed: Array
    axes: Array
    white: Array
    initial: Array = field(default_factory=lambda: _NONE, init=False)

    def transition(self, dt: float) -> tuple[Array, Array]:
        """Return nothing: there is no state."""
        return _NONE, _NONE

    @property
    def components(self) -> Components:
        """The measurements as a table.

        :meta private:
        """
        rest = np.zeros((len(self.speed), 2))
        told = np.column_stack([self.speed, rest])
        return _along(_ACROSS, told, self.axes, self.white)

    def innovation(self, k: int, state: Any, own: Array) -> Innovation:
        """Return the innovation of row k."""
        value, rows = state.moving_in(self.axes)
        value = np.array([self.speed[k], 0.0, 0.0]) - value
        there = ~np.isnan(value)
        noise = np.diag(np.square(self.white)[there])
        return Innovation(value[there], rows[there], np.zeros((there.sum(), 0)), noise)


@dataclass(frozen=True)
class Constants:
    """States that nothing measures and that do not change: what is remembered of a start.

    Attributes
    ----------
    count : int
    """

    count: int
    time: ClassVar[Array] = _NONE

    @property
    def initial(self) -> Array:
        """Variances, which a start has that goes with them."""
        return np.zeros(self.count)

    def transition(self, dt: float) -> tuple[Array, Array]:
        """Return that they stay."""
        return np.ones(self.count), np.zeros(self.count)

    @property
    def components(self) -> Components:
        """An empty table.

        :meta private:
        """
        return _along(_PLACE, np.zeros((0, 3)), np.eye(3), np.ones(3))._replace(arm=np.zeros(3))

    def innovation(self, k: int, state: Any, own: Array) -> None:
        """Return nothing."""


def _along(kind: int, told: Array, axes: Array, white: Array) -> Components:
    """Return the components along axes that are not NaN, of what was told (rows, axes)."""
    row, axis = np.nonzero(~np.isnan(told))
    first = np.searchsorted(row, np.arange(len(told) + 1))
    own = np.full((len(row), 3), -1)
    noise = np.square(white)[axis]
    return Components(first, kind, axes[axis], np.zeros(len(axes)), told[row, axis], noise, own)


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
    >>> from inswsn_lib.estimation import gauss_markov
    >>> [each.tolist() for each in gauss_markov(1.0, np.array([0.0, np.inf]), np.ones(2))]
    [[0.0, 1.0], [1.0, 0.0]]
    """
    with np.errstate(divide="ignore"):
        factor = np.exp(-dt / np.asarray(times, dtype=float))
    return factor, np.square(deviations) * (1 - factor**2)
