"""What all filters ask of their input."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from inswsn_lib.errors import ParameterError

Array = NDArray[np.float64]


def checked_measurements(measurements: ArrayLike, outputs: int) -> Array:
    """Return measurements as (steps, outputs, runs), NaN where missing; refuse others."""
    y = np.asarray(measurements, dtype=float)
    if y.ndim != 3 or y.shape[1] != outputs:
        raise ParameterError(
            "measurements", f"of shape {y.shape}", f"(steps, {outputs}, runs); one run is runs = 1"
        )
    with np.errstate(over="ignore", invalid="ignore"):
        whole = bool(np.isfinite(y.sum()))  # a sum is quicker to look at
    if not whole and np.isinf(y).any():
        raise ParameterError("measurements", "infinite", "finite, or NaN where missing")
    return y


def first_state(value: ArrayLike | None, states: int, runs: int) -> Array:
    """Return the first state of every run as (states, runs); zero by default."""
    if value is None:
        return np.zeros((states, runs))
    given = np.asarray(value, dtype=float)
    if given.shape not in ((states,), (states, runs)) or not np.isfinite(given).all():
        raise ParameterError(
            "initial_state", f"of shape {given.shape}", f"finite, ({states},) or ({states}, {runs})"
        )
    return np.broadcast_to(given.reshape(states, -1), (states, runs)).copy()


def covariances(name: str, value: ArrayLike, steps: int, size: int) -> Array:
    """Return covariances as (steps, size, size), checked."""
    given = np.asarray(value, dtype=float)
    if given.shape not in ((size, size), (steps, size, size)):
        raise ParameterError(
            name, f"of shape {given.shape}", f"({size}, {size}) or ({steps}, {size}, {size})"
        )
    largest = np.abs(given).max(initial=0.0)
    if not np.isfinite(largest) or not np.allclose(
        given, np.swapaxes(given, -1, -2), rtol=0, atol=1e-9 * largest
    ):
        raise ParameterError(name, "not finite or not symmetric", "a covariance")
    if given.size and np.linalg.eigvalsh(given).min() < -1e-9 * largest:
        raise ParameterError(name, "not positive semidefinite", "a covariance")
    return np.broadcast_to(given, (steps, size, size))
