"""The compiled inverses are the plain ones."""

from __future__ import annotations

import numpy as np
import pytest
from random_filters import random_covariances

from inswsn_lib.filters import information
from inswsn_lib.kernels import choose

compiled = choose("eliminated", information._eliminated)


@pytest.mark.parametrize("seed", range(20))
def test_they_are_the_plain_inverses(seed: int) -> None:
    rng = np.random.default_rng(seed)
    filters, n, K = rng.integers(0, 4), rng.integers(1, 7), rng.choice([0, 1, 3, 70])
    given = np.ascontiguousarray(np.moveaxis(random_covariances(rng, n, filters, K), 1, -1))
    before = given.copy()
    found = compiled(given)
    assert np.array_equal(given, before)
    assert found == pytest.approx(information._eliminated(given), rel=1e-10, abs=1e-10)


def test_what_has_no_inverse_is_not_finite() -> None:
    given = np.array([[1.0, 1.0], [1.0, 1.0]])[None, :, :, None]
    for run in (compiled, information._eliminated):
        assert not np.isfinite(run(given)).all()
        with pytest.raises(information.ParameterError, match="is lost to rounding"):
            information.inverses(np.repeat(given, 2, axis=-1))
