r"""Carlson's federated filter: one local filter per cluster, and a centre that adds information.

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
from typing import Any, Literal, NamedTuple, Self, get_args

import numpy as np
from numpy.typing import ArrayLike

from inswsn_lib.checks import Array, Mask, array, mask, of_runs, one_of, whole
from inswsn_lib.errors import ParameterError
from inswsn_lib.filters.information import (
    Filters,
    Observations,
    centre_states,
    checked_noise,
    inverses,
)
from inswsn_lib.filters.inputs import first_state, once
from inswsn_lib.models import ErrorModel

Reset = Literal["fusion", "zero", "none"]

_ROUNDING = 1e-9


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
    r"""Run Carlson's federated filter (1990) over one run, or any number at once.

    Cluster c runs a Kalman filter of its own, from :math:`P_0/\beta_c` and with process noise
    :math:`Q/\beta_c`; the master has no measurements and the share :math:`\beta_m`. The fused
    estimate of every step, between resets as well, is

    .. math::
        P_f^{-1} = \sum_c P_c^{-1}, \qquad \hat x_f = P_f \sum_c P_c^{-1} \hat x_c .

    - Reset "fusion": after each interval every filter is set to :math:`\hat x_f` and
      :math:`P_f/\beta_c`. With an interval of 1 the result is the Kalman filter of all
      measurements, whatever the shares.
    - Reset "zero": after each interval the master takes all. The clusters have no share, so that
      inside an interval a measurement is used in the fused estimate of its own step only.
    - Reset "none": the fused estimate is not fed back. It is not optimal, since each filter takes
      the process noise for larger than it is, unless the clusters are equal in all.

    Estimates are those of 50 digits to 1e-7 of their size or deviation for ratios of Q to R from
    10^-12 to 10^6, to 1e-6 where P_0 is 10^8 times R, and to 1e-3 for ratios to 10^12. Where more
    is lost, as with a singular Q that is 10^12 times R, the filter raises a ParameterError.

    Where a message is lost the centre uses the last one since the last reset, or what the reset
    gave, aged by :math:`A P A' + Q/\beta_c`. The next message before a reset brings the
    measurements of those lost. The way back is never lost.

    Parameters
    ----------
    model : ErrorModel
        A, C (of every cluster), and by default Q = B B'.
    measurements : array_like, (N, steps, m) or (N, steps, m, runs)
        y of each cluster; NaN where a component is missing.
    measurement_covariance : array_like, (N, m, m) or (N, steps, m, m)
        R of each cluster, positive definite; the noises of two clusters are independent.
    initial_covariance : array_like, (n, n)
        P_0, before the first measurement, positive definite.
    sharing : array_like, (N + 1,), optional
        :math:`\beta` of the clusters and, last, of the master: not negative, of sum 1. Default:
        1/N for each cluster; with reset "zero", all for the master, the only value allowed then.
    reset : {"fusion", "zero", "none"}
    interval : int
        Steps from one reset to the next: the first is after step `interval` - 1.
    lost : array_like of bool, (N, steps) or (N, steps, runs), as measurements, optional
        Whether the message of a cluster at a step does not reach the centre. Default: none is.
    process_covariance, initial_state, predicted
        As in `run_kalman`.

    Returns
    -------
    ndarray, (steps, n) or (steps, n, runs)

    Examples
    --------
    Two clusters of variance 2 that measure the same are one sensor of variance 1:

    >>> import numpy as np
    >>> import inswsn_lib as iw
    >>> model = iw.ErrorModel(A=[[1]], B=[[1]], C=[[1]], D=[[1]], period=1.0)
    >>> y, R = [[1.0], [5.0], [2.0]], [[[2]], [[2]]]
    >>> fused = iw.run_federated(model, [y, y], measurement_covariance=R, initial_covariance=[[1]])
    >>> bool(np.allclose(fused, iw.run_kalman(model, y, initial_covariance=[[1]])))
    True
    """
    y, back = of_runs("measurements", measurements, "N", "steps", len(model.C), "runs", gaps=True)
    one = y[:, :, 0]  # component, (N, steps, runs)
    gone = None if lost is None else mask("lost", lost, back(one).shape).reshape(one.shape)
    x = first_state(initial_state, len(model.A), y.shape[3])
    given = _Given.of(
        model, y, x, measurement_covariance, initial_covariance, sharing, reset, interval,
        process_covariance,
    )  # fmt: skip

    def plain(*_: object) -> tuple[Array, float]:
        estimates = np.empty((y.shape[1], *x.shape))
        for k, each in enumerate(_fused(given, gone, predicted)):
            estimates[k] = each.states()
        return estimates, 0.0

    if gone is not None or given.start.Y.shape[-1] != 1:
        return back(plain()[0])
    return back(centre_states(plain, *given[:5], 0, given.every, predicted))


def federated_covariance(
    model: ErrorModel, available: ArrayLike, *, lost: ArrayLike | None = None, **options: Any
) -> Array:
    """Return the covariance that the federated filter claims for its fused estimate.

    It is an upper bound of the covariance of the error.

    Parameters
    ----------
    model : ErrorModel
    available : array_like of bool, (steps, N)
        Which clusters measure at each step, all components of them.
    lost : array_like of bool, (steps, N), optional
        Whose messages are lost at each step.
    **options
        As in `run_federated`, but for the initial state.

    Returns
    -------
    ndarray, (steps, n, n)

    Examples
    --------
    Two clusters of variance 2 are a sensor of variance 1, and 1/1 + 1/1 is an information of 2:

    >>> import inswsn_lib as iw
    >>> model = iw.ErrorModel(A=[[1]], B=[[1]], C=[[1]], D=[[1]], period=1.0)
    >>> noise = {"measurement_covariance": [[[2]], [[2]]], "initial_covariance": [[1]]}
    >>> iw.federated_covariance(model, [[True, True]], **noise).tolist()
    [[[0.5]]]
    """
    heard = mask("available", available, ("steps", "N"))
    gone = None if lost is None else mask("lost", lost, heard.shape).T[..., None]
    m, n = model.C.shape
    y = np.where(heard.T[:, :, None, None], np.zeros((m, 1)), np.nan)
    predicted = options.pop("predicted", False)
    fused = _fused(_Given.of(model, y, np.zeros((n, 1)), **options), gone, predicted)
    return np.array([inverses(each.Y)[..., 0] for each in fused]).reshape(-1, n, n)


def _shares(sharing: ArrayLike | None, clusters: int, reset: str) -> Array:
    """Return the sharing factors (N + 1,), checked."""
    masters = float(reset == "zero")
    if sharing is None:
        return np.append(np.full(clusters, (1 - masters) / clusters), masters)
    shares = array("sharing", sharing, (clusters + 1,))
    if shares.min() < 0 or abs(shares.sum() - 1) > _ROUNDING or shares[-1] < masters:
        must_be = 'non-negative, of sum 1, and all for the master if reset is "zero"'
        raise ParameterError("sharing", sharing, must_be)
    return np.asarray(shares / shares.sum())


class _Given(NamedTuple):
    """What federated filters are given, checked; the sum is shared out every so many steps."""

    A: Array
    Qs: Array
    shares: Array
    start: Filters
    observed: Observations
    every: int

    @classmethod
    def of(
        cls,
        model: ErrorModel,
        y: Array,
        x: Array,
        measurement_covariance: ArrayLike,
        initial_covariance: ArrayLike,
        sharing: ArrayLike | None = None,
        reset: Reset = "fusion",
        interval: int = 1,
        process_covariance: ArrayLike | None = None,
    ) -> Self:
        one_of("reset", reset, get_args(Reset))
        every = whole("interval", interval, 1) * (reset != "none")
        shares = _shares(sharing, len(y), reset)
        prior, Qs, R = checked_noise(
            model, y, measurement_covariance, initial_covariance, process_covariance
        )
        observed = Observations(y, model.C, R)
        start = Filters.start(prior, x, shares, observed.heard.shape[-1])
        return cls(model.A, Qs, shares, start, observed, every)


def _fused(given: _Given, lost: Mask | None = None, predicted: bool = False) -> Iterator[Filters]:
    """Yield the fused filter of every step."""
    A, Qs, shares, start, observed, every = given
    arrived = None
    if lost is not None:  # what the master has is never
        gone = once(lost)
        arrived = np.append(~gone, np.ones_like(gone[:1]), axis=0)
    # what the clusters have, and what the centre has of each of them
    local = held = start
    for k in range(len(Qs)):
        if k:
            together = held is local
            local = local.predicted(A, Qs[k - 1], shares)
            held = local if together else held.predicted(A, Qs[k - 1], shares)
        if predicted:
            yield held.total()
        local = local.measured(*observed.at(k))
        held = local if arrived is None else local.where(arrived[:, k], held)
        fused = held.total()
        if not predicted:
            yield fused
        if every and (k + 1) % every == 0:
            local = held = fused.shared(shares)
