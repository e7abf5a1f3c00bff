"""What the vehicle's filter believes of its sensors and of its start."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import MISSING, dataclass, field, fields
from typing import Any, Self

import numpy as np

from inswsn_lib import scenario
from inswsn_lib.checks import Array, number, whole
from inswsn_lib.errors import ParameterError
from inswsn_lib.inertial.earth import metres
from inswsn_lib.vehicle.state import (
    ACCELEROMETER_BIAS,
    ATTITUDE,
    GYRO_DRIFT,
    POSITION,
    STATES,
    VELOCITY,
)

#: States that may stand beyond P3's fifteen: how many each takes, and the setting of its deviation
EXTRA_STATES = {
    "compass": (1, "compass_bias"),
    "mounting": (1, "mounting_yaw"),
    "gps": (2, "gps_error"),
}


@dataclass(frozen=True)
class FilterSettings:
    """What the filter believes of the sensors and of its start; standard deviations, SI units.

    Attributes
    ----------
    accelerometer_noise, gyro_noise : float
        White noise (m/s/s^0.5, rad/s^0.5).
    accelerometer_walk, gyro_walk : float
        What drives biases and drifts (m/s^2/s^0.5, rad/s/s^0.5).
    position, velocity, tilt, yaw, accelerometer_bias, gyro_drift : float
        At the start (m, m/s, rad, rad, m/s^2, rad/s).
    compass, lateral, gps_position, gps_velocity : float
        Of the measurements (rad, m/s, m, m/s).
    body_velocity : float
        Of what wheels or a standstill tell, if the drive has any (m/s). P3 has neither.
    gate : float
        A compass measurement whose innovation is larger than this many standard deviations is not
        used. P3 names no gate.
    substeps : int
        Into how many steps the interval between two epochs is divided for the covariance.
    extra : tuple of str
        States beyond P3's fifteen: "compass", a constant bias of the compass; "mounting", the yaw
        of the vehicle's axes from those of the IMU; "gps", an error of the GPS position, east and
        north, that is correlated in time.
    compass_bias, mounting_yaw, gps_error : float
        Their standard deviations (rad, rad, m).
    gps_time : float
        The correlation time of the last (s).

    Raises
    ------
    ParameterError
        If a number is not positive and finite, the steps are not whole, or an extra is not known.

    Examples
    --------
    >>> import inswsn_lib as iw
    >>> p3 = iw.load_scenario(iw.data_file("scenarios/p3.yaml"))
    >>> iw.FilterSettings.from_settings(p3, extra=("compass", "gps")).states
    18
    """

    accelerometer_noise: float
    gyro_noise: float
    accelerometer_walk: float
    gyro_walk: float
    position: float
    velocity: float
    tilt: float
    yaw: float
    accelerometer_bias: float
    gyro_drift: float
    compass: float
    lateral: float
    gps_position: float
    gps_velocity: float
    gate: float = 5.0
    substeps: int = field(default=5, metadata={"range": (1, 1000)})
    extra: tuple[str, ...] = ()
    compass_bias: float = 0.0873
    mounting_yaw: float = 0.0524
    gps_error: float = 3.0
    gps_time: float = 60.0
    body_velocity: float = 0.05

    def __post_init__(self) -> None:
        known = isinstance(self.extra, tuple) and set(self.extra) <= set(EXTRA_STATES)
        if not known or len(set(self.extra)) < len(self.extra):
            raise ParameterError(
                "extra", self.extra, f"a tuple of any of {', '.join(EXTRA_STATES)}, each once"
            )
        whole("substeps", self.substeps, 1)
        for each in fields(self):
            if each.name not in ("extra", "substeps"):
                number(each.name, getattr(self, each.name), above=0)

    @classmethod
    def from_settings(cls, settings: Mapping[str, scenario.Setting], **changes: Any) -> Self:
        """Take the settings of a scenario whose names begin with ``filter_``, with changes."""
        begin = "filter_"
        told = {n.removeprefix(begin): s for n, s in settings.items() if n.startswith(begin)}
        default = {f.name: f.default for f in fields(cls) if f.default is not MISSING}
        values = {name: value for name, value in default.items() if name not in told} | changes
        return scenario.from_settings(cls, told, **values)

    @property
    def states(self) -> int:
        """How many states the filter has."""
        return STATES + sum(EXTRA_STATES[name][0] for name in self.extra)

    def column(self, name: str) -> int:
        """Return the first state of one of `extra`, counted from 0."""
        before = self.extra[: self.extra.index(name)]
        return STATES + sum(EXTRA_STATES[other][0] for other in before)

    @property
    def numbers(self) -> tuple[float, ...]:
        """All settings that are numbers, in the order of the attributes, but `substeps`."""
        return tuple(float(getattr(self, name)) for name in _NUMBERS)

    @property
    def columns(self) -> tuple[int, ...]:
        """The first state of each of `EXTRA_STATES`, -1 where the filter does not have it."""
        return tuple(self.column(name) if name in self.extra else -1 for name in EXTRA_STATES)

    def initial_covariance(self, position: Array) -> Array:
        """Return P at the start, (runs, n, n), at positions (runs, 3).

        Position and yaw are those of GPS and compass, whose lasting errors they share.
        """
        sizes = np.zeros((len(position), self.states))
        sizes[:, POSITION] = self.position / metres(position)
        sizes[:, VELOCITY] = self.velocity
        sizes[:, ATTITUDE] = [self.tilt, self.tilt, self.yaw]
        sizes[:, ACCELEROMETER_BIAS] = self.accelerometer_bias
        sizes[:, GYRO_DRIFT] = self.gyro_drift
        shared = np.zeros((len(position), self.states, self.states)) + np.eye(self.states)
        for name in self.extra:
            i, (count, deviation) = self.column(name), EXTRA_STATES[name]
            sizes[:, i : i + count] = getattr(self, deviation)
            if name == "gps":
                north, east = metres(position)[:, :2].T
                shared[:, 1, i], shared[:, 0, i + 1] = 1 / east, 1 / north
            else:
                shared[:, 8, i] = 1.0
        P = sizes[:, :, None] ** 2 * np.eye(self.states)
        return np.asarray(shared @ P @ np.swapaxes(shared, 1, 2))


_NUMBERS = [f.name for f in fields(FilterSettings) if f.name not in ("extra", "substeps")]
