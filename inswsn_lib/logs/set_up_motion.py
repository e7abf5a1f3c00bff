"""Whether an IMU, odometry and velocities of fixes go with the motion that others tell."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from functools import partial

import numpy as np
from scipy.spatial.transform import Rotation
from scipy.stats import t

from inswsn_lib.checks import Array, Mask
from inswsn_lib.errors import InswsnError
from inswsn_lib.logs.blocks import interpolate
from inswsn_lib.logs.findings import FALSE_ALARM, Finding, judged, unknown
from inswsn_lib.logs.imu_clock import Felt, Told, imu_clock, told_by, windows
from inswsn_lib.logs.likeness import BLOCK, HOUR, Likeness, late, units_of
from inswsn_lib.logs.model import ReferenceMotion
from inswsn_lib.streams import Imu, Recording

GRAVITY = 9.80665  # m/s^2

_FORCES = {"in g": 1 / GRAVITY, "in mg": 1000 / GRAVITY, "in cm/s^2": 100.0, "in ft/s^2": 3.2808}
_RATES = {"in deg/s": 57.29578, "in mdeg/s": 57295.78, "in mrad/s": 1000.0, "in turns/s": 0.159155}
_SPEEDS = {"in km/h": 3.6, "in knots": 1.9438, "in cm/s": 100.0, "in mm/s": 1000.0}
_TRACKS = {"in deg/s": 57.29578, "by half the track": 2.0, "by twice the track": 0.5}
_SIZE, _COURSE_SIZE = (0.8, 1.25), (0.5, 2.0)  # of a unit; sideslip has a part in a course
_LET, _COURSE_LET = (0.9, 1.1), (0.7, 1.3)  # of odometry: wheels wear, and a body slips
_FASTEST = 40.0  # rad/s, beyond the range of usual gyros of 2000 deg/s
_WINDOW, _MOST = 0.5, 3000  # s, and how many windows are looked at
_WAY, _SLOWEST = 1.0, 0.1  # s, of which ways are compared, and m/s, of a course beside odometry
_LEVEL = 45.0  # degrees, by which what goes on a plane is tilted at most
_TILT, _MOUNTED, _LATE = 5.0, 5.0, 0.02  # degrees, degrees, s: what is let pass
_AXLE = 1.0  # m, of an antenna from where the course is the heading: it tells early or late by it
_LIMIT, _TOLD = 0.5, 1.0  # s: of the deviation of a clock, and of its bound
_FEW, _MOVES, _APART = 5, 0.5, 0.5  # blocks, m/s, and share of the speed that is let pass


def check_imu(recording: Recording) -> Iterator[Finding]:
    """Yield whether an IMU has the units, the axes, the clock and the mounting that is said."""
    imu = recording.imu
    if imu is None or len(imu) < 2:
        return
    force = _force_unit(imu)
    yield force
    try:
        told = told_by(recording, _WINDOW)
    except InswsnError as error:
        fast = float(np.quantile(np.linalg.norm(imu.rate, axis=1), 0.999))
        right, wrong = str(error).rstrip("."), "faster than a gyro can tell: in deg/s"
        found = judged("unit", "IMU's rates", fast, 0, _FASTEST, right, wrong)
        yield replace(found, fits=None if found.fits else False)
        yield unknown("axes", "IMU", "nothing tells how it turns")
        return
    who, told = f"IMU and {told.by}", told.some(slice(None, None, -(-len(told.time) // _MOST)))
    alike = Likeness.of_any_zone(partial(told.pairs, told.felt_by(imu)), told.time)
    if alike is None:
        for name in ("unit", "axes", "time"):
            yield unknown(name, who, "it is there for too short a time, or nothing turns")
        return
    slope, let = alike.slope(), _SIZE if told.by == "attitude" else _COURSE_SIZE
    says, right = f"the gyro turns {slope} times as fast", f"the gyro turns as the {told.by} does"
    units = _RATES | _increments(imu)
    unit = slope.judged("unit", "IMU's rates", let, units, f"{says} as the {told.by}", right)
    axes = alike.axes(who, "the gyro's")
    doubtful = told.by == "course" and unit.fits is None
    if doubtful:
        says = "too little turns, or the course is not the heading"
        axes = unknown("axes", who, says)
        yield unknown("time", who, says)
    yield from (unit, axes)
    if told.by == "attitude":
        right_imu = replace(imu, time=imu.time - alike.clock)
        yield from _gravity(right_imu, told, sized=force.fits is True)
    else:
        says = "without an attitude its axes and its mounting cannot be told"
        yield unknown("mounting", "IMU", says)
    if not doubtful and unit.fits is not False and axes.fits is not False:
        yield from _clock(recording, imu, alike.clock, told.speed)


def _force_unit(imu: Imu) -> Finding:
    """Compare the median size of the specific force with gravity; no chance makes it so wrong."""
    size = float(np.median(np.linalg.norm(imu.force, axis=1)))
    low, high = _SIZE[0] * GRAVITY, _SIZE[1] * GRAVITY
    found = units_of(size / GRAVITY, size / GRAVITY, _FORCES | _increments(imu))
    says = f"it is {size:.3g}, and gravity 9.81 m/s^2"
    if found:
        says += f": it may be {' or '.join(found)}"
    elif size < 0.1 * GRAVITY:
        says += ": gravity was taken off"
    right = "at rest it is gravity's opposite"
    return judged("unit", "IMU's specific force", size, low, high, right, says)


def _increments(imu: Imu) -> dict[str, float]:
    """Return the units of what was summed up over each period."""
    period = float(np.median(np.diff(imu.time)))
    words = f"one period ({period:.3g} s) times what it should be: increments"
    return {words: period, "in deg of each period: increments": period * 57.29578}


def _gravity(imu: Imu, told: Told, *, sized: bool) -> Iterator[Finding]:
    """Compare the specific force with gravity's opposite, by the attitude."""
    felt = Felt(imu.time, imu.force)
    told = told.some(told.covered(felt, 0.0))
    if told.attitude is None or not len(told.time):
        return
    force = felt.mean(told.time, told.window)
    x, y, z = told.attitude.apply(force).mean(axis=0)
    tilt = float(np.degrees(np.arctan2(np.hypot(x, y), z)))
    down = "down: z is down, or its sign is another" if tilt > 150 else f"{tilt:.0f} deg off up"
    says = "by the attitude the specific force points"
    right = "on average the specific force points up"
    # a body that moves for long has gravity alone on average, so that chance has no part in it
    yield judged("gravity", "IMU and reference", tilt, 0, _TILT, right, f"{says} {down}")
    up = told.attitude.inv().apply([0.0, 0.0, GRAVITY])
    every: Mask = np.ones(len(up), dtype=bool)
    alike = Likeness(lambda _: (force, up, every), told.time, 0.0, centred=False)
    if sized and not alike.empty:
        yield alike.axes("IMU's specific force and reference", "its")


def _clock(recording: Recording, imu: Imu, clock: float, speed: float) -> Iterator[Finding]:
    """Judge how late the IMU's stamps are, and how it is turned against the reference's body."""
    near = replace(recording, imu=replace(imu, time=imu.time - clock))
    by_fixes = recording.reference is None
    stamps, sign = ("stamps of fixes, by the IMU's,", -1) if by_fixes else ("its stamps", 1)
    let = _LATE if np.isnan(speed) else _LATE + _AXLE / speed
    try:
        found = imu_clock(near, limit=_LIMIT)
    except InswsnError as error:
        who = "IMU and what it is compared with"
        if abs(clock) > HOUR / 2:  # which is tried where nothing is shared without
            yield late(who, stamps, sign * clock, _LIMIT, 2.0, let)
        else:
            yield unknown("time", who, str(error).rstrip("."))
        return
    q, value = float(t.isf(FALSE_ALARM / 2, found.blocks - 1)), sign * (clock + found.offset)
    told = late(f"IMU and {found.by}", stamps, value, found.deviation, q, let)
    if told.fits and told.high > _TOLD:
        told = replace(told, fits=None, says="too little turns to tell")
    yield told
    if found.rotation is None:
        return
    angle = float(np.degrees(Rotation.from_matrix(found.rotation).magnitude()))
    worst = float(np.degrees(found.rotation_deviation.max()))
    bound = _MOUNTED + float(t.isf(FALSE_ALARM / 6, found.blocks - 1)) * worst * np.sqrt(3)
    says = f"its axes are turned by {angle:.2g} deg against the body's (± {worst:.2g} deg)"
    yield judged("mounting", "IMU and reference", angle, 0, float(bound), says, says)


def check_odometry(recording: Recording) -> Iterator[Finding]:
    """Yield whether odometry has the signs, sizes and clock of what a reference tells."""
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
        told = told_by(recording.without("fixes"), _WAY, _SLOWEST)
        told = told.vertical() if told.by == "attitude" else told
        moved = _moved(ReferenceMotion(reference, 2), told.time)
    except InswsnError as error:
        yield unknown("odometry", "odometry", str(error).rstrip("."))
        return
    signed = moved.by == "forward"
    speed = odometry.speed if signed else np.abs(odometry.speed)
    way = partial(moved.pairs, Felt(odometry.time, speed[:, None]))
    for found in _judged(
        "odometry's speed", Likeness(way, moved.time, centred=False), _SPEEDS, _LET
    ):
        signless = found.fits and not signed
        more = "; without an attitude its sign cannot be told" if signless else ""
        yield replace(found, says=found.says + more)
    turn = partial(told.pairs, Felt(odometry.time, odometry.rate[:, None], told.chord))
    let = _LET if told.by == "heading" else _COURSE_LET
    yield from _judged("odometry's heading rate", Likeness(turn, told.time), _TRACKS, let)


def _moved(motion: ReferenceMotion, time: Array) -> Told:
    """Return speeds over windows, forward where the reference tells what that is."""
    time = time[motion.covers(time - _WAY / 2) & motion.covers(time + _WAY / 2)]
    moved = (motion.position(time + _WAY / 2) - motion.position(time - _WAY / 2)) / _WAY
    if motion.has_attitude:
        forward = np.sum(moved * motion.attitude(time)[:, :, 0], axis=1)
        return Told("forward", time, forward[:, None], _WAY)
    return Told("way", time, np.linalg.norm(moved, axis=1)[:, None], _WAY)


def _judged(
    subject: str, alike: Likeness, units: dict[str, float], let: tuple[float, float]
) -> Iterator[Finding]:
    if alike.empty:
        yield unknown("odometry", subject, "too little moves to tell")
        return
    slope = alike.slope()
    says = f"it is {slope} times what the reference tells"
    found = slope.judged("odometry", subject, let, units, says)
    if found.fits is not None and alike.axes(subject, "its").fits is False:
        says = f"{found.says}, and its sign is another"
        found = replace(found, value=-found.value, fits=False, says=says)
    yield found
    if clock := alike.late:
        yield late(f"{subject} and reference", "stamps of odometry", clock, 0.1, 2.0, 0.02)


def check_velocities(recording: Recording) -> Iterator[Finding]:
    """Yield whether fixes move as their velocities say, over blocks of 5 s."""
    fixes = recording.fixes
    if fixes is None or fixes.velocity is None:
        return
    state = np.hstack([fixes.position[:, :2], fixes.velocity[:, :2]])
    there = np.isfinite(state).all(axis=1) & (True if fixes.good is None else fixes.good)
    time, state = fixes.time[there], state[there]
    speed, apart = np.zeros(0), np.zeros(0)
    if len(time) > 1:
        middle, whole = windows(time, BLOCK)
        early, after = (
            interpolate(time, state[:, :2], middle[whole] + h * BLOCK) for h in (-0.5, 0.5)
        )
        told = Felt(time, state[:, 2:]).mean(middle[whole], BLOCK)
        speed = np.linalg.norm(told, axis=1)
        apart = np.linalg.norm((after - early) / BLOCK - told, axis=1)
    fast = speed > _MOVES
    if fast.sum() < _FEW:
        yield unknown("itself", "fixes", "it moves too little to tell")
        return
    value = float(np.median(apart[fast] / speed[fast]))
    says = (
        f"by {value:.2g} of the speed positions do not move as velocities say: another unit, or "
        "axes exchanged or reversed, of one of them"
    )
    yield judged("itself", "fixes", value, 0, _APART, "positions move as velocities say", says)
