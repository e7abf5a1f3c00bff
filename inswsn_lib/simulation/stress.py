"""What breaks the assumptions of a filter: heavy tails, coloured drift, lost fixes.

Each function takes errors as `Scene.simulate` draws them and returns a disturbed copy.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.signal import lfilter

from inswsn_lib.errors import ParameterError

Array = NDArray[np.float64]


def heavy_tailed(errors: ArrayLike, degrees: float, rng: np.random.Generator) -> Array:
    r"""Give Gaussian errors the tails of Student's t distribution.

    The errors of one step and run are multiplied by :math:`\sqrt{\nu / \chi^2_\nu}`, which makes
    them multivariate t (Kotz and Nadarajah 2004, Section 1.1). The middle of the distribution
    nearly keeps its width, and the variance grows by :math:`\nu / (\nu - 2)`.

    Parameters
    ----------
    errors : ndarray, (steps, n, runs)
        Gaussian errors, in any units.
    degrees : float
        :math:`\nu`, above 2 and finite.
    rng : numpy.random.Generator
        The stream.

    Returns
    -------
    ndarray, (steps, n, runs)

    Raises
    ------
    ParameterError
        If `degrees` is not above 2, where the variance is infinite, or not finite, or the errors
        have another shape.

    Examples
    --------
    One factor a step and run, whose square is :math:`\nu / (\nu - 2)` in the mean: 1.2 for twelve
    degrees of freedom.

    >>> import numpy as np
    >>> from inswsn_lib.simulation import heavy_tailed
    >>> found = heavy_tailed(np.ones((1000, 2, 100)), 12, np.random.default_rng(0))
    >>> bool((found[:, 0] == found[:, 1]).all()), round(float(np.mean(found**2)), 1)
    (True, 1.2)
    """
    if not 2 < degrees < np.inf:
        raise ParameterError("degrees", degrees, "above 2 and finite")
    given = _errors(errors)
    steps, _, runs = given.shape
    return np.asarray(given * np.sqrt(degrees / rng.chisquare(degrees, (steps, 1, runs))))


def drifting(
    errors: ArrayLike,
    period: float,
    rng: np.random.Generator,
    *,
    deviation: float,
    correlation_time: float,
) -> Array:
    r"""Add to the errors of an INS those of accelerations that wander.

    The acceleration error of each axis is a first-order Gauss-Markov process,
    :math:`a_{k+1} = \varphi a_k + \sigma \sqrt{1 - \varphi^2}\, n_k` with
    :math:`\varphi = e^{-T/\tau}` (Brown and Hwang 2012, Section 4.6), integrated twice from the
    first step on.

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
        If the period or the correlation time is not positive, the deviation is negative, one of
        them is not finite, or the errors have another shape.

    Examples
    --------
    An acceleration that wanders much more slowly than the run is long is a bias: after the time t
    the position is off by t/2 times what the velocity is off by.

    >>> import numpy as np
    >>> from inswsn_lib.simulation import drifting
    >>> rng = np.random.default_rng(0)
    >>> found = drifting(np.zeros((11, 4, 1)), 1.0, rng, deviation=0.1, correlation_time=1e12)
    >>> (found[10, :2] / found[10, 2:]).round(3).ravel().tolist()
    [5.0, 5.0]
    """
    for name, value in (("period", period), ("correlation_time", correlation_time)):
        if not 0 < value < np.inf:
            raise ParameterError(name, value, "positive and finite")
    if not 0 <= deviation < np.inf:
        raise ParameterError("deviation", deviation, "finite and not negative")
    given = _errors(errors, components=4)
    steps, _, runs = given.shape
    share = np.exp(-period / correlation_time)
    normal = rng.standard_normal((steps, 2, runs))
    normal[1:] *= np.sqrt(1 - share**2)  # the first one has the stationary variance
    acceleration = deviation * lfilter([1.0], [1.0, -share], normal, axis=0)
    added = np.zeros_like(given)
    velocity = np.cumsum(period * acceleration[:-1], axis=0)
    added[1:, 2:] = velocity
    added[1:, :2] = np.cumsum(period * added[:-1, 2:] + period**2 / 2 * acceleration[:-1], axis=0)
    return given + added


def losing(errors: ArrayLike, share: float, rng: np.random.Generator) -> Array:
    """Lose fixes: all components of a step become NaN.

    Parameters
    ----------
    errors : ndarray, (steps, n, runs)
        Errors of fixes, in any units.
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
        If the share is not between 0 and 1, or the errors have another shape.

    Examples
    --------
    >>> import numpy as np
    >>> from inswsn_lib.simulation import losing
    >>> found = losing(np.zeros((1000, 2, 100)), 0.3, np.random.default_rng(0))
    >>> lost = np.isnan(found)
    >>> round(float(lost.mean()), 1), bool((lost[:, 0] == lost[:, 1]).all())
    (0.3, True)
    """
    if not 0 <= share <= 1:
        raise ParameterError("share", share, "between 0 and 1")
    given = _errors(errors)
    steps, _, runs = given.shape
    return np.where(rng.random((steps, 1, runs)) < share, np.nan, given)


def _errors(errors: ArrayLike, components: int | None = None) -> Array:
    """Return errors as floats, (steps, components, runs); refuse another shape."""
    given = np.asarray(errors, dtype=float)
    if given.ndim != 3 or components not in (None, given.shape[1]):
        raise ParameterError(
            "errors", f"of shape {given.shape}", f"(steps, {components or 'components'}, runs)"
        )
    return given
