"""One epoch of the vehicle's filter: its error carried on, then updated group by group."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
from numpy.typing import NDArray

from inswsn_lib.checks import Array, Mask
from inswsn_lib.kernels import import_numba_user
from inswsn_lib.vehicle.error_model import (
    POSITION,
    STATES,
    compass_row,
    discretise,
    earth_rate,
    error_dynamics,
    gps_rows,
    lateral_row,
    metres,
    noise_input,
    transport_rate,
    wrapped,
    yaw,
)
from inswsn_lib.vehicle.settings import FilterSettings
from inswsn_lib.vehicle.strapdown import VehicleState, integrate_strapdown

earth = import_numba_user("pyins.earth")

Integers = NDArray[np.intp]

# The groups of measurements: compass and lateral velocity, then position and velocity of GPS
_FIRST, _SECOND = slice(0, 2), slice(2, 8)


def sequential_update(
    x: Array, P: Array, z: Array, H: Array, R: Array, used: Mask
) -> tuple[Array, Array, Array, Array]:
    r"""Update estimates with one group of measurements (P3 (24)-(26)).

    .. math::
        S = H P H' + R, \quad K = P H' S^{-1}, \quad x \leftarrow x + K (z - H x), \quad
        P \leftarrow (I - K H) P (I - K H)' + K R K'

    Parameters
    ----------
    x, P : ndarray, (runs, n) and (runs, n, n)
    z, H : ndarray, (runs, m) and (runs, m, n)
        INS less sensor, and its rows.
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
    As uncertain as the measurement, the estimate goes half of the way:

    >>> import numpy as np, inswsn_lib as iw
    >>> one, matrix = np.ones((1, 1)), np.ones((1, 1, 1))
    >>> iw.vehicle.sequential_update(0 * one, matrix, 2 * one, matrix, one[0], one > 0)[0].item()
    1.0
    """
    innovation = z - (H @ x[..., None])[..., 0]
    noise = R[..., None] * np.eye(R.shape[-1])
    covariance = H @ P @ np.swapaxes(H, 1, 2) + noise
    rows = H * used[..., None]
    PH = P @ np.swapaxes(rows, 1, 2)
    K = np.swapaxes(np.linalg.solve(rows @ PH + noise, np.swapaxes(PH, 1, 2)), 1, 2)
    x = x + (K @ np.where(used, innovation, 0.0)[..., None])[..., 0]
    keep = np.eye(P.shape[-1]) - K @ rows
    P = keep @ P @ np.swapaxes(keep, 1, 2) + (K * R[..., None, :]) @ np.swapaxes(K, 1, 2)
    return x, P, innovation, covariance


def propagate(
    settings: FilterSettings,
    state: VehicleState,
    rotations: Array,
    velocities: Array,
    period: float,
) -> VehicleState:
    """Carry the INS, its error and its covariance over an interval (P3 (22), (23)).

    The interval is divided into `substeps`; what moves the error is that of their middles.
    """
    flown = integrate_strapdown(state, rotations, velocities, period)
    edges = substep_edges(rotations.shape[1], settings.substeps)
    middle, lengths = (edges[:-1] + edges[1:]) // 2, np.diff(edges) * period
    position, velocity, attitude = (x[:, middle] for x in flown)
    change = np.diff(flown[1][:, edges], axis=1) / lengths[:, None]
    force = _force(position, velocity, change)
    F = np.zeros((*force.shape[:2], settings.states, settings.states))
    F[..., :STATES, :STATES] = error_dynamics(position, velocity, attitude, force)
    density = np.zeros_like(F)
    density[..., :STATES, :STATES] = _density(settings, attitude)
    if "gps" in settings.extra:
        i = settings.column("gps")
        for j in (i, i + 1):
            F[..., j, j] = -1 / settings.gps_time
            density[..., j, j] = 2 * settings.gps_error**2 / settings.gps_time
    error, P = state.error, state.covariance
    transitions, processes = discretise(F, density, lengths)
    for j in range(len(lengths)):
        transition = transitions[:, j]
        error = (transition @ error[..., None])[..., 0]
        P = transition @ P @ np.swapaxes(transition, 1, 2) + processes[:, j]
    position, velocity, attitude = (x[:, -1] for x in flown)
    return replace(
        state,
        position=position,
        velocity=velocity,
        attitude=attitude,
        error=error,
        covariance=0.5 * (P + np.swapaxes(P, 1, 2)),
    )


@cache
def substep_edges(samples: int, substeps: int) -> Integers:
    """Return where substeps begin and end among the samples of an interval, (substeps + 1,)."""
    return np.linspace(0, samples, substeps + 1).round().astype(np.intp)


def _force(position: Array, velocity: Array, change: Array) -> Array:
    r"""Return the specific force :math:`f = \dot v + (2\omega_{ie} + \omega_{en}) \times v - g`."""
    rate = 2 * earth_rate(position) + transport_rate(position, velocity)
    force = change + np.cross(rate, velocity)
    force[..., 2] += earth.gravity(np.rad2deg(position[..., 0]), position[..., 2])
    return np.asarray(force)


def _density(settings: FilterSettings, attitude: Array) -> Array:
    """Return the power density of the noise in the states, (..., 15, 15)."""
    noises = settings.accelerometer_noise, settings.gyro_noise
    scaled = noise_input(attitude) * np.repeat(
        [*noises, settings.accelerometer_walk, settings.gyro_walk], 3
    )
    return np.asarray(scaled @ np.swapaxes(scaled, -1, -2))


def measure(
    settings: FilterSettings, state: VehicleState, told: Array
) -> tuple[Array, Array, Array]:
    """Return INS less sensor (runs, 8), NaN where nothing is told, with rows and variances.

    What is told is that of an epoch in `Drive.measurements`, (runs, 7).
    """
    C, v, size = state.attitude, state.velocity, metres(state.position)
    z = np.concatenate(
        [
            wrapped(yaw(C) - told[:, 0])[:, None],
            (C[:, :, 1] * v).sum(axis=-1)[:, None],
            state.position - told[:, 1:4],
            v - told[:, 4:],
        ],
        axis=1,
    )
    H = np.zeros((len(z), 8, settings.states))
    H[:, :1, :STATES], H[:, 1:2, :STATES] = compass_row(C), lateral_row(C, v)
    H[:, _SECOND, :STATES] = gps_rows()
    for name in settings.extra:
        i = settings.column(name)
        if name == "gps":
            H[:, 3, i], H[:, 2, i + 1] = -1 / size[:, 1], -1 / size[:, 0]
        else:
            H[:, 0, i] = -1.0
        if name == "mounting":  # the vehicle's forward axis is turned by this from that of the IMU
            H[:, 1, i] = (C[:, :, 0] * v).sum(axis=-1)
    R = np.empty(z.shape)
    R[:, _FIRST] = np.array([settings.compass, settings.lateral]) ** 2
    R[:, 2:5] = (settings.gps_position / size) ** 2
    R[:, 5:] = settings.gps_velocity**2
    return z, H, R


def update(
    settings: FilterSettings,
    state: VehicleState,
    z: Array,
    H: Array,
    R: Array,
    *,
    sensed: bool,
    heard: bool,
) -> tuple[VehicleState, Array, Array, Array]:
    """Update with each group (P3 Section 3.3): state, X1, innovations and their covariances."""
    x, P = state.error, state.covariance
    used = ~np.isnan(z)
    used[:, _FIRST] &= sensed
    used[:, _SECOND] &= heard
    expected = (H[:, 0] * (P @ H[:, 0, :, None])[..., 0]).sum(axis=-1) + R[:, 0]
    surprise = z[:, 0] - (H[:, 0] * x).sum(axis=-1)
    used[:, 0] &= surprise**2 <= settings.gate**2 * expected
    z = np.where(np.isnan(z), 0.0, z)
    innovations, covariances = np.empty(z.shape), np.zeros((len(z), 8, 8))
    estimates = []
    for group in (_FIRST, _SECOND):
        x, P, nu, S = sequential_update(x, P, z[:, group], H[:, group], R[:, group], used[:, group])
        innovations[:, group], covariances[:, group, group] = nu, S
        estimates.append(x)
    return (
        replace(state, error=x, covariance=P),
        state.position - estimates[0][:, POSITION],
        np.where(used, innovations, np.nan),
        covariances,
    )
