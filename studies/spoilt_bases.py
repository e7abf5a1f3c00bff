"""Recordings that are spoilt, and what the standard filter makes of them.

Three are made, of which all is known; the others have names, and are taken where they are to be
had. The filter of an IMU is loosely coupled, with coloured errors of fixes; that of an odometry
takes ranges, whose biases and common scale are states. Their numbers are fixed.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from made_recording import made, made_drive, made_imu
from numpy.typing import NDArray

from inswsn_lib import logs
from inswsn_lib.errors import InswsnError
from inswsn_lib.inertial import (
    ImuNoise,
    InertialMotion,
    OdometryMotion,
    OdometryNoise,
    PlanarState,
    PositionFixes,
    RangesToAnchors,
    Start,
    align,
    run_error_state,
)
from inswsn_lib.inertial.error_state import antenna
from inswsn_lib.logs import multilaterate_track
from inswsn_lib.logs.reference_motion import ReferenceMotion
from inswsn_lib.streams import Fixes, Recording

Array = NDArray[np.float64]

_ALIGNED = 20.0  # s
_UP = np.array([1.0, 1.0, 2.0])
_EVERY = 4  # of fixes without a reference, one is taken and the others judge
_BEGIN = np.diag([0.5, 0.5, 0.3, 0.1, 0.05]) ** 2


@dataclass(frozen=True, eq=False)
class Base:
    """A recording to be spoilt.

    Attributes
    ----------
    recording : Recording
    white, coloured : float
        Of fixes, or of ranges beside odometry, m; coloured errors last 3 s.
    noise : ImuNoise or OdometryNoise
    """

    recording: Recording
    white: float
    coloured: float
    noise: ImuNoise | OdometryNoise

    @property
    def name(self) -> str:
        """That of the recording."""
        return self.recording.name

    @property
    def kind(self) -> str:
        """The streams that a filter runs on."""
        motion = "odometry" if self.recording.odometry else "IMU"
        return f"{motion} and {'ranges' if self.recording.ranges else 'fixes'}"

    @property
    def judged(self) -> tuple[Array, Array]:
        """Times and places, (n,) and (n, 2), by which a track is judged."""
        there = self.recording
        if there.reference is not None:
            begin, end = there.reference.time[[0, -1]]
            times = np.arange(begin + 1, end, 0.5)
            return times, places(there, times)
        assert there.fixes is not None
        withheld = np.arange(len(there.fixes)) % _EVERY != 0
        withheld &= np.isfinite(there.fixes.position).all(axis=1)
        if there.fixes.good is not None:
            withheld &= there.fixes.good
        return there.fixes.time[withheld], there.fixes.position[withheld, :2]

    def track(self, spoilt: Recording) -> tuple[Array, Array]:
        """Return times and places by the standard filter, of those that are judged."""
        times, _ = self.judged
        start, observed, motion = self._planar(spoilt) if spoilt.odometry else self._spatial(spoilt)
        d = 2 if spoilt.odometry else 3
        silent = PositionFixes(Fixes(times, np.full((len(times), d), np.nan)), _UP[:d], _UP[:d])
        arm = spoilt.lever_arm[:d]
        found = run_error_state(motion, start, [observed, silent])
        times = times[times > start.time]
        at = found.at(times)
        where, _ = antenna([found.states[k] for k in at], found.covariances[at], arm)
        return times, where[:, :2]

    def _spatial(self, spoilt: Recording) -> tuple[Start, PositionFixes, InertialMotion]:
        if spoilt.imu is None:
            raise InswsnError("There is no IMU.")
        if spoilt.ranges is not None:
            begin, end = spoilt.imu.time[[0, -1]]
            fixes = multilaterate_track(spoilt.ranges.part(float(begin), float(end)), 0.2)
        elif spoilt.fixes is not None:
            fixes = spoilt.fixes if spoilt.reference else _some(spoilt.fixes)
        else:
            raise InswsnError("There are neither ranges nor fixes.")
        motion = InertialMotion(spoilt.imu, self.noise)
        white = PositionFixes(fixes, spoilt.lever_arm, max(self.white, self.coloured) * _UP)
        start = align(motion, [white], fixes.time[0] - 0.1, fixes.time[0] + _ALIGNED)
        colour = (self.coloured * _UP, np.full(3, 3.0)) if self.coloured else ()
        return start, PositionFixes(fixes, spoilt.lever_arm, self.white * _UP, *colour), motion

    def _planar(self, spoilt: Recording) -> tuple[Start, RangesToAnchors, OdometryMotion]:
        """Start where the reference of the recording that is right says."""
        if spoilt.ranges is None:
            raise InswsnError("There are no ranges.")
        times = self.judged[0][:2]
        (here, ahead) = places(self.recording, times)
        heading = float(np.arctan2(*(ahead - here)[::-1]))
        start = Start(float(times[0]), PlanarState(here, heading), _BEGIN)
        heard = RangesToAnchors(
            spoilt.ranges, spoilt.lever_arm[:2], self.white, bias=0.3, scale=0.1
        )
        return start, heard, OdometryMotion(spoilt.odometry, self.noise)

    def error(self, spoilt: Recording) -> float:
        """Return the RMS error of the filter on a spoilt recording, m.

        Against where the body was, and against the reference of the spoilt recording: the larger.
        """
        times, track = self.track(spoilt)
        when, where = self.judged
        truth = where[np.isin(when, times)]
        found = [rms(track - truth)]
        if spoilt.reference is not None and len(spoilt.reference) > 1:
            told = places(spoilt, times)
            there = np.isfinite(told).all(axis=1)
            found += [rms((track - told)[there])] if there.any() else []
        return max(found)


def rms(errors: Array) -> float:
    """Return the root of the mean squared length of vectors."""
    return float(np.sqrt(np.mean(np.sum(errors**2, axis=1))))


def places(recording: Recording, times: Array) -> Array:
    """Return where the reference says that the antenna is, (n, 2); NaN where it is not there."""
    assert recording.reference is not None
    d = recording.reference.position.shape[1]
    motion = ReferenceMotion(recording.reference, d)
    found = np.full((len(times), 2), np.nan)
    there = motion.covers(times)
    arm = np.asarray(recording.lever_arm, dtype=float)
    found[there] = motion.carried(times[there], arm)[:, :2]
    return found


def _some(fixes: Fixes) -> Fixes:
    """Return one of some fixes; the others judge."""
    return Fixes(fixes.time[::_EVERY], fixes.position[::_EVERY])


def made_room() -> Base:
    """Make a tag that is carried about a room, with an IMU and ranges."""
    arm = (0.05, 0.0, 0.1)
    right = made(1, seconds=60, rate=40, lasting=0.03, lever_arm=arm)
    imu = made_imu(1, seconds=60)
    whole = replace(right, name="made, ranges", imu=imu, lever_arm=np.array(arm))
    return Base(whole, 0.04, 0.08, ImuNoise(0.02, 0.002, 1e-3, 1e-4))


def made_fixes() -> Base:
    """Make the same, of which fixes were logged."""
    base = made_room()
    assert base.recording.ranges is not None
    fixes = multilaterate_track(base.recording.ranges, 0.2)
    right = replace(base.recording, name="made, fixes", ranges=None, fixes=fixes)
    return replace(base, recording=right)


def made_wheels() -> Base:
    """Make a vehicle with odometry and ranges."""
    right = replace(made_drive(1), name="made, odometry")
    return Base(right, 0.1, 0.0, OdometryNoise(0.05, 0.01, 1e-4, 1e-4))


MADE = (made_room, made_fixes, made_wheels)
# name: from and to when, s from the begin; white and coloured; noise
_RECORDED: dict[str, tuple[float, float, float, float, ImuNoise | OdometryNoise]] = {
    "inrol/1": (0, 100, 0.04, 0.08, ImuNoise(0.02, 0.002, 1e-3, 1e-4)),
    "inrol/2": (0, 100, 0.04, 0.08, ImuNoise(0.02, 0.002, 1e-3, 1e-4)),
    "plaza/1": (0, 400, 0.5, 0.0, OdometryNoise(0.05, 0.02, 1e-3, 1e-3)),
    "plaza/2": (0, np.inf, 0.5, 0.0, OdometryNoise(0.05, 0.02, 1e-3, 1e-3)),
    "labyrinth/1": (0, np.inf, 0.3, 0.0, OdometryNoise(0.05, 0.02, 1e-3, 1e-3)),
    "rtklib/drive-0708": (300, 420, 0.05, 0.0, ImuNoise(0.05, 0.005, 1e-3, 1e-4)),
    "rtklib/walk-0827": (0, np.inf, 0.05, 0.0, ImuNoise(0.1, 0.01, 1e-3, 1e-4)),
}


def recorded(name: str) -> Base | None:
    """Return a recording that has a name; None where it is not to be had."""
    try:
        whole = logs.load(name)
    except logs.RecordingUnavailableError:
        return None
    first, last, *numbers = _RECORDED[name]
    begin = whole.span[0]
    part = whole.part(begin + first, begin + last)
    return Base(replace(part, name=name), *numbers)


def bases(chosen: tuple[Callable[[], Base], ...] = MADE, *, real: bool = True) -> list[Base]:
    """Return the recordings that are to be spoilt."""
    found = [make() for make in chosen]
    there = [recorded(name) for name in _RECORDED] if real else []
    return found + [base for base in there if base is not None]
