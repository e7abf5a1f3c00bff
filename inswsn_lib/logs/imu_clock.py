"""How late an IMU's stamps are on the clock of a reference or of fixes, and how it is mounted."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from inswsn_lib.checks import Array, number
from inswsn_lib.errors import InswsnError
from inswsn_lib.logs.blocks import FEWEST, deviation_of
from inswsn_lib.logs.turn_rates import Felt, Told, Turn, Turned, told_by, vertical_part
from inswsn_lib.streams import Imu, Recording

#: The largest deviations that count as told: s, rad
CLOCK_LIMIT, TURN_LIMIT = 0.02, 0.05

_STEP = 0.02  # s, of the clocks that are tried
_EXPLAINED = 0.5  # of the variance of the gyro's rates, lest it is no gyro of this body
_CHANCE = 15.0  # over the number of rows: what no chance explains
_ABOUT = 1e-4  # of what turns about an axis tell, that others do: below it is rounding
_FACTOR = 2.0  # of what is felt by what a course explains of it


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
    before, after : float
        Deviation of the difference of rates by its median absolute value, rad/s: as logged, and
        with these values.
    blocks : int
        As of `Calibration`; of those that tell, as many as would if each told as much.

    Examples
    --------
    >>> import numpy as np
    >>> from inswsn_lib.logs import ImuClock
    >>> from inswsn_lib.streams import Imu, Recording
    >>> found = ImuClock("course", 0.02, 0.001, None, np.full(3, np.nan), np.zeros(1), 0.1, 0.1, 9)
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
    before: float
    after: float
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


def imu_clock(
    recording: Recording,
    *,
    window: float | None = None,
    slowest: float = 1.0,
    block: float = 5.0,
    reach: float = 1.0,
    limit: float = CLOCK_LIMIT,
) -> ImuClock:
    r"""Return how late the IMU's stamps are, from turns that it and another sensor measure.

    With the mean rate :math:`\bar\omega(t)` of the gyro over a window and that of the reference's
    attitude, :math:`\log(A(t - h/2)^{-1} A(t + h/2)) / h` in axes of the body,

    .. math:: \bar\omega(t + \tau) = M\, \log(A(t - h/2)^{-1} A(t + h/2)) / h + b + e

    is fitted by least squares with weights that fall with the misfit, for offsets :math:`\tau` on a
    grid, the rotation M and the gyro's bias b in closed form (Umeyama 1991; the likeness of rates
    is a usual measure of an IMU's delay, as in Furgale, Rehder and Siegwart 2013). Deviations are
    those of a jackknife over blocks of time, each left out. Where the body turns about
    the vertical alone, or there is no attitude, the gyro about the vertical (the mean of the
    specific force) is compared with the rate of the heading, or of the course of fixes that have a
    velocity, or of chords of positions of the reference or else of fixes, which are made longer, up
    to 4 s, until errors turn them little. The course turns as the body does only without sideslip.

    Parameters
    ----------
    recording : Recording
        With an IMU, and a reference or fixes.
    window : float, optional
        h, s: 0.2 by default, and 0.5 for a course; three periods at least.
    slowest : float
        Below which speed a course tells nothing, m/s.
    block : float
        As in `calibrate`, s.
    reach : float
        How late or early the stamps may be, s.
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
    number("slowest", slowest, least=0)
    number("reach", reach, least=0)
    number("block", block, above=0)
    if window is not None:
        number("window", window, above=0)
    if recording.imu is None or len(recording.imu) < 2:
        raise InswsnError(f"The recording {recording.name} has no IMU.")
    told = told_by(recording, window, slowest)
    number("limit", limit, above=0)
    found = _matched(Felt.of(recording.imu, told), told, block, reach, limit)
    if found is None:
        told = vertical_part(told)
        found = _matched(Felt.of(recording.imu, told), told, block, reach, limit)
    assert found is not None  # a rate about the vertical has no rotation to be lost
    return found


def _matched(felt: Felt, told: Told, block: float, reach: float, limit: float) -> ImuClock | None:
    """Return the offset and the rest; None if it is told, but not the rotation."""
    count = round(reach / _STEP) + 1
    clocks: Array = np.asarray(_STEP * np.arange(-count, count + 1))
    turned = Turned(felt, told, clocks, block)
    if not len(turned.time):
        raise InswsnError("The IMU and what it is compared with share too little time.")
    blocks = len(turned.starts)
    if blocks < FEWEST:
        raise InswsnError(f"The IMU is compared in {blocks} blocks; {FEWEST} are needed.")
    state, others = turned.matched()
    off = others - others.mean(axis=0)
    deviations = np.sqrt((blocks - 1) / blocks * np.sum(off**2, axis=0))
    # errors of a course by far positions are larger than what is felt, which then is all in it
    course = told.by == "course"
    least = min(_EXPLAINED, _CHANCE / len(turned.time)) if course else _EXPLAINED
    if state.explained < least or (course and state.factor > _FACTOR):
        raise InswsnError(
            f"The IMU's clock cannot be told: by the {told.by} {state.explained:.0%} of the "
            "variance of its rates is explained: it turns too little, has other axes, or is of "
            "another run."
        )
    if turned.turns and (state.about < _ABOUT or not (deviations[1:] <= TURN_LIMIT).all()):
        return None
    if not deviations[0] <= limit:
        raise InswsnError(
            f"The recording cannot tell the IMU's clock: the deviation would be {deviations[0]:.2g}"
            f" s, above {limit:g}; it turns at {turned.size:.2g} rad/s."
        )
    nothing = Turn(0.0, np.eye(turned.width), np.zeros(turned.width))
    return ImuClock(
        by=told.by,
        offset=state.clock,
        deviation=float(deviations[0]),
        rotation=state.turn if turned.turns else None,
        rotation_deviation=deviations[1:] if turned.turns else np.full(3, np.nan),
        gyro_bias=state.bias,
        before=deviation_of(turned.residual(nothing).ravel()),
        after=deviation_of(turned.residual(state).ravel()),
        blocks=turned.telling(state),
    )
