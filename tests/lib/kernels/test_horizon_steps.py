"""The recursion over a finite horizon, compiled, against the one of numpy."""

from __future__ import annotations

import numpy as np
import pytest

from inswsn_lib.kernels.horizon_steps import horizon_steps
from inswsn_lib.lmi.stochastic import _steps_held


@pytest.mark.parametrize("seed", range(20))
def test_it_holds_for_as_many_steps(seed: int) -> None:
    rng = np.random.default_rng(seed)
    n, p, outputs, jitters = rng.integers(1, 7, size=4)
    A = rng.standard_normal((n, n)) / n**0.5
    E = 0.3 * rng.standard_normal((jitters - 1, n, n)) / n**0.5
    B, L = rng.standard_normal((n, p)), rng.standard_normal((outputs, n))
    given = [matrix.copy() for matrix in (A, E, B, L)]
    held = [
        (_steps_held(A, E, B, L, gain, 40), horizon_steps(A, E, B, L, gain, 40))
        for gain in np.geomspace(0.1, 1e4, 60)
    ]
    assert all(plain == compiled for plain, compiled in held)
    assert held[0][0] == 0
    assert len({plain for plain, _ in held}) > 2
    assert all(np.array_equal(*each) for each in zip(given, (A, E, B, L), strict=True))


@pytest.mark.parametrize("first", [1e200, np.inf, np.nan])
def test_it_ends_where_numbers_do(first: float) -> None:
    """And after no steps, if none are asked for."""
    one, none = np.ones((1, 1)), np.zeros((0, 1, 1))
    for A, L in ((first * one, one), (one, first * one)):
        plain = _steps_held(A, none, one, L, 1e150, 5)
        assert plain < 5
        assert horizon_steps(A, none, one, L, 1e150, 5) == plain
    assert (
        horizon_steps(one, none, one, one, 2.0, 0) == _steps_held(one, none, one, one, 2.0, 0) == 0
    )
