"""Strapdown integration of many runs at once, by `pyins`, in the frame east, north, up."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from typing import Any, Self

import numpy as np
from scipy.spatial.transform import Rotation

from inswsn_lib.checks import Array
from inswsn_lib.kernels import import_numba_user, keeping
from inswsn_lib.vehicle.error_model import (
    ACCELEROMETER_BIAS,
    ATTITUDE,
    GYRO_DRIFT,
    POSITION,
    STATES,
    TURN,
    VELOCITY,
)

# the compiled loop below pyins' public Integrator, which keeps its data in tables of pandas; a test
# holds the two together
integrate = import_numba_user("pyins.strapdown").integrate
keeping(integrate.enable_caching)  # pyins would compile it anew in each process: seconds

_DEGREES = np.array([np.rad2deg(1.0), np.rad2deg(1.0), 1.0])
# TURN by its entries: as a product with zeros it took as long as a tenth of the integration
_AXES, _SIGNS = np.abs(TURN).argmax(axis=1), TURN.sum(axis=1)


@dataclass(frozen=True, eq=False)
class VehicleState:
    """What a filter knows: the INS, what has been estimated of its errors, and how well.

    Arrays have one leading shape ``...``: runs, or epochs and runs.

    Attributes
    ----------
    position, velocity : ndarray, (..., 3)
        Latitude, longitude (rad), height (m); east, north, up (m/s).
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
    An error of 2 m/s in the velocity north is estimated; fed back, it is taken off:

    >>> import numpy as np, inswsn_lib as iw
    >>> zero, error = np.zeros(3), 2.0 * np.eye(15)[4]
    >>> state = iw.vehicle.VehicleState(zero, zero, np.eye(3), zero, zero, error, error)
    >>> state.corrected().velocity
    array([ 0., -2.,  0.])
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

        The error of P3's fifteen states is then zero; extra states and the covariance stay.
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


def integrate_strapdown(
    state: VehicleState, rotations: Array, velocities: Array, period: float
) -> tuple[Array, Array, Array]:
    """Integrate the increments of one interval, less the biases of the state.

    Parameters
    ----------
    state : VehicleState
        Where each run begins, (runs,).
    rotations, velocities : ndarray, (runs, samples, 3)
        Increments as in `Drive` (rad, m/s), each over the period (s).

    Returns
    -------
    position, velocity, attitude : ndarray, (runs, samples + 1, ...)
        As in `VehicleState`, at the start and at the end of every sample.

    Examples
    --------
    An IMU that feels nothing falls, :math:`g t^2/2` in a second:

    >>> import numpy as np, inswsn_lib as iw
    >>> zero, nothing = np.zeros((1, 3)), np.zeros((1, 100, 3))
    >>> state = iw.vehicle.VehicleState(zero, zero, np.eye(3)[None], zero, zero, zero, zero)
    >>> iw.vehicle.integrate_strapdown(state, nothing, nothing, 0.01)[0][0, -1].round(2)
    array([ 0.  ,  0.  , -4.89])
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
    position, attitude = lla / _DEGREES, matrix[..., _AXES, :] * _SIGNS[:, None]
    return position, velocity[..., _AXES] * _SIGNS, attitude
