"""Motion from one event to the next, as the filter takes it: pieces in which nothing changes."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from inswsn_lib.checks import Array
from inswsn_lib.streams import Whole


@dataclass(frozen=True, eq=False)
class Steps:
    """What an IMU or an odometry told between events.

    Attributes
    ----------
    lengths : ndarray, (pieces,)
        s, the same in all runs.
    rates, forces : ndarray, (records, rows, 3)
        Angular rate (rad/s) and specific force (m/s^2) in axes of the body; (records, rows, 2) both
        are speed (m/s) and rate (rad/s) on a plane.
    ends : ndarray, (events,)
        How many pieces lie before each event.
    densities : ndarray, (4,)
        Of white noise of forces and rates, and of the walks of their biases; on a plane of speed,
        rate, and the walks of scale and bias.
    increments : bool
        Rates and forces are integrals over a piece, rad and m/s, the latter in axes of the body at
        its beginning, corrected for sculling and rotation.
    substep : float
        How long a step of the covariance is at least, s.
    earth : ndarray, (4,)
        Numbers of an `Earth`; zeros are flat.
    which, offsets : ndarray, (runs,)
        The record of each run, and the row of its first piece.
    """

    lengths: Array
    rates: Array
    forces: Array
    ends: Whole
    densities: Array
    increments: bool = False
    substep: float = 0.2
    earth: Array = field(default_factory=lambda: np.zeros(4))
    which: Whole = field(default_factory=lambda: np.zeros(1, dtype=np.int64))
    offsets: Whole = field(default_factory=lambda: np.zeros(1, dtype=np.int64))

    @property
    def numbers(self) -> tuple[Any, ...]:
        """All of it, in the order in which the filter takes it."""
        arrays = [np.require(x, float, ["C", "W"]) for x in (self.lengths, self.rates, self.forces)]
        which, offsets, ends = (
            np.require(x, np.int64, ["C", "W"]) for x in (self.which, self.offsets, self.ends)
        )
        rest = np.require(self.densities, float, ["C", "W"]), float(self.substep) - 1e-9
        return (*arrays, self.increments, ends, *rest, np.array(self.earth), which, offsets)
