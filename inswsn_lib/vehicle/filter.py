"""The vehicle's Kalman filter with sequential updates (P3 Section 3), for many runs at once."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields, replace
from functools import cache
from typing import Any, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pyins import earth
from scipy.spatial.transform import Rotation

from inswsn_lib.errors import ParameterError
from inswsn_lib.scenario import Setting
from inswsn_lib.vehicle.drive import Drive
from inswsn_lib.vehicle.error_model import (
    ACCELEROMETER_BIAS,
    ATTITUDE,
    GYRO_DRIFT,
    POSITION,
    STATES,
    VELOCITY,
    compass_row,
    discretise,
    earth_rate,
    error_dynamics,
    gps_rows,
    lateral_row,
    metres,
    noise_input,
    transport_rate,
    yaw,
)
from inswsn_lib.vehicle.strapdown import Flight, VehicleState, integrate_strapdown

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

#: States that may stand beyond P3's fifteen, and how many each takes
EXTRA_STATES = {"compass": 1, "mounting": 1, "gps": 2}


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
    >>> from inswsn_lib.files import data_file
    >>> from inswsn_lib.scenario import load_scenario
    >>> from inswsn_lib.vehicle import FilterSettings
    >>> scenario = load_scenario(data_file("scenarios/p3.yaml"))
    >>> settings = FilterSettings.from_settings(scenario)
    >>> settings.gps_position, settings.states
    (3.0, 15)
    >>> FilterSettings.from_settings(scenario, extra=("compass", "gps")).states
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
    substeps: int = 5
    extra: tuple[str, ...] = ()
    compass_bias: float = 0.0873
    mounting_yaw: float = 0.0524
    gps_error: float = 3.0
    gps_time: float = 60.0

    def __post_init__(self) -> None:
        for name in self.extra:
            if name not in EXTRA_STATES or self.extra.count(name) > 1:
                raise ParameterError(
                    "extra", self.extra, f"some of {', '.join(EXTRA_STATES)}, each once"
                )
        whole = isinstance(self.substeps, int | np.integer) and not isinstance(self.substeps, bool)
        if not whole or self.substeps < 1:
            raise ParameterError("substeps", self.substeps, "a whole number, 1 or more")
        if not isinstance(self.extra, tuple):
            raise ParameterError("extra", self.extra, "a tuple of names")
        for field in fields(self):
            value = getattr(self, field.name)
            if field.name in ("extra", "substeps"):
                continue
            number = isinstance(value, int | float | np.number) and not isinstance(value, bool)
            if not number or not 0 < value < np.inf:
                raise ParameterError(field.name, value, "positive and finite")

    @classmethod
    def from_settings(cls, settings: Mapping[str, Setting], **changes: Any) -> Self:
        """Take the settings whose names begin with ``filter_``; `changes` replace some.

        Parameters
        ----------
        settings : mapping of str to Setting
            From `load_scenario`.
        **changes
            Values by the names of the attributes, in place of those of the settings.

        Returns
        -------
        FilterSettings

        Raises
        ------
        ParameterError
            If one is missing, or has a value it may not have.
        """
        begin = "filter_"
        values: dict[str, Any] = {
            name.removeprefix(begin): setting.value
            for name, setting in settings.items()
            if name.startswith(begin)
        }
        if "substeps" in values:
            values["substeps"] = int(values["substeps"])
        try:
            return cls(**(values | changes))
        except TypeError as error:
            raise ParameterError("settings", str(error), "those of FilterSettings") from None

    @property
    def states(self) -> int:
        """How many states the filter has."""
        return STATES + sum(EXTRA_STATES[name] for name in self.extra)

    def column(self, name: str) -> int:
        """Return the first state of an extra.

        Parameters
        ----------
        name : str
            One of `extra`.

        Returns
        -------
        int
            Counted from 0.
        """
        before = self.extra[: self.extra.index(name)]
        return STATES + sum(EXTRA_STATES[other] for other in before)

    def initial_covariance(self, position: Array) -> Array:
        """Return P at the start, (runs, n, n), for positions (runs, 3).

        Parameters
        ----------
        position : ndarray, (runs, 3)
            Latitude, longitude (rad), height (m): position errors are angles.

        Returns
        -------
        ndarray, (runs, n, n)
        """
        sizes = np.zeros((len(position), self.states))
        sizes[:, POSITION] = self.position / metres(position)
        sizes[:, VELOCITY] = self.velocity
        sizes[:, ATTITUDE] = [self.tilt, self.tilt, self.yaw]
        sizes[:, ACCELEROMETER_BIAS] = self.accelerometer_bias
        sizes[:, GYRO_DRIFT] = self.gyro_drift
        for name, size in self._extra_sizes().items():
            first = self.column(name)
            sizes[:, first : first + EXTRA_STATES[name]] = size
        P = np.asarray(sizes[:, :, None] ** 2 * np.eye(self.states))
        # position and yaw are those of GPS and compass, whose errors they share
        turns = np.zeros((len(position), self.states, self.states)) + np.eye(self.states)
        for name in self.extra:
            i = self.column(name)
            if name == "gps":
                north, east = metres(position)[:, :2].T
                turns[:, 1, i], turns[:, 0, i + 1] = 1 / east, 1 / north
            else:
                turns[:, 8, i] = 1.0
        return np.asarray(turns @ P @ np.swapaxes(turns, 1, 2))

    def _extra_sizes(self) -> dict[str, float]:
        sizes = {
            "compass": self.compass_bias, "mounting": self.mounting_yaw, "gps": self.gps_error,
        }  # fmt: skip
        return {name: sizes[name] for name in self.extra}


@dataclass(frozen=True, eq=False)
class VehicleRun:
    """What the filter made of a drive, or of stretches of it.

    Attributes
    ----------
    epochs : ndarray of int, (steps, runs)
        The epoch of the drive at each step.
    which : ndarray of int, (runs,)
        The run of the drive.
    states : VehicleState
        After the updates of each epoch, leading shape (steps, runs).
    first : ndarray, (steps, 3, runs)
        Position after the first update alone, compass and lateral velocity: P3's :math:`X_1` taken
        from the INS (rad, rad, m).
    innovations : ndarray, (steps, 8, runs)
        Compass (rad), lateral velocity (m/s), GPS position (rad, rad, m) and velocity (m/s), INS
        less sensor; NaN where not used.
    innovation_covariances : ndarray, (steps, 8, 8, runs)
        Of the first two and of the last six, each before its own update; zero between the two.

    Examples
    --------
    >>> from inswsn_lib.files import data_file
    >>> from inswsn_lib.scenario import load_scenario, with_values
    >>> from inswsn_lib.vehicle import FilterSettings, run_vehicle_filter, simulate_drive
    >>> scenario = load_scenario(data_file("scenarios/p3.yaml"))
    >>> drive = simulate_drive(with_values(scenario, imu_period=0.1), runs=2, seed=0)
    >>> run = run_vehicle_filter(drive, FilterSettings.from_settings(scenario), last=5)
    >>> run.position.shape, run.innovations.shape, run.states.attitude.shape
    ((6, 3, 2), (6, 8, 2), (6, 2, 3, 3))
    """

    epochs: NDArray[np.intp]
    which: NDArray[np.intp]
    states: VehicleState
    first: Array
    innovations: Array
    innovation_covariances: Array

    @property
    def position(self) -> Array:
        """Latitude, longitude (rad) and height (m) after all updates, (steps, 3, runs)."""
        states = self.states
        return np.moveaxis(states.position - states.error[..., POSITION], 1, 2)

    @property
    def velocity(self) -> Array:
        """East, north, up (m/s), (steps, 3, runs)."""
        states = self.states
        return np.moveaxis(states.velocity - states.error[..., VELOCITY], 1, 2)


def position_error(run: VehicleRun, drive: Drive, position: Array | None = None) -> Array:
    """Return the error of a position, east, north and up (m), (steps, 3, runs).

    Parameters
    ----------
    run : VehicleRun
    drive : Drive
        What it was run on.
    position : ndarray, (steps, 3, runs), optional
        Default: that after all updates.

    Returns
    -------
    ndarray, (steps, 3, runs)
        m.

    Examples
    --------
    A position that is 4 m east and 3 m north of the reference:

    >>> import numpy as np
    >>> from inswsn_lib.files import data_file
    >>> from inswsn_lib.scenario import load_scenario, with_values
    >>> from inswsn_lib.vehicle import (
    ...     FilterSettings, metres, position_error, run_vehicle_filter, simulate_drive
    ... )
    >>> scenario = load_scenario(data_file("scenarios/p3.yaml"))
    >>> drive = simulate_drive(with_values(scenario, imu_period=0.1), runs=1, seed=0)
    >>> run = run_vehicle_filter(drive, FilterSettings.from_settings(scenario), last=1)
    >>> true = drive.reference.position[:2]
    >>> moved = true + np.array([3.0, 4.0, 0.0]) / metres(true)  # latitude, longitude, height
    >>> position_error(run, drive, moved[:, :, None])[1, :, 0].round(6).tolist()
    [4.0, 3.0, 0.0]
    """
    found = np.moveaxis(run.position if position is None else position, 2, 1)
    true = drive.reference.position[run.epochs]
    north, east, up = np.moveaxis((found - true) * metres(true), -1, 0)
    return np.stack([east, north, up], axis=1)


def horizontal_error(run: VehicleRun, drive: Drive, position: Array | None = None) -> Array:
    """Return the horizontal distance from the reference (m), (steps, runs); P3 Section 5.

    Parameters
    ----------
    run, drive, position
        As for `position_error`.

    Returns
    -------
    ndarray, (steps, runs)
        m.

    Examples
    --------
    A position that is 4 m east and 3 m north of the reference:

    >>> import numpy as np
    >>> from inswsn_lib.files import data_file
    >>> from inswsn_lib.scenario import load_scenario, with_values
    >>> from inswsn_lib.vehicle import (
    ...     FilterSettings, horizontal_error, metres, run_vehicle_filter, simulate_drive
    ... )
    >>> scenario = load_scenario(data_file("scenarios/p3.yaml"))
    >>> drive = simulate_drive(with_values(scenario, imu_period=0.1), runs=1, seed=0)
    >>> run = run_vehicle_filter(drive, FilterSettings.from_settings(scenario), last=1)
    >>> true = drive.reference.position[:2]
    >>> moved = true + np.array([3.0, 4.0, 0.0]) / metres(true)  # latitude, longitude, height
    >>> horizontal_error(run, drive, moved[:, :, None]).round(6).tolist()
    [[5.0], [5.0]]
    """
    error = position_error(run, drive, position)
    return np.asarray(np.hypot(error[:, 0], error[:, 1]))


def navigation_error(run: VehicleRun, drive: Drive) -> Array:
    r"""Return the errors of the first nine states, (steps, 9, runs), of a drive of known attitude.

    What is left of them after all updates: position (rad, rad, m), velocity (m/s), and the attitude
    error :math:`\varphi` of :math:`C' = (I - [\varphi\times])\,C` (rad).

    Parameters
    ----------
    run : VehicleRun
    drive : Drive
        What it was run on.

    Returns
    -------
    ndarray, (steps, 9, runs)

    Raises
    ------
    ParameterError
        If the reference has no attitude.

    Examples
    --------
    After 100 s with all aids the attitude is known to better than a degree about each axis:

    >>> import numpy as np
    >>> from inswsn_lib.files import data_file
    >>> from inswsn_lib.scenario import load_scenario, with_values
    >>> from inswsn_lib.vehicle import (
    ...     FilterSettings, navigation_error, run_vehicle_filter, simulate_drive
    ... )
    >>> scenario = load_scenario(data_file("scenarios/p3.yaml"))
    >>> drive = simulate_drive(with_values(scenario, imu_period=0.1), runs=2, seed=0)
    >>> run = run_vehicle_filter(drive, FilterSettings.from_settings(scenario), last=100)
    >>> error = navigation_error(run, drive)
    >>> error.shape, bool(np.degrees(np.abs(error[100, 6:])).max() < 1)
    ((101, 9, 2), True)
    """
    true = drive.reference
    if true.attitude is None:
        raise ParameterError("drive", "a recording", "one whose attitude is known")
    states = run.states
    turned = states.attitude @ np.swapaxes(true.attitude[run.epochs], -1, -2)
    phi = -Rotation.from_matrix(turned.reshape(-1, 3, 3)).as_rotvec().reshape(*turned.shape[:-1])
    parts = [
        states.position - true.position[run.epochs],
        states.velocity - true.velocity[run.epochs],
        phi,
    ]
    return np.moveaxis(np.concatenate(parts, axis=-1) - states.error[..., :9], 1, 2)


def run_vehicle_filter(
    drive: Drive,
    settings: FilterSettings,
    *,
    aiding: bool = True,
    outages: Sequence[tuple[int, int]] = (),
    aided_outages: bool = True,
    feedback: bool = True,
    last: int | None = None,
) -> VehicleRun:
    r"""Run the filter over a drive (P3 (22), (23), (28), (29)).

    The run begins with `align` at epoch 0. At each epoch after it the error is carried on, then
    updated with compass and lateral velocity (:math:`Z_1`, giving :math:`X_1`), then with GPS
    position and velocity (:math:`Z_2`, giving :math:`X_2`). A measurement that is NaN is left out.

    Parameters
    ----------
    drive : Drive
    settings : FilterSettings
    aiding : bool
        Whether :math:`Z_1` is used.
    outages : sequence of (int, int)
        Epochs without GPS: from the first to before the second.
    aided_outages : bool
        Whether :math:`Z_1` is used within them.
    feedback : bool
        Whether the estimate corrects the INS after each epoch (closed loop) or is kept beside it
        (open loop).
    last : int, optional
        The epoch to end with. Default: that of the drive.

    Returns
    -------
    VehicleRun
        One step an epoch, from epoch 0.

    Raises
    ------
    ParameterError
        If an outage or `last` is not within the drive.

    Examples
    --------
    Forty seconds without GPS in a turn, with compass and lateral velocity and without them:

    >>> from inswsn_lib.files import data_file
    >>> from inswsn_lib.scenario import load_scenario, with_values
    >>> from inswsn_lib.vehicle import (
    ...     FilterSettings, horizontal_error, run_vehicle_filter, simulate_drive
    ... )
    >>> scenario = load_scenario(data_file("scenarios/p3.yaml"))
    >>> settings = FilterSettings.from_settings(scenario)
    >>> drive = simulate_drive(with_values(scenario, imu_period=0.1), runs=4, seed=0)
    >>> start = drive.places[0].start
    >>> outage, end = (start + 1, start + 41), start + 40
    >>> aided, alone = (
    ...     run_vehicle_filter(drive, settings, aiding=aiding, outages=[outage], last=end)
    ...     for aiding in (True, False)
    ... )
    >>> far = [horizontal_error(run, drive)[end].mean() for run in (aided, alone)]
    >>> bool(far[0] < far[1] / 3)
    True
    """
    end = len(drive.time) - 1 if last is None else last
    if not isinstance(end, int | np.integer):
        raise ParameterError("last", last, "a whole number")
    if not 1 <= end < len(drive.time):
        raise ParameterError("last", last, f"from 1 to {len(drive.time) - 1}")
    heard = np.ones(end + 1, dtype=bool)
    for outage in outages:
        if np.shape(outage) != (2,) or np.asarray(outage).dtype.kind not in "iu":
            raise ParameterError("outages", outages, "pairs of whole numbers")
        begin, stop = outage
        if not 0 <= begin < stop <= len(drive.time):
            raise ParameterError("outages", (begin, stop), f"within 0 to {len(drive.time)}")
        heard[begin:stop] = False
    sensed = np.full(end + 1, aiding) & (heard | aided_outages)
    which = np.arange(drive.runs)
    # the measurements of epoch 0 made the first state, and do not count again
    state = align(drive, settings)
    return _advance(drive, settings, state, which, np.zeros_like(which), heard, sensed, feedback)


def replay(
    drive: Drive,
    settings: FilterSettings,
    run: VehicleRun,
    starts: ArrayLike,
    steps: int,
    *,
    aiding: bool,
    gps: bool = False,
    feedback: bool = True,
) -> VehicleRun:
    """Run the filter anew from what a run knew at some epochs: one branch for each epoch and run.

    What a replay of the whole drive with an outage at that epoch would give, for the price of the
    outage.

    Parameters
    ----------
    drive, settings
        As for `run_vehicle_filter`.
    run : VehicleRun
        From `run_vehicle_filter`, from epoch 0.
    starts : array_like of int, (branches,) or (branches, runs)
        The epochs.
    steps : int
        How many epochs each branch goes on.
    aiding, gps : bool
        Whether compass and lateral velocity, and GPS, are used after the start.
    feedback : bool
        As the run was made.

    Returns
    -------
    VehicleRun
        (steps + 1, ..., branches x runs), the runs of the first branch first; step 0 is the start.

    Raises
    ------
    ParameterError
        If a branch would begin or end outside the run.

    Examples
    --------
    A branch with an outage is the run that has it:

    >>> import numpy as np
    >>> from inswsn_lib.files import data_file
    >>> from inswsn_lib.scenario import load_scenario, with_values
    >>> from inswsn_lib.vehicle import FilterSettings, replay, run_vehicle_filter, simulate_drive
    >>> scenario = load_scenario(data_file("scenarios/p3.yaml"))
    >>> settings = FilterSettings.from_settings(scenario)
    >>> drive = simulate_drive(with_values(scenario, imu_period=0.1), runs=1, seed=0)
    >>> run = run_vehicle_filter(drive, settings, last=30)
    >>> branches = replay(drive, settings, run, [20, 25], 10, aiding=True)
    >>> branches.epochs[0].tolist(), branches.epochs[-1].tolist()
    ([20, 25], [30, 35])
    >>> whole = run_vehicle_filter(drive, settings, outages=[(21, 31)], last=30)
    >>> bool(np.allclose(branches.position[:, :, 0], whole.position[20:, :, 0], rtol=0, atol=1e-9))
    True
    """
    begin = np.asarray(starts)
    runs = len(run.which)
    if run.epochs[0].any():
        raise ParameterError("run", "a replay", "a run from epoch 0")
    if run.states.error.shape[-1] != settings.states:
        raise ParameterError("settings", settings.extra, "those that the run was made with")
    shaped = begin.ndim in (1, 2) and begin.size and begin.shape[1:] in ((), (1,), (runs,))
    if begin.dtype.kind not in "iu" or not shaped:
        raise ParameterError(
            "starts",
            f"{begin.dtype} of shape {begin.shape}",
            f"whole numbers, one a branch or one for each of its {runs} runs",
        )
    if isinstance(steps, bool) or not isinstance(steps, int | np.integer) or steps < 0:
        raise ParameterError("steps", steps, "a whole number, 0 or more")
    begin = np.broadcast_to(begin.reshape(len(begin), -1), (len(begin), runs))
    if begin.min() < 0 or begin.max() >= len(run.epochs) or begin.max() + steps >= len(drive.time):
        raise ParameterError(
            "starts", f"{begin.min()} to {begin.max()}", f"epochs with {steps} more in the drive"
        )
    numbers = np.broadcast_to(np.arange(runs), begin.shape).ravel()
    state = run.states[begin.ravel(), numbers]
    heard, sensed = np.full(steps + 1, gps), np.full(steps + 1, aiding)
    return _advance(
        drive, settings, state, run.which[numbers], begin.ravel(), heard, sensed, feedback
    )


def align(drive: Drive, settings: FilterSettings) -> VehicleState:
    """Return the state at epoch 0 of a car at rest: levelled, with the compass' first yaw.

    Roll and pitch come from the mean specific force over the first interval (Groves 2013, Section
    5.6), yaw from the first compass measurement, position from the first GPS fix, velocity is zero.

    Parameters
    ----------
    drive : Drive
    settings : FilterSettings
        For the covariance.

    Returns
    -------
    VehicleState
        Leading shape (runs,).

    Raises
    ------
    ParameterError
        If the first epoch lacks GPS or compass.

    Examples
    --------
    An accelerometer that tells 0.1 m/s^2 more across the car tilts the levelled INS by that over g:

    >>> import numpy as np
    >>> from inswsn_lib.files import data_file
    >>> from inswsn_lib.scenario import load_scenario
    >>> from inswsn_lib.vehicle import Drive, FilterSettings, Reference, align, yaw
    >>> pushes = np.zeros((10, 3, 1))
    >>> pushes[:, 1], pushes[:, 2] = 0.1 * 0.1, -9.8 * 0.1  # right and down, 10 Hz
    >>> drive = Drive(
    ...     time=np.arange(2.0), period=0.1, rotation_increments=0 * pushes,
    ...     velocity_increments=pushes, gps_position=np.zeros((2, 3, 1)),
    ...     gps_velocity=np.zeros((2, 3, 1)), compass=np.full((2, 1), np.pi / 2), places=(),
    ...     reference=Reference(np.zeros((2, 3)), np.zeros((2, 3))), origin="simulated",
    ... )
    >>> scenario = load_scenario(data_file("scenarios/p3.yaml"))
    >>> state = align(drive, FilterSettings.from_settings(scenario))
    >>> print(f"{float(np.degrees(yaw(state.attitude)[0])):.1f} degrees")
    90.0 degrees
    >>> right = state.attitude[0, :, 1]
    >>> print(f"{right[2]:.4f} {0.1 / 9.8:.4f}")  # how far the right side is up
    0.0102 0.0102
    """
    position, heading = drive.gps_position[0].T, drive.compass[0]
    if np.isnan(position).any() or np.isnan(heading).any():
        raise ParameterError("drive", "one without GPS or compass at epoch 0", "one with both")
    x, y, z = -drive.velocity_increments[: drive.samples_per_epoch].mean(axis=0)
    roll, pitch = np.arctan2(y, z), np.arctan2(-x, np.hypot(y, z))
    runs, zero = drive.runs, np.zeros((drive.runs, 3))
    return VehicleState(
        position=position.copy(),
        velocity=zero.copy(),
        attitude=attitude_matrix(roll, pitch, heading),
        accelerometer_bias=zero.copy(),
        gyro_drift=zero.copy(),
        error=np.zeros((runs, settings.states)),
        covariance=settings.initial_covariance(position),
    )


def attitude_matrix(roll: Array, pitch: Array, heading: Array) -> Array:
    """Return body to east-north-up, (..., 3, 3), from roll, pitch and yaw (rad)."""
    sr, cr, sp, cp = np.sin(roll), np.cos(roll), np.sin(pitch), np.cos(pitch)
    sy, cy = np.sin(heading), np.cos(heading)
    rows = [
        [cp * sy, sr * sp * sy + cr * cy, cr * sp * sy - sr * cy],
        [cp * cy, sr * sp * cy - cr * sy, cr * sp * cy + sr * sy],
        [sp, -sr * cp, -cr * cp],
    ]
    return np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)


def sequential_update(
    x: Array, P: Array, z: Array, H: Array, R: Array, used: Mask
) -> tuple[Array, Array, Array, Array]:
    r"""Update estimates with one group of measurements (P3 (24)-(26)).

    .. math::
        S = H P H' + R, \quad K = P H' S^{-1}, \quad x \leftarrow x + K (z - H x), \quad
        P \leftarrow (I - K H) P (I - K H)' + K R K'

    Parameters
    ----------
    x : ndarray, (runs, n)
    P : ndarray, (runs, n, n)
    z : ndarray, (runs, m)
        INS less sensor.
    H : ndarray, (runs, m, n)
    R : ndarray, (m,) or (runs, m)
        Variances.
    used : ndarray of bool, (runs, m)
        A measurement that is not used has no effect.

    Returns
    -------
    x, P, innovation, covariance : ndarray
        The last two are those of all measurements, used or not.

    Examples
    --------
    A scalar by hand: as uncertain as the measurement, the estimate goes half of the way, and keeps
    half of its variance; a measurement that is not used changes nothing.

    >>> import numpy as np
    >>> from inswsn_lib.vehicle import sequential_update
    >>> x, P, H = np.zeros((2, 1)), np.full((2, 1, 1), 4.0), np.ones((2, 1, 1))  # two runs
    >>> z, used = np.array([[2.0], [2.0]]), np.array([[True], [False]])
    >>> x, P, innovation, covariance = sequential_update(x, P, z, H, np.array([4.0]), used)
    >>> x.ravel().tolist(), P.ravel().tolist()
    ([1.0, 0.0], [2.0, 4.0])
    >>> innovation.ravel().tolist(), covariance.ravel().tolist()
    ([2.0, 2.0], [8.0, 8.0])
    """
    innovation = z - (H @ x[..., None])[..., 0]
    noise = R[..., None] * np.eye(R.shape[-1])
    covariance = H @ P @ np.swapaxes(H, 1, 2) + noise
    rows = H * used[..., None]
    PH = P @ np.swapaxes(rows, 1, 2)
    S = rows @ PH + noise
    K = np.swapaxes(np.linalg.solve(S, np.swapaxes(PH, 1, 2)), 1, 2)
    x = x + (K @ np.where(used, innovation, 0.0)[..., None])[..., 0]
    keep = np.eye(P.shape[-1]) - K @ rows
    P = keep @ P @ np.swapaxes(keep, 1, 2) + (K * R[..., None, :]) @ np.swapaxes(K, 1, 2)
    return x, P, innovation, covariance


@dataclass(frozen=True, eq=False)
class _Updated:
    """A state after both updates, and what the updates met."""

    state: VehicleState
    first: Array
    innovations: Array
    covariances: Array


def _advance(
    drive: Drive,
    settings: FilterSettings,
    state: VehicleState,
    which: NDArray[np.intp],
    begin: NDArray[np.intp],
    heard: Mask,
    sensed: Mask,
    feedback: bool,
) -> VehicleRun:
    """Go on from a start for as many epochs as `heard` and `sensed` tell of."""
    runs = len(which)
    first = state.position - state.error[:, POSITION]
    start = _Updated(state, first, np.full((runs, 8), np.nan), np.zeros((runs, 8, 8)))
    if settings.substeps > drive.samples_per_epoch:
        raise ParameterError("substeps", settings.substeps, f"up to {drive.samples_per_epoch}")
    if "gps" in settings.extra and settings.gps_time < drive.interval:
        raise ParameterError("gps_time", settings.gps_time, f"{drive.interval} or more")
    state = state.corrected() if feedback else state
    kept = [replace(start, state=state)]
    turns, pushes = drive.increments
    for k in range(1, len(heard)):
        flight = integrate_strapdown(
            state, turns[which, begin + k - 1], pushes[which, begin + k - 1], drive.period
        )
        state = _propagate(settings, state, flight, drive.interval)
        updated = _update(drive, settings, state, which, begin + k, heard[k], sensed[k])
        state = updated.state.corrected() if feedback else updated.state
        kept.append(replace(updated, state=state))
    states = VehicleState(
        **{
            f.name: np.stack([getattr(step.state, f.name) for step in kept])
            for f in fields(VehicleState)
        }
    )
    return VehicleRun(
        epochs=begin + np.arange(len(heard))[:, None],
        which=which,
        states=states,
        first=np.stack([step.first.T for step in kept]),
        innovations=np.stack([step.innovations.T for step in kept]),
        innovation_covariances=np.stack([np.moveaxis(step.covariances, 0, 2) for step in kept]),
    )


def _propagate(
    settings: FilterSettings, state: VehicleState, flight: Flight, interval: float
) -> VehicleState:
    """Carry error and covariance over the interval that a flight covers (P3 (22), (23))."""
    samples = flight.position.shape[1] - 1
    edges = _edges(samples, settings.substeps)
    middle = (edges[:-1] + edges[1:]) // 2
    lengths = (edges[1:] - edges[:-1]) * (interval / samples)
    position, velocity = flight.position[:, middle], flight.velocity[:, middle]
    attitude = flight.attitude[:, middle]
    force = _force(flight, edges, middle, lengths)
    F = np.zeros((*force.shape[:2], settings.states, settings.states))
    F[..., :STATES, :STATES] = error_dynamics(position, velocity, attitude, force)
    density = np.zeros_like(F)
    density[..., :STATES, :STATES] = _density(settings, attitude)
    if "gps" in settings.extra:
        i = settings.column("gps")
        for j in (i, i + 1):
            F[..., j, j] = -1 / settings.gps_time
            density[..., j, j] = 2 * settings.gps_error**2 / settings.gps_time
    x, P = state.error, state.covariance
    transitions, processes = discretise(F, density, lengths)
    for j in range(len(lengths)):
        transition = transitions[:, j]
        x = (transition @ x[..., None])[..., 0]
        P = transition @ P @ np.swapaxes(transition, 1, 2) + processes[:, j]
    return replace(
        state,
        position=flight.position[:, -1],
        velocity=flight.velocity[:, -1],
        attitude=flight.attitude[:, -1],
        error=x,
        covariance=0.5 * (P + np.swapaxes(P, 1, 2)),
    )


@cache
def _edges(samples: int, substeps: int) -> NDArray[np.intp]:
    """Return where substeps begin and end among the samples of an interval, (substeps + 1,)."""
    return np.linspace(0, samples, substeps + 1).round().astype(np.intp)


def _force(
    flight: Flight, edges: NDArray[np.intp], middle: NDArray[np.intp], lengths: Array
) -> Array:
    r"""Return the mean specific force of each substep, (runs, substeps, 3).

    .. math:: f = \dot v + (2\omega_{ie} + \omega_{en}) \times v - g
    """
    position, velocity = flight.position[:, middle], flight.velocity[:, middle]
    ends = flight.velocity[:, edges]
    change = (ends[:, 1:] - ends[:, :-1]) / lengths[:, None]
    rate = 2 * earth_rate(position) + transport_rate(position, velocity)
    force = change + np.cross(rate, velocity)
    force[..., 2] += earth.gravity(np.rad2deg(position[..., 0]), position[..., 2])
    return np.asarray(force)


def _density(settings: FilterSettings, attitude: Array) -> Array:
    sizes = np.repeat(
        [
            settings.accelerometer_noise, settings.gyro_noise,
            settings.accelerometer_walk, settings.gyro_walk,
        ],
        3,
    )  # fmt: skip
    scaled = noise_input(attitude) * sizes
    return np.asarray(scaled @ np.swapaxes(scaled, -1, -2))


def _update(
    drive: Drive,
    settings: FilterSettings,
    state: VehicleState,
    which: NDArray[np.intp],
    epoch: NDArray[np.intp],
    heard: bool,
    sensed: bool,
) -> _Updated:
    """Update with compass and lateral velocity, then with GPS (P3 Section 3.3)."""
    x, P = state.error, state.covariance
    z1, H1, used1 = _first_measurements(drive, settings, state, which, epoch)
    R1 = np.array([settings.compass, settings.lateral]) ** 2
    expected = (H1[:, 0] * (P @ H1[:, 0, :, None])[..., 0]).sum(axis=-1) + R1[0]
    surprise = z1[:, 0] - (H1[:, 0] * x).sum(axis=-1)
    used1[:, 0] &= surprise**2 <= settings.gate**2 * expected
    used1 &= sensed
    x, P, nu1, S1 = sequential_update(x, P, np.where(np.isnan(z1), 0.0, z1), H1, R1, used1)
    first = state.position - x[:, POSITION]
    z2, H2 = _gps_measurements(drive, settings, state, which, epoch)
    used2 = ~np.isnan(z2) & heard
    R2 = np.full(z2.shape, settings.gps_velocity**2)
    R2[:, :3] = (settings.gps_position / metres(state.position)) ** 2
    x, P, nu2, S2 = sequential_update(x, P, np.where(np.isnan(z2), 0.0, z2), H2, R2, used2)
    covariances = np.zeros((len(which), 8, 8))
    covariances[:, :2, :2], covariances[:, 2:, 2:] = S1, S2
    return _Updated(
        state=replace(state, error=x, covariance=P),
        first=first,
        innovations=np.where(np.hstack([used1, used2]), np.hstack([nu1, nu2]), np.nan),
        covariances=covariances,
    )


def _first_measurements(
    drive: Drive,
    settings: FilterSettings,
    state: VehicleState,
    which: NDArray[np.intp],
    epoch: NDArray[np.intp],
) -> tuple[Array, Array, Mask]:
    """Return what compass and lateral velocity tell, their rows, and where there is something."""
    difference = yaw(state.attitude) - drive.compass[epoch, which]
    lateral = (state.attitude[:, :, 1] * state.velocity).sum(axis=-1)
    z = np.stack([np.angle(np.exp(1j * difference)), lateral], axis=-1)
    H = np.zeros((len(which), 2, settings.states))
    H[:, :1, :STATES] = compass_row(state.attitude)
    H[:, 1:, :STATES] = lateral_row(state.attitude, state.velocity)
    if "compass" in settings.extra:
        H[:, 0, settings.column("compass")] = -1.0
    if "mounting" in settings.extra:
        # the vehicle's forward axis is turned by this from that of the IMU
        i = settings.column("mounting")
        H[:, 0, i] = -1.0
        H[:, 1, i] = (state.attitude[:, :, 0] * state.velocity).sum(axis=-1)
    return z, H, ~np.isnan(z)


def _gps_measurements(
    drive: Drive,
    settings: FilterSettings,
    state: VehicleState,
    which: NDArray[np.intp],
    epoch: NDArray[np.intp],
) -> tuple[Array, Array]:
    z = np.concatenate(
        [
            state.position - drive.gps_position[epoch, :, which],
            state.velocity - drive.gps_velocity[epoch, :, which],
        ],
        axis=-1,
    )
    H = np.zeros((len(which), 6, settings.states))
    H[:, :, :STATES] = gps_rows()
    if "gps" in settings.extra:
        i = settings.column("gps")
        size = metres(state.position)
        H[:, 1, i], H[:, 0, i + 1] = -1 / size[:, 1], -1 / size[:, 0]
    return z, H
