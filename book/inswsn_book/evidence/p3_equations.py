r"""P3's error model of a strapdown INS with fifteen states, and what aids it (P3 3.1 to 3.3).

The text of P3 at hand has lost its equations; what stands here is the standard form that its words
describe (Titterton and Weston 2004; Groves 2013), in the frame east, north, up. Errors are what the
INS computes less the truth; the attitude error :math:`\varphi` turns the true frame into the
computed one, :math:`C' = (I - [\varphi\times])\,C`.

All functions take stacks: a leading shape ``...`` that is the same for every argument. ``position``
(..., 3) is latitude, longitude (rad) and height (m), ``velocity`` (..., 3) east, north, up (m/s),
``attitude`` (..., 3, 3) takes the body's axes (forward, right, down) to east, north, up.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from inswsn_lib.checks import Array, Mask
from inswsn_lib.inertial.earth import AXIS, RATE, normal_gravity, radii
from inswsn_lib.inertial.mechanization import skew
from inswsn_lib.vehicle.state import (
    ACCELEROMETER_BIAS,
    ATTITUDE,
    GYRO_DRIFT,
    POSITION,
    STATES,
    VELOCITY,
)  # fmt: skip


def earth_rate(position: Array) -> Array:
    r"""Return :math:`\omega_{ie} = \Omega\,(0, \cos L, \sin L)`, (..., 3), rad/s."""
    latitude = position[..., 0]
    rate = np.zeros(position.shape)
    rate[..., 1], rate[..., 2] = RATE * np.cos(latitude), RATE * np.sin(latitude)
    return rate


def transport_rate(position: Array, velocity: Array) -> Array:
    r"""Return :math:`(-v_N/(R_M+h),\ v_E/(R_N+h),\ v_E\tan L/(R_N+h))`, (..., 3), rad/s."""
    meridian, transverse = radii(position)
    east, north = velocity[..., 0], velocity[..., 1]
    rate = np.empty(position.shape)
    rate[..., 0], rate[..., 1] = -north / meridian, east / transverse
    rate[..., 2] = east * np.tan(position[..., 0]) / transverse
    return rate


def error_dynamics(position: Array, velocity: Array, attitude: Array, force: Array) -> Array:
    r"""Return F of P3 (3), :math:`\dot x = F x + G w`, (..., 15, 15).

    By blocks, with :math:`f` the specific force in the navigation frame,

    .. math::
        \delta\dot L &= \frac{\delta v_N}{R_M+h} - \frac{v_N\,\delta h}{(R_M+h)^2}, \qquad
        \delta\dot\lambda = \frac{\delta v_E}{(R_N+h)\cos L}
            + \frac{v_E \tan L\,\delta L}{(R_N+h)\cos L}
            - \frac{v_E\,\delta h}{(R_N+h)^2\cos L}, \qquad \delta\dot h = \delta v_U, \\
        \delta\dot v &= f\times\varphi + C\nabla - (2\omega_{ie}+\omega_{en})\times\delta v
            - (2\delta\omega_{ie}+\delta\omega_{en})\times v + \delta g, \\
        \dot\varphi &= -(\omega_{ie}+\omega_{en})\times\varphi
            + \delta\omega_{ie} + \delta\omega_{en} - C\varepsilon, \qquad
        \dot\nabla = 0, \quad \dot\varepsilon = 0 ,

    and :math:`\delta g = (0, 0, 2 g\,\delta h / R)`. The change of the radii and of gravity with
    latitude is left out, as is usual.

    Parameters
    ----------
    position, velocity, force : ndarray, (..., 3)
        The last is specific force, east, north, up (m/s^2).
    attitude : ndarray, (..., 3, 3)
    """
    latitude = position[..., 0]
    meridian, transverse = radii(position)
    east, north = velocity[..., 0], velocity[..., 1]
    sine, cosine, tangent = np.sin(latitude), np.cos(latitude), np.tan(latitude)
    rate, transport = earth_rate(position), transport_rate(position, velocity)

    # what errors of position and velocity do to the two rates
    rate_by_position = np.zeros((*latitude.shape, 3, 3))
    rate_by_position[..., 1, 0] = -RATE * sine
    rate_by_position[..., 2, 0] = RATE * cosine
    transport_by_position = np.zeros_like(rate_by_position)
    transport_by_position[..., 0, 2] = north / meridian**2
    transport_by_position[..., 1, 2] = -east / transverse**2
    transport_by_position[..., 2, 0] = east / (transverse * cosine**2)
    transport_by_position[..., 2, 2] = -east * tangent / transverse**2
    transport_by_velocity = np.zeros_like(rate_by_position)
    transport_by_velocity[..., 0, 1] = -1 / meridian
    transport_by_velocity[..., 1, 0] = 1 / transverse
    transport_by_velocity[..., 2, 0] = tangent / transverse

    F = np.zeros((*latitude.shape, STATES, STATES))
    F[..., 0, 2], F[..., 0, 4] = -north / meridian**2, 1 / meridian
    F[..., 1, 0] = east * tangent / (transverse * cosine)
    F[..., 1, 2] = -east / (transverse**2 * cosine)
    F[..., 1, 3] = 1 / (transverse * cosine)
    F[..., 2, 5] = 1.0

    across = skew(velocity)
    F[..., VELOCITY, POSITION] = across @ (2 * rate_by_position + transport_by_position)
    F[..., 5, 2] += 2 * normal_gravity(sine, 0.0) / AXIS
    F[..., VELOCITY, VELOCITY] = across @ transport_by_velocity - skew(2 * rate + transport)
    F[..., VELOCITY, ATTITUDE] = skew(force)
    F[..., VELOCITY, ACCELEROMETER_BIAS] = attitude

    F[..., ATTITUDE, POSITION] = rate_by_position + transport_by_position
    F[..., ATTITUDE, VELOCITY] = transport_by_velocity
    F[..., ATTITUDE, ATTITUDE] = -skew(rate + transport)
    F[..., ATTITUDE, GYRO_DRIFT] = -attitude
    return F


def discretise(F: Array, density: Array, step: ArrayLike) -> tuple[Array, Array]:
    r"""Return the transition and the process covariance of a short step (P3 (4)).

    .. math::
        \Phi = I + F T + \tfrac12 F^2 T^2 + \tfrac16 F^3 T^3, \qquad
        Q = \tfrac T2 \bigl( \Phi\,S\,\Phi' + S \bigr)

    Parameters
    ----------
    F, density : ndarray, (..., n, n)
        The latter is :math:`S = G q G'`, the power density of the noise.
    step : array_like, (...)
        T (s); one for all, or one for each matrix.
    """
    length = np.asarray(step, dtype=float)[..., None, None]
    scaled = F * length
    square = scaled @ scaled
    transition = np.eye(F.shape[-1]) + scaled + square / 2 + square @ scaled / 6
    carried = transition @ density @ np.swapaxes(transition, -1, -2)
    return transition, 0.5 * length * (carried + density)


def compass_row(attitude: Array) -> Array:
    r"""Return the row of the compass (P3 (12), (13)), (..., 1, 15).

    With c the body's forward axis, :math:`\delta\psi = [-c_E c_U/d,\ -c_N c_U/d,\ 1]\,\varphi`,
    :math:`d = c_E^2 + c_N^2`.
    """
    east, north, up = attitude[..., 0, 0], attitude[..., 1, 0], attitude[..., 2, 0]
    d = east**2 + north**2
    row = np.zeros((*attitude.shape[:-2], 1, STATES))
    row[..., 0, 6], row[..., 0, 7], row[..., 0, 8] = -east * up / d, -north * up / d, 1.0
    return row


def lateral_row(attitude: Array, velocity: Array) -> Array:
    r"""Return the row of the lateral velocity (P3 (18)), (..., 1, 15).

    With r the second row of :math:`C_n^b`,
    :math:`\delta v_y = r\,\delta v - r\,[v\times]\,\varphi`.

    Parameters
    ----------
    attitude : ndarray, (..., 3, 3)
        From the body's axes to east, north and up.
    velocity : ndarray, (..., 3)
        East, north and up, m/s.
    """
    r = attitude[..., None, :, 1]
    row = np.zeros((*attitude.shape[:-2], 1, STATES))
    row[..., VELOCITY] = r
    row[..., ATTITUDE] = -r @ skew(velocity)
    return row


def gps_rows() -> Array:
    """Return the rows of GPS position and velocity (P3 (20)), (6, 15)."""
    return np.eye(6, STATES)


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
