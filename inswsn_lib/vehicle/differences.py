"""The error model by finite differences of the full mechanisation: a check that shares no line."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from inswsn_lib.vehicle.error_model import (
    ACCELEROMETER_BIAS,
    ATTITUDE,
    GYRO_DRIFT,
    POSITION,
    STATES,
    VELOCITY,
    metres,
)
from inswsn_lib.vehicle.strapdown import VehicleState, integrate_strapdown

Array = NDArray[np.float64]

# sizes of the perturbations: m, m/s, rad, m/s^2, rad/s
_SIZES = np.repeat([1.0, 0.1, 3e-3, 0.3, 3e-3], 3)
_STEP = 0.01  # s


def state_sizes(position: Array) -> Array:
    """Return what a unit of each of P3's states is in metres, (15,): radians become metres."""
    return np.concatenate([metres(position), np.ones(STATES - 3)])


def numeric_dynamics(
    position: Array, velocity: Array, attitude: Array, force: Array, rate: Array
) -> Array:
    r"""Return F of P3 (3), (15, 15), by central differences of pyins' strapdown integrator.

    Each state is perturbed to either side, the perturbed and the true mechanisation are integrated
    over a short step with the same sensors, and the growth of the difference is divided by the
    step. Steps of T and T/2, extrapolated to zero, leave an error of the order of :math:`T^2`.

    Parameters
    ----------
    position : ndarray, (3,)
        Latitude, longitude (rad), height (m).
    velocity : ndarray, (3,)
        East, north, up (m/s).
    attitude : ndarray, (3, 3)
        Body to east-north-up.
    force, rate : ndarray, (3,)
        Specific force and angular rate, body axes (m/s^2, rad/s).

    Returns
    -------
    ndarray, (15, 15)
        1/s, and units of the states.

    Examples
    --------
    It agrees with `error_dynamics`, with which it shares no line, but for what that leaves out:

    >>> import numpy as np
    >>> from inswsn_lib.vehicle import error_dynamics, numeric_dynamics, row_difference
    >>> position = np.array([0.56, 2.07, 20.0])
    >>> velocity = np.array([3.0, 12.0, 0.2])
    >>> attitude = np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]])  # level, north
    >>> force = np.array([0.5, 1.0, -9.8])  # forward, right, down
    >>> found = numeric_dynamics(position, velocity, attitude, force, np.array([0.0, 0.0, 0.1]))
    >>> expected = error_dynamics(position, velocity, attitude, attitude @ force)
    >>> bool(row_difference(found, expected, position) < 0.01)
    True
    """
    # the dynamics do not know the longitude, and near zero its rounding is smaller
    position = position * np.array([1.0, 0.0, 1.0])
    whole, half = (
        _growth(position, velocity, attitude, force, rate, step) for step in (_STEP, _STEP / 2)
    )
    return 2 * half - whole


def _growth(
    position: Array, velocity: Array, attitude: Array, force: Array, rate: Array, step: float
) -> Array:
    """Return the difference quotient over one step."""
    sizes = _SIZES / state_sizes(position)
    errors = np.concatenate([np.diag(sizes), -np.diag(sizes), np.zeros((1, STATES))])
    state = _perturbed(position, velocity, attitude, errors)
    rotations = (rate * step + errors[:, GYRO_DRIFT] * step)[:, None]
    turned = 0.5 * np.cross(rate, force) * step**2  # the frame at the sample's beginning
    velocities = (force * step + errors[:, ACCELEROMETER_BIAS] * step + turned)[:, None]
    flight = integrate_strapdown(state, rotations, velocities, step)
    after = np.zeros_like(errors)
    true = flight.attitude[-1, -1]
    after[:, POSITION] = flight.position[:, -1] - flight.position[-1, -1]
    after[:, VELOCITY] = flight.velocity[:, -1] - flight.velocity[-1, -1]
    after[:, ATTITUDE] = -Rotation.from_matrix(flight.attitude[:, -1] @ true.T).as_rotvec()
    after[:, ACCELEROMETER_BIAS.start :] = errors[:, ACCELEROMETER_BIAS.start :]
    change = (after[:STATES] - after[STATES:-1]) / 2 - np.diag(sizes)
    return np.asarray((change / sizes[:, None]).T / step)


def _perturbed(position: Array, velocity: Array, attitude: Array, errors: Array) -> VehicleState:
    """Return computed states with given errors; biases stay in the sensors."""
    count = len(errors)
    turned = Rotation.from_rotvec(-errors[:, ATTITUDE]).as_matrix() @ attitude
    zero = np.zeros((count, 3))
    return VehicleState(
        position=position + errors[:, POSITION],
        velocity=velocity + errors[:, VELOCITY],
        attitude=turned,
        accelerometer_bias=zero,
        gyro_drift=zero,
        error=np.zeros((count, STATES)),
        covariance=np.zeros((count, STATES, STATES)),
    )


def numeric_rows(position: Array, velocity: Array, attitude: Array) -> Array:
    """Return the rows of compass, lateral velocity and GPS, (8, 15), by central differences.

    The yaw is that of a vector in the horizontal plane, the lateral velocity the second component
    in the body, both as a navigation computer has them; see `numeric_dynamics` for the arguments.

    Parameters
    ----------
    position, velocity, attitude : ndarray, (3,), (3,), (3, 3)
        As for `numeric_dynamics`.

    Returns
    -------
    ndarray, (8, 15)
        The compass, the lateral velocity, three of GPS position and three of GPS velocity.

    Examples
    --------
    >>> import numpy as np
    >>> from inswsn_lib.vehicle import (
    ...     compass_row, gps_rows, lateral_row, numeric_rows, row_difference
    ... )
    >>> position = np.array([0.56, 2.07, 20.0])
    >>> velocity = np.array([3.0, 12.0, 0.2])
    >>> attitude = np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]])  # level, north
    >>> expected = np.vstack([compass_row(attitude), lateral_row(attitude, velocity), gps_rows()])
    >>> bool(row_difference(numeric_rows(position, velocity, attitude), expected, position) < 1e-3)
    True
    """
    sizes = _SIZES / state_sizes(position)
    errors = np.concatenate([np.diag(sizes), -np.diag(sizes)])
    state = _perturbed(position, velocity, attitude, errors)
    forward = state.attitude @ np.array([1.0, 0.0, 0.0])
    heading = np.unwrap(np.arctan2(forward[:, 0], forward[:, 1]), axis=0)
    body = np.einsum("rij,ri->rj", state.attitude, state.velocity)
    told = np.column_stack([heading, body[:, 1], state.position, state.velocity])
    return np.asarray(((told[:STATES] - told[STATES:]) / (2 * sizes[:, None])).T)


def row_difference(found: Array, expected: Array, position: Array) -> float:
    """Return the largest difference of two matrices, as a share of the largest entry of its row.

    Parameters
    ----------
    found, expected : ndarray, (rows, 15)
        In P3's units; columns are compared in metres.
    position : ndarray, (3,)
        Where, for the metres of a radian.

    Returns
    -------
    float
        The share, 1.

    Examples
    --------
    An error of one per cent in the largest entry of a row:

    >>> import numpy as np
    >>> from inswsn_lib.vehicle import gps_rows, row_difference
    >>> position = np.array([0.56, 2.07, 20.0])
    >>> round(row_difference(1.01 * gps_rows(), gps_rows(), position), 6)
    0.01
    """
    scaled = (found - expected) / state_sizes(position)
    size = np.abs(expected / state_sizes(position)).max(axis=1)
    # where nothing is expected, the difference itself
    return float((np.abs(scaled).max(axis=1) / np.where(size > 0, size, 1.0)).max())
