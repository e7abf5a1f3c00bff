"""Where a reference has the body, and what the body carries, between its time stamps."""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation, Slerp

from inswsn_lib.checks import Array, Mask
from inswsn_lib.recordings.recording import Reference

_GAP = 0.5  # s, or three periods: between stamps that are farther apart nothing is told


class ReferenceMotion:
    """A reference between its stamps: straight lines, and turns about one axis.

    Parameters
    ----------
    reference : Reference
    dimensions : int
        Of what it is compared with, 2 or 3; the first of its coordinates.
    """

    def __init__(self, reference: Reference, dimensions: int) -> None:
        self.d = dimensions
        there = np.isfinite(reference.position).all(axis=1)
        self.time = reference.time[there]
        self._track = reference.position[there, :dimensions]
        self.middle: Array = self._track.mean(axis=0)
        steps = np.diff(self.time)
        self.period = float(np.median(steps)) if steps.size else 0.0
        self._gap = max(_GAP, 3 * self.period)
        self._turns: Slerp | None = None
        if reference.attitude is not None and len(self.time) > 1:
            self._turns = Slerp(self.time, Rotation.from_quat(reference.attitude[there]))

    @property
    def has_attitude(self) -> bool:
        """Whether the reference tells it."""
        return self._turns is not None

    def covers(self, time: Array, margin: float = 0.0) -> Mask:
        """Tell which times are within it by a margin (s), and in no gap."""
        after = np.clip(np.searchsorted(self.time, time), 1, len(self.time) - 1)
        near = self.time[after] - self.time[after - 1] <= self._gap
        inside = (time >= self.time[0] + margin) & (time <= self.time[-1] - margin)
        return np.asarray(near & inside)

    def position(self, time: Array) -> Array:
        """Return where the body was, (n, d)."""
        return np.column_stack([np.interp(time, self.time, x) for x in self._track.T])

    def attitude(self, time: Array) -> Array:
        """Return the matrices (n, d, 3) that turn vectors of the body into the frame."""
        if self._turns is None:
            return np.broadcast_to(np.eye(self.d, 3), (len(time), self.d, 3))
        turned = self._turns(np.clip(time, self.time[0], self.time[-1])).as_matrix()
        return np.asarray(turned[:, : self.d])

    def carried(self, time: Array, lever_arm: Array) -> Array:
        """Return where a point of the body was, (n, d)."""
        there = self.position(time)
        if self._turns is None or not lever_arm.any():
            return there
        return np.asarray(there + self.attitude(time) @ lever_arm)

    def velocity(self, time: Array, lever_arm: Array) -> Array:
        """Return the velocity of a point of the body, (n, d), m/s, over some periods."""
        half = max(0.02, 2 * self.period)
        ends = self.carried(time + half, lever_arm) - self.carried(time - half, lever_arm)
        return np.asarray(ends / (2 * half))
