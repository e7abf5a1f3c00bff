"""The step of a few filters in the information form, whose covariances all runs share."""

from __future__ import annotations

import numba
import numpy as np


@numba.njit(cache=True, error_model="numpy", fastmath={"contract"})
def moved_information(Y, A, Q, shares):
    """Return Y+, Y+ A P and the inflation; arguments as in `filters.information`."""
    n, most = len(A), 0.0
    ahead, weights = np.empty_like(Y), np.empty_like(Y)
    P, half, moved = np.empty((n, n)), np.empty((n, n)), np.empty((n, n))
    for c in range(len(Y)):
        if not shares[c] > 0.0:
            ahead[c], weights[c] = 0.0, 0.0
            continue
        most = max(most, _inverse(Y[c], P))
        _product(A, P, half)  # A P
        for i in range(n):
            for j in range(n):
                moved[i, j] = Q[i, j] / shares[c]
                for a in range(n):
                    moved[i, j] += half[i, a] * A[j, a]
        most = max(most, _inverse(moved, ahead[c]))
        _product(ahead[c], half, weights[c])
    return ahead, weights, most


@numba.njit(cache=True, error_model="numpy", fastmath={"contract"})
def _product(X, Y, out):
    for i in range(len(X)):
        for j in range(len(X)):
            out[i, j] = 0.0
            for a in range(len(X)):
                out[i, j] += X[i, a] * Y[a, j]


@numba.njit(cache=True, error_model="numpy", fastmath={"contract"})
def _inverse(matrix, out):
    """Set out to the inverse of a positive definite matrix, and return how much it is inflated.

    By the elimination of Gauss and Jordan; what is not positive definite is infinitely inflated.
    """
    n, lost, most = len(matrix), False, 0.0
    for i in range(n):
        for j in range(n):
            out[i, j] = matrix[i, j]
    for p in range(n):
        lost |= not out[p, p] > 0.0
        pivot = 1.0 / out[p, p]
        for j in range(n):
            out[p, j] *= pivot
        out[p, p] = pivot
        for i in range(n):
            if i != p:
                factor = out[i, p]
                out[i, p] = 0.0
                for j in range(n):
                    out[i, j] -= factor * out[p, j]
    for i in range(n):
        most = max(most, matrix[i, i] * out[i, i])
        lost |= not matrix[i, i] * out[i, i] < np.inf
    return np.inf if lost else most
