"""Fixes of ranges and their velocities, against closed forms, scipy and polyfit."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st
from made_recording import ROOM, YARD, made
from numpy.typing import NDArray
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from inswsn_lib.errors import InswsnError, ParameterError
from inswsn_lib.logs import multilaterate_track, slope_velocity
from inswsn_lib.streams import Fixes, Ranges

Array = NDArray[np.float64]


def names(count: int) -> tuple[str, ...]:
    return tuple(f"a{k}" for k in range(count))


def ranges_from(
    places: Array, anchors: Array, each: int, noise: float = 0.0, seed: int = 0
) -> Ranges:
    """Ranges to anchors in turn: `each` within 0.2 s from one place, then from the next."""
    rng = np.random.default_rng(seed)
    heard = np.arange(len(places) * each) % len(anchors)
    where = np.repeat(places, each, axis=0)[:, : anchors.shape[1]]
    distance = np.linalg.norm(where - anchors[heard], axis=1)
    distance += noise * rng.normal(size=len(heard))
    stamps = (np.arange(len(heard)) // each + (np.arange(len(heard)) % each) / each) * 0.2
    return Ranges(stamps, heard, distance, anchors, names(len(anchors)))


@pytest.mark.parametrize("anchors", [YARD, ROOM], ids=["plane", "space"])
def test_ranges_without_noise_give_the_place(anchors: Array) -> None:
    rng = np.random.default_rng(1)
    places = rng.uniform(anchors.min(axis=0), anchors.max(axis=0), (50, anchors.shape[1]))
    ranges = ranges_from(places, anchors, 2 * len(anchors))
    fixes = multilaterate_track(ranges)
    np.testing.assert_allclose(fixes.position, places, atol=1e-4)
    each = 2 * len(anchors)
    assert fixes.time == pytest.approx(0.2 * np.arange(50) + 0.1 * (each - 1) / each)
    assert (fixes.deviation < 1e-4).all()


def test_a_square_and_a_known_height_in_closed_form() -> None:
    """Of anchors at the corners of a square, differences of squares tell x and y by themselves."""
    anchors = np.array([[0.0, 0.0, 3.0], [6.0, 0.0, 3.0], [0.0, 6.0, 3.0], [6.0, 6.0, 3.0]])
    exact = np.linalg.norm(anchors[:, :2] - [2.0, 1.0], axis=1)
    # the tag is 2 m below
    ranges = Ranges(0.01 * np.arange(4), np.arange(4), np.hypot(exact, 2.0), anchors, names(4))
    x = (exact[0] ** 2 - exact[1] ** 2 + 36) / 12
    y = (exact[0] ** 2 - exact[2] ** 2 + 36) / 12
    found = multilaterate_track(ranges, height=1.0)
    assert found.position.shape == (1, 2)
    np.testing.assert_allclose(found.position[0], [x, y], atol=1e-6)


def test_fixes_are_those_of_scipy() -> None:
    """The scale of the loss is not told, but there is one with which the fixes are the same."""
    ranges = made(3, seconds=12, noise=0.1, outliers=0.03).ranges
    fixes = multilaterate_track(ranges, 0.5)
    cell = np.floor((ranges.time - ranges.time[0]) / 0.5).astype(int)
    kept = np.isfinite(fixes.position[:, 0])
    assert kept.sum() > 20

    def solved(scale: float) -> Array:
        found = []
        for k, place in zip(np.unique(cell)[kept], fixes.position[kept], strict=True):
            at, r = ROOM[ranges.anchor[cell == k]], ranges.distance[cell == k]
            found.append(
                least_squares(
                    lambda p, at=at, r=r: np.linalg.norm(p - at, axis=1) - r, place + 0.05,
                    loss="soft_l1", f_scale=scale, xtol=1e-12, ftol=1e-12, gtol=1e-12,
                ).x
            )  # fmt: skip
        return np.array(found)

    scales = np.linspace(0.07, 0.14, 15)
    misses = [float(np.median(np.abs(fixes.position[kept] - solved(s)))) for s in scales]
    assert min(misses) < 1e-3 < max(misses)


def test_what_the_geometry_cannot_tell_is_not_guessed() -> None:
    line = np.column_stack([np.arange(5.0), np.zeros(5)])
    ceiling = ROOM.copy()
    ceiling[:, 2] = 2.5
    for anchors in (line, ceiling):
        places = np.full((3, anchors.shape[1]), 1.0)
        fixes = multilaterate_track(ranges_from(places, anchors, len(anchors)))
        assert np.isnan(fixes.position).all()
        assert np.isnan(fixes.deviation).all()
    flat = multilaterate_track(ranges_from(np.full((3, 3), 1.0), ceiling, 8), height=1.0)
    np.testing.assert_allclose(flat.position, 1.0, atol=1e-5)
    few = ranges_from(np.zeros((4, 2)) + 1.0, YARD, 5)
    few = replace(few, anchor=np.where(few.time < 0.4, few.anchor % 2, few.anchor))
    assert np.isnan(multilaterate_track(few).position[:, 0]).tolist() == [True, True, False, False]


def test_anchors_in_a_plane_tell_the_place_on_the_given_side() -> None:
    """The mirror image fits as well: its height is as far above the plane as the tag is below."""
    ceiling = ROOM * [1, 1, 0] + [0, 0, 2.5]
    turn = Rotation.from_euler("xy", [0.5, 0.3])
    rng = np.random.default_rng(8)
    places = rng.uniform([-3, -2, 0.3], [3, 2, 1.8], (400, 3))
    for turned in (Rotation.identity(), turn):
        args = turned.apply(places), turned.apply(ceiling), 16
        below = multilaterate_track(ranges_from(*args, noise=0.05, seed=8), side=-1)
        above = multilaterate_track(ranges_from(*args, noise=0.05, seed=8), side=1)
        error = turned.inv().apply(below.position) - places
        assert np.isfinite(error).all(axis=1).mean() > 0.98
        assert np.nanmedian(np.abs(error)) < 0.03
        flat = turned.inv().apply(above.position) - places * [1, 1, -1] - [0, 0, 5]
        assert np.nanmedian(np.abs(flat)) < 0.03
        # a vertical error is as much larger as the anchors let it be, from 0.7 m below them on
        scaled = (below.position - args[0]) / below.deviation
        assert np.nanmean(scaled**2, axis=0) == pytest.approx(np.ones(3), abs=0.3)


@pytest.mark.parametrize("apart", [0.3, 0.6, 1.0, 1.5])
def test_anchors_nearly_in_a_plane_tell_the_side(apart: float) -> None:
    """No side is given; with fixes on the other one errors would be metres."""
    nearly = ROOM * [1, 1, 0] + [0, 0, 2.8]
    nearly[::2, 2] -= apart
    rng = np.random.default_rng(9)
    places = rng.uniform([-3, -2, 0.3], [3, 2, 1.8], (400, 3))
    for side in (1.0, -1.0):
        where = places * [1, 1, -side] + [0, 0, 2.8 * (1 + side)]
        anchors = nearly * [1, 1, -side] + [0, 0, 2.8 * (1 + side)]
        fixes = multilaterate_track(ranges_from(where, anchors, 16, noise=0.05, seed=9))
        error = fixes.position - where
        assert np.nanmax(np.abs(error)) < 1.0
        scaled = error / fixes.deviation
        assert np.nanmean(scaled**2, axis=0) == pytest.approx(np.ones(3), abs=0.3)


def test_an_interval_without_ranges_has_no_fix() -> None:
    ranges = ranges_from(np.ones((6, 2)), YARD, 5)
    gap = (ranges.time < 0.4) | (ranges.time >= 0.8)
    holed = Ranges(*(x[gap] for x in (ranges.time, ranges.anchor, ranges.distance)), YARD, names(5))
    assert len(multilaterate_track(holed)) == 4


def test_a_range_that_is_not_there_is_passed_over() -> None:
    ranges = ranges_from(np.ones((3, 2)), YARD, 10)
    holed = replace(ranges, distance=np.where(ranges.anchor == 1, np.nan, ranges.distance))
    np.testing.assert_allclose(multilaterate_track(holed).position, 1.0, atol=1e-4)


def test_a_gross_error_hardly_moves_a_fix() -> None:
    rng = np.random.default_rng(5)
    places = rng.uniform(-10, 10, (200, 2))
    ranges = ranges_from(places, YARD, 15, noise=0.1, seed=5)
    wrong = np.where(rng.random(len(ranges)) < 0.05, 5.0, 0.0)
    ranges = replace(ranges, distance=ranges.distance + wrong)
    assert np.sqrt(np.mean((multilaterate_track(ranges).position - places) ** 2)) < 0.08


@pytest.mark.parametrize("of_anchor", [0.0, 0.1])
def test_errors_are_as_large_as_told(of_anchor: float) -> None:
    """Also if ranges to an anchor err alike within an interval, though the intervals are short."""
    rng = np.random.default_rng(11)
    places = rng.uniform(-15, 15, (800, 2))
    ranges = ranges_from(places, YARD, 20, noise=0.05, seed=11)
    cell = np.repeat(np.arange(800), 20)
    own = of_anchor * rng.normal(size=(800, 5))
    ranges = replace(ranges, distance=ranges.distance + own[cell, ranges.anchor])
    fixes = multilaterate_track(ranges)
    z = (fixes.position - places) / fixes.deviation
    # 1600 values, half as many independent ones: five deviations of their mean square are 0.25
    assert np.mean(z**2) == pytest.approx(1.0, abs=0.25)


@given(
    seed=st.integers(0, 2**16),
    angles=st.tuples(*[st.floats(-3, 3)] * 3),
    shift=st.tuples(*[st.floats(-50, 50)] * 3),
    d=st.sampled_from([2, 3]),
)
@settings(max_examples=25, deadline=None, derandomize=True)
def test_turned_anchors_turn_the_fixes(seed: int, angles: Any, shift: Any, d: int) -> None:
    rng = np.random.default_rng(seed)
    anchors = YARD if d == 2 else ROOM
    places = rng.uniform(anchors.min(axis=0), anchors.max(axis=0), (6, d)) * 0.7
    ranges = ranges_from(places, anchors, 16, noise=0.1, seed=seed)
    turn = Rotation.from_euler("zyx", angles).as_matrix()
    if d == 2:
        turn = Rotation.from_euler("z", angles[0]).as_matrix()[:2, :2]
    moved = replace(ranges, anchors=anchors @ turn.T + np.array(shift[:d]))
    fixes, other = multilaterate_track(ranges), multilaterate_track(moved)
    there = np.isfinite(fixes.position).all(axis=1) & np.isfinite(other.position).all(axis=1)
    assert there.sum() >= 5
    expected = fixes.position[there] @ turn.T + np.array(shift[:d])
    np.testing.assert_allclose(other.position[there], expected, atol=2e-3)


def test_what_is_asked_wrongly_is_refused() -> None:
    ranges = ranges_from(np.ones((3, 2)), YARD, 5)
    empty = Ranges(*(x[:0] for x in (ranges.time, ranges.anchor, ranges.distance)), YARD, names(5))
    with pytest.raises(InswsnError, match="no range"):
        multilaterate_track(empty)
    for wrong in ({"period": 0.0}, {"side": 2.0}, {"height": 1.0}):
        with pytest.raises(ParameterError):
            multilaterate_track(ranges, **wrong)


# --- velocities ---


def test_a_slope_is_that_of_polyfit_and_looks_back_alone() -> None:
    rng = np.random.default_rng(0)
    time = np.cumsum(rng.uniform(0.1, 0.3, 40))
    place = rng.normal(size=(40, 3))
    found = slope_velocity(Fixes(time, place), 5).velocity
    assert np.isnan(found[:4]).all()
    for k in range(4, 40):
        rows = slice(k - 4, k + 1)
        expected = np.polyfit(time[rows] - time[k], place[rows], 1)[0]
        np.testing.assert_allclose(found[k], expected, atol=1e-9)
    changed = place.copy()
    changed[20:] += 100.0
    other = slope_velocity(Fixes(time, changed), 5).velocity
    np.testing.assert_array_equal(found[:20], other[:20])


def test_the_deviation_of_a_slope_is_that_of_its_docstring() -> None:
    rng = np.random.default_rng(1)
    fixes = Fixes(0.2 * np.arange(40_000), 0.1 * rng.normal(size=(40_000, 2)))
    found = slope_velocity(fixes, 6).velocity
    told = 0.1 * np.sqrt(12 / (6**3 - 6)) / 0.2
    assert np.nanstd(found[5::6]) == pytest.approx(told, rel=0.03)


def test_a_long_gap_makes_no_velocity() -> None:
    time = np.array([0.0, 1, 2, 3, 9, 10, 11, 12])
    fixes = Fixes(time, np.column_stack([2 * time, -time]))
    found = slope_velocity(fixes, 3).velocity
    assert np.isnan(found[:, 0]).tolist() == [True, True, False, False, True, True, False, False]
    np.testing.assert_allclose(found[[2, 3, 6, 7]], [[2.0, -1.0]] * 4)
    few = slope_velocity(Fixes(time[:2], np.zeros((2, 2))), 3).velocity
    assert np.isnan(few).all()
    with pytest.raises(ParameterError):
        slope_velocity(fixes, 1)
