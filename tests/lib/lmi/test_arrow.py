"""The interior-point method of parts against problems by hand, and against Clarabel."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from inswsn_lib.lmi import InfeasibleDesignError, arrow
from inswsn_lib.lmi.arrow import Arrow, Places, solve_arrow
from inswsn_lib.lmi.solvers import Inequality, solve

# a symmetric X, (2, 2), with the sign changed
PLACES = Places(2, np.arange(3), np.array([0, 0, 1]), np.array([0, 1, 1]), -np.ones(3))


def problem(seed: int, parts: int = 4, d: int = 5) -> Arrow:
    """Random parts: J'(-X)J below a share of the diagonal, the sum of the X given."""
    rng = np.random.default_rng(seed)
    J = rng.normal(size=(parts, 2, d))
    O = np.zeros(d)  # noqa: E741
    O[2:] = 1.0
    q = np.abs(rng.normal(size=(parts, 3))) * [1, 0, 1]
    G = np.tile(np.eye(3), (parts, 1, 1))
    return Arrow(PLACES, J, O, 1.0, q, G, np.array([1.0, 0.2, 1.0]), np.zeros(3), False)


def test_the_largest_eigenvalues_by_hand() -> None:
    """The least s with C_c <= s I, C_c fixed by equations: the largest of all, if positive."""
    rng = np.random.default_rng(1)
    C = rng.normal(size=(3, 2, 2))
    C = C + C.mT
    upper = C[:, [0, 0, 1], [0, 1, 1]]
    G = np.zeros((3, 9, 3))
    for c in range(3):
        G[c, 3 * c : 3 * c + 3] = np.eye(3)
    given = Arrow(
        replace(PLACES, sign=np.ones(3)), np.tile(np.eye(2, 3), (3, 1, 1)), np.ones(3), 0.0,
        np.zeros((3, 3)), G, upper.ravel(), np.zeros(9), True,
    )  # fmt: skip
    found = solve_arrow(given)
    assert found.status == "optimal"
    assert found.s == pytest.approx(np.linalg.eigvalsh(C).max(), rel=1e-7)
    assert found.x == pytest.approx(upper, abs=1e-7)
    # the dual solution is the projection on the vector of that eigenvalue
    assert np.trace(found.Z, axis1=1, axis2=2).sum() == pytest.approx(1, abs=1e-6)


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
    theirs = solve(given.q.ravel(), inequalities, "clarabel", (np.hstack(list(given.G)), given.h))
    ours = solve_arrow(given)
    assert np.sum(given.q * ours.x) == pytest.approx(float(given.q.ravel() @ theirs.x), rel=1e-6)
    assert np.linalg.eigvalsh(given.left(ours.x, 0.0)).max() < 1e-7
    # the dual solution is one: positive, stationary up to multipliers that all parts share
    assert np.linalg.eigvalsh(ours.Z).min() > -1e-9
    left = given.q + given.places.read(given.J @ ours.Z @ given.J.mT)
    assert left == pytest.approx(np.tile(left[0], (N, 1)), abs=1e-6)


def test_what_it_reads_and_fills_are_adjoint() -> None:
    rng = np.random.default_rng(2)
    x, V = rng.normal(size=(3, 3)), rng.normal(size=(3, 2, 2))
    V = V + V.mT
    assert np.sum(PLACES.filled(x) * V) == pytest.approx(np.sum(x * PLACES.read(V)))


def test_a_problem_without_a_solution_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    """The sum of positive matrices is not negative; and so it is after too few steps."""
    never = replace(problem(0), h=-np.ones(3), O=np.zeros(5))
    with pytest.raises(InfeasibleDesignError, match=r"^The method of parts stops .* from a sol"):
        solve_arrow(never)
    monkeypatch.setattr(arrow, "_STEPS", 2)
    with pytest.raises(InfeasibleDesignError, match=r"^The method of parts stops"):
        solve_arrow(problem(0))
