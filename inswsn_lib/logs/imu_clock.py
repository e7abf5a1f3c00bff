"""How late an IMU's stamps are on the clock of a reference or of fixes, and how it is mounted."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from scipy.spatial.transform import Rotation

from inswsn_lib.checks import Array, number
from inswsn_lib.errors import InswsnError
from inswsn_lib.logs.blocks import FEWEST, block_starts, block_sums, jackknife
from inswsn_lib.logs.likeness import BLOCK, Likeness
from inswsn_lib.logs.turn_rates import Felt, Told, told_by
from inswsn_lib.streams import Imu, Recording

_CLOCK, _TURN = 0.02, 0.05  # s, rad: the largest deviations that count as told
_REACH = 1.0  # s, of clocks that are tried
_STEP = 0.16  # s, of a derivative, in which noise is no matter
_ROUNDS, _FAR = 6, 3.0  # of weights, and median misfits at which one counts less
_EXPLAINED = 0.5  # of the variance of the gyro's rates, lest it is no gyro of this body
_CHANCE = 15.0  # over the number of rows: what no chance explains
_JUMP = 1.5  # times as fast as is felt: where a reference jumps
_FACTOR = 2.0  # of what is felt by what a course explains of it

_State = tuple[float, Array, Array]  # clock, rotation, bias of the gyro


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
