"""P2's scene: a sensor network in clusters, each of which locates the blind node by itself."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields
from functools import cached_property
from itertools import pairwise
from numbers import Integral, Real
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from inswsn_lib.errors import InswsnError, ParameterError
from inswsn_lib.scenario import Setting, frozen, take
from inswsn_lib.simulation.ins import InertialErrors, inertial_errors
from inswsn_lib.simulation.network import (
    Ranging,
    measure_ranges,
    multilaterate,
    node_grid,
    position_covariance,
    velocity_slopes,
)
from inswsn_lib.simulation.trajectory import Motion, Path

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

_SOURCES = ("sensor", "difference", "window")
_POSITIVE = ("size", "spacing", "radius", "speed", "period", "reach")
_NOT_NEGATIVE = ("noise", "outlier_scale", "velocity_noise", "accelerometer_noise", "gyro_noise")
_SHARES = ("dropout", "outlier")
_PAIRS = ("size", "accelerometer_bias", "accelerometer_scale", "position", "velocity")
_ROWS = {"clusters": 4, "waypoints": 2}
_LEAST = 3  # ranges for a fix
_LARGEST, _MOST_NODES, _MOST_STEPS = 1e9, 10_000, 100_000  # what a machine can hold


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
        From x, to x, from y, to y of each cluster, m. A node belongs to the first cluster that
        holds it.
    waypoints, radius, speed
        The path, m and m/s; see `Path.through`.
    period : float
        Of the INS, the fixes and the filters, s.
    ranging : Ranging
        How ranges are measured.
    velocity_source : {"sensor", "difference", "window"}
        How a cluster comes to a velocity: measured; the difference of its last two fixes; the slope
        of its last `velocity_fixes` fixes.
    velocity_noise : float
        Standard deviation of a measured velocity, m/s, each component.
    velocity_fixes : int
        Fixes in a window.
    inertial : InertialErrors
        The INS.

    Examples
    --------
    P2's network: ten by seven nodes in three clusters, whose fixes are as accurate as P2 says.

    >>> import numpy as np
    >>> from inswsn_lib.files import data_file
    >>> from inswsn_lib.scenario import load_scenario
    >>> from inswsn_lib.simulation import ClusterScene
    >>> scene = ClusterScene.from_settings(load_scenario(data_file("scenarios/p2.yaml")))
    >>> len(scene.nodes), [int(np.sum(scene.labels == c)) for c in range(3)]
    (70, [15, 15, 40])
    >>> traces = np.trace(scene.fix_covariance, axis1=2, axis2=3)
    >>> print(f"{np.sqrt(np.nanmean(traces)):.1f} m")
    0.2 m
    >>> errors = scene.simulate(np.random.default_rng(0), runs=2)
    >>> errors["ins"].shape[1:], errors["wsn"].shape[::2]
    ((4, 2), (3, 4))
    """

    size: tuple[float, float]
    spacing: float
    clusters: tuple[tuple[float, float, float, float], ...]
    waypoints: tuple[tuple[float, float], ...]
    radius: float
    speed: float
    period: float
    ranging: Ranging
    velocity_source: Literal["sensor", "difference", "window"]
    velocity_noise: float
    velocity_fixes: int
    inertial: InertialErrors

    @classmethod
    def from_settings(cls, settings: Mapping[str, Setting]) -> ClusterScene:
        """Return the scene of a scenario.

        Parameters
        ----------
        settings : mapping of str to Setting
            From `load_scenario`.

        Returns
        -------
        ClusterScene

        Raises
        ------
        InswsnError
            If a setting is missing or unknown.
        ParameterError
            If a value may not be what it is, a cluster has fewer than three nodes, the arcs do not
            fit on the path, or there are too many nodes or samples.
        """
        values: dict[str, Any] = {name: setting.value for name, setting in settings.items()}
        parts = {f.name for kind in (Ranging, InertialErrors) for f in fields(kind)}
        wanted = parts | ({f.name for f in fields(cls)} - {"ranging", "inertial"})
        for complaint, names in (
            ("has an unknown", set(values) - wanted),
            ("lacks the", wanted - set(values)),
        ):
            if names:
                raise InswsnError(f"The scenario {complaint} setting {min(names)}.")
        _check_values(values)
        ranging, inertial = take(values, Ranging), take(values, InertialErrors)
        values = {name: frozen(value) for name, value in values.items()}
        values["velocity_fixes"] = int(values["velocity_fixes"])
        scene = cls(ranging=ranging, inertial=inertial, **values)
        _ = scene.motion  # a path that cannot be is refused here
        for c in range(len(scene.clusters)):
            count = int((scene.labels == c).sum())
            if count < _LEAST:
                raise ParameterError(
                    "clusters", f"one with {count} nodes", "of three nodes or more"
                )
        return scene

    @cached_property
    def nodes(self) -> Array:
        """The reference nodes, (nodes, 2), m."""
        return node_grid((0.0, 0.0), self.size, self.spacing)

    @cached_property
    def labels(self) -> NDArray[np.intp]:
        """The cluster of each node, (nodes,); -1 for a node that is in none."""
        x, y = self.nodes.T
        slack = self.spacing / 1e6
        inside = np.array(
            [
                (x >= left - slack)
                & (x <= right + slack)
                & (y >= low - slack)
                & (y <= high + slack)
                for left, right, low, high in self.clusters
            ]
        )
        return np.where(inside.any(axis=0), inside.argmax(axis=0), -1)

    @cached_property
    def heads(self) -> NDArray[np.intp]:
        """The head of each cluster, (clusters,), which is its node nearest to its middle."""
        found = []
        for c in range(len(self.clusters)):
            mine = np.flatnonzero(self.labels == c)
            middle = self.nodes[mine].mean(axis=0)
            found.append(mine[np.hypot(*(self.nodes[mine] - middle).T).round(9).argmin()])
        return np.array(found)

    @cached_property
    def centre(self) -> int:
        """The node at which the fusion centre is, the one nearest to the middle of all."""
        away = np.hypot(*(self.nodes - self.nodes.mean(axis=0)).T)
        return int(away.round(9).argmin())

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
        away = self.motion.position[:, None] - self.nodes
        return np.asarray(np.hypot(away[..., 0], away[..., 1]) <= self.ranging.reach)

    @cached_property
    def fix_covariance(self) -> Array:
        r"""The covariance of the fix of each cluster, (clusters, steps, 2, 2), m^2.

        To first order in the noise, :math:`\sigma^2 (H'H)^{-1}`, if no range is lost; NaN where a
        cluster hears the node from fewer than three nodes, or from nodes on one line. A node that
        the blind node is at counts for nothing: its range has no direction.
        """
        out = np.full((len(self.clusters), len(self.motion.time), 2, 2), np.nan)
        for c in range(len(self.clusters)):
            for k, position in enumerate(self.motion.position):
                nodes = self.nodes[self.heard[k] & (self.labels == c)]
                if len(nodes) >= _LEAST and _spread_out(nodes):
                    apart = nodes[(nodes != position).any(axis=1)]
                    out[c, k] = position_covariance(apart, position, self.ranging.noise)
        return out

    @cached_property
    def measurement_covariance(self) -> Array:
        r"""The covariance R of what each cluster measures, (clusters, steps, 4, 4).

        Position from `fix_covariance`; velocity from its source: :math:`\sigma_v^2`, or
        :math:`12\,\Sigma / (T^2 n (n^2 - 1))` for the slope of n fixes of covariance
        :math:`\Sigma`. That velocities of windows are correlated over time, and with the fixes, is
        left out. Where a cluster has no fix, the mean of its others stands in.
        """
        fixes = 2 if self.velocity_source == "difference" else self.velocity_fixes
        slope = 12 / (self.period**2 * fixes * (fixes**2 - 1))
        out = np.zeros((*self.fix_covariance.shape[:2], 4, 4))
        out[..., :2, :2] = self.fix_covariance
        out[..., 2:, 2:] = (
            self.velocity_noise**2 * np.eye(2)
            if self.velocity_source == "sensor"
            else slope * self.fix_covariance
        )
        for each in out:
            there = ~np.isnan(each).any(axis=(1, 2))
            if there.any():
                each[~there] = each[there].mean(axis=0)
        return out

    @cached_property
    def mean_covariance(self) -> Array:
        """The mean of `measurement_covariance` over the steps with a fix, (clusters, 4, 4)."""
        hears = ~np.isnan(self.fix_covariance[:, :, 0, 0])
        R = self.measurement_covariance
        return np.stack([R[c, hears[c]].mean(axis=0) for c in range(len(R))])

    def margins(self, length: float) -> Array:
        """Return how far each cluster's coverage reaches beyond the node, (clusters, steps).

        It is the reach less the distance of the third nearest node of the cluster, over `length`,
        cut to the range from 0 to 1: at 0 the cluster loses its third node. It is 0 as well where
        the nodes in reach lie on one line, so that there is no fix.

        Parameters
        ----------
        length : float
            The margin that counts as full, m.

        Returns
        -------
        ndarray, (clusters, steps)
            From 0 to 1.

        Raises
        ------
        ParameterError
            If it is not a positive number.
        """
        if not (isinstance(length, Real) and length > 0):
            raise ParameterError("length", length, "positive")
        out = np.empty((len(self.clusters), len(self.motion.time)))
        for c in range(len(self.clusters)):
            away = self.motion.position[:, None] - self.nodes[self.labels == c]
            third = np.sort(np.hypot(away[..., 0], away[..., 1]), axis=1)[:, _LEAST - 1]
            out[c] = np.clip((self.ranging.reach - third) / length, 0.0, 1.0)
        return np.where(np.isnan(self.fix_covariance[:, :, 0, 0]), 0.0, out)

    def simulate(self, rng: np.random.Generator, runs: int) -> dict[str, Array]:
        """Simulate a number of runs; for `inswsn_lib.evaluation.monte_carlo`.

        Parameters
        ----------
        rng : numpy.random.Generator
            The stream.
        runs : int
            How many.

        Returns
        -------
        dict of str to ndarray
            ``"ins"``, (steps, 4, runs): the error of the INS, position (m) and velocity (m/s).
            ``"fixes"``, (clusters, steps, 2, runs): the error of the fix of each cluster, m; NaN
            where it has none. ``"wsn"``, (clusters, steps, 4, runs): the same with the error of its
            velocity, by `velocity_source`.

        Raises
        ------
        ParameterError
            If the number of runs is not whole, or negative.
        """
        if not (isinstance(runs, Integral) and runs >= 0):
            raise ParameterError("runs", runs, "a whole number, 0 or more")
        motion = self.motion
        # a stream for each purpose, so that a change of one setting moves no other draw
        sensors, velocities, *networks = rng.spawn(2 + len(self.clusters))
        ins = inertial_errors(motion, self.inertial, sensors, runs)
        fixes = np.stack([self._fixes(c, stream, runs) for c, stream in enumerate(networks)])
        normal = velocities.standard_normal(fixes.shape)
        return {"ins": ins, "fixes": fixes, "wsn": self.with_velocities(fixes, normal)}

    def with_velocities(self, fixes: Array, normal: Array) -> Array:
        """Return the errors of fixes with those of the velocities that go with them.

        Parameters
        ----------
        fixes : ndarray, (clusters, steps, 2, runs)
            From `simulate`, m.
        normal : ndarray, (clusters, steps, 2, runs)
            Standard normal numbers for a sensor of velocity.

        Returns
        -------
        ndarray, (clusters, steps, 4, runs)
            m and m/s. A cluster without a fix has no velocity either. With velocities from fixes,
            it has a fix but no velocity after it has begun to hear the node, and after each fix
            that is lost, until the window is full again: with 30 % of the ranges lost, few fixes
            have one.

        Raises
        ------
        ParameterError
            If an array has another shape.
        """
        motion = self.motion
        clusters, steps = len(self.clusters), len(motion.time)
        may_be = f"numbers ({clusters}, {steps}, 2, runs)"
        fixes = as_array("fixes", fixes, may_be)
        if fixes.ndim != 4 or fixes.shape[:3] != (clusters, steps, 2):
            raise ParameterError("fixes", f"of shape {fixes.shape}", may_be)
        normal = as_array("normal", normal, f"numbers {fixes.shape}")
        if normal.shape != fixes.shape:
            raise ParameterError("normal", f"of shape {normal.shape}", f"numbers {fixes.shape}")
        if self.velocity_source == "sensor":
            velocity = np.where(np.isnan(fixes), np.nan, self.velocity_noise * normal)
        else:
            count = 2 if self.velocity_source == "difference" else self.velocity_fixes
            velocity = np.stack(
                [
                    velocity_slopes(each + motion.position[:, :, None], self.period, count)
                    - motion.velocity[:, :, None]
                    for each in fixes
                ]
            )
        return np.concatenate([fixes, velocity], axis=2)

    def _fixes(self, cluster: int, rng: np.random.Generator, runs: int) -> Array:
        """Return the errors of the fixes of a cluster, (steps, 2, runs)."""
        position = self.motion.position
        out = np.full((len(position), 2, runs), np.nan)
        heard = self.heard & (self.labels == cluster)
        changes = np.flatnonzero((heard[1:] != heard[:-1]).any(axis=1)) + 1
        # steps at which the same nodes are heard are solved at once
        for first, last in pairwise([0, *changes, len(position)]):
            nodes = self.nodes[heard[first]]
            if len(nodes) < _LEAST:
                continue
            ranges = [
                measure_ranges(nodes, where, self.ranging, rng, runs)
                for where in position[first:last]
            ]
            found = multilaterate(nodes, np.concatenate(ranges, axis=1))
            found = np.moveaxis(found.reshape(2, last - first, runs), 0, 1)
            out[first:last] = found - position[first:last, :, None]
        return out


def as_array(name: str, value: object, may_be: str) -> Array:
    """Return numbers as an array of floats; refuse what is none, or complex, or of ragged rows."""
    try:
        given = np.asarray(value)
    except (TypeError, ValueError):  # rows of unequal length
        raise ParameterError(name, "no array", may_be) from None
    if given.dtype.kind not in "biuf":
        raise ParameterError(name, f"{given.dtype} of shape {given.shape}", may_be)
    return np.asarray(given, dtype=float)


def _spread_out(nodes: Array) -> bool:
    """Tell whether nodes do not lie on a line."""
    return bool(np.linalg.matrix_rank(nodes - nodes.mean(axis=0), tol=1e-6) == 2)


def _check_values(values: Mapping[str, Any]) -> None:
    if values["velocity_source"] not in _SOURCES:
        raise ParameterError("velocity_source", values["velocity_source"], f"one of {_SOURCES}")
    for name in sorted(set(values) - {"velocity_source"}):
        numbers = _as_numbers(name, values[name])
        if name in _POSITIVE and not (numbers > 0).all():
            raise ParameterError(name, values[name], "positive")
        if name in _NOT_NEGATIVE + _SHARES and not (numbers >= 0).all():
            raise ParameterError(name, values[name], "not negative")
        if name in _SHARES and not (numbers <= 1).all():
            raise ParameterError(name, values[name], "between 0 and 1")
    count = values["velocity_fixes"]
    if count != int(count) or count < 2:
        raise ParameterError("velocity_fixes", count, "a whole number, 2 or more")
    width, height = (float(side) / values["spacing"] + 1 for side in values["size"])
    if not width * height < _MOST_NODES:
        raise ParameterError(
            "spacing", values["spacing"], f"so large that there are fewer than {_MOST_NODES} nodes"
        )


def _as_numbers(name: str, value: object) -> Array:
    """Return a setting as an array if it is finite numbers of its shape."""
    try:
        numbers = np.asarray(value)
    except ValueError:  # lists of unequal length
        numbers = np.array(None)
    if name in _ROWS:
        fits = numbers.ndim == 2 and numbers.shape[1] == _ROWS[name]
        wanted = f"a list of lists of {_ROWS[name]} numbers"
    elif name in _PAIRS:
        fits, wanted = numbers.shape == (2,), "two numbers"
    else:
        fits, wanted = numbers.ndim == 0, "a number"
    if not fits or numbers.dtype.kind not in "if" or not (np.abs(numbers) <= _LARGEST).all():
        raise ParameterError(name, value, f"{wanted} from -1e9 to 1e9")
    return numbers
