"""The positions of many windows of ranges at once: sums over the rows of each window."""

from __future__ import annotations

from typing import NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray

from inswsn_lib.checks import Array, Mask
from inswsn_lib.logs.blocks import interpolate
from inswsn_lib.simulation.position_search import (
    least_positions,
    linear_start,
    misses_from,
    scatter,
    squares,
)
from inswsn_lib.streams import Ranges, Whole

Kind = TypeVar("Kind", bound=np.generic)

#: Of fixes by ranges, s, that are tried
PERIODS = (0.2, 0.5, 1.0, 2.0, 4.0)

_SAVED = 1e-6  # s that compiled loops save a range
_ROUNDS, _SAME = 4, 0.8  # of the scale of residuals, and what is no change of it
_ENOUGH = 0.7  # of the intervals
_ROUNDING = 1e-6  # of an interval
_FLAT = 1e-4  # of the eigenvalues of an information or a scatter, the least over the largest
# Of the eigenvalues of a scatter, where both sides are tried, and of anchors almost in a plane
_THIN, _PLANE = 0.15, 0.02
# How much smaller the loss must be on one side of that plane, in variances of a range, in one
# window, and in most of them; and the cosine of their planes' normals
_SINGLE, _USUAL, _ALONG = 16.0, 2.0, 0.9
_EXACT = 1e-6  # m, the least noise
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
    told: Mask  # (windows,), those with enough anchors, and not on a line

    def information(self, rows: WindowRanges) -> Array:
        """Return the second derivative of half the loss by each position, (windows, d, d)."""
        # the derivative of soft-l1's gradient is the weight's third power
        return by_window(rows, self.weight[:, None, None] ** 3 * squares(self.direction))


def enough_ranges(ranges: Ranges) -> float | None:
    """Return the shortest of `PERIODS` in most intervals of which a fix has enough anchors."""
    d, count = ranges.anchors.shape[1], len(ranges.anchors)
    for period in PERIODS:
        heard = np.unique(_intervals(ranges, period) * count + ranges.anchor) // count
        if np.mean(np.unique(heard, return_counts=True)[1] > d) >= _ENOUGH:
            return period
    return None


def _intervals(ranges: Ranges, period: float) -> Whole:
    """Return in which interval each range is; those that begin with a stamp have it inside."""
    found: Whole = np.floor((ranges.time - ranges.time[0]) / period + _ROUNDING).astype(int)
    return found


def window_ranges(ranges: Ranges, period: float, height: float | None = None) -> WindowRanges:
    """Return the ranges of each interval that has some, s, as of a tag whose height is known, m."""
    d = ranges.anchors.shape[1] if height is None else 2
    interval = _intervals(ranges, period)
    order = np.lexsort((ranges.anchor, interval))
    anchor: Whole = ranges.anchor[order]
    new = np.diff(interval[order], prepend=-1) != 0
    windows = np.flatnonzero(new)
    groups = np.flatnonzero(new | (np.diff(anchor, prepend=-1) != 0))
    return WindowRanges(
        place=ranges.anchors[anchor, :d],
        height=np.zeros(len(anchor)) if height is None else ranges.anchors[anchor, 2] - height,
        distance=ranges.distance[order],
        windows=windows,
        groups=groups,
        in_window=np.searchsorted(groups, windows),
        anchor=anchor,
        time=ranges.time[order],
    )


def fit_windows(
    rows: WindowRanges, *, near: WindowFit | None = None, side: float = 0.0
) -> WindowFit:
    """Return the positions of all windows by soft-l1.

    Where positions are known to be near those of another fit, they begin there. Else, where the
    anchors of a window lie almost in a plane, or on a line in two dimensions, the positions on both
    sides of it are tried. The loss chooses where it differs by enough in that window; else, where
    all anchors lie almost in one plane, in most windows, and then the given side; else the
    positions before and after.
    """
    if near is not None:
        return _fitted(rows, near.position, near.told)
    spread = _spread(rows)
    if not spread.thin.any():
        start = linear_start(rows.place, rows.height, rows.distance, rows.windows, ~spread.told)
        return _fitted(rows, start, spread.told)
    above, below = (_fitted(rows, start, spread.told) for start in _sides(rows, spread))
    return _chosen(rows, above, below, _side(rows, spread, above, below, side))


def _side(
    rows: WindowRanges, spread: _Spread, above: WindowFit, below: WindowFit, given: float
) -> Array:
    """Return on which side of its anchors the position of each window is, 1 or -1, or 0."""
    noise = max(min(above.noise, below.noise), _EXACT)
    more = _loss(rows, below, noise) - _loss(rows, above, noise)
    better = np.where(more < 0, -1.0, 1.0)
    # where both searches end at one place there is no other side
    same = np.linalg.norm(above.position - below.position, axis=1) <= noise
    clear = spread.told & (same | (np.abs(more) > _SINGLE))
    sides = np.where(clear | ~spread.thin, better, 0.0)
    open_ones = spread.common & ~same
    if open_ones.any():
        usual = float(np.median(more[open_ones]))
        other = np.sign(usual if abs(usual) > _USUAL else given)
        sides = np.where(open_ones & (sides == 0), other, sides)
    known = spread.told & ((sides != 0) | ~spread.thin)
    rest = np.flatnonzero(~known)
    if known.any() and not spread.common[rest].any():
        place = np.where(sides[known, None] >= 0, above.position[known], below.position[known])
        time = mean_times(rows)
        near = interpolate(time[known], place, time[rest])
        away = [np.linalg.norm(fit.position[rest] - near, axis=1) for fit in (above, below)]
        sides[rest] = np.where(away[0] < away[1], 1.0, -1.0)
    # what a window tells by little is better than nothing, but where it is hardly anything
    return np.where((sides == 0) & ~spread.flat, better, sides)


def _chosen(rows: WindowRanges, above: WindowFit, below: WindowFit, side: Array) -> WindowFit:
    """Return of each window the fit on its side; on none nothing is told."""
    upper = side >= 0
    row = each_row(rows, upper)
    return WindowFit(
        np.where(upper[:, None], above.position, below.position),
        np.where(upper, above.bad, below.bad) | (side == 0),
        np.where(row[:, None], above.direction, below.direction),
        np.where(row, above.miss, below.miss),
        np.where(row, above.weight, below.weight),
        min(above.noise, below.noise),
        above.told & (side != 0),
    )


def in_a_plane(ranges: Ranges) -> Array | None:
    """Return the normal of the plane that all anchors lie almost in, or None.

    Of its components the largest is positive. In two dimensions it is a line.
    """
    apart = ranges.anchors - ranges.anchors.mean(axis=0)
    values, axes = np.linalg.eigh(apart.T @ apart)
    return _upward(axes[:, 0]) if values[0] <= _PLANE * values[-1] else None


def _upward(normal: Array) -> Array:
    return np.asarray(normal * np.sign(normal[np.argmax(np.abs(normal))]))


class _Spread(NamedTuple):
    """How the anchors of windows are spread."""

    normal: Array  # (windows, d), of the plane that they are nearest to
    told: Mask  # (windows,), that are enough for a position, and not on a line
    thin: Mask  # (windows,), of those, that lie so near the plane that both sides are tried
    flat: Mask  # (windows,), of those, that lie almost in it
    common: Mask  # (windows,), of those, in that of all anchors, with normals to one side


def _spread(rows: WindowRanges) -> _Spread:
    values, axes = np.linalg.eigh(scatter(rows.place[rows.groups], rows.in_window))
    anchors = np.diff(np.append(rows.in_window, len(rows.groups)))
    # anchors on a line leave a circle open
    told = (anchors > rows.place.shape[1]) & (values[:, 1] > _FLAT * values[:, -1])
    apart = rows.place - rows.place.mean(axis=0)
    of_all, common = np.linalg.eigh(apart.T @ apart)
    along = axes[:, :, 0] @ _upward(common[:, 0])
    normal = axes[:, :, 0] * np.where(along < 0, -1.0, 1.0)[:, None]
    thin, flat = (told & (values[:, 0] <= least * values[:, -1]) for least in (_THIN, _PLANE))
    in_it = flat & (np.abs(along) > _ALONG) & (of_all[0] <= _PLANE * of_all[-1])
    return _Spread(normal, told, thin, flat, in_it)


def _sides(rows: WindowRanges, spread: _Spread) -> tuple[Array, Array]:
    """Return where the search begins on both sides of the plane of anchors.

    Differences of squared ranges tell the position; of anchors almost in a plane they tell where in
    it that is, and the mean of the squares how far from it.
    """
    across = np.where(spread.thin[:, None], spread.normal, 0.0)
    normals = each_row(rows, across)
    middle = by_window(rows, rows.place) / _counts(rows)[:, None]
    apart = np.sum(normals * (rows.place - each_row(rows, middle)), axis=1)
    placed = rows.place - normals * apart[:, None]
    start = linear_start(
        placed, rows.height, rows.distance, rows.windows, ~spread.told, across=squares(across)
    )
    square = rows.distance**2 - rows.height**2
    square -= np.sum((each_row(rows, start) - placed) ** 2, axis=1)
    size = by_window(rows, rows.distance**2)
    away = np.sqrt(np.maximum(by_window(rows, square), _FLAT * size) / _counts(rows))
    return start + away[:, None] * across, start - away[:, None] * across


def _fitted(rows: WindowRanges, position: Array, told: Mask) -> WindowFit:
    """Return the positions of least loss near others; the noise is of windows that are told."""
    noise, weight = np.inf, np.ones(len(rows.distance))
    for _ in range(_ROUNDS):
        position = least_positions(
            rows.place, rows.height, rows.distance, rows.windows, position, noise,
            saves=_SAVED * len(rows.distance),
        )  # fmt: skip
        at = each_row(rows, position)
        direction, miss = misses_from(rows.place, rows.height, rows.distance, at)
        # with which least squares have the same gradient as soft-l1
        weight = 1 / np.sqrt(1 + (miss / noise) ** 2)
        noise, before = _scale(rows, miss, told), noise
        # least squares spread a gross error over all residuals, and so make the scale too large
        if noise == 0 or noise > _SAME * before:
            break
    fit = WindowFit(position, ~told, direction, miss, weight, noise, told)
    values = np.linalg.eigvalsh(fit.information(rows))
    return fit._replace(bad=~told | (values[:, 0] <= _FLAT * values[:, -1]))


def _loss(rows: WindowRanges, fit: WindowFit, noise: float) -> Array:
    """Return the soft-l1 loss of each window in units of the noise."""
    square = (fit.miss / noise) ** 2
    return by_window(rows, 2 * square / (1 + np.sqrt(1 + square)))


def by_window(rows: WindowRanges, values: Array) -> Array:
    """Return the sums of values over the rows of each window."""
    return np.add.reduceat(values, rows.windows, axis=0)


def mean_times(rows: WindowRanges) -> Array:
    """Return the mean time of the ranges of each window, s."""
    return np.asarray(rows.time[0] + by_window(rows, rows.time - rows.time[0]) / _counts(rows))


def _counts(rows: WindowRanges) -> NDArray[np.intp]:
    return np.diff(np.append(rows.windows, len(rows.distance)))


def each_row(rows: WindowRanges, values: NDArray[Kind]) -> NDArray[Kind]:
    """Return for each row the value of its window."""
    return np.repeat(values, _counts(rows), axis=0)


def _scale(rows: WindowRanges, miss: Array, told: Mask) -> float:
    """Return the deviation of a range, from the median of the residuals' absolute values."""
    used = miss[each_row(rows, told)]
    if not used.size:
        return 0.0
    freedom = 1 - rows.place.shape[1] * told.sum() / used.size
    return float(_TO_DEVIATION * np.median(np.abs(used)) / np.sqrt(freedom))
