"""Whether odometry has the signs, the units and the size of what a reference tells."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
from scipy.stats import t

from inswsn_lib.calibration.blocks import spaced
from inswsn_lib.calibration.linear_fit import fit_linear
from inswsn_lib.calibration.reference_motion import ReferenceMotion
from inswsn_lib.checks import Array, Mask
from inswsn_lib.errors import InswsnError
from inswsn_lib.recordings.findings import FALSE_ALARM, Finding
from inswsn_lib.recordings.likeness import units_of
from inswsn_lib.streams import Odometry, Recording

_BLOCK = 5.0  # s
_WINDOW = 1.0  # s, of which the displacements are compared
_LET = 0.1  # of a size that is right: wheels wear
_CHORD = 0.4  # likewise, where a course is compared with turns
_TOLD = 0.5  # the widest bound with which a size is told
_SPEEDS = {"in km/h": 3.6, "in knots": 1.9438, "in cm/s": 100.0, "in mm/s": 1000.0}
_RATES = {"in deg/s": 57.29578, "by half the track": 2.0, "by twice the track": 0.5}
_MOVES = 0.3  # of the largest speeds, above which a course is told
_MOST = 1.0  # rad, that a course may change from one window to the next


def check_odometry(recording: Recording) -> Iterator[Finding]:
    """Yield whether speed and heading rate go with the reference."""
    odometry, reference = recording.odometry, recording.reference
    if odometry is None or len(odometry) < 2:
        return
    if reference is None or len(reference) < 3:
        says = "without a reference its signs and sizes cannot be told"
        yield Finding("odometry", "odometry", np.nan, np.nan, np.nan, None, says)
        return
    motion = ReferenceMotion(reference, 2)
    begin = max(motion.time[0], odometry.time[0])
    end = min(motion.time[-1], odometry.time[-1])
    try:
        ends = spaced(begin, end, _WINDOW, len(odometry) + len(reference))
    except InswsnError as error:
        says = str(error).rstrip(".")
        yield Finding("odometry", "odometry", np.nan, np.nan, np.nan, None, says)
        return
    if len(ends) < 4:
        return
    whole = motion.covers(ends)
    whole = whole[1:] & whole[:-1]
    moved = np.diff(motion.position(ends), axis=0) / _WINDOW
    way, heading = _dead_reckoned(odometry)
    track = np.column_stack([np.interp(ends, odometry.time, x) for x in way.T])
    middle = (ends[1:] + ends[:-1]) / 2
    yield _speed(motion, odometry, middle, moved, whole)
    if motion.has_attitude:
        turned = np.diff(_yaw(motion, ends)) / _WINDOW
        rate = np.diff(np.interp(ends, odometry.time, heading)) / _WINDOW
        yield _judged("odometry's heading rate", turned[whole], rate[whole], middle[whole], _RATES)
    else:
        own = np.diff(track, axis=0) / _WINDOW
        found = _course_rate(moved, own, middle, whole)
        if found.fits is None:  # the track by the odometry may turn too fast to have a course
            turned = np.diff(np.interp(middle, odometry.time, heading))
            found = _course_rate(moved, moved, middle, whole, turned)
        yield found


def _dead_reckoned(odometry: Odometry) -> tuple[Array, Array]:
    """Return places (n, 2) and headings (n,) by the odometry alone, from nought."""
    steps = np.diff(odometry.time, prepend=odometry.time[0])
    turned = odometry.rate * steps
    heading = np.cumsum(turned)
    middle = heading - turned / 2
    way = odometry.speed * steps
    return np.cumsum(np.column_stack([way * np.cos(middle), way * np.sin(middle)]), axis=0), heading


def _yaw(motion: ReferenceMotion, time: Array) -> Array:
    forward = motion.attitude(time)[:, :, 0]
    return np.unwrap(np.arctan2(forward[:, 1], forward[:, 0]))


def _speed(
    motion: ReferenceMotion, odometry: Odometry, middle: Array, moved: Array, whole: Mask
) -> Finding:
    """Fit the speed by the wheels as a multiple of that by the reference."""
    steps = np.diff(odometry.time, prepend=odometry.time[0])
    way = np.cumsum(odometry.speed * steps)
    ends = np.append(middle - _WINDOW / 2, middle[-1] + _WINDOW / 2)
    own = np.diff(np.interp(ends, odometry.time, way)) / _WINDOW
    if motion.has_attitude:
        forward = motion.attitude(middle)[:, :, 0]
        told = np.sum(moved * forward, axis=1)
        return _judged("odometry's speed", told[whole], own[whole], middle[whole], _SPEEDS)
    told = np.linalg.norm(moved, axis=1)
    found = _judged("odometry's speed", told[whole], np.abs(own)[whole], middle[whole], _SPEEDS)
    if found.fits:
        says = f"{found.says}; without an attitude its sign cannot be told"
        return replace(found, says=says)
    return found


def _course_rate(
    moved: Array, own: Array, middle: Array, whole: Mask, turned: Array | None = None
) -> Finding:
    """Compare how the course changes from window to window, along both tracks alike.

    Or compare the course of the reference with how far the odometry says that the body turned
    between the windows' middles; chords round off corners, so that a size is told less well.
    """
    speeds = np.minimum(np.linalg.norm(moved, axis=1), np.linalg.norm(own, axis=1))
    fast = whole & (speeds > _MOVES * np.quantile(speeds, 0.9))
    both = fast[1:] & fast[:-1]
    course, other = (
        np.angle(np.exp(1j * np.diff(np.arctan2(v[:, 1], v[:, 0])))) for v in (moved, own)
    )
    both &= np.abs(course) < _MOST
    if turned is None:
        both &= np.abs(other) < _MOST
    else:
        other = turned
    let = _LET if turned is None else _CHORD
    who = "odometry's heading rate"
    return _judged(who, course[both], other[both], middle[1:][both], _RATES, let)


def _judged(
    subject: str,
    told: Array,
    own: Array,
    time: Array,
    units: dict[str, float],
    let: float = _LET,
) -> Finding:
    line = fit_linear(told[:, None], own, time, _BLOCK) if len(told) else None
    little = "too little moves to tell"
    if line is None or not np.isfinite(line.deviations[0]):
        return Finding("odometry", subject, np.nan, np.nan, np.nan, None, little)
    value, deviation = float(line.values[0]), float(line.deviations[0])
    half = let + float(t.isf(FALSE_ALARM / 2, line.blocks - 1)) * deviation
    fits = bool(abs(value - 1) <= half)
    if fits and half > _TOLD:
        return Finding("odometry", subject, value, 1 - half, 1 + half, None, little)
    if fits:
        says = f"it is {value:.3g} times what the reference tells (± {deviation:.2g})"
        return Finding("odometry", subject, value, 1 - half, 1 + half, True, says)
    found = units_of(abs(value), abs(value), units)
    says = f"it is {value:.3g} times what the reference tells (± {deviation:.2g})"
    says += ": its sign is another" if value < 0 else ""
    says += f": it may be {found[0]}" if found else ""
    return Finding("odometry", subject, value, 1 - half, 1 + half, False, says)
