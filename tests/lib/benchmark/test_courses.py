"""What entries are given on each track, on made recordings whose motion is known."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from made_folders import needs
from made_recording import ROOM, YARD, made, made_drive, made_imu, motion

from inswsn_lib.benchmark import TRACKS, track_courses
from inswsn_lib.benchmark.courses import CLUSTERS, Course, Track, make_course, place_outages
from inswsn_lib.errors import InswsnError
from inswsn_lib.files import DATA_VARIABLE
from inswsn_lib.recordings import write_csv
from inswsn_lib.streams import Fixes, Recording


def room(seconds: float = 30.0) -> Recording:
    recording = made(1, seconds=seconds, rate=80.0, noise=0.02)
    return replace(recording, imu=made_imu(1, seconds=seconds))


def times(course: Course, kind: str) -> np.ndarray:
    return np.array([event.time for event in course.events if event.kind == kind])


def test_the_truth_is_where_the_body_is() -> None:
    course = make_course(room(), TRACKS["network"])
    place, _ = motion(course.asked)
    ahead, _ = motion(course.asked + 1e-4)
    speed = (ahead - place)[:, :2] / 1e-4
    np.testing.assert_allclose(course.truth[:, :2], place[:, :2], atol=2e-3)
    np.testing.assert_allclose(course.truth[:, 2:], speed, atol=0.03)


def test_events_are_in_order_and_the_parts_do_not_meet() -> None:
    course = make_course(room(), TRACKS["network"])
    stamps = np.array([event.time for event in course.events])
    assert (np.diff(stamps) >= 0).all()
    assert course.task.streams == ("imu", "range")
    assert np.diff(course.asked) == pytest.approx(0.2)
    assert not (course.tuning & course.judged).any()
    np.testing.assert_array_equal(course.tuning | course.judged, course.scored)
    begin = stamps[0] + course.task.warm_up
    assert course.asked[course.scored].min() >= begin
    assert course.asked[course.tuning].max() <= course.split < course.asked[course.judged].min()
    assert [event.time for event in course.first] == [t for t in stamps if t <= course.split]


def test_a_question_comes_after_all_else_of_its_time() -> None:
    recording = room()
    assert recording.ranges is not None
    first = recording.ranges.time[0]
    at = replace(recording.ranges, time=first + 0.0125 * np.arange(len(recording.ranges)))
    course = make_course(replace(recording, ranges=at), TRACKS["network"])
    for before, event in zip(course.events, course.events[1:], strict=False):
        if event.time == before.time:
            assert before.kind != "ask"


def test_nothing_is_heard_in_an_outage_and_nothing_else_is_scored() -> None:
    track = TRACKS["outage-2"]
    course = make_course(room(), track)
    begin = course.events[0].time
    outages = place_outages(begin + course.task.warm_up, course.events[-1].time, track)
    assert len(outages) >= 2
    heard, scored = times(course, "range"), course.asked[course.scored]
    for a, b in outages:
        assert not ((heard > a) & (heard <= b)).any()
        assert ((scored > a) & (scored <= b)).sum() == pytest.approx(10, abs=1)
    inside = sum(((scored > a) & (scored <= b)).sum() for a, b in outages)
    assert inside == len(scored)
    whole = make_course(room(), TRACKS["network"])
    assert len(times(course, "imu")) == len(times(whole, "imu"))


def test_outages_are_at_the_same_places_and_take_turns() -> None:
    track = Track((), outages=(1.0, 3.0), gaps=(2.0, 4.0))
    found = np.array(place_outages(5.0, 60.0, track))
    np.testing.assert_array_equal(found, place_outages(5.0, 60.0, track))
    lengths = found[:, 1] - found[:, 0]
    assert lengths == pytest.approx(np.resize([1.0, 3.0], len(found)))
    gaps = np.append(found[0, 0] - 5.0, found[1:, 0] - found[:-1, 1])
    assert ((gaps >= 2) & (gaps <= 4)).all()
    assert found[-1, 1] <= 60.0


def test_two_clusters_give_fixes_of_their_own_anchors() -> None:
    """The ranges of one of them are too long: its fixes alone are wrong."""
    bias = np.where(np.isin(np.arange(8), CLUSTERS[1]), 0.5, 0.0)
    recording = replace(made(2, seconds=20.0, rate=120.0, noise=0.02, bias=bias), imu=made_imu(2))
    course = make_course(recording, TRACKS["two-clusters"])
    assert course.task.sources == 2
    assert not len(course.task.anchors)
    fixes = [event for event in course.events if event.kind == "fix"]
    place, _ = motion(np.array([event.time for event in fixes]))
    errors = np.linalg.norm([e.values[:3] for e in fixes] - place, axis=1)
    sources = np.array([event.source for event in fixes])
    assert np.median(errors[sources == 0]) < 0.15
    assert np.median(errors[sources == 1]) > 0.3
    with pytest.raises(InswsnError, match="in space need 8 anchors"):
        make_course(made_drive(1, seconds=20.0), TRACKS["two-clusters"])


def drive(good: bool = True) -> Recording:
    """A car along x at 2 m/s, which says so."""
    t = np.arange(0, 120, 0.25)
    position = np.outer(t, [2.0, 0.0, 0.0])
    flags = np.arange(len(t)) % 10 > 0 if good else None
    fixes = Fixes(t, position, np.tile([2.0, 0.0, 0.0], (len(t), 1)), 0.01 + 0 * position, flags)
    return Recording("car", imu=made_imu(1, seconds=120.0), fixes=fixes)


def test_a_vehicle_is_asked_where_its_good_fixes_are_and_scored_where_they_are_withheld() -> None:
    course = make_course(drive(), TRACKS["vehicle"])
    np.testing.assert_array_equal(course.truth[:, 0], 2 * course.asked)
    assert (np.round(course.asked / 0.25).astype(int) % 10 > 0).all()
    assert course.task.period == 0.25
    given = set(times(course, "fix").tolist())
    assert given.isdisjoint(course.asked[course.scored].tolist())
    assert course.scored.sum() > 20


@pytest.mark.parametrize(
    ("recording", "track", "said"),
    [
        (made(1, seconds=5.0), "network", "has neither imu nor odometry"),
        (replace(drive(), fixes=None), "vehicle", "car has no fixes"),
        (drive(), "network", "car has no ranges"),
        (replace(room(5.0), reference=None), "network", "made has no reference"),
        (replace(drive(), fixes=replace(drive().fixes, velocity=None)), "vehicle",  # type: ignore[type-var]
         "no velocity to judge by"),
    ],
)  # fmt: skip
def test_what_a_track_needs(recording: Recording, track: str, said: str) -> None:
    with pytest.raises(InswsnError, match=said):
        make_course(recording, TRACKS[track])


def test_a_recording_of_ones_own_is_read_from_a_folder(tmp_path: Path) -> None:
    write_csv(made_drive(1, seconds=20.0), tmp_path / "mine")
    (course,), left_out = track_courses("network", tmp_path / "mine")
    assert left_out == ()
    assert course.task.streams == ("odometry", "range")
    np.testing.assert_array_equal(course.task.anchors, YARD)
    assert course.task.period == 0.4  # 12 ranges a second, of which 4.5 make a fix
    assert ROOM.shape == (8, 3)


def test_recordings_that_are_not_there_are_left_out(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv(DATA_VARIABLE, str(tmp_path))
    with pytest.raises(InswsnError, match="The track network has no recording"):
        track_courses("network")


@needs("inrol/1")
@needs("plaza/2")
@needs("labyrinth/1")
def test_the_network_track_on_the_recordings() -> None:
    courses, left_out = track_courses("network")
    assert left_out == ()
    found = {c.name: (c.task.streams, c.task.period, c.task.dimension) for c in courses}
    assert found == {
        "inrol/1": (("imu", "range"), 0.2, 3),
        "plaza/2": (("odometry", "range"), 1.0, 2),
        "labyrinth/1": (("odometry", "range"), 0.6, 2),
    }
    assert all(course.judged.sum() > 20 for course in courses)
