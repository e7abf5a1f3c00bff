"""Which solver the convex problems of the designs are given to, and with what settings.

Clarabel is an interior-point method. SCS is a first-order method: another kind of algorithm, which
reaches the same answer by many cheap steps, is slower and less accurate, and is there to check the
first. Either's answer counts only if it passes a certificate that knows of no solver.

Designs that name no solver use Clarabel, or the one that ``INSWSN_SOLVER`` names. SCS does not
solve all of them well enough: where its answer is refused, Clarabel is asked. `design_counts` tells
how often which solver's answer was taken.
"""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Callable, Sequence
from typing import Any, Literal, TypeVar

import clarabel  # type: ignore[import-untyped]
import cvxpy as cp
import numpy as np
import scs  # type: ignore[import-untyped]
from numpy.typing import NDArray
from scipy import sparse

from inswsn_lib.errors import InswsnError, ParameterError

Array = NDArray[np.float64]
Solver = Literal["clarabel", "scs"]

#: Names the solver of designs that do not name one
SOLVER_VARIABLE = "INSWSN_SOLVER"

SOLVED, ALMOST = "Solved", "AlmostSolved"  # in the words of Clarabel
_ALLOWED = 'one of "clarabel", "scs"'
_TITLES: dict[Solver, str] = {"clarabel": "Clarabel", "scs": "SCS"}
# a first-order method: with its own default it stops at 1e-4
_FIRST_ORDER: dict[str, Any] = {"eps_abs": 1e-9, "eps_rel": 1e-9, "max_iters": 20_000}
_CVXPY: dict[Solver, dict[str, Any]] = {
    "clarabel": {"solver": cp.CLARABEL},
    # from the start each time, so that an answer does not depend on what was solved before
    "scs": {"solver": cp.SCS, "warm_start": False, **_FIRST_ORDER},
}

_Made = TypeVar("_Made")
_counts: Counter[tuple[Solver, str]] = Counter()  # of this process


class InfeasibleDesignError(InswsnError):
    """No filter satisfies the inequality, or none could be certified; the message says which.

    Examples
    --------
    A filter that takes nothing from the measurements cannot follow a random walk:

    >>> import numpy as np
    >>> from inswsn_lib.lmi import InfeasibleDesignError, certify
    >>> from inswsn_lib.models import ErrorModel
    >>> model = ErrorModel(A=[[1]], B=[[1]], C=[[1]], D=[[1]], L=[[1]], E=[[0]], period=1.0)
    >>> P, gain = np.array([[1.1]]), np.array([[0.0]])
    >>> try:
    ...     certify(model, P, gain, level=2.0, form="exact")
    ... except InfeasibleDesignError as error:
    ...     print(str(error).partition(":")[0])
    The design does not pass its certificate
    """


def chosen_solver(solver: Solver | None = None) -> Solver:
    """Return the solver of a design: the one it names, or else the one that all use.

    Parameters
    ----------
    solver : {"clarabel", "scs"}, optional
        Default: what the environment variable ``INSWSN_SOLVER`` names, or else ``"clarabel"``.

    Returns
    -------
    str
        ``"clarabel"`` or ``"scs"``.

    Raises
    ------
    ParameterError
        If there is no such solver; the sentence tells whether the parameter or the variable is
        wrong.

    Examples
    --------
    >>> import os
    >>> from inswsn_lib.lmi.solvers import SOLVER_VARIABLE, chosen_solver
    >>> before = os.environ.pop(SOLVER_VARIABLE, None)
    >>> chosen_solver()
    'clarabel'
    >>> os.environ[SOLVER_VARIABLE] = "scs"
    >>> chosen_solver(), chosen_solver("clarabel")
    ('scs', 'clarabel')
    >>> del os.environ[SOLVER_VARIABLE]
    >>> if before is not None:
    ...     os.environ[SOLVER_VARIABLE] = before
    """
    if solver is None:
        named = os.environ.get(SOLVER_VARIABLE) or "clarabel"
        if named not in _TITLES:
            raise ParameterError(SOLVER_VARIABLE, named, _ALLOWED)
        return named
    if not isinstance(solver, str) or solver not in _TITLES:
        raise ParameterError("solver", solver, _ALLOWED)
    return solver


def solver_title(solver: Solver) -> str:
    """Return the name of a solver as it is written."""
    return _TITLES[solver]


def designed_by(solver: Solver | None, make: Callable[[Solver, bool], _Made]) -> _Made:
    """Make a design by the solver it names, or by the one that all use.

    Parameters
    ----------
    solver : {"clarabel", "scs"}, optional
        With a name, this solver's answer or none. By default what `chosen_solver` says; where that
        is SCS and its answer is refused, Clarabel is asked.
    make : callable
        Takes the solver, and whether another one will be asked if it fails, so that one try is
        enough. Returns the design, or raises `InfeasibleDesignError`.

    Raises
    ------
    InfeasibleDesignError
        If the design is refused.
    ParameterError
        See `chosen_solver`.
    """
    first = chosen_solver(solver)
    another = solver is None and first == "scs"
    try:
        made = make(first, another)
    except InfeasibleDesignError:
        _counts[first, "refused"] += 1
        if not another:
            raise
        return designed_by("clarabel", make)
    _counts[first, "taken"] += 1
    return made


def design_counts() -> dict[str, str]:
    """Return how many designs of this process were made by each solver.

    A design of which several solvers were asked counts for each of them.

    Returns
    -------
    dict of str to str
        Such as ``{"Clarabel": "12 taken, 1 refused"}``: an answer is taken if it passes its
        certificate, and refused if it does not or the solver finds none.

    Examples
    --------
    >>> from inswsn_lib.lmi import design_counts, design_filter
    >>> from inswsn_lib.models import ErrorModel
    >>> model = ErrorModel(A=[[1]], B=[[1]], C=[[1]], D=[[1]], L=[[1]], E=[[0]], period=1.0)
    >>> design = design_filter(model, solver="clarabel")
    >>> "taken" in design_counts()["Clarabel"]
    True
    """
    return {
        title: f"{_counts[solver, 'taken']} taken, {_counts[solver, 'refused']} refused"
        for solver, title in _TITLES.items()
        if _counts[solver, "taken"] + _counts[solver, "refused"]
    }


def cvxpy_options(solver: Solver) -> dict[str, Any]:
    """Return the arguments with which ``cvxpy.Problem.solve`` uses a solver."""
    return dict(_CVXPY[solver])


def solve_cones(
    A: sparse.csc_matrix, b: Array, cost: Array, zeros: int, sizes: Sequence[int], solver: Solver
) -> tuple[Array, str]:
    """Minimise cost'x where b - A x is zero at first, then positive semidefinite matrices.

    Parameters
    ----------
    A : csc_matrix, (rows, unknowns)
    b : ndarray, (rows,)
        The first `zeros` rows are equations. Then comes the upper triangle of each matrix, column
        by column, its entries off the diagonal times root 2.
    cost : ndarray, (unknowns,)
    zeros : int
        How many equations.
    sizes : sequence of int
        Rows of each matrix.
    solver : {"clarabel", "scs"}

    Returns
    -------
    x : ndarray, (unknowns,)
        What the solver ended with, whatever it says of it.
    status : str
        What it said, in the words of Clarabel where they fit: ``"Solved"``, or ``"AlmostSolved"``
        if it did not reach its full accuracy.
    """
    if solver == "scs":
        return _by_scs(A, b, cost, zeros, sizes)
    settings = clarabel.DefaultSettings()
    settings.verbose = False
    cones = [clarabel.ZeroConeT(zeros), *map(clarabel.PSDTriangleConeT, sizes)]
    none = sparse.csc_matrix((len(cost), len(cost)))
    solution = clarabel.DefaultSolver(none, cost, A, b, cones, settings).solve()
    return np.asarray(solution.x), str(solution.status)


def _by_scs(
    A: sparse.csc_matrix, b: Array, cost: Array, zeros: int, sizes: Sequence[int]
) -> tuple[Array, str]:
    rows, first = [np.arange(zeros)], zeros
    for size in sizes:
        rows.append(first + lower_order(size))
        first += len(rows[-1])
    order = np.concatenate(rows)
    data = {"A": sparse.csc_matrix(A.tocsr()[order]), "b": b[order], "c": cost}
    cone = {"z": zeros, "s": list(sizes)}
    solution = scs.SCS(data, cone, verbose=False, **_FIRST_ORDER).solve()
    info = solution["info"]
    words = {scs.SOLVED: SOLVED, scs.SOLVED_INACCURATE: ALMOST}
    return np.asarray(solution["x"]), words.get(info["status_val"], str(info["status"]))


def lower_order(size: int) -> NDArray[np.int64]:
    """Return where the entries of a lower triangle stand in the upper one, both by columns.

    Clarabel takes the upper triangle of a symmetric matrix column by column, SCS the lower one.
    """
    rows, columns = np.triu_indices(size)  # entry (columns, rows) of the lower triangle, by columns
    return np.asarray(columns * (columns + 1) // 2 + rows)
