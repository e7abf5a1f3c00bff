"""The H-infinity filter of P1 and P2 as a convex problem, each design with its own certificate."""

from __future__ import annotations

import threading
import warnings
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import cvxpy as cp
import numpy as np
from numpy.typing import NDArray

from inswsn_lib.errors import ParameterError
from inswsn_lib.lmi.designs import Certificate, FilterDesign, Form
from inswsn_lib.lmi.norms import (
    hinf_norm,
    mean_square_radius,
    riccati_gain_below,
    spectral_radius,
)
from inswsn_lib.lmi.solvers import (
    InfeasibleDesignError,
    Solver,
    chosen_solver,
    cvxpy_options,
    designed_by,
    solver_title,
)
from inswsn_lib.models import ErrorModel

Array = NDArray[np.float64]

_KALMAN_STEPS = 40
# The solver's answer may break the inequality by this share of its largest entry.
_TOLERANCE = 1e-6
_LARGEST = 1e9  # margin; far above it the least bound is lost in rounding


def inequality(model: ErrorModel, P: Any, Q: Any, squared: Any, form: Form) -> list[list[Any]]:
    r"""Return the blocks of the matrix that must be negative definite.

    With :math:`\Gamma = PA - QC`, :math:`\Lambda = PB_1 - QD_1`, :math:`B_1 = [B\ 0]`,
    :math:`D_1 = [0\ D]`:

    .. math::
        \begin{bmatrix} -P + L'L & 0 & \Gamma' & E'P \\ 0 & -\gamma^2 I & \Lambda' & 0 \\
        \Gamma & \Lambda & -P & 0 \\ PE & 0 & 0 & -P \end{bmatrix}

    is the bounded real lemma for (2.11), and the form "exact". The form "printed" has one more
    row and column, :math:`(\Gamma, 0, 0, 0, -P)`: P1 (2.15), with L eliminated.

    Parameters
    ----------
    model : ErrorModel
        The model, with arrays or with parameters of a convex problem as its matrices.
    P, Q : array or cvxpy expression, (n, n) and (n, m)
        Q = P B_f.
    squared : float or cvxpy expression
        The bound squared.
    form : {"exact", "printed"}
        Which inequality.

    Returns
    -------
    list of lists of arrays or cvxpy expressions
        The rows of blocks, for ``numpy.block`` or ``cvxpy.bmat``.

    Examples
    --------
    P1 (2.15) as printed has one block row more than the bounded real lemma:

    >>> import numpy as np
    >>> from inswsn_lib.lmi import inequality, negative_definite
    >>> from inswsn_lib.models import ErrorModel
    >>> model = ErrorModel(A=[[1]], B=[[1]], C=[[1]], D=[[1]], L=[[1]], E=[[0]], period=1.0)
    >>> P, Q = np.array([[1.1]]), np.array([[1.1]])  # the gain Q / P is 1
    >>> for form in ("exact", "printed"):
    ...     matrix = np.block(inequality(model, P, Q, 1.6**2, form))
    ...     print(matrix.shape, negative_definite(matrix))
    (5, 5) True
    (6, 6) True
    """
    return _blocks(
        model.A, model.B, model.C, model.D, model.L.T @ model.L, model.E, P, Q, squared, form
    )


def _blocks(
    A: Any, B: Any, C: Any, D: Any, LL: Any, E: Any, P: Any, Q: Any, squared: Any, form: Form
) -> list[list[Any]]:
    n, p, q = A.shape[0], B.shape[1], D.shape[1]
    error, process, measurement, jitter = P @ A - Q @ C, P @ B, -(Q @ D), P @ E
    nn, np_, nq, pq = (np.zeros(s) for s in ((n, n), (n, p), (n, q), (p, q)))
    rows = [
        [-P + LL, np_, nq, error.T, jitter.T],
        [np_.T, -squared * np.eye(p), pq, process.T, np_.T],
        [nq.T, pq.T, -squared * np.eye(q), measurement.T, nq.T],
        [error, process, measurement, -P, nn],
        [jitter, np_, nq, nn, -P],
    ]
    if form == "printed":
        last = [error, np_, nq, nn, nn, -P]
        rows = [
            [*row, block] for row, block in zip(rows, (error.T, np_.T, nq.T, nn, nn), strict=True)
        ]
        rows.append(last)
    return rows


def design_filter(
    model: ErrorModel,
    form: Form = "exact",
    *,
    margin: float = 0.01,
    solver: Solver | None = None,
) -> FilterDesign:
    r"""Design the H-infinity filter of a model.

    First the smallest gamma is found for which `inequality` has a solution. The gain that attains
    it is not unique in general: often one channel sets gamma and leaves the gains of the others
    open. So the gain is that of a second problem: among all P and Q that satisfy the inequality at
    (1 + margin) gamma, the one with the least :math:`\mathrm{tr}\, \tilde B' P \tilde B`. That is a
    bound on the variance of :math:`L e` for white noise of unit variance. A small margin gives the
    filter with the least worst case; with a large one the filter of the exact form becomes the
    Kalman predictor. Its least value does not depend
    on the solver. Neither does the gain, if L sees all states; states that L does not see may have
    any gain that keeps them stable.

    The problems are solved in units in which the noise, the states of a Kalman filter and L are of
    the order of one, and then in states in which a first solution P is the identity.

    Parameters
    ----------
    model : ErrorModel
        The model. With a jitter E, the error system is that of (2.11), in which the filter knows
        the jitter of each step.
    form : {"exact", "printed"}
        The bounded real lemma, or the inequality (2.15) as P1 prints it.
    margin : float
        By which share the bound may be above the smallest one; positive.
    solver : {"clarabel", "scs"}, optional
        An interior-point method, or a first-order method, which is slower and less accurate and
        there to check the first. Default: the one that the environment variable ``INSWSN_SOLVER``
        names, or else "clarabel"; where an answer of SCS that was asked for by the variable is
        refused, Clarabel is asked.

    Returns
    -------
    FilterDesign
        A design that has passed its certificate.

    Raises
    ------
    InfeasibleDesignError
        If no solution is found, for example because a mode that cannot be observed is not stable,
        or the solver's answer does not pass the certificate.
    ParameterError
        If there is no such form or solver, the margin is not positive and at most 1e9, or B or L is
        zero.

    Examples
    --------
    The least worst case of a random walk with noises of unit size is :math:`\sqrt 2`, at the gain
    1. A large margin leaves the Kalman predictor, whose gain is one over the golden ratio:

    >>> from inswsn_lib.lmi import design_filter
    >>> from inswsn_lib.models import ErrorModel
    >>> model = ErrorModel(A=[[1]], B=[[1]], C=[[1]], D=[[1]], L=[[1]], E=[[0]], period=1.0)
    >>> for margin in (0.0001, 0.01, 1000.0):
    ...     design = design_filter(model, margin=margin)
    ...     print(f"{design.gamma:.3f} {design.gain.item():.2f}")
    1.414 1.00
    1.414 0.99
    1.414 0.62
    """
    if not 0 < margin <= _LARGEST:
        raise ParameterError("margin", margin, f"positive, at most {_LARGEST:g}")
    _check(form, solver)
    for name in "BL":
        if not getattr(model, name).any():
            raise ParameterError(name, "zero", "a matrix that is not zero")
    return designed_by(solver, lambda by, once: _designed(model, form, margin, by, once))


def _designed(
    model: ErrorModel, form: Form, margin: float, solver: Solver, once: bool
) -> FilterDesign:
    """Return the design by one solver, after one try or several."""
    problems = _problems(_shape(model), form, solver)
    units = _Units.of(model)
    plain = units.scaled(model)
    failure: InfeasibleDesignError | None = None
    # the first works nearly always; where the solver fails, other states of the same problem help
    starts = (np.eye(len(model.A)), _inverse_root(units.correlation))
    tries = [(start, rounds) for start in starts for rounds in (1, 2)]
    for start, rounds in tries[: 1 if once else None]:
        try:
            gamma, status, P, gain = _solve_balanced(problems, plain, margin, start, rounds)
            P = units.seen**2 * P / np.outer(units.states, units.states)
            gain = units.states[:, None] * gain / units.outputs
            gamma *= units.seen
            level = gamma * (1 + margin)
            certificate = certify(model, P, gain, level, form)
        except InfeasibleDesignError as error:
            failure = failure or error
            continue
        return FilterDesign(
            model, form, gamma, level, gain, np.asarray(model.A - gain @ model.C), P,
            certificate, not model.E.any(), status, solver_title(solver),
        )  # fmt: skip
    assert failure is not None
    raise failure


def _solve_balanced(
    problems: _Problems, plain: ErrorModel, margin: float, S: Array, rounds: int
) -> tuple[float, str, Array, Array]:
    """Solve both problems in states in which an earlier solution P is the identity.

    Returns gamma, the solver's word, P and the gain, all in the states of `plain`; S holds the
    first states to be tried.
    """
    for _ in range(rounds):
        _, _, P, _ = problems.smallest_gamma(_in_other_states(plain, S))
        S = _square_root(P) @ S
    balanced = _in_other_states(plain, S)
    gamma, status, _, _ = problems.smallest_gamma(balanced)
    P, Q = problems.least_variance(balanced, gamma * (1 + margin))
    return gamma, status, S.T @ P @ S, np.linalg.solve(S, np.linalg.solve(P, Q))


def minimise_gamma(
    model: ErrorModel, form: Form = "exact", *, solver: Solver | None = None
) -> tuple[float, Array]:
    r"""Solve P1 (2.23) as it stands: the least gamma over P and Q, and :math:`B_f = P^{-1} Q`.

    There is no second criterion. Where many gains attain the least gamma, or nearly, the solver
    decides which one it is. Use `design_filter` for a filter that is to be run.

    Parameters
    ----------
    model : ErrorModel
        The model; its units are left as they are.
    form : {"exact", "printed"}
        The inequality.
    solver : {"clarabel", "scs"}, optional
        As for `design_filter`.

    Returns
    -------
    gamma : float
    gain : ndarray, (n, m)
        B_f, without a certificate.

    Raises
    ------
    InfeasibleDesignError
        If no solution is found.
    ParameterError
        If there is no such form or solver.

    Examples
    --------
    >>> from inswsn_lib.lmi import minimise_gamma
    >>> from inswsn_lib.models import ErrorModel
    >>> model = ErrorModel(A=[[1]], B=[[1]], C=[[1]], D=[[1]], L=[[1]], E=[[0]], period=1.0)
    >>> gamma, gain = minimise_gamma(model)
    >>> print(f"{gamma:.3f} {gain.item():.2f}")
    1.414 1.00
    """
    _check(form, solver)

    def solve(by: Solver, once: bool) -> tuple[float, Array]:
        gamma, status, P, Q = _problems(_shape(model), form, by).smallest_gamma(model)
        if once and status != "optimal":  # there is no certificate to tell
            raise InfeasibleDesignError(f"The solver says {status}.")
        return gamma, np.asarray(np.linalg.solve(P, Q))

    return designed_by(solver, solve)


def certify(model: ErrorModel, P: Array, gain: Array, level: float, form: Form) -> Certificate:
    """Return the certificate of a gain.

    Parameters
    ----------
    model : ErrorModel
        The model.
    P : ndarray, (n, n)
        The solution of the inequality.
    gain : ndarray, (n, m)
        B_f.
    level : float
        The bound that is to be certified.
    form : {"exact", "printed"}
        The inequality.

    Returns
    -------
    Certificate
        Of a gain that has passed all checks.

    Raises
    ------
    InfeasibleDesignError
        If P is not positive definite, the inequality does not hold, the error system is not
        stable in the mean square, or its gain, computed from its frequency response and by the
        Riccati iteration, is not below the level.
    ParameterError
        If P or the gain has another shape or is not finite, or the level is not positive.

    Examples
    --------
    With the gain 1 a random walk's error is :math:`e^+ = w - v`, and P need only be above 1:

    >>> import numpy as np
    >>> from inswsn_lib.lmi import certify
    >>> from inswsn_lib.models import ErrorModel
    >>> model = ErrorModel(A=[[1]], B=[[1]], C=[[1]], D=[[1]], L=[[1]], E=[[0]], period=1.0)
    >>> P, gain = np.array([[1.1]]), np.array([[1.0]])
    >>> certificate = certify(model, P, gain, level=1.6, form="exact")
    >>> print(f"{certificate.norm:.4f}", certificate.largest_eigenvalue < 0)
    1.4142 True
    """
    n, m = len(model.A), len(model.C)
    for name, matrix, shape in (("P", P, (n, n)), ("gain", gain, (n, m))):
        if np.shape(matrix) != shape or not np.isfinite(matrix).all():
            raise ParameterError(name, f"of shape {np.shape(matrix)}", f"finite, {shape}")
    if not 0 < level < np.inf:
        raise ParameterError("level", level, "positive and finite")
    values = np.linalg.eigvalsh(P)
    blocks = np.block(inequality(model, P, P @ gain, level**2, form))
    largest = float(np.linalg.eigvalsh(blocks).max() / np.abs(blocks).max())
    A, B = model.A - gain @ model.C, np.hstack([model.B, -gain @ model.D])
    norm = hinf_norm(A, B, model.L)
    slack = level * (1 + _TOLERANCE)
    radius = mean_square_radius(A, model.E)
    # without jitter the norm says it all; the iteration is slow near instability
    stochastic = not model.E.any() or riccati_gain_below(A, model.E, B, model.L, slack)
    complaints = {
        f"P has the eigenvalue {values.min():.3g}": values.min() <= 0,
        f"the inequality has the eigenvalue {largest:.3g}": largest > _TOLERANCE,
        f"the error system has the spectral radius {spectral_radius(A):.6g}": norm == np.inf,
        f"the error system has the mean-square radius {radius:.6g}": radius >= 1,
        f"the norm is {norm:.6g}, above {level:.6g}": norm > slack,
        "the Riccati iteration does not confirm the gain": not stochastic,
    }
    failed = [complaint for complaint, fails in complaints.items() if fails]
    if failed:
        raise InfeasibleDesignError(
            f"The design does not pass its certificate: {'; '.join(failed)}."
        )
    return Certificate(largest, float(values.min() / values.max()), norm, stochastic)


def _check(form: Form, solver: Solver | None) -> None:
    if form not in ("exact", "printed"):
        raise ParameterError("form", form, 'one of "exact", "printed"')
    chosen_solver(solver)


def _shape(model: ErrorModel) -> tuple[int, int, int, int]:
    return (*model.B.shape, model.C.shape[0], model.D.shape[1])


class _Problems:
    """The two convex problems for one shape of model, compiled once and solved with new numbers."""

    def __init__(self, shape: tuple[int, int, int, int], form: Form, solver: Solver) -> None:
        n, p, m, q = shape
        self._solver = cvxpy_options(solver)
        self._guard = threading.Lock()  # the problems hold the numbers of one model at a time
        sizes = {"A": (n, n), "B": (n, p), "C": (m, n), "D": (m, q), "LL": (n, n), "E": (n, n)}
        self._numbers = {name: cp.Parameter(size) for name, size in sizes.items()}
        self._P, self._Q = cp.Variable((n, n), symmetric=True), cp.Variable((n, m))
        self._squared = cp.Variable()
        A, B, C, D, LL, E = self._numbers.values()
        matrix = cp.bmat(_blocks(A, B, C, D, LL, E, self._P, self._Q, self._squared, form))
        self._first = cp.Problem(cp.Minimize(self._squared), [_symmetric(matrix) << 0])
        self._level = cp.Parameter(nonneg=True)
        matrix = cp.bmat(_blocks(A, B, C, D, LL, E, self._P, self._Q, self._level, form))
        driven = cp.hstack([self._P @ B, -(self._Q @ D)])
        bound = cp.Variable((p + q, p + q), symmetric=True)
        schur = cp.bmat([[bound, driven.T], [driven, self._P]])
        self._second = cp.Problem(
            cp.Minimize(cp.trace(bound)), [_symmetric(matrix) << 0, _symmetric(schur) >> 0]
        )

    def smallest_gamma(self, model: ErrorModel) -> tuple[float, str, Array, Array]:
        with self._guard:
            self._set(model)
            _solve(self._first, self._solver)
            squared, P = float(self._squared.value), np.asarray(self._P.value)
            gamma, Q = float(np.sqrt(max(squared, 0.0))), np.asarray(self._Q.value)
            return gamma, str(self._first.status), (P + P.T) / 2, Q

    def least_variance(self, model: ErrorModel, level: float) -> tuple[Array, Array]:
        with self._guard:
            self._set(model)
            self._level.value = level**2
            _solve(self._second, self._solver)
            P = np.asarray(self._P.value)
            return (P + P.T) / 2, np.asarray(self._Q.value)

    def _set(self, model: ErrorModel) -> None:
        for name, parameter in self._numbers.items():
            parameter.value = model.L.T @ model.L if name == "LL" else getattr(model, name)


@lru_cache(maxsize=32)
def _problems(shape: tuple[int, int, int, int], form: Form, solver: Solver) -> _Problems:
    return _Problems(shape, form, solver)


@dataclass(frozen=True, eq=False)
class _Units:
    """Units in which the numbers of a model are of the order of one.

    The states are measured in `states`, (n,), the outputs in `outputs`, (m,), and what L sees in
    `seen`. In these units `correlation`, (n, n), is the covariance of a Kalman filter's error.
    """

    states: Array
    outputs: Array
    seen: float
    correlation: Array

    @classmethod
    def of(cls, model: ErrorModel) -> _Units:
        """Take the outputs by their noise, and the states by what a Kalman filter makes of them."""
        Q, R = model.process_covariance, model.measurement_covariance
        floor = 1e-6 * max(float(np.trace(R)) / len(R), 1e-300)
        outputs = np.sqrt(np.maximum(np.diag(R), floor))
        C, R = model.C / outputs[:, None], R / np.outer(outputs, outputs)
        P = Q + 1e-12 * float(np.trace(Q)) * np.eye(len(Q))
        for _ in range(_KALMAN_STEPS):
            S = C @ P @ C.T + R + 1e-9 * np.eye(len(R))
            P = model.A @ (P - P @ C.T @ np.linalg.solve(S, C @ P)) @ model.A.T + Q
            P = (P + P.T) / 2
        sizes = np.sqrt(np.maximum(np.diag(P), 1e-12 * max(float(np.trace(P)), 1e-300)))
        if not np.isfinite(sizes).all() or not sizes.any():
            P, sizes = np.eye(len(Q)), np.ones(len(Q))
        seen = float(np.linalg.norm(model.L * sizes, 2)) or 1.0
        if not model.measurement_covariance.any():
            outputs = np.linalg.norm(model.C * sizes, axis=1)
            outputs = np.where(outputs > 0, outputs, 1.0)
        return cls(sizes, outputs, seen, P / np.outer(sizes, sizes))

    def scaled(self, model: ErrorModel) -> ErrorModel:
        """Return the model in these units."""
        t, o = self.states, self.outputs
        return ErrorModel(
            A=model.A * t / t[:, None], B=model.B / t[:, None], C=model.C * t / o[:, None],
            D=model.D / o[:, None], L=model.L * t / self.seen, E=model.E * t / t[:, None],
            period=model.period,
        )  # fmt: skip


def _square_root(P: Array) -> Array:
    """Return the symmetric square root of a positive definite matrix, rounding mended."""
    values, vectors = np.linalg.eigh(P)
    roots = np.sqrt(np.maximum(values, 1e-10 * values.max()))
    return np.asarray((vectors * roots) @ vectors.T)


def _inverse_root(P: Array) -> Array:
    """Return the symmetric root of the inverse of a covariance, tiny variances raised."""
    values, vectors = np.linalg.eigh(P)
    roots = 1 / np.sqrt(np.maximum(values, 1e-8 * values.max()))
    return np.asarray((vectors * roots) @ vectors.T)


def _in_other_states(model: ErrorModel, S: Array) -> ErrorModel:
    """Return the model for the states S x."""
    back = np.linalg.inv(S)
    return ErrorModel(
        A=S @ model.A @ back, B=S @ model.B, C=model.C @ back, D=model.D, L=model.L @ back,
        E=S @ model.E @ back, period=model.period,
    )  # fmt: skip


def _symmetric(matrix: Any) -> Any:
    return (matrix + matrix.T) / 2


def _solve(problem: Any, solver: dict[str, Any]) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # an inaccurate answer is judged by its certificate
        try:
            problem.solve(**solver)
        except cp.SolverError as error:
            raise InfeasibleDesignError(f"The solver failed on the inequality: {error}.") from None
    if problem.status not in ("optimal", "optimal_inaccurate"):
        raise InfeasibleDesignError(
            f"No solution of the inequality was found: the solver says {problem.status}."
        )
