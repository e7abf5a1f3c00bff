"""Rates of turning, as a gyro feels them and as attitudes, headings and courses tell them."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.integrate import cumulative_trapezoid
from scipy.spatial.transform import Rotation, Slerp

from inswsn_lib.checks import Array, Mask
from inswsn_lib.errors import InswsnError
from inswsn_lib.logs.blocks import spaced
from inswsn_lib.streams import Imu, Recording, Reference, Whole

_WINDOW, _COURSE_WINDOW, _LONGEST = 0.2, 0.5, 4.0  # s
_ANGLE = 0.15  # rad, of errors of a course by positions, above which its chords are longer
_CLEAR = 3.0  # deviations of a chord by its errors, that it is longer than
_PERIODS = 3  # that a window has at least
_GAP = 0.25  # s, or three periods: across a longer one nothing is told


def along(time: Array, values: Array, at: Array) -> Array:
    """Return values (n, columns) on straight lines between their time stamps."""
    return np.column_stack([np.interp(at, time, x) for x in values.T])


class Felt:
    """The integral of rates (n, axes); over a chord, of their means over it."""

    def __init__(self, time: Array, rate: Array, chord: float = 0.0) -> None:
        if chord:
            rate = Felt(time, rate).mean(time, chord)
        self.time, self._sum = time, cumulative_trapezoid(rate, time, axis=0, initial=0)
        self.gaps = gaps_before(time)

    def mean(self, time: Array, window: float) -> Array:
        """Return the mean rates over windows around some times, (n, axes)."""
        early, late = (along(self.time, self._sum, time + h * window) for h in (-0.5, 0.5))
        return (late - early) / window


@dataclass(frozen=True, eq=False)
class Told:
    """Rates (n, axes) over windows around times, and the attitude there where it is known."""

    by: str
    time: Array
    rate: Array
    window: float
    attitude: Rotation | None = None
    chord: float = 0.0  # s, over which positions tell a course
    speed: float = np.nan  # m/s, usual, of a course

    def some(self, rows: slice | Mask) -> Told:
        """Return some of the rows."""
        attitude = None if self.attitude is None else self.attitude[rows]
        return replace(self, time=self.time[rows], rate=self.rate[rows], attitude=attitude)

    def vertical(self) -> Told:
        """Return the rate of the heading, of rates along axes of the body."""
        assert self.attitude is not None
        return replace(self, by="heading", rate=self.attitude.apply(self.rate)[:, 2:])

    def felt_by(self, imu: Imu) -> Felt:
        """Return the gyro's rates that are compared: of all axes, or about the vertical."""
        if self.by == "attitude":
            return Felt(imu.time, imu.rate)
        up = imu.force.mean(axis=0)
        up /= max(float(np.linalg.norm(up)), 1e-300)
        return Felt(imu.time, imu.rate @ up[:, None], self.chord)

    def covered(self, felt: Felt, clock: float, margin: float = 0.0) -> Mask:
        """Tell over which windows a sensor whose stamps are late was there, without a gap."""
        half = self.window / 2 + margin
        early, late = self.time + clock - half, self.time + clock + half
        return unbroken(felt.time, early, late, felt.gaps)

    def pairs(self, felt: Felt, clock: float) -> tuple[Array, Array, Mask]:
        """Return what is felt over the windows and what is told, and which rows have both."""
        rows = self.covered(felt, clock)
        seen = felt.mean(self.time + clock, self.window) if rows.any() else self.rate
        return seen, self.rate, rows


def told_by(recording: Recording, window: float = _WINDOW, slowest: float = 1.0) -> Told:
    """Return the rates that the reference's attitude tells, else those of a course.

    Windows have a length (s) at least; what is slower (m/s) has no course.
    """
    reference, fixes = recording.reference, recording.fixes
    if reference is not None and reference.attitude is not None and len(reference) > 1:
        return _by_attitude(reference, _longer(window, reference.time))
    if fixes is not None and fixes.velocity is not None:
        there = np.isfinite(fixes.velocity).all(axis=1)
        return _by_velocities(fixes.time[there], fixes.velocity[there, :2], window, slowest)
    for source in (reference, fixes):
        if source is not None and len(source) > 2:
            there = np.isfinite(source.position[:, :2]).all(axis=1)
            return _by_positions(source.time[there], source.position[there, :2], window, slowest)
    raise InswsnError(
        f"The recording {recording.name} has neither a reference nor fixes, by which an IMU's "
        "clock could be told."
    )


def gaps_before(time: Array) -> Whole:
    """Return how many gaps are before each stamp."""
    steps = np.diff(time)
    return np.append(0, np.cumsum(steps > max(_GAP, 3 * float(np.median(steps)))))


def unbroken(time: Array, early: Array, late: Array, gaps: Whole) -> Mask:
    """Tell which intervals lie within some stamps, and in none of their gaps."""
    first, last = np.searchsorted(time, early, side="right") - 1, np.searchsorted(time, late)
    first, last = np.maximum(first, 0), np.minimum(last, len(time) - 1)
    return np.asarray((early >= time[0]) & (late <= time[-1]) & (gaps[first] == gaps[last]))


def windows(time: Array, window: float, step: float | None = None) -> tuple[Array, Mask]:
    """Return the middles of windows over some stamps, and which have no gap."""
    middle = spaced(time[0] + window / 2, time[-1] - window / 2, step or window, len(time))
    half = window / 2 - 1e-9  # rounding takes none of them away
    return middle, unbroken(time, middle - half, middle + half, gaps_before(time))


def _longer(window: float, time: Array) -> float:
    return max(window, _PERIODS * float(np.median(np.diff(time))))


def _by_attitude(reference: Reference, h: float) -> Told:
    middle, kept = windows(reference.time, h)
    middle = middle[kept]
    if not len(middle):
        raise InswsnError(f"The reference has no {h:g} s without a gap.")
    attitude = Slerp(reference.time, Rotation.from_quat(reference.attitude))
    ends = np.clip([middle - h / 2, middle + h / 2], reference.time[0], reference.time[-1])
    turns = attitude(ends[0]).inv() * attitude(ends[1])
    return Told("attitude", middle, turns.as_rotvec() / h, h, attitude(middle))


def _by_velocities(time: Array, velocity: Array, window: float, slowest: float) -> Told:
    if len(time) < 3:
        raise InswsnError("There are too few velocities to tell a course by.")
    h = _longer(max(window, _COURSE_WINDOW), time)
    middle, kept = windows(time, h)
    ends = np.array([along(time, velocity, middle + side) for side in (-h / 2, h / 2)])
    return _course(middle, ends, kept & (_slower(ends) >= slowest), h, slowest)


def _by_positions(time: Array, place: Array, window: float, slowest: float) -> Told:
    """Return the rates of the course of chords, so long that their errors are no matter."""
    if len(time) < 5:
        raise InswsnError("There are too few positions to tell a course by.")
    usual = 1.4826 * np.median(np.abs(np.diff(place, 2, axis=0))) / np.sqrt(6)
    h, error = _longer(max(window, _COURSE_WINDOW), time), np.sqrt(2) * usual
    while True:
        middle, kept = windows(time, 2 * h, h)
        ends = np.diff([along(time, place, middle + side * h) for side in (-1, 0, 1)], axis=0) / h
        speed = _slower(ends)
        kept &= speed > max(slowest, _CLEAR * error / h)
        clear = kept.any() and error < _ANGLE * h * float(np.median(speed[kept]))
        if clear or 2 * h > _LONGEST:
            return _course(middle, ends, kept, h, slowest, h)
        h *= 2


def _slower(ends: Array) -> Array:
    """Return the lesser speed of velocities at both ends of windows, (2, n, 2)."""
    return np.asarray(np.linalg.norm(ends, axis=2).min(axis=0))


def _course(
    time: Array, ends: Array, kept: Mask, window: float, slowest: float, chord: float = 0.0
) -> Told:
    """Return the rates by velocities at both ends of windows, (2, n, 2)."""
    if not kept.any():
        raise InswsnError(f"It never moves at {slowest:g} m/s, so it has no course.")
    early, late = np.arctan2(ends[:, kept, 1], ends[:, kept, 0])
    rate = np.angle(np.exp(1j * (late - early)))[:, None] / window
    speed = float(np.median(_slower(ends)[kept]))
    return Told("course", time[kept], rate, window, None, chord, speed)
