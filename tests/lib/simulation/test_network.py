"""Nodes, ranges and slopes: by hand, and as often as asked."""

from __future__ import annotations

import numpy as np
import pytest

from inswsn_lib.errors import ParameterError
from inswsn_lib.simulation import Path, Ranging, nodes_heard, velocity_slopes
from inswsn_lib.simulation.network import measure_ranges, node_grid, slope_errors

NODES = node_grid((0.0, 0.0), (150.0, 150.0), 5.0)


def test_a_grid_by_hand_and_that_of_p1() -> None:
    assert node_grid((0.0, 10.0), (10, 5), 5).tolist() == [
        [0, 10], [5, 10], [10, 10], [0, 15], [5, 15], [10, 15]
    ]  # fmt: skip
    assert len(node_grid((0, 0), (0.6, 0.3), 0.1)) == 7 * 4  # 6 times 0.1 is more than 0.6
    assert len(NODES) == 31 * 31  # 150 m by 5 m, edges included
    counts = {len(nodes_heard(NODES, np.array([60 + a, 60 + b]), 11.0))
              for a in np.linspace(0, 5, 21) for b in np.linspace(0, 5, 21)}  # fmt: skip
    assert counts == {13, 14, 15, 16, 17}
    assert nodes_heard(NODES, np.array([0.0, 3.0]), 3.0).tolist() == [[0, 0], [0, 5]]


@pytest.mark.parametrize("spacing", [0.0, -1.0, 0.01])
def test_a_spacing_that_cannot_be(spacing: float) -> None:
    with pytest.raises(ParameterError, match="spacing must be"):
        node_grid((0, 0), (10, 10), spacing)
    assert len(node_grid((0, 0), (10, 10), 0.05)) == 201**2


def test_nothing_is_lost_or_late_unless_told() -> None:
    assert Ranging(1.0, 0.0) == Ranging(1.0, 0.0, dropout=0, outlier=0, outlier_scale=0)


def test_noise_dropouts_and_outliers_come_as_often_and_as_large_as_asked() -> None:
    """True ones leave the bounds once in 10,000 times."""
    truth, rng = np.array([61.3, 72.9]), np.random.default_rng(11)
    heard = nodes_heard(NODES, truth, 11.0)
    ranging = Ranging(reach=11.0, noise=0.01, dropout=0.2, outlier=0.1, outlier_scale=5.0)
    excess = measure_ranges(heard, truth, ranging, rng, 5000) - np.linalg.norm(
        heard - truth, axis=1
    ).reshape(-1, 1)
    assert np.isnan(excess).mean() == pytest.approx(0.2, abs=3.9 * (0.16 / excess.size) ** 0.5)
    there = excess[~np.isnan(excess)]
    late = there > 0.1
    assert late.mean() == pytest.approx(
        0.1 * np.exp(-0.1 / 5), abs=4.5 * (0.09 / there.size) ** 0.5
    )
    # late, never early; an exponential beyond a bound is exponential from there on
    assert there[late].mean() == pytest.approx(5.1, abs=3.9 * 5 / late.sum() ** 0.5)
    assert there[~late].std() == pytest.approx(0.01, rel=0.2)
    assert there.min() > -0.06
    # with outliers and without, the noise is the same
    a, b = (
        measure_ranges(heard, truth, Ranging(11.0, 0.3, outlier=share), np.random.default_rng(1), 9)
        for share in (0.0, 1.0)
    )
    assert np.array_equal(a, b)  # outliers of no size


def test_a_slope_is_that_of_the_line_of_least_squares() -> None:
    positions = np.random.default_rng(2).standard_normal((9, 2, 3))
    found = velocity_slopes(positions, 0.2, 4)
    assert np.isnan(found[:3]).all()
    for k in range(3, 9):
        for axis in (0, 1):
            slope, _ = np.polyfit(0.2 * np.arange(4), positions[k - 3 : k + 1, axis], 1)
            assert found[k, axis] == pytest.approx(slope, abs=1e-12)
    with pytest.raises(ParameterError, match=r"velocity_fixes .* not 1"):
        velocity_slopes(positions, 0.2, 1)


def test_errors_of_slopes_are_those_of_the_fixes_and_of_the_bend() -> None:
    """Exact fixes on a circle of 5 m: the slope is the chord's, the truth half a period ahead."""
    motion = Path.through([(0, 0), (9, 0), (9, 9)], 5.0).drive(1.0, 0.1 * np.arange(200))
    errors = np.random.default_rng(3).standard_normal((200, 2, 4))
    found = slope_errors(errors, motion, 0.1, 2)
    bent = slope_errors(np.zeros((200, 2, 1)), motion, 0.1, 2)
    assert found[1:] - bent[1:] == pytest.approx((errors[1:] - errors[:-1]) / 0.1)
    # two unit vectors, but for the shortness of the chord, 0.01 rad apart
    bend = (motion.time > 4.11) & (motion.time < 4 + 5 * np.pi / 2)
    assert np.hypot(*bent[bend, :, 0].T) == pytest.approx(0.1 / 5 / 2, rel=1e-3)
    assert np.abs(bent[1:40]).max() < 1e-9
