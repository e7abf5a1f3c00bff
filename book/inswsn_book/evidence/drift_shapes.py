"""Drifts of an INS with a shape."""

from __future__ import annotations

from typing import Literal, get_args

import numpy as np
from numpy.typing import ArrayLike

from inswsn_lib.checks import Array, array, number, one_of, whole

Shape = Literal["steady", "accelerating", "oscillating"]
SHAPES: tuple[Shape, ...] = get_args(Shape)


def shaped_drift(
    shape: Shape,
    time: ArrayLike,
    rng: np.random.Generator,
    runs: int,
    *,
    size: float = 1.0,
    cycle: float = 30.0,
) -> Array:
    r"""Draw errors of an INS whose velocity error has a shape.

    In each axis and run, with :math:`z, z'` independent standard normal numbers and the velocity
    scale s, the velocity error is :math:`s z` if steady, :math:`s (z/4 + z' t / 20\,\mathrm s)` if
    accelerating, and :math:`s\,(z \cos\omega t + z' \sin\omega t)` with :math:`\omega = 2\pi` over
    `cycle` if oscillating. The position error is its integral from a first one of deviation 1 m.

    Parameters
    ----------
    shape : {"steady", "accelerating", "oscillating"}
    time : array_like, (steps,)
        s since the first step.
    rng : numpy.random.Generator
    runs : int
    size, cycle : float
        s, m/s; the period of the oscillation, s.

    Returns
    -------
    ndarray, (steps, 4, runs)
        Position (m) and velocity (m/s) errors.
    """
    one_of("shape", shape, SHAPES)
    for name, value in (("size", size), ("cycle", cycle)):
        number(name, value, above=0)
    whole("runs", runs, 1)
    t = array("time", time, ("steps",))[:, None, None]
    z, other, start = rng.standard_normal((3, 2, runs))
    if shape == "steady":
        velocity, way = size * z * np.ones_like(t), size * z * t
    elif shape == "accelerating":
        velocity = size * (z / 4 + other * t / 20)
        way = size * (z / 4 * t + other * t**2 / 40)
    else:
        rate = 2 * np.pi / cycle
        velocity = size * (z * np.cos(rate * t) + other * np.sin(rate * t))
        way = size / rate * (z * np.sin(rate * t) + other * (1 - np.cos(rate * t)))
    return np.concatenate([start + way, velocity], axis=1)
