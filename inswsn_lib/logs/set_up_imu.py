"""Whether an IMU has the units, the axes, the clock and the mounting that a recording says."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
from scipy.spatial.transform import Rotation
from scipy.stats import t

from inswsn_lib.checks import Mask
from inswsn_lib.errors import InswsnError
from inswsn_lib.logs.findings import FALSE_ALARM, Finding, unknown
from inswsn_lib.logs.imu_clock import ImuClock, imu_clock
from inswsn_lib.logs.likeness import BLOCK, HOUR, Likeness, compared_windows, late, units_of
from inswsn_lib.logs.turn_rates import Felt, Told, told_by
from inswsn_lib.streams import Imu, Recording

GRAVITY = 9.80665  # m/s^2

_FORCES = {"in g": 1 / GRAVITY, "in mg": 1000 / GRAVITY, "in cm/s^2": 100.0, "in ft/s^2": 3.2808}
_RATES = {"in deg/s": 57.29578, "in mdeg/s": 57295.78, "in mrad/s": 1000.0, "in turns/s": 0.159155}
_SIZE = (0.8, 1.25)  # of a unit that is right
_COURSE_SIZE = (0.5, 2.0)  # likewise, where sideslip has a part
_SLOWEST = 1.0  # m/s, of a course
_FASTEST = 40.0  # rad/s, beyond the range of usual gyros of 2000 deg/s
_WINDOW, _MOST = 0.5, 3000  # s, and how many windows are looked at
_TILT, _MOUNTED, _LATE = 5.0, 5.0, 0.02  # degrees, degrees, s: what is let pass
_AXLE = 1.0  # m, of an antenna from where the course is the heading: it tells early or late by it
_NEAR, _LIMIT, _TOLD = 1.0, 0.5, 1.0  # s: reach and limit of the last fit, and what is told


def check_imu(recording: Recording) -> Iterator[Finding]:
    """Yield what can be found of the IMU of a recording."""
    imu = recording.imu
    if imu is None or len(imu) < 2:
        return
    force = _force_unit(imu)
    yield force
    try:
        told = told_by(recording, None, _SLOWEST)
        told = told_by(recording, max(_WINDOW, told.window), _SLOWEST)
    except InswsnError as error:
        fast = float(np.quantile(np.linalg.norm(imu.rate, axis=1), 0.999))
        wrong = fast > _FASTEST
        says = "faster than a gyro can tell: in deg/s" if wrong else str(error).rstrip(".")
        yield Finding("unit", "IMU's rates", fast, 0, _FASTEST, False if wrong else None, says)
        yield unknown("axes", "IMU", "nothing tells how it turns")
        return
    who = f"IMU and {told.by}"
    some = slice(None, None, -(-len(told.time) // _MOST))
    pairs = compared_windows(Felt.of(imu, told), told.time[some], told.rate[some], told.window)
    alike = Likeness.of_any_zone(pairs, told.time[some])
    if alike is None:
        for name in ("unit", "axes", "time"):
            yield unknown(name, who, "it is there for too short a time, or nothing turns")
        return
    unit, axes = _unit(alike, told.by, _period(imu)), alike.axes(who, "the gyro's")
    doubtful = told.by == "course" and unit.fits is None
    if doubtful:
        says = "too little turns, or the course is not the heading"
        axes = unknown("axes", who, says)
        yield unknown("time", who, says)
    yield from (unit, axes)
    if told.by == "attitude":
        right = replace(imu, time=imu.time - alike.clock)
        yield from _gravity(right, told, force.fits is True)
    else:
        says = "without an attitude its axes and its mounting cannot be told"
        yield unknown("mounting", "IMU", says)
    if not doubtful and unit.fits is not False and axes.fits is not False:
        yield from _clock(recording, imu, alike.clock, told.speed)


def _period(imu: Imu) -> float:
    return float(np.median(np.diff(imu.time)))


def _force_unit(imu: Imu) -> Finding:
    """Compare the median size of the specific force with gravity; no chance makes it so wrong."""
    size = float(np.median(np.linalg.norm(imu.force, axis=1)))
    low, high = _SIZE[0] * GRAVITY, _SIZE[1] * GRAVITY
    fits = low <= size <= high
    ratio, units = size / GRAVITY, _FORCES | _increments(_period(imu))
    found = " or ".join(units_of(ratio, ratio, units))
    says = "at rest it is gravity's opposite" if fits else (
        f"it is {size:.3g}, and gravity 9.81 m/s^2" + (f": it may be {found}" if found else "")
    )  # fmt: skip
    if size < 0.1 * GRAVITY and not found:
        says += ": gravity was taken off"
    return Finding("unit", "IMU's specific force", size, low, high, fits, says)


def _increments(period: float) -> dict[str, float]:
    """Return the units of what was summed up over each period."""
    words = f"one period ({period:.3g} s) times what it should be: increments"
    return {words: period, "in deg of each period: increments": period * 57.29578}


def _unit(alike: Likeness, by: str, period: float) -> Finding:
    """Return whether the gyro turns as fast as what tells, whatever its clock and axes."""
    low, high = _SIZE if by == "attitude" else _COURSE_SIZE
    slope, who = alike.slope(), "IMU's rates"
    value = float(np.clip(1.0, slope.low, slope.high))
    if not slope.tells:
        says = "too little turns for the data to tell"
        return Finding("unit", who, value, low, high, None, says)
    if not slope.outside(low, high):
        fits = slope.high < 4 * slope.low
        says = f"the gyro turns as the {by} does" if fits else (
            f"the gyro turns {slope} times as fast as the {by}, which has errors: it cannot be told"
        )  # fmt: skip
        return Finding("unit", who, value, low, high, True if fits else None, says)
    found = " or ".join(units_of(slope.low, slope.high, _RATES | _increments(period)))
    says = f"the gyro turns {slope} times as fast as the {by}"
    says += f": it may be {found}" if found else ""
    return Finding("unit", who, value, low, high, False, says)


def _gravity(imu: Imu, told: Told, sized: bool) -> Iterator[Finding]:
    """Compare the specific force with gravity's opposite, by the attitude."""
    attitude, half = told.attitude, told.window / 2
    assert attitude is not None
    inside = (told.time > imu.time[0] + half) & (told.time < imu.time[-1] - half)
    if not inside.any():
        return
    time, attitude = told.time[inside], attitude[inside]
    force = Felt(imu.time, imu.force).mean(time, told.window)
    mean = attitude.apply(force).mean(axis=0)
    tilt = float(np.degrees(np.arctan2(np.hypot(mean[0], mean[1]), mean[2])))
    fits = tilt <= _TILT
    says = "on average the specific force points up" if fits else (
        "by the attitude the specific force points "
        + ("down: z is down, or its sign is another" if tilt > 150 else f"{tilt:.0f} deg off up")
    )  # fmt: skip
    # a body that moves for long has gravity alone on average, so that chance has no part in it
    yield Finding("gravity", "IMU and reference", tilt, 0, _TILT, fits, says)
    if not sized:
        return
    up = attitude.inv().apply([0.0, 0.0, GRAVITY])
    rows: Mask = np.ones(len(time), dtype=bool)
    alike = Likeness(lambda _: (force, up, rows), time, 0.0, centred=False)
    if not alike.empty:
        yield alike.axes("IMU's specific force and reference", "its")


def _clock(recording: Recording, imu: Imu, clock: float, speed: float) -> Iterator[Finding]:
    """Judge how late the IMU's stamps are, and how it is turned against the reference's body."""
    near = replace(recording, imu=replace(imu, time=imu.time - clock))
    by_fixes = recording.reference is None
    stamps, sign = ("stamps of fixes, by the IMU's,", -1) if by_fixes else ("its stamps", 1)
    let = _LATE if np.isnan(speed) else _LATE + _AXLE / speed
    try:
        found = imu_clock(near, slowest=_SLOWEST, block=BLOCK, reach=_NEAR, limit=_LIMIT)
    except InswsnError as error:
        who = "IMU and what it is compared with"
        if abs(clock) > HOUR / 2:  # which is tried where nothing is shared without
            yield late(who, stamps, sign * clock, _LIMIT, 2.0, let)
        else:
            yield unknown("time", who, str(error).rstrip("."))
        return
    q, value = float(t.isf(FALSE_ALARM / 2, found.blocks - 1)), sign * (clock + found.offset)
    judged = late(f"IMU and {found.by}", stamps, value, found.deviation, q, let)
    if judged.fits and judged.high > _TOLD:
        judged = replace(judged, fits=None, says="too little turns to tell")
    yield judged
    yield from _mounting(found)


def _mounting(found: ImuClock) -> Iterator[Finding]:
    if found.rotation is None:
        return
    angle = float(np.degrees(Rotation.from_matrix(found.rotation).magnitude()))
    worst = float(np.degrees(found.rotation_deviation.max()))
    bound = _MOUNTED + float(t.isf(FALSE_ALARM / 6, found.blocks - 1)) * worst * np.sqrt(3)
    fits = bool(angle <= bound)
    says = f"its axes are turned by {angle:.2g} deg against the body's (± {worst:.2g} deg)"
    yield Finding("mounting", "IMU and reference", angle, 0, float(bound), fits, says)
