"""Where a filter starts: levelling in closed form, alignment of a moving start, and refusals."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st
from lib.estimation.made import LEVER_ARM, Path, fixes_of, imu_of, ranges_of
from scipy.spatial.transform import Rotation
from scipy.stats import chi2

from inswsn_lib.errors import InswsnError
from inswsn_lib.estimation import (
    ImuNoise,
    InertialMotion,
    PositionFixes,
    RangesToAnchors,
    align,
    level,
)
from inswsn_lib.estimation.mechanization import GRAVITY
from inswsn_lib.streams import Fixes, Imu

NOISE = ImuNoise(0.02, 0.002, 1e-3, 1e-5)
RUNS = 8


@settings(max_examples=50, deadline=None)
@given(st.integers(0, 10**6), st.floats(-3, 3))
def test_a_body_at_rest_is_levelled(seed: int, heading: float) -> None:
    """Gravity's opposite is upwards in the frame, and the x axis has the heading."""
    attitude = Rotation.random(rng=np.random.default_rng(seed))
    force = np.tile(attitude.inv().apply([0.0, 0.0, GRAVITY]), (5, 1))
    found = level(Imu(np.arange(5.0), np.zeros((5, 3)), force), heading)
    assert found @ force[0] == pytest.approx([0.0, 0.0, GRAVITY], abs=1e-9)
    assert found @ found.T == pytest.approx(np.eye(3), abs=1e-9)
    assert np.linalg.det(found) == pytest.approx(1.0)
    ahead = found[:, 0]
    if np.hypot(*ahead[:2]) > 0.5:
        assert np.arctan2(ahead[1], ahead[0]) == pytest.approx(heading, abs=1e-6)


@pytest.fixture(scope="module")
def starts() -> list[tuple[Path, object]]:
    """Eight starts in motion, at up to 1.6 m/s, nothing of which is told."""
    made = []
    for seed in range(RUNS):
        rng, path = np.random.default_rng([3, seed]), Path(float(seed))
        biases = 0.05 * rng.standard_normal(3), 0.003 * rng.standard_normal(3)
        imu = imu_of(path, 11.0, rng, force=0.02, rate=0.002, biases=biases)
        count = len(np.arange(0.2, 11.0, 0.2))
        fixes = PositionFixes(
            fixes_of(path, 11.0, 0.05 * rng.standard_normal((count, 3))),
            LEVER_ARM,
            np.full(3, 0.05),
        )
        made.append((path, align(InertialMotion(imu, NOISE), [fixes], 0.0, 10.0)))
    return made


def test_a_moving_start_is_found_as_well_as_it_says(starts: list) -> None:
    """Position, velocity and attitude of eight starts: 72 numbers, false alarms of 1e-4."""
    total, headings = 0.0, []
    for path, start in starts:
        at = np.array(start.time)
        turn = (Rotation.from_matrix(start.state.attitude).inv() * path.attitude(at)).as_rotvec()
        error = np.concatenate(
            [
                path.position(at) - start.state.position,
                path.velocity(at) - start.state.velocity,
                turn,
            ]
        )
        total += error @ np.linalg.solve(start.covariance[:9, :9], error)
        headings.append(np.degrees(np.abs(turn).max()))
    assert chi2.ppf(5e-5, 9 * RUNS) < total < chi2.ppf(1 - 5e-5, 9 * RUNS)
    assert max(headings) < 10


def test_a_steady_motion_does_not_tell_the_heading() -> None:
    """At constant velocity nothing turns the specific force: any heading fits."""
    rng, t = np.random.default_rng(2), np.arange(0, 11, 0.01)
    imu = Imu(
        t,
        0.02 * rng.standard_normal((len(t), 3)),
        0.2 * rng.standard_normal((len(t), 3)) + [0, 0, GRAVITY],
    )
    times = np.arange(0.2, 11, 0.2)
    fixes = Fixes(
        times, np.outer(times, [8.0, 1.0, 0.0]) + 0.05 * rng.standard_normal((len(times), 3))
    )
    observed = [PositionFixes(fixes, np.zeros(3), np.full(3, 0.05))]
    with pytest.raises(InswsnError, match="The heading cannot be told between 0 and 10 s"):
        align(InertialMotion(imu, NOISE), observed, 0.0, 10.0)
    ranges = RangesToAnchors(ranges_of(Path(), 11.0, rng, 0.05), LEVER_ARM, 0.05)
    with pytest.raises(InswsnError, match="Ranges do not align an INS"):
        align(InertialMotion(imu, NOISE), [ranges], 0.0, 10.0)
    with pytest.raises(InswsnError, match="The IMU says nothing between 20 and 30 s"):
        align(InertialMotion(imu, NOISE), observed, 20.0, 30.0)
