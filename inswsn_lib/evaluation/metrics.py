"""Errors in numbers: over a window, and over runs."""

from __future__ import annotations

from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from inswsn_lib.checks import Array, array, one_of, whole
from inswsn_lib.errors import Described, ParameterError

_FEWEST_RUNS, _FEWEST_CLUSTERS = 40, 5


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
    >>> import inswsn_lib as iw
    >>> iw.mean_absolute_error([[[3.0]], [[-4.0]], [[float("nan")]]]).tolist()
    [[3.5]]
    """
    return np.asarray(np.nanmean(np.abs(np.asarray(errors, dtype=float)), axis=0))


def root_mean_square_error(errors: ArrayLike) -> Array:
    """Return the root of the mean squared error over the steps; as `mean_absolute_error`.

    Examples
    --------
    It weighs large errors more than the mean of the absolute error, which here is 4:

    >>> import inswsn_lib as iw
    >>> iw.root_mean_square_error([[[1.0]], [[-7.0]]]).tolist()
    [[5.0]]
    """
    return np.asarray(np.sqrt(np.nanmean(np.square(np.asarray(errors, dtype=float)), axis=0)))


def largest_error(errors: ArrayLike) -> Array:
    """Return the largest absolute error over the steps; as `mean_absolute_error`.

    Examples
    --------
    >>> from inswsn_lib.evaluation import largest_error
    >>> largest_error([[[3.0]], [[-4.0]], [[float("nan")]]]).tolist()
    [[4.0]]
    """
    return np.asarray(np.nanmax(np.abs(np.asarray(errors, dtype=float)), axis=0))


class Spread(NamedTuple):
    """The median over runs and the quantiles 2.5 % and 97.5 %, each (components,)."""

    median: Array
    low: Array
    high: Array


def spread(values: ArrayLike) -> Spread:
    """Return median, low and high of values (components, runs): 95 % of the runs lie between.

    It takes 40 runs or more: of fewer, the 2.5 % quantile is not among them.

    Examples
    --------
    >>> import inswsn_lib as iw
    >>> [float(x[0].round(6)) for x in iw.spread([range(41)])]  # one component, 41 runs
    [20.0, 1.0, 39.0]
    """
    given = np.asarray(values, dtype=float)
    if given.ndim != 2 or given.shape[1] < _FEWEST_RUNS:
        may_be = f"(components, {_FEWEST_RUNS} or more runs)"
        raise ParameterError("values", Described(f"of shape {given.shape}"), may_be)
    low, median, high = np.quantile(given, [0.025, 0.5, 0.975], axis=1)
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
    values, clusters : array_like, (n,)
        The values and the cluster of each, of five clusters or more.
    seed : int
        Of the draws.
    statistic : {"mean", "median"}
    resamples : int

    Returns
    -------
    statistic, low, high : float

    Examples
    --------
    A hundred copies of each value are no new knowledge: the interval is that of the five values.

    >>> from inswsn_lib.evaluation import cluster_interval
    >>> few = cluster_interval([1, 2, 3, 4, 5], range(5), seed=0)
    >>> many = cluster_interval([1, 2, 3, 4, 5] * 100, [*range(5)] * 100, seed=0)
    >>> [round(x, 6) for x in few] == [round(x, 6) for x in many]
    True
    """
    given, labels = array("values", values, ("n",)), np.asarray(clusters)
    if labels.shape != given.shape:
        raise ParameterError("clusters", Described(f"of shape {labels.shape}"), f"{given.shape}")
    one_of("statistic", statistic, ("mean", "median"))
    whole("resamples", resamples, 1)
    names, which = np.unique(labels, return_inverse=True)
    if len(names) < _FEWEST_CLUSTERS:
        raise ParameterError("clusters", clusters, f"of {_FEWEST_CLUSTERS} kinds or more")
    drawn = np.random.default_rng(seed).integers(len(names), size=(resamples, len(names)))
    if statistic == "mean":
        sums, counts = np.bincount(which, weights=given), np.bincount(which)
        found, total = sums[drawn].sum(axis=1) / counts[drawn].sum(axis=1), float(given.mean())
    else:
        groups = [given[which == i] for i in range(len(names))]
        found = np.array([np.median(np.concatenate([groups[i] for i in row])) for row in drawn])
        total = float(np.median(given))
    low, high = np.quantile(found, [0.025, 0.975])
    # the statistic itself lies within, but for a bootstrap that is very skew
    return total, min(float(low), total), max(float(high), total)
