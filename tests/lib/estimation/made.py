"""A body on a made path, exactly: what its IMU says, fixes and ranges of it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from inswsn_lib.estimation import InertialState, Start, Velocities, run_error_state
from inswsn_lib.estimation.mechanization import GRAVITY
from inswsn_lib.streams import Fixes, Imu, Ranges

Array = NDArray[np.float64]
PERIOD = 0.01
ANCHORS = np.array(
    [[4.0, 3, 0.2], [-4, 3, 2.5], [-4, -3, 0.3], [4, -3, 2.4], [0, 4, 2.6], [0, -4, 0.1]]
)
LEVER_ARM = np.array([0.1, -0.05, 0.2])


@dataclass(frozen=True, eq=False)
class Path:
    """Positions are sums of sines, the body turns about all its axes; all derivatives are exact."""

    phase: float = 0.0

    def position(self, t: Array) -> Array:
        return np.stack(
            [2 * np.sin(0.5 * t + self.phase), 1.5 * np.sin(0.8 * t), 1 + 0.2 * np.sin(t)], -1
        )

    def velocity(self, t: Array) -> Array:
        return np.stack([np.cos(0.5 * t + self.phase), 1.2 * np.cos(0.8 * t), 0.2 * np.cos(t)], -1)

    def start(self) -> InertialState:
        """The state at 0 s."""
        zero = np.array(0.0)
        return InertialState(
            self.position(zero), self.velocity(zero), self.attitude(zero).as_matrix()
        )

    def acceleration(self, t: Array) -> Array:
        return np.stack(
            [-0.5 * np.sin(0.5 * t + self.phase), -0.96 * np.sin(0.8 * t), -0.2 * np.sin(t)], -1
        )

    def attitude(self, t: Array) -> Rotation:
        """Yaw, then pitch, then roll."""
        return Rotation.from_euler("ZYX", np.stack([0.6 * t, 0.3 * np.sin(t), 0.2 * np.cos(t)], -1))

    def heading(self, t: Array) -> Array:
        """Of the x axis of the body, to the left."""
        return 0.6 * t

    def rate(self, t: Array) -> Array:
        """By a central difference over 0.1 ms, exact to 1e-8."""
        h = 5e-5
        return (self.attitude(t - h).inv() * self.attitude(t + h)).as_rotvec() / (2 * h)

    def force(self, t: Array) -> Array:
        return self.attitude(t).inv().apply(self.acceleration(t) + np.array([0.0, 0.0, GRAVITY]))

    def antenna(self, t: Array) -> Array:
        return self.position(t) + self.attitude(t).apply(LEVER_ARM)


def imu_of(
    path: Path,
    seconds: float,
    rng: np.random.Generator | None = None,
    *,
    force: float = 0.0,
    rate: float = 0.0,
    biases: tuple[Array, Array] | None = None,
) -> Imu:
    """Return an IMU's samples with white noise of some densities and constant biases."""
    t = np.arange(0, seconds + PERIOD / 2, PERIOD)
    f, w = path.force(t), path.rate(t)
    if rng is not None:
        f = f + force / PERIOD**0.5 * rng.standard_normal(f.shape)
        w = w + rate / PERIOD**0.5 * rng.standard_normal(w.shape)
    if biases is not None:
        f, w = f + biases[0], w + biases[1]
    return Imu(t, w, f)


def fixes_of(path: Path, seconds: float, errors: Array | float, period: float = 0.2) -> Fixes:
    t = np.arange(period, seconds, period)
    return Fixes(t, path.antenna(t) + errors)


def ranges_of(path: Path, seconds: float, rng: np.random.Generator, deviation: float) -> Ranges:
    """Return two ranges each 20 ms, to anchors in turn."""
    t = np.repeat(np.arange(0.02, seconds, 0.02), 2)
    anchor = np.arange(len(t)) % len(ANCHORS)
    distance = np.linalg.norm(path.antenna(t) - ANCHORS[anchor], axis=1)
    noise = deviation * rng.standard_normal(len(t))
    return Ranges(t, anchor, distance + noise, ANCHORS, tuple("abcdef"))


def ahead(motion: Any, begin: float, end: float, state: Any) -> tuple[Any, Array, Array]:
    """Return the state at a later time, with transition and covariance from one that is certain."""
    silent = Velocities(np.array([end]), np.full((1, 2), np.nan), np.ones(2))
    start = Start(begin, state, np.zeros((state.errors, state.errors)))
    found = run_error_state(motion, start, [silent])
    return found.states[0], found.transitions[0], found.covariances[0]
