"""Drifts with a shape: positions that are integrals of velocities, and variances in closed form."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given, strategies as st
from scipy.integrate import cumulative_simpson

from inswsn_lib.errors import ParameterError
from inswsn_lib.simulation.shapes import SHAPES, Shape, shaped_drift

TIME = np.linspace(0, 90, 3601)


def draw(shape: Shape, seed: int, **options: float) -> np.ndarray:
    return shaped_drift(shape, TIME, np.random.default_rng(seed), 6, **options)


@given(
    st.sampled_from(SHAPES), st.integers(0, 10**6), st.floats(0.01, 100), st.floats(5, 200)
)  # fmt: skip
def test_the_position_is_the_integral_of_the_velocity(
    shape: Shape, seed: int, size: float, cycle: float
) -> None:
    """By Simpson's rule, from the first position on."""
    drift = draw(shape, seed, size=size, cycle=cycle)
    assert drift.shape == (len(TIME), 4, 6)
    way = cumulative_simpson(drift[:, 2:], x=TIME, axis=0, initial=0)
    assert np.abs(drift[:, :2] - drift[0, :2] - way).max() < 1e-4 * size


def test_a_steady_velocity_does_not_change() -> None:
    velocity = draw("steady", 1)[:, 2:]
    assert np.array_equal(velocity, np.broadcast_to(velocity[0], velocity.shape))


def test_an_accelerating_velocity_is_on_a_straight_line() -> None:
    velocity = draw("accelerating", 2)[:, 2:]
    assert np.abs(np.diff(velocity, n=2, axis=0)).max() < 1e-12
    assert np.abs(np.diff(velocity, axis=0)).min() > 1e-6


@given(st.integers(0, 10**6), st.floats(5, 200))
def test_an_oscillating_velocity_obeys_the_oscillator(seed: int, cycle: float) -> None:
    """v(t + h) + v(t - h) = 2 cos(w h) v(t), the sum rule of the cosine."""
    velocity = draw("oscillating", seed, cycle=cycle)[:, 2:]
    step = 2 * np.pi / cycle * (TIME[1] - TIME[0])
    left = velocity[2:] + velocity[:-2] - 2 * np.cos(step) * velocity[1:-1]
    assert np.abs(left).max() < 1e-12


@pytest.mark.parametrize("shape", SHAPES)
def test_the_variances(shape: Shape) -> None:
    """20000 runs; each sample variance is within 5 of its standard deviations, sqrt(2/n) times it.

    Of 96 variances and as many means one leaves these bounds with a probability of 1e-4 at most,
    and with this seed none does.
    """
    runs, size, cycle = 20000, 2.0, 17.0
    t = np.array([0.0, 3.0, 8.5, 40.0])
    w = 2 * np.pi / cycle
    velocity, way = {
        "steady": (np.ones(4), t**2),
        "accelerating": (1 / 16 + t**2 / 400, t**2 / 16 + t**4 / 1600),
        "oscillating": (np.ones(4), 2 * (1 - np.cos(w * t)) / w**2),
    }[shape]
    rng = np.random.default_rng(20120707)
    drift = shaped_drift(shape, t, rng, runs, size=size, cycle=cycle)
    expected = np.stack([1 + size**2 * way] * 2 + [size**2 * velocity] * 2, axis=1)
    found = np.mean(drift**2, axis=2)  # the mean is 0
    assert found == pytest.approx(expected, rel=5 * np.sqrt(2 / runs))
    assert np.all(np.abs(drift.mean(axis=2)) < 5 * np.sqrt(expected / runs))
    # the axes are independent of one another, and so is the first position of the drift
    for one, other in ((0, 1), (2, 3), (0, 2), (1, 3)):
        assert abs(np.corrcoef(drift[0, one], drift[0, other])[0, 1]) < 5 / np.sqrt(runs)


@pytest.mark.parametrize("shape", SHAPES)
def test_the_same_stream_gives_the_same_drift(shape: Shape) -> None:
    assert np.array_equal(draw(shape, 3), draw(shape, 3))
    assert not np.array_equal(draw(shape, 3), draw(shape, 4))


@pytest.mark.parametrize("shape", SHAPES)
def test_the_size_is_that_of_the_drift_and_not_of_the_first_position(shape: Shape) -> None:
    one, three = draw(shape, 5), draw(shape, 5, size=3.0)
    assert np.array_equal(three[0, :2], one[0, :2])
    assert three[:, 2:] == pytest.approx(3 * one[:, 2:])
    assert three[:, :2] - three[0, :2] == pytest.approx(3 * (one[:, :2] - one[0, :2]))


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"shape": "jumping"}, "shape is 'jumping'"),
        ({"size": 0.0}, "size is 0.0"),
        ({"size": float("inf")}, "size is inf"),
        ({"cycle": -1.0}, "cycle is -1.0"),
        ({"cycle": float("nan")}, "cycle is nan"),
        ({"runs": 0}, "runs is 0"),
        ({"runs": 2.5}, "runs is 2.5"),
        ({"time": [[0.0, 1.0]]}, "time is 'of shape"),
        ({"time": [0.0, float("nan")]}, "time is 'of shape"),
    ],
)
def test_what_cannot_be_is_refused(change: dict[str, Any], said: str) -> None:
    given: dict[str, Any] = {
        "shape": "oscillating", "time": [0.0, 1.0], "rng": np.random.default_rng(1), "runs": 2,
    }  # fmt: skip
    with pytest.raises(ParameterError, match=said):
        shaped_drift(**given | change)
