"""The network's positions: of ranges, on a side of anchors in a plane, or with a height held."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from inswsn_lib.checks import Array, number, whole
from inswsn_lib.errors import InswsnError, ParameterError
from inswsn_lib.logs.findings import Finding
from inswsn_lib.logs.window_fits import (
    PERIODS,
    WindowFit,
    WindowRanges,
    fit_windows,
    in_a_plane,
    mean_times,
    window_ranges,
)
from inswsn_lib.simulation.position_search import squares
from inswsn_lib.streams import Fixes, Ranges, Recording

#: The deviation of a height that is held, m
HELD = 1.0
#: What the errors of fixes upwards are taken for, times those to the side
UP = np.array([1.0, 1.0, 2.0])
_MOST_FIXES = 0.5  # of the intervals, that must have one
_VERTICAL = 0.9  # the cosine of a normal, of a plane such as a ceiling
_OF_SECOND_DIFFERENCES = 1.4826 / np.sqrt(6)  # from their median size to a deviation
_LEAST, _LEAST_SHARE = 1e-3, 0.1  # m, of a deviation, and of one over the median
_SLACK = 2.0  # times what the fixes of a line take if none is missing


def multilaterate_track(
    ranges: Ranges, period: float = 0.2, *, height: float | None = None, side: float = 0.0
) -> Fixes:
    r"""Return a fix for each interval, from the ranges of that interval alone.

    With :math:`e_i = r_i - |p - a_i|`, a fix minimises

    .. math:: \sum_i 2 c^2 \left(\sqrt{1 + (e_i / c)^2} - 1\right),

    the loss that is called soft-l1, quadratic near zero and linear far away (Charbonnier and others
    1997; ``loss="soft_l1"`` of `scipy.optimize.least_squares`). The scale c is the deviation of the
    residuals of the whole recording, from their median absolute value; where errors are normal,
    this loss wastes 7 % of the information. All intervals are solved at once by Levenberg and
    Marquardt's method (Marquardt 1963), from the solution of the linear problem that differences of
    squared ranges pose.

    Errors of one anchor's ranges hang together within an interval. So the deviation knows of two
    variances, one of an anchor in an interval and one of a range, both of the whole recording's
    residuals: :math:`H^{-1} S H^{-1}` with the information :math:`H = \sum_i u_i u_i'` of the
    directions, and S the covariance of :math:`\sum_i u_i e_i`. Errors that all anchors have in
    common, or one anchor over the whole recording, may be missing from it.

    Parameters
    ----------
    ranges : Ranges
        To anchors in two or three dimensions.
    period : float
        Of the intervals, s. They begin with the first stamp; one without a range has no fix.
    height : float, optional
        Of the tag, m, if it is known: fixes are then horizontal, from anchors in three dimensions.
    side : float
        On which side of anchors that lie in a plane (in two dimensions, on a line) the tag is: 1
        where the largest component of the normal is positive, such as above a ceiling, -1 below, 0
        if that is not known. Where they lie almost in a plane, the ranges come first.

    Returns
    -------
    Fixes
        The stamp is the mean of those of the ranges that a fix takes. It is NaN with fewer distinct
        anchors than dimensions and one more, with anchors in a plane (on a line) that leave its
        side open, or where a direction's deviation is a hundred times another's.

    Raises
    ------
    InswsnError
        If there is no range, or a parameter is not what it must be (`ParameterError`).

    Examples
    --------
    A tag goes from (1, 2) to (2, 2); two ranges to each of four anchors make a fix.

    >>> import numpy as np
    >>> from inswsn_lib.logs import multilaterate_track
    >>> from inswsn_lib.streams import Ranges
    >>> anchors = np.array([[0.0, 0.0], [4.0, 0.0], [0.0, 5.0], [4.0, 5.0]])
    >>> track = np.repeat([[1.0, 2.0], [2.0, 2.0]], 8, axis=0)
    >>> heard = np.tile(range(4), 4)
    >>> distance = np.linalg.norm(anchors[heard] - track, axis=1)
    >>> ranges = Ranges(np.arange(16) * 0.025, heard, distance, anchors, tuple("abcd"))
    >>> fixes = multilaterate_track(ranges, period=0.2)
    >>> print(fixes.time.round(4), fixes.position.round(6).tolist())
    [0.0875 0.2875] [[1.0, 2.0], [2.0, 2.0]]
    """
    number("period", period, above=0)
    ranges = ranges.kept(np.isfinite(ranges.distance))
    if not len(ranges):
        raise InswsnError("There is no range to make fixes of.")
    if height is not None and ranges.anchors.shape[1] == 2:
        raise ParameterError("height", height, "left out for anchors in two dimensions")
    rows = window_ranges(ranges, period, None if height is None else number("height", height))
    fit = fit_windows(rows, side=number("side", side, least=-1, most=1))
    position = np.where(fit.bad[:, None], np.nan, fit.position)
    return Fixes(time=mean_times(rows), position=position, deviation=_deviations(rows, fit))


def _deviations(rows: WindowRanges, fit: WindowFit) -> Array:
    """Return the deviations of positions, from a variance of an anchor and one of a range."""
    d = rows.place.shape[1]
    counts = np.diff(np.append(rows.groups, len(fit.miss)))
    anchors = np.diff(np.append(rows.in_window, len(rows.groups)))
    there = np.repeat(~fit.bad, anchors)
    found = np.full((len(fit.bad), d), np.nan)
    if fit.bad.all():
        return found
    # what the ranges pull the fix by: their residuals, less where these are large
    push = fit.weight * fit.miss
    mean = np.add.reduceat(push, rows.groups) / counts
    rest = np.add.reduceat((push - np.repeat(mean, counts)) ** 2, rows.groups)
    several = int((counts - 1)[there].sum())
    of_range = float(rest[there].sum()) / several if several else 0.0
    # a fix takes d of its anchors' residuals
    of_anchor = float(np.sum(mean[there] ** 2)) / int((anchors - d)[~fit.bad].sum())
    of_anchor = max(of_anchor - of_range * float(np.mean(1 / counts[there])), 0.0)
    variance = of_anchor * counts**2 + of_range * counts
    S = variance[:, None, None] * squares(fit.direction[rows.groups])
    S = np.add.reduceat(S, rows.in_window, axis=0)[~fit.bad]
    inverse = np.linalg.inv(fit.information(rows)[~fit.bad])
    found[~fit.bad] = np.sqrt(np.einsum("wij,wjk,wki->wi", inverse, S, inverse))
    return found


def slope_velocity(fixes: Fixes, count: int = 5) -> Fixes:
    r"""Return fixes with the velocity of the straight line through the last `count` of them.

    With stamps :math:`t_i` and positions :math:`p_i` of the fixes up to now,

    .. math:: v = \sum_i (t_i - \bar t)\, p_i \big/ \sum_i (t_i - \bar t)^2,

    the slope by least squares. It is causal: it is late by half of the time that these fixes take,
    as every derivative by the past is, and its deviation with even periods T and independent errors
    :math:`\sigma` is :math:`\sigma \sqrt{12 / (n^3 - n)} / T` (Bar-Shalom, Li and Kirubarajan 2001,
    Section 3.5, a straight line by least squares).

    Parameters
    ----------
    fixes : Fixes
        Those that are NaN are passed over.
    count : int
        How many fixes a line goes through, 2 or more.

    Returns
    -------
    Fixes
        The velocity, m/s, is NaN where the fix is, where fewer fixes came before, or where they
        take more than twice as long as by the median step.

    Examples
    --------
    A fix is missing at 3 s; the line goes on through the others, for they do not take too long.

    >>> import numpy as np
    >>> from inswsn_lib.logs import slope_velocity
    >>> from inswsn_lib.streams import Fixes
    >>> x = np.array([0.0, 2.0, 4.0, np.nan, 8.0])
    >>> fixes = Fixes(time=np.arange(5.0), position=np.column_stack([x, 0 * x]))
    >>> print(slope_velocity(fixes, count=3).velocity[:, 0])
    [nan nan  2. nan  2.]
    """
    whole("count", count, 2)
    there = np.flatnonzero(np.isfinite(fixes.position).all(axis=1))
    velocity = np.full(fixes.position.shape, np.nan)
    if len(there) >= count:
        times = sliding_window_view(fixes.time[there], count)
        places = sliding_window_view(fixes.position[there], count, axis=0).swapaxes(1, 2)
        apart = times - times.mean(axis=1, keepdims=True)
        slope = np.einsum("nc,ncd->nd", apart, places - places[:, :1])
        slope /= np.sum(apart**2, axis=1, keepdims=True)
        longest = _SLACK * (count - 1) * np.median(np.diff(fixes.time))
        slope[times[:, -1] - times[:, 0] > longest] = np.nan
        velocity[there[count - 1 :]] = slope
    return replace(fixes, velocity=velocity)


def network_of(recording: Recording, periods: Sequence[float] = PERIODS) -> Fixes:
    """Return what the network alone says: fixes as they are, or of ranges, with velocities.

    Of the periods of fixes by ranges, s, the shortest in which most have one is taken.
    """
    ranges, fixes = recording.ranges, recording.fixes
    if ranges is not None and len(ranges):
        return fixes_of(ranges, periods, recording.height)
    if fixes is None or not np.isfinite(fixes.position).all(axis=1).any():
        raise InswsnError(
            f"The recording {recording.name} has neither ranges nor fixes while it moves: there is "
            "nothing to correct by."
        )
    return slope_velocity(fixes) if fixes.velocity is None else fixes


def fixes_of(
    ranges: Ranges, periods: Sequence[float], height: float | None = None, side: float = 0.0
) -> Fixes:
    """Return fixes of the shortest intervals of which most have one, with velocities.

    Height and side are as of `multilaterate_track`. Anchors in a level plane are taken to be above.
    """
    if (fixes := shortest(ranges, periods, height, side)) is not None:
        return fixes
    normal = in_a_plane(ranges) if height is None else None
    if normal is None or side:
        raise InswsnError(
            f"Too few anchors are heard at a time: most intervals of {periods[-1]:g} s have no fix."
        )
    if not is_level(normal):
        raise refusal(ranges, normal)
    return fixes_of(ranges, periods, side=-1.0)  # to the side the mirror image is the same


def shortest(
    ranges: Ranges, periods: Sequence[float], height: float | None = None, side: float = 0.0
) -> Fixes | None:
    """Return what `fixes_of` does, or None where most intervals have no fix."""
    for period in periods:
        fixes = multilaterate_track(ranges, period, height=height, side=side)
        if np.isfinite(fixes.position).all(axis=1).mean() > _MOST_FIXES:
            return slope_velocity(fixes)
    return None


def is_level(normal: Array) -> bool:
    """Tell whether a plane with a normal is one such as a ceiling."""
    return len(normal) == 3 and float(abs(normal[2])) > _VERTICAL


def named_plane(ranges: Ranges, normal: Array) -> str:
    """Return the equation of the plane of anchors, such as z = 2.5 m."""
    middle = float(ranges.anchors.mean(axis=0) @ normal)
    parts = [f"{a:+.2g} {name}" for a, name in zip(normal, "xyz", strict=False) if abs(a) > 0.01]
    return f"{' '.join(parts).lstrip('+').replace('1 ', '')} = {middle:.3g} m"


def refusal(ranges: Ranges, normal: Array) -> InswsnError:
    """Return the error of anchors in a plane, where nothing tells the side of it."""
    return InswsnError(
        f"The anchors lie in a plane, {named_plane(ranges, normal)}, and neither ranges nor motion "
        "tell on which side of it the tag is: give its height, height_m in recording.yaml, or put "
        "an anchor out of the plane."
    )


def with_height(fixes: Fixes, height: float) -> tuple[Fixes, Finding]:
    """Return fixes on a plane with a height, m, that is held, and what to say of it."""
    heights = np.where(np.isfinite(fixes.position).all(axis=1), height, np.nan)
    more = {
        name: np.column_stack([value, np.full(len(fixes), np.nan)])
        for name in ("velocity", "deviation")
        if (value := getattr(fixes, name)) is not None
    }
    says = (
        f"positions are on a plane, and the IMU moves in space: the height is held at {height:g} m "
        f"within {HELD:g} m, and how it moves up and down is not told"
    )
    found = replace(fixes, position=np.column_stack([fixes.position, heights]), **more)
    return found, Finding("height", "network", height, -np.inf, np.inf, None, says)


def fix_deviation(fixes: Fixes) -> float:
    """Return about how large the errors of fixes are, m: as they say of themselves, or look."""
    if fixes.deviation is not None and np.isfinite(fixes.deviation).any():
        return max(float(np.nanmedian(fixes.deviation[:, :2])), _LEAST)
    return roughness(fixes.position[:, :2])


def roughness(values: Array) -> float:
    """Return how large errors of values (rows, 2) that change steadily are.

    That is told by their second differences.
    """
    second = np.diff(values[np.isfinite(values).all(axis=1)], 2, axis=0)
    if not len(second):
        return 1.0
    return max(float(_OF_SECOND_DIFFERENCES * np.median(np.abs(second))), _LEAST)


def shares_of(fixes: Fixes) -> Array:
    """Return deviations of fixes by axis over the median one to the side, (rows, 3).

    Those that a fix does not say are as in the median, and twice as large upwards.
    """
    found = np.tile(UP, (len(fixes), 1))
    if fixes.deviation is not None and np.isfinite(fixes.deviation).any():
        said = fixes.deviation / fix_deviation(fixes)
        part = found[:, : said.shape[1]]
        part[:] = np.where(np.isfinite(said), np.maximum(said, _LEAST_SHARE), part)
    return found
