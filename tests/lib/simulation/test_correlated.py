"""Errors of fixes that are correlated over time, and those of nodes, against what was asked."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, strategies as st

from inswsn_lib.evaluation import monte_carlo
from inswsn_lib.navigation import ClusterFusion, TrainingAreas
from inswsn_lib.simulation import coloured


@given(st.floats(0.05, 2.0), st.floats(0.05, 20.0))
def test_variance_is_kept_and_autocorrelation_is_that_of_gauss_markov(
    period: float, time: float
) -> None:
    """20,000 runs: the standard error of a correlation is below 0.0071, 5 of them are allowed."""
    white = np.random.default_rng(7).standard_normal((6, 1, 20_000))
    e = coloured(white, period, time)[:, 0]
    for lag in range(6):
        found = np.mean(e[0] * e[lag])
        assert found == pytest.approx(np.exp(-lag * period / time), abs=0.05)
        assert np.mean(e[lag] ** 2) == pytest.approx(1.0, abs=0.05)


def test_white_stays_as_it_is_and_a_gap_counts_as_time() -> None:
    rng = np.random.default_rng(8)
    white = rng.standard_normal((4, 2, 50_000))
    assert np.array_equal(coloured(white, 0.2, 0.0), white)
    white[1:3] = np.nan
    e = coloured(white, 1.0, 5.0)
    assert np.isnan(e[1:3]).all()
    assert np.mean(e[0] * e[3]) == pytest.approx(np.exp(-3 / 5), abs=0.03)


def lagged(errors: np.ndarray, lag: int) -> float:
    """Return the autocorrelation at a lag, over steps and runs; NaN left out."""
    ahead, behind = errors[lag:], errors[: len(errors) - lag]
    return float(np.nanmean(ahead * behind) / np.nanmean(errors**2))


@pytest.mark.parametrize("time", [0.5, 2.0])
def test_the_scene_of_p1_has_the_autocorrelation_asked_for(time: float) -> None:
    """Of fixes and of velocities, at 0.2, 0.6 and 1 s; 300 runs, allowed 0.03."""
    scene = TrainingAreas(correlation_time=time).scene
    found = monte_carlo(scene.simulate, 300, 1)["wsn.area1"]
    white = monte_carlo(TrainingAreas().scene.simulate, 300, 1)["wsn.area1"]
    for rows in (slice(0, 2), slice(2, 4)):
        for lag in (1, 3, 5):
            asked = np.exp(-lag * 0.2 / time)
            assert lagged(found[:, rows], lag) == pytest.approx(asked, abs=0.03)
        assert abs(lagged(white[:, rows], 1)) < 0.02
        assert np.mean(found[:, rows] ** 2) == pytest.approx(np.mean(white[:, rows] ** 2), rel=0.06)


def test_the_scene_of_p2_has_the_autocorrelation_asked_for() -> None:
    found = ClusterFusion(runs=100, correlation_time=1.0, velocity_source="sensor").drawn["wsn"]
    for lag in (5, 25, 50):
        for rows in (slice(0, 2), slice(2, 4)):
            asked = np.exp(-lag * 0.02 / 1.0)
            assert lagged(found[2][:, rows], lag) == pytest.approx(asked, abs=0.06)


def test_a_bias_of_nodes_keeps_the_variance_and_makes_fixes_alike_that_share_nodes() -> None:
    """A node is heard for 3 s at most: fixes of adjacent steps share most nodes, after 5 s none."""
    runs = {
        share: monte_carlo(TrainingAreas(node_bias=share).scene.simulate, 300, 2)["wsn.area1"]
        for share in (0.0, 0.5, 1.0)
    }
    size = {share: np.mean(e[:, :2] ** 2) for share, e in runs.items()}
    assert size[1.0] == pytest.approx(size[0.0], rel=0.1)
    near = [lagged(e[:, :2], 1) for e in runs.values()]
    assert abs(near[0]) < 0.03
    assert near[1] > 0.3
    assert near[1] == pytest.approx(near[2] / 2, rel=0.1)
    assert abs(lagged(runs[1.0][:, :2], 25)) < 0.05
    assert abs(lagged(runs[1.0][:, 2:], 1)) < 0.02  # a sensor's velocities know no node
