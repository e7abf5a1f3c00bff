"""Wrong set-ups are found, and a right one is not taken for wrong."""

from __future__ import annotations

import re
import tracemalloc
from collections.abc import Callable
from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import pytest
from conftest import WHOLE
from made_logs import Motion, made_car, made_robot
from made_recording import ROOM, made, made_drive, made_imu
from scipy.spatial.transform import Rotation

from inswsn_lib.logs import Finding, check_set_up, multilaterate_track, verdict
from inswsn_lib.logs.set_up_checks import check_failed
from inswsn_lib.streams import Fixes, Imu, Ranges, Recording, Reference

NAMES = {"unit", "repeats", "gaps", "axes", "gravity", "time", "mounting", "place", "bias", "scale",
         "lever arm", "frame", "odometry", "span", "values"}  # fmt: skip


@cache
def room(seed: int) -> Recording:
    """A tag that is carried about a room, with an IMU; all is as it should be."""
    right = made(seed, seconds=60, rate=25, lasting=0.03, lever_arm=(0.05, 0.0, 0.1))
    lever_arm = np.array([0.05, 0.0, 0.1])
    return replace(right, imu=made_imu(seed, seconds=60), lever_arm=lever_arm)


def wrong(findings: list[Finding]) -> list[str]:
    return [f"{found.name}: {found.subject}" for found in findings if found.fits is False]


def test_a_right_set_up_is_told_with_all_that_was_looked_at() -> None:
    assert {found.name for found in check_set_up(room(0))} == NAMES - {"odometry"}
    assert {found.name for found in check_set_up(made_drive(0))} == {
        "repeats", "gaps", "unit", "axes", "time", "place", "bias", "scale", "lever arm", "frame",
        "odometry", "span", "values",
    }  # fmt: skip


def imu_of(change: Callable[[Imu], dict[str, Any]]) -> Callable[[Recording], Recording]:
    def changed(right: Recording) -> Recording:
        return replace(right, imu=replace(right.imu, **change(right.imu)))

    return changed


def ranges_of(change: Callable[[Ranges], dict[str, Any]]) -> Callable[[Recording], Recording]:
    def changed(right: Recording) -> Recording:
        return replace(right, ranges=replace(right.ranges, **change(right.ranges)))

    return changed


def moved_anchor(ranges: Ranges) -> dict[str, Any]:
    anchors = ranges.anchors.copy()
    anchors[2] += [1.0, -1.2, 0.3]
    return {"anchors": anchors}


def hidden(ranges: Ranges) -> dict[str, Any]:
    return {"distance": ranges.distance + np.where(ranges.anchor == 3, 0.6, 0.0)}


def twice(ranges: Ranges) -> dict[str, Any]:
    time, anchor = ranges.time.copy(), ranges.anchor.copy()
    time[101], anchor[101] = time[100], anchor[100]
    return {"time": time, "anchor": anchor}


def holed(imu: Imu) -> dict[str, Any]:
    kept = (imu.time < 20) | (imu.time > 21)
    return {"time": imu.time[kept], "rate": imu.rate[kept], "force": imu.force[kept]}


SWAP = np.array([[0.0, 1, 0], [1, 0, 0], [0, 0, 1]])
Wrong = dict[str, tuple[Callable[[Recording], Recording], str, str]]
WRONG_IMU: Wrong = {
    "without gravity": (imu_of(lambda i: {"force": 0.03 * i.force}), "unit", "gravity was taken"),
    "forward, right, down": (
        imu_of(lambda i: {"rate": i.rate * [1.0, -1, -1], "force": i.force * [1.0, -1, -1]}),
        "axes", r"x, -y, -z$"),
    "x and y of the accelerometer exchanged": (
        imu_of(lambda i: {"force": i.force @ SWAP}), "axes", r"y, x, z \(mirrored\)"),
    "gravity down": (imu_of(lambda i: {"force": -i.force}), "gravity", "points down"),
    "a gap": (imu_of(holed), "gaps", "for 1.02 s from 19.99"),
}  # fmt: skip
WRONG_RANGES: Wrong = {
    "anchors in mm": (ranges_of(lambda r: {"anchors": r.anchors * 1e3}), "unit", "anchors in mm"),
    "anchors mirrored": (
        ranges_of(lambda r: {"anchors": r.anchors * [1.0, -1, 1]}), "axes", r"mirrored"),
    "anchors shifted": (
        ranges_of(lambda r: {"anchors": r.anchors + np.array([1.0, 0, 0])}),
        "frame", r"shifted by"),
    "logged twice": (ranges_of(twice), "repeats", "1 ranges have the stamp"),
}  # fmt: skip


@pytest.mark.parametrize("kind", [*WRONG_IMU, *WRONG_RANGES])
def test_each_wrong_set_up_is_found(kind: str) -> None:
    change, name, says = (WRONG_IMU | WRONG_RANGES)[kind]
    right = room(1).without("ranges" if kind in WRONG_IMU else "imu")
    findings = check_set_up(change(right))
    first = next(found for found in findings if found.fits is False)
    mine = [found for found in findings if found.fits is False and found.name == name]
    assert mine, [found for found in findings if found.fits is False]
    found = mine[0]
    assert not found.low <= found.value <= found.high or found.name == "axes"
    assert re.search(says, found.says), found.says
    # nothing that is right comes before the cause
    assert first.name == name or first.name in {"time", "axes", "gravity"}


def test_the_anchor_that_is_elsewhere_or_hidden_is_named() -> None:
    for change, anchor in ((moved_anchor, "a2"), (hidden, "a3")):
        findings = check_set_up(ranges_of(change)(room(2)))
        assert {found.subject for found in findings if found.fits is False} == {f"anchor {anchor}"}


def test_fixes_in_another_frame_are_found() -> None:
    right = made_drive(5)
    fixes = multilaterate_track(right.ranges, 0.5)
    with_fixes = replace(right, ranges=None, fixes=fixes)
    assert wrong(check_set_up(with_fixes)) == []
    for change, name in (
        (lambda p: p[:, ::-1], "axes"),
        (lambda p: p @ np.array([[0.94, 0.34], [-0.34, 0.94]]), "frame"),
    ):
        other = Fixes(fixes.time, change(fixes.position))
        found = wrong(check_set_up(replace(with_fixes, fixes=other)))
        assert found[0].startswith(name), found


# --- what cannot be told ---


def test_without_a_reference_what_cannot_be_told_is_told_so() -> None:
    alone = room(1).without("reference")
    findings = check_set_up(alone)
    assert wrong(findings) == []
    unknown = {f"{found.name}: {found.subject}" for found in findings if found.fits is None}
    assert unknown == {"unit: IMU's rates", "axes: IMU", "axes: ranges", "time: ranges"}
    mirrored = check_set_up(ranges_of(lambda r: {"anchors": r.anchors * [1.0, -1, 1]})(alone))
    assert wrong(mirrored) == []
    assert "the data cannot tell" in verdict(mirrored)


@pytest.mark.parametrize("unit", [3.2808, 1000.0])
def test_without_a_reference_ranges_tell_their_unit(unit: float) -> None:
    alone = room(1).without("reference")
    found = check_set_up(ranges_of(lambda r: {"distance": unit * r.distance})(alone))
    assert "unit: ranges" in wrong(found)


def test_without_a_reference_a_hidden_anchor_is_found() -> None:
    found = check_set_up(ranges_of(hidden)(room(1).without("reference")))
    assert wrong(found) == ["bias: anchor a3"]


def test_at_rest_axes_and_clocks_are_not_told() -> None:
    still = made(1, still=True, seconds=60, rate=25)
    rng = np.random.default_rng(0)
    time = np.arange(0, 60, 0.01)
    rate = 0.01 * rng.normal(size=(len(time), 3))
    up = Rotation.from_quat(still.reference.attitude[0]).inv().apply([0.0, 0.0, 9.81])
    force = up + 0.05 * rng.normal(size=rate.shape)
    findings = check_set_up(replace(still, imu=Imu(time, rate, force)))
    assert wrong(findings) == []
    unknown = {f"{found.name}: {found.subject}" for found in findings if found.fits is None}
    assert {"axes: IMU and attitude", "time: IMU and attitude",
            "axes: ranges and reference", "time: ranges and reference"} <= unknown  # fmt: skip


def test_too_short_recordings_make_no_error() -> None:
    right = room(1)
    for end in (0.05, 0.5, 3.0):
        findings = check_set_up(right.part(end=end))
        assert wrong(findings) == []
    assert check_set_up(Recording("empty")) == []
    assert ROOM.shape == (8, 3)


def test_a_reference_of_one_row_tells_as_much_as_none() -> None:
    right = made_drive(1)
    alone = replace(right, reference=right.reference.part(end=0.05))
    told, without = (check_set_up(each) for each in (alone, right.without("reference")))
    assert [(f.name, f.subject, f.fits) for f in told] == [
        (f.name, f.subject, f.fits) for f in without
    ]


def test_work_does_not_grow_with_the_span_of_a_clock() -> None:
    for right in (room(1), made_drive(1)):
        for name, stream in [*right.streams.items()][: None if WHOLE else 1]:
            time = np.append(stream.time[0] - 1.7e9, stream.time[1:])
            tracemalloc.start()
            findings = check_set_up(replace(right, **{name: replace(stream, time=time)}))
            assert tracemalloc.get_traced_memory()[1] < 1e8
            tracemalloc.stop()
            assert f"gaps: {name}" in wrong(findings)


def with_failed(right: Recording, value: float, share: float) -> tuple[Recording, int]:
    distance = right.ranges.distance.copy()
    rows = np.random.default_rng(7).random(len(distance)).argsort()[: int(share * len(distance))]
    distance[rows] = value
    return replace(right, ranges=replace(right.ranges, distance=distance)), len(rows)


@pytest.mark.parametrize("value", [65.535, 20.0, 0.0, -1.0])
@pytest.mark.parametrize("share", [0.01, 0.025, 0.1, 0.6])
def test_ranges_that_mean_nothing_are_named_and_left_out(value: float, share: float) -> None:
    """Above 0 they must stand in a fiftieth of the rows."""
    for seed in range(3 if WHOLE else 1):
        spoilt, count = with_failed(made(seed), value, share)
        found, right = check_failed(spoilt)
        if value > 0 and share < 0.02:
            assert (found, right) == ([], spoilt)
            continue
        assert found[0].says.startswith(f"{value:g} stands in {100 * count / len(spoilt.ranges):g}")
        assert right.ranges.time.tolist() == (
            spoilt.ranges.time[spoilt.ranges.distance != value].tolist()
        )
    findings = check_set_up(with_failed(room(1), value, 0.1)[0])
    assert wrong(findings) == ["values: ranges, failed"]


def test_no_range_of_a_recording_is_taken_for_a_failed_one() -> None:
    for seed in range(100 if WHOLE else 20):
        right = made_drive(seed) if seed % 4 == 0 else made(seed, still=seed % 2 == 0)
        for digits in (9, 2, 1, 0):
            distance = right.ranges.distance.round(digits)
            rounded = replace(right, ranges=replace(right.ranges, distance=distance))
            assert check_failed(rounded) == ([], rounded)


def test_a_stream_in_milliseconds_is_at_another_time() -> None:
    right = made_drive(1)
    late = replace(right.odometry, time=1000 * right.odometry.time)
    found = {f.subject: f for f in check_set_up(replace(right, odometry=late)) if f.name == "span"}
    assert {name: each.fits for name, each in found.items()} == {
        "odometry": False, "ranges": True, "reference": True,
    }  # fmt: skip
    assert found["odometry"].value == pytest.approx((119.9 - 100) / 119_800, rel=1e-6)


@pytest.mark.parametrize(
    ("velocity", "value"),
    [([6.0, 2.0], 0.0), ([2.0, 6.0], np.sqrt(0.8)), ([18.0, 6.0], 2 / 3), ([-6.0, -2.0], 2.0)],
)
def test_fixes_move_as_their_velocities_say(velocity: list[float], value: float) -> None:
    """A straight way at (6, 2) m/s."""
    time = np.arange(0.0, 60.0, 0.25)
    told = np.tile(velocity, (len(time), 1))
    fixes = Fixes(time, np.outer(time, [6.0, 2.0]), velocity=told)
    [found] = [f for f in check_set_up(Recording("car", fixes=fixes)) if f.name == "itself"]
    assert found.value == pytest.approx(value, abs=1e-6)
    assert found.fits is bool(value == 0)
    still = replace(fixes, position=0 * fixes.position, velocity=0 * told)
    [found] = [f for f in check_set_up(Recording("car", fixes=still)) if f.name == "itself"]
    assert found.fits is None


def said(recording: Recording, subject: str) -> bool | None:
    """What the check of values says of a stream."""
    return next(
        x.fits for x in check_set_up(recording) if (x.name, x.subject) == ("values", subject)
    )


def test_a_sensor_that_sticks_or_ends_at_a_limit_is_found() -> None:
    imu = made_imu(3)
    walk = Recording("walk", imu=imu)
    assert said(walk, "imu")
    assert said(walk, "imu, limits")
    for rows, fits in ((20, True), (21, False)):  # as many rows on end say the same
        force, rate = imu.force.copy(), imu.rate.copy()
        force[100 : 100 + rows], rate[100 : 100 + rows] = force[100], rate[100]
        assert said(replace(walk, imu=replace(imu, force=force, rate=rate)), "imu") is fits
    limit = float(np.quantile(imu.rate[:, 2], 0.98))
    clipped = replace(imu, rate=np.minimum(imu.rate, limit))
    assert said(replace(walk, imu=clipped), "imu, limits") is False
    # ranges of one anchor stick while others go on
    recording = made(3)
    assert said(recording, "ranges")
    distance, mine = recording.ranges.distance.copy(), np.flatnonzero(recording.ranges.anchor == 2)
    distance[mine[10:40]] = distance[mine[10]]
    stuck = replace(recording, ranges=replace(recording.ranges, distance=distance))
    assert said(stuck, "ranges") is False
    # wheels that stand say 0 for long; those that turn do not say the same for long
    drive = made_drive(0)
    for value, fits in ((0.0, True), (1.0, False)):
        speed, rate = drive.odometry.speed.copy(), drive.odometry.rate.copy()
        speed[100:130], rate[100:130] = value, value / 2
        stuck = replace(drive, odometry=replace(drive.odometry, speed=speed, rate=rate))
        assert said(stuck, "odometry") is fits


# --- stamps and rows ---


def test_values_that_are_held_are_named_and_the_first_of_each_is_taken() -> None:
    """A receiver at 1 Hz that is logged at 5 Hz; of right logs rounding makes none."""
    right = made_car(2)
    fixes = right.fixes
    for often in (2, 5):
        rows = np.arange(len(fixes)) // often * often
        velocity = None if fixes.velocity is None else fixes.velocity[rows]
        held = replace(fixes, position=fixes.position[rows], velocity=velocity)
        [found], first = check_failed(replace(right, fixes=held))
        assert f"stands in {often} rows on end" in found.says
        np.testing.assert_array_equal(first.fixes.time, fixes.time[::often])
    still = Fixes(fixes.time, np.random.default_rng(0).normal(0, 0.01, (len(fixes), 3)).round(2))
    creeping = Fixes(fixes.time, (fixes.time[:, None] * [0.01, 0.0, 0.0]).round(2))
    for calm in (still, creeping):
        assert check_failed(replace(right, fixes=calm))[0] == []


def test_stamps_that_jam_are_named_and_left_out() -> None:
    """Rows of 0.8 s are stamped when they are logged; where rows are lost nothing jams."""
    right = room(1)
    time = right.reference.time
    jam = (time >= 20.0) & (time < 20.8)
    jammed = np.where(jam, 20.8 - 1e-3 + 1e-5 * np.arange(len(time)) - 1e-5 * jam.argmax(), time)
    found, left = check_failed(replace(right, reference=replace(right.reference, time=jammed)))
    assert [(x.name, x.subject) for x in found] == [("stamps", "reference")]
    assert found[0].value == pytest.approx(0.8, abs=0.02)
    assert not ((left.reference.time > 20.0) & (left.reference.time < 20.6)).any()
    assert len(left.reference) > 0.98 * len(time)
    lost = replace(right, reference=right.reference.kept(~jam))
    assert check_failed(lost) == ([], lost)


@pytest.mark.parametrize("seed", range(4))
def test_rows_that_no_motion_joins_are_named_and_left_out(seed: int) -> None:
    """Stretches of up to 3 s are 0.7 to 3.8 m off."""
    right, rng = room(seed), np.random.default_rng(seed)
    place, wrong_rows = right.reference.position.copy(), np.zeros(len(right.reference), dtype=bool)
    for begin in rng.choice(np.arange(100, 2600, 200), 5, replace=False):
        rows, way = slice(begin, begin + int(rng.integers(1, 150))), rng.normal(size=3)
        place[rows] += rng.uniform(0.7, 3.8) * way / np.linalg.norm(way)
        wrong_rows[rows] = True
    spoilt = replace(right, reference=replace(right.reference, position=place))
    [found], left = check_failed(spoilt)
    assert found.says.startswith(f"{wrong_rows.sum()} rows, first at")
    np.testing.assert_array_equal(left.reference.time, right.reference.time[~wrong_rows])
    assert wrong(check_set_up(spoilt)) == ["values: reference, rows"]
    assert check_failed(right) == ([], right)


# --- clocks and units, by a course or an attitude ---


@pytest.mark.parametrize(("late", "says"), [(18.0, "ahead of UTC"), (-3.0, "early"), (7200, "2 h")])
def test_a_clock_that_is_far_off_is_told_and_no_other_axes(late: float, says: str) -> None:
    for seed in (4, 5, 7) if WHOLE else (4,):
        car = made_car(seed)
        moved = replace(car, fixes=replace(car.fixes, time=car.fixes.time + late))
        found = [x for x in check_set_up(moved) if x.fits is False and x.name != "span"]
        assert {x.name for x in found} == {"time"}
        assert found[-1].value == pytest.approx(late, abs=0.6)
        assert says in found[-1].says


@pytest.mark.parametrize("by", ["attitude", "course"])
def test_turns_that_are_few_tell_the_unit(by: str) -> None:
    """Four turns of a right angle in 200 s, each of 2 s."""
    time = np.arange(-1.0, 201.0, 0.005)
    yaw = np.interp(
        time, *np.array([(40 * k + d, k + (d > 0)) for k in range(1, 5) for d in (0, 2)]).T
    )
    yaw = 0.5 * np.pi * (yaw - 1)
    way = np.cumsum(10 * np.column_stack([np.cos(yaw), np.sin(yaw), 0 * yaw]), axis=0) * 0.005
    motion, rng = (
        Motion(time, way, np.column_stack([yaw, 0 * yaw, 0 * yaw])),
        np.random.default_rng(1),
    )
    stamps, at = np.arange(0, 200, 0.02), np.arange(0.2, 199.8, 0.2)
    rate, force = motion.felt(stamps)
    rate, force = (
        rate + 0.005 * rng.normal(size=rate.shape),
        force + rng.normal(size=force.shape) / 9,
    )
    velocity = motion.velocity(at) + 0.06 * rng.normal(size=(len(at), 3))
    fixes = Fixes(at, motion.place(at) + rng.normal(size=(len(at), 3)), velocity)
    reference = Reference(at, motion.place(at), motion.attitude(at).as_quat())
    log = Recording("turns", imu=Imu(stamps, rate, force), fixes=fixes, reference=reference)
    log = log if by == "attitude" else log.without("reference")
    assert wrong(check_set_up(log)) == []
    for unit, words in ((57.29578, "in deg/s"), (0.02, "increments")):
        found = check_set_up(replace(log, imu=replace(log.imu, rate=unit * rate)))
        assert wrong(found) == ["unit: IMU's rates"]
        assert words in next(x.says for x in found if x.subject == "IMU's rates")
    [told] = [x for x in check_set_up(log) if x.subject == "IMU's rates"]
    assert told.fits
    assert told.value == pytest.approx(1.0, abs=0.1)


def _turned(robot: Recording, angle: float) -> Recording:
    c, s = np.cos(angle), np.sin(angle)
    anchors = robot.ranges.anchors @ np.array([[c, s], [-s, c]])
    return replace(robot, ranges=replace(robot.ranges, anchors=anchors))


def _late_odometry(robot: Recording) -> Recording:
    return replace(robot, odometry=replace(robot.odometry, time=robot.odometry.time + 0.5))


def _w_first(robot: Recording) -> Recording:
    attitude = np.roll(robot.reference.attitude, 1, axis=1)
    return replace(robot, reference=replace(robot.reference, attitude=attitude))


@pytest.mark.parametrize(
    ("change", "names"),
    [
        (lambda robot: robot, set()),
        (_late_odometry, {"time"}),
        (_w_first, {"axes"}),
        (lambda robot: _turned(robot, 0.4), {"frame"}),
        (lambda robot: _turned(robot, np.pi / 2), {"axes"}),
        (ranges_of(lambda ranges: {"distance": -ranges.distance}), {"unit"}),
    ],
)
def test_on_a_plane_each_is_called_by_its_name(
    change: Callable[[Recording], Recording], names: set[str]
) -> None:
    found = check_set_up(change(made_robot(4)))
    assert {each.name for each in found if each.fits is False} == names
