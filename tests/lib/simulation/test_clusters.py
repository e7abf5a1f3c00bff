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
from hypothesis import given, settings as hypothesis_settings, strategies as st

from inswsn_lib.errors import InswsnError, ParameterError
from inswsn_lib.scenario import Setting, load_scenario, with_values
from inswsn_lib.simulation import ClusterScene, multilaterate

Build = Callable[..., ClusterScene]
Array = np.ndarray

# a path on which nothing turns: headed by the angle of the triangle 3, 4, 5, for 10 s
STRAIGHT = {"waypoints": [[9, 8], [45, 35]], "speed": 4.5, "period": 0.1}
# almost at rest, where the first and the third cluster have fixes: 21 samples
STILL = {"waypoints": [[20, 18], [20.02, 18]], "speed": 0.01, "period": 0.1}


@pytest.fixture(scope="module")
def settings(root: Path) -> dict[str, Setting]:
    return load_scenario(root / "data/scenarios/p2.yaml")


@pytest.fixture(scope="module")
def scene(settings: dict[str, Setting]) -> ClusterScene:
    return ClusterScene.from_settings(settings)


@pytest.fixture(scope="module")
def coarse(settings: dict[str, Setting]) -> ClusterScene:
    return ClusterScene.from_settings(with_values(settings, period=0.5))


@pytest.fixture(scope="module")
def build(settings: dict[str, Setting]) -> Build:
    return lambda **values: ClusterScene.from_settings(with_values(settings, **values))


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


def test_the_grid_of_p2(scene: ClusterScene) -> None:
    assert len(scene.nodes) == 10 * 7  # 63 m by 42 m, 7 m apart
    # 5 by 3, 5 by 3 and 10 by 4 nodes, and none beside them
    assert [int((scene.labels == c).sum()) for c in (-1, 0, 1, 2)] == [0, 15, 15, 40]
    for (x, y), label in zip(scene.nodes, scene.labels, strict=True):
        assert label == (2 if y > 17.5 else 0 if x < 31.5 else 1)


def test_heads_and_the_centre(scene: ClusterScene) -> None:
    # the third cluster and the whole have an even number of columns: the first of equals
    assert scene.nodes[scene.heads].tolist() == [[14, 7], [49, 7], [28, 28]]
    assert scene.nodes[scene.centre].tolist() == [28, 21]


def test_a_node_belongs_to_the_first_cluster_that_holds_it(build: Build) -> None:
    scene = build(size=[28, 7], clusters=[[0, 7, 0, 7], [0, 21, 0, 7]])
    assert scene.labels.tolist() == [0, 0, 1, 1, -1] * 2


def test_nodes_on_the_edge_of_a_cluster_are_in_it_however_they_are_rounded(build: Build) -> None:
    # 3 times 0.1 is more than 0.3
    scene = build(
        size=[0.6, 0.1], spacing=0.1, clusters=[[0, 0.3, 0, 0.1], [0.4, 0.6, 0, 0.1]], reach=1
    )
    assert scene.labels.tolist() == [0, 0, 0, 0, 1, 1, 1] * 2


def test_the_path_takes_its_time(scene: ClusterScene) -> None:
    # three legs, of which the arcs at the two corners cut little off
    legs = 2 * math.hypot(13, 9.5) + 19
    turn = math.atan2(9.5, 13)
    length = legs - 2 * 5 * (2 * math.tan(turn / 2) - turn)
    assert len(scene.motion.time) == int(length / 2.4 / 0.02) + 1
    assert scene.motion.position[-1] == pytest.approx([54, 8], abs=2.4 * 0.02)


def test_the_end_of_the_path_is_a_sample_however_it_is_rounded(build: Build) -> None:
    # 0.3 / 0.1 is less than 3
    scene = build(waypoints=[[0, 0], [0.3, 0]], speed=1, period=0.1)
    assert scene.motion.position[:, 0] == pytest.approx([0, 0.1, 0.2, 0.3])


def test_a_cluster_hears_what_is_within_reach(build: Build) -> None:
    scene = build(period=0.5)
    found = [
        [math.dist(place, node) <= 12 for node in scene.nodes] for place in scene.motion.position
    ]
    assert scene.heard.tolist() == found
    assert 0 < scene.heard.mean() < 0.3


def test_the_fixes_are_as_accurate_as_the_file_says(scene: ClusterScene) -> None:
    traces = np.trace(scene.fix_covariance, axis1=2, axis2=3)
    assert np.sqrt(np.nanmean(traces)) == pytest.approx(0.2, rel=0.1)


def test_a_bias_of_the_body_grows_as_in_closed_form(build: Build) -> None:
    scene = build(
        **STRAIGHT, reach=0.1, accelerometer_bias=[0.1, -0.05], accelerometer_noise=0,
        position=[1, 2], velocity=[0.3, -0.1],
    )  # fmt: skip
    ins = scene.simulate(np.random.default_rng(1), 2)["ins"]
    t = scene.motion.time[:, None]
    bias = np.array([0.8 * 0.1 + 0.6 * 0.05, 0.6 * 0.1 - 0.8 * 0.05])
    moved = np.array([1, 2]) + np.array([0.3, -0.1]) * t + bias * t**2 / 2
    assert len(t) == 101
    for run in range(2):
        assert ins[:, :2, run] == pytest.approx(moved, abs=1e-9)
        assert ins[:, 2:, run] == pytest.approx(np.array([0.3, -0.1]) + bias * t, abs=1e-9)


def test_noise_walks_as_in_closed_form(build: Build) -> None:
    """8,192 runs; a true variance leaves its bounds once in 10,000 times."""
    scene = build(**STRAIGHT, reach=0.1, accelerometer_bias=[0, 0], accelerometer_noise=0.05)
    ins = scene.simulate(np.random.default_rng(2), 8192)["ins"]
    bound = 3.9 * (2 / 8192) ** 0.5
    for k, t in ((50, 5.0), (100, 10.0)):
        variance = (ins[k] ** 2).mean(axis=1)
        # trapezoids of a walk in steps: (n^3 - n / 4) / 3 in place of n^3 / 3
        walk = 0.05**2 * t**3 / 3 * (1 - 1 / (4 * k**2))
        assert variance == pytest.approx([walk] * 2 + [0.05**2 * t] * 2, rel=bound)


def test_without_noise_the_fixes_are_exact(build: Build) -> None:
    scene = build(period=0.1, noise=0)
    fixes = scene.simulate(np.random.default_rng(3), 2)["fixes"]
    there = ~np.isnan(fixes).any(axis=2)
    assert np.abs(fixes[~np.isnan(fixes)]).max() < 1e-6
    # there is a fix where there is a covariance, and nowhere else
    flat = np.isnan(scene.fix_covariance).any(axis=(2, 3))
    assert np.array_equal(there, np.repeat(~flat[:, :, None], 2, axis=2))
    assert 0.2 < there.mean() < 0.8


def test_there_is_a_fix_where_single_steps_have_one(build: Build) -> None:
    scene = build(period=0.1, noise=0)
    fixes = scene.simulate(np.random.default_rng(3), 1)["fixes"]
    for c in range(3):
        for k in range(0, len(scene.motion.time), 7):
            place = scene.motion.position[k]
            mine = [n for n, label in zip(scene.nodes, scene.labels, strict=True) if label == c]
            nodes = np.array([node for node in mine if math.dist(node, place) <= 12])
            if len(nodes) < 3:
                assert np.isnan(fixes[c, k]).all()
                continue
            ranges = np.array([[math.dist(node, place)] for node in nodes])
            alone = multilaterate(nodes, ranges) - place[:, None]
            assert fixes[c, k] == pytest.approx(alone, abs=1e-6, nan_ok=True)


def test_fixes_are_unbiased_with_the_covariance_of_theory(build: Build) -> None:
    """10,000 runs, some 17 fixes; true ones leave the bounds once in 1,000 times."""
    scene = build(period=2, noise=0.002)  # so small that the first order is all
    fixes = scene.simulate(np.random.default_rng(4), 10_000)["fixes"]
    count = 0
    for c in range(3):
        for k in range(len(scene.motion.time)):
            if not np.isnan(scene.fix_covariance[c, k]).any():
                assert is_standard_normal(whitened(fixes[c, k], scene.fix_covariance[c, k]))
                count += 1
    assert count > 10


def test_fixes_of_steps_and_clusters_are_independent(build: Build) -> None:
    """4,000 runs; true ones leave the bounds twice in 10,000 times."""
    fixes = build(**STILL).simulate(np.random.default_rng(5), 4000)["fixes"]
    a, b = fixes[0, 3, 0], fixes[0, 4, 0]
    c = fixes[2, 3, 0]
    bound = 4.0 / 4000**0.5
    assert abs(np.corrcoef(a, b)[0, 1]) < bound
    assert abs(np.corrcoef(a, c)[0, 1]) < bound
    assert not np.array_equal(a, b)


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


def test_dropout_loses_fixes(build: Build) -> None:
    """Of three ranges all must arrive; a true share leaves the bounds once in 10,000 times."""
    scene = build(period=0.1, dropout=0.3)
    fixes = scene.simulate(np.random.default_rng(6), 100)["fixes"]
    there = ~np.isnan(fixes).any(axis=2)
    mine = np.array([(scene.heard & (scene.labels == c)).sum(axis=1) for c in range(3)])
    assert not there[mine < 3].any()
    three = there[(mine == 3) & ~np.isnan(scene.fix_covariance[..., 0, 0])]
    assert three.size > 1000
    assert three.mean() == pytest.approx(0.7**3, abs=3.9 * (0.343 * 0.657 / three.size) ** 0.5)
    more = there[mine >= 6]
    assert three.mean() < more.mean() < 1


def test_a_difference_is_the_slope_of_two_fixes(build: Build) -> None:
    scene = build(**STRAIGHT, velocity_source="difference")
    fixes = np.random.default_rng(7).standard_normal((3, 101, 2, 4))
    wsn = scene.with_velocities(fixes, np.zeros_like(fixes))
    assert wsn[:, :, :2] == pytest.approx(fixes)
    assert np.isnan(wsn[:, 0, 2:]).all()
    # on a straight path the slope of the truth is its velocity
    assert wsn[:, 1:, 2:] == pytest.approx((fixes[:, 1:] - fixes[:, :-1]) / 0.1, abs=1e-9)


def test_a_window_is_the_slope_of_its_fixes(build: Build) -> None:
    scene = build(**STRAIGHT, velocity_source="window", velocity_fixes=6)
    fixes = np.random.default_rng(8).standard_normal((3, 101, 2, 4))
    fixes[1, 40] = np.nan
    wsn = scene.with_velocities(fixes, np.zeros_like(fixes))
    for c, k in ((0, 5), (0, 40), (1, 39), (1, 46), (2, 100)):
        for axis in (0, 1):
            slopes, _ = np.polyfit(0.1 * np.arange(6), fixes[c, k - 5 : k + 1, axis], 1)
            assert wsn[c, k, 2 + axis] == pytest.approx(slopes, abs=1e-9)
    # until a window is full, and while it holds a gap
    missing = np.isnan(wsn[:, :, 2:]).all(axis=(2, 3))
    assert np.flatnonzero(missing[0]).tolist() == [0, 1, 2, 3, 4]
    assert np.flatnonzero(missing[1]).tolist() == [0, 1, 2, 3, 4, 40, 41, 42, 43, 44, 45]


def test_an_odd_window_has_no_velocity_without_a_fix(build: Build) -> None:
    """The fix in its middle has no weight, and must be there all the same."""
    scene = build(**STRAIGHT, velocity_source="window", velocity_fixes=5)
    fixes = np.zeros((3, 101, 2, 1))
    fixes[0, 40] = np.nan
    missing = np.isnan(scene.with_velocities(fixes, fixes)[0, :, 2, 0])
    assert np.flatnonzero(missing).tolist() == [0, 1, 2, 3, 40, 41, 42, 43, 44]


def test_a_window_on_a_bend_is_late_by_half_of_it(build: Build) -> None:
    """Exact fixes on a circle: the slope is the chord's, the truth half a window ahead."""
    scene = build(
        waypoints=[[10, 10], [20, 10], [20, 20]], radius=5, speed=1, period=0.1, noise=0,
        velocity_source="difference",
    )  # fmt: skip
    fixes = np.zeros((3, len(scene.motion.time), 2, 1))
    error = scene.with_velocities(fixes, fixes)[0, :, 2:, 0]
    bend = np.flatnonzero((scene.motion.yaw_rate[1:] > 0) & (scene.motion.yaw_rate[:-1] > 0)) + 1
    assert len(bend) > 50
    # two unit vectors, but for the shortness of the chord, 0.01 rad apart
    assert np.hypot(*error[bend].T) == pytest.approx(0.1 / 5 / 2, rel=1e-3)
    after = scene.motion.time > 5 + 5 * np.pi / 2 + 0.1
    assert error[after] == pytest.approx(0, abs=1e-9)


def test_a_sensor_measures_with_its_noise(build: Build) -> None:
    scene = build(**STILL, velocity_source="sensor", velocity_noise=0.3)
    rng = np.random.default_rng(9)
    fixes, normal = rng.standard_normal((2, 3, 21, 2, 8))
    fixes[1, 4, :, 2] = np.nan
    velocity = scene.with_velocities(fixes, normal)[:, :, 2:]
    assert np.array_equal(np.isnan(velocity), np.isnan(fixes))
    there = ~np.isnan(velocity)
    assert velocity[there] == pytest.approx(0.3 * normal[there])


@pytest.mark.parametrize("source", ["sensor", "difference", "window"])
def test_the_covariance_of_a_measurement_is_that_of_what_is_measured(
    build: Build, source: str
) -> None:
    """4,000 runs at two steps of two clusters; true ones fail once in 1,000 times."""
    scene = build(**STILL, velocity_source=source, velocity_fixes=5, velocity_noise=0.3, noise=0.02)
    wsn = scene.simulate(np.random.default_rng(10), 4000)["wsn"]
    assert (scene.heard == scene.heard[0]).all()
    R = scene.measurement_covariance
    assert R.shape == (3, 21, 4, 4)
    for c in (0, 2):
        for k in (10, 20):
            # in 0.5 s the node moves 5 mm, and the covariance less than 1 %
            assert is_standard_normal(whitened(wsn[c, k, :2], R[c, k, :2, :2]), 0.01)
            assert is_standard_normal(whitened(wsn[c, k, 2:], R[c, k, 2:, 2:]), 0.01)
            assert (R[c, k, :2, 2:] == 0).all()
            assert (R[c, k, 2:, :2] == 0).all()


def test_where_there_is_no_fix_the_mean_stands_in(build: Build) -> None:
    scene = build(period=0.2)
    R = scene.measurement_covariance
    for c in range(3):
        there = ~np.isnan(scene.fix_covariance[c]).any(axis=(1, 2))
        assert 0 < there.sum() < len(there)
        mean = sum(scene.fix_covariance[c][there]) / there.sum()
        for k in np.flatnonzero(~there):
            assert R[c, k, :2, :2] == pytest.approx(mean)
            slope = 12 / (0.2**2 * 25 * (25**2 - 1))
            assert R[c, k, 2:, 2:] == pytest.approx(slope * mean)
    # a cluster that has no fix on the whole path has no covariance either
    assert np.isnan(build(**STILL).measurement_covariance[1, :, :2, :2]).all()


def test_margins_by_hand(build: Build) -> None:
    scene = build(waypoints=[[3.5, 3.5], [17.5, 17.5]], speed=1.75 * 2**0.5, period=1)
    margins = scene.margins(10.0)
    assert margins.shape == (3, 9)
    assert scene.motion.position[6] == pytest.approx([14, 14])
    # in the middle of four nodes; at a node with three neighbours of its cluster
    assert margins[0, 0] == pytest.approx((12 - 3.5 * 2**0.5) / 10)
    assert margins[0, 6] == pytest.approx((12 - 7) / 10)
    # above it the third cluster: one node 7 m away, two more at the diagonal, all on its first row
    mine = scene.labels == 2
    assert scene.nodes[scene.heard[6] & mine].tolist() == [[7, 21], [14, 21], [21, 21]]
    assert margins[2, 6] == 0
    # between them: two nodes of each near by, and the third half a cell across and one and a half
    # along; from there on nodes of the second row are in reach
    assert margins[0, -1] == pytest.approx((12 - math.hypot(3.5, 10.5)) / 10)
    assert margins[2, -1] == pytest.approx((12 - math.hypot(3.5, 10.5)) / 10)
    assert scene.nodes[scene.heard[-1] & mine][:, 1].max() == 28
    assert margins[2, 0] == 0
    assert (margins[1] == 0).all()
    # full within its length, and not above
    assert scene.margins(3.0)[0, 6] == 1
    assert scene.margins(5.0)[0, 6] == pytest.approx(1)


@hypothesis_settings(max_examples=20)
@given(st.floats(0.01, 50), st.floats(0.01, 50))
def test_margins_fall_with_their_length_and_end_with_the_fix(
    coarse: ClusterScene, a: float, b: float
) -> None:
    short, long = coarse.margins(min(a, b)), coarse.margins(max(a, b))
    assert (long <= short).all()
    for c in range(3):
        heard = coarse.heard & (coarse.labels == c)
        few = heard.sum(axis=1) < 3
        without = np.array([not span_a_triangle(coarse.nodes[row]) for row in heard])
        assert few.any()
        # three or more on a line: the row of the third cluster along which the path leads
        assert (without & ~few).any() == (c == 2)
        assert np.array_equal(long[c] == 0, without)
        assert np.array_equal(short[c] == 0, without)


@pytest.mark.parametrize("length", [0.0, -1.0, float("nan")])
def test_a_margin_of_no_length(scene: ClusterScene, length: float) -> None:
    with pytest.raises(ParameterError, match="length is"):
        scene.margins(length)


@pytest.mark.parametrize(
    ("values", "moved"),
    [
        ({"velocity_noise": 0.5}, ()),  # not used by a window
        ({"velocity_source": "sensor"}, ("wsn",)),
        ({"velocity_fixes": 5}, ("wsn",)),
        ({"accelerometer_noise": 0.1}, ("ins",)),
        ({"gyro_noise": 0.1, "heading": 0.1}, ("ins",)),
        ({"noise": 0.3}, ("fixes", "wsn")),
        ({"dropout": 1e-9, "outlier": 1e-9}, ()),
    ],
)
def test_a_setting_moves_no_draw_but_its_own(
    build: Build, values: dict[str, float | str], moved: tuple[str, ...]
) -> None:
    a, b = (
        build(period=0.2, **v).simulate(np.random.default_rng(11), 4)
        for v in ({"velocity_source": "window"}, {"velocity_source": "window"} | values)
    )
    same = {name for name in a if np.array_equal(a[name], b[name], equal_nan=True)}
    assert same == {"ins", "fixes", "wsn"} - set(moved)


def test_the_noise_of_a_sensor_scales_its_own_draws(build: Build) -> None:
    a, b = (
        build(period=0.2, velocity_source="sensor", velocity_noise=noise).simulate(
            np.random.default_rng(12), 4
        )
        for noise in (0.1, 0.3)
    )
    assert np.array_equal(a["fixes"], b["fixes"], equal_nan=True)
    assert b["wsn"][:, :, 2:] == pytest.approx(3 * a["wsn"][:, :, 2:], nan_ok=True)


def test_a_cluster_draws_the_same_however_many_there_are(build: Build) -> None:
    three = build(period=0.2)
    two = replace(three, clusters=three.clusters[:2])
    a, b = (s.simulate(np.random.default_rng(13), 4) for s in (three, two))
    assert np.array_equal(a["fixes"][:2], b["fixes"], equal_nan=True)
    assert np.array_equal(a["ins"], b["ins"])


def test_a_seed_stands_for_its_runs(build: Build) -> None:
    scene = build(period=0.5)
    a, b, c = (scene.simulate(np.random.default_rng(seed), 4) for seed in (14, 14, 15))
    for name in a:
        assert np.array_equal(a[name], b[name], equal_nan=True)
        assert not np.array_equal(a[name], c[name], equal_nan=True)


def test_settings_that_are_missing_or_unknown(settings: dict[str, Setting]) -> None:
    for name in settings:
        without = {n: setting for n, setting in settings.items() if n != name}
        with pytest.raises(InswsnError, match=f"lacks the setting {name}."):
            ClusterScene.from_settings(without)
    with pytest.raises(InswsnError, match="unknown setting pace"):
        ClusterScene.from_settings(settings | {"pace": settings["speed"]})


def test_words_where_numbers_belong_and_numbers_for_words(settings: dict[str, Setting]) -> None:
    for name, setting in settings.items():
        for value in ("fast", float("nan"), float("inf"), -1e300, [], [[]], [[[1.0]]], None, True,
                      [[1.0, 2.0], [3.0]], [1.0, float("nan")], ["a", "b"], {"a": 1.0}, 1j, 10**400,
                      [True, False], [[1.0, 2.0, 3.0, float("inf")]], [1.0, 2.0, 3.0]):  # fmt: skip
            # by the setting itself if no setting could have it, else by the scene
            with pytest.raises(ParameterError, match=f"^({name}|value) is .*; it may be "):
                ClusterScene.from_settings(settings | {name: replace(setting, value=value)})


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("size", 42.0), ("size", [63.0, 0.0]), ("spacing", 0.0), ("spacing", [7.0]),
        ("spacing", 1e-300), ("spacing", 0.1), ("radius", 0.0), ("radius", 100.0),
        ("speed", 0.0), ("speed", -2.4), ("period", 0.0), ("period", 1e-9), ("period", 30.0),
        ("reach", 0.0), ("noise", -0.1), ("noise", [0.1, 0.1]), ("dropout", 2.0),
        ("dropout", -0.1), ("outlier", 1.5), ("outlier_scale", -3.0), ("velocity_noise", -0.1),
        ("accelerometer_noise", -0.1), ("gyro_noise", -0.1), ("velocity_source", "gps"),
        ("velocity_source", 1.0), ("velocity_fixes", 1.0), ("velocity_fixes", 2.5),
        ("velocity_fixes", -5.0), ("accelerometer_bias", 0.15), ("gyro_bias", [0.0, 0.0]),
        ("position", [0.0, 0.0, 0.0]), ("waypoints", [[1.0, 2.0]]),
        ("waypoints", [[1.0, 2.0, 3.0]] * 2), ("clusters", [0.0, 28.0, 0.0, 14.0]),
        ("clusters", [[0.0, 28.0, 0.0]]), ("clusters", [[0.0, 28.0, 0.0, 14.0], [0.0, 7.0, 0, 1]]),
        ("clusters", [[28.0, 0.0, 0.0, 14.0]]),  # the wrong way round: no nodes
        ("clusters", [[0.0, 28.0, 0.0, 14.0]] * 2),  # the first has taken them all
    ],
)  # fmt: skip
def test_settings_that_cannot_be(build: Build, name: str, value: object) -> None:
    with pytest.raises(ParameterError, match=f"^{name} is .*; it may be "):
        build(**{name: value})


def test_a_cluster_of_three_nodes_is_enough(build: Build) -> None:
    first = [0, 28, 0, 14]
    assert (build(clusters=[first, [35, 49, 0, 0]]).labels == 1).sum() == 3
    with pytest.raises(ParameterError, match="one with 2 nodes"):
        build(clusters=[first, [35, 42, 0, 0]])


@pytest.mark.parametrize("length", ["a", "1.0", None, 1j, [1.0], np.ones(2)])
def test_a_length_that_is_no_number(scene: ClusterScene, length: Any) -> None:
    with pytest.raises(ParameterError, match="length is"):
        scene.margins(length)


@pytest.mark.parametrize("runs", [-1, 1.5, "a", "1", None, [1], np.ones(2), float("nan")])
def test_a_number_of_runs_that_is_none(build: Build, runs: Any) -> None:
    with pytest.raises(ParameterError, match="runs is"):
        build(**STILL).simulate(np.random.default_rng(1), runs)


def test_no_runs_and_runs_of_numpy(build: Build) -> None:
    scene = build(**STILL)
    none = scene.simulate(np.random.default_rng(1), 0)
    assert {name: found.shape[-1] for name, found in none.items()} == dict.fromkeys(none, 0)
    two = [scene.simulate(np.random.default_rng(1), runs)["wsn"] for runs in (2, np.int64(2))]
    assert np.array_equal(*two, equal_nan=True)


@pytest.mark.parametrize("source", ["sensor", "difference", "window"])
def test_fixes_of_a_wrong_shape(build: Build, source: str) -> None:
    scene = build(**STILL, velocity_source=source)
    right = np.zeros((len(scene.clusters), len(scene.motion.time), 2, 3))
    assert scene.with_velocities(right, right).shape == (*right.shape[:2], 4, 3)
    wrong = [
        right[0], right[1:], right[:, 1:], right[:, :, :1], right[..., 0], "a", None, [[1.0], []],
        1j * right, right.astype(str), {"fixes": right},
    ]  # fmt: skip
    for given_one in wrong:
        with pytest.raises(ParameterError, match="fixes is"):
            scene.with_velocities(given_one, right)
    for given_one in (*wrong, right[..., :1]):
        with pytest.raises(ParameterError, match="normal is"):
            scene.with_velocities(right, given_one)


@pytest.mark.parametrize("name", ["heads", "centre", "labels", "nodes", "measurement_covariance"])
def test_no_colon_in_what_stands_for_a_property(name: str) -> None:
    """Sphinx would take what is before it for a type."""
    first = getattr(ClusterScene, name).__doc__.splitlines()[0]
    assert ": " not in first
    assert first.endswith(".")
