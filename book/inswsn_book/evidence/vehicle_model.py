"""P3's model of a car's INS and its filter, against computations that share no line with it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
import pandas as pd
from pyins import filters, inertial_sensor, measurements, strapdown, transform
from pyins.util import DV_COLS, LLA_COLS, THETA_COLS, TRAJECTORY_COLS, VEL_COLS
from scipy.linalg import expm
from scipy.spatial.transform import Rotation

from inswsn_book.evidence.p3_equations import (
    compass_row,
    discretise,
    error_dynamics,
    gps_rows,
    lateral_row,
    sequential_update,
)
from inswsn_lib.checks import Array
from inswsn_lib.evaluation import normalised_squares
from inswsn_lib.inertial import metres
from inswsn_lib.navigation import VehicleOutages
from inswsn_lib.navigation.vehicle_outages import OUTAGE
from inswsn_lib.simulation import Drive, Truth
from inswsn_lib.vehicle import (
    FilterSettings,
    VehicleRun,
    VehicleState,
    align,
    navigation_error,
    replay,
    run_vehicle_filter,
)

_SIZES = np.repeat([1.0, 0.1, 3e-3, 0.3, 3e-3], 3)  # m, m/s, rad, m/s^2, rad/s
_DEGREES = np.array([np.rad2deg(1.0), np.rad2deg(1.0), 1.0])
_TO_NED = np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]])


class Moment(NamedTuple):
    """Position, velocity and attitude, and what the sensors feel, all as `VehicleState` has them.

    Specific force (m/s^2) and rate (rad/s) are about the body's axes.
    """

    position: Array
    velocity: Array
    attitude: Array
    force: Array
    rate: Array

    @classmethod
    def of(cls, truth: Truth, epoch: int) -> Moment:
        """Return an epoch of a drive."""
        way, sample = truth.reference, epoch * round(1 / truth.period) + 1
        felt = truth.velocity[:, sample] / truth.period, truth.rotation[:, sample] / truth.period
        assert way.attitude is not None  # a simulated drive has one
        return cls(way.position[epoch], way.velocity[epoch], way.attitude[epoch], *felt)

    @property
    def dynamics(self) -> Array:
        """F by P3's equations."""
        turned = self.attitude @ self.force
        return error_dynamics(self.position, self.velocity, self.attitude, turned)

    @property
    def rows(self) -> Array:
        """The rows of compass, lateral velocity and GPS by P3's equations, (8, 15)."""
        compass = compass_row(self.attitude)
        return np.concatenate([compass, lateral_row(self.attitude, self.velocity), gps_rows()])

    @property
    def metres(self) -> Array:
        """What a unit of each state is in metres, (15,): radians become metres."""
        return np.concatenate([metres(self.position), np.ones(12)])


def model_differences(moment: Moment, step: float) -> dict[str, float]:
    """Return the largest differences of P3's matrices from computations that do not use them.

    As shares of the largest entry of a row, columns in metres: ``dynamics``, ``compass``,
    ``lateral`` and ``gps`` from central differences of pyins' full mechanisation, ``transition``
    over a step (s) from the matrix exponential.
    """
    F, numeric, rows = moment.dynamics, numeric_rows(moment), moment.rows
    transition = discretise(F, np.zeros((15, 15)), step)[0]
    pairs = {
        "dynamics": (numeric_dynamics(moment), F),
        "transition": (transition, expm(F * step)),
        **{
            name: (numeric[part], rows[part])
            for name, part in zip(
                ("compass", "lateral", "gps"), map(slice, (0, 1, 2), (1, 2, 8)), strict=True
            )
        },
    }
    return {name: _row_difference(*pair, moment.metres) for name, pair in pairs.items()}


def largest_differences(truth: Truth, step: float) -> dict[str, float]:
    """Return the largest `model_differences` of the places of a drive."""
    moments = (Moment.of(truth, place.start + 20) for place in truth.places)
    each = [model_differences(moment, step) for moment in moments]
    return {name: max(found[name] for found in each) for name in each[0]}


def numeric_dynamics(moment: Moment) -> Array:
    """Return F by central differences of pyins' integrator, for a step of no length."""
    # F does not know the longitude, and zero is not rounded
    there = moment._replace(position=moment.position * np.array([1.0, 0.0, 1.0]))
    return 2 * _growth(there, 0.005) - _growth(there, 0.01)


def numeric_rows(moment: Moment) -> Array:
    """Return the rows of the eight measurements by central differences of what an INS tells."""
    sizes = _SIZES / moment.metres
    state = _perturbed(moment, np.concatenate([np.diag(sizes), -np.diag(sizes)]))
    forward = state.attitude @ np.array([1.0, 0.0, 0.0])
    heading = np.unwrap(np.arctan2(forward[:, 0], forward[:, 1]))
    lateral = np.einsum("rij,ri->rj", state.attitude, state.velocity)[:, 1]
    measured = np.column_stack([heading, lateral, state.position, state.velocity])
    return np.asarray(((measured[:15] - measured[15:]) / (2 * sizes[:, None])).T)


def _perturbed(moment: Moment, x: Array) -> VehicleState:
    """Return what an INS computes whose errors are x, (m, 15); biases stay in the sensors."""
    turned = Rotation.from_rotvec(-x[:, 6:9]).as_matrix() @ moment.attitude
    zero = np.zeros((len(x), 3))
    position, velocity = moment.position + x[:, :3], moment.velocity + x[:, 3:6]
    return VehicleState(position, velocity, turned, zero, zero, zero, zero)


def _integrated(
    state: VehicleState, turns: Array, pushes: Array, step: float
) -> tuple[Array, Array, Array]:
    """Return where pyins' integrator is after a sample."""
    begin = state.position * _DEGREES, state.velocity @ _TO_NED, _TO_NED @ state.attitude
    lla, speed, matrix = (np.stack([x, x], axis=1) for x in begin)
    for one in zip(lla, speed, matrix, turns, pushes, strict=True):
        strapdown.integrate(np.array([step]), *one, 0, True)
    return lla[:, 1] / _DEGREES, speed[:, 1] @ _TO_NED, _TO_NED @ matrix[:, 1]


def _growth(moment: Moment, step: float) -> Array:
    """Return how errors grow over one step of pyins' integrator, per second."""
    sizes = _SIZES / moment.metres
    x = np.concatenate([np.diag(sizes), -np.diag(sizes), np.zeros((1, 15))])
    turns = (moment.rate * step + x[:, 12:] * step)[:, None]
    # the frame at the sample's beginning
    turned = 0.5 * np.cross(moment.rate, moment.force) * step**2
    pushes = (moment.force * step + x[:, 9:12] * step + turned)[:, None]
    position, velocity, attitude = _integrated(_perturbed(moment, x), turns, pushes, step)
    after = x.copy()
    after[:, :3] = position - position[-1]
    after[:, 3:6] = velocity - velocity[-1]
    after[:, 6:9] = -Rotation.from_matrix(attitude @ attitude[-1].T).as_rotvec()
    change = (after[:15] - after[15:-1]) / 2 - np.diag(sizes)
    return np.asarray((change / sizes[:, None]).T / step)


def _row_difference(found: Array, expected: Array, unit: Array) -> float:
    """Return the largest difference as a share of the largest entry of its row, in metres."""
    size = np.abs(expected / unit).max(axis=1)
    gap = np.abs((found - expected) / unit).max(axis=1)
    return float((gap / np.where(size > 0, size, 1.0)).max())


def run_pyins(
    drive: Drive, believed: FilterSettings, last: int, step: float
) -> tuple[Array, pd.DataFrame]:
    """Return what pyins' feedback filter finds for the first run by GPS alone, at the epochs.

    Positions, (epochs, 3), as in `Drive`, and deviations by pyins' names and in its units. It has
    the same start, noises and fixes, up to the epoch `last`, and steps of its own (s).
    """
    start, samples = align(drive, believed)[0], last * drive.samples_per_epoch
    rph = transform.mat_to_rph(_TO_NED @ start.attitude)
    begin = [*(start.position * _DEGREES), *(_TO_NED @ start.velocity), *rph]
    sensed = drive.rotation_increments, drive.velocity_increments
    increments = pd.DataFrame(
        np.hstack([np.full((samples, 1), drive.period), *(x[:samples, :, 0] for x in sensed)]),
        index=drive.period * np.arange(1, samples + 1),
        columns=["dt", *THETA_COLS, *DV_COLS],
    )
    # a fix belongs to the increment that begins at its epoch; that of epoch 0 made the start
    fixes = slice(1, last + 1)
    position, velocity = (
        pd.DataFrame(values[fixes], index=drive.time[fixes] + 1e-6, columns=columns)
        for values, columns in (
            (drive.gps_position[:, :, 0] * _DEGREES, LLA_COLS),
            (drive.gps_velocity[:, :, 0] @ _TO_NED, VEL_COLS),
        )
    )
    gyro, accelerometer = (
        inertial_sensor.EstimationModel(*model)
        for model in (
            (believed.gyro_drift, believed.gyro_noise, believed.gyro_walk),
            (
                believed.accelerometer_bias,
                believed.accelerometer_noise,
                believed.accelerometer_walk,
            ),
        )
    )
    unsure = believed.position, believed.velocity
    found = filters.run_feedback_filter(
        pd.Series(begin, index=TRAJECTORY_COLS, name=0.0),
        *unsure,
        np.rad2deg(believed.tilt),
        np.rad2deg(believed.yaw),
        increments,
        gyro,
        accelerometer,
        [
            measurements.Position(position, believed.gps_position),
            measurements.NedVelocity(velocity, believed.gps_velocity),
        ],
        time_step=step,
    )
    track = found.trajectory.iloc[:: drive.samples_per_epoch]
    places = np.asarray(track[LLA_COLS].to_numpy() / _DEGREES)
    return places, found.trajectory_sd.reindex(track.index)


class Epoch:
    """What a filter knows at an epoch of some drives, and the eight measurements of it.

    Attributes
    ----------
    prior : tuple of ndarray, (runs, 15) and (runs, 15, 15)
        The estimate before the measurements, and its covariance.
    """

    def __init__(self, drive: Drive, believed: FilterSettings, epoch: int) -> None:
        run = run_vehicle_filter(drive, believed, last=epoch)
        states, innovation = run.states, run.innovations[epoch].T
        now = states.position[epoch], states.velocity[epoch], states.attitude[epoch]
        none = np.zeros(3)  # the rows do not ask what the sensors feel
        self._rows = np.array([Moment(*each, none, none).rows for each in zip(*now, strict=True)])
        self._innovation, self._used = np.nan_to_num(innovation), ~np.isnan(innovation)
        gps = (believed.gps_position / metres(now[0][0])) ** 2, [believed.gps_velocity**2] * 3
        self._noise = np.concatenate([[believed.compass**2, believed.lateral**2], *gps])
        self.prior = np.zeros((len(self._rows), 15)), states.covariance[epoch - 1]

    def updated(
        self, prior: tuple[Array, Array], part: slice, without: slice = slice(0)
    ) -> tuple[Array, Array]:
        """Return an estimate and its covariance after some measurements, some of them left out."""
        used = self._used.copy()
        used[:, without] = False
        rows, noise = self._rows[:, part], self._noise[part]
        innovation = self._innovation[:, part]
        x, P, *_ = sequential_update(*prior, innovation, rows, noise, used[:, part])
        return x, P

    def apart(self, one: Sequence[Array], other: Sequence[Array]) -> float:
        """Return the largest difference in standard deviations of the prior."""
        size = np.sqrt(np.diagonal(self.prior[1], axis1=1, axis2=2))
        sizes = size, size[:, :, None] * size[:, None, :]
        parts = zip(one, other, sizes, strict=False)  # the estimate alone, or its covariance too
        return max(float(np.abs((x - y) / s).max()) for x, y, s in parts)


def variance_parts(outages: VehicleOutages) -> dict[str, Array]:
    """Return the deviation of the position that the aided filter states at 40 s of an outage, m.

    Of the outages and runs of the first route: the ``whole``, what ``noise`` within the outage
    makes of it, what the noise of the ``gyros`` makes of that, and what is unknown at its
    ``start``.
    """
    drive, starts, told = outages.drives[0], outages.starts[0], outages.beliefs
    base = run_vehicle_filter(drive, told, last=max(starts))
    silent = replace(told, gyro_noise=1e-12, gyro_walk=1e-12)
    silent = replace(silent, accelerometer_noise=1e-12, accelerometer_walk=1e-12)

    def deviation(believed: FilterSettings, scale: float) -> Array:
        begun = replace(base.states, covariance=base.states.covariance * scale)
        known = replace(base, states=begun)
        end = replay(drive, believed, known, starts, OUTAGE, aiding=True).states
        P = np.diagonal(end.covariance[-1], axis1=1, axis2=2)[:, :2]
        return np.asarray(np.sqrt((P * metres(end.position[-1])[:, :2] ** 2).sum(axis=1)))

    return {
        "whole": deviation(told, 1.0),
        "noise": deviation(told, 1e-9),
        "gyros": deviation(replace(silent, gyro_noise=told.gyro_noise), 1e-9),
        "start": deviation(silent, 1.0),
    }


def consistency(run: VehicleRun, drive: Drive) -> Mapping[str, tuple[Array, int]]:
    """Return NEES and NIS with their degrees of freedom, at epochs that are 50 s apart."""
    every = slice(100, None, 50)
    P = np.moveaxis(run.states.covariance[every, :, :9, :9], 1, 3)
    nu, S = run.innovations[every], run.innovation_covariances[every]
    parts = {
        "NIS of GPS": slice(2, None),
        "NIS of compass": slice(0, 1),
        "NIS of constraint": slice(1, 2),
    }
    left = navigation_error(run, drive)[every]
    found = {"NEES": (normalised_squares(left, P), 9)}
    for name, part in parts.items():
        squares = normalised_squares(nu[:, part], S[:, part, part])
        found[name] = squares, nu[:, part].shape[1]
    return {name: pair for name, pair in found.items() if np.isfinite(pair[0]).any()}
