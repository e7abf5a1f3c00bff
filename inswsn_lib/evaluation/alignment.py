"""How one track follows another: with a lag, a clock that gains, turned, stretched or mirrored.

All is least squares between whitened columns, of which the sums of products are enough.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from inswsn_lib.checks import Array

_UNITS = {
    "feet": 3.2808, "cm": 100.0, "mm": 1000.0, "km/h": 3.6, "knots": 1.9438, "yards": 1.0936,
    "miles": 1.6093,
}  # fmt: skip
_NEAR = 0.03  # of a unit, in scale
_LEAST = 0.01  # variance of a whitened value, lest a track that is the other one has none
_COLUMNS = "abcdt"


class Fit(NamedTuple):
    """An explanation: a name, how many parameters, the squares that it leaves, and what it says."""

    name: str
    parameters: int
    left: float
    value: float
    deviation: float
    says: str


class Comparison:
    """Sums of products of whitened columns: the track, and five for each lag of the other track.

    Turned and stretched, the other is p a + q b with a = (x, y), b = (-y, x); mirrored it is p c +
    q d with c = (x, -y), d = (y, x). The fifth, t, is the derivative of a by the lag, times time:
    of a clock that gains.

    Parameters
    ----------
    lags : int
        On each side.
    spacing : float
        Of the lags, s.
    """

    def __init__(self, lags: int, spacing: float) -> None:
        self.lags, self.spacing = lags, spacing
        count = 1 + len(_COLUMNS) * (2 * lags + 1)
        self.gram = np.zeros((count, count))
        self.freedom = 0

    def add(self, white: Array, count: int) -> None:
        """Add whitened columns (values, columns), freed of those after the first of them."""
        basis, _ = np.linalg.qr(white[:, count:])
        free = white[:, :count] - basis @ (basis.T @ white[:, :count])
        self.gram += free.T @ free
        self.freedom += len(white) - basis.shape[1]

    def _column(self, letter: str, lag: int) -> Array:
        unit = np.zeros(len(self.gram))
        unit[1 + len(_COLUMNS) * (lag + self.lags) + _COLUMNS.index(letter)] = 1.0
        return unit

    def _track(self) -> Array:
        return np.asarray(np.eye(1, len(self.gram))[0])

    def _left(self, rest: Array) -> float:
        return float(rest @ self.gram @ rest)

    def _fitted(self, track: Array, *columns: Array) -> tuple[Array, float]:
        """Return coefficients of a track on columns, and the squares that are left."""
        rows = np.stack([track, *columns])
        inner = rows @ self.gram @ rows.T
        found = np.linalg.lstsq(inner[1:, 1:], inner[1:, 0], rcond=1e-10)[0]
        rest = np.append(1.0, -found)
        return np.asarray(found), float(rest @ inner @ rest)

    def explanations(self) -> tuple[float, float, list[Fit]]:
        """Return the squares left by none, the variance of a value, and the explanations."""
        cells = range(-self.lags, self.lags)
        every = [
            self._fitted(self._track(), *(self._column(x, k) for k in (j, j + 1) for x in "abcd"))
            for j in cells
        ]
        variance = max(_LEAST, min(left for _, left in every) / max(1, self.freedom - 8))
        nothing = self._left(self._track() - self._column("a", 0))
        fits = [self._time(cells, variance), self._clock(cells)]
        fits += [self._turn(letters, 0, variance) for letters in ("ab", "cd")]
        fits += [self._turn_and_time(letters, cells, variance) for letters in ("ab", "cd")]
        return nothing, variance, fits

    def _time(self, cells: Sequence[int], variance: float) -> Fit:
        best = (np.inf, 0.0, np.inf)
        for j in cells:
            track = self._track() - self._column("a", j)
            change = self._column("a", j + 1) - self._column("a", j)
            (share,), _ = self._fitted(track, change)
            share = float(np.clip(share, 0, 1))
            size = self._left(change)
            deviation = self.spacing * np.sqrt(variance / size) if size > 0 else np.inf
            left = self._left(track - share * change)
            best = min(best, (left, (j + share) * self.spacing, float(deviation)))
        left, lag, deviation = best
        return Fit("time", 1, left, lag, deviation, f"{_late(lag)} (± {deviation:.2g} s)")

    def _clock(self, cells: Sequence[int]) -> Fit:
        best = (np.inf, 0.0, 0.0)
        for j in cells:
            now = self._column("a", j)
            change = self._column("a", j + 1) - now
            (share, gain), left = self._fitted(self._track() - now, change, self._column("t", j))
            if -1 <= share <= 2:
                best = min(best, (left, (j + float(share)) * self.spacing, float(gain)))
        left, lag, gain = best
        says = f"its clock loses {gain:.2%}, and half way {_late(lag)}"
        return Fit("clock", 2, left, gain, 0.0, says)

    def _turn(self, letters: str, lag: int, variance: float) -> Fit:
        columns = [self._column(letter, lag) for letter in letters]
        (p, q), left = self._fitted(self._track(), *columns)
        size = self._left(columns[1])
        deviation = float(np.sqrt(variance / size)) if size > 0 else np.inf
        return _turned(letters, float(p), float(q), Fit("", 2, left, 0.0, deviation, ""))

    def _turn_and_time(self, letters: str, cells: Sequence[int], variance: float) -> Fit:
        best = (np.inf, 0.0, 1.0, 0.0)
        for j in cells:
            columns = [self._column(letter, k) for k in (j, j + 1) for letter in letters]
            found, left = self._fitted(self._track(), *columns)
            p, q = found[:2] + found[2:]
            share = float(np.clip(found[2:] @ (p, q) / max(p * p + q * q, 1e-300), 0, 1))
            best = min(best, (left, (j + share) * self.spacing, float(p), float(q)))
        left, lag, p, q = best
        turned = _turned(letters, p, q, Fit("", 4, left, 0.0, 0.0, ""))
        return turned._replace(name=f"{turned.name} and time", says=f"{turned.says}; {_late(lag)}")


def _late(seconds: float) -> str:
    return f"it is {abs(seconds):.3g} s {'late' if seconds > 0 else 'early'}"


def _turned(letters: str, p: float, q: float, fit: Fit) -> Fit:
    """Return a fit with what its two coefficients mean."""
    scale, angle = float(np.hypot(p, q)), float(np.degrees(np.arctan2(q, p)))
    name, value, what = "frame", angle, f"it is turned by {angle:.3g}°"
    if letters == "cd":
        named = {
            0: "y has the other sign", 90: "x and y are exchanged", -90: "x and y are exchanged, "
            "with other signs", 180: "x has the other sign", -180: "x has the other sign",
        }  # fmt: skip
        near = min(named, key=lambda each: abs(each - angle))
        also = f": {named[near]}" if abs(near - angle) < 15 else f", and turned by {angle:.3g}°"
        name, what = "axes", f"it is mirrored{also}"
    if abs(scale - 1) > max(0.02, 3 * fit.deviation):
        units = [u for u, size in _UNITS.items() if abs(abs(np.log(scale)) - np.log(size)) < _NEAR]
        size = f"{scale:.3g} times as large" + (f", as with {units[0]}" if units else "")
        if letters == "ab" and abs(np.radians(angle)) < max(0.05, abs(scale - 1) / 2):
            name, value, what = "scale", scale, f"it is {size}"
        else:
            what += f", and {size}"
    return fit._replace(name=name, value=value, says=what)
