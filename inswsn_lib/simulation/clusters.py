"""P2's scene: a sensor network in clusters, each of which locates the blind node by itself."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from inswsn_lib.checks import Array, Mask, array, number, whole
from inswsn_lib.errors import Described, ParameterError
from inswsn_lib.scenario import ANY, NOT_NEGATIVE, POSITIVE, Pair, between
from inswsn_lib.simulation.disturbances import coloured
from inswsn_lib.simulation.ins import InertialErrors, inertial_errors
from inswsn_lib.simulation.multilateration import LEAST, multilaterate, position_covariances
from inswsn_lib.simulation.network import Ranging, measure_ranges, node_grid, slope_errors
from inswsn_lib.simulation.trajectory import Motion, Path

_MOST_STEPS = 100_000


@dataclass(frozen=True)
class ClusterScene:
    """P2's scene of Section 3: a path through a grid of reference nodes in clusters.

    All positions are in the frame of the scene, x right and y up.

    Attributes
    ----------
    size : tuple of two floats
        Width and height of the grid of nodes, m.
    spacing : float
        Of the nodes, m.
    clusters : tuple of tuples of four floats
        From x, to x, from y, to y of each cluster, m. No node may be in two of them: each cluster
        measures the ranges of its own nodes.
    period : float
        Of the INS, the fixes and the filters, s.
    waypoints, radius, speed, ranging, inertial
        As in `Scene`.
    velocity_source, velocity_noise, velocity_fixes
        How each cluster comes to a velocity, as in `Scene`.
    correlation_time : float
        Of the errors of fixes, and of measured velocities, s, as in `Scene`.

    Examples
    --------
    P2's network: ten by seven nodes in three clusters, whose fixes are as accurate as P2 says.

    >>> import numpy as np
    >>> import inswsn_lib as iw
    >>> settings = iw.load_scenario(iw.data_file("scenarios/p2.yaml"))
    >>> scene = iw.from_settings(iw.ClusterScene, settings)
    >>> len(scene.nodes), np.bincount(scene.labels).tolist()
    (70, [15, 15, 40])
    >>> print(f"{np.sqrt(np.nanmean(np.trace(scene.fix_covariance, axis1=2, axis2=3))):.1f} m")
    0.2 m
    """

    ranging: Ranging
    velocity_source: Literal["sensor", "difference", "window"]
    inertial: InertialErrors
    size: Pair = between(*POSITIVE)
    spacing: float = between(*POSITIVE)
    clusters: tuple[tuple[float, float, float, float], ...] = between(*ANY)
    waypoints: tuple[Pair, ...] = between(*ANY)
    radius: float = between(*POSITIVE)
    speed: float = between(*POSITIVE)
    period: float = between(*POSITIVE)
    velocity_noise: float = between(*NOT_NEGATIVE)
    velocity_fixes: int = between(2, 1e6)
    correlation_time: float = between(*NOT_NEGATIVE)

    @cached_property
    def nodes(self) -> Array:
        """The reference nodes, (nodes, 2), m."""
        return node_grid((0.0, 0.0), self.size, self.spacing)

    @cached_property
    def labels(self) -> NDArray[np.intp]:
        """The cluster of each node, (nodes,); -1 for a node that is in none."""
        x, y = self.nodes.T[:, :, None]
        left, right, low, high = np.array(self.clusters).T
        slack = self.spacing / 1e6
        inside = (x >= left - slack) & (x <= right + slack)
        inside &= (y >= low - slack) & (y <= high + slack)
        if (shared := inside.sum(axis=1) > 1).any():
            got = Described(f"{int(shared.sum())} of them in two or more")
            raise ParameterError("clusters", got, "rectangles that have no node in common")
        labels = np.where(inside.any(axis=1), inside.argmax(axis=1), -1)
        for c in range(len(self.clusters)):
            count = int((labels == c).sum())
            if count < LEAST:
                raise ParameterError("clusters", count, f"of at least {LEAST} nodes each")
        return labels

    @cached_property
    def heads(self) -> NDArray[np.intp]:
        """The head of each cluster, (clusters,), which is its node nearest to its middle."""
        mine = [np.flatnonzero(self.labels == c) for c in range(len(self.clusters))]
        return np.array([nodes[_most_central(self.nodes[nodes])] for nodes in mine])

    @cached_property
    def centre(self) -> int:
        """The node at which the fusion centre is, the one nearest to the middle of all."""
        return _most_central(self.nodes)

    @cached_property
    def motion(self) -> Motion:
        """The truth at the samples, from the start of the path to its end."""
        path = Path.through(self.waypoints, self.radius)
        periods = path.length / self.speed / self.period + 1e-9  # an end that rounding moved
        if not 1 <= periods < _MOST_STEPS:
            raise ParameterError(
                "period", self.period, f"such that the path has 2 to {_MOST_STEPS} samples"
            )
        return path.drive(self.speed, self.period * np.arange(int(periods) + 1))

    @cached_property
    def heard(self) -> Mask:
        """Which nodes are within reach at each sample, (steps, nodes)."""
        return np.asarray(self._away(self.nodes) <= self.ranging.reach)

    def _away(self, nodes: Array) -> Array:
        """Return how far nodes are from the blind node at each sample, (steps, nodes), m."""
        away = self.motion.position[:, None] - nodes
        return np.asarray(np.hypot(away[..., 0], away[..., 1]))

    @cached_property
    def fix_covariance(self) -> Array:
        r"""The covariance of the fix of each cluster, (clusters, steps, 2, 2), m^2.

        To first order in the noise, :math:`\sigma^2 (H'H)^{-1}`, if no range is lost; NaN where a
        cluster hears the node from fewer than three nodes, or from nodes on one line. A node that
        the blind node is at counts for nothing: its range has no direction.
        """
        out = np.full((len(self.clusters), len(self.motion.time), 2, 2), np.nan)
        for c in range(len(self.clusters)):
            mine = self.nodes[self.labels == c]
            heard = self.heard[:, self.labels == c]
            kinds, which = np.unique(heard, axis=0, return_inverse=True)
            fixed = np.array([k.sum() >= LEAST and _spread_out(mine[k]) for k in kinds])[which]
            out[c, fixed] = position_covariances(
                mine, heard[fixed], self.motion.position[fixed], self.ranging.noise
            )
        return out

    @cached_property
    def measurement_covariance(self) -> Array:
        r"""The covariance R of what each cluster measures, (clusters, steps, 4, 4).

        Position from `fix_covariance`; velocity from its source: :math:`\sigma_v^2`, or
        :math:`12\,\Sigma / (T^2 n (n^2 - 1))` for the slope of n fixes of covariance
        :math:`\Sigma`. That velocities of windows are correlated over time, and with the fixes, is
        left out. Where a cluster has no fix, the mean of its others stands in, or of all clusters.
        """
        slope = 12 / (self.period**2 * self._window * (self._window**2 - 1))
        out = np.zeros((*self.fix_covariance.shape[:2], 4, 4))
        out[..., :2, :2] = self.fix_covariance
        out[..., 2:, 2:] = (
            self.velocity_noise**2 * np.eye(2)
            if self.velocity_source == "sensor"
            else slope * self.fix_covariance
        )
        has = np.isfinite(out).all(axis=(2, 3)).reshape(out.shape[:2])
        if not has.any():
            raise ParameterError("clusters", Described("out of reach"), "heard from somewhere")
        for each, there in zip(out, has, strict=True):
            each[~there] = (each[there] if there.any() else out[has]).mean(axis=0)
        return out

    @cached_property
    def mean_covariance(self) -> Array:
        """The mean of `measurement_covariance` over the steps with a fix, (clusters, 4, 4)."""
        hears = ~np.isnan(self.fix_covariance[:, :, 0, 0])
        hears[~hears.any(axis=1)] = True  # one that is out of reach takes no part
        R = self.measurement_covariance
        return np.stack([R[c, hears[c]].mean(axis=0) for c in range(len(R))])

    @property
    def _window(self) -> int:
        """How many fixes a velocity is the slope of."""
        return 2 if self.velocity_source == "difference" else self.velocity_fixes

    def margins(self, length: float) -> Array:
        """Return how far each cluster's coverage reaches beyond the node, (clusters, steps).

        It is the reach less the distance of the third nearest node of the cluster, over the
        `length` that counts as full, m, cut to the range from 0 to 1: at 0 the cluster loses its
        third node. It is 0 as well where the nodes in reach lie on one line: there is no fix.
        """
        number("length", length, above=0)
        out = np.empty((len(self.clusters), len(self.motion.time)))
        for c in range(len(self.clusters)):
            third = np.sort(self._away(self.nodes[self.labels == c]), axis=1)[:, LEAST - 1]
            out[c] = np.clip((self.ranging.reach - third) / length, 0.0, 1.0)
        return np.where(np.isnan(self.fix_covariance[:, :, 0, 0]), 0.0, out)

    def simulate(self, rng: np.random.Generator, runs: int) -> dict[str, Array]:
        """Simulate a number of runs; for `inswsn_lib.evaluation.monte_carlo`.

        Returns
        -------
        dict of str to ndarray
            ``"ins"``, (steps, 4, runs): the error of the INS, position (m) and velocity (m/s).
            ``"fixes"``, (clusters, steps, 2, runs): the error of the fix of each cluster, m; NaN
            where it has none. ``"wsn"``, (clusters, steps, 4, runs): the same with the error of its
            velocity, by `velocity_source`.
        """
        whole("runs", runs)
        # a stream for each purpose, so that a change of one setting moves no other draw
        sensors, velocities, *networks, nodes = rng.spawn(3 + len(self.clusters))
        ins = inertial_errors(self.motion, self.inertial, sensors, runs)
        biases = nodes.standard_normal((len(self.nodes), runs))
        fixes = np.stack([self._fixes(c, stream, biases) for c, stream in enumerate(networks)])
        normal = velocities.standard_normal(fixes.shape)
        return {"ins": ins, "fixes": fixes, "wsn": self.with_velocities(fixes, normal)}

    def with_velocities(self, fixes: ArrayLike, normal: ArrayLike) -> Array:
        """Return the errors of fixes with those of the velocities that go with them.

        A cluster without a fix has no velocity either. With velocities from fixes, it has a fix but
        no velocity after it has begun to hear the node, and after each fix that is lost, until the
        window is full again: with 30 % of the ranges lost, few fixes have one.

        Parameters
        ----------
        fixes : array_like, (clusters, steps, 2, runs)
            From `simulate`, m.
        normal : array_like, (clusters, steps, 2, runs)
            White standard normal numbers for a sensor of velocity.

        Returns
        -------
        ndarray, (clusters, steps, 4, runs)
            m and m/s.
        """
        motion = self.motion
        sizes = len(self.clusters), len(motion.time)
        errors = array("fixes", fixes, (*sizes, 2, "runs"), gaps=True)
        normal = array("normal", normal, errors.shape)
        if self.velocity_source == "sensor":
            white = np.where(np.isnan(errors), np.nan, self.velocity_noise * normal)
            velocity = np.stack([self._coloured(each) for each in white])
        else:
            slopes = [slope_errors(each, motion, self.period, self._window) for each in errors]
            velocity = np.stack(slopes)
        return np.concatenate([errors, velocity], axis=2)

    def _fixes(self, cluster: int, rng: np.random.Generator, biases: Array) -> Array:
        """Return the errors of the fixes of a cluster, (steps, 2, runs); of nodes with biases."""
        runs = biases.shape[1]
        position = self.motion.position
        out = np.full((len(position), 2, runs), np.nan)
        heard = self.heard & (self.labels == cluster)
        changes = np.flatnonzero((heard[1:] != heard[:-1]).any(axis=1)) + 1
        # steps at which the same nodes are heard are solved at once
        for first, last in pairwise([0, *changes, len(position)]):
            nodes, own = self.nodes[heard[first]], biases[heard[first]]
            if len(nodes) < LEAST:
                continue
            ranges = [
                measure_ranges(nodes, where, self.ranging, rng, runs, own)
                for where in position[first:last]
            ]
            (found,) = multilaterate([nodes], [np.concatenate(ranges, axis=1)])
            found = np.moveaxis(found.reshape(2, last - first, runs), 0, 1)
            out[first:last] = found - position[first:last, :, None]
        return self._coloured(out)

    def _coloured(self, errors: Array) -> Array:
        return coloured(errors, self.period, self.correlation_time)


def _most_central(nodes: Array) -> int:
    """Return which of some nodes is nearest to their middle; the first of equals."""
    return int(np.hypot(*(nodes - nodes.mean(axis=0)).T).round(9).argmin())


def _spread_out(nodes: Array) -> bool:
    """Tell whether nodes do not lie on a line."""
    return bool(np.linalg.matrix_rank(nodes - nodes.mean(axis=0), tol=1e-6) == 2)
