"""The steps of filters in the information form, whose covariances all runs share."""

from __future__ import annotations

import numpy as np

from inswsn_lib.kernels.choice import kernel


@kernel(error_model="numpy", fastmath={"contract"})
def information_steps(A, Qs, shares, Y, i, added, told, heard, rule, every, predicted):
    """Return the centre's states (steps, n, runs) and the inflation; see `filters.information`."""
    steps, n, runs = len(Qs), len(A), i.shape[2]
    last = len(Y) - 1
    Y, i = Y.copy(), i.copy()
    P, half, moved, W = np.empty((n, n)), np.empty((n, n)), np.empty((n, n)), np.empty((n, n))
    fused, state = np.empty((n, n)), np.empty((n, runs))
    omega, found, most = np.empty(last + 1), np.empty((steps, n, runs)), 0.0
    for k in range(steps):
        if k > 0:
            for c in range(last + 1):
                most = max(most, _predict(A, Qs[k - 1], shares[c], Y[c], i[c], P, half, moved, W))
        if predicted:
            _mix(_weights(rule, omega, last, True), Y, i, fused, state)
            most = max(most, _inverse(fused, P))
            _apply(P, state, found[k])
        for c in range(last):
            Y[c] += added[c, k]
            i[c] += told[c, k]
        some = False
        for c in range(last):
            some |= heard[c, k]
        if rule > 0:
            lightest = np.inf
            for c in range(last):
                omega[c] = 0.0
                most = max(most, _inverse(Y[c], P))
                trace = np.trace(P)
                if heard[c, k] and rule == 1:
                    omega[c] = 1.0 / trace
                elif heard[c, k] and trace < lightest:
                    omega[:c] = 0.0
                    omega[c], lightest = 1.0, trace
            omega[last] = 0.0 if some else 1.0
            omega /= omega.sum()
        else:
            _weights(rule, omega, last, False)
        _mix(omega, Y, i, fused, state)
        if not predicted:
            most = max(most, _inverse(fused, P))
            _apply(P, state, found[k])
        for c in range(last + 1):
            if rule > 0 and (c == last or not heard[c, k]):
                Y[c] = fused
                i[c] = state
            elif rule == 0 and every > 0 and (k + 1) % every == 0:
                Y[c] = shares[c] * fused
                i[c] = shares[c] * state
    return found, most


@kernel()
def _weights(rule, omega, last, held):
    """Set the weights to the centre's alone, or to the sum of all for a rule of 0."""
    omega[:] = 1.0 if rule == 0 else 0.0
    omega[last] = 1.0
    return omega


@kernel(error_model="numpy", fastmath={"contract"})
def _mix(omega, Y, i, fused, state):
    fused[:] = 0.0
    state[:] = 0.0
    for c in range(len(omega)):
        if omega[c] != 0.0:
            fused += omega[c] * Y[c]
            state += omega[c] * i[c]


@kernel(error_model="numpy", fastmath={"contract"})
def _predict(A, Q, share, Y, i, P, half, moved, W):
    """Move one filter a step ahead, in place; return how much its inverses are inflated."""
    if not share > 0.0:
        Y[:] = 0.0
        i[:] = 0.0
        return 0.0
    n = len(A)
    most = _inverse(Y, P)
    _apply(A, P, half)
    for a in range(n):
        for b in range(n):
            moved[a, b] = Q[a, b] / share
            for c in range(n):
                moved[a, b] += half[a, c] * A[b, c]
    most = max(most, _inverse(moved, Y))
    _apply(Y, half, W)
    before = i.copy()
    _apply(W, before, i)
    return most


@kernel(error_model="numpy", fastmath={"contract"})
def _apply(X, Y, out):
    for i in range(len(X)):
        out[i] = 0.0
        for a in range(len(X)):
            for r in range(Y.shape[1]):
                out[i, r] += X[i, a] * Y[a, r]


@kernel(error_model="numpy", fastmath={"contract"})
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
