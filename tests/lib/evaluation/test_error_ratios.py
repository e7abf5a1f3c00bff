"""Ratios of errors along a recording, exact ones; tests/trials tells how often intervals hold."""

from __future__ import annotations

import numpy as np
import pytest

from inswsn_lib.errors import ParameterError
from inswsn_lib.evaluation import block_ratio


def test_a_constant_factor_is_known_exactly() -> None:
    theirs = np.random.default_rng(1).exponential(size=500)
    assert block_ratio(0.09 * theirs, theirs) == pytest.approx((0.3, 0.3, 0.3))


def test_of_independent_squares_the_width_is_that_of_the_delta_method() -> None:
    # the log of a ratio of two sums of n squared normal values has the variance 2 * 2 / n, that of
    # the ratio of RMS a quarter of it; 20 blocks have Student's 2.09 for 1.96
    rng, n = np.random.default_rng(2), 4000
    widths = []
    for _ in range(40):
        mine, theirs = np.square(rng.normal(size=(2, n)))
        ratio, low, high = block_ratio(mine, theirs)
        assert ratio == pytest.approx(np.sqrt(mine.sum() / theirs.sum()))
        widths.append(np.log(high / low) / (2 * 2.093))
    assert np.mean(widths) == pytest.approx(np.sqrt(1 / n), rel=0.1)


def test_rows_that_share_data_are_in_one_block() -> None:
    rng = np.random.default_rng(4)
    mine, theirs = np.square(rng.normal(size=(2, 60)))
    free, third, half = (block_ratio(mine, theirs, block) for block in (1, 20, 30))
    # never fewer than three blocks
    assert third == half != free


def test_what_cannot_be_told_is_said() -> None:
    with pytest.raises(ParameterError, match=r"^squares must be 3 rows or more, not 2"):
        block_ratio(np.ones(2), np.ones(2))
    assert np.isnan(block_ratio(np.ones(9), np.zeros(9))).all()
    # one block has all that the other does wrong
    theirs = np.append(np.zeros(8), 1.0)
    assert block_ratio(np.ones(9), theirs)[1:] == (0.0, np.inf)
