"""P1's scene as one simulation: every number of it stands in a scenario file, with its source."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields
from functools import cached_property
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from inswsn_lib.errors import InswsnError, ParameterError
from inswsn_lib.scenario import Setting, frozen, take
from inswsn_lib.simulation.ins import InertialErrors, inertial_errors
from inswsn_lib.simulation.network import (
    Ranging,
    measure_ranges,
    multilaterate_each,
    node_grid,
    nodes_heard,
    velocity_slopes,
)
from inswsn_lib.simulation.trajectory import Motion, Path

Array = NDArray[np.float64]

_COUNTS = ("training_samples", "outage_samples", "velocity_fixes")
_POSITIVE = (
    *("size", "radius", "speed", "periods", "area_sizes", "spacing", "reach"),
    "inertial_interval",
)
_NOT_NEGATIVE = (
    *("lead", "between", "jitter", "noise", "outlier_scale", "velocity_noise"),
    *("accelerometer_noise", "gyro_noise"),
)
_SHARES = ("dropout", "outlier")
_SOURCES = ("sensor", "difference", "window")


@dataclass(frozen=True)
class Window:
    """A stretch of samples at a constant period.

    Attributes
    ----------
    start : float
        Time of the first sample, s.
    period : float
        s.
    samples : int

    Examples
    --------
    Where one window ends the next one begins:

    >>> from inswsn_lib.simulation import Window
    >>> area = Window(start=10.0, period=0.5, samples=4)
    >>> area.times.tolist(), area.end
    ([10.0, 10.5, 11.0, 11.5], 12.0)
    """

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
        How ranges are measured.
    velocity_source : {"sensor", "difference", "window"}
        How the network comes to a velocity: measured; the difference of the last two fixes; the
        slope of the last `velocity_fixes` fixes.
    velocity_noise : float
        Standard deviation of a measured velocity, m/s, each component.
    velocity_fixes : int
        Fixes in a window.
    inertial : InertialErrors
        The INS.
    inertial_interval : float
        Sampling interval of the inertial sensors, s.

    Examples
    --------
    P1's scene, with the errors of the INS that fit its INS-only cells:

    >>> import numpy as np
    >>> from inswsn_lib.files import data_file
    >>> from inswsn_lib.scenario import load_scenario
    >>> from inswsn_lib.simulation import Scene
    >>> folder = data_file("scenarios")
    >>> settings = load_scenario(folder / "p1.yaml") | load_scenario(folder / "p1-inertial.yaml")
    >>> scene = Scene.from_settings(settings)
    >>> {name: window.samples for name, window in scene.windows.items()}
    {'area1': 100, 'outage1': 50, 'area2': 100, 'outage2': 50}
    >>> len(scene.nodes["area1"])  # 150 m a side, 5 m apart, edges included: 31 by 31
    961
    >>> errors = scene.simulate(np.random.default_rng(0), runs=2)
    >>> errors["wsn.area1"].shape, errors["ins.outage1"].shape
    ((100, 4, 2), (50, 4, 2))
    """

    size: tuple[float, float]
    waypoints: tuple[tuple[float, float], ...]
    radius: float
    speed: float
    lead: float
    between: float
    periods: tuple[float, float]
    jitter: tuple[float, float]
    training_samples: int
    outage_samples: int
    area_sizes: tuple[float, float]
    spacing: float
    ranging: Ranging
    velocity_source: Literal["sensor", "difference", "window"]
    velocity_noise: float
    velocity_fixes: int
    inertial: InertialErrors
    inertial_interval: float

    @classmethod
    def from_settings(
        cls, settings: Mapping[str, Setting], inertial: InertialErrors | None = None
    ) -> Scene:
        """Return the scene of a scenario.

        Parameters
        ----------
        settings : mapping of str to Setting
            From `load_scenario`; files may be joined by ``|``.
        inertial : InertialErrors, optional
            The errors of the INS, in place of those of the settings.

        Returns
        -------
        Scene

        Raises
        ------
        InswsnError
            If a setting is missing or unknown.
        ParameterError
            If a number is negative or not finite that may not be, a count is not whole, an area is
            larger than the scene, or there is no such source of velocities.
        """
        values: dict[str, Any] = {name: setting.value for name, setting in settings.items()}
        parts = {f.name for kind in (Ranging, InertialErrors) for f in fields(kind)}
        own = {f.name for f in fields(cls)} - {"ranging", "inertial"}
        wanted = own | (parts if inertial is None else {f.name for f in fields(Ranging)})
        unknown, absent = sorted(set(values) - own - parts), sorted(wanted - set(values))
        if unknown or absent:
            raise InswsnError(
                f"The scenario {'has an unknown' if unknown else 'lacks the'} setting "
                f"{(unknown or absent)[0]}."
            )
        _check_values(values)
        ranging, taken = take(values, Ranging), take(values, InertialErrors)
        values = {name: frozen(value) for name, value in values.items()}
        for name in _COUNTS:
            values[name] = int(values[name])
        return cls(ranging=ranging, inertial=inertial or taken, **values)

    @cached_property
    def windows(self) -> dict[str, Window]:
        """The four windows, by name: area1, outage1, area2, outage2."""
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
        """The reference nodes of each area: a grid around the path inside it, within the scene.

        Its middle is that of the path, or as near to that as the edges of the scene allow.
        """
        found = {}
        for name, size in zip(("area1", "area2"), self.area_sizes, strict=True):
            inside = self.path.drive(self.speed, self.windows[name].times).position
            middle = (inside.min(axis=0) + inside.max(axis=0)) / 2
            corner = np.clip(middle - size / 2, 0.0, np.array(self.size) - size)
            found[name] = node_grid(corner, (size, size), self.spacing)
        return found

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
            ``"ins.NAME"``, (samples, 4, runs), for each window: the error of the INS, position (m)
            and velocity (m/s). ``"wsn.NAME"`` for each area: the error of the network, NaN where
            it has no fix.
        """
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
            found[f"wsn.{area}"] = self._network_errors(area, self.windows[area], network, runs)
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

    def _network_errors(
        self, name: str, window: Window, rng: np.random.Generator, runs: int
    ) -> Array:
        truth = self.path.drive(self.speed, window.times)
        errors = np.empty((window.samples, 4, runs))
        ranges_of, velocities_of = rng.spawn(2)
        heard = [nodes_heard(self.nodes[name], p, self.ranging.reach) for p in truth.position]
        ranges = [
            measure_ranges(nodes, position, self.ranging, ranges_of, runs)
            for nodes, position in zip(heard, truth.position, strict=True)
        ]
        errors[:, :2] = multilaterate_each(heard, ranges) - truth.position[:, :, None]
        if self.velocity_source == "sensor":
            normal = velocities_of.standard_normal((window.samples, 2, runs))
            errors[:, 2:] = self.velocity_noise * normal
        else:
            fixes = 2 if self.velocity_source == "difference" else self.velocity_fixes
            measured = errors[:, :2] + truth.position[:, :, None]
            errors[:, 2:] = (
                velocity_slopes(measured, window.period, fixes) - truth.velocity[:, :, None]
            )
        return errors


def _check_values(values: Mapping[str, Any]) -> None:
    for name in _COUNTS:
        if values[name] != int(values[name]) or values[name] < 1:
            raise ParameterError(name, values[name], "a whole number, 1 or more")
    for name in _POSITIVE + _NOT_NEGATIVE + _SHARES:
        numbers = np.atleast_1d(np.asarray(values.get(name, 1.0)))
        if numbers.dtype.kind not in "if" or not np.isfinite(numbers).all():
            raise ParameterError(name, values[name], "finite numbers")
        if (numbers < 0).any() or (name in _POSITIVE and (numbers == 0).any()):
            raise ParameterError(
                name, values[name], "positive" if name in _POSITIVE else "not negative"
            )
        if name in _SHARES and (numbers > 1).any():
            raise ParameterError(name, values[name], "between 0 and 1")
    size, sides = np.asarray(values["size"]), np.asarray(values["area_sizes"])
    if size.shape != (2,) or sides.shape != (2,) or size.min() < sides.max():
        raise ParameterError("size", values["size"], "two numbers, none below a side of an area")
    if values["velocity_source"] not in _SOURCES:
        raise ParameterError("velocity_source", values["velocity_source"], f"one of {_SOURCES}")


def _interpolate(values: Array, places: Array) -> Array:
    """Return values (steps, n, runs) at fractional places (samples, runs), linearly."""
    last = len(values) - 2
    floor = np.clip(places.astype(int), 0, last)
    share = (places - floor)[:, None, :]
    run = np.arange(values.shape[2])
    below, above = (np.moveaxis(values[floor + step, :, run[None]], -1, 1) for step in (0, 1))
    return np.asarray(below + share * (above - below))
