"""Worst-case gains of systems with multiplicative noise, over all time and over a finite horizon.

None of them knows of a convex problem: they certify what comes of one.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache
from itertools import islice
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.linalg import lapack

from inswsn_lib.checks import Array, array, matrices, number, whole
from inswsn_lib.errors import Described, ParameterError
from inswsn_lib.kernels import choose
from inswsn_lib.lmi.norms import hinf_norm, least_level, of_size_one

_HIGHEST = 1e100  # of a gain, whose square must be a number
# How often a gain may be double what is known of it: over all time, and over a horizon, where it is
# sought from a smallest number on.
_DOUBLINGS, _DOUBLINGS_FROM_NOTHING, _NOTHING = 12, 400, 1e-100
# How many policies are tried, and which change of the value is none
_POLICIES, _STILL = 200, 1e-10
# and, of what the state is worth at most, which share is rounding
_ROUNDED = 1e-13
# A plant as near to instability is taken as unstable: the equation is singular to rounding
_EDGE = 1e-14
# The disturbance is computed this far above the gain, where the recursion still holds.
_ABOVE = 1e-9


def mean_square_radius(A: ArrayLike, E: ArrayLike) -> float:
    """Return the spectral radius of A (x) A + E (x) E: below 1 for mean-square stability.

    Parameters
    ----------
    A, E : array_like, (n, n), (n, n) or (k, n, n)
        Of the plant x+ = (A + E beta) x, with beta white of unit variance; the terms of a stack of
        independent multiplicative noises add.

    Raises
    ------
    ParameterError
        If a shape does not fit, or an entry is not finite.

    Examples
    --------
    Stable without the noise, and in the mean square only while :math:`a^2 + e^2 < 1`:

    >>> import inswsn_lib as iw
    >>> print([f"{iw.lmi.mean_square_radius([[0.9]], [[e]]):.2f}" for e in (0.3, 0.5)])
    ['0.90', '1.06']
    """
    (A,) = matrices(A=(A, "nn"))
    return _radius(_moves(np.concatenate([A[None], _stack(E, len(A))])))


def stochastic_gain(
    A: ArrayLike, E: ArrayLike, B: ArrayLike, L: ArrayLike, relative: float = 1e-6
) -> float:
    r"""Return the gain of a system with multiplicative noise, by bisection.

    The plant is :math:`x^+ = (A + \sum_i E_i\beta_i) x + B s`, :math:`z = L x`, with
    :math:`\beta_i` white of unit variance and independent of one another. The recursion

    .. math::
        P^+ = A'PA + \sum_i E_i'PE_i + L'L + A'PB (g^2 I - B'PB)^{-1} B'PA

    from :math:`P = L'L` rises. If the plant is mean-square stable, it converges with
    :math:`g^2 I - B'PB > 0` for every g above the gain, and for none below it (El Bouhtouri,
    Hinrichsen and Pritchard 1999). Its limit is found by policies, a linear equation each.

    Parameters
    ----------
    A, E, B, L : array_like, (n, n), (n, n) or (k, n, n), (n, p), (l, n)
        The system; E may be a stack of k matrices, one for each multiplicative noise.
    relative : float
        Relative accuracy; not reached near instability, where the result is on the safe side.

    Returns
    -------
    float
        From above; infinite if the system is not mean-square stable.

    Raises
    ------
    ParameterError
        If a shape does not fit, a number is not finite, the plant is too near instability, or
        there is no such accuracy.

    Examples
    --------
    For A = E = 1/2 and B = L = 1 it is :math:`1 + \sqrt 3`, and 2 without the noise:

    >>> import inswsn_lib as iw
    >>> half, one = [[0.5]], [[1.0]]
    >>> print([f"{iw.stochastic_gain(half, jump, one, one):.3f}" for jump in (half, [[0.0]])])
    ['2.732', '2.000']
    """
    A, E, B, L = _system(A, E, B, L)
    number("relative", relative, least=1e-14, below=1)
    if mean_square_radius(A, E) >= 1:
        return float("inf")
    B, L, size = of_size_one(B, L)
    low = hinf_norm(A, B, L)  # beta = 0 in the mean: the gain cannot be smaller
    if low == 0:
        return 0.0
    gain = least_level(
        lambda level: riccati_gain_below(A, E, B, L, level),
        low, low * (1 + relative), relative, _DOUBLINGS,
    )  # fmt: skip
    if gain == np.inf:
        raise ParameterError("A and E", Described("so near it"), "farther from instability")
    return gain * size


def finite_horizon_gain(
    A: ArrayLike, E: ArrayLike, B: ArrayLike, L: ArrayLike, steps: int, relative: float = 1e-9
) -> float:
    r"""Return the worst-case gain of a system with multiplicative noise over a finite horizon.

    From :math:`x_0 = 0`, with a disturbance :math:`s_k` that is a function of what has happened
    before, it is the least g with

    .. math::
        \mathbb{E} \sum_{k=0}^{N} |z_k|^2 \le g^2\, \mathbb{E} \sum_{k=0}^{N-1} |s_k|^2 ,

    for which N steps of the recursion of `stochastic_gain` keep :math:`g^2 I - B'PB` positive
    definite: by dynamic programming, :math:`x'Px` is the largest energy of z from x on less what s
    costs. No stability is needed.

    Parameters
    ----------
    A, E, B, L
        The system of `stochastic_gain`.
    steps : int
        N, 1 or more.
    relative : float
        Relative accuracy, from above.

    Raises
    ------
    ParameterError
        As in `stochastic_gain`; or there is no step, or the gain is no number.

    Examples
    --------
    A sum over two steps is the map [[1, 0], [1, 1]], whose norm is the golden ratio:

    >>> import inswsn_lib as iw
    >>> print(f"{iw.lmi.finite_horizon_gain([[1.0]], [[0.0]], [[1.0]], [[1.0]], steps=2):.4f}")
    1.6180
    """
    A, E, B, L = _system(A, E, B, L)
    whole("steps", steps, 1)
    number("relative", relative, least=1e-14, below=1)
    if not B.any() or not L.any():
        return 0.0
    B, L, size = of_size_one(B, L)
    low = float(np.linalg.norm(L @ B, 2))  # what one step does
    A, E, B, L = (np.ascontiguousarray(matrix) for matrix in (A, E[E.any(axis=(1, 2))], B, L))
    steps_held = choose("horizon_steps")
    gain = least_level(
        lambda level: steps_held(A, E, B, L, level, steps) == steps,
        low, max(low, _NOTHING), relative, _DOUBLINGS_FROM_NOTHING,
    )  # fmt: skip
    if gain == np.inf:
        raise ParameterError("steps", steps, "few enough for the gain to be finite")
    return gain * size


@dataclass(frozen=True, eq=False)
class WorstCase:
    r"""The disturbance that attains the gain over a horizon, from the state zero.

    Attributes
    ----------
    gain : float
        The root of the largest quotient of the energies of z and s.
    first : ndarray, (p,)
        s_0, of unit length.
    feedback : ndarray, (steps - 1, p, n)
        :math:`s_k = F_k x_k` for k = 1, 2, ...
    """

    gain: float
    first: Array
    feedback: Array


def worst_disturbance(
    A: ArrayLike, E: ArrayLike, B: ArrayLike, L: ArrayLike, steps: int
) -> WorstCase:
    r"""Return the disturbance that attains `finite_horizon_gain`.

    From :math:`x_0 = 0` it goes first in the direction of the largest eigenvalue of
    :math:`B'PB`, and then answers the state that it has made so far,
    :math:`s = (g^2 I - B'PB)^{-1} B'PA\, x`, with the P of the step.

    Parameters
    ----------
    A, E, B, L, steps
        As in `finite_horizon_gain`, and so are the errors.

    Returns
    -------
    WorstCase
        With the `gain`, the `first` disturbance and the `feedback` of the later steps.

    Examples
    --------
    Played back over two steps of a sum, it attains the golden ratio:

    >>> import inswsn_lib as iw
    >>> worst = iw.lmi.worst_disturbance([[1.0]], [[0.0]], [[1.0]], [[1.0]], steps=2)
    >>> x1 = s0 = worst.first.item()
    >>> s1 = worst.feedback.item() * x1
    >>> print(f"{((x1**2 + (x1 + s1) ** 2) / (s0**2 + s1**2)) ** 0.5:.4f}, {worst.gain:.4f}")
    1.6180, 1.6180
    """
    gain = finite_horizon_gain(A, E, B, L, steps)
    A, E, B, L = _system(A, E, B, L)
    if gain == 0:
        inputs = B.shape[1]
        return WorstCase(gain, np.eye(inputs)[0], np.zeros((steps - 1, inputs, len(A))))
    push, (B, L, size) = np.abs(B).max(), of_size_one(B, L)
    *later, (P, _) = _first(steps, A, E, B, L, gain / size * (1 + _ABOVE))
    feedback = np.array([F for _, F in reversed(later)]).reshape(-1, B.shape[1], len(A))
    # the state is in units of the largest entry of B
    return WorstCase(gain, np.linalg.eigh(B.T @ P @ B)[1][:, -1], feedback / push)


def riccati_gain_below(A: Array, E: Array, B: Array, L: Array, gain: float) -> bool:
    r"""Tell whether a system is mean-square stable with a gain below a number.

    The fixed point of the recursion of `stochastic_gain` is sought by policies: of a feedback
    :math:`s = Fx`, at first none, the value P solves a linear equation; the feedback that is best
    against P is the next. The values rise to the fixed point, in a few steps. There is none if a
    policy destroys stability, or a disturbance costs less than it gains.
    """
    E = _stack(E, len(A))
    B, L, size = of_size_one(B, L)
    level = min(gain / size, _HIGHEST) ** 2 * np.eye(B.shape[1])
    jitter, turned = _moves(E), _symmetric(len(A))
    feedback, before, sizes = np.zeros(B.shape[::-1]), None, np.empty(len(A))
    for _ in range(_POLICIES):
        closed = A + B @ feedback
        moves = _moves(closed[None]) + jitter
        if not (np.isfinite(moves).all() and _radius(moves) < 1 - _EDGE):
            return False
        eye, value = np.eye(len(moves)), L.T @ L - feedback.T @ level @ feedback
        P = _matrix(np.linalg.solve(eye - moves.T, turned.T @ value.ravel()))
        if before is None:  # how far white noise drives each state
            spread = _matrix(np.linalg.solve(eye - moves, turned.T @ (B @ B.T).ravel()))
            sizes = np.sqrt(np.maximum(spread.diagonal(), 0.0))
        else:
            # entry by entry, since a mode that L hardly sees may still move; but one that it does
            # not see at all is rounding, beside what driven states are worth
            moved = np.abs(P - before) * np.outer(sizes, sizes)
            worth = np.sqrt(np.abs(P.diagonal())) * sizes
            if (moved <= _STILL * np.outer(worth, worth) + _ROUNDED * worth.max() ** 2).all():
                return True
        factor, failed = lapack.dpotrf(level - B.T @ P @ B)
        if failed:
            return False
        feedback, before = lapack.dpotrs(factor, B.T @ P @ A)[0], P
    return False


def _moves(E: Array) -> Array:
    r"""Return the map of X to :math:`\sum_i E_i X E_i'` for symmetric X, (n(n+1)/2, n(n+1)/2)."""
    n, turned = E.shape[1], _symmetric(E.shape[1])
    full = np.einsum("kij,kab->iajb", E, E).reshape(n * n, -1)
    return np.asarray(turned.T @ full @ turned)


def _radius(moves: Array) -> float:
    return float(np.abs(np.linalg.eigvals(moves)).max())


@cache
def _symmetric(n: int) -> Array:
    """Return an orthonormal basis of the symmetric matrices, (n^2, n(n+1)/2)."""
    basis = np.zeros((n, n, n * (n + 1) // 2))
    for each, (i, j) in enumerate(zip(*np.triu_indices(n), strict=True)):
        basis[i, j, each] = basis[j, i, each] = 1.0 if i == j else 0.5**0.5
    return basis.reshape(n * n, -1)


def _matrix(coordinates: NDArray[Any]) -> Array:
    """Return a symmetric matrix from its coordinates in that basis."""
    n = int((2 * len(coordinates)) ** 0.5)
    return np.asarray((_symmetric(n) @ coordinates).reshape(n, n))


def _recursion(
    A: Array, E: Array, B: Array, L: Array, gain: float
) -> Iterator[tuple[Array, Array]]:
    """Give P and the worst feedback, step by step, until a disturbance costs less than it gains."""
    P, source, level = L.T @ L, L.T @ L, gain**2 * np.eye(B.shape[1])
    while np.isfinite(P).all():
        PB = P @ B
        # LAPACK itself: what SciPy checks before it calls these takes most of an iteration
        factor, failed = lapack.dpotrf(level - B.T @ PB)
        if failed:
            return
        BPA = PB.T @ A
        feedback = lapack.dpotrs(factor, BPA)[0]
        yield P, feedback
        jitter = (E.transpose(0, 2, 1) @ P @ E).sum(axis=0)
        P = A.T @ P @ A + jitter + source + BPA.T @ feedback
        P = (P + P.T) / 2


def _first(
    steps: int, A: Array, E: Array, B: Array, L: Array, gain: float
) -> list[tuple[Array, Array]]:
    """Return so many steps of the recursion, or fewer if it ends before."""
    with np.errstate(over="ignore", invalid="ignore"):  # of a gain that is no number
        return list(islice(_recursion(A, E, B, L, gain), steps))


def _system(
    A: ArrayLike, E: ArrayLike, B: ArrayLike, L: ArrayLike
) -> tuple[Array, Array, Array, Array]:
    """Return the matrices of a system, E as a stack (k, n, n); refuse those that do not fit."""
    A, B, L = matrices(A=(A, "nn"), B=(B, "np"), L=(L, "ln"))
    return A, _stack(E, len(A)), B, L


def _stack(E: ArrayLike, n: int) -> Array:
    return array("E", E, (n, n), ("k", n, n)).reshape(-1, n, n)
