"""The one place where a convex problem is given to a solver, and what it says made a sentence.

Clarabel is an interior-point method. SCS is a first-order method: another kind of algorithm, slower
and less accurate, there to check the first. Either's answer counts only if it passes a certificate
that knows of no solver.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable, Iterable
from typing import Any, TypeVar

import cvxpy as cp
import numpy as np

from inswsn_lib.checks import one_of
from inswsn_lib.errors import InswsnError
from inswsn_lib.lmi.designs import InfeasibleDesignError, Solver

_SETTINGS: dict[str, dict[str, Any]] = {
    "clarabel": {"solver": cp.CLARABEL},
    # with the default accuracy it stops at 1e-4
    "scs": {"solver": cp.SCS, "eps_abs": 1e-9, "eps_rel": 1e-9, "max_iters": 20_000},
}  # fmt: skip

_Made = TypeVar("_Made")


def in_order(solver: Solver | tuple[Solver, ...]) -> tuple[Solver, ...]:
    """Return the solvers that are asked, in turn and each once; refuse what is none."""
    named = solver if isinstance(solver, tuple) and solver else (solver,)
    for name in named:
        one_of("solver", name, tuple(_SETTINGS))
    return tuple(dict.fromkeys(named))  # type: ignore[arg-type]


def solve(problem: Any, solver: Solver, *, accurate: bool = False) -> str:
    """Let a solver solve a problem of cvxpy; return its word, "optimal" or "optimal_inaccurate".

    An inaccurate answer, which a certificate is to judge, is refused if `accurate`.
    """
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of an inaccurate answer
        try:
            # from the start each time: an answer must not depend on what was solved before
            problem.solve(warm_start=False, **_SETTINGS[solver])
        except cp.SolverError as error:
            said = str(error).partition(". ")[0].removesuffix(".")  # and not what else to try
            raise InfeasibleDesignError(f"The solver failed on the inequality: {said}.") from None
    if problem.status not in ("optimal", "optimal_inaccurate")[: 1 if accurate else 2]:
        raise InfeasibleDesignError(
            f"No solution of the inequality was found: the solver says {problem.status}."
        )
    return str(problem.status)


def first_that_passes(attempts: Iterable[Callable[[], _Made]]) -> _Made:
    """Return what the first attempt makes that is not infeasible; raise the first failure."""
    failures = []
    for attempt in attempts:
        try:
            return attempt()
        except InfeasibleDesignError as error:
            failures.append(error)
        except InswsnError:
            raise
        except (np.linalg.LinAlgError, ValueError) as error:  # scipy's word for what is not finite
            failures.append(InfeasibleDesignError(f"Numbers are too far apart: {error}."))
    raise failures[0]
