"""Constant-gain predictors in the steady state: the Kalman gain, and the error of any gain."""

from __future__ import annotations

from contextlib import suppress

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.linalg import LinAlgError, solve_discrete_are, solve_discrete_lyapunov

from inswsn_lib.errors import ParameterError
from inswsn_lib.models import ErrorModel

Array = NDArray[np.float64]

_ROUNDING = 1e-7


def predictor_gain(model: ErrorModel) -> Array:
    r"""Return the gain of the Kalman predictor in the steady state.

    With P the stabilising solution of the Riccati equation, the covariance of the predicted error,

    .. math::
        B_f = A P C' (C P C' + D D')^{-1} , \qquad
        P = A P A' + B B' - B_f (C P C' + D D') B_f' .

    It has the least error variance for white noise. The jitter E is left out.

    Parameters
    ----------
    model : ErrorModel
        The model; :math:`D D'` must be invertible.

    Returns
    -------
    ndarray, (n, m)

    Raises
    ------
    ParameterError
        If there is no steady state: a mode that is not stable is not measured, or a mode on the
        unit circle has no process noise.

    Examples
    --------
    For a random walk with noises of unit variance, the Riccati equation is :math:`P^2 = P + 1`.
    So P is the golden ratio, and the gain :math:`P / (P + 1) = 1 / P`:

    >>> from inswsn_lib.filters import predictor_gain
    >>> from inswsn_lib.models import ErrorModel
    >>> model = ErrorModel(A=[[1]], B=[[1]], C=[[1]], D=[[1]], L=[[1]], E=[[0]], period=1.0)
    >>> print(f"{predictor_gain(model).item():.4f}")
    0.6180
    """
    R = model.measurement_covariance
    gain = None
    with suppress(LinAlgError, ValueError):
        P = solve_discrete_are(model.A.T, model.C.T, model.process_covariance, R)
        gain = np.linalg.solve(model.C @ P @ model.C.T + R, model.C @ P @ model.A.T).T
    if gain is None or np.abs(np.linalg.eigvals(model.A - gain @ model.C)).max() >= 1 - _ROUNDING:
        raise ParameterError(
            "model", "without a steady state", "one whose Riccati equation has a stable solution"
        )
    return np.asarray(gain, dtype=float)


def steady_error(model: ErrorModel, gain: ArrayLike) -> float:
    r"""Return the root mean square of L e under white noise of unit variance, jitter left out.

    The covariance of the error obeys :math:`X = \tilde A X \tilde A' + \tilde B \tilde B'` with
    :math:`\tilde A = A - B_f C` and :math:`\tilde B = [B\ \ {-B_f D}]`; the result is the root of
    the trace of :math:`L X L'`.

    Parameters
    ----------
    model : ErrorModel
        The model.
    gain : array_like, (n, m)
        B_f.

    Returns
    -------
    float
        Infinite if the error system is not stable.

    Raises
    ------
    ParameterError
        If the gain has another shape, or an entry that is not finite.

    Examples
    --------
    The error of the Kalman predictor of a random walk is the root of the golden ratio. Of all gains
    it has the least; the deadbeat gain 1 has :math:`\sqrt 2`:

    >>> from inswsn_lib.filters import predictor_gain, steady_error
    >>> from inswsn_lib.models import ErrorModel
    >>> model = ErrorModel(A=[[1]], B=[[1]], C=[[1]], D=[[1]], L=[[1]], E=[[0]], period=1.0)
    >>> for gain in (predictor_gain(model), [[1.0]], [[0.0]]):
    ...     print(f"{steady_error(model, gain):.4f}")
    1.2720
    1.4142
    inf
    """
    B_f = np.asarray(gain, dtype=float)
    if B_f.shape != (len(model.A), len(model.C)) or not np.isfinite(B_f).all():
        raise ParameterError(
            "gain", f"of shape {B_f.shape}", f"finite, ({len(model.A)}, {len(model.C)})"
        )
    A = model.A - B_f @ model.C
    if np.abs(np.linalg.eigvals(A)).max() >= 1:
        return float("inf")
    driven = np.hstack([model.B, -B_f @ model.D])
    X = solve_discrete_lyapunov(A, driven @ driven.T)
    return float(np.sqrt(np.trace(model.L @ X @ model.L.T)))
