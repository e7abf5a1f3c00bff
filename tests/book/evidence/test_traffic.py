"""What a network sends: hops and messages that can be counted by hand."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import networkx
import numpy as np
import pytest
from hypothesis import given, strategies as st
from inswsn_book.evidence.traffic import OPERATIONS, count_hops, count_traffic

from inswsn_lib.errors import ParameterError
from inswsn_lib.scenario import from_settings, load_scenario, with_values
from inswsn_lib.simulation import ClusterScene
from inswsn_lib.simulation.network import node_grid

Build = Callable[..., ClusterScene]

# Two rows of five nodes, 0 1 2 3 4 below 5 6 7 8 9, that reach their neighbours, also at the
# diagonal. 0 1 5 6 are a cluster with head 0, the others one with head 3; the centre is at 2. The
# blind node goes from the first over the border into the second, and up and away.
TINY: dict[str, Any] = {
    "size": [28, 7], "clusters": [[0, 7, 0, 7], [14, 28, 0, 7]], "reach": 11.2,
    "waypoints": [[5.8, 1.25], [30.8, 20]],  # by (5, 3.75) in a step
    "speed": 6.25, "period": 1,
}  # fmt: skip


@pytest.fixture(scope="module")
def build(root: Path) -> Build:
    settings = load_scenario(root / "data/scenarios/p2.yaml")
    return lambda **values: from_settings(ClusterScene, with_values(settings, **values))


@given(
    st.lists(st.tuples(st.floats(-10, 10), st.floats(-10, 10)), min_size=1, max_size=9),
    st.floats(1, 20),
)
def test_hops_are_those_of_a_graph(points: list[tuple[float, float]], reach: float) -> None:
    nodes = np.array(points)
    graph = networkx.Graph()
    graph.add_nodes_from(range(len(nodes)))
    graph.add_edges_from(
        (a, b) for a, p in enumerate(nodes) for b, q in enumerate(nodes)
        if np.sqrt(((p - q) ** 2).sum()) <= reach * (1 + 1e-9)
    )  # fmt: skip
    if not networkx.is_connected(graph):
        with pytest.raises(ParameterError, match="reach must be"):
            count_hops(nodes, reach)
        return
    ways = dict(networkx.all_pairs_shortest_path_length(graph))
    expected = [[ways[a][b] for b in range(len(nodes))] for a in range(len(nodes))]
    assert count_hops(nodes, reach).tolist() == expected


def test_nodes_a_reach_apart_are_neighbours_however_they_are_rounded() -> None:
    nodes = node_grid((0.0, 0.0), (1.0, 1.0), 0.1)
    assert np.diff(np.unique(nodes[:, 0])).max() > 0.1
    column, row = np.divmod(np.arange(121), 11)
    blocks = np.abs(column[:, None] - column) + np.abs(row[:, None] - row)
    assert np.array_equal(count_hops(nodes, 0.1), blocks)


def test_a_tiny_scene_by_hand(build: Build) -> None:
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
    scene = build(**TINY)
    assert (scene.heads.tolist(), scene.centre) == ([0, 3], 2)
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
    assert list(found) == list(by_hand)
    for name, (transmissions, numbers) in by_hand.items():
        assert found[name].transmissions.tolist() == transmissions, name
        assert found[name].numbers.tolist() == numbers, name


def test_a_network_that_falls_apart_and_nodes_that_are_none(build: Build) -> None:
    nodes = [(0.0, 0.0), (7.0, 0.0), (20.0, 0.0)]
    for reach in (0.0, 6.9, 12.9, float("nan")):
        with pytest.raises(ParameterError, match="reach must be"):
            count_hops(nodes, reach)
    assert count_hops(nodes, 13.0)[0].tolist() == [0, 1, 2]
    with pytest.raises(ParameterError, match="reach must be"):
        count_traffic(build(**TINY | {"reach": 6.9}))
    with pytest.raises(ParameterError, match="nodes must be"):
        count_hops(np.zeros((2, 3)), 1.0)
