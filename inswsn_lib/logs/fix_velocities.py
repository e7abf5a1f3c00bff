"""The velocity that the last few fixes tell."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from inswsn_lib.checks import Array, number, whole
from inswsn_lib.streams import Fixes

_SLACK = 2.0  # times what the fixes take if none is missing


def slope_velocity(fixes: Fixes, count: int = 5, *, longest: float | None = None) -> Fixes:
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
    longest : float, optional
        The longest time that they may take, s; by default twice as long as they take by the median
        step.

    Returns
    -------
    Fixes
        The velocity, m/s, is NaN where the fix is, where fewer fixes came before, or where they
        take too long.

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
    if longest is None:
        steps = np.diff(fixes.time)
        longest = _SLACK * (count - 1) * float(np.median(steps)) if steps.size else 0.0
    number("longest", longest, least=0)
    velocity = np.full(fixes.position.shape, np.nan)
    if len(there) >= count:
        times = sliding_window_view(fixes.time[there], count)
        places = sliding_window_view(fixes.position[there], count, axis=0)
        slope = _slopes(times, np.moveaxis(places, 1, 2))
        slope[times[:, -1] - times[:, 0] > longest] = np.nan
        velocity[there[count - 1 :]] = slope
    return replace(fixes, velocity=velocity)


def _slopes(times: Array, places: Array) -> Array:
    """Return the slopes (n, d) of lines through places (n, count, d) at times (n, count)."""
    apart = times - times.mean(axis=1, keepdims=True)
    return np.asarray(
        np.einsum("nc,ncd->nd", apart, places - places[:, :1]) / np.sum(apart**2, axis=1)[:, None]
    )
