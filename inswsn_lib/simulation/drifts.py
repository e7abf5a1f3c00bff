"""Drifts of an INS with one formula each: each method has one that it is made for."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from inswsn_lib.checks import Array, array, one_of
from inswsn_lib.simulation.disturbances import SHAPES, drifting, shaped_drift

#: The drifts; in ``"first turn"`` the vehicle goes straight until the outage
DRIFTS = ("offset", "step", *SHAPES, "wandering", "turning", "first turn")
_SPEED = 7.5  # m/s, that of P1
_DRIFT = 0.8  # m/s, the velocity error of P1's INS


def draw_motion(drift: str, time: ArrayLike, rng: np.random.Generator, runs: int) -> Array:
    r"""Draw the motion of a vehicle at 7.5 m/s, (steps, 4, runs), m and m/s.

    Its heading is :math:`\theta + \sin(2\pi t / 20\,\mathrm s + \theta')` with two angles at
    random. For the drift ``"first turn"`` it is :math:`\theta` up to time 0, when a quarter of a
    circle of 20 m begins, to either side.

    Parameters
    ----------
    drift : str
        One of `DRIFTS`.
    time : array_like, (steps,)
        s since the outage began.
    rng : numpy.random.Generator
    runs : int

    Examples
    --------
    >>> import numpy as np
    >>> from inswsn_lib.simulation import draw_motion
    >>> motion = draw_motion("turning", np.arange(-20, 40, 0.2), np.random.default_rng(0), runs=3)
    >>> bool(np.allclose(np.hypot(motion[:, 2], motion[:, 3]), 7.5))
    True
    """
    t = array("time", time, ("steps",))[:, None]
    one_of("drift", drift, DRIFTS)
    angle, other = rng.uniform(0, 2 * np.pi, (2, runs))
    heading = angle + np.sin(2 * np.pi * t / 20 + other)
    if drift == "first turn":
        side = np.where(other < np.pi, 1.0, -1.0)
        heading = angle + side * np.clip(_SPEED / 20 * t, 0.0, np.pi / 2)
    velocity = _SPEED * np.stack([np.cos(heading), np.sin(heading)], axis=1)
    steps = np.diff(t, axis=0)[:, None] * (velocity[1:] + velocity[:-1]) / 2
    position = np.concatenate([np.zeros((1, 2, runs)), np.cumsum(steps, axis=0)])
    return np.concatenate([position, velocity], axis=1)


def draw_drift(drift: str, time: ArrayLike, motion: Array, rng: np.random.Generator) -> Array:
    r"""Draw the errors of an INS, (steps, 4, runs), m and m/s.

    With standard normal numbers :math:`z`, others in each place, axis and run, the position error
    is

    - ``"offset"``: :math:`5\,\mathrm m\; z`;
    - ``"step"``: the same, and another after a time that is uniform in the training;
    - ``"steady"``, ``"accelerating"``, ``"oscillating"``: those of `shaped_drift`, linear,
      quadratic, and a sine of 30 s, with 0.8 m/s;
    - ``"wandering"``: a quarter of the steady one, and a velocity that walks at random to a
      deviation of 0.8 m/s in 20 s;
    - ``"turning"``, ``"first turn"``: :math:`z + M (p - p_0)`, with the velocity error
      :math:`M v`, where M turns by :math:`0.1 z` rad and stretches by :math:`0.03 z`.

    Parameters
    ----------
    drift : str
        One of `DRIFTS`.
    time : array_like, (steps,)
        s since the outage began.
    motion : ndarray, (steps, 4, runs)
        True position and velocity, m and m/s.
    rng : numpy.random.Generator

    Examples
    --------
    An error of the heading makes a velocity error in proportion to the speed, whatever the way:

    >>> import numpy as np
    >>> from inswsn_lib.simulation import draw_drift, draw_motion
    >>> time, rng = np.arange(-20, 40, 0.2), np.random.default_rng(0)
    >>> error = draw_drift("turning", time, draw_motion("turning", time, rng, 3), rng)
    >>> bool(np.ptp(np.hypot(error[:, 2], error[:, 3]), axis=0).max() < 1e-9)
    True
    """
    t, runs = array("time", time, ("steps",)), motion.shape[2]
    one_of("drift", drift, DRIFTS)
    if drift in SHAPES:
        return shaped_drift(drift, t - t[0], rng, runs, size=_DRIFT)
    if drift == "wandering":
        error = shaped_drift("steady", t - t[0], rng, runs, size=_DRIFT / 4)
        # 2 * deviation^2 * correlation_time is the square of 0.8 m/s over 20 s
        return drifting(error, t[1] - t[0], rng, deviation=0.09, correlation_time=2.0)
    if drift in ("offset", "step"):
        first, second = 5 * rng.standard_normal((2, 2, runs))
        late = t[:, None, None] >= rng.uniform(t[0], 0.0, runs)
        position = first + second * late * (drift == "step")
        return np.concatenate([position, np.zeros_like(position)], axis=1)
    turn, stretch = np.array([[0.1], [0.03]]) * rng.standard_normal((2, runs))
    error = np.zeros_like(motion)
    error[:, :2] = rng.standard_normal((2, runs))
    for x, y, since in ((0, 1, motion[0]), (2, 3, np.zeros((4, runs)))):
        way, across = motion[:, x] - since[x], motion[:, y] - since[y]
        error[:, x] += stretch * way - turn * across
        error[:, y] += turn * way + stretch * across
    return error
