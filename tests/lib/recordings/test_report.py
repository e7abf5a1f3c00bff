"""A report of recordings whose motion is known, and of those that lack something."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from made_folders import needs
from made_recording import made, made_drive, made_imu

from inswsn_lib import recordings
from inswsn_lib.errors import InswsnError
from inswsn_lib.recordings import Finding, Report, report
from inswsn_lib.recordings.correction import correction_of, deviation_of, network_of
from inswsn_lib.recordings.report import withheld_rows
from inswsn_lib.recordings.report_words import sentence_of
from inswsn_lib.streams import Fixes, Recording, Reference

NOISE = 0.3


def drive(seed: int = 1) -> Recording:
    """A vehicle with odometry and fixes twice a second, of which two in ten are missing."""
    right = made_drive(seed)
    assert right.reference is not None
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
    found = report(drive(), trials=8)
    assert failing(found) == set()
    assert "The filter is consistent." in found.sentence
    assert "better than the network" in found.sentence
    assert found.judge == "reference"
    network, corrected, smoothed = found.table["position"]
    # of two coordinates
    assert network == pytest.approx(np.sqrt(2) * NOISE, rel=0.15)
    assert smoothed < corrected < 0.5 * network
    # the filter finds the noise of the fixes
    assert found.numbers[2] == pytest.approx(NOISE, rel=0.15)
    assert {"size", "colour", "whiteness", "errors"} <= {each.name for each in found.findings}
    assert list(found.track) == ["time", "x", "y", "vx", "vy", "sd_x", "sd_y", "sd_vx", "sd_vy"]
    assert found.track["sd_vx"].isna().all()  # the speed is no state
    assert (found.track["sd_x"] > 0).all()


def test_the_track_is_where_the_vehicle_was() -> None:
    right = drive()
    track = report(right, trials=1).track
    assert right.reference is not None
    late = track[track["time"] > 60]
    for name, axis in (("x", 0), ("y", 1)):
        true = np.interp(late["time"], right.reference.time, right.reference.position[:, axis])
        assert np.sqrt(np.mean((late[name] - true) ** 2)) < 0.2


def test_without_a_reference_withheld_fixes_judge() -> None:
    found = report(drive().without("reference"), trials=4)
    assert found.judge == "withheld fixes"
    assert "fixes that are withheld" in found.sentence
    # a fix has errors of its own, and a line between two of them half of their variance
    line, corrected, _ = found.table["position"]
    assert line == pytest.approx(np.sqrt(2 * 1.5) * NOISE, rel=0.2)
    assert np.sqrt(2) * NOISE * 0.85 < corrected < line
    assert found.table["velocity"].isna().all()
    assert [each.fits for each in found.findings if each.name == "axes"] == [True]


@pytest.mark.parametrize("change", ["mirrored", "exchanged", "sign of the rate"])
def test_a_mirrored_network_is_told_without_a_reference(change: str) -> None:
    right = drive().without("reference")
    assert right.fixes is not None
    assert right.odometry is not None
    place = right.fixes.position
    changed = {
        "mirrored": {"fixes": replace(right.fixes, position=place * [1.0, -1.0])},
        "exchanged": {"fixes": replace(right.fixes, position=place[:, ::-1])},
        "sign of the rate": {"odometry": replace(right.odometry, rate=-right.odometry.rate)},
    }[change]
    found = report(replace(right, **changed), trials=1)
    assert "axes" in failing(found)
    assert "network is mirrored" in found.sentence


def test_a_network_that_is_late_makes_the_filter_inconsistent() -> None:
    right = drive()
    assert right.fixes is not None
    late = replace(right, fixes=replace(right.fixes, time=right.fixes.time + 3.0))
    found = report(late, trials=4)
    assert "Warning: the filter is not consistent" in found.sentence
    assert {"time", "errors"} <= failing(found)


def test_ranges_beside_odometry_are_taken_one_by_one() -> None:
    found = report(made_drive(1), trials=1)
    assert len(found.numbers) == 4
    # ranges with errors of 0.1 m, twelve a second
    assert found.table.loc["corrected", "position"] < 0.15
    assert found.table.loc["corrected", "position_high"] < 1


def test_an_imu_is_aligned_without_the_reference() -> None:
    """The tag is at the end of a lever arm; ranges have errors of 0.05 m."""
    arm = np.array([0.05, 0.0, 0.1])
    right = made(1, seconds=60, rate=40, lever_arm=tuple(arm))
    found = report(replace(right, imu=made_imu(1, seconds=60), lever_arm=arm), trials=2)
    # two trials tune little
    assert failing(found) <= {"outliers", "size", "colour", "whiteness"}
    assert found.table.loc["corrected", "velocity"] < 0.5 * found.table.loc["network", "velocity"]
    assert (found.track[["sd_x", "sd_vx"]] > 0).all(axis=None)


def test_a_short_recording_is_told_by_its_network_alone() -> None:
    found = report(drive().part(end=19.0))
    assert "The start takes 20 s, more than half of the recording." in found.sentence
    assert list(found.table.index) == ["network"]
    assert found.table.loc["network", "position_ratio"] == 1
    assert [each.fits for each in found.findings if each.name == "start"] == [None]


def test_what_has_no_motion_is_told_by_its_network_alone() -> None:
    found = report(drive().without("odometry", "reference"))
    assert found.sentence.endswith("there is nothing to correct fixes with.")
    assert (found.judge, found.numbers) == ("nothing", ())
    assert len(found.track) > 100


def test_what_has_no_network_is_refused() -> None:
    with pytest.raises(InswsnError, match="neither ranges nor fixes"):
        report(drive().without("fixes"))


@pytest.mark.parametrize(
    ("other", "says"),
    [
        ({"ranges": made(1, seconds=5).ranges}, "anchors in three dimensions"),
        ({"odometry": None, "imu": made_imu(1, seconds=5)}, "network on a plane"),
    ],
)
def test_a_plane_and_space_do_not_go_together(other: dict[str, object], says: str) -> None:
    with pytest.raises(InswsnError, match=says):
        correction_of(replace(drive(), **other), 20.0)


def test_too_few_ranges_at_a_time_are_refused() -> None:
    right = made_drive(1)
    assert right.ranges is not None
    ranges = right.ranges
    [rows] = np.nonzero(ranges.anchor < 2)
    few = replace(
        ranges, time=ranges.time[rows], anchor=ranges.anchor[rows], distance=ranges.distance[rows]
    )
    with pytest.raises(InswsnError, match="Too few anchors"):
        network_of(replace(right, ranges=few))


def test_second_differences_tell_the_noise_of_a_steady_motion() -> None:
    rng = np.random.default_rng(1)
    time = np.arange(2000.0)
    place = np.outer(time, [1.0, 2.0]) + 0.5 * rng.normal(size=(2000, 2))
    assert deviation_of(Fixes(time, place)) == pytest.approx(0.5, rel=0.1)
    assert deviation_of(Fixes(time, place, deviation=0 * place + 0.2)) == pytest.approx(0.2)
    assert deviation_of(Fixes(time[:2], place[:2])) == 1.0


def test_every_second_good_fix_is_withheld() -> None:
    time = np.arange(8.0)
    place = np.zeros((8, 2))
    place[3] = np.nan
    good = time != 5
    assert withheld_rows(Fixes(time, place), 0.5).nonzero()[0].tolist() == [1, 5, 7]
    assert withheld_rows(Fixes(time, place, good=good), 2.0).nonzero()[0].tolist() == [7]


@pytest.mark.parametrize(
    ("judge", "low", "high", "says"),
    [
        ("reference", 1.1, 1.5, "Warning: in position the corrected track is worse than"),
        ("reference", 0.8, 1.2, "In position the corrected track is neither better nor worse than"),
        ("reference", 0.5, 0.9, "In position the corrected track is better than the network"),
        ("withheld fixes", 1.1, 1.5, "Warning: from fixes that are withheld"),
        ("withheld fixes", 0.5, 0.9, "From fixes that are withheld"),
        ("nothing", 0.5, 0.9, "How large the errors are cannot be told."),
    ],
)
def test_the_sentence_warns_of_a_track_that_is_worse(
    judge: str, low: float, high: float, says: str
) -> None:
    columns = {"ratio": (low + high) / 2, "low": low, "high": high}
    row = {f"{what}_{end}": x for what in ("position", "velocity") for end, x in columns.items()}
    table = pd.DataFrame([row], index=["corrected"])
    assert says in sentence_of([], table, judge)
    wrong = Finding("colour", "innovations", 0.5, -0.1, 0.1, False, "they are coloured")
    said = sentence_of([wrong], table, judge)
    assert "Warning: the filter is not consistent (colour 0.5: they are coloured)." in said
    set_up = Finding("gaps", "imu", 50, 0, 10, False, "a gap")
    assert sentence_of([set_up], table, judge).startswith("The set-up does not fit: imu: a gap.")


def test_a_reference_that_is_at_another_time_judges_nothing() -> None:
    right = drive()
    assert right.reference is not None
    other = Reference(right.reference.time + 1000, right.reference.position)
    found = report(replace(right, reference=other), trials=1)
    assert found.judge == "nothing"
    assert "How large the errors are cannot be told." in found.sentence
    assert "span" in failing(found)


def test_a_reference_in_milliseconds_judges_nothing() -> None:
    """One of its rows is while the vehicle moves."""
    right = drive()
    assert right.reference is not None
    other = replace(right.reference, time=1000 * right.reference.time)
    found = report(replace(right, reference=other), trials=1)
    assert found.judge == "nothing"
    assert "span" in failing(found)


@needs("labyrinth/1")
def test_a_recorded_robot_is_better_than_its_network() -> None:
    found = report(recordings.load("labyrinth/1"), trials=4)
    assert found.table.loc["corrected", "position_high"] < 0.8
    assert "better than the network" in found.sentence
