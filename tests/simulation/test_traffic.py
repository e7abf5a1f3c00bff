"""What a network sends: hops and messages that can be counted by hand."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from inswsn_lib.errors import ParameterError
from inswsn_lib.simulation import (
    OPERATIONS,
    ClusterScene,
    Setting,
    count_hops,
    count_traffic,
    load_scenario,
    node_grid,
    with_values,
)

# Two rows of three nodes, 0 1 2 below 3 4 5, that reach their neighbours across and above. Each
# row is a cluster, with heads 1 and 4; the centre is at 1. The blind node goes up between them.
TINY = {
    "size": [14, 7],
    "clusters": [[0, 14, 0, 0], [0, 14, 7, 7]],
    "reach": 8,
    "waypoints": [[7, 0.4], [7, 15.4]],
    "speed": 6,
    "period": 0.5,
}


@pytest.fixture(scope="module")
def settings(root: Path) -> dict[str, Setting]:
    return load_scenario(root / "data/scenarios/p2.yaml")


@pytest.fixture(scope="module")
def scene(settings: dict[str, Setting]) -> ClusterScene:
    return ClusterScene.from_settings(with_values(settings, period=0.1))


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
    """Six steps: beside 1; between the rows; beside 4; above it; 4 alone is heard; nothing.

    At the second step: the blind node talks to 1, which is the centre. The INS goes there and the
    estimate comes back, one hop each, or the INS goes to both heads, 1 + 2 hops. Six ranges take
    1 + 0 + 1 hops to the first head and to the second, and 2 + 1 + 2 of the second row to the
    centre; from the second head to the centre it is one hop, from the first none.
    """
    scene = ClusterScene.from_settings(with_values(settings, **TINY))
    assert scene.heads.tolist() == [1, 4]
    assert scene.centre == 1
    assert [np.flatnonzero(row).tolist() for row in scene.heard] == [
        [0, 1, 2, 4], [0, 1, 2, 3, 4, 5], [1, 3, 4, 5], [3, 4, 5], [4], []
    ]  # fmt: skip
    by_hand = {
        OPERATIONS[0]: ([4, 9, 9, 9, 4, 0], [10, 15, 21, 21, 16, 0]),
        OPERATIONS[1]: ([4, 7, 7, 7, 4, 0], [10, 15, 21, 21, 16, 0]),
        OPERATIONS[2]: ([4, 9, 6, 6, 2, 0], [10, 24, 18, 18, 8, 0]),
        OPERATIONS[3]: ([4, 9, 6, 6, 2, 0], [10, 34, 28, 28, 8, 0]),
        OPERATIONS[4]: ([4, 10, 7, 7, 2, 0], [10, 48, 42, 42, 8, 0]),
    }
    found = count_traffic(scene)
    assert list(found) == list(OPERATIONS) == list(by_hand)
    for name, (transmissions, numbers) in by_hand.items():
        assert found[name].transmissions.tolist() == transmissions, name
        assert found[name].numbers.tolist() == numbers, name


def test_where_nothing_is_heard_nothing_is_sent(settings: dict[str, Setting]) -> None:
    away = with_values(settings, period=1, waypoints=[[30, 42], [30, 80]])
    scene = ClusterScene.from_settings(away)
    silent = ~scene.heard.any(axis=1)
    assert 0 < silent.sum() < len(silent)
    for traffic in count_traffic(scene).values():
        assert np.array_equal(traffic.transmissions == 0, silent)
        assert np.array_equal(traffic.numbers == 0, silent)


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
    mine = [(scene.heard & (scene.labels == c)).sum(axis=1) for c in range(3)]
    up = sum((n >= 3) * hops[h, scene.centre] for n, h in zip(mine, scene.heads, strict=True))
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
