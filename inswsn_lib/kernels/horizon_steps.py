"""How long the recursion of a worst-case gain over a finite horizon holds."""

from __future__ import annotations

from typing import Any

import numpy as np

from inswsn_lib.kernels.choice import kernel


@kernel()
def horizon_steps(A: Any, E: Any, B: Any, L: Any, gain: float, steps: int) -> int:
    """Return for how many steps, at most `steps`, no disturbance costs less than it gains.

    The recursion is that of `stochastic_gain`. Elimination in [g^2 I - B'PB, B'PA] makes of it a
    Cholesky factor R' and V = R^-1 B'PA, with which its last term is V'V.
    """
    n, p = B.shape
    A_, B_, source = A.T.copy(), B.T.copy(), np.dot(L.T.copy(), L)
    P, rows = source.copy(), np.empty((p, p + n))
    for step in range(steps):
        if not np.isfinite(P).all():
            return step
        PB = np.dot(P, B)
        rows[:, :p], rows[:, p:] = -np.dot(B_, PB), np.dot(PB.T.copy(), A)
        for j in range(p):
            rows[j, j] += gain * gain
            for k in range(j):
                for i in range(j, p + n):
                    rows[j, i] -= rows[k, j] * rows[k, i]
            if not rows[j, j] > 0:
                return step
            rows[j, j:] /= np.sqrt(rows[j, j])
        V = rows[:, p:].copy()
        new = source + np.dot(np.dot(A_, P), A) + np.dot(V.T.copy(), V)
        for e in range(len(E)):
            new += np.dot(np.dot(E[e].T.copy(), P), E[e])
        P = (new + new.T) / 2
    return steps
