r"""Carlson's federated filter: one local filter a cluster, and a centre that adds informations.

All filters estimate the same state, so that their errors share the first error and the process
noise. Carlson (1990), "Federated square root filter for decentralized parallel processes", IEEE
Trans. AES 26(3), bounds what they share: for factors :math:`\beta_c \ge 0` of sum 1,

.. math::
    \begin{bmatrix} Q & \cdots & Q \\ \vdots & & \vdots \\ Q & \cdots & Q \end{bmatrix}
    \preceq \mathrm{diag}(Q/\beta_1, Q/\beta_2, \ldots) ,

and the same for the covariance of the first state. Filters that start from :math:`P_0/\beta_c` and
predict with :math:`Q/\beta_c` may be fused as if their errors were independent: the informations
:math:`Y_c = P_c^{-1}` and :math:`Y_c \hat x_c` are added, and the sum is never optimistic. That
holds whichever measurements each filter has had; every rule below rests on it.

A share of zero is an infinite covariance. So filters are carried in the information form, and one
without a share of the process noise forgets all it knows in each prediction. (Where Q is singular
it could remember the part of the state that no noise reaches; the rule is then on the safe side.)
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Literal, get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray

from inswsn_lib.errors import ParameterError
from inswsn_lib.filters.inputs import (
    as_bools,
    as_floats,
    checked_clusters,
    checked_mask,
    cluster_covariances,
    covariances,
    definite,
    first_state,
    is_one_of,
)
from inswsn_lib.models import ErrorModel

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
Reset = Literal["fusion", "zero", "none"]

_ROUNDING = 1e-9
_MOST_COMPONENTS = 62  # bits of an int64 that stand for those that are there


def inverses(matrices: Array) -> Array:
    """Return the inverses of positive definite matrices (..., n, n, K), K of them side by side.

    Gauss and Jordan's elimination. It needs no pivoting for positive definite matrices, and its
    operations go over all K at once, which for small n is far quicker than a call for each. For
    one it is the other way round, and LAPACK is called.

    Raises
    ------
    ParameterError
        If a single matrix is singular to rounding, such as an information after a fix without any
        before it.
    """
    if matrices.shape[-1] == 1:
        try:
            return np.asarray(np.linalg.inv(matrices[..., 0])[..., None])
        except np.linalg.LinAlgError:
            raise ParameterError(
                "an information or covariance",
                "singular to rounding",
                "positive definite; initial_covariance may be too large beside R",
            ) from None
    work = matrices.copy()
    for p in range(work.shape[-2]):
        pivot = 1 / work[..., p, p, :]
        row = work[..., p, :, :] * pivot[..., None, :]
        column = work[..., :, p, :].copy()
        work -= column[..., :, None, :] * row[..., None, :, :]
        work[..., p, :, :] = row
        work[..., :, p, :] = -column * pivot[..., None, :]
        work[..., p, p, :] = pivot
    return work


def applied(matrices: Array, vectors: Array) -> Array:
    """Return the products of matrices (..., i, j, 1 or runs) with vectors (..., j, runs)."""
    if matrices.shape[-1] == 1:
        return np.asarray(matrices[..., 0] @ vectors)
    return np.asarray(np.einsum("...ijr,...jr->...ir", matrices, vectors))


def moved(transition: Array, matrices: Array) -> Array:
    """Return A P A' for matrices P (..., n, n, K)."""
    *lead, n, _, count = matrices.shape
    # Kronecker's product; np.kron takes longer than all the rest
    squared = (transition[:, None, :, None] * transition[None, :, None, :]).reshape(n * n, n * n)
    product = squared @ matrices.reshape(*lead, n * n, count)
    return np.asarray(product.reshape(matrices.shape))


def predicted_informations(
    Y: Array, information: Array, transition: Array, noises: Array
) -> tuple[Array, Array]:
    r"""Return :math:`Y^+ = (A Y^{-1} A' + Q)^{-1}` and :math:`Y^+ A Y^{-1} i`.

    Parameters
    ----------
    Y : ndarray, (filters, n, n, 1 or runs)
        Informations, positive definite.
    information : ndarray, (filters, n, runs)
        i = Y x.
    transition : ndarray, (n, n)
        A.
    noises : ndarray, (filters or 1, n, n)
        Q.
    """
    P = inverses(Y)
    ahead = inverses(moved(transition, P) + noises[..., None])
    return ahead, applied(ahead, transition @ applied(P, information))


class Observations:
    """What the measurements of clusters say, as informations, for runs with patterns of data.

    Where all runs miss the same data, matrices are kept once.

    Parameters
    ----------
    measurements : ndarray, (N, steps, m, runs)
        y; NaN where missing.
    C : ndarray, (m, n)
        How each cluster measures the state.
    R : ndarray, (N, 1 or steps, m, m)
        Covariances, positive definite.
    lost : ndarray of bool, (N, steps, runs), optional
        It is kept once as well where all runs share it and the data they miss.

    Attributes
    ----------
    patterns : int
        1, or the number of runs.
    heard : ndarray of bool, (N, steps, patterns)
        Whether any component is there.
    lost : ndarray of bool, (N, steps, patterns), or None
        As given.
    """

    def __init__(self, measurements: Array, C: Array, R: Array, lost: Mask | None = None) -> None:
        there = ~np.isnan(measurements)
        shared = bool((there == there[..., :1]).all())
        if lost is not None:
            shared = shared and bool((lost == lost[..., :1]).all())
        if shared:
            there = there[..., :1]
            lost = None if lost is None else lost[..., :1]
        self.lost = lost
        self.heard: Mask = np.asarray(there.any(axis=2))
        self.patterns: int = there.shape[-1]
        self._values = np.nan_to_num(measurements)  # their weight is zero
        masks, self._which = _component_masks(there)
        # an absent component gets a row and a column of the identity, and then of zeros
        both = masks[:, :, None] & masks[:, None, :]
        inner = np.where(both, R[:, :, None], np.eye(len(C)))
        weights = np.where(both, np.linalg.inv(inner), 0.0)
        self._gains = np.moveaxis(C.T @ weights, 2, -1)  # (N, 1 or steps, n, m, masks)
        self._matrices = np.moveaxis(C.T @ weights @ C, 2, -1)

    def at(self, step: int) -> tuple[Array, Array]:
        """Return C'R^-1 C (N, n, n, patterns) and C'R^-1 y (N, n, runs) of the present data."""
        when = step if self._gains.shape[1] > 1 else 0
        which = self._which[:, step]
        gains = _taken(self._gains[:, when], which)
        matrices = _taken(self._matrices[:, when], which)
        return matrices, applied(gains, self._values[:, step])


def _component_masks(there: Mask) -> tuple[Mask, NDArray[np.intp]]:
    """Return the masks (masks, m) that occur and which of them (N, steps, K) is where."""
    outputs = there.shape[2]
    if outputs > _MOST_COMPONENTS:
        raise ParameterError(
            "measurements",
            f"of {outputs} components a cluster",
            f"of {_MOST_COMPONENTS} components a cluster at most",
        )
    flat = np.moveaxis(there, 2, -1)
    packed = flat @ (1 << np.arange(outputs, dtype=np.int64))
    found, which = np.unique(packed, return_inverse=True)
    masks = (found[:, None] >> np.arange(outputs)) & 1 == 1
    return masks, which.reshape(packed.shape)


def _taken(tables: Array, which: NDArray[np.intp]) -> Array:
    """Return from tables (N, i, j, masks) the entries (N, i, j, K) that which (N, K) names."""
    return np.stack(
        [table.take(entry, axis=-1) for table, entry in zip(tables, which, strict=True)]
    )


def checked_noise(
    model: ErrorModel,
    steps: int,
    initial_covariance: ArrayLike,
    process_covariance: ArrayLike | None,
) -> tuple[Array, Array]:
    """Return P_0 (n, n) and Q (steps, n, n) with which every predicted covariance is definite."""
    n = len(model.A)
    P0 = definite(
        "initial_covariance", covariances("initial_covariance", initial_covariance, 1, n)[0]
    )
    Q = model.process_covariance if process_covariance is None else process_covariance
    Qs = covariances("process_covariance", Q, steps, n)
    # A P A' + Q is positive definite for each positive definite P if, and only if, it is for I
    definite("process_covariance", model.A @ model.A.T + Qs)
    return P0, Qs


def run_federated(
    model: ErrorModel,
    measurements: ArrayLike,
    *,
    measurement_covariance: ArrayLike,
    initial_covariance: ArrayLike,
    sharing: ArrayLike | None = None,
    reset: Reset = "fusion",
    interval: int = 1,
    process_covariance: ArrayLike | None = None,
    lost: ArrayLike | None = None,
    initial_state: ArrayLike | None = None,
    predicted: bool = False,
) -> Array:
    r"""Run Carlson's federated filter (1990) over any number of runs at once.

    Cluster c runs a Kalman filter of its own, from :math:`P_0/\beta_c` and with process noise
    :math:`Q/\beta_c`; the master has no measurements and the share :math:`\beta_m`. The fused
    estimate of every step, between resets as well, is

    .. math::
        P_f^{-1} = \sum_c P_c^{-1}, \qquad \hat x_f = P_f \sum_c P_c^{-1} \hat x_c .

    - Reset "fusion": at the end of each interval every filter, the master included, is set to
      :math:`\hat x_f` and :math:`P_f/\beta_c`. With an interval of 1 the result is the Kalman
      filter of all measurements, whatever the shares.
    - Reset "zero": at the end of each interval the master takes :math:`\hat x_f, P_f`, and the
      clusters are left with no information. The master has all process noise, so that the clusters
      have infinite process noise: with an interval of 1 the result is the Kalman filter of all
      measurements; with a longer one the measurement of a step inside an interval is used in the
      fused estimate of its own step only. To keep it without a share of the noise would be
      optimistic.
    - Reset "none": filters go on by themselves, and the fused estimate is not fed back. It is not
      optimal, since each filter takes the process noise for larger than it is. (Clusters that are
      equal in all, shares and losses included, are an exception: their mean is the Kalman filter.)

    Between resets the clusters go on with :math:`Q/\beta_c`, and the fused covariance is an upper
    bound of the true one for every interval, by the bound of this module's description.

    Where a message is lost the centre uses the last one that it received since the last reset, or
    what the reset itself gave, aged by :math:`A P A' + Q/\beta_c`. With a reset in every step that
    is as if the cluster had not measured. The local filter goes on with its measurement, so that
    the next message that arrives before a reset brings it. The way back is never lost.

    Parameters
    ----------
    model : ErrorModel
        A, C (of every cluster), and by default Q = B B'.
    measurements : array_like, (N, steps, m, runs)
        y of each cluster; NaN where a component is missing.
    measurement_covariance : array_like, (N, m, m) or (N, steps, m, m)
        R of each cluster, positive definite; the noises of two clusters are independent.
    initial_covariance : array_like, (n, n)
        P_0, before the first measurement, positive definite.
    sharing : array_like, (N + 1,), optional
        :math:`\beta` of the clusters and, last, of the master: not negative, of sum 1. Default:
        1/N for each cluster and 0 for the master; with reset "zero", all for the master, which is
        then the only value allowed.
    reset : {"fusion", "zero", "none"}
        See above.
    interval : int
        Steps from one reset to the next: the first is after step `interval` - 1.
    process_covariance : array_like, (n, n) or (steps, n, n), optional
        Q; entry k drives step k to k + 1, and the last is not used.
    lost : array_like of bool, (N, steps, runs), optional
        Whether the message of a cluster at a step does not reach the centre. Default: none is.
    initial_state : array_like, (n,) or (n, runs), optional
        The state before the first measurement. Default: zero.
    predicted : bool
        Return the fused state before the measurements of each step instead of after them.

    Returns
    -------
    ndarray, (steps, n, runs)

    Raises
    ------
    ParameterError
        If a shape does not fit, something is not numbers, a measurement is infinite, a cluster
        measures more than 62 components, a covariance is not one, P_0 or R is singular, A and Q
        let a predicted covariance be singular, the shares are negative or do not add up to 1, or
        reset or interval is none of those above.

    Examples
    --------
    Two clusters of variance 2 that measure the same are one sensor of variance 1. Reset in each
    step, the federated filter is the Kalman filter of that sensor:

    >>> import numpy as np
    >>> from inswsn_lib.filters import run_federated, run_kalman
    >>> from inswsn_lib.models import ErrorModel
    >>> model = ErrorModel(A=[[1]], B=[[1]], C=[[1]], D=[[1]], L=[[1]], E=[[0]], period=1.0)
    >>> y = np.array([1.0, 5.0, 2.0]).reshape(3, 1, 1)
    >>> R = [[[2.0]], [[2.0]]]
    >>> fused = run_federated(model, [y, y], measurement_covariance=R, initial_covariance=[[1.0]])
    >>> bool(np.allclose(fused, run_kalman(model, y, initial_covariance=[[1.0]])))
    True
    """
    y = checked_clusters(measurements, len(model.C))
    clusters, steps, outputs, runs = y.shape
    shares = _shares(sharing, clusters, reset, interval)
    P0, Qs = checked_noise(model, steps, initial_covariance, process_covariance)
    R = cluster_covariances(
        "measurement_covariance", measurement_covariance, clusters, steps, outputs
    )
    gone = None if lost is None else checked_mask("lost", lost, (clusters, steps, runs))
    observed = Observations(y, model.C, R, gone)
    x = first_state(initial_state, len(model.A), runs)
    every = 0 if reset == "none" else interval
    estimates = np.empty((steps, *x.shape))
    fused = _fused(model.A, Qs, observed, shares, every, P0, x, predicted)
    for k, (Y, information) in enumerate(fused):
        estimates[k] = applied(inverses(Y), information)
    return estimates


def federated_covariance(
    model: ErrorModel,
    available: ArrayLike,
    *,
    measurement_covariance: ArrayLike,
    initial_covariance: ArrayLike,
    sharing: ArrayLike | None = None,
    reset: Reset = "fusion",
    interval: int = 1,
    process_covariance: ArrayLike | None = None,
    lost: ArrayLike | None = None,
    predicted: bool = False,
) -> Array:
    """Return the covariance that the federated filter claims for its fused estimate.

    It does not depend on the measured values, and is an upper bound of the covariance of the error.

    Parameters
    ----------
    model, measurement_covariance, initial_covariance, sharing, reset, interval
        See `run_federated`.
    available : array_like of bool, (steps, N)
        Which clusters measure at each step, all components of them.
    process_covariance
        See `run_federated`.
    lost : array_like of bool, (steps, N), optional
        Whose messages are lost at each step.
    predicted : bool
        Before the measurements of each step instead of after them.

    Returns
    -------
    ndarray, (steps, n, n)

    Raises
    ------
    ParameterError
        See `run_federated`.

    Examples
    --------
    Of two clusters of variance 2 the second falls silent at step 1. With a reset in each step what
    the filter claims is the covariance of a Kalman filter, 1/2 and then 6/7:

    >>> from inswsn_lib.filters import federated_covariance
    >>> from inswsn_lib.models import ErrorModel
    >>> model = ErrorModel(A=[[1]], B=[[1]], C=[[1]], D=[[1]], L=[[1]], E=[[0]], period=1.0)
    >>> covariance = federated_covariance(
    ...     model,
    ...     [[True, True], [True, False]],
    ...     measurement_covariance=[[[2.0]], [[2.0]]],
    ...     initial_covariance=[[1.0]],
    ... )
    >>> covariance.ravel().round(4).tolist()
    [0.5, 0.8571]
    """
    may_be = "bool of shape (steps, N)"
    mask = as_bools("available", available, may_be)
    if mask.ndim != 2 or not mask.shape[1]:
        raise ParameterError("available", f"{mask.dtype} of shape {mask.shape}", may_be)
    steps, clusters = mask.shape
    shares = _shares(sharing, clusters, reset, interval)
    P0, Qs = checked_noise(model, steps, initial_covariance, process_covariance)
    m, n = model.C.shape
    R = cluster_covariances("measurement_covariance", measurement_covariance, clusters, steps, m)
    gone = None if lost is None else checked_mask("lost", lost, (steps, clusters)).T[..., None]
    y = np.where(mask.T[:, :, None, None], np.zeros((m, 1)), np.nan)
    observed, every = Observations(y, model.C, R, gone), 0 if reset == "none" else interval
    covariance = np.empty((steps, n, n))
    fused = _fused(model.A, Qs, observed, shares, every, P0, np.zeros((n, 1)), predicted)
    for k, (Y, _) in enumerate(fused):
        covariance[k] = inverses(Y)[..., 0]
    return covariance


def _shares(sharing: ArrayLike | None, clusters: int, reset: str, interval: int) -> Array:
    """Return the sharing factors (N + 1,), checked with what goes with them."""
    if not is_one_of(reset, get_args(Reset)):
        raise ParameterError("reset", reset, '"fusion", "zero" or "none"')
    if not (isinstance(interval, (int, np.integer)) and interval >= 1):
        raise ParameterError("interval", interval, "a whole number of steps, 1 or more")
    default = np.zeros(clusters + 1)
    if reset == "zero":
        default[-1] = 1.0
    else:
        default[:-1] = 1 / clusters
    if sharing is None:
        return default
    may_be = f"{clusters} shares and the master's, not negative, of sum 1"
    shares = as_floats("sharing", sharing, may_be)
    fits = shares.shape == default.shape and np.isfinite(shares).all() and shares.min() >= 0
    if not fits or abs(shares.sum() - 1) > _ROUNDING:
        raise ParameterError("sharing", sharing, may_be)
    if reset == "zero" and shares[-1] < 1 - _ROUNDING:
        raise ParameterError("sharing", sharing, 'all for the master where reset is "zero"')
    return default if reset == "zero" else shares / shares.sum()


def _fused(
    A: Array,
    Qs: Array,
    observed: Observations,
    shares: Array,
    every: int,
    P0: Array,
    x: Array,
    predicted: bool,
) -> Iterator[tuple[Array, Array]]:
    """Yield Y_f (n, n, patterns) and Y_f x_f (n, runs) of every step; no reset if `every` is 0."""
    clusters = len(shares) - 1

    def shared(Y: Array, information: Array) -> tuple[Array, Array]:
        return shares[:, None, None, None] * Y, shares[:, None, None] * information

    prior = np.linalg.inv(P0)
    start = np.broadcast_to(prior[..., None], (*prior.shape, observed.patterns))
    local, held = shared(start, prior @ x), shared(start, prior @ x)
    for k in range(len(Qs)):
        if k:
            local = _predicted(A, Qs[k - 1], shares, *local)
            # as long as no message is lost, what the centre holds is what the clusters have
            held = local if observed.lost is None else _predicted(A, Qs[k - 1], shares, *held)
        if predicted:
            yield held[0].sum(axis=0), held[1].sum(axis=0)
        for total, added in zip(local, observed.at(k), strict=True):
            total[:clusters] += added
        held = _received(None if observed.lost is None else observed.lost[:, k], local, held)
        fused = held[0].sum(axis=0), held[1].sum(axis=0)
        if not predicted:
            yield fused
        if every and (k + 1) % every == 0:
            local = held = shared(*fused)


def _predicted(
    A: Array, Q: Array, shares: Array, Y: Array, information: Array
) -> tuple[Array, Array]:
    """Predict filters one step; one without a share forgets all it knows."""
    some = shares > 0
    ahead, moved_on = np.zeros(Y.shape), np.zeros(information.shape)
    noises = Q / shares[some, None, None]
    ahead[some], moved_on[some] = predicted_informations(Y[some], information[some], A, noises)
    return ahead, moved_on


def _received(
    lost: Mask | None, local: tuple[Array, Array], held: tuple[Array, Array]
) -> tuple[Array, Array]:
    """Return what the centre holds after the messages of a step: those lost (N, K) leave it."""
    if lost is None:
        return local
    gone = np.concatenate([lost, np.zeros((1, lost.shape[1]), dtype=bool)])  # never the master's
    return (
        np.where(gone[:, None, None, :], held[0], local[0]),
        np.where(gone[:, None, :], held[1], local[1]),
    )
