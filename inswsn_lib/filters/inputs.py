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


def checked_clusters(
    measurements: ArrayLike, outputs: int | None = None, clusters: int | None = None
) -> Array:
    """Return measurements of clusters as (N, steps, m, runs), NaN where missing; refuse others."""
    y = np.asarray(measurements, dtype=float)
    wanted = {0: clusters, 2: outputs}
    fits = y.ndim == 4 and all(size in (None, y.shape[axis]) for axis, size in wanted.items())
    if not fits or not len(y):
        N, m = ("N" if clusters is None else clusters), ("m" if outputs is None else outputs)
        raise ParameterError(
            "measurements", f"of shape {y.shape}", f"({N}, steps, {m}, runs); one run is runs = 1"
        )
    if np.isinf(y).any():
        raise ParameterError("measurements", "infinite", "finite, or NaN where missing")
    return y


def cluster_covariances(name: str, value: ArrayLike, clusters: int, steps: int, size: int) -> Array:
    """Return one covariance a cluster as (clusters, 1 or steps, size, size), positive definite."""
    given = np.asarray(value, dtype=float)
    shapes = (clusters, size, size), (clusters, steps, size, size)
    if given.shape not in shapes:
        raise ParameterError(name, f"of shape {given.shape}", f"{shapes[0]} or {shapes[1]}")
    flat = given.reshape(-1, size, size)
    covariances(name, flat, len(flat), size)
    return definite(name, flat).reshape(clusters, -1, size, size)


def definite(name: str, value: Array) -> Array:
    """Return symmetric matrices (..., n, n) as they are; refuse those not positive definite."""
    try:
        np.linalg.cholesky(value)
    except np.linalg.LinAlgError:
        raise ParameterError(name, "singular", "positive definite") from None
    return value


def checked_mask(name: str, value: ArrayLike, shape: tuple[int, ...]) -> NDArray[np.bool_]:
    """Return an array of bools of a shape; refuse others."""
    mask = np.asarray(value)
    if mask.dtype != bool or mask.shape != shape:
        raise ParameterError(name, f"{mask.dtype} of shape {mask.shape}", f"bool of shape {shape}")
    return mask
