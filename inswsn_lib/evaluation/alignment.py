"""How one track follows another: late, by a clock that gains, turned, stretched or mirrored.

Each explanation is a least-squares fit, with an unknown origin, of a track whose noise is known.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.optimize import minimize

from inswsn_lib.checks import Array

_UNITS = {
    "feet": 3.2808, "cm": 100.0, "mm": 1000.0, "km/h": 3.6, "knots": 1.9438, "yards": 1.0936,
    "miles": 1.6093,
}  # fmt: skip
_NEAR = 0.03  # of a unit, in scale
_SPACING = 0.1  # s, of the lags at which a search begins
_MOST = 10_000  # rows that are compared; of more, some at even distances
#: Explanations: whether turned or mirrored, and how many numbers the time has, a lag and a gain
_KINDS = (("", 1), ("", 2), ("turned", 0), ("mirrored", 0), ("turned", 1), ("mirrored", 1))


class Explanation(NamedTuple):
    """A name, how many parameters, what they leave over the noise, and what they mean.

    What is left is (rows, 2 or 4), NaN where missing; `value` is in s, degrees, or a quotient.
    `rival` is the sum of squares that nothing leaves or, if less, what the opposite lag leaves:
    between two rows the noise of the other track is averaged, which is no lag.
    """

    name: str
    parameters: int
    left: Array
    value: float
    says: str
    rival: float

    @property
    def squares(self) -> float:
        """The sum of squares that it leaves."""
        return _squares(self.left)


class Alignment:
    """A track, to be explained by another one that is right.

    Turned and stretched, the other is p a + q b with a = (x, y), b = (-y, x); mirrored it is p c +
    q d with c = (x, -y), d = (y, x).

    Parameters
    ----------
    time : ndarray, (n,)
        s.
    track : ndarray, (n, 2 or 4)
        Positions (m), and velocities (m/s); NaN where missing.
    other : ndarray, (n, 4)
        NaN where missing.
    sigma : ndarray, (2 or 4,)
        Deviations of the noise of the track.
    reach : float
        How late or early it may be, s.
    """

    def __init__(self, time: Array, track: Array, other: Array, sigma: Array, reach: float) -> None:
        known, m = ~np.isnan(other).any(axis=1), len(sigma)
        centre = np.append(other[known, :2].mean(axis=0), [0.0, 0.0])
        self._other = time[known], (other[known] - centre).T
        inner = (time >= time[0] + reach) & (time <= time[-1] - reach)
        rows = np.flatnonzero(inner & known & ~np.isnan(track).all(axis=1))
        rows = rows[:: -(-len(rows) // _MOST) or 1]
        self._time, self._middle, self._reach = time[rows], float(time.mean()), reach
        self._sigma, self._track = sigma, self._over_noise((track - centre[:m])[rows], sigma)
        #: How many values are compared
        self.values = int(np.isfinite(self._track).sum())

    @staticmethod
    def _over_noise(values: Array, sigma: Array) -> Array:
        """Return values (rows, m) over the noise, with the mean position at zero."""
        free = values.copy()
        if len(free):
            free[:, :2] -= np.nan_to_num(np.nanmean(free[:, :2], axis=0))
        return np.asarray(free / sigma)

    def _moved(self, lag: float, gain: float = 0.0) -> Array:
        """Return the other track as it is told so much later, by a clock that loses, (4, rows)."""
        at = self._time - lag - gain * (self._time - self._middle)
        return np.stack([np.interp(at, self._other[0], x) for x in self._other[1]])

    def _fit(self, kind: str, *late: float) -> tuple[Array, Array]:
        """Return the two coefficients, and what is left over the noise."""
        x, y, u, v = self._moved(*late or (0.0,))
        columns = [(x, y, u, v), (-y, x, -v, u)]
        if kind == "mirrored":
            columns = [(x, -y, u, -v), (y, x, v, u)]
        there, m = np.isfinite(self._track), len(self._sigma)
        both = [np.where(there, np.stack(each[:m], axis=1), np.nan) for each in columns]
        A = np.stack([self._over_noise(each, self._sigma) for each in both], axis=2)
        found = np.array([1.0, 0.0])
        if kind:
            found = np.linalg.lstsq(A[there], self._track[there], rcond=None)[0]
        return found, np.asarray(self._track - A @ found)

    def _searched(self, kind: str, count: int) -> Array:
        """Return the lag, or it and the gain, that leave least."""

        def squares(late: Array) -> float:
            outside = max(0.0, abs(float(late[0])) - self._reach)
            return _squares(self._fit(kind, *late)[1]) * (1 + outside) + outside

        lags = np.linspace(-self._reach, self._reach, 2 * max(1, round(self._reach / _SPACING)) + 1)
        begin = min(([float(lag), 0.0][:count] for lag in lags), key=lambda x: squares(np.array(x)))
        simplex = np.vstack([begin, begin + np.diag([_SPACING, 0.01])[:count, :count]])
        how = {"initial_simplex": simplex, "xatol": 1e-4, "fatol": 1e-2}
        return np.asarray(minimize(squares, begin, method="Nelder-Mead", options=how).x)

    def explanations(self) -> list[Explanation]:
        """Return the explanations, first that of a lag alone."""
        found = []
        nothing = _squares(self._fit("")[1])
        for kind, count in _KINDS:
            late = self._searched(kind, count) if count else np.empty(0)
            (p, q), left = self._fit(kind, *late)
            name, value, says = _turned(kind, p, q)
            if not kind:
                name, value, says = "time", float(late[0]), _late(late[0])
            elif count:
                name, says = f"{name} and time", f"{says}; {_late(late[0])}"
            if count == 2:
                name, value = "clock", float(late[1])
                says = f"its clock loses {value:.2%}, and half way {says}"
            rival = min(nothing, _squares(self._fit(kind, *-late)[1])) if count else nothing
            found.append(Explanation(name, count + 2 * bool(kind), left, value, says, rival))
        return found

    def deviations(self) -> tuple[float, float]:
        """Return the deviations of a lag, s, and of a turn, rad, by the noise."""
        h, m = _SPACING / 2, len(self._sigma)
        changes = (self._moved(h) - self._moved(-h)) / (2 * h), self._moved(0.0)
        there = np.isfinite(self._track)
        over = (np.where(there, each[:m].T, np.nan) for each in changes)
        sizes = [np.nansum(self._over_noise(each, self._sigma) ** 2) for each in over]
        lag, turn = (float(1 / np.sqrt(size)) if size > 0 else np.inf for size in sizes)
        return lag, turn


def _squares(left: Array) -> float:
    return float(np.nansum(left**2))


def _late(seconds: float) -> str:
    return f"it is {abs(seconds):.3g} s {'late' if seconds > 0 else 'early'}"


def _turned(kind: str, p: float, q: float) -> tuple[str, float, str]:
    """Return the name, the value and the words of two coefficients."""
    scale, angle = float(np.hypot(p, q)), float(np.degrees(np.arctan2(q, p)))
    name, what = "frame", f"it is turned by {angle:.3g}°"
    if kind == "mirrored":
        named = {
            0: "y has the other sign", 90: "x and y are exchanged", -90: "x and y are exchanged, "
            "with other signs", 180: "x has the other sign", -180: "x has the other sign",
        }  # fmt: skip
        near = min(named, key=lambda each: abs(each - angle))
        also = f": {named[near]}" if abs(near - angle) < 15 else f", and turned by {angle:.3g}°"
        name, what = "axes", f"it is mirrored{also}"
    if abs(scale - 1) > 0.02:
        units = [u for u, size in _UNITS.items() if abs(abs(np.log(scale)) - np.log(size)) < _NEAR]
        size = f"{scale:.3g} times as large" + (f", as with {units[0]}" if units else "")
        if kind == "turned" and abs(np.radians(angle)) < max(0.05, abs(scale - 1) / 2):
            return "scale", scale, f"it is {size}"
        what += f", and {size}"
    return name, angle, what
