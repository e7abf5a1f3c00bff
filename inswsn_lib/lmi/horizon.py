"""Worst-case gains over a finite horizon, what attains them, and the filter that can be built."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.linalg import LinAlgError, cho_factor, cho_solve

from inswsn_lib.errors import ParameterError
from inswsn_lib.lmi.norms import (
    checked_relative,
    checked_system,
    matrix_of,
    multipliers,
    of_size_one,
    seen_through,
)
from inswsn_lib.models import ErrorModel

Array = NDArray[np.float64]

# The feedback is computed this far above the gain, where the recursion still holds.
_ABOVE = 1e-9
# Between these a gain has a square that is a number.
_LOWEST, _HIGHEST = 1e-100, 1e100
# Steps of which all courses of the jitter are still few.
_ENUMERATED = 8


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

    Examples
    --------
    From a disturbance of one, the feedback makes the second: their ratio is the one of the right
    singular vector of the map of two steps, the golden ratio less 1:

    >>> from inswsn_lib.lmi import worst_disturbance
    >>> one, zero = [[1.0]], [[0.0]]
    >>> worst = worst_disturbance(one, zero, one, one, steps=2)
    >>> print(f"{worst.gain:.4f}, {worst.feedback.item():.4f}")
    1.6180, 0.6180
    """

    gain: float
    first: Array
    feedback: Array


def finite_horizon_gain(
    A: ArrayLike, E: ArrayLike, B: ArrayLike, L: ArrayLike, steps: int, relative: float = 1e-9
) -> float:
    r"""Return the worst-case gain of a system with multiplicative noise over a finite horizon.

    The plant is :math:`x_{k+1} = (A + E\beta_k) x_k + B s_k`, :math:`z_k = L x_k`, from
    :math:`x_0 = 0`, with :math:`\beta_k` white of unit variance and :math:`s_k` a function of what
    has happened before. The gain is the least g with

    .. math::
        \mathbb{E} \sum_{k=0}^{N} |z_k|^2 \le g^2\, \mathbb{E} \sum_{k=0}^{N-1} |s_k|^2 .

    It is the least g for which, from :math:`P_N = L'L` backwards,

    .. math::
        P_k = A'P_{k+1}A + E'P_{k+1}E + L'L
        + A'P_{k+1}B\,(g^2 I - B'P_{k+1}B)^{-1} B'P_{k+1}A

    keeps :math:`g^2 I - B'P_{k+1}B` positive definite: by dynamic programming,
    :math:`x'P_k x` is the largest energy of z from step k on less what s costs. No stability is
    needed.

    Parameters
    ----------
    A, E, B, L : array_like, (n, n), (n, n) or (k, n, n), (n, p), (l, n)
        The system; E may be a stack of k matrices, one for each of k independent multiplicative
        noises.
    steps : int
        N, 1 or more.
    relative : float
        Relative accuracy.

    Returns
    -------
    float
        The gain, from above.

    Raises
    ------
    ParameterError
        If a shape does not fit, an entry is not finite, or there is no step.

    Examples
    --------
    A sum of disturbances, over one step and over two. Over two the map is [[1, 0], [1, 1]], whose
    norm is the golden ratio:

    >>> from inswsn_lib.lmi import finite_horizon_gain
    >>> one, zero = [[1.0]], [[0.0]]
    >>> for steps in (1, 2):
    ...     print(f"{finite_horizon_gain(one, zero, one, one, steps):.4f}")
    1.0000
    1.6180
    """
    A, B, L = checked_system(A, B, L)
    E = multipliers(E, len(A))
    _check_steps(steps)
    checked_relative(relative)
    B, L, size = of_size_one(B, L)
    if size == 0:
        return 0.0
    low = float(np.linalg.norm(L @ B, 2))  # what one step does
    high = max(low, _LOWEST)
    while _backwards(A, E, B, L, steps, high) is None:
        low, high = high, 2 * high
        if high > _HIGHEST:
            raise ParameterError("steps", steps, "so few that the gain is a number")
    while high > low * (1 + relative):
        middle = (low + high) / 2
        if _backwards(A, E, B, L, steps, middle) is None:
            low = middle
        else:
            high = middle
    return high * size


def enumerated_gain(A: ArrayLike, E: ArrayLike, B: ArrayLike, L: ArrayLike, steps: int) -> float:
    r"""Return the gain over a few steps from all courses of the jitter, without any recursion.

    With :math:`\beta_k = \pm 1`, each with the probability one half, there are
    :math:`2^N` courses. The disturbance of step k is one vector for each course up to then, and
    the outputs are a linear map of all these vectors, each weighted by the root of the probability
    of its course. The gain is the largest singular value of that map. It depends on the first two
    moments of :math:`\beta_k` only, so it is that of `finite_horizon_gain`.

    Parameters
    ----------
    A, E, B, L : array_like, (n, n), (n, n), (n, p), (l, n)
        The system of `finite_horizon_gain`, with one multiplicative noise.
    steps : int
        N, from 1 to 8: the map has about :math:`2^N p` columns.

    Returns
    -------
    float
        The gain, the root of a quotient of energies.

    Raises
    ------
    ParameterError
        If a shape does not fit, or the number of steps is not in that range.

    Examples
    --------
    The recursion and the enumeration agree:

    >>> from inswsn_lib.lmi import enumerated_gain, finite_horizon_gain
    >>> one, half = [[1.0]], [[0.5]]
    >>> for gain in (enumerated_gain, finite_horizon_gain):
    ...     print(f"{gain(one, half, one, one, 6):.6f}")
    5.116001
    5.116001
    """
    A, B, L = checked_system(A, B, L)
    stack = multipliers(E, len(A))
    if len(stack) != 1:
        raise ParameterError("E", f"a stack of {len(stack)}", "one matrix")
    _check_steps(steps)
    if steps > _ENUMERATED:
        raise ParameterError("steps", steps, f"from 1 to {_ENUMERATED}")
    inputs, columns = B.shape[1], B.shape[1] * (2**steps - 1)
    states = np.zeros((1, len(A), columns))  # of each course so far, as a map of all inputs
    rows, first = [], 0
    for k in range(steps):
        weight = 2.0 ** (k / 2)  # one over the root of the probability: inputs of unit energy
        push = np.zeros((len(states), len(A), columns))
        for course in range(len(states)):
            there = slice(first + course * inputs, first + (course + 1) * inputs)
            push[course, :, there] = weight * B
        first += len(states) * inputs
        states = np.concatenate([(A + sign * stack[0]) @ states + push for sign in (1, -1)])
        rows.append((L @ states).reshape(-1, columns) / 2.0 ** ((k + 1) / 2))
    return float(np.linalg.norm(np.vstack(rows), 2))


def worst_disturbance(
    A: ArrayLike, E: ArrayLike, B: ArrayLike, L: ArrayLike, steps: int
) -> WorstCase:
    r"""Return the disturbance that attains `finite_horizon_gain`.

    From :math:`x_0 = 0` the first disturbance goes in the direction of the largest eigenvalue of
    :math:`B'P_1B`. Then :math:`s_k = (g^2 I - B'P_{k+1}B)^{-1} B'P_{k+1}A\, x_k`, a feedback of the
    state that the disturbance has made so far.

    Parameters
    ----------
    A, E, B, L : array_like, (n, n), (n, n) or (k, n, n), (n, p), (l, n)
        The system of `finite_horizon_gain`.
    steps : int
        N, 1 or more.

    Returns
    -------
    WorstCase
        The gain, and the disturbance that attains it.

    Raises
    ------
    ParameterError
        As `finite_horizon_gain`.

    Examples
    --------
    Played back, the disturbance attains the gain:

    >>> import numpy as np
    >>> from inswsn_lib.lmi import worst_disturbance
    >>> worst = worst_disturbance([[1.0]], [[0.0]], [[1.0]], [[1.0]], steps=2)
    >>> s0 = worst.first.item()
    >>> x1 = s0
    >>> s1 = worst.feedback.item() * x1
    >>> x2 = x1 + s1
    >>> print(f"{np.hypot(x1, x2) / np.hypot(s0, s1):.4f}, {worst.gain:.4f}")
    1.6180, 1.6180
    """
    gain = finite_horizon_gain(A, E, B, L, steps)
    A, B, L = checked_system(A, B, L)
    inputs, push = B.shape[1], float(np.abs(B).max())
    if gain == 0:
        return WorstCase(gain, np.eye(inputs)[0], np.zeros((steps - 1, inputs, len(A))))
    B, L, size = of_size_one(B, L)
    found = _backwards(A, multipliers(E, len(A)), B, L, steps, gain / size * (1 + _ABOVE))
    assert found is not None  # the gain is the least for which it is not
    P, feedback = found
    # the state is in units of the largest entry of B
    return WorstCase(gain, np.linalg.eigh(B.T @ P @ B)[1][:, -1], feedback / push)


def _check_steps(steps: int) -> None:
    if isinstance(steps, bool) or not isinstance(steps, int | np.integer) or steps < 1:
        raise ParameterError("steps", steps, "a whole number, 1 or more")


def _backwards(
    A: Array, E: Array, B: Array, L: Array, steps: int, gain: float
) -> tuple[Array, Array] | None:
    """Return P_1 and the feedbacks of steps 1, 2, ..., or None if the gain is too small."""
    P = L.T @ L
    feedback: list[Array] = []
    for k in range(steps):
        PB = P @ B
        try:
            factor = cho_factor(gain**2 * np.eye(B.shape[1]) - B.T @ PB)
        except (LinAlgError, ValueError):  # not positive definite, or not finite
            return None
        if k == steps - 1:
            return P, np.array(feedback[::-1]).reshape(steps - 1, B.shape[1], len(A))
        BPA = PB.T @ A
        feedback.append(cho_solve(factor, BPA))
        P = A.T @ P @ A + seen_through(P, E) + L.T @ L + BPA.T @ feedback[-1]
        P = (P + P.T) / 2
    return None


def buildable_system(model: ErrorModel, gain: ArrayLike) -> tuple[Array, Array, Array, Array]:
    r"""Return the error system of the filter that can be built, which does not know the jitter.

    With :math:`A_f = A - B_f C` (P1 2.25) the error obeys, beside the state itself,

    .. math::
        e^+ = (A - B_f C)\, e + E\beta\, x + B w - B_f D v, \qquad x^+ = (A + E\beta)\, x + B w,
        \qquad z = L e .

    The jitter multiplies the state and not its error, other than in (2.11).

    Parameters
    ----------
    model : ErrorModel
        The model.
    gain : array_like, (n, m)
        B_f.

    Returns
    -------
    A, E, B, L : ndarray, (2n, 2n), (2n, 2n), (2n, p + q), (l, 2n)
        For the state (e, x) and the disturbance (w, v).

    Raises
    ------
    ParameterError
        If the gain has another shape, or an entry that is not finite.

    Examples
    --------
    The jitter of :math:`\beta E` drives the error through the state, in the right half of E:

    >>> from inswsn_lib.lmi import buildable_system
    >>> from inswsn_lib.models import ErrorModel
    >>> model = ErrorModel(A=[[0.9]], B=[[1]], C=[[1]], D=[[1]], L=[[1]], E=[[0.1]], period=1.0)
    >>> A, E, B, L = buildable_system(model, [[0.5]])
    >>> A.round(3).tolist()
    [[0.4, 0.0], [0.0, 0.9]]
    >>> E.tolist()
    [[0.0, 0.1], [0.0, 0.1]]
    """
    B_f, n = matrix_of("gain", gain), len(model.A)
    if B_f.shape != (n, len(model.C)):
        raise ParameterError("gain", f"of shape {B_f.shape}", f"({n}, {len(model.C)})")
    zero = np.zeros((n, n))
    return (
        np.block([[model.A - B_f @ model.C, zero], [zero, model.A]]),
        np.block([[zero, model.E], [zero, model.E]]),
        np.block([[model.B, -B_f @ model.D], [model.B, np.zeros((n, model.D.shape[1]))]]),
        np.hstack([model.L, np.zeros_like(model.L)]),
    )
