"""A drive: what the sensors of a car told, and what is known of the truth."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from inswsn_lib.errors import ParameterError

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Reference:
    """Where the car was.

    Attributes
    ----------
    position : ndarray, (epochs, 3)
        Latitude and longitude (rad), height above the ellipsoid (m).
    velocity : ndarray, (epochs, 3)
        East, north, up (m/s).
    attitude : ndarray, (epochs, 3, 3), optional
        Body (forward, right, down) to east-north-up; None where it is not known, as in a recording.
    gyro_bias, accelerometer_bias : ndarray, (3, runs), optional
        Of each run, at the end of the drive, body axes (rad/s, m/s^2); None in a recording.

    Examples
    --------
    A recording knows no attitude and no biases:

    >>> import numpy as np
    >>> from inswsn_lib.vehicle import Reference
    >>> parked = Reference(position=np.array([[0.56, 2.07, 20.0]] * 3), velocity=np.zeros((3, 3)))
    >>> parked.attitude is None, parked.gyro_bias is None
    (True, True)
    """

    position: Array
    velocity: Array
    attitude: Array | None = None
    gyro_bias: Array | None = None
    accelerometer_bias: Array | None = None


@dataclass(frozen=True)
class Place:
    """Where an outage begins.

    Attributes
    ----------
    name : str
        A few words that a table can show.
    start : int
        The epoch of the last GPS measurement before the outage.

    Examples
    --------
    >>> from inswsn_lib.vehicle import Place
    >>> tunnel = Place("tunnel", start=120)
    >>> f"GPS is last heard at epoch {tunnel.start}, then comes the {tunnel.name}."
    'GPS is last heard at epoch 120, then comes the tunnel.'
    """

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
        (forward, right, down), coning corrected; samples is (epochs - 1) times the samples an
        interval.
    velocity_increments : ndarray, (samples, 3, runs)
        The integral of the specific force over each sample (m/s), in the body frame at the sample's
        beginning, sculling and rotation corrected: what `pyins` calls increments.
    gps_position : ndarray, (epochs, 3, runs)
        Latitude and longitude (rad), height (m); NaN where missing.
    gps_velocity : ndarray, (epochs, 3, runs)
        East, north, up (m/s); NaN where missing.
    compass : ndarray, (epochs, runs)
        Yaw (rad), clockwise from north, in (-pi, pi]; NaN where missing.
    reference : Reference
    places : tuple of Place
        Where outages are to begin.
    origin : {"simulated", "recorded"}
        In a recorded drive the IMU is recorded, GPS and compass are emulated from the reference.

    Raises
    ------
    ParameterError
        If shapes do not fit, an increment is not finite, a measurement is infinite, time is not
        even, samples do not fill the epochs, or a place is not in the drive.

    Examples
    --------
    A car parked on the equator, heading north, for two seconds, with an IMU at 10 Hz: the
    accelerometers tell the reaction to gravity, the gyros the rate of the earth.

    >>> import numpy as np
    >>> from pyins import earth
    >>> from inswsn_lib.vehicle import Drive, Reference
    >>> still = Reference(position=np.zeros((3, 3)), velocity=np.zeros((3, 3)))
    >>> turns, pushes = np.zeros((2, 20, 3, 1))  # samples, axes, runs
    >>> turns[:, 0], pushes[:, 2] = earth.RATE * 0.1, -earth.gravity(0.0, 0.0) * 0.1
    >>> drive = Drive(
    ...     time=np.arange(3.0), period=0.1, rotation_increments=turns, velocity_increments=pushes,
    ...     gps_position=np.zeros((3, 3, 1)), gps_velocity=np.zeros((3, 3, 1)),
    ...     compass=np.zeros((3, 1)), reference=still, places=(), origin="simulated",
    ... )
    >>> drive.interval, drive.samples_per_epoch, drive.runs, drive.increments[0].shape
    (1.0, 10, 1, (1, 2, 10, 3))
    """

    time: Array
    period: float
    rotation_increments: Array
    velocity_increments: Array
    gps_position: Array
    gps_velocity: Array
    compass: Array
    reference: Reference
    places: tuple[Place, ...]
    origin: Literal["simulated", "recorded"]

    def __post_init__(self) -> None:
        epochs, runs = len(self.time), self.compass.shape[-1]
        samples = (epochs - 1) * self.samples_per_epoch
        shapes = {
            "rotation_increments": (samples, 3, runs),
            "velocity_increments": (samples, 3, runs),
            "gps_position": (epochs, 3, runs),
            "gps_velocity": (epochs, 3, runs),
            "compass": (epochs, runs),
        }
        for name, shape in shapes.items():
            value = getattr(self, name)
            if value.shape != shape:
                raise ParameterError(name, f"of shape {value.shape}", f"of shape {shape}")
        for name in ("rotation_increments", "velocity_increments"):
            if not np.isfinite(getattr(self, name)).all():
                raise ParameterError(name, "not finite", "finite: an INS has no gaps")
        steps = np.diff(self.time)
        even = np.allclose(steps, self.interval, rtol=0, atol=1e-6 * self.interval)
        if not even or abs(self.interval / self.period - self.samples_per_epoch) > 1e-6:
            raise ParameterError(
                "time", "uneven", "even, with a whole number of IMU samples a step"
            )
        for name in ("gps_position", "gps_velocity", "compass"):
            if np.isinf(getattr(self, name)).any():
                raise ParameterError(name, "infinite", "finite, or NaN where missing")
        for place in self.places:
            if not 0 <= place.start < epochs:
                raise ParameterError("places", place, f"one that starts at 0 to {epochs - 1}")

    @property
    def interval(self) -> float:
        """The time between two epochs (s)."""
        return float(self.time[1] - self.time[0])

    @property
    def samples_per_epoch(self) -> int:
        """How many IMU samples fill the time between two epochs."""
        if len(self.time) < 2:
            raise ParameterError("time", f"{len(self.time)} epochs", "two or more")
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
            np.ascontiguousarray(np.moveaxis(x, 2, 0)).reshape(shape)
            for x in (self.rotation_increments, self.velocity_increments)
        )
        return turns, pushes
