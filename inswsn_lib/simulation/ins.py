"""A two-dimensional inertial system: sensors with errors, and what integrates them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from inswsn_lib.checks import Array, array
from inswsn_lib.scenario import ANY, NOT_NEGATIVE, Pair, between
from inswsn_lib.simulation.trajectory import Motion

_AT_ONCE = 16  # runs; a dozen arrays of so many are held by a processor's cache


@dataclass(frozen=True)
class InertialErrors:
    """The errors of two accelerometers and a yaw gyro, and of what the INS starts from.

    Attributes
    ----------
    accelerometer_bias : tuple of two floats
        Along and across the vehicle (left positive), m/s^2.
    accelerometer_scale : tuple of two floats
        Scale factor errors, 1.
    accelerometer_noise : float
        Velocity random walk, m/s per sqrt(s).
    gyro_bias, gyro_scale : float
        rad/s; scale factor error, 1.
    gyro_noise : float
        Angle random walk, rad per sqrt(s).
    position, velocity : tuple of two floats
        Errors at the start in the frame of the scene, m and m/s.
    heading : float
        Error at the start, rad.

    Examples
    --------
    A bias b of the accelerometer along a straight path moves the INS by :math:`b t^2 / 2`:

    >>> from inswsn_lib.simulation import InertialErrors, Path, simulate_ins
    >>> motion = Path.through([(0, 0), (100, 0)], radius=1).drive(2.0, [0, 5, 10])
    >>> found = simulate_ins(motion, InertialErrors(accelerometer_bias=(0.1, 0.0)))
    >>> (found[:, 0, 0] - motion.position[:, 0]).round(6).tolist()
    [0.0, 1.25, 5.0]
    """

    accelerometer_bias: Pair = between(*ANY, (0.0, 0.0))
    accelerometer_scale: Pair = between(*ANY, (0.0, 0.0))
    accelerometer_noise: float = between(*NOT_NEGATIVE, 0.0)
    gyro_bias: float = between(*ANY, 0.0)
    gyro_scale: float = between(*ANY, 0.0)
    gyro_noise: float = between(*NOT_NEGATIVE, 0.0)
    position: Pair = between(*ANY, (0.0, 0.0))
    velocity: Pair = between(*ANY, (0.0, 0.0))
    heading: float = between(*ANY, 0.0)


def simulate_ins(motion: Motion, errors: InertialErrors, noise: ArrayLike | None = None) -> Array:
    r"""Integrate erroneous sensors along a motion, for any number of runs at once.

    .. math::
        \psi^+ = \psi + \Delta\psi, \quad
        v^+ = v + R\!\left(\tfrac{\psi + \psi^+}{2}\right) \Delta v, \quad
        p^+ = p + \tfrac12 (v + v^+) \Delta t

    Parameters
    ----------
    motion : Motion
        The truth, at the rate of the sensors.
    errors : InertialErrors
        Those that are constant are the same in every run.
    noise : array_like, (steps - 1, 3, runs), optional
        Standard normal numbers for the two accelerometers and the gyro. Default: one run without.

    Returns
    -------
    ndarray, (steps, 4, runs)
        x, y (m), v_x, v_y (m/s) by the INS alone.

    Examples
    --------
    Without errors it gives the truth, here along a straight way at 2 m/s:

    >>> from inswsn_lib.simulation import InertialErrors, Path, simulate_ins
    >>> motion = Path.through([(0, 0), (100, 0)], radius=1).drive(2.0, [0, 5, 10])
    >>> simulate_ins(motion, InertialErrors())[:, 0, 0].tolist()
    [0.0, 10.0, 20.0]
    """
    velocity, angle = _true_increments(motion)
    dt = np.diff(motion.time)[:, None]
    normal = np.zeros((len(dt), 3, 1))
    if noise is not None:
        normal = array("noise", noise, (len(dt), 3, "runs"))
    pushed = velocity * (1 + np.array(errors.accelerometer_scale))
    pushed += dt * np.array(errors.accelerometer_bias)
    turned = angle[:, None] * (1 + errors.gyro_scale) + dt * errors.gyro_bias
    position = motion.position[0] + np.array(errors.position)
    moving = motion.velocity[0] + np.array(errors.velocity)
    heading = motion.heading[0] + errors.heading
    pushes, turns = errors.accelerometer_noise * np.sqrt(dt), errors.gyro_noise * np.sqrt(dt)
    out = np.empty((len(dt) + 1, 4, normal.shape[2]))
    for first in range(0, normal.shape[2], _AT_ONCE):
        runs = slice(first, first + _AT_ONCE)
        turn = turned + turns * normal[:, 2, runs]
        middle = heading + np.cumsum(turn, axis=0) - turn / 2
        c, s = np.cos(middle), np.sin(middle)
        along, across = (pushed[:, [i]] + pushes * normal[:, i, runs] for i in range(2))
        out[0, :, runs] = np.append(position, moving)[:, None]
        for i, push in enumerate((c * along - s * across, s * along + c * across)):
            out[1:, 2 + i, runs] = moving[i] + np.cumsum(push, axis=0)
            mean = (out[1:, 2 + i, runs] + out[:-1, 2 + i, runs]) / 2
            out[1:, i, runs] = position[i] + np.cumsum(dt * mean, axis=0)
    return out


def _true_increments(motion: Motion) -> tuple[Array, Array]:
    """Return what ideal sensors integrate over each interval: velocity (steps, 2) and angle.

    The velocity is in the body frame at the middle heading: along and to the left.
    """
    change = np.diff(motion.velocity, axis=0)
    middle = (motion.heading[1:] + motion.heading[:-1]) / 2
    c, s = np.cos(middle), np.sin(middle)
    along = c * change[:, 0] + s * change[:, 1]
    across = -s * change[:, 0] + c * change[:, 1]
    return np.stack([along, across], axis=1), np.diff(motion.heading)


def inertial_errors(
    motion: Motion, errors: InertialErrors, rng: np.random.Generator, runs: int
) -> Array:
    """Return what the INS with drawn noise indicates less the truth, (steps, 4, runs)."""
    noise = rng.standard_normal((len(motion.time) - 1, 3, runs))
    found = simulate_ins(motion, errors, noise)
    found[:, :2] -= motion.position[:, :, None]
    found[:, 2:] -= motion.velocity[:, :, None]
    return found
