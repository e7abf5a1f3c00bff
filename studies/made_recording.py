"""Recordings whose clock, frame, lever arm and biases are known, since they are made with them."""

from __future__ import annotations

from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from inswsn_lib.checks import Array
from inswsn_lib.streams import Imu, Odometry, Ranges, Recording, Reference

ROOM = np.array([[x, y, z] for x in (-4.0, 4.0) for y in (-3.0, 3.0) for z in (0.0, 2.5)])
YARD = np.array([[-30.0, -20.0], [30.0, -22.0], [28.0, 20.0], [-31.0, 23.0], [2.0, 30.0]])
GRAVITY = 9.80665


def motion(time: Array, still: bool = False) -> tuple[Array, Rotation]:
    """Move a tag about a room, turned to and fro about all axes; or leave it at rest."""
    t = np.zeros_like(time) if still else time
    place = np.column_stack(
        [
            2.2 * np.sin(0.53 * t) + 0.5 * np.sin(1.9 * t + 1),
            1.6 * np.sin(0.71 * t + 0.4) + 0.4 * np.sin(1.7 * t),
            1.2 + 0.6 * np.sin(0.9 * t + 2),
        ]
    )
    turned = Rotation.from_euler(
        "ZYX",
        np.column_stack([2 * np.sin(0.4 * t), 0.6 * np.sin(1.1 * t), 0.6 * np.sin(0.8 * t + 1)]),
    )
    return place, turned


def coloured(rng: np.random.Generator, time: Array, seconds: float) -> Array:
    """Errors of unit variance whose memory fades within some seconds (Ornstein and Uhlenbeck)."""
    keep = np.exp(-np.diff(time) / seconds)
    error = rng.normal(size=len(time))
    for i, k in enumerate(keep):
        error[i + 1] = k * error[i] + np.sqrt(1 - k**2) * error[i + 1]
    return error


def made(
    seed: int,
    *,
    seconds: float = 60.0,
    rate: float = 40.0,
    clock: float = 0.0,
    turn: tuple[float, float, float] = (0.0, 0.0, 0.0),
    shift: tuple[float, float, float] = (0.0, 0.0, 0.0),
    lever_arm: tuple[float, float, float] = (0.0, 0.0, 0.0),
    bias: Any = 0.0,
    noise: float = 0.05,
    lasting: float = 0.0,
    outliers: float = 0.0,
    still: bool = False,
    anchors: Array = ROOM,
) -> Recording:
    """Ranges from a lever arm's end, late by a clock; the reference is turned back and shifted.

    What is lasting is the deviation of errors of each anchor that fade within a second.
    """
    rng = np.random.default_rng(seed)
    time = np.arange(0.0, seconds, 0.02)
    place, attitude = motion(time, still)
    back = Rotation.from_rotvec(turn).inv()
    reference = Reference(time, back.apply(place - shift), (back * attitude).as_quat())
    stamps = np.sort(rng.uniform(0.2, seconds - 0.2, round(seconds * rate)))
    heard = rng.integers(len(anchors), size=len(stamps))
    where, how = motion(stamps - clock, still)
    tag = where + how.apply(lever_arm)
    d = anchors.shape[1]
    distance = np.linalg.norm(tag[:, :d] - anchors[heard], axis=1)
    distance += np.broadcast_to(bias, len(anchors))[heard] + noise * rng.normal(size=len(stamps))
    if lasting:
        for k in range(len(anchors)):
            mine = heard == k
            distance[mine] += lasting * coloured(rng, stamps[mine], 1.0)
    distance += np.where(rng.random(len(stamps)) < outliers, rng.exponential(3.0, len(stamps)), 0)
    names = tuple(f"a{k}" for k in range(len(anchors)))
    ranges = Ranges(stamps, heard, distance, anchors, names)
    return Recording("made", ranges=ranges, reference=reference)


def made_imu(
    seed: int,
    *,
    seconds: float = 60.0,
    clock: float = 0.0,
    mounted: Any = None,
    noise: float = 0.01,
) -> Imu:
    """Make the IMU of the same body; its axes are turned, and its stamps late."""
    rng = np.random.default_rng(seed + 1000)
    time, step = np.arange(0.0, seconds, 0.01), 1e-3
    _, before = motion(time - step)
    there, attitude = motion(time)
    _, after = motion(time + step)
    rate = (before.inv() * after).as_rotvec() / (2 * step)
    pushed = (motion(time + step)[0] - 2 * there + motion(time - step)[0]) / step**2
    force = attitude.inv().apply(pushed + np.array([0.0, 0.0, GRAVITY]))
    turned = np.eye(3) if mounted is None else Rotation.from_rotvec(mounted).as_matrix()
    rate = rate @ turned.T + 0.01 + noise * rng.normal(size=rate.shape)
    force = force @ turned.T + 0.05 * rng.normal(size=force.shape)
    return Imu(time + clock, rate, force)


def made_drive(seed: int, *, seconds: float = 120.0, noise: float = 0.1) -> Recording:
    """Make a vehicle in the plane with odometry, ranges, and a reference with a heading."""
    rng = np.random.default_rng(seed)
    time = np.arange(0.0, seconds, 0.1)
    speed, rate = 2 + np.sin(0.3 * time), 0.4 * np.sin(0.17 * time) + 0.2
    heading = np.concatenate([[0.0], np.cumsum((rate[1:] + rate[:-1]) / 2 * 0.1)])
    velocity = speed[:, None] * np.column_stack([np.cos(heading), np.sin(heading)])
    place = np.vstack([np.zeros(2), np.cumsum((velocity[1:] + velocity[:-1]) / 2 * 0.1, axis=0)])
    place -= place.mean(axis=0)
    attitude = np.column_stack([0 * time, 0 * time, np.sin(heading / 2), np.cos(heading / 2)])
    stamps = np.sort(rng.uniform(0.5, seconds - 0.5, round(seconds * 12)))
    heard = rng.integers(len(YARD), size=len(stamps))
    tag = np.column_stack([np.interp(stamps, time, x) for x in place.T])
    distance = np.linalg.norm(tag - YARD[heard], axis=1) + noise * rng.normal(size=len(stamps))
    odometry = Odometry(
        time[1:],
        (speed[1:] + speed[:-1]) / 2 + 0.02 * rng.normal(size=len(time) - 1),
        (rate[1:] + rate[:-1]) / 2 + 0.01 * rng.normal(size=len(time) - 1),
    )
    ranges = Ranges(stamps, heard, distance, YARD, tuple("ABCDE"))
    reference = Reference(time, place, attitude)
    return Recording("drive", odometry=odometry, ranges=ranges, reference=reference)
