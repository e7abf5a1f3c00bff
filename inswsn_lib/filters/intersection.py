r"""Covariance intersection: the fusion of estimates whose errors are correlated in an unknown way.

Julier and Uhlmann (1997), "A non-divergent estimation algorithm in the presence of unknown
correlations", Proc. American Control Conference: for weights :math:`\omega_c \ge 0` of sum 1,

.. math::
    P^{-1} = \sum_c \omega_c P_c^{-1}, \qquad \hat x = P \sum_c \omega_c P_c^{-1} \hat x_c

is consistent, that is P bounds the covariance of the fused error from above, whatever the
correlations, if each of the P_c is.
"""

from __future__ import annotations

from typing import Literal, get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.optimize import minimize

from inswsn_lib.errors import ParameterError
from inswsn_lib.filters.federated import (
    Observations,
    applied,
    checked_noise,
    inverses,
    predicted_informations,
)
from inswsn_lib.filters.inputs import (
    as_floats,
    checked_clusters,
    cluster_covariances,
    covariances,
    definite,
    first_state,
    is_one_of,
)
from inswsn_lib.models import ErrorModel

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
Rule = Literal["intersection", "best"]

_ROUNDING = 1e-9


def intersect(
    estimates: ArrayLike, covariances: ArrayLike, weights: ArrayLike | str | None = None
) -> tuple[Array, Array]:
    r"""Fuse estimates of the same state by covariance intersection (Julier and Uhlmann 1997).

    Parameters
    ----------
    estimates : array_like, (N, n, runs)
        The estimates.
    covariances : array_like, (N, n, n) or (N, runs, n, n)
        Their covariances, positive definite.
    weights : {"fast", "trace"} or array_like, (N,) or (N, runs), optional
        :math:`\omega`, not negative, of sum 1. "fast", the default: in proportion to
        :math:`1 / \mathrm{tr} P_c`. "trace": those with the least trace of P, found by a convex
        minimisation; for covariances that all runs share.

    Returns
    -------
    state : ndarray, (n, runs)
        The fused estimate.
    covariance : ndarray, (n, n) or (runs, n, n)
        P; one for all runs where covariances and weights are.

    Raises
    ------
    ParameterError
        If a shape does not fit, something is not numbers or not finite, a covariance is not
        symmetric and positive definite, or the weights are negative, do not add up to 1, or have
        an unknown name.

    Examples
    --------
    Two estimates, 0 m and 2 m, of variance 1. They may have made the same error, so the variance of
    their mean is not taken for 1/2:

    >>> from inswsn_lib.filters import intersect
    >>> state, covariance = intersect([[[0.0]], [[2.0]]], [[[1.0]], [[1.0]]])
    >>> state.item(), covariance.item()
    (1.0, 1.0)
    """
    x = as_floats("estimates", estimates, "finite, (N, n, runs)")
    if x.ndim != 3 or not len(x) or not np.isfinite(x).all():
        raise ParameterError("estimates", f"of shape {x.shape}", "finite, (N, n, runs)")
    P = _checked_covariances(covariances, x.shape)
    shared = P.shape[-1] == 1 and np.ndim(covariances) == 3
    Y = inverses(P)
    if isinstance(weights, str) and weights == "trace":
        if not shared:
            raise ParameterError("weights", weights, "another where runs have their covariances")
        omega = _least_trace_weights(Y[..., 0])[:, None]
    elif weights is None or (isinstance(weights, str) and weights == "fast"):
        omega = _fast(_traces(P))
    else:
        omega = _checked_weights(weights, len(x), x.shape[2])
        shared = shared and np.ndim(weights) == 1
    total, information = _mixed(omega, Y, applied(Y, x))
    fused = inverses(total)
    covariance = fused[..., 0] if shared else np.moveaxis(fused, -1, 0)
    return applied(fused, information), covariance


def _least_trace_weights(informations: Array) -> Array:
    r"""Return the weights :math:`\omega` with the least trace of :math:`(\sum \omega_c Y_c)^{-1}`.

    The trace is a convex function of the weights. Never worse than the weights in proportion to
    :math:`1 / \mathrm{tr} P_c`, or than the best estimate alone.

    Parameters
    ----------
    informations : ndarray, (N, n, n)
        Y, positive definite.

    Returns
    -------
    ndarray, (N,)
    """
    clusters = len(informations)
    P = np.linalg.inv(informations)
    traces = np.trace(P, axis1=1, axis2=2)
    scale = traces.min()

    def cost(omega: Array) -> float:
        return float(np.trace(np.linalg.inv(np.tensordot(omega, informations, 1))) / scale)

    def slope(omega: Array) -> Array:
        fused = np.linalg.inv(np.tensordot(omega, informations, 1))
        return np.asarray(-np.einsum("ij,cji->c", fused @ fused, informations) / scale)

    fast = (1 / traces) / (1 / traces).sum()
    sum_is_one = {"type": "eq", "fun": lambda omega: omega.sum() - 1, "jac": np.ones_like}
    found = minimize(
        cost, fast, jac=slope, bounds=[(0, 1)] * clusters, constraints=sum_is_one,
        method="SLSQP", options={"ftol": 1e-12, "maxiter": 200},
    )  # fmt: skip
    solved = np.clip(found.x, 0, 1)
    candidates = [solved / solved.sum(), fast, np.eye(clusters)[traces.argmin()]]
    return np.asarray(min(candidates, key=cost))


def run_fused_locals(
    model: ErrorModel,
    measurements: ArrayLike,
    *,
    measurement_covariance: ArrayLike,
    initial_covariance: ArrayLike,
    rule: Rule = "intersection",
    process_covariance: ArrayLike | None = None,
    initial_state: ArrayLike | None = None,
    predicted: bool = False,
) -> Array:
    r"""Run a Kalman filter in each cluster and fuse them without knowing how they are correlated.

    Each filter has the full P_0 and Q. At each step the centre takes the clusters that hear the
    node, and fuses their estimates by covariance intersection with weights in proportion to
    :math:`1 / \mathrm{tr} P_c`, or takes the one whose covariance has the least trace, the first of
    equals. A cluster that does not hear the node is set to the result, state and covariance. Where
    none hears it, the last result is predicted.

    Parameters
    ----------
    model : ErrorModel
        A, C (of every cluster), and by default Q = B B'.
    measurements : array_like, (N, steps, m, runs)
        y of each cluster; NaN where a component is missing. A cluster hears the node where any
        component is there.
    measurement_covariance : array_like, (N, m, m) or (N, steps, m, m)
        R of each cluster, positive definite.
    initial_covariance : array_like, (n, n)
        P_0, before the first measurement, positive definite.
    rule : {"intersection", "best"}
        See above.
    process_covariance : array_like, (n, n) or (steps, n, n), optional
        Q; entry k drives step k to k + 1, and the last is not used.
    initial_state : array_like, (n,) or (n, runs), optional
        The state before the first measurement. Default: zero.
    predicted : bool
        Return the result of the step before, predicted, instead of that of the step.

    Returns
    -------
    ndarray, (steps, n, runs)

    Raises
    ------
    ParameterError
        If a shape does not fit, something is not numbers, a measurement is infinite, a cluster
        measures more than 62 components, a covariance is not one, P_0 or R is singular, A and Q
        let a predicted covariance be singular, or the rule is unknown.

    Examples
    --------
    Two clusters that measure the same with the same variance are fused to what one of them knows:

    >>> import numpy as np
    >>> from inswsn_lib.filters import run_fused_locals, run_kalman
    >>> from inswsn_lib.models import ErrorModel
    >>> model = ErrorModel(A=[[1]], B=[[1]], C=[[1]], D=[[1]], L=[[1]], E=[[0]], period=1.0)
    >>> y = np.array([1.0, 5.0, 2.0]).reshape(3, 1, 1)
    >>> R = [[[1.0]], [[1.0]]]
    >>> P0 = [[1.0]]
    >>> fused = run_fused_locals(model, [y, y], measurement_covariance=R, initial_covariance=P0)
    >>> bool(np.allclose(fused, run_kalman(model, y, initial_covariance=P0)))
    True
    """
    if not is_one_of(rule, get_args(Rule)):
        raise ParameterError("rule", rule, '"intersection" or "best"')
    y = checked_clusters(measurements, len(model.C))
    clusters, steps, outputs, runs = y.shape
    P0, Qs = checked_noise(model, steps, initial_covariance, process_covariance)
    R = cluster_covariances(
        "measurement_covariance", measurement_covariance, clusters, steps, outputs
    )
    observed = Observations(y, model.C, R)
    x = first_state(initial_state, len(model.A), runs)
    prior = np.linalg.inv(P0)
    # the last of the filters is the centre's, which holds the result
    Y = np.tile(prior[..., None], (clusters + 1, 1, 1, observed.patterns))
    information = np.tile(prior @ x, (clusters + 1, 1, 1))
    estimates = np.empty((steps, *x.shape))
    for k in range(steps):
        if k:
            Y, information = predicted_informations(Y, information, model.A, Qs[k - 1][None])
        if predicted:
            estimates[k] = applied(inverses(Y[-1]), information[-1])
        for total, added in zip((Y, information), observed.at(k), strict=True):
            total[:-1] += added
        _fuse(rule, observed.heard[:, k], Y, information)
        if not predicted:
            estimates[k] = applied(inverses(Y[-1]), information[-1])
    return estimates


def _fuse(rule: Rule, heard: Mask, Y: Array, information: Array) -> None:
    """Fuse the filters that are heard (N, K); the result goes to the others and to the centre's."""
    traces = np.where(heard, _traces(inverses(Y[:-1])), np.inf)
    if rule == "best":
        omega = (traces.argmin(axis=0) == np.arange(len(traces))[:, None]).astype(float)
    else:
        traces[:, ~heard.any(axis=0)] = 1.0  # any number: the result is not used
        omega = _fast(traces)
    total, mixed = _mixed(omega, Y[:-1], information[:-1])
    some = heard.any(axis=0)
    Y[-1], information[-1] = np.where(some, total, Y[-1]), np.where(some, mixed, information[-1])
    Y[:-1] = np.where(heard[:, None, None, :], Y[:-1], Y[-1])
    information[:-1] = np.where(heard[:, None, :], information[:-1], information[-1])


def _traces(matrices: Array) -> Array:
    """Return the traces (N, K) of matrices (N, n, n, K)."""
    return np.asarray(np.einsum("ciik->ck", matrices))


def _fast(traces: Array) -> Array:
    """Return the weights (N, K) in proportion to 1 / trace; zero where it is infinite."""
    return np.asarray((1 / traces) / (1 / traces).sum(axis=0))


def _mixed(omega: Array, Y: Array, information: Array) -> tuple[Array, Array]:
    """Return the weighted sums of informations."""
    return (omega[:, None, None, :] * Y).sum(axis=0), (omega[:, None, :] * information).sum(axis=0)


def _checked_covariances(given: ArrayLike, shape: tuple[int, ...]) -> Array:
    """Return covariances as (N, n, n, 1 or runs)."""
    clusters, n, runs = shape
    shapes = (clusters, n, n), (clusters, runs, n, n)
    may_be = f"numbers {shapes[0]} or {shapes[1]}"
    P = as_floats("covariances", given, may_be)
    if P.shape not in shapes:
        raise ParameterError("covariances", f"of shape {P.shape}", may_be)
    flat = P.reshape(-1, n, n)
    covariances("covariances", flat, len(flat), n)
    return np.moveaxis(definite("covariances", flat).reshape(clusters, -1, n, n), 1, -1)


def _checked_weights(given: ArrayLike, clusters: int, runs: int) -> Array:
    """Return weights as (N, 1 or runs)."""
    expected = (
        f'"fast", "trace" or ({clusters},) or ({clusters}, {runs}) numbers, 0 or more, of sum 1'
    )
    if isinstance(given, str):
        raise ParameterError("weights", given, expected)
    omega = as_floats("weights", given, expected)
    if omega.shape not in ((clusters,), (clusters, runs)) or not np.isfinite(omega).all():
        raise ParameterError("weights", f"of shape {omega.shape}", expected)
    if omega.min(initial=0) < 0 or (np.abs(omega.sum(axis=0) - 1) > _ROUNDING).any():
        raise ParameterError("weights", "negative or of another sum", expected)
    return omega.reshape(clusters, -1)
