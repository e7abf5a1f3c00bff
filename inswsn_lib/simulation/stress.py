"""What breaks the assumptions of a filter: heavy tails, coloured drift, lost fixes.

Each function takes errors as `Scene.simulate` draws them and returns a disturbed copy.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.signal import lfilter

from inswsn_lib.errors import ParameterError

Array = NDArray[np.float64]


def heavy_tailed(errors: Array, degrees: float, rng: np.random.Generator) -> Array:
    r"""Give Gaussian errors the tails of Student's t distribution.

    The errors of one step and run are multiplied by :math:`\sqrt{\nu / \chi^2_\nu}`. The middle of
    the distribution keeps its width, and the variance grows by :math:`\nu / (\nu - 2)`.

    Parameters
    ----------
    errors : ndarray, (steps, n, runs)
        Gaussian errors.
    degrees : float
        :math:`\nu`, above 2.
    rng : numpy.random.Generator
        The stream.

    Returns
    -------
    ndarray, (steps, n, runs)

    Raises
    ------
    ParameterError
        If `degrees` is not above 2, where the variance is infinite.
    """
    if not degrees > 2:
        raise ParameterError("degrees", degrees, "above 2")
    steps, _, runs = errors.shape
    return np.asarray(errors * np.sqrt(degrees / rng.chisquare(degrees, (steps, 1, runs))))


def drifting(
    errors: Array,
    period: float,
    rng: np.random.Generator,
    *,
    deviation: float,
    correlation_time: float,
) -> Array:
    r"""Add to the errors of an INS those of accelerations that wander.

    The acceleration error of each axis is a first-order Gauss-Markov process,
    :math:`a_{k+1} = \varphi a_k + \sigma \sqrt{1 - \varphi^2}\, n_k` with
    :math:`\varphi = e^{-T/\tau}`, integrated twice from the first step on.

    Parameters
    ----------
    errors : ndarray, (steps, 4, runs)
        Position (m) and velocity (m/s) errors.
    period : float
        T, s.
    rng : numpy.random.Generator
        The stream.
    deviation : float
        :math:`\sigma`, m/s^2.
    correlation_time : float
        :math:`\tau`, s.

    Returns
    -------
    ndarray, (steps, 4, runs)

    Raises
    ------
    ParameterError
        If the period or the correlation time is not positive, or the deviation negative.
    """
    for name, value in (("period", period), ("correlation_time", correlation_time)):
        if not value > 0:
            raise ParameterError(name, value, "positive")
    if not deviation >= 0:
        raise ParameterError("deviation", deviation, "not negative")
    steps, _, runs = errors.shape
    share = np.exp(-period / correlation_time)
    normal = rng.standard_normal((steps, 2, runs))
    normal[1:] *= np.sqrt(1 - share**2)  # the first one has the stationary variance
    acceleration = deviation * lfilter([1.0], [1.0, -share], normal, axis=0)
    added = np.zeros_like(errors)
    velocity = np.cumsum(period * acceleration[:-1], axis=0)
    added[1:, 2:] = velocity
    added[1:, :2] = np.cumsum(period * added[:-1, 2:] + period**2 / 2 * acceleration[:-1], axis=0)
    return np.asarray(errors + added)


def losing(errors: Array, share: float, rng: np.random.Generator) -> Array:
    """Lose fixes: all components of a step become NaN.

    Parameters
    ----------
    errors : ndarray, (steps, n, runs)
        Errors of fixes.
    share : float
        Of the fixes, each lost by itself.
    rng : numpy.random.Generator
        The stream.

    Returns
    -------
    ndarray, (steps, n, runs)

    Raises
    ------
    ParameterError
        If the share is not between 0 and 1.
    """
    if not 0 <= share <= 1:
        raise ParameterError("share", share, "between 0 and 1")
    steps, _, runs = errors.shape
    return np.where(rng.random((steps, 1, runs)) < share, np.nan, errors)
