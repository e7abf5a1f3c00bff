"""The position that follows from ranges to known nodes, and how accurate it is."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from inswsn_lib.checks import Array, Back, Mask, array, of_runs
from inswsn_lib.errors import ParameterError
from inswsn_lib.simulation.position_search import least_positions, linear_start, scatter

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
        found[part] = _multilaterated(at[part], measured[part])
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
    """Return positions (places, 2, runs)."""
    places, runs, measured = len(nodes), ranges[0].shape[1], np.concatenate(ranges)
    found = np.full((runs, places, 2), np.nan)
    # the ranges of a fix beside one another, those of a run one after the other
    run, node = np.nonzero(~np.isnan(measured.T))
    fix = run * places + np.repeat(np.arange(places), [len(each) for each in nodes])[node]
    windows, at = np.flatnonzero(np.diff(fix, prepend=-1)), np.concatenate(nodes)[node]
    spread = scatter(at, windows)
    # nodes almost on a line leave the side of it open
    lost = np.linalg.det(spread) <= _FLAT * np.trace(spread, axis1=1, axis2=2) ** 2
    lost |= np.diff(np.append(windows, len(fix))) < LEAST
    rows = at, np.zeros(len(at)), measured[node, run], windows
    position = least_positions(*rows, linear_start(*rows, lost))
    found.reshape(-1, 2)[fix[windows]] = np.where(lost[:, None], np.nan, position)
    return np.moveaxis(found, 0, 2)


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
