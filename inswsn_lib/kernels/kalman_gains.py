"""The gains of one Kalman filter over steps."""

from __future__ import annotations

import numpy as np

from inswsn_lib.kernels.choice import kernel


@kernel(error_model="numpy", fastmath={"contract"})
def kalman_gains(A, C, Q, R, limits, P, there, out):
    """Fill out with K and I - K C of each step; arguments and results as in `filters.kalman`."""
    (m, n), certain = C.shape, False
    S, X, half = np.empty((m, m)), np.empty((m, n)), np.empty((n, n))
    P, after = P.copy(), np.zeros((n, n))
    for k in range(len(there)):
        _product(C, P, X)
        for i in range(m):
            for j in range(m):
                S[i, j] = R[i, j]
                for a in range(n):
                    S[i, j] += X[i, a] * C[j, a]
        for i in range(m):
            if S[i, i] > limits[i]:
                return k, P, after, certain
        for i in range(m):
            if not there[k, i]:
                X[i] = 0.0
            for j in range(m):
                if not (there[k, i] and there[k, j]):
                    S[i, j] = 1.0 if i == j else 0.0
        certain |= _solve(S, X)
        gain, keep = out[k, :, :m], out[k, :, m:]
        for i in range(n):
            for j in range(m):
                gain[i, j] = X[j, i]
            for j in range(n):
                keep[i, j] = 1.0 if i == j else 0.0
                for a in range(m):
                    keep[i, j] -= gain[i, a] * C[a, j]
        _product(keep, P, half)
        for i in range(m):  # R K'
            for j in range(n):
                X[i, j] = 0.0
                for a in range(m):
                    X[i, j] += R[i, a] * gain[j, a]
        for i in range(n):
            for j in range(i + 1):
                value = 0.0
                for a in range(n):
                    value += half[i, a] * keep[j, a]
                for a in range(m):
                    value += gain[i, a] * X[a, j]
                after[i, j] = after[j, i] = value
        _product(A, after, half)
        for i in range(n):
            for j in range(n):
                P[i, j] = Q[i, j]
                for a in range(n):
                    P[i, j] += half[i, a] * A[j, a]
    return len(there), P, after, certain


@kernel(error_model="numpy", fastmath={"contract"})
def _product(left, right, out):
    for i in range(len(left)):
        for j in range(right.shape[1]):
            out[i, j] = 0.0
            for a in range(len(right)):
                out[i, j] += left[i, a] * right[a, j]


@kernel(error_model="numpy", fastmath={"contract"})
def _solve(S, X):
    """Set X to S^-1 X for a symmetric positive definite S; tell whether it is singular."""
    m, n = X.shape
    singular = False
    for p in range(m):
        singular |= S[p, p] == 0.0
        pivot = 1.0 / S[p, p]
        for i in range(p + 1, m):
            factor = S[p, i] * pivot
            for j in range(i, m):
                S[i, j] -= factor * S[p, j]
            for j in range(n):
                X[i, j] -= factor * X[p, j]
        S[p, p] = pivot
    for i in range(m - 1, -1, -1):
        for j in range(n):
            value = X[i, j]
            for a in range(i + 1, m):
                value -= S[i, a] * X[a, j]
            X[i, j] = value * S[i, i]
    return singular
