"""Whether errors are as large as a filter says: normalised squares and their chi-square bounds."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.stats import chi2

from inswsn_lib.errors import ParameterError

Array = NDArray[np.float64]


def normalised_squares(errors: ArrayLike, covariances: ArrayLike) -> Array:
    r"""Return :math:`\epsilon_k' S_k^{-1} \epsilon_k`: NEES of state errors, NIS of innovations.

    Parameters
    ----------
    errors : array_like, (steps, n, runs)
        Errors or innovations; NaN where a component is missing.
    covariances : array_like, (n, n), (steps, n, n) or (steps, n, n, runs)
        What the filter says of them; positive definite.

    Returns
    -------
    ndarray, (steps, runs)
        Over the components that are there; NaN where none is. If the errors are Gaussian with
        these covariances, each has a chi-square distribution with as many degrees of freedom as
        components (Bar-Shalom, Li and Kirubarajan 2001, Section 5.4).

    Raises
    ------
    ParameterError
        If shapes do not fit or a covariance is not positive definite.

    Examples
    --------
    An error of three and four, where the filter says five each, is as large as expected of two
    components together: its square is 1, the mean of a chi-square distribution is 2.

    >>> import numpy as np
    >>> from inswsn_lib.evaluation import normalised_squares
    >>> errors = np.array([[[3.0], [4.0]], [[3.0], [np.nan]]])  # two steps, two components, one run
    >>> print(normalised_squares(errors, 25 * np.eye(2)).round(2).ravel())
    [1.   0.36]
    """
    e = np.asarray(errors, dtype=float)
    S = np.asarray(covariances, dtype=float)
    if e.ndim == 3 and S.shape == (e.shape[0], e.shape[1], *e.shape[1:]):
        # each run has covariances of its own: every step of every run is a step of one run
        steps, n, runs = e.shape
        single = np.moveaxis(e, 2, 1).reshape(-1, n, 1)
        own = np.moveaxis(S, 3, 1).reshape(-1, n, n)
        return normalised_squares(single, own).reshape(steps, runs)
    if e.ndim != 3 or S.shape not in ((e.shape[1],) * 2, (e.shape[0], e.shape[1], e.shape[1])):
        raise ParameterError(
            "errors and covariances",
            (e.shape, S.shape),
            "(steps, n, runs) and (n, n), (steps, n, n) or (steps, n, n, runs)",
        )
    whole = np.broadcast_to(S, (e.shape[0], *S.shape[-2:]))
    squares = np.full((e.shape[0], e.shape[2]), np.nan)
    there = ~np.isnan(e)
    for pattern in np.unique(np.moveaxis(there, 1, 2).reshape(-1, e.shape[1]), axis=0):
        if pattern.any():
            chosen = (there == pattern[:, None]).all(axis=1)
            part = _whole_squares(e[:, pattern], whole[:, pattern][:, :, pattern])
            squares[chosen] = part[chosen]
    return squares


def _whole_squares(e: Array, S: Array) -> Array:
    try:
        factors = np.linalg.cholesky(S)
    except np.linalg.LinAlgError:
        raise ParameterError("covariances", "not positive definite", "positive definite") from None
    return np.asarray(np.square(np.linalg.solve(factors, e)).sum(axis=1))


def mean_bounds(count: int, degrees: int, probability: float = 0.95) -> tuple[float, float]:
    """Return the interval that holds the mean of normalised squares with a probability.

    Parameters
    ----------
    count : int
        How many independent squares are averaged.
    degrees : int
        Degrees of freedom of each: the number of components.
    probability : float
        Of the interval, equal tails.

    Returns
    -------
    low, high : float
        Quantiles of the chi-square distribution with count times degrees degrees of freedom, over
        the count (Bar-Shalom, Li and Kirubarajan 2001, Section 5.4).

    Raises
    ------
    ParameterError
        If a number is not positive, or the probability not between 0 and 1.

    Examples
    --------
    One square of one component is a squared standard normal number, so that its bounds are squares
    of that number's quantiles; the more squares are averaged, the nearer the bounds come to their
    mean.

    >>> from inswsn_lib.evaluation import mean_bounds
    >>> print("{:.3f} {:.3f}".format(*mean_bounds(1, 1)))
    0.001 5.024
    >>> print("{:.2f} {:.2f}".format(*mean_bounds(10_000, 4)))
    3.94 4.06
    """
    for name, number in (("count", count), ("degrees", degrees)):
        if number < 1:
            raise ParameterError(name, number, "1 or more")
    if not 0 < probability < 1:
        raise ParameterError("probability", probability, "between 0 and 1")
    tail = (1 - probability) / 2
    low, high = chi2.ppf([tail, 1 - tail], count * degrees) / count
    return float(low), float(high)
