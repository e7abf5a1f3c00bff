"""What unknowns do to the parts' inequalities, compiled and not, against the products J'QJ."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from inswsn_lib.kernels import choose
from inswsn_lib.kernels.arrow_columns import arrow_columns


@pytest.mark.parametrize("run", [choose("arrow_columns"), arrow_columns])
@pytest.mark.parametrize("seed", range(10))
def test_it_is_the_product(seed: int, run: Any) -> None:
    rng = np.random.default_rng(seed)
    parts, size, d, unknowns = rng.integers(1, 7, size=4)
    unknown = np.repeat(np.arange(unknowns), rng.integers(1, 3, size=unknowns))
    row, column = rng.integers(0, size, size=(2, len(unknown)))
    J, weight = rng.normal(size=(parts, size, d)), rng.normal(size=len(unknown))
    if seed == 0:
        J[-1, 0, 0] = np.nan  # which spoils no other part
    given = J, unknown, row, column, weight
    before = [each.copy() for each in given]
    Q = np.zeros((unknowns, size, size))
    for at in ((row, column), (column, row)):
        np.add.at(Q, (unknown, *at), weight / 2)
    a, b = np.triu_indices(d)
    wanted = np.einsum("cpi,apq,cqj->caij", J, Q, J)[:, :, a, b] * np.where(a == b, 1.0, 2**0.5)
    sound = np.isfinite(J).all(axis=(1, 2))
    np.testing.assert_allclose(run(*given)[sound], wanted[sound], rtol=1e-12, atol=1e-12)
    assert all(np.array_equal(*each, equal_nan=True) for each in zip(given, before, strict=True))
