"""Rates of turning, as a gyro feels them and as attitudes, headings and courses tell them."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import cumulative_trapezoid
from scipy.spatial.transform import Rotation, Slerp

from inswsn_lib.calibration.blocks import spaced
from inswsn_lib.calibration.start import aligned
from inswsn_lib.checks import Array, Mask
from inswsn_lib.errors import InswsnError
from inswsn_lib.streams import Imu, Recording, Reference

_WINDOW, _COURSE_WINDOW, _LONGEST = 0.2, 0.5, 4.0  # s
_ANGLE = 0.15  # rad, of errors of a course by positions, above which its chords are longer
_CLEAR = 3.0  # deviations of a chord by its errors, that it is longer than
_PERIODS = 3  # that a window has at least
_STEP = 0.1  # s, over which a loss differs by more than errors
_FAR = 5.0  # deviations of a difference that counts half
_CHANCE, _SINGULAR = 5.0, 1e-9  # deviations of a cross moment, and of the largest one
_GAP = 0.25  # s, or three periods: across a longer one nothing is told


class Felt:
    """The integral of a gyro's rates, along three axes or one."""

    def __init__(self, time: Array, rate: Array) -> None:
        self.time, self.rate = time, rate
        self._sum = cumulative_trapezoid(rate, time, axis=0, initial=0)

    @classmethod
    def of(cls, imu: Imu, told: Told) -> Felt:
        """Return the rates that are compared: of all axes, or of a course about the vertical."""
        felt = cls(imu.time, imu.rate)
        if told.by == "attitude":
            return felt
        return cls(imu.time, imu.rate @ up_of(imu)[:, None]).like(told)

    def like(self, told: Told) -> Felt:
        """Return means over a chord, which has the mean of the headings along it."""
        if not told.chord:
            return self
        ends = [self.turned(self.time + side * told.chord / 2) for side in (1, -1)]
        return Felt(self.time, (ends[0] - ends[1]) / told.chord)

    def turned(self, time: Array) -> Array:
        """Return the integral from the first stamp to some times, (n, axes)."""
        return np.column_stack([np.interp(time, self.time, x) for x in self._sum.T])

    def at(self, time: Array) -> Array:
        """Return the rates at some times, (n, axes)."""
        return np.column_stack([np.interp(time, self.time, x) for x in self.rate.T])


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


def told_by(recording: Recording, window: float | None, slowest: float) -> Told:
    """Return the rates that the reference's attitude tells, else those of a course."""
    reference = recording.reference
    if reference is not None and reference.attitude is not None and len(reference) > 1:
        return _by_attitude(reference, window)
    fixes = recording.fixes
    if fixes is not None and fixes.velocity is not None:
        there = np.isfinite(fixes.velocity).all(axis=1)
        return _by_course(fixes.time[there], fixes.velocity[there, :2], window, slowest)
    for source in (reference, fixes):
        if source is not None and len(source) > 2:
            there = np.isfinite(source.position[:, :2]).all(axis=1)
            return _by_positions(source.time[there], source.position[there, :2], window, slowest)
    raise InswsnError(
        f"The recording {recording.name} has neither a reference nor fixes, by which an IMU's "
        "clock could be told."
    )


def up_of(imu: Imu) -> Array:
    """Return the direction of the mean specific force in the axes of the IMU."""
    mean = imu.force.mean(axis=0)
    return np.asarray(mean / max(float(np.linalg.norm(mean)), 1e-300))


def _grid(time: Array, window: float, step: float | None = None) -> tuple[Array, Mask]:
    """Return the middles of windows over some stamps, and which have no gap."""
    middle = spaced(time[0] + window / 2, time[-1] - window / 2, step or window, len(time))
    steps = np.diff(time)
    wide = np.append(0, np.cumsum(steps > max(_GAP, 3 * float(np.median(steps)))))
    first, last = (np.searchsorted(time, middle + side * window / 2) for side in (-1, 1))
    whole = wide[np.minimum(last, len(time) - 1)] == wide[np.maximum(first - 1, 0)]
    return middle, np.asarray(whole)


def _window(given: float | None, usual: float, time: Array) -> float:
    if given is not None:
        return given
    return max(usual, _PERIODS * float(np.median(np.diff(time))))


def _by_attitude(reference: Reference, window: float | None) -> Told:
    h = _window(window, _WINDOW, reference.time)
    middle, kept = _grid(reference.time, h)
    middle = middle[kept]
    if not len(middle):
        raise InswsnError(f"The reference has no {h:g} s without a gap.")
    attitude = Slerp(reference.time, Rotation.from_quat(reference.attitude))
    ends = np.clip([middle - h / 2, middle + h / 2], reference.time[0], reference.time[-1])
    turns = attitude(ends[0]).inv() * attitude(ends[1])
    return Told("attitude", middle, turns.as_rotvec() / h, h, attitude(middle))


def _by_course(time: Array, velocity: Array, window: float | None, slowest: float) -> Told:
    """Return the rates of the course, where the speed at both ends of a window is enough."""
    if len(time) < 3:
        raise InswsnError("There are too few velocities to tell a course by.")
    h = _window(window, _COURSE_WINDOW, time)
    middle, kept = _grid(time, h)
    ends = []
    for side in (-h / 2, h / 2):
        v = np.column_stack([np.interp(middle + side, time, x) for x in velocity.T])
        speed = np.hypot(v[:, 0], v[:, 1])
        kept = kept & (speed >= slowest)
        ends.append(np.arctan2(v[:, 1], v[:, 0]))
    if not kept.any():
        raise InswsnError(f"It never moves at {slowest:g} m/s, so it has no course.")
    change = np.angle(np.exp(1j * (ends[1] - ends[0])))
    rate, usual = (change[kept] / h)[:, None], float(np.median(speed[kept]))
    return Told("course", middle[kept], rate, h, speed=usual)


def _by_positions(time: Array, place: Array, window: float | None, slowest: float) -> Told:
    """Return the rates of the course of chords, as long as their errors are no matter."""
    if len(time) < 5:
        raise InswsnError("There are too few positions to tell a course by.")
    usual = 1.4826 * np.median(np.abs(np.diff(place, 2, axis=0))) / np.sqrt(6)
    h = _window(window, _COURSE_WINDOW, time)
    while True:
        middle, kept = _grid(time, 2 * h, h)
        ends = [
            np.column_stack([np.interp(middle + side * h, time, x) for x in place.T])
            for side in (-1, 0, 1)
        ]
        ways = np.diff(ends, axis=0)
        length = np.linalg.norm(ways, axis=2).min(axis=0)
        error = np.sqrt(2) * usual
        kept = kept & (length > max(slowest * h, _CLEAR * error))
        clear = kept.any() and error < _ANGLE * float(np.median(length[kept]))
        if clear or 2 * h > _LONGEST:
            break
        h *= 2
    if not kept.any():
        raise InswsnError(f"It never moves at {slowest:g} m/s, so it has no course.")
    course = np.arctan2(ways[:, :, 1], ways[:, :, 0])
    change = np.angle(np.exp(1j * (course[1] - course[0])))
    speed = float(np.median(length[kept])) / h
    return Told("course", middle[kept], (change[kept] / h)[:, None], h, None, h, speed)


def vertical_part(told: Told) -> Told:
    """Return the rate of the heading, of rates along axes of the body."""
    assert told.attitude is not None
    return replace(told, by="heading", rate=told.attitude.apply(told.rate)[:, 2:])


@dataclass(frozen=True, eq=False)
class Turn:
    """A clock's offset (s), a rotation, and a gyro's bias (rad/s)."""

    clock: float
    turn: Array
    bias: Array


class Turned:
    """Rates that are felt less those that are told, which `robust_fit` makes small.

    Parameters
    ----------
    felt : Felt
    told : Told
    reach : float
        How far a clock may move without the gyro's rates coming to their end, s.
    """

    def __init__(self, felt: Felt, told: Told, reach: float) -> None:
        half = told.window / 2
        ends = felt.time[0] + half + reach, felt.time[-1] - half - reach
        inside = (told.time >= ends[0]) & (told.time <= ends[1]) & _complete(felt, told, reach)
        self.felt, self.half = felt, half
        self.time, self.rate = told.time[inside], told.rate[inside]
        self.width = self.rate.shape[1]
        self.turns = 3 if self.width == 3 else 0

    def nothing(self) -> Turn:
        """Return no offset, no turn and no bias."""
        return Turn(0.0, np.eye(self.width), np.zeros(self.width))

    def size(self) -> float:
        """Return the root mean square of the rates, free of their mean, rad/s."""
        return float(np.sqrt(np.mean(np.sum((self.rate - self.rate.mean(axis=0)) ** 2, axis=1))))

    def felt_rate(self, clock: float) -> Array:
        """Return the mean rates of the gyro over the windows, (n, axes)."""
        ends = (self.felt.turned(self.time + clock + side) for side in (-self.half, self.half))
        early, late = ends
        return np.asarray((late - early) / (2 * self.half))

    def start(self, clocks: Array) -> Turn:
        """Return the offset of some, and the rotation, that leave the least median."""
        best, state = np.inf, self.nothing()
        for clock in clocks:
            felt = self.felt_rate(float(clock))
            turn, bias = np.eye(1), np.median(felt - self.rate[:, : self.width], axis=0)
            if self.turns:
                turn, bias = aligned(self.rate, felt)
            off = float(np.median(np.linalg.norm(felt - self.rate @ turn.T - bias, axis=1)))
            if off < best:
                best, state = off, Turn(float(clock), turn, bias)
        return state

    def explained(self, state: Turn, noise: float) -> tuple[float, float]:
        """Return the squared correlation of both, and the factor of what is felt by its part in it.

        What fits worse than noise counts less. The factor is 1 if only what is told has errors.
        """
        felt, told = self.felt_rate(state.clock) - state.bias, self.rate @ state.turn.T
        weight = 1 / (1 + np.sum((felt - told) ** 2, axis=1, keepdims=True) / (_FAR * noise) ** 2)
        felt, told = (x - np.average(x, axis=0, weights=weight[:, 0]) for x in (felt, told))
        C, S, T = (float(np.sum(weight * x)) for x in (felt * told, felt**2, told**2))
        return max(C, 0.0) ** 2 / max(S * T, 1e-300), S / max(C, 1e-300)

    def clock_attenuation(self, state: Turn, noise: float) -> float:
        """Return by how much a clock is told less than by rates without errors.

        Its derivative has errors of what is felt; differences of the loss over more time hardly.
        """
        losses = [
            float(np.sum(2 * noise**2 * (np.sqrt(1 + (self.residual(each) / noise) ** 2) - 1)))
            for each in (replace(state, clock=state.clock + x * _STEP) for x in (-1, 0, 1))
        ]
        true = (losses[0] - 2 * losses[1] + losses[2]) / (2 * _STEP**2)
        push = self.jacobian(state)[:, 0] ** 2 / (1 + (self.residual(state) / noise) ** 2) ** 1.5
        return max(float(np.sum(push)) / true, 1.0) if true > 0 else np.inf

    def attenuation(self, state: Turn, noise: float) -> Array | None:
        """Return by how much a turn is told less than by rates without errors, (3, 3).

        The derivatives have the errors of the rates that are told, the second derivatives of the
        squares have not: those are the cross moments of both. None if these are chance alone.
        """
        felt, told = self.felt_rate(state.clock) - state.bias, self.rate @ state.turn.T
        weight = 1 / np.sqrt(1 + np.sum((felt - told) ** 2, axis=1) / noise**2)
        moment = (weight[:, None] * felt).T @ told
        true = np.trace(moment) * np.eye(3) - (moment + moment.T) / 2
        own = (weight[:, None] * told).T @ told
        values, vectors = np.linalg.eigh(true)
        along = vectors[:, 0]
        each = weight * (np.sum(felt * told, axis=1) - (felt @ along) * (told @ along))
        if values[0] <= max(_CHANCE * float(np.linalg.norm(each)), _SINGULAR * values[-1]):
            return None
        return np.asarray(np.linalg.solve(true, np.trace(own) * np.eye(3) - own))

    def residual(self, state: Turn) -> Array:
        """Return rates that are felt less those that are told, all axes of a time together."""
        miss = self.felt_rate(state.clock) - self.rate @ state.turn.T - state.bias
        return np.asarray(miss.ravel())

    def jacobian(self, state: Turn) -> Array:
        """Return the derivatives by clock, turn and bias."""
        n, w = self.rate.shape
        late, early = (self.felt.at(self.time + state.clock + x) for x in (self.half, -self.half))
        columns = [((late - early) / (2 * self.half)).reshape(n * w, 1)]
        if self.turns:
            told = self.rate @ state.turn.T
            # -(d x w) = w x d, as a matrix of w
            columns.append(np.stack([np.cross(told, e) for e in np.eye(3)], axis=2).reshape(-1, 3))
        columns.append(np.tile(-np.eye(w), (n, 1)))
        return np.hstack(columns)

    def moved(self, state: Turn, by: Array) -> Turn:
        """Return an offset, a turn and a bias after a step."""
        turn = state.turn
        if self.turns:
            turn = Rotation.from_rotvec(by[1:4]).as_matrix() @ turn
        return Turn(state.clock + float(by[0]), turn, state.bias + by[1 + self.turns :])


def _complete(felt: Felt, told: Told, reach: float) -> NDArray[np.bool_]:
    """Tell which windows lie in no gap of the gyro, wherever its clock moves."""
    steps = np.diff(felt.time)
    wide = np.append(0, np.cumsum(steps > max(_GAP, 3 * float(np.median(steps)))))
    half = told.window / 2 + reach
    first = np.clip(np.searchsorted(felt.time, told.time - half) - 1, 0, len(wide) - 1)
    last = np.clip(np.searchsorted(felt.time, told.time + half), 0, len(wide) - 1)
    return np.asarray(wide[first] == wide[last])
