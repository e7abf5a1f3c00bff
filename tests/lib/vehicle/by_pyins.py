"""The same filter by pyins, for tests: its tables, its error model, its loop."""

from __future__ import annotations

import numpy as np
import pandas as pd
from lib.vehicle.made_drive import PERIOD, TURN, as_pva, as_table
from pyins import filters, inertial_sensor, measurements, transform
from pyins.util import LLA_COLS, RPH_COLS, VEL_COLS, Bunch

from inswsn_lib.simulation import Drive
from inswsn_lib.vehicle import FilterSettings, align


class AtEpochs(measurements.Measurement):
    """A number that is measured at the times of a table."""

    def __init__(self, data: pd.DataFrame, deviation: float) -> None:
        super().__init__(data)
        self.R = np.array([[deviation**2]])

    def compute_matrices(self, time, pva, error_model):  # type: ignore[no-untyped-def]
        there = time in self.data.index
        return (*self.seen(time, pva, error_model), self.R) if there else None


class Compass(AtEpochs):
    """The yaw."""

    def seen(self, time, pva, error_model):  # type: ignore[no-untyped-def]
        z = np.deg2rad(pva.heading) - self.data.loc[time, "yaw"]
        row = np.deg2rad(error_model.transform_to_output(pva)[error_model.DHEADING])
        return np.array([np.angle(np.exp(1j * z))]), row[None]


class Sideways(AtEpochs):
    """The lateral velocity, which is zero."""

    def seen(self, time, pva, error_model):  # type: ignore[no-untyped-def]
        z = (transform.mat_from_rph(pva[RPH_COLS]).T @ pva[VEL_COLS].to_numpy(float))[1:2]
        return z, error_model.body_velocity_error_jacobian(pva)[1:2]


def run_by_pyins(
    drive: Drive, settings: FilterSettings, *, aiding: bool, time_step: float
) -> Bunch:
    """Run pyins' feedback filter over the first run of a drive, from the same start."""
    begun = align(drive, settings)[0]
    pva = as_pva(begun.position, begun.velocity, begun.attitude)
    increments = as_table(drive.rotation_increments[..., 0], drive.velocity_increments[..., 0])
    time = np.arange(len(drive.time)) * 100 * PERIOD
    gps = drive.gps_position[..., 0].copy()
    gps[:, :2] = np.rad2deg(gps[:, :2])
    heard: list[measurements.Measurement] = [
        measurements.Position(pd.DataFrame(gps, time, LLA_COLS), settings.gps_position),
        measurements.NedVelocity(
            pd.DataFrame(drive.gps_velocity[..., 0] @ TURN, time, VEL_COLS), settings.gps_velocity
        ),
    ]
    for measurement in heard:
        measurement.data = measurement.data.iloc[1:]  # epoch 0 made the first state
    if aiding:
        compass = pd.DataFrame({"yaw": drive.compass[1:, 0]}, time[1:])
        heard = [Compass(compass, settings.compass), Sideways(compass, settings.lateral), *heard]
    return filters.run_feedback_filter(
        pva, settings.position, settings.velocity,
        np.rad2deg(settings.tilt), np.rad2deg(settings.yaw), increments,
        inertial_sensor.EstimationModel(
            settings.gyro_drift, settings.gyro_noise, settings.gyro_walk
        ),
        inertial_sensor.EstimationModel(
            settings.accelerometer_bias, settings.accelerometer_noise, settings.accelerometer_walk
        ),
        heard, time_step,
    )  # fmt: skip
