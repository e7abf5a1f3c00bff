"""The positions of many windows of ranges at once: sums over the rows of each window.

`range_fixes` makes fixes of them, `anchor_bias` what anchors have too much.
"""

from __future__ import annotations

from typing import NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray

from inswsn_lib.checks import Array, Mask
from inswsn_lib.simulation.position_search import (
    least_positions,
    linear_start,
    misses_from,
    scatter,
    squares,
)
from inswsn_lib.streams import Ranges, Whole

Kind = TypeVar("Kind", bound=np.generic)

_SAVED = 1e-6  # s that compiled loops save a range
_ROUNDS, _SAME = 3, 0.8  # of the scale of robust residuals, and what is no change of it
_ENOUGH = 0.7  # of the intervals
_ROUNDING = 1e-6  # of an interval
_FLAT = 1e-4  # of the eigenvalues of an information or a scatter, the least over the largest
_TO_DEVIATION = 1.4826  # from the median of absolute values, of a normal distribution


class WindowRanges(NamedTuple):
    """The ranges of all windows, those of one window and one anchor beside one another."""

    place: Array  # (rows, d), of the anchors
    height: Array  # (rows,), of the anchors above what is fixed, m
    distance: Array
    windows: NDArray[np.intp]  # the first row of each window
    groups: NDArray[np.intp]  # the first row of each anchor in each window
    in_window: NDArray[np.intp]  # the first group of each window
    anchor: Whole  # (rows,)
    time: Array  # (rows,), s


class WindowFit(NamedTuple):
    """The positions that fit the ranges of each window best."""

    position: Array  # (windows, d)
    bad: Mask  # (windows,), those whose ranges do not tell a position
    direction: Array  # (rows, d), from the anchors to the position
    miss: Array  # (rows,), what a range has more than the distance, m
    weight: Array  # (rows,), with which least squares have the gradient of the loss
    noise: float  # of a range, m

    def information(self, rows: WindowRanges) -> Array:
        """Return the second derivative of half the loss by each position, (windows, d, d)."""
        # the derivative of soft-l1's gradient is the weight's third power
        return by_window(rows, self.weight[:, None, None] ** 3 * squares(self.direction))


def window_rows(
    time: Array, period: float, window: float
) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Return the rows of every window, one after the other, and where each window begins."""
    # stamps that are multiples of the period, but for rounding, begin intervals
    cell = np.floor((time - time[0]) / period + _ROUNDING).astype(int)
    last = np.flatnonzero(np.diff(cell, append=cell[-1] + 1))  # of each interval that has a range
    end = last + 1
    if window == period:
        begin = np.append(0, end[:-1])
    else:
        begin = np.searchsorted(time, time[0] + (cell[last] + 1 - _ROUNDING) * period - window)
    counts = end - begin
    first = np.append(0, np.cumsum(counts)[:-1])
    return np.arange(counts.sum()) + np.repeat(begin - first, counts), first


def enough_ranges(ranges: Ranges, periods: tuple[float, ...]) -> float | None:
    """Return the shortest of some periods in most intervals of which a fix has enough anchors."""
    d = ranges.anchors.shape[1]
    for period in periods:
        cell = np.floor((ranges.time - ranges.time[0]) / period + _ROUNDING).astype(int)
        heard = np.unique(cell * len(ranges.anchors) + ranges.anchor) // len(ranges.anchors)
        if np.mean(np.unique(heard, return_counts=True)[1] > d) >= _ENOUGH:
            return period
    return None


def window_ranges(
    ranges: Ranges,
    which: NDArray[np.intp],
    first: NDArray[np.intp],
    bias: Array,
    d: int,
    level: float | None,
) -> WindowRanges:
    """Return the ranges of the windows, ordered by anchor within each."""
    inside = np.repeat(np.arange(len(first)), np.diff(np.append(first, len(which))))
    order = np.lexsort((ranges.anchor[which], inside))
    anchor: Whole = ranges.anchor[which][order]
    new = (np.diff(inside, prepend=-1) != 0) | (np.diff(anchor, prepend=-1) != 0)
    groups = np.flatnonzero(new)
    return WindowRanges(
        ranges.anchors[anchor, :d],
        np.zeros(len(anchor)) if level is None else ranges.anchors[anchor, 2] - level,
        ranges.distance[which][order] - bias[anchor],
        first,
        groups,
        np.searchsorted(groups, first),
        anchor,
        ranges.time[which][order],
    )


def fit_windows(
    rows: WindowRanges, *, robust: bool = True, near: WindowFit | None = None
) -> WindowFit:
    """Return the positions of all windows by soft-l1, or by least squares.

    Where positions are known to be near those of another fit, they begin there.
    """
    d = rows.place.shape[1]
    anchors = np.diff(np.append(rows.in_window, len(rows.groups)))
    open_side = (anchors <= d) | _is_flat(scatter(rows.place[rows.groups], rows.in_window))
    if near is None:
        start = linear_start(rows.place, rows.height, rows.distance, rows.windows, open_side)
        position = _descended(rows, start, np.inf)
    else:
        position = near.position
    direction, miss = misses(rows, position)
    noise = _scale(rows, miss, ~open_side)
    weight = np.ones(len(miss))
    for _ in range(_ROUNDS if robust and noise > 0 else 0):
        position = _descended(rows, position, noise)
        direction, miss = misses(rows, position)
        weight = _soft_weights(miss, noise)
        noise, before = _scale(rows, miss, ~open_side), noise
        # least squares spread a gross error over all residuals, and so make the scale too large
        if noise > _SAME * before:
            break
    fit = WindowFit(position, open_side, direction, miss, weight, noise)
    return fit._replace(bad=open_side | _is_flat(fit.information(rows)))


def by_window(rows: WindowRanges, values: Array) -> Array:
    """Return the sums of values over the rows of each window."""
    return np.add.reduceat(values, rows.windows, axis=0)


def _counts(rows: WindowRanges) -> NDArray[np.intp]:
    return np.diff(np.append(rows.windows, len(rows.distance)))


def each_row(rows: WindowRanges, values: NDArray[Kind]) -> NDArray[Kind]:
    """Return for each row the value of its window."""
    return np.repeat(values, _counts(rows), axis=0)


def _is_flat(matrices: Array) -> Mask:
    """Tell of symmetric matrices whether one direction is lost beside another."""
    values = np.linalg.eigvalsh(matrices)
    return np.asarray(values[:, 0] <= _FLAT * values[:, -1])


def misses(rows: WindowRanges, position: Array) -> tuple[Array, Array]:
    """Return the directions from the anchors, and what the ranges have more than the distances."""
    return misses_from(rows.place, rows.height, rows.distance, each_row(rows, position))


def _soft_weights(miss: Array, scale: float) -> Array:
    """Return the weights with which least squares have the same gradient as soft-l1."""
    return np.asarray(1 / np.sqrt(1 + (miss / scale) ** 2))


def _descended(rows: WindowRanges, position: Array, scale: float) -> Array:
    saves = _SAVED * len(rows.distance)
    return least_positions(
        rows.place, rows.height, rows.distance, rows.windows, position, scale, saves=saves
    )


def _scale(rows: WindowRanges, miss: Array, redundant: Mask) -> float:
    """Return the deviation of a range, from the median of the residuals' absolute values."""
    used = miss[each_row(rows, redundant)]
    if not used.size:
        return 0.0
    freedom = 1 - rows.place.shape[1] * redundant.sum() / used.size
    return float(_TO_DEVIATION * np.median(np.abs(used)) / np.sqrt(freedom))
