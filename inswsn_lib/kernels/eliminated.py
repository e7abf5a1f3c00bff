"""Inverses of small positive definite matrices, as many as there are runs, side by side."""

from __future__ import annotations

from inswsn_lib.kernels.choice import kernel


@kernel(error_model="numpy", fastmath={"contract"})
def eliminated(matrices):
    """Return the inverses of matrices (filters, n, n, K); infinite where there is none.

    By the elimination of Gauss and Jordan, which needs no pivoting for positive definite matrices.
    """
    filters, n = matrices.shape[:2]
    work = matrices.copy()
    for f in range(filters):
        for p in range(n):
            pivot = 1.0 / work[f, p, p]
            for j in range(n):
                if j != p:
                    work[f, p, j] *= pivot
            for i in range(n):
                factor = work[f, i, p]
                for j in range(n):
                    if i != p != j:
                        work[f, i, j] -= factor * work[f, p, j]
                if i != p:
                    factor *= -pivot
            work[f, p, p] = pivot
    return work
