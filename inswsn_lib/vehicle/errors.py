"""How far a run of the filter is from the truth."""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from inswsn_lib.checks import Array
from inswsn_lib.errors import Described, ParameterError
from inswsn_lib.inertial.earth import metres
from inswsn_lib.simulation.drive import Drive
from inswsn_lib.vehicle.filter import VehicleRun


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
