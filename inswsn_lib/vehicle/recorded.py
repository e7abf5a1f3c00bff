"""A recorded drive: GPS and compass emulated; how its IMU is turned in the car, and how noisy."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike
from scipy.integrate import cumulative_trapezoid

from inswsn_lib.checks import Array, array, number, whole
from inswsn_lib.errors import InswsnError, ParameterError
from inswsn_lib.inertial.earth import Earth, metres
from inswsn_lib.simulation.drive import Drive, DriveReference, Place, wrapped
from inswsn_lib.simulation.ideal_sensors import as_increments
from inswsn_lib.streams import Recording
from inswsn_lib.vehicle.filter import VehicleRun, run_vehicle_filter
from inswsn_lib.vehicle.settings import FilterSettings

#: By how much the noises may be multiplied
LEVELS = (0.5, 1.0, 1.5, 2.0, 3.0, 4.0, 6.0)
_JITTER = 0.01  # of the seconds between two epochs, at most


def emulate_sensors(
    recording: Recording,
    *,
    runs: int,
    seed: int,
    gps_position_sd: float = 3.0,
    gps_velocity_sd: float = 0.05,
    compass_sd: float = float(np.deg2rad(0.15)),
    hold_below: float = 1.0,
    period: float = 0.01,
    mounting: ArrayLike | None = None,
    places: Sequence[Place] = (),
) -> Drive:
    """Return a drive of the recorded IMU with GPS and compass emulated from RTK.

    The epochs are fixes, those nearest to whole seconds; nothing of RTK is interpolated. The IMU's
    grid goes through them: its samples are integrated (trapezoids), the integrals interpolated on
    the grid, and their differences taken, so that what the IMU summed up to is kept. Coning,
    sculling and the rotation within a sample are then corrected.

    White noise makes GPS and compass, new in each run; the IMU is the same in all. The car has no
    compass: it is emulated by the course over ground, which is the yaw of a car that does not slip.
    At low speed there is no course, and the last one is held; before the car has moved for the
    first time, the first course it will have is taken. Noise is on top of held courses too.

    Parameters
    ----------
    recording : Recording
        With an IMU, fixes with velocities, and their origin. The lever arm is left out.
    runs, seed : int
        How many, and of the noise.
    gps_position_sd, gps_velocity_sd, compass_sd : float
        Standard deviations, of each axis (m, m/s) and of the compass (rad).
    hold_below : float
        The speed below which the course is held (m/s).
    period : float
        Of the IMU on the even grid (s).
    mounting : ndarray, (3, 3) or (runs, 3, 3), optional
        Rotation from the IMU's axes to those of the vehicle, forward, right, down; the same axes by
        default.
    places : sequence of Place
        Where outages are to begin.

    Raises
    ------
    ParameterError
        If a number or a place may not be what it is, or the car is never as fast as `hold_below`.
    InswsnError
        If the recording lacks what is needed, or a second that its IMU covers has no fix.

    Examples
    --------
    A car on its way north at 10 m/s for two seconds; without noise the compass is the course.

    >>> import numpy as np, inswsn_lib as iw
    >>> from inswsn_lib.streams import Fixes, Imu
    >>> time, zero, v = np.arange(-1.0, 4.0), np.zeros((5, 3)), np.array([[0.0, 10.0, 0.0]] * 5)
    >>> imu, fixes = Imu(time, rate=zero, force=zero), Fixes(time, time[:, None] * v, velocity=v)
    >>> recording = iw.Recording("north", imu=imu, fixes=fixes, origin=np.zeros(3))
    >>> iw.emulate_sensors(recording, runs=2, seed=0, compass_sd=0.0).compass[:, 0]
    array([0., 0., 0.])
    """
    rotation = array("mounting", np.eye(3) if mounting is None else mounting, (3, 3), (runs, 3, 3))
    turn = np.broadcast_to(rotation, (whole("runs", runs, 1), 3, 3))
    step = number("period", period, least=1e-4, most=1)
    rotations, pushes, position, velocity = _on_even_grids(recording, step)
    east, north, _ = velocity.T
    speed = np.hypot(east, north)
    slowest = number("hold_below", hold_below, least=0, most=float(speed.max()))
    known = np.flatnonzero(speed >= slowest)
    last = np.searchsorted(known, np.arange(len(speed)), side="right") - 1
    course = np.arctan2(east, north)[known[np.maximum(last, 0)]]
    rng = np.random.default_rng(whole("seed", seed))
    shape = (len(position), 3, runs)
    moved = number("gps_position_sd", gps_position_sd, least=0) * rng.standard_normal(shape)
    speeds = number("gps_velocity_sd", gps_velocity_sd, least=0) * rng.standard_normal(shape)
    angles = number("compass_sd", compass_sd, least=0) * rng.standard_normal(shape[::2])
    return Drive(
        time=np.arange(float(len(position))),
        period=step,
        rotation_increments=(turn @ rotations).T,
        velocity_increments=(turn @ pushes).T,
        gps_position=position[:, :, None] + moved / metres(position)[:, :, None],
        gps_velocity=velocity[:, :, None] + speeds,
        compass=wrapped(course[:, None] + angles),
        reference=DriveReference(position=position, velocity=velocity),
        places=tuple(places),
        origin="recorded",
    )


def _on_even_grids(recording: Recording, period: float) -> tuple[Array, Array, Array, Array]:
    """Return increments, each (3, samples), and positions and velocities, each (epochs, 3)."""
    imu, fixes, origin = recording.imu, recording.fixes, recording.origin
    if not imu or not fixes or fixes.velocity is None or origin is None:
        there = {"imu": imu, "fixes": fixes, "origin": origin is not None}
        lacks = next((name for name in there if not there[name]), "velocities of fixes")
        raise InswsnError(f"The recording {recording.name} has no {lacks}: a drive needs it.")
    sensed = array("imu", np.hstack([imu.rate, imu.force]), ("samples", 6))
    at = fixes.time
    first = at[np.argmin(np.abs(at - np.round(at))[at < at[0] + 1])]
    seconds = first + np.arange(at[-1] - first + _JITTER)
    rows = np.searchsorted((at[1:] + at[:-1]) / 2, seconds)
    # epochs that the IMU covers, with a sample before the first and a little more
    begin, end = imu.time[0] + 1.5 * period, imu.time[-1] - 0.5 * period
    rows = rows[(at[rows] > begin) & (at[rows] < end)]
    if len(rows) < 2 or np.abs(np.diff(at[rows]) - 1).max() > _JITTER:
        raise InswsnError(f"The recording {recording.name} has no fix each second of its IMU.")
    time = imu.time - at[rows[0]]
    grid = period * np.arange(-1.0, round((len(rows) - 1) / period) + 1)
    integrals = cumulative_trapezoid(sensed, time, axis=0, initial=0)
    felt = np.diff([np.interp(grid, time, each) for each in integrals.T])
    place = array("fixes", fixes.position[rows], ("epochs", 3))
    velocity = array("velocities of fixes", fixes.velocity[rows], ("epochs", 3))
    return *as_increments(felt[:3], felt[3:]), Earth(*origin).geodetic(place), velocity


def estimate_mounting(run: VehicleRun, until: int, *, slowest: float = 5.0) -> Array:
    r"""Return rotations from the IMU's axes to the vehicle's, from its motion, (runs, 3, 3).

    A vehicle moves forward: its velocity in the IMU's axes, :math:`C_n^b v`, points along the
    vehicle's forward axis. Sums over epochs weigh each with its speed; side slip in turns to the
    left and to the right cancels. The turn about the forward axis cannot be seen so, and is left
    as it is. A row is an axis of the vehicle (forward, right, down) in those of the IMU.

    Parameters
    ----------
    run : VehicleRun
        From `run_vehicle_filter` without compass and lateral constraint, which would hide it.
    until : int
        The last epoch that is used.
    slowest : float
        Slower than this (m/s) does not count.

    Examples
    --------
    The IMU is turned by six degrees to the right, so that forward is to the left:

    >>> import numpy as np, inswsn_lib as iw
    >>> p3 = iw.load_scenario(iw.data_file("scenarios/p3.yaml"))
    >>> p3 = iw.with_values(p3, imu_period=0.1, mounting_yaw=np.radians(6), filter_yaw=0.2)
    >>> drive, told = iw.simulate_drive(p3, runs=1, seed=0), iw.FilterSettings.from_settings(p3)
    >>> run = iw.run_vehicle_filter(drive, told, aiding=False, last=150)
    >>> forward, right, down = iw.vehicle.estimate_mounting(run, 150)[0]
    >>> print(f"{np.degrees(np.arctan2(forward[1], forward[0])):.0f} degrees")
    -6 degrees
    """
    states = run.states[: whole("until", until, 0, len(run.epochs) - 1) + 1]
    velocity = np.moveaxis(run.velocity, 2, 1)[: until + 1]
    body = np.einsum("krij,kri->krj", states.attitude, velocity)
    fast = np.linalg.norm(velocity, axis=-1) > slowest
    if not fast.any(axis=0).all():
        raise ParameterError("until", until, f"an epoch after motion faster than {slowest} m/s")
    forward = (body * fast[..., None]).sum(axis=0)
    axes = [forward, np.cross([0.0, 0.0, 1.0], forward)]  # the right side is level
    forward, right = (axis / np.linalg.norm(axis, axis=-1, keepdims=True) for axis in axes)
    return np.stack([forward, right, np.cross(forward, right)], axis=1)


def calibrate_inertial_noise(
    drive: Drive,
    settings: FilterSettings,
    rows: tuple[int, int],
    *,
    levels: Sequence[float] = LEVELS,
) -> tuple[FilterSettings, dict[float, float]]:
    r"""Choose by how much the inertial noises are to be larger than in the settings.

    For each level the noises of the IMU and what drives its biases are multiplied by it, a filter
    with GPS alone runs, and the squared innovations of GPS velocity over their variances are
    averaged. The level is taken whose mean is nearest to 1 on a logarithmic scale.

    Parameters
    ----------
    drive, settings
    rows : (int, int)
        The epochs whose innovations count, both included; none after them is used.
    levels : sequence of float
        Candidates.

    Returns
    -------
    settings, means
        The settings with the level that was taken, and the mean of each level.

    Examples
    --------
    A simulated IMU that is three times as noisy as the filter believes:

    >>> import inswsn_lib as iw
    >>> p3 = iw.with_values(iw.load_scenario(iw.data_file("scenarios/p3.yaml")), imu_period=0.1)
    >>> told = iw.FilterSettings.from_settings(p3)
    >>> noises = {n: 3 * p3[n].value for n in ("gyro_noise", "accelerometer_noise")}
    >>> drive = iw.simulate_drive(iw.with_values(p3, **noises), runs=2, seed=0)
    >>> louder, _ = iw.vehicle.calibrate_inertial_noise(drive, told, (20, 100))
    >>> round(louder.gyro_noise / told.gyro_noise, 3)
    3.0
    """
    first, last = rows
    whole("rows", last, whole("rows", first, 1) + 1, len(drive.time) - 1)
    candidates, means = {}, {}
    for level in (number("levels", each, above=0) for each in levels):
        candidates[level] = louder = _louder(settings, level)
        run = run_vehicle_filter(drive, louder, aiding=False, last=last)
        variances = np.diagonal(run.innovation_covariances, axis1=1, axis2=2)
        squares = run.innovations[:, 5:] ** 2 / np.moveaxis(variances, 2, 1)[:, 5:]
        means[level] = float(np.nanmean(squares[first:]))
    best = min(means, key=lambda level: abs(np.log(means[level])))
    return candidates[best], means


def _louder(settings: FilterSettings, level: float) -> FilterSettings:
    """Return the settings with all inertial noises multiplied."""
    names = ("gyro_noise", "accelerometer_noise", "gyro_walk", "accelerometer_walk")
    return replace(settings, **{name: level * getattr(settings, name) for name in names})
