"""The vehicle's Kalman filter with sequential updates (P3 Section 3), for many runs at once."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.spatial.transform import Rotation

from inswsn_lib.checks import Array, Mask, whole
from inswsn_lib.errors import Described, ParameterError
from inswsn_lib.inertial.earth import TURN, metres
from inswsn_lib.inertial.error_state import Solution, Start
from inswsn_lib.inertial.mechanization import turned
from inswsn_lib.inertial.runs import AFTER, AT_ONCE, BESIDE, run_table
from inswsn_lib.inertial.smoothing import smooth, smooth_with_lag
from inswsn_lib.inertial.strapdown import InertialState
from inswsn_lib.simulation.drive import Drive
from inswsn_lib.vehicle.frame import SENSORS, DriveFrame
from inswsn_lib.vehicle.settings import FilterSettings
from inswsn_lib.vehicle.state import POSITION, VELOCITY, VehicleState

Integers = NDArray[np.intp]

_WALKING, _PASSES = 1.0, 5  # m/s, and of levelling


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
    """

    epochs: Integers
    which: Integers
    states: VehicleState
    first: Array
    innovations: Array
    innovation_covariances: Array

    @property
    def position(self) -> Array:
        """Latitude, longitude (rad) and height (m) after all updates, (steps, 3, runs)."""
        return np.moveaxis(self.states.position - self.states.error[..., POSITION], 1, 2)

    @property
    def velocity(self) -> Array:
        """East, north, up (m/s), (steps, 3, runs)."""
        return np.moveaxis(self.states.velocity - self.states.error[..., VELOCITY], 1, 2)


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

    Raises
    ------
    ParameterError
        If an outage or `last` is not within the drive.

    Examples
    --------
    Forty seconds without GPS in the first turn, with compass and lateral velocity:

    >>> import inswsn_lib as iw
    >>> p3 = iw.with_values(iw.load_scenario(iw.data_file("scenarios/p3.yaml")), imu_period=0.1)
    >>> drive = iw.simulate_drive(p3, runs=4, seed=0)
    >>> start, told = drive.places[0].start, iw.FilterSettings.from_settings(p3)
    >>> run = iw.run_vehicle_filter(drive, told, outages=[(start + 1, start + 41)], last=start + 40)
    >>> print(f"{iw.horizontal_error(run, drive)[-1].mean():.0f} m")
    8 m
    """
    heard, sensed = _used(drive, aiding, outages, aided_outages, last)
    which = np.arange(drive.runs)
    # the measurements of epoch 0 made the first state, and do not count again
    state = align(drive, settings)
    return _advance(drive, settings, state, which, np.zeros_like(which), heard, sensed, feedback)


def _used(
    drive: Drive, aiding: bool, outages: Sequence[tuple[int, int]], aided_outages: bool,
    last: int | None,
) -> tuple[Mask, Mask]:  # fmt: skip
    """Return at which epochs GPS, and compass and lateral velocity, are used."""
    end = len(drive.time) - 1 if last is None else whole("last", last, 1, len(drive.time) - 1)
    heard = np.ones(end + 1, dtype=bool)
    for begin, stop in outages:
        whole("outages", stop, whole("outages", begin) + 1, len(drive.time))
        heard[begin:stop] = False
    return heard, np.full(end + 1, aiding) & (heard | aided_outages)


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

    What a run over the whole drive with an outage at that epoch would give, for the price of the
    outage.

    Parameters
    ----------
    drive, settings, run
        The run is that of `run_vehicle_filter`, from epoch 0.
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

    Examples
    --------
    >>> import inswsn_lib as iw
    >>> p3 = iw.with_values(iw.load_scenario(iw.data_file("scenarios/p3.yaml")), imu_period=0.1)
    >>> drive, told = iw.simulate_drive(p3, runs=1, seed=0), iw.FilterSettings.from_settings(p3)
    >>> run = iw.run_vehicle_filter(drive, told, last=30)
    >>> iw.vehicle.replay(drive, told, run, [20, 25], 10, aiding=True).epochs[[0, -1]].tolist()
    [[20, 25], [30, 35]]
    """
    state, which, begin = _branches(drive, run, starts, whole("steps", steps))
    heard, sensed = np.full(steps + 1, gps), np.full(steps + 1, aiding)
    return _advance(drive, settings, state, which, begin, heard, sensed, feedback)


def smooth_outages(
    drive: Drive,
    settings: FilterSettings,
    run: VehicleRun,
    starts: ArrayLike,
    steps: int,
    *,
    after: int,
    lag: float = np.inf,
) -> Array:
    """Return positions in outages by what came after them too, (steps + 1, 3, branches x runs).

    Latitude, longitude (rad) and height (m); step 0 is that of the filter. Not causal: a smoother
    (`inswsn_lib.inertial.smooth`) with compass and lateral velocity throughout, and with GPS after
    the outage. The filter that it is of corrects its INS after each measurement, that of `replay`
    after each epoch, which differs in second order.

    Parameters
    ----------
    drive, settings, run, starts, steps
        As in `replay`; the run in closed loop.
    after : int
        Epochs with GPS after the outage that are used.
    lag : float
        How late an answer may be (s): measurements that far ahead of each epoch are used. Default:
        all.

    Examples
    --------
    Forty seconds without GPS, bridged when they are over:

    >>> import inswsn_lib as iw
    >>> p3 = iw.with_values(iw.load_scenario(iw.data_file("scenarios/p3.yaml")), imu_period=0.1)
    >>> drive, told = iw.simulate_drive(p3, runs=2, seed=0), iw.FilterSettings.from_settings(p3)
    >>> run = iw.run_vehicle_filter(drive, told, last=120)
    >>> branch = iw.vehicle.replay(drive, told, run, [113], 40, aiding=True)
    >>> found = iw.vehicle.smooth_outages(drive, told, run, [113], 40, after=20)
    >>> late = iw.horizontal_error(branch, drive, found)
    >>> bool(late.mean() < iw.horizontal_error(branch, drive).mean())
    True
    """
    end = whole("steps", steps, 1) + whole("after", after)
    state, which, begin = _branches(drive, run, starts, end)
    begun, frame = state.corrected(), DriveFrame(drive, settings)
    epochs = begin[:, None] + np.arange(1, end + 1)
    table = frame.table(epochs, which, np.arange(end) >= steps, np.ones(end, dtype=bool))
    start = frame.from_vehicle(begun, feedback=True)
    found = run_table(
        InertialState, frame.steps(epochs, which), start, frame.own(end), SENSORS, table,
        mode=AT_ONCE, kept=2,
    )  # fmt: skip
    time, places = drive.interval * np.arange(1.0, end + 1), []
    for branch, (row, covariance) in enumerate(zip(*start[:2], strict=True)):
        first = Start(0.0, InertialState.of_row(row), covariance)
        filtered = Solution.of(found, time, first, [], first, run=branch)
        told = smooth_with_lag(filtered, lag) if np.isfinite(lag) else smooth(filtered)
        places.append(frame.earth.geodetic(told.position[:steps]))
    return np.concatenate([begun.position.T[None], np.stack(places, axis=2)])


def _branches(
    drive: Drive, run: VehicleRun, starts: ArrayLike, steps: int
) -> tuple[VehicleState, Integers, Integers]:
    """Return the states from which branches of so many epochs begin, their runs and epochs."""
    if run.epochs[0].any():
        raise ParameterError("run", Described("a replay"), "a run from epoch 0")
    runs = len(run.which)
    begin = np.asarray(starts)
    shaped = begin.ndim in (1, 2) and begin.size and begin.shape[1:] in ((), (1,), (runs,))
    last = min(len(run.epochs), len(drive.time) - steps) - 1
    fits = begin.dtype.kind in "iu" and shaped and begin.min() >= 0 and begin.max() <= last
    if not fits:
        raise ParameterError(
            "starts", begin.tolist(), f"epochs up to {last}, one per branch or one for each run"
        )
    begin = np.broadcast_to(begin.reshape(len(begin), -1), (len(begin), runs))
    numbers = np.broadcast_to(np.arange(runs), begin.shape).ravel()
    begin = begin.ravel()
    return run.states[begin, numbers], run.which[numbers], begin


def align(drive: Drive, settings: FilterSettings) -> VehicleState:
    """Return the state at epoch 0, levelled, with the compass' first yaw and the first GPS fix.

    Roll and pitch come from the mean specific force over the first interval (Groves 2013, Section
    5.6). A car whose first GPS velocity is above 1 m/s and six of its deviations is not at rest:
    then that is its velocity, and the specific force is levelled after the acceleration that the
    first two GPS velocities tell; it must be heard at epoch 1 too. Else the velocity is zero.

    Parameters
    ----------
    drive : Drive
    settings : FilterSettings
        Of them the standard deviations at the start.

    Examples
    --------
    >>> import inswsn_lib as iw
    >>> p3 = iw.with_values(iw.load_scenario(iw.data_file("scenarios/p3.yaml")), imu_period=0.1)
    >>> drive = iw.simulate_drive(p3, runs=2, seed=0)
    >>> state = iw.vehicle.align(drive, iw.FilterSettings.from_settings(p3))
    >>> abs(iw.vehicle.yaw(state.attitude) - drive.compass[0]).max() < 1e-9
    np.True_
    """
    position, heading = drive.gps_position[0].T, drive.compass[0]
    if np.isnan(position).any() or np.isnan(heading).any():
        raise ParameterError(
            "drive", Described("one without"), "one with GPS and compass at epoch 0"
        )
    velocity, pushed = _moving(drive, settings)
    P = settings.initial_covariance(position)
    if velocity.any():
        P[:, VELOCITY, VELOCITY] = settings.gps_velocity**2 * np.eye(3)
    runs, zero = drive.runs, np.zeros((drive.runs, 3))
    pitch, roll = _levelled(drive, heading, pushed)
    return VehicleState(
        position=position.copy(),
        velocity=velocity,
        attitude=_body(heading, pitch, roll),
        accelerometer_bias=zero,
        gyro_drift=zero,
        error=np.zeros((runs, settings.states)),
        covariance=P,
    )


def _moving(drive: Drive, settings: FilterSettings) -> tuple[Array, Array]:
    """Return velocity and acceleration at the start by GPS, (runs, 3) each; zeros at rest."""
    first, second = drive.gps_velocity[:2].transpose(0, 2, 1)
    still = np.zeros_like(first)
    speed = float(np.nanmean(np.linalg.norm(first, axis=1))) if np.isfinite(first).any() else 0.0
    if speed <= max(_WALKING, 6 * settings.gps_velocity):
        return still, still
    if np.isnan(drive.gps_velocity[:2]).any():
        raise ParameterError(
            "drive", Described("one that moves at epoch 0 without it"),
            "one with GPS velocity at epochs 0 and 1",
        )  # fmt: skip
    return first.copy(), (second - first) / drive.interval


def _levelled(drive: Drive, heading: Array, pushed: Array) -> tuple[Array, Array]:
    """Return pitch and roll by the specific force of the first interval, (runs,) each.

    What accelerates the car, `pushed`, is taken out of it first; it depends on the tilt that is
    looked for, so that is found again and again.
    """
    count = drive.samples_per_epoch
    force = drive.velocity_increments[:count].mean(axis=0).T
    middle = heading + drive.rotation_increments[:count, 2].sum(axis=0) / 2
    pitch, roll = np.zeros((2, drive.runs))
    for _ in range(_PASSES if pushed.any() else 1):
        felt = np.einsum("rij,ri->rj", _body(middle, pitch, roll), pushed)
        x, y, z = -(force - drive.period * felt).T
        roll, pitch = np.arctan2(y, z), np.arctan2(-x, np.hypot(y, z))
    return pitch, roll


def _body(heading: Array, pitch: Array, roll: Array) -> Array:
    """Return the attitude, (runs, 3, 3), of a body that yaws, then pitches, then rolls."""
    about = np.stack([heading, pitch, roll])[..., None] * np.eye(3)[::-1, None]
    yaws, pitches, rolls = turned(about)
    return np.asarray(TURN @ yaws @ pitches @ rolls)


def _advance(
    drive: Drive,
    settings: FilterSettings,
    state: VehicleState,
    which: Integers,
    begin: Integers,
    heard: Mask,
    sensed: Mask,
    feedback: bool,
) -> VehicleRun:
    """Go on from a start for as many epochs as `heard` and `sensed` tell of."""
    frame = DriveFrame(drive, settings)
    begun = state.corrected() if feedback else state
    epochs = begin[:, None] + np.arange(1, len(heard))
    table = frame.table(epochs, which, heard[1:], sensed[1:])
    found = run_table(
        InertialState, frame.steps(epochs, which), frame.from_vehicle(begun, feedback),
        frame.own(len(heard) - 1), SENSORS, table, mode=AFTER if feedback else BESIDE, kept=1,
    )  # fmt: skip
    states = frame.to_vehicle(found.states, found.errors, found.filtered)
    firsts = np.moveaxis(frame.earth.geodetic(found.firsts), 1, 2)
    nu, S = frame.innovations(found, states)
    before = begun.position - begun.error[:, POSITION]
    return VehicleRun(
        epochs=np.concatenate([begin[None], epochs.T]),
        which=which,
        states=VehicleState(*(
            np.concatenate([getattr(begun, f.name)[None], getattr(states, f.name)])
            for f in fields(states)
        )),
        first=np.concatenate([before.T[None], firsts]),
        innovations=np.concatenate([np.full((1, *nu.shape[1:]), np.nan), nu]),
        innovation_covariances=np.concatenate([np.zeros((1, *S.shape[1:])), S]),
    )  # fmt: skip


def position_error(run: VehicleRun, drive: Drive, position: Array | None = None) -> Array:
    """Return the error of a position, east, north and up (m), (steps, 3, runs).

    Parameters
    ----------
    run, drive
        The run, and what it was run on.
    position : ndarray, (steps, 3, runs), optional
        Default: that after all updates.

    Examples
    --------
    A metre of height too much:

    >>> import inswsn_lib as iw
    >>> p3 = iw.with_values(iw.load_scenario(iw.data_file("scenarios/p3.yaml")), imu_period=0.1)
    >>> drive = iw.simulate_drive(p3, runs=1, seed=0)
    >>> run = iw.run_vehicle_filter(drive, iw.FilterSettings.from_settings(p3), last=1)
    >>> high = drive.reference.position[:2, :, None] + [[0], [0], [1]]
    >>> iw.position_error(run, drive, high)[1, :, 0]
    array([0., 0., 1.])
    """
    found = np.moveaxis(run.position if position is None else position, 2, 1)
    true = drive.reference.position[run.epochs]
    north, east, up = np.moveaxis((found - true) * metres(true), -1, 0)
    return np.stack([east, north, up], axis=1)


def horizontal_error(run: VehicleRun, drive: Drive, position: Array | None = None) -> Array:
    """Return the horizontal part of `position_error` (m), (steps, runs); P3 Section 5.

    Parameters
    ----------
    run, drive, position
        As in `position_error`.

    Examples
    --------
    >>> import inswsn_lib as iw
    >>> p3 = iw.with_values(iw.load_scenario(iw.data_file("scenarios/p3.yaml")), imu_period=0.1)
    >>> drive = iw.simulate_drive(p3, runs=1, seed=0)
    >>> run = iw.run_vehicle_filter(drive, iw.FilterSettings.from_settings(p3), last=1)
    >>> iw.horizontal_error(run, drive)[0].round(1)  # that of a fix, of 3 m each way
    array([3.4])
    """
    error = position_error(run, drive, position)
    return np.asarray(np.hypot(error[:, 0], error[:, 1]))


def navigation_error(run: VehicleRun, drive: Drive) -> Array:
    r"""Return the errors of the first nine states, (steps, 9, runs), of a drive of known attitude.

    What is left of them after all updates: position (rad, rad, m), velocity (m/s), and the attitude
    error :math:`\varphi` of :math:`C' = (I - [\varphi\times])\,C` (rad).

    Parameters
    ----------
    run, drive
        As in `position_error`.

    Examples
    --------
    After 100 s with all aids the attitude is known to better than a degree about each axis:

    >>> import numpy as np, inswsn_lib as iw
    >>> p3 = iw.with_values(iw.load_scenario(iw.data_file("scenarios/p3.yaml")), imu_period=0.1)
    >>> drive = iw.simulate_drive(p3, runs=2, seed=0)
    >>> run = iw.run_vehicle_filter(drive, iw.FilterSettings.from_settings(p3), last=100)
    >>> bool(np.degrees(np.abs(iw.vehicle.navigation_error(run, drive)[100, 6:])).max() < 1)
    True
    """
    true, states = drive.reference, run.states
    if true.attitude is None:
        raise ParameterError("drive", Described("a recording"), "one whose attitude is known")
    turned = states.attitude @ np.swapaxes(true.attitude[run.epochs], -1, -2)
    phi = -Rotation.from_matrix(turned.reshape(-1, 3, 3)).as_rotvec().reshape(*turned.shape[:-1])
    parts = [
        states.position - true.position[run.epochs],
        states.velocity - true.velocity[run.epochs],
        phi,
    ]
    return np.moveaxis(np.concatenate(parts, axis=-1) - states.error[..., :9], 1, 2)
