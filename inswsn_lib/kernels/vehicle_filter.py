"""The epochs of the vehicle's filter, run after run.

The errors of position, velocity and attitude are nine states, which biases and drifts drive; those
are driven by noise alone, and the density S of all noise is diagonal, since a rotation leaves white
noise as it is. So a step T is, with F by blocks,

    F = [A B; 0 0],  M = T + A T^2/2 + A^2 T^3/6,  Phi = [I + M A, M B; 0, I],
    P <- Phi (P + S T/2) Phi' + S T/2.

Vectors are tuples of three numbers, east, north, up, and rotations of nine, row by row: so they
stay in registers. The error is kept as the last column of P, since what carries and corrects the
one does so with the other.
"""

from __future__ import annotations

import math
from typing import Any

import numba
import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Integers = NDArray[np.intp]
Mask = NDArray[np.bool_]
Vector = tuple[float, float, float]
Turn = tuple[float, float, float, float, float, float, float, float, float]

# WGS84: rotation (rad/s), semi-major axis (m), squared eccentricity, gravity at the equator and by
# how much it grows to the pole (m/s^2)
_RATE, _A, _E2, _GRAVITY = 7.292115e-5, 6378137.0, 6.6943799901413e-3, 9.7803253359
_GROWTH = math.sqrt(1 - _E2) * 9.8321849378 / _GRAVITY - 1
_DRIVEN, _STATES = 9, 15


@numba.njit(cache=True, fastmath={"contract"})
def _cross(a: Vector, b: Vector) -> Vector:
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


@numba.njit(cache=True, fastmath={"contract"})
def _turned(C: Turn, a: Vector) -> Vector:
    return (
        C[0] * a[0] + C[1] * a[1] + C[2] * a[2],
        C[3] * a[0] + C[4] * a[1] + C[5] * a[2],
        C[6] * a[0] + C[7] * a[1] + C[8] * a[2],
    )


@numba.njit(cache=True, fastmath={"contract"})
def _product(a: Turn, b: Turn) -> Turn:
    return (
        a[0] * b[0] + a[1] * b[3] + a[2] * b[6],
        a[0] * b[1] + a[1] * b[4] + a[2] * b[7],
        a[0] * b[2] + a[1] * b[5] + a[2] * b[8],
        a[3] * b[0] + a[4] * b[3] + a[5] * b[6],
        a[3] * b[1] + a[4] * b[4] + a[5] * b[7],
        a[3] * b[2] + a[4] * b[5] + a[5] * b[8],
        a[6] * b[0] + a[7] * b[3] + a[8] * b[6],
        a[6] * b[1] + a[7] * b[4] + a[8] * b[7],
        a[6] * b[2] + a[7] * b[5] + a[8] * b[8],
    )


@numba.njit(cache=True, fastmath={"contract"})
def _rotation(a: Vector) -> Turn:
    """Return the rotation by a vector (rad)."""
    square = a[0] * a[0] + a[1] * a[1] + a[2] * a[2]
    if square > 1e-6:
        angle = math.sqrt(square)
        cosine = math.cos(angle)
        k1, k2 = math.sin(angle) / angle, (1 - cosine) / square
    else:
        fourth = square * square
        cosine = 1 - square / 2 + fourth / 24
        k1, k2 = 1 - square / 6 + fourth / 120, 0.5 - square / 24 + fourth / 720
    x, y, z = k2 * a[0], k2 * a[1], k2 * a[2]
    return (
        x * a[0] + cosine, x * a[1] - k1 * a[2], x * a[2] + k1 * a[1],
        y * a[0] + k1 * a[2], y * a[1] + cosine, y * a[2] - k1 * a[0],
        z * a[0] - k1 * a[1], z * a[1] + k1 * a[0], z * a[2] + cosine,
    )  # fmt: skip


@numba.njit(cache=True, fastmath={"contract"})
def _earth(latitude: float, height: float) -> tuple[float, float, float, float, float]:
    """Return the radii of curvature with the height, sine and cosine, and gravity at height 0."""
    sine = math.sin(latitude)
    square = sine * sine
    root = 1 / math.sqrt(1 - _E2 * square)
    transverse, gravity = _A * root, _GRAVITY * (1 + _GROWTH * square) * root
    meridian = transverse * (1 - _E2) * root * root
    return meridian + height, transverse + height, sine, math.sqrt(1 - square), gravity


@numba.njit(cache=True, fastmath={"contract"})
def _flown(
    place: Vector, v: Vector, C: Turn, turn: Vector, push: Vector, dt: float
) -> tuple[Vector, Vector, Turn]:
    """Integrate one sample as `pyins` does; the place is in rad, rad, m."""
    meridian, transverse, sine, cosine, gravity = _earth(place[0], place[2])
    per_meridian, per_transverse, per_cosine = 1 / meridian, 1 / transverse, 1 / cosine
    earth_n, earth_u = _RATE * cosine, _RATE * sine
    tangent = sine * per_cosine
    e, n = v[0] * per_transverse, v[1] * per_meridian
    pushed = _turned(C, push)
    coriolis = _cross((-n, 2 * earth_n + e, 2 * earth_u + e * tangent), v)
    leaning = _cross((-n, earth_n + e, earth_u + e * tangent), pushed)
    weight = gravity * (1 - 2 * (place[2] + 0.5 * v[2] * dt) / _A)
    new = (
        v[0] + pushed[0] - (coriolis[0] + 0.5 * leaning[0]) * dt,
        v[1] + pushed[1] - (coriolis[1] + 0.5 * leaning[1]) * dt,
        v[2] + pushed[2] - (coriolis[2] + 0.5 * leaning[2] + weight) * dt,
    )
    e, n = 0.5 * dt * (v[0] + new[0]) * per_transverse, 0.5 * dt * (v[1] + new[1]) * per_meridian
    place = place[0] + n, place[1] + e * per_cosine, place[2] + 0.5 * dt * (v[2] + new[2])
    frame = _rotation((n, -earth_n * dt - e, -earth_u * dt - e * tangent))
    return place, new, _product(frame, _product(C, _rotation(turn)))


@numba.njit(cache=True, fastmath={"contract"})
def _fill_dynamics(A: Array, place: Vector, v: Vector, C: Turn, change: Vector) -> None:
    """Fill the driven rows of `error_dynamics`, at a place and a velocity that changes."""
    meridian, transverse, sine, cosine, gravity = _earth(place[0], place[2])
    east, north, up = v
    tangent = sine / cosine
    earth_n, earth_u = _RATE * cosine, _RATE * sine
    e, n = east / transverse, north / meridian
    u = e * tangent
    # what height, and latitude, do to the rates
    e_h, n_h, u_h = n / meridian, -e / transverse, -u / transverse
    u_l = e / cosine**2
    w = -n, 2 * earth_n + e, 2 * earth_u + u
    f = _cross(w, v)
    f_e, f_n = change[0] + f[0], change[1] + f[1]
    f_u = change[2] + f[2] + gravity * (1 - 2 * place[2] / _A)

    A[0, 2], A[0, 4] = -e_h, 1 / meridian
    A[1, 0], A[1, 2], A[1, 3] = u / cosine, n_h / cosine, 1 / (transverse * cosine)
    A[2, 5] = 1.0

    A[3, 0], A[3, 2] = 2 * up * earth_u + north * (2 * earth_n + u_l), north * u_h - up * n_h
    A[4, 0], A[4, 2] = -east * (2 * earth_n + u_l), up * e_h - east * u_h
    A[5, 0], A[5, 2] = -2 * east * earth_u, east * n_h - north * e_h + 2 * gravity / _A
    A[3, 3], A[3, 4], A[3, 5] = north * tangent / transverse - up / transverse, w[2], -w[1]
    A[4, 3], A[4, 4], A[4, 5] = -u - w[2], -up / meridian, w[0]
    A[5, 3], A[5, 4] = e + w[1], n - w[0]
    A[3, 7], A[3, 8], A[4, 6], A[4, 8], A[5, 6], A[5, 7] = -f_u, f_n, f_u, -f_e, -f_n, f_e

    A[6, 2], A[6, 4] = e_h, -1 / meridian
    A[7, 0], A[7, 2], A[7, 3] = -earth_u, n_h, 1 / transverse
    A[8, 0], A[8, 2], A[8, 3] = earth_n + u_l, u_h, tangent / transverse
    A[6, 7], A[6, 8], A[7, 6] = earth_u + u, -earth_n - e, -earth_u - u
    A[7, 8], A[8, 6], A[8, 7] = -n, earth_n + e, n
    for i in range(3):
        for j in range(3):
            A[3 + i, 9 + j], A[6 + i, 12 + j] = C[3 * i + j], -C[3 * i + j]


@numba.njit(cache=True, fastmath={"contract"})
def _carry(
    F: Array, T: float, density: Array, gps: int, decay: float, P: Array, M: Array, moved: Array,
    W: Array,
) -> None:  # fmt: skip
    """Carry covariance and error over a step."""
    n = len(P)
    for i in range(_DRIVEN):
        for j in range(_DRIVEN):
            M[i, j] = F[i, j] * T * T / 2
        M[i, i] += T
        for k in range(_DRIVEN):
            share = F[i, k] * T * T * T / 6
            for j in range(_DRIVEN):
                M[i, j] += share * F[k, j]
    for i in range(n):
        P[i, i] += density[i] * T / 2
    # what moves the driven states, Phi - I = M [A B], and Phi P, row by row
    for i in range(_DRIVEN):
        for j in range(n + 1):
            W[i, j] = P[i, j]
        for k in range(_STATES):
            share = 0.0
            for j in range(_DRIVEN):
                share += M[i, j] * F[j, k]
            moved[i, k] = share
            for j in range(n + 1):
                W[i, j] += share * P[k, j]
    for i in range(_DRIVEN):
        for j in range(i + 1):
            total = W[i, j]
            for k in range(_STATES):
                total += W[i, k] * moved[j, k]
            P[i, j] = total
            P[j, i] = total
        for j in range(_DRIVEN, n):
            P[i, j] = W[i, j]
            P[j, i] = W[i, j]
        P[i, n] = W[i, n]
    if gps >= 0:
        z = T * decay
        kept = 1 - z + z**2 / 2 - z**3 / 6
        for i in range(gps, gps + 2):
            for j in range(n + 1):
                P[i, j] *= kept
            for j in range(n):
                P[j, i] *= kept
    for i in range(n):
        P[i, i] += density[i] * T / 2


@numba.njit(cache=True, fastmath={"contract"})
def _measure(
    place: Vector, v: Vector, C: Turn, told: Array, noise: tuple[float, ...],
    columns: tuple[int, ...], z: Array, H: Array, R: Array,
) -> None:  # fmt: skip
    """Fill INS less sensor, rows and variances of the eight measurements, as `measure` does."""
    compass, mounting, gps = columns
    meridian, transverse, _, cosine, _ = _earth(place[0], place[2])
    size = meridian, transverse * cosine, 1.0
    forward, right = (C[0], C[3], C[6]), (C[1], C[4], C[7])
    angle = math.atan2(forward[0], forward[1]) - told[0]
    z[0] = math.pi - (math.pi - angle) % (2 * math.pi)
    if z[0] <= -math.pi:  # the remainder of a number just below zero is the whole turn
        z[0] = math.pi
    z[1] = right[0] * v[0] + right[1] * v[1] + right[2] * v[2]
    level = forward[0] ** 2 + forward[1] ** 2
    H[0, 6], H[0, 7] = -forward[0] * forward[2] / level, -forward[1] * forward[2] / level
    H[0, 8] = 1.0
    lever = _cross(v, right)
    R[0], R[1] = noise[0] ** 2, noise[1] ** 2
    for i in range(3):
        H[1, 3 + i], H[1, 6 + i] = right[i], lever[i]
        z[2 + i], z[5 + i] = place[i] - told[1 + i], v[i] - told[4 + i]
        R[2 + i], R[5 + i] = (noise[2] / size[i]) ** 2, noise[3] ** 2
        H[2 + i, i], H[5 + i, 3 + i] = 1.0, 1.0
    if compass >= 0:
        H[0, compass] = -1.0
    if mounting >= 0:
        H[0, mounting] = -1.0
        H[1, mounting] = forward[0] * v[0] + forward[1] * v[1] + forward[2] * v[2]
    if gps >= 0:
        H[3, gps], H[2, gps + 1] = -1 / size[1], -1 / size[0]


@numba.njit(cache=True, fastmath={"contract"})
def _update(
    first: int, last: int, heard: bool, gate: float, z: Array, H: Array, R: Array, P: Array,
    innovation: Array, S: Array, HP: Array, K: Array, L: Array,
) -> None:  # fmt: skip
    """Update with a group of measurements in Joseph's form; one that is not used has no effect."""
    n = len(P)
    for r in range(first, last):
        for i in range(n + 1):
            HP[r, i] = 0.0
        for k in range(n):
            h = H[r, k]
            if h != 0.0:
                for i in range(n + 1):
                    HP[r, i] += h * P[k, i]
        HP[r, n] -= z[r]  # the innovation with the other sign, like HP to be taken off with K
    for r in range(first, last):
        for s in range(first, last):
            S[r, s] = 0.0
            for k in range(n):
                S[r, s] += HP[r, k] * H[s, k]
        S[r, r] += R[r]
        used = heard and not math.isnan(z[r])
        if r == 0:
            used = used and HP[0, n] ** 2 <= gate**2 * S[0, 0]
        innovation[r] = -HP[r, n] if used else math.nan
    # a row of K for each measurement, by Cholesky: that of one that is not used is zero
    for r in range(first, last):
        used = not math.isnan(innovation[r])
        for i in range(n):
            K[r, i] = HP[r, i] if used else 0.0
        for s in range(first, r + 1):
            both = S[r, s] if used and not math.isnan(innovation[s]) else 0.0
            for k in range(first, s):
                both -= L[r, k] * L[s, k]
            if s < r:
                L[r, s] = both / L[s, s]
                for i in range(n):
                    K[r, i] -= L[r, s] * K[s, i]
            else:
                L[r, r] = math.sqrt(both) if used else 1.0
        for i in range(n):
            K[r, i] /= L[r, r]
    for r in range(last - 1, first - 1, -1):
        for k in range(r + 1, last):
            for i in range(n):
                K[r, i] -= L[k, r] * K[k, i]
        for i in range(n):
            K[r, i] /= L[r, r]
    # (I - K H) P, and that times (I - K H)' with K R K'
    for r in range(first, last):
        if not math.isnan(innovation[r]):
            for i in range(n):
                for j in range(n + 1):
                    P[i, j] -= K[r, i] * HP[r, j]
    for r in range(first, last):
        if not math.isnan(innovation[r]):
            for i in range(n):
                HP[r, i] = -R[r] * K[r, i]
            for k in range(n):
                h = H[r, k]
                if h != 0.0:
                    for i in range(n):
                        HP[r, i] += h * P[i, k]
    for r in range(first, last):
        if not math.isnan(innovation[r]):
            for i in range(n):
                for j in range(n):
                    P[i, j] -= HP[r, i] * K[r, j]


@numba.njit(cache=True, fastmath={"contract"})
def vehicle_filter(
    start: tuple[Array, ...], turns: Array, pushes: Array, period: float, edges: Integers,
    told: Array, which: Integers, begin: Integers, heard: Mask, sensed: Mask,
    numbers: tuple[float, ...], columns: tuple[int, ...], feedback: bool,
) -> Any:  # fmt: skip
    """Do what the plain form in `inswsn_lib.vehicle.filter` does, which has the same terms."""
    position, velocity, attitude, bias, drift, error, covariance = start
    runs, epochs, n = len(which), len(heard), error.shape[1]
    positions, velocities = np.empty((epochs, runs, 3)), np.empty((epochs, runs, 3))
    attitudes = np.empty((epochs, runs, 3, 3))
    biases, drifts = np.empty((epochs, runs, 3)), np.empty((epochs, runs, 3))
    errors, covariances = np.empty((epochs, runs, n)), np.empty((epochs, runs, n, n))
    firsts = np.empty((epochs, runs, 3))
    innovations, spreads = np.empty((epochs, runs, 8)), np.zeros((epochs, runs, 8, 8))
    noise, gate, gps_error, gps_time = numbers[10:14], numbers[14], numbers[17], numbers[18]
    gps, decay = columns[2], 1 / gps_time
    density = np.zeros(n)
    for i in range(3):
        for j in range(4):
            density[3 + 3 * j + i] = numbers[j] ** 2
    if gps >= 0:
        density[gps] = density[gps + 1] = 2 * gps_error**2 / gps_time
    F, M = np.zeros((_DRIVEN, _STATES)), np.empty((_DRIVEN, _DRIVEN))
    moved, W = np.empty((_DRIVEN, _STATES)), np.empty((_DRIVEN, n + 1))
    P, z, H, R = np.empty((n, n + 1)), np.empty(8), np.zeros((8, n)), np.empty(8)
    HP, K, L = np.empty((8, n + 1)), np.empty((8, n)), np.empty((8, 8))
    for r in range(runs):
        place = position[r, 0], position[r, 1], position[r, 2]
        v = velocity[r, 0], velocity[r, 1], velocity[r, 2]
        c = attitude[r]
        C = c[0, 0], c[0, 1], c[0, 2], c[1, 0], c[1, 1], c[1, 2], c[2, 0], c[2, 1], c[2, 2]
        b, g = (bias[r, 0], bias[r, 1], bias[r, 2]), (drift[r, 0], drift[r, 1], drift[r, 2])
        for i in range(n):
            P[i, n] = error[r, i]
            for j in range(n):
                P[i, j] = covariance[r, i, j]
        for i in range(3):
            firsts[0, r, i] = place[i] - P[i, n]
        for i in range(8):
            innovations[0, r, i] = math.nan
        for e in range(epochs):
            if e > 0:
                at = begin[r] + e
                for j in range(len(edges) - 1):
                    first, last = edges[j], edges[j + 1]
                    T = (last - first) * period
                    before, there, flying, axes = v, place, v, C
                    for k in range(first, last):
                        if k == (first + last) // 2:
                            there, flying, axes = place, v, C
                        t, p = turns[which[r], at - 1, k], pushes[which[r], at - 1, k]
                        turn = t[0] - g[0] * period, t[1] - g[1] * period, t[2] - g[2] * period
                        push = p[0] - b[0] * period, p[1] - b[1] * period, p[2] - b[2] * period
                        place, v, C = _flown(place, v, C, turn, push, period)
                    change = (v[0] - before[0]) / T, (v[1] - before[1]) / T, (v[2] - before[2]) / T
                    _fill_dynamics(F, there, flying, axes, change)
                    _carry(F, T, density, gps, decay, P, M, moved, W)
                for i in range(n):
                    for j in range(i):
                        P[i, j] = P[j, i] = 0.5 * (P[i, j] + P[j, i])
                _measure(place, v, C, told[at, which[r]], noise, columns, z, H, R)
                for group in range(2):
                    if group == 1:
                        for i in range(3):
                            firsts[e, r, i] = place[i] - P[i, n]
                    _update(
                        2 * group, 2 + 6 * group, heard[e] if group else sensed[e], gate, z, H, R,
                        P, innovations[e, r], spreads[e, r], HP, K, L,
                    )  # fmt: skip
            if feedback and e > 0:
                place = place[0] - P[0, n], place[1] - P[1, n], place[2] - P[2, n]
                v = v[0] - P[3, n], v[1] - P[4, n], v[2] - P[5, n]
                C = _product(_rotation((P[6, n], P[7, n], P[8, n])), C)
                b = b[0] + P[9, n], b[1] + P[10, n], b[2] + P[11, n]
                g = g[0] + P[12, n], g[1] + P[13, n], g[2] + P[14, n]
                for i in range(_STATES):
                    P[i, n] = 0.0
            for i in range(3):
                positions[e, r, i], velocities[e, r, i] = place[i], v[i]
                biases[e, r, i], drifts[e, r, i] = b[i], g[i]
                for j in range(3):
                    attitudes[e, r, i, j] = C[3 * i + j]
            for i in range(n):
                errors[e, r, i] = P[i, n]
                for j in range(n):
                    covariances[e, r, i, j] = P[i, j]
    states = positions, velocities, attitudes, biases, drifts, errors, covariances
    return states, firsts, innovations, spreads
