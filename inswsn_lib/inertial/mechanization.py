r"""Strapdown mechanization in a level frame, fixed to a turning `Earth` or to a flat one at rest.

Flat, the turn of the Earth, 7e-5 rad/s, is taken up by the biases of the gyroscopes; for the
minutes and metres of a tag in a room it is below their noise.

The errors are those of Sola, "Quaternion kinematics for the error-state Kalman filter" (2017),
section 5: the true attitude is :math:`R \exp([\theta]_\times)`, a turn about axes of the body,

.. math::
    \dot{\delta p} = \delta v, \qquad
    \dot{\delta v} = -R [f]_\times \theta - R\, \delta b_a - R\, w_a, \qquad
    \dot\theta = -[\omega]_\times \theta - \delta b_g - w_g .
"""

from __future__ import annotations

import math

import numpy as np

from inswsn_lib.checks import Array
from inswsn_lib.inertial.earth import AXIS, RATE, over
from inswsn_lib.streams import Whole

#: Standard gravity, m/s^2; what is missing to that of the place is in the accelerometers' biases
GRAVITY = 9.80665
#: States of the error: position, velocity, attitude, biases of accelerometers and gyroscopes
ERRORS = 15


def cut(time: Array, begin: float, events: Array) -> tuple[Array, Whole, Whole]:
    """Return the lengths of pieces from a time to the last of some events, which lie at their ends.

    With them are told the row of the samples' interval in which each lies, and how many lie before
    each event.
    """
    inside = time[slice(*np.searchsorted(time, [begin, events[-1]], side="right"))]
    inside = inside[inside < events[-1]]
    edges = np.union1d(inside, np.append(events, begin))
    # the first and the last interval go on beyond their ends
    of = np.clip(np.searchsorted(time, edges[:-1], side="right"), 1, len(time) - 1)
    return np.diff(edges), of, np.searchsorted(edges, events)


def turned(angle: Array) -> Array:
    """Return rotation matrices, (..., 3, 3), of rotation vectors (..., 3), rad, by Rodrigues."""
    x, y, z = np.moveaxis(np.asarray(angle, dtype=float), -1, 0)
    square = x * x + y * y + z * z
    size = np.sqrt(square)
    small = size < 1e-4
    safe = np.where(small, 1.0, size)
    a = np.where(small, 1 - square / 6, np.sin(safe) / safe)
    b = np.where(small, 0.5 - square / 24, (1 - np.cos(safe)) / safe**2)
    found = np.empty((*square.shape, 3, 3))
    found[..., 0, 0] = 1 - b * (y * y + z * z)
    found[..., 1, 1] = 1 - b * (x * x + z * z)
    found[..., 2, 2] = 1 - b * (x * x + y * y)
    for i, j, product, sine in ((0, 1, x * y, z), (1, 2, y * z, x), (2, 0, x * z, y)):
        found[..., i, j], found[..., j, i] = b * product - a * sine, b * product + a * sine
    return found


def rotation_vector(turn: Array) -> Array:
    """Return the rotation vector (3,), rad, of a rotation matrix: the inverse of `turned`.

    By its quaternion, of which the largest part comes first (Shepperd, J. Guidance and Control
    1(3), 1978): a single matrix is done thirty times as fast as by `Rotation` of SciPy.
    """
    R = turn.tolist()
    trace = R[0][0] + R[1][1] + R[2][2]
    i = max(range(3), key=lambda axis: R[axis][axis])
    j, k = (i + 1) % 3, (i + 2) % 3
    if trace > R[i][i]:
        vector = [R[2][1] - R[1][2], R[0][2] - R[2][0], R[1][0] - R[0][1]]
        scalar = 1.0 + trace
    else:
        vector = [0.0, 0.0, 0.0]
        vector[i] = 1.0 - trace + 2 * R[i][i]
        vector[j], vector[k] = R[j][i] + R[i][j], R[k][i] + R[i][k]
        scalar = R[k][j] - R[j][k]
    sine = math.hypot(*vector)
    angle = 2 * math.atan2(math.copysign(sine, scalar), abs(scalar))
    return np.array(vector) * (angle / sine if sine else 0.0)


def skew(vector: Array) -> Array:
    """Return the matrices (..., 3, 3) of the cross product with vectors (..., 3) from the left."""
    x, y, z = np.moveaxis(vector, -1, 0)
    zero = np.zeros_like(x)
    rows = [[zero, -z, y], [z, zero, -x], [-y, x, zero]]
    return np.moveaxis(np.array(rows), (0, 1), (-2, -1))


def advance(
    x: Array, pieces: tuple[Array, Array, Array], increments: bool, densities: Array, earth: Array
) -> tuple[Array, Array, Array]:
    """Integrate states over some pieces; return them, the transition, and half of the noise.

    Sums over the samples are those of `kernels.error_state`, which explains them. `pieces` are
    lengths, rates and forces, (runs, pieces, 3) each; where they are `increments`, integrals over a
    piece, the force in axes of the body at its beginning.
    """
    T, rates, forces = pieces
    T, long = T[:, None], float(T.sum())
    force_bias, rate_bias = x[:, None, 15:18], x[:, None, 18:21]
    if increments:
        turns, pushes = rates - rate_bias * T, forces - force_bias * T
    else:
        turns = (rates - rate_bias) * T
        pushes = (turned(0.5 * turns) @ ((forces - force_bias) * T)[..., None])[..., 0]
    R, steps = [x[:, 6:15].reshape(-1, 3, 3)], turned(turns)
    for k in range(len(T)):
        R.append(R[-1] @ steps[:, k])
    begun, ended = np.stack(R[:-1], axis=1), np.stack(R[1:], axis=1)
    wide = T[:, :, None]
    dv, dA = (begun @ pushes[..., None])[..., 0], 0.5 * wide * (begun + ended)
    A = np.cumsum(dA, axis=1) - 0.5 * dA
    dB = skew(dv) @ A
    V, B = dv.sum(axis=1), dB.sum(axis=1)
    S = (T * (np.cumsum(dv, axis=1) - 0.5 * dv)).sum(axis=1)
    AA, BB = (wide * A).sum(axis=1), (wide * (np.cumsum(dB, axis=1) - 0.5 * dB)).sum(axis=1)
    A, Rt = dA.sum(axis=1), np.swapaxes(R[-1], 1, 2)
    Phi = _transition(x, long, Rt, V, S, A, AA, B, BB, earth)
    half = np.diag(0.5 * long * np.repeat([0.0, *np.square(densities)], 3))
    return _moved(x, long, R[-1], V, S, earth), Phi, half


def _moved(x: Array, T: float, R: Array, V: Array, S: Array, earth: Array) -> Array:
    """Return the states after a step."""
    rate = _rate(earth)
    pull = gravity(x[:, :3] + 0.5 * T * x[:, 3:6], earth)
    way = T * x[:, 3:6] + S + 0.5 * T**2 * pull
    # Coriolis, and what turns the force while the frame turns: the integral of t R f is T V - S
    turning = np.cross(rate, T * V - S)
    pull = pull - (2 * np.cross(rate, way) + turning) / T
    moved = x.copy()
    # what turns grows with the square of the time, of which a third is the mean, not a half
    moved[:, :3] += T * x[:, 3:6] + S + 0.5 * T**2 * pull + T / 6 * turning
    moved[:, 3:6] += V + T * pull
    moved[:, 6:15] = (turned(-T * rate) @ R).reshape(-1, 9)
    return moved


def _transition(
    x: Array, T: float, Rt: Array, V: Array, S: Array, A: Array, AA: Array, B: Array, BB: Array,
    earth: Array,
) -> Array:  # fmt: skip
    R0, Phi = x[:, 6:15].reshape(-1, 3, 3), np.tile(np.eye(ERRORS), (len(x), 1, 1))
    Phi[:, 0:3, 3:6] += T * np.eye(3)
    Phi[:, 0:3, 6:9], Phi[:, 3:6, 6:9] = -skew(S) @ R0, -skew(V) @ R0
    Phi[:, 0:3, 9:12], Phi[:, 3:6, 9:12] = -AA, -A
    Phi[:, 0:3, 12:15], Phi[:, 3:6, 12:15] = BB, B
    Phi[:, 6:9, 6:9], Phi[:, 6:9, 12:15] = Rt @ R0, -Rt @ A
    if earth[3]:
        pull = gravity(x[:, :3] + 0.5 * T * x[:, 3:6], earth)
        size = T * np.linalg.norm(pull, axis=1)[:, None, None] / AXIS
        Phi[:, 3:6, 3:6] -= 2 * T * skew(_rate(earth))
        Phi[:, 3:6, 0:3] += size * np.diag([-1.0, -1.0, 2.0])
    return Phi


def _rate(earth: Array) -> Array:
    return np.array([0.0, RATE * earth[0], RATE * earth[1]])


def gravity(place: Array, earth: Array) -> Array:
    """Return gravity at places in a frame, (..., 3), by the numbers of an `Earth` or four zeros."""
    if not earth[3]:
        return np.array([0.0, 0.0, -GRAVITY]) + np.zeros_like(place)
    return over(place, earth)[0].gravity


def reckon(
    x: Array, pieces: tuple[Array, Array, Array], densities: Array
) -> tuple[Array, Array, Array]:
    """Go along a piece on the plane; return states, transition and covariance."""
    lengths, rates, _ = pieces
    T, speed, rate = float(lengths[0]), rates[:, 0, 0], rates[:, 0, 1]
    way, turn = T * speed * (1 + x[:, 3]), T * (rate - x[:, 4])
    c, s = np.cos(x[:, 2] + turn / 2), np.sin(x[:, 2] + turn / 2)
    F, G = np.tile(np.eye(5), (len(x), 1, 1)), np.zeros((len(x), 5, 4))
    F[:, 0, 2], F[:, 1, 2], F[:, 0, 3], F[:, 1, 3] = -way * s, way * c, T * speed * c, T * speed * s
    F[:, 0, 4], F[:, 1, 4], F[:, 2, 4] = way * T / 2 * s, -way * T / 2 * c, -T
    G[:, 0, 0], G[:, 1, 0], G[:, 2, 1] = T * c, T * s, T
    G[:, 0, 1], G[:, 1, 1] = -way * T / 2 * s, way * T / 2 * c
    G[:, 3, 2] = G[:, 4, 3] = T
    moved = x.copy()
    moved[:, 0], moved[:, 1] = x[:, 0] + way * c, x[:, 1] + way * s
    moved[:, 2], moved[:, 5] = x[:, 2] + turn, speed
    # densities are squared over the length of the piece
    return moved, F, (G * np.square(densities) / T) @ np.swapaxes(G, 1, 2)
