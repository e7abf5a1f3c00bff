"""A small drive made with the simulator of pyins, independent of this library's own.

The car stands for two seconds, speeds up, and winds through curves; it never slides sideways.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cache
from typing import Any

import numpy as np
import pandas as pd
from pyins import sim, strapdown, transform
from pyins.util import ACCEL_COLS, GYRO_COLS, LLA_COLS, TRAJECTORY_COLS, VEL_COLS

from inswsn_lib.simulation import Drive, DriveReference, Place
from inswsn_lib.streams import Fixes, Imu, Recording
from inswsn_lib.vehicle import FilterSettings, VehicleRun, VehicleState

#: North-east-down to east-north-up
TURN = np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]])
THETA, DV = ["theta_x", "theta_y", "theta_z"], ["dv_x", "dv_y", "dv_z"]
PERIOD = 0.01
ACCEL_NOISE, GYRO_NOISE = 0.01, np.deg2rad(0.05)
ACCEL_BIAS, GYRO_BIAS = 0.05, np.deg2rad(0.1)
COMPASS, GPS_POSITION, GPS_VELOCITY = np.deg2rad(0.15), 3.0, 0.05

#: What a filter is told that knows how the drives below were made
KNOWN = FilterSettings(
    accelerometer_noise=ACCEL_NOISE, gyro_noise=GYRO_NOISE,
    accelerometer_walk=1e-6, gyro_walk=1e-8,
    position=GPS_POSITION, velocity=GPS_VELOCITY, tilt=np.deg2rad(2), yaw=np.deg2rad(5),
    accelerometer_bias=ACCEL_BIAS, gyro_drift=GYRO_BIAS,
    compass=COMPASS, lateral=0.05, gps_position=GPS_POSITION, gps_velocity=GPS_VELOCITY,
)  # fmt: skip


@dataclass(frozen=True, eq=False)
class Made:
    """What was driven: the trajectory (north-east-down, degrees) and increments without error.

    The integrals of rate and force, (samples + 1, 6), begin with a sample before the first.
    """

    trajectory: pd.DataFrame
    integrals: np.ndarray
    increments: pd.DataFrame


@cache
def driven(duration: int, mounting: float = 0.0) -> Made:
    """Return the drive; the IMU's forward axis is `mounting` (rad) left of the car's."""
    time = np.arange(duration * 100 + 1) * PERIOD
    begun = np.clip(time - 2, 0, None)
    speed = 10 * (1 - np.exp(-(begun**2) / 50)) + 2 * np.sin(begun / 7) * (1 - np.exp(-begun / 5))
    heading = 0.5 + 1.2 * np.sin(begun / 11) * (1 - np.exp(-begun / 5)) + begun / 60
    pitch = 0.02 * np.sin(begun / 13)
    forward = np.stack(
        [np.cos(pitch) * np.cos(heading), np.cos(pitch) * np.sin(heading), -np.sin(pitch)], axis=-1
    )
    # the axes of the IMU: those of the car, turned to the left about its down axis
    car = transform.mat_from_rph(np.rad2deg(np.stack([0 * pitch, pitch, heading], axis=-1)))
    rph = transform.mat_to_rph(car @ transform.mat_from_rph([0, 0, -np.rad2deg(mounting)]))
    trajectory, imu = sim.generate_imu(
        time, [50.0, 60.0, 100.0], rph, speed[:, None] * forward, "increment"
    )
    integrals = imu[[*GYRO_COLS, *ACCEL_COLS]].to_numpy()
    return Made(trajectory, integrals, strapdown.compute_increments_from_imu(imu, "increment"))


def logged(made: Made, integrals: np.ndarray) -> Recording:
    """Return a recording of the drive with other integrals: each sample is logged at both ends."""
    epochs = made.trajectory.iloc[::100]
    lla = epochs[LLA_COLS].to_numpy()
    position, velocity = transform.lla_to_ned(lla) @ TURN, epochs[VEL_COLS].to_numpy() @ TURN
    steps = np.arange(-1, len(integrals) + 1)
    time = PERIOD * np.column_stack([steps - 1 + 1e-4, steps - 1e-4]).ravel()
    rate, force = np.split(np.pad(integrals, ((1, 1), (0, 0)), "edge").repeat(2, 0) / PERIOD, 2, 1)
    return Recording(
        "made",
        imu=Imu(time, rate, force),
        fixes=Fixes(np.arange(float(len(epochs))), position, velocity),
        origin=np.array([*np.deg2rad(lla[0, :2]), lla[0, 2]]),
    )


def make_drive(
    duration: int = 60,
    runs: int = 1,
    *,
    seed: int = 0,
    mounting: float = 0.0,
    compass_bias: float = 0.0,
    compass_noise: float = COMPASS,
    errors: float = 1.0,
) -> Drive:
    """Return a drive with sensors: `errors` scales noise and biases of the IMU."""
    rng = np.random.default_rng(seed)
    made = driven(duration, mounting)
    epochs = made.trajectory.iloc[::100]
    size = (3, runs)
    gyro_bias = errors * rng.normal(0, GYRO_BIAS, size)
    accel_bias = errors * rng.normal(0, ACCEL_BIAS, size)
    samples = len(made.increments)
    root = np.sqrt(PERIOD)
    theta = made.increments[THETA].to_numpy()[:, :, None] + gyro_bias * PERIOD
    dv = made.increments[DV].to_numpy()[:, :, None] + accel_bias * PERIOD
    theta = theta + errors * rng.normal(0, GYRO_NOISE * root, (samples, *size))
    dv = dv + errors * rng.normal(0, ACCEL_NOISE * root, (samples, *size))

    position = np.column_stack([np.deg2rad(epochs.lat), np.deg2rad(epochs.lon), epochs.alt])
    velocity = epochs[["VN", "VE", "VD"]].to_numpy() @ TURN
    attitude = TURN @ transform.mat_from_rph(epochs[["roll", "pitch", "heading"]])
    gps = transform.perturb_lla(
        np.repeat(epochs[["lat", "lon", "alt"]].to_numpy(), runs, axis=0),
        rng.normal(0, GPS_POSITION, (len(epochs) * runs, 3)),
    ).reshape(len(epochs), runs, 3)
    gps[..., :2] = np.deg2rad(gps[..., :2])
    yaw = np.deg2rad(epochs.heading.to_numpy())[:, None] + mounting
    compass = yaw + compass_bias + rng.normal(0, compass_noise, (len(epochs), runs))
    return Drive(
        time=np.arange(len(epochs)) * 1.0,
        period=PERIOD,
        rotation_increments=theta,
        velocity_increments=dv,
        gps_position=np.moveaxis(gps, 1, 2),
        gps_velocity=velocity[:, :, None] + rng.normal(0, GPS_VELOCITY, (len(epochs), *size)),
        compass=np.angle(np.exp(1j * compass)),
        reference=DriveReference(position, velocity, attitude, gyro_bias, accel_bias),
        places=(Place("middle", len(epochs) // 2),),
        origin="simulated",
    )


def as_table(theta: np.ndarray, dv: np.ndarray, period: float = PERIOD) -> pd.DataFrame:
    """Return increments, (samples, 3) each, as pyins has them."""
    time = period * np.arange(1, len(theta) + 1)
    data = np.column_stack([np.full(len(time), period), theta, dv])
    return pd.DataFrame(data, pd.Index(time, name="time"), ["dt", *THETA, *DV])


def as_pva(position: np.ndarray, velocity: np.ndarray, attitude: np.ndarray) -> pd.Series:
    """Return what is known of a start as pyins has it."""
    lla, rph = np.append(np.rad2deg(position[:2]), position[2]), transform.mat_to_rph
    return pd.Series([*lla, *(TURN @ velocity), *rph(TURN @ attitude)], TRAJECTORY_COLS, name=0.0)


def flown(begun: VehicleState, theta: np.ndarray, dv: np.ndarray) -> VehicleState:
    """Let pyins' public Integrator go on from some runs, by increments (runs, samples, 3)."""
    ends = []
    for r, position in enumerate(begun.position):
        drift, bias = begun.gyro_drift[r] * PERIOD, begun.accelerometer_bias[r] * PERIOD
        start = as_pva(position, begun.velocity[r], begun.attitude[r])
        table = as_table(theta[r] - drift, dv[r] - bias)
        ends.append(strapdown.Integrator(start).integrate(table).iloc[-1])
    last = pd.DataFrame(ends)
    return replace(
        begun,
        position=np.column_stack([np.deg2rad(last.lat), np.deg2rad(last.lon), last.alt]),
        velocity=last[VEL_COLS].to_numpy(float) @ TURN,
        attitude=TURN @ transform.mat_from_rph(last[["roll", "pitch", "heading"]]),
    )


def only(drive: Drive, runs: Sequence[int]) -> Drive:
    """Return some runs of a drive."""
    take = list(runs)
    return replace(drive, **{name: getattr(drive, name)[..., take] for name in SENSORS})


#: A drive with other data
changed = replace
SENSORS = ("rotation_increments", "velocity_increments", "gps_position", "gps_velocity", "compass")


def on_the_way(drive: Drive, epoch: int) -> Drive:
    """Return the drive from an epoch on, when the car moves."""
    first, true = epoch * drive.samples_per_epoch, drive.reference
    assert true.attitude is not None
    later = {name: getattr(true, name)[epoch:] for name in ("position", "velocity", "attitude")}
    samples = {name: getattr(drive, name)[first:] for name in SENSORS[:2]}
    epochs = {name: getattr(drive, name)[epoch:] for name in SENSORS[2:]}
    time, reference = drive.time[: len(drive.time) - epoch], replace(true, **later)
    return replace(drive, time=time, reference=reference, places=(), **samples, **epochs)


def off(one: VehicleRun, two: VehicleRun, a: Any = slice(None), b: Any = slice(None)) -> float:
    """Return how far two runs are apart, at some steps and runs of each: states in deviations."""
    mine, other = one.states[a], two.states[b]
    size = np.sqrt(np.diagonal(other.covariance, axis1=-2, axis2=-1))
    parts = [
        np.abs(getattr(mine, name) - getattr(other, name)) / size[..., where]
        for name, where in (
            ("position", slice(0, 3)), ("velocity", slice(3, 6)), ("error", slice(None)),
            ("accelerometer_bias", slice(9, 12)), ("gyro_drift", slice(12, 15)),
        )
    ]  # fmt: skip
    spread = (mine.covariance - other.covariance) / (size[..., None] * size[..., None, :])
    turned = mine.attitude - other.attitude
    return float(max(np.abs(part).max() for part in (*parts, spread, turned)))
