"""Robust fits, and their uncertainty where errors are correlated within blocks of time."""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol, TypeVar

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

from inswsn_lib.checks import Array, Mask
from inswsn_lib.errors import InswsnError

State = TypeVar("State")

#: Blocks below which a covariance says nothing
FEWEST = 6

_ROUNDING = 1e-6  # of a block
_MOST, _ALWAYS = 20.0, 2e4  # windows for each row, and those that are no matter
_SINGULAR = 1e-10  # of eigenvalues of a scaled information
_ROUNDS, _SAME = 6, 0.02  # of the scale of residuals, and what is no change of it
_FLOOR = 1e-6  # of that scale
_SETTLED, _REACH = 1e-10, 1e4  # of the loss, and how many sizes the first step may go
_FAR = 0.1  # of a size: a way after which the scale is looked at again
_TO_DEVIATION = 1.4826  # from the median of absolute values, of a normal distribution


def interpolate(time: Array, values: Array, at: Array) -> Array:
    """Return values (n, columns) on straight lines between their time stamps."""
    return np.column_stack([np.interp(at, time, x) for x in values.T])


class _Problem(Protocol[State]):
    """Residuals (n,) of a state, their derivatives (n, p), and a state that is a step (p,) off."""

    def residual(self, state: State) -> Array: ...
    def jacobian(self, state: State) -> Array: ...
    def moved(self, state: State, by: Array) -> State: ...


def deviation_of(miss: Array, unknowns: int = 0) -> float:
    """Return the deviation of residuals, by the median of their absolute values."""
    freedom = len(miss) / max(1, len(miss) - unknowns)
    return float(_TO_DEVIATION * np.median(np.abs(miss)) * np.sqrt(freedom))


def fit(
    problem: _Problem[State], state: State, noise: float, sizes: Callable[[float], Array]
) -> tuple[State, float]:
    """Return the state near another with the least soft-l1 loss, and the residuals' deviation.

    That deviation is the loss's scale; first it is `noise`, for which `sizes` says what counts as 1
    in each unknown.
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


def _least(problem: _Problem[State], state: State, noise: float, size: Array) -> Array:
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


def covariance(
    problem: _Problem[State], state: State, noise: float, starts: NDArray[np.intp]
) -> tuple[Array, Mask]:
    """Return the covariance of a fit's unknowns by `jackknife`, and which nothing tells."""
    miss = problem.residual(state)
    weight = 1 / np.sqrt(1 + (miss / noise) ** 2)  # of soft-l1: its derivatives are w e and w^3
    return jackknife(*block_sums(problem.jacobian(state), weight * miss, weight**3, starts))


def spaced(begin: float, end: float, step: float, rows: int) -> Array:
    """Return the times from one to another, as `numpy.arange`; refuse far more than rows."""
    if end - begin > step * max(_ALWAYS, _MOST * rows):
        raise InswsnError(
            f"{rows} rows are spread over {end - begin:.3g} s: a clock was set in between, or time "
            "stamps are not in s."
        )
    return np.arange(begin, end, step)


def block_starts(time: Array, seconds: float) -> NDArray[np.intp]:
    """Return the first row of each block of some seconds, from the first stamp on.

    Blocks without a row are none. Where the time is short there are ten of them.
    """
    length = min(seconds, float(time[-1] - time[0]) / 10)
    cell = np.floor((time - time[0]) / max(length, 1e-9) + _ROUNDING)
    cell = np.minimum(cell, cell[-1] - (cell[-1] > 9))  # the last stamp begins no block of its own
    return np.flatnonzero(np.diff(cell, prepend=-1.0))


def block_sums(
    jacobian: Array, push: Array, weight: Array, starts: NDArray[np.intp]
) -> tuple[Array, Array]:
    """Return the information (blocks, p, p) and the gradient (blocks, p) of each block.

    Of residuals e with the derivatives J and a loss with the derivatives psi and psi', they are the
    sums of psi' J J' and of psi J.
    """
    ends = [*starts[1:].tolist(), len(push)]
    parts = [slice(a, b) for a, b in zip(starts.tolist(), ends, strict=True)]
    information = [(jacobian[p] * weight[p, None]).T @ jacobian[p] for p in parts]
    return np.array(information), np.array([push[p] @ jacobian[p] for p in parts])


def jackknife(information: Array, gradient: Array) -> tuple[Array, Mask]:
    r"""Return the covariance (p, p) of an estimate, and which unknowns nothing or one block tells.

    Errors of one block may hang together in any way; those of two are taken for independent, so
    blocks have to be longer than errors last. The estimate without block g differs by
    :math:`(A - A_g)^{-1} s_g` to first order, and

    .. math:: V = \frac{G - 1}{G} \sum_g (A - A_g)^{-1} s_g s_g' (A - A_g)^{-1}.

    This is the covariance by clusters (Liang and Zeger 1986), in the form CR3, which is not too
    small when the clusters are few (MacKinnon, Nielsen and Webb 2023; a jackknife by blocks in
    time is Künsch's, 1989). Unknowns that are lost with a block have NaN. The information of each
    block, A_g of the sum A, is (G, p, p), its gradient at the estimate, s_g, (G, p).
    """
    size = np.sqrt(np.maximum(np.diagonal(information.sum(axis=0)), 1e-300))
    scaled = information / (size[:, None] * size)
    without = scaled.sum(axis=0) - scaled
    values, vectors = np.linalg.eigh(without)
    gone = values <= np.maximum(_SINGULAR * values[:, -1:], 1e-300)
    lost: Mask = ((gone[:, None, :] * vectors**2).sum(axis=2) > 0.01).any(axis=0)
    inverse = np.where(gone, 0.0, 1 / np.where(gone, 1.0, values))
    along = np.einsum("gji,gj->gi", vectors, gradient / size) * inverse
    moved = np.einsum("gij,gj->gi", vectors, along) / size
    count = len(gradient)
    covariance = (count - 1) / count * moved.T @ moved
    covariance[lost], covariance[:, lost] = np.nan, np.nan
    return covariance, lost
