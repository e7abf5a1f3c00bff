"""What a clustered sensor network has to send so that a blind node is located at each step."""

from __future__ import annotations

from dataclasses import dataclass
from numbers import Real

import numpy as np
from numpy.typing import NDArray
from scipy.sparse.csgraph import shortest_path
from scipy.spatial.distance import cdist

from inswsn_lib.errors import ParameterError
from inswsn_lib.simulation.clusters import ClusterScene, as_array

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

_STATE, _COVARIANCE = 4, 10  # numbers; a symmetric 4 by 4 matrix has ten
_SLACK = 1e-9  # nodes a reach apart are within reach, however their places are rounded
#: What is sent where; see `count_traffic`.
OPERATIONS = (
    "ranges to the centre",
    "ranges packed by the heads",
    "local estimates",
    "local estimates with covariances",
    "local estimates with covariances, and reset",
)


@dataclass(frozen=True, eq=False)
class Traffic:
    """What is sent at each step.

    Attributes
    ----------
    transmissions : ndarray, (steps,)
        Messages, each counted once for every hop from node to node.
    numbers : ndarray, (steps,)
        The numbers in them, each counted once for every hop.

    Examples
    --------
    One count for each step of the scene; a message holds one number or more:

    >>> from inswsn_lib.files import data_file
    >>> from inswsn_lib.scenario import load_scenario, with_values
    >>> from inswsn_lib.simulation import ClusterScene, count_traffic
    >>> settings = load_scenario(data_file("scenarios/p2.yaml"))
    >>> scene = ClusterScene.from_settings(with_values(settings, period=1.0))
    >>> traffic = count_traffic(scene)["local estimates"]
    >>> len(traffic.transmissions) == len(traffic.numbers) == len(scene.motion.time)
    True
    >>> bool((traffic.numbers >= traffic.transmissions).all())
    True
    """

    transmissions: Array
    numbers: Array


def count_hops(nodes: Array, reach: float) -> Array:
    """Return how many hops a message takes between any two nodes, (nodes, nodes).

    A hop goes to any node within reach, and a message takes a way with the fewest hops.

    Parameters
    ----------
    nodes : ndarray, (nodes, 2)
        m.
    reach : float
        m.

    Returns
    -------
    ndarray, (nodes, nodes)
        Whole numbers as floats; 0 on the diagonal.

    Raises
    ------
    ParameterError
        If the nodes are not finite numbers (nodes, 2), the reach is no number, or the network
        falls apart: there is no way between some nodes.

    Examples
    --------
    Three nodes in a row, 10 m apart:

    >>> import numpy as np
    >>> from inswsn_lib.simulation import count_hops
    >>> nodes = np.array([[0.0, 0.0], [10.0, 0.0], [20.0, 0.0]])
    >>> count_hops(nodes, reach=10.0).tolist()
    [[0.0, 1.0, 2.0], [1.0, 0.0, 1.0], [2.0, 1.0, 0.0]]
    >>> count_hops(nodes, reach=20.0)[0].tolist()
    [0.0, 1.0, 1.0]
    """
    places = as_array("nodes", nodes, "finite, (nodes, 2)")
    if places.ndim != 2 or places.shape[1] != 2 or not np.isfinite(places).all():
        raise ParameterError("nodes", f"of shape {places.shape}", "finite, (nodes, 2)")
    if not isinstance(reach, Real):
        raise ParameterError("reach", reach, "a number")
    hops = shortest_path(cdist(places, places) <= reach * (1 + _SLACK), unweighted=True)
    if not np.isfinite(hops).all():
        raise ParameterError("reach", reach, "so large that every node can be reached by hops")
    return np.asarray(hops)


def count_traffic(scene: ClusterScene) -> dict[str, Traffic]:
    """Count what each way of working has to send along the path of a scene.

    The nodes measure the ranges. In each way of working the blind node sends its INS to where it
    is compared with fixes, and gets the estimate back from the fusion centre: four numbers each.

    Clusters take part that have a fix: three nodes in reach or more, not on one line. Where there
    is none, nothing is sent.

    - "ranges to the centre": every node of theirs that hears the blind node sends its range to the
      centre.
    - "ranges packed by the heads": every such node sends its range to the head of its cluster, and
      the head sends all of them to the centre in one message.
    - "local estimates": ranges to the head, and a message of four numbers from each head to the
      centre: the distributed H-infinity filter.
    - "local estimates with covariances": the same with ten more numbers, which a federated Kalman
      filter or covariance intersection needs.
    - "local estimates with covariances, and reset": the centre sends as much back to these heads.

    Parameters
    ----------
    scene : ClusterScene
        The scene.

    Returns
    -------
    dict of str to Traffic
        By the names in `OPERATIONS`.

    Raises
    ------
    ParameterError
        As `count_hops`.

    Examples
    --------
    Covariances take ten more numbers a message, but no message more:

    >>> from inswsn_lib.files import data_file
    >>> from inswsn_lib.scenario import load_scenario, with_values
    >>> from inswsn_lib.simulation import ClusterScene, count_traffic
    >>> settings = load_scenario(data_file("scenarios/p2.yaml"))
    >>> scene = ClusterScene.from_settings(with_values(settings, period=1.0))
    >>> traffic = count_traffic(scene)
    >>> local, full = (traffic[f"local estimates{more}"] for more in ("", " with covariances"))
    >>> bool((local.transmissions == full.transmissions).all())
    True
    >>> extra = full.numbers - local.numbers
    >>> bool((extra % 10 == 0).all()), bool(extra.sum() > 0)
    (True, True)
    """
    hops = count_hops(scene.nodes, scene.ranging.reach)
    away = cdist(scene.motion.position, scene.nodes)
    fixed = ~np.isnan(scene.fix_covariance[:, :, 0, 0]).T
    steps = [
        _one_step(scene, hops, heard, row, there)
        for heard, row, there in zip(scene.heard, away, fixed, strict=True)
    ]
    counts = np.array(steps, dtype=float)  # (steps, operations, 2)
    return {name: Traffic(counts[:, i, 0], counts[:, i, 1]) for i, name in enumerate(OPERATIONS)}


def _one_step(
    scene: ClusterScene, hops: Array, heard: Mask, away: Array, fixed: Mask
) -> list[tuple[float, float]]:
    """Return transmissions and numbers of each operation at one step."""
    if not fixed.any():
        return [(0.0, 0.0)] * len(OPERATIONS)
    gate = int(np.argmin(away))  # the node by which the blind node talks to the network
    active = [
        (scene.heads[c], np.flatnonzero(heard & (scene.labels == c))) for c in np.flatnonzero(fixed)
    ]
    centre = 1 + hops[gate, scene.centre]  # the first hop is that of the blind node
    to_heads = sum(hops[m, head].sum() for head, m in active)
    up = sum(hops[head, scene.centre] for head, _ in active)
    packed = sum(hops[head, scene.centre] * len(m) for head, m in active)
    ins = sum(1 + hops[gate, head] for head, _ in active)
    direct = sum(hops[m, scene.centre].sum() for _, m in active)
    local = ins + centre + to_heads + up, _STATE * (ins + centre) + to_heads
    full = _STATE + _COVARIANCE
    return [
        (2 * centre + direct, 2 * _STATE * centre + direct),
        (2 * centre + to_heads + up, 2 * _STATE * centre + to_heads + packed),
        (local[0], local[1] + _STATE * up),
        (local[0], local[1] + full * up),
        (local[0] + up, local[1] + 2 * full * up),
    ]
