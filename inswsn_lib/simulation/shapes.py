"""Drifts of an INS that have a shape: steady, accelerating, oscillating."""

from __future__ import annotations

from typing import Literal, get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray

from inswsn_lib.errors import ParameterError

Array = NDArray[np.float64]
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
    scale s, the velocity error is

    - steady: :math:`s z`;
    - accelerating: :math:`s (z/4 + z' t / 20\,\mathrm s)`;
    - oscillating: :math:`s\,(z \cos\omega t + z' \sin\omega t)`, :math:`\omega = 2\pi` over
      `cycle`,

    and the position error its integral from a first error that is normal with deviation 1 m.

    Parameters
    ----------
    shape : {"steady", "accelerating", "oscillating"}
    time : array_like, (steps,)
        s since the first step.
    rng : numpy.random.Generator
        The stream.
    runs : int
        How many.
    size : float
        s, m/s; positive.
    cycle : float
        Period of the oscillation, s; positive.

    Returns
    -------
    ndarray, (steps, 4, runs)
        Position (m) and velocity (m/s) errors.

    Raises
    ------
    ParameterError
        If there is no such shape, a number is not positive and finite, or the runs are not whole.

    Examples
    --------
    A steady velocity error moves the position error evenly, an accelerating one does not:

    >>> import numpy as np
    >>> from inswsn_lib.simulation import SHAPES, shaped_drift
    >>> t = np.array([0.0, 10.0, 20.0])
    >>> for shape in SHAPES[:2]:
    ...     drift = shaped_drift(shape, t, np.random.default_rng(0), runs=3)
    ...     moved = np.diff(drift[:, :2], axis=0)
    ...     print(shape, drift.shape, bool(np.allclose(moved[0], moved[1])))
    steady (3, 4, 3) True
    accelerating (3, 4, 3) False
    """
    if shape not in SHAPES:
        raise ParameterError("shape", shape, f"one of {', '.join(SHAPES)}")
    for name, value in (("size", size), ("cycle", cycle)):
        if not 0 < value < np.inf:
            raise ParameterError(name, value, "positive and finite")
    if isinstance(runs, bool) or not isinstance(runs, int | np.integer) or runs < 1:
        raise ParameterError("runs", runs, "a whole number, 1 or more")
    t = np.asarray(time, dtype=float)
    if t.ndim != 1 or not np.isfinite(t).all():
        raise ParameterError("time", f"of shape {t.shape}", "finite, (steps,)")
    t = t[:, None, None]
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
