"""The Kalman filter: gains computed once for a pattern of data, then run over many runs at once."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.linalg import cho_factor, cho_solve

from inswsn_lib.errors import ParameterError
from inswsn_lib.models import ErrorModel

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]


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

    Raises
    ------
    ParameterError
        If a shape does not fit, a covariance is not symmetric and positive semidefinite, or an
        innovation covariance is singular.
    """
    states, outputs = model.A.shape[0], model.C.shape[0]
    mask = np.asarray(available)
    if mask.dtype != bool or mask.ndim != 2 or mask.shape[1] != outputs:
        raise ParameterError(
            "available", f"{mask.dtype} of shape {mask.shape}", f"bool of shape (steps, {outputs})"
        )
    steps = mask.shape[0]
    P = _covariances("initial_covariance", initial_covariance, 1, states)[0]
    Q = model.process_covariance if process_covariance is None else process_covariance
    R = model.measurement_covariance if measurement_covariance is None else measurement_covariance
    Qs = _covariances("process_covariance", Q, steps, states)
    Rs = _covariances("measurement_covariance", R, steps, outputs)
    gains = np.zeros((steps, states, outputs))
    predicted, filtered = np.empty((2, steps, states, states))
    innovation = np.empty((steps, outputs, outputs))
    for k in range(steps):
        predicted[k] = P
        innovation[k] = model.C @ P @ model.C.T + Rs[k]
        gains[k] = _gain(P, model.C, innovation[k], mask[k], k)
        keep = np.eye(states) - gains[k] @ model.C
        # Joseph's form stays symmetric and positive for any gain
        filtered[k] = keep @ P @ keep.T + gains[k] @ Rs[k] @ gains[k].T
        P = model.A @ filtered[k] @ model.A.T + Qs[k]
    return KalmanDesign(gains, predicted, filtered, innovation)


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
    """
    y = np.asarray(measurements, dtype=float)
    outputs, states = model.C.shape
    if y.ndim != 3 or y.shape[1] != outputs:
        raise ParameterError(
            "measurements", f"of shape {y.shape}", f"(steps, {outputs}, runs); one run is runs = 1"
        )
    if np.isinf(y).any():
        raise ParameterError("measurements", "infinite", "finite, or NaN where missing")
    runs = y.shape[2]
    x = _initial_state(initial_state, states, runs)
    estimates = np.empty((y.shape[0], states, runs))
    for members, available in _patterns(~np.isnan(y)):
        design = design_kalman(
            model,
            available,
            initial_covariance=initial_covariance,
            process_covariance=process_covariance,
            measurement_covariance=measurement_covariance,
        )
        estimates[:, :, members] = _run(
            model, design.gains, y[:, :, members], x[:, members], predicted
        )
    return estimates


def _run(model: ErrorModel, gains: Array, y: Array, x: Array, predicted: bool) -> Array:
    estimates = np.empty((y.shape[0], *x.shape))
    measured = np.nan_to_num(y)  # the gain of a missing component is zero
    for k, gain in enumerate(gains):
        if predicted:
            estimates[k] = x
        x = x + gain @ (measured[k] - model.C @ x)
        if not predicted:
            estimates[k] = x
        x = model.A @ x
    return estimates


def _gain(P: Array, C: Array, innovation: Array, measured: Mask, step: int) -> Array:
    gain = np.zeros((P.shape[0], C.shape[0]))
    if measured.any():
        try:
            factor = cho_factor(innovation[np.ix_(measured, measured)])
        except np.linalg.LinAlgError:
            raise ParameterError(
                "measurement_covariance",
                f"such that the innovation of step {step} has a singular covariance",
                "positive definite",
            ) from None
        gain[:, measured] = cho_solve(factor, C[measured] @ P).T
    return gain


def _patterns(available: Mask) -> list[tuple[NDArray[np.intp], Mask]]:
    """Return each pattern (steps, m) of available data with the runs that have it."""
    steps, outputs, runs = available.shape
    flat = available.reshape(steps * outputs, runs)
    if runs and (flat == flat[:, :1]).all():  # the usual case, without a sort
        return [(np.arange(runs), available[:, :, 0])]
    kinds, member = np.unique(flat, axis=1, return_inverse=True)
    return [
        (np.flatnonzero(member == i), kinds[:, i].reshape(steps, outputs))
        for i in range(kinds.shape[1])
    ]


def _covariances(name: str, value: ArrayLike, steps: int, size: int) -> Array:
    """Return covariances as (steps, size, size), checked."""
    given = np.asarray(value, dtype=float)
    if given.shape not in ((size, size), (steps, size, size)):
        raise ParameterError(
            name, f"of shape {given.shape}", f"({size}, {size}) or ({steps}, {size}, {size})"
        )
    largest = np.abs(given).max(initial=0.0)
    if not np.isfinite(largest) or not np.allclose(
        given, np.swapaxes(given, -1, -2), rtol=0, atol=1e-9 * largest
    ):
        raise ParameterError(name, "not finite or not symmetric", "a covariance")
    if given.size and np.linalg.eigvalsh(given).min() < -1e-9 * largest:
        raise ParameterError(name, "not positive semidefinite", "a covariance")
    return np.broadcast_to(given, (steps, size, size))


def _initial_state(value: ArrayLike | None, states: int, runs: int) -> Array:
    if value is None:
        return np.zeros((states, runs))
    given = np.asarray(value, dtype=float)
    if given.shape not in ((states,), (states, runs)) or not np.isfinite(given).all():
        raise ParameterError(
            "initial_state", f"of shape {given.shape}", f"finite, ({states},) or ({states}, {runs})"
        )
    return np.broadcast_to(given.reshape(states, -1), (states, runs)).copy()
