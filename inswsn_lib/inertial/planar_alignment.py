"""Where a vehicle with odometry is and where it heads, by what it measured at the beginning."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from inswsn_lib.checks import Array
from inswsn_lib.errors import InswsnError
from inswsn_lib.inertial.alignment import LARGEST_HEADING
from inswsn_lib.inertial.error_state import Start, run_error_state
from inswsn_lib.inertial.observations import Observation
from inswsn_lib.inertial.planar import OdometryMotion, PlanarState

_HEADINGS = 36
_ERRORS = PlanarState.errors


def align_planar(
    motion: OdometryMotion, observations: Sequence[Observation], begin: float, end: float,
    place: Array, deviations: Sequence[float] = (1.0, 0.1, 0.02),
) -> Start:  # fmt: skip
    """Return where a vehicle is at the end of a window, its heading by a bank of filters.

    One filter for each of 36 headings at the beginning runs over the window, and the one that makes
    the measurements most likely is taken. States of the observations are left behind.

    Parameters
    ----------
    motion : OdometryMotion
    observations : sequence of Observation
        Fixes or ranges.
    begin, end : float
        The window, s.
    place : ndarray, (2,)
        About where the vehicle is at its beginning, m.
    deviations : sequence of float
        Standard deviations at its beginning of position (m), scale and bias of the rate (rad/s).

    Raises
    ------
    InswsnError
        If the window has no measurement, or does not tell the heading.

    Examples
    --------
    Wheels say 1 m/s, fixes go along y:

    >>> import numpy as np
    >>> from inswsn_lib import inertial as nav
    >>> from inswsn_lib.streams import Fixes, Odometry
    >>> t = np.arange(0, 10.1, 0.1)
    >>> wheels = Odometry(t, speed=np.full(101, 1.0), rate=np.zeros(101))
    >>> motion = nav.OdometryMotion(wheels, nav.OdometryNoise(0.01, 0.001, 1e-4, 1e-5))
    >>> observed = [nav.PositionFixes(Fixes(t, np.outer(t, [0.0, 1.0])), np.zeros(2), np.ones(2))]
    >>> start = nav.align_planar(motion, observed, begin=0.0, end=10.0, place=np.zeros(2))
    >>> print(f"{np.degrees(start.state.heading):.0f} degrees")
    90 degrees
    """
    apart = 2 * np.pi / _HEADINGS
    where, scale, bias = deviations
    P0 = np.diag(np.square([where, where, apart, scale, bias]))
    fits = [
        run_error_state(
            motion, Start(begin, PlanarState(place, heading), P0), observations, end=end
        )
        for heading in apart * np.arange(_HEADINGS)
    ]
    best = max(fits, key=lambda fit: fit.log_likelihood)
    state, P = best.states[-1], best.covariances[-1][:_ERRORS, :_ERRORS]
    spread = float(np.degrees(np.sqrt(P[2, 2])))
    if not spread < LARGEST_HEADING:
        raise InswsnError(
            f"The heading cannot be told between {begin:.6g} and {end:.6g} s: its standard "
            f"deviation is {spread:.0f} degrees. Take a longer window, or one in which it moves."
        )
    return Start(float(best.time[-1]), replace(state, own=np.zeros(0)), P)
