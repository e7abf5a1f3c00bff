"""The search for positions of least squares from ranges, of many fixes at once."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from inswsn_lib.checks import Array, Mask
from inswsn_lib.kernels import choose

Indices = NDArray[np.intp]

# Iterations (most fixes need five; beside an anchor that is nearer than the noise, it is slow), the
# first damping and that which is stuck, the gradient of what is settled, and how flat is too flat
_LIMITS = 200, 0.1, 1e6, 1e-7, 1e-4


def least_positions(
    place: Array, height: Array, distance: Array, windows: Indices, start: Array,
    scale: float = np.inf, *, saves: float = np.inf,
) -> Array:  # fmt: skip
    r"""Return the positions whose ranges have the least loss, by Levenberg and Marquardt's method.

    Each minimises :math:`\sum_k \rho(r_k - |p - a_k|)` over the ranges of its window, with
    :math:`\rho(e) = e^2`, or with a finite scale c the soft-l1 loss
    :math:`2 c^2 (\sqrt{1 + e^2 / c^2} - 1)`, as weighted least squares (Marquardt 1963). The loss
    never rises, so that an outlier sends none to infinity; it may be a local minimum.

    Parameters
    ----------
    place, height : ndarray, (rows, d) and (rows,)
        Of the anchor of each range, m; the height is that above what is sought.
    distance : ndarray, (rows,)
        m.
    windows : ndarray of int, (windows,)
        The first row of each window; none is empty.
    start : ndarray, (windows, d)
        m.
    scale : float
        c, m.
    saves : float
        What a compiled search saves, s; see `choose`.
    """
    packed = map(np.ascontiguousarray, (place, height, distance, windows, start))
    # a form in numpy for the page: of lesson 1 it takes 0.3 s, the uncompiled kernel 8 s
    run = choose("descend", _descend, saves=saves)
    return np.asarray(run(*packed, float(scale), _LIMITS))


def linear_start(
    place: Array, height: Array, distance: Array, windows: Indices, open_side: Mask,
    *, across: Array | float = 0.0,
) -> Array:  # fmt: skip
    """Return where |p - a_k|^2 = r_k^2 less its mean over k, which is linear in p, is met best.

    Arguments are as in `least_positions`; where a side is open it is the mean of the anchors.
    Where anchors lie in a plane, `across` is n n' of its normal n (windows, d, d), and the position
    is in the plane.
    """
    counts = np.diff(np.append(windows, len(distance)))
    middle = np.add.reduceat(place, windows, axis=0) / counts[:, None]
    apart = place - np.repeat(middle, counts, axis=0)
    # r below the anchor's height, which noise makes, has no horizontal distance
    square = np.sum(apart**2, axis=1) - np.maximum(distance**2 - height**2, 0.0)
    square -= np.repeat(np.add.reduceat(square, windows) / counts, counts)
    A = scatter(place, windows) + across
    A[open_side] = np.eye(A.shape[1])
    right = np.add.reduceat(apart * square[:, None] / 2, windows, axis=0)
    start = middle + np.linalg.solve(A, right[:, :, None])[:, :, 0]
    return np.where(open_side[:, None], middle, start)


def scatter(place: Array, windows: Indices) -> Array:
    """Return how the anchors of each window are spread about their mean, (windows, d, d), m^2."""
    counts = np.diff(np.append(windows, len(place)))
    middle = np.add.reduceat(place, windows, axis=0) / counts[:, None]
    apart = place - np.repeat(middle, counts, axis=0)
    return np.asarray(np.add.reduceat(squares(apart), windows, axis=0))


def squares(direction: Array) -> Array:
    """Return u u' of each row u, (rows, d, d)."""
    columns = direction.T
    return np.asarray(
        np.stack([a * b for a in columns for b in columns], axis=1).reshape(-1, *[len(columns)] * 2)
    )


def _descend(
    place: Array, height: Array, distance: Array, windows: Indices, start: Array, scale: float,
    limits: tuple[float, ...],
) -> Array:  # fmt: skip
    """Return positions as the kernel does, a step of all windows at a time."""
    iterations, damp, stuck, small, flat = limits
    rows, counts = (place, height, distance), np.diff(np.append(windows, len(distance)))
    found, here, left = start.copy(), start.copy(), np.arange(len(start))
    damping, on = np.zeros(len(start)), np.ones(len(start), dtype=bool)
    cost, A, b = _equations(*rows, counts, here, scale)
    for _ in range(int(iterations)):
        tried = here + _steps(A, b, damping, flat)
        new = _equations(*rows, counts, tried, scale)
        better = on & (new[0] < cost)  # what has settled stays, whatever is beside it
        for old, value in zip((here, cost, A, b), (tried, *new), strict=True):
            old[better] = value[better]
        # a step that makes it worse is tried again, shorter
        damping = np.where(better, damping / 10, np.clip(10 * damping, damp, 10 * stuck))
        found[left] = here
        # at an anchor the cost has a cusp: there no step, however short, makes it smaller
        on = (np.abs(b).max(axis=1, initial=0) >= small) & (damping <= stuck)
        if not on.any():
            break
        if on.sum() < len(on) / 2:  # the few that take long need not take the others along
            rows = tuple(each[np.repeat(on, counts)] for each in rows)
            left, counts, here, damping = left[on], counts[on], here[on], damping[on]
            cost, A, b, on = cost[on], A[on], b[on], on[on]
    return found


def _equations(
    place: Array, height: Array, distance: Array, counts: Indices, at: Array, scale: float
) -> tuple[Array, Array, Array]:
    """Return costs (windows,) and the normal equations J'WJ (windows, d, d) and J'We."""
    direction, miss = misses_from(place, height, distance, np.repeat(at, counts, axis=0))
    root = np.sqrt(1 + (miss / scale) ** 2)
    pull = direction / root[:, None]
    windows = np.append(0, np.cumsum(counts)[:-1]) if len(counts) else counts
    # the loss without the cancellation in root - 1
    parts = 2 * miss**2 / (1 + root), pull[:, :, None] * direction[:, None], pull * miss[:, None]
    cost, A, b = (np.add.reduceat(part, windows, axis=0) for part in parts)
    return cost, A, b


def misses_from(place: Array, height: Array, distance: Array, at: Array) -> tuple[Array, Array]:
    """Return directions (rows, d) from anchors, and what ranges have more than distances, m."""
    apart = at - place
    away = np.maximum(np.sqrt(np.sum(apart**2, axis=1) + height**2), 1e-9)
    return apart / away[:, None], distance - away


def _steps(A: Array, b: Array, damping: Array, flat: float) -> Array:
    """Return the damped steps (windows, d); none where without damping it would be unbounded."""
    d = A.shape[1]
    size = np.maximum(np.trace(A, axis1=1, axis2=2), 1e-300)
    stays = (np.linalg.det(A) <= flat * size**d) & (damping <= 1e-9)
    diagonal = damping[:, None] * (1 + np.diagonal(A, axis1=1, axis2=2))
    damped = A + diagonal[:, :, None] * np.eye(d)
    stays |= ~(np.linalg.det(damped) > 0)
    damped[stays] = np.eye(d)
    step = np.linalg.solve(damped, b[:, :, None])[:, :, 0]
    return np.where(stays[:, None] | ~np.isfinite(step), 0.0, step)
