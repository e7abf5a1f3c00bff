"""Noise figures and errors: those that fit, and whether errors are as large as a filter says."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from inswsn_lib.checks import Array, Mask, array, number, of_runs, whole
from inswsn_lib.errors import Described, ParameterError

_BITS = 30  # components of a pattern that a number takes in at once


class NoiseFit(NamedTuple):
    """Second moments of simulated errors, from `fit_noise`.

    Attributes
    ----------
    process : ndarray, (n, n)
        Q, of the residual of the model in a step.
    measurement : ndarray, (m, m)
        R, of the errors of the measurements.
    initial : ndarray, (n, n)
        P_0, of the state at the first step.

    Examples
    --------
    >>> from inswsn_lib.evaluation import NoiseFit
    >>> Q, R, P0 = NoiseFit(process=[[1.0]], measurement=[[4.0]], initial=[[0.0]])
    >>> R
    [[4.0]]
    """

    process: Array
    measurement: Array
    initial: Array


def fit_noise(A: ArrayLike, states: ArrayLike, measurement_errors: ArrayLike) -> NoiseFit:
    r"""Return the noise figures that a Kalman filter needs, from errors that a simulation knows.

    .. math::
        Q = \overline{w_k w_k'}, \; w_k = x_{k+1} - A x_k, \qquad R = \overline{v_k v_k'},
        \qquad P_0 = \overline{x_0 x_0'}

    with means over steps and runs: the sample version of what Q, R and P_0 stand for (Bar-Shalom,
    Li and Kirubarajan 2001, Section 5.2). They are moments about zero: a filter that assumes noise
    of zero mean has to take a mean for noise. Noise that is coloured is taken for white.

    Parameters
    ----------
    A : array_like, (n, n)
        Transition of the state.
    states : array_like, (steps, n) or (steps, n, runs)
        The true states; two steps or more, in the units of the model.
    measurement_errors : array_like, (steps, m) or (steps, m, runs)
        The true errors of the measurements; NaN where missing, complete at some step.

    Examples
    --------
    A state that takes steps of one to either side, from zero, and measurements that are off by two:

    >>> import inswsn_lib as iw
    >>> states = [[0.0], [1.0], [0.0], [-1.0], [0.0]]
    >>> Q, R, P0 = iw.fit_noise([[1.0]], states, [[2.0]] * 5)
    >>> Q.tolist(), R.tolist(), P0.tolist()
    ([[1.0]], [[4.0]], [[0.0]])
    """
    x, _ = of_runs("states", states, "steps", "n", "runs")
    steps, n, runs = x.shape
    if steps < 2 or not x.size:
        raise ParameterError("states", Described(f"of shape {x.shape}"), "two or more steps long")
    transition = array("A", A, (n, n))
    v, _ = of_runs("measurement_errors", measurement_errors, steps, "m", runs, gaps=True)
    columns = np.moveaxis(v, 1, 0).reshape(v.shape[1], -1)
    columns = columns[:, ~np.isnan(columns).any(axis=0)]
    if columns.shape[1] == 0:
        raise ParameterError("measurement_errors", Described("at none"), "complete at some step")
    left = np.moveaxis(x[1:] - transition @ x[:-1], 1, 0).reshape(n, -1)
    return NoiseFit(_moment(left), _moment(columns), _moment(x[0]))


def _moment(columns: Array) -> Array:
    return np.asarray(columns @ columns.T / columns.shape[1])


def normalised_squares(errors: ArrayLike, covariances: ArrayLike) -> Array:
    r"""Return :math:`\epsilon_k' S_k^{-1} \epsilon_k`: NEES of state errors, NIS of innovations.

    Parameters
    ----------
    errors : array_like, (steps, n) or (steps, n, runs)
        Errors or innovations; NaN where a component is missing.
    covariances : array_like, (n, n), (steps, n, n) or (steps, n, n, runs)
        What the filter says of them; positive definite.

    Returns
    -------
    ndarray, (steps,) or (steps, runs)
        Over the components that are there; NaN where none is. If the errors are Gaussian with
        these covariances, each has a chi-square distribution with as many degrees of freedom as
        components (Bar-Shalom, Li and Kirubarajan 2001, Section 5.4).

    Examples
    --------
    An error of three and four, where the filter says a deviation of five for each:

    >>> import inswsn_lib as iw
    >>> iw.normalised_squares([[3.0, 4.0]], [[25.0, 0.0], [0.0, 25.0]]).round(9).tolist()
    [1.0]
    """
    e, back = of_runs("errors", errors, "steps", "n", "runs", gaps=True)
    steps, n, runs = e.shape
    S = array("covariances", covariances, (n, n), (steps, n, n), (steps, n, n, runs))
    if S.ndim == 4:
        # each run has covariances of its own: every step of every run is a step of one run
        single = np.moveaxis(e, 2, 1).reshape(-1, n, 1)
        own = np.moveaxis(S, 3, 1).reshape(-1, n, n)
        return back(normalised_squares(single, own).reshape(steps, runs))
    S = np.broadcast_to(S, (steps, n, n))
    squares = np.full((steps, runs), np.nan)
    there = ~np.isnan(e)
    codes = _pattern_codes(there)
    _, places = np.unique(codes, return_index=True)
    for step, run in zip(*np.unravel_index(places, codes.shape), strict=True):
        pattern, chosen = there[step, :, run], codes == codes[step, run]
        if pattern.any():
            whitened = np.linalg.solve(_factors(S[:, pattern][:, :, pattern]), e[:, pattern])
            squares[chosen] = np.square(whitened).sum(axis=1)[chosen]
    return back(squares)


def _pattern_codes(there: Mask) -> NDArray[np.int64]:
    """Return a number (steps, runs) for each pattern in a mask (steps, n, runs)."""
    codes = np.zeros((there.shape[0], there.shape[2]), dtype=np.int64)
    for component in range(there.shape[1]):
        codes = 2 * codes + there[:, component]
        if component % _BITS == _BITS - 1:  # before they overflow, patterns are numbered anew
            codes = np.unique(codes, return_inverse=True)[1].reshape(codes.shape)
    return codes


def _factors(covariances: Array) -> Array:
    try:
        return np.asarray(np.linalg.cholesky(covariances))
    except np.linalg.LinAlgError:
        given = Described("singular or indefinite")
        raise ParameterError("covariances", given, "positive definite") from None


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

    Examples
    --------
    The more squares are averaged, the nearer the bounds come to their mean:

    >>> import inswsn_lib as iw
    >>> print("{:.2f} {:.2f}".format(*iw.mean_bounds(10_000, 4)))
    3.94 4.06
    """
    from scipy.stats import chi2  # noqa: PLC0415  # a page of the book has numpy alone

    whole("count", count, 1)
    whole("degrees", degrees, 1)
    tail = (1 - number("probability", probability, above=0, below=1)) / 2
    low, high = chi2.ppf([tail, 1 - tail], count * degrees) / count
    return float(low), float(high)


def autocorrelation(values: ArrayLike, lags: ArrayLike) -> Array:
    r"""Return the autocorrelation of series about zero at some lags, (lags, ...).

    .. math::
        \rho_k = \overline{x_t x_{t+k}} \,/\, \overline{x_t^2}

    with means over what is there (Box, Jenkins, Reinsel and Ljung 2016, Section 2.1).

    Parameters
    ----------
    values : array_like, (n, ...)
        NaN where missing.
    lags : array_like of int, (lags,)
        From 0 to less than n. NaN is returned where no two values are so far apart.

    Examples
    --------
    >>> from inswsn_lib.evaluation import autocorrelation
    >>> autocorrelation([1.0, -1.0, 1.0, -1.0], [0, 1, 2]).tolist()
    [1.0, -1.0, 1.0]
    """
    x = np.asarray(values, dtype=float)
    x = x.reshape(len(x), -1)
    found = [_mean(x[lag:] * x[: len(x) - lag]) for lag in np.asarray(lags).tolist()]
    shape = (len(found), *np.shape(values)[1:])
    return np.asarray(np.array(found) / _mean(np.square(x))).reshape(shape)


def _mean(columns: Array) -> Array:
    """Return the means of what is there, NaN of nothing."""
    there = np.isfinite(columns)
    count: Array = there.sum(axis=0).astype(float)
    count[count == 0] = np.nan
    return np.asarray(np.where(there, columns, 0.0).sum(axis=0) / count)


def ljung_box(values: ArrayLike, lags: int = 10) -> float:
    r"""Return the statistic of Ljung and Box (Biometrika 65(2), 1978) of a series about zero.

    .. math:: Q = n (n + 2) \sum_{k=1}^{m} r_k^2 / (n - k), \qquad r_k = (1 - k / n)\, \rho_k ,

    which has the chi-square distribution with m degrees of freedom if the series is white.

    Parameters
    ----------
    values : array_like, (n,)
    lags : int
        m.

    Examples
    --------
    >>> import numpy as np
    >>> from inswsn_lib.evaluation import ljung_box
    >>> white = np.random.default_rng(0).normal(size=1000)
    >>> print(f"{ljung_box(white):.0f} and {ljung_box(np.cumsum(white)):.0f}")
    6 and 9391
    """
    n, k = len(np.asarray(values)), np.arange(1, lags + 1)
    r = (1 - k / n) * autocorrelation(values, k)
    return float(n * (n + 2) * np.sum(r**2 / (n - k)))
