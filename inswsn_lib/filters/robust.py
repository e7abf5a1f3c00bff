"""Rivals that an engineer would use today: gating, a Huber update, and an adaptive R.

Their gains depend on the measured values, so that each run has a covariance of its own. All runs
are still carried at once, as arrays with the runs first.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.stats import chi2

from inswsn_lib.errors import ParameterError
from inswsn_lib.filters.inputs import checked_measurements, covariances, first_state
from inswsn_lib.models import ErrorModel

Array = NDArray[np.float64]

Mask = NDArray[np.bool_]
_TINY = 1e-300
# (innovation (runs, m), its covariance without R (runs, m, m), components there (runs, m))
# -> R to use (runs, m, m), and which components to use (runs, m)
Step = Callable[[Array, Array, Mask], tuple[Array, Mask]]
# (R (m, m), number of runs) -> the step of these runs, which may remember
Policy = Callable[[Array, int], Step]


def gating(probability: float = 0.999, patience: int = 5) -> Policy:
    """Return the policy that drops a measurement whose NIS is too large to be true.

    A filter that is lost takes every measurement for false. So after some rejections on end it is
    a plain Kalman filter until a measurement is inside the gate again.

    Parameters
    ----------
    probability : float
        With which a measurement of the modelled noise is kept.
    patience : int
        Rejections on end after which measurements are taken all the same.

    Returns
    -------
    callable
        The policy, for `run_robust`.

    Raises
    ------
    ParameterError
        If the probability is not between 0 and 1, or the patience is negative.

    Examples
    --------
    Five measurements of zero, and one that is off by a thousand times the noise and is dropped:

    >>> import numpy as np
    >>> from inswsn_lib.filters import gating, run_robust
    >>> from inswsn_lib.models import ErrorModel
    >>> model = ErrorModel(A=[[1]], B=[[1]], C=[[1]], D=[[1]], L=[[1]], E=[[0]], period=1.0)
    >>> measured = np.array([0.0, 0.0, 0.0, 1000.0, 0.0, 0.0]).reshape(6, 1, 1)
    >>> estimates = run_robust(model, measured, gating(), initial_covariance=[[1.0]])
    >>> float(abs(estimates).max())
    0.0
    """
    if not 0 < probability < 1:
        raise ParameterError("probability", probability, "between 0 and 1")
    if not patience >= 0:
        raise ParameterError("patience", patience, "0 or more")

    def start(R: Array, runs: int) -> Step:
        limits = np.concatenate([[np.inf], chi2.ppf(probability, np.arange(1, len(R) + 1))])
        rejected = np.zeros(runs, dtype=int)

        def step(innovation: Array, prior: Array, there: Mask) -> tuple[Array, Mask]:
            nis = _squares(innovation, prior + R, there)
            limit = limits[there.sum(axis=1)]
            outside = nis > limit
            forced = outside & (rejected >= patience)
            rejected[:] = np.where(outside, rejected + 1, 0)
            return np.broadcast_to(R, prior.shape), there & (~outside | forced)[:, None]

        return step

    return start


def huber(threshold: float = 1.345) -> Policy:
    """Return the policy that bounds the influence of a large innovation.

    A component of the innovation beyond `threshold` standard deviations is taken for that many:
    its variance is inflated by size / threshold, so that it has the weight threshold / size of
    Huber (1964). The inflation is added to the variance of the measurement, so that the R in use
    stays a covariance, whatever the correlations of the prediction.

    Parameters
    ----------
    threshold : float
        In standard deviations; 1.345 keeps 95 % of the efficiency for Gaussian noise.

    Returns
    -------
    callable
        The policy, for `run_robust`.

    Raises
    ------
    ParameterError
        If the threshold is not positive.

    Examples
    --------
    One measurement of a thousand: the estimate moves by a bounded step, not by half of it:

    >>> from inswsn_lib.filters import huber, run_robust
    >>> from inswsn_lib.models import ErrorModel
    >>> model = ErrorModel(A=[[1]], B=[[1]], C=[[1]], D=[[1]], L=[[1]], E=[[0]], period=1.0)
    >>> for size in (1.0, 1000.0, 2000.0):
    ...     estimates = run_robust(model, [[[size]]], huber(), initial_covariance=[[1.0]])
    ...     print(f"{size:6.0f} {estimates.item():.3f}")
         1 0.500
      1000 0.951
      2000 0.951
    """
    if not threshold > 0:
        raise ParameterError("threshold", threshold, "positive")

    def start(R: Array, runs: int) -> Step:
        def step(innovation: Array, prior: Array, there: Mask) -> tuple[Array, Mask]:
            S = prior + R
            deviation = np.sqrt(np.maximum(np.diagonal(S, axis1=1, axis2=2), _TINY))
            size = np.where(there, np.abs(innovation), 0.0) / deviation
            excess = deviation**2 * np.maximum(size / threshold - 1.0, 0.0)
            used = np.tile(R, (len(excess), 1, 1))
            used[:, np.arange(len(R)), np.arange(len(R))] += excess
            return used, there

        return step

    return start


def adaptive(forgetting: float = 0.95) -> Policy:
    """Return the policy that learns the diagonal of R from the innovations.

    The variance of each component is a running mean of the squared innovation less what the
    prediction accounts for, kept between a hundredth and ten thousand times the modelled one
    (Mehra 1972). Correlations in R are left out.

    Parameters
    ----------
    forgetting : float
        Weight of the past, between 0 and 1.

    Returns
    -------
    callable
        The policy, for `run_robust`.

    Raises
    ------
    ParameterError
        If it is not between 0 and 1.

    Examples
    --------
    The model says that the noise has the variance 1, and the measurements jump by 20 m. The filter
    learns that they are worth little, and follows them less than a Kalman filter does:

    >>> import numpy as np
    >>> from inswsn_lib.filters import adaptive, run_kalman, run_robust
    >>> from inswsn_lib.models import ErrorModel
    >>> model = ErrorModel(A=[[1]], B=[[1]], C=[[1]], D=[[1]], L=[[1]], E=[[0]], period=1.0)
    >>> jumping = np.tile([10.0, -10.0], 50).reshape(100, 1, 1)
    >>> learnt = run_robust(model, jumping, adaptive(), initial_covariance=[[1.0]])
    >>> modelled = run_kalman(model, jumping, initial_covariance=[[1.0]])
    >>> print(f"{abs(learnt[-1]).item():.1f} m, {abs(modelled[-1]).item():.1f} m")
    0.5 m, 4.5 m
    """
    if not 0 < forgetting < 1:
        raise ParameterError("forgetting", forgetting, "between 0 and 1")

    def start(R: Array, runs: int) -> Step:
        modelled = np.diag(R)
        variances = np.tile(modelled, (runs, 1))

        def step(innovation: Array, prior: Array, there: Mask) -> tuple[Array, Mask]:
            seen = np.nan_to_num(innovation) ** 2 - np.diagonal(prior, axis1=1, axis2=2)
            moved = forgetting * variances + (1 - forgetting) * seen
            moved = np.clip(moved, 0.01 * modelled, 1e4 * modelled)
            variances[there] = moved[there]
            return variances[:, :, None] * np.eye(len(R)), there

        return step

    return start


def run_robust(
    model: ErrorModel,
    measurements: ArrayLike,
    policy: Policy,
    *,
    initial_covariance: ArrayLike,
    initial_state: ArrayLike | None = None,
    predicted: bool = False,
) -> Array:
    """Run a Kalman filter whose update follows a policy, each run with a covariance of its own.

    Parameters
    ----------
    model : ErrorModel
        A, C, Q = B B' and R = D D'.
    measurements : array_like, (steps, m, runs)
        y; NaN where missing.
    policy : callable
        From `gating`, `huber` or `adaptive`.
    initial_covariance : array_like, (n, n)
        P_0.
    initial_state : array_like, (n,) or (n, runs), optional
        Default: zero.
    predicted : bool
        Return the state before the measurement of each step instead of after it.

    Returns
    -------
    ndarray, (steps, n, runs)

    Raises
    ------
    ParameterError
        If a shape does not fit, or a measurement is infinite.

    Examples
    --------
    A policy is any function of R and the number of runs. One that changes nothing gives the Kalman
    filter:

    >>> import numpy as np
    >>> from inswsn_lib.filters import run_kalman, run_robust
    >>> from inswsn_lib.models import ErrorModel
    >>> model = ErrorModel(A=[[1]], B=[[1]], C=[[1]], D=[[1]], L=[[1]], E=[[0]], period=1.0)
    >>> def plain(R, runs):
    ...     return lambda innovation, prior, there: (np.broadcast_to(R, prior.shape), there)
    >>> measured = np.array([1.0, 5.0, 2.0]).reshape(3, 1, 1)
    >>> robust = run_robust(model, measured, plain, initial_covariance=[[1.0]])
    >>> bool(np.allclose(robust, run_kalman(model, measured, initial_covariance=[[1.0]])))
    True
    """
    y = checked_measurements(measurements, model.C.shape[0])
    runs, n = y.shape[2], model.C.shape[1]
    x = first_state(initial_state, n, runs).T
    P0 = covariances("initial_covariance", initial_covariance, 1, n)[0]
    P = np.broadcast_to(P0, (runs, n, n)).copy()
    step = policy(model.measurement_covariance, runs)
    Q, eye = model.process_covariance, np.eye(n)
    estimates = np.empty((y.shape[0], n, runs))
    for k in range(y.shape[0]):
        if predicted:
            estimates[k] = x.T
        measured = y[k].T
        there = ~np.isnan(measured)
        innovation = measured - x @ model.C.T
        prior = model.C @ P @ model.C.T
        R_used, used = step(innovation, prior, there)
        gain = np.swapaxes(_solve(prior + R_used, model.C @ P, used), 1, 2)
        x = x + (gain @ np.where(used, innovation, 0.0)[:, :, None])[:, :, 0]
        keep = eye - gain @ model.C
        P = keep @ P @ np.swapaxes(keep, 1, 2) + gain @ R_used @ np.swapaxes(gain, 1, 2)
        if not predicted:
            estimates[k] = x.T
        x = x @ model.A.T
        P = model.A @ P @ model.A.T + Q
    return estimates


def _solve(S: Array, right: Array, used: Mask) -> Array:
    """Return S^-1 right over the components in use; zero rows for the others."""
    both = used[:, :, None] & used[:, None, :]
    inner = np.where(both, S, np.eye(S.shape[1]))
    try:
        return np.asarray(np.linalg.solve(inner, np.where(used[:, :, None], right, 0.0)))
    except np.linalg.LinAlgError:
        raise ParameterError(
            "measurement_covariance", "such that an innovation is certain", "positive definite"
        ) from None


def _squares(innovation: Array, S: Array, there: Mask) -> Array:
    e = np.where(there, innovation, 0.0)[:, :, None]
    return np.asarray((np.swapaxes(e, 1, 2) @ _solve(S, e, there))[:, 0, 0])
