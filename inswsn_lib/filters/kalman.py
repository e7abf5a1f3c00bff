"""The Kalman filter: its gains for a pattern of data, runs of it, and its steady state."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from inswsn_lib.checks import Array, Mask, array, covariance, mask
from inswsn_lib.errors import Described, ParameterError
from inswsn_lib.filters.inputs import first_state, over_steps, present, solve_present, times
from inswsn_lib.models import ErrorModel

_ROUNDING = 1e-7
_FAR = 1e5  # times the variance of a measurement: that of a prediction that needs square roots


@dataclass(frozen=True, eq=False)
class KalmanDesign:
    """Gains and covariances of a Kalman filter, which do not depend on the measured values.

    Attributes
    ----------
    gains : ndarray, (steps, n, m)
        K_k; zero for components that are not measured at step k.
    predicted, filtered : ndarray, (steps, n, n)
        Covariance of the state before and after the measurement of step k.
    innovation : ndarray, (steps, m, m)
        Covariance of the innovation, C P C' + R, of all components, measured or not.

    Examples
    --------
    The gains of a random walk with noises of unit size are ratios of Fibonacci numbers:

    >>> import inswsn_lib as iw
    >>> model = iw.ErrorModel(A=[[1]], B=[[1]], C=[[1]], D=[[1]], period=1.0)
    >>> iw.design_kalman(model, [[True]] * 3, initial_covariance=[[1]]).gains.ravel().round(4)
    array([0.5   , 0.6   , 0.6154])
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
    r"""Compute the gains of the Kalman filter for a pattern of available measurements.

    .. math::
        K_k = P_k C' (C P_k C' + R_k)^{-1}, \quad
        P_k^+ = (I - K_k C) P_k (I - K_k C)' + K_k R_k K_k', \quad
        P_{k+1} = A P_k^+ A' + Q_k

    The jitter E, which multiplies the state, is left out. Over 10^5 steps and ratios of Q to R from
    10^-12 to 10^12, with measurements that are missing, covariances are those of 50 digits to 1e-8
    of the products of deviations, those of predictions to 1e-11.

    Parameters
    ----------
    model : ErrorModel
        A, C, and by default Q = B B' and R = D D'.
    available : array_like of bool, (steps, m)
        Which components are measured at each step.
    initial_covariance : array_like, (n, n)
        P_0, before the first measurement.
    process_covariance : array_like, (n, n) or (steps, n, n), optional
        Q; entry k drives step k to k + 1.
    measurement_covariance : array_like, (m, m) or (steps, m, m), optional
        R.

    Examples
    --------
    Where the second measurement is missing, its gain is zero and the covariance grows by Q:

    >>> import inswsn_lib as iw
    >>> model = iw.ErrorModel(A=[[1]], B=[[1]], C=[[1]], D=[[1]], period=1.0)
    >>> design = iw.design_kalman(model, [[True], [False]], initial_covariance=[[1]])
    >>> design.gains.ravel().tolist(), design.filtered.ravel().tolist()
    ([0.5, 0.0], [0.5, 1.5])
    """
    there = mask("available", available, ("steps", len(model.C)))
    noise = _noise(
        model, len(there), initial_covariance, process_covariance, measurement_covariance
    )
    steps = zip(*_steps(model, there[:, None], *noise), strict=True)
    gains, _, *covariances = (np.array(each)[:, 0] for each in steps)
    return KalmanDesign(gains, *covariances)


def run_kalman(
    model: ErrorModel,
    measurements: ArrayLike,
    *,
    initial_covariance: ArrayLike,
    process_covariance: ArrayLike | None = None,
    measurement_covariance: ArrayLike | None = None,
    initial_state: ArrayLike | None = None,
    predicted: bool = False,
) -> Array:
    """Run the Kalman filter of `design_kalman` over any number of runs at once.

    Over 10^5 steps and ratios of Q to R from 10^-12 to 10^12 the estimates are those of 50 digits
    to 1e-7 of their size, or of their deviation where that is larger.

    Parameters
    ----------
    model : ErrorModel
        A, C, and by default Q = B B' and R = D D'.
    measurements : array_like, (steps, m, runs)
        y; NaN where a component is missing. Where all are, the filter predicts.
    initial_covariance, process_covariance, measurement_covariance
        As in `design_kalman`.
    initial_state : array_like, (n,) or (n, runs), optional
        The state before the first measurement. Default: zero.
    predicted : bool
        Return the state before the measurement of each step instead of after it.

    Returns
    -------
    ndarray, (steps, n, runs)
        ``estimates[k]`` uses the measurements up to and including step k, or before step k if
        `predicted`.

    Examples
    --------
    A random walk that is measured at 1 m, is not measured, and is measured at 1 m again:

    >>> import numpy as np
    >>> import inswsn_lib as iw
    >>> model = iw.ErrorModel(A=[[1]], B=[[1]], C=[[1]], D=[[1]], period=1.0)
    >>> measured = np.array([1.0, np.nan, 1.0]).reshape(3, 1, 1)
    >>> iw.run_kalman(model, measured, initial_covariance=[[1]]).ravel().round(4).tolist()
    [0.5, 0.5, 0.8571]
    """
    m, n = model.C.shape
    there, y = present(array("measurements", measurements, ("steps", m, "runs"), gaps=True))
    noise = _noise(model, len(y), initial_covariance, process_covariance, measurement_covariance)
    states = np.empty((len(y) + 1, n, y.shape[2]))
    states[0] = first_state(initial_state, n, y.shape[2])
    # one gain for all runs where they miss the same; two products from one estimate to the next
    for k, (gain, keep, *_) in enumerate(_steps(model, np.swapaxes(there, 1, 2), *noise)):
        if predicted:
            F, G = model.A @ keep, model.A @ gain
        else:
            F, G = keep @ model.A if k else keep, gain
        np.add(times(F, states[k]), times(G, y[k]), out=states[k + 1])
    return states[:-1] if predicted else states[1:]


def _noise(
    model: ErrorModel,
    steps: int,
    initial_covariance: ArrayLike,
    process_covariance: ArrayLike | None,
    measurement_covariance: ArrayLike | None,
) -> tuple[Array, Array, Array]:
    """Return P_0 (n, n), Q (steps, n, n) and R (steps, m, m), checked."""
    Q, R = model.process_covariance, model.measurement_covariance
    return (
        covariance("initial_covariance", initial_covariance, model.A.shape),
        over_steps("process_covariance", process_covariance, Q, steps),
        over_steps("measurement_covariance", measurement_covariance, R, steps),
    )


def _steps(
    model: ErrorModel, there: Mask, P: Array, Qs: Array, Rs: Array
) -> Iterator[tuple[Array, Array, Array, Array, Array]]:
    """Yield K, I - K C, P, P+ and C P C' + R of each step, for patterns there (steps, K, m).

    Where a prediction is far less certain than the measurement, P+ is lost in the rounding of P:
    there P is carried as a square root.
    """
    P, root, after, driven = P[None], None, None, None
    limits = _FAR * np.diagonal(Rs, axis1=1, axis2=2)
    for here, Q, R, limit in zip(there, Qs, Rs, limits, strict=True):
        S = model.C @ P @ model.C.T + R
        if (S.diagonal(axis1=1, axis2=2) > limit).any():  # what is missing may come next
            if after is None or driven is None:
                root = _root(P)
            else:
                moved = model.A @ (_root(after) if root is None else root)
                root = np.concatenate([_driving(model, driven, len(moved)), moved], axis=2)
            gain, after, root = _updated_root(model.C, root, R, here)
            keep = np.eye(len(model.A)) - gain @ model.C
        else:
            gain, keep, after = updated(model.C, P, S, R, here)
            root = None
        yield gain, keep, P, after, S
        P, driven = model.A @ after @ model.A.T + Q, Q


def _driving(model: ErrorModel, Q: Array, count: int) -> Array:
    """Return the square root of the process noise; of the model's own it is exact."""
    root = model.B if np.array_equal(Q, model.process_covariance) else _root(Q[None])[0]
    return np.broadcast_to(root, (count, *root.shape))


def _root(P: Array) -> Array:
    """Return W (., n, n) with P = W W', by the eigenvalues of the correlations."""
    size = np.sqrt(np.diagonal(P, axis1=1, axis2=2))
    unit = np.where(size > 0, size, 1.0)
    values, vectors = np.linalg.eigh(P / unit[:, :, None] / unit[:, None, :])
    return np.asarray(unit[:, :, None] * vectors * np.sqrt(np.maximum(values, 0))[:, None, :])


def _updated_root(C: Array, W: Array, R: Array, there: Mask) -> tuple[Array, Array, Array]:
    """Return K, P+ and its square root, from that of P (filters, n, .): `updated` by a QR.

    The triangle of [W'C' W'; R^(1/2)' 0] holds the square roots of S and P+, and S^(-1/2) C P
    (Kailath, Sayed and Hassibi 2000, Section 12.3).
    """
    m, n = C.shape
    W = np.broadcast_to(W, (len(there), *W.shape[1:]))  # one until measurements differ
    seen, noise = (np.where(there[:, :, None], X, 0.0) for X in (C, _root(R[None])))
    # what is missing has a noise of its own, and tells nothing
    noise = np.concatenate([noise, np.where(there[:, :, None], 0.0, np.eye(m))], axis=2)
    turned = np.swapaxes(W, 1, 2)
    upper = np.concatenate([turned @ np.swapaxes(seen, 1, 2), turned], axis=2)
    lower = np.concatenate([np.swapaxes(noise, 1, 2), np.zeros((len(W), 2 * m, n))], axis=2)
    whole: Array = np.concatenate([upper, lower], axis=1)
    triangle: Array = np.asarray(np.linalg.qr(whole, mode="r"))
    solved = solve_present(np.ones_like(there), triangle[:, :m, :m], triangle[:, :m, m:])
    gain = np.swapaxes(solved, 1, 2)
    root = np.swapaxes(triangle[:, m : m + n, m:], 1, 2)
    return gain, root @ np.swapaxes(root, 1, 2), root


def updated(C: Array, P: Array, S: Array, R: Array, there: Mask) -> tuple[Array, Array, Array]:
    """Return K, I - K C and P+ (filters, ., .) for what is there (filters, m) of a measurement."""
    gain = np.swapaxes(solve_present(there, S, C @ P), 1, 2)
    keep = np.eye(C.shape[1]) - gain @ C
    # Joseph's form stays symmetric and positive for any gain
    after = keep @ P @ np.swapaxes(keep, 1, 2) + gain @ R @ np.swapaxes(gain, 1, 2)
    return gain, keep, after


def predictor_gain(model: ErrorModel) -> Array:
    r"""Return the gain (n, m) of the Kalman predictor in the steady state, jitter left out.

    With P the stabilising solution of the Riccati equation, the covariance of the predicted error,

    .. math::
        B_f = A P C' (C P C' + D D')^{-1} , \qquad
        P = A P A' + B B' - B_f (C P C' + D D') B_f' .

    It has been that of closed forms to 1e-9, for ratios of B B' to D D' from 10^-12 to 10^12.

    Raises
    ------
    ParameterError
        If there is no steady state: a mode that is not stable is not measured, or a mode on the
        unit circle has no process noise, or D D' is singular.

    Examples
    --------
    For a random walk with noises of unit size :math:`P^2 = P + 1`: P is the golden ratio, and the
    gain :math:`P / (P + 1)` is one over it:

    >>> import inswsn_lib as iw
    >>> model = iw.ErrorModel(A=[[1]], B=[[1]], C=[[1]], D=[[1]], period=1.0)
    >>> print(f"{iw.predictor_gain(model).item():.4f}")
    0.6180
    """
    from scipy.linalg import solve_discrete_are  # noqa: PLC0415  # runs of filters need numpy alone

    R = model.measurement_covariance
    gain = None
    with suppress(np.linalg.LinAlgError, ValueError):
        P = solve_discrete_are(model.A.T, model.C.T, model.process_covariance, R)
        gain = np.linalg.solve(model.C @ P @ model.C.T + R, model.C @ P @ model.A.T).T
    if gain is None or np.abs(np.linalg.eigvals(model.A - gain @ model.C)).max() >= 1 - _ROUNDING:
        got = Described("without a steady state")
        raise ParameterError("model", got, "one whose Riccati equation has a stable solution")
    return np.asarray(gain)


def steady_error(model: ErrorModel, gain: ArrayLike) -> float:
    r"""Return the root mean square of L e of a predictor with a constant gain, jitter left out.

    For white noise of unit variance the covariance of e obeys
    :math:`X = \tilde A X \tilde A' + \tilde B \tilde B'` with :math:`\tilde A = A - B_f C` and
    :math:`\tilde B = [B\ \ {-B_f D}]`. It is infinite if the error system is not stable.

    Parameters
    ----------
    model : ErrorModel
    gain : array_like, (n, m)
        B_f.

    Examples
    --------
    The deadbeat gain of a random walk carries each measurement on by a step, so that two noises of
    unit size make the error. Without a gain it grows for ever:

    >>> import inswsn_lib as iw
    >>> model = iw.ErrorModel(A=[[1]], B=[[1]], C=[[1]], D=[[1]], period=1.0)
    >>> print(f"{iw.steady_error(model, [[1]]):.4f} {iw.steady_error(model, [[0]])}")
    1.4142 inf
    """
    from scipy.linalg import solve_discrete_lyapunov  # noqa: PLC0415  # as above

    B_f = array("gain", gain, model.C.shape[::-1])
    A = model.A - B_f @ model.C
    if np.abs(np.linalg.eigvals(A)).max() >= 1:
        return float("inf")
    driven = np.hstack([model.B, -B_f @ model.D])
    X = solve_discrete_lyapunov(A, driven @ driven.T)
    return float(np.sqrt(np.trace(model.L @ X @ model.L.T)))
