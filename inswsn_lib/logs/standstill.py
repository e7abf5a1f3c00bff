"""When a body stands still, by its IMU and its fixes: for zero-velocity updates (ZUPT)."""

from __future__ import annotations

import numpy as np
from scipy.ndimage import uniform_filter1d

from inswsn_lib.checks import Array, Mask
from inswsn_lib.streams import Fixes, Imu

_WINDOW = 1.0  # s, over which an IMU is quiet
_QUIETEST, _QUIET = 0.02, 2.5  # a share of all windows, and times the level that these have
_CONTRAST = 4.0  # times that level the median of one must be: else it never stands, or never moves
_LASTS = 2.0  # s, before it is believed
#: Between updates, s
STEP = 0.2
_SPEED, _TOLD = 0.1, 0.3  # m/s, by fixes: what is let pass, and the largest deviation that tells
_FEWEST = 3  # fixes


def standstill_times(imu: Imu, fixes: Fixes, deviation: float, until: float) -> Array:
    r"""Return times at which a body stands still, (n,), s.

    It stands where specific force and angular rate vary as little as in the quietest windows (the
    detector of variances; Skog, Händel, Nilsson and Rantakokko 2010), and the line through the
    fixes since then has no speed: less than 0.1 m/s, or than three of its deviations,
    :math:`\sigma \sqrt{12 / n} / T`. None of these fixes may lie off, nor the last have another
    velocity: a car can leave so gently that its IMU is as quiet as before. Each time is told by
    what was before it alone, but for the level of the quietest windows, which is that of the
    recording's first part.

    Parameters
    ----------
    imu : Imu
    fixes : Fixes
        NaN where missing.
    deviation : float
        Of fixes, m.
    until : float
        s, the end of the first part.
    """
    quiet = _is_quiet(imu, until)
    edges = np.flatnonzero(np.diff(np.concatenate([[False], quiet, [False]]).astype(int)))
    there = np.isfinite(fixes.position[:, :2]).all(axis=1)
    time, place = fixes.time[there], fixes.position[there, :2]
    speed = np.zeros(len(time))
    if fixes.velocity is not None:
        speed = np.linalg.norm(fixes.velocity[there, :2], axis=1)
    found = []
    for first, last in zip(edges[::2], edges[1::2] - 1, strict=True):
        begin, end = imu.time[first] - _WINDOW, imu.time[last]
        for at in np.arange(begin + _LASTS, end, STEP):
            inside = slice(*np.searchsorted(time, [begin, at]))
            if _stands(time[inside], place[inside], speed[inside], deviation):
                found.append(float(at))
    return np.array(found)


def _is_quiet(imu: Imu, until: float) -> Mask:
    """Tell of each sample whether the window that ends with it is quiet."""
    rows = max(round(_WINDOW / float(np.median(np.diff(imu.time)))), 2)
    quiet, contrast = np.ones(len(imu), dtype=bool), 0.0
    for vectors in (imu.force, imu.rate):
        variance = np.zeros(len(imu))
        for column in vectors.T:  # one at a time: they are long
            apart = column - column.mean()
            mean, square = (
                uniform_filter1d(x, rows, origin=(rows - 1) // 2) for x in (apart, apart**2)
            )
            variance += np.maximum(square - mean**2, 0)
        size = np.sqrt(variance)
        first = size[rows:][imu.time[rows:] <= until]
        if not len(first):
            return np.zeros(len(imu), dtype=bool)
        level = float(np.quantile(first, _QUIETEST))
        quiet &= size <= _QUIET * level
        contrast = max(contrast, float(np.median(first)) / max(level, 1e-300))
    quiet[:rows] = False
    return quiet & (contrast > _CONTRAST)


def _stands(time: Array, place: Array, speed: Array, deviation: float) -> bool:
    if len(time) < _FEWEST or time[-1] <= time[0]:
        return False
    off = np.linalg.norm(place - np.median(place, axis=0), axis=1)
    if off.max() > 4 * deviation or speed[-1] > _SPEED:
        return False
    slope = np.polyfit(time - time[0], place, 1)[0]
    expected = deviation * np.sqrt(12 / len(time)) / float(time[-1] - time[0])
    return bool(expected < _TOLD and np.linalg.norm(slope) < max(_SPEED, 3 * expected))
