"""Metrics by hand."""

from __future__ import annotations

import numpy as np
import pytest

from inswsn_lib.errors import ParameterError
from inswsn_lib.evaluation import largest_error, mean_absolute_error, root_mean_square_error, spread

ERRORS = np.array([[[3.0, 1.0]], [[-4.0, np.nan]], [[0.0, -1.0]]])


def test_errors_over_a_window_by_hand() -> None:
    assert mean_absolute_error(ERRORS)[0] == pytest.approx([7 / 3, 1])
    assert root_mean_square_error(ERRORS)[0] == pytest.approx([(25 / 3) ** 0.5, 1])
    assert largest_error(ERRORS)[0] == pytest.approx([4, 1])


def test_spread_of_a_ramp_and_of_too_few_runs() -> None:
    found = spread(np.vstack([np.arange(1001.0), -np.arange(1001.0)]))
    assert found.median == pytest.approx([500, -500])
    # the value k stands at (k + 1) / 1002
    assert found.low == pytest.approx([24.05, -975.95])
    assert found.high == pytest.approx([975.95, -24.05])
    assert spread(np.zeros((2, 40))).low.tolist() == [0, 0]
    with pytest.raises(ParameterError, match="40 or more runs"):
        spread(np.zeros((2, 39)))
    with pytest.raises(ParameterError, match=r"values .* not of shape"):
        spread(np.zeros(40))
