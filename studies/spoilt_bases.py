"""Recordings that are spoilt, and what a filter of the ladder makes of them.

Three are made, of which all is known; the others have names, and are taken where they are to be
had. The filter of an IMU is loosely coupled, with coloured errors of fixes; that of an odometry
takes ranges, whose biases and common scale are states. They have the numbers that are most likely
on the recording as it is.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from made_recording import made, made_drive, made_imu

from inswsn_lib import logs
from inswsn_lib.checks import Array
from inswsn_lib.logs.correction import COLOURED, PLANAR_TIGHT, correction_of
from inswsn_lib.logs.estimates import of_solution, truth_at
from inswsn_lib.streams import Recording

_ALIGNED = 20.0  # s
_NEAR = 1.0  # s, between fixes between which a place is told
_EVERY = 4  # of fixes without a reference, one is taken and the others judge


@dataclass(frozen=True, eq=False)
class Base:
    """A recording to be spoilt.

    Attributes
    ----------
    recording : Recording
    """

    recording: Recording

    @property
    def name(self) -> str:
        """That of the recording."""
        return self.recording.name

    @property
    def kind(self) -> str:
        """The streams that a filter runs on."""
        motion = "odometry" if self.recording.odometry else "IMU"
        return f"{motion} and {'ranges' if self.recording.ranges else 'fixes'}"

    @cached_property
    def numbers(self) -> tuple[float, ...]:
        """Of the filter, as they are searched on the recording that is right."""
        ladder = logs.Ladder(self.recording, alignment=_ALIGNED, begins=1)
        return ladder.tuned(_named(ladder.rungs)).best

    def error(self, spoilt: Recording) -> float:
        """Return the RMS error of the filter on a spoilt recording, m.

        Against where the body was, and against the reference of the spoilt recording: the larger.
        """
        filters = correction_of(spoilt, _ALIGNED)
        rung = filters.rungs[_named(filters.rungs)]
        times, gone = filters.fixes.time, np.zeros(len(filters.fixes), dtype=bool)
        if self.recording.reference is None:
            gone = np.arange(len(times)) % _EVERY != 0
        found = of_solution(rung.run(*self.numbers, gone=gone), filters.lever_arm, times)
        errors = [rms(found.state[:, :2] - places(self.recording, times))]
        if spoilt.reference is not None:
            errors.append(rms(found.state[:, :2] - places(spoilt, times)))
        return float(np.nanmax(errors))


def _named(rungs: Mapping[str, logs.Rung]) -> str:
    return PLANAR_TIGHT if PLANAR_TIGHT in rungs else COLOURED


def rms(errors: Array) -> float:
    """Return the root of the mean squared length of vectors; NaN of none."""
    there = np.isfinite(errors).all(axis=1)
    return float(np.sqrt(np.mean(np.sum(errors[there] ** 2, axis=1)))) if there.any() else np.nan


def places(recording: Recording, times: Array) -> Array:
    """Return where the tag was by the reference, or else by the fixes that are good, (n, 2)."""
    if recording.reference is not None:
        return truth_at(recording, times)[:, :2]
    fixes = recording.fixes
    assert fixes is not None
    there = np.isfinite(fixes.position).all(axis=1)
    if fixes.good is not None:
        there &= fixes.good
    time, place = fixes.time[there], fixes.position[there, :2]
    found = np.column_stack([np.interp(times, time, x) for x in place.T])
    after = np.searchsorted(time, times)
    gap = np.concatenate([[np.inf], np.diff(time), [np.inf]])[after]
    found[(gap > _NEAR) & ~np.isin(times, time)] = np.nan
    return found


def made_room() -> Base:
    """Make a tag that is carried about a room, with an IMU and ranges."""
    arm = (0.05, 0.0, 0.1)
    right = made(1, seconds=60, rate=40, lasting=0.03, lever_arm=arm)
    imu = made_imu(1, seconds=60)
    whole = replace(right, name="made, ranges", imu=imu, lever_arm=np.array(arm))
    return Base(whole)


def made_fixes() -> Base:
    """Make the same, of which fixes were logged."""
    base = made_room()
    assert base.recording.ranges is not None
    fixes = logs.multilaterate_track(base.recording.ranges, 0.2)
    right = replace(base.recording, name="made, fixes", ranges=None, fixes=fixes)
    return Base(right)


def made_wheels() -> Base:
    """Make a vehicle with odometry and ranges."""
    right = replace(made_drive(1), name="made, odometry")
    return Base(right)


MADE = (made_room, made_fixes, made_wheels)
#: From and to when each is taken, s from the begin
_RECORDED = {
    "inrol/1": (0, 100),
    "inrol/2": (0, 100),
    "plaza/1": (0, 400),
    "plaza/2": (0, np.inf),
    "labyrinth/1": (0, np.inf),
    "rtklib/drive-0708": (300, 420),
    "rtklib/walk-0827": (0, np.inf),
}


def recorded(name: str) -> Base | None:
    """Return a recording that has a name; None where it is not to be had."""
    try:
        whole = logs.load(name)
    except logs.RecordingUnavailableError:
        return None
    first, last = _RECORDED[name]
    begin = whole.span[0]
    part = whole.part(begin + first, begin + last)
    return Base(replace(part, name=name))


def bases(chosen: tuple[Callable[[], Base], ...] = MADE, *, real: bool = True) -> list[Base]:
    """Return the recordings that are to be spoilt."""
    found = [make() for make in chosen]
    there = [recorded(name) for name in _RECORDED] if real else []
    return found + [base for base in there if base is not None]
