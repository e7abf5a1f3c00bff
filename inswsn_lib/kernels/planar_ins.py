"""The planar INS, integrated over many runs."""

from __future__ import annotations

import math

import numba
import numpy as np


@numba.njit(cache=True, error_model="numpy")
def planar_ins(start, pushed, turned, dt, accelerometer_noise, gyro_noise, normal, out):
    """Fill out with positions and velocities, (steps, 4, runs); see `simulation.ins`."""
    runs = normal.shape[2]
    heading = np.full(runs, start[4])
    for i in range(4):
        out[0, i] = start[i]
    for k in range(len(dt)):
        root = math.sqrt(dt[k])
        a, g = accelerometer_noise * root, gyro_noise * root
        for r in range(runs):
            turn = turned[k] + g * normal[k, 2, r]
            middle = heading[r] + turn / 2
            heading[r] += turn
            c, s = math.cos(middle), math.sin(middle)
            along, across = pushed[k, 0] + a * normal[k, 0, r], pushed[k, 1] + a * normal[k, 1, r]
            vx, vy = out[k, 2, r], out[k, 3, r]
            out[k + 1, 2, r] = vx + (c * along - s * across)
            out[k + 1, 3, r] = vy + (s * along + c * across)
            out[k + 1, 0, r] = out[k, 0, r] + dt[k] * (out[k + 1, 2, r] + vx) / 2
            out[k + 1, 1, r] = out[k, 1, r] + dt[k] * (out[k + 1, 3, r] + vy) / 2
    return out
