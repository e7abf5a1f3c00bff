"""The position that follows from ranges to known nodes, and how accurate it is."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from inswsn_lib.checks import Array, Back, Mask, array, of_runs
from inswsn_lib.errors import ParameterError
from inswsn_lib.simulation.position_search import least_positions

#: Ranges that a fix takes
LEAST = 3

_FLAT = 1e-4
_AT_ONCE = 2**14  # ranges; several arrays of so many are held by a processor's cache


def multilaterate(nodes: Sequence[ArrayLike], ranges: Sequence[ArrayLike]) -> Array:
    r"""Return least-squares positions of many places and runs by `least_positions`.

    Each minimises :math:`\sum_i (r_i - |p - n_i|)^2` over the ranges that are there, from the
    solution of the linear problem that differences of squared ranges pose.

    Parameters
    ----------
    nodes : sequence of array_like, (heard, 2)
        Those heard at each place, m.
    ranges : sequence of array_like, (heard,) or (heard, runs)
        m; NaN where lost.

    Returns
    -------
    ndarray, (places, 2) or (places, 2, runs)
        m; NaN where fewer than three ranges are there, or the nodes lie almost on a line.

    Examples
    --------
    One place: three nodes and the distances from (3, 4). In a second run a range is lost.

    >>> import numpy as np
    >>> import inswsn_lib as iw
    >>> nodes = [[0.0, 0.0], [3.0, 0.0], [0.0, 4.0]]
    >>> ranges = [[5.0, 5.0], [4.0, 4.0], [3.0, np.nan]]
    >>> print(iw.multilaterate([nodes], [ranges])[0].round(6).T)
    [[ 3.  4.]
     [nan nan]]
    """
    at, measured, back = _places(nodes, ranges)
    found = np.empty((len(at), 2, measured[0].shape[1] if measured else 0))
    at_once = max(1, _AT_ONCE // max([1, *(each.size for each in measured)]))
    for first in range(0, len(at), at_once):
        part = slice(first, first + at_once)
        found[part] = np.moveaxis(_multilaterated(at[part], measured[part]), 1, 0)
    return back(found)


def _places(
    nodes: Sequence[ArrayLike], ranges: Sequence[ArrayLike]
) -> tuple[list[Array], list[Array], Back]:
    """Return nodes and ranges of each place, by `of_runs`; refuse what does not fit together."""
    if len(nodes) != len(ranges):
        raise ParameterError("ranges", len(ranges), f"of {len(nodes)} places, as nodes are")
    at = [array("nodes", each, ("heard", 2)) for each in nodes]
    runs: int | str = "runs"
    back: Back = np.asarray
    measured = []
    for here, lengths in zip(at, ranges, strict=True):
        found, back = of_runs("ranges", lengths, len(here), runs, gaps=True)
        measured.append(found)
        runs = found.shape[1]
    return at, measured, back


def _multilaterated(nodes: Sequence[Array], ranges: Sequence[Array]) -> Array:
    """Return positions (2, places, runs); nodes that a place does not hear count as lost there."""
    places, runs, most = len(nodes), ranges[0].shape[1], max(map(len, nodes))
    heard, measured = np.zeros((most, 2, places, 1)), np.full((most, places, runs), np.nan)
    for place, (at, lengths) in enumerate(zip(nodes, ranges, strict=True)):
        heard[: len(at), :, place, 0], measured[: len(at), place] = at, lengths
    there = ~np.isnan(measured)
    centre, start = _linear_start(heard, np.where(there, measured, 0.0), there.astype(float))
    fixed = (there.sum(axis=0) >= LEAST) & np.isfinite(centre).all(axis=0)
    position = np.full((2, places, runs), np.nan)
    # the ranges of a fix beside one another
    which, run, node = np.nonzero(np.moveaxis(there & fixed, 0, 2))
    begins = np.flatnonzero(np.diff(which * runs + run, prepend=-1))
    position[:, fixed] = least_positions(
        heard[node, :, which, 0], np.zeros(len(node)), measured[node, which, run], begins,
        start[:, fixed].T,
    ).T  # fmt: skip
    return position


def _linear_start(nodes: Array, r: Array, weight: Array) -> tuple[Array, Array]:
    """Solve |p - n_i|^2 = r_i^2 less its mean over i, which is linear in p; (2, places, runs)."""
    count = np.maximum(weight.sum(axis=0), 1)
    mean_node = (nodes * weight[:, None]).sum(axis=0) / count
    square = (nodes**2).sum(axis=1) - r**2
    mean_square = (weight * square).sum(axis=0) / count
    start = _solve_two(nodes - mean_node, weight, weight * (square - mean_square) / 2)
    return start, np.where(np.isfinite(start), start, mean_node)


def _solve_two(rows: Array, weight: Array, right: Array) -> Array:
    """Return the weighted least-squares solution in two unknowns of every run, or NaN."""
    a = (weight * rows[:, 0] ** 2).sum(axis=0)
    b = (weight * rows[:, 0] * rows[:, 1]).sum(axis=0)
    d = (weight * rows[:, 1] ** 2).sum(axis=0)
    u, v = (rows[:, 0] * right).sum(axis=0), (rows[:, 1] * right).sum(axis=0)
    # nodes almost on a line leave the side of it open
    flat = a * d - b * b <= _FLAT * np.maximum(a + d, 1e-300) ** 2
    safe = np.where(flat, np.nan, a * d - b * b)
    return np.stack([(d * u - b * v) / safe, (a * v - b * u) / safe])


def position_covariance(nodes: Array, position: Array, noise: float) -> Array:
    r"""Return the covariance :math:`\sigma^2 (H'H)^{-1}` of a multilaterated position, (2, 2).

    It holds to first order in the noise. The rows of H are directions from the nodes to the
    position.

    Parameters
    ----------
    nodes : ndarray, (heard, 2)
        m; none is at the position, and not all are on a line with it.
    position : ndarray, (2,)
        m.
    noise : float
        Standard deviation of a range, m.

    Examples
    --------
    Two nodes in directions at right angles tell each coordinate by one range:

    >>> import numpy as np
    >>> from inswsn_lib.simulation import position_covariance
    >>> nodes = np.array([[10.0, 0.0], [0.0, 10.0]])
    >>> position_covariance(nodes, np.zeros(2), noise=0.2).round(6).diagonal().tolist()
    [0.04, 0.04]
    """
    everywhere = np.ones((1, len(nodes)), dtype=bool)
    if len(nodes) < 2 or not (nodes != position).any(axis=1).all():
        raise ParameterError("nodes", nodes.tolist(), "two or more, none at the position")
    found: Array = position_covariances(nodes, everywhere, position[None], noise)[0]
    return found


def position_covariances(nodes: Array, heard: Mask, positions: Array, noise: float) -> Array:
    """Return `position_covariance` of many positions (places, 2) of nodes heard (places, nodes).

    A node at the position counts for nothing.
    """
    away = positions[:, None] - nodes
    distance = np.hypot(away[..., 0], away[..., 1])
    counts = heard & (distance > 0)
    H = np.where(counts[..., None], away / np.where(counts, distance, 1.0)[..., None], 0.0)
    information = np.swapaxes(H, 1, 2) @ H
    on_a_line = np.linalg.det(information) < 1e-9 * np.trace(information, axis1=1, axis2=2) ** 2
    on_a_line |= counts.sum(axis=1) < 2
    if on_a_line.any():
        given = nodes[counts[on_a_line.argmax()]].tolist()
        raise ParameterError("nodes", given, "on more than one line through the position")
    return np.asarray(noise**2 * np.linalg.inv(information))
