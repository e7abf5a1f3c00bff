"""Whether a filter is consistent, and noise figures that fit: with numpy alone, as a page has it.

A filter is consistent if its innovations are white and as large as it says (NIS), and its errors
are as large as it says (NEES). What each statistic may be is by one level, `FALSE_ALARM`.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import cache
from statistics import NormalDist
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from inswsn_lib.checks import Array, Mask, array, number, of_runs, whole
from inswsn_lib.errors import Described, ParameterError

#: How often a check fails by chance where all is right. A recording has some twenty checks: at
#: 1e-3 one right recording in fifty is called wrong, at 5 % two in three would be.
FALSE_ALARM = 1e-3

#: Values of which more tell what is too small to matter: what 5,000 cannot tell from consistent, a
#: variance off by 7 % or an autocorrelation of 0.05, is called so, however long a recording is
_TELL = 5000
_BITS = 30  # components of a pattern that a number takes in at once
_FEWEST_PAIRS = 30  # of neighbours
_PER_LAG = 60  # values; with fewer the statistic of Ljung and Box has a heavier tail than it should
_MOST_LAGS = 10
_FEWEST_INDEPENDENT = 5  # errors; of fewer the correlation cannot be told


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


def log_likelihoods(errors: ArrayLike, covariances: ArrayLike) -> Array:
    r"""Return the logarithm of the Gaussian density of errors, as of the innovations of a filter.

    .. math:: -\tfrac12 \left(\epsilon_k' S_k^{-1} \epsilon_k + \ln \det 2 \pi S_k\right)

    Their sum over innovations is the log-likelihood of what the filter assumes (Bar-Shalom, Li and
    Kirubarajan 2001, Section 5.4).

    Parameters
    ----------
    errors, covariances
        As of `normalised_squares`, whose errors it raises.

    Returns
    -------
    ndarray, (steps,) or (steps, runs)
        Of densities in the inverse units of the components that are there; NaN where none is.

    Examples
    --------
    >>> from inswsn_lib.evaluation import log_likelihoods
    >>> log_likelihoods([[0.0], [3.0]], [[9.0]]).round(3).tolist()
    [-2.018, -2.518]
    """
    squares, S = normalised_squares(errors, covariances), np.asarray(covariances, dtype=float)
    e, back = of_runs("errors", errors, "steps", "n", "runs", gaps=True)
    there = ~np.isnan(np.swapaxes(e, 1, 2))
    S = np.moveaxis(S, 3, 1) if S.ndim == 4 else S[..., None, :, :]
    both = there[..., :, None] & there[..., None, :]
    sizes = np.linalg.slogdet(np.where(both, 2 * np.pi * S, np.eye(e.shape[1])))[1]
    return np.asarray(-0.5 * (squares + back(sizes)))


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


def mean_bounds(count: float, degrees: int, probability: float = 0.95) -> tuple[float, float]:
    """Return the interval that holds the mean of normalised squares with a probability.

    Parameters
    ----------
    count : float
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
    number("count", count, above=0)
    whole("degrees", degrees, 1)
    tail = (1 - number("probability", probability, above=0, below=1)) / 2
    low, high = (chi_square(level, count * degrees) / count for level in (tail, 1 - tail))
    return low, high


@cache
def chi_square(level: float, degrees: float) -> float:
    """Return a quantile of the chi-square distribution, by halving an interval that holds it.

    `level` is the probability of less, `degrees` those of freedom.

    The distribution function is the power series of the incomplete gamma function (Abramowitz and
    Stegun 1964, 6.5.29).
    """
    half = degrees / 2
    low, high = 0.0, half + 8 * math.sqrt(half) + 40
    terms = half + np.arange(1.0, 26 * math.sqrt(half) + 180)
    while low < (x := (low + high) / 2) < high:
        first = math.exp(half * math.log(x) - x - math.lgamma(half + 1))
        below = first * (1 + float(np.cumprod(x / terms).sum())) < level
        low, high = (x, high) if below else (low, x)
    return low + high


class Statistic(NamedTuple):
    """A statistic of a consistent filter, and between what it is but for one time in a thousand.

    Attributes
    ----------
    value, low, high : float
        Bounds are NaN where there is too little to tell.

    Examples
    --------
    >>> from inswsn_lib.evaluation import Statistic
    >>> Statistic(4.0, 0.9, 1.1).fits, Statistic(1.0, 0.9, 1.1).fits
    (False, True)
    """

    value: float
    low: float
    high: float

    @property
    def fits(self) -> bool | None:
        """Whether the value is between; None where there is too little to tell."""
        return None if math.isnan(self.low) else self.low <= self.value <= self.high


_UNTOLD = Statistic(math.nan, math.nan, math.nan)


def mean_square(mean: float, degrees: float) -> Statistic:
    """Return the mean of normalised squares over their degrees of freedom: NIS or NEES.

    Parameters
    ----------
    mean : float
        1 of a consistent filter.
    degrees : float
        Of freedom of all squares together, of such as are independent of one another.

    Examples
    --------
    >>> from inswsn_lib.evaluation import mean_square
    >>> print("{:.2f} {:.2f} {:.2f}".format(*mean_square(1.1, 1000)))
    1.10 0.86 1.15
    """
    count = min(float(degrees), float(_TELL))
    return Statistic(float(mean), *mean_bounds(count, 1, 1 - FALSE_ALARM))


def colour(innovations: Sequence[ArrayLike], spacing: int = 1) -> Statistic:
    r"""Return the largest autocorrelation of neighbouring innovations of any series.

    Of n pairs it has the deviation :math:`1 / \sqrt n` if the series is white (Box, Jenkins,
    Reinsel and Ljung 2016, Section 2.1). The bound is that of the worst of all series.

    Parameters
    ----------
    innovations : sequence of array_like, (n,)
        Each a series over its deviations, NaN where missing. Those with fewer than 30 pairs are
        left out.
    spacing : int
        How many steps neighbours are apart.

    Examples
    --------
    >>> import numpy as np
    >>> from inswsn_lib.evaluation import colour
    >>> white = np.random.default_rng(0).normal(size=1000)
    >>> colour([white]).fits, colour([np.cumsum(white)]).fits
    (True, False)
    """
    series = _of_enough(innovations, spacing, _FEWEST_PAIRS)
    found = [_UNTOLD]
    for x in series:
        z = -NormalDist().inv_cdf(FALSE_ALARM / (2 * len(series)))
        bound = z / math.sqrt(min(_pairs(x, spacing), _TELL))
        found.append(Statistic(float(autocorrelation(x, [spacing])[0]), -bound, bound))
    return max(found, key=_excess)


def whiteness(innovations: Sequence[ArrayLike], spacing: int = 1) -> Statistic:
    """Return the statistic of Ljung and Box over up to ten lags, of the worst series.

    Parameters
    ----------
    innovations, spacing
        As of `colour`. There is one lag for each 60 values, lest the tail of the statistic is
        heavier than that of the chi-square distribution; shorter series are left out.

    Examples
    --------
    >>> import numpy as np
    >>> from inswsn_lib.evaluation import whiteness
    >>> white = np.random.default_rng(0).normal(size=1000)
    >>> whiteness([white]).fits, whiteness([white[5:] + white[:-5]]).fits
    (True, False)
    """
    series = _of_enough(innovations, spacing, _PER_LAG)
    found = [_UNTOLD]
    for x in series:
        lags = min(_MOST_LAGS, _pairs(x, spacing) // _PER_LAG)
        bound = chi_square(1 - FALSE_ALARM / len(series), lags)
        bound *= max(1.0, _pairs(x, spacing) / _TELL)
        found.append(Statistic(ljung_box(x, lags, spacing), 0.0, bound))
    return max(found, key=_excess)


def _of_enough(innovations: Sequence[ArrayLike], spacing: int, pairs: int) -> list[Array]:
    """Return the series that have so many pairs, and are not zero throughout."""
    series = [np.asarray(x, dtype=float) for x in innovations]
    return [x for x in series if _pairs(x, spacing) >= pairs and np.nan_to_num(x).any()]


def _excess(found: Statistic) -> float:
    return -1.0 if found.fits is None else abs(found.value) / found.high


def _pairs(values: Array, lag: int) -> int:
    there = np.isfinite(values)
    return int(np.sum(there[lag:] & there[: len(there) - lag]))


def independent_count(errors: ArrayLike) -> float:
    """Return how many independent errors would tell as much; 1 where it is less than five.

    They are counted by blocks that are longer than errors are correlated: as long as the first lag,
    to a fifth, at which the autocorrelation about zero, the mean of all components, is not
    positive. Errors of Gauss-Markov processes of one time and of two, and such as oscillate, from
    60 to 1,000 of them, are then taken for inconsistent once in a thousand times or less often.

    Parameters
    ----------
    errors : array_like, (n, d)
        Over what the filter says of them, in the order of time, NaN where missing.

    Examples
    --------
    >>> import numpy as np
    >>> from inswsn_lib.evaluation import independent_count
    >>> white = np.random.default_rng(0).normal(size=(1000, 2))
    >>> independent_count(np.repeat(white, 3, axis=0)) < 1001
    True
    """
    x = np.asarray(errors, dtype=float)
    x = x[:, np.nan_to_num(x).any(axis=0)]
    count = int(np.isfinite(x).all(axis=1).sum()) if x.size else 0
    lags = np.unique(np.geomspace(1, max(count // _FEWEST_INDEPENDENT, 1), 40).astype(int))
    if count < _FEWEST_INDEPENDENT:
        return 1.0
    gone = lags[np.nanmean(autocorrelation(x, lags), axis=1) <= 0]
    return count / float(gone[0]) if len(gone) else 1.0


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
        From 0 to less than n. NaN is returned where no two values are so far apart, or all are 0.

    Examples
    --------
    >>> from inswsn_lib.evaluation import autocorrelation
    >>> autocorrelation([1.0, -1.0, 1.0, -1.0], [0, 1, 2]).tolist()
    [1.0, -1.0, 1.0]
    """
    x = np.asarray(values, dtype=float)
    x = x.reshape(len(x), -1)
    found = [_mean(x[lag:] * x[: len(x) - lag]) for lag in np.asarray(lags).tolist()]
    size = _mean(np.square(x))
    size[size == 0] = np.nan
    return np.asarray(np.array(found) / size).reshape(len(found), *np.shape(values)[1:])


def _mean(columns: Array) -> Array:
    """Return the means of what is there, NaN of nothing."""
    there = np.isfinite(columns)
    count: Array = there.sum(axis=0).astype(float)
    count[count == 0] = np.nan
    return np.asarray(np.where(there, columns, 0.0).sum(axis=0) / count)


def ljung_box(values: ArrayLike, lags: int = 10, spacing: int = 1) -> float:
    r"""Return the statistic of Ljung and Box (Biometrika 65(2), 1978) of a series about zero.

    .. math:: Q = \frac{n + 2}{n} \sum_{k=1}^{m} n_k\, \rho_k^2

    with n values and :math:`n_k` pairs at lag k, which is n - k without gaps. It has the chi-square
    distribution with m degrees of freedom if the series is white.

    Parameters
    ----------
    values : array_like, (steps,)
        NaN where missing.
    lags : int
        m.
    spacing : int
        Steps of a lag.

    Examples
    --------
    >>> import numpy as np
    >>> from inswsn_lib.evaluation import ljung_box
    >>> white = np.random.default_rng(0).normal(size=1000)
    >>> print(f"{ljung_box(white):.0f} and {ljung_box(np.cumsum(white)):.0f}")
    6 and 9391
    """
    x = np.asarray(values, dtype=float)
    n, k = int(np.isfinite(x).sum()), spacing * np.arange(1, lags + 1)
    pairs = np.array([_pairs(x, lag) for lag in k.tolist()])
    return float((n + 2) / n * np.nansum(pairs * autocorrelation(x, k) ** 2))
