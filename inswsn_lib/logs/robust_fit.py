"""Unknowns that make a robust loss least, and their covariance by blocks of time."""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol, TypeVar

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

from inswsn_lib.checks import Array, Mask
from inswsn_lib.logs.blocks import block_sums, jackknife

State = TypeVar("State")

_ROUNDS, _SAME = 6, 0.02  # of the scale of residuals, and what is no change of it
_FLOOR = 1e-6  # of that scale
_SETTLED, _REACH = 1e-10, 1e4  # of the loss, and how many sizes the first step may go
_FAR = 0.1  # of a size: a way after which the scale is looked at again
_NULL = 1e-9  # of the singular values of the scaled Jacobian
_TO_DEVIATION = 1.4826  # from the median of absolute values, of a normal distribution


class Problem(Protocol[State]):
    """Residuals (n,) of a state, their derivatives (n, p), and a state that is a step (p,) off."""

    def residual(self, state: State) -> Array:
        """Return what was measured less what should have been."""

    def jacobian(self, state: State) -> Array:
        """Return the derivatives of the residuals by a step from a state."""

    def moved(self, state: State, by: Array) -> State:
        """Return the state after a step."""


def deviation_of(miss: Array, unknowns: int = 0) -> float:
    """Return the deviation of residuals, by the median of their absolute values."""
    freedom = len(miss) / max(1, len(miss) - unknowns)
    return float(_TO_DEVIATION * np.median(np.abs(miss)) * np.sqrt(freedom))


def fit(
    problem: Problem[State], state: State, noise: float, sizes: Callable[[float], Array]
) -> tuple[State, float]:
    """Return the state that makes the soft-l1 loss least, and the deviation of the residuals.

    Parameters
    ----------
    problem : Problem
    state : State
        Where the search begins.
    noise : float
        The first scale of the loss; later it is the residuals' own deviation.
    sizes : callable
        Gives for a noise what counts as 1 in each unknown.
    """
    noise = max(noise, _FLOOR)
    for _ in range(_ROUNDS):
        size = sizes(noise)
        way = _least(problem, state, noise, size)
        state, moved = problem.moved(state, way * size), float(np.abs(way).max())
        before, noise = noise, max(deviation_of(problem.residual(state), len(size)), _FLOOR)
        if abs(noise / before - 1) < _SAME and moved < _FAR:
            break
    return state, noise


def _least(problem: Problem[State], state: State, noise: float, size: Array) -> Array:
    """Return the way from a state to where the loss is least, in sizes of the unknowns."""

    def residual(way: Array) -> Array:
        return problem.residual(problem.moved(state, way * size))

    def jacobian(way: Array) -> Array:
        return problem.jacobian(problem.moved(state, way * size)) * size

    found = least_squares(
        residual, np.zeros(len(size)), jacobian, loss="soft_l1", f_scale=noise, x_scale=_REACH,
        ftol=_SETTLED, xtol=_SETTLED**0.5, gtol=1e-15,
    )  # fmt: skip
    return np.asarray(found.x)


def _soft(miss: Array, noise: float) -> tuple[Array, Array]:
    """Return the first and the second derivative of half the loss by each residual."""
    weight = 1 / np.sqrt(1 + (miss / noise) ** 2)
    return weight * miss, weight**3


def covariance(
    problem: Problem[State], state: State, noise: float, size: Array, starts: NDArray[np.intp]
) -> tuple[Array, Mask]:
    """Return the covariance of the unknowns by blocks of rows, and which nothing tells.

    An unknown is told by nothing if the residuals do not depend on it, alone or with others: if it
    has a part in a right singular vector of the Jacobian, its columns scaled by the sizes, whose
    singular value is nil beside the largest; or if it is told by one block alone.
    """
    jacobian = problem.jacobian(state) * size
    push, bend = _soft(problem.residual(state), noise)
    found, lost = jackknife(*block_sums(jacobian, push, bend, starts))
    _, values, right = np.linalg.svd(np.linalg.qr(jacobian, mode="r"))
    gone = values <= _NULL * max(float(values[0]), 1e-300)
    lost |= np.sum(right[gone] ** 2, axis=0) > 1e-3
    return np.asarray(found * np.outer(size, size)), lost
