"""The noise figures that fit simulated errors: what a filter would be told if all were known."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from inswsn_lib.errors import ParameterError

Array = NDArray[np.float64]


class NoiseFit(NamedTuple):
    """Second moments of simulated errors.

    Attributes
    ----------
    process : ndarray, (n, n)
        Q, of what a step of the model leaves over.
    measurement : ndarray, (m, m)
        R, of the errors of the measurements.
    initial : ndarray, (n, n)
        P_0, of the state at the first step.

    Examples
    --------
    It unpacks into Q, R and P_0. Here the model leaves nothing over, and all measurements are
    exact:

    >>> import numpy as np
    >>> from inswsn_lib.evaluation import fit_noise
    >>> states = np.ones((4, 1, 1))  # four steps of one state that stays, one run
    >>> Q, R, P0 = fit_noise([[1.0]], states, np.zeros((4, 1, 1)))
    >>> Q.tolist(), R.tolist(), P0.tolist()
    ([[0.0]], [[0.0]], [[1.0]])
    """

    process: Array
    measurement: Array
    initial: Array


def fit_noise(A: ArrayLike, states: ArrayLike, measurement_errors: ArrayLike) -> NoiseFit:
    r"""Return the noise figures that a Kalman filter needs, from errors that a simulation knows.

    .. math::
        Q = \overline{w_k w_k'}, \; w_k = x_{k+1} - A x_k, \qquad R = \overline{v_k v_k'},
        \qquad P_0 = \overline{x_0 x_0'}

    with means over steps and runs: the sample version of what Q, R and P_0 stand for (Bar-Shalom,
    Li and Kirubarajan 2001, Section 5.2). They are moments about zero: a filter that assumes noise
    of zero mean has to take a mean for noise. Noise that is coloured is taken for white.

    Parameters
    ----------
    A : array_like, (n, n)
        Transition of the state.
    states : array_like, (steps, n, runs)
        The true states; two steps or more, in the units of the model.
    measurement_errors : array_like, (steps, m, runs)
        The true errors of the measurements; NaN where missing.

    Returns
    -------
    NoiseFit
        In the squared units of the states and the measurements.

    Raises
    ------
    ParameterError
        If shapes do not fit, a number is infinite, a state is missing, there is no run, or no
        measurement is complete.

    Examples
    --------
    A state that takes steps of one to either side, from zero, and measurements that are off by two:

    >>> import numpy as np
    >>> from inswsn_lib.evaluation import fit_noise
    >>> states = np.array([0.0, 1.0, 0.0, -1.0, 0.0]).reshape(5, 1, 1)
    >>> errors = np.array([2.0, -2.0, np.nan, 2.0, -2.0]).reshape(5, 1, 1)
    >>> fit = fit_noise([[1.0]], states, errors)
    >>> fit.process.tolist(), fit.measurement.tolist(), fit.initial.tolist()
    ([[1.0]], [[4.0]], [[0.0]])
    """
    x, v = np.asarray(states, dtype=float), np.asarray(measurement_errors, dtype=float)
    transition = np.asarray(A, dtype=float)
    if x.ndim != 3 or len(x) < 2 or 0 in x.shape or not np.isfinite(x).all():
        raise ParameterError(
            "states", f"of shape {x.shape}", "finite, (2 or more steps, n, 1 or more runs)"
        )
    if transition.shape != (x.shape[1],) * 2 or not np.isfinite(transition).all():
        raise ParameterError(
            "A", f"of shape {transition.shape}", f"finite, ({x.shape[1]}, {x.shape[1]})"
        )
    if v.ndim != 3 or (v.shape[0], v.shape[2]) != (x.shape[0], x.shape[2]) or np.isinf(v).any():
        raise ParameterError(
            "measurement_errors",
            f"of shape {v.shape}",
            f"({x.shape[0]}, m, {x.shape[2]}), finite, or NaN where missing",
        )
    columns = np.moveaxis(v, 1, 0).reshape(v.shape[1], -1)
    columns = columns[:, ~np.isnan(columns).any(axis=0)]
    if columns.shape[1] == 0:
        raise ParameterError("measurement_errors", "never complete", "complete at some step")
    left = np.moveaxis(x[1:] - transition @ x[:-1], 1, 0).reshape(x.shape[1], -1)
    return NoiseFit(_moment(left), _moment(columns), _moment(x[0]))


def _moment(columns: Array) -> Array:
    return np.asarray(columns @ columns.T / columns.shape[1])
