"""The compiled step of filters in the information form is the plain one."""

from __future__ import annotations

import numpy as np
import pytest
from random_filters import random_covariances

from inswsn_lib.filters import information
from inswsn_lib.kernels import choose

compiled = choose("moved_information", information._moved)


@pytest.mark.parametrize("seed", range(20))
def test_it_is_the_plain_step(seed: int) -> None:
    rng = np.random.default_rng(seed)
    n, filters = rng.integers(1, 7), rng.integers(0, 5)
    Y, A = random_covariances(rng, n, filters), np.eye(n) + 0.3 * rng.normal(size=(n, n))
    shares = np.where(rng.random(filters) < 0.3, 0.0, rng.random(filters))
    given = Y, A, random_covariances(rng, n), shares
    before = [each.copy() for each in given]
    *found, inflation = compiled(*given)
    *theirs, wanted = information._moved(*given)
    assert all(np.array_equal(a, b) for a, b in zip(given, before, strict=True))
    assert inflation == pytest.approx(wanted, rel=1e-9)
    for ours, plain in zip(found, theirs, strict=True):
        assert ours == pytest.approx(plain, rel=1e-9, abs=1e-10)


def test_what_has_no_inverse_is_infinitely_inflated() -> None:
    for lost in (0.0, np.nan):
        Y = np.array([[[1.0, 0.0], [0.0, lost]]])
        given = Y, np.eye(2), np.eye(2), np.ones(1)
        assert not compiled(*given)[-1] <= 1e9
        assert not information._moved(*given)[-1] <= 1e9
