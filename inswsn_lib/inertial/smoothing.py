r"""Smoothers of Rauch, Tung and Striebel (AIAA J. 3(8), 1965) for an error-state filter.

With the state :math:`\hat x_k` after the measurements of event k, the one before those of the next,
:math:`\hat x^-_{k+1}`, and :math:`A_k = P_k \Phi_{k+1}' (P^-_{k+1})^{-1}`,

.. math::
    \hat x^s_k = \hat x_k \oplus A_k (\hat x^s_{k+1} \ominus \hat x^-_{k+1}), \qquad
    P^s_k = P_k + A_k (P^s_{k+1} - P^-_{k+1}) A_k' .
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.linalg.lapack import dposv

from inswsn_lib.checks import Array, number
from inswsn_lib.inertial.error_state import Solution


def smooth(solution: Solution) -> Solution:
    """Return the solution by all measurements, before and after each event: not causal.

    Parameters
    ----------
    solution : Solution
        Of `run_error_state`.

    Examples
    --------
    What is known at the end tells what the scale of the odometer was at the beginning:

    >>> import numpy as np
    >>> from inswsn_lib import inertial as nav
    >>> from inswsn_lib.streams import Fixes, Odometry
    >>> t = np.arange(0, 20.1, 0.1)
    >>> wheels = Odometry(t, speed=np.full(201, 1.0), rate=np.zeros(201))
    >>> motion = nav.OdometryMotion(wheels, nav.OdometryNoise(0.01, 0.001, 1e-4, 1e-5))
    >>> start = nav.Start(0.0, nav.PlanarState(np.zeros(2), 0.0), np.eye(5) / 25)
    >>> fixes = Fixes(t[10::10], np.outer(1.1 * t[10::10], [1.0, 0.0]))
    >>> observed = [nav.PositionFixes(fixes, np.zeros(2), white=np.full(2, 0.1))]
    >>> solution = nav.run_error_state(motion, start, observed)
    >>> print([f"{s.states[0].scale:.2f}" for s in (solution, nav.smooth(solution))])
    ['0.04', '0.10']
    """
    states, P = list(solution.states), solution.covariances.copy()
    for k in range(len(states) - 2, -1, -1):
        back = _back(solution, k)
        error = back @ states[k + 1].minus(solution.before[k + 1])
        states[k] = states[k].plus(error)
        left = P[k] + back @ (P[k + 1] - solution.priors[k + 1]) @ back.T
        P[k] = 0.5 * (left + left.T)
    return replace(solution, states=states, covariances=P)


def smooth_with_lag(solution: Solution, lag: float) -> Solution:
    """Return the solution by the measurements up to a time after each event.

    The fixed-lag smoother, whose answers are late by the lag.

    Parameters
    ----------
    solution : Solution
        Of `run_error_state`.
    lag : float
        s.
    """
    late = number("lag", lag, least=0)
    last = np.searchsorted(solution.time, solution.time + late, side="right") - 1
    backs = [_back(solution, k) for k in range(len(solution.time) - 1)]
    states, P = list(solution.states), solution.covariances.copy()
    for k, end in enumerate(last):
        state, spread = solution.states[end], solution.covariances[end]
        for j in range(end - 1, k - 1, -1):
            state = solution.states[j].plus(backs[j] @ state.minus(solution.before[j + 1]))
            spread = (
                solution.covariances[j] + backs[j] @ (spread - solution.priors[j + 1]) @ backs[j].T
            )
        states[k], P[k] = state, 0.5 * (spread + spread.T)
    return replace(solution, states=states, covariances=P)


def _back(solution: Solution, k: int) -> Array:
    return _gain(solution.covariances[k], solution.transitions[k + 1], solution.priors[k + 1])


def _gain(P: Array, transition: Array, prior: Array) -> Array:
    # states without noise make a prior singular but for rounding
    scale = np.sqrt(np.maximum(np.diag(prior), 1e-300))
    scaled = prior / np.outer(scale, scale) + 1e-13 * np.eye(len(prior))
    moved = transition @ P
    # without the checks of scipy's own functions, which take five times as long
    _, solved, failed = dposv(scaled, moved / scale[:, None])
    if failed:
        raise np.linalg.LinAlgError("A covariance before a measurement is not positive definite.")
    return np.asarray(solved.T / scale)
