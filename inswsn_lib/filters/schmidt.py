"""Schmidt's filter, which allows for states that it does not estimate."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from inswsn_lib.checks import Array, covariance, whole
from inswsn_lib.filters.inputs import measured, times
from inswsn_lib.filters.kalman import updated
from inswsn_lib.models import ErrorModel


def run_schmidt(
    model: ErrorModel,
    measurements: ArrayLike,
    *,
    considered: int,
    initial_covariance: ArrayLike,
    predicted: bool = False,
) -> Array:
    r"""Run a Kalman filter that considers its last states without estimating them.

    Their uncertainty and their correlation with the others shape the gain; their estimate stays
    zero. The gain is that of the Kalman filter with the rows of these states set to zero, and the
    covariance is Joseph's for that gain (Schmidt 1966; Simon 2006, Section 10.3):

    .. math::
        K_k = \begin{bmatrix} I & 0 \\ 0 & 0 \end{bmatrix} P_k C' (C P_k C' + R)^{-1} , \quad
        P_k^+ = (I - K_k C) P_k (I - K_k C)' + K_k R K_k' .

    Parameters
    ----------
    model : ErrorModel
        With the states that are considered last, such as of `ErrorModel.with_coloured_noise`.
    measurements : array_like, (steps, m) or (steps, m, runs)
        NaN where a component is missing.
    considered : int
        How many states are considered; fewer than all.
    initial_covariance : array_like, (n, n)
        P_0, of all states.
    predicted : bool
        Return estimates before the measurement of each step instead of after it.

    Returns
    -------
    ndarray, (steps, n - considered) or (steps, n - considered, runs)

    Raises
    ------
    ParameterError
        If a shape does not fit, or all states are considered.

    Examples
    --------
    A constant is measured with an error that never changes and has its variance: half of what is
    measured is believed, and a second look at the same error adds nothing:

    >>> import numpy as np
    >>> import inswsn_lib as iw
    >>> model = iw.ErrorModel(A=np.eye(2), B=[[0], [0]], C=[[1, 1]], D=[[1e-6]], period=1.0)
    >>> found = iw.run_schmidt(model, [[1], [1]], considered=1, initial_covariance=np.eye(2))
    >>> found.ravel().round(6).tolist()
    [0.5, 0.5]
    """
    m, n = model.C.shape
    kept = n - whole("considered", considered, 0, n - 1)
    there, y, back = measured(measurements, "steps", m, "runs")
    R, Q = model.measurement_covariance, model.process_covariance
    P = covariance("initial_covariance", initial_covariance, (n, n))[None]
    F, C = model.A[:kept, :kept], model.C[:, :kept]
    x = np.zeros((kept, y.shape[2]))
    out = np.empty((len(y), *x.shape))
    for k, here in enumerate(np.swapaxes(there, 1, 2)):
        gain, _, _ = updated(model.C, P, model.C @ P @ model.C.T + R, R, here)
        gain[:, kept:] = 0.0
        keep = np.eye(n) - gain @ model.C
        P = keep @ P @ np.swapaxes(keep, 1, 2) + gain @ R @ np.swapaxes(gain, 1, 2)
        P = model.A @ P @ model.A.T + Q
        before, x = x, x + times(gain[:, :kept], y[k] - C @ x)
        out[k] = before if predicted else x
        x = F @ x
    return back(out)
