"""Fusion of the local H-infinity filters of P2's clusters: weights by a convex problem, certified.

Each of N clusters runs a filter of its own, and its error obeys

    x_c+ = A_c x_c + [B, -K_c D_c] (w, xi_c),    A_c = A - K_c C_c.

The fused estimate is the sum of M_c times the local estimates, with the sum of the M_c the identity
(P2 6 and 7). Its error, seen through L, is z = L (M_1 x_1 + ... + M_N x_N).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from numbers import Real
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import sparse
from scipy.linalg import (
    LinAlgError,
    block_diag,
    cho_factor,
    cho_solve,
    eigvalsh,
    solve_discrete_lyapunov,
)

from inswsn_lib.errors import ParameterError
from inswsn_lib.lmi.designs import FilterDesign
from inswsn_lib.lmi.norms import hinf_norm, spectral_radius
from inswsn_lib.lmi.solvers import (
    ALMOST,
    SOLVED,
    InfeasibleDesignError,
    Solver,
    chosen_solver,
    designed_by,
    solve_cones,
    solver_title,
)

Array = NDArray[np.float64]
Noise = Literal["common", "independent"]
Structure = Literal["full", "block"]
States = Literal["covariance", "designs"]

_STATES: tuple[States, ...] = ("covariance", "designs")

# The solution may break the inequality by this share of its largest entry, and the level too.
_TOLERANCE = 1e-6
_LARGEST_MARGIN = 1e9  # as in `design_filter`
_LARGEST_STACK = 64  # states for which the norm of the stacked system is computed as it stands
_SMALLEST = 1e-8  # eigenvalues of the matrices that give the units are raised to this share
_SEEN = 1e-9  # singular values of L, B and K D below this share of the largest count as zero
_ROUNDING = 1e-9  # a matrix is positive semidefinite if no eigenvalue is below minus this share
_BISECTIONS = 60
_SHARE = 10.0  # of a cluster in the sums that the solver is given
# of the sweep over frequencies: first points, peaks refined, points for each, and how often
_SWEEP = 512
_REFINED = 8
_ZOOM = 33
_ZOOMS = 6


@dataclass(frozen=True)
class FusionCertificate:
    """What vouches for the weights, computed without the solver.

    Attributes
    ----------
    largest_eigenvalue : float
        Of the left side of the inequality at the solution, with all clusters in one matrix, over
        the largest entry of that matrix; negative up to rounding. The states are in units in
        which the P of each local design is a multiple of the identity, and the noise in units of
        the level.
    weights_sum_error : float
        The largest entry of the sum of the weights less the identity.
    norm : float
        H-infinity norm of the fused error with these weights, from its frequency response.

    Examples
    --------
    >>> from inswsn_lib.lmi import design_filter, design_fusion
    >>> from inswsn_lib.models import ErrorModel
    >>> model = ErrorModel(A=[[1]], B=[[1]], C=[[1]], D=[[1]], L=[[1]], E=[[0]], period=1.0)
    >>> fusion = design_fusion([design_filter(model)] * 2)
    >>> certificate = fusion.certificate
    >>> certificate.norm <= fusion.level * (1 + 1e-6), certificate.weights_sum_error < 1e-9
    (True, True)
    """

    largest_eigenvalue: float
    weights_sum_error: float
    norm: float


@dataclass(frozen=True, eq=False)
class FusionDesign:
    """The weights of a fused estimate (P2 6).

    Attributes
    ----------
    designs : tuple of FilterDesign
        The N local filters.
    noise : {"common", "independent"}
        Whether the clusters share their process noise.
    structure : {"full", "block"}
        Of P.
    gamma : float
        The smallest bound on the gain from the noise to z that the inequality allows.
    level : float
        The bound that the weights were designed for, slightly above `gamma`; certified.
    weights : ndarray, (N, n, n)
        M_c.
    P : ndarray, (N n, N n) or (N, n, n)
        The solution of the inequality at `level`; with the structure "block" its diagonal blocks.
    certificate : FusionCertificate
        See there.
    status : str
        What the solver said: "Solved", or "AlmostSolved" if it did not reach its full accuracy.
    solver : str
        Its name: "Clarabel" or "SCS".

    Examples
    --------
    >>> from inswsn_lib.lmi import design_filter, design_fusion
    >>> from inswsn_lib.models import ErrorModel
    >>> model = ErrorModel(A=[[1]], B=[[1]], C=[[1]], D=[[1]], L=[[1]], E=[[0]], period=1.0)
    >>> fusion = design_fusion([design_filter(model)] * 2, structure="block")
    >>> fusion.weights.shape, fusion.P.shape, fusion.structure
    ((2, 1, 1), (2, 1, 1), 'block')
    """

    designs: tuple[FilterDesign, ...]
    noise: Noise
    structure: Structure
    gamma: float
    level: float
    weights: Array
    P: Array
    certificate: FusionCertificate
    status: str
    solver: str = "Clarabel"


@dataclass(frozen=True, eq=False)
class _Part:
    """A part of the inequality with a P of its own; it shares w and z with the other parts.

    Attributes
    ----------
    A, K : ndarray, (k, k) and (k, u)
        The system.
    shared : int
        So many of the inputs, the first, are the process noise that all parts share.
    turned : ndarray, (k, n)
        Takes an error that all clusters have in common to the states of the part. The weights Y of
        the parts satisfy sum Y turned = L.
    states : ndarray, (k, k)
        The states of the local filters are `states` times those of the part.
    """

    A: Array
    K: Array
    shared: int
    turned: Array
    states: Array

    def left_side(self, squared: Array, P: Array, Y: Array, W: Array, V: Array, Z: Array) -> Array:
        """Return the matrices that must be negative, for a batch of each of the variables."""
        states, inputs = self.K.shape
        last = states + inputs
        own = np.diag(np.arange(inputs) >= self.shared).astype(float)
        F = np.zeros((len(P), last + Y.shape[1], last + Y.shape[1]))
        process = slice(states, states + self.shared)
        F[:, :states, :states] = self.A.T @ P @ self.A - P
        F[:, :states, states:last] = self.A.T @ P @ self.K
        F[:, states:last, states:last] = self.K.T @ P @ self.K - squared[:, None, None] * own
        F[:, process, process] -= W
        F[:, :states, last:] = Y.transpose(0, 2, 1)
        F[:, process, last:] = V
        F[:, last:, last:] = -Z
        upper = np.triu(F)
        return np.asarray(upper + np.triu(F, 1).transpose(0, 2, 1))

    def coupling(self, Y: Array, W: Array, V: Array, Z: Array) -> Array:
        """Return what is summed over the parts, (batch, k): Y turned, Z, W and V as rows."""
        upper = [X[:, *np.triu_indices(X.shape[1])] for X in (Z, W)]
        return np.hstack(
            [(Y @ self.turned).reshape(len(Y), -1), *upper, V.reshape(len(V), V[0].size)]
        )

    def variables(self, seen: int) -> tuple[Array, Array, Array, Array, Array]:
        """Return P, Y, W, V and Z for each unknown of the part: one is 1 and all others 0."""
        k, s = len(self.A), self.shared
        kinds = [
            _symmetric_basis(k), _basis(seen, k), _symmetric_basis(s), _basis(s, seen),
            _symmetric_basis(seen),
        ]  # fmt: skip
        total = sum(len(kind) for kind in kinds)
        found, first = [], 0
        for kind in kinds:
            batch = np.zeros((total, *kind.shape[1:]))
            batch[first : first + len(kind)] = kind
            first += len(kind)
            found.append(batch)
        return found[0], found[1], found[2], found[3], found[4]


def design_fusion(
    designs: Sequence[FilterDesign],
    noise: Noise = "common",
    structure: Structure = "full",
    *,
    margin: float = 0.01,
    solver: Solver | None = None,
) -> FusionDesign:
    r"""Design the weights with which local H-infinity filters are fused (P2, theorem 1).

    With :math:`\tilde A = \mathrm{diag}(A_c)`, :math:`M = [M_1, \dots, M_N]` and K from
    `fusion_system`, the least :math:`\gamma` is found for which a symmetric P and weights with
    :math:`\sum_c M_c = I` satisfy

    .. math::
        \begin{bmatrix} \tilde A'P\tilde A - P & \tilde A'PK & (LM)' \\
        K'P\tilde A & K'PK - \gamma^2 I & 0 \\ LM & 0 & -I \end{bmatrix} \le 0.

    That is P2 (9): the Schur complement on the block :math:`-P` in its third row and column. P2
    needs that row since it multiplies P with unknown gains; here the local gains are known, so
    that :math:`\tilde A'P\tilde A` is linear in P. :math:`P \ge 0` need not be asked for: it
    follows from the first block, since the local filters are stable.

    Then, as in `design_filter`, that solution is taken which has the least
    :math:`\mathrm{tr}\, K'PK` at :math:`(1 + \mathrm{margin})\gamma`. This is a bound on the
    variance of z for white noise of unit variance. With the structure "full" and a large margin it
    is the variance, and the weights become those of least variance,
    :math:`(e'X^{-1}e)^{-1} e'X^{-1}` with the joint covariance X of the local errors and
    :math:`e = \mathrm{col}(I)`.

    With the structure "block" the matrix is made of parts, one for each cluster, that share only z
    and the common process noise w. Such a matrix is negative exactly if it is a sum of negative
    matrices, one for each part (Agler, Helton, McCullough and Rodman 1988). So the large
    inequality is replaced by N small ones:

    .. math::
        \begin{bmatrix} A_c'P_cA_c - P_c & A_c'P_cB & A_c'P_cG_c & (LM_c)' \\
        \cdot & B'P_cB - W_c & B'P_cG_c & V_c \\
        \cdot & \cdot & G_c'P_cG_c - \gamma^2 I & 0 \\
        \cdot & \cdot & \cdot & -Z_c \end{bmatrix} \le 0, \qquad
        \sum_c W_c = \gamma^2 I,\ \sum_c V_c = 0,\ \sum_c Z_c = I,

    with :math:`G_c = -K_cD_c`. For noise of each cluster's own, there are no :math:`W_c` and
    :math:`V_c`. The time grows in proportion to N. For the structure "full", it grows with about
    the fifth power.

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
        By which share the bound may be above the smallest one; positive.
    solver : {"clarabel", "scs"}, optional
        As for `design_filter`.

    Returns
    -------
    FusionDesign
        A design that has passed its certificate.

    Raises
    ------
    InfeasibleDesignError
        If a local filter is not stable, the solver fails, or its answer does not pass the
        certificate.
    ParameterError
        If the designs are none, differ in A, B or L, or have a jitter; if there is no such noise,
        structure or solver; or the margin is not positive and at most 1e9.

    Examples
    --------
    Two clusters with the gain 1 and noises of unit size: half of each leaves the common process
    noise and half of the variance of the measurements, so that :math:`\gamma = \sqrt{3/2}`:

    >>> from inswsn_lib.lmi import design_filter, design_fusion
    >>> from inswsn_lib.models import ErrorModel
    >>> model = ErrorModel(A=[[1]], B=[[1]], C=[[1]], D=[[1]], L=[[1]], E=[[0]], period=1.0)
    >>> designs = [design_filter(model, margin=1e-4)] * 2
    >>> fusion = design_fusion(designs)
    >>> print(f"{fusion.gamma:.3f}", [f"{weight:.2f}" for weight in fusion.weights.ravel()])
    1.225 ['0.50', '0.50']
    """
    local = _checked_designs(designs)
    check_options(noise, structure, margin)
    chosen_solver(solver)
    radius = max(spectral_radius(design.A_f) for design in local)
    if radius >= 1:
        raise InfeasibleDesignError(f"A local filter has the spectral radius {radius:.6g}.")
    return designed_by(
        solver, lambda by, once: _designed_in_some_states(local, noise, structure, margin, by, once)
    )


def _designed_in_some_states(
    local: tuple[FilterDesign, ...],
    noise: Noise,
    structure: Structure,
    margin: float,
    solver: Solver,
    once: bool,
) -> FusionDesign:
    """Return the design in the first states in which the solver has no difficulties."""
    found: FusionDesign | None = None
    failure: InfeasibleDesignError | None = None
    # the first states work nearly always; where the solver has difficulties, others may help
    for states in _STATES[: 1 if once else None]:
        try:
            design = _designed(local, noise, structure, margin, states, solver)
        except InfeasibleDesignError as error:
            failure = failure or error
            continue
        if design.status == SOLVED:
            return design
        found = found or design
    if found is None:
        assert failure is not None
        raise failure
    return found


def check_options(noise: Noise, structure: Structure, margin: float) -> None:
    """Refuse what `design_fusion` does not take as its noise, structure or margin.

    Raises
    ------
    ParameterError
        See `design_fusion`.
    """
    _checked_noise(noise)
    if not (isinstance(structure, str) and structure in ("full", "block")):
        raise ParameterError("structure", structure, 'one of "full", "block"')
    if not (isinstance(margin, Real) and 0 < margin <= _LARGEST_MARGIN):
        raise ParameterError("margin", margin, f"positive, at most {_LARGEST_MARGIN:g}")


def _designed(
    designs: tuple[FilterDesign, ...],
    noise: Noise,
    structure: Structure,
    margin: float,
    states: States,
    solver: Solver,
) -> FusionDesign:
    units, parts = _balanced(designs, noise, structure, states)
    gamma, weights, blocks, status = _solve_in(units, parts, len(designs), margin, solver)
    P = blocks[0] if structure == "full" else np.stack(blocks)
    level = gamma * (1 + margin)
    certificate = _certificate(designs, noise, weights, P, level)
    return FusionDesign(
        designs, noise, structure, gamma, level, weights, P, certificate, status,
        solver_title(solver),
    )  # fmt: skip


def fusion_system(
    designs: Sequence[FilterDesign], weights: ArrayLike, noise: Noise = "common"
) -> tuple[Array, Array, Array]:
    """Return the system of the fused error (P2 13): the stacked local errors, seen through L M.

    Parameters
    ----------
    designs : sequence of FilterDesign
        As for `design_fusion`.
    weights : array_like, (N, n, n)
        M_c; their sum is not looked at.
    noise : {"common", "independent"}
        The input is (w, xi_1, ..., xi_N), or (w_1, xi_1, ..., w_N, xi_N).

    Returns
    -------
    A : ndarray, (N n, N n)
    B : ndarray, (N n, inputs)
        K of P2 (13).
    L : ndarray, (l, N n)
        [L M_1, ..., L M_N].

    Raises
    ------
    ParameterError
        If the designs do not fit together, there is no such noise, or the weights have another
        shape or are not finite.

    Examples
    --------
    >>> from inswsn_lib.lmi import design_filter, fusion_system
    >>> from inswsn_lib.models import ErrorModel
    >>> model = ErrorModel(A=[[1]], B=[[1]], C=[[1]], D=[[1]], L=[[1]], E=[[0]], period=1.0)
    >>> designs = [design_filter(model)] * 2
    >>> A, K, L = fusion_system(designs, [[[0.25]], [[0.75]]])
    >>> A.shape, K.shape  # the noises are w, xi_1 and xi_2
    ((2, 2), (2, 3))
    >>> L.tolist()
    [[0.25, 0.75]]
    """
    local = _checked_designs(designs)
    _checked_noise(noise)
    systems = [(design.A_f, _local_inputs(design)) for design in local]
    A, K = _stacked(systems, local[0].model.B.shape[1], noise)
    return A, K, np.hstack(list(local[0].model.L @ _checked_weights(weights, local)))


def fusion_gain(
    designs: Sequence[FilterDesign], weights: ArrayLike, noise: Noise = "common"
) -> float:
    """Return the gain from the noise to the fused error.

    Up to 64 stacked states it is the H-infinity norm, by `hinf_norm`. For more, it is the largest
    singular value over a grid of frequencies, with its peaks refined, where each cluster is solved
    for by itself. That is a lower bound. It is below the norm only by what a peak between the
    grid's frequencies may hide.

    Parameters
    ----------
    designs, weights, noise
        As for `fusion_system`.

    Returns
    -------
    float
        Infinite if a local filter is not stable.

    Raises
    ------
    ParameterError
        As `fusion_system`.

    Examples
    --------
    The worst case of one cluster alone, and of the mean of two:

    >>> from inswsn_lib.lmi import design_filter, fusion_gain
    >>> from inswsn_lib.models import ErrorModel
    >>> model = ErrorModel(A=[[1]], B=[[1]], C=[[1]], D=[[1]], L=[[1]], E=[[0]], period=1.0)
    >>> designs = [design_filter(model, margin=1e-4)] * 2
    >>> print(f"{fusion_gain(designs, [[[1.0]], [[0.0]]]):.3f}")
    1.414
    >>> print(f"{fusion_gain(designs, [[[0.5]], [[0.5]]]):.3f}")
    1.225
    """
    local = _checked_designs(designs)
    if len(local) * len(local[0].A_f) <= _LARGEST_STACK:
        return hinf_norm(*fusion_system(local, weights, noise))
    _checked_noise(noise)
    return _swept_gain(local, _checked_weights(weights, local), noise)


def tied_level(designs: Sequence[FilterDesign], noise: Noise = "independent") -> float:
    r"""Return the least level of P2 (9) if P is tied to the local solutions.

    One may read P2's theorem 1 such that :math:`\tilde P = \mathrm{diag}(P_c)` holds the solutions
    of (10), so that only M is free in (9). The inputs are eliminated by a Schur complement, with

    .. math::
        X(g) = P - \tilde A'P\tilde A - \tilde A'PK (g^2 I - K'PK)^{-1} K'P\tilde A,

    and :math:`X \ge M'L'LM` is left. It has a solution M exactly if :math:`X \ge 0` and
    :math:`e'Xe \ge L'L` with :math:`e = \mathrm{col}(I)`, since the least of :math:`MX^{-1}M'`
    under :math:`Me = I` is :math:`(e'Xe)^{-1}`. X rises with g, so that the least g is found by
    bisection, without a solver.

    Parameters
    ----------
    designs : sequence of FilterDesign
        As for `design_fusion`; their P is used as it is, with whatever margin it was found.
    noise : {"common", "independent"}
        P2 (9) has "independent".

    Returns
    -------
    float

    Raises
    ------
    InfeasibleDesignError
        If there is no such level, which certified designs rule out.
    ParameterError
        If the designs do not fit together, or there is no such noise.

    Examples
    --------
    Tied to the local solutions, the fusion of two clusters promises no more than each has alone,
    :math:`\sqrt 2`. With P free the level of two with noises of their own is 1:

    >>> from inswsn_lib.lmi import design_filter, design_fusion, tied_level
    >>> from inswsn_lib.models import ErrorModel
    >>> model = ErrorModel(A=[[1]], B=[[1]], C=[[1]], D=[[1]], L=[[1]], E=[[0]], period=1.0)
    >>> designs = [design_filter(model, margin=1e-4)] * 2
    >>> print(f"{tied_level(designs):.2f}")
    1.41
    >>> print(f"{design_fusion(designs, noise='independent').gamma:.2f}")
    1.00
    """
    local = _checked_designs(designs)
    _checked_noise(noise)
    structure: Structure = "full" if noise == "common" else "block"
    units, parts = _balanced(local, noise, structure, "designs")
    own = [design.P / units.seen**2 for design in local]
    if noise == "common":
        own = [np.asarray(block_diag(*own))]
    P = [part.states.T @ p @ part.states for part, p in zip(parts, own, strict=True)]
    # with independent noise the largest local level serves, with common noise sqrt(N) times it
    low, high = 0.0, 2 * len(local) ** 0.5 * max(design.level for design in local) / units.seen
    if not _tied(parts, P, units.L, high):
        raise InfeasibleDesignError("The local solutions satisfy the inequality at no level.")
    for _ in range(_BISECTIONS):
        middle = (low + high) / 2
        low, high = (low, middle) if _tied(parts, P, units.L, middle) else (middle, high)
    return float(high * units.seen)


def _tied(parts: list[_Part], P: list[Array], L: Array, level: float) -> bool:
    """Tell whether weights exist for P at a level, all in the same units."""
    total = -L.T @ L
    for part, p in zip(parts, P, strict=True):
        PK = p @ part.K
        try:
            factor = cho_factor(level**2 * np.eye(part.K.shape[1]) - part.K.T @ PK)
        except LinAlgError:
            return False
        driven = part.A.T @ PK
        X = p - part.A.T @ p @ part.A - driven @ cho_solve(factor, driven.T)
        if np.linalg.eigvalsh(X).min() < -_ROUNDING * np.abs(p).max():
            return False
        total = total + part.turned.T @ X @ part.turned
    return bool(np.linalg.eigvalsh(total).min() >= -_ROUNDING * np.abs(L.T @ L).max())


@dataclass(frozen=True, eq=False)
class _Units:
    """Units of the fused state and of z in which L is of the order of one.

    Attributes
    ----------
    common : ndarray, (n, n)
        The fused state is `common` times the new one.
    seen : float
        What z is measured in: the level of the best cluster.
    L : ndarray, (rank, n)
        L in these units, less the rows that depend on others; L'L is what it was.
    """

    common: Array
    seen: float
    L: Array

    @classmethod
    def of(cls, designs: tuple[FilterDesign, ...], local: list[Array]) -> _Units:
        """Take the states of the best cluster."""
        best = min(range(len(designs)), key=lambda c: designs[c].level)
        seen = designs[best].level
        _, sizes, rows = np.linalg.svd(designs[0].model.L @ local[best] / seen, full_matrices=False)
        kept = sizes > _SEEN * sizes[0]
        return cls(local[best], seen, sizes[kept, None] * rows[kept])


def _balanced(
    designs: tuple[FilterDesign, ...], noise: Noise, structure: Structure, states: States
) -> tuple[_Units, list[_Part]]:
    """Return the parts of the inequality, one for each cluster or one for all, in other states.

    "covariance" takes those in which the errors of a part have the covariance I for white unit
    noise, "designs" those in which the P of each local design is its level squared times I.
    """
    B = _compressed(designs[0].model.B)
    p = B.shape[1]
    systems = [
        (design.A_f, np.hstack([B, _compressed(-design.gain @ design.model.D)]))
        for design in designs
    ]
    local = [np.asarray(design.level * np.linalg.inv(_root(design.P)).T) for design in designs]
    if states == "covariance":
        local = [_whitened(A, K, T) for (A, K), T in zip(systems, local, strict=True)]
    units = _Units.of(designs, local)
    if structure == "block":
        shared = p if noise == "common" else 0
        parts = [
            _part(A, K, shared, units.common, T) for (A, K), T in zip(systems, local, strict=True)
        ]
        return units, parts
    A, K = _stacked(systems, p, noise)
    T = np.asarray(block_diag(*local))
    if states == "covariance":
        T = _whitened(A, K, T)
    return units, [_part(A, K, 0, np.vstack([units.common] * len(designs)), T)]


def _compressed(B: Array) -> Array:
    """Return a matrix with the same B B' and as few columns as it can have, at least one."""
    rotated, sizes, _ = np.linalg.svd(B, full_matrices=False)
    kept = sizes > _SEEN * sizes[0]
    kept[0] = True
    return np.asarray(rotated[:, kept] * sizes[kept])


def _part(A: Array, K: Array, shared: int, turned: Array, T: Array) -> _Part:
    """Return a part in the states of which T times gives those of A, K and `turned`."""
    A, K, turned = (np.asarray(np.linalg.solve(T, X)) for X in (A @ T, K, turned))
    return _Part(A, K, shared, turned, T)


def _whitened(A: Array, K: Array, T: Array) -> Array:
    """Return other states T for which the covariance is I; those given make it well conditioned."""
    A, K = (np.asarray(np.linalg.solve(T, X)) for X in (A @ T, K))
    return T @ _root(solve_discrete_lyapunov(A, K @ K.T))


def _root(matrix: Array) -> Array:
    """Return R with R R' the matrix, its small eigenvalues raised; units of rows do not matter."""
    sizes = np.sqrt(np.maximum(np.diag(matrix), 1e-300))
    values, vectors = np.linalg.eigh(matrix / np.outer(sizes, sizes))
    raised = np.maximum(values, _SMALLEST * values.max())
    return np.asarray(sizes[:, None] * vectors * np.sqrt(raised))


def _local_inputs(design: FilterDesign) -> Array:
    """Return [B, -K_c D_c], (n, p + q)."""
    return np.hstack([design.model.B, -design.gain @ design.model.D])


def _stacked(systems: list[tuple[Array, Array]], p: int, noise: Noise) -> tuple[Array, Array]:
    """Return A and K of the stacked error of P2 (13); the first p inputs of a cluster are w."""
    A = np.asarray(block_diag(*(A for A, _ in systems)))
    if noise == "independent":
        return A, np.asarray(block_diag(*(K for _, K in systems)))
    own = block_diag(*(K[:, p:] for _, K in systems))
    return A, np.hstack([np.vstack([K[:, :p] for _, K in systems]), own])


def _solve_in(
    units: _Units, parts: list[_Part], clusters: int, margin: float, solver: Solver
) -> tuple[float, Array, list[Array], str]:
    """Solve both problems; return gamma, the weights, P of each part and the solver's word."""
    scale = _SHARE * clusters
    first = _program(parts, units.L, scale)
    cost = np.zeros(first.A.shape[1])
    cost[0] = 1.0
    solution, status = _solved(first, cost, solver)
    gamma = float(np.sqrt(max(solution[0], 0.0)))
    level = gamma * (1 + margin)
    if not level > 0:
        raise InfeasibleDesignError("The solver found no level above zero.")
    # with the noise in units of the level, a large margin does no harm
    scaled = [replace(part, K=part.K / level) for part in parts]
    cost = np.concatenate([_variance_bounds(part, len(units.L)) for part in parts])
    solution, last = _solved(_program(scaled, units.L, scale).at_level_one(), cost, solver)
    Y, P = [], []
    for part, (own, p) in zip(parts, _read(parts, solution, len(units.L)), strict=True):
        back = np.linalg.inv(part.states)
        Y.append(own @ back)
        P.append(units.seen**2 * back.T @ p @ back)
    return gamma * units.seen, _weights(units, np.hstack(Y), clusters), P, _worse(status, last)


@dataclass(frozen=True, eq=False)
class _Program:
    """A convex problem in the form of the solvers: A x + s = b, with s in a product of cones.

    The first `zeros` entries of s are zero; the others are triangles of positive semidefinite
    matrices with `sizes` rows.

    x is `scale` times the unknowns: each cluster has a share of about 1 / N in the sums, and the
    solver is accurate if its numbers are not small.
    """

    A: sparse.csc_matrix
    b: Array
    zeros: int
    sizes: list[int]
    scale: float

    def at_level_one(self) -> _Program:
        """Return the problem with the first unknown, the level squared, set to one."""
        level = self.A[:, [0]].toarray()[:, 0]
        return replace(self, A=self.A[:, 1:], b=self.b - self.scale * level)


def _program(parts: list[_Part], L: Array, scale: float) -> _Program:
    """Return the inequalities of all parts; the unknowns are the level squared, then the parts'."""
    seen = len(L)
    one, shared = np.ones(1), parts[0].shared
    sums, level_rows, blocks, sizes = [], [], [], []
    for part in parts:
        unknowns = part.variables(seen)
        sums.append(part.coupling(*unknowns[1:]))
        blocks.append(
            sparse.csc_matrix(_vector(part.left_side(np.zeros(len(unknowns[0])), *unknowns)))
        )
        none = tuple(np.zeros((1, *kind.shape[1:])) for kind in unknowns)
        level_rows.append(_vector(part.left_side(one, *none)))
        sizes.append(part.K.shape[0] + part.K.shape[1] + seen)
    # the sums: L, the identity, level squared times the identity, and zero
    eye = [np.eye(size)[np.triu_indices(size)] for size in (seen, shared)]
    fixed = np.concatenate([L.ravel(), eye[0], 0 * eye[1], np.zeros(shared * seen)])
    moving = np.concatenate([0 * L.ravel(), 0 * eye[0], -eye[1], np.zeros(shared * seen)])
    first = np.concatenate([moving[:, None], *level_rows])
    rest = sparse.vstack([np.vstack(sums).T, sparse.block_diag(blocks)])
    A = sparse.hstack([first, rest], format="csc")
    b = np.concatenate([scale * fixed, np.zeros(A.shape[0] - len(fixed))])
    return _Program(A, b, len(fixed), sizes, scale)


def _solved(program: _Program, cost: Array, solver: Solver) -> tuple[Array, str]:
    """Return the unknowns of least cost and the solver's word."""
    solution, status = solve_cones(program.A, program.b, cost, program.zeros, program.sizes, solver)
    if status not in (SOLVED, ALMOST):
        raise InfeasibleDesignError(
            f"No solution of the inequality was found: the solver says {status}."
        )
    return solution / program.scale, status


def _worse(one: str, other: str) -> str:
    return one if one != SOLVED else other


def _variance_bounds(part: _Part, seen: int) -> Array:
    """Return tr K'PK for each unknown of a part."""
    P = part.variables(seen)[0]
    return np.asarray(np.einsum("kij,ij->k", P, part.K @ part.K.T))


def _read(parts: list[_Part], solution: Array, seen: int) -> list[tuple[Array, Array]]:
    """Return Y and P of each part."""
    found, first = [], 0
    for part in parts:
        P, Y, *_ = part.variables(seen)
        values = solution[first : first + len(P)]
        first += len(values)
        found.append((np.tensordot(values, Y, 1), np.tensordot(values, P, 1)))
    return found


def _weights(units: _Units, Y: Array, clusters: int) -> Array:
    """Return M_c from L M_c; what L does not see has the weight 1 / N. Their sum is made exact."""
    n = len(units.common)
    each = Y.reshape(len(units.L), clusters, n).transpose(1, 0, 2)
    backwards = np.linalg.pinv(units.L)
    unseen = (np.eye(n) - backwards @ units.L) @ np.linalg.inv(units.common)
    weights = units.common @ (backwards @ each + unseen / clusters)
    return np.asarray(weights + (np.eye(n) - weights.sum(axis=0)) / clusters)


def _vector(matrices: Array) -> Array:
    """Return symmetric matrices (k, s, s) as the columns that `solve_cones` takes.

    They hold the upper triangle, column by column, the entries off the diagonal times root 2.
    """
    columns, rows = np.tril_indices(matrices.shape[1])
    return np.asarray((matrices[:, rows, columns] * np.where(rows == columns, 1.0, 2**0.5)).T)


def _basis(rows: int, columns: int) -> Array:
    """Return the matrices (k, rows, columns) with one entry that is 1."""
    return np.eye(rows * columns).reshape(rows * columns, rows, columns)


def _symmetric_basis(size: int) -> Array:
    """Return the symmetric matrices (k, size, size) with one entry, or two, that are 1."""
    rows, columns = np.triu_indices(size)
    found = np.zeros((len(rows), size, size))
    found[np.arange(len(rows)), rows, columns] = 1.0
    found[np.arange(len(rows)), columns, rows] = 1.0
    return found


def _certificate(
    designs: tuple[FilterDesign, ...], noise: Noise, weights: Array, P: Array, level: float
) -> FusionCertificate:
    """Return the certificate of weights; raise if they do not keep the level."""
    largest = _largest_eigenvalue(designs, noise, weights, P, level)
    error = float(np.abs(weights.sum(axis=0) - np.eye(weights.shape[1])).max())
    norm = fusion_gain(designs, weights, noise)
    complaints = {
        f"the inequality has the eigenvalue {largest:.3g}": not largest <= _TOLERANCE,
        f"the weights miss the identity by {error:.3g}": not error <= _ROUNDING,
        f"the norm is {norm:.6g}, above {level:.6g}": not norm <= level * (1 + _TOLERANCE),
    }
    failed = [complaint for complaint, fails in complaints.items() if fails]
    if failed:
        raise InfeasibleDesignError(
            f"The design does not pass its certificate: {'; '.join(failed)}."
        )
    return FusionCertificate(largest, error, norm)


def _largest_eigenvalue(
    designs: tuple[FilterDesign, ...], noise: Noise, weights: Array, P: Array, level: float
) -> float:
    """Return the largest eigenvalue of the left side, all clusters in one matrix."""
    units, (whole,) = _balanced(designs, noise, "full", "designs")
    turn = whole.states
    P = turn.T @ (P if P.ndim == 2 else block_diag(*P)) @ turn / units.seen**2
    A, K = whole.A, whole.K / (level / units.seen)
    LM = np.hstack(list(designs[0].model.L @ weights)) @ turn / units.seen
    F = np.block(
        [
            [A.T @ P @ A - P, A.T @ P @ K, LM.T],
            [K.T @ P @ A, K.T @ P @ K - np.eye(K.shape[1]), np.zeros((K.shape[1], len(LM)))],
            [LM, np.zeros((len(LM), K.shape[1])), -np.eye(len(LM))],
        ]
    )
    last = len(F) - 1
    return float(eigvalsh(F, subset_by_index=(last, last))[0] / np.abs(F).max())


def _swept_gain(designs: tuple[FilterDesign, ...], weights: Array, noise: Noise) -> float:
    """Return the largest singular value of the fused error over frequencies, peaks refined."""
    poles = np.concatenate([np.linalg.eigvals(design.A_f) for design in designs])
    if np.abs(poles).max() >= 1:
        return float("inf")
    width = 1 - np.abs(poles)  # of the peak of a pole
    near = np.concatenate([np.abs(np.angle(poles)) + k * width for k in (-1, 0, 1)])
    angles = np.unique(np.clip(np.concatenate([np.linspace(0, np.pi, _SWEEP), near]), 0, np.pi))
    sizes = _sizes(designs, weights, noise, angles)
    best = float(sizes.max())
    for _ in range(_ZOOMS):
        peaks = np.argsort(sizes)[-_REFINED:]
        left, right = (
            angles[np.maximum(peaks - 1, 0)],
            angles[np.minimum(peaks + 1, len(angles) - 1)],
        )
        angles = np.unique(np.linspace(left, right, _ZOOM))
        sizes = _sizes(designs, weights, noise, angles)
        best = max(best, float(sizes.max()))
    return best


def _sizes(designs: tuple[FilterDesign, ...], weights: Array, noise: Noise, angles: Array) -> Array:
    """Return the largest singular value of the fused error at frequencies, (k,).

    It is the root of the largest eigenvalue of the response times its adjoint, to which each
    cluster adds a term, and the common process noise another.
    """
    model = designs[0].model
    outputs, p = len(model.L), model.B.shape[1]
    squares = np.zeros((len(angles), outputs, outputs), dtype=complex)
    common = np.zeros((len(angles), outputs, p), dtype=complex)
    circle = np.exp(1j * angles)[:, None, None] * np.eye(len(model.A))
    for design, weight in zip(designs, weights, strict=True):
        response = model.L @ weight @ np.linalg.solve(circle - design.A_f, _local_inputs(design))
        if noise == "common":
            common += response[:, :, :p]
            response = response[:, :, p:]
        squares += response @ response.conj().transpose(0, 2, 1)
    squares += common @ common.conj().transpose(0, 2, 1)
    return np.asarray(np.sqrt(np.maximum(np.linalg.eigvalsh(squares)[:, -1], 0.0)))


def _checked_designs(designs: Sequence[FilterDesign]) -> tuple[FilterDesign, ...]:
    """Return the designs as a tuple; refuse those that cannot be fused."""
    may_be = "one or more designs of `design_filter`, without jitter, with the same A, B and L"
    if not isinstance(designs, Sequence):
        raise ParameterError("designs", designs, may_be)
    local = tuple(designs)
    if not local:
        raise ParameterError("designs", "empty", may_be)
    for design in local:
        if not isinstance(design, FilterDesign):
            raise ParameterError("designs", design, may_be)
        if design.model.E.any():
            raise ParameterError("designs", "for a model with jitter", may_be)
        for name in "ABL":
            if not np.array_equal(getattr(design.model, name), getattr(local[0].model, name)):
                raise ParameterError("designs", f"for models that differ in {name}", may_be)
    return local


def _checked_noise(noise: str) -> None:
    if not (isinstance(noise, str) and noise in ("common", "independent")):
        raise ParameterError("noise", noise, 'one of "common", "independent"')


def _checked_weights(weights: ArrayLike, designs: tuple[FilterDesign, ...]) -> Array:
    shape = (len(designs), *designs[0].model.A.shape)
    try:
        found = np.asarray(weights)
    except (TypeError, ValueError):
        raise ParameterError("weights", "not numbers", f"finite, {shape}") from None
    if found.dtype.kind not in "biuf":
        raise ParameterError("weights", f"{found.dtype}", f"finite, {shape}")
    if found.shape != shape or not np.isfinite(found).all():
        raise ParameterError("weights", f"of shape {found.shape}", f"finite, {shape}")
    return np.asarray(found, dtype=float)
