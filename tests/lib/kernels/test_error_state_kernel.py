"""The compiled error-state filter against the one in numpy."""

from __future__ import annotations

from dataclasses import fields, replace
from typing import Any

import numpy as np
import pytest
from lib.inertial.made import ANCHORS, LEVER_ARM, Path, compass, imu_of
from lib.kernels.both_ways import both

from inswsn_lib import inertial as nav
from inswsn_lib.streams import Fixes, Odometry, Ranges

NAMES = tuple("ABCDEF")


EARTH = nav.Earth(0.9)


def height(x: Any, own: Any, data: Any, row: Any) -> Any:
    """Return a height with an error that lasts, in some units."""
    row[2], row[15] = 1.0, data[0]
    return x[2] + data[0] * own[0]


def inertial(seed: int) -> tuple[Any, nav.Start, list[Any], dict[str, Any]]:
    """Return an INS with all that it can observe: told badly, with gaps, two at a time."""
    rng, path = np.random.default_rng(seed), Path()
    imu = imu_of(path, 4.0, rng, force=0.02, rate=0.002)
    motion = nav.InertialMotion(imu, nav.ImuNoise(0.05, 0.005, 1e-3, 1e-4), EARTH)
    t = np.arange(0.1, 4.05, 0.1)
    place = path.antenna(t) + 0.1 * rng.standard_normal((len(t), 3))
    place[rng.random(place.shape) < 0.2] = np.nan
    place[7] = np.nan
    fixes = nav.PositionFixes(
        Fixes(t, place), LEVER_ARM, np.array([0.1, 0.1, 0.2]), np.full(3, 0.05), np.full(3, 2.0)
    )
    heard = np.sort(rng.choice(t, 60))
    anchor = rng.integers(0, len(ANCHORS), 60)
    distance = np.linalg.norm(path.antenna(heard) - ANCHORS[anchor], axis=1)
    distance += 0.1 * rng.standard_normal(60) + 3 * (rng.random(60) < 0.1)
    ranges = nav.RangesToAnchors(
        Ranges(heard, anchor, distance, ANCHORS, NAMES), LEVER_ARM, 0.1, 0.05, 0.1, 1.0, scale=0.01
    )
    moved = path.velocity(t[::5])
    moved[2, 1] = np.nan
    wheels = np.linalg.norm(moved, axis=1)
    observed = [
        fixes, ranges, nav.Velocities(t[::5], moved, np.full(3, 0.1)),
        nav.WheelSpeeds(t[::5], wheels, np.eye(3)[[1, 2, 0]], np.array([0.3, 2.0, 2.0])),
        compass(
            t[::4], path.heading(t[::4]), 0.05, EARTH,
            deviations=np.array([0.1]), times=np.array([np.inf]),
        ),
        nav.Sensor(
            height, t[::3], path.antenna(t[::3])[:, 2:], np.array([0.1]), np.array([[2.0]]),
            np.ones(1), np.array([30.0]), LEVER_ARM,
        ),
    ]  # fmt: skip
    root = 0.1 * rng.standard_normal((15, 15)) + 0.2 * np.eye(15)
    begun = path.state(0.0).plus(0.05 * rng.standard_normal(15))
    start = nav.Start(0.0, begun, root @ root.T)
    about = path.state(0.0).plus(0.2 * rng.standard_normal(15))
    return motion, start, observed, {"about": about}


def planar(seed: int) -> tuple[Any, nav.Start, list[Any], dict[str, Any]]:
    """Return the same of a vehicle on a plane."""
    rng, t = np.random.default_rng(seed), np.arange(0, 10.05, 0.1)
    odometry = Odometry(t, 1 + 0.1 * rng.standard_normal(101), 0.3 * rng.standard_normal(101))
    motion = nav.OdometryMotion(odometry, nav.OdometryNoise(0.1, 0.05, 1e-3, 1e-3))
    arm, anchors = np.array([0.3, -0.1]), 8 * rng.standard_normal((4, 2))
    place = np.column_stack([t, 0.1 * t])[::3] + 0.1 * rng.standard_normal((34, 2))
    place[rng.random(place.shape) < 0.2] = np.nan
    fixes = nav.PositionFixes(
        Fixes(t[::3], place), arm, np.full(2, 0.1), np.full(2, 0.1), np.full(2, 3.0)
    )
    heard, anchor = np.sort(rng.choice(t, 50)), rng.integers(0, 4, 50)
    distance = np.linalg.norm(np.column_stack([heard, 0.1 * heard]) - anchors[anchor], axis=1)
    distance += 0.1 * rng.standard_normal(50) + 4 * (rng.random(50) < 0.1)
    ranges = nav.RangesToAnchors(
        Ranges(heard, anchor, np.abs(distance), anchors, NAMES[:4]), arm, 0.1, 0.05, 0.1, 1.0,
        scale=0.02,
    )  # fmt: skip
    moved = np.tile([1.0, 0.1], (len(t[::7]), 1))
    moved[3] = np.nan, 0.1
    observed = [fixes, ranges, nav.Velocities(t[::7], moved, np.full(2, 0.2))]
    root = 0.05 * rng.standard_normal((5, 5)) + 0.1 * np.eye(5)
    start = nav.Start(0.0, nav.PlanarState(np.zeros(2), 0.1), root @ root.T)
    return motion, start, observed, {"about": nav.PlanarState(np.array([0.1, 0.0]), 0.3, 0.01)}


def numbers(found: Any) -> list[Any]:
    """Return all that a solution holds, as arrays."""
    one = found.innovations
    return [
        found.time, *(s.row for s in (*found.states, *found.before, found.start.state)),
        found.covariances, found.priors, found.transitions, found.log_likelihood,
        *(getattr(each, f.name) for each in one for f in fields(each) if f.name in "time squares"),
        *(part for each in one for of in (each.values, each.deviations, each.used) for part in of),
    ]  # fmt: skip


def same(*told: Any, **more: Any) -> nav.Solution:
    """Hold the compiled run against the plain one, to rounding, and return it."""
    compiled, plain = both(lambda: nav.run_error_state(*told, **more))
    for one, other in zip(numbers(compiled), numbers(plain), strict=True):
        assert np.asarray(one).dtype == np.asarray(other).dtype
        scale = np.max(np.abs(np.nan_to_num(np.asarray(other, dtype=float))), initial=1e-3)
        np.testing.assert_allclose(one, other, rtol=1e-8, atol=1e-9 * scale)
    return compiled


@pytest.mark.parametrize("made", [inertial, planar])
@pytest.mark.parametrize("seed", [1, 2])
@pytest.mark.parametrize("gate", [np.inf, 9.0])
def test_both_find_the_same(made: Any, seed: int, gate: float) -> None:
    motion, start, observed, about = made(seed)
    found = same(motion, start, observed, gate=gate)
    used = np.concatenate([part for each in found.innovations for part in each.used])
    assert used.all() == np.isinf(gate)  # a gate leaves out some
    bare = same(motion, start, observed, gate=gate, kept=False)
    assert bare.log_likelihood == pytest.approx(found.log_likelihood, rel=1e-12)
    for one, other in zip(bare.innovations, found.innovations, strict=True):
        assert np.array_equal(one.squares, other.squares)
        assert np.array_equal(one.time, other.time)
    same(motion, start, observed, gate=gate, **about)


@pytest.mark.parametrize("made", [inertial, planar])
@pytest.mark.parametrize("kept", [True, False])
def test_edges(made: Any, kept: bool) -> None:
    motion, start, observed, _ = made(3)
    same(motion, start, observed, end=0.35, kept=kept)
    same(motion, start, observed, gate=0.0, kept=kept)  # nothing passes
    fixes = observed[0]
    nothing = replace(fixes.fixes, position=np.full_like(fixes.fixes.position, np.nan))
    found = same(motion, start, [replace(fixes, fixes=nothing)], kept=kept)
    assert found.log_likelihood == 0.0
    assert len(found.states) == kept * np.sum(nothing.time > 0)
    # beyond the last sample of the sensor, and an observation without states of its own
    late = replace(nothing, time=nothing.time + 2.0)
    bare = nav.PositionFixes(late, fixes.lever_arm, fixes.white)
    same(motion, start, [bare, observed[2]], kept=kept)


@pytest.mark.parametrize("made", [inertial, planar])
def test_what_comes_one_after_the_other(made: Any) -> None:
    motion, start, observed, _ = made(4)

    def run() -> tuple[Any, ...]:
        running = nav.ErrorStateFilter(start, observed, gate=9.0)
        for k in range(1, 5):
            running.predict(motion, float(observed[0].fixes.time[k]))
            running.measure(0, observed[0], k)
            running.measure(1, observed[1], k)
        return running.state.row, running.covariance, running.log_likelihood

    for one, other in zip(*both(run), strict=True):
        np.testing.assert_allclose(one, other, rtol=1e-9, atol=1e-11)
