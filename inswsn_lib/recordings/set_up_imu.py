"""Whether an IMU has the units, the axes, the clock and the mounting that a recording says."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from scipy.spatial.transform import Rotation
from scipy.stats import t

from inswsn_lib.calibration.blocks import FEWEST, block_starts
from inswsn_lib.calibration.imu_clock import ImuClock, imu_clock, up_of
from inswsn_lib.calibration.turn_rates import Felt, Told, Turned, told_by
from inswsn_lib.checks import Array
from inswsn_lib.errors import InswsnError
from inswsn_lib.recordings.findings import FALSE_ALARM, Finding
from inswsn_lib.recordings.signed_axes import judge_axes, signed_permutations, unit_of
from inswsn_lib.streams import Imu, Recording

GRAVITY = 9.80665  # m/s^2

_BLOCK = 5.0  # s
_FORCES = {"g": 1 / GRAVITY, "mg": 1000 / GRAVITY, "cm/s^2": 100.0, "ft/s^2": 3.2808}
_RATES = {"deg/s": 57.29578, "mdeg/s": 57295.78, "mrad/s": 1000.0, "turns/s": 0.159155}
_SIZE = (0.8, 1.25)  # of a unit that is right
_COURSE_SIZE = (0.5, 2.0)  # likewise, where sideslip and noise of velocities have a part
_SLOWEST = 1.0  # m/s, of a course
_FASTEST = 40.0  # rad/s, beyond the range of usual gyros of 2000 deg/s
_WINDOW = 0.5  # s
_TILT, _MOUNTED, _LATE = 5.0, 5.0, 0.02  # degrees, degrees, s: what is let pass
_REACH, _STEP = 1.0, 0.05  # s, of clocks that are tried
_NOTHING = 1e-9  # (rad/s)^2, below which nothing turns
_CAP = 5.0  # times the median: what is larger counts as much


def check_imu(recording: Recording) -> Iterator[Finding]:
    """Yield what can be found of the IMU of a recording."""
    imu = recording.imu
    if imu is None or len(imu) < 2:
        return
    force = _force_unit(imu)
    yield force
    try:
        told = told_by(recording, _WINDOW, _SLOWEST)
    except InswsnError as error:
        fast = float(np.quantile(np.linalg.norm(imu.rate, axis=1), 0.999))
        wrong = fast > _FASTEST
        says = "faster than a gyro can tell: in deg/s" if wrong else str(error).rstrip(".")
        yield Finding("unit", "IMU's rates", fast, 0, _FASTEST, False if wrong else None, says)
        yield Finding("axes", "IMU", np.nan, np.nan, np.nan, None, "nothing tells how it turns")
        return
    felt = Felt(imu) if told.by == "attitude" else Felt(imu).about(up_of(imu))
    turned = Turned(felt, told, _REACH)
    if len(block_starts(turned.time, _BLOCK) if len(turned.time) else []) < FEWEST:
        says = "it is there for too short a time"
        yield Finding("axes", f"IMU and {told.by}", np.nan, np.nan, np.nan, None, says)
        return
    unit, axes = _rates(turned, told.by)
    yield from (unit, axes)
    if told.by == "attitude":
        yield from _gravity(imu, told, force.fits is True)
    else:
        says = "without an attitude its axes and its mounting cannot be told"
        yield Finding("mounting", "IMU", np.nan, np.nan, np.nan, None, says)
    if unit.fits is not False and axes.fits is not False:
        yield from _clock(recording)


def _force_unit(imu: Imu) -> Finding:
    """Compare the median size of the specific force with gravity; no chance makes it so wrong."""
    size = float(np.median(np.linalg.norm(imu.force, axis=1)))
    low, high = _SIZE[0] * GRAVITY, _SIZE[1] * GRAVITY
    fits = low <= size <= high
    units = ", ".join(unit_of(size / GRAVITY, _FORCES))
    says = "at rest it is gravity's opposite" if fits else (
        f"it is {size:.3g}, and gravity 9.81 m/s^2" + (f": it may be in {units}" if units else "")
    )  # fmt: skip
    if size < 0.1 * GRAVITY and not units:
        says += ": gravity was taken off"
    return Finding("unit", "IMU's specific force", size, low, high, fits, says)


def _capped(values: Array) -> Array:
    """Return vectors, those that are very long shortened: attitudes jump."""
    size = np.linalg.norm(values, axis=1, keepdims=True)
    most = _CAP * float(np.median(size))
    return np.asarray(values * np.minimum(1.0, most / np.maximum(size, 1e-300)))


def _rates(turned: Turned, by: str) -> tuple[Finding, Finding]:
    """Return what unit and what axes the gyro has, whatever its clock."""
    matrices = signed_permutations(turned.width)
    told = _capped(turned.rate - np.median(turned.rate, axis=0))
    size = float(np.mean(np.sum(told**2, axis=1)))
    best, ratio, misfits = 0.0, 0.0, np.zeros((len(told), len(matrices)))
    for clock in np.arange(-_REACH + _STEP, _REACH, _STEP):
        felt = turned.felt_rate(float(clock))
        felt = _capped(felt - np.median(felt, axis=0))
        likeness = max(float(np.mean(np.sum(felt * (told @ P.T), axis=1))) for P in matrices)
        if likeness > max(best, _NOTHING):
            best, ratio = likeness, likeness / max(size, 1e-300)
            unit = felt / max(ratio, 1e-300)
            misfits = np.column_stack([np.linalg.norm(unit - told @ P.T, axis=1) for P in matrices])
    if best < _NOTHING:
        says = "nothing turns, so that the data cannot tell"
        unknown = np.nan, np.nan, np.nan, None, says
        return Finding("unit", "IMU's rates", *unknown), Finding("axes", f"IMU and {by}", *unknown)
    starts = block_starts(turned.time, _BLOCK)
    axes = judge_axes(f"IMU and {by}", "the gyro's", misfits, starts, matrices)
    low, high = _SIZE if by == "attitude" else _COURSE_SIZE
    if axes.fits is None and ratio < high:  # it is noise that is compared
        says = "too little turns for the data to tell"
        return Finding("unit", "IMU's rates", ratio, low, high, None, says), axes
    fits = low <= ratio <= high
    units = ", ".join(unit_of(ratio, _RATES))
    says = f"the gyro turns as the {by} does" if fits else (
        f"the gyro turns {ratio:.3g} times as fast as the {by}"
        + (f": it may be in {units}" if units else "")
    )  # fmt: skip
    return Finding("unit", "IMU's rates", ratio, low, high, fits, says), axes


def _gravity(imu: Imu, told: Told, sized: bool) -> Iterator[Finding]:
    """Compare the specific force with gravity's opposite, by the attitude."""
    attitude = told.attitude
    assert attitude is not None
    inside = (told.time > imu.time[0] + _WINDOW) & (told.time < imu.time[-1] - _WINDOW)
    if not inside.any():
        return
    time, attitude = told.time[inside], attitude[inside]
    felt = Felt(Imu(imu.time, imu.force, imu.force))
    half = told.window / 2
    force = (felt.turned(time + half) - felt.turned(time - half)) / told.window
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
    matrices = signed_permutations(3)
    up = attitude.inv().apply([0.0, 0.0, GRAVITY])
    misfits = np.column_stack([np.linalg.norm(force - up @ P.T, axis=1) for P in matrices])
    starts = block_starts(time, _BLOCK)
    yield judge_axes("IMU's specific force and reference", "its", misfits, starts, matrices)


def _clock(recording: Recording) -> Iterator[Finding]:
    """Judge how late the IMU's stamps are, and how it is turned against the reference's body."""
    try:
        found = imu_clock(recording, block=_BLOCK)
    except InswsnError as error:
        who = "IMU and what it is compared with"
        yield Finding("time", who, np.nan, np.nan, np.nan, None, str(error).rstrip("."))
        return
    q = float(t.isf(FALSE_ALARM / 2, found.blocks - 1))
    bound = _LATE + q * found.deviation
    fits = bool(abs(found.offset) <= bound)
    late = "late" if found.offset > 0 else "early"
    says = f"its stamps are {abs(found.offset):.3g} s {late} (± {found.deviation:.2g} s)"
    yield Finding("time", f"IMU and {found.by}", found.offset, -bound, bound, fits, says)
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
