"""P1's Table 2 cell by cell: what is drawn, and windows of a recording."""

from __future__ import annotations

import numpy as np
import pytest
from inswsn_book.evidence.training_table import rebuild_table2, with_recorded

from inswsn_lib.evaluation import Finding
from inswsn_lib.navigation import FilterContest, TrainingAreas, table2_cells


@pytest.fixture(scope="module")
def contest() -> FilterContest:
    return FilterContest(TrainingAreas(runs=40, other_runs=20))


@pytest.fixture(scope="module")
def exact(contest: FilterContest) -> dict[str, Finding]:
    """The table where recorded fixes have no error."""
    return rebuild_table2(contest, np.zeros((150, 2)))


def test_the_ins_is_what_is_drawn(contest: FilterContest, exact: dict[str, Finding]) -> None:
    for column, cell in table2_cells(contest.areas.drawn["ins"]).items():
        found = exact[f"table2.ins.{column}"]
        assert found.value == pytest.approx(np.median(cell))
        assert found.low < found.value < found.high


def test_exact_fixes_leave_little(exact: dict[str, Finding]) -> None:
    """Both filters, tuned for fixes of 0.2 m, then have the lag of their gain alone."""
    for column in ("rx1", "ry1", "rx2", "ry2"):
        for name in ("kalman", "hf-exact-lmi"):
            assert exact[f"recorded.cells.{name}.{column}"].value < 0.8 * (
                exact[f"fair.cells.{name}.{column}"].value
            )
    assert not any(name.startswith("recorded.cells.kalman.v") for name in exact)


def test_windows_are_stretches_of_the_recording() -> None:
    drawn = {part: {a: np.zeros((20, 4, 6)) for a in "12"} for part in ("ins", "wsn")}
    series = np.arange(100.0)[:, None] * [1, -1]
    changed = with_recorded(drawn, series, np.random.default_rng(3))["wsn"]
    for errors in changed.values():
        np.testing.assert_array_equal(np.diff(errors[:, 0], axis=0), 1)
        np.testing.assert_array_equal(errors[:, 1], -errors[:, 0])
        assert len(set(errors[0, 0])) > 1  # from random starts
    assert not drawn["wsn"]["1"].any()
