"""Who is asked, what an answer is called, and what is made of a failure."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from inswsn_lib.errors import ParameterError
from inswsn_lib.lmi import InfeasibleDesignError
from inswsn_lib.lmi.designs import Solver
from inswsn_lib.lmi.solvers import _ASKED, Inequality, first_that_passes, in_order, solve

BOTH: tuple[Solver, ...] = ("clarabel", "scs")


def largest(M: np.ndarray, *, given: bool = False) -> Inequality:
    """The inequality of: the least t with t I - M positive semidefinite."""
    terms = -np.eye(len(M))[None]
    return Inequality(M, terms, np.arange(1), np.ones_like(terms) if given else None)


@pytest.mark.parametrize("given", [False, True])
@pytest.mark.parametrize("solver", BOTH)
def test_the_largest_eigenvalue_of_a_matrix(solver: Solver, given: bool) -> None:
    """The dual solution is the projection on its vector."""
    M = np.random.default_rng(3).standard_normal((5, 5))
    M += M.T
    values, vectors = np.linalg.eigh(M)
    answer = solve(np.ones(1), [largest(M, given=given)], solver)
    assert (answer.status, answer.seconds > 0) == ("optimal", True)
    assert answer.x == pytest.approx(values[-1:], abs=1e-7)
    assert answer.duals[0] == pytest.approx(np.outer(vectors[:, -1], vectors[:, -1]), abs=1e-6)


@pytest.mark.parametrize("solver", BOTH)
def test_inequalities_that_share_unknowns_and_an_equation(solver: Solver) -> None:
    """The least a + 2 b with b - a = 1 and both at least as large as eigenvalues of 1 and 3."""
    of = [np.diag([1.0, 0.0]), np.array([[2.0, 1.0], [1.0, 2.0]])]
    both = [Inequality(M, -np.eye(2)[None], np.array([i])) for i, M in enumerate(of)]
    equations = (np.array([[-1.0, 1.0]]), np.ones(1))
    answer = solve(np.array([1.0, 2.0]), both, solver, equations)
    assert answer.x == pytest.approx([2, 3], abs=1e-6)
    assert [np.trace(dual) for dual in answer.duals] == pytest.approx([0, 3], abs=1e-5)


@pytest.mark.parametrize("solver", BOTH)
def test_an_answer_does_not_depend_on_the_one_before(solver: Solver) -> None:
    M = np.random.default_rng(4).standard_normal((4, 4))
    found = [solve(np.ones(1), [largest(size * (M + M.T))], solver).x for size in (1.0, 3.0, 1.0)]
    assert np.array_equal(found[0], found[2])


@pytest.mark.parametrize("solver", BOTH)
def test_a_problem_without_a_solution_is_not_solved(solver: Solver) -> None:
    """One number is 1 and not above 0."""
    not_above = Inequality(np.zeros((1, 1)), np.ones((1, 1, 1)), np.arange(1))
    with pytest.raises(InfeasibleDesignError) as caught:
        solve(np.ones(1), [not_above], solver, (np.ones((1, 1)), np.ones(1)))
    assert str(caught.value) == (
        "No solution of the inequality was found: the solver says infeasible."
    )


def test_what_a_solver_says_is_taken_or_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    def saying(word: Any) -> Any:
        monkeypatch.setitem(_ASKED, "clarabel", lambda *_: (word, np.ones(1), np.ones(1), 0.0))
        return solve(np.ones(1), [largest(np.eye(1))], "clarabel")

    assert saying("AlmostSolved").status == saying(2).status == "optimal_inaccurate"
    for word, told in (("DualInfeasible", "unbounded"), (-7, "infeasible_inaccurate")):
        with pytest.raises(InfeasibleDesignError, match=f"^No solution .* says {told}\\.$"):
            saying(word)
    with pytest.raises(InfeasibleDesignError) as caught:
        saying("NumericalError")
    said = "The solver failed on the inequality: clarabel says NumericalError."
    assert str(caught.value) == said


def test_the_order_in_which_solvers_are_asked() -> None:
    assert in_order("scs") == ("scs",)
    assert in_order(("scs", "clarabel")) == ("scs", "clarabel")
    assert in_order(("clarabel", "clarabel", "scs")) == ("clarabel", "scs")


@pytest.mark.parametrize("wrong", ["mosek", None, (), ["scs"], ("clarabel", "mosek"), ("scs", 1)])
def test_a_solver_that_is_none_is_refused(wrong: Any) -> None:
    with pytest.raises(ParameterError, match=r'^solver must be one of "clarabel", "scs"'):
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
