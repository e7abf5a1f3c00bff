"""The Kalman filter of runs that miss different measurements, each with a covariance of its own.

Some runs are computed side by side, in the last axis, so that one instruction of the processor
serves several. One whose prediction is far less certain than the measurement is taken out for that
step, and computed by square roots of covariances.
"""

from __future__ import annotations

import numpy as np

from inswsn_lib.kernels.choice import kernel

_LANES = 128
_ZERO = 1e-14  # of a variance: what a Cholesky factor takes for zero


@kernel(error_model="numpy", fastmath={"contract"})
def kalman_runs(
    A, C, Q, driving, R, noise, limits, P, W, x, there, y, known, states, outputs, predicted, out
):
    """Fill out with the states of all runs; arguments and results as in `filters.kalman`."""
    steps, _, runs = y.shape
    lanes = max(min(_LANES, runs), 1)
    (m, n), wide = C.shape[1:], max(driving.shape[2] + A.shape[2], W.shape[2])
    x_after, P_after = np.empty((n, runs)), np.empty((runs, n, n))
    W_after = np.empty((runs, n, wide))
    now, e, here = np.zeros((n, lanes)), np.zeros((m, lanes)), np.zeros((m, lanes))
    prior, after = np.zeros((n, n, lanes)), np.zeros((n, n, lanes))
    keep, work = np.zeros((n, n, lanes)), np.zeros((n, n, lanes))
    gain, seen, S = np.zeros((m, n, lanes)), np.zeros((m, n, lanes)), np.zeros((m, m, lanes))
    far, rooted = np.zeros(lanes, np.bool_), np.zeros(lanes, np.bool_)
    root, certain = np.zeros((lanes, n, wide)), False
    for first in range(0, runs, lanes):
        count = min(lanes, runs - first)
        for r in range(lanes):
            run = first + min(r, count - 1)  # where the runs end, the last fills up
            own, rooted[r] = min(run, len(P) - 1), True
            for i in range(n):
                now[i, r] = x[i, run]
                for j in range(n):
                    prior[i, j, r] = P[own, i, j]
                for j in range(wide):
                    root[r, i, j] = W[own, i, j] if j < W.shape[2] else 0.0
        for k in range(steps):
            q, s, a_k = min(k, len(Q) - 1), min(k, len(R) - 1), min(k, len(A) - 1)
            C_k = C[min(k, len(C) - 1)]
            if predicted:
                for i in range(n):
                    for r in range(count):
                        out[k, states[i], first + r] = now[i, r]
            for i in range(m):
                for r in range(count):
                    here[i, r] = there[k, outputs[i], first + r]
                    e[i, r] = y[k, outputs[i], first + r]
                for r in range(count, lanes):
                    here[i, r], e[i, r] = here[i, count - 1], e[i, count - 1]
                for j in range(n):
                    c = C_k[i, j]
                    if c != 0.0:
                        for r in range(lanes):
                            e[i, r] -= c * now[j, r]
            _times(C_k, prior, seen)
            _times_transposed(seen, C_k, R[s], S)
            far[:], any_far = False, False
            for i in range(m):
                for r in range(lanes):
                    any_far |= S[i, i, r] > limits[s, i]
            if any_far:
                for r in range(lanes):
                    for i in range(m):
                        far[r] |= S[i, i, r] > limits[s, i]
                    if far[r] and not rooted[r]:
                        q_before = max(min(k, len(driving)) - 1, 0)
                        A_before = A[max(min(k, len(A)) - 1, 0)]
                        _predicted_root(A_before, after, driving[q_before], root[r], r)
            certain |= _solve(S, seen, here, gain)
            _joseph(C_k, R[s], prior, gain, keep, work, seen, after)
            if any_far:
                for r in range(lanes):
                    if far[r]:
                        certain |= _updated_root(C_k, noise[s], here, root[r], gain, after, r)
                        _moved_root(A[a_k], driving[q], root[r])
            rooted[:] = far
            for a in range(m):
                for i in range(n):
                    for r in range(lanes):
                        now[i, r] += gain[a, i, r] * (here[a, r] * e[a, r])
            if not predicted:
                for i in range(n):
                    for r in range(count):
                        out[k, states[i], first + r] = now[i, r]
            _times(A[a_k], after, work)
            _times_transposed(work, A[a_k], Q[q], prior)
            for i in range(n):
                for r in range(lanes):
                    keep[0, i, r] = now[i, r]
            for i in range(n):
                for r in range(lanes):
                    of_run = min(first + r, known.shape[2] - 1)
                    now[i, r] = known[min(k, len(known) - 1), i, of_run]
                for j in range(n):
                    for r in range(lanes):
                        now[i, r] += A[a_k, i, j] * keep[0, j, r]
        for r in range(count):
            if not rooted[r]:
                _predicted_root(A[-1], after, driving[-1], root[r], r)
            for i in range(n):
                x_after[i, first + r] = now[i, r]
                for j in range(n):
                    P_after[first + r, i, j] = prior[i, j, r]
                for j in range(wide):
                    W_after[first + r, i, j] = root[r, i, j]
    return x_after, P_after, W_after, certain


@kernel(error_model="numpy", fastmath={"contract"})
def _times(M, X, out):
    """Set out to M X, for a matrix that all runs share; it is often sparse."""
    lanes = out.shape[2]
    for i in range(len(M)):
        for j in range(X.shape[1]):
            begun = False
            for a in range(len(X)):
                c = M[i, a]
                if c != 0.0 and begun:
                    for r in range(lanes):
                        out[i, j, r] += c * X[a, j, r]
                elif c != 0.0:
                    for r in range(lanes):
                        out[i, j, r] = c * X[a, j, r]
                    begun = True
            if not begun:
                out[i, j] = 0.0


@kernel(error_model="numpy", fastmath={"contract"})
def _times_transposed(X, M, added, out):
    """Set out to the symmetric matrix X M' + added."""
    lanes = out.shape[2]
    for i in range(len(M)):
        for j in range(i + 1):
            begun = False
            for a in range(X.shape[1]):
                c = M[j, a]
                if c != 0.0 and begun:
                    for r in range(lanes):
                        out[i, j, r] += c * X[i, a, r]
                elif c != 0.0:
                    for r in range(lanes):
                        out[i, j, r] = added[i, j] + c * X[i, a, r]
                    begun = True
            if not begun:
                out[i, j] = added[i, j]
            if i != j:
                for r in range(lanes):
                    out[j, i, r] = out[i, j, r]


@kernel(error_model="numpy", fastmath={"contract"})
def _solve(S, seen, here, gain):
    """Set gain (m, n) to S^-1 C P of what is here, zero elsewhere; tell whether S is singular."""
    lanes = S.shape[2]
    m, n, singular = len(S), seen.shape[1], False
    for i in range(m):
        for j in range(m):
            for r in range(lanes):
                S[i, j, r] *= here[i, r] * here[j, r]
        for r in range(lanes):
            S[i, i, r] += 1.0 - here[i, r]
        for j in range(n):
            for r in range(lanes):
                gain[i, j, r] = seen[i, j, r] * here[i, r]
    for p in range(m):
        for r in range(lanes):
            singular |= S[p, p, r] == 0.0
            S[p, p, r] = 1.0 / S[p, p, r] if S[p, p, r] != 0.0 else 1.0
        for i in range(p + 1, m):
            for r in range(lanes):
                S[i, p, r] = S[p, i, r] * S[p, p, r]
            for j in range(i, m):
                for r in range(lanes):
                    S[i, j, r] -= S[i, p, r] * S[p, j, r]
            for j in range(n):
                for r in range(lanes):
                    gain[i, j, r] -= S[i, p, r] * gain[p, j, r]
    for i in range(m - 1, -1, -1):
        for j in range(n):
            for a in range(i + 1, m):
                for r in range(lanes):
                    gain[i, j, r] -= S[i, a, r] * gain[a, j, r]
            for r in range(lanes):
                gain[i, j, r] *= S[i, i, r]
    return singular


@kernel(error_model="numpy", fastmath={"contract"})
def _joseph(C, R, prior, gain, keep, work, weighed, after):
    """Set after to (I - K C) P (I - K C)' + K R K'."""
    lanes = prior.shape[2]
    m, n = len(gain), len(prior)
    for i in range(n):
        for j in range(n):
            for r in range(lanes):
                keep[i, j, r] = 1.0 if i == j else 0.0
            for a in range(m):
                c = C[a, j]
                if c != 0.0:
                    for r in range(lanes):
                        keep[i, j, r] -= gain[a, i, r] * c
        for j in range(n):
            for r in range(lanes):
                work[i, j, r] = keep[i, 0, r] * prior[0, j, r]
            for a in range(1, n):
                for r in range(lanes):
                    work[i, j, r] += keep[i, a, r] * prior[a, j, r]
    _times(R, gain, weighed)
    for i in range(n):
        for j in range(i + 1):
            for r in range(lanes):
                after[i, j, r] = work[i, 0, r] * keep[j, 0, r]
            for a in range(1, n):
                for r in range(lanes):
                    after[i, j, r] += work[i, a, r] * keep[j, a, r]
            for a in range(m):
                for r in range(lanes):
                    after[i, j, r] += gain[a, i, r] * weighed[a, j, r]
            for r in range(lanes):
                after[j, i, r] = after[i, j, r]


@kernel(error_model="numpy")
def _predicted_root(A, after, driving, root, r):
    """Set root (n, .) to that of A P A' + Q, of the run in place r."""
    n, p = len(A), root.shape[1] - len(A)
    for i in range(n):
        for j in range(n):
            root[i, p + j] = 0.0
    for j in range(n):
        pivot = after[j, j, r]
        for a in range(j):
            pivot -= root[j, p + a] ** 2
        if pivot > _ZERO * after[j, j, r]:  # semidefinite at least
            pivot = pivot**0.5
            for i in range(j, n):
                rest = after[i, j, r]
                for a in range(j):
                    rest -= root[i, p + a] * root[j, p + a]
                root[i, p + j] = rest / pivot
    _moved_root(A, driving, root)


@kernel(error_model="numpy")
def _moved_root(A, driving, root):
    """Set root (n, .) to [driving, 0, A W] of the W in its last columns."""
    n, p = len(A), root.shape[1] - len(A)
    W = root[:, p:].copy()
    for i in range(n):
        for j in range(n):
            root[i, p + j] = 0.0
            for a in range(n):
                root[i, p + j] += A[i, a] * W[a, j]
        for j in range(p):
            root[i, j] = driving[i, j] if j < driving.shape[1] else 0.0


@kernel(error_model="numpy")
def _updated_root(C, noise, here, root, gain, after, r):
    """Set gain, P+, and the last columns of root to its root; tell if an innovation is certain.

    They stand in the triangle of [W'C' W'; R^(1/2)' 0].
    """
    m, n = C.shape
    wide, certain = root.shape[1], False
    noises = noise.shape[1]
    whole = np.zeros((wide + noises + m, m + n))
    for a in range(wide):
        for j in range(n):
            whole[a, m + j] = root[j, a]
            for i in range(m):
                whole[a, i] += here[i, r] * C[i, j] * root[j, a]
    for i in range(m):
        for a in range(noises):
            whole[wide + a, i] = here[i, r] * noise[i, a]
        # what is missing has a noise of its own, and tells nothing
        whole[wide + noises + i, i] = 1.0 - here[i, r]
    for p in range(m + n):
        _reflected(whole, p)
    for i in range(m - 1, -1, -1):
        certain |= whole[i, i] == 0.0
        for j in range(n):
            rest = whole[i, m + j]
            for a in range(i + 1, m):
                rest -= whole[i, a] * gain[a, j, r]
            gain[i, j, r] = rest / whole[i, i] if whole[i, i] != 0.0 else 0.0
    for i in range(n):
        for j in range(n):
            root[i, wide - n + j] = whole[m + j, m + i]
            after[i, j, r] = 0.0
            for a in range(n):
                after[i, j, r] += whole[m + a, m + i] * whole[m + a, m + j]
    return certain


@kernel(error_model="numpy")
def _reflected(whole, p):
    """Make zeros below the diagonal of column p, by Householder's reflection."""
    rows, columns = whole.shape
    square = 0.0
    for a in range(p, rows):
        square += whole[a, p] ** 2
    if square == 0.0:
        return
    size = -np.sqrt(square) if whole[p, p] > 0.0 else np.sqrt(square)
    head = whole[p, p] - size  # of the mirror; its other entries stay in the column
    scale = -1.0 / (size * head)
    for j in range(p + 1, columns):
        along = head * whole[p, j]
        for a in range(p + 1, rows):
            along += whole[a, p] * whole[a, j]
        along *= scale
        whole[p, j] -= along * head
        for a in range(p + 1, rows):
            whole[a, j] -= along * whole[a, p]
    whole[p, p] = size
    for a in range(p + 1, rows):
        whole[a, p] = 0.0
