"""The feedback filter of `pyins` on a drive, for comparison: GPS alone aids it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from pyins import filters, inertial_sensor, measurements, transform
from pyins.util import DV_COLS, LLA_COLS, RPH_COLS, THETA_COLS, VEL_COLS

from inswsn_lib.errors import ParameterError
from inswsn_lib.vehicle.drive import Drive
from inswsn_lib.vehicle.error_model import TURN
from inswsn_lib.vehicle.filter import FilterSettings, align

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class PeerRun:
    """What the filter of pyins found, at the epochs.

    Attributes
    ----------
    position : ndarray, (epochs, 3)
        Latitude, longitude (rad), height (m).
    velocity : ndarray, (epochs, 3)
        East, north, up (m/s).

    Examples
    --------
    >>> from inswsn_lib.files import data_file
    >>> from inswsn_lib.scenario import load_scenario, with_values
    >>> from inswsn_lib.vehicle import FilterSettings, run_pyins_filter, simulate_drive
    >>> scenario = load_scenario(data_file("scenarios/p3.yaml"))
    >>> drive = simulate_drive(with_values(scenario, imu_period=0.1), runs=1, seed=0)
    >>> peer = run_pyins_filter(drive, FilterSettings.from_settings(scenario), last=2, step=1.0)
    >>> peer.position.shape, peer.velocity.shape  # epochs 0, 1 and 2
    ((3, 3), (3, 3))
    """

    position: Array
    velocity: Array


def run_pyins_filter(
    drive: Drive, settings: FilterSettings, last: int, *, run: int = 0, step: float = 0.1
) -> PeerRun:
    """Run `pyins.filters.run_feedback_filter` with the same start, noises and GPS.

    Parameters
    ----------
    drive : Drive
    settings : FilterSettings
        Extra states are not known to pyins and are refused.
    last : int
        The epoch to end with.
    run : int
        Of the drive.
    step : float
        Of its covariance (s).

    Returns
    -------
    PeerRun
        At epochs 0 to `last`. The fix of the last epoch is not in it yet: pyins takes a fix with
        the increment that begins at its epoch.

    Raises
    ------
    ParameterError
        If there are extra states, or the drive has no such run or epoch.

    Examples
    --------
    With GPS alone it and `run_vehicle_filter` say the same to a centimetre, but for the last epoch:

    >>> import numpy as np
    >>> from inswsn_lib.files import data_file
    >>> from inswsn_lib.scenario import load_scenario, with_values
    >>> from inswsn_lib.vehicle import (
    ...     FilterSettings, metres, run_pyins_filter, run_vehicle_filter, simulate_drive
    ... )
    >>> scenario = load_scenario(data_file("scenarios/p3.yaml"))
    >>> settings = FilterSettings.from_settings(scenario)
    >>> drive = simulate_drive(with_values(scenario, imu_period=0.1), runs=1, seed=0)
    >>> peer = run_pyins_filter(drive, settings, last=10, step=1.0)
    >>> own = run_vehicle_filter(drive, settings, aiding=False, last=10).position[:, :, 0]
    >>> bool(np.abs((peer.position - own) * metres(own))[:-1].max() < 0.01)  # m
    True
    """
    if settings.extra:
        raise ParameterError("extra", settings.extra, "empty for pyins")
    if not 0 <= run < drive.runs or not 1 <= last < len(drive.time):
        raise ParameterError("run and last", (run, last), f"within {drive.runs}, {len(drive.time)}")
    start = align(drive, settings)[run]
    pva = pd.Series(
        np.concatenate(
            [
                start.position * _DEGREES,
                TURN @ start.velocity,
                transform.mat_to_rph(TURN @ start.attitude),
            ]
        ),
        index=[*LLA_COLS, *VEL_COLS, *RPH_COLS],
        name=drive.time[0],
    )
    samples = last * drive.samples_per_epoch
    increments = pd.DataFrame(
        np.column_stack(
            [
                np.full(samples, drive.period),
                drive.rotation_increments[:samples, :, run],
                drive.velocity_increments[:samples, :, run],
            ]
        ),
        index=drive.time[0] + drive.period * np.arange(1, samples + 1),
        columns=["dt", *THETA_COLS, *DV_COLS],
    )
    # a fix belongs to the increment that begins at its epoch; that of epoch 0 made the start
    epochs = drive.time[1 : last + 1] + 1e-6
    fixes = pd.DataFrame(
        np.hstack(
            [
                drive.gps_position[1 : last + 1, :, run] * _DEGREES,
                drive.gps_velocity[1 : last + 1, :, run] @ TURN,
            ]
        ),
        index=epochs,
        columns=[*LLA_COLS, *VEL_COLS],
    ).dropna()
    found = filters.run_feedback_filter(
        pva,
        settings.position,
        settings.velocity,
        np.rad2deg(settings.tilt),
        np.rad2deg(settings.yaw),
        increments,
        inertial_sensor.EstimationModel(
            settings.gyro_drift, settings.gyro_noise, settings.gyro_walk
        ),
        inertial_sensor.EstimationModel(
            settings.accelerometer_bias, settings.accelerometer_noise, settings.accelerometer_walk
        ),
        [
            measurements.Position(fixes[LLA_COLS], settings.gps_position),
            measurements.NedVelocity(fixes[VEL_COLS], settings.gps_velocity),
        ],
        time_step=step,
    )
    at = found.trajectory.iloc[:: drive.samples_per_epoch]
    return PeerRun(at[LLA_COLS].to_numpy() / _DEGREES, at[VEL_COLS].to_numpy() @ TURN)


_DEGREES = np.array([np.rad2deg(1.0), np.rad2deg(1.0), 1.0])
