"""The compiled planar INS is the plain one."""

from __future__ import annotations

import numpy as np
import pytest

from inswsn_lib.kernels import choose
from inswsn_lib.simulation import ins


@pytest.mark.parametrize(("steps", "runs"), [(0, 3), (1, 1), (200, 1), (200, 7), (50, 0)])
def test_it_is_the_plain_integration(steps: int, runs: int) -> None:
    rng = np.random.default_rng(steps + runs)
    given = (
        rng.normal(size=5), rng.normal(size=(steps, 2)), rng.normal(size=steps),
        rng.uniform(0.01, 0.1, steps), 0.3, 0.2, rng.standard_normal((steps, 3, runs)),
    )  # fmt: skip
    before = [np.copy(each) for each in given]
    ours, plain = (np.full((steps + 1, 4, runs), np.nan) for _ in range(2))
    assert choose("planar_ins", ins._integrated)(*given, ours) is not None
    ins._integrated(*given, plain)
    assert all(np.array_equal(a, b) for a, b in zip(given, before, strict=True))
    np.testing.assert_allclose(ours, plain, rtol=1e-11, atol=1e-11)


def test_a_reading_that_is_missing_is_missing_from_then_on() -> None:
    noise = np.zeros((4, 3, 2))
    noise[2, 2, 1] = np.nan
    start, out = np.zeros(5), np.empty((5, 4, 2))
    choose("planar_ins", ins._integrated)(
        start, np.ones((4, 2)), np.zeros(4), np.ones(4), 1.0, 1.0, noise, out
    )
    assert np.isnan(out[3:, :, 1]).all()
    assert np.isfinite(out[:3]).all()
    assert np.isfinite(out[..., 0]).all()
