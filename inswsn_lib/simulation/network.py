"""A wireless sensor network: reference nodes, ranges to them, and velocities from fixes."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from inswsn_lib.checks import Array, Mask, array, number, whole
from inswsn_lib.errors import ParameterError
from inswsn_lib.scenario import NOT_NEGATIVE, POSITIVE, between
from inswsn_lib.simulation.trajectory import Motion


@dataclass(frozen=True)
class Ranging:
    """How a range is measured.

    Attributes
    ----------
    reach : float
        Nodes within this distance are heard, m.
    noise : float
        Standard deviation of a range, m.
    node_bias : float
        Share of that variance that is an error of the node, the same at each range to it; the rest
        is drawn anew at each range.
    dropout, outlier : float
        Probabilities that a range is lost, and that it is an outlier.
    outlier_scale : float
        Mean excess of an outlier, m: it is late, never early (exponential).

    Examples
    --------
    >>> from inswsn_lib.simulation import Ranging
    >>> Ranging(reach=11.0, noise=0.38).dropout
    0.0
    """

    reach: float = between(*POSITIVE)
    noise: float = between(*NOT_NEGATIVE)
    node_bias: float = between(0, 1, 0.0)
    dropout: float = between(0, 1, 0.0)
    outlier: float = between(0, 1, 0.0)
    outlier_scale: float = between(*NOT_NEGATIVE, 0.0)


def node_grid(corner: ArrayLike, size: tuple[float, float], spacing: float) -> Array:
    """Return nodes (nodes, 2) on a square grid that fills a rectangle, its edges included, m.

    The rectangle has its lower left corner (2,) at `corner`, and `size` is its width and height.
    """
    width, height = (side / number("spacing", spacing, above=0) + 1 for side in size)
    if not width * height < 100_000:
        raise ParameterError("spacing", spacing, "large enough for fewer than 100,000 nodes")
    x, y = (np.arange(0, length + spacing / 1e6, spacing) for length in size)
    grid = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
    return np.asarray(grid + array("corner", corner, (2,)))


def nodes_heard(nodes: Array, position: Array, reach: float) -> Array:
    """Return those of some nodes that are within reach of a position, (heard, 2), m.

    Parameters
    ----------
    nodes : ndarray, (nodes, 2)
        m.
    position : ndarray, (2,)
        m.
    reach : float
        m.

    Examples
    --------
    >>> import numpy as np
    >>> from inswsn_lib.simulation import nodes_heard
    >>> nodes = np.array([[3.0, 4.0], [6.0, 8.0], [30.0, 40.0]])  # 5, 10 and 50 m from the origin
    >>> nodes_heard(nodes, np.zeros(2), reach=10.0).tolist()
    [[3.0, 4.0], [6.0, 8.0]]
    """
    return np.asarray(nodes[nodes_within(nodes, position, reach)])


def nodes_within(nodes: Array, position: Array, reach: float) -> Mask:
    """Return which of some nodes are within reach of a position, (nodes,)."""
    return np.asarray(np.hypot(*(nodes - position).T) <= reach)


def measure_ranges(
    nodes: Array,
    position: Array,
    ranging: Ranging,
    rng: np.random.Generator,
    runs: int,
    biases: ArrayLike = 0.0,
) -> Array:
    """Draw ranges (heard, runs) from a position (2,) to nodes (heard, 2), m; NaN where lost.

    The biases (heard, runs) are standard normal numbers, a node's the same at each range to it.
    """
    distances = np.hypot(*(nodes - position).T)[:, None]
    shape, share = (len(nodes), runs), ranging.node_bias
    # a stream for each purpose: with outliers and without, the noise is the same
    noises, outliers, dropouts = rng.spawn(3)
    normal = np.sqrt(1 - share) * noises.standard_normal(shape) + np.sqrt(share) * np.asarray(
        biases
    )
    ranges = distances + ranging.noise * normal
    if ranging.outlier > 0:
        late = outliers.random(shape) < ranging.outlier
        ranges += late * outliers.exponential(ranging.outlier_scale, shape)
    if ranging.dropout > 0:
        ranges[dropouts.random(shape) < ranging.dropout] = np.nan
    return np.asarray(ranges)


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

    Examples
    --------
    Fixes along :math:`x = t^2`: the slope of three fixes is that of the middle one, 2t.

    >>> import numpy as np
    >>> from inswsn_lib.simulation import velocity_slopes
    >>> fixes = np.stack([np.arange(5.0) ** 2, np.zeros(5)], axis=1)[:, :, None]
    >>> velocity_slopes(fixes, period=1.0, fixes=3)[:, 0, 0].round(6).tolist()
    [nan, nan, 2.0, 4.0, 6.0]
    """
    whole("velocity_fixes", fixes, 2)
    lags = np.arange(fixes) - (fixes - 1) / 2
    weights = lags / (period * np.sum(lags**2))
    out = np.full_like(positions, np.nan)
    for k in range(fixes - 1, len(positions)):
        out[k] = np.tensordot(weights, positions[k - fixes + 1 : k + 1], axes=1)
    return out


def slope_errors(errors: Array, motion: Motion, period: float, fixes: int) -> Array:
    """Return the errors of `velocity_slopes` from those of the fixes, (steps, 2, runs)."""
    positions = errors + motion.position[:, :, None]
    return velocity_slopes(positions, period, fixes) - motion.velocity[:, :, None]
