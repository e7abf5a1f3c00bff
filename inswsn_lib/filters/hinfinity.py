"""Filters of constant gain: the H-infinity filter, and one with a gain for each pattern of data."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

import numpy as np
from numpy.typing import ArrayLike, NDArray

from inswsn_lib.checks import Array, Mask, array
from inswsn_lib.errors import Described, ParameterError
from inswsn_lib.filters.inputs import (
    Pattern,
    by_pattern,
    each_step,
    first_state,
    measured,
    occurring,
    times,
)
from inswsn_lib.lmi import FilterDesign
from inswsn_lib.models import ErrorModel

#: A filter: a design, or a model with a gain B_f (n, m)
Design = FilterDesign | tuple[ErrorModel, ArrayLike]


def deadbeat_gain(model: ErrorModel) -> Array:
    """Return B_f = A C^-1 (n, n), with which the filter carries the last measurement one step.

    Examples
    --------
    >>> import inswsn_lib as iw
    >>> iw.deadbeat_gain(iw.ErrorModel(A=[[1]], B=[[1]], C=[[2]], D=[[1]], period=1.0)).item()
    0.5
    """
    C = model.C
    if C.shape[0] != C.shape[1] or np.linalg.matrix_rank(C) < len(C):
        raise ParameterError("C", Described(f"of shape {C.shape}"), "square and invertible")
    return np.asarray(np.linalg.solve(C.T, model.A.T).T)


def run_hinfinity(
    design: Design,
    measurements: ArrayLike,
    *,
    initial_state: ArrayLike | None = None,
    predicted: bool = False,
) -> Array:
    r"""Run the filter :math:`\hat x_{k+1} = A \hat x_k + B_f (y_k - C \hat x_k)` (P1 2.9).

    Where a component of y is missing, its prediction stands in for it; that may be unstable where
    many are. Over 10^5 steps of complete measurements estimates of a position and a velocity are
    those of 50 digits to 1e-10 of the largest for ratios of Q to R up to 1, and to 1e-8 up to
    10^12, where one is 10^5 times the other.

    Parameters
    ----------
    design : FilterDesign, or tuple of ErrorModel and ndarray (n, m)
        The filter: a design, or a model with a gain B_f.
    measurements, initial_state
        As in `run_kalman`.
    predicted : bool
        Return :math:`\hat x_k`, as (2.9) has it, which uses the measurements before step k, instead
        of :math:`A^{-1} \hat x_{k+1}`, which uses that of step k as well and needs an inverse.

    Returns
    -------
    ndarray, (steps, n) or (steps, n, runs)

    Examples
    --------
    With the deadbeat gain of a random walk each prediction is the measurement of the step before:

    >>> import inswsn_lib as iw
    >>> model = iw.ErrorModel(A=[[1]], B=[[1]], C=[[1]], D=[[1]], period=1.0)
    >>> iw.run_hinfinity((model, [[1]]), [[3.0], [1.0], [4.0]], predicted=True).tolist()
    [[0.0], [3.0], [1.0]]
    """
    model, gain = model_and_gain("design", design)
    there, y, back = measured(measurements, "steps", len(model.C), "runs")
    which, one = np.zeros((len(y), 1), dtype=np.intp), (there[None], y[None])
    return back(_run(model.A, model.C[None], gain[None], which, *one, initial_state, predicted))


def run_switched(
    designs: Mapping[Pattern, Design],
    measurements: ArrayLike,
    *,
    initial_state: ArrayLike | None = None,
    predicted: bool = False,
) -> Array:
    r"""Run a filter on the measurements of all clusters, with a gain for each pattern of them.

    With C and y stacked over the clusters that hear the node at step k,

    .. math::
        \hat x_{k+1} = A \hat x_k + K_{\mathrm{pattern}} (y_k - C \hat x_k) .

    Parameters
    ----------
    designs : mapping of tuple of N bools to FilterDesign or tuple of ErrorModel and ndarray
        The filter for each pattern that occurs, with C and a gain for the clusters that hear the
        node, in order; A is the same in all. Where no cluster does, A predicts.
    measurements : array_like, (N, steps, m) or (N, steps, m, runs)
        y of each cluster; NaN where missing, and where it does not reach the centre.
    initial_state, predicted
        As in `run_hinfinity`.

    Returns
    -------
    ndarray, (steps, n) or (steps, n, runs)

    Examples
    --------
    The mean of what two clusters measure is carried on; the second falls silent after a step:

    >>> import numpy as np
    >>> import inswsn_lib as iw
    >>> one = iw.ErrorModel(A=[[1]], B=[[1]], C=[[1]], D=[[1]], period=1.0)
    >>> two = iw.ErrorModel(A=[[1]], B=[[1]], C=[[1], [1]], D=np.eye(2), period=1.0)
    >>> designs = {(True, True): (two, [[0.5, 0.5]]), (True, False): (one, [[1]])}
    >>> y = [[[2.0], [5.0]], [[4.0], [np.nan]]]
    >>> iw.run_switched(designs, y).tolist()
    [[3.0], [5.0]]
    """
    there, y, back = measured(measurements, "N", "steps", "m", "runs")
    clusters, _, m, _ = y.shape
    occur, which = occurring(np.any(there, axis=2))
    filters = {key: model_and_gain("designs", design) for key, design in designs.items()}
    A = common_transition(model for model, _ in filters.values())
    C = np.zeros((len(occur), clusters * m, len(A)))
    gains = np.zeros((len(occur), len(A), clusters * m))
    for place, pattern, (model, gain) in by_pattern("designs", filters, occur):
        rows = np.repeat(pattern, m)
        C[place, rows] = array("designs", model.C, (int(rows.sum()), len(A)))
        gains[place][:, rows] = gain
    return back(_run(A, C, gains, which, there, y, initial_state, predicted))


def _run(
    A: Array,
    C: Array,
    gains: Array,
    which: NDArray[np.intp],
    there: Mask,
    y: Array,
    initial_state: ArrayLike | None,
    predicted: bool,
) -> Array:
    """Run with one of some C (patterns, N m, n) and gains (patterns, n, N m) at each step and run.

    The measurements are (N, steps, m, runs), zero where they are not there.
    """
    clusters, steps, m, runs = y.shape
    states = empty_predictions(A, first_state(initial_state, len(A), runs), steps, predicted)
    for k, use in enumerate(each_step(which)):
        x = states[k]
        innovation = y[:, k].reshape(clusters * m, runs) - times(C[use], x)
        innovation *= there[:, k].reshape(clusters * m, -1)
        states[k + 1] = A @ x + times(gains[use], innovation)
    return estimates_of(A, states, predicted)


def empty_predictions(A: Array, start: Array, steps: int, predicted: bool) -> Array:
    """Return room for predictions (steps + 1, n, runs), of which the first is the start."""
    if not predicted and np.linalg.matrix_rank(A) < len(A):
        raise ParameterError("predicted", predicted, "True, since A cannot be inverted")
    states = np.empty((steps + 1, *start.shape))
    states[0] = start
    return states


def estimates_of(A: Array, states: Array, predicted: bool) -> Array:
    """Return of predictions (steps + 1, n, runs) that before each step, or A^-1 times the next."""
    return states[:-1] if predicted else np.asarray(np.linalg.inv(A) @ states[1:])


def model_and_gain(name: str, design: Design) -> tuple[ErrorModel, Array]:
    """Return the model and the gain of a filter."""
    if isinstance(design, FilterDesign):
        return design.model, design.gain
    if not (isinstance(design, tuple) and len(design) == 2 and isinstance(design[0], ErrorModel)):
        got = Described(f"of {type(design).__name__}")
        raise ParameterError(name, got, "made of designs, or of models with gains")
    model, gain = design
    return model, array("gain", gain, model.C.shape[::-1])


def common_transition(models: Iterable[ErrorModel]) -> Array:
    """Return the transition that all models have."""
    A = np.stack([model.A for model in models])
    if (A[0] != A).any():
        raise ParameterError("designs", Described("of different ones"), "of models with the same A")
    return np.asarray(A[0])
