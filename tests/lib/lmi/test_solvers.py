"""Two solvers of different kinds: the same cone problems, designs and counts."""

from __future__ import annotations

import numpy as np
import pytest
from inswsn_book import runs
from scipy import sparse
from threadpoolctl import threadpool_info, threadpool_limits

from inswsn_lib.errors import ParameterError
from inswsn_lib.lmi import (
    design_counts,
    design_filter,
    design_fusion,
    fusion_gain,
    hinf_norm,
    solvers as module,
)
from inswsn_lib.lmi.solvers import (
    SOLVER_VARIABLE,
    InfeasibleDesignError,
    Solver,
    chosen_solver,
    designed_by,
    lower_order,
    solve_cones,
)
from inswsn_lib.models import ErrorModel

BOTH: tuple[Solver, ...] = ("clarabel", "scs")


def upper(matrix: np.ndarray) -> np.ndarray:
    """The upper triangle column by column, entries off the diagonal times root 2."""
    size = len(matrix)
    return np.array(
        [matrix[i, j] * (1 if i == j else 2**0.5) for j in range(size) for i in range(j + 1)]
    )


@pytest.mark.parametrize("size", [1, 2, 5])
def test_the_order_of_a_triangle_by_counting(size: int) -> None:
    places = {(i, j): k for k, (i, j) in enumerate(
        (i, j) for j in range(size) for i in range(j + 1)
    )}  # fmt: skip
    lower = [places[column, row] for column in range(size) for row in range(column, size)]
    assert lower_order(size).tolist() == lower


@pytest.mark.parametrize("solver", BOTH)
def test_the_largest_eigenvalues_of_two_matrices(solver: Solver) -> None:
    """Min t1 + t2 + u with t I - M positive semidefinite for each, and u = 3 by an equation."""
    rng = np.random.default_rng(3)
    matrices = [m + m.T for m in (rng.standard_normal((4, 4)), rng.standard_normal((3, 3)))]
    first, second = (upper(np.eye(len(m))) for m in matrices)
    A = np.zeros((1 + len(first) + len(second), 3))
    A[0, 2] = 1
    A[1 : 1 + len(first), 0], A[1 + len(first) :, 1] = -first, -second
    b = np.concatenate([[3.0], *(-upper(m) for m in matrices)])
    x, status = solve_cones(sparse.csc_matrix(A), b, np.ones(3), 1, [4, 3], solver)
    assert status == "Solved"
    tops = [float(np.linalg.eigvalsh(m)[-1]) for m in matrices]
    np.testing.assert_allclose(x, [*tops, 3.0], atol=1e-6)


@pytest.mark.parametrize("solver", BOTH)
def test_a_problem_without_a_solution_is_not_solved(solver: Solver) -> None:
    A = sparse.csc_matrix(np.array([[1.0], [1.0]]))  # x = 1, and -x not negative
    _, status = solve_cones(A, np.array([1.0, 0.0]), np.ones(1), 1, [1], solver)
    assert status not in ("Solved", "AlmostSolved")


@pytest.mark.parametrize("form", ["exact", "printed"])
def test_designs_of_both_solvers_agree_and_are_certified(form: str) -> None:
    model = ErrorModel.p1(1.0)
    one, two = (design_filter(model, form, solver=solver) for solver in BOTH)  # type: ignore[arg-type]
    assert (one.solver, two.solver) == ("Clarabel", "SCS")
    assert two.gamma == pytest.approx(one.gamma, rel=1e-6)
    np.testing.assert_allclose(two.gain, one.gain, atol=1e-3)
    for design in (one, two):
        noise = np.hstack([model.B, -design.gain @ model.D])
        assert hinf_norm(model.A - design.gain @ model.C, noise, model.L) <= design.level * (
            1 + 1e-6
        )


@pytest.mark.parametrize("structure", ["full", "block"])
def test_fusion_by_both_solvers_agrees_and_is_certified(structure: str) -> None:
    """Two random walks with the gain 1: half of each is best, gamma the root of 3/2."""
    model = ErrorModel(A=[[1]], B=[[1]], C=[[1]], D=[[1]], L=[[1]], E=[[0]], period=1.0)
    designs = [design_filter(model, margin=1e-6, solver="clarabel")] * 2
    for solver in BOTH:
        fusion = design_fusion(designs, "common", structure, solver=solver)  # type: ignore[arg-type]
        assert fusion.gamma == pytest.approx(1.5**0.5, rel=1e-5)
        np.testing.assert_allclose(fusion.weights.ravel(), 0.5, atol=1e-3)
        assert fusion_gain(designs, fusion.weights, "common") <= fusion.level * (1 + 1e-6)
        assert fusion.solver == {"clarabel": "Clarabel", "scs": "SCS"}[solver]


def test_one_and_two_threads_design_the_same() -> None:
    model, found = ErrorModel.p2(1.0), []
    for threads in (1, 2):
        with threadpool_limits(threads, "blas"):
            had = {lib["num_threads"] for lib in threadpool_info() if lib["user_api"] == "blas"}
            if max(had) != threads:
                pytest.skip(f"The linear algebra has {had} threads when told to have {threads}.")
            design = design_filter(model, solver="clarabel")
            found.append((design, design_fusion([design] * 3, "common", "full", solver="clarabel")))
    (one, fused), (two, refused) = found
    assert two.gamma == pytest.approx(one.gamma, rel=1e-7)
    np.testing.assert_allclose(two.gain, one.gain, atol=1e-5)
    assert refused.gamma == pytest.approx(fused.gamma, rel=1e-7)


def test_the_variable_names_the_solver(monkeypatch: pytest.MonkeyPatch) -> None:
    model = ErrorModel(A=[[1]], B=[[1]], C=[[1]], D=[[1]], L=[[1]], E=[[0]], period=1.0)
    monkeypatch.delenv(SOLVER_VARIABLE, raising=False)
    assert chosen_solver() == "clarabel"
    monkeypatch.setenv(SOLVER_VARIABLE, "")
    assert design_filter(model).solver == "Clarabel"
    monkeypatch.setenv(SOLVER_VARIABLE, "scs")
    assert design_filter(model).solver == "SCS"
    assert design_filter(model, solver="clarabel").solver == "Clarabel"
    monkeypatch.setenv(SOLVER_VARIABLE, "mosek")
    with pytest.raises(ParameterError, match=r'INSWSN_SOLVER is .mosek.; it may be one of "clar'):
        design_filter(model)
    with pytest.raises(ParameterError, match=r"solver is .mosek.; it may be one of"):
        design_filter(model, solver="mosek")  # type: ignore[arg-type]
    with pytest.raises(ParameterError, match=r"solver is \['scs'\]; it may be one of"):
        design_filter(model, solver=["scs"])  # type: ignore[arg-type]


def test_clarabel_is_asked_where_scs_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    """Only where the variable named SCS; and the counts tell it."""
    monkeypatch.setattr(module, "_counts", type(module._counts)())
    monkeypatch.setenv(SOLVER_VARIABLE, "scs")

    def picky(solver: Solver, once: bool) -> tuple[Solver, bool]:
        if solver == "scs":
            raise InfeasibleDesignError("no")
        return solver, once

    def hopeless(solver: Solver, once: bool) -> None:
        raise InfeasibleDesignError("no")

    assert designed_by(None, picky) == ("clarabel", False)
    assert designed_by(None, lambda solver, once: (solver, once)) == ("scs", True)
    assert designed_by("scs", lambda solver, once: (solver, once)) == ("scs", False)
    with pytest.raises(InfeasibleDesignError):
        designed_by("scs", picky)
    with pytest.raises(InfeasibleDesignError):
        designed_by(None, hopeless)
    assert design_counts() == {"Clarabel": "1 taken, 1 refused", "SCS": "2 taken, 3 refused"}


def test_what_executes_chapters_knows_the_same_solvers() -> None:
    """It imports no numerics and so names them itself."""
    assert runs.SOLVER_VARIABLE == SOLVER_VARIABLE
    assert runs.SOLVERS == BOTH
