"""Where a filter starts: levelling at rest, and alignment in motion by a bank of smoothers.

In motion nothing is assumed of the start but wide limits: of the attitude only the tilt is
guessed, by the mean specific force. From each of several headings a smoother finds the most likely
start, linearised about the motion from the last one that it found: the way of Gauss and Newton. The
most likely of all is taken, at the end of the window, with its covariance there; where that does
not tell the heading, it is refused.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy.spatial.transform import Rotation

from inswsn_lib.checks import Array
from inswsn_lib.errors import InswsnError
from inswsn_lib.estimation.error_state import Start, run_error_state
from inswsn_lib.estimation.inertial import ATTITUDE, InertialMotion, InertialState
from inswsn_lib.estimation.mechanization import ERRORS
from inswsn_lib.estimation.observations import Observation, RangesToAnchors
from inswsn_lib.estimation.smoothing import smooth_start
from inswsn_lib.streams import Imu

#: Standard deviations that are assumed of position, velocity, attitude and both biases: wide
WIDE = (1000.0, 30.0, 2.0, 0.3, 0.02)
#: A heading is told if its standard deviation is below this, degrees
LARGEST_HEADING = 20.0
_HEADINGS, _PASSES = 4, 6


def level(imu: Imu, heading: float = 0.0) -> Array:
    """Return the attitude of an IMU that is not accelerated, by its mean specific force, (3, 3).

    Parameters
    ----------
    imu : Imu
        What it says at rest or in a steady motion.
    heading : float
        Of the body's x axis against x, to the left, rad.

    Examples
    --------
    >>> import numpy as np
    >>> from inswsn_lib.estimation import level
    >>> from inswsn_lib.streams import Imu
    >>> still = Imu(np.arange(3.0), np.zeros((3, 3)), np.tile([0.0, 0.0, 9.8], (3, 1)))
    >>> level(still).tolist()
    [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]
    """
    up = imu.force.mean(axis=0)
    up = up / np.linalg.norm(up)
    ahead = np.eye(3)[np.argmin(np.abs(up))] if abs(up[0]) > 0.9 else np.array([1.0, 0.0, 0.0])
    ahead = ahead - up * (up @ ahead)
    ahead /= np.linalg.norm(ahead)
    levelled = np.stack([ahead, np.cross(up, ahead), up])
    return np.asarray(Rotation.from_rotvec([0.0, 0.0, heading]).as_matrix() @ levelled)


def align(
    motion: InertialMotion,
    observations: Sequence[Observation],
    begin: float,
    end: float,
    *,
    deviations: Sequence[float] = WIDE,
) -> Start:
    """Return where a filter starts at the end of a window, by the measurements in it.

    Parameters
    ----------
    motion : InertialMotion
    observations : sequence of Observation
        Fixes and velocities. Ranges are far from linear in a position of which nothing is known.
    begin, end : float
        The window, s.
    deviations : sequence of float
        Standard deviations that are assumed at its beginning of position, m, velocity, m/s,
        attitude, rad, and the biases of accelerometers, m/s^2, and gyroscopes, rad/s.

    Raises
    ------
    InswsnError
        If the window has no measurement, or does not tell the heading, or there are ranges.

    Examples
    --------
    A body that looks along y and is moved to and fro along x, to its right and to its left:

    >>> import numpy as np
    >>> from inswsn_lib import estimation as est
    >>> from inswsn_lib.streams import Fixes, Imu
    >>> t, fixed = np.arange(0, 10.01, 0.01), np.arange(0.2, 10.1, 0.2)
    >>> force = np.stack([0 * t, -np.sin(t), 0 * t + 9.80665], axis=1)
    >>> imu = Imu(t, np.zeros((1001, 3)), force)
    >>> motion = est.InertialMotion(imu, est.ImuNoise(0.01, 0.001, 1e-4, 1e-5))
    >>> fixes = Fixes(fixed, np.outer(fixed - np.sin(fixed), [1.0, 0.0, 0.0]))
    >>> observed = [est.PositionFixes(fixes, np.zeros(3), white=np.full(3, 0.01))]
    >>> start = est.align(motion, observed, begin=0.0, end=10.0)
    >>> print(f"{start.state.velocity[0]:.1f} m/s, {1 - np.cos(10):.1f} m/s in truth")
    1.8 m/s, 1.8 m/s in truth
    >>> np.abs(start.state.attitude.round(1))[:, 0].tolist()  # where the body's nose is
    [0.0, 1.0, 0.0]
    """
    if any(isinstance(each, RangesToAnchors) for each in observations):
        raise InswsnError("Ranges do not align an INS: take fixes by multilateration of them.")
    window = motion.imu.part(begin, end)
    if len(window) < 2:
        raise InswsnError(f"The IMU says nothing between {begin:.6g} and {end:.6g} s.")
    P0 = np.diag(np.repeat(np.square(deviations, dtype=float), 3))
    fits = []
    for heading in np.linspace(0, 2 * np.pi, _HEADINGS, endpoint=False):
        prior = Start(begin, InertialState(np.zeros(3), np.zeros(3), level(window, heading)), P0)
        about = prior.state
        for _ in range(_PASSES):
            found = run_error_state(motion, prior, observations, end=end, about=about)
            about = smooth_start(found).state
        fits.append(found)
    best = max(fits, key=lambda fit: fit.log_likelihood)
    state, P = best.states[-1], best.covariances[-1][:ERRORS, :ERRORS]
    vertical = state.attitude[2]  # the axis upwards, in axes of the body
    spread = float(np.degrees(np.sqrt(vertical @ P[ATTITUDE, ATTITUDE] @ vertical)))
    if not spread < LARGEST_HEADING:
        raise InswsnError(
            f"The heading cannot be told between {begin:.6g} and {end:.6g} s: its standard "
            f"deviation is {spread:.0f} degrees, for want of acceleration. Take a longer window, "
            "or one with turns."
        )
    return Start(float(best.time[-1]), replace(state, own=np.zeros(0)), P)
