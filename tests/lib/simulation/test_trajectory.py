"""Paths against geometry."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from inswsn_lib.errors import ParameterError
from inswsn_lib.simulation import Path

CORNERS = [(650.0, 0.0), (500.0, 100.0), (300.0, 90.0), (130.0, 400.0)]


def test_a_quarter_turn_by_hand() -> None:
    path = Path.through([(0.0, 0.0), (20.0, 0.0), (20.0, 30.0)], radius=10.0)
    assert path.length == pytest.approx(10 + 10 * np.pi / 2 + 20)
    motion = path.drive(2.0, [0.0, 5.0, 5.0 + 2.5 * np.pi / 2, 5 + 2.5 * np.pi, 10 + 2.5 * np.pi])
    assert motion.position == pytest.approx(
        np.array([
            (0, 0), (10, 0), (10 + 10 / 2**0.5, 10 - 10 / 2**0.5), (20, 10), (20, 20)
        ])
    )  # fmt: skip
    assert motion.heading == pytest.approx([0, 0, np.pi / 4, np.pi / 2, np.pi / 2])
    # the other way round
    right = Path.through([(0.0, 0.0), (20.0, 0.0), (20.0, -30.0)], radius=10.0)
    assert right.drive(2.0, motion.time).position == pytest.approx(motion.position * [1, -1])


def test_it_starts_and_ends_where_it_should_at_its_speed() -> None:
    path = Path.through(CORNERS, 20.0)
    motion = path.drive(7.5, np.linspace(0, path.length / 7.5, 4001))
    assert motion.position[0] == pytest.approx(CORNERS[0])
    assert motion.position[-1] == pytest.approx(CORNERS[-1])
    assert np.hypot(*motion.velocity.T) == pytest.approx(7.5)
    # velocity is the derivative of position, and heading its direction
    moved = np.diff(motion.position, axis=0) / motion.time[1]
    assert moved == pytest.approx((motion.velocity[1:] + motion.velocity[:-1]) / 2, abs=2e-2)
    assert np.exp(1j * motion.heading) * 7.5 == pytest.approx(motion.velocity @ [1, 1j])
    assert np.abs(np.diff(motion.heading)).max() < 0.01  # no jump by a turn


def test_it_goes_straight_on_after_its_end() -> None:
    path = Path.through([(0.0, 0.0), (3.0, 4.0)], 1.0)
    assert path.drive(1.0, [10.0]).position[0] == pytest.approx((6.0, 8.0))


@pytest.mark.parametrize(
    ("points", "radius", "said"),
    [
        ([(0, 0)], 1.0, "waypoints must be .*at least two points"),
        ([(0, 0, 0), (1, 0, 0)], 1.0, "waypoints"),
        ([(0, 0), (1, 0)], 0.0, "radius"),
        ([(0, 0), (10, 0), (10, 10)], 10.1, "small enough for arcs to fit"),
    ],
)
def test_paths_that_cannot_be(points: list[Any], radius: float, said: str) -> None:
    with pytest.raises(ParameterError, match=said):
        Path.through(points, radius)
    assert Path.through([(0, 0), (10, 0), (10, 10)], 9.9).lengths[0] == pytest.approx(0.1)


@pytest.mark.parametrize(("speed", "time"), [(0.0, [0.0]), (1.0, [0.0, -0.1]), (1.0, [[0.0]])])
def test_drives_that_cannot_be(speed: float, time: list[Any]) -> None:
    with pytest.raises(ParameterError, match="speed must be" if speed == 0 else "time must be"):
        Path.through([(0, 0), (1, 0)], 1.0).drive(speed, time)
