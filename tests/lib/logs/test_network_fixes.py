"""A network whose anchors lie in a plane, or which has no heights, beside an IMU that is known."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from made_recording import ROOM, made, made_drive, made_imu, motion

from inswsn_lib.errors import InswsnError
from inswsn_lib.logs import report
from inswsn_lib.logs.correction import WHITE, InertialCorrection, correction_of
from inswsn_lib.logs.network_fixes import network_of
from inswsn_lib.streams import Fixes, Ranges, Recording

CEILING, FLOOR = ROOM * [1, 1, 0] + [0, 0, 2.5], ROOM * [1, 1, 0] + [0, 0, 0.1]
WALL = np.repeat([[4.0, -3.0, 0.3], [4.0, -3.0, 2.2], [4.0, 3.0, 0.3], [4.0, 3.0, 2.2]], 2, axis=0)


def room(anchors: np.ndarray, seed: int, *, still: bool = False) -> Recording:
    return replace(made(seed, rate=80, anchors=anchors, still=still), imu=made_imu(seed))


@pytest.mark.parametrize(
    ("anchors", "says"),
    [
        (CEILING, "z = 2.5 m; the tag is taken to be below"),
        (FLOOR, "z = 0.1 m; the tag is taken to be above"),
        (WALL, "x = 4 m; the tag is taken to be on the side that fits the motion"),
    ],
)
def test_the_motion_tells_the_side_of_anchors_in_a_plane(anchors: np.ndarray, says: str) -> None:
    """On the other side the IMU would be pushed the other way."""
    filtered = correction_of(room(anchors, 3), 15.0)
    [side] = filtered.assumed
    assert says in side.says
    assert side.fits
    place, _ = motion(filtered.fixes.time)
    assert np.nanmedian(np.abs(filtered.fixes.position - place)) < 0.1


def test_what_tells_no_side_is_refused_by_the_plane() -> None:
    assert np.nanmedian(network_of(room(CEILING, 4)).position[:, 2]) < 2.5
    with pytest.raises(InswsnError, match="The anchors lie in a plane, x = 4 m, and neither"):
        network_of(room(WALL, 4))
    odd = room(WALL, 4)
    with pytest.raises(InswsnError, match="lie in a plane, and on neither side"):
        correction_of(replace(odd, imu=replace(odd.imu, force=odd.imu.force * [1, -1, 1])), 15.0)


def test_a_height_that_is_given_is_held() -> None:
    filtered = correction_of(replace(room(CEILING, 5), height=1.2), 15.0)
    place, _ = motion(filtered.fixes.time)
    assert np.nanmedian(np.abs(filtered.fixes.position - place)[:, :2]) < 0.3
    assert (filtered.fixes.position[:, 2] == 1.2).all()
    assert [each.name for each in filtered.assumed] == ["height"]


@pytest.mark.parametrize("velocities", [False, True])
def test_fixes_on_a_plane_beside_an_imu_have_their_height_held(velocities: bool) -> None:
    """The tag goes up and down by 0.6 m all the same."""
    rng = np.random.default_rng(6)
    time = np.arange(0.2, 59.0, 0.2)
    place, _ = motion(time)
    moved = (motion(time + 1e-3)[0] - motion(time - 1e-3)[0]) / 2e-3
    velocity = moved[:, :2] + 0.05 * rng.normal(size=(len(time), 2)) if velocities else None
    fixes = Fixes(time, place[:, :2] + 0.2 * rng.normal(size=(len(time), 2)), velocity)
    reference = made(6).reference
    found = report(Recording("flat", imu=made_imu(6), fixes=fixes, reference=reference), begins=1)
    network, corrected, *_ = found.table["position"]
    assert network == pytest.approx(0.2 * np.sqrt(2), rel=0.15)
    assert corrected < 0.6 * network
    [errors] = [each for each in found.findings if each.name == "errors"]
    assert 0.4 < errors.value < 2.5
    assert "the height is held at 0 m" in next(f.says for f in found.findings if f.name == "height")
    [size] = [each for each in found.findings if each.name == "size"]
    assert size.fits


def test_held_heights_are_no_innovations() -> None:
    time = np.arange(0.2, 59.0, 0.2)
    fixes = Fixes(time, motion(time)[0][:, :2])
    filtered = correction_of(Recording("flat", imu=made_imu(7), fixes=fixes), 15.0)
    assert isinstance(filtered, InertialCorrection)
    rung = filtered.rungs[WHITE]
    told = rung.run(*rung.begin).innovations[0]
    assert {len(value) for value in told.values} == {2}
    assert set(rung.series[0][1]) == {0, 1}


def test_ranges_to_anchors_on_a_line_have_a_side_by_odometry() -> None:
    """Two dimensions: the mirror image of a way turns to the other side."""
    drive = made_drive(3)
    line = np.column_stack([np.linspace(-30, 30, 5), np.full(5, -40.0)])
    heard = np.arange(3000) % 5
    time = np.linspace(0.5, 119.0, 3000)
    tag = np.column_stack([np.interp(time, drive.reference.time, x) for x in
                           drive.reference.position.T])  # fmt: skip
    rng = np.random.default_rng(3)
    distance = np.linalg.norm(tag - line[heard], axis=1) + 0.05 * rng.normal(size=3000)
    ranges = Ranges(time, heard, distance, line, tuple("abcde"))
    filtered = correction_of(replace(drive, ranges=ranges), 15.0)
    [side] = filtered.assumed
    assert "y = -40 m" in side.says
    true = np.column_stack([np.interp(filtered.fixes.time, drive.reference.time, x) for x in
                            drive.reference.position.T])  # fmt: skip
    assert np.nanmedian(np.abs(filtered.fixes.position - true)) < 0.5
