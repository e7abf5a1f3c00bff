"""A wireless sensor network: reference nodes, ranges, and the position that follows from them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from inswsn_lib.errors import ParameterError

Array = NDArray[np.float64]

_ITERATIONS = 200  # most fixes need five; beside a node that is nearer than the noise, it is slow
_DAMPING, _STUCK, _GRADIENT, _FLAT = 0.1, 1e6, 1e-7, 1e-4
_AT_ONCE = 2**14  # ranges; several arrays of so many are held by a processor's cache


def node_grid(corner: ArrayLike, size: tuple[float, float], spacing: float) -> Array:
    """Return reference nodes on a square grid that fills a rectangle, its edges included.

    Parameters
    ----------
    corner : array_like, (2,)
        Lower left corner, m.
    size : tuple of two floats
        Width and height, m.
    spacing : float
        m.

    Returns
    -------
    ndarray, (nodes, 2)

    Raises
    ------
    ParameterError
        If the spacing is not positive.

    Examples
    --------
    >>> from inswsn_lib.simulation import node_grid
    >>> node_grid((0.0, 10.0), size=(10, 5), spacing=5).tolist()
    [[0.0, 10.0], [5.0, 10.0], [10.0, 10.0], [0.0, 15.0], [5.0, 15.0], [10.0, 15.0]]
    """
    if not spacing > 0:
        raise ParameterError("spacing", spacing, "positive")
    x, y = (np.arange(0, length + spacing / 1e6, spacing) for length in size)
    grid = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
    return np.asarray(grid + np.asarray(corner, dtype=float))


@dataclass(frozen=True)
class Ranging:
    """How a range is measured.

    Attributes
    ----------
    reach : float
        Nodes within this distance are heard, m.
    noise : float
        Standard deviation of a range, m.
    dropout : float
        Probability that a range is lost.
    outlier : float
        Probability that a range is an outlier.
    outlier_scale : float
        Mean excess of an outlier, m: it is late, never early (exponential).

    Examples
    --------
    Outliers are late, never early, by 3 m in the mean if the scale is 3 m:

    >>> import numpy as np
    >>> from inswsn_lib.simulation import Ranging, measure_ranges
    >>> late = Ranging(reach=10.0, noise=0.0, outlier=1.0, outlier_scale=3.0)
    >>> rng = np.random.default_rng(0)
    >>> excess = measure_ranges(np.array([[3.0, 4.0]]), np.zeros(2), late, rng, runs=100_000) - 5.0
    >>> bool(excess.min() >= 0), round(float(excess.mean()), 1)
    (True, 3.0)
    """

    reach: float
    noise: float
    dropout: float = 0.0
    outlier: float = 0.0
    outlier_scale: float = 0.0


def nodes_heard(nodes: Array, position: Array, reach: float) -> Array:
    """Return the nodes within reach of a position.

    Parameters
    ----------
    nodes : ndarray, (nodes, 2)
        m.
    position : ndarray, (2,)
        m.
    reach : float
        m.

    Returns
    -------
    ndarray, (heard, 2)

    Examples
    --------
    >>> import numpy as np
    >>> from inswsn_lib.simulation import nodes_heard
    >>> nodes = np.array([[3.0, 4.0], [6.0, 8.0], [30.0, 40.0]])  # 5, 10 and 50 m from the origin
    >>> nodes_heard(nodes, np.zeros(2), reach=10.0).tolist()
    [[3.0, 4.0], [6.0, 8.0]]
    """
    return np.asarray(nodes[np.hypot(*(nodes - position).T) <= reach])


def measure_ranges(
    nodes: Array, position: Array, ranging: Ranging, rng: np.random.Generator, runs: int
) -> Array:
    """Draw the ranges to all nodes that are heard.

    Parameters
    ----------
    nodes : ndarray, (heard, 2)
        From `nodes_heard`, m.
    position : ndarray, (2,)
        The truth, m.
    ranging : Ranging
        How.
    rng : numpy.random.Generator
        The stream.
    runs : int
        How many independent draws.

    Returns
    -------
    ndarray, (heard, runs)
        m; NaN where lost.

    Examples
    --------
    Without noise they are distances; with noise, its standard deviation is that of `Ranging`.

    >>> import numpy as np
    >>> from inswsn_lib.simulation import Ranging, measure_ranges
    >>> nodes, position = np.array([[0.0, 0.0], [3.0, 0.0]]), np.array([3.0, 4.0])
    >>> rng = np.random.default_rng(0)
    >>> measure_ranges(nodes, position, Ranging(reach=10.0, noise=0.0), rng, runs=1).tolist()
    [[5.0], [4.0]]
    >>> noisy = measure_ranges(nodes, position, Ranging(reach=10.0, noise=0.2), rng, runs=50_000)
    >>> noisy.std(axis=1).round(1).tolist()
    [0.2, 0.2]
    """
    distances = np.hypot(*(nodes - position).T)[:, None]
    shape = (len(nodes), runs)
    # a stream for each purpose: with outliers and without, the noise is the same
    noises, outliers, dropouts = rng.spawn(3)
    ranges = distances + ranging.noise * noises.standard_normal(shape)
    if ranging.outlier > 0:
        late = outliers.random(shape) < ranging.outlier
        ranges += late * outliers.exponential(ranging.outlier_scale, shape)
    if ranging.dropout > 0:
        ranges[dropouts.random(shape) < ranging.dropout] = np.nan
    return np.asarray(ranges)


def multilaterate(nodes: Array, ranges: Array) -> Array:
    r"""Return the least-squares position of each run by damped Gauss-Newton iteration.

    It minimises :math:`\sum_i (r_i - |p - n_i|)^2` over the ranges that are there, from the
    solution of the linear problem that differences of squared ranges pose.

    Parameters
    ----------
    nodes : ndarray, (heard, 2)
        m.
    ranges : ndarray, (heard, runs)
        m; NaN where lost.

    Returns
    -------
    ndarray, (2, runs)
        m; NaN where fewer than three ranges are there, or the nodes lie almost on a line. The cost
        never rises, so that an outlier cannot send a fix to infinity; with gross outliers it may be
        a local minimum.

    Raises
    ------
    ParameterError
        If there is not one range a node and run.

    Examples
    --------
    Three nodes and the distances from (3, 4); in a second run a range is lost, and two do not make
    a fix.

    >>> import numpy as np
    >>> from inswsn_lib.simulation import multilaterate
    >>> nodes = np.array([[0.0, 0.0], [3.0, 0.0], [0.0, 4.0]])
    >>> ranges = np.array([[5.0, 5.0], [4.0, 4.0], [3.0, np.nan]])
    >>> print(multilaterate(nodes, ranges).round(6).T)
    [[ 3.  4.]
     [nan nan]]
    """
    return np.asarray(multilaterate_each([nodes], [ranges])[0])


def multilaterate_each(nodes: Sequence[Array], ranges: Sequence[Array]) -> Array:
    """Return what `multilaterate` tells of each of many places, in less time.

    It is the same to the last bit, but for a single run: NumPy takes its sums in another order, and
    a fix may end some micrometres beside.

    Parameters
    ----------
    nodes : sequence of ndarray, (heard, 2)
        Those heard at each place, m.
    ranges : sequence of ndarray, (heard, runs)
        m; NaN where lost.

    Returns
    -------
    ndarray, (places, 2, runs)
        m, as `multilaterate`.

    Raises
    ------
    ParameterError
        If a place has no ranges or not one a node and run, or not as many runs as the first.

    Examples
    --------
    At the first place four nodes are heard, at the second three of them.

    >>> import numpy as np
    >>> from inswsn_lib.simulation import multilaterate_each
    >>> nodes = np.array([[0.0, 0.0], [3.0, 0.0], [0.0, 4.0], [3.0, 4.0]])
    >>> ranges = [np.array([[2.5], [2.5], [2.5], [2.5]]), np.array([[5.0], [4.0], [3.0]])]
    >>> multilaterate_each([nodes, nodes[:3]], ranges)[:, :, 0].round(6).tolist()
    [[1.5, 2.0], [3.0, 4.0]]
    """
    _check_places(nodes, ranges)
    found = np.empty((len(nodes), 2, ranges[0].shape[1] if len(ranges) else 0))
    at_once = max(1, _AT_ONCE // max([1, *(each.size for each in ranges)]))
    for first in range(0, len(nodes), at_once):
        part = slice(first, first + at_once)
        found[part] = np.moveaxis(_multilaterated(nodes[part], ranges[part]), 1, 0)
    return found


def _check_places(nodes: Sequence[Array], ranges: Sequence[Array]) -> None:
    """Refuse places whose nodes and ranges do not fit."""
    if len(nodes) != len(ranges):
        raise ParameterError("ranges", f"of {len(ranges)} places", f"of {len(nodes)}, as the nodes")
    first = np.shape(ranges[0]) if len(ranges) else ()
    runs = first[1] if len(first) == 2 else "runs"
    for at, measured in zip(nodes, ranges, strict=True):
        if np.ndim(at) != 2 or np.shape(at)[1] != 2:
            raise ParameterError("nodes", f"of shape {np.shape(at)}", "(heard, 2)")
        if np.shape(measured) != (len(at), runs):
            may_be = f"({len(at)}, {runs}), a row for each node"
            raise ParameterError("ranges", f"of shape {np.shape(measured)}", may_be)


def _multilaterated(nodes: Sequence[Array], ranges: Sequence[Array]) -> Array:
    """Return positions (2, places, runs); nodes that a place does not hear count as lost there."""
    runs, most = ranges[0].shape[1], max(map(len, nodes))
    heard, r, weight = np.zeros((most, 2, len(nodes), 1)), *np.zeros((2, most, len(nodes), runs))
    position, fixed = np.empty((2, len(nodes), runs)), np.empty((len(nodes), runs), dtype=bool)
    for place, (at, measured) in enumerate(zip(nodes, ranges, strict=True)):
        there = ~np.isnan(measured)
        lengths, used = np.where(there, measured, 0.0), there.astype(float)
        centre, position[:, place] = _linear_start(at, lengths, used)
        fixed[place] = (there.sum(axis=0) >= 3) & np.isfinite(centre).all(axis=0)
        heard[: len(at), :, place, 0], r[: len(at), place] = at, lengths
        weight[: len(at), place] = used
    _descend(heard, r, weight, position)
    position[:, ~fixed] = np.nan
    return position


def _descend(nodes: Array, r: Array, weight: Array, position: Array) -> None:
    """Take positions (2, places, runs) to where the cost is least, each place by itself."""
    enough = weight.sum(axis=0) >= 3
    left, here, damping = np.arange(position.shape[1]), position, np.zeros(position.shape[1:])
    distance, miss = _miss(nodes, r, weight, here)
    cost = _cost(miss)
    _, step = _newton(nodes, weight, here, distance, miss, damping)
    for _ in range(_ITERATIONS):
        tried = here + np.where(np.isfinite(step), step, 0.0)
        new_distance, new_miss = _miss(nodes, r, weight, tried)
        new_cost = _cost(new_miss)
        better = new_cost < cost
        here, cost = np.where(better, tried, here), np.where(better, new_cost, cost)
        distance = np.where(better, new_distance, distance)
        miss = np.where(better, new_miss, miss)
        # a step that makes it worse is tried again, shorter
        damping = np.where(better, damping / 10, np.clip(10 * damping, _DAMPING, 10 * _STUCK))
        gradient, step = _newton(nodes, weight, here, distance, miss, damping)
        # at a node the cost has a cusp: there no step, however short, makes it smaller
        settled = (np.abs(gradient).max(axis=0) < _GRADIENT) | (damping > _STUCK)
        on = ~(settled | ~enough).all(axis=1)
        if not on.all():
            position[:, left] = here
            left, nodes, r, weight = left[on], nodes[:, :, on], r[:, on], weight[:, on]
            here, step, distance, miss = here[:, on], step[:, on], distance[:, on], miss[:, on]
            cost, damping, enough = cost[on], damping[on], enough[on]
        if not left.size:
            return
    position[:, left] = here


def _newton(
    nodes: Array, weight: Array, position: Array, distance: Array, miss: Array, damping: Array
) -> tuple[Array, Array]:
    """Return the gradient of the cost and the damped Gauss-Newton step, (2, places, runs)."""
    direction = (position[None] - nodes) / distance[:, None]
    gradient = (direction * miss[:, None]).sum(axis=0)
    return gradient, _solve_two(direction, weight, miss, damping)


def _miss(nodes: Array, r: Array, weight: Array, position: Array) -> tuple[Array, Array]:
    """Return the distances from the nodes, and the misses of the ranges that are there."""
    east, north = position[0] - nodes[:, 0], position[1] - nodes[:, 1]
    distance = np.maximum(np.hypot(east, north), 1e-9)
    return distance, weight * (r - distance)


def _cost(miss: Array) -> Array:
    return np.asarray((miss**2).sum(axis=0))


def position_covariance(nodes: Array, position: Array, noise: float) -> Array:
    r"""Return the covariance :math:`\sigma^2 (H'H)^{-1}` of a multilaterated position.

    Parameters
    ----------
    nodes : ndarray, (heard, 2)
        m.
    position : ndarray, (2,)
        m.
    noise : float
        Standard deviation of a range, m.

    Returns
    -------
    ndarray, (2, 2)
        m^2, to first order in the noise.

    Raises
    ------
    ParameterError
        If the nodes are fewer than two or in a line with the position, or one is at it.

    Examples
    --------
    Two nodes in directions at right angles tell each coordinate by one range; four, by two each:

    >>> import numpy as np
    >>> from inswsn_lib.simulation import position_covariance
    >>> nodes = np.array([[10.0, 0.0], [0.0, 10.0], [-10.0, 0.0], [0.0, -10.0]])
    >>> position_covariance(nodes[:2], np.zeros(2), noise=0.2).round(6).diagonal().tolist()
    [0.04, 0.04]
    >>> position_covariance(nodes, np.zeros(2), noise=0.2).round(6).diagonal().tolist()
    [0.02, 0.02]
    """
    away = position - nodes
    distance = np.hypot(*away.T)[:, None]
    if len(nodes) < 2 or not (distance > 0).all():
        raise ParameterError("nodes", f"{len(nodes)}", "two or more, none at the position")
    H = away / distance
    information = H.T @ H
    if np.linalg.det(information) < 1e-9 * np.trace(information) ** 2:
        raise ParameterError("nodes", "in a line with the position", "on more than one line")
    return np.asarray(noise**2 * np.linalg.inv(information))


def velocity_slopes(positions: Array, period: float, fixes: int) -> Array:
    """Return the slope of the last fixes at each step, a velocity; NaN until there are enough.

    Parameters
    ----------
    positions : ndarray, (steps, 2, runs)
        Fixes, m.
    period : float
        Between fixes, s.
    fixes : int
        How many fixes a slope is fitted to, 2 or more. With two it is their difference.

    Returns
    -------
    ndarray, (steps, 2, runs)
        m/s; of the middle of the window, so that it is late by half of it.

    Raises
    ------
    ParameterError
        If there are fewer than two fixes in a window.

    Examples
    --------
    Fixes along a parabola, :math:`x = t^2`: the slope of three fixes is the velocity 2t of the
    middle one, one period late.

    >>> import numpy as np
    >>> from inswsn_lib.simulation import velocity_slopes
    >>> t = np.arange(5.0)
    >>> fixes = np.stack([t**2, 3 * t], axis=1)[:, :, None]
    >>> velocity_slopes(fixes, period=1.0, fixes=3)[:, :, 0].round(6).tolist()
    [[nan, nan], [nan, nan], [2.0, 3.0], [4.0, 3.0], [6.0, 3.0]]
    """
    if fixes < 2:
        raise ParameterError("velocity_fixes", fixes, "2 or more")
    lags = np.arange(fixes) - (fixes - 1) / 2
    weights = lags / (period * np.sum(lags**2))
    out = np.full_like(positions, np.nan)
    for k in range(fixes - 1, len(positions)):
        out[k] = np.tensordot(weights, positions[k - fixes + 1 : k + 1], axes=1)
    return out


def _linear_start(nodes: Array, r: Array, weight: Array) -> tuple[Array, Array]:
    """Solve |p - n_i|^2 = r_i^2 less its mean over i, which is linear in p."""
    count = np.maximum(weight.sum(axis=0), 1)
    mean_node = nodes.T @ weight / count
    square = (nodes**2).sum(axis=1)[:, None] - r**2
    mean_square = (weight * square).sum(axis=0) / count
    rows = nodes[:, :, None] - mean_node[None]
    start = _solve_two(rows, weight, weight * (square - mean_square) / 2)
    return start, np.where(np.isfinite(start), start, mean_node)


def _solve_two(rows: Array, weight: Array, right: Array, damping: Array | float = 0.0) -> Array:
    """Return the weighted least-squares solution in two unknowns of every run, or NaN."""
    a = (weight * rows[:, 0] ** 2).sum(axis=0)
    b = (weight * rows[:, 0] * rows[:, 1]).sum(axis=0)
    d = (weight * rows[:, 1] ** 2).sum(axis=0)
    u, v = (rows[:, 0] * right).sum(axis=0), (rows[:, 1] * right).sum(axis=0)
    # nodes almost on a line leave the side of it open
    flat = a * d - b * b <= _FLAT * np.maximum(a + d, 1e-300) ** 2
    a, d = a * (1 + damping) + damping, d * (1 + damping) + damping
    safe = np.where(flat & (np.asarray(damping) == 0), np.nan, a * d - b * b)
    return np.stack([(d * u - b * v) / safe, (a * v - b * u) / safe])
