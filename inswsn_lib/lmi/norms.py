"""Worst-case gains of linear systems, computed without the convex problems they are to certify."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.linalg import eigvals, lapack
from scipy.optimize import minimize_scalar

from inswsn_lib.errors import ParameterError

Array = NDArray[np.float64]

_ON_CIRCLE = 1e-7
_SWEEP = 512
_REFINED = 8
_DOUBLINGS = 12
_HIGHEST = 1e100  # of a gain, whose square must be a number


def spectral_radius(A: ArrayLike) -> float:
    """Return the largest modulus of the eigenvalues of a square matrix.

    Parameters
    ----------
    A : array_like, (n, n)
        The matrix.

    Returns
    -------
    float

    Raises
    ------
    ParameterError
        If it is not square or not finite.

    Examples
    --------
    >>> from inswsn_lib.lmi import spectral_radius
    >>> print(f"{spectral_radius([[0.0, 0.25], [-1.0, 0.0]]):.3f}")  # eigenvalues +- 0.5 j
    0.500
    """
    matrix = matrix_of("A", A)
    if matrix.shape[0] != matrix.shape[1]:
        raise ParameterError("A", f"of shape {matrix.shape}", "square")
    return float(np.abs(np.linalg.eigvals(matrix)).max())


def largest_singular_value(A: ArrayLike, B: ArrayLike, C: ArrayLike, angles: ArrayLike) -> Array:
    r"""Return the largest singular value of :math:`C (e^{j\omega} I - A)^{-1} B`.

    Parameters
    ----------
    A, B, C : array_like, (n, n), (n, p), (l, n)
        The system.
    angles : array_like, (k,)
        Frequencies, radians per sample.

    Returns
    -------
    ndarray, (k,)

    Raises
    ------
    ParameterError
        If a shape does not fit, or an entry is not finite.

    Examples
    --------
    :math:`1 / (z - 1/2)` at z = 1 and at z = -1:

    >>> import numpy as np
    >>> from inswsn_lib.lmi import largest_singular_value
    >>> largest_singular_value([[0.5]], [[1.0]], [[1.0]], [0.0, np.pi]).round(4).tolist()
    [2.0, 0.6667]
    """
    A, B, C = checked_system(A, B, C)
    turns = np.asarray(angles, dtype=float)
    if turns.ndim != 1 or not np.isfinite(turns).all():
        raise ParameterError("angles", f"of shape {turns.shape}", "finite, (k,)")
    return _largest(A, B, C, turns)


def _largest(A: Array, B: Array, C: Array, turns: Array) -> Array:
    z = np.exp(1j * turns)[:, None, None]
    response = C @ np.linalg.solve(
        z * np.eye(len(A)) - A, np.broadcast_to(B, (z.shape[0], *B.shape))
    )
    return np.asarray(np.linalg.svd(response, compute_uv=False)[:, 0])


def hinf_norm(A: ArrayLike, B: ArrayLike, C: ArrayLike, relative: float = 1e-10) -> float:
    r"""Return the H-infinity norm of :math:`C (zI - A)^{-1} B`.

    A sweep over frequencies gives a lower bound. At a level above it the pencil

    .. math::
        z \begin{bmatrix} I & -BB'/g^2 \\ 0 & A' \end{bmatrix}
        - \begin{bmatrix} A & 0 \\ -C'C & I \end{bmatrix}

    has eigenvalues on the unit circle exactly at the frequencies at which a singular value is g.
    Between them the level is raised, until there are none (Bruinsma and Steinbuch 1990).

    Parameters
    ----------
    A, B, C : array_like, (n, n), (n, p), (l, n)
        The system.
    relative : float
        Relative accuracy.

    Returns
    -------
    float
        Infinite if A has an eigenvalue on or outside the unit circle.

    Raises
    ------
    ParameterError
        If shapes do not fit, or an entry is not finite.

    Examples
    --------
    For one state the peak is at the frequency zero: :math:`1 / (1 - 1/2)`:

    >>> from inswsn_lib.lmi import hinf_norm
    >>> print(f"{hinf_norm([[0.5]], [[1.0]], [[1.0]]):.6f}")
    2.000000
    >>> hinf_norm([[1.0]], [[1.0]], [[1.0]])
    inf
    """
    A, B, C = checked_system(A, B, C)
    checked_relative(relative)
    if spectral_radius(A) >= 1:
        return float("inf")
    B, C, size = of_size_one(B, C)
    level = _top_of_sweep(A, B, C)
    if level == 0 or size == 0:
        return 0.0
    for _ in range(60):
        crossings = _crossings(A, B, C, level * (1 + 2 * relative))
        if crossings.size < 2:
            break
        middles = (crossings + np.roll(crossings, -1)) / 2
        middles[-1] += np.pi  # the last interval reaches over the cut at pi
        raised = float(largest_singular_value(A, B, C, middles).max())
        if raised <= level * (1 + relative):
            break
        level = raised
    return level * size


def _top_of_sweep(A: Array, B: Array, C: Array) -> float:
    """Return the largest singular value over a grid of frequencies, its peaks refined."""
    poles = np.abs(np.angle(np.linalg.eigvals(A)))
    width = np.maximum(1 - np.abs(np.linalg.eigvals(A)), 1e-12)  # of the peak of a pole
    near = np.concatenate([poles + k * width for k in (-1, 0, 1)])
    angles = np.unique(np.clip(np.concatenate([np.linspace(0, np.pi, _SWEEP), near]), 0, np.pi))
    sizes = _largest(A, B, C, angles)
    best = sizes.max()
    beside = np.pad(sizes, 1, constant_values=-np.inf)
    peaks = np.flatnonzero((sizes >= beside[:-2]) & (sizes >= beside[2:]))
    for k in peaks[np.argsort(sizes[peaks])[-_REFINED:]]:
        around = angles[max(k - 1, 0)], angles[min(k + 1, len(angles) - 1)]
        peak = minimize_scalar(
            lambda angle: -_largest(A, B, C, np.array([angle]))[0],
            bounds=around, method="bounded", options={"xatol": 1e-12},
        )  # fmt: skip
        best = max(best, -peak.fun)
    return float(best)


def _crossings(A: Array, B: Array, C: Array, level: float) -> Array:
    """Return the frequencies, in order, at which a singular value is `level`."""
    n = len(A)
    eye, zero = np.eye(n), np.zeros((n, n))
    left = np.block([[A, zero], [-C.T @ C, eye]])
    right = np.block([[eye, -B @ B.T / level**2], [zero, A.T]])
    values = eigvals(left, right)
    values = values[np.isfinite(values)]
    return np.sort(np.angle(values[np.abs(np.abs(values) - 1) < _ON_CIRCLE]))


def riccati_gain_below(
    A: ArrayLike, E: ArrayLike, B: ArrayLike, L: ArrayLike, gain: float, iterations: int = 20_000
) -> bool:
    r"""Tell whether a system with multiplicative noise is stable with a gain below a number.

    The plant is :math:`x^+ = (A + \sum_i E_i\beta_i) x + B s`, :math:`z = L x`, with
    :math:`\beta_i` white of unit variance and independent of one another. The iteration

    .. math::
        P^+ = A'PA + \sum_i E_i'PE_i + L'L + A'PB (g^2 I - B'PB)^{-1} B'PA

    from P = 0 rises. If the plant is mean-square stable, it converges with
    :math:`g^2 I - B'PB > 0` for every g above the gain, and for none below it (El Bouhtouri,
    Hinrichsen and Pritchard 1999). It converges slowly if g is near the gain, or the plant near
    instability.

    Parameters
    ----------
    A, E, B, L : array_like, (n, n), (n, n) or (k, n, n), (n, p), (l, n)
        The system; E may be a stack of k matrices, one for each multiplicative noise.
    gain : float
        g.
    iterations : int
        After which a sequence that still moves counts as one that does not converge.

    Returns
    -------
    bool
        False as well if the sequence has not settled after `iterations`.

    Raises
    ------
    ParameterError
        If a shape does not fit, an entry is not finite, or the gain is not a number.

    Examples
    --------
    For A = E = 1/2 and B = L = 1 the gain is :math:`1 + \sqrt 3 = 2.732`:

    >>> from inswsn_lib.lmi import riccati_gain_below
    >>> half, one = [[0.5]], [[1.0]]
    >>> [riccati_gain_below(half, half, one, one, gain) for gain in (2.73, 2.74)]
    [False, True]
    """
    A, B, L = checked_system(A, B, L)
    E = multipliers(E, len(A))
    B, L, size = of_size_one(B, L)
    if np.isnan(gain):
        raise ParameterError("gain", gain, "a number")
    gain = min(gain / size, _HIGHEST) if size else _HIGHEST
    if mean_square_radius(A, E) >= 1:
        return False
    P, source, level = np.zeros_like(A), L.T @ L, gain**2 * np.eye(B.shape[1])
    for _ in range(iterations):
        PB = P @ B
        # LAPACK itself: what SciPy checks before it calls these takes most of an iteration
        factor, failed = lapack.dpotrf(level - B.T @ PB)
        if failed:
            return False
        APB = A.T @ PB
        new = A.T @ P @ A + seen_through(P, E) + source + APB @ lapack.dpotrs(factor, APB.T)[0]
        new = (new + new.T) / 2
        if not np.isfinite(new).all():
            return False
        # entry by entry: a mode that L hardly sees may still move
        variances = new.diagonal()
        size = np.sqrt(np.abs(variances[:, None] * variances))
        if (np.abs(new - P) <= 1e-12 * size).all():
            return True
        P = new
    return False


def mean_square_radius(A: ArrayLike, E: ArrayLike) -> float:
    """Return the spectral radius of A (x) A + E (x) E: below 1 for mean-square stability.

    Parameters
    ----------
    A, E : array_like, (n, n), (n, n) or (k, n, n)
        Of the plant x+ = (A + E beta) x, with beta white of unit variance; E may be a stack of k
        matrices, one for each of k independent multiplicative noises, whose terms add.

    Returns
    -------
    float

    Raises
    ------
    ParameterError
        If A is not square, E does not fit it, or an entry is not finite.

    Examples
    --------
    Stable without the noise, and in the mean square only while :math:`a^2 + e^2 < 1`:

    >>> from inswsn_lib.lmi import mean_square_radius
    >>> for e in (0.3, 0.5):
    ...     print(f"{mean_square_radius([[0.9]], [[e]]):.2f}")
    0.90
    1.06
    """
    a = matrix_of("A", A)
    if a.shape[0] != a.shape[1]:
        raise ParameterError("A", f"of shape {a.shape}", "square")
    each = multipliers(E, len(a))
    return spectral_radius(np.kron(a, a) + sum(np.kron(e, e) for e in each))


def stochastic_gain(
    A: ArrayLike, E: ArrayLike, B: ArrayLike, L: ArrayLike, relative: float = 1e-6
) -> float:
    r"""Return the gain of a system with multiplicative noise by bisection on the Riccati iteration.

    Parameters
    ----------
    A, E, B, L : array_like, (n, n), (n, n) or (k, n, n), (n, p), (l, n)
        The system of `riccati_gain_below`.
    relative : float
        Relative accuracy; for a plant near instability it is not reached, and the result is on the
        safe side.

    Returns
    -------
    float
        An upper bound; infinite if the system is not mean-square stable.

    Raises
    ------
    ParameterError
        If the plant is so near instability that the iteration does not tell, a shape does not fit,
        or an entry is not finite.

    Examples
    --------
    With one state and A = E = 1/2, B = L = 1 the Riccati equation is quadratic, and has a solution
    from :math:`g = 1 + \sqrt 3` on. Without the noise the gain is 2:

    >>> from inswsn_lib.lmi import stochastic_gain
    >>> half, one = [[0.5]], [[1.0]]
    >>> print(f"{stochastic_gain(half, half, one, one, relative=1e-4):.3f}")
    2.732
    >>> print(f"{stochastic_gain(half, [[0.0]], one, one):.3f}")
    2.000
    """
    A, B, L = checked_system(A, B, L)
    E = multipliers(E, len(A))
    checked_relative(relative)
    B, L, size = of_size_one(B, L)
    if mean_square_radius(A, E) >= 1:
        return float("inf")
    low = hinf_norm(A, B, L)  # beta = 0 in the mean: the gain cannot be smaller
    if low == 0:
        return 0.0
    high = low * (1 + relative)
    for _ in range(_DOUBLINGS):
        if riccati_gain_below(A, E, B, L, high):
            break
        low, high = high, 2 * high
    else:
        raise ParameterError("A, E", "too near instability", "farther from it")
    while high > low * (1 + relative):
        middle = (low * high) ** 0.5
        if riccati_gain_below(A, E, B, L, middle):
            high = middle
        else:
            low = middle
    return high * size


def checked_system(A: ArrayLike, B: ArrayLike, C: ArrayLike) -> tuple[Array, Array, Array]:
    """Return the matrices of a system as floats; refuse shapes that do not fit."""
    matrices = [matrix_of("A, B, C", matrix) for matrix in (A, B, C)]
    n = len(matrices[0])
    shapes = [matrix.shape for matrix in matrices]
    if shapes[0] != (n, n) or shapes[1][0] != n or shapes[2][1] != n:
        raise ParameterError("A, B, C", shapes, "(n, n), (n, p), (l, n)")
    return matrices[0], matrices[1], matrices[2]


def matrix_of(name: str, value: ArrayLike) -> Array:
    """Return a matrix of real, finite numbers with one row and column or more; refuse all else."""
    try:
        found = np.asarray(value)
        real = found.dtype.kind in "fiub"
        matrix = found.astype(float) if real else None
    except (TypeError, ValueError):  # ragged lists, texts
        matrix = None
    if matrix is None or matrix.ndim != 2 or not matrix.size:
        raise ParameterError(name, f"of shape {np.shape(value) if matrix is not None else '?'}",
                             "a matrix of real numbers")  # fmt: skip
    if not np.isfinite(matrix).all():
        raise ParameterError(name, "not finite", "finite")
    return matrix


def of_size_one(B: Array, C: Array) -> tuple[Array, Array, float]:
    """Return input and output matrix over their largest entries, and the product of these.

    A gain is proportional to both, and its square must neither overflow nor vanish.
    """
    largest = [float(np.abs(matrix).max()) for matrix in (B, C)]
    b, c = (size or 1.0 for size in largest)
    return B / b, C / c, largest[0] * largest[1]


def checked_relative(relative: float) -> None:
    """Raise a ParameterError if a relative accuracy cannot be reached in double precision."""
    if not 1e-14 <= relative < 1:
        raise ParameterError("relative", relative, "from 1e-14 to below 1")


def multipliers(E: ArrayLike, states: int) -> Array:
    """Return one matrix of a multiplicative noise, or several, as a stack (k, n, n)."""
    try:
        matrix = np.asarray(E, dtype=float)
    except (TypeError, ValueError):
        raise ParameterError("E", "not numbers", f"finite, ({states}, {states})") from None
    stack = matrix[None] if matrix.ndim == 2 else matrix
    if stack.ndim != 3 or stack.shape[1:] != (states, states) or not np.isfinite(stack).all():
        raise ParameterError(
            "E",
            f"of shape {matrix.shape}",
            f"finite, ({states}, {states}) or (k, {states}, {states})",
        )
    return stack


def seen_through(P: Array, stack: Array) -> Array:
    """Return the sum of E' P E over a stack of multiplicative noises."""
    return np.asarray((stack.transpose(0, 2, 1) @ P @ stack).sum(axis=0))
