"""Who is asked, what an answer is called, and what is made of a failure."""

from __future__ import annotations

from typing import Any

import cvxpy as cp
import numpy as np
import pytest

from inswsn_lib.errors import ParameterError
from inswsn_lib.lmi import InfeasibleDesignError
from inswsn_lib.lmi.designs import Solver
from inswsn_lib.lmi.solvers import first_that_passes, in_order, solve

BOTH: tuple[Solver, ...] = ("clarabel", "scs")


@pytest.mark.parametrize("solver", BOTH)
def test_the_largest_eigenvalue_of_a_matrix(solver: Solver) -> None:
    """The least t with t I - M positive semidefinite."""
    M = np.random.default_rng(3).standard_normal((5, 5))
    t = cp.Variable()
    problem = cp.Problem(cp.Minimize(t), [t * np.eye(5) - (M + M.T) >> 0])
    assert solve(problem, solver, accurate=True) == "optimal"
    assert t.value == pytest.approx(np.linalg.eigvalsh(M + M.T)[-1], abs=1e-7)
    assert problem.solver_stats.solver_name == {"clarabel": "CLARABEL", "scs": "SCS"}[solver]


def test_an_answer_of_scs_does_not_depend_on_the_one_before() -> None:
    x, size = cp.Variable((4, 4), PSD=True), cp.Parameter()
    problem = cp.Problem(cp.Minimize(cp.norm(x - size * np.ones((4, 4)) + np.eye(4))))
    found = []
    for number in (1.0, 3.0, 1.0):
        size.value = number
        solve(problem, "scs")
        found.append(x.value)
    assert np.array_equal(found[0], found[2])


@pytest.mark.parametrize("solver", BOTH)
def test_a_problem_without_a_solution_is_not_solved(solver: Solver) -> None:
    x = cp.Variable()
    with pytest.raises(InfeasibleDesignError) as caught:
        solve(cp.Problem(cp.Minimize(x), [x == 1, -x >= 0]), solver)
    assert str(caught.value) == (
        "No solution of the inequality was found: the solver says infeasible."
    )


class Saying:
    """A problem whose solver says a word, or fails."""

    def __init__(self, status: str, error: str = "") -> None:
        self.status, self._error = status, error

    def solve(self, **_: Any) -> None:
        if self._error:
            raise cp.SolverError(self._error)


def test_what_a_solver_says_is_taken_or_refused() -> None:
    assert solve(Saying("optimal_inaccurate"), "clarabel") == "optimal_inaccurate"
    for given, accurate in (("optimal_inaccurate", True), ("unbounded", False)):
        with pytest.raises(InfeasibleDesignError, match=f"^No solution .* says {given}\\.$"):
            solve(Saying(given), "clarabel", accurate=accurate)
    with pytest.raises(InfeasibleDesignError) as caught:
        solve(Saying("", "it broke"), "scs")
    assert str(caught.value) == "The solver failed on the inequality: it broke."


def test_the_order_in_which_solvers_are_asked() -> None:
    assert in_order("scs") == ("scs",)
    assert in_order(("scs", "clarabel")) == ("scs", "clarabel")
    assert in_order(("clarabel", "clarabel", "scs")) == ("clarabel", "scs")


@pytest.mark.parametrize("wrong", ["mosek", None, (), ["scs"], ("clarabel", "mosek"), ("scs", 1)])
def test_a_solver_that_is_none_is_refused(wrong: Any) -> None:
    with pytest.raises(ParameterError, match=r'^solver is .*; it may be one of "clarabel", "scs"'):
        in_order(wrong)


def test_the_first_attempt_that_passes_is_taken() -> None:
    asked: list[int] = []

    def attempt(number: int, passes: bool) -> Any:
        def make() -> int:
            asked.append(number)
            if not passes:
                raise InfeasibleDesignError(f"failure {number}")
            return number

        return make

    assert first_that_passes(attempt(i, i > 1) for i in range(4)) == 2
    assert asked == [0, 1, 2]
    with pytest.raises(InfeasibleDesignError, match="failure 5"):
        first_that_passes([attempt(5, False), attempt(6, False)])
