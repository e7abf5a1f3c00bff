"""P1's scene as one simulation: every number of it stands in a scenario file, with its source."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Literal

import numpy as np

from inswsn_lib import scenario
from inswsn_lib.checks import Array, whole
from inswsn_lib.errors import ParameterError
from inswsn_lib.scenario import ANY, NOT_NEGATIVE, POSITIVE, Pair
from inswsn_lib.simulation.disturbances import coloured
from inswsn_lib.simulation.ins import InertialErrors, inertial_errors
from inswsn_lib.simulation.multilateration import multilaterate
from inswsn_lib.simulation.network import (
    Ranging,
    measure_ranges,
    node_grid,
    nodes_within,
    slope_errors,
)
from inswsn_lib.simulation.trajectory import Motion, Path


@dataclass(frozen=True)
class Window:
    """A stretch of samples at a constant period, from its start on, both s."""

    start: float
    period: float
    samples: int

    @property
    def times(self) -> Array:
        """The nominal sampling times, (samples,), s."""
        return np.asarray(self.start + self.period * np.arange(self.samples))

    @property
    def end(self) -> float:
        """Where the next window begins, s."""
        return self.start + self.period * self.samples


@dataclass(frozen=True)
class Scene:
    """P1's scene of Section 5.1: a path, two areas with nodes, an outage after each.

    Attributes
    ----------
    size : tuple of two floats
        Width and height of the scene, m.
    waypoints, radius, speed
        The path, m and m/s; see `Path.through`.
    lead, between : float
        Time before the first area, and between the first outage and the second area, s.
    periods : tuple of two floats
        The sampling period in and after each area, s.
    jitter : tuple of two floats
        Standard deviation of a sampling interval in and after each area, s. It moves the samples of
        the INS; the fixes are drawn at the nominal times, since their errors do not depend on it.
    training_samples, outage_samples : int
        Samples in an area and in an outage.
    area_sizes : tuple of two floats
        Sides of the two square areas, m.
    spacing : float
        Of the nodes, m.
    ranging : Ranging
    velocity_source : {"sensor", "difference", "window"}
        How the network comes to a velocity: measured; the difference of the last two fixes; the
        slope of the last `velocity_fixes` fixes.
    velocity_noise : float
        Standard deviation of a measured velocity, m/s, each component.
    velocity_fixes : int
    correlation_time : float
        Of the errors of fixes, and of measured velocities, s: see `coloured`. At 0 they are white.
    lost_every : int
        Of so many fixes the last is lost, as with 3 every third; at 0 none is.
    inertial, inertial_interval : InertialErrors, float
        The INS, and the sampling interval of its sensors, s.

    Examples
    --------
    P1's scene, with the errors of the INS that fit its INS-only cells:

    >>> import inswsn_lib as iw
    >>> folder = iw.data_file("scenarios")
    >>> p1, fitted = (iw.load_scenario(folder / f"{name}.yaml") for name in ("p1", "p1-inertial"))
    >>> scene = iw.from_settings(iw.Scene, p1 | fitted)
    >>> len(scene.nodes["area1"])  # 150 m a side, 5 m apart, edges included: 31 by 31
    961
    >>> iw.monte_carlo(scene.simulate, runs=2, seed=0)["wsn.area1"].shape
    (100, 4, 2)
    """

    ranging: Ranging
    velocity_source: Literal["sensor", "difference", "window"]
    inertial: InertialErrors
    size: Pair = scenario.between(*POSITIVE)
    waypoints: tuple[Pair, ...] = scenario.between(*ANY)
    radius: float = scenario.between(*POSITIVE)
    speed: float = scenario.between(*POSITIVE)
    lead: float = scenario.between(*NOT_NEGATIVE)
    between: float = scenario.between(*NOT_NEGATIVE)
    periods: Pair = scenario.between(*POSITIVE)
    jitter: Pair = scenario.between(*NOT_NEGATIVE)
    training_samples: int = scenario.between(1, 1e6)
    outage_samples: int = scenario.between(1, 1e6)
    area_sizes: Pair = scenario.between(*POSITIVE)
    spacing: float = scenario.between(*POSITIVE)
    velocity_noise: float = scenario.between(*NOT_NEGATIVE)
    velocity_fixes: int = scenario.between(2, 1e6)
    correlation_time: float = scenario.between(*NOT_NEGATIVE)
    lost_every: int = scenario.between(0, 1e6)
    inertial_interval: float = scenario.between(*POSITIVE)

    @cached_property
    def windows(self) -> dict[str, Window]:
        """The four windows, by their names area1, outage1, area2, outage2."""
        first, second = self.periods
        area1 = Window(self.lead, first, self.training_samples)
        outage1 = Window(area1.end, first, self.outage_samples)
        area2 = Window(outage1.end + self.between, second, self.training_samples)
        outage2 = Window(area2.end, second, self.outage_samples)
        return {"area1": area1, "outage1": outage1, "area2": area2, "outage2": outage2}

    @cached_property
    def path(self) -> Path:
        """The path."""
        return Path.through(self.waypoints, self.radius)

    @cached_property
    def motion(self) -> Motion:
        """The truth, at the rate of the inertial sensors, to the end of the last window."""
        end = self.windows["outage2"].end
        steps = int(np.ceil(end / self.inertial_interval)) + 1
        return self.path.drive(self.speed, self.inertial_interval * np.arange(steps))

    @cached_property
    def nodes(self) -> dict[str, Array]:
        """The reference nodes of each area, a grid around the path inside it, within the scene.

        Its middle is that of the path, or as near to that as the edges of the scene allow.
        """
        if min(self.size) < max(self.area_sizes):
            raise ParameterError("size", self.size, "two numbers, neither below a side of an area")
        found = {}
        for name, size in zip(("area1", "area2"), self.area_sizes, strict=True):
            inside = self.path.drive(self.speed, self.windows[name].times).position
            middle = (inside.min(axis=0) + inside.max(axis=0)) / 2
            corner = np.clip(middle - size / 2, 0.0, np.array(self.size) - size)
            found[name] = node_grid(corner, (size, size), self.spacing)
        return found

    def simulate(self, rng: np.random.Generator, runs: int) -> dict[str, Array]:
        """Simulate a number of runs; for `inswsn_lib.evaluation.monte_carlo`.

        Returns
        -------
        dict of str to ndarray
            ``"ins.NAME"``, (samples, 4, runs), for each window: the error of the INS, position (m)
            and velocity (m/s). ``"wsn.NAME"`` for each area: the error of the network, NaN where
            it has no fix.
        """
        whole("runs", runs)
        motion, interval = self.motion, self.inertial_interval
        # a stream for each purpose, so that a change of one setting moves no other draw
        sensors, clock, *networks = rng.spawn(2 + len(self.nodes))
        ins = inertial_errors(motion, self.inertial, sensors, runs)
        found = {}
        for half, network in zip("12", networks, strict=True):
            area, outage = f"area{half}", f"outage{half}"
            times = self._sampling_times(int(half) - 1, clock, runs)
            places = np.split(times / interval, [self.training_samples])
            for name, place in zip((area, outage), places, strict=True):
                found[f"ins.{name}"] = _interpolate(ins, place)
            found[f"wsn.{area}"] = self._network_errors(area, network, runs)
        return found

    def _sampling_times(self, half: int, rng: np.random.Generator, runs: int) -> Array:
        """Return the times of the samples of an area and the outage after it, (samples, runs).

        Each interval jitters by itself, and the clock runs on from the area into the outage.
        """
        count = self.training_samples + self.outage_samples
        steps = self.periods[half] + self.jitter[half] * rng.standard_normal((count, runs))
        steps[0] = 0.0
        start = self.windows[f"area{half + 1}"].start
        return np.asarray(start + np.cumsum(np.maximum(steps, 0.0), axis=0))

    def _network_errors(self, name: str, rng: np.random.Generator, runs: int) -> Array:
        """Return the errors of the network's positions and velocities, (samples, 4, runs)."""
        window = self.windows[name]
        truth = self.path.drive(self.speed, window.times)
        ranges_of, velocities_of, biases_of = rng.spawn(3)
        nodes = self.nodes[name]
        biases = biases_of.standard_normal((len(nodes), runs))
        heard = [nodes_within(nodes, p, self.ranging.reach) for p in truth.position]
        ranges = [
            measure_ranges(nodes[here], position, self.ranging, ranges_of, runs, biases[here])
            for here, position in zip(heard, truth.position, strict=True)
        ]
        white = multilaterate([nodes[here] for here in heard], ranges)
        white -= truth.position[:, :, None]
        fixes = coloured(white, window.period, self.correlation_time)
        if self.velocity_source == "sensor":
            normal = velocities_of.standard_normal((window.samples, 2, runs))
            velocities = self.velocity_noise * coloured(
                normal, window.period, self.correlation_time
            )
        else:
            count = 2 if self.velocity_source == "difference" else self.velocity_fixes
            velocities = slope_errors(fixes, truth, window.period, count)
        found = np.concatenate([fixes, velocities], axis=1)
        if self.lost_every:
            found[self.lost_every - 1 :: self.lost_every] = np.nan
        return found


def _interpolate(values: Array, places: Array) -> Array:
    """Return values (steps, n, runs) at fractional places (samples, runs), linearly."""
    last = len(values) - 2
    floor = np.clip(places.astype(int), 0, last)
    share = (places - floor)[:, None, :]
    run = np.arange(values.shape[2])
    below, above = (np.moveaxis(values[floor + step, :, run[None]], -1, 1) for step in (0, 1))
    return np.asarray(below + share * (above - below))
