"""What all filters ask of their input."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from inswsn_lib.errors import ParameterError

Array = NDArray[np.float64]

_ROUNDING = 1e-9  # of covariances, as a share of the largest entry of each


def as_floats(name: str, value: ArrayLike, may_be: str) -> Array:
    """Return numbers as an array of floats; refuse what is none, or complex, or of ragged rows."""
    return np.asarray(_as_array(name, value, may_be, "biuf"), dtype=float)


def _as_array(name: str, value: ArrayLike, may_be: str, kinds: str) -> NDArray[Any]:
    """Return an array of one of the kinds of dtype; refuse others."""
    try:
        given = np.asarray(value)
    except (TypeError, ValueError):  # rows of unequal length
        raise ParameterError(name, "no array", may_be) from None
    if given.dtype.kind not in kinds:
        raise ParameterError(name, f"{given.dtype} of shape {given.shape}", may_be)
    return given


def is_one_of(value: object, names: tuple[str, ...]) -> bool:
    """Tell whether a value, of whatever type, is one of some names."""
    return isinstance(value, str) and value in names


def checked_measurements(measurements: ArrayLike, outputs: int) -> Array:
    """Return measurements as (steps, outputs, runs), NaN where missing; refuse others."""
    may_be = f"numbers (steps, {outputs}, runs); one run is runs = 1"
    y = as_floats("measurements", measurements, may_be)
    if y.ndim != 3 or y.shape[1] != outputs:
        raise ParameterError("measurements", f"of shape {y.shape}", may_be)
    with np.errstate(over="ignore", invalid="ignore"):
        whole = bool(np.isfinite(y.sum()))  # a sum is quicker to look at
    if not whole and np.isinf(y).any():
        raise ParameterError("measurements", "infinite", "finite, or NaN where missing")
    return y


def first_state(value: ArrayLike | None, states: int, runs: int) -> Array:
    """Return the first state of every run as (states, runs); zero by default."""
    if value is None:
        return np.zeros((states, runs))
    may_be = f"finite, ({states},) or ({states}, {runs})"
    given = as_floats("initial_state", value, may_be)
    if given.shape not in ((states,), (states, runs)) or not np.isfinite(given).all():
        raise ParameterError("initial_state", f"of shape {given.shape}", may_be)
    return np.broadcast_to(given.reshape(states, -1), (states, runs)).copy()


def covariances(name: str, value: ArrayLike, steps: int, size: int) -> Array:
    """Return covariances as (steps, size, size), each checked by the size of its own entries."""
    may_be = f"numbers ({size}, {size}) or ({steps}, {size}, {size})"
    given = as_floats(name, value, may_be)
    if given.shape not in ((size, size), (steps, size, size)):
        raise ParameterError(name, f"of shape {given.shape}", may_be)
    if not np.isfinite(given).all():
        raise ParameterError(name, "not finite or not symmetric", "a covariance")
    slack = _ROUNDING * np.abs(given).max(axis=(-2, -1), initial=0.0)
    if (np.abs(given - np.swapaxes(given, -1, -2)) > slack[..., None, None]).any():
        raise ParameterError(name, "not finite or not symmetric", "a covariance")
    if given.size and (np.linalg.eigvalsh(given).min(axis=-1) < -slack).any():
        raise ParameterError(name, "not positive semidefinite", "a covariance")
    return np.broadcast_to(given, (steps, size, size))


def checked_clusters(
    measurements: ArrayLike, outputs: int | None = None, clusters: int | None = None
) -> Array:
    """Return measurements of clusters as (N, steps, m, runs), NaN where missing; refuse others."""
    N, m = ("N" if clusters is None else clusters), ("m" if outputs is None else outputs)
    may_be = f"numbers ({N}, steps, {m}, runs); one run is runs = 1"
    y = as_floats("measurements", measurements, may_be)
    wanted = {0: clusters, 2: outputs}
    fits = y.ndim == 4 and all(size in (None, y.shape[axis]) for axis, size in wanted.items())
    if not fits or not len(y):
        raise ParameterError("measurements", f"of shape {y.shape}", may_be)
    if np.isinf(y).any():
        raise ParameterError("measurements", "infinite", "finite, or NaN where missing")
    return y


def cluster_covariances(name: str, value: ArrayLike, clusters: int, steps: int, size: int) -> Array:
    """Return one covariance a cluster as (clusters, 1 or steps, size, size), positive definite."""
    shapes = (clusters, size, size), (clusters, steps, size, size)
    may_be = f"numbers {shapes[0]} or {shapes[1]}"
    given = as_floats(name, value, may_be)
    if given.shape not in shapes:
        raise ParameterError(name, f"of shape {given.shape}", may_be)
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


def as_bools(name: str, value: ArrayLike, may_be: str) -> NDArray[np.bool_]:
    """Return an array of bools; refuse others."""
    return _as_array(name, value, may_be, "b")


def checked_mask(name: str, value: ArrayLike, shape: tuple[int, ...]) -> NDArray[np.bool_]:
    """Return an array of bools of a shape; refuse others."""
    may_be = f"bool of shape {shape}"
    mask = as_bools(name, value, may_be)
    if mask.shape != shape:
        raise ParameterError(name, f"{mask.dtype} of shape {mask.shape}", may_be)
    return mask
