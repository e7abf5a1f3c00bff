"""Where a filter starts: levelling in closed form, alignment of a moving start, and refusals."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st
from lib.inertial.made import LEVER_ARM, NOISE, Log, Path, fixes_of, motion_on, off_by, ranges_of
from scipy.spatial.transform import Rotation
from scipy.stats import chi2

from inswsn_lib import inertial as nav
from inswsn_lib.errors import InswsnError, ParameterError
from inswsn_lib.inertial.alignment import _steady
from inswsn_lib.inertial.mechanization import GRAVITY
from inswsn_lib.streams import Fixes, Imu

RUNS = 8


@settings(max_examples=50, deadline=None)
@given(st.integers(0, 10**6), st.floats(-3, 3))
def test_a_body_at_rest_is_levelled(seed: int, heading: float) -> None:
    """Gravity's opposite is upwards in the frame, and the x axis has the heading."""
    attitude = Rotation.random(rng=np.random.default_rng(seed))
    force = np.tile(attitude.inv().apply([0.0, 0.0, GRAVITY]), (5, 1))
    found = nav.level(Imu(np.arange(5.0), np.zeros((5, 3)), force), heading)
    assert found @ force[0] == pytest.approx([0.0, 0.0, GRAVITY], abs=1e-9)
    assert found @ found.T == pytest.approx(np.eye(3), abs=1e-9)
    assert np.linalg.det(found) == pytest.approx(1.0)
    ahead = found[:, 0]
    if np.hypot(*ahead[:2]) > 0.5:
        assert np.arctan2(ahead[1], ahead[0]) == pytest.approx(heading, abs=1e-6)


def test_a_moving_start_is_found_as_well_as_it_says() -> None:
    """Nothing is told of eight starts, at up to 1.6 m/s: 72 numbers, false alarms of 1e-4."""
    total, headings = 0.0, []
    for seed in range(RUNS):
        rng, path = np.random.default_rng([3, seed]), Path(float(seed))
        biases = np.array([[0.05], [0.003]]) * rng.standard_normal((2, 3))
        motion = motion_on(path, 11.0, rng, biases=biases)
        fixed = fixes_of(path, 11.0, 0.05 * rng.standard_normal((54, 3)))
        seen = [nav.PositionFixes(fixed, LEVER_ARM, np.full(3, 0.05))]
        start = nav.align(motion, seen, 0.0, 10.0)
        error = path.state(start.time).minus(start.state)[:9]
        total += error @ np.linalg.solve(start.covariance[:9, :9], error)
        headings.append(np.degrees(np.abs(error[6:]).max()))
    assert chi2.ppf(5e-5, 9 * RUNS) < total < chi2.ppf(1 - 5e-5, 9 * RUNS)
    assert max(headings) < 10


def test_a_steady_motion_does_not_tell_the_heading() -> None:
    """At constant velocity nothing turns the specific force: any heading fits."""
    rng, t = np.random.default_rng(2), np.arange(0, 11, 0.01)
    rate, force = np.array([[[0.02]], [[0.2]]]) * rng.standard_normal((2, len(t), 3))
    motion = nav.InertialMotion(Imu(t, rate, force + np.array([0, 0, GRAVITY])), NOISE)
    times = np.arange(0.2, 11, 0.2)
    track = np.outer(times, [8.0, 1.0, 0.0])
    fixes = Fixes(times, track + 0.05 * rng.standard_normal(track.shape))
    observed = [nav.PositionFixes(fixes, np.zeros(3), np.full(3, 0.05))]
    with pytest.raises(InswsnError, match="The heading cannot be told between 0 and 10 s"):
        nav.align(motion, observed, 0.0, 10.0)
    ranges = nav.RangesToAnchors(ranges_of(Path(), 11.0, rng, 0.05), LEVER_ARM, 0.05)
    with pytest.raises(InswsnError, match="Ranges do not align an INS"):
        nav.align(motion, [ranges], 0.0, 10.0)
    with pytest.raises(InswsnError, match="The IMU says nothing between 20 and 30 s"):
        nav.align(motion, observed, 20.0, 30.0)


def test_the_first_motion_tells_the_heading_or_the_user_does() -> None:
    """At rest for 25 s nothing tells the heading; who knows that it rests knows the biases, too."""
    log = Log(seed=5, rest=25.0, turns=True, velocities=True)
    motion, seen, attitude, biases = log.make()
    with pytest.raises(InswsnError, match="The heading cannot be told between 0 and 20 s"):
        nav.align(motion, seen, 0.0, 20.0)
    found = nav.align(motion, seen, 0.0, 20.0, latest=60.0)
    true = attitude(0.0).as_matrix()
    told = np.arctan2(true[1, 0], true[0, 0]) + 0.02, 0.03
    known = nav.known_start(motion.imu, 0.0, heading=told, rest=18.0)
    mine = nav.align(motion, seen, 18.0, 20.0, prior=known)
    for start in (found, mine):
        assert np.abs(off_by(start, attitude(start.time))).max() < 3.5
        sizes = np.sqrt(np.diag(start.covariance)[12:])
        assert (np.abs(start.state.rate_bias - biases[1]) < 3.5 * sizes).all()
    assert sizes.max() < 5e-4  # of 0.06 rad/s
    assert mine.time == pytest.approx(20.0, abs=0.3)


@pytest.mark.parametrize("seed", range(2))
def test_a_steady_spin_in_place_is_not_taken_for_rest(seed: int) -> None:
    """An IMU says then what it says at rest with another bias."""
    log = Log(seed, rest=20.0, turns=True, velocities=seed % 2 > 0, spin=0.05)
    motion, seen, attitude, _ = log.make()
    start = nav.align(motion, seen, 0.0, 40.0, latest=60.0)
    assert np.abs(off_by(start, attitude(start.time))).max() < 3.5


def test_rest_ends_where_the_clock_was_set() -> None:
    """However far: the work is that of the rows."""
    rng = np.random.default_rng(3)
    time = np.append(np.arange(0, 4, 0.01), 1e12)
    imu = Imu(time, rng.normal(size=(401, 3)), rng.normal(size=(401, 3)))
    assert _steady(imu) == _steady(imu.part(end=4)) == 4.0


def test_a_start_that_its_own_deviations_exclude_is_refused() -> None:
    motion, seen, _, biases = Log(seed=7, rest=0.0, turns=True, velocities=True).make()
    imu, fixes = motion.imu, seen[0].fixes
    small = (1000.0, 30.0, 2.0, 0.6, float(np.abs(biases[1]).max() / 6))
    with pytest.raises(InswsnError, match=r"bias of the gyroscopes of 0.0\d+ rad/s, which its"):
        nav.align(motion, seen, 0.0, 60.0, deviations=small)
    late = nav.PositionFixes(replace(fixes, time=fixes.time - 2.0), np.zeros(3), np.full(3, 0.5))
    with pytest.raises(InswsnError, match=r"misses measurements by \d+ times|not settled"):
        nav.align(motion, [late, *seen[1:]], 0.0, 60.0)
    degrees = replace(motion, imu=replace(imu, rate=np.degrees(imu.rate)))
    with pytest.raises(InswsnError, match="between 0 and 60 s"):
        nav.align(degrees, seen, 0.0, 60.0)


@pytest.mark.parametrize(
    ("known", "said"),
    [
        ({"attitude": (2 * np.eye(3), 0.1)}, "attitude must be a rotation matrix"),
        ({"heading": (0.0, -1.0)}, "deviation of the heading must be"),
        ({"rest": 0.5}, "rest must be a time with samples of the IMU before it, not 0.5"),
        ({"velocity": ([1.0, 2.0], 1.0)}, "velocity must be finite numbers of shape"),
    ],
)
def test_what_is_known_of_a_start_is_checked(known: dict, said: str) -> None:
    still = Imu(np.arange(3.0), np.zeros((3, 3)), np.tile([0.0, 0.0, GRAVITY], (3, 1)))
    with pytest.raises(ParameterError, match=said):
        nav.known_start(still, 0.0, **known)
    start = nav.known_start(still, 1.0, position=([1, 2, 3], 0.5), attitude=(np.eye(3), 0.1))
    assert start.state.position.tolist() == [1, 2, 3]
    assert np.diag(start.covariance)[[0, 6]] == pytest.approx([0.25, 0.01])
