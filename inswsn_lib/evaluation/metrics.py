"""Errors in numbers: over a window, and over runs."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from inswsn_lib.checks import Array, unmasked
from inswsn_lib.errors import Described, ParameterError

_FEWEST_RUNS = 40


def mean_absolute_error(errors: ArrayLike) -> Array:
    """Return the mean of the absolute error over the steps: what the papers call mean error.

    Parameters
    ----------
    errors : array_like, (steps, components) or (steps, components, runs)
        Steps that are NaN, or masked, are left out.

    Returns
    -------
    ndarray, (components,) or (components, runs)

    Examples
    --------
    >>> import inswsn_lib as iw
    >>> iw.mean_absolute_error([[3.0], [-4.0], [float("nan")]]).tolist()
    [3.5]
    """
    return np.asarray(np.nanmean(np.abs(np.asarray(unmasked(errors), dtype=float)), axis=0))


def root_mean_square_error(errors: ArrayLike) -> Array:
    """Return the root of the mean squared error over the steps; as `mean_absolute_error`.

    Examples
    --------
    It weighs large errors more than the mean of the absolute error, which here is 4:

    >>> import inswsn_lib as iw
    >>> iw.root_mean_square_error([[1.0], [-7.0]]).tolist()
    [5.0]
    """
    return np.asarray(
        np.sqrt(np.nanmean(np.square(np.asarray(unmasked(errors), dtype=float)), axis=0))
    )


def largest_error(errors: ArrayLike) -> Array:
    """Return the largest absolute error over the steps; as `mean_absolute_error`.

    Examples
    --------
    >>> from inswsn_lib.evaluation import largest_error
    >>> largest_error([[3.0], [-4.0], [float("nan")]]).tolist()
    [4.0]
    """
    return np.asarray(np.nanmax(np.abs(np.asarray(unmasked(errors), dtype=float)), axis=0))


class Spread(NamedTuple):
    """The median over runs and the quantiles 2.5 % and 97.5 %, each (components,)."""

    median: Array
    low: Array
    high: Array


def spread(values: ArrayLike) -> Spread:
    """Return median, low and high of values (components, runs): by 95 % one more lies between.

    They are quantiles at k / (runs + 1). It takes 40 runs or more: of fewer, the 2.5 % quantile is
    not among them.

    Examples
    --------
    >>> import inswsn_lib as iw
    >>> [float(x[0].round(6)) for x in iw.spread([range(41)])]  # one component, 41 runs
    [20.0, 0.05, 39.95]
    """
    given = np.asarray(unmasked(values), dtype=float)
    if given.ndim != 2 or given.shape[1] < _FEWEST_RUNS:
        must_be = f"of shape (components, {_FEWEST_RUNS} or more runs)"
        raise ParameterError("values", Described(f"of shape {given.shape}"), must_be)
    low, median, high = np.quantile(given, [0.025, 0.5, 0.975], axis=1, method="weibull")
    return Spread(median, low, high)
