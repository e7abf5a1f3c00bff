r"""What P3's filter knows: the state of its INS and of the errors (P3 3.1).

The filter is that of `inswsn_lib.inertial`; `frame` tells how its states and errors become P3's:
:math:`x = (\delta L, \delta\lambda, \delta h, \delta v_E, \delta v_N, \delta v_U, \varphi_E,
\varphi_N, \varphi_U, \nabla_x, \nabla_y, \nabla_z, \varepsilon_x, \varepsilon_y, \varepsilon_z)`,
what the INS computes less the truth. They are latitude and longitude (rad), height (m), velocity
(m/s), the turn of the true frame into the computed one, :math:`C' = (I - [\varphi\times])\,C`
(rad), the accelerometers' biases (m/s^2) and the gyros' drifts (rad/s) in the body frame.
"""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from typing import Any, Self

import numpy as np

from inswsn_lib.checks import Array
from inswsn_lib.inertial.mechanization import turned

#: How many states P3 has
STATES = 15
POSITION, VELOCITY, ATTITUDE = slice(0, 3), slice(3, 6), slice(6, 9)
ACCELEROMETER_BIAS, GYRO_DRIFT = slice(9, 12), slice(12, 15)


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
        error = x.copy()
        error[..., :STATES] = 0.0
        return replace(
            self,
            position=self.position - x[..., POSITION],
            velocity=self.velocity - x[..., VELOCITY],
            attitude=turned(x[..., ATTITUDE]) @ self.attitude,
            accelerometer_bias=self.accelerometer_bias + x[..., ACCELEROMETER_BIAS],
            gyro_drift=self.gyro_drift + x[..., GYRO_DRIFT],
            error=error,
        )


def yaw(attitude: Array) -> Array:
    r"""Return the yaw :math:`\psi = \mathrm{atan2}(c_E, c_N)`, (...), clockwise from north (rad).

    Examples
    --------
    A body whose forward axis c, the first column, points east:

    >>> import numpy as np, inswsn_lib as iw
    >>> float(np.degrees(iw.vehicle.yaw(np.eye(3))))
    90.0
    """
    return np.asarray(np.arctan2(attitude[..., 0, 0], attitude[..., 1, 0]))
