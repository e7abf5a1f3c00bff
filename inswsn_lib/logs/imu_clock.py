"""How late an IMU's stamps are on the clock of a reference or of fixes, and how it is mounted."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from scipy.integrate import cumulative_trapezoid
from scipy.spatial.transform import Rotation, Slerp

from inswsn_lib.checks import Array, Mask, number
from inswsn_lib.errors import InswsnError
from inswsn_lib.logs.blocks import FEWEST, block_starts, block_sums, interpolate, jackknife, spaced
from inswsn_lib.logs.likeness import BLOCK, Likeness
from inswsn_lib.streams import Imu, Recording, Reference, Whole

_CLOCK, _TURN = 0.02, 0.05  # s, rad: the largest deviations that count as told
_REACH = 1.0  # s, of clocks that are tried
_STEP = 0.16  # s, of a derivative, in which noise is no matter
_ROUNDS, _FAR = 6, 3.0  # of weights, and median misfits at which one counts less
_EXPLAINED = 0.5  # of the variance of the gyro's rates, lest it is no gyro of this body
_CHANCE = 15.0  # over the number of rows: what no chance explains
_JUMP = 1.5  # times as fast as is felt: where a reference jumps
_FACTOR = 2.0  # of what is felt by what a course explains of it
_State = tuple[float, Array, Array]  # clock, rotation, bias of the gyro
_WINDOW, _COURSE_WINDOW, _LONGEST = 0.2, 0.5, 4.0  # s
_ANGLE = 0.15  # rad, of errors of a course by positions, above which its chords are longer
_CLEAR = 3.0  # deviations of a chord by its errors, that it is longer than
_PERIODS = 3  # that a window has at least
_GAP = 0.25  # s, or three periods: across a longer one nothing is told


class Felt:
    """The integral of rates (n, axes); over a chord, of their means over it."""

    def __init__(self, time: Array, rate: Array, chord: float = 0.0) -> None:
        if chord:
            rate = Felt(time, rate).mean(time, chord)
        self.time, self._sum = time, cumulative_trapezoid(rate, time, axis=0, initial=0)
        self.gaps = gaps_before(time)

    def mean(self, time: Array, window: float) -> Array:
        """Return the mean rates over windows around some times, (n, axes)."""
        early, late = (interpolate(self.time, self._sum, time + h * window) for h in (-0.5, 0.5))
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
    ends = np.array([interpolate(time, velocity, middle + side) for side in (-h / 2, h / 2)])
    return _course(middle, ends, kept & (_slower(ends) >= slowest), h, slowest)


def _by_positions(time: Array, place: Array, window: float, slowest: float) -> Told:
    """Return the rates of the course of chords, so long that their errors are no matter."""
    if len(time) < 5:
        raise InswsnError("There are too few positions to tell a course by.")
    usual = 1.4826 * np.median(np.abs(np.diff(place, 2, axis=0))) / np.sqrt(6)
    h, error = _longer(max(window, _COURSE_WINDOW), time), np.sqrt(2) * usual
    while True:
        middle, kept = windows(time, 2 * h, h)
        places = [interpolate(time, place, middle + side * h) for side in (-1, 0, 1)]
        ends = np.diff(places, axis=0) / h
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


@dataclass(frozen=True, eq=False)
class ImuClock:
    """What `imu_clock` found.

    Attributes
    ----------
    by : str
        ``"attitude"``, ``"heading"`` (the attitude turns about the vertical alone) or ``"course"``.
    offset, deviation : float
        How late the IMU's stamps are, s.
    rotation : ndarray, (3, 3), or None
        Takes vectors along the reference's body axes into those of the IMU; None where heading or
        course are compared, which cannot tell it.
    rotation_deviation : ndarray, (3,)
        Of the small rotation about each of the IMU's axes that is left, rad; NaN likewise.
    gyro_bias : ndarray, (3,) or (1,)
        rad/s, along the axes of the IMU, or about the vertical.
    blocks : int
        Of 5 s; of those that tell, as many as would if each told as much.

    Examples
    --------
    >>> import numpy as np
    >>> from inswsn_lib.logs import ImuClock
    >>> from inswsn_lib.streams import Imu, Recording
    >>> found = ImuClock("course", 0.02, 0.001, None, np.full(3, np.nan), np.zeros(1), 9)
    >>> imu = Imu(np.arange(3.0), np.zeros((3, 3)), np.zeros((3, 3)))
    >>> print(found.apply(Recording("made", imu=imu)).imu.time)
    [-0.02  0.98  1.98]
    """

    by: str
    offset: float
    deviation: float
    rotation: Array | None
    rotation_deviation: Array
    gyro_bias: Array
    blocks: int

    def apply(self, recording: Recording) -> Recording:
        """Return a recording whose IMU has the clock, and if told the axes, of the reference.

        Its rates keep their bias.
        """
        imu = recording.imu
        if imu is None:
            raise InswsnError(f"The recording {recording.name} has no IMU to correct.")
        M = np.eye(3) if self.rotation is None else self.rotation
        right = Imu(time=imu.time - self.offset, rate=imu.rate @ M, force=imu.force @ M)
        return replace(recording, imu=right)


def imu_clock(recording: Recording, *, limit: float = _CLOCK) -> ImuClock:
    r"""Return how late the IMU's stamps are, from turns that it and another sensor measure.

    With the mean rate :math:`\bar\omega(t)` of the gyro over a window of 0.2 s or longer and that
    of the reference's attitude, in axes of the body,

    .. math:: \bar\omega(t + \tau) = M\, \log(A(t - h/2)^{-1} A(t + h/2)) / h + b + e

    is fitted by least squares with weights that fall with the misfit, from the offset :math:`\tau`,
    of all up to 1 s, and the rotation M with which the rates are most alike (in closed form:
    Umeyama 1991; the likeness of rates is a usual measure of an IMU's delay, as in Furgale, Rehder
    and Siegwart 2013). Deviations are those of a jackknife over blocks of time. Where the
    body turns about the vertical alone, or there is no attitude, the gyro about the vertical (the
    mean of the specific force) is compared with the rate of the heading, or of the course of fixes
    that have a velocity, or of chords of positions of the reference or else of fixes, which are
    made longer, up to 4 s, until errors turn them little. The course turns as the body does only
    without sideslip; below 1 m/s it tells nothing.

    Parameters
    ----------
    recording : Recording
        With an IMU, and a reference or fixes.
    limit : float
        The largest deviation of the offset that counts as told, s.

    Raises
    ------
    InswsnError
        If the offset's deviation is above the limit, as with too little rotation, or if most of
        what the gyro feels is not what the others see: other axes, another run, a mirrored frame.

    Examples
    --------
    A body that turns to and fro about all axes; stamps of its IMU are 20 ms late.

    >>> import numpy as np
    >>> from scipy.spatial.transform import Rotation
    >>> from inswsn_lib.logs import imu_clock
    >>> from inswsn_lib.streams import Imu, Recording, Reference
    >>> time = np.arange(0, 60, 0.01)
    >>> angles = np.column_stack([np.sin(1.1 * time), np.sin(1.7 * time), np.sin(0.7 * time)])
    >>> attitude = Rotation.from_rotvec(0.3 * angles)
    >>> rate = (attitude[:-1].inv() * attitude[1:]).as_rotvec() / 0.01
    >>> rate += np.random.default_rng(0).normal(0, 0.01, rate.shape)
    >>> imu = Imu(time[:-1] + 0.005 + 0.02, rate, np.tile([0.0, 0.0, 9.81], (len(rate), 1)))
    >>> reference = Reference(time, np.zeros((len(time), 3)), attitude.as_quat())
    >>> found = imu_clock(Recording("made", imu=imu, reference=reference))
    >>> print(found.by, f"{found.offset:.3f} s")
    attitude 0.020 s
    """
    number("limit", limit, above=0)
    if recording.imu is None or len(recording.imu) < 2:
        raise InswsnError(f"The recording {recording.name} has no IMU.")
    told = told_by(recording)
    found = _fitted(recording.imu, told, limit) or _fitted(recording.imu, told.vertical(), limit)
    assert found is not None  # a rate about the vertical has no rotation to be lost
    return found


def _moved(state: _State, by: Array) -> _State:
    """Return a clock, a rotation and a bias after a step."""
    clock, turn, bias = state
    if len(bias) == 3:
        turn = Rotation.from_rotvec(by[1:4]).as_matrix() @ turn
    return clock + float(by[0]), turn, bias + by[-len(bias) :]


def _linear(felt: Felt, told: Told, state: _State) -> tuple[Array, Array, Array]:
    """Return what is told, what is felt beside it, (n, d), and its slopes by a step, (n, d, p)."""
    clock, turn, bias = state
    at, eye, rate = told.time + clock, np.eye(len(bias)), told.rate @ turn.T
    early, seen, late = (felt.mean(at + k * _STEP, told.window) for k in (-0.5, 0.0, 0.5))
    columns = [(late - early)[:, :, None] / _STEP]
    if len(bias) == 3:
        columns.append(np.cross(rate[:, None], eye).transpose(0, 2, 1))
    columns.append(np.broadcast_to(-eye, (len(at), *eye.shape)))
    return rate, np.asarray(seen - rate - bias), np.concatenate(columns, axis=2)


def _fitted(imu: Imu, told: Told, limit: float) -> ImuClock | None:
    """Return the offset and the rest; None if it is told, but not the rotation."""
    felt, d = told.felt_by(imu), told.rate.shape[1]
    told = told.some(told.covered(felt, 0.0, _REACH + _STEP))
    if not len(told.time):
        raise InswsnError("The IMU and what it is compared with share too little time.")
    fastest = float(np.abs(felt.mean(told.time, told.window)).max())
    told = told.some(np.linalg.norm(told.rate, axis=1) <= _JUMP * fastest)  # the others are jumps
    starts = block_starts(told.time, BLOCK) if len(told.time) else np.arange(0)
    if len(starts) < FEWEST:
        raise InswsnError(f"The IMU is compared in {len(starts)} blocks; {FEWEST} are needed.")
    alike = Likeness(partial(told.pairs, felt), told.time, _REACH)
    state: _State = (*((0.0, np.eye(d)) if alike.empty else alike.turned), np.zeros(d))
    for _ in range(_ROUNDS):
        rate, off, slopes = _linear(felt, told, state)
        miss = np.linalg.norm(off, axis=1)
        w = 1 / (1 + (miss / max(_FAR * float(np.median(miss)), 1e-9)) ** 2)
        rows, each = slopes.reshape(off.size, -1), np.repeat(w, d)
        parts = block_sums(rows, each * off.ravel(), each, d * starts)
        state = _moved(state, -np.linalg.lstsq(parts[0].sum(axis=0), parts[1].sum(axis=0))[0])
    clock, turn, bias = state
    alike.weight = w
    share, factor = (0.0, np.inf) if alike.empty else alike.explained(clock, turn)
    # errors of a course by far positions are larger than what is felt, which then is all in it
    course = told.by == "course"
    least = min(_EXPLAINED, _CHANCE / len(told.time)) if course else _EXPLAINED
    if share < least or (course and factor > _FACTOR):
        raise InswsnError(
            f"The IMU's clock cannot be told: by the {told.by} {share:.0%} of the variance of its "
            "rates is explained: it turns too little, has other axes, or is of another run."
        )
    if d == 3:  # what is told has errors, too: the rotation's whole second derivative
        bend = np.add.reduceat(w[:, None, None] * off[:, :, None] * rate[:, None], starts)
        trace = np.trace(bend, axis1=1, axis2=2)[:, None, None]
        parts[0][:, 1:4, 1:4] += trace * np.eye(3) - (bend + bend.transpose(0, 2, 1)) / 2
    found, lost = jackknife(*parts)
    deviations = np.where(lost, np.inf, np.sqrt(np.diag(found)))
    rotated = deviations[1:4] if d == 3 else np.full(3, np.nan)
    if (rotated > _TURN).any():
        return None
    if not deviations[0] <= limit:
        size = float(np.sqrt(np.sum(np.var(told.rate, axis=0))))
        raise InswsnError(
            f"The recording cannot tell the IMU's clock: the deviation would be {deviations[0]:.2g}"
            f" s, above {limit:g}; it turns at {size:.2g} rad/s."
        )
    both = np.sum((off + rate) * rate, axis=1)
    shares = np.maximum(np.add.reduceat(w * both, starts), 0.0)
    telling = max(2, round(float(shares.sum() ** 2 / max(np.sum(shares**2), 1e-300))))  # Kish 1965
    rotation = turn if d == 3 else None
    return ImuClock(told.by, clock, float(deviations[0]), rotation, rotated, bias, telling)
