"""What a network sends: hops and messages that can be counted by hand."""

from __future__ import annotations

from itertools import combinations
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, strategies as st

from inswsn_lib.errors import ParameterError
from inswsn_lib.scenario import Setting, load_scenario, with_values
from inswsn_lib.simulation import OPERATIONS, ClusterScene, count_hops, count_traffic, node_grid

# Two rows of five nodes, 0 1 2 3 4 below 5 6 7 8 9, that reach their neighbours, also at the
# diagonal. 0 1 5 6 are a cluster with head 0, the others one with head 3; the centre is at 2. The
# blind node goes from the first over the border into the second, and up and away.
TINY = {
    "size": [28, 7],
    "clusters": [[0, 7, 0, 7], [14, 28, 0, 7]],
    "reach": 11.2,
    "waypoints": [[5.8, 1.25], [30.8, 20]],  # by (5, 3.75) in a step
    "speed": 6.25,
    "period": 1,
}


@pytest.fixture(scope="module")
def settings(root: Path) -> dict[str, Setting]:
    return load_scenario(root / "data/scenarios/p2.yaml")


@pytest.fixture(scope="module")
def scene(settings: dict[str, Setting]) -> ClusterScene:
    return ClusterScene.from_settings(with_values(settings, period=0.1))


def have_fix(scene: ClusterScene) -> np.ndarray:
    """Return which clusters hear the blind node from a triangle of nodes, (clusters, steps)."""

    def spread(nodes: np.ndarray) -> bool:
        return any(
            abs((b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])) > 1e-6
            for a, b, c in combinations(nodes.tolist(), 3)
        )

    clusters = range(len(scene.clusters))
    return np.array(
        [[spread(scene.nodes[row & (scene.labels == c)]) for row in scene.heard] for c in clusters]
    )


def steps_from(start: int, near: list[list[int]]) -> list[float]:
    """Return the hops from a node to all, by a wave that spreads."""
    hops = [float("inf")] * len(near)
    hops[start], wave = 0, [start]
    while wave:
        beyond = [b for a in wave for b in near[a] if hops[b] == float("inf")]
        for b in beyond:
            hops[b] = hops[wave[0]] + 1
        wave = list(dict.fromkeys(beyond))
    return hops


def test_hops_on_a_line() -> None:
    nodes = np.array([(0.0, 0.0), (7.0, 0.0), (14.0, 0.0), (21.0, 0.0), (28.0, 0.0)])
    places = np.arange(5)
    assert np.array_equal(count_hops(nodes, 7.0), np.abs(places[:, None] - places))
    # two at once, from either end
    assert count_hops(nodes, 14.0)[0].tolist() == [0, 1, 1, 2, 2]
    assert (count_hops(nodes, 28.0) == 1 - np.eye(5)).all()


@given(
    st.lists(st.tuples(st.floats(-10, 10), st.floats(-10, 10)), min_size=1, max_size=9),
    st.floats(1, 20),
)
def test_hops_are_a_distance(points: list[tuple[float, float]], reach: float) -> None:
    nodes = np.array(points)
    near = [[b for b, q in enumerate(nodes) if np.sqrt(((p - q) ** 2).sum()) <= reach * (1 + 1e-9)]
            for p in nodes]  # fmt: skip
    waves = [steps_from(a, near) for a in range(len(nodes))]
    if np.isinf(waves).any():
        with pytest.raises(ParameterError, match="reach is"):
            count_hops(nodes, reach)
        return
    hops = count_hops(nodes, reach)
    assert hops.tolist() == waves
    assert (hops == hops.T).all()
    assert (np.diag(hops) == 0).all()
    assert (hops[:, None] <= hops[:, :, None] + hops[None]).all()


def test_nodes_a_reach_apart_are_neighbours_however_they_are_rounded() -> None:
    nodes = node_grid((0.0, 0.0), (1.0, 1.0), 0.1)
    assert np.diff(np.unique(nodes[:, 0])).max() > 0.1
    column, row = np.divmod(np.arange(121), 11)
    blocks = np.abs(column[:, None] - column) + np.abs(row[:, None] - row)
    assert np.array_equal(count_hops(nodes, 0.1), blocks)


@pytest.mark.parametrize("reach", [0.0, 6.9, 12.9, float("nan")])
def test_a_network_that_falls_apart(reach: float) -> None:
    nodes = np.array([(0.0, 0.0), (7.0, 0.0), (20.0, 0.0)])
    with pytest.raises(ParameterError, match="reach is"):
        count_hops(nodes, reach)
    assert count_hops(nodes, 13.0)[0, 2] == 2


def test_a_scene_whose_network_falls_apart(settings: dict[str, Setting]) -> None:
    scene = ClusterScene.from_settings(with_values(settings, **{**TINY, "reach": 6.9}))
    with pytest.raises(ParameterError, match="reach is"):
        count_traffic(scene)


def test_a_tiny_scene_by_hand(settings: dict[str, Setting]) -> None:
    """Six steps: a fix of the first cluster; of both; of the second; of none, three times.

    At the last three steps a row of three nodes is heard, then two nodes, then nothing. Hops are
    columns apart, or one within a column: 2 and 1 from the heads 0 and 3 to the centre, 2.

    First step: the blind node talks to 1. Its INS takes 1 + 1 hops to the centre or to head 0, and
    the estimate 2 back. Ranges of 0 1 5 6 take 0 + 1 + 1 + 1 hops to the head, 2 + 1 + 2 + 1 to the
    centre. Those that 2 and 7 measure are not sent: two nodes are no fix. Transmissions: 4 + 6 to
    the centre; 4 + 3 + 2 packed; 4 + 3 + 2 local, and 2 more for the reset. Numbers: 16 + 6;
    16 + 3 + 2 hops of 4 ranges; 16 + 3 + 2 hops of 4, of 14, and of 14 there and back.

    Second step: it talks to 7. The INS takes 1 + 1 hops to the centre, 1 + 2 to head 0 and 1 + 1 to
    head 3. Ranges of 1 5 6 and of 2 7 8 take 3 hops to each head, 1 + 2 + 1 and 0 + 1 + 1 to the
    centre. Transmissions: 4 + 6; 4 + 6 + 3; 5 + 2 + 6 + 3, and 3 more. Numbers: 16 + 6;
    16 + 6 + 3 hops of 3; 28 + 6 + 3 hops of 4, of 14, and of 14 there and back.

    Third step: it talks to 7. The INS takes 2 hops to the centre or to head 3. Ranges of 2 3 7 8
    take 1 + 0 + 1 + 1 hops to the head, 0 + 1 + 1 + 1 to the centre; that of 6 is not sent.
    Transmissions: 4 + 3; 4 + 3 + 1; 4 + 3 + 1, and 1 more. Numbers: 16 + 3; 16 + 3 + 4;
    16 + 3 + 1 hop of 4, of 14, and of 14 there and back.
    """
    scene = ClusterScene.from_settings(with_values(settings, **TINY))
    assert scene.heads.tolist() == [0, 3]
    assert scene.centre == 2
    assert [np.flatnonzero(row).tolist() for row in scene.heard] == [
        [0, 1, 2, 5, 6, 7], [1, 2, 5, 6, 7, 8], [2, 3, 6, 7, 8], [7, 8, 9], [8, 9], []
    ]  # fmt: skip
    by_hand = {
        OPERATIONS[0]: ([10, 10, 7, 0, 0, 0], [22, 22, 19, 0, 0, 0]),
        OPERATIONS[1]: ([9, 13, 8, 0, 0, 0], [27, 31, 23, 0, 0, 0]),
        OPERATIONS[2]: ([9, 16, 8, 0, 0, 0], [27, 46, 23, 0, 0, 0]),
        OPERATIONS[3]: ([9, 16, 8, 0, 0, 0], [47, 76, 33, 0, 0, 0]),
        OPERATIONS[4]: ([11, 19, 9, 0, 0, 0], [75, 118, 47, 0, 0, 0]),
    }
    found = count_traffic(scene)
    assert list(found) == list(OPERATIONS) == list(by_hand)
    for name, (transmissions, numbers) in by_hand.items():
        assert found[name].transmissions.tolist() == transmissions, name
        assert found[name].numbers.tolist() == numbers, name


def test_where_no_cluster_has_a_fix_nothing_is_sent(settings: dict[str, Setting]) -> None:
    away = with_values(settings, period=1, waypoints=[[30, 42], [30, 80]])
    scene = ClusterScene.from_settings(away)
    silent = ~have_fix(scene).any(axis=0)
    assert 0 < silent.sum() < len(silent)
    assert 0 < scene.heard[silent].any(axis=1).sum() < silent.sum()  # heard in part, or not at all
    for traffic in count_traffic(scene).values():
        assert np.array_equal(traffic.transmissions == 0, silent)
        assert np.array_equal(traffic.numbers == 0, silent)


def test_clusters_that_are_lines_send_nothing(settings: dict[str, Setting]) -> None:
    """Two rows of three nodes, each a cluster, of which all are heard at some step."""
    rows = {"size": [14, 7], "clusters": [[0, 14, 0, 0], [0, 14, 7, 7]], "reach": 8}
    path = {"waypoints": [[7, 0.4], [7, 15.4]], "speed": 6, "period": 0.5}
    scene = ClusterScene.from_settings(with_values(settings, **rows, **path))
    assert scene.heard.all(axis=1).any()
    assert (scene.margins(1.0) == 0).all()
    for traffic in count_traffic(scene).values():
        assert traffic.transmissions.tolist() == [0] * 6
        assert traffic.numbers.tolist() == [0] * 6


def test_what_the_ways_of_working_have_in_common(scene: ClusterScene) -> None:
    found = count_traffic(scene)
    direct, packed, local, full, reset = (found[name] for name in OPERATIONS)
    for traffic in found.values():
        assert traffic.transmissions.shape == scene.motion.time.shape
        assert (traffic.numbers >= traffic.transmissions).all()
        assert (traffic.transmissions >= 0).all()
        assert (traffic.numbers == np.round(traffic.numbers)).all()
    # hops from the heads that take part to the centre, from the hops alone
    hops = count_hops(scene.nodes, 12.0)
    fixed = have_fix(scene)
    mine = [(scene.heard & (scene.labels == c)).sum(axis=1) for c in range(3)]
    # somewhere the third hears from three on a line, while another has a fix
    assert (fixed[:2].any(axis=0) & ~fixed[2] & (mine[2] >= 3)).any()
    up = sum(there * hops[h, scene.centre] for there, h in zip(fixed, scene.heads, strict=True))
    assert up.max() > up.min() > 0
    assert np.array_equal(full.transmissions, local.transmissions)
    assert np.array_equal(full.numbers, local.numbers + 10 * up)
    assert np.array_equal(reset.transmissions, full.transmissions + up)
    assert np.array_equal(reset.numbers, full.numbers + 14 * up)
    # the way by the head is no shorter than the straight one
    assert (packed.numbers >= direct.numbers).all()


def test_with_one_hop_between_any_two_nodes(settings: dict[str, Setting]) -> None:
    """Each message is one transmission, or none if it stays where it is."""
    scene = ClusterScene.from_settings(with_values(settings, period=2, reach=80))
    found = count_traffic(scene)
    # all 70 are heard: all but the centre send, and INS and estimate take two hops at most
    nearest = np.linalg.norm(scene.motion.position[:, None] - scene.nodes, axis=2).argmin(axis=1)
    centre = 1 + (nearest != scene.centre)
    assert np.array_equal(found[OPERATIONS[0]].transmissions, 69 + 2 * centre)
    # 67 members to their heads, and three heads to the centre
    assert np.array_equal(found[OPERATIONS[1]].transmissions, 67 + 3 + 2 * centre)
    assert np.array_equal(found[OPERATIONS[1]].numbers, 67 + 70 + 8 * centre)


@pytest.mark.parametrize(
    "nodes",
    [
        np.zeros(2), np.zeros((2, 3)), np.zeros((1, 2, 2)), [[0.0, 0.0], [1.0]], "nodes", None,
        {"a": 1.0}, 1j * np.zeros((2, 2)), [["0", "0"]], [[0.0, np.nan]], [[0.0, np.inf]],
    ],
)  # fmt: skip
def test_nodes_that_are_none(nodes: Any) -> None:
    with pytest.raises(ParameterError, match="nodes is"):
        count_hops(nodes, 1.0)


@pytest.mark.parametrize("reach", ["7", "a", None, 7j, [7.0], np.full(2, 7.0)])
def test_a_reach_that_is_no_number(reach: Any) -> None:
    with pytest.raises(ParameterError, match="reach is"):
        count_hops(np.array([(0.0, 0.0), (7.0, 0.0)]), reach)
