"""What a least level cannot be below, whatever a solver has said."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from inswsn_lib.checks import Array

# Shares of another dual solution that are added to a solver's until it can be made exact
_SHARES = (0.0, 1e-12, 1e-10, 1e-8, 1e-6, 1e-5, 1e-4)
_LEFT_OVER = 1e-9


def dual_bound(
    dual: Array, inside: Array, left_side: Callable[[Array], Array], cost: Array
) -> float:
    r"""Return a bound on the cost of a linear matrix inequality, from a nearly right dual solution.

    Of all x with :math:`F_0 + \sum_i x_i F_i \le 0` none has a cost :math:`c'x` below
    :math:`\langle Z, F_0 \rangle`, if Z is positive semidefinite with
    :math:`\langle Z, F_i \rangle = -c_i`. A solver's Z has that up to what it calls accurate. With
    a root R of it, the smallest :math:`\Delta` is taken with which :math:`R (I + \Delta) R'` has it
    up to rounding; it is positive semidefinite if no eigenvalue of :math:`\Delta` is below -1.

    Parameters
    ----------
    dual : ndarray, (k, k)
        The solver's Z.
    inside : ndarray, (k, k)
        A positive definite Z, right but for its size.
    left_side : callable
        Gives :math:`F_0 + \sum_i x_i F_i`, (k, k), for x, (unknowns,).
    cost : ndarray, (unknowns,)
        c.

    Returns
    -------
    float
        Minus infinity if no Z is found.
    """
    constant = left_side(np.zeros_like(cost))
    terms = np.array([left_side(unit) - constant for unit in np.eye(len(cost))])
    dual, eye = (dual + dual.T) / 2, np.eye(len(dual))
    inside = inside * np.trace(dual) / np.trace(inside)
    for share in _SHARES:
        values, vectors = np.linalg.eigh(dual + share * inside)
        root = vectors * np.sqrt(np.maximum(values, 0.0))
        seen = (root.T @ terms @ root).reshape(len(cost), -1)
        sizes = np.linalg.norm(seen, axis=1)
        seen, wanted = seen / sizes[:, None], -cost / sizes
        change = np.linalg.lstsq(seen, wanted - seen @ eye.ravel(), rcond=1e-14)[0]
        mended = eye + change.reshape(eye.shape)
        mended = (mended + mended.T) / 2
        left_over = np.abs(seen @ mended.ravel() - wanted).max()
        if left_over < _LEFT_OVER and np.linalg.eigvalsh(mended)[0] >= 0:
            return float(np.sum(root.T @ constant @ root * mended))
    return float("-inf")
