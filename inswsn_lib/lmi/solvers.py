"""The one place where a convex problem goes to a solver and its status becomes a sentence.

Clarabel is an interior-point method. SCS is a first-order method: another kind of algorithm, slower
and less accurate, there to check the first. Either's answer counts only if it passes a certificate
that knows of no solver.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from functools import cache
from typing import Any, NamedTuple, TypeVar

import clarabel
import numpy as np
from scipy import sparse

from inswsn_lib.checks import Array, one_of
from inswsn_lib.errors import InswsnError
from inswsn_lib.extras import need
from inswsn_lib.lmi.designs import InfeasibleDesignError, Solver

SOLVERS = ("clarabel", "scs")
# with the default accuracy it stops at 1e-4
_SCS = {"eps_abs": 1e-9, "eps_rel": 1e-9, "max_iters": 20_000, "verbose": False}
_WORDS = {
    "Solved": "optimal", "AlmostSolved": "optimal_inaccurate",
    "PrimalInfeasible": "infeasible", "AlmostPrimalInfeasible": "infeasible_inaccurate",
    "DualInfeasible": "unbounded", "AlmostDualInfeasible": "unbounded_inaccurate",
    1: "optimal", 2: "optimal_inaccurate", -2: "infeasible", -7: "infeasible_inaccurate",
    -1: "unbounded", -6: "unbounded_inaccurate",
}  # fmt: skip

_Made = TypeVar("_Made")
_Name = TypeVar("_Name", bound=str)


class Inequality(NamedTuple):
    r"""A linear matrix inequality, :math:`F_0 + \sum_i x_i F_i \le 0`.

    Its `constant`, (k, k), and `terms`, (m, k, k), are symmetric; `places`, (m,), tells which of
    all unknowns the terms belong to. `pattern`, (m, k, k), is not zero where a number that happens
    to be zero is given all the same: Clarabel takes a matrix apart by its zeros, and its answer
    must not jump where a number of a model becomes one.
    """

    constant: Array
    terms: Array
    places: Any
    pattern: Array | None = None


@dataclass(frozen=True, eq=False)
class Answer:
    """The unknowns, a dual solution (k, k) of each inequality, the word and the seconds."""

    x: Array
    duals: list[Array]
    status: str
    seconds: float


def in_order(
    solver: _Name | tuple[_Name, ...], known: Sequence[str] = SOLVERS
) -> tuple[_Name, ...]:
    """Return the solvers that are asked, in turn and each once; refuse what is none."""
    named = solver if isinstance(solver, tuple) and solver else (solver,)
    for name in named:
        one_of("solver", name, tuple(known))
    return tuple(dict.fromkeys(named))  # type: ignore[arg-type]


def solve(
    cost: Array,
    inequalities: Sequence[Inequality],
    solver: Solver,
    equations: tuple[Any, Array] | None = None,
) -> Answer:
    """Let a solver find the x of the least cost'x that satisfies inequalities and equations.

    The equations are a matrix, (equations, unknowns), times x, and what it must be. The answer's
    word is "optimal" or "optimal_inaccurate": a certificate is to judge it.
    """
    # both solvers take A x + s = b, s in a cone, and of a symmetric matrix one triangle with its
    # off-diagonal entries times the root of 2: the upper by columns, or by rows
    triangles = [
        np.tril_indices(len(F.constant)) if solver == "clarabel"
        else np.triu_indices(len(F.constant)) for F in inequalities
    ]  # fmt: skip
    weights = [np.where(i == j, 1.0, 2**0.5) for i, j in triangles]
    rows, columns, numbers, right = [], [], [], []
    if equations:
        left = sparse.coo_array(equations[0])
        rows, columns, numbers = [left.row], [left.col], [left.data]
        right.append(equations[1])
    for F, (i, j), weight in zip(inequalities, triangles, weights, strict=True):
        column, row = np.nonzero((F.terms if F.pattern is None else F.pattern)[:, i, j])
        rows.append(row + sum(map(len, right)))
        columns.append(np.asarray(F.places)[column])
        numbers.append(F.terms[column, i[row], j[row]] * weight[row])
        right.append(-F.constant[i, j] * weight)
    b = np.concatenate(right)
    at = np.concatenate(rows), np.concatenate(columns)
    A = sparse.csc_array((np.concatenate(numbers), at), shape=(len(b), len(cost)))
    zeros = len(equations[1]) if equations else 0
    sizes = [len(F.constant) for F in inequalities]
    word, x, dual, seconds = _ASKED[solver](A, b, cost, zeros, sizes)
    status = _WORDS.get(word)
    if status is None:
        raise InfeasibleDesignError(f"The solver failed on the inequality: {solver} says {word}.")
    if not status.startswith("optimal"):
        raise InfeasibleDesignError(
            f"No solution of the inequality was found: the solver says {status}."
        )
    duals = []
    ends = np.cumsum([len(weight) for weight in weights])
    for k, (i, j), weight, z in zip(
        sizes, triangles, weights, np.split(dual[zeros:], ends[:-1]), strict=True
    ):
        duals.append(np.zeros((k, k)))
        duals[-1][i, j] = duals[-1][j, i] = z / weight
    return Answer(x, duals, status, seconds)


def _clarabel(
    A: Any, b: Array, cost: Array, zeros: int, sizes: list[int]
) -> tuple[str, Array, Array, float]:
    settings = clarabel.DefaultSettings()
    settings.verbose = False
    cones = [clarabel.ZeroConeT(zeros)] * bool(zeros)
    cones += [clarabel.PSDTriangleConeT(k) for k in sizes]
    none = sparse.csc_array((len(cost), len(cost)))
    found = clarabel.DefaultSolver(none, cost, A, b, cones, settings).solve()
    return str(found.status), np.array(found.x), np.array(found.z), found.solve_time


def _scs(
    A: Any, b: Array, cost: Array, zeros: int, sizes: list[int]
) -> tuple[int, Array, Array, float]:
    found = need("scs", 'The solver "scs"').SCS(
        {"A": sparse.csc_matrix(A), "b": b, "c": cost}, {"z": zeros, "s": sizes}, **_SCS
    )
    found = found.solve()
    info = found["info"]
    seconds = (info["setup_time"] + info["solve_time"]) / 1000
    return info["status_val"], found["x"], found["y"], seconds


_ASKED: dict[Solver, Callable[..., Any]] = {"clarabel": _clarabel, "scs": _scs}


@cache
def symmetric_units(n: int) -> Array:
    """Return a basis of the symmetric matrices, (n(n+1)/2, n, n): ones in one or two places."""
    i, j = np.triu_indices(n)
    units, each = np.zeros((len(i), n, n)), np.arange(len(i))
    units[each, i, j] = units[each, j, i] = 1.0
    return units


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
