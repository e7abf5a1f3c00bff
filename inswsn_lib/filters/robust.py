"""Rivals that an engineer would use today: gating, a Huber update, and an adaptive R.

Their gains depend on the measured values, so that each run has a covariance of its own. All runs
are still carried at once, as arrays with the runs first.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import ArrayLike

from inswsn_lib.checks import Array, Mask, covariance, number, of_runs, whole
from inswsn_lib.filters.inputs import first_state, sandwiched, solve_present
from inswsn_lib.filters.kalman import updated
from inswsn_lib.models import ErrorModel

#: Of a step: innovation (runs, m), its covariance without R (runs, m, m), and which components are
#: there (runs, m), to the R to use (runs, m, m), and which components to use (runs, m)
Step = Callable[[Array, Array, Mask], tuple[Array, Mask]]
#: R (m, m) and the number of runs, to the step of these runs, which may remember
Policy = Callable[[Array, int], Step]

_TINY = 1e-300


def gating(probability: float = 0.999, patience: int = 5) -> Policy:
    """Return the policy of `run_robust` that drops a measurement whose NIS is too large.

    A filter that is lost takes every measurement for false. So after some rejections on end it is
    a plain Kalman filter until a measurement is inside the gate again.

    Parameters
    ----------
    probability : float
        With which a measurement of the modelled noise is kept; between 0 and 1.
    patience : int
        Rejections on end after which measurements are taken all the same.

    Examples
    --------
    A measurement that is off by a thousand times the noise is dropped, and those of zero are not:

    >>> import inswsn_lib as iw
    >>> model = iw.ErrorModel(A=[[1]], B=[[1]], C=[[1]], D=[[1]], period=1.0)
    >>> y = [[0.0], [1000.0], [0.0]]
    >>> iw.run_robust(model, y, policy=iw.gating(), initial_covariance=[[1]]).tolist()
    [[0.0], [0.0], [0.0]]
    """
    from scipy.stats import chi2  # noqa: PLC0415  # runs of other filters need numpy alone

    number("probability", probability, above=0, below=1)
    whole("patience", patience)

    def start(R: Array, runs: int) -> Step:
        limits = np.append(np.inf, chi2.ppf(probability, np.arange(1, len(R) + 1)))
        rejected = np.zeros(runs, dtype=int)

        def step(innovation: Array, prior: Array, there: Mask) -> tuple[Array, Mask]:
            e = np.where(there, innovation, 0.0)
            nis = np.sum(e * solve_present(there, prior + R, e[:, :, None])[:, :, 0], axis=1)
            outside = nis > limits[there.sum(axis=1)]
            kept = ~outside | (rejected >= patience)
            rejected[:] = np.where(outside, rejected + 1, 0)
            return np.broadcast_to(R, prior.shape), there & kept[:, None]

        return step

    return start


def huber(threshold: float = 1.345) -> Policy:
    """Return the policy of `run_robust` that bounds the influence of a large innovation.

    A component of the innovation beyond `threshold` standard deviations is taken for that many:
    its variance is inflated by size / threshold, so that it has the weight threshold / size of
    Huber (1964). The inflation is added to the variance of the measurement, so that the R in use
    stays a covariance, whatever the correlations of the prediction.

    Parameters
    ----------
    threshold : float
        In standard deviations; 1.345 keeps 95 % of the efficiency for Gaussian noise.

    Examples
    --------
    However large a measurement, the estimate moves by a bounded step, not by half of it:

    >>> import inswsn_lib as iw
    >>> model = iw.ErrorModel(A=[[1]], B=[[1]], C=[[1]], D=[[1]], period=1.0)
    >>> options = {"policy": iw.huber(), "initial_covariance": [[1]]}
    >>> [iw.run_robust(model, [[y]], **options).round(3).item() for y in (1, 1000, 2000)]
    [0.5, 0.951, 0.951]
    """
    number("threshold", threshold, above=0)

    def start(R: Array, runs: int) -> Step:
        def step(innovation: Array, prior: Array, there: Mask) -> tuple[Array, Mask]:
            variance = np.maximum(np.diagonal(prior + R, axis1=1, axis2=2), _TINY)
            size = np.where(there, np.abs(innovation), 0.0) / np.sqrt(variance)
            excess = variance * np.maximum(size / threshold - 1.0, 0.0)
            return R + excess[:, :, None] * np.eye(len(R)), there

        return step

    return start


def adaptive(forgetting: float = 0.95) -> Policy:
    """Return the policy of `run_robust` that learns the diagonal of R (Mehra 1972).

    The variance of each component is a running mean of the squared innovation less what the
    prediction accounts for, kept between a hundredth and ten thousand times the modelled one.
    Correlations in R are left out.

    Parameters
    ----------
    forgetting : float
        Weight of the past, between 0 and 1.

    Examples
    --------
    The model says that the noise has the variance 1, and the measurements jump by 20 m. The filter
    learns that they are worth little:

    >>> import inswsn_lib as iw
    >>> model = iw.ErrorModel(A=[[1]], B=[[1]], C=[[1]], D=[[1]], period=1.0)
    >>> y, P0 = [[10.0], [-10.0]] * 50, [[1]]
    >>> learnt = iw.run_robust(model, y, policy=iw.adaptive(), initial_covariance=P0)[-1].item()
    >>> print(f"{learnt:.1f} and {iw.run_kalman(model, y, initial_covariance=P0)[-1].item():.1f} m")
    -0.5 and -4.5 m
    """
    number("forgetting", forgetting, above=0, below=1)

    def start(R: Array, runs: int) -> Step:
        modelled = np.diag(R)
        variances = np.tile(modelled, (runs, 1))

        def step(innovation: Array, prior: Array, there: Mask) -> tuple[Array, Mask]:
            seen = innovation**2 - np.diagonal(prior, axis1=1, axis2=2)
            moved = forgetting * variances + (1 - forgetting) * seen
            moved = np.clip(moved, 0.01 * modelled, 1e4 * modelled)
            variances[there] = moved[there]
            return variances[:, :, None] * np.eye(len(R)), there

        return step

    return start


def run_robust(
    model: ErrorModel,
    measurements: ArrayLike,
    *,
    policy: Policy,
    initial_covariance: ArrayLike,
    initial_state: ArrayLike | None = None,
    predicted: bool = False,
) -> Array:
    """Run a Kalman filter whose update follows a policy, each run with a covariance of its own.

    Parameters
    ----------
    model : ErrorModel
        A, C, Q = B B' and R = D D'.
    policy : callable
        From `gating`, `huber` or `adaptive`, or your own: of R (m, m) and the number of runs, to a
        function of each step. That has the innovation (runs, m), its covariance without R
        (runs, m, m), and which components are there (runs, m), and returns the R to use
        (runs, m, m) and which components to use.
    measurements, initial_covariance, initial_state, predicted
        As in `run_kalman`.

    Returns
    -------
    ndarray, (steps, n) or (steps, n, runs)

    Examples
    --------
    A policy that believes no measurement leaves the estimate where it is:

    >>> import inswsn_lib as iw
    >>> model = iw.ErrorModel(A=[[1]], B=[[1]], C=[[1]], D=[[1]], period=1.0)
    >>> def deaf(R, runs):
    ...     return lambda innovation, prior, there: (prior + R, there & False)
    >>> iw.run_robust(model, [[5], [5]], policy=deaf, initial_covariance=[[1]]).tolist()
    [[0.0], [0.0]]
    """
    m, n = model.C.shape
    y, back = of_runs("measurements", measurements, "steps", m, "runs", gaps=True)
    runs = y.shape[2]
    x = first_state(initial_state, n, runs).T
    P = np.tile(covariance("initial_covariance", initial_covariance, (n, n)), (runs, 1, 1))
    Q, step = model.process_covariance, policy(model.measurement_covariance, runs)
    estimates = np.empty((len(y), n, runs))
    for k, measured in enumerate(np.swapaxes(y, 1, 2)):
        if predicted:
            estimates[k] = x.T
        there, innovation = ~np.isnan(measured), measured - x @ model.C.T
        prior = sandwiched(model.C, P)
        R, used = step(innovation, prior, there)
        gain, _, P = updated(model.C, P, prior + R, R, used)
        x = x + (gain @ np.where(used, innovation, 0.0)[:, :, None])[:, :, 0]
        if not predicted:
            estimates[k] = x.T
        x, P = x @ model.A.T, sandwiched(model.A, P) + Q
    return back(estimates)
