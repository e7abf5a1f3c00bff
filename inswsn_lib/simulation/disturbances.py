"""What breaks the assumptions of a filter: drifts, heavy tails, lost fixes.

Errors are arrays (steps, components, runs), as `Scene.simulate` draws them.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from inswsn_lib.checks import Array, array, number


def drifting(
    errors: ArrayLike,
    period: float,
    rng: np.random.Generator,
    *,
    deviation: float,
    correlation_time: float,
) -> Array:
    r"""Add to the errors of an INS, (steps, 4, runs), those of accelerations that wander.

    The acceleration error of each axis is a first-order Gauss-Markov process,
    :math:`a_{k+1} = \varphi a_k + \sigma \sqrt{1 - \varphi^2}\, n_k` with
    :math:`\varphi = e^{-T/\tau}` (Brown and Hwang 2012, Section 4.6), integrated twice from the
    first step on: those of `coloured`.

    Parameters
    ----------
    errors : ndarray, (steps, 4, runs)
        Position (m) and velocity (m/s) errors.
    rng : numpy.random.Generator
    period, deviation, correlation_time : float
        T, s; :math:`\sigma`, m/s^2; :math:`\tau`, s.

    Examples
    --------
    One that hardly wanders is a bias: after the time t positions are off by t/2 times velocities.

    >>> import numpy as np
    >>> from inswsn_lib.simulation import drifting
    >>> rng = np.random.default_rng(0)
    >>> found = drifting(np.zeros((11, 4, 1)), 1.0, rng, deviation=0.1, correlation_time=1e12)
    >>> (found[10, :2] / found[10, 2:]).round(3).ravel().tolist()
    [5.0, 5.0]
    """
    number("period", period, above=0)
    number("correlation_time", correlation_time, above=0)
    number("deviation", deviation, least=0)
    given = array("errors", errors, ("steps", 4, "runs"), gaps=True)
    steps, _, runs = given.shape
    normal = rng.standard_normal((steps, 2, runs))
    acceleration = deviation * coloured(normal, period, correlation_time)
    added = np.zeros_like(given)
    velocity = np.cumsum(period * acceleration[:-1], axis=0)
    added[1:, 2:] = velocity
    added[1:, :2] = np.cumsum(period * added[:-1, 2:] + period**2 / 2 * acceleration[:-1], axis=0)
    return given + added


def coloured(errors: ArrayLike, period: float, correlation_time: float) -> Array:
    r"""Correlate white errors over time, by a first-order Gauss-Markov process.

    With :math:`w_k` the errors that are given and :math:`\varphi = e^{-T/\tau}`,

    .. math::
        e_0 = w_0, \qquad e_k = \varphi\, e_{k-1} + \sqrt{1 - \varphi^2}\, w_k ,

    so that :math:`e_k` has the variance of :math:`w_k`, where that is constant, and the
    autocorrelation :math:`\varphi^{|j|}` at lag j (Brown and Hwang 2012, Section 4.6). After a gap
    of g steps :math:`\varphi^{g+1}` stands in the place of :math:`\varphi`.

    Parameters
    ----------
    errors : array_like, (steps, n, runs)
        White; NaN where missing.
    period, correlation_time : float
        T and :math:`\tau`, s. With :math:`\tau = 0` the errors stay white.

    Returns
    -------
    ndarray, (steps, n, runs)

    Examples
    --------
    What a step adds is what the correlation leaves open; here it adds nothing, and 0.5 is left:

    >>> import numpy as np
    >>> from inswsn_lib.simulation import coloured
    >>> errors = coloured([[[1.0]], [[0.0]], [[0.0]]], period=1.0, correlation_time=1 / np.log(2))
    >>> errors.ravel().round(6).tolist()
    [1.0, 0.5, 0.25]
    """
    number("period", period, above=0)
    number("correlation_time", correlation_time, least=0)
    out = array("errors", errors, ("steps", "n", "runs"), gaps=True).copy()
    if correlation_time == 0:
        return out
    last, age = np.zeros_like(out[:1]), np.full_like(out[:1], np.inf)  # nothing was before
    for k in range(len(out)):
        share = np.exp(-age * period / correlation_time)
        out[k] = share[0] * last[0] + np.sqrt(1 - share[0] ** 2) * out[k]
        there = ~np.isnan(out[k : k + 1])
        last, age = np.where(there, out[k : k + 1], last), np.where(there, 1.0, age + 1)
    return out


def heavy_tailed(errors: ArrayLike, degrees: float, rng: np.random.Generator) -> Array:
    r"""Give Gaussian errors the tails of Student's t distribution.

    The errors of one step and run are multiplied by :math:`\sqrt{\nu / \chi^2_\nu}`, which makes
    them multivariate t (Kotz and Nadarajah 2004, Section 1.1). The variance grows by
    :math:`\nu / (\nu - 2)`, which is finite for :math:`\nu` above 2.

    Parameters
    ----------
    errors : array_like, (steps, n, runs)
    degrees : float
        :math:`\nu`.
    rng : numpy.random.Generator

    Examples
    --------
    >>> import numpy as np
    >>> from inswsn_lib.simulation import heavy_tailed
    >>> found = heavy_tailed(np.ones((1000, 2, 100)), 12, np.random.default_rng(0))
    >>> round(float(np.mean(found**2)), 1)  # 12 / 10
    1.2
    """
    number("degrees", degrees, above=2)
    given = array("errors", errors, ("steps", "n", "runs"), gaps=True)
    steps, _, runs = given.shape
    return np.asarray(given * np.sqrt(degrees / rng.chisquare(degrees, (steps, 1, runs))))


def losing(errors: ArrayLike, share: float, rng: np.random.Generator) -> Array:
    """Lose a share of fixes, each by itself: all components become NaN.

    Parameters
    ----------
    errors : array_like, (steps, n, runs)
        Of the fixes.
    share : float
        From 0 to 1.
    rng : numpy.random.Generator

    Examples
    --------
    >>> import numpy as np
    >>> from inswsn_lib.simulation import losing
    >>> lost = np.isnan(losing(np.zeros((1000, 2, 100)), 0.3, np.random.default_rng(0)))
    >>> round(float(lost.mean()), 1), bool((lost[:, 0] == lost[:, 1]).all())
    (0.3, True)
    """
    number("share", share, least=0, most=1)
    given = array("errors", errors, ("steps", "n", "runs"), gaps=True)
    steps, _, runs = given.shape
    return np.where(rng.random((steps, 1, runs)) < share, np.nan, given)
