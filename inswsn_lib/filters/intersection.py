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
from numpy.typing import ArrayLike

from inswsn_lib.checks import Array, Mask, array, covariance, of_runs, one_of
from inswsn_lib.errors import ParameterError
from inswsn_lib.filters.information import (
    Filters,
    Observations,
    applied,
    centre_states,
    checked_noise,
    inverses,
)
from inswsn_lib.filters.inputs import first_state
from inswsn_lib.models import ErrorModel

Rule = Literal["intersection", "best"]

_ROUNDING = 1e-9
_CENTRE = slice(-1, None)  # the centre's filter is the last


def intersect(
    estimates: ArrayLike, covariances: ArrayLike, weights: ArrayLike | str = "fast"
) -> tuple[Array, Array]:
    r"""Fuse estimates of the same state by covariance intersection (Julier and Uhlmann 1997).

    Parameters
    ----------
    estimates : array_like, (N, n) or (N, n, runs)
    covariances : array_like, (N, n, n) or (N, runs, n, n)
        Positive definite.
    weights : {"fast", "trace"} or array_like, (N,) or (N, runs)
        :math:`\omega`, not negative, of sum 1. "fast": in proportion to
        :math:`1 / \mathrm{tr} P_c`. "trace": those with the least trace of P, found by a convex
        minimisation; for covariances that all runs share.

    Returns
    -------
    state : ndarray, (n,) or (n, runs)
        The fused estimate.
    covariance : ndarray, (n, n) or (runs, n, n)
        P; one for all runs where covariances and weights are.

    Examples
    --------
    Two estimates, 0 m and 2 m, of variance 1. They may have made the same error, so the variance of
    their mean is not taken for 1/2:

    >>> import inswsn_lib as iw
    >>> state, covariance = iw.intersect([[0.0], [2.0]], [[[1.0]], [[1.0]]])
    >>> state.item(), covariance.item()
    (1.0, 1.0)
    """
    x, back = of_runs("estimates", estimates, "N", "n", "runs")
    clusters, n, runs = x.shape
    shapes = (clusters, n, n), (clusters, runs, n, n)
    P = covariance("covariances", covariances, *shapes, definite=True)
    shared = P.ndim == 3
    P = np.moveaxis(P[:, None] if shared else P, 1, -1)  # (N, n, n, 1 or runs)
    Y = inverses(P)
    if not isinstance(weights, str):
        omega = array("weights", weights, (clusters,), (clusters, runs))
        shared = shared and omega.ndim == 1
        omega = omega.reshape(clusters, -1)
        if omega.min(initial=0) < 0 or (np.abs(omega.sum(axis=0) - 1) > _ROUNDING).any():
            raise ParameterError("weights", weights, "non-negative and of sum 1")
    elif weights == "trace" and shared:
        omega = _least_trace(Y[..., 0])[:, None]
    else:
        one_of("weights", weights, ("fast",) if not shared else ("fast", "trace"))
        omega = _fast(_traces(P))
    fused = _mixed(omega, Filters(Y, applied(Y, x)))
    P = inverses(fused.Y[0])
    return back(fused.states()[0]), P[..., 0] if shared else np.moveaxis(P, -1, 0)


def _least_trace(Y: Array) -> Array:
    r"""Return the weights (N,) with the least trace of :math:`(\sum \omega_c Y_c)^{-1}`."""
    from scipy.optimize import minimize  # noqa: PLC0415  # runs of filters need numpy alone

    traces = np.trace(np.linalg.inv(Y), axis1=1, axis2=2)

    def cost(omega: Array) -> float:
        return float(np.trace(np.linalg.inv(np.tensordot(omega, Y, 1))) / traces.min())

    def slope(omega: Array) -> Array:
        P = np.linalg.inv(np.tensordot(omega, Y, 1))
        return np.asarray(-np.einsum("ij,cji->c", P @ P, Y) / traces.min())

    fast = _fast(traces)
    sum_is_one = {"type": "eq", "fun": lambda omega: omega.sum() - 1, "jac": np.ones_like}
    found = minimize(
        cost, fast, jac=slope, bounds=[(0, 1)] * len(Y), constraints=sum_is_one,
        method="SLSQP", options={"ftol": 1e-12, "maxiter": 200},
    )  # fmt: skip
    solved = np.clip(found.x, 0, 1)
    # the search may stop early; never worse than these
    candidates = [solved / solved.sum(), fast, np.eye(len(Y))[traces.argmin()]]
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
    model, measurements, measurement_covariance, initial_covariance
        As in `run_federated`. A cluster hears the node where any component is there.
    rule : {"intersection", "best"}
    process_covariance, initial_state, predicted
        As in `run_kalman`.

    Returns
    -------
    ndarray, (steps, n) or (steps, n, runs)

    Examples
    --------
    Two clusters that measure the same with the same variance are fused to what one of them knows:

    >>> import numpy as np
    >>> import inswsn_lib as iw
    >>> model = iw.ErrorModel(A=[[1]], B=[[1]], C=[[1]], D=[[1]], period=1.0)
    >>> y, noise = [[1.0], [5.0], [2.0]], {"initial_covariance": [[1]]}
    >>> fused = iw.run_fused_locals(model, [y, y], measurement_covariance=[[[1]], [[1]]], **noise)
    >>> bool(np.allclose(fused, iw.run_kalman(model, y, **noise)))
    True
    """
    one_of("rule", rule, get_args(Rule))
    y, back = of_runs("measurements", measurements, "N", "steps", len(model.C), "runs", gaps=True)
    prior, Qs, R = checked_noise(
        model, y, measurement_covariance, initial_covariance, process_covariance
    )
    x = first_state(initial_state, len(model.A), y.shape[-1])
    observed = Observations(y, model.C, R)
    # the last of the filters is the centre's, which holds the result
    whole = np.ones(len(y) + 1)  # each filter has all of Q
    filters = Filters.start(prior, x, whole, observed.heard.shape[-1])

    def plain(*_: object) -> tuple[Array, float]:
        estimates, now = np.empty((len(Qs), *x.shape)), filters
        for k in range(len(Qs)):
            if k:
                now = now.predicted(model.A, Qs[k - 1], whole)
            if predicted:
                estimates[k] = now.part(_CENTRE).states()[0]
            now = _fuse(rule, observed.heard[:, k], now.measured(*observed.at(k)))
            if not predicted:
                estimates[k] = now.part(_CENTRE).states()[0]
        return estimates, 0.0

    if filters.Y.shape[-1] != 1:
        return back(plain()[0])
    how = 1 + get_args(Rule).index(rule), 0, predicted
    return back(centre_states(plain, model.A, Qs, whole, filters, observed, *how))


def _fuse(rule: Rule, heard: Mask, filters: Filters) -> Filters:
    """Set the centre's filter to the fusion of those heard (N, K), and those not heard to it."""
    local, centre = filters.part(slice(-1)), filters.part(_CENTRE)
    some = np.any(heard, axis=0)
    # where none is heard any weights will do, since the centre's filter goes on
    traces = np.where(heard | ~some, _traces(inverses(local.Y)), np.inf)
    if rule == "best":
        omega = (traces.argmin(axis=0) == np.arange(len(traces))[:, None]).astype(float)
    else:
        omega = _fast(traces)
    centre = _mixed(omega, local).where(some[None], centre)
    return filters.where(np.concatenate([heard, np.zeros_like(heard[:1])]), centre)


def _traces(matrices: Array) -> Array:
    """Return the traces (N, K) of matrices (N, n, n, K)."""
    return np.asarray(np.einsum("ciik->ck", matrices))


def _fast(traces: Array) -> Array:
    """Return the weights (N, K) in proportion to 1 / trace; zero where it is infinite."""
    return np.asarray((1 / traces) / (1 / traces).sum(axis=0))


def _mixed(omega: Array, filters: Filters) -> Filters:
    """Return the one filter (1, ...) with the weighted sum (N, K) of the informations of all."""
    weighted = omega[:, None, None] * filters.Y, omega[:, None] * filters.i
    return Filters(*(each.sum(axis=0, keepdims=True) for each in weighted))
