"""Norms of linear systems from their frequency response, and searches that other gains share."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.linalg import eigvals

from inswsn_lib.checks import Array, array, matrices, number

_ON_CIRCLE = 1e-7
# of a sweep over frequencies: first points, and how often peaks are refined; for a start, less
_SWEEP, _ZOOMS, _START = 512, 4, (64, 0)
_REFINED, _ZOOM = 8, 33  # peaks, and points for each


def spectral_radius(A: ArrayLike) -> float:
    """Return the largest modulus of the eigenvalues of a square matrix.

    Parameters
    ----------
    A : array_like, (n, n)

    Raises
    ------
    ParameterError
        If it is not square or not finite.

    Examples
    --------
    >>> import inswsn_lib as iw
    >>> print(f"{iw.spectral_radius([[0.0, 0.25], [-1.0, 0.0]]):.3f}")  # eigenvalues +- 0.5 j
    0.500
    """
    (matrix,) = matrices(A=(A, "nn"))
    return float(np.abs(np.linalg.eigvals(matrix)).max())


def largest_singular_value(A: ArrayLike, B: ArrayLike, C: ArrayLike, angles: ArrayLike) -> Array:
    r"""Return the largest singular value of :math:`C (e^{j\omega} I - A)^{-1} B`.

    Parameters
    ----------
    A, B, C : array_like, (n, n), (n, p), (l, n)
    angles : array_like, (k,)
        Frequencies, radians per sample.

    Returns
    -------
    ndarray, (k,)

    Raises
    ------
    ParameterError
        If a shape does not fit, or an entry is not finite.

    Examples
    --------
    :math:`1 / (z - 1/2)` at z = 1 and at z = -1:

    >>> import inswsn_lib as iw
    >>> iw.lmi.largest_singular_value([[0.5]], [[1.0]], [[1.0]], [0.0, 3.14159]).round(4).tolist()
    [2.0, 0.6667]
    """
    A, B, C = matrices(A=(A, "nn"), B=(B, "np"), C=(C, "ln"))
    return _sizes(A, B, C, array("angles", angles, ("k",)))


def _sizes(A: Array, B: Array, C: Array, angles: Array) -> Array:
    if len(C) > B.shape[1]:  # the adjoint has the same
        A, B, C = A.T, C.T, B.T
    z = np.exp(1j * angles)[:, None, None]
    response = C @ np.linalg.solve(z * np.eye(len(A)) - A, B)
    # the largest eigenvalue of the square is as exact as the largest singular value, and quicker
    heights = np.abs(response).max(axis=(1, 2), initial=1e-300)
    response = response / heights[:, None, None]
    squares = np.linalg.eigvalsh(response @ response.conj().mT)[:, -1]
    return np.asarray(heights * np.sqrt(np.maximum(squares, 0.0)))


def hinf_norm(A: ArrayLike, B: ArrayLike, C: ArrayLike, relative: float = 1e-10) -> float:
    r"""Return the H-infinity norm of :math:`C (zI - A)^{-1} B`.

    A sweep over frequencies gives a lower bound. At a level above it the pencil

    .. math::
        z \begin{bmatrix} I & -BB'/g^2 \\ 0 & A' \end{bmatrix}
        - \begin{bmatrix} A & 0 \\ -C'C & I \end{bmatrix}

    has eigenvalues on the unit circle exactly at the frequencies at which a singular value is g.
    Between them the level is raised, until there are none (Bruinsma and Steinbuch 1990).

    Parameters
    ----------
    A, B, C
        As in `largest_singular_value`.
    relative : float
        Relative accuracy, from 1e-14 to below 1.

    Returns
    -------
    float
        Infinite if A has an eigenvalue on or outside the unit circle.

    Raises
    ------
    ParameterError
        If shapes do not fit, an entry is not finite, or there is no such accuracy.

    Examples
    --------
    For one state the peak is at the frequency zero: :math:`1 / (1 - 1/2)`:

    >>> import inswsn_lib as iw
    >>> print(f"{iw.hinf_norm([[0.5]], [[1.0]], [[1.0]]):.6f}")
    2.000000
    >>> iw.hinf_norm([[1.0]], [[1.0]], [[1.0]])
    inf
    """
    A, B, C = matrices(A=(A, "nn"), B=(B, "np"), C=(C, "ln"))
    number("relative", relative, least=1e-14, below=1)
    poles = np.linalg.eigvals(A)
    if np.abs(poles).max() >= 1:
        return float("inf")
    B, C, size = of_size_one(B, C)
    level = swept_peak(lambda angles: _sizes(A, B, C, angles), poles, *_START)
    if level == 0:
        return 0.0
    for _ in range(60):
        crossings = _crossings(A, B, C, level * (1 + 2 * relative))
        if crossings.size < 2:
            break
        middles = (crossings + np.roll(crossings, -1)) / 2
        middles[-1] += np.pi  # the last interval reaches over the cut at pi
        before, level = level, max(level, float(_sizes(A, B, C, middles).max()))
        if level <= before * (1 + relative):
            break
    return level * size


def swept_peak(
    sizes: Callable[[Array], Array], poles: NDArray[Any], points: int = _SWEEP, zooms: int = _ZOOMS
) -> float:
    """Return the largest value of a function of frequencies, over a grid with its peaks refined.

    The grid, (k,), has points of its own where `poles` may make a narrow peak.
    """
    width = np.maximum(1 - np.abs(poles), 1e-12)
    near = np.abs(np.angle(poles)) + np.outer([-1, 0, 1], width)
    angles = np.unique(np.clip([*np.linspace(0, np.pi, points), *near.ravel()], 0, np.pi))
    found = sizes(angles)
    best = float(found.max())
    for _ in range(zooms):
        beside = np.pad(found, 1, constant_values=-np.inf)
        peaks = np.flatnonzero((found >= beside[:-2]) & (found >= beside[2:]))
        peaks = peaks[np.argsort(found[peaks])[-_REFINED:]]
        left, right = np.maximum(peaks - 1, 0), np.minimum(peaks + 1, len(angles) - 1)
        angles = np.unique(np.linspace(angles[left], angles[right], _ZOOM))
        found = sizes(angles)
        best = max(best, float(found.max()))
    return best


def _crossings(A: Array, B: Array, C: Array, level: float) -> Array:
    """Return the frequencies, in order, at which a singular value is `level`."""
    n = len(A)
    left, right = np.eye(2 * n), np.eye(2 * n)
    left[:n, :n], left[n:, :n] = A, -C.T @ C
    right[:n, n:], right[n:, n:] = -B @ B.T / level**2, A.T
    values = eigvals(left, right)
    values = values[np.isfinite(values)]
    return np.sort(np.angle(values[np.abs(np.abs(values) - 1) < _ON_CIRCLE]))


def least_level(
    holds: Callable[[float], bool], low: float, high: float, relative: float, doublings: int
) -> float:
    """Return from above the least level at which something holds, which is not below `low`.

    It is infinite if it holds at none of the levels that come from doubling `high`.
    """
    for _ in range(doublings + 1):
        if holds(high):
            break
        low, high = high, 2 * high
    else:
        return float("inf")
    while high > low * (1 + relative):
        middle = (low + high) / 2
        if holds(middle):
            high = middle
        else:
            low = middle
    return high


def of_size_one(B: Array, C: Array) -> tuple[Array, Array, float]:
    """Return input and output matrix over their largest entries, and the product of these.

    A gain is proportional to both, and its square must neither overflow nor vanish.
    """
    b, c = (float(np.abs(matrix).max()) or 1.0 for matrix in (B, C))
    return B / b, C / c, b * c
