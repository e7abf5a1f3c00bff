"""A body on a made path, exactly: what its IMU says, fixes and ranges of it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.interpolate import PchipInterpolator
from scipy.spatial.transform import Rotation

from inswsn_lib import inertial as nav
from inswsn_lib.checks import Array
from inswsn_lib.inertial import sensors
from inswsn_lib.inertial.mechanization import GRAVITY
from inswsn_lib.streams import Fixes, Imu, Ranges

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

    def state(self, time: float) -> nav.InertialState:
        t = np.array(time)
        return nav.InertialState(self.position(t), self.velocity(t), self.attitude(t).as_matrix())

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
    biases: Array | tuple[Array, Array] | None = None,
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


#: What a filter is told of an IMU as in `motion_on`
NOISE = nav.ImuNoise(0.02, 0.002, 1e-3, 1e-5)


def motion_on(
    path: Path, seconds: float, rng: np.random.Generator | None = None, *,
    biases: Array | None = None, earth: nav.Earth | None = None,
) -> nav.InertialMotion:  # fmt: skip
    """Return the motion by an IMU on a path, as noisy as is told of it."""
    imu = imu_of(path, seconds, rng, force=NOISE.force, rate=NOISE.rate, biases=biases)
    return nav.InertialMotion(imu, NOISE, earth)


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
    silent = nav.Velocities(np.array([end]), np.full((1, 2), np.nan), np.ones(2))
    start = nav.Start(begin, state, np.zeros((state.errors, state.errors)))
    found = nav.run_error_state(motion, start, [silent])
    return found.states[0], found.transitions[0], found.covariances[0]


#: Of a cheap IMU: noises, and the largest biases, m/s^2 and rad/s
CHEAP = nav.ImuNoise(0.0047, 0.0008, 1e-4, 1e-5)
LARGEST_BIASES = 0.1 * GRAVITY, np.radians(5)


@dataclass(frozen=True, eq=False)
class Log:
    """A vehicle's log of 70 s: 100 Hz IMU with biases, 5 Hz fixes, perhaps with velocities.

    At rest or moving at the beginning, with turns or without; the IMU is mounted at some angles.
    """

    seed: int
    rest: float  # s
    turns: bool
    velocities: bool
    spin: float = 0.0  # rad/s, in place, as long as it would be at rest

    @classmethod
    def drawn(cls, seed: int) -> Log:
        rng = np.random.default_rng([1, seed])
        rest = rng.uniform(5, 25) * (rng.random() < 0.5)
        return cls(seed, rest, rng.random() < 0.5, rng.random() < 0.7)

    def make(self) -> tuple[nav.InertialMotion, list, Callable[[float], Rotation], Array]:
        """Return motion, observations, the attitude at a time, and both biases, (2, 3)."""
        rng, t = np.random.default_rng([2, self.seed]), np.arange(0, 70, PERIOD)
        knots = np.cumsum([self.rest, *rng.uniform(3, 8, 24)])
        speeds = np.where(rng.random(25) < 0.1, 0, rng.uniform(3, 14, 25))
        speeds[0] = 0 if self.rest else rng.uniform(2, 12)
        speed = PchipInterpolator([-5, *knots], [speeds[0], *speeds])(t)
        rate = np.zeros(len(t))
        begin = self.rest + rng.uniform(4, 20)
        while self.turns and begin < 70:
            long, angle = rng.uniform(3, 7), rng.choice([-1, 1]) * rng.uniform(0.6, 1.7)
            inside = (t > begin) & (t < begin + long)
            rate[inside] = 2 * angle / long * np.sin(np.pi * (t[inside] - begin) / long) ** 2
            begin += long + rng.uniform(3, 20)
        rate *= speed > 0.5
        rate[t < self.rest] = self.spin
        yaw = rng.uniform(0, 2 * np.pi) + np.cumsum(rate) * PERIOD
        velocity = np.stack([speed * np.cos(yaw), speed * np.sin(yaw), 0 * yaw], -1)
        steps = 0.5 * (velocity[1:] + velocity[:-1]) * PERIOD
        position = np.vstack([np.zeros(3), np.cumsum(steps, axis=0)])
        mounted = Rotation.from_euler("ZYX", rng.normal(size=3) * [0.2, 0.05, 0.05])
        attitude = Rotation.from_euler("z", yaw[:, None]) * mounted
        turned = (attitude[:-2].inv() * attitude[2:]).as_rotvec() / (2 * PERIOD)
        pushed = np.gradient(velocity, PERIOD, axis=0) + np.array([0.0, 0.0, GRAVITY])
        biases = rng.uniform(-1, 1, (2, 3)) * np.array(LARGEST_BIASES)[:, None]
        white = rng.standard_normal((2, len(t), 3)) / PERIOD**0.5
        imu = Imu(
            t,
            np.pad(turned, ((1, 1), (0, 0)), "edge") + biases[1] + CHEAP.rate * white[1],
            attitude.inv().apply(pushed) + biases[0] + CHEAP.force * white[0],
        )
        rows = slice(0, None, 20)
        size = np.array([5.0, 5.0, 10.0]) if self.velocities else np.array([0.5, 0.5, 1.0])
        noise = rng.standard_normal((2, *position[rows].shape))
        fixes = Fixes(t[rows], position[rows] + size * noise[0])
        seen: list = [nav.PositionFixes(fixes, np.zeros(3), size)]
        if self.velocities:
            told = velocity[rows] + 0.05 * noise[1]
            seen.append(nav.Velocities(fixes.time, told, np.full(3, 0.05)))
        return (
            nav.InertialMotion(imu, CHEAP), seen,
            lambda time: attitude[round(time / PERIOD)], biases,
        )  # fmt: skip


def off_by(start: nav.Start, true: Rotation) -> Array:
    """Return the errors of attitude about the axes of the frame, in their deviations, (3,)."""
    found = start.state.attitude
    error = found @ Rotation.from_matrix(true.as_matrix().T @ found).as_rotvec()
    turn = found @ start.covariance[6:9, 6:9] @ found.T
    return np.asarray(error / np.sqrt(np.diag(turn)))


def compass(time: Array, heading: Array, white: float, earth: nav.Earth, **more: Any) -> nav.Sensor:
    """Return headings of the body's forward axis; with deviations the first of them is a bias."""
    own = 0 if "deviations" in more else -1
    data = np.array([[1.0, 0.0, 0.0, *earth.numbers, own, -1]])
    told = heading[:, None], np.array([white]), data
    return nav.Sensor(sensors.heading, time, *told, period=2 * np.pi, **more)
