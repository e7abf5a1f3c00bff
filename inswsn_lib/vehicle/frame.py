r"""P3's car in the inertial filter: its sensors as a table, its states as P3 has them.

The filter is `inswsn_lib.inertial`'s, in a level frame about the start of the drive. P3's states
are latitude, longitude and height, and vectors along east, north and up of the place; its errors
are what the INS computes less the truth, and the attitude error turns about axes of the place,
:math:`C' = (I - [\varphi\times])\,C`. With E the axes of the place in the frame, covariances of the
filter's errors (truth less INS, a turn :math:`\theta` of the body) are carried over by

.. math::
    (\delta L, \delta\lambda, \delta h) = -D^{-1} E'\,\delta p, \qquad
    \delta v_n = -E'\,\delta v, \qquad \varphi = C\,\theta ,

with D the metres of a radian. By how much E itself is wrong where the position is, 1.6e-7 rad for a
metre, is left out of covariances; errors that are kept beside an INS are differences of states.
"""

from __future__ import annotations

from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from inswsn_lib.checks import Array, Mask, whole
from inswsn_lib.errors import ParameterError
from inswsn_lib.inertial import sensors
from inswsn_lib.inertial.earth import Earth, metres
from inswsn_lib.inertial.mechanization import turned
from inswsn_lib.inertial.observations import gauss_markov
from inswsn_lib.inertial.runs import Outcome, Table
from inswsn_lib.inertial.steps import Steps
from inswsn_lib.inertial.strapdown import InertialState
from inswsn_lib.simulation.drive import Drive
from inswsn_lib.vehicle.settings import FilterSettings
from inswsn_lib.vehicle.state import ATTITUDE, POSITION, STATES, VELOCITY, VehicleState

Integers = NDArray[np.intp]

SENSORS = (sensors.heading, sensors.body_velocity, sensors.position, sensors.velocity)
# The sensors of compass, lateral velocity, position and velocity of GPS
_KINDS = [0, 1, 2, 2, 2, 3, 3, 3]
# P3's two groups; what else tells the velocity of the body stands between them
_FIRST, _SECOND = slice(0, 2), slice(-6, None)
_NORTH_EAST_UP = [1, 0, 2]


class DriveFrame:
    """A drive in a level frame about its start, and what a filter is told of it.

    Raises
    ------
    ParameterError
        If there are more substeps than samples in an epoch, or `gps_time` is below an epoch.
    """

    def __init__(self, drive: Drive, settings: FilterSettings) -> None:
        whole("substeps", settings.substeps, 1, drive.samples_per_epoch)
        if "gps" in settings.extra and settings.gps_time < drive.interval:
            raise ParameterError("gps_time", settings.gps_time, f"at least {drive.interval}")
        self.drive, self.settings = drive, settings
        self.earth = Earth(*map(float, drive.reference.position[0]))
        self._more = 0 if drive.body_velocity is None else 3
        # headings of the filter are counted to the left, P3's to the right
        self._signs = np.ones(settings.states - STATES)
        for name in {"compass", "mounting"} & set(settings.extra):
            self._signs[settings.column(name) - STATES] = -1.0

    def steps(self, epochs: Integers, which: Integers) -> Steps:
        """Return what the IMU told up to some epochs, (runs, steps), of some runs of the drive."""
        drive, told = self.drive, self.settings
        samples, count = drive.samples_per_epoch, epochs.shape[1]
        rates, forces = (x.reshape(drive.runs, -1, 3) for x in drive.increments)
        return Steps(
            np.full(count * samples, drive.period), rates, forces,
            samples * np.arange(1, count + 1), np.array(told.numbers[:4]), increments=True,
            substep=drive.interval / told.substeps, earth=self.earth.numbers, which=which,
            offsets=samples * (epochs[:, 0] - 1) if count else np.zeros_like(which),
        )  # fmt: skip

    def own(self, count: int) -> tuple[Array, Array]:
        """Return by what the extra states are multiplied in each of some epochs, and their gain."""
        told, n = self.settings, self.settings.states - STATES
        times, deviations = np.full(n, np.inf), np.zeros(n)
        if "gps" in told.extra:
            i = told.column("gps") - STATES
            times[i : i + 2], deviations[i : i + 2] = told.gps_time, told.gps_error
        factors, gained = gauss_markov(self.drive.interval, times, deviations)
        return np.tile(factors, (count, 1)), np.tile(gained, (count, 1))

    def table(self, epochs: Integers, which: Integers, heard: Mask, sensed: Mask) -> Table:
        """Return the measurements of some epochs: two for each, without GPS and of GPS."""
        runs, count = epochs.shape
        told, n = self._told[epochs, which[:, None]], self.settings.states - STATES
        told[:, ~sensed, :-6] = np.nan
        told[:, ~heard, _SECOND] = np.nan
        own = [i if i < 0 else i - STATES for i in self.settings.columns]
        rows, aids = 8 + self._more, 2 + self._more
        data = np.full((rows, 9), -1.0)
        data[0] = [1.0, 0.0, 0.0, *self.earth.numbers, *own[:2]]
        data[1, :7] = [0.0, -1.0, 0.0, 1.0, 0.0, 0.0, own[1]]
        data[2:aids, :3], data[2:aids, 6] = np.eye(3)[: self._more], -1.0
        data[-6:-3, :3] = np.eye(3)
        data[-3:] = np.eye(3, 9)
        if own[2] >= 0:
            data[-6:-4, 3] = own[2], own[2] + 1
        noise, each = np.zeros((rows, 3)), self.settings
        noise[:2, 0] = each.compass**2, each.lateral**2
        noise[2:aids, 0] = each.body_velocity**2
        noise[-6:-3, 0], noise[-3:, 0] = each.gps_position**2, each.gps_velocity**2
        noise[:, 1] = np.inf
        noise[0, 1:] = each.gate**2, 2 * np.pi
        begins = rows * np.repeat(np.arange(count), 2) + np.tile([0, aids], count)
        kinds = np.array([*_KINDS[:2], *[1] * self._more, *_KINDS[2:]], dtype=np.int64)
        return Table(
            2 * np.arange(count + 1), begins, begins + np.tile([aids, 6], count),
            np.tile(kinds, count), np.tile(data, (count, 1)), np.zeros((rows * count, 3)),
            np.tile(noise, (count, 1)), np.tile([0.0, n], (rows * count, 1)),
            told.reshape(runs, rows * count),
        )  # fmt: skip

    @cached_property
    def _told(self) -> Array:
        """What was measured, (epochs, runs, 8 or 11), in the frame; NaN where missing.

        Where a part is missing, the last one before it serves to turn the others into the frame.
        """
        heading, gps = self.drive.measurements[..., 0], self.drive.measurements[..., 1:]
        missing = np.isnan(gps)
        if missing.any():
            here = np.where(missing, 0, np.arange(len(gps))[:, None, None])
            last = np.maximum.accumulate(here, axis=0)
            gps = np.nan_to_num(np.take_along_axis(gps, last, axis=0))
        place = self.earth.local(gps[..., :3])
        axes = self.earth.ground(place).axes
        more = self.drive.body_velocity
        aids = [np.stack([np.pi / 2 - heading, np.zeros_like(heading)], -1)]
        aids += [] if more is None else [np.moveaxis(more, 1, 2)]
        told = np.concatenate([*aids, place, (axes @ gps[..., 3:, None])[..., 0]], axis=-1)
        told[..., _SECOND][missing[..., [*_NORTH_EAST_UP, 3, 4, 5]]] = np.nan
        return told

    def from_vehicle(self, state: VehicleState, feedback: bool) -> tuple[Array, Array, Array]:
        """Return states, covariances and errors of the filter, runs before axes."""
        place = self.earth.local(state.position)
        axes = self.earth.ground(place).axes
        R = axes @ state.attitude
        size = metres(state.position)[..., None]
        to_frame = -axes @ (np.eye(3)[_NORTH_EAST_UP].T * np.swapaxes(size, -1, -2))
        turns = to_frame, -axes, np.swapaxes(state.attitude, -1, -2)
        P, own = self._carried(turns, state.covariance), self._signs * state.error[:, STATES:]
        velocity = (axes @ state.velocity[..., None])[..., 0]
        biases = state.accelerometer_bias, state.gyro_drift
        x = np.concatenate([place, velocity, R.reshape(-1, 9), *biases, 0 * own], axis=1)
        e = np.concatenate([np.zeros_like(state.error[:, :STATES]), own], axis=1)
        if not feedback:
            true, _, _ = self.from_vehicle(state.corrected(), feedback=True)
            e[:, :STATES] = np.array([
                InertialState.of_row(b).minus(InertialState.of_row(a))[:STATES]
                for a, b in zip(x, true, strict=True)
            ])  # fmt: skip
        return x, P, e

    def to_vehicle(self, x: Array, e: Array, P: Array) -> VehicleState:
        """Return P3's states, of any leading shape, of states, errors and covariances."""
        position, axes = self.earth.geodetic(x[..., :3]), self.earth.ground(x[..., :3]).axes
        back = np.swapaxes(axes, -1, -2)
        attitude = back @ x[..., 6:15].reshape(*x.shape[:-1], 3, 3)
        turns = -back[..., _NORTH_EAST_UP, :] / metres(position)[..., None], -back, attitude
        velocity = (back @ x[..., 3:6, None])[..., 0]
        error = np.zeros_like(e)
        error[..., STATES:] = self._signs * e[..., STATES:]
        if e[..., :STATES].any():
            true = x[..., :21] + e[..., [*range(6), *[0] * 9, *range(9, 15)]]
            R = x[..., 6:15].reshape(attitude.shape) @ turned(e[..., ATTITUDE])
            true[..., 6:15] = R.reshape(*x.shape[:-1], 9)
            there = self.to_vehicle(true, 0 * e, P)
            error[..., POSITION] = position - there.position
            error[..., VELOCITY] = velocity - there.velocity
            apart = there.attitude @ np.swapaxes(attitude, -1, -2)
            turns_ = Rotation.from_matrix(apart.reshape(-1, 3, 3)).as_rotvec()
            error[..., ATTITUDE] = turns_.reshape(velocity.shape)
            error[..., 9:STATES] = e[..., 9:STATES]
        return VehicleState(
            position=position, velocity=velocity, attitude=attitude,
            accelerometer_bias=x[..., 15:18], gyro_drift=x[..., 18:21], error=error,
            covariance=self._carried(turns, P),
        )  # fmt: skip

    def _carried(self, turns: tuple[Array, Array, Array], P: Array) -> Array:
        """Return covariances, (..., n, n), with their blocks turned."""
        found = P.copy()
        for block, turn in zip((POSITION, VELOCITY, ATTITUDE), turns, strict=True):
            found[..., block, :] = turn @ found[..., block, :]
            found[..., :, block] = found[..., :, block] @ np.swapaxes(turn, -1, -2)
        if found.shape[-1] > STATES:
            found[..., STATES:] *= self._signs
            found[..., STATES:, :] *= self._signs[:, None]
        return found

    def innovations(self, found: Outcome, states: VehicleState) -> tuple[Array, Array]:
        """Return P3's innovations, (steps, 8, runs), INS less sensor, and their covariances."""
        epochs, runs = found.states.shape[:2]
        values = np.where(found.used, found.values, np.nan).reshape(runs, epochs, 8 + self._more)
        values = np.swapaxes(values, 0, 1)[..., [0, 1, *range(-6, 0)]]
        back = np.swapaxes(self.earth.ground(found.states[..., :3]).axes, -1, -2)
        turn = np.zeros((epochs, runs, 6, 6))
        turn[..., :3, :3] = -back[..., _NORTH_EAST_UP, :] / metres(states.position)[..., None]
        turn[..., 3:, 3:] = -back
        missing = np.isnan(values[..., _SECOND])[..., [*_NORTH_EAST_UP, 3, 4, 5]]
        gps = (turn @ np.nan_to_num(values[..., _SECOND, None]))[..., 0]
        values[..., _SECOND] = np.where(missing, np.nan, gps)
        S, spreads = np.zeros((epochs, runs, 8, 8)), found.spreads
        S[..., _FIRST, _FIRST] = spreads[::2, :, :2, :2]
        if epochs:
            S[..., _SECOND, _SECOND] = turn @ spreads[1::2] @ np.swapaxes(turn, -1, -2)
        return np.moveaxis(values, 1, 2), np.moveaxis(S, 1, 3)
