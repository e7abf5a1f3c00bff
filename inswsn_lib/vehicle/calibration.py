"""How noisy an IMU is in its vehicle, from the innovations of GPS velocity."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from inswsn_lib.errors import ParameterError
from inswsn_lib.vehicle.filter import FilterSettings, run_vehicle_filter
from inswsn_lib.vehicle.recorded import RecordedDrive, emulate_sensors

#: Candidates: by how much the noises are multiplied
LEVELS = (0.5, 1.0, 1.5, 2.0, 3.0, 4.0, 6.0)


def calibrate_inertial_noise(
    recorded: RecordedDrive,
    settings: FilterSettings,
    rows: tuple[int, int],
    *,
    runs: int,
    seed: int,
    levels: Sequence[float] = LEVELS,
) -> tuple[FilterSettings, dict[float, float]]:
    r"""Choose by how much the inertial noises are to be larger than in the settings.

    For each level the noises of the IMU and what drives its biases are multiplied by it, a filter
    with GPS alone runs, and the squared innovations of GPS velocity over their variances are
    averaged. The level is taken whose mean is nearest to 1 on a logarithmic scale.

    Parameters
    ----------
    recorded : RecordedDrive
    settings : FilterSettings
    rows : (int, int)
        The epochs whose innovations count, both included; none after them is used.
    runs : int
        Draws of the noise of the emulated GPS.
    seed : int
        Of these draws.
    levels : sequence of float
        Candidates.

    Returns
    -------
    settings : FilterSettings
    means : dict of float to float
        By level.

    Raises
    ------
    ParameterError
        If the rows are not within the drive, or there is no candidate.

    Examples
    --------
    A recording in which the IMU is as noisy as the filter believes, and one three times as noisy;
    both are made here from a simulated drive:

    >>> import numpy as np
    >>> from inswsn_lib.files import data_file
    >>> from inswsn_lib.scenario import load_scenario, with_values
    >>> from inswsn_lib.vehicle import (
    ...     FilterSettings, RecordedDrive, calibrate_inertial_noise, simulate_drive
    ... )
    >>> from inswsn_lib.vehicle.recorded import Track
    >>> scenario = load_scenario(data_file("scenarios/p3.yaml"))
    >>> settings = FilterSettings.from_settings(scenario)
    >>> for times in (1, 3):
    ...     noises = {n: times * scenario[n].value for n in ("gyro_noise", "accelerometer_noise")}
    ...     drive = simulate_drive(with_values(scenario, imu_period=0.1, **noises), runs=1, seed=0)
    ...     true = drive.reference
    ...     track = Track(drive.time, true.position, true.velocity, np.ones(len(drive.time), int))
    ...     recorded = RecordedDrive(
    ...         0.0, drive.time, drive.period, drive.rotation_increments[..., 0],
    ...         drive.velocity_increments[..., 0], true.position, true.velocity, track,
    ...     )
    ...     louder, means = calibrate_inertial_noise(
    ...         recorded, settings, (20, 100), runs=2, seed=0, levels=(1.0, 3.0)
    ...     )
    ...     print(times, round(louder.gyro_noise / settings.gyro_noise, 3))
    1 1.0
    3 3.0
    """
    first, last = rows
    end = len(recorded.time) - 1
    whole = all(isinstance(row, int | np.integer) for row in rows)
    if not whole or not 0 < first < last <= end:
        raise ParameterError("rows", rows, f"two epochs in order, within 1 to {end}")
    if not levels or not all(0 < level < np.inf for level in levels):
        raise ParameterError("levels", levels, "one or more positive numbers")
    drive = emulate_sensors(recorded, runs=runs, seed=seed)
    means = {}
    for level in levels:
        run = run_vehicle_filter(drive, louder(settings, level), aiding=False, last=last)
        variances = np.diagonal(run.innovation_covariances, axis1=1, axis2=2)
        squares = run.innovations[:, 5:] ** 2 / np.moveaxis(variances, 2, 1)[:, 5:]
        means[float(level)] = float(np.nanmean(squares[first:]))
    best = min(means, key=lambda level: abs(np.log(means[level])))
    return louder(settings, best), means


def louder(settings: FilterSettings, level: float) -> FilterSettings:
    """Return the settings with all inertial noises multiplied."""
    return replace(
        settings,
        gyro_noise=settings.gyro_noise * level,
        accelerometer_noise=settings.accelerometer_noise * level,
        gyro_walk=settings.gyro_walk * level,
        accelerometer_walk=settings.accelerometer_walk * level,
    )
