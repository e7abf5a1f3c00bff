"""Rates of turning, as a gyro feels them and as attitudes, headings and courses tell them."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.integrate import cumulative_trapezoid
from scipy.spatial.transform import Rotation, Slerp

from inswsn_lib.checks import Array, Mask
from inswsn_lib.errors import InswsnError
from inswsn_lib.logs.blocks import block_starts, spaced
from inswsn_lib.streams import Imu, Recording, Reference

_WINDOW, _COURSE_WINDOW, _LONGEST = 0.2, 0.5, 4.0  # s
_ANGLE = 0.15  # rad, of errors of a course by positions, above which its chords are longer
_CLEAR = 3.0  # deviations of a chord by its errors, that it is longer than
_PERIODS = 3  # that a window has at least
_ROUNDS, _FAR = 3, 3.0  # of weights, and median misfits at which one counts less
_MOST = 20_000  # windows that are looked at
_AROUND = 4  # clocks on either side, by which the best one is told
_GAP = 0.25  # s, or three periods: across a longer one nothing is told


class Felt:
    """The integral of a gyro's rates, along three axes or one."""

    def __init__(self, time: Array, rate: Array) -> None:
        self.time = time
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
        return Felt(self.time, self.mean(self.time, told.chord))

    def turned(self, time: Array) -> Array:
        """Return the integral from the first stamp to some times, (n, axes)."""
        return np.column_stack([np.interp(time, self.time, x) for x in self._sum.T])

    def mean(self, time: Array, window: float) -> Array:
        """Return the mean rates over windows around some times, (n, axes)."""
        return (self.turned(time + window / 2) - self.turned(time - window / 2)) / window


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


def unbroken(time: Array, early: Array, late: Array) -> Mask:
    """Tell which intervals lie within some stamps, and in none of their gaps."""
    steps = np.diff(time)
    wide = np.append(0, np.cumsum(steps > max(_GAP, 3 * float(np.median(steps)))))
    first, last = np.searchsorted(time, early, side="right") - 1, np.searchsorted(time, late)
    first, last = np.maximum(first, 0), np.minimum(last, len(time) - 1)
    return np.asarray((early >= time[0]) & (late <= time[-1]) & (wide[first] == wide[last]))


def windows(time: Array, window: float, step: float | None = None) -> tuple[Array, Mask]:
    """Return the middles of windows over some stamps, and which have no gap."""
    middle = spaced(time[0] + window / 2, time[-1] - window / 2, step or window, len(time))
    half = window / 2 - 1e-9  # rounding takes none of them away
    return middle, unbroken(time, middle - half, middle + half)


def _window(given: float | None, usual: float, time: Array) -> float:
    if given is not None:
        return given
    return max(usual, _PERIODS * float(np.median(np.diff(time))))


def _by_attitude(reference: Reference, window: float | None) -> Told:
    h = _window(window, _WINDOW, reference.time)
    middle, kept = windows(reference.time, h)
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
    middle, kept = windows(time, h)
    ends = []
    for side in (-h / 2, h / 2):
        v = np.column_stack([np.interp(middle + side, time, x) for x in velocity.T])
        speed = np.hypot(v[:, 0], v[:, 1])
        kept = kept & (speed >= slowest)
        ends.append(v)
    if not kept.any():
        raise InswsnError(f"It never moves at {slowest:g} m/s, so it has no course.")
    return _course(middle[kept], np.array(ends)[:, kept], h, float(np.median(speed[kept])))


def _by_positions(time: Array, place: Array, window: float | None, slowest: float) -> Told:
    """Return the rates of the course of chords, as long as their errors are no matter."""
    if len(time) < 5:
        raise InswsnError("There are too few positions to tell a course by.")
    usual = 1.4826 * np.median(np.abs(np.diff(place, 2, axis=0))) / np.sqrt(6)
    h = _window(window, _COURSE_WINDOW, time)
    while True:
        middle, kept = windows(time, 2 * h, h)
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
    return _course(middle[kept], ways[:, kept], h, float(np.median(length[kept])) / h, h)


def _course(time: Array, ways: Array, window: float, speed: float, chord: float = 0.0) -> Told:
    """Return the rates by vectors (2, n, 2) along the course at both ends of windows."""
    early, late = np.arctan2(ways[..., 1], ways[..., 0])
    rate = np.angle(np.exp(1j * (late - early)))[:, None] / window
    return Told("course", time, rate, window, None, chord, speed)


def vertical_part(told: Told) -> Told:
    """Return the rate of the heading, of rates along axes of the body."""
    assert told.attitude is not None
    return replace(told, by="heading", rate=told.attitude.apply(told.rate)[:, 2:])


@dataclass(frozen=True, eq=False)
class Turn:
    """A clock's offset (s), a rotation, a gyro's bias (rad/s), and what is left.

    `explained` is the squared correlation of both rates, `factor` what is felt over its part in
    that, 1 if only what is told has errors, and `about` how much turns about a second axis tell
    beside those about the first.
    """

    clock: float
    turn: Array
    bias: Array
    explained: float = 0.0
    factor: float = 1.0
    about: float = 0.0


class Turned:
    """The rates that a gyro feels and those that are told, over the same windows.

    By moments over blocks of time the offset, the rotation and the bias that leave the least
    squares are in closed form for each clock (Umeyama 1991), also without any block.
    """

    def __init__(self, felt: Felt, told: Told, clocks: Array, block: float) -> None:
        reach = told.window / 2 + float(np.abs(clocks).max())
        inside = np.flatnonzero(unbroken(felt.time, told.time - reach, told.time + reach))
        inside = inside[:: -(-len(inside) // _MOST) or 1]
        self.felt, self.window, self.clocks = felt, told.window, clocks
        self.time, self.rate = told.time[inside], told.rate[inside]
        self.width = self.rate.shape[1]
        self.turns = self.width == 3
        self.weight = np.ones(len(self.time))
        self.starts = block_starts(self.time, block) if len(self.time) else np.arange(0)

    @property
    def size(self) -> float:
        """The root mean square of the rates, free of their mean, rad/s."""
        return float(np.sqrt(np.mean(np.sum((self.rate - self.rate.mean(axis=0)) ** 2, axis=1))))

    def felt_rate(self, clock: float) -> Array:
        """Return the mean rates of the gyro over the windows, (n, axes)."""
        return self.felt.mean(self.time + clock, self.window)

    def residual(self, state: Turn) -> Array:
        """Return rates that are felt less those that are told, (n, axes)."""
        return np.asarray(self.felt_rate(state.clock) - self.rate @ state.turn.T - state.bias)

    def matched(self) -> tuple[Turn, Array]:
        """Return what leaves least, and what it is without each block, (blocks, 1 or 4).

        These are offsets and small rotations. What fits worse than others counts less.
        """
        fastest = 1.5 * float(np.abs(self.felt_rate(0.0)).max())
        size = np.maximum(np.linalg.norm(self.rate, axis=1), 1e-300)
        self.weight = np.minimum(1.0, fastest / size) ** 4
        for _ in range(_ROUNDS):
            sums = self._sums()
            state = self._least(sums.sum(axis=1, keepdims=True))[0]
            miss = np.linalg.norm(self.residual(state), axis=1)
            self.weight = 1 / (1 + (miss / max(_FAR * float(np.median(miss)), 1e-9)) ** 2)
        sums = self._sums()
        whole = sums.sum(axis=1, keepdims=True)
        state, others = self._least(whole)[0], self._least(whole - sums)
        moved = [
            [other.clock, *Rotation.from_matrix(other.turn @ state.turn.T).as_rotvec()]
            if self.turns
            else [other.clock]
            for other in others
        ]
        return state, np.array(moved)

    def telling(self, state: Turn) -> int:
        """Return how many blocks tell: as many as would if each told as much (Kish 1965)."""
        felt, told = self.felt_rate(state.clock) - state.bias, self.rate @ state.turn.T
        parts = self.weight * np.sum(felt * (told - told.mean(axis=0)), axis=1)
        shares = np.maximum(np.add.reduceat(parts, self.starts), 0.0)
        return max(2, round(float(shares.sum() ** 2 / max(np.sum(shares**2), 1e-300))))

    def _sums(self) -> Array:
        """Return sums over blocks of 1, what is felt, told, their products and squares."""
        found, u, w = [], self.rate, self.weight[:, None]
        for clock in self.clocks.tolist():
            f = self.felt_rate(clock)
            products = (f[:, :, None] * u[:, None]).reshape(len(u), -1)
            squares = np.column_stack([np.sum(f**2, axis=1), np.sum(u**2, axis=1)])
            rows = np.column_stack([np.ones(len(u)), f, u, products, squares])
            found.append(np.add.reduceat(w * rows, self.starts, axis=0))
        return np.array(found)

    def _least(self, sums: Array) -> list[Turn]:
        """Return what leaves least by sums (clocks, sets, numbers), for each set."""
        d, n = self.width, sums[..., :1]
        f, u = sums[..., 1 : 1 + d] / n, sums[..., 1 + d : 1 + 2 * d] / n
        products = sums[..., 1 + 2 * d : -2].reshape(*sums.shape[:2], d, d) / n[..., None]
        C = products - f[..., :, None] * u[..., None, :]
        S, T = (sums[..., k] / n[..., 0] - np.sum(x**2, axis=-1) for k, x in ((-2, f), (-1, u)))
        left, values, right = np.linalg.svd(C)
        turn = np.broadcast_to(np.eye(d), C.shape)
        alike, about = C[..., 0, 0], np.zeros(C.shape[:2])
        if self.turns:
            proper = np.linalg.det(left @ right)
            left[..., -1] *= proper[..., None]
            turn, alike = left @ right, values.sum(axis=-1) + (proper - 1) * values[..., -1]
            about = alike / np.maximum(values[..., 0], 1e-300) - 1
        misfit = S - 2 * alike
        found = []
        for k, best in enumerate(np.argmin(misfit, axis=0).tolist()):
            some = slice(max(0, best - _AROUND), best + _AROUND + 1)
            bend, slope, _ = np.polyfit(self.clocks[some] - self.clocks[best], misfit[some, k], 2)
            step = -slope / (2 * bend) if bend > 0 else np.inf
            clock = self.clocks[best] + float(np.clip(step, *(self.clocks[[0, -1]])))
            bias = f[best, k] - turn[best, k] @ u[best, k]
            share = max(alike[best, k], 1e-300)
            told = share**2 / max(S[best, k] * T[best, k], 1e-300), S[best, k] / share
            found.append(Turn(float(clock), turn[best, k], bias, *told, about[best, k]))
        return found
