"""Nodes, ranges and slopes by hand; multilateration exact without noise, else as theory says."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import assume, given, strategies as st
from scipy.optimize import least_squares

from inswsn_lib.errors import ParameterError
from inswsn_lib.simulation import (
    Path,
    Ranging,
    multilaterate,
    nodes_heard,
    position_covariance,
    velocity_slopes,
)
from inswsn_lib.simulation.network import measure_ranges, node_grid, slope_errors

NODES = node_grid((0.0, 0.0), (150.0, 150.0), 5.0)
TRUTH = np.array([61.3, 72.9])
HEARD = nodes_heard(NODES, TRUTH, 11.0)


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
    truth, heard, rng = TRUTH, HEARD, np.random.default_rng(11)
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


# Multilateration ----------------------------------------------------------------------------------


@given(
    st.lists(st.tuples(st.floats(-50, 50), st.floats(-50, 50)), min_size=4, max_size=12),
    st.floats(-40, 40), st.floats(-40, 40),
)  # fmt: skip
def test_without_noise_the_position_is_exact(
    nodes: list[tuple[float, float]], x: float, y: float
) -> None:
    points, truth = np.array(nodes), np.array([x, y])
    spread = np.linalg.svd(points - points.mean(axis=0), compute_uv=False)
    assume(spread[1] > 5)  # not on a line
    ranges = np.hypot(*(points - truth).T)[:, None]
    assume(ranges.min() > 0.1)
    assert multilaterate([points], [ranges])[0, :, 0] == pytest.approx(truth, abs=1e-5)


def test_it_is_the_minimum_that_another_solver_finds() -> None:
    rng = np.random.default_rng(5)
    ranges = measure_ranges(HEARD, TRUTH, Ranging(11.0, 2.0, dropout=0.3), rng, 40)
    (found,) = multilaterate([HEARD], [ranges])
    for run in range(40):
        there = ~np.isnan(ranges[:, run])

        def misses(p: np.ndarray, there: np.ndarray = there, run: int = run) -> np.ndarray:
            return ranges[there, run] - np.hypot(*(p - HEARD[there]).T)

        away = found[:, run] - HEARD[there]
        gradient = misses(found[:, run]) @ (away / np.hypot(*away.T)[:, None])
        assert gradient == pytest.approx([0, 0], abs=2e-5)
        peer = least_squares(misses, TRUTH, ftol=1e-14, xtol=1e-12, gtol=1e-12).x
        assert found[:, run] == pytest.approx(peer, abs=1e-3)


def test_it_is_unbiased_with_the_covariance_of_theory() -> None:
    """20,000 fixes; a true estimator leaves the bounds once in 10,000 times."""
    ranges = measure_ranges(HEARD, TRUTH, Ranging(11.0, 0.3), np.random.default_rng(9), 20_000)
    theory = position_covariance(HEARD, TRUTH, 0.3)
    error = multilaterate([HEARD], [ranges])[0] - TRUTH[:, None]
    # second-order bias is of the order noise^2 / distance, below 0.3^2 / 5 / nodes
    bounds = 3.9 * np.sqrt(np.diag(theory) / 20_000) + 0.002
    assert (np.abs(error.mean(axis=1)) < bounds).all()
    assert np.cov(error) == pytest.approx(
        theory, abs=3.9 * theory.max() * (2 / 20_000) ** 0.5 * 1.2
    )


def test_lost_ranges_are_left_out_and_two_are_no_fix() -> None:
    ranges = measure_ranges(HEARD, TRUTH, Ranging(11.0, 0.3), np.random.default_rng(10), 50)
    lost = ranges.copy()
    lost[4:] = np.nan
    alone = multilaterate([HEARD[:4]], [ranges[:4]])
    assert multilaterate([HEARD], [lost]) == pytest.approx(alone)
    three, two = np.array([[0.0, 0.0], [5.0, 0.0], [0.0, 5.0]]), [[5.0], [np.nan], [5.0]]
    assert np.isfinite(multilaterate([three], [[[5.0], [4.0], [5.0]]])).all()
    assert np.isnan(multilaterate([three], [two])).all()


def test_nodes_on_a_line_give_no_position() -> None:
    nodes = np.array([(0.0, 0.0), (5.0, 0.0), (10.0, 0.0)])
    ranges = np.hypot(*(nodes - [3.0, 4.0]).T)[:, None]
    assert np.isnan(multilaterate([nodes], [ranges])).all()
    assert np.isfinite(multilaterate([nodes + np.array([[0, 0], [0, 2], [0, 0]])], [ranges])).all()


def test_outliers_send_no_fix_to_infinity() -> None:
    ranging = Ranging(reach=11.0, noise=0.38, dropout=0.5, outlier=0.3, outlier_scale=20.0)
    ranges = measure_ranges(HEARD, TRUTH, ranging, np.random.default_rng(15), 5000)
    (fixes,) = multilaterate([HEARD], [ranges])
    found = ~np.isnan(fixes).any(axis=0)
    assert found.mean() > 0.9

    # no fix costs more than the truth does, but where it is stuck in a local minimum
    def cost(points: np.ndarray) -> np.ndarray:
        distances = np.hypot(*np.moveaxis(points[None] - HEARD[:, :, None], 1, 0))
        return np.nansum((ranges - distances) ** 2, axis=0)

    worse = cost(fixes)[found] > cost(TRUTH[:, None])[found] * (1 + 1e-9)
    assert worse.mean() < 0.02
    assert np.abs(fixes[:, found] - TRUTH[:, None]).max() < 500


@pytest.mark.parametrize("runs", [1, 2, 400])
def test_many_places_at_once_are_those_one_by_one(runs: int) -> None:
    """To the last bit, but for one run, of which NumPy takes sums in another order.

    In places that hear few nodes, many, none, and with ranges lost or late.
    """
    rng = np.random.default_rng(16)
    ranging = Ranging(reach=11.0, noise=0.38, dropout=0.3, outlier=0.2, outlier_scale=20.0)
    # by the edges of the grid fewer are heard, beyond them none
    places = [*rng.uniform(0.0, 150.0, (20, 2)), np.zeros(2), np.array([75.0, 200.0])]
    heard = [nodes_heard(NODES, place, ranging.reach) for place in places]
    ranges = [
        measure_ranges(nodes, place, ranging, rng, runs)
        for nodes, place in zip(heard, places, strict=True)
    ]
    found = multilaterate(heard, ranges)
    alone = [multilaterate([n], [lengths])[0] for n, lengths in zip(heard, ranges, strict=True)]
    if runs > 1:
        assert found.tobytes() == np.array(alone).tobytes()
    np.testing.assert_allclose(found, alone, rtol=0, atol=1e-5)
    assert not np.isnan(found[:-1]).all(axis=(1, 2)).any()
    assert np.isnan(found[-1]).all()
    assert multilaterate([], []).shape == (0, 2, 0)


@pytest.mark.parametrize(
    ("nodes", "ranges", "said"),
    [
        ([(3, 2)], [(3, 5), (3, 5)], "ranges must be of 1 places, as nodes are"),
        ([(3, 2)], [(4, 5)], r"ranges must be .* of shape \(3,\) or \(3, runs\)"),
        ([(3, 2)] * 2, [(3, 5), (3, 4)], r"ranges .*NaN .* \(3, 5\), not of shape \(3, 4\)"),
        ([(3, 3)], [(3, 5)], r"nodes .* not of shape \(3, 3\)"),
    ],
)
def test_places_that_do_not_fit_are_refused(
    nodes: list[tuple[int, ...]], ranges: list[tuple[int, ...]], said: str
) -> None:
    with pytest.raises(ParameterError, match=f"^{said}"):
        multilaterate(list(map(np.ones, nodes)), list(map(np.ones, ranges)))


def test_the_covariance_of_directions_by_hand() -> None:
    """Directions along the axes: each coordinate by one range, or by two, however far away."""
    nodes = np.array([[10.0, 0.0], [0.0, 3.0], [-7.0, 0.0], [0.0, -1.0]])
    assert position_covariance(nodes[:2], np.zeros(2), 0.2) == pytest.approx(0.04 * np.eye(2))
    assert position_covariance(nodes, np.zeros(2), 0.2) == pytest.approx(0.02 * np.eye(2))
    # two directions 60 degrees apart: information [[1.25, s], [s, 0.75]], s = 3^(1/2) / 4
    slanted = np.array([[1.0, 0.0], [0.5, 3**0.5 / 2]])
    expected = np.linalg.inv([[1.25, 3**0.5 / 4], [3**0.5 / 4, 0.75]])
    assert position_covariance(slanted, np.zeros(2), 1.0) == pytest.approx(expected)


@pytest.mark.parametrize("nodes", [
    np.empty((0, 2)), [[1.0, 0.0]], [[1.0, 0.0], [2.0, 0.0]], [[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]]
])  # fmt: skip
def test_nodes_that_fix_no_position_have_no_covariance(nodes: np.ndarray) -> None:
    with pytest.raises(ParameterError, match="nodes must be"):
        position_covariance(np.asarray(nodes), np.zeros(2), 0.1)
