"""Multilateration: exact without noise, unbiased with the covariance of theory, honest in gaps."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import assume, given, strategies as st
from scipy.optimize import least_squares

from inswsn_lib.errors import ParameterError
from inswsn_lib.simulation import Ranging, multilaterate, nodes_heard, position_covariance
from inswsn_lib.simulation.network import measure_ranges, node_grid

NODES = node_grid((0.0, 0.0), (150.0, 150.0), 5.0)
TRUTH = np.array([61.3, 72.9])
HEARD = nodes_heard(NODES, TRUTH, 11.0)


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
