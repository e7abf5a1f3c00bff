"""Lower bounds on a least level, whatever a solver has said."""

from __future__ import annotations

import numpy as np

from inswsn_lib.checks import Array

#: Shares of another dual solution that are added to a solver's until it can be made exact
SHARES = (0.0, 1e-12, 1e-10, 1e-8, 1e-6, 1e-5, 1e-4)
_LEFT_OVER = 1e-9


def dual_bound(dual: Array, inside: Array, constant: Array, terms: Array, cost: Array) -> float:
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
    constant, terms : ndarray, (k, k), (unknowns, k, k)
        :math:`F_0` and the :math:`F_i`.
    cost : ndarray, (unknowns,)
        c.

    Returns
    -------
    float
        Minus infinity if no Z is found.
    """
    inside = inside * np.trace(dual) / np.trace(inside)
    for share in SHARES:
        found = mended(dual + share * inside, terms, -cost)
        if found is not None:
            return float(np.sum(constant * found))
    return float("-inf")


def mended(dual: Array, terms: Array, wanted: Array) -> Array | None:
    """Return a positive semidefinite matrix near a given one, with products that are wanted.

    Parameters
    ----------
    dual : ndarray, (k, k)
        Symmetric up to rounding; eigenvalues below zero are taken as zero.
    terms : ndarray, (unknowns, k, k)
    wanted : ndarray, (unknowns,)
        The inner products with the terms.

    Returns
    -------
    ndarray, (k, k), or None
    """
    eye = np.eye(len(dual))
    values, vectors = np.linalg.eigh((dual + dual.T) / 2)
    root = vectors * np.sqrt(np.maximum(values, 0.0))
    seen = (root.T @ terms @ root).reshape(len(terms), -1)
    sizes = np.linalg.norm(seen, axis=1)
    sizes = np.where(sizes > 0, sizes, 1.0)
    seen, wanted = seen / sizes[:, None], wanted / sizes
    change = np.linalg.lstsq(seen, wanted - seen @ eye.ravel(), rcond=1e-14)[0]
    middle = eye + change.reshape(eye.shape)
    middle = (middle + middle.T) / 2
    left_over = np.abs(seen @ middle.ravel() - wanted).max()
    if left_over > _LEFT_OVER or np.linalg.eigvalsh(middle)[0] < 0:
        return None
    return np.asarray(root @ middle @ root.T)
