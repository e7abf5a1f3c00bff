"""Whether a filter is consistent, in words: the statistics are those of `evaluation`.

It needs numpy alone: the page on your own data calls it in a browser.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from inswsn_lib.checks import Array, Mask
from inswsn_lib.evaluation.consistency import (
    Statistic,
    colour,
    independent_count,
    mean_square,
    normalised_squares,
    whiteness,
)
from inswsn_lib.filters.kalman import KalmanDesign, design_kalman, run_kalman
from inswsn_lib.logs.findings import Finding, judged, unknown
from inswsn_lib.models import ErrorModel
from inswsn_lib.streams import Whole

_FEWEST = 30  # innovations
_MOST_OUTLIERS = 0.01  # a share that is let pass
_RIGHT = {
    "size": "the noise figures fit",
    "colour": "neighbours are not correlated",
    "whiteness": "they are white by the test of Ljung and Box",
    "errors": "errors are as large as the filter says",
}


@dataclass(frozen=True, eq=False)
class FilterRun:
    """A run of the Kalman filter over a recording, with what its innovations are judged by.

    `states` (steps, n) or (steps, n, runs) are after each measurement, in the units of the model,
    `innovations` (steps, m) or (steps, m, runs) NaN where missing. `design` has their covariances.
    """

    design: KalmanDesign
    states: Array
    innovations: Array

    @classmethod
    def of(cls, model: ErrorModel, y: Array, P0: Array) -> FilterRun:
        """Run it over y (steps, m) or (steps, m, runs), runs with one pattern, from zero and P0."""
        there = np.isfinite(y.reshape(*y.shape[:2], -1)[..., 0])
        design = design_kalman(model, there, initial_covariance=P0)
        states = run_kalman(model, y, initial_covariance=P0)
        ahead = run_kalman(model, y, initial_covariance=P0, predicted=True)
        return cls(design, states, y - np.moveaxis(np.moveaxis(ahead, 1, -1) @ model.C.T, -1, 1))

    @cached_property
    def nis(self) -> Array:
        """The normalised squares of innovations, (steps,) or (steps, runs)."""
        return normalised_squares(self.innovations, self.design.innovation)


def check_innovations(
    squares: Array, scaled: Array, series: Whole, spacing: int = 1
) -> Iterator[Finding]:
    """Yield whether the innovations of a filter are as large as it says (NIS), and white.

    Parameters
    ----------
    squares : ndarray, (components,)
        Normalised squares, whose sum has the chi-square distribution of as many degrees.
    scaled : ndarray, (components,)
        Innovations over the deviations that the filter expected, in the order of time. Of a series
        with gaps, as on a grid, those that are missing are NaN, in both.
    series : ndarray of int, (components,)
        Of which series each is, such as one axis.
    spacing : int
        How many values of a series neighbours are apart.

    Examples
    --------
    >>> import numpy as np
    >>> from inswsn_lib.logs import check_innovations
    >>> white = np.random.default_rng(1).normal(size=500)
    >>> for found in check_innovations(4 * white**2, 2 * white, np.zeros(500, dtype=int)):
    ...     print(found.name, found.fits)
    size False
    colour True
    whiteness True
    """
    there = squares[np.isfinite(squares)]
    if len(there) < _FEWEST:
        yield unknown("size", "innovations", f"there are {len(there)} of them, too few to tell")
        return
    size = mean_square(float(there.mean()), len(there))
    large = "small, or the model is wrong" if size.value > size.high else "large"
    yield _found("size", size, f"the noise figures are too {large}")
    every = [scaled[series == label] for label in np.unique(series)]
    says = (
        "neighbours are correlated: the filter leaves errors that it could know, or takes coloured "
        "ones for white"
    )
    yield _found("colour", colour(every, spacing), says)
    says = "they are not white by the test of Ljung and Box"
    yield _found("whiteness", whiteness(every, spacing), says)


def check_filter(innovations: Array, covariances: Array) -> list[Finding]:
    """Return what `check_innovations` finds in innovations on a grid of steps, with gaps.

    Neighbours are as far apart as fixes usually are.

    Parameters
    ----------
    innovations : ndarray, (steps, m)
        NaN where missing.
    covariances : ndarray, (steps, m, m)

    Examples
    --------
    >>> import numpy as np
    >>> from inswsn_lib.logs import check_filter
    >>> white = np.random.default_rng(1).normal(size=(500, 2))
    >>> size, colour, whiteness = check_filter(white, np.broadcast_to(np.eye(2), (500, 2, 2)))
    >>> size.fits, colour.fits, whiteness.fits
    (True, True, True)
    """
    steps, m = innovations.shape
    there = np.isfinite(innovations)
    counts = there.sum(axis=1)
    each = normalised_squares(innovations, covariances) / np.maximum(counts, 1)
    squares = np.where(there, each[:, None], np.nan)
    scaled = innovations / np.sqrt(np.diagonal(covariances, axis1=1, axis2=2))
    labels = np.tile(np.arange(m), steps)
    spacing = usual_spacing(counts > 0)
    return list(check_innovations(squares.ravel(), scaled.ravel(), labels, spacing))


def usual_spacing(there: Mask) -> int:
    """Return how many steps fixes are usually apart, by where they are (steps,)."""
    apart = np.diff(np.flatnonzero(there))
    return int(np.median(apart)) if len(apart) else 1


def say_noise(findings: Sequence[Finding]) -> str:
    """Return in words whether noise figures fit, by what `check_filter` found.

    Examples
    --------
    >>> from inswsn_lib.logs.filter_checks import say_noise
    >>> say_noise([])
    'they fit: innovations are as large as the filter says, and white'
    """
    wrong = [f"{each.name}: {each.says}" for each in findings if each.fits is False]
    if wrong:
        return f"they do not fit ({'; '.join(wrong)})"
    unknown = [each.name for each in findings if each.fits is None]
    if unknown:
        return f"nothing against them was found, but fixes are too few to tell {', '.join(unknown)}"
    return "they fit: innovations are as large as the filter says, and white"


def check_outliers(near: Mask) -> Finding:
    """Return whether few measurements are far, by which are within four deviations."""
    share = 1 - float(np.mean(near)) if len(near) else 0.0
    says = f"{share:.1%} of them are more than four deviations off"
    return judged("outliers", "innovations", share, 0.0, _MOST_OUTLIERS, says, says)


def check_nees(errors: Array, covariances: Array) -> Finding:
    """Return whether the errors of a filter are as large as it says (NEES).

    Parameters
    ----------
    errors : ndarray, (steps, n)
        In the order of time; NaN where missing.
    covariances : ndarray, (steps, n, n)
        What the filter says of them.

    Examples
    --------
    A filter that takes its errors for half of what they are:

    >>> import numpy as np
    >>> from inswsn_lib.logs import check_nees
    >>> errors = 2 * np.random.default_rng(1).normal(size=(500, 4))
    >>> found = check_nees(errors, np.broadcast_to(np.eye(4), (500, 4, 4)))
    >>> found.fits, found.says
    (False, 'errors are 2 times as large as the filter says')
    """
    n = errors.shape[1]
    scaled = errors / np.sqrt(np.diagonal(covariances, axis1=1, axis2=2))
    mean = float(np.nanmean(normalised_squares(errors, covariances))) / n
    independent = independent_count(scaled)
    says = f"errors are {np.sqrt(mean):.2g} times as large as the filter says"
    found = _found("errors", mean_square(mean, independent * n), says)
    if found.fits and independent == 1:
        return replace(found, fits=None, says="errors last too long to tell how large they are")
    return found


def _found(name: str, statistic: Statistic, wrong: str) -> Finding:
    says = wrong if statistic.fits is False else _RIGHT[name]
    if statistic.fits is None:
        says = "there are too few of each to tell"
    subject = "filter and reference" if name == "errors" else "innovations"
    return Finding(name, subject, *statistic, statistic.fits, says)
