"""What a clustered sensor network has to send so that a blind node is located at each step."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike
from scipy.sparse.csgraph import shortest_path
from scipy.spatial.distance import cdist

from inswsn_lib.checks import Array, array, number
from inswsn_lib.errors import ParameterError
from inswsn_lib.simulation.clusters import ClusterScene

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


class Traffic(NamedTuple):
    """Messages sent at each step, and the numbers in them, (steps,), once for every hop."""

    transmissions: Array
    numbers: Array


def count_hops(nodes: ArrayLike, reach: float) -> Array:
    """Return how many hops a message takes between any two nodes (nodes, 2), (nodes, nodes).

    A hop goes to any node within reach, m, and a message takes a way with the fewest hops.
    """
    places = array("nodes", nodes, ("nodes", 2))
    number("reach", reach, least=0)
    hops = shortest_path(cdist(places, places) <= reach * (1 + _SLACK), unweighted=True)
    if not np.isfinite(hops).all():
        raise ParameterError("reach", reach, "large enough for every node to be reached by hops")
    return np.asarray(hops)


def count_traffic(scene: ClusterScene) -> dict[str, Traffic]:
    """Count what each way of working has to send along the path of a scene.

    The nodes measure the ranges. In each way of working the blind node sends its INS to where it
    is compared with fixes, and gets the estimate back from the fusion centre: four numbers each.
    Clusters take part that have a fix; where there is none, nothing is sent.

    - "ranges to the centre": every node of theirs that hears the blind node sends its range to the
      centre.
    - "ranges packed by the heads": every such node sends its range to the head of its cluster, and
      the head sends all of them to the centre in one message.
    - "local estimates": ranges to the head, and a message of four numbers from each head to the
      centre: the distributed H-infinity filter.
    - "local estimates with covariances": the same with ten more numbers, which a federated Kalman
      filter or covariance intersection needs.
    - "local estimates with covariances, and reset": the centre sends as much back to these heads.

    Returns
    -------
    dict of str to Traffic
        By the names in `OPERATIONS`; each has transmissions and numbers, (steps,).
    """
    hops = count_hops(scene.nodes, scene.ranging.reach)
    to_centre = hops[:, scene.centre]
    # the node by which the blind node talks to the network: its own hop comes first
    gate = cdist(scene.motion.position, scene.nodes).argmin(axis=1)
    fixed = ~np.isnan(scene.fix_covariance[:, :, 0, 0])
    centre = fixed.any(axis=0) * (1 + to_centre[gate])
    to_heads, packed, direct, ins, up = np.zeros((5, len(gate)))
    for c, head in enumerate(scene.heads):
        mine = np.flatnonzero(scene.labels == c)
        heard = (scene.heard[:, mine] & fixed[c, :, None]).astype(float)
        to_heads += heard @ hops[mine, head]
        packed += heard.sum(axis=1) * to_centre[head]
        direct += heard @ to_centre[mine]
        ins += fixed[c] * (1 + hops[gate, head])
        up += fixed[c] * to_centre[head]
    ranges = to_heads + ins + centre + up, to_heads + _STATE * (ins + centre)
    full = _STATE + _COVARIANCE
    counts = (
        (2 * centre + direct, 2 * _STATE * centre + direct),
        (2 * centre + to_heads + up, 2 * _STATE * centre + to_heads + packed),
        (ranges[0], ranges[1] + _STATE * up),
        (ranges[0], ranges[1] + full * up),
        (ranges[0] + up, ranges[1] + 2 * full * up),
    )
    return {name: Traffic(*count) for name, count in zip(OPERATIONS, counts, strict=True)}
