"""What unknowns do to the parts' inequalities, compiled, against numpy."""

from __future__ import annotations

import numpy as np
import pytest

from inswsn_lib.kernels.arrow_columns import arrow_columns
from inswsn_lib.lmi.arrow import _columns


@pytest.mark.parametrize("seed", range(10))
def test_it_is_the_same(seed: int) -> None:
    rng = np.random.default_rng(seed)
    parts, size, d, unknowns = rng.integers(1, 7, size=4)
    unknown = np.repeat(np.arange(unknowns), rng.integers(1, 3, size=unknowns))
    row, column = rng.integers(0, size, size=(2, len(unknown)))
    J, weight = rng.normal(size=(parts, size, d)), rng.normal(size=len(unknown))
    if seed == 0:
        J[0, 0, 0] = np.nan
    given = [each.copy() for each in (J, unknown, row, column, weight)]
    plain = _columns(J, unknown, row, column, weight)
    np.testing.assert_allclose(
        arrow_columns(J, unknown, row, column, weight), plain, rtol=1e-12, atol=1e-12
    )
    for each, before in zip((J, unknown, row, column, weight), given, strict=True):
        assert np.array_equal(each, before, equal_nan=True)
