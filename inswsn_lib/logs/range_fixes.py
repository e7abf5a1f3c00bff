"""Positions from the ranges of each short interval of a recording, and how accurate they are."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from inswsn_lib.checks import Array, array, number
from inswsn_lib.errors import InswsnError, ParameterError
from inswsn_lib.logs.window_fits import (
    WindowFit,
    WindowRanges,
    fit_windows,
    mean_times,
    window_ranges,
    window_rows,
)
from inswsn_lib.simulation.position_search import squares
from inswsn_lib.streams import Fixes, Ranges


def multilaterate_track(
    ranges: Ranges,
    period: float = 0.2,
    *,
    window: float | None = None,
    bias: ArrayLike | None = None,
    height: float | None = None,
    side: float = 0.0,
    robust: bool = True,
) -> Fixes:
    r"""Return a fix for each interval, from the ranges of that interval alone.

    With :math:`e_i = r_i - b_i - |p - a_i|`, a fix minimises

    .. math:: \sum_i 2 c^2 \left(\sqrt{1 + (e_i / c)^2} - 1\right),

    the loss that is called soft-l1, quadratic near zero and linear far away (Charbonnier and others
    1997; ``loss="soft_l1"`` of `scipy.optimize.least_squares`), else :math:`\sum_i e_i^2`. The
    scale c is the deviation of the residuals of the whole recording, from their median absolute
    value; where errors are normal, this loss wastes 7 % of the information. All intervals are
    solved at once by Levenberg and Marquardt's method (Marquardt 1963), from the solution of the
    linear problem that differences of squared ranges pose.

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
    window : float, optional
        How far back from the end of its interval a fix takes ranges, s; `period` by default. A
        longer one makes fixes that hang together and are late by half of it if the tag moves.
    bias : array_like, (N,), optional
        What each anchor's ranges have too much, m.
    height : float, optional
        Of the tag, m, if it is known: fixes are then horizontal, from anchors in three dimensions.
    side : float
        On which side of anchors that lie in a plane (in two dimensions, on a line) the tag is: 1
        where the largest component of the normal is positive, such as above a ceiling, -1 below, 0
        if that is not known. Where they lie almost in a plane, the ranges come first.
    robust : bool
        Whether the loss is soft-l1, or least squares.

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
    window = period if window is None else number("window", window, least=period)
    sound = np.isfinite(ranges.distance)
    if not sound.any():
        raise InswsnError("There is no range to make fixes of.")
    if not sound.all():
        ranges = ranges.kept(sound)
    d, level = _dimensions(ranges, height)
    each = (
        np.zeros(len(ranges.anchors))
        if bias is None
        else array("bias", bias, (len(ranges.anchors),))
    )
    which, first = window_rows(ranges.time, period, window)
    rows = window_ranges(ranges, which, first, each, d, level)
    fit = fit_windows(rows, robust=robust, side=number("side", side, least=-1, most=1))
    position = np.where(fit.bad[:, None], np.nan, fit.position)
    return Fixes(time=mean_times(rows), position=position, deviation=_deviations(rows, fit))


def _dimensions(ranges: Ranges, height: float | None) -> tuple[int, float | None]:
    """Return how many coordinates a fix has, and the height that is given."""
    d = ranges.anchors.shape[1]
    if height is None:
        return d, None
    if d == 2:
        raise ParameterError("height", height, "left out for anchors in two dimensions")
    return 2, number("height", height)


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
