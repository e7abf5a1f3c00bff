"""How long a gain holds, compiled and not, is as by LAPACK's factors.

`test_stochastic` holds the gain against singular values.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from inswsn_lib.kernels import choose
from inswsn_lib.kernels.horizon_steps import horizon_steps
from inswsn_lib.lmi.stochastic import _first

FORMS = [choose("horizon_steps"), horizon_steps]


@pytest.mark.parametrize("run", FORMS)
@pytest.mark.parametrize("seed", range(20))
def test_it_holds_for_as_many_steps_as_by_lapack(seed: int, run: Any) -> None:
    rng = np.random.default_rng(seed)
    n, p, outputs, jitters = rng.integers(1, 7, size=4)
    A = rng.standard_normal((n, n)) / n**0.5
    E = 0.3 * rng.standard_normal((jitters - 1, n, n)) / n**0.5
    given = A, E, rng.standard_normal((n, p)), rng.standard_normal((outputs, n))
    B, L = given[2:]
    before = [matrix.copy() for matrix in given]
    gains = np.geomspace(0.1, 1e4, 60)
    held = [run(A, E, B, L, gain, 40) for gain in gains]
    assert held == [len(_first(40, A, E, B, L, gain)) for gain in gains]
    assert held[0] == 0
    assert len(set(held)) > 2
    assert all(np.array_equal(*each) for each in zip(given, before, strict=True))


@pytest.mark.parametrize("run", FORMS)
@pytest.mark.parametrize("first", [1e200, np.inf, np.nan])
def test_it_ends_where_numbers_do(first: float, run: Any) -> None:
    """And after no steps, if none are asked for."""
    one, none = np.ones((1, 1)), np.zeros((0, 1, 1))
    with np.errstate(all="ignore"):
        for A, L in ((first * one, one), (one, first * one)):
            assert run(A, none, one, L, 1e150, 5) < 5
    assert run(one, none, one, one, 2.0, 0) == 0
