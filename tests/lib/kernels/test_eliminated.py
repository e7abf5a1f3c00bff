"""Inverses side by side, compiled and not, are those of LAPACK."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from random_filters import random_covariances

from inswsn_lib.filters import information
from inswsn_lib.kernels import choose
from inswsn_lib.kernels.eliminated import eliminated

FORMS = [choose("eliminated"), eliminated]


@pytest.mark.parametrize("run", FORMS)
@pytest.mark.parametrize("seed", range(20))
def test_they_are_the_inverses_of_lapack(seed: int, run: Any) -> None:
    rng = np.random.default_rng(seed)
    filters, n, K = rng.integers(0, 4), rng.integers(1, 7), rng.choice([0, 1, 3, 70])
    each = random_covariances(rng, n, filters, K)
    given = np.ascontiguousarray(np.moveaxis(each, 1, -1))
    before = given.copy()
    found = np.moveaxis(run(given), -1, 1)
    assert np.array_equal(given, before)
    assert found == pytest.approx(np.linalg.inv(each), rel=1e-10, abs=1e-10)


def test_what_has_no_inverse_is_not_finite() -> None:
    given = np.array([[1.0, 1.0], [1.0, 1.0]])[None, :, :, None]
    for run in FORMS:
        with np.errstate(all="ignore"):
            assert not np.isfinite(run(given)).all()
    with pytest.raises(information.ParameterError, match="is lost to rounding"):
        information.inverses(np.repeat(given, 2, axis=-1))
