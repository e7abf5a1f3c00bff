"""Errors in numbers: over a window, and over runs."""

from __future__ import annotations

from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from inswsn_lib.errors import ParameterError

Array = NDArray[np.float64]

_FEWEST_CLUSTERS = 5


def mean_absolute_error(errors: ArrayLike) -> Array:
    """Return the mean of the absolute error over the steps: what the papers call mean error.

    Parameters
    ----------
    errors : array_like, (steps, components, runs)
        Steps that are NaN are left out.

    Returns
    -------
    ndarray, (components, runs)

    Examples
    --------
    >>> import numpy as np
    >>> from inswsn_lib.evaluation import mean_absolute_error
    >>> errors = np.array([3.0, -4.0, np.nan]).reshape(3, 1, 1)  # the last step has no fix
    >>> mean_absolute_error(errors).tolist()
    [[3.5]]
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

    Examples
    --------
    It weighs large errors more than the mean of the absolute error, which here is 4:

    >>> import numpy as np
    >>> from inswsn_lib.evaluation import root_mean_square_error
    >>> root_mean_square_error(np.array([1.0, -7.0]).reshape(2, 1, 1)).tolist()
    [[5.0]]
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

    Examples
    --------
    >>> import numpy as np
    >>> from inswsn_lib.evaluation import largest_error
    >>> largest_error(np.array([3.0, -4.0, np.nan]).reshape(3, 1, 1)).tolist()
    [[4.0]]
    """
    return np.asarray(np.nanmax(np.abs(np.asarray(errors, dtype=float)), axis=0))


class Spread(NamedTuple):
    """The median over runs and the interval that holds 95 % of them.

    Attributes
    ----------
    median, low, high : ndarray, (components,)
        low and high are the quantiles 2.5 % and 97.5 %.

    Examples
    --------
    It unpacks into median, low and high:

    >>> import numpy as np
    >>> from inswsn_lib.evaluation import spread
    >>> median, low, high = spread(np.arange(41.0)[None])  # one component, 41 runs
    >>> [float(x[0].round(6)) for x in (median, low, high)]
    [20.0, 1.0, 39.0]
    """

    median: Array
    low: Array
    high: Array


def spread(values: ArrayLike) -> Spread:
    """Return how a number of each run is spread over the runs.

    Parameters
    ----------
    values : array_like, (components, runs)

    Returns
    -------
    Spread
        Median and the quantiles 2.5 % and 97.5 %, each (components,), in the units of the values.

    Raises
    ------
    ParameterError
        If there are fewer than 40 runs: their 2.5 % quantile is not among them.

    Examples
    --------
    Of standard normal numbers 95 % are within 1.96 to either side of zero:

    >>> import numpy as np
    >>> from inswsn_lib.evaluation import spread
    >>> found = spread(np.random.default_rng(0).standard_normal((1, 200_000)))
    >>> print(f"{found.high[0]:.1f}, {-found.low[0]:.1f}")
    2.0, 2.0
    """
    array = np.asarray(values, dtype=float)
    if array.ndim != 2 or array.shape[1] < 40:
        raise ParameterError("values", f"of shape {array.shape}", "(components, 40 or more runs)")
    low, median, high = np.quantile(array, [0.025, 0.5, 0.975], axis=1)
    return Spread(median, low, high)


def cluster_interval(
    values: ArrayLike,
    clusters: ArrayLike,
    *,
    seed: int,
    statistic: Literal["mean", "median"] = "mean",
    resamples: int = 2000,
) -> tuple[float, float, float]:
    """Return the mean or median of values and a 95 % interval of it that knows of clusters.

    Values of one cluster, such as outages at one place, are not independent. The bootstrap draws
    whole clusters with replacement (Davison and Hinkley 1997, Section 3.8) and takes the 2.5 % and
    97.5 % quantiles of the statistic.

    Parameters
    ----------
    values : array_like, (n,)
    clusters : array_like, (n,)
        The cluster of each value.
    seed : int
        Of the draws.
    statistic : {"mean", "median"}
    resamples : int
        How many.

    Returns
    -------
    statistic, low, high : float

    Raises
    ------
    ParameterError
        If shapes do not fit, a value is not finite, or there are fewer than five clusters.

    Examples
    --------
    A hundred copies of each value are no new knowledge: the interval is that of the five values.

    >>> import numpy as np
    >>> from inswsn_lib.evaluation import cluster_interval
    >>> values = [1.0, 2.0, 3.0, 4.0, 5.0]
    >>> few = cluster_interval(values, range(5), seed=0)
    >>> many = cluster_interval(np.repeat(values, 100), np.repeat(range(5), 100), seed=0)
    >>> bool(np.allclose(few, many))
    True
    >>> [round(x, 2) for x in cluster_interval([2.0] * 10, [0, 1, 2, 3, 4] * 2, seed=0)]
    [2.0, 2.0, 2.0]
    """
    array, labels = np.asarray(values, dtype=float), np.asarray(clusters)
    if array.ndim != 1 or labels.shape != array.shape or not np.isfinite(array).all():
        raise ParameterError(
            "values", f"of shape {array.shape}", f"finite, (n,), with clusters {labels.shape}"
        )
    if statistic not in ("mean", "median"):
        raise ParameterError("statistic", statistic, "mean or median")
    if resamples < 1:
        raise ParameterError("resamples", resamples, "1 or more")
    names, which = np.unique(labels, return_inverse=True)
    if len(names) < _FEWEST_CLUSTERS:
        raise ParameterError("clusters", f"{len(names)} of them", f"{_FEWEST_CLUSTERS} or more")
    drawn = np.random.default_rng(seed).integers(len(names), size=(resamples, len(names)))
    if statistic == "mean":
        sums, counts = np.bincount(which, weights=array), np.bincount(which)
        found, whole = sums[drawn].sum(axis=1) / counts[drawn].sum(axis=1), float(array.mean())
    else:
        groups = [array[which == i] for i in range(len(names))]
        found = np.array([np.median(np.concatenate([groups[i] for i in row])) for row in drawn])
        whole = float(np.median(array))
    low, high = np.quantile(found, [0.025, 0.975])
    # the statistic itself lies within, but for a bootstrap that is very skew
    return whole, min(float(low), whole), max(float(high), whole)
