"""Where a reference has the body, and what the body carries, between its time stamps."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from inswsn_lib.checks import Array, Mask
from inswsn_lib.errors import InswsnError
from inswsn_lib.streams import Reference

_GAP = 0.5  # s, or three periods: between stamps that are farther apart nothing is told
_HALF = 0.05  # s, of what velocities are differences over: stamps jitter by milliseconds


class ReferenceMotion:
    """A reference on straight lines between its stamps, also where the body carries something.

    Parameters
    ----------
    reference : Reference
    dimensions : int
        Of what it is compared with, 2 or 3; the first of its coordinates.
    """

    def __init__(self, reference: Reference, dimensions: int) -> None:
        self.d = dimensions
        there = np.isfinite(reference.position).all(axis=1)
        if there.sum() < 2:
            raise InswsnError("The reference has fewer than two positions.")
        self.time = reference.time[there]
        self._track = self._point = reference.position[there, :dimensions]
        self.middle: Array = self._track.mean(axis=0)
        self.period = float(np.median(np.diff(self.time)))
        self.has_attitude = reference.attitude is not None
        matrices = np.broadcast_to(np.eye(3), (len(self.time), 3, 3))
        if reference.attitude is not None:
            matrices = Rotation.from_quat(reference.attitude[there]).as_matrix()
        self._turned: Array = matrices
        self._arm: Array = np.zeros(3)

    def covers(self, time: Array, margin: float = 0.0) -> Mask:
        """Tell which times are within it by a margin (s), and in no gap."""
        before = self._before(time)
        near = self.time[before + 1] - self.time[before] <= max(_GAP, 3 * self.period)
        inside = (time >= self.time[0] + margin) & (time <= self.time[-1] - margin)
        return np.asarray(near & inside)

    def position(self, time: Array) -> Array:
        """Return where the body was, (n, d)."""
        return self._between(self._track, time)

    def attitude(self, time: Array) -> Array:
        """Return the matrices (n, d, 3) that turn vectors of the body into the frame."""
        return self._between(self._turned[:, : self.d], time)

    def rotation(self, time: Array) -> Rotation:
        """Return the rotations from the axes of the body to the frame."""
        return Rotation.from_matrix(self._between(self._turned, time))

    def carried(self, time: Array, lever_arm: Array) -> Array:
        """Return where a point of the body was, (n, d); without an attitude, where that was."""
        if self.has_attitude and not np.array_equal(lever_arm, self._arm):
            self._arm = np.array(lever_arm, dtype=float)
            self._point = self._track + self._turned[:, : self.d] @ self._arm
        return self._between(self._point, time)

    def velocity(self, time: Array, lever_arm: Array) -> Array:
        """Return the velocity of a point of the body, (n, d), m/s, over some periods."""
        half = max(_HALF, 2 * self.period)
        late, early = np.clip([time + half, time - half], self.time[0], self.time[-1])
        ends = self.carried(late, lever_arm) - self.carried(early, lever_arm)
        return np.asarray(ends / np.maximum(late - early, 1e-9)[:, None])

    def _before(self, time: Array) -> NDArray[np.intp]:
        return np.clip(np.searchsorted(self.time, time) - 1, 0, len(self.time) - 2)

    def _between(self, values: Array, time: Array) -> Array:
        i = self._before(time)
        share = np.clip((time - self.time[i]) / (self.time[i + 1] - self.time[i]), 0.0, 1.0)
        share = share.reshape(-1, *[1] * (values.ndim - 1))
        return np.asarray(values[i] + share * (values[i + 1] - values[i]))
