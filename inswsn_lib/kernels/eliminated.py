"""Inverses of small positive definite matrices, as many as there are runs, side by side."""

from __future__ import annotations

import numba
import numpy as np


@numba.njit(cache=True, error_model="numpy", fastmath={"contract"})
def eliminated(matrices):
    """Return the inverses of matrices (filters, n, n, K); infinite where there is none."""
    filters, n, _, K = matrices.shape
    work, pivot = matrices.copy(), np.empty(K)
    for f in range(filters):
        for p in range(n):
            for k in range(K):
                pivot[k] = 1.0 / work[f, p, p, k]
                work[f, p, p, k] = 1.0
            for j in range(n):
                for k in range(K):
                    work[f, p, j, k] *= pivot[k]
            for i in range(n):
                if i == p:
                    continue
                for j in range(n):
                    if j != p:
                        for k in range(K):
                            work[f, i, j, k] -= work[f, i, p, k] * work[f, p, j, k]
                for k in range(K):
                    work[f, i, p, k] *= -work[f, p, p, k]
    return work
