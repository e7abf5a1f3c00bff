"""A filter whose gains all runs share: each step goes once over the measurements of all runs."""

from __future__ import annotations

from inswsn_lib.kernels.choice import kernel


@kernel(error_model="numpy", fastmath={"contract"})
def linear_recursion(F, G, x, y, out):
    """Fill out with x_k; arguments as in `filters.kalman`."""
    # by entries: to assign whole rows takes the compiler seconds, for what a wrong shape is told
    n, runs = x.shape
    for i in range(n):
        for r in range(runs):
            out[0, i, r] = x[i, r]
    for k in range(len(y)):
        for i in range(n):
            fresh = _add(F[k, i], out, k, out, i, True)
            if _add(G[k, i], y, k, out, i, fresh):
                for r in range(runs):
                    out[k + 1, i, r] = 0.0


@kernel(error_model="numpy", fastmath={"contract"})
def _add(weights, rows, k, out, i, fresh):
    """Add weighted rows to a row of the next step, two at a time; tell whether it is still fresh.

    What is fresh is set. Weights of zero are left out, since matrices are often sparse.
    """
    runs, waiting = out.shape[2], -1
    for j in range(len(weights)):
        if weights[j] == 0.0:
            continue
        if waiting < 0:
            waiting = j
            continue
        f, g = weights[waiting], weights[j]
        if fresh:
            for r in range(runs):
                out[k + 1, i, r] = f * rows[k, waiting, r] + g * rows[k, j, r]
        else:
            for r in range(runs):
                out[k + 1, i, r] += f * rows[k, waiting, r] + g * rows[k, j, r]
        fresh, waiting = False, -1
    if waiting >= 0:
        f = weights[waiting]
        if fresh:
            for r in range(runs):
                out[k + 1, i, r] = f * rows[k, waiting, r]
        else:
            for r in range(runs):
                out[k + 1, i, r] += f * rows[k, waiting, r]
        fresh = False
    return fresh
