"""How an IMU is turned in its vehicle, from what a filter without the constraint found."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from inswsn_lib.errors import ParameterError
from inswsn_lib.vehicle.filter import VehicleRun

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Mounting:
    """The vehicle's axes in those of the IMU.

    Attributes
    ----------
    yaw, pitch : ndarray, (runs,)
        Of the vehicle's forward axis in the IMU's axes (rad): to the right, and up.
    rotation : ndarray, (runs, 3, 3)
        Takes vectors from the IMU's axes to the vehicle's, forward, right, down.
    epochs : ndarray of int, (runs,)
        How many epochs told.

    Examples
    --------
    The rotation takes the vehicle's forward axis, in the IMU's axes, to (1, 0, 0):

    >>> import numpy as np
    >>> from inswsn_lib.files import data_file
    >>> from inswsn_lib.scenario import load_scenario, with_values
    >>> from inswsn_lib.vehicle import (
    ...     FilterSettings, estimate_mounting, run_vehicle_filter, simulate_drive
    ... )
    >>> scenario = load_scenario(data_file("scenarios/p3.yaml"))
    >>> drive = simulate_drive(with_values(scenario, imu_period=0.1), runs=1, seed=0)
    >>> settings = FilterSettings.from_settings(scenario)
    >>> mounting = estimate_mounting(run_vehicle_filter(drive, settings, aiding=False, last=80), 80)
    >>> level = np.cos(mounting.pitch)
    >>> forward = np.stack(
    ...     [level * np.cos(mounting.yaw), level * np.sin(mounting.yaw), -np.sin(mounting.pitch)]
    ... )
    >>> np.abs(mounting.rotation[0] @ forward).round(6).ravel().tolist()
    [1.0, 0.0, 0.0]
    """

    yaw: Array
    pitch: Array
    rotation: Array
    epochs: NDArray[np.intp]


def estimate_mounting(run: VehicleRun, until: int, *, slowest: float = 5.0) -> Mounting:
    r"""Estimate the mounting from the direction in which the vehicle moves in the IMU's axes.

    A vehicle moves forward: its velocity in the IMU's axes, :math:`C_n^b v`, points along the
    vehicle's forward axis. Sums over epochs weigh each with its speed; side slip in turns to the
    left and to the right cancels. The turn about the forward axis cannot be seen so, and is left
    as it is.

    Parameters
    ----------
    run : VehicleRun
        From `run_vehicle_filter` without compass and lateral constraint, which would hide it.
    until : int
        The last epoch that is used.
    slowest : float
        Slower than this (m/s) does not count.

    Returns
    -------
    Mounting
        Of each run.

    Raises
    ------
    ParameterError
        If the vehicle has not moved that fast by then.

    Examples
    --------
    The IMU is turned by six degrees to the right, so that the car's forward axis is to the left of
    its own:

    >>> import numpy as np
    >>> from inswsn_lib.files import data_file
    >>> from inswsn_lib.scenario import load_scenario, with_values
    >>> from inswsn_lib.vehicle import (
    ...     FilterSettings, estimate_mounting, run_vehicle_filter, simulate_drive
    ... )
    >>> scenario = load_scenario(data_file("scenarios/p3.yaml"))
    >>> turned = with_values(scenario, imu_period=0.1, mounting_yaw=np.radians(6.0))
    >>> drive = simulate_drive(turned, runs=2, seed=0)
    >>> settings = FilterSettings.from_settings(scenario, yaw=0.2)
    >>> run = run_vehicle_filter(drive, settings, aiding=False, last=150)
    >>> found = np.degrees(estimate_mounting(run, 150).yaw)
    >>> bool(np.abs(found + 6.0).max() < 1.5)
    True
    """
    whole = isinstance(until, int | np.integer) and not isinstance(until, bool)
    if not whole or not 0 <= until < len(run.epochs):
        raise ParameterError("until", until, f"an epoch from 0 to {len(run.epochs) - 1}")
    states = run.states[: until + 1]
    velocity = np.moveaxis(run.velocity, 2, 1)[: until + 1]
    body = np.einsum("krij,kri->krj", states.attitude, velocity)
    fast = np.linalg.norm(velocity, axis=-1) > slowest
    if not fast.any(axis=0).all():
        raise ParameterError("until", until, f"an epoch after motion faster than {slowest} m/s")
    x, y, z = np.moveaxis((body * fast[..., None]).sum(axis=0), -1, 0)
    turn, rise = np.arctan2(y, x), np.arctan2(-z, np.hypot(x, y))
    forward = np.stack(
        [np.cos(rise) * np.cos(turn), np.cos(rise) * np.sin(turn), -np.sin(rise)], axis=-1
    )
    right = np.stack([-np.sin(turn), np.cos(turn), np.zeros_like(turn)], axis=-1)
    rotation = np.stack([forward, right, np.cross(forward, right)], axis=1)
    return Mounting(turn, rise, rotation, fast.sum(axis=0))
