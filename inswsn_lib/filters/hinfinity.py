"""The H-infinity filter: a constant gain, designed by an inequality, run over many runs at once."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from inswsn_lib.errors import ParameterError
from inswsn_lib.filters.inputs import checked_measurements, first_state
from inswsn_lib.lmi import FilterDesign
from inswsn_lib.models import ErrorModel

Array = NDArray[np.float64]


def deadbeat_gain(model: ErrorModel) -> Array:
    """Return B_f = A C^-1, with which A_f = 0: the filter carries the last measurement one step.

    Parameters
    ----------
    model : ErrorModel
        A and C.

    Returns
    -------
    ndarray, (n, n)
        B_f.

    Raises
    ------
    ParameterError
        If C is not square and invertible.

    Examples
    --------
    >>> from inswsn_lib.filters import deadbeat_gain
    >>> from inswsn_lib.models import ErrorModel
    >>> model = ErrorModel(A=[[1]], B=[[1]], C=[[2]], D=[[1]], L=[[1]], E=[[0]], period=1.0)
    >>> deadbeat_gain(model).tolist()
    [[0.5]]
    """
    if model.C.shape[0] != model.C.shape[1] or np.linalg.matrix_rank(model.C) < len(model.C):
        raise ParameterError("C", f"of shape {model.C.shape}", "square and invertible")
    return np.asarray(np.linalg.solve(model.C.T, model.A.T).T)


def run_hinfinity(
    design: FilterDesign | tuple[ErrorModel, Array],
    measurements: ArrayLike,
    *,
    initial_state: ArrayLike | None = None,
    predicted: bool = True,
) -> Array:
    r"""Run the filter :math:`\hat x_{k+1} = A_f \hat x_k + B_f y_k` (P1 2.9).

    Where a component of y is missing, its prediction :math:`C \hat x_k` stands in for it.

    Parameters
    ----------
    design : FilterDesign, or tuple of ErrorModel and ndarray (n, m)
        The filter: a design, or a model with a gain B_f.
    measurements : array_like, (steps, m, runs)
        y; NaN where missing.
    initial_state : array_like, (n,) or (n, runs), optional
        Default: zero.
    predicted : bool
        As (2.9) has it, ``estimates[k]`` uses the measurements before step k. Otherwise it uses
        that of step k as well: :math:`A^{-1} \hat x_{k+1}`.

    Returns
    -------
    ndarray, (steps, n, runs)

    Raises
    ------
    ParameterError
        If a shape does not fit, a measurement is infinite, or A^-1 is needed and does not exist.

    Examples
    --------
    With the deadbeat gain of a random walk, each prediction is the measurement of the step before:

    >>> import numpy as np
    >>> from inswsn_lib.filters import deadbeat_gain, run_hinfinity
    >>> from inswsn_lib.models import ErrorModel
    >>> model = ErrorModel(A=[[1]], B=[[1]], C=[[1]], D=[[1]], L=[[1]], E=[[0]], period=1.0)
    >>> measured = np.array([3.0, 1.0, 4.0]).reshape(3, 1, 1)
    >>> run_hinfinity((model, deadbeat_gain(model)), measured).ravel().tolist()
    [0.0, 3.0, 1.0]
    """
    model, gain = (design.model, design.gain) if isinstance(design, FilterDesign) else design
    shape = len(model.A), len(model.C)
    if np.shape(gain) != shape:
        raise ParameterError("gain", f"of shape {np.shape(gain)}", f"{shape}")
    if not predicted and np.linalg.matrix_rank(model.A) < len(model.A):
        raise ParameterError("predicted", predicted, "true, since A cannot be inverted")
    y = checked_measurements(measurements, model.C.shape[0])
    x = first_state(initial_state, len(model.A), y.shape[2])
    estimates = np.empty((y.shape[0], *x.shape))
    for k, measured in enumerate(y):
        ahead = model.A @ x + gain @ np.nan_to_num(measured - model.C @ x)
        estimates[k] = x if predicted else np.linalg.solve(model.A, ahead)
        x = ahead
    return estimates
