"""The scene of P2: its clusters, its fixes and velocities, and what it refuses."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from itertools import combinations
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from inswsn_lib.errors import ParameterError
from inswsn_lib.scenario import from_settings, load_scenario, with_values
from inswsn_lib.simulation import ClusterScene, multilaterate

Build = Callable[..., ClusterScene]
Array = np.ndarray

# a path on which nothing turns: headed by the angle of the triangle 3, 4, 5, for 10 s
STRAIGHT = {"waypoints": [[9, 8], [45, 35]], "speed": 4.5, "period": 0.1}
# almost at rest, where the first and the third cluster have fixes: 21 samples
STILL = {"waypoints": [[20, 18], [20.02, 18]], "speed": 0.01, "period": 0.1}


@pytest.fixture(scope="module")
def build(root: Path) -> Build:
    settings = load_scenario(root / "data/scenarios/p2.yaml")
    return lambda **values: from_settings(ClusterScene, with_values(settings, **values))


@pytest.fixture(scope="module")
def scene(build: Build) -> ClusterScene:
    return build()


def whitened(errors: Array, covariance: Array) -> Array:
    """Errors (2, runs) in units of the covariance: standard normal if it is theirs."""
    return np.linalg.solve(np.linalg.cholesky(covariance), errors)


def is_standard_normal(errors: Array, slack: float = 0.0) -> bool:
    """Whether mean and covariance are 0 and 1; wrong for true ones 4 times in 100,000."""
    runs = errors.shape[1]
    off = np.cov(errors) - np.eye(2)
    return bool(
        (np.abs(errors.mean(axis=1)) < 4.5 / runs**0.5).all()
        and (np.abs(off) < 4.5 * (2 / runs) ** 0.5 + slack).all()
    )


def span_a_triangle(nodes: Array) -> bool:
    """Whether some three of the nodes are the corners of a triangle that has an area."""
    return any(
        abs((b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])) > 1e-6
        for a, b, c in combinations(nodes.tolist(), 3)
    )


def test_the_network_of_p2(scene: ClusterScene) -> None:
    assert len(scene.nodes) == 10 * 7  # 63 m by 42 m, 7 m apart
    for (x, y), label in zip(scene.nodes, scene.labels, strict=True):
        assert label == (2 if y > 17.5 else 0 if x < 31.5 else 1)
    # the third cluster and the whole have an even number of columns: the first of equals
    assert scene.nodes[scene.heads].tolist() == [[14, 7], [49, 7], [28, 28]]
    assert scene.nodes[scene.centre].tolist() == [28, 21]
    traces = np.trace(scene.fix_covariance, axis1=2, axis2=3)
    assert np.sqrt(np.nanmean(traces)) == pytest.approx(0.2, rel=0.1)


def test_which_nodes_belong_to_a_cluster(build: Build) -> None:
    scene = build(size=[28, 7], clusters=[[0, 7, 0, 7], [14, 21, 0, 7]])
    assert scene.labels.tolist() == [0, 0, 1, 1, -1] * 2  # the one that holds it, or none
    with pytest.raises(ParameterError, match="no node in common, not 4 of them in two or more"):
        _ = build(size=[28, 7], clusters=[[0, 7, 0, 7], [0, 21, 0, 7]]).labels
    # those on the edge, however they are rounded: 3 times 0.1 is more than 0.3
    scene = build(
        size=[0.6, 0.1], spacing=0.1, clusters=[[0, 0.3, 0, 0.1], [0.4, 0.6, 0, 0.1]], reach=1
    )
    assert scene.labels.tolist() == [0, 0, 0, 0, 1, 1, 1] * 2
    first = [0, 28, 0, 14]
    assert (build(clusters=[first, [35, 49, 0, 0]]).labels == 1).sum() == 3
    for few, said in (([35, 42, 0, 0], 2), ([49, 35, 0, 14], 0)):
        with pytest.raises(ParameterError, match=rf"clusters .* not {said}"):
            _ = build(clusters=[first, few]).labels


def test_the_path_takes_its_time(build: Build, scene: ClusterScene) -> None:
    # three legs, of which the arcs at the two corners cut little off
    legs, turn = 2 * math.hypot(13, 9.5) + 19, math.atan2(9.5, 13)
    length = legs - 2 * 5 * (2 * math.tan(turn / 2) - turn)
    assert len(scene.motion.time) == int(length / 2.4 / 0.02) + 1
    assert scene.motion.position[-1] == pytest.approx([54, 8], abs=2.4 * 0.02)
    # the end is a sample however it is rounded: 0.3 / 0.1 is less than 3
    short = build(waypoints=[[0, 0], [0.3, 0]], speed=1, period=0.1)
    assert short.motion.position[:, 0] == pytest.approx([0, 0.1, 0.2, 0.3])
    for period in (1e-9, 30.0):
        with pytest.raises(ParameterError, match=r"period must be .* 2 to 100000 samples"):
            _ = build(period=period).motion


def test_a_bias_of_the_body_grows_as_in_closed_form(build: Build) -> None:
    scene = build(
        **STRAIGHT, accelerometer_bias=[0.1, -0.05], accelerometer_noise=0, position=[1, 2],
        velocity=[0.3, -0.1],
    )  # fmt: skip
    ins = scene.simulate(np.random.default_rng(1), 2)["ins"]
    t = scene.motion.time[:, None]
    bias = np.array([0.8 * 0.1 + 0.6 * 0.05, 0.6 * 0.1 - 0.8 * 0.05])
    moved = np.array([1, 2]) + np.array([0.3, -0.1]) * t + bias * t**2 / 2
    assert len(t) == 101
    for run in range(2):
        assert ins[:, :2, run] == pytest.approx(moved, abs=1e-9)
        assert ins[:, 2:, run] == pytest.approx(np.array([0.3, -0.1]) + bias * t, abs=1e-9)


def test_fixes_are_exact_without_noise_and_where_single_steps_have_one(build: Build) -> None:
    scene = build(period=0.1, noise=0)
    fixes = scene.simulate(np.random.default_rng(3), 1)["fixes"]
    there = ~np.isnan(fixes).any(axis=(2, 3))
    assert np.array_equal(there, ~np.isnan(scene.fix_covariance).any(axis=(2, 3)))
    assert 0.2 < there.mean() < 0.8
    for c in range(3):
        for k in range(0, len(scene.motion.time), 7):
            place = scene.motion.position[k]
            mine = [n for n, label in zip(scene.nodes, scene.labels, strict=True) if label == c]
            nodes = [node for node in mine if math.dist(node, place) <= 12]
            assert there[c, k] == span_a_triangle(np.array(nodes))
            if there[c, k]:
                ranges = [[math.dist(node, place)] for node in nodes]
                alone = multilaterate([nodes], [ranges])[0] - place[:, None]
                assert fixes[c, k] == pytest.approx(alone, abs=1e-6)
                assert fixes[c, k] == pytest.approx(0, abs=1e-6)


def test_fixes_are_unbiased_with_the_covariance_of_theory_and_independent(build: Build) -> None:
    """10,000 runs, some 17 fixes; true ones leave the bounds once in 1,000 times."""
    scene = build(period=2, noise=0.002)  # so small that the first order is all
    fixes = scene.simulate(np.random.default_rng(4), 10_000)["fixes"]
    there = ~np.isnan(scene.fix_covariance).any(axis=(2, 3))
    assert there.sum() > 10
    for c, k in zip(*np.nonzero(there), strict=True):
        assert is_standard_normal(whitened(fixes[c, k], scene.fix_covariance[c, k]))
    x = fixes[there][:, 0]
    assert np.abs(np.corrcoef(x) - np.eye(len(x))).max() < 4.5 / 100


def test_a_node_at_the_position_counts_for_nothing(build: Build) -> None:
    """The node starts at one, as it does if the nodes are a metre apart."""
    waypoints = [[14, 7], [14.5, 7]]
    scene = build(waypoints=waypoints, speed=1, period=0.5)
    # within 12 m of (14, 7): four on the axes, four on the diagonals, and the node itself
    diagonals = 4 * 0.5  # of each, the cosine squared
    assert scene.heard[0].sum() == 9
    expected = 0.2**2 * np.eye(2) / (2 + diagonals)
    assert scene.fix_covariance[0, 0] == pytest.approx(expected)
    assert build(spacing=1, waypoints=waypoints).fix_covariance[0, 0, 0, 0] > 0


@pytest.mark.parametrize(("source", "fixes"), [("difference", 2), ("window", 6)])
def test_a_velocity_is_the_slope_of_its_fixes(build: Build, source: str, fixes: int) -> None:
    scene = build(**STRAIGHT, velocity_source=source, velocity_fixes=6)
    errors = np.random.default_rng(8).standard_normal((3, 101, 2, 4))
    errors[1, 40] = np.nan
    wsn = scene.with_velocities(errors, np.zeros_like(errors))
    assert wsn[:, :, :2] == pytest.approx(errors, nan_ok=True)
    # on a straight path the slope of the truth is its velocity
    for c, k in ((0, 5), (0, 40), (1, 39), (1, 46), (2, 100)):
        for axis in (0, 1):
            window = errors[c, k - fixes + 1 : k + 1, axis]
            slopes, _ = np.polyfit(0.1 * np.arange(fixes), window, 1)
            assert wsn[c, k, 2 + axis] == pytest.approx(slopes, abs=1e-9)
    # until a window is full, and while it holds a gap
    missing = [np.flatnonzero(np.isnan(wsn[c, :, 2:]).all(axis=(1, 2))).tolist() for c in (0, 1)]
    first = list(range(fixes - 1))
    assert missing == [first, first + list(range(40, 40 + fixes))]


@pytest.mark.parametrize("source", ["sensor", "difference", "window"])
def test_the_covariance_of_a_measurement_is_that_of_what_is_measured(
    build: Build, source: str
) -> None:
    """4,000 runs at two steps of two clusters; true ones fail once in 1,000 times."""
    scene = build(**STILL, velocity_source=source, velocity_fixes=5, velocity_noise=0.3, noise=0.02)
    wsn = scene.simulate(np.random.default_rng(10), 4000)["wsn"]
    assert (scene.heard == scene.heard[0]).all()
    R = scene.measurement_covariance
    for c in (0, 2):
        for k in (10, 20):
            # in 0.5 s the node moves 5 mm, and the covariance less than 1 %
            assert is_standard_normal(whitened(wsn[c, k, :2], R[c, k, :2, :2]), 0.01)
            assert is_standard_normal(whitened(wsn[c, k, 2:], R[c, k, 2:, 2:]), 0.01)
            assert (R[c, k, :2, 2:] == 0).all()
    # a cluster that has no fix on the whole path, and takes no part, has the mean of the others
    assert R[1] == pytest.approx(np.broadcast_to(R[[0, 2]].mean(axis=(0, 1)), R[1].shape))
    assert scene.mean_covariance[1] == pytest.approx(R[1, 0])


def test_where_there_is_no_fix_the_mean_stands_in(build: Build) -> None:
    scene = build(period=0.2)
    slope = 12 / (0.2**2 * 25 * (25**2 - 1))
    for c, R in enumerate(scene.measurement_covariance):
        there = ~np.isnan(scene.fix_covariance[c]).any(axis=(1, 2))
        assert 0 < there.sum() < len(there)
        mean = sum(scene.fix_covariance[c][there]) / there.sum()
        for k in np.flatnonzero(~there):
            assert R[k, :2, :2] == pytest.approx(mean)
            assert R[k, 2:, 2:] == pytest.approx(slope * mean)
        assert scene.mean_covariance[c, :2, :2] == pytest.approx(mean)


def test_margins_by_hand(build: Build) -> None:
    scene = build(waypoints=[[3.5, 3.5], [17.5, 17.5]], speed=1.75 * 2**0.5, period=1)
    margins = scene.margins(10.0)
    assert scene.motion.position[6] == pytest.approx([14, 14])
    # in the middle of four nodes; at a node with three neighbours of its cluster
    assert margins[0, 0] == pytest.approx((12 - 3.5 * 2**0.5) / 10)
    assert margins[0, 6] == pytest.approx((12 - 7) / 10)
    # above it the third cluster: one node 7 m away, two more at the diagonal, all on its first row
    mine = scene.labels == 2
    assert scene.nodes[scene.heard[6] & mine].tolist() == [[7, 21], [14, 21], [21, 21]]
    # between them: two nodes of each near by, and the third half a cell across and one and a half
    # along; from there on nodes of the second row are in reach
    assert margins[[0, 2], -1] == pytest.approx((12 - math.hypot(3.5, 10.5)) / 10)
    assert scene.nodes[scene.heard[-1] & mine][:, 1].max() == 28
    # none where there is no fix, and full within its length, and not above
    without = [[not span_a_triangle(scene.nodes[h & (scene.labels == c)]) for h in scene.heard]
               for c in range(3)]  # fmt: skip
    assert np.array_equal(margins == 0, without)
    assert scene.margins(3.0)[0, 6] == 1
    assert scene.margins(5.0)[0, 6] == pytest.approx(1)
    with pytest.raises(ParameterError, match=r"length .* not 0"):
        scene.margins(0)


@pytest.mark.parametrize(
    ("values", "moved"),
    [
        ({"velocity_noise": 0.5}, ()),  # not used by a window
        ({"velocity_source": "sensor"}, ("wsn",)),
        ({"velocity_fixes": 5}, ("wsn",)),
        ({"accelerometer_noise": 0.1}, ("ins",)),
        ({"noise": 0.3}, ("fixes", "wsn")),
        ({"dropout": 1e-9, "outlier": 1e-9}, ()),
    ],
)
def test_a_setting_moves_no_draw_but_its_own(
    build: Build, values: dict[str, Any], moved: tuple[str, ...]
) -> None:
    a, b = (build(period=0.2, **v).simulate(np.random.default_rng(11), 4) for v in ({}, values))
    same = {name for name in a if np.array_equal(a[name], b[name], equal_nan=True)}
    assert same == {"ins", "fixes", "wsn"} - set(moved)


def test_a_sensor_draws_its_noise_and_a_cluster_the_same_however_many(build: Build) -> None:
    a, b = (
        build(period=0.2, velocity_source="sensor", velocity_noise=noise) for noise in (0.1, 0.3)
    )
    two = replace(a, clusters=a.clusters[:2])
    drawn, thrice, fewer = (s.simulate(np.random.default_rng(12), 4) for s in (a, b, two))
    assert thrice["wsn"][:, :, 2:] == pytest.approx(3 * drawn["wsn"][:, :, 2:], nan_ok=True)
    there = ~np.isnan(drawn["fixes"])
    assert np.array_equal(np.isnan(drawn["wsn"][:, :, 2:]), ~there)
    # standard error of a deviation from so many draws: 1 %
    assert drawn["wsn"][:, :, 2:][there].std() == pytest.approx(0.1, rel=0.05)
    assert np.array_equal(drawn["fixes"][:2], fewer["fixes"], equal_nan=True)
    assert np.array_equal(drawn["ins"], fewer["ins"])


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("size", [63.0, 0.0]), ("size", [63.0]), ("spacing", 0.0), ("radius", 0.0), ("speed", -2.4),
        ("reach", 0.0), ("noise", -0.1), ("dropout", 2.0), ("outlier", -0.1), ("gyro_noise", -1),
        ("outlier_scale", -3.0), ("velocity_source", "gps"), ("velocity_fixes", 1.0),
        ("velocity_fixes", 2.5), ("accelerometer_bias", 0.15), ("position", [0.0, 0.0, 0.0]),
        ("waypoints", [[1.0, 2.0, 3.0]] * 2), ("clusters", [[0.0, 28.0, 0.0]]),
    ],
)  # fmt: skip
def test_settings_that_cannot_be(build: Build, name: str, value: object) -> None:
    with pytest.raises(ParameterError, match=f"^{name} must be "):
        build(**{name: value})


def test_arguments_that_do_not_fit(build: Build) -> None:
    scene = build(**STILL)
    right = np.zeros((3, 21, 2, 3))
    assert scene.with_velocities(right, right).shape == (3, 21, 4, 3)
    for wrong in (right[0], right[:, 1:], right[:, :, :1]):
        with pytest.raises(ParameterError, match=r"fixes .* not of shape"):
            scene.with_velocities(wrong, right)
    with pytest.raises(ParameterError, match=r"normal .* not of shape"):
        scene.with_velocities(right, right[..., :1])
    with pytest.raises(ParameterError, match="clusters must be heard from somewhere, not out of"):
        assert build(clusters=[[0, 14, 35, 42]]).mean_covariance is None
    with pytest.raises(ParameterError, match=r"runs .* not -1"):
        scene.simulate(np.random.default_rng(1), -1)
    none = scene.simulate(np.random.default_rng(1), 0)
    assert {name: found.shape[-1] for name, found in none.items()} == dict.fromkeys(none, 0)
