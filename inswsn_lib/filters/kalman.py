"""The Kalman filter: gains computed once for a pattern of data, then run over many runs at once."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from inswsn_lib.errors import ParameterError
from inswsn_lib.filters.inputs import checked_measurements, covariances, first_state
from inswsn_lib.models import ErrorModel

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

# Runs with patterns of their own that are carried at once; it bounds the memory of their gains.
_CHUNK = 512


@dataclass(frozen=True, eq=False)
class KalmanDesign:
    """Gains and covariances of a Kalman filter, which do not depend on the measured values.

    Attributes
    ----------
    gains : ndarray, (steps, n, m)
        K_k; the columns of components that are not measured at step k are zero.
    predicted : ndarray, (steps, n, n)
        Covariance of the state before the measurement of step k.
    filtered : ndarray, (steps, n, n)
        Covariance after it.
    innovation : ndarray, (steps, m, m)
        Covariance of the innovation, C P C' + R, of all components, measured or not.

    Examples
    --------
    With the variance 1 of the process noise, of the measurement noise and of the first error, the
    gains of a random walk are ratios of Fibonacci numbers, 1/2, 3/5 and 8/13:

    >>> import numpy as np
    >>> from inswsn_lib.filters import design_kalman
    >>> from inswsn_lib.models import ErrorModel
    >>> model = ErrorModel(A=[[1]], B=[[1]], C=[[1]], D=[[1]], L=[[1]], E=[[0]], period=1.0)
    >>> design = design_kalman(model, np.full((3, 1), True), initial_covariance=[[1.0]])
    >>> design.gains.ravel().round(4).tolist()
    [0.5, 0.6, 0.6154]
    >>> design.predicted.ravel().round(4).tolist()
    [1.0, 1.5, 1.6]
    """

    gains: Array
    predicted: Array
    filtered: Array
    innovation: Array


def design_kalman(
    model: ErrorModel,
    available: ArrayLike,
    *,
    initial_covariance: ArrayLike,
    process_covariance: ArrayLike | None = None,
    measurement_covariance: ArrayLike | None = None,
) -> KalmanDesign:
    r"""Compute the gains of the Kalman filter for a given pattern of available measurements.

    .. math::
        K_k = P_k C' (C P_k C' + R_k)^{-1}, \quad
        P_k^+ = (I - K_k C) P_k (I - K_k C)' + K_k R_k K_k', \quad
        P_{k+1} = A P_k^+ A' + Q_k

    The jitter E is left out: it multiplies the state, which a Kalman filter does not model.

    Parameters
    ----------
    model : ErrorModel
        A, C, and by default Q = B B' and R = D D'.
    available : array_like of bool, (steps, m)
        Which components are measured at each step.
    initial_covariance : array_like, (n, n)
        P_0, before the first measurement.
    process_covariance : array_like, (n, n) or (steps, n, n), optional
        Q.
    measurement_covariance : array_like, (m, m) or (steps, m, m), optional
        R.

    Returns
    -------
    KalmanDesign
        Gains and covariances of each step.

    Raises
    ------
    ParameterError
        If a shape does not fit, a covariance is not symmetric and positive semidefinite, or an
        innovation covariance is singular.

    Examples
    --------
    Where the second measurement is missing, its gain is zero and the covariance grows by Q:

    >>> from inswsn_lib.filters import design_kalman
    >>> from inswsn_lib.models import ErrorModel
    >>> model = ErrorModel(A=[[1]], B=[[1]], C=[[1]], D=[[1]], L=[[1]], E=[[0]], period=1.0)
    >>> design = design_kalman(model, [[True], [False], [True]], initial_covariance=[[1.0]])
    >>> design.gains.ravel().round(4).tolist()
    [0.5, 0.0, 0.7143]
    >>> design.filtered.ravel().round(4).tolist()
    [0.5, 1.5, 0.7143]
    """
    outputs = model.C.shape[0]
    mask = np.asarray(available)
    if mask.dtype != bool or mask.ndim != 2 or mask.shape[1] != outputs:
        raise ParameterError(
            "available", f"{mask.dtype} of shape {mask.shape}", f"bool of shape (steps, {outputs})"
        )
    P, Qs, Rs = _checked(
        model, mask.shape[0], initial_covariance, process_covariance, measurement_covariance
    )
    gains, predicted, filtered, innovation = _design(model, mask[:, None], P, Qs, Rs)
    return KalmanDesign(gains[:, 0], predicted[:, 0], filtered[:, 0], innovation[:, 0])


def _checked(
    model: ErrorModel,
    steps: int,
    initial_covariance: ArrayLike,
    process_covariance: ArrayLike | None,
    measurement_covariance: ArrayLike | None,
) -> tuple[Array, Array, Array]:
    """Return P_0 (n, n), Q (steps, n, n) and R (steps, m, m), checked."""
    states, outputs = model.A.shape[0], model.C.shape[0]
    P = covariances("initial_covariance", initial_covariance, 1, states)[0]
    Q = model.process_covariance if process_covariance is None else process_covariance
    R = model.measurement_covariance if measurement_covariance is None else measurement_covariance
    Qs = covariances("process_covariance", Q, steps, states)
    Rs = covariances("measurement_covariance", R, steps, outputs)
    return P, Qs, Rs


def _design(
    model: ErrorModel, masks: Mask, P: Array, Qs: Array, Rs: Array, store_all: bool = True
) -> tuple[Array, Array, Array, Array]:
    """Compute the filter for many patterns (steps, patterns, m) at once.

    Returns gains, predicted, filtered and innovation covariances as (steps, patterns, ., .); the
    last three are empty unless `store_all`.
    """
    steps, patterns, outputs = masks.shape
    states = len(model.A)
    kept = steps if store_all else 0
    gains = np.empty((steps, patterns, states, outputs))
    predicted, filtered = np.empty((2, kept, patterns, states, states))
    innovation = np.empty((kept, patterns, outputs, outputs))
    P, identity = np.broadcast_to(P, (patterns, states, states)), np.eye(states)
    for k, mask in enumerate(masks):
        S = model.C @ P @ model.C.T + Rs[k]
        gain = _gain(P, model.C, S, mask, k)
        keep = identity - gain @ model.C
        # Joseph's form stays symmetric and positive for any gain
        after = keep @ P @ np.swapaxes(keep, 1, 2) + gain @ Rs[k] @ np.swapaxes(gain, 1, 2)
        gains[k] = gain
        if store_all:
            predicted[k], filtered[k], innovation[k] = P, after, S
        P = model.A @ after @ model.A.T + Qs[k]
    return gains, predicted, filtered, innovation


def run_kalman(
    model: ErrorModel,
    measurements: ArrayLike,
    *,
    initial_covariance: ArrayLike,
    initial_state: ArrayLike | None = None,
    process_covariance: ArrayLike | None = None,
    measurement_covariance: ArrayLike | None = None,
    predicted: bool = False,
) -> Array:
    """Run the Kalman filter over any number of runs at once.

    Parameters
    ----------
    model : ErrorModel
        The model; see `design_kalman`.
    measurements : array_like, (steps, m, runs)
        y; NaN where a component is missing. Where none of the components at a step is measured,
        the filter predicts.
    initial_covariance, process_covariance, measurement_covariance
        See `design_kalman`.
    initial_state : array_like, (n,) or (n, runs), optional
        The state before the first measurement. Default: zero.
    predicted : bool
        Return the state before the measurement of each step instead of after it.

    Returns
    -------
    ndarray, (steps, n, runs)
        ``estimates[k]`` uses the measurements up to and including step k, or before step k if
        `predicted`.

    Raises
    ------
    ParameterError
        If a shape does not fit, a measurement is infinite, or a covariance is refused by
        `design_kalman`.

    Examples
    --------
    A random walk that is measured at 1 m, is not measured, and is measured at 1 m again:

    >>> import numpy as np
    >>> from inswsn_lib.filters import run_kalman
    >>> from inswsn_lib.models import ErrorModel
    >>> model = ErrorModel(A=[[1]], B=[[1]], C=[[1]], D=[[1]], L=[[1]], E=[[0]], period=1.0)
    >>> measured = np.array([1.0, np.nan, 1.0]).reshape(3, 1, 1)
    >>> estimates = run_kalman(model, measured, initial_covariance=[[1.0]])
    >>> estimates.ravel().round(4).tolist()
    [0.5, 0.5, 0.8571]
    """
    outputs, states = model.C.shape
    y = checked_measurements(measurements, outputs)
    runs = y.shape[2]
    x = first_state(initial_state, states, runs)
    estimates = np.empty((y.shape[0], states, runs))
    P, Qs, Rs = _checked(
        model, y.shape[0], initial_covariance, process_covariance, measurement_covariance
    )
    for members, masks in _patterns(y):
        gains = _design(model, masks, P, Qs, Rs, store_all=False)[0]
        chosen, missing = (slice(None), slice(None), members), not masks.all()
        _run(model, gains, y[chosen], x[:, members], predicted, estimates[chosen], missing)
    return estimates


def _run(
    model: ErrorModel, gains: Array, y: Array, x: Array, predicted: bool, out: Array, missing: bool
) -> None:
    """Run with gains (steps, 1 or runs, n, m); the estimates go to out."""
    measured = np.nan_to_num(y) if missing else y  # their gain is zero
    if gains.shape[1] == 1:
        _run_together(model, gains[:, 0], measured, x, predicted, out)
        return
    for k, gain in enumerate(gains):
        if predicted:
            out[k] = x
        x = x + _each(gain, measured[k] - model.C @ x)
        if not predicted:
            out[k] = x
        x = model.A @ x


def _run_together(
    model: ErrorModel, gains: Array, y: Array, x: Array, predicted: bool, out: Array
) -> None:
    """Run with one gain a step for all runs: two products of matrices a step, without copies."""
    keep = np.eye(len(model.A)) - gains @ model.C
    # x+ = F x + G y, from one estimate to the next
    F = model.A @ keep if predicted else keep @ model.A
    G = model.A @ gains if predicted else gains
    if len(y) == 0:
        return
    out[0] = x if predicted else keep[0] @ x + gains[0] @ y[0]
    driven = np.empty(x.shape)
    for k in range(1, len(y)):
        use = k - 1 if predicted else k
        np.matmul(F[use], out[k - 1], out=out[k])
        np.matmul(G[use], y[use], out=driven)
        out[k] += driven


def _each(gain: Array, innovation: Array) -> Array:
    """Return the product of each run's gain (runs, n, m) with its innovation (m, runs)."""
    return np.asarray((gain @ innovation.T[:, :, None])[:, :, 0].T)


def _gain(P: Array, C: Array, S: Array, measured: Mask, step: int) -> Array:
    """Return the gains (patterns, n, m); zero for components that are not measured."""
    inner, right = S, C @ P
    if not measured.all():
        both = measured[:, :, None] & measured[:, None, :]
        # a component that is missing gets a row and a column of the identity
        inner = np.where(both, S, np.eye(len(C)))
        right = np.where(measured[:, :, None], right, 0.0)
    try:
        np.linalg.cholesky(inner)
    except np.linalg.LinAlgError:
        raise ParameterError(
            "measurement_covariance",
            f"such that the innovation of step {step} has a singular covariance",
            "positive definite",
        ) from None
    return np.asarray(np.swapaxes(np.linalg.solve(inner, right), 1, 2))


def _patterns(y: Array) -> list[tuple[slice, Mask]]:
    """Return groups of runs with their patterns (steps, 1 or runs, m) of available data."""
    steps, outputs, runs = y.shape
    with np.errstate(over="ignore"):  # a sum that overflows is looked at number by number
        complete = bool(np.isfinite(y.sum()))
    if runs and complete:  # quicker than to look at each number
        return [(slice(0, runs), np.ones((steps, 1, outputs), dtype=bool))]
    available = ~np.isnan(y)
    if runs and (available == available[:, :, :1]).all():  # the usual case: one gain for all
        return [(slice(0, runs), np.swapaxes(available[:, :, :1], 1, 2))]
    chunks = [slice(first, first + _CHUNK) for first in range(0, runs, _CHUNK)]
    return [(chunk, np.swapaxes(available[:, :, chunk], 1, 2)) for chunk in chunks]
