"""Fusion of the local H-infinity filters of P2's clusters: weights by a convex problem, certified.

Each of N clusters runs a filter of its own, and its error obeys

    x_c+ = A_c x_c + [B, -K_c D_c] (w, xi_c),    A_c = A - K_c C_c.

The fused estimate is the sum of M_c times the local estimates, with the sum of the M_c the identity
(P2 6 and 7). Its error, seen through L, is z = L (M_1 x_1 + ... + M_N x_N).
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cache, partial

import numpy as np
from numpy.typing import ArrayLike
from scipy.linalg import block_diag, qr, solve_discrete_lyapunov

from inswsn_lib.checks import Array, array, number, one_of
from inswsn_lib.errors import Described, ParameterError
from inswsn_lib.lmi.arrow import Arrow, Places, solve_arrow
from inswsn_lib.lmi.bounds import SHARES, mended
from inswsn_lib.lmi.designs import (
    LARGEST_GAP,
    FilterDesign,
    FusionCertificate,
    FusionDesign,
    FusionSolver,
    InfeasibleDesignError,
    Noise,
    Solver,
    Structure,
    told_gap,
)
from inswsn_lib.lmi.filter_design import LARGEST_MARGIN, TOLERANCE, refuse_if
from inswsn_lib.lmi.norms import hinf_norm, spectral_radius, swept_peak
from inswsn_lib.lmi.solvers import Inequality, first_that_passes, in_order, solve, symmetric_units

NOISES = ("common", "independent")
FUSION_SOLVERS = ("structured", "clarabel", "scs")
_LARGEST_STACK = 64  # states for which the norm of the stacked system is computed as it stands
_SMALLEST = 1e-8  # eigenvalues of the matrices that give the units are raised to this share
_SEEN = 1e-9  # sizes of L, B and K D along an axis below this share of the largest count as zero
_ROUNDED = 1e-15  # a share of a matrix to which an eigenvalue is sought
_ROUNDING = 1e-9  # a matrix is positive semidefinite if no eigenvalue is below minus this share
# Of a cluster in the sums that a solver is given; they are accurate if numbers are not small
_SHARE = {"structured": 1.0, "clarabel": 30.0, "scs": 30.0}


def design_fusion(
    designs: Sequence[FilterDesign],
    noise: Noise = "common",
    structure: Structure = "full",
    *,
    margin: float = 0.01,
    solver: FusionSolver | tuple[FusionSolver, ...] = ("structured", "clarabel"),
) -> FusionDesign:
    r"""Design the weights with which local H-infinity filters are fused (P2, theorem 1).

    With :math:`\tilde A = \mathrm{diag}(A_c)`, :math:`M = [M_1, \dots, M_N]` and K from
    `fusion_system`, the least :math:`\gamma` is found for which a symmetric P and weights with
    :math:`\sum_c M_c = I` satisfy

    .. math::
        \begin{bmatrix} \tilde A'P\tilde A - P & \tilde A'PK & (LM)' \\
        K'P\tilde A & K'PK - \gamma^2 I & 0 \\ LM & 0 & -I \end{bmatrix} \le 0.

    That is P2 (9) less its third row and column, by a Schur complement. P2 needs them since it
    multiplies P with unknown gains; here the local gains are known.

    Then, as in `design_filter`, that solution is taken which has the least
    :math:`\mathrm{tr}\, K'PK` at :math:`(1 + \mathrm{margin})\gamma`, a bound on the variance of z
    for white noise of unit variance. With the structure "full" and a large margin the weights
    become those of least variance.

    With the structure "block" the matrix is made of parts, one for each cluster, that share only z
    and the common process noise w. It is negative exactly if it is a sum of negative matrices, one
    for each part (Agler, Helton, McCullough and Rodman 1988), so with :math:`G_c = -K_cD_c`

    .. math::
        \begin{bmatrix} A_c'P_cA_c - P_c & A_c'P_cB & A_c'P_cG_c & (LM_c)' \\
        \cdot & B'P_cB - W_c & B'P_cG_c & V_c \\
        \cdot & \cdot & G_c'P_cG_c - \gamma^2 I & 0 \\
        \cdot & \cdot & \cdot & -Z_c \end{bmatrix} \le 0, \qquad
        \sum_c W_c = \gamma^2 I,\ \sum_c V_c = 0,\ \sum_c Z_c = I.

    For noise of each cluster's own there are no :math:`W_c` and :math:`V_c`. The time grows in
    proportion to N; for the structure "full" it grows with about the fifth power.

    States that L does not see have no part in this. There each cluster has the weight 1 / N.

    Parameters
    ----------
    designs : sequence of FilterDesign
        The local filters, without jitter, all with the same A, B and L.
    noise : {"common", "independent"}
        "common": the clusters share the process noise, since they correct the same INS.
        "independent": each has a process noise of its own, as P2 (13) has it.
    structure : {"full", "block"}
        Any symmetric P, or one made of diagonal blocks, one for each cluster.
    margin : float
        As in `design_filter`.
    solver : {"structured", "clarabel", "scs"} or a tuple of them
        An interior-point method that computes the parts side by side, or those of `design_filter`,
        which know of no parts. Of several the later are asked where the answers of those before are
        refused.

    Returns
    -------
    FusionDesign
        A design that has passed its certificate.

    Raises
    ------
    InfeasibleDesignError
        If a local filter is not stable, or no solution is found that passes the certificate.
    ParameterError
        If the designs are none, differ in A, B or L, or have a jitter; or there is no such noise,
        structure, margin or solver.

    Examples
    --------
    Two clusters with the gain 1 and noises of unit size: with half of each, the common
    process noise remains and half of the variance of the measurements, so that
    :math:`\gamma = \sqrt{3/2}`:

    >>> import inswsn_lib as iw
    >>> model = iw.ErrorModel(A=[[1]], B=[[1]], C=[[1]], D=[[1]], period=1.0)
    >>> fusion = iw.design_fusion([iw.design_filter(model, margin=1e-4)] * 2)
    >>> print(f"{fusion.gamma:.3f}", [f"{weight:.2f}" for weight in fusion.weights.ravel()])
    1.225 ['0.50', '0.50']
    """
    local = _checked_designs(designs)
    check_options(noise, structure, margin)
    solvers = in_order(solver, FUSION_SOLVERS)
    radius = max(spectral_radius(design.A_f) for design in local)
    if radius >= 1:
        raise InfeasibleDesignError(f"A local filter has the spectral radius {radius:.6g}.")
    # the first states work nearly always; where a solver fails, others of the same problem help
    return first_that_passes(
        partial(_designed, local, noise, structure, margin, whitened, by)
        for whitened in (True, False)
        for by in solvers
    )


def check_options(noise: Noise, structure: Structure, margin: float) -> None:
    """Refuse a noise, structure or margin that `design_fusion` does not accept."""
    one_of("noise", noise, NOISES)
    one_of("structure", structure, ("full", "block"))
    number("margin", margin, above=0, most=LARGEST_MARGIN)


def _designed(
    designs: tuple[FilterDesign, ...],
    noise: Noise,
    structure: Structure,
    margin: float,
    whitened: bool,
    by: FusionSolver,
) -> FusionDesign:
    """Solve both problems in some states, and certify what comes of it."""
    units, parts = _balanced(designs, noise, structure, whitened)
    gamma, first, status = _solved(parts, units.L, len(designs), by)
    bounds = _bounds(parts, units.L, gamma, first)
    level = gamma * (1 + margin)
    _, found, last = _solved(parts, units.L, len(designs), by, level)
    back = np.linalg.inv(parts.states)
    Y = np.hstack(list(found.Y @ back))
    P = units.seen**2 * back.mT @ found.P @ back
    P = P[0] if structure == "full" else P
    weights = _weights(units, Y, len(designs))
    bounds = units.seen * bounds[0], units.seen * bounds[1]
    certificate = _certified(designs, noise, weights, P, units.seen * level, bounds)
    status = status if status != "optimal" else last
    return FusionDesign(
        designs, noise, structure, units.seen * gamma, units.seen * level, weights, P, certificate,
        status, by,
    )  # fmt: skip


@dataclass(frozen=True, eq=False)
class _Parts:
    """The parts of the inequality, each with a P of its own; they share w and z.

    The system of each is `A`, (N, k, k), and `K`, (N, k, u), whose first `shared` inputs are the
    process noise that all parts share. `turned`, (N, k, n), takes an error that all clusters have
    in common to the states of the part, and `states`, (N, k, k), these to those of the local
    filters.
    """

    A: Array
    K: Array
    shared: int
    turned: Array
    states: Array


@dataclass(frozen=True, eq=False)
class _Solution:
    """Of each part P, Y = L M, what it takes of w and z beyond its share, and its dual solution."""

    P: Array
    Y: Array
    X: Array
    dual: Array


def _solved(
    parts: _Parts, L: Array, clusters: int, by: FusionSolver, level: float | None = None
) -> tuple[float, _Solution, str]:
    """Find the least level, or at one that is given the least bound on the variance.

    Returns the level, what is found of each part, and the solver's word.
    """
    scale = _SHARE[by] * clusters
    problem = _arrow(parts, L, scale, level)
    if by == "structured":
        answer = solve_arrow(problem)
        x, squared, duals, status = answer.x, answer.s, answer.Z, answer.status
    else:
        x, squared, duals, status = _by_general_solver(problem, by)
    least = (max(squared, 0.0) / scale) ** 0.5 if level is None else level
    (_, k, _), seen = parts.K.shape, len(L)
    P, Y, X = np.split(x / scale, np.cumsum([k * (k + 1) // 2, seen * k]), axis=1)
    found = _Solution(
        _symmetric(P, k), Y.reshape(-1, seen, k), _symmetric(X, parts.shared + seen), duals
    )
    return least, found, status


def _symmetric(upper: Array, n: int) -> Array:
    return np.tensordot(upper, symmetric_units(n), axes=1)


def _by_general_solver(problem: Arrow, by: Solver) -> tuple[Array, float, Array, str]:
    """Return unknowns, s, dual solutions and the word of a solver that knows of no parts."""
    N, m = problem.q.shape
    constants, first = problem.left(np.zeros((N, m)), 0.0), int(problem.shared)
    inequalities = []
    for c, constant in enumerate(constants):
        places = np.arange(first + c * m, first + (c + 1) * m)
        terms = _terms(problem, c)
        if problem.shared:
            terms, places = np.concatenate([-np.diag(problem.o)[None], terms]), np.append(0, places)
        inequalities.append(Inequality(constant, terms, places))
    fills = np.eye(m - problem.G.shape[2])
    right = np.append(problem.h, np.zeros(len(fills)))
    left = [np.zeros((len(right), first)), *(block_diag(G, fills) for G in problem.G)]
    cost = np.concatenate([np.ones(first), problem.q.ravel()])
    answer = solve(cost, inequalities, by, (np.hstack(left), right))
    s = float(answer.x[0]) if problem.shared else 0.0
    return answer.x[first:].reshape(N, m), s, np.array(answer.duals), answer.status


def _terms(problem: Arrow, part: int) -> Array:
    """Return what each unknown of a part does to its left side, (m, d, d)."""
    J = problem.J[part]
    return np.asarray(J.T @ problem.places.filled(np.eye(problem.q.shape[1])) @ J)


def _bounds(parts: _Parts, L: Array, gamma: float, found: _Solution) -> tuple[float, float]:
    """Return what the least level cannot be below, and a level at which the inequality holds."""
    level = gamma * (1 + LARGEST_GAP / 2)
    problem = _arrow(parts, L, 1.0, None)
    left = problem.left(_packed(found.P, found.Y, found.X), level**2)
    largest = (np.linalg.eigvalsh(left)[:, -1] / np.abs(left).max(axis=(1, 2))).max()
    lower = next((b for b in _lowers(parts, L, problem, found) if b is not None), 0.0)
    return min(lower, gamma), level if largest <= TOLERANCE else np.inf


def _packed(P: Array, Y: Array, X: Array) -> Array:
    """Return the unknowns of each part, (N, m)."""
    upper = [matrix[:, *np.triu_indices(matrix.shape[1])] for matrix in (P, X)]
    return np.concatenate([upper[0], Y.reshape(len(Y), -1), upper[1]], axis=1)


def _lowers(parts: _Parts, L: Array, problem: Arrow, found: _Solution) -> Iterator[float | None]:
    r"""Give bounds on the least level from dual solutions Z_c, made exact if they can be.

    They are :math:`\ge 0`, stationary, :math:`E Z E' = S Z S'` with the state E and the next one
    S, agree in the covariance :math:`\Theta` of w and z, and have :math:`2 z Z E' = -\Lambda T'`.
    Then :math:`\gamma^2` is not below
    :math:`\langle\Lambda, L\rangle^2 / (4\,\mathrm{tr}\,\Theta_z)` over the power of all noise.
    Ever larger shares of solutions that are exact but for the covariance are added to those found.
    """
    (N, k, u), seen, shared = parts.K.shape, len(L), parts.shared
    d = k + u + seen
    inside = cache(partial(_inside, parts, found.dual))
    ends = np.r_[k : k + shared, k + u : d]
    turned = parts.turned.reshape(N * k, -1)
    for share in SHARES:
        duals = found.dual + share * inside() if share else found.dual
        theta = duals[:, ends[:, None], ends].mean(axis=0)
        states = -2 * duals[:, :k, k + u :].reshape(N * k, seen)
        multiplier = np.linalg.lstsq(turned, states, rcond=None)[0].T
        wanted = _packed(
            np.zeros((N, k, k)), -multiplier @ parts.turned.mT,
            np.tile(-theta * (2 - np.eye(len(theta))), (N, 1, 1)),
        )  # fmt: skip
        power = float(np.trace(theta[:shared, :shared]))
        for c, dual in enumerate(duals):
            exact = mended(dual, _terms(problem, c), wanted[c])
            if exact is None:
                yield None
                break
            power += float(np.trace(exact[k + shared : k + u, k + shared : k + u]))
        else:
            gained = float(np.sum(multiplier * L)) ** 2
            yield float(np.sqrt(gained / (4 * float(np.trace(theta[shared:, shared:])) * power)))


def _inside(parts: _Parts, dual: Array) -> Array:
    """Return dual solutions of full rank, which are exact but for the covariance of w and z."""
    inside = np.tile(np.eye(dual.shape[1]), (len(dual), 1, 1))
    for own, A, K in zip(inside, parts.A, parts.K, strict=True):
        own[: len(A), : len(A)] = solve_discrete_lyapunov(A, K @ K.T)
    return np.asarray(inside * np.trace(dual, axis1=1, axis2=2)[:, None, None] / len(dual))


@cache
def _places(k: int, seen: int, shared: int) -> Places:
    """Return where the unknowns of P, Y and X stand between the next state, the state, w and z."""
    i, j = np.triu_indices(k)
    a, b = (index.ravel() for index in np.indices((seen, k)))
    e, f = np.triu_indices(shared + seen)
    P = np.arange(len(i))
    Y, X = len(P) + np.arange(seen * k), len(P) + seen * k + np.arange(len(e))
    ones = np.ones_like(P)
    return Places(
        2 * k + shared + seen,
        np.concatenate([np.repeat(P, 2), Y, X]),
        np.concatenate([np.stack([i, k + i], 1).ravel(), k + b, 2 * k + e]),
        np.concatenate([np.stack([j, k + j], 1).ravel(), 2 * k + shared + a, 2 * k + f]),
        np.concatenate([np.stack([ones, -ones], 1).ravel(), np.ones(len(Y)), -np.ones(len(X))]),
        shared + seen,
    )


def _arrow(parts: _Parts, L: Array, scale: float, level: float | None) -> Arrow:
    """Return the problem of the least level squared, or at a level of the least variance.

    All unknowns are `scale` times theirs, and the noise is in units of the level.
    """
    (N, k, u), seen = parts.K.shape, len(L)
    places = _places(k, seen, parts.shared)
    # what the next state, the state, w and z are of the state, all noise and z
    J = np.zeros((N, places.size, k + u + seen))
    J[:, :k, :k], J[:, :k, k : k + u] = parts.A, parts.K / (level or 1.0)
    J[:, k : 2 * k, :k] = np.eye(k)
    J[:, 2 * k : 2 * k + parts.shared, k : k + parts.shared] = np.eye(parts.shared)
    J[:, 2 * k + parts.shared :, k + u :] = np.eye(seen)
    P, ends = k * (k + 1) // 2, parts.shared + seen
    G = np.zeros((N, seen, L.shape[1], P + seen * k))
    for a in range(seen):
        G[:, a, :, P + a * k : P + (a + 1) * k] = parts.turned.mT
    # of what all have in common a part takes a share, and X besides
    o = np.repeat([0, 1 / N, 1, 0], [k, parts.shared, u - parts.shared, seen])
    f = np.repeat([0.0, scale / N], [k + u, seen])
    q = np.zeros((N, P + seen * k + ends * (ends + 1) // 2))
    if level is not None:
        f += scale * o
        squares = parts.K @ parts.K.mT * (2 - np.eye(k))
        q[:, :P] = squares[:, *np.triu_indices(k)] / scale
    G, h = G.reshape(N, L.size, -1), scale * L.ravel()
    return Arrow(places, J, o, f, q, G, h, level is None)


def fusion_system(
    designs: Sequence[FilterDesign], weights: ArrayLike, noise: Noise = "common"
) -> tuple[Array, Array, Array]:
    """Return the system of the fused error (P2 13): the stacked local errors, seen through L M.

    Parameters
    ----------
    designs : sequence of FilterDesign
        As in `design_fusion`.
    weights : array_like, (N, n, n)
        M_c; their sum is not looked at.
    noise : {"common", "independent"}
        The input is (w, xi_1, ..., xi_N), or (w_1, xi_1, ..., w_N, xi_N).

    Returns
    -------
    A : ndarray, (N n, N n)
    K : ndarray, (N n, inputs)
    L : ndarray, (l, N n)
        [L M_1, ..., L M_N].

    Raises
    ------
    ParameterError
        If the designs do not fit together, or there are no such weights or noise.

    Examples
    --------
    >>> import inswsn_lib as iw
    >>> model = iw.ErrorModel(A=[[1]], B=[[1]], C=[[1]], D=[[1]], period=1.0)
    >>> A, K, L = iw.lmi.fusion_system([iw.design_filter(model)] * 2, [[[0.25]], [[0.75]]])
    >>> A.shape, K.shape, L.tolist()  # the noises are w, xi_1 and xi_2
    ((2, 2), (2, 3), [[0.25, 0.75]])
    """
    local, M = _checked_weights(designs, weights, noise)
    systems = [design.error_system[:2] for design in local]
    A, K = _stacked(systems, local[0].model.B.shape[1], noise)
    return A, K, np.hstack(list(local[0].model.L @ M))


def fusion_gain(
    designs: Sequence[FilterDesign], weights: ArrayLike, noise: Noise = "common"
) -> float:
    """Return the gain from the noise to the fused error; infinite if a local filter is not stable.

    Up to 64 stacked states it is the H-infinity norm, by `hinf_norm`. For more, it is the largest
    singular value over a grid of frequencies with its peaks refined, below the norm by no more than
    what a peak between the grid's frequencies may hide.

    Parameters
    ----------
    designs, weights, noise
        As in `fusion_system`, and so are the errors.

    Examples
    --------
    The worst case of one cluster alone, and of the mean of two:

    >>> import inswsn_lib as iw
    >>> model = iw.ErrorModel(A=[[1]], B=[[1]], C=[[1]], D=[[1]], period=1.0)
    >>> designs = [iw.design_filter(model, margin=1e-4)] * 2
    >>> weights = [[[1.0]], [[0.0]]], [[[0.5]], [[0.5]]]
    >>> print([f"{iw.lmi.fusion_gain(designs, each):.3f}" for each in weights])
    ['1.414', '1.225']
    """
    local, M = _checked_weights(designs, weights, noise)
    if M.shape[0] * M.shape[1] <= _LARGEST_STACK:
        return hinf_norm(*fusion_system(local, M, noise))
    poles = np.concatenate([np.linalg.eigvals(design.A_f) for design in local])
    if np.abs(poles).max() >= 1:
        return float("inf")
    seen = local[0].model.L @ M
    return swept_peak(lambda angles: _sizes(local, seen, noise, angles), poles)


def _sizes(designs: tuple[FilterDesign, ...], seen: Array, noise: Noise, angles: Array) -> Array:
    """Return the largest singular value of the fused error at frequencies, (k,).

    It is the root of the largest eigenvalue of the response times its adjoint, to which each
    cluster adds a term, and the common process noise another.
    """
    outputs, n, p = len(seen[0]), *designs[0].model.B.shape
    squares = np.zeros((len(angles), outputs, outputs), dtype=complex)
    common = np.zeros((len(angles), outputs, p), dtype=complex)
    circle = np.exp(1j * angles)[:, None, None] * np.eye(n)
    for design, LM in zip(designs, seen, strict=True):
        A, K, _ = design.error_system
        response = np.linalg.solve(circle - A.T, LM.T).mT @ K
        if noise == "common":
            common += response[:, :, :p]
            response = response[:, :, p:]
        squares += response @ response.conj().transpose(0, 2, 1)
    squares += common @ common.conj().transpose(0, 2, 1)
    return np.asarray(np.sqrt(np.maximum(np.linalg.eigvalsh(squares)[:, -1], 0.0)))


@dataclass(frozen=True, eq=False)
class _Units:
    """Units of the fused state and of z in which L is of the order of one.

    The fused state is `common`, (n, n), times the new one, and z is measured in `seen`, the level
    of the best cluster. `L`, (rank, n), is L in these units, less the rows that depend on others.
    """

    common: Array
    seen: float
    L: Array


def _balanced(
    designs: tuple[FilterDesign, ...], noise: Noise, structure: Structure, whitened: bool
) -> tuple[_Units, _Parts]:
    """Return the parts of the inequality, one for each cluster or one for all, in other states.

    In these the errors of a part have the covariance I for white unit noise if `whitened`; else
    the P of each local design is its level squared times I.
    """
    p = designs[0].model.B.shape[1]
    systems = [design.error_system[:2] for design in designs]
    local = [np.asarray(design.level * np.linalg.inv(_root(design.P)).T) for design in designs]
    if whitened:
        local = [_whitened(*system, T) for system, T in zip(systems, local, strict=True)]
    best = min(range(len(designs)), key=lambda c: designs[c].level)
    common, seen = local[best], designs[best].level
    B = _compressed(designs[0].model.B, common)
    systems = [
        (A, np.hstack([B, _compressed(K[:, p:], T)]))
        for (A, K), T in zip(systems, local, strict=True)
    ]
    p = B.shape[1]
    _, sizes, rows = np.linalg.svd(designs[0].model.L @ common / seen, full_matrices=False)
    kept = sizes > _SEEN * sizes[0]
    units = _Units(common, seen, sizes[kept, None] * rows[kept])
    if structure == "block":
        shared = p if noise == "common" else 0
        parts = [
            _part(*system, shared, common, T) for system, T in zip(systems, local, strict=True)
        ]
    else:
        A, K = _stacked(systems, p, noise)
        T = np.asarray(block_diag(*local))
        T = _whitened(A, K, T) if whitened else T
        shared, parts = 0, [_part(A, K, 0, np.vstack([common] * len(designs)), T)]
    most = max(K.shape[1] for _, K, _, _ in parts)
    A, turned, states = (np.stack([part[i] for part in parts]) for i in (0, 2, 3))
    K = np.zeros((*A.shape[:2], most))  # columns of zeros are no noise
    for padded, (_, own, _, _) in zip(K, parts, strict=True):
        padded[:, : own.shape[1]] = own
    return units, _Parts(A, K, shared, turned, states)


def _part(
    A: Array, K: Array, shared: int, turned: Array, T: Array
) -> tuple[Array, Array, Array, Array]:
    """Return a part in the states of which T times gives those of A, K and `turned`, and T."""
    A, K, turned = (np.asarray(np.linalg.solve(T, X)) for X in (A @ T, K, turned))
    return A, K if shared else _compressed(K, np.eye(len(K))), turned, T


def _whitened(A: Array, K: Array, T: Array) -> Array:
    """Return other states T for which the covariance is I; those given make it well conditioned."""
    A, K = (np.asarray(np.linalg.solve(T, X)) for X in (A @ T, K))
    return T @ _root(solve_discrete_lyapunov(A, K @ K.T))


def _compressed(B: Array, T: Array) -> Array:
    """Return a matrix with the same B B' and as few columns as it can have, at least one.

    It is the pivoted Cholesky factor: axes that have no part in each other stay apart, which the
    singular vectors of equal axes do not. What is small is told in the states of which T times
    gives those of B: in its own units a small number may be the one that matters.
    """
    _, R, order = qr(np.linalg.solve(T, B).T, mode="economic", pivoting=True)
    kept = np.abs(np.diag(R)) > _SEEN * np.abs(R[0, 0])
    kept[0] = True
    columns = np.empty((len(B), np.count_nonzero(kept)))
    columns[order] = R[kept].T
    return np.asarray(T @ columns)


def _root(matrix: Array) -> Array:
    """Return R with R R' the matrix, its small eigenvalues raised; units of rows do not matter."""
    sizes = np.sqrt(np.maximum(np.diag(matrix), 1e-300))
    values, vectors = np.linalg.eigh(matrix / np.outer(sizes, sizes))
    raised = np.maximum(values, _SMALLEST * values.max())
    return np.asarray(sizes[:, None] * vectors * np.sqrt(raised))


def _stacked(systems: list[tuple[Array, Array]], p: int, noise: Noise) -> tuple[Array, Array]:
    """Return A and K of the stacked error of P2 (13); the first p inputs of a cluster are w."""
    A = block_diag(*(A for A, _ in systems))
    if noise == "independent":
        return A, block_diag(*(K for _, K in systems))
    own = block_diag(*(K[:, p:] for _, K in systems))
    return A, np.hstack([np.vstack([K[:, :p] for _, K in systems]), own])


def _weights(units: _Units, Y: Array, clusters: int) -> Array:
    """Return M_c from L M_c; what L does not see has the weight 1 / N. Their sum is made exact."""
    n = len(units.common)
    each = Y.reshape(len(units.L), clusters, n).transpose(1, 0, 2)
    backwards = np.linalg.pinv(units.L)
    unseen = (np.eye(n) - backwards @ units.L) @ np.linalg.inv(units.common)
    weights = units.common @ (backwards @ each + unseen / clusters)
    return np.asarray(weights + (np.eye(n) - weights.sum(axis=0)) / clusters)


def _certified(
    designs: tuple[FilterDesign, ...],
    noise: Noise,
    weights: Array,
    P: Array,
    level: float,
    bounds: tuple[float, float],
) -> FusionCertificate:
    """Return the certificate of weights; raise if they do not keep the level."""
    largest = _largest_eigenvalue(designs, noise, weights, P, level)
    error = float(np.abs(weights.sum(axis=0) - np.eye(weights.shape[1])).max())
    norm = fusion_gain(designs, weights, noise)
    refuse_if({
        f"the inequality has the eigenvalue {largest:.3g}": not largest <= TOLERANCE,
        f"the weights miss the identity by {error:.3g}": not error <= _ROUNDING,
        f"the norm is {norm:.6g}, above {level:.6g}": not norm <= level * (1 + TOLERANCE),
        told_gap(*bounds): not bounds[1] <= bounds[0] * (1 + LARGEST_GAP),
    })  # fmt: skip
    return FusionCertificate(largest, error, norm, *bounds)


def _largest_eigenvalue(
    designs: tuple[FilterDesign, ...], noise: Noise, weights: Array, P: Array, level: float
) -> float:
    """Return the largest eigenvalue of the left side, all clusters in one matrix.

    With a P of diagonal blocks that matrix is an arrow: clusters touch in w and z alone.
    """
    structure: Structure = "full" if P.ndim == 2 else "block"
    units, parts = _balanced(designs, noise, structure, whitened=False)
    turn, K, shared = parts.states, parts.K / (level / units.seen), parts.shared
    LM = designs[0].model.L @ (np.hstack(list(weights))[None] if P.ndim == 2 else weights)
    LM = LM @ turn / units.seen
    P = turn.mT @ P @ turn / units.seen**2
    N, k, u = K.shape
    # of each cluster the state and its own noise, and then w and z
    order = np.r_[:k, k + shared : k + u, k : k + shared, k + u : k + u + len(LM[0])]
    system = np.concatenate([parts.A, K], axis=2)
    F = np.zeros((N, len(order), len(order)))
    F[:, : k + u, : k + u] = system.mT @ P @ system
    F[:, :k, :k] -= P
    F[:, k + u :, :k], F[:, :k, k + u :] = LM, LM.mT
    F = F[:, order[:, None], order]
    cluster = k + u - shared
    F[:, k:cluster, k:cluster] -= np.eye(cluster - k)
    blocks, arms = F[:, :cluster, :cluster], F[:, :cluster, cluster:]
    tip = F[:, cluster:, cluster:].sum(axis=0) - np.eye(len(order) - cluster)
    most = max(np.abs(blocks).max(), np.abs(arms).max(), np.abs(tip).max())
    return _largest_of_arrow(blocks, arms, tip) / float(most)


def _largest_of_arrow(blocks: Array, arms: Array, tip: Array) -> float:
    """Return the largest eigenvalue of symmetric blocks (N, b, b), arms (N, b, e), tip (e, e).

    Above those of the blocks, a number is larger than all if the Schur complement says so.
    """
    values, vectors = np.linalg.eigh(blocks)
    across = (vectors.mT @ arms).reshape(-1, arms.shape[2])
    values, size = values.ravel(), float(np.abs(blocks).max() + np.abs(tip).max())

    def above(level: float) -> bool:
        left = level * np.eye(len(tip)) - tip - (across / (level - values)[:, None]).T @ across
        return bool(np.linalg.eigvalsh(left)[0] >= 0)

    low = float(max(values.max(), np.linalg.eigvalsh(tip)[-1]))
    high = low + float(np.linalg.norm(across))
    while high - low > _ROUNDED * size:
        middle = (low + high) / 2
        low, high = (low, middle) if above(middle) else (middle, high)
    return high


def _checked_designs(designs: Sequence[FilterDesign]) -> tuple[FilterDesign, ...]:
    """Return the designs as a tuple; refuse those that cannot be fused."""
    must_be = "one or more designs of `design_filter` without jitter, with the same A, B and L"
    if not (isinstance(designs, Sequence) and all(isinstance(d, FilterDesign) for d in designs)):
        raise ParameterError("designs", designs, must_be)
    models = [design.model for design in designs]
    if not models:
        raise ParameterError("designs", Described("empty"), must_be)
    if any(model.E.any() for model in models):
        raise ParameterError("designs", Described("for a model with jitter"), must_be)
    for name in "ABL":
        first, *others = (getattr(model, name) for model in models)
        if not all(np.array_equal(first, other) for other in others):
            raise ParameterError("designs", Described(f"for models that differ in {name}"), must_be)
    return tuple(designs)


def _checked_weights(
    designs: Sequence[FilterDesign], weights: ArrayLike, noise: Noise
) -> tuple[tuple[FilterDesign, ...], Array]:
    """Return designs and M_c, (N, n, n); refuse those that do not fit together."""
    local = _checked_designs(designs)
    one_of("noise", noise, NOISES)
    return local, array("weights", weights, (len(local), *local[0].model.A.shape))
