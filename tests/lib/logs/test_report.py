"""A report of recordings whose motion is known, and of those that lack something."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pandas as pd
import pytest
from conftest import WHOLE
from made_folders import needs
from made_recording import made, made_drive, made_imu, motion

from inswsn_lib import logs
from inswsn_lib.errors import InswsnError
from inswsn_lib.inertial import PlanarState, Start, known_start
from inswsn_lib.logs import Finding, Ladder, Report, report
from inswsn_lib.logs.correction import (
    LATERAL,
    WHITE,
    InertialCorrection,
    correction_of,
    turned_by_gyroscope,
)
from inswsn_lib.logs.network_fixes import fix_deviation, network_of
from inswsn_lib.logs.report import sentence_of
from inswsn_lib.streams import Fixes, Imu, Odometry, Recording, Reference

NOISE = 0.3


def drive(seed: int = 1) -> Recording:
    """A vehicle with odometry and fixes twice a second, of which two in ten are missing."""
    right = made_drive(seed)
    rng = np.random.default_rng(seed)
    time = np.arange(0.5, 119.5, 0.5)
    place = np.column_stack(
        [np.interp(time, right.reference.time, x) for x in right.reference.position.T]
    )
    place += NOISE * rng.normal(size=place.shape)
    place[rng.random(len(time)) < 0.2] = np.nan
    return replace(right, ranges=None, fixes=Fixes(time, place))


def failing(found: Report) -> set[str]:
    return {each.name for each in found.findings if each.fits is False}


def test_a_filter_that_fits_is_consistent_and_better_than_the_network() -> None:
    right = drive()
    found = report(right, begins=1)
    assert failing(found) == set()
    assert "The filter is consistent." in found.sentence
    assert "better than the network" in found.sentence
    assert found.judge == "reference"
    network, corrected, smoothed, *_ = found.table["position"]
    # of two coordinates
    assert network == pytest.approx(np.sqrt(2) * NOISE, rel=0.15)
    assert smoothed < corrected < 0.5 * network
    # it drifts too little in this time to tell for how long it holds a place
    assert "expected" not in found.table.index
    assert set(found.table.dtypes) == {np.dtype(float)}
    # the filter finds the noise of the fixes
    assert found.numbers[2] == pytest.approx(NOISE, rel=0.15)
    assert {"size", "colour", "whiteness", "errors"} <= {each.name for each in found.findings}
    assert list(found.track) == ["time", "x", "y", "vx", "vy", "sd_x", "sd_y", "sd_vx", "sd_vy"]
    assert found.track["sd_vx"].isna().all()  # the speed is no state
    assert (found.track["sd_x"] > 0).all()
    late = found.track[found.track["time"] > 60]
    for name, axis in (("x", 0), ("y", 1)):
        true = np.interp(late["time"], right.reference.time, right.reference.position[:, axis])
        assert np.sqrt(np.mean((late[name] - true) ** 2)) < 0.2


def test_without_a_reference_outages_judge() -> None:
    found = report(drive().without("reference"), begins=1)
    assert found.judge.startswith("outages of ")
    assert "the fixes that are withheld" in found.sentence
    # a fix has errors of its own, of two coordinates
    network, corrected, line, smoothed, _ = found.table["position"]
    assert np.sqrt(2) * NOISE * 0.85 < smoothed < corrected < network
    assert smoothed < line
    assert found.table["velocity"].isna().all()
    assert [each.fits for each in found.findings if each.name == "axes"] == [True]
    # what the filter says that it leaves of a fix's error, and what it does
    expected, known = found.table.loc["expected"], report(drive(), begins=1).table
    left = known.loc["corrected", "position_ratio"]
    assert expected["position_low"] < left < expected["position_high"] < 1


@pytest.mark.parametrize("change", ["mirrored", "exchanged", "sign of the rate"])
def test_a_mirrored_network_is_told_without_a_reference(change: str) -> None:
    right = drive().without("reference")
    place = right.fixes.position
    changed = {
        "mirrored": {"fixes": replace(right.fixes, position=place * [1.0, -1.0])},
        "exchanged": {"fixes": replace(right.fixes, position=place[:, ::-1])},
        "sign of the rate": {"odometry": replace(right.odometry, rate=-right.odometry.rate)},
    }[change]
    found = report(replace(right, **changed), begins=1)
    assert "axes" in failing(found)
    assert "network is mirrored" in found.sentence


def test_a_network_that_is_late_makes_the_filter_inconsistent() -> None:
    right = drive()
    late = replace(right, fixes=replace(right.fixes, time=right.fixes.time + 3.0))
    found = report(late, begins=1)
    assert "Warning: the filter is not consistent" in found.sentence
    assert {"time", "errors"} <= failing(found)


def test_ranges_beside_odometry_are_taken_one_by_one() -> None:
    found = report(made_drive(1), begins=1)
    assert len(found.numbers) == 4
    # ranges with errors of 0.1 m, twelve a second
    assert found.table.loc["corrected", "position"] < 0.15
    assert found.table.loc["corrected", "position_high"] < 1


def test_an_imu_is_aligned_without_the_reference() -> None:
    """The tag is at the end of a lever arm; ranges have errors of 0.05 m."""
    arm = np.array([0.05, 0.0, 0.1])
    right = made(1, seconds=60, rate=40, lever_arm=tuple(arm))
    found = report(replace(right, imu=made_imu(1, seconds=60), lever_arm=arm), begins=1)
    assert failing(found) <= {"outliers", "size", "colour", "whiteness"}
    assert found.table.loc["corrected", "velocity"] < 0.5 * found.table.loc["network", "velocity"]
    assert (found.track[["sd_x", "sd_vx"]] > 0).all(axis=None)


def beside(recording: Recording, rate: float, noise: float) -> Recording:
    """Add an IMU whose rate about the vertical is that of the odometry times a number."""
    rng, odometry = np.random.default_rng(3), recording.odometry
    time = np.arange(0.0, 119.8, 0.02)
    turned = np.interp(time + 0.05, odometry.time, odometry.rate)
    values = noise * rng.standard_normal((2, len(time), 3))
    values[0, :, 2] += rate * turned
    return replace(recording, imu=Imu(time, values[0], values[1] + [[0.0, 0.0, 9.81]]))


def test_an_imu_beside_odometry_is_taken_or_refused_in_words() -> None:
    """Odometry that turns by too much is mended by a gyroscope; nonsense is left out."""
    right = drive()
    wrong = replace(right.odometry, rate=1.3 * right.odometry.rate)
    alone = report(right, begins=1)
    good = report(beside(replace(right, odometry=wrong), 1 / 1.3, 0.001), begins=1)
    bad = report(beside(right, -20.0, 5.0), begins=1)
    found = {each: [f for f in each.findings if f.name == "gyroscope"] for each in (good, bad)}
    assert [f.fits for f in found[good]] == [True]
    assert "taken" in found[good][0].says
    assert good.table.loc["corrected", "position"] < 1.1 * alone.table.loc["corrected", "position"]
    assert [f.fits for f in found[bad]] == [False]
    assert "IMU and odometry: the IMU's rate about the vertical does not fit" in bad.sentence
    assert bad.numbers == alone.numbers


def carried(**changes: object) -> Recording:
    """A body in a room with an IMU, 5 Hz fixes of 0.3 m at the end of an arm, and velocities."""
    arm = np.array([0.3, 0.0, 0.2])
    right = replace(made(4, rate=1.0), ranges=None, imu=made_imu(4))
    rng, time, step = np.random.default_rng(4), np.arange(0.2, 59.5, 0.2), 1e-3
    tags = [where + how.apply(arm) for where, how in (motion(time + h) for h in (-step, 0, step))]
    fixes = Fixes(
        time,
        tags[1] + 0.3 * rng.normal(size=(len(time), 3)),
        (tags[2] - tags[0]) / (2 * step) + 0.03 * rng.normal(size=(len(time), 3)),
    )
    return replace(right, fixes=fixes, lever_arm=arm, **changes)


@cache
def report_of_carried() -> Report:
    return report(carried(), begins=1)


@pytest.mark.parametrize("velocities", [pytest.param(True, marks=pytest.mark.whole), False])
def test_a_mirrored_network_beside_an_imu_is_told(velocities: bool) -> None:
    """The filter starts as badly as it may; or it cannot, but with the other sign of y it could."""
    right = carried()
    other = np.array([1.0, -1.0, 1.0])
    moving = right.fixes.velocity * other if velocities else None
    fixes = Fixes(right.fixes.time, right.fixes.position * other, moving)
    found = report(replace(right, fixes=fixes, reference=None), begins=1)
    assert "network and motion: the network is mirrored" in found.sentence
    assert bool(found.numbers) != velocities


def test_velocities_of_fixes_are_used() -> None:
    """With velocities of 0.03 m/s the track is better than without, and says their size."""
    right, told = carried(), report_of_carried()
    bare = replace(right, fixes=replace(right.fixes, velocity=None))
    without = report(bare, begins=1)
    assert told.numbers[3] == pytest.approx(0.03, rel=0.3)
    for name in ("position", "velocity"):
        assert told.table.loc["corrected", name] < 0.6 * without.table.loc["corrected", name]
    # it learns tilt and biases, here constant: it does better than is expected of one that does not
    for table in (told.table, without.table):
        expected, gained = table.loc["expected"], table.loc["corrected"]
        assert 0.8 < gained["position_ratio"] / expected["position_ratio"] < 1
        assert 0.5 < gained["velocity_ratio"] / expected["velocity_ratio"] < 1


def test_the_deviation_of_each_fix_is_used() -> None:
    """Every second fix is ten times worse, and says so."""
    right = carried()
    rng, sizes = np.random.default_rng(6), np.where(np.arange(len(right.fixes)) % 2, 3.0, 0.3)
    fixes = replace(right.fixes, velocity=None)
    fixes = replace(
        fixes, position=fixes.position + sizes[:, None] * rng.normal(size=fixes.position.shape)
    )
    said = replace(fixes, deviation=np.tile(sizes[:, None], (1, 3)))
    sizes = []
    for each in (said, fixes):
        ladder = Ladder(replace(right, fixes=each))
        rung = ladder.rungs[WHITE]
        errors = ladder.of(rung.run(*rung.begin)).state - ladder.truth
        sizes.append(np.sqrt(np.mean(errors[ladder.judged, :2] ** 2)))
    assert sizes[0] < 0.6 * sizes[1]


def test_a_lever_arm_counts_where_the_reference_has_no_attitude() -> None:
    right = carried()
    bare = replace(right, reference=replace(right.reference, attitude=None))
    without = report(bare, begins=1).table.loc["corrected", "position"]
    right_one = report_of_carried().table.loc["corrected", "position"]
    assert without == pytest.approx(right_one, rel=0.1)


def test_what_is_known_of_the_start_is_used() -> None:
    """Of odometry it is where the filter starts; of an IMU what an alignment knows before."""
    right = drive()
    state = PlanarState(np.array([1.0, 2.0]), heading=0.5)
    given = Start(1.0, state, np.eye(5))
    assert correction_of(right, 20.0, given).start is given
    with pytest.raises(InswsnError, match="start must be one with InertialState"):
        report(carried(), start=given)
    body = carried()
    true = motion(np.array([0.1]))[1]
    begun = known_start(body.imu, 0.1, attitude=(true.as_matrix()[0], 0.05))
    mine, found = (correction_of(body, 5.0, each).start for each in (begun, None))
    assert mine.time == pytest.approx(5.0, abs=0.3)
    assert np.linalg.det(mine.covariance[6:9, 6:9]) < np.linalg.det(found.covariance[6:9, 6:9])


def test_who_does_not_move_is_told_by_the_network_alone() -> None:
    right = drive()
    still = replace(right.odometry, speed=0 * right.odometry.speed, rate=0 * right.odometry.rate)
    where = replace(right.fixes, position=right.fixes.position - right.fixes.position)
    found = report(replace(right, odometry=still, fixes=where, reference=None))
    assert "The heading cannot be told" in found.sentence
    assert [each.fits for each in found.findings if each.name == "start"] == [None]
    assert (found.judge, found.numbers) == ("nothing", ())


def test_what_has_no_motion_is_told_by_its_network_alone() -> None:
    found = report(drive().without("odometry", "reference"))
    assert found.sentence.endswith("there is nothing to correct fixes with.")
    assert (found.judge, found.numbers) == ("nothing", ())
    assert len(found.track) > 100


def test_what_makes_no_network_is_refused() -> None:
    with pytest.raises(InswsnError, match="neither ranges nor fixes"):
        report(drive().without("fixes"))
    with pytest.raises(InswsnError, match="anchors in three dimensions"):
        correction_of(replace(drive(), ranges=made(1, seconds=5).ranges), 20.0)
    ranges = made_drive(1).ranges
    with pytest.raises(InswsnError, match="Too few anchors"):
        network_of(replace(drive(), ranges=ranges.kept(ranges.anchor < 2)))


def test_second_differences_tell_the_noise_of_a_steady_motion() -> None:
    rng = np.random.default_rng(1)
    time = np.arange(2000.0)
    place = np.outer(time, [1.0, 2.0]) + 0.5 * rng.normal(size=(2000, 2))
    assert fix_deviation(Fixes(time, place)) == pytest.approx(0.5, rel=0.1)
    assert fix_deviation(Fixes(time, place, deviation=0 * place + 0.2)) == pytest.approx(0.2)
    assert fix_deviation(Fixes(time[:2], place[:2])) == 1.0


@pytest.mark.parametrize(
    ("judge", "low", "high", "says"),
    [
        ("reference", 1.1, 1.5, "Warning: in position the corrected track is worse than"),
        ("reference", 0.8, 1.2, "In position the corrected track is neither better nor worse than"),
        ("reference", 0.5, 0.9, "In position the corrected track is better than the network"),
        ("outages of 4 s", 1.1, 1.5, "Warning: in outages of 4 s"),
        ("outages of 4 s", 0.5, 0.9, "In outages of 4 s, by the fixes that are withheld"),
        ("nothing", 0.5, 0.9, "How large the errors are cannot be told."),
    ],
)
def test_the_sentence_warns_of_a_track_that_is_worse(
    judge: str, low: float, high: float, says: str
) -> None:
    columns = {"ratio": (low + high) / 2, "low": low, "high": high}
    row = {f"{what}_{end}": x for what in ("position", "velocity") for end, x in columns.items()}
    table = pd.DataFrame([row] * 2, index=["corrected", "smoothed"])
    assert says in sentence_of([], table, judge)
    wrong = Finding("colour", "innovations", 0.5, -0.1, 0.1, False, "they are coloured")
    said = sentence_of([wrong], table, judge)
    assert "Warning: the filter is not consistent (colour 0.5: they are coloured)." in said
    set_up = Finding("gaps", "imu", 50, 0, 10, False, "a gap")
    assert sentence_of([set_up], table, judge).startswith("The set-up does not fit: imu: a gap.")


@pytest.mark.parametrize("count", [1, 2, 3, 5] if WHOLE else [2])
def test_few_fixes_are_no_filter_that_is_consistent(count: int) -> None:
    right = drive()
    [there] = np.nonzero(np.isfinite(right.fixes.position[:, 0]))
    rows = np.isin(np.arange(len(right.fixes)), there[np.linspace(3, 180, count).astype(int)])
    found = report(replace(right, fixes=right.fixes.kept(rows)), begins=1)
    assert "The filter is consistent" not in found.sentence
    assert found.judge == "nothing"


def test_a_gyroscope_is_taken_where_it_covers_a_step_of_the_odometry() -> None:
    """It says 0.2 rad/s, and begins and ends inside a step."""
    time = np.arange(0.0, 3.0, 0.5)
    odometry = Odometry(time, np.ones(6), np.full(6, 0.1))
    samples = np.arange(0.7, 2.3, 0.01)
    rows = np.tile([0.0, 0.0, 1.0], (len(samples), 1))
    both = Recording("both", odometry=odometry, imu=Imu(samples, 0.2 * rows, 9.8 * rows))
    turned = turned_by_gyroscope(both)
    assert turned.odometry.rate == pytest.approx([0.1, 0.1, 0.1, 0.2, 0.2, 0.1])


def test_a_vehicle_that_stands_in_the_first_half_has_no_axes() -> None:
    time = np.arange(0.0, 100.0)
    speeds = np.stack([np.where(time < 60, 0.0, 20.0), np.full(100, 20.0)])
    for speed, lateral in zip(speeds, (False, True), strict=True):
        velocity = np.outer(speed, [1.0, 0.0, 0.0])
        fixes = Fixes(time, np.cumsum(velocity, axis=0), velocity)
        filters = InertialCorrection(Recording("car", imu=made_imu(1), fixes=fixes), fixes, 20.0)
        assert (LATERAL in filters.rungs) is lateral


@pytest.mark.parametrize(("factor", "later"), [(1, 1000), (1000, 0)])
def test_a_reference_at_another_time_or_in_milliseconds_judges_nothing(
    factor: float, later: float
) -> None:
    right = drive()
    other = Reference(factor * right.reference.time + later, right.reference.position)
    found = report(replace(right, reference=other), begins=1)
    assert found.judge == "nothing"
    assert "How large the errors are cannot be told." in found.sentence
    assert "span" in failing(found)


def test_fixes_that_stick_are_told_without_a_traceback() -> None:
    """A line between two equal fixes goes through one between them: the network has no error."""
    right = drive().without("reference")
    found = report(replace(right, fixes=replace(right.fixes, position=0 * right.fixes.position)))
    assert found.judge != "reference"
    assert "Warning: the filter is not consistent" in found.sentence


@needs("labyrinth/1")
def test_a_recorded_robot_is_better_than_its_network() -> None:
    found = report(logs.load("labyrinth/1"), begins=1)
    assert found.table.loc["corrected", "position_high"] < 0.8
    assert "better than the network" in found.sentence
