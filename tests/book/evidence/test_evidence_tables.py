"""The papers' tables cell by cell: of which errors they are, and what is computed for them."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from inswsn_book.evidence import training_inputs
from inswsn_book.evidence.filter_gammas import printed_clocks, rebuild_gammas
from inswsn_book.evidence.fusion_percentages import FirstReading, rebuild_percentages
from inswsn_book.evidence.lmi_proof import attack
from inswsn_book.evidence.outage_cells import outages_by_drive, rebuild_outages, rebuild_recorded
from inswsn_book.evidence.outage_page import (
    area_squares,
    first_half,
    hf_over_kf,
    turning_time,
    with_past,
)
from inswsn_book.evidence.outage_tables import rebuild_table1, rebuild_table3, table1_cells
from inswsn_book.evidence.recorded_tables import mean_ratio
from inswsn_book.evidence.training_table import rebuild_table2, with_recorded

from inswsn_lib import data_file
from inswsn_lib.evaluation import Finding, mean_absolute_error
from inswsn_lib.filters import patterns_of
from inswsn_lib.learning import LSSVMRegressor
from inswsn_lib.lmi import design_filter, worst_disturbance
from inswsn_lib.models import ErrorModel
from inswsn_lib.navigation import (
    BridgedOutages,
    ClusterFusion,
    FilterContest,
    TrainingAreas,
    VehicleOutages,
    read_trials,
    table2_cells,
    with_outage,
)
from inswsn_lib.navigation.bridged_outages import Passage
from inswsn_lib.navigation.vehicle_outages import p3_settings
from inswsn_lib.papers import COLUMNS, read_numbers
from inswsn_lib.scenario import with_values

# P1: the printed gamma, by both inequalities -----------------------------------------------------


def test_a_mean_over_recordings_has_student_s_interval_in_logarithms() -> None:
    """Of -1, 0 and 1 it is 4.303 / sqrt(3) to either side: the quantile for two degrees."""
    mean, low, high = mean_ratio([np.exp(-1), 1.0, np.exp(1)])
    assert (mean, low * high) == pytest.approx((1.0, 1.0))
    assert np.log(high) == pytest.approx(4.303 / np.sqrt(3), rel=1e-3)


@pytest.fixture(scope="module")
def filters() -> Any:
    return read_numbers(data_file("papers/p1.yaml"))["filters"]


def test_the_clocks_are_the_printed_ones(filters: Any) -> None:
    assert printed_clocks(filters) == {"area1": (0.2, 0.0012), "area2": (0.21, 0.8409e-3)}


def test_the_fitted_noise_gives_the_printed_gamma(filters: Any) -> None:
    found = rebuild_gammas(filters)
    for area in ("area1", "area2"):
        for form in ("printed", "exact"):
            value = found[f"gamma.fitted.{form}.{area}"].value
            assert value == pytest.approx(float(filters[area]["gamma"]), abs=5e-5)


def test_gamma_has_the_unit_of_the_noise_and_the_exact_one_is_not_above(filters: Any) -> None:
    once, twice = (rebuild_gammas(filters, process_noise=n, measurement_noise=n) for n in (1, 2))
    for area in ("area1", "area2"):
        exact, printed = (once[f"gamma.alike.{form}.{area}"].value for form in ("exact", "printed"))
        assert exact <= printed + 1e-6
        assert twice[f"gamma.alike.exact.{area}"].value == pytest.approx(2 * exact, rel=1e-4)


def test_a_longer_period_needs_a_larger_gamma_in_both_areas(filters: Any) -> None:
    short, long = (rebuild_gammas(filters, period=T) for T in (0.2, 1.0))
    for area in ("area1", "area2"):
        name = f"gamma.alike.exact.{area}"
        assert long[name].value > 1.1 * short[name].value


@pytest.mark.parametrize("jitter", [0.0, 0.002])
def test_without_jitter_there_is_nothing_to_know(jitter: float) -> None:
    """The worst disturbance then attains its gain in each run; with jitter the filters differ."""
    design = design_filter(ErrorModel.p1(0.2, jitter), margin=0.01)
    worst = worst_disturbance(design.A_f, design.model.E, *design.error_system[1:], 30)
    knows, told_nothing = (attack(design, worst, 1, 30, 5, known) for known in (True, False))
    energies, spent = (each.sum(axis=0) for each in knows)
    if jitter == 0:
        assert np.sqrt(energies / spent) == pytest.approx(np.full(5, worst.gain))
        np.testing.assert_array_equal(knows[0], told_nothing[0])
    else:
        assert (knows[0][1:] != told_nothing[0][1:]).any(axis=0).all()


# P1: Table 2, what is drawn, and windows of a recording ------------------------------------------


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


def test_the_batch_is_what_a_kalman_filter_finds(
    contest: FilterContest, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert training_inputs.kalman_difference(contest.areas) < 1e-12
    # one that finds nothing is off by all of the state
    monkeypatch.setattr(training_inputs, "run_kalman", lambda _, y, **__: 0 * y)
    assert training_inputs.kalman_difference(contest.areas) == 1


# P1: Tables 1 and 3, who is fed with what, and on which samples ----------------------------------


@pytest.fixture(scope="module")
def outages() -> BridgedOutages:
    return BridgedOutages(runs=6, tuning_runs=2)


@pytest.fixture(scope="module")
def table3(outages: BridgedOutages) -> dict[str, Finding]:
    return rebuild_table3(outages)


def test_the_ins_of_outages_is_drawn(outages: BridgedOutages, table3: dict[str, Finding]) -> None:
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


def test_what_a_passage_tells_of_the_past_and_in_its_first_half() -> None:
    error = np.arange(6.0)[:, None, None] + np.array([0.0, 10.0])[None, :, None]
    told = Passage("1", 4, error, error + 0.5, {"oracle": error, "state": None}, np.arange(6.0))
    oracle = with_past(told).inputs["oracle"]
    assert oracle is not None
    assert oracle[:, :, 0].tolist()[1] == [1, 11, 0, 10, 0, 10, 0, 10]  # the first is held
    assert oracle[:, :, 0].tolist()[5] == [5, 15, 4, 14, 3, 13, 2, 12]
    silent = np.isnan(first_half(told).y).all(axis=(1, 2))
    assert silent.tolist() == [False, False, True, True, True, True]
    assert not np.isnan(told.y).any()


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


def test_hf_has_the_squares_of_the_network(outages: BridgedOutages) -> None:
    """P1's filter is the last fix; its error is that of the network."""
    (hf, kf), drawn = area_squares(outages), outages.drawn
    for found, area in zip(hf, "12", strict=True):
        fixes = drawn[f"wsn.area{area}"][:, :2]
        np.testing.assert_allclose(found, (fixes**2).mean(axis=(0, 1)), rtol=1e-6)
    assert (kf > 0).all()


def test_a_factor_is_the_mean_over_the_areas_of_the_root_of_the_squares() -> None:
    """2 m over 1 m in the first area, 3 m over 1 m in the second."""
    hf, kf = [[3.0, 5.0], [9.0, 9.0]], [[1.0, 1.0], [0.5, 1.5]]
    assert hf_over_kf(np.array([hf, kf])) == pytest.approx(2.5)


def test_the_turn_is_where_the_filters_are_level() -> None:
    """HF has 1 m, the Kalman filter a power of the time that is 1 m at 1.2 s, in all runs."""
    ones = np.ones((2, 40))
    squares = {t: np.array([ones, (t / 1.2) ** 0.8 * ones]) for t in (0.5, 1.0, 1.5, 3.2)}
    turn, (low, high) = turning_time(squares, seed=1)
    assert (turn, low, high) == pytest.approx((1.2, 1.2, 1.2))


def test_the_turn_of_few_runs_is_less_sure() -> None:
    rng = np.random.default_rng(5)
    widths = []
    for runs in (20, 320):
        kf = rng.gamma(5.0, 0.2, (2, runs))
        squares = {t: np.array([np.ones((2, runs)), t * kf]) for t in (0.5, 1.0, 2.0)}
        turn, (low, high) = turning_time(squares, seed=1)
        assert low < turn < high
        assert low < 1.0 < high
        widths.append(high - low)
    assert widths[0] == pytest.approx(4 * widths[1], rel=0.5)


# P2: its percentages -----------------------------------------------------------------------------


def test_percentages_are_those_of_the_runs() -> None:
    fusion = ClusterFusion(runs=40, speed=6.0)
    vars(fusion)["chosen"] = {"fkf-reset": (0.4, 10.0), "dhf": (1.0, 1.0, 1.0, 0.5)}
    first = FirstReading(fusion)
    found = rebuild_percentages(first)
    ins, y = fusion.drawn["ins"], fusion.measurements
    dhf = fusion.distributed(fusion.white, 1.0, 1.0, for_sets=patterns_of(y))
    np.testing.assert_allclose(first.errors["DHF"], ins - dhf(y), atol=1e-9)
    left = mean_absolute_error(ins - fusion.filters["dhf"](y))
    left /= mean_absolute_error(ins - fusion.filters["fkf-reset"](y))
    value, low, high, unit, *_ = found["fair.cells.vy.vs-fkf"]
    assert (value, unit) == (pytest.approx(100 * (1 - np.median(left[3]))), "%")
    assert low < value < high
    both = 100 * (1 - left[2:].mean(axis=0))
    assert found["fair.cells.velocity.vs-fkf"].value == pytest.approx(np.median(both))


def test_a_filter_that_is_not_asked_for_is_not_tuned(monkeypatch: pytest.MonkeyPatch) -> None:
    tuned: list[str] = []

    def tune(_: ClusterFusion, name: str, make: object) -> None:
        tuned.append(name)

    monkeypatch.setattr(ClusterFusion, "_tune", tune)
    fusion = ClusterFusion()
    for _ in range(2):
        fusion.tuned["fkf-reset"]
    assert tuned == ["fkf-reset"]
    assert len(fusion.tuned) == 8
    with pytest.raises(KeyError):
        fusion.errors["fkf"]


# P3: its outages, against errors whose sizes are known -------------------------------------------


#: Errors grow so fast, m/s; at place 4 three times that, in the second drive twice
SPEED = {"never": 1.0, "through": 0.25, "lssvm": 0.5, "rbf": 2.0}


def test_cells_are_those_of_the_errors() -> None:
    time = np.arange(51.0)[:, None, None] * [1, 2] * np.array([1, 1, 1, 3, 1, 1, 1, 1])[:, None]
    found = outages_by_drive({name: speed * time for name, speed in SPEED.items()})
    rms = np.sqrt(np.mean(np.arange(1, 41.0) ** 2))
    for name, expected in {
        "sim.40.never.place1.max": [40, 80],
        "sim.40.never.place4.rms": [3 * rms, 6 * rms],
        "sim.40.lssvm.max.most": [60, 120],
        "sim.40.through.rms.least": [rms / 4, rms / 2],
        "sim.50.rbf.place5.max": [100, 200],
        "sim.40.gain.seven.rms": [50, 50],
        "sim.40.difference.place4.max": [-60, -120],
        "sim.50.gain.place5.over-rbf": [75, 75],
        "fair.cells.40.gain.place8.max": [-100, -100],
        "fair.cells.40.difference.place4.max": [30, 60],
        "fair.cells.50.gain.place5.over-kf": [-100, -100],
    }.items():
        np.testing.assert_allclose(found[name].values, expected, err_msg=name)
    assert not [name for name in found if "until" in name]


def test_some_methods_alone_have_the_errors_that_they_have_among_all() -> None:
    published = with_values(p3_settings(), imu_period=0.1)
    there = VehicleOutages(published, routes=1, draws=2)
    some = there.errors_of(("never", "through", "lssvm", "rbf"))
    assert [*some] == ["never", "through", "lssvm", "rbf"]
    for name, error in some.items():
        np.testing.assert_array_equal(error, there.errors[name])
    found = rebuild_outages(some)["sim.40.lssvm.place1.max"]
    assert found.value == pytest.approx(some["lssvm"][1:41, 0].max(axis=0).mean())


def test_recorded_cells_are_those_of_the_kept_trials(root: Path) -> None:
    trials, _ = read_trials(root / "data" / "recorded" / "p3-drive.json")
    found = rebuild_recorded(trials)
    largest = trials.errors["lssvm"][1:41].max(axis=0)
    assert found["recorded.cells.40.lssvm.max"].value == pytest.approx(np.median(largest))
    least = found["recorded.cells.40.lssvm.max.least"]
    assert least.value == pytest.approx(np.median(largest.min(axis=0)))
    gains = 100 * (1 - largest / trials.errors["never"][1:41].max(axis=0))
    mean = found["recorded.cells.40.gain.all.max"].value
    assert mean == pytest.approx(np.median(gains.mean(axis=0)))
