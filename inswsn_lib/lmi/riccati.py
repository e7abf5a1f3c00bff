"""The least gamma by a Riccati equation: a route that shares nothing with the convex problem."""

from __future__ import annotations

import warnings

import numpy as np
from scipy.linalg import LinAlgError, eigh, solve_discrete_are, solve_discrete_lyapunov

from inswsn_lib.checks import Array, number
from inswsn_lib.errors import Described, ParameterError
from inswsn_lib.lmi.designs import LARGEST_GAP, InfeasibleDesignError, told_gap
from inswsn_lib.lmi.norms import hinf_norm, least_level, spectral_radius
from inswsn_lib.lmi.units import Units
from inswsn_lib.models import ErrorModel

_DOUBLINGS = 120
_ROUNDING = 1e-9
# How well a disturbance must lead where it is to lead
_MISSED = 1e-6
# Of a gain in `Units`, where that of the Kalman predictor, the first that is tried, may be endless
_HIGH, _LOW = 1e6, 1e-12
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
        None if none is found: no filter of the form (P1 2.9) has this bound, or the equation cannot
        be solved at it, as happens within a thousandth of the least one.

    Raises
    ------
    ParameterError
        If model or gamma is not such.
    InfeasibleDesignError
        If the numbers of the model are too far apart to be computed with.

    Examples
    --------
    No predictor of a random walk with noises of unit size has a gain below :math:`\sqrt 2`; with
    the gain of the Kalman predictor, one over the golden ratio, it is far from it:

    >>> import inswsn_lib as iw
    >>> model = iw.ErrorModel(A=[[1]], B=[[1]], C=[[1]], D=[[1]], period=1.0)
    >>> print(iw.lmi.riccati_filter(model, 1.41), iw.lmi.riccati_filter(model, 1000.0).round(3))
    None [[0.618]]
    """
    number("gamma", gamma, above=0, most=1e100)
    units = Units.of(model)
    scaled = _checked(units.scaled(model))
    found = _central(scaled, gamma / units.seen)
    return None if found is None else units.back @ found[0] @ units.outputs


def _central(model: ErrorModel, gamma: float) -> tuple[Array, Array, Array] | None:
    """Return gain, P and P after the measurement and L x, of a model in `Units`."""
    A, B, C, D, L = model.A, model.B, model.C, model.D, model.L
    R, cost, none = D @ D.T, gamma**2 * np.eye(len(L)), np.zeros((len(C), len(L)))
    both, weights = np.vstack([C, L]), np.block([[R, none], [none.T, -cost]])
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # what is returned is checked
            P = solve_discrete_are(A.T, both.T, B @ B.T, weights)
            after = P - P @ both.T @ np.linalg.solve(both @ P @ both.T + weights, both @ P)
            slack = cost - L @ P @ L.T
            seen = P + P @ L.T @ np.linalg.solve(slack, L @ P)
            gain = np.linalg.solve(R + C @ seen @ C.T, C @ seen @ A.T).T
            norm = hinf_norm(*model.error_system(gain))
    # eigenvalues on the unit circle, or too near to it; or numbers too large
    except (LinAlgError, ValueError):
        return None
    if np.linalg.eigvalsh(slack).min() <= 0 or not norm <= gamma * (1 + _ROUNDING):
        return None
    return gain, P, after


def riccati_gamma(model: ErrorModel, relative: float = 1e-8) -> float:
    r"""Return the least worst-case gain of a filter by bisection on `riccati_filter`.

    Parameters
    ----------
    model : ErrorModel
        As in `riccati_filter`, with B and L that are not zero.
    relative : float
        Width at which the bisection ends. What is certain is a thousandth, see below.

    Returns
    -------
    float
        Infinite if a mode that is not seen is not stable.

    Raises
    ------
    ParameterError
        If the model is not such, or there is no such accuracy.
    InfeasibleDesignError
        If the gamma that is found is more than a thousandth above what no filter can be below.

    Examples
    --------
    With a gain k up to a, the gain of :math:`e^+ = (a - k) e + w - k v` is
    :math:`\sqrt{1 + k^2} / (1 - a + k)`, and its least value :math:`\sqrt{1 + a^2}`, at k = a:

    >>> import inswsn_lib as iw
    >>> model = iw.ErrorModel(A=[[0.75]], B=[[1]], C=[[1]], D=[[1]], period=1.0)
    >>> print(f"{iw.lmi.riccati_gamma(model):.4f}")
    1.2500
    """
    number("relative", relative, least=1e-14, below=1)
    if not model.L.any() or not model.B.any():
        raise ParameterError("B and L", Described("zero"), "nonzero matrices")
    units = Units.of(model)
    scaled = _checked(units.scaled(model))
    # the Kalman predictor, in its units
    gain = scaled.A @ scaled.C.T
    high = hinf_norm(*scaled.error_system(gain))
    if high == np.inf and _hides_growth(scaled):
        return high
    # no filter undoes what one step does; if L does not see it, only the scale is known
    low = float(np.linalg.norm(scaled.L @ scaled.B, 2)) or _LOW
    high = least_level(
        lambda gamma: _central(scaled, gamma) is not None,
        low,
        min(high, _HIGH),
        relative,
        _DOUBLINGS,
    )
    found = None if high == np.inf else _central(scaled, high)
    lower = low if found is None else max(low, _unseen(scaled, *found[1:]))
    if not high <= lower * (1 + LARGEST_GAP + relative):
        raise InfeasibleDesignError(
            "The Riccati equation does not tell: "
            f"{told_gap(units.seen * lower, units.seen * high)}."
        )
    return units.seen * high


def _unseen(model: ErrorModel, P: Array, after: Array) -> float:
    r"""Return a worst-case gain that no filter can be below.

    Disturbances :math:`w = B'P^{-1}x^+` and :math:`v = -D^+Cx` lead along
    :math:`x = \Sigma A'P^{-1}x^+`, with :math:`\Sigma` after the measurement and L x, from nothing
    to any state. The outputs are zero, so that the state is the error of each filter. The best end
    is the largest eigenvalue of two energies.
    """
    A, B, C, D, L = model.A, model.B, model.C, model.D, model.L
    try:
        inverse = np.linalg.inv(P)
        back, w = after @ A.T @ inverse, B.T @ inverse
        v = np.linalg.pinv(D) @ C @ back
        misses = np.abs(A @ back + B @ w - np.eye(len(A))).max()
        if not (spectral_radius(back) < 1 and misses < _MISSED):
            return 0.0
        gained, spent = (solve_discrete_lyapunov(back.T, X) for X in (L.T @ L, w.T @ w + v.T @ v))
        return float(np.sqrt(eigh(gained, spent, eigvals_only=True)[-1]))
    except LinAlgError:  # a state to which nothing leads
        return 0.0


def _hides_growth(model: ErrorModel) -> bool:
    """Tell whether a mode that is not stable is not seen: the test of Popov, Belevitch, Hautus."""
    n = len(model.A)
    return any(
        np.linalg.matrix_rank(np.vstack([model.A - mode * np.eye(n), model.C])) < n
        for mode in np.linalg.eigvals(model.A)
        if abs(mode) >= 1
    )


def _checked(model: ErrorModel) -> ErrorModel:
    """Return a model in `Units`, in which ranks can be told; refuse one without the equation."""
    if model.E.any():
        raise ParameterError("E", Described("nonzero"), "zero, since the equation has no jitter")
    if np.linalg.matrix_rank(model.D) < len(model.D):
        raise ParameterError("D", Described("such that D D' is singular"), "of full row rank")
    n = len(model.A)
    for mode in np.linalg.eigvals(model.A):
        driven = np.hstack([model.A - mode * np.eye(n), model.B])
        if abs(abs(mode) - 1) < _ON_CIRCLE and np.linalg.matrix_rank(driven) < n:
            raise ParameterError(
                "B", Described("one that leaves a mode without noise"),
                "one that drives every mode on the unit circle",
            )  # fmt: skip
    return model
