"""What filters share: first states, missing data, gains for what is there, patterns of clusters."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from inswsn_lib.checks import Array, Back, Mask, array, covariance, mask, of_runs
from inswsn_lib.errors import Described, ParameterError

#: Which clusters hear the blind node
Pattern = tuple[bool, ...]
_Given = TypeVar("_Given")
_Kind = TypeVar("_Kind", bound=np.generic)

_MOST_PARTS = 62  # bits of an int64


def first_state(value: ArrayLike | None, states: int, runs: int) -> Array:
    """Return the first state of every run, (states, runs); zero by default."""
    if value is None:
        return np.zeros((states, runs))
    given = array("initial_state", value, (states,), (states, runs))
    return np.broadcast_to(given.reshape(states, -1), (states, runs))


def over_steps(
    name: str,
    value: ArrayLike | None,
    default: Array,
    steps: int,
    check: Callable[..., Array] = covariance,
) -> Array:
    """Return the matrix of each step, from one for all, one for each, or the default."""
    shape = steps, *default.shape
    given = check(name, default if value is None else value, default.shape, shape)
    return np.broadcast_to(given, shape)


def once(values: NDArray[_Kind]) -> NDArray[_Kind]:
    """Return values (..., runs) as (..., 1) where all runs share them."""
    return values[..., :1] if (values == values[..., :1]).all() else values


def measured(value: ArrayLike, *shape: int | str) -> tuple[Mask, Array, Back]:
    """Return which of measurements (..., runs) are there, and all with zero for the others.

    The first is (..., 1) where all runs miss the same. The last is that of `of_runs`.
    """
    try:  # one look at all of them tells that none is missing
        y, back = of_runs("measurements", value, *shape)
    except ParameterError:
        y, back = of_runs("measurements", value, *shape, gaps=True)
        there = ~np.isnan(y)
        return once(there), np.where(there, y, 0.0), back
    return np.ones((*y.shape[:-1], 1), dtype=bool), y, back


def times(matrices: Array, vectors: Array) -> Array:
    """Return the products of matrices (1 or runs, i, j) with the vectors (j, runs) of runs."""
    if len(matrices) == 1:
        return np.asarray(matrices[0] @ vectors)
    return np.asarray((matrices @ vectors.T[:, :, None])[:, :, 0].T)


def sandwiched(M: Array, P: Array) -> Array:
    """Return M P M' (filters, m, m) of symmetric P (filters, n, n), as two products of all."""
    (m, n), count = M.shape, len(P)
    half = (P.reshape(count * n, n) @ M.T).reshape(count, n, m)
    turned = np.ascontiguousarray(np.swapaxes(half, 1, 2))
    return np.asarray((turned.reshape(count * m, n) @ M.T).reshape(count, m, m))


def each_step(which: NDArray[np.intp]) -> list[NDArray[np.intp]]:
    """Return the rows of (steps, runs), each (1,) where all runs share it."""
    shared = (which == which[:, :1]).all(axis=1)
    return [row[:1] if same else row for row, same in zip(which, shared, strict=True)]


def solve_present(there: Mask, S: Array, right: Array) -> Array:
    """Return S^-1 right (filters, m, .) over the components there (filters, m); zero elsewhere."""
    if not there.all():
        both = there[:, :, None] & there[:, None, :]
        # a component that is missing gets a row and a column of the identity
        S = np.where(both, S, np.eye(S.shape[-1]))
        right = np.where(there[:, :, None], right, 0.0)
    try:
        return np.asarray(np.linalg.solve(S, right))
    except np.linalg.LinAlgError:
        raise certain_innovation() from None


def certain_innovation() -> ParameterError:
    """Return the error for an innovation that has no variance."""
    got = Described("such that an innovation has no variance")
    return ParameterError("measurement_covariance", got, "positive definite")


def occurring(there: Mask) -> tuple[Mask, NDArray[np.intp]]:
    """Return the patterns (patterns, parts) in a mask (parts, ...), and which is where (...)."""
    parts = len(there)
    if parts > _MOST_PARTS:
        must_be = f"of at most {_MOST_PARTS} clusters, or components of a cluster"
        raise ParameterError("measurements", parts, must_be)
    bits = 1 << np.arange(parts, dtype=np.int64)
    codes = np.tensordot(bits, there, axes=1)
    found = np.unique(codes)
    return (found[:, None] & bits) > 0, np.searchsorted(found, codes)


def by_pattern(
    name: str, given: Mapping[Pattern, _Given], occur: Mask
) -> list[tuple[int, Pattern, _Given]]:
    """Return place, pattern and what is given for it, of each that occurs (patterns, clusters).

    For the pattern of no cluster nothing is asked.
    """
    known = {as_pattern(name, key, occur.shape[1]): value for key, value in given.items()}
    wanted = [(place, tuple(row)) for place, row in enumerate(occur.tolist()) if any(row)]
    for _, pattern in wanted:
        if pattern not in known:
            got = Described(f"without {pattern}")
            raise ParameterError(name, got, "given for every pattern that occurs")
    return [(place, pattern, known[pattern]) for place, pattern in wanted]


def as_pattern(name: str, given: Pattern, clusters: int) -> Pattern:
    """Return a pattern as a tuple of bools."""
    return tuple(mask(name, given, (clusters,)).tolist())
