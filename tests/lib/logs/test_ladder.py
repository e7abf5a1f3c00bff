"""The ladder of estimators: pieces with known answers, and made recordings."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from made_logs import Motion, driven, imu_of
from made_recording import made, made_drive, made_imu

from inswsn_lib.errors import InswsnError
from inswsn_lib.inertial import Innovations, Solution, Start
from inswsn_lib.logs import Ladder, Outages, report
from inswsn_lib.logs.correction import (
    COLOURED,
    PLANAR_TIGHT,
    STANDSTILL,
    TIGHT,
    WHEELS,
    WHITE,
    correction_of,
    is_planar,
    standstill_times,
)
from inswsn_lib.logs.estimates import Estimate, largest_lag_one, scores, truth_at
from inswsn_lib.logs.ladder import ALONE, FAMILIES, NETWORK, SMOOTHER, DifferenceFilters
from inswsn_lib.streams import Fixes, Imu, Odometry, Recording, Reference


def test_a_line_gives_position_and_velocity_of_a_straight_way_between_its_rows_alone() -> None:
    time = np.arange(0.0, 2.0, 0.02)
    track = np.column_stack([1 + 3 * time, 2 - time])
    recording = Recording("line", reference=Reference(time, track))
    found = truth_at(recording, np.array([0.5, 1.013, 3.0]))
    assert found[:2] == pytest.approx(np.array([[2.5, 1.5, 3, -1], [4.039, 0.987, 3, -1]]))
    assert np.isnan(found[2]).all()


def test_scores_of_known_errors() -> None:
    # 3 and 4 cm, and 6 and 8 cm/s, against twice as much; the covariance is that of the errors
    n, error = 60, np.array([0.03, 0.04, 0.06, 0.08])
    P = np.tile(np.diag(error**2), (n, 1, 1))
    found = scores(
        Estimate(np.tile(error, (n, 1)), P), np.zeros((n, 4)), 2 * error + np.zeros((n, 4))
    )
    assert (found["position"], found["velocity"]) == pytest.approx((0.05, 0.1))
    assert found["position_ratio"] == found["velocity_high"] == pytest.approx(0.5)
    assert found["nees"] == pytest.approx(1.0)
    few = scores(Estimate(np.ones((5, 4))), np.zeros((5, 4)), np.ones((5, 4)))
    assert np.isnan([*few.values()]).all()


def test_lag_one_is_of_neighbours_of_one_series() -> None:
    # the first series alternates, the second is constant; together they would look white
    count = 101
    values = [np.array([(-1.0) ** k, 1.0]) for k in range(count)]
    time = np.arange(float(count))
    told = Innovations(
        time, values, [np.ones(2)] * count, [np.ones(2, bool)] * count, np.ones(count)
    )
    ends = [Start(at, None, np.eye(1)) for at in (-0.5, 200.0)]
    solution = Solution(*[None] * 6, [told], 0.0, *ends)
    both = [(np.repeat(time, 2), np.tile([0, 1], count))]
    assert largest_lag_one(solution, both, -1.0) == {"nis": 1.0, "lag1": pytest.approx(1.0)}
    alone = largest_lag_one(solution, [(np.repeat(time, 2), np.zeros(2 * count, int))], -1.0)
    assert alone["lag1"] < 0.02
    assert np.isnan([*largest_lag_one(solution, [], -1.0).values()]).all()


@pytest.fixture(scope="module")
def drifting() -> DifferenceFilters:
    """An INS with a steady error of acceleration, and a network without an error."""
    time = 0.2 * np.arange(300)[:, None]
    true = np.hstack([np.sin(time), np.cos(time), np.cos(time), -np.sin(time)])
    drift = np.hstack([time**2 / 20, -(time**2) / 20, time / 10, -time / 10])
    return DifferenceFilters(true + drift, true, 0.2)


def test_the_published_filter_predicted_is_the_last_fix_carried_on_by_the_ins(
    drifting: DifferenceFilters,
) -> None:
    # what it leaves is the drift of one step: a T^2 / 2 and a T
    left = drifting.published.state[1:] - drifting.network[1:]
    assert left == pytest.approx(np.tile([0.002, -0.002, 0.02, -0.02], (299, 1)))


@pytest.mark.parametrize("name", FAMILIES)
def test_filters_of_differences_follow_a_drift_within_what_they_are_told(
    drifting: DifferenceFilters, name: str
) -> None:
    numbers = (10.0, 1.0, *FAMILIES[name][2:])
    left = drifting.run(name, *numbers).state[50:] - drifting.network[50:]
    assert np.abs(left).max() < 0.05
    slow = drifting.run(name, 0.01, *numbers[1:]).state[50:] - drifting.network[50:]
    assert np.abs(slow).max() > 0.1


@pytest.fixture(scope="module")
def walk() -> Ladder:
    recording = replace(made(4, seconds=60.0, lasting=0.1), imu=made_imu(4))
    return on_fixes(Ladder(recording, share=0.4, alignment=10.0, begins=1))


def on_fixes(ladder: Ladder) -> Ladder:
    """Leave out the filters whose search takes longest."""
    vars(ladder)["rungs"] = {name: ladder.filters.rungs[name] for name in (WHITE, COLOURED)}
    vars(ladder)["families"] = ("KF",)
    return ladder


def test_on_a_made_recording_filters_beat_the_network_and_the_smoother_beats_them(
    walk: Ladder,
) -> None:
    table = walk.table()
    assert table.index[:2].tolist() == [NETWORK, ALONE]
    assert table.loc[NETWORK, ["position_ratio", "velocity_ratio"]].tolist() == [1.0, 1.0]
    assert table.loc[COLOURED, "velocity_ratio"] < 0.5
    assert table.loc[SMOOTHER, "position"] < table.loc[COLOURED, "position"]
    assert 0.3 < table.loc[COLOURED, "nees"] < 3
    assert not table.loc[SMOOTHER, "causal"]
    assert walk.compare(NETWORK, NETWORK)["position"] == (1.0, 1.0, 1.0)


def test_the_tight_filter_takes_ranges_one_by_one(walk: Ladder) -> None:
    rung, rows = walk.filters.rungs[TIGHT], walk.judged
    solution = rung.run(*rung.begin)
    errors = walk.truth[rows] - walk.network.state[rows]
    found = scores(walk.of(solution).part(rows), walk.truth[rows], errors)
    assert found["position_ratio"] < 0.9
    assert found["velocity_ratio"] < 0.5
    assert len(solution.innovations[0].time) > 5 * len(walk.fixes)


def test_a_filter_is_tuned_by_no_error_after_the_split(walk: Ladder) -> None:
    reference, later = walk.recording.reference, 0.5
    assert reference is not None
    moved = reference.position + later * (reference.time > walk.split + 1)[:, None]
    recording = replace(walk.recording, reference=replace(reference, position=moved))
    other = on_fixes(replace(walk, recording=recording))
    assert (other.truth - walk.truth)[-1, :2] == pytest.approx(later)
    assert other.tuned("KF") == walk.tuned("KF")


def test_what_comes_later_changes_no_causal_answer(walk: Ladder) -> None:
    """But for the scale of the fixes' robust loss."""
    shorter = Ladder(walk.recording.part(end=45.0), share=0.4 * 60 / 45, alignment=10.0, begins=1)
    vars(shorter)["_searches"] = walk._searches
    early = walk.fixes.time < 44
    both = [each.estimates[COLOURED].state[: early.sum()] for each in (walk, shorter)]
    assert both[0] == pytest.approx(both[1], abs=2e-3, nan_ok=True)


def test_the_report_has_the_numbers_of_the_ladder(walk: Ladder) -> None:
    whole = on_fixes(Ladder(walk.recording, alignment=12.0, begins=1))
    found = report(walk.recording, alignment=12.0, begins=1)
    assert found.numbers == whole.tuned(whole.corrected).best
    for name, row in ((NETWORK, "network"), (whole.corrected, "corrected")):
        columns = ["position", "position_ratio", "position_low", "velocity"]
        assert found.table.loc[row, columns].tolist() == whole.table().loc[name, columns].tolist()


def test_what_is_missing_is_told() -> None:
    recording = made(5)
    with pytest.raises(InswsnError, match="has neither an IMU nor odometry"):
        Ladder(recording).table()
    with pytest.raises(
        InswsnError, match="has no reference: estimators are judged only in outages"
    ):
        Ladder(replace(recording, imu=made_imu(5), reference=None)).table()


def test_on_a_made_drive_both_together_beat_each_alone() -> None:
    table = Ladder(made_drive(3), alignment=10.0, period=0.5, begins=1).table()
    assert table.loc[PLANAR_TIGHT, "position_high"] < 1
    assert table.loc[PLANAR_TIGHT, "position"] < table.loc[ALONE, "position"]
    assert table.loc[SMOOTHER, "position"] < table.loc[PLANAR_TIGHT, "position"]
    assert table.loc[PLANAR_TIGHT, "lag1"] < 0.3


def test_a_scale_of_all_ranges_is_found() -> None:
    drive = made_drive(4)
    longer = replace(drive, ranges=replace(drive.ranges, distance=1.05 * drive.ranges.distance))
    ladder = Ladder(longer, alignment=10.0, period=0.5, begins=1)
    scale = ladder.solution(PLANAR_TIGHT).states[-1].own[0]
    assert scale == pytest.approx(0.05, abs=0.01)
    assert ladder.table().loc[PLANAR_TIGHT, "position_high"] < 0.5


def test_outages_of_a_drive_are_bridged_by_odometry() -> None:
    table = Outages(Ladder(made_drive(3), alignment=10.0, begins=1), 4.0, 4.0).table((4.0,))
    assert table.loc["coasting filter", "high 4 s"] < 1


def _car_with_wheels(seed: int) -> tuple[Recording, Motion]:
    rng = np.random.default_rng(seed)
    motion, time = driven(rng, 160.0, 8.0, 0.3), np.arange(0.1, 159.0, 0.5)
    position = motion.place(time) + rng.normal(0, 0.2, (len(time), 3))
    velocity = motion.velocity(time) + rng.normal(0, 0.05, (len(time), 3))
    each = np.arange(0.0, 159.0, 0.1)
    speed = np.linalg.norm(motion.velocity(each[1:] - 0.05), axis=1)
    wheels = Odometry(each, np.append(0.0, speed) + 0.05 * rng.normal(size=len(each)), 0 * each)
    imu = imu_of(rng, motion, 159.0)
    shaken = 0.05 * np.linalg.norm(motion.velocity(imu.time), axis=1)[:, None]  # by the road
    vibration = rng.normal(size=(2, *imu.rate.shape)) * shaken
    imu = replace(imu, rate=imu.rate + vibration[0] / 20, force=imu.force + vibration[1])
    return Recording("car", imu=imu, fixes=Fixes(time, position, velocity), odometry=wheels), motion


def test_wheels_beside_an_ins_better_its_position_and_velocity() -> None:
    recording, motion = _car_with_wheels(5)
    assert not is_planar(recording)
    assert is_planar(replace(recording, fixes=Fixes(np.arange(3.0), np.zeros((3, 2)))))
    filters = correction_of(recording, 20.0)
    errors = {}
    for name in (COLOURED, WHEELS):
        found = filters.rungs[name].run(*filters.rungs[name].begin)
        late = found.time > 80
        truth = motion.velocity(found.time[late])
        errors[name] = np.sqrt(np.mean((found.velocity[late] - truth) ** 2))
    assert errors[WHEELS] < 0.8 * errors[COLOURED]


def test_a_body_stands_only_where_it_does() -> None:
    recording, motion = _car_with_wheels(5)
    found = standstill_times(recording.imu, recording.fixes, 0.2, 80.0)
    assert len(found) > 20
    assert np.linalg.norm(motion.velocity(found), axis=1).max() < 0.1
    # what never stands, and a car that leaves so gently that its IMU feels nothing
    time = np.arange(0.0, 60.0, 0.02)
    rng = np.random.default_rng(0)
    noise = rng.normal(0, np.where(time < 30, 0.01, 0.2)[:, None], (len(time), 3))
    imu, at = Imu(time, noise, noise), np.arange(0.0, 60.0, 0.25)
    way = np.where(at > 15, 0.05 * (at - 15) ** 2, 0.0)[:, None] * [1.0, 0.0, 0.0]
    gone = standstill_times(imu, Fixes(at, way), 0.02, 60.0)
    assert gone.min() < 4
    assert 15 < gone.max() < 17.5
    assert not len(standstill_times(imu, Fixes(at, 5 * at[:, None] * [1.0, 0, 0]), 0.02, 60.0))


def test_who_stands_has_no_velocity_but_where_the_fixes_that_tell_are_withheld() -> None:
    recording, motion = _car_with_wheels(5)
    filters = correction_of(replace(recording, odometry=None), 20.0)
    runs = {name: filters.rungs[name].run for name in (COLOURED, COLOURED + STANDSTILL)}
    begin, withheld = filters.rungs[COLOURED].begin, np.ones(len(filters.fixes), dtype=bool)
    errors, events = [], []
    for run in runs.values():
        found = run(*begin)
        truth = motion.velocity(found.time)
        still = (found.time > 40) & (np.linalg.norm(truth, axis=1) < 1e-3)
        errors.append(np.sqrt(np.mean((found.velocity - truth)[still] ** 2)))
        events.append(len(run(*begin, gone=withheld).time))
    assert errors[1] < errors[0] / 3
    assert events[0] == events[1]
