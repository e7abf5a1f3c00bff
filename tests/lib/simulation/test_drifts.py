"""Drifts with one formula each: what the formula says, and the motion that makes some of them."""

from __future__ import annotations

import numpy as np
import pytest

from inswsn_lib.errors import ParameterError
from inswsn_lib.simulation import DRIFTS, draw_drift, draw_motion

RUNS, PERIOD = 40, 0.2
TIME = PERIOD * (np.arange(300) - 100)


def drawn(drift: str, runs: int = RUNS) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(DRIFTS.index(drift))
    motion = draw_motion(drift, TIME, rng, runs)
    return motion, draw_drift(drift, TIME, motion, rng)


@pytest.mark.parametrize("drift", DRIFTS)
def test_a_drift_has_its_shape_and_its_size(drift: str) -> None:
    motion, error = drawn(drift, 2000)
    assert motion.shape == error.shape == (300, 4, 2000)
    at_10 = error[150, :2] - error[0, :2]  # 30 s after the first sample
    stands = error[150, :2]
    # by the formulas: deviations in m, of offsets and of what comes after them
    walk = np.hypot(0.2 * 30, np.sqrt(0.8**2 / 20 * 30**3 / 3))
    wave = 0.8 * 30 / (2 * np.pi) * np.sqrt(2 * (1 - np.cos(2 * np.pi)))
    sizes = {
        "offset": 0.0,
        "step": 5.0,
        "steady": 0.8 * 30,
        "accelerating": np.hypot(0.2 * 30, 0.8 * 30**2 / 40),
        "oscillating": wave,
        "wandering": walk,
    }
    if drift in sizes:
        assert at_10.std() == pytest.approx(sizes[drift], rel=0.06, abs=1e-9)
    if drift in ("offset", "step"):
        assert stands.std() == pytest.approx(5.0 * (2**0.5 if drift == "step" else 1), rel=0.06)
        assert not error[:, 2:].any()


@pytest.mark.parametrize("drift", [d for d in DRIFTS if d != "step"])
def test_the_position_error_is_the_integral_of_the_velocity_error(drift: str) -> None:
    _, error = drawn(drift)
    middle = (error[1:, 2:] + error[:-1, 2:]) / 2
    # the rule of trapezoids: a third derivative of at most 0.8 (2 pi / 30 s)^2 m/s^3 or so
    assert np.diff(error[:, :2], axis=0) == pytest.approx(PERIOD * middle, abs=2e-4)


def test_a_step_is_one_and_in_the_training() -> None:
    _, error = drawn("step")
    moved = np.abs(np.diff(error[:, :2], axis=0)) > 0
    assert (moved.sum(axis=0) == 1).all()
    assert not moved[100:].any()
    assert (moved[:, 0] == moved[:, 1]).all()  # both axes at once


def test_a_vehicle_drives_at_its_speed_and_winds() -> None:
    motion, _ = drawn("turning")
    assert np.hypot(motion[:, 2], motion[:, 3]) == pytest.approx(np.full((300, RUNS), 7.5))
    heading = np.unwrap(np.arctan2(motion[:, 3], motion[:, 2]), axis=0)
    assert np.ptp(heading, axis=0) == pytest.approx(np.full(RUNS, 2.0), abs=0.01)
    assert heading[:200] == pytest.approx(heading[100:], abs=1e-9)  # of a period of 20 s


def test_the_first_turn_is_in_the_outage() -> None:
    motion, _ = drawn("first turn")
    heading = np.unwrap(np.arctan2(motion[:, 3], motion[:, 2]), axis=0)
    assert np.ptp(heading[:101], axis=0) == pytest.approx(np.zeros(RUNS), abs=1e-9)
    turned = heading[-1] - heading[0]
    assert np.abs(turned) == pytest.approx(np.full(RUNS, np.pi / 2))
    assert turned.min() < 0 < turned.max()
    # a quarter of a circle of 20 m takes 4.19 s at 7.5 m/s
    assert heading[100 + 20] != pytest.approx(heading[-1])
    assert heading[100 + 21] == pytest.approx(heading[-1])


@pytest.mark.parametrize("drift", ["turning", "first turn"])
def test_an_error_of_the_motion_is_a_linear_function_of_it(drift: str) -> None:
    motion, error = drawn(drift)
    for run in range(3):
        design = np.column_stack([motion[:, :, run], np.ones(len(motion))])
        found = np.linalg.lstsq(design, error[:, :, run], rcond=None)[0]
        assert design @ found == pytest.approx(error[:, :, run], abs=1e-8)
    # a turn and a stretch: the matrix [[k, -w], [w, k]], so v'e = k v'v and v x e = w v'v
    v, e = motion[:, 2:], error[:, 2:]
    stretch = (v * e).sum(axis=1) / 7.5**2
    turn = (v[:, 0] * e[:, 1] - v[:, 1] * e[:, 0]) / 7.5**2
    assert np.ptp(stretch, axis=0) == pytest.approx(np.zeros(RUNS), abs=1e-9)
    assert np.ptp(turn, axis=0) == pytest.approx(np.zeros(RUNS), abs=1e-9)
    assert stretch[0].std() == pytest.approx(0.03, rel=0.35)
    assert turn[0].std() == pytest.approx(0.1, rel=0.35)


def test_what_is_unknown_is_refused() -> None:
    rng = np.random.default_rng(0)
    with pytest.raises(ParameterError, match="drift"):
        draw_motion("sideways", TIME, rng, 2)
    with pytest.raises(ParameterError, match="drift"):
        draw_drift("sideways", TIME, np.zeros((300, 4, 2)), rng)
