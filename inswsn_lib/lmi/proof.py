"""P1's proof of its Theorem 2.3 as matrices, so that each printed step can be judged by numbers."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from inswsn_lib.errors import ParameterError
from inswsn_lib.lmi.norms import checked_system

Array = NDArray[np.float64]


def printed_steps(
    A: ArrayLike, B: ArrayLike, E: ArrayLike, L: ArrayLike, P: ArrayLike, gamma: float
) -> dict[str, Array]:
    r"""Return the matrices of P1 (2.16) to (2.21), each of which is said to be negative definite.

    They are those of an error system :math:`e^+ = (\tilde A + E\beta) e + \tilde B s`,
    :math:`z = L e`, with :math:`\Delta = -P + \tilde A'P\tilde A + L'L + E'PE`. P1 says that each
    is equivalent to the one before. From (2.18) to (2.19) that is false: :math:`\Delta` holds
    :math:`\tilde A'P\tilde A`, and (2.19) adds it again.

    Parameters
    ----------
    A, B, E, L : array_like, (n, n), (n, p), (n, n), (l, n)
        The error system.
    P : array_like, (n, n)
        Symmetric and positive definite.
    gamma : float
        The bound; :math:`\gamma^2 I - \tilde B'P\tilde B` must be invertible.

    Returns
    -------
    dict of str to ndarray
        By the number of the inequality: ``"2.16"``, ``"2.18"``, ``"2.19"``, ``"2.20"``, ``"2.21"``;
        (2.17) is (2.16) with another name for a part. The condition of (2.16) that
        :math:`\gamma^2 I - \tilde B'P\tilde B` be positive definite is a block of its own.

    Raises
    ------
    ParameterError
        If a shape does not fit, an entry is not finite, or P is not symmetric.

    Examples
    --------
    A system without jitter, A = 1/2 and B = L = 1, whose norm is 2. P = 2 and the level 3 satisfy
    (2.18), and do not satisfy (2.19), which P1 says is equivalent:

    >>> from inswsn_lib.lmi import negative_definite, printed_steps
    >>> one = [[1.0]]
    >>> steps = printed_steps([[0.5]], one, [[0.0]], one, P=[[2.0]], gamma=3.0)
    >>> {name: negative_definite(matrix) for name, matrix in steps.items()}
    {'2.16': True, '2.18': True, '2.19': False, '2.20': False, '2.21': False}
    """
    A, B, L = checked_system(A, B, L)
    E, P = (np.asarray(matrix, dtype=float) for matrix in (E, P))
    for name, matrix in (("E", E), ("P", P)):
        if matrix.shape != A.shape or not np.isfinite(matrix).all():
            raise ParameterError(name, f"of shape {matrix.shape}", f"finite, {A.shape}")
    if not np.allclose(P, P.T, rtol=0, atol=1e-12 * np.abs(P).max()):
        raise ParameterError("P", "not symmetric", "symmetric")
    n, p, outputs = len(A), B.shape[1], len(L)
    PA, PB, PE, cost = P @ A, P @ B, P @ E, gamma**2 * np.eye(p)
    theta = cost - B.T @ PB
    delta = -P + A.T @ PA + L.T @ L + E.T @ PE
    across = A.T @ PB
    schur = delta + across @ np.linalg.solve(theta, across.T)
    both = np.hstack([A, B])
    zero, none = np.zeros((n, n)), np.zeros((n, p))
    return {
        "2.16": np.block([[schur, none], [none.T, -theta]]),
        "2.18": np.block([[delta, across], [across.T, -theta]]),
        "2.19": np.block([[delta, none], [none.T, -cost]]) + both.T @ P @ both,
        "2.20": np.block([[delta, none, PA.T], [none.T, -cost, PB.T], [PA, PB, -P]]),
        "2.21": np.block(
            [
                [-P, none, PA.T, PA.T, L.T, PE.T],
                [none.T, -cost, PB.T, none.T, np.zeros((p, outputs)), none.T],
                [PA, PB, -P, zero, np.zeros((n, outputs)), zero],
                [PA, none, zero, -P, np.zeros((n, outputs)), zero],
                [L, np.zeros((outputs, p)), *[np.zeros((outputs, n))] * 2, -np.eye(outputs),
                 np.zeros((outputs, n))],
                [PE, none, zero, zero, np.zeros((n, outputs)), -P],
            ]
        ),
    }  # fmt: skip


def negative_definite(matrix: ArrayLike) -> bool:
    """Tell whether a symmetric matrix is negative definite, by its largest eigenvalue.

    Parameters
    ----------
    matrix : array_like, (n, n)
        A symmetric matrix; only its lower triangle is read.

    Returns
    -------
    bool

    Examples
    --------
    >>> from inswsn_lib.lmi import negative_definite
    >>> negative_definite([[-2.0, 1.0], [1.0, -2.0]]), negative_definite([[-1.0, 2.0], [2.0, -1.0]])
    (True, False)
    """
    return bool(np.linalg.eigvalsh(np.asarray(matrix, dtype=float)).max() < 0)
