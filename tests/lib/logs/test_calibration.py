"""Calibrations of recordings that are made with known unknowns, and of those that cannot tell."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st
from made_recording import ROOM, YARD, made, made_drive
from numpy.typing import NDArray
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation
from scipy.stats import binom

from inswsn_lib.errors import InswsnError, ParameterError
from inswsn_lib.logs import Calibration, calibrate, multilaterate_track
from inswsn_lib.streams import Fixes, Recording, Reference

Array = NDArray[np.float64]

KNOWN: dict[str, Any] = {
    "clock": 0.04,
    "turn": (0.02, -0.03, 0.4),
    "shift": (0.3, -0.2, 0.1),
    "lever_arm": (0.1, -0.05, 0.2),
    "bias": np.linspace(-0.1, 0.1, 8),
}


def errors(found: Calibration) -> Array:
    """Return what was found less what is known; of turns the small rotation between them."""
    turn = Rotation.from_rotvec(KNOWN["turn"])
    off = (Rotation.from_matrix(found.state.turn) * turn.inv()).as_rotvec()
    # p -> R p + shift, told as a turn about the centre and a shift
    shift = KNOWN["shift"] - found.centre + turn.apply(found.centre)
    truth = [[KNOWN["clock"]], found.values[1:4] - off, shift, KNOWN["lever_arm"], KNOWN["bias"]]
    return np.asarray(found.values - np.concatenate(truth))


@pytest.fixture(scope="module")
def calibrations() -> list[Calibration]:
    """Of 12 recordings with errors that last for a second, and with gross ones."""
    return [
        calibrate(made(seed, rate=30, lasting=0.05, outliers=0.02, **KNOWN)) for seed in range(12)
    ]


def test_all_unknowns_at_once_are_found_as_well_as_told(calibrations: list[Calibration]) -> None:
    """Intervals of 95 %: of 12 an unknown misses more only once in 10 000 times."""
    assert calibrations[0].names[:5] == ("clock", "turn x", "turn y", "turn z", "shift x")
    assert calibrations[0].names[-2:] == ("bias a6", "bias a7")
    half = [np.diff(each.intervals(0.95), axis=1)[:, 0] / 2 for each in calibrations]
    missed = np.abs([errors(each) for each in calibrations]) > half
    assert missed.shape == (12, 18)
    assert missed.sum(axis=0).max() <= binom.isf(1e-4 / 18, 12, 0.05)
    # unknowns of a recording are not independent, so that this bound is wider than of 216
    assert 0.005 < missed.mean() < 0.10
    # the intervals are no wider than they need be
    z = np.array([errors(each) / each.deviations for each in calibrations])
    assert 0.5 < np.sqrt(np.mean(z**2)) < 1.5


def test_the_deviations_are_useful(calibrations: list[Calibration]) -> None:
    told = {
        name: np.median([c.told[name][1] for c in calibrations]) for name in calibrations[0].names
    }
    assert told["clock"] < 0.006
    assert told["turn z"] < 0.006
    assert told["lever arm z"] < 0.03
    assert all(c.after < 0.12 and c.before > 0.4 for c in calibrations)


def test_blocks_shorter_than_errors_last_tell_too_small_deviations() -> None:
    recording = made(0, lasting=0.15, noise=0.02, **KNOWN)
    wide, narrow = (calibrate(recording, block=b).deviations for b in (5.0, 0.05))
    assert np.median(wide / narrow) > 1.5


def test_what_was_found_is_made_good(calibrations: list[Calibration]) -> None:
    recording = made(0, rate=30, lasting=0.05, outliers=0.02, **KNOWN)
    right = calibrations[0].apply(recording)
    np.testing.assert_allclose(
        right.ranges.time, recording.ranges.time - calibrations[0].values[0], atol=1e-12
    )
    # the frame in which the ranges were made, with a clock and a tag of its own
    made_here = made(0, rate=30).reference
    assert np.abs(right.reference.position - made_here.position).max() < 0.15
    off = (
        Rotation.from_quat(right.reference.attitude) * Rotation.from_quat(made_here.attitude).inv()
    )
    assert off.magnitude().max() < 0.05
    again = calibrate(right)
    np.testing.assert_allclose(again.values[:7], 0.0, atol=2e-3)
    np.testing.assert_allclose(again.values[7:10], right.lever_arm, atol=2e-3)
    np.testing.assert_allclose(again.values[10:], 0.0, atol=2e-3)


def test_the_estimate_is_that_of_scipy() -> None:
    """Clock and bias of ranges in the plane, by scipy's least squares with the same loss."""
    recording = made_drive(4)
    ranges, reference = recording.ranges, recording.reference
    late = replace(ranges, time=ranges.time + 0.2, distance=ranges.distance + 0.3)
    found = calibrate(replace(recording, ranges=late), ("clock", "bias"))
    inside = (ranges.time > 0.5) & (ranges.time < reference.time[-1] - 0.5)

    def miss(x: Array) -> Array:
        at = [np.interp(late.time - x[0], reference.time, p) for p in reference.position.T]
        distance = np.linalg.norm(np.column_stack(at) - YARD[late.anchor], axis=1)
        return np.asarray(late.distance - distance - x[1:][late.anchor])[inside]

    by_scipy = least_squares(miss, np.zeros(6), loss="soft_l1", f_scale=found.after, xtol=1e-12)
    np.testing.assert_allclose(found.values, by_scipy.x, atol=1e-3)
    assert found.values[0] == pytest.approx(0.2, abs=4 * found.deviations[0])
    assert found.values[1:] == pytest.approx(0.3, abs=0.03)


def test_a_rate_and_a_scale_are_told_apart() -> None:
    recording = made_drive(7)
    ranges = recording.ranges
    gained = ranges.time + 300e-6 * (ranges.time - ranges.time.mean()) + 0.1
    scaled = replace(ranges, time=gained, distance=1.07 * ranges.distance + 0.5)
    found = calibrate(
        replace(recording, ranges=scaled), ("clock", "rate", "bias", "scale"), limits={"rate": 500}
    )
    for name, (value, deviation) in found.told.items():
        truth = {"clock": 0.1, "rate": 300.0, "bias": 0.5, "scale": 0.07}[name.split(" ")[0]]
        assert abs(value - truth) < 4 * deviation, name
    assert found.told["rate"][1] < 150
    assert found.told["scale A"][1] < 0.005
    right = found.apply(replace(recording, ranges=scaled)).ranges
    assert np.median(np.abs(right.distance - ranges.distance)) < 0.05
    assert np.abs(right.time - ranges.time).max() < 0.02


def test_fixes_tell_clock_frame_and_lever_arm() -> None:
    known = {name: value for name, value in KNOWN.items() if name != "bias"}
    recording = made(2, rate=120, noise=0.03, **known)
    fixes = multilaterate_track(recording.ranges, 0.1)
    found = calibrate(replace(recording, ranges=None, fixes=fixes), ("clock", "frame", "lever arm"))
    assert found.source == "fixes"
    longer = replace(found, values=np.append(found.values, KNOWN["bias"]))
    assert np.abs(errors(longer)[:10] / found.deviations).max() < 4
    with pytest.raises(InswsnError, match=r"Fixes have no bias by anchor"):
        calibrate(replace(recording, ranges=None, fixes=fixes), ("bias",))


def test_a_clock_of_seconds_is_found_and_one_beyond_reach_is_not() -> None:
    recording = made_drive(1)
    late = replace(recording, ranges=replace(recording.ranges, time=recording.ranges.time + 3.0))
    assert calibrate(late, ("clock", "frame")).told["clock"][0] == pytest.approx(3.0, abs=0.02)
    assert calibrate(late, ("clock",)).told["clock"][0] == pytest.approx(3.0, abs=0.02)


# --- what cannot be told ---


def test_at_rest_neither_clock_nor_lever_arm_nor_frame_is_told() -> None:
    still = made(1, still=True, lever_arm=(0.1, 0.0, 0.0))
    with pytest.raises(
        InswsnError, match=r"^The recording cannot tell clock \(.*moves at 0 m/s\)\.$"
    ):
        calibrate(still, ("clock",))
    with pytest.raises(InswsnError, match=r"cannot tell turn x, y, z .*places are within"):
        calibrate(still, ("frame",))
    with pytest.raises(InswsnError, match=r"shift x, y, z .*; lever arm x, y, z .*turns by"):
        calibrate(still, ("frame", "lever arm"))


def test_a_lever_arm_without_rotation_is_told_only_in_a_known_frame() -> None:
    recording = made(1, lever_arm=(0.1, -0.1, 0.2))
    reference, ranges = recording.reference, recording.ranges
    upright = replace(reference, attitude=np.tile([0.0, 0.0, 0.0, 1.0], (len(reference), 1)))
    tag = [np.interp(ranges.time, reference.time, x) for x in reference.position.T]
    off = np.column_stack(tag) + np.array([0.1, -0.1, 0.2]) - ROOM[ranges.anchor]
    noise = np.random.default_rng(0).normal(0, 0.05, len(ranges))
    ranges = replace(ranges, distance=np.linalg.norm(off, axis=1) + noise)
    slid = replace(recording, reference=upright, ranges=ranges)
    found = calibrate(slid, ("lever arm",))
    assert found.values == pytest.approx([0.1, -0.1, 0.2], abs=0.01)
    with pytest.raises(InswsnError, match=r"tell .*shift x, y, z .*lever arm x, y, z"):
        calibrate(slid, ("frame", "lever arm"))
    with pytest.raises(InswsnError, match="no attitude, so the lever arm"):
        calibrate(replace(slid, reference=replace(upright, attitude=None)), ("lever arm",))


def test_an_anchor_that_is_heard_too_seldom_is_named() -> None:
    recording = made(1)
    ranges = recording.ranges
    seldom = ranges.kept((ranges.anchor != 5) | (ranges.time < 2.0))
    with pytest.raises(InswsnError, match=r"cannot tell bias a5 \(nothing, or one short time"):
        calibrate(replace(recording, ranges=seldom), ("bias",))
    found = calibrate(replace(recording, ranges=ranges.kept(ranges.anchor != 5)), ("bias",))
    assert "bias a5" not in found.names
    assert len(found.values) == 7


def test_limits_are_what_refuses() -> None:
    with pytest.raises(InswsnError, match=r"clock \(its deviation would be .* s, above 0\.0001"):
        calibrate(made(1), ("clock",), limits={"clock": 1e-4})


def test_too_little_data_is_refused() -> None:
    recording = made(1)
    with pytest.raises(InswsnError, match=r"too few for \d unknowns"):
        calibrate(recording.part(10.0, 10.15), ("bias",))
    elsewhere = replace(recording, reference=recording.part(end=0.01).reference)
    with pytest.raises(InswsnError, match="fewer than two positions"):
        calibrate(elsewhere, ("bias",))
    late = Reference(np.array([500.0, 501.0]), np.zeros((2, 3)))
    with pytest.raises(InswsnError, match="share no time"):
        calibrate(replace(recording, reference=late), ("bias",))
    flat = Reference(np.arange(60.0), np.zeros((60, 2)))
    with pytest.raises(InswsnError, match="2 coordinates, and what it is compared with has 3"):
        calibrate(replace(recording, reference=flat), ("bias",))


def test_what_is_asked_wrongly_is_refused() -> None:
    recording = made(1, seconds=10)
    for estimate in ((), "clock", ("clock", "clock"), ("offset",)):
        with pytest.raises(ParameterError):
            calibrate(recording, estimate)
    for more in ({"block": 0.0}, {"reach": -1.0}, {"limits": {"frame": 1.0}}, {"source": "imu"}):
        with pytest.raises(ParameterError):
            calibrate(recording, ("clock",), **more)
    with pytest.raises(InswsnError, match="has no fixes"):
        calibrate(recording, ("clock",), source="fixes")
    found = calibrate(made(1), ("bias",))
    with pytest.raises(InswsnError, match="has no ranges to correct"):
        found.apply(Recording("other", fixes=Fixes(np.arange(3.0), np.zeros((3, 2)))))
    with pytest.raises(ParameterError):
        found.apply(made_drive(0))


# --- without a reference ---


def test_ranges_alone_tell_what_each_anchor_has_too_much() -> None:
    """With errors that last: of 30 intervals of 95 % an anchor misses more once in 10 000 times."""
    missed, bias = [], np.linspace(-0.1, 0.1, 8)
    for seed in range(30):
        alone = made(seed, rate=50, bias=bias, lasting=0.05, noise=0.03).without("reference")
        found = calibrate(alone, ("bias",))
        half = np.diff(found.intervals(), axis=1)[:, 0] / 2
        missed.append(np.abs(found.values - bias) > half)
        assert found.deviations.max() < 0.06
        assert found.after < found.before
    assert np.sum(missed, axis=0).max() <= binom.isf(1e-4 / 8, 30, 0.05)
    # those of a seed hang together
    assert np.mean(missed) < 0.12


def test_without_redundant_ranges_nothing_is_told() -> None:
    alone = made(1).without("reference")
    for more in (("clock",), ("bias", "clock"), ("clock", "frame", "lever arm", "bias")):
        with pytest.raises(InswsnError, match="Without a reference nothing can be told but"):
            calibrate(alone, more)
    three = alone.ranges.kept(alone.ranges.anchor < 3)
    with pytest.raises(InswsnError, match="none is redundant"):
        calibrate(replace(alone, ranges=three), ("bias",))
    still = made(1, still=True, rate=60).without("reference")
    with pytest.raises(InswsnError, match="cannot tell bias a0"):
        calibrate(still, ("bias",))


# --- symmetry ---


@given(angles=st.tuples(*[st.floats(-3, 3)] * 3), shift=st.tuples(*[st.floats(-50, 50)] * 3))
@settings(max_examples=3, deadline=None, derandomize=True)
def test_turned_anchors_turn_the_frame_and_nothing_else(angles: Any, shift: Any) -> None:
    recording = made(9, rate=15, seconds=40, **KNOWN)
    turn = Rotation.from_euler("zyx", angles)
    moved = replace(recording.ranges, anchors=turn.apply(ROOM) + np.array(shift))
    found, other = calibrate(recording), calibrate(replace(recording, ranges=moved))
    np.testing.assert_allclose(other.state.turn, turn.as_matrix() @ found.state.turn, atol=1e-3)
    same = [0, *range(7, 18)]  # clock, lever arm, biases
    np.testing.assert_allclose(other.values[same], found.values[same], atol=2e-3)
    np.testing.assert_allclose(other.deviations[same], found.deviations[same], rtol=0.05)
