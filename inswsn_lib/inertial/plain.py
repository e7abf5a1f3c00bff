"""The error-state filter by numpy, for many runs at once: where there is no numba."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from inswsn_lib.checks import Array, Mask
from inswsn_lib.inertial.mechanization import advance, reckon, turned
from inswsn_lib.streams import Whole


def error_state(
    sensors: Sequence[Callable[..., Any]], lengths: Array, rates: Array, forces: Array,
    increments: bool, ends: Whole, densities: Array, substep: float, earth: Array, which: Whole,
    offsets: Whole, starts: Array, covariances: Array, errors: Array, factors: Array, gained: Array,
    taken: Whole, begins: Whole, stops: Whole, kinds: Whole, data: Array, arms: Array, noise: Array,
    owns: Array, told: Array, mode: int, kept: int, *, make: Any,
) -> tuple[Any, ...]:  # fmt: skip
    """Do what the kernel of that name does."""
    run = _Runs(starts.copy(), covariances.copy(), errors.copy(), make)
    runs = len(starts)
    values, deviations, used = _blank(told)
    squares, likelihoods = np.full((runs, len(begins)), np.nan), np.zeros(runs)
    most = int(max([1, *(stops - begins)]))
    spreads = np.zeros((len(begins) if kept == 1 else 0, runs, most, most))
    tables: list[list[Array]] = [[] for _ in range(7)]
    states, before, filtered, priors, transitions, left, firsts = tables
    for k, end in enumerate(ends.tolist()):
        pieces = slice(int(ends[k - 1]) if k else 0, end)
        rows = offsets[:, None] + np.arange(pieces.start, pieces.stop)
        sensed = lengths[pieces], rates[which[:, None], rows], forces[which[:, None], rows]
        Phi = run.go(sensed, increments, densities, substep, earth)
        Phi = run.colour(Phi, factors[k], gained[k])
        if kept > 1:
            before.append(run.shown())
            priors.append(run.P)
            transitions.append(Phi)
        for j in range(taken[k], taken[k + 1]):
            part = slice(begins[j], stops[j])
            chosen = [sensors[kind] for kind in kinds[part]]
            table = chosen, data[part], arms[part], noise[part], owns[part], told[:, part]
            got = run.measure(table, mode)
            values[:, part], deviations[:, part], used[:, part] = got[:3]
            squares[:, j], likelihoods = got[3], likelihoods + got[4]
            if kept == 1:
                m = part.stop - part.start
                spreads[j, :, :m, :m] = got[5]
                if j == taken[k]:
                    firsts.append(run.x[:, :3] + run.e[:, :3])
        if mode == 2:
            run.feed_back_motion()
        if kept:
            states.append(run.shown() if kept > 1 else run.x.copy())
            filtered.append(run.P)
            left.append(run.e.copy())
    n, shape = covariances.shape[1], (-1, runs)
    numbers = starts.shape[1]
    sizes = (numbers,), (numbers,), (n, n), (n, n), (n, n), (n,), (3,)
    kept_ = [np.reshape(x, (*shape, *size)) for x, size in zip(tables, sizes, strict=True)]
    return (
        *kept_, values, deviations, used, squares, spreads, likelihoods, run.x, run.P, run.e,
    )  # fmt: skip


def _blank(told: Array) -> tuple[Array, Array, Mask]:
    return np.full(told.shape, np.nan), np.full(told.shape, np.nan), np.zeros(told.shape, bool)


class _Runs:
    """States, covariances and errors of some runs, on their way."""

    def __init__(self, x: Array, P: Array, e: Array, make: Any) -> None:
        self.x, self.P, self.e, self.make, self.d = x, P, e, make, make.errors
        self.own = x.shape[1] - P.shape[1] + self.d  # where own states begin

    def shown(self) -> Array:
        """Return the states with their errors taken in."""
        return np.array([
            self.make.of_row(x).plus(e).row for x, e in zip(self.x, self.e, strict=True)
        ])  # fmt: skip

    def feed_back(self) -> None:
        """Take the errors into the states."""
        self.x, self.e = self.shown(), np.zeros_like(self.e)

    def feed_back_motion(self) -> None:
        """Take the errors of the motion alone into the states.

        The covariance of the attitude is kept about axes of the frame.
        """
        d = self.d
        if d > 5:
            turn = np.swapaxes(turned(self.e[:, 6:9]), 1, 2)
            self.P[:, 6:9] = turn @ self.P[:, 6:9]
            self.P[:, :, 6:9] = self.P[:, :, 6:9] @ np.swapaxes(turn, 1, 2)
        self.x[:, : self.own] = self.shown()[:, : self.own]
        self.e[:, :d] = 0.0

    def go(
        self, sensed: tuple[Array, Array, Array], increments: bool, densities: Array,
        substep: float, earth: Array,
    ) -> Array:  # fmt: skip
        """Go along some pieces, and return the transition."""
        n, d = self.P.shape[1], self.d
        whole = np.tile(np.eye(n), (len(self.x), 1, 1))
        lengths, rates, forces = sensed
        for part in _parts(lengths, substep) if d > 5 else map(_one, range(len(lengths))):
            pieces = lengths[part], rates[:, part], forces[:, part]
            if d > 5:
                self.x, Phi, half = advance(self.x, pieces, increments, densities, earth)
                begin = end = half
            else:
                self.x, Phi, end = reckon(self.x, pieces, densities)
                begin = 0.0 * end
            step = np.tile(np.eye(n), (len(self.x), 1, 1))
            step[:, :d, :d] = Phi
            P = self.P.copy()
            P[:, :d, :d] += begin
            P = step @ P @ np.swapaxes(step, 1, 2)
            P[:, :d, :d] += end
            self.P, self.e = P, (step @ self.e[..., None])[..., 0]
            whole = step @ whole
        return whole

    def colour(self, Phi: Array, factors: Array, gained: Array) -> Array:
        """Take the own states to the event, and return the whole transition."""
        factor = np.concatenate([np.ones(self.d), factors])
        self.x[:, self.own :] *= factors
        self.e = factor * self.e
        self.P = factor[:, None] * self.P * factor
        self.P[:, range(self.d, len(factor)), range(self.d, len(factor))] += gained
        return np.asarray(Phi * factor)

    def measure(self, table: tuple[Any, ...], mode: int) -> tuple[Any, ...]:
        """Take a measurement; return its innovation and what is used of it, NIS and the rest."""
        chosen, data, arms, noise, owns, told = table
        found, H = expected(self.x, self.d, self.P.shape[1], chosen, data, arms, owns)
        value = wrapped(told - found, noise[:, 2]) - (H @ self.e[..., None])[..., 0]
        there = ~np.isnan(value)
        R = noise[:, 0] * np.eye(len(noise))
        S = H @ self.P @ np.swapaxes(H, 1, 2) + R
        variances = np.diagonal(S, axis1=1, axis2=2)
        with np.errstate(invalid="ignore"):
            used = there & (value**2 <= noise[:, 1] * variances)
        _, whole, _ = self._weigh(H, value, there, noise)
        gain, size, logarithm = self._weigh(H, value, used, noise)
        beyond = np.where(there & ~used, noise[:, 1] + np.log(2 * np.pi * variances), 0.0)
        count = used.sum(axis=1)
        likelihood = -0.5 * (size + logarithm + count * np.log(2 * np.pi) + beyond.sum(axis=1))
        self._update(H, value, used, gain, noise[:, 0], mode)
        with np.errstate(invalid="ignore"):
            square = whole / np.where(there.any(axis=1), there.sum(axis=1), np.nan)
        both = there[:, :, None] & there[:, None, :]
        deviation = np.where(there, np.sqrt(variances), np.nan)
        return value, deviation, used, square, likelihood, np.where(both, S, 0.0)

    def _weigh(
        self, H: Array, value: Array, used: Mask, noise: Array
    ) -> tuple[Array, Array, Array]:
        """Return the gain of the components that are used, their NIS, and the log of det S."""
        rows, wide = H * used[..., None], noise[:, 0] * np.eye(len(noise))
        S = rows @ self.P @ np.swapaxes(rows, 1, 2) + wide
        v = np.where(used, value, 0.0)
        gain = np.swapaxes(np.linalg.solve(S, rows @ self.P), 1, 2)
        size = (v * np.linalg.solve(S, v[..., None])[..., 0]).sum(axis=1)
        idle = np.where(used, 0.0, np.log(noise[:, 0])).sum(axis=1)
        return gain, size, np.linalg.slogdet(S)[1] - idle

    def _update(
        self, H: Array, value: Array, used: Mask, gain: Array, variances: Array, mode: int
    ) -> None:
        """Correct the errors, and with a mode of 1 the states."""
        correction = (gain @ np.where(used, value, 0.0)[..., None])[..., 0]
        keep = np.eye(self.P.shape[1]) - gain @ (H * used[..., None])
        P = keep @ self.P @ np.swapaxes(keep, 1, 2)
        P += (gain * variances) @ np.swapaxes(gain, 1, 2)
        self.P, self.e = 0.5 * (P + np.swapaxes(P, 1, 2)), self.e + correction
        if mode == 1:
            self.feed_back()


def expected(
    x: Array, d: int, n: int, chosen: Sequence[Callable[..., Any]], data: Sequence[Any],
    arms: Array, owns: Array,
) -> tuple[Array, Array]:  # fmt: skip
    """Return what sensors expect of states, (runs, m), and derivatives by errors, (runs, m, n)."""
    found, H = np.empty((len(x), len(chosen))), np.zeros((len(x), len(chosen), n))
    seen, begin = _see(x, d), x.shape[1] - n + d
    R = seen[:, 6:15].reshape(-1, 3, 3)
    for c, (sensor, arm) in enumerate(zip(chosen, arms, strict=True)):
        first, count = owns[c].astype(int)
        at, row = seen.copy(), np.zeros((15 + count, len(x)))
        at[:, :3] += R @ arm
        own = x[:, begin + first : begin + first + count]
        plain = getattr(sensor, "py_func", sensor)  # compiled, where nothing can be kept on disk
        found[:, c] = plain(at.T, own.T, data[c], row)
        H[:, c] = _rows(x, R, arm, row.T, d, first, n)
    return found, H


def _see(x: Array, d: int) -> Array:
    """Return what sensors see of states, (runs, 21); see `sensors`."""
    if d > 5:
        return x[:, :21].copy()
    seen, speed = np.zeros((len(x), 21)), x[:, 5] * (1 + x[:, 3])
    c, s = np.cos(x[:, 2]), np.sin(x[:, 2])
    seen[:, :2], seen[:, 3], seen[:, 4] = x[:, :2], speed * c, speed * s
    seen[:, 6], seen[:, 7], seen[:, 9], seen[:, 10], seen[:, 14] = c, -s, s, c, 1.0
    return seen


def _rows(x: Array, R: Array, arm: Array, row: Array, d: int, first: int, n: int) -> Array:
    """Return derivatives by the errors, of those by what a sensor at a lever arm saw."""
    H = np.zeros((len(x), n))
    back = (np.swapaxes(R, 1, 2) @ row[:, :3, None])[..., 0]
    about = row[:, 6:9] + np.cross(arm, back)
    if d > 5:
        H[:, :15] = row[:, :15]
        H[:, 6:9] = about
    else:
        H[:, :2], speed = row[:, :2], x[:, 5] * (1 + x[:, 3])
        ahead = row[:, 3] * R[:, 0, 0] + row[:, 4] * R[:, 1, 0]
        side = row[:, 4] * R[:, 0, 0] - row[:, 3] * R[:, 1, 0]
        H[:, 2], H[:, 3] = about[:, 2] + speed * side, x[:, 5] * ahead
    H[:, d + first : d + first + row.shape[1] - 15] = row[:, 15:]
    return H


def wrapped(value: Array, period: Array) -> Array:
    """Return values within half a period, where there is one."""
    safe = np.where(period > 0, period, 1.0)
    return np.where(period > 0, value - safe * np.floor(value / safe + 0.5), value)


def _one(piece: int) -> slice:
    return slice(piece, piece + 1)


def _parts(lengths: Array, substep: float) -> list[slice]:
    """Return pieces by steps of the covariance, as the kernel takes them."""
    parts, begin, passed = [], 0, 0.0
    for k, length in enumerate(lengths.tolist()):
        passed += length
        if passed >= substep or k + 1 == len(lengths):
            parts.append(slice(begin, k + 1))
            begin, passed = k + 1, 0.0
    return parts
