"""Whether odometry has the signs, the units, the size and the clock of what a reference tells."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
from scipy.spatial.transform import Rotation

from inswsn_lib.checks import Array
from inswsn_lib.errors import InswsnError
from inswsn_lib.logs.findings import Finding, unknown
from inswsn_lib.logs.likeness import Likeness, compared_windows, late, units_of
from inswsn_lib.logs.reference_motion import ReferenceMotion
from inswsn_lib.logs.turn_rates import Felt, told_by, vertical_part
from inswsn_lib.streams import Odometry, Recording

_WINDOW, _SLOWEST = 1.0, 0.1  # s, of which means are compared, and m/s, of a course
_LET, _COURSE_LET = 0.1, 0.3  # of a size that is right: wheels wear, and a body slips
_LEVEL = 45.0  # degrees, by which what goes on a plane is tilted at most
_TOLD = 2.0  # between which factors a size is told
_SPEEDS = {"in km/h": 3.6, "in knots": 1.9438, "in cm/s": 100.0, "in mm/s": 1000.0}
_RATES = {"in deg/s": 57.29578, "by half the track": 2.0, "by twice the track": 0.5}


def check_odometry(recording: Recording) -> Iterator[Finding]:
    """Yield whether speed and heading rate go with the reference."""
    odometry, reference = recording.odometry, recording.reference
    if odometry is None or len(odometry) < 2:
        return
    if reference is None or len(reference) < 3:
        yield unknown("odometry", "odometry", "without a reference its sizes cannot be told")
        return
    if reference.attitude is not None:
        up = Rotation.from_quat(reference.attitude).apply([0.0, 0.0, 1.0])[:, 2]
        tilt = float(np.degrees(np.arccos(np.clip(np.median(up), -1, 1))))
        if tilt > _LEVEL:
            says = f"its attitudes are tilted by {tilt:.3g} degrees: quaternions may have w first"
            yield Finding("axes", "reference", tilt, 0, _LEVEL, False, says)
            return
    try:
        told = told_by(recording.without("fixes"), _WINDOW, _SLOWEST)
        told = vertical_part(told) if told.by == "attitude" else told
        turned = Felt(odometry.time, odometry.rate[:, None]).like(told)
        let = _LET if told.by == "heading" else _COURSE_LET
        rate = Likeness(compared_windows(turned, told.time, told.rate, told.window), told.time)
        speed = _speed(ReferenceMotion(reference, 2), odometry, told.time)
    except InswsnError as error:
        yield unknown("odometry", "odometry", str(error).rstrip("."))
        return
    for found in _judged("odometry's speed", speed, _SPEEDS, _LET):
        signless = found.fits and reference.attitude is None
        more = "; without an attitude its sign cannot be told" if signless else ""
        yield replace(found, says=found.says + more)
    yield from _judged("odometry's heading rate", rate, _RATES, let)


def _speed(motion: ReferenceMotion, odometry: Odometry, time: Array) -> Likeness:
    """Compare the ways by both, forward where the reference tells what that is."""
    ends = np.array([time - _WINDOW / 2, time + _WINDOW / 2])
    whole = motion.covers(ends[0]) & motion.covers(ends[1])
    ends, time = ends[:, whole], time[whole]
    moved = (motion.position(ends[1]) - motion.position(ends[0])) / _WINDOW
    speed = odometry.speed
    told = np.linalg.norm(moved, axis=1)
    if motion.has_attitude:
        told = np.sum(moved * motion.attitude(time)[:, :, 0], axis=1)
    else:
        speed = np.abs(speed)
    way = Felt(odometry.time, speed[:, None])
    return Likeness(compared_windows(way, time, told[:, None], _WINDOW), time, centred=False)


def _judged(
    subject: str, alike: Likeness, units: dict[str, float], let: float
) -> Iterator[Finding]:
    little = "too little moves to tell"
    if alike.empty:
        yield unknown("odometry", subject, little)
        return
    slope, axes = alike.slope(), alike.axes(subject, "its")
    value = float(np.clip(1.0, slope.low, slope.high))
    says = f"it is {slope} times what the reference tells"
    found = units_of(slope.low, slope.high, units, 0.1)
    if not slope.tells or (not slope.outside(1 - let, 1 + let) and slope.high > _TOLD * slope.low):
        fits, says = None, little
    elif axes.fits is False:
        value, fits, says = -value, False, f"{says}, and its sign is another"
    else:
        fits = not slope.outside(1 - let, 1 + let)
    says += f": it may be {' or '.join(found)}" if fits is False and found else ""
    yield Finding("odometry", subject, value, 1 - let, 1 + let, fits, says)
    if clock := alike.late:
        yield late(f"{subject} and reference", "stamps of odometry", clock, 0.1, 2.0, 0.02)
