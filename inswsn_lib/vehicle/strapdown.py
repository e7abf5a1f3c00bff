"""Strapdown integration of many runs at once, by `pyins`, in the frame east, north, up."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

# the compiled loop below pyins' public Integrator, which keeps its data in tables of pandas; a test
# holds the two together
from pyins.strapdown import integrate
from scipy.spatial.transform import Rotation

from inswsn_lib.vehicle.error_model import (
    ACCELEROMETER_BIAS,
    ATTITUDE,
    GYRO_DRIFT,
    POSITION,
    STATES,
    TURN,
    VELOCITY,
)

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class VehicleState:
    """What a filter knows: the INS, what has been estimated of its errors, and how well.

    Arrays have one leading shape ``...``: runs, or epochs and runs.

    Attributes
    ----------
    position : ndarray, (..., 3)
        Latitude, longitude (rad), height (m).
    velocity : ndarray, (..., 3)
        East, north, up (m/s).
    attitude : ndarray, (..., 3, 3)
        Body (forward, right, down) to east-north-up.
    accelerometer_bias, gyro_drift : ndarray, (..., 3)
        What is taken from the sensors (m/s^2, rad/s).
    error : ndarray, (..., n)
        The estimate of the error that is not fed back: all of it in open loop, that of states
        beyond P3's fifteen in closed loop.
    covariance : ndarray, (..., n, n)
        Of the error.

    Examples
    --------
    An error of 2 m/s in the velocity north is estimated; fed back, it is taken off and known to be
    zero:

    >>> import numpy as np
    >>> from inswsn_lib.vehicle import STATES, VehicleState
    >>> error = np.zeros((1, STATES))
    >>> error[0, 4] = 2.0
    >>> zero = np.zeros((1, 3))
    >>> level = np.array([[[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]]])
    >>> state = VehicleState(
    ...     position=zero, velocity=zero + [0.0, 12.0, 0.0], attitude=level,
    ...     accelerometer_bias=zero, gyro_drift=zero, error=error,
    ...     covariance=np.zeros((1, STATES, STATES)),
    ... )
    >>> fed_back = state.corrected()
    >>> fed_back.velocity[0].tolist(), bool(fed_back.error.any())
    ([0.0, 10.0, 0.0], False)
    """

    position: Array
    velocity: Array
    attitude: Array
    accelerometer_bias: Array
    gyro_drift: Array
    error: Array
    covariance: Array

    def __getitem__(self, index: Any) -> Self:
        """Return the state at an index of the leading shape."""
        return replace(self, **{f.name: getattr(self, f.name)[index] for f in fields(self)})

    def corrected(self) -> Self:
        r"""Return the state with its error fed back, :math:`C = e^{[\varphi\times]} C'`.

        Returns
        -------
        VehicleState
            With the error of P3's fifteen states zero; extra states and the covariance stay.
        """
        x = self.error
        turns = Rotation.from_rotvec(x[..., ATTITUDE].reshape(-1, 3)).as_matrix()
        error = x.copy()
        error[..., :STATES] = 0.0
        return replace(
            self,
            position=self.position - x[..., POSITION],
            velocity=self.velocity - x[..., VELOCITY],
            attitude=turns.reshape(self.attitude.shape) @ self.attitude,
            accelerometer_bias=self.accelerometer_bias + x[..., ACCELEROMETER_BIAS],
            gyro_drift=self.gyro_drift + x[..., GYRO_DRIFT],
            error=error,
        )


@dataclass(frozen=True, eq=False)
class Flight:
    """What the INS computes over one interval, at the end of every sample.

    Attributes
    ----------
    position, velocity : ndarray, (runs, samples + 1, 3)
        As in `VehicleState`; the first is where the interval begins.
    attitude : ndarray, (runs, samples + 1, 3, 3)

    Examples
    --------
    An IMU that feels nothing falls: :math:`g t^2/2` in a second.

    >>> import numpy as np
    >>> from inswsn_lib.vehicle import STATES, VehicleState, integrate_strapdown
    >>> zero, nothing = np.zeros((1, 3)), np.zeros((1, 100, 3))
    >>> level = np.array([[[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]]])
    >>> errors = np.zeros((1, STATES)), np.zeros((1, STATES, STATES))
    >>> state = VehicleState(zero, zero, level, zero, zero, *errors)
    >>> flight = integrate_strapdown(state, nothing, nothing, 0.01)
    >>> flight.position.shape  # runs, samples and the start, latitude to height
    (1, 101, 3)
    >>> print(f"{flight.position[0, -1, 2]:.2f} m")
    -4.89 m
    """

    position: Array
    velocity: Array
    attitude: Array


def integrate_strapdown(
    state: VehicleState, rotations: Array, velocities: Array, period: float
) -> Flight:
    """Integrate the increments of one interval, less the biases of the state.

    Parameters
    ----------
    state : VehicleState
        Where each run begins, (runs,).
    rotations, velocities : ndarray, (runs, samples, 3)
        Increments as in `Drive` (rad, m/s).
    period : float
        s.

    Returns
    -------
    Flight
        At the end of every sample.

    Examples
    --------
    At rest on the equator, heading north: the gyros tell the rate of the earth, the accelerometers
    the reaction to gravity, and ten seconds later the INS is where it was. A bias of 0.01 m/s^2
    forward that nobody takes off moves it north by :math:`b t^2/2`, half a metre.

    >>> import numpy as np
    >>> from pyins import earth
    >>> from inswsn_lib.vehicle import STATES, VehicleState, integrate_strapdown, metres
    >>> level = np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]])
    >>> zero = np.zeros((2, 3))  # two runs
    >>> state = VehicleState(
    ...     zero, zero, np.stack([level] * 2), zero, zero,
    ...     np.zeros((2, STATES)), np.zeros((2, STATES, STATES)),
    ... )
    >>> turns, pushes = np.zeros((2, 2, 1000, 3))
    >>> turns[..., 0], pushes[..., 2] = earth.RATE * 0.01, -earth.gravity(0.0, 0.0) * 0.01
    >>> pushes[1, :, 0] = 0.01 * 0.01
    >>> flight = integrate_strapdown(state, turns, pushes, 0.01)
    >>> np.abs(flight.position[:, -1] * metres(zero)).round(3).tolist()
    [[0.0, 0.0, 0.0], [0.5, 0.0, 0.0]]
    """
    runs, samples = rotations.shape[:2]
    lla, velocity = np.empty((2, runs, samples + 1, 3))
    matrix = np.empty((runs, samples + 1, 3, 3))
    lla[:, 0] = state.position * _DEGREES
    velocity[:, 0] = state.velocity @ TURN
    matrix[:, 0] = TURN @ state.attitude
    theta = rotations - state.gyro_drift[:, None] * period
    dv = velocities - state.accelerometer_bias[:, None] * period
    steps = np.full(samples, period)
    for r in range(runs):
        integrate(steps, lla[r], velocity[r], matrix[r], theta[r], dv[r], 0, True)
    # TURN by its entries: as a product with zeros it took as long as a tenth of the integration
    return Flight(
        lla / _DEGREES,
        velocity[..., _AXES] * _SIGNS,
        matrix[..., _AXES, :] * _SIGNS[:, None],
    )


_DEGREES = np.array([np.rad2deg(1.0), np.rad2deg(1.0), 1.0])
_AXES, _SIGNS = np.abs(TURN).argmax(axis=1), TURN.sum(axis=1)
