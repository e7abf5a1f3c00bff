"""Bounds from dual solutions against problems whose optimum is known."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, strategies as st

from inswsn_lib.lmi.bounds import dual_bound, mended


def largest(M: np.ndarray) -> tuple[np.ndarray, float]:
    """Return the dual solution of: minimise s with M - s I <= 0; and the optimum."""
    values, vectors = np.linalg.eigh(M)
    return np.outer(vectors[:, -1], vectors[:, -1]), float(values[-1])


@given(st.integers(0, 10**6), st.integers(1, 5), st.floats(1e-12, 1e-2))
def test_whatever_is_given_it_is_not_above_the_optimum(seed: int, n: int, wrong: float) -> None:
    """And for a dual solution that is nearly right it is near it."""
    rng = np.random.default_rng(seed)
    M = rng.normal(size=(n, n))
    M = M + M.T
    dual, optimum = largest(M)
    spoilt = dual + wrong * rng.normal(size=(n, n))
    found = dual_bound(spoilt, np.eye(n), M, -np.eye(n)[None], np.ones(1))
    assert found <= optimum + 1e-9
    assert found > optimum - 20 * wrong * np.abs(M).max() * n
    anything = rng.normal(size=(n, n))
    found = dual_bound(anything @ anything.T, np.eye(n), M, -np.eye(n)[None], np.ones(1))
    assert found <= optimum + 1e-9


def test_a_share_of_another_solution_makes_room() -> None:
    """Two unknowns and a dual solution of rank one, off by more than its small eigenvalue."""
    M, free = np.diag([2.0, 1.0, 0.0]), np.diag([0.0, 1.0, -1.0])

    terms = np.array([-np.eye(3), free])
    cost = np.array([1.0, 0.0])
    off = np.diag([1.0, 1e-9, -1e-9])
    found = dual_bound(off, np.eye(3) / 3, M, terms, cost)
    assert 2 - 1e-4 < found <= 2 + 1e-12


def test_what_cannot_be_mended_is_nothing() -> None:
    """No positive semidefinite matrix has a negative trace, nor one of the rank one the trace of
    another place."""
    assert mended(np.eye(2), np.eye(2)[None], -np.ones(1)) is None
    other = np.diag([0.0, 1.0])[None]
    assert mended(np.diag([1.0, 0.0]), other, np.ones(1)) is None
    made = mended(np.eye(2), other, np.array([3.0]))
    assert made == pytest.approx(np.diag([1.0, 3.0]))
    assert (
        dual_bound(np.eye(2), np.eye(2), np.zeros((2, 2)), np.eye(2)[None], np.ones(1)) == -np.inf
    )
