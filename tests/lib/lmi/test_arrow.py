"""The interior-point method of parts against problems by hand, and against Clarabel."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.linalg import block_diag

from inswsn_lib.lmi import InfeasibleDesignError, arrow
from inswsn_lib.lmi.arrow import Arrow, Places, solve_arrow
from inswsn_lib.lmi.solvers import Inequality, solve

# a symmetric matrix of unknowns, (2, 2), and another that fills the corner, with the sign changed
ROW, COLUMN = np.array([0, 0, 1, 2, 2, 3]), np.array([0, 1, 1, 2, 3, 3])
PLACES = Places(4, np.arange(6), ROW, COLUMN, -np.ones(6), 2)


def problem(seed: int, parts: int = 4, d: int = 6) -> Arrow:
    """Random parts: J'(-x)J below a share of the diagonal and what the corners give each other."""
    rng = np.random.default_rng(seed)
    J = rng.normal(size=(parts, 4, d))
    f = np.repeat([0.0, 1.0], [2, d - 2])
    q = np.abs(rng.normal(size=(parts, 6))) * [1, 0, 1, 0, 0, 0]
    G = np.tile(np.eye(3), (parts, 1, 1))
    return Arrow(PLACES, J, f, f, q, G, np.array([1.0, 0.2, 1.0]), False)


def test_the_largest_eigenvalues_by_hand() -> None:
    """The least s with C_c <= s I, C_c fixed by equations: the largest of all; a corner is idle."""
    rng = np.random.default_rng(1)
    C = rng.normal(size=(3, 2, 2))
    C = C + C.mT
    upper = C[:, [0, 0, 1], [0, 1, 1]]
    G = np.zeros((3, 9, 3))
    for c in range(3):
        G[c, 3 * c : 3 * c + 3] = np.eye(3)
    row, column, signs = [0, 0, 1, 2], [0, 1, 1, 2], np.array([1.0, 1.0, 1.0, -1.0])
    places = Places(3, np.arange(4), np.array(row), np.array(column), signs, 1)
    last = np.array([0.0, 0.0, 1.0])
    given = Arrow(
        places, np.tile(np.eye(3), (3, 1, 1)), 1 - last, last, np.zeros((3, 4)), G, upper.ravel(),
        True,
    )  # fmt: skip
    found = solve_arrow(given)
    assert found.status == "optimal"
    assert found.s == pytest.approx(np.linalg.eigvalsh(C).max(), rel=1e-7)
    assert found.x[:, :3] == pytest.approx(upper, abs=1e-7)
    # the dual solution is the projection on the vector of that eigenvalue
    assert np.trace(found.Z[:, :2, :2], axis1=1, axis2=2).sum() == pytest.approx(1, abs=1e-6)


@pytest.mark.parametrize("seed", range(5))
def test_it_comes_to_what_clarabel_finds(seed: int) -> None:
    given = problem(seed)
    N, m = given.q.shape
    constants = given.left(np.zeros((N, m)), 0.0)
    inequalities = [
        Inequality(
            constants[c], J.T @ given.places.filled(np.eye(m)) @ J, np.arange(c * m, (c + 1) * m)
        )
        for c, J in enumerate(given.J)
    ]
    left = np.hstack([block_diag(G, np.eye(3)) for G in given.G])
    theirs = solve(given.q.ravel(), inequalities, "clarabel", (left, np.append(given.h, [0, 0, 0])))
    ours = solve_arrow(given)
    assert np.sum(given.q * ours.x) == pytest.approx(float(given.q.ravel() @ theirs.x), rel=1e-6)
    assert np.linalg.eigvalsh(given.left(ours.x, 0.0)).max() < 1e-7
    assert np.abs(ours.x[:, 3:]).max() > 0.01  # the corners do give
    assert ours.x[:, 3:].sum(axis=0) == pytest.approx(0, abs=1e-8)
    # the dual solution is one: positive, stationary up to multipliers that all parts share
    assert np.linalg.eigvalsh(ours.Z).min() > -1e-9
    left = given.q + given.places.read(given.J @ ours.Z @ given.J.mT)
    assert left == pytest.approx(np.tile(left[0], (N, 1)), abs=1e-6)


def test_what_it_reads_and_fills_are_adjoint() -> None:
    rng = np.random.default_rng(2)
    x, V = rng.normal(size=(3, 6)), rng.normal(size=(3, 4, 4))
    V = V + V.mT
    assert np.sum(PLACES.filled(x) * V) == pytest.approx(np.sum(x * PLACES.read(V)))


def test_a_problem_without_a_solution_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    """The sum of positive matrices is not negative; and so it is after too few steps."""
    never = replace(problem(0), h=-np.ones(3), f=np.zeros(6))
    with pytest.raises(InfeasibleDesignError, match=r"^The method of parts stops .* from a sol"):
        solve_arrow(never)
    monkeypatch.setattr(arrow, "_STEPS", 2)
    with pytest.raises(InfeasibleDesignError, match=r"^The method of parts stops"):
        solve_arrow(problem(0))
