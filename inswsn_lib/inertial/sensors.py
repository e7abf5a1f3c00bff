r"""Sensors: each is one function from the state to what is expected, and its derivatives.

A function is written for one component of a measurement, in the part of Python that numba compiles:

.. code-block:: python

    def height(x, own, data, row):
        row[2] = row[15] = 1.0
        return x[2] + own[0]

`x` holds position (0 to 2), velocity (3 to 5), attitude row by row (6 to 14: it turns vectors of
the body into the frame) and the biases of accelerometers and gyroscopes (15 to 20), the position
being that of the lever arm; on a plane it is the same with zeros. `own` are the sensor's own
states, `data` what the component needs to know. What is returned is expected; the derivatives by
the errors are written into `row`, which is zero before: position (0 to 2), velocity, attitude as a
turn about axes of the body (6 to 8), biases, and from 15 on the own states. Without numba each
number is an array of runs, so that functions of `numpy` take the place of those of `math`.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from inswsn_lib.inertial.earth import ECCENTRICITY

_FLATTENED = ECCENTRICITY / (1 - ECCENTRICITY)


def position(x: Any, own: Any, data: Any, row: Any) -> Any:
    """Return the position along an axis, and its lasting error: `data` is the axis, own state."""
    row[0], row[1], row[2] = data[0], data[1], data[2]
    found = data[0] * x[0] + data[1] * x[1] + data[2] * x[2]
    if data[3] >= 0:
        row[15 + int(data[3])] = 1.0
        found = found + own[int(data[3])]
    return found


def velocity(x: Any, own: Any, data: Any, row: Any) -> Any:
    """Return the velocity along an axis of the frame, `data[:3]`, of an antenna.

    `data[3:6]` is what the gyroscopes said times the lever arm, and `data[6:]` that, which their
    biases turn as well; both along axes of the body.
    """
    row[3], row[4], row[5] = data[0], data[1], data[2]
    a = data[0] * x[6] + data[1] * x[9] + data[2] * x[12]
    b = data[0] * x[7] + data[1] * x[10] + data[2] * x[13]
    c = data[0] * x[8] + data[1] * x[11] + data[2] * x[14]
    u = data[3] + data[7] * x[20] - data[8] * x[19]
    v = data[4] + data[8] * x[18] - data[6] * x[20]
    w = data[5] + data[6] * x[19] - data[7] * x[18]
    row[6], row[7], row[8] = v * c - w * b, w * a - u * c, u * b - v * a
    row[12] = b * data[8] - c * data[7]
    row[13] = c * data[6] - a * data[8]
    row[14] = a * data[7] - b * data[6]
    return data[0] * x[3] + data[1] * x[4] + data[2] * x[5] + a * u + b * v + c * w


def distance(x: Any, own: Any, data: Any, row: Any) -> Any:
    """Return the distance from an anchor, `data[:3]`.

    The other data are own states, or -1: the scale, and two that are added.
    """
    a, b, c = x[0] - data[0], x[1] - data[1], x[2] - data[2]
    away = np.sqrt(a * a + b * b + c * c)
    factor = 1.0 + 0.0 * away
    if data[3] >= 0:
        factor = 1.0 + own[int(data[3])]
        row[15 + int(data[3])] = away
    row[0], row[1], row[2] = a / away * factor, b / away * factor, c / away * factor
    found = away * factor
    for k in range(4, 6):
        if data[k] >= 0:
            row[15 + int(data[k])] = 1.0
            found = found + own[int(data[k])]
    return found


def body_velocity(x: Any, own: Any, data: Any, row: Any) -> Any:
    """Return the velocity along an axis a of the body.

    Where `data` says -1 for the axis of motion b, none; else the vehicle's axes are turned from the
    body's by the own state `data[6]`, a small angle m, so that the axis is a - m b.
    """
    turned = 0.0 * x[0]
    if data[6] >= 0:
        turned = turned + own[int(data[6])]
    found = 0.0 * x[0]
    for i in range(3):
        j, k = (i + 1) % 3, (i + 2) % 3
        axis = data[i] - turned * data[3 + i]
        one, two = data[j] - turned * data[3 + j], data[k] - turned * data[3 + k]
        along = x[6 + i] * x[3] + x[9 + i] * x[4] + x[12 + i] * x[5]
        found = found + axis * along
        for c in range(3):
            row[3 + c] += x[6 + 3 * c + i] * axis
            # the cross product of the axis and the velocity in the body
            row[6 + i] += (one * x[6 + 3 * c + k] - two * x[6 + 3 * c + j]) * x[3 + c]
        if data[6] >= 0:
            row[15 + int(data[6])] -= data[3 + i] * along
    return found


def heading(x: Any, own: Any, data: Any, row: Any) -> Any:
    r"""Return the heading of an axis of the body, `data[:3]`, from east to the left, rad.

    `data[3:7]` are the numbers of an `Earth`, or zeros for a flat one; the others are two own
    states that are added, or -1. East is across the polar axis and the way from the centre, and up
    the normal of the ellipsoid; by how much both turn with the place is left out of the row, 1.6e-7
    rad for a metre.
    """
    fx = x[6] * data[0] + x[7] * data[1] + x[8] * data[2]
    fy = x[9] * data[0] + x[10] * data[1] + x[11] * data[2]
    fz = x[12] * data[0] + x[13] * data[1] + x[14] * data[2]
    # the polar axis, and the way from the centre of the Earth: a flat one's is below without end
    ky, kz, rx, ry, rz = 1.0, 0.0, 0.0 * x[0], 0.0 * x[1], 1.0 + 0.0 * x[2]
    if data[6] > 0:
        ky, kz = data[3], data[4]
        rx, ry, rz = x[0], x[1] + data[5], x[2] + data[6]
        along = _FLATTENED * (ky * ry + kz * rz)
        ex, ey, ez = ky * rz - kz * ry, kz * rx, -ky * rx
        ry, rz = ry + along * ky, rz + along * kz
    else:
        ex, ey, ez = 1.0 + 0.0 * x[0], 0.0 * x[0], 0.0 * x[0]
    size = np.sqrt(rx * rx + ry * ry + rz * rz)
    rx, ry, rz = rx / size, ry / size, rz / size
    size = np.sqrt(ex * ex + ey * ey + ez * ez)
    ex, ey, ez = ex / size, ey / size, ez / size
    nx, ny, nz = ry * ez - rz * ey, rz * ex - rx * ez, rx * ey - ry * ex
    east = fx * ex + fy * ey + fz * ez
    north = fx * nx + fy * ny + fz * nz
    up = fx * rx + fy * ry + fz * rz
    level = east * east + north * north
    # the derivative by a turn about axes of the frame
    gx = rx - up * (east * ex + north * nx) / level
    gy = ry - up * (east * ey + north * ny) / level
    gz = rz - up * (east * ez + north * nz) / level
    for i in range(3):
        row[6 + i] = x[6 + i] * gx + x[9 + i] * gy + x[12 + i] * gz
    found = np.arctan2(north, east)
    for k in range(7, 9):
        if data[k] >= 0:
            row[15 + int(data[k])] = 1.0
            found = found + own[int(data[k])]
    return found
