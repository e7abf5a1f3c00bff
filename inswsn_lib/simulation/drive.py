"""A drive: what the sensors of a car measured, and what is known of the truth."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Literal, NamedTuple

import numpy as np

from inswsn_lib.checks import Array, array
from inswsn_lib.errors import Described, ParameterError


@dataclass(frozen=True, eq=False)
class DriveReference:
    """Where the car was; a recording lacks the last three.

    Attributes
    ----------
    position, velocity : ndarray, (epochs, 3)
        Latitude, longitude (rad), height above the ellipsoid (m); east, north, up (m/s).
    attitude : ndarray, (epochs, 3, 3), optional
        Body (forward, right, down) to east-north-up.
    gyro_bias, accelerometer_bias : ndarray, (3, runs), optional
        At the end of the drive, body axes (rad/s, m/s^2).
    """

    position: Array
    velocity: Array
    attitude: Array | None = None
    gyro_bias: Array | None = None
    accelerometer_bias: Array | None = None


class Place(NamedTuple):
    """Where an outage begins: its name, and the epoch of the last GPS measurement before it."""

    name: str
    start: int


@dataclass(frozen=True, eq=False)
class Drive:
    """One drive, with the sensors of one or many runs.

    The IMU's samples are on an even grid; a whole number of them fills each interval between two
    epochs, and the last sample of an interval ends at its epoch.

    Attributes
    ----------
    time : ndarray, (epochs,)
        Seconds from the first epoch; even steps.
    period : float
        Of the IMU (s).
    rotation_increments : ndarray, (samples, 3, runs)
        The integral of the angular rate over each sample as a rotation vector (rad), body frame
        (forward, right, down), coning corrected.
    velocity_increments : ndarray, (samples, 3, runs)
        The integral of the specific force over each sample (m/s), in the body frame at the sample's
        beginning, sculling and rotation corrected: what `pyins` calls increments.
    gps_position, gps_velocity : ndarray, (epochs, 3, runs)
        As in `DriveReference`; NaN where missing.
    compass : ndarray, (epochs, runs)
        Yaw (rad), clockwise from north; NaN where missing.
    reference : DriveReference
    places : tuple of Place
    origin : {"simulated", "recorded"}
        In a recorded drive the IMU is recorded, GPS and compass are emulated from the reference.
    body_velocity : ndarray, (epochs, 3, runs), optional
        Forward, right and down (m/s), what wheels or a standstill tell of it; NaN where nothing.

    Raises
    ------
    ParameterError
        If shapes do not fit, an increment is missing, time is not even, samples do not fill the
        epochs, or a place is not in the drive.

    Examples
    --------
    >>> import inswsn_lib as iw
    >>> p3 = iw.with_values(iw.load_scenario(iw.data_file("scenarios/p3.yaml")), imu_period=0.1)
    >>> drive = iw.simulate_drive(p3, runs=4, seed=0)
    >>> drive.interval, drive.samples_per_epoch, drive.runs, drive.places[0].name
    (1.0, 10, 4, '90-degree turn')
    """

    time: Array
    period: float
    rotation_increments: Array
    velocity_increments: Array
    gps_position: Array
    gps_velocity: Array
    compass: Array
    reference: DriveReference
    places: tuple[Place, ...]
    origin: Literal["simulated", "recorded"]
    body_velocity: Array | None = None

    def __post_init__(self) -> None:
        epochs, runs = len(self.time), self.compass.shape[-1]
        if epochs < 2:
            raise ParameterError("time", epochs, "at least two epochs long")
        even = np.allclose(np.diff(self.time), self.interval, rtol=0, atol=1e-6 * self.interval)
        if not even or abs(self.interval / self.period - self.samples_per_epoch) > 1e-6:
            raise ParameterError(
                "time", Described("uneven"), "even, with a whole number of IMU samples per step"
            )
        samples = (epochs - 1) * self.samples_per_epoch
        imu, gps = (samples, 3, runs), (epochs, 3, runs)
        for name, shape in (
            ("rotation_increments", imu), ("velocity_increments", imu), ("gps_position", gps),
            ("gps_velocity", gps), ("compass", (epochs, runs)), ("body_velocity", gps),
        ):  # fmt: skip
            if getattr(self, name) is not None:
                found = array(name, getattr(self, name), shape, gaps=shape is not imu)
                object.__setattr__(self, name, found)
        for place in self.places:
            if not 0 <= place.start < epochs:
                raise ParameterError("places", place, f"such that each starts at 0 to {epochs - 1}")

    @property
    def interval(self) -> float:
        """The time between two epochs (s)."""
        return float(self.time[1] - self.time[0])

    @property
    def samples_per_epoch(self) -> int:
        """How many IMU samples fill the time between two epochs."""
        return round(self.interval / self.period)

    @property
    def runs(self) -> int:
        """How many runs share the drive."""
        return int(self.compass.shape[-1])

    @cached_property
    def increments(self) -> tuple[Array, Array]:
        """Rotation and velocity increments by run and interval, (runs, epochs - 1, samples, 3)."""
        shape = (self.runs, len(self.time) - 1, self.samples_per_epoch, 3)
        turns, pushes = (
            np.ascontiguousarray(np.moveaxis(x, 2, 0), dtype=float).reshape(shape)
            for x in (self.rotation_increments, self.velocity_increments)
        )
        return turns, pushes

    @cached_property
    def measurements(self) -> Array:
        """Compass, GPS position and GPS velocity by epoch and run, (epochs, runs, 7)."""
        gps = [np.moveaxis(x, 1, 2) for x in (self.gps_position, self.gps_velocity)]
        return np.concatenate([self.compass[:, :, None], *gps], axis=2)


def wrapped(angle: Array) -> Array:
    """Return angles (rad) in (-pi, pi]."""
    within = np.pi - (np.pi - angle) % (2 * np.pi)
    # the remainder of a number just below zero is rounded to the whole turn
    return np.asarray(np.where(within <= -np.pi, np.pi, within))
