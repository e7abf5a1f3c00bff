"""Logs of several kinds, drawn at random, of which all is right: set-up, clocks, units and axes."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from made_recording import GRAVITY, coloured
from scipy.interpolate import CubicSpline
from scipy.ndimage import gaussian_filter1d
from scipy.spatial.transform import Rotation

from inswsn_lib.checks import Array
from inswsn_lib.streams import Fixes, Imu, Odometry, Ranges, Recording, Reference

Random = np.random.Generator

_STEP = 0.005  # s, of what is known of a motion
_ENDS = 1.0  # s, before and after a log


class Motion:
    """A place and an attitude that are smooth functions of time, and what an IMU feels of them."""

    def __init__(self, time: Array, place: Array, angles: Array) -> None:
        self._place = CubicSpline(time, place)
        self._angles = CubicSpline(time, angles)  # of yaw, pitch and roll

    def place(self, time: Array, arm: Array | float = 0.0) -> Array:
        """Return where a point of the body is, (n, 3)."""
        return np.asarray(self._place(time) + self.attitude(time).apply(np.zeros(3) + arm))

    def attitude(self, time: Array) -> Rotation:
        """Return what turns vectors of the body into the frame."""
        return Rotation.from_euler("ZYX", self._angles(time))

    def velocity(self, time: Array) -> Array:
        """Return that of the body, (n, 3)."""
        return np.asarray(self._place(time, 1))

    def felt(self, time: Array) -> tuple[Array, Array]:
        """Return angular rates and specific forces, (n, 3)."""
        half = 1e-3
        turned = self.attitude(time - half).inv() * self.attitude(time + half)
        push = self._place(time, 2) + np.array([0.0, 0.0, GRAVITY])
        return turned.as_rotvec() / (2 * half), self.attitude(time).inv().apply(push)


def carried(rng: Random, seconds: float, size: Array) -> Motion:
    """Carry a tag about a room, now and then at rest."""
    time = np.arange(-_ENDS, seconds + _ENDS, _STEP)
    going = np.repeat(rng.random(int(seconds / 5) + 3) < 0.85, round(5 / _STEP))[: len(time)]
    t = np.cumsum(gaussian_filter1d(going.astype(float), 0.5 / _STEP)) * _STEP
    waves = [
        sum(
            rng.uniform(0.3, 1) / k * np.sin(k * rng.uniform(0.2, 0.7) * t + rng.uniform(0, 6))
            for k in (1, 2, 3)
        )
        for _ in range(6)
    ]
    place = 0.25 * size * np.column_stack(waves[:3]) + [0, 0, 1.2]
    angles = np.column_stack([2 * waves[3], 0.4 * waves[4], 0.4 * waves[5]])
    return Motion(time, place, angles)


def driven(rng: Random, seconds: float, speed: float, turn: float) -> Motion:
    """Drive on a plane: stretches of one speed or none, and turns now and then."""
    time = np.arange(-_ENDS, seconds + _ENDS, _STEP)
    parts = rng.uniform(4, 20, int(seconds / 4) + 2)
    which = np.searchsorted(np.cumsum(parts), time + _ENDS)
    speeds = speed * rng.uniform(0.4, 1, len(parts) + 1) * (rng.random(len(parts) + 1) < 0.85)
    v = gaussian_filter1d(speeds[which], 1.0 / _STEP)
    rates = turn * rng.uniform(-1, 1, len(parts) + 1) * (rng.random(len(parts) + 1) < 0.5)
    # what stands does not turn
    yaw = np.cumsum(gaussian_filter1d(rates[which], 0.7 / _STEP) * v / speed) * _STEP
    yaw += rng.uniform(0, 6)
    way = np.cumsum(v[:, None] * np.column_stack([np.cos(yaw), np.sin(yaw), 0 * yaw]), axis=0)
    place = way * _STEP
    level = np.zeros_like(yaw)
    return Motion(time, place - place.mean(axis=0), np.column_stack([yaw, level, level]))


def imu_of(rng: Random, motion: Motion, seconds: float) -> Imu:
    """Return what an IMU of some rate, bias and noise logs of a motion."""
    time = np.arange(0.0, seconds, 1 / rng.choice([50, 100, 200]))
    rate, force = motion.felt(time)
    noise = float(rng.uniform(0.002, 0.02))
    rate = rate + rng.normal(0, 0.01, 3) + noise * rng.normal(size=rate.shape)
    force = force + rng.normal(0, 0.05, 3) + 5 * noise * rng.normal(size=force.shape)
    return Imu(time, rate, force)


def _reference(
    rng: Random, motion: Motion, seconds: float, rates: list[int], noise: float, turned: bool
) -> Reference:
    time = np.arange(0.0, seconds, 1 / rng.choice(rates))
    time = time[rng.random(len(time)) > rng.choice([0.0, 0.02])]
    place = motion.place(time) + noise * rng.normal(size=(len(time), 3))
    small = Rotation.from_rotvec(0.002 * rng.normal(size=(len(time), 3)))
    return Reference(time, place, (motion.attitude(time) * small).as_quat() if turned else None)


def _ranges(rng: Random, where: Callable[[Array], Array], seconds: float, anchors: Array) -> Ranges:
    count = len(anchors)
    rate = float(rng.uniform(2, 8)) * count
    time = np.arange(0.05, seconds - 0.05, 1 / rate)
    heard = np.arange(len(time)) % count
    if rng.random() < 0.5:
        time = np.sort(rng.uniform(0.05, seconds - 0.05, len(time)))
        heard = rng.integers(count, size=len(time))
    d = anchors.shape[1]
    distance = np.linalg.norm(where(time)[:, :d] - anchors[heard], axis=1)
    noise, lasting = float(rng.uniform(0.02, 0.12)), float(rng.uniform(0, 0.05))
    distance += rng.uniform(-0.05, 0.05, count)[heard] + noise * rng.normal(size=len(time))
    for k in range(count):
        mine = heard == k
        distance[mine] += lasting * coloured(rng, time[mine], float(rng.uniform(0.3, 2)))
    echo = rng.random(len(time)) < rng.choice([0.0, 0.03])
    distance = np.abs(distance + echo * rng.exponential(1.0, len(time)))
    kept = rng.random(len(time)) > rng.choice([0.0, 0.1])
    names = tuple(f"a{k}" for k in range(count))
    return Ranges(time[kept], heard[kept], distance[kept].round(3), anchors, names)


def made_tag(seed: int) -> Recording:
    """Make a tag with an IMU that is carried about a room of eight anchors."""
    rng = np.random.default_rng([seed, 1])
    seconds, size = float(rng.uniform(60, 150)), rng.uniform([6, 5, 2.5], [14, 10, 4])
    motion, arm = carried(rng, seconds, size * [1, 1, 0.5]), rng.normal(0, 0.08, 3)
    corners = np.array([[x, y, z] for x in (-0.5, 0.5) for y in (-0.5, 0.5) for z in (0, 1)])
    anchors = corners * size + rng.normal(0, 0.2, (8, 3))
    ranges = _ranges(rng, lambda t: motion.place(t, arm), seconds, anchors)
    turned = bool(rng.random() < 0.8)
    reference = _reference(rng, motion, seconds, [20, 50, 100], 0.002, turned)
    if not turned:
        ranges = _ranges(rng, motion.place, seconds, anchors)
    imu = imu_of(rng, motion, seconds) if rng.random() < 0.8 else None
    return Recording(
        f"tag {seed}", imu=imu, ranges=ranges, reference=reference, lever_arm=arm * turned
    )


def made_car(seed: int) -> Recording:
    """Make a car with an IMU and fixes at 1 to 5 Hz, with velocities or without."""
    rng = np.random.default_rng([seed, 2])
    seconds = float(rng.uniform(120, 300))
    motion = driven(rng, seconds, float(rng.uniform(4, 16)), float(rng.uniform(0.15, 0.5)))
    kind, arm = rng.integers(3), rng.normal(0, 0.3, 3)  # of reference: none, places, attitudes
    arm = arm * (kind == 2)
    time = np.arange(0.1, seconds - 0.1, 1 / rng.choice([1, 2, 5]))
    errors = float(rng.uniform(0.02, 1.0)) * rng.normal(size=(len(time), 3))
    if rng.random() < 0.4:
        errors += float(rng.uniform(0.1, 1.0)) * np.column_stack(
            [coloured(rng, time, 20.0) for _ in range(3)]
        )
    velocity = motion.velocity(time) + rng.normal(0, 0.05, (len(time), 3))
    fixes = Fixes(
        time, (motion.place(time, arm) + errors).round(3), velocity if rng.random() < 0.5 else None
    )
    reference = _reference(rng, motion, seconds, [5, 10, 50], 0.01, kind == 2) if kind else None
    imu = imu_of(rng, motion, seconds)
    return Recording(f"car {seed}", imu=imu, fixes=fixes, reference=reference, lever_arm=arm)


def made_robot(seed: int) -> Recording:
    """Make a robot on a plane with odometry and ranges."""
    rng = np.random.default_rng([seed, 3])
    seconds = float(rng.uniform(100, 300))
    motion = driven(rng, seconds, float(rng.uniform(0.4, 2)), float(rng.uniform(0.3, 0.8)))
    time = np.arange(0.0, seconds, 0.1)
    place = motion.place(time)
    size = np.ptp(place[:, :2], axis=0) + 6
    count = int(rng.integers(4, 9))
    angles = 2 * np.pi * (np.arange(count) + rng.uniform(0.1, 0.9, count)) / count
    around = np.column_stack([np.cos(angles), np.sin(angles)])
    anchors = 0.7 * size * around + place[:, :2].mean(axis=0)
    ranges = _ranges(rng, motion.place, seconds, anchors)
    heading = np.unwrap(motion.attitude(time).as_euler("ZYX")[:, 0])
    speed = np.linalg.norm(np.diff(place, axis=0), axis=1) / 0.1
    odometry = Odometry(
        time[1:],
        speed * (1 + 0.02 * rng.normal()) + 0.01 * rng.normal(size=len(speed)),
        np.diff(heading) / 0.1 + 0.01 * rng.normal(size=len(speed)),
    )
    reference = _reference(rng, motion, seconds, [5, 10, 50], 0.01, bool(rng.random() < 0.6))
    reference = Reference(reference.time, reference.position[:, :2], reference.attitude)
    return Recording(f"robot {seed}", odometry=odometry, ranges=ranges, reference=reference)


MADE_LOGS = {"tag": made_tag, "car": made_car, "robot": made_robot}
