"""Errors in numbers: over a window, and over runs."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from inswsn_lib.errors import ParameterError

Array = NDArray[np.float64]


def mean_absolute_error(errors: ArrayLike) -> Array:
    """Return the mean of the absolute error over the steps: what the papers call mean error.

    Parameters
    ----------
    errors : array_like, (steps, components, runs)
        Steps that are NaN are left out.

    Returns
    -------
    ndarray, (components, runs)
    """
    return np.asarray(np.nanmean(np.abs(np.asarray(errors, dtype=float)), axis=0))


def root_mean_square_error(errors: ArrayLike) -> Array:
    """Return the root of the mean squared error over the steps.

    Parameters
    ----------
    errors : array_like, (steps, components, runs)
        Steps that are NaN are left out.

    Returns
    -------
    ndarray, (components, runs)
    """
    return np.asarray(np.sqrt(np.nanmean(np.square(np.asarray(errors, dtype=float)), axis=0)))


def largest_error(errors: ArrayLike) -> Array:
    """Return the largest absolute error over the steps.

    Parameters
    ----------
    errors : array_like, (steps, components, runs)
        Steps that are NaN are left out.

    Returns
    -------
    ndarray, (components, runs)
    """
    return np.asarray(np.nanmax(np.abs(np.asarray(errors, dtype=float)), axis=0))


class Spread(NamedTuple):
    """The median over runs and the interval that holds 95 % of them.

    Attributes
    ----------
    median, low, high : ndarray, (components,)
        low and high are the quantiles 2.5 % and 97.5 %.
    """

    median: Array
    low: Array
    high: Array


def spread(values: ArrayLike) -> Spread:
    """Return how a number of each run is spread over the runs.

    Parameters
    ----------
    values : array_like, (components, runs)

    Raises
    ------
    ParameterError
        If there are fewer than 40 runs: their 2.5 % quantile is not among them.
    """
    array = np.asarray(values, dtype=float)
    if array.ndim != 2 or array.shape[1] < 40:
        raise ParameterError("values", f"of shape {array.shape}", "(components, 40 or more runs)")
    low, median, high = np.quantile(array, [0.025, 0.5, 0.975], axis=1)
    return Spread(median, low, high)
