"""Whether a filter is consistent: innovations white and as large as it says, and its errors too."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from scipy.stats import chi2, norm

from inswsn_lib.checks import Array, Mask
from inswsn_lib.evaluation import autocorrelation, ljung_box
from inswsn_lib.recordings.estimates import BLOCK
from inswsn_lib.recordings.findings import FALSE_ALARM, Finding
from inswsn_lib.streams import Whole

_FEWEST = 30  # innovations, of all or of a series
_LAGS = 10
_OUTLIER, _MOST_OUTLIERS = 4.0, 0.01  # deviations; a share that is let pass


def check_innovations(squares: Array, scaled: Array, series: Whole) -> Iterator[Finding]:
    r"""Yield whether the innovations of a filter are as large as it says, and white.

    The mean of their normalised squares (NIS) over the number of components is held against
    quantiles of the chi-square distribution. Of each series, such as one axis, the autocorrelation
    of neighbours is held against :math:`z / \sqrt n`, and the first ten by Ljung and Box; of all
    series the worst is told, with bounds for that.

    Parameters
    ----------
    squares : ndarray, (components,)
        Normalised squares, whose sum has the chi-square distribution of as many degrees.
    scaled : ndarray, (components,)
        Innovations over the deviations that the filter expected, in the order of time.
    series : ndarray of int, (components,)
        Of which series each is.

    Examples
    --------
    >>> import numpy as np
    >>> from inswsn_lib.recordings import check_innovations
    >>> white = np.random.default_rng(1).normal(size=500)
    >>> for found in check_innovations(4 * white**2, 2 * white, np.zeros(500, dtype=int)):
    ...     print(found.name, found.fits)
    size False
    colour True
    whiteness True
    """
    count = len(squares)
    if count < _FEWEST:
        yield _untold("size", count)
        return
    mean = float(np.mean(squares))
    low, high = _mean_bounds(count)
    says = "the noise figures fit"
    if not low <= mean <= high:
        says = "the noise figures are too " + (
            "small, or the model is wrong" if mean > high else "large"
        )
    yield Finding("size", "innovations", mean, low, high, low <= mean <= high, says)
    every = [scaled[series == label] for label in np.unique(series)]
    every = [each for each in every if len(each) >= _FEWEST]
    if not every:
        yield _untold("colour", count)
        return
    yield max((_lag_one(each, len(every)) for each in every), key=_excess)
    yield max((_ljung_box(each, len(every)) for each in every), key=_excess)


def inside(values: list[Array], deviations: list[Array]) -> Mask:
    """Return which measurements lie within four deviations of what was expected, (measurements,).

    Parameters
    ----------
    values, deviations : list of ndarray
        Of the components of each, as of `Innovations`.
    """
    near = [
        bool((np.abs(value) <= _OUTLIER * each).all())
        for value, each in zip(values, deviations, strict=True)
    ]
    return np.array(near, dtype=bool)


def check_outliers(near: Mask) -> Finding:
    """Return whether few measurements are far from what was expected.

    Parameters
    ----------
    near : ndarray of bool, (measurements,)
        Which are `inside`.
    """
    share = 1 - float(np.mean(near)) if len(near) else 0.0
    fits = share <= _MOST_OUTLIERS
    says = f"{share:.1%} of them are more than four deviations off"
    return Finding("outliers", "innovations", share, 0.0, _MOST_OUTLIERS, fits, says)


def check_errors(squares: Array, degrees: int, period: float) -> Finding:
    """Return whether the errors of a filter are as large as it says (NEES).

    Errors of neighbouring steps hang together; those of 10 s are counted as one.

    Parameters
    ----------
    squares : ndarray, (steps,)
        Normalised squares of errors, over their degrees of freedom.
    degrees : int
        Of each.
    period : float
        Of the steps, s.

    Examples
    --------
    A filter that takes its errors for half of what they are:

    >>> import numpy as np
    >>> from inswsn_lib.recordings import check_errors
    >>> found = check_errors(np.full(500, 4.0), degrees=4, period=0.2)
    >>> found.fits, round(found.high, 2)
    (False, 1.9)
    """
    blocks = max(int(len(squares) * period / BLOCK), 1)
    mean = float(np.mean(squares))
    low, high = _mean_bounds(blocks * degrees)
    says = "errors are as large as the filter says"
    if not low <= mean <= high:
        says = f"errors are {np.sqrt(mean):.2g} times as large as the filter says"
    return Finding("errors", "filter and reference", mean, low, high, low <= mean <= high, says)


def _mean_bounds(count: int) -> tuple[float, float]:
    low, high = chi2.ppf([FALSE_ALARM / 2, 1 - FALSE_ALARM / 2], count) / count
    return float(low), float(high)


def _lag_one(values: Array, tests: int) -> Finding:
    bound = float(norm.isf(FALSE_ALARM / (2 * tests)) / np.sqrt(len(values)))
    [value] = autocorrelation(values, [1]).tolist()
    fits = abs(value) <= bound
    says = "neighbours are not correlated" if fits else (
        "neighbours are correlated: the filter leaves errors that it could know, or takes coloured "
        "ones for white"
    )  # fmt: skip
    return Finding("colour", "innovations", value, -bound, bound, fits, says)


def _ljung_box(values: Array, tests: int) -> Finding:
    value = ljung_box(values, _LAGS)
    bound = float(chi2.isf(FALSE_ALARM / tests, _LAGS))
    fits = value <= bound
    says = f"they are {'' if fits else 'not '}white over {_LAGS} lags (Ljung and Box)"
    return Finding("whiteness", "innovations", value, 0.0, bound, fits, says)


def _excess(found: Finding) -> float:
    return abs(found.value) / found.high


def _untold(name: str, count: int) -> Finding:
    says = (
        f"there are {count} of them{', too few' if name == 'size' else ', too few of each'} to tell"
    )
    return Finding(name, "innovations", np.nan, np.nan, np.nan, None, says)
