"""Ratios of errors along a recording: exact ones, and intervals whose width is known."""

from __future__ import annotations

import numpy as np
import pytest

from inswsn_lib.errors import ParameterError
from inswsn_lib.evaluation import block_ratio


def test_a_constant_factor_is_known_exactly_whatever_is_drawn() -> None:
    theirs = np.random.default_rng(1).exponential(size=500)
    assert block_ratio(0.09 * theirs, theirs, 50) == pytest.approx((0.3, 0.3, 0.3))


def test_of_independent_squares_the_width_is_that_of_the_delta_method() -> None:
    # the log of a ratio of two sums of n squared normal values has the variance 2 * 2 / n, that of
    # the ratio of RMS a quarter of it
    rng, n = np.random.default_rng(2), 4000
    mine, theirs = np.square(rng.normal(size=(2, n)))
    ratio, low, high = block_ratio(mine, theirs, 20, draws=4000)
    assert ratio == pytest.approx(np.sqrt(mine.sum() / theirs.sum()))
    assert (high - low) / (2 * 1.96) == pytest.approx(np.sqrt(1 / n), rel=0.12)


def test_errors_that_hang_together_widen_it_by_the_root_of_how_many_do() -> None:
    rng = np.random.default_rng(3)
    mine, theirs = np.repeat(np.square(rng.normal(size=(2, 200))), 25, axis=1)
    _, low, high = block_ratio(mine, theirs, 250, draws=4000)
    assert (high - low) / (2 * 1.96) == pytest.approx(np.sqrt(1 / 200), rel=0.25)
    _, narrow, wide = block_ratio(mine, theirs, 1, draws=4000)
    assert (high - low) / (wide - narrow) == pytest.approx(5.0, rel=0.3)


def test_too_few_blocks_are_refused() -> None:
    with pytest.raises(ParameterError, match=r"^block must be at most 33 for 100 "):
        block_ratio(np.ones(100), np.ones(100), 40)
