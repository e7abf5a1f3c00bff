"""Scores of hypotheses by hand."""

from __future__ import annotations

import numpy as np
import pytest

from inswsn_lib.errors import ParameterError
from inswsn_lib.evaluation import score_hypothesis


def test_by_hand() -> None:
    score = score_hypothesis("halves", [1.05, 0.95, 2.0], [1.0, 1.0, 4.0], free=1)
    assert score.ratios == pytest.approx([1.05, 0.95, 0.5])
    assert (score.met, score.explained, score.worst) == (2, False, 0.5)
    assert score.spread == pytest.approx(
        np.sqrt((np.log(1.05) ** 2 + np.log(0.95) ** 2 + np.log(0.5) ** 2) / 3)
    )


def test_as_many_free_numbers_as_cells_explain_nothing() -> None:
    cells = [1.0, 2.0]
    assert score_hypothesis("exact", cells, cells, free=1).explained
    assert not score_hypothesis("fitted", cells, cells, free=2).explained


@pytest.mark.parametrize(
    ("rebuilt", "printed", "free"),
    [([1.0], [1.0, 2.0], 0), ([], [], 0), ([0.0], [1.0], 0), ([1.0], [np.nan], 0), ([1], [1], -1)],
)
def test_what_does_not_pair_is_refused(rebuilt: list, printed: list, free: int) -> None:
    with pytest.raises(ParameterError):
        score_hypothesis("none", rebuilt, printed, free)
