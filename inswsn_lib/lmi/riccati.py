"""The least gamma by a Riccati equation: a route that shares nothing with the convex problem."""

from __future__ import annotations

import numpy as np
from scipy.linalg import LinAlgError, solve_discrete_are

from inswsn_lib.checks import Array, number
from inswsn_lib.errors import Described, ParameterError
from inswsn_lib.lmi.norms import hinf_norm, least_level
from inswsn_lib.models import ErrorModel

_DOUBLINGS = 120
_ROUNDING = 1e-9
_ON_CIRCLE = 1e-9


def riccati_filter(model: ErrorModel, gamma: float) -> Array | None:
    r"""Return the gain of the central predictor with a worst-case gain below a number, if any.

    It is the Kalman predictor of a model that has one more output :math:`L x`, whose noise has the
    covariance :math:`-\gamma^2 I`. With the stabilising solution P of its Riccati equation

    .. math::
        P = A \tilde P A' + BB' - A \tilde P C'(DD' + C \tilde P C')^{-1} C \tilde P A', \qquad
        \tilde P^{-1} = P^{-1} - \gamma^{-2} L'L ,

    which must leave :math:`\gamma^2 I - L P L'` positive definite, the gain is
    :math:`B_f = A \tilde P C'(DD' + C \tilde P C')^{-1}` (Hassibi, Sayed and Kailath 1999, the *a
    priori* filter). For :math:`\gamma \to \infty` it is that of the Kalman predictor. What is
    returned has been checked: the norm of its error system is not above gamma.

    Parameters
    ----------
    model : ErrorModel
        Without jitter, with D of full row rank, and noise on each mode on the unit circle.
    gamma : float
        The bound, positive, at most 1e100.

    Returns
    -------
    ndarray, (n, m), or None
        None if no filter of the form (P1 2.9) has this bound.

    Raises
    ------
    ParameterError
        If model or gamma is not such.

    Examples
    --------
    No predictor of a random walk with noises of unit size has a gain below :math:`\sqrt 2`; with
    the gain of the Kalman predictor, one over the golden ratio, it is far from it:

    >>> import inswsn_lib as iw
    >>> model = iw.ErrorModel(A=[[1]], B=[[1]], C=[[1]], D=[[1]], period=1.0)
    >>> print(iw.lmi.riccati_filter(model, 1.41), iw.lmi.riccati_filter(model, 1000.0).round(3))
    None [[0.618]]
    """
    _check(model)
    number("gamma", gamma, above=0, most=1e100)
    R = model.measurement_covariance
    A, B, C, L = model.A, model.B, model.C, model.L
    cost, none = gamma**2 * np.eye(len(L)), np.zeros((len(R), len(L)))
    try:
        P = solve_discrete_are(
            A.T, np.vstack([C, L]).T, B @ B.T, np.block([[R, none], [none.T, -cost]])
        )
    except (LinAlgError, ValueError):  # eigenvalues on the unit circle, or too near to it
        return None
    slack = cost - L @ P @ L.T
    if np.linalg.eigvalsh(slack).min() <= 0:
        return None
    P = P + P @ L.T @ np.linalg.solve(slack, L @ P)
    gain = np.linalg.solve(R + C @ P @ C.T, C @ P @ A.T).T
    norm = hinf_norm(A - gain @ C, np.hstack([B, -gain @ model.D]), L)
    return gain if norm <= gamma * (1 + _ROUNDING) else None


def riccati_gamma(model: ErrorModel, relative: float = 1e-8) -> float:
    r"""Return the least worst-case gain of a filter by bisection on `riccati_filter`.

    Parameters
    ----------
    model : ErrorModel
        As in `riccati_filter`, with B and L that are not zero.
    relative : float
        Relative accuracy, from above.

    Returns
    -------
    float
        Infinite if no filter is found, as when a mode that is not seen is not stable.

    Raises
    ------
    ParameterError
        If the model is not such, or there is no such accuracy.

    Examples
    --------
    With a gain k up to a, the gain of :math:`e^+ = (a - k) e + w - k v` is
    :math:`\sqrt{1 + k^2} / (1 - a + k)`, and its least value :math:`\sqrt{1 + a^2}`, at k = a:

    >>> import inswsn_lib as iw
    >>> model = iw.ErrorModel(A=[[0.75]], B=[[1]], C=[[1]], D=[[1]], period=1.0)
    >>> print(f"{iw.lmi.riccati_gamma(model):.4f}")
    1.2500
    """
    _check(model)
    number("relative", relative, least=1e-14, below=1)
    if not model.L.any() or not model.B.any():
        raise ParameterError("B, L", Described("zero"), "matrices that are not zero")
    # no filter undoes what one step does; if L does not see it, only the scale is known
    low = float(np.linalg.norm(model.L @ model.B, 2))
    high = low or 1e-12 * float(np.linalg.norm(model.L, 2) * np.linalg.norm(model.B, 2))
    return least_level(
        lambda gamma: riccati_filter(model, gamma) is not None, low, high, relative, _DOUBLINGS
    )


def _check(model: ErrorModel) -> None:
    if model.E.any():
        raise ParameterError("E", Described("not zero"), "zero: the equation knows no jitter")
    if np.linalg.matrix_rank(model.D) < len(model.D):
        raise ParameterError("D", Described("such that D D' is singular"), "of full row rank")
    n = len(model.A)
    for mode in np.linalg.eigvals(model.A):
        driven = np.hstack([model.A - mode * np.eye(n), model.B])
        if abs(abs(mode) - 1) < _ON_CIRCLE and np.linalg.matrix_rank(driven) < n:
            raise ParameterError(
                "B", Described("such that a mode on the unit circle has no noise"),
                "one that drives it",
            )  # fmt: skip
