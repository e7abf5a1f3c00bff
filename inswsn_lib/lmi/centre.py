"""What an interior-point method holds when it is stopped before the least gamma."""

from __future__ import annotations

import warnings

import cvxpy as cp
import numpy as np
from numpy.typing import NDArray

from inswsn_lib.errors import ParameterError
from inswsn_lib.lmi.designs import Form
from inswsn_lib.lmi.filter_design import inequality
from inswsn_lib.lmi.solvers import (
    InfeasibleDesignError,
    Solver,
    chosen_solver,
    cvxpy_options,
    designed_by,
)
from inswsn_lib.models import ErrorModel

Array = NDArray[np.float64]

_LARGEST = 1e100


def central_gain(
    model: ErrorModel, level: float, form: Form = "exact", *, solver: Solver | None = None
) -> Array:
    r"""Return the gain at the analytic centre of the inequality at a level.

    The centre is the pair P, Q that maximises the determinant of the left side of the inequality
    with its sign changed. A path-following method stays near such centres, one level after the
    other, so its gain is about this one wherever it is stopped.

    There is a centre if B has full row rank, so that P is bounded. If D = 0 and C is invertible,
    :math:`\Gamma = PA - QC` is as free as Q, and the inequality holds for :math:`\Gamma` if and
    only if it holds for :math:`-\Gamma`. The centre is unique, so :math:`\Gamma = 0`: the gain is
    the deadbeat one at every level.

    Parameters
    ----------
    model : ErrorModel
        The model.
    level : float
        The bound, above the least one.
    form : {"exact", "printed"}
        The inequality.
    solver : {"clarabel", "scs"}, optional
        As for `design_filter`.

    Returns
    -------
    ndarray, (n, m)
        B_f.

    Raises
    ------
    InfeasibleDesignError
        If the inequality has no solution at this level, or it has no centre, or the solver does
        not find it.
    ParameterError
        If the level is not positive and at most 1e100, or there is no such form or
        solver.

    Examples
    --------
    Without measurement noise the gain is the deadbeat one, at whatever level:

    >>> from inswsn_lib.lmi import central_gain
    >>> from inswsn_lib.models import ErrorModel
    >>> model = ErrorModel(A=[[1]], B=[[1]], C=[[1]], D=[[0]], L=[[1]], E=[[0]], period=1.0)
    >>> print(f"{central_gain(model, level=2.0).item():.3f}")
    1.000
    """
    if form not in ("exact", "printed"):
        raise ParameterError("form", form, 'one of "exact", "printed"')
    if not 0 < level <= _LARGEST:
        raise ParameterError("level", level, f"positive, at most {_LARGEST:g}")
    chosen_solver(solver)
    return designed_by(solver, lambda by, once: _centre(model, level, form, by))


def _centre(model: ErrorModel, level: float, form: Form, solver: Solver) -> Array:
    P = cp.Variable(model.A.shape, symmetric=True)
    Q = cp.Variable((len(model.A), len(model.C)))
    matrix = cp.bmat(inequality(model, P, Q, level**2, form))
    problem = cp.Problem(cp.Maximize(cp.log_det(-(matrix + matrix.T) / 2)))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # an inaccurate answer is refused below
        try:
            problem.solve(**cvxpy_options(solver))
        except cp.SolverError as error:
            raise InfeasibleDesignError(f"The solver failed at the centre: {error}.") from None
    if problem.status != "optimal" or P.value is None:
        raise InfeasibleDesignError(
            f"No centre of the inequality was found at {level:.6g}: the solver says "
            f"{problem.status}."
        )
    return np.asarray(np.linalg.solve(P.value, Q.value))
