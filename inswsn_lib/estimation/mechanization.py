r"""Strapdown mechanization in a level frame that does not turn, with the transition of its errors.

For the minutes and metres of a tag in a room, or of a car between satellite fixes, the turn of the
Earth is below the noise of the sensors that this room is for: 15 degrees an hour is 7e-5 rad/s, and
is taken up by the biases of the gyroscopes. `inswsn_lib.vehicle` has it.

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
from inswsn_lib.streams import Whole

#: Standard gravity, m/s^2; what is missing to that of the place is in the accelerometers' biases
GRAVITY = 9.80665
#: States of the error: position, velocity, attitude, biases of accelerometers and gyroscopes
ERRORS = 15


def cut(time: Array, rate: Array, force: Array, begin: float, events: Array) -> tuple[Array, Whole]:
    """Return pieces from a time to the last of some events, which lie at ends of pieces.

    A piece, (7,), is its length, s, and the means of rate and force at both ends of the interval of
    samples that it is of. With them is told how many lie before each event.
    """
    inside = time[(time > begin) & (time < events[-1])]
    edges = np.unique(np.concatenate([[begin], inside, events]))
    # the interval of samples in which a piece lies; the first and the last go on beyond their ends
    of = np.clip(np.searchsorted(time, edges[:-1], side="right"), 1, len(time) - 1)
    means = [0.5 * (values[of - 1] + values[of]) for values in (rate, force)]
    return np.column_stack([np.diff(edges), *means]), np.searchsorted(edges, events)


def turned(angle: Array) -> Array:
    """Return the rotation matrix of a rotation vector (3,), rad, by Rodrigues' formula."""
    size = np.sqrt((angle * angle).sum())
    cross = np.array(
        [[0.0, -angle[2], angle[1]], [angle[2], 0.0, -angle[0]], [-angle[1], angle[0], 0.0]]
    )
    if size < 1e-6:
        first, second = 1.0, 0.5
    else:
        first, second = np.sin(size) / size, (1 - np.cos(size)) / size**2
    found: Array = np.eye(3) + first * cross + second * cross @ cross
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


def advance(
    p: Array, v: Array, R: Array, accelerometer: Array, gyro: Array, pieces: Array, noise: Array
) -> tuple[Array, Array, Array, Array, Array]:  # fmt: skip
    """Integrate over pieces; return position, velocity, attitude, transition and covariance.

    `noise` has the densities of accelerometers and gyroscopes and of the walks of their biases.
    """
    down = np.array([0.0, 0.0, -GRAVITY])
    Phi, Q, F = np.eye(ERRORS), np.zeros((ERRORS, ERRORS)), np.eye(ERRORS)
    p, v, R = p.copy(), v.copy(), R.copy()
    for piece in pieces:
        T, f, turn = piece[0], piece[4:] - accelerometer, (piece[1:4] - gyro) * piece[0]
        middle = R @ turned(0.5 * turn)
        acceleration = middle @ f + down
        cross = np.array([[0.0, -f[2], f[1]], [f[2], 0.0, -f[0]], [-f[1], f[0], 0.0]])
        for i in range(3):
            F[i, 3 + i] = T
        # of the error of the attitude half a piece later
        tilted, half = -T * (middle @ cross), turned(0.5 * turn).T
        F[3:6, 6:9] = tilted @ half
        F[3:6, 9:12] = -T * middle
        F[3:6, 12:15] = -0.5 * T * tilted
        F[:3, 6:15] = 0.5 * T * F[3:6, 6:15]
        F[6:9, 6:9] = turned(turn).T
        F[6:9, 12:15] = -T * half
        Phi = F @ Phi
        Q = F @ Q @ F.T
        for i in range(3):
            Q[3 + i, 3 + i] += noise[0] ** 2 * T
            Q[6 + i, 6 + i] += noise[1] ** 2 * T
            Q[9 + i, 9 + i] += noise[2] ** 2 * T
            Q[12 + i, 12 + i] += noise[3] ** 2 * T
        p += T * v + 0.5 * T**2 * acceleration
        v += T * acceleration
        R = R @ turned(turn)
    return p, v, R, Phi, Q
