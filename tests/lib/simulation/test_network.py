"""Multilateration: exact without noise, unbiased with the covariance of theory, honest in gaps."""

from __future__ import annotations

import re

import numpy as np
import pytest
from hypothesis import assume, given, strategies as st

from inswsn_lib.errors import ParameterError
from inswsn_lib.simulation import (
    Ranging,
    measure_ranges,
    multilaterate,
    multilaterate_each,
    node_grid,
    nodes_heard,
    position_covariance,
)

NODES = node_grid((0.0, 0.0), (150.0, 150.0), 5.0)


def test_the_grid_of_p1() -> None:
    assert len(NODES) == 31 * 31  # 150 m by 5 m, edges included
    assert len(node_grid((0, 0), (100, 100), 5.0)) == 21 * 21
    counts = {len(nodes_heard(NODES, np.array([60 + a, 60 + b]), 11.0))
              for a in np.linspace(0, 5, 21) for b in np.linspace(0, 5, 21)}  # fmt: skip
    assert counts == {13, 14, 15, 16, 17}


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
    assert multilaterate(points, ranges)[:, 0] == pytest.approx(truth, abs=1e-5)


def test_it_is_unbiased_with_the_covariance_of_theory() -> None:
    """20,000 fixes; a true estimator leaves the bounds once in 10,000 times."""
    truth, rng = np.array([61.3, 72.9]), np.random.default_rng(9)
    heard = nodes_heard(NODES, truth, 11.0)
    ranging = Ranging(reach=11.0, noise=0.3)
    fixes = multilaterate(heard, measure_ranges(heard, truth, ranging, rng, 20_000))
    theory = position_covariance(heard, truth, 0.3)
    error = fixes - truth[:, None]
    # second-order bias is of the order noise^2 / distance, below 0.3^2 / 5 / nodes
    bounds = 3.9 * np.sqrt(np.diag(theory) / 20_000) + 0.002
    assert (np.abs(error.mean(axis=1)) < bounds).all()
    assert np.cov(error) == pytest.approx(
        theory, abs=3.9 * theory.max() * (2 / 20_000) ** 0.5 * 1.2
    )


def test_lost_ranges_are_left_out() -> None:
    truth, rng = np.array([61.3, 72.9]), np.random.default_rng(10)
    heard = nodes_heard(NODES, truth, 11.0)
    ranges = measure_ranges(heard, truth, Ranging(reach=11.0, noise=0.3), rng, 50)
    lost = ranges.copy()
    lost[4:] = np.nan
    assert multilaterate(heard, lost) == pytest.approx(multilaterate(heard[:4], ranges[:4]))
    lost[2:] = np.nan
    assert np.isnan(multilaterate(heard, lost)).all()


def test_nodes_on_a_line_give_no_position() -> None:
    nodes = np.array([(0.0, 0.0), (5.0, 0.0), (10.0, 0.0)])
    ranges = np.hypot(*(nodes - [3.0, 4.0]).T)[:, None]
    assert np.isnan(multilaterate(nodes, ranges)).all()


def test_outliers_send_no_fix_to_infinity() -> None:
    truth, rng = np.array([61.3, 72.9]), np.random.default_rng(15)
    heard = nodes_heard(NODES, truth, 11.0)
    ranging = Ranging(reach=11.0, noise=0.38, dropout=0.5, outlier=0.3, outlier_scale=20.0)
    ranges = measure_ranges(heard, truth, ranging, rng, 5000)
    fixes = multilaterate(heard, ranges)
    found = ~np.isnan(fixes).any(axis=0)
    assert found.mean() > 0.9

    # no fix costs more than the truth does, but where it is stuck in a local minimum
    def cost(points: np.ndarray) -> np.ndarray:
        distances = np.hypot(*np.moveaxis(points[None] - heard[:, :, None], 1, 0))
        return np.nansum((ranges - distances) ** 2, axis=0)

    worse = cost(fixes)[found] > cost(truth[:, None])[found] * (1 + 1e-9)
    assert worse.mean() < 0.02
    assert np.abs(fixes[:, found] - truth[:, None]).max() < 500


@pytest.mark.parametrize("runs", [1, 2, 3, 400])
def test_many_places_at_once_are_those_one_by_one(runs: int) -> None:
    """To the last bit, but for one run.

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
    found = multilaterate_each(heard, ranges)
    alone = [multilaterate(nodes, lengths) for nodes, lengths in zip(heard, ranges, strict=True)]
    if runs > 1:
        assert found.tobytes() == np.array(alone).tobytes()
    np.testing.assert_allclose(found, alone, rtol=0, atol=1e-5)
    assert not np.isnan(found[:-1]).all(axis=(1, 2)).any()
    assert np.isnan(found[-1]).all()


def test_no_place_has_no_fix() -> None:
    assert multilaterate_each([], []).shape == (0, 2, 0)


@pytest.mark.parametrize(
    ("nodes", "ranges", "said"),
    [
        ([(3, 2)], [(3, 5), (3, 5)], "ranges is 'of 2 places'; it may be of 1, as the nodes."),
        ([(3, 2)], [(4, 5)], "ranges is 'of shape (4, 5)'; it may be (3, 5), a row for each node."),
        ([(3, 2)] * 2, [(3, 5), (3, 4)], "ranges is 'of shape (3, 4)'; it may be (3, 5), a row"),
        ([(3, 2)], [(3,)], "ranges is 'of shape (3,)'; it may be (3, runs), a row for each node."),
        ([(3, 3)], [(3, 5)], "nodes is 'of shape (3, 3)'; it may be (heard, 2)."),
    ],
)
def test_places_that_do_not_fit_are_refused(
    nodes: list[tuple[int, ...]], ranges: list[tuple[int, ...]], said: str
) -> None:
    with pytest.raises(ParameterError, match=f"^{re.escape(said)}"):
        multilaterate_each(list(map(np.ones, nodes)), list(map(np.ones, ranges)))


def test_dropouts_and_outliers_come_as_often_as_asked() -> None:
    truth, rng = np.array([61.3, 72.9]), np.random.default_rng(11)
    heard = nodes_heard(NODES, truth, 11.0)
    ranging = Ranging(reach=11.0, noise=0.01, dropout=0.2, outlier=0.1, outlier_scale=5.0)
    ranges = measure_ranges(heard, truth, ranging, rng, 5000)
    lost = np.isnan(ranges).mean()
    late = (ranges - np.hypot(*(heard - truth).T)[:, None] > 0.1)[~np.isnan(ranges)].mean()
    count = ranges.size
    assert lost == pytest.approx(0.2, abs=3.9 * (0.16 / count) ** 0.5)
    assert late == pytest.approx(0.1 * np.exp(-0.1 / 5), abs=4.5 * (0.09 / count) ** 0.5)


def test_a_spacing_that_cannot_be() -> None:
    with pytest.raises(ParameterError, match="spacing"):
        node_grid((0, 0), (10, 10), 0.0)


@pytest.mark.parametrize(
    "nodes",
    [
        np.empty((0, 2)),
        [[1.0, 0.0]],
        [[1.0, 0.0], [2.0, 0.0]],
        [[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]],
    ],
)
def test_nodes_that_fix_no_position_have_no_covariance(nodes: np.ndarray) -> None:
    with pytest.raises(ParameterError, match="nodes is"):
        position_covariance(np.asarray(nodes), np.zeros(2), 0.1)
