"""P1's Tables 1 and 3 cell by cell: who is fed with what, and on which samples."""

from __future__ import annotations

import numpy as np
import pytest
from inswsn_book.evidence.outage_tables import (
    rebuild_table1,
    rebuild_table3,
    table1_cells,
)

from inswsn_lib.evaluation import Finding
from inswsn_lib.learning import LSSVMRegressor
from inswsn_lib.navigation import BridgedOutages, with_outage
from inswsn_lib.papers import COLUMNS


@pytest.fixture(scope="module")
def outages() -> BridgedOutages:
    return BridgedOutages(runs=6, tuning_runs=2)


@pytest.fixture(scope="module")
def table3(outages: BridgedOutages) -> dict[str, Finding]:
    return rebuild_table3(outages)


def test_the_ins_is_what_is_drawn(outages: BridgedOutages, table3: dict[str, Finding]) -> None:
    drift = np.abs(outages.drawn["ins.outage2"][:, 3]).mean(axis=0)
    found = table3["table3.ins.vy2"]
    assert found.value == pytest.approx(np.median(drift))
    assert drift.min() <= found.low < found.value < found.high <= drift.max()


def test_every_cell_is_there_and_equal_terms_are_those_of_the_scores(
    outages: BridgedOutages, table3: dict[str, Finding]
) -> None:
    scores = outages.scores()
    for column in COLUMNS:
        assert {f"table3.{m}.{column}" for m in ("ins", "bp", "lssvm")} <= set(table3)
        for learner in ("bp", "ls-svm"):
            found = table3[f"fair.cells.{learner}.{column}"]
            assert found.value == pytest.approx(np.median(scores.of(learner, column)))
    for name, finding in scores.findings.items():
        assert table3[name][:3] == pytest.approx(finding[:3])


def test_the_printed_machine_is_fed_with_the_answer(
    outages: BridgedOutages, table3: dict[str, Finding]
) -> None:
    """It leaves less of the position than on the motion, with the same settings."""
    fed = outages.judge(outages.judged.values(), outages.printed, "motion", scaled=False)
    alone = np.abs(outages.drawn["ins.outage1"][:, 0]).mean(axis=0)
    assert table3["table3.lssvm.rx1"].value < 0.5 * np.median(fed[0] * alone)


def test_table_1_is_of_the_points_that_trained(outages: BridgedOutages) -> None:
    passage = outages.judged["1"]
    found = rebuild_table1(outages, {2: (30.0, 100.0)})
    errors = []
    for run in range(outages.runs):
        x, y = passage.error[:50, :, run], passage.y[:50, :, run]
        left = LSSVMRegressor(30.0, 100.0).fit(x, y).predict(x) - y
        errors.append(np.abs(left).mean(axis=0))
    middle = np.median(errors, axis=0)
    for i, axis in enumerate(("rx", "ry", "vx", "vy")):
        assert found[f"table1.row02.{axis}"].value == pytest.approx(middle[i])
    both = np.median(np.array(errors)[:, :2].mean(axis=1))
    assert found["table1.row02.mean-position"].value == pytest.approx(both)


def test_scaled_cells_are_in_the_units_of_the_table(outages: BridgedOutages) -> None:
    """A machine that follows nothing leaves the deviation of the targets, scaled or not."""
    passage, half = outages.judged["1"], np.arange(50)
    plain, scaled = (
        table1_cells(passage, [(1e6, 1e-6)], half, half, scaled=which) for which in (False, True)
    )
    assert scaled == pytest.approx(plain, rel=1e-3)
    wide = table1_cells(passage, [(9.0, 10.0)], half, half, runs=2)
    root = table1_cells(passage, [(81.0, 10.0)], half, half, runs=2, width=np.sqrt)
    assert root == pytest.approx(wide)


@pytest.mark.parametrize("samples", [5, 100])
def test_an_outage_of_another_length_moves_no_area(samples: int) -> None:
    outages = BridgedOutages(with_outage(BridgedOutages().published, samples), runs=2)
    for area, passage in outages.judged.items():
        assert passage.error.shape[0] == 100 + samples
        was = BridgedOutages(runs=2).judged[area]
        assert passage.time[:100] == pytest.approx(was.time[:100])
        assert not np.isnan(passage.y[:100]).any()
