"""The H-infinity filter of P1 and P2 as a convex problem, each design with its own certificate."""

from __future__ import annotations

import threading
from dataclasses import dataclass, replace
from functools import lru_cache, partial
from typing import Any

import cvxpy as cp
import numpy as np

from inswsn_lib.checks import Array, number, one_of
from inswsn_lib.errors import Described, ParameterError
from inswsn_lib.lmi.designs import Certificate, FilterDesign, Form, InfeasibleDesignError, Solver
from inswsn_lib.lmi.norms import hinf_norm, spectral_radius
from inswsn_lib.lmi.solvers import first_that_passes, in_order, solve
from inswsn_lib.lmi.stochastic import mean_square_radius, riccati_gain_below
from inswsn_lib.models import ErrorModel

FORMS = ("exact", "printed")
#: Far above it the least bound is lost in rounding
LARGEST_MARGIN = 1e9
#: A solver's answer may break the inequality, and the level, by this share
TOLERANCE = 1e-6
_KALMAN_STEPS = 40


def design_filter(
    model: ErrorModel,
    form: Form = "exact",
    *,
    margin: float = 0.01,
    solver: Solver | tuple[Solver, ...] = "clarabel",
) -> FilterDesign:
    r"""Design the H-infinity filter of a model.

    First the smallest gamma is found for which P and Q = P B_f satisfy, with
    :math:`\Gamma = PA - QC`,

    .. math::
        \begin{bmatrix} -P + L'L & 0 & 0 & \Gamma' & E'P \\ 0 & -\gamma^2 I & 0 & B'P & 0 \\
        0 & 0 & -\gamma^2 I & -D'Q' & 0 \\ \Gamma & PB & -QD & -P & 0 \\ PE & 0 & 0 & 0 & -P
        \end{bmatrix} \le 0 ,

    the bounded real lemma for (2.11). The form "printed" has one more row and column,
    :math:`(\Gamma, 0, 0, 0, 0, -P)`: P1 (2.15), with L eliminated.

    The gain that attains gamma is not unique in general: often one channel sets it and leaves the
    gains of the others open. So among all P and Q that satisfy the inequality at
    (1 + margin) gamma, those are taken that have the least :math:`\mathrm{tr}\,\tilde B'P\tilde B`,
    a bound on the variance of :math:`L e` for white noise of unit variance. A small margin gives
    the filter with the least worst case; with a large one the filter of the exact form becomes the
    Kalman predictor. States that L does not see may have any gain that keeps them stable.

    Parameters
    ----------
    model : ErrorModel
        With a jitter E, the error system is that of (2.11), whose filter knows each step's jitter.
    form : {"exact", "printed"}
        The bounded real lemma, or the inequality (2.15) as P1 prints it.
    margin : float
        By which share the bound may be above the smallest one; positive.
    solver : {"clarabel", "scs"} or a tuple of them
        An interior-point method, or a first-order method, slower and less accurate, to check the
        first. Of several the later are asked where the answers of those before are refused.

    Returns
    -------
    FilterDesign
        A design that has passed its certificate.

    Raises
    ------
    InfeasibleDesignError
        If no solution is found, as where a mode that is not seen is not stable, or none that
        passes the certificate.
    ParameterError
        If there is no such form, margin or solver, or B or L is zero.

    Examples
    --------
    The least worst case of a random walk with noises of unit size is :math:`\sqrt 2`, at the gain
    1. A large margin leaves the Kalman predictor, whose gain is one over the golden ratio:

    >>> import inswsn_lib as iw
    >>> model = iw.ErrorModel(A=[[1]], B=[[1]], C=[[1]], D=[[1]], period=1.0)
    >>> designs = [iw.design_filter(model, margin=margin) for margin in (0.0001, 1000.0)]
    >>> print([f"{design.gamma:.3f} {design.gain.item():.2f}" for design in designs])
    ['1.414 1.00', '1.414 0.62']
    """
    one_of("form", form, FORMS)
    number("margin", margin, above=0, most=LARGEST_MARGIN)
    solvers = in_order(solver)
    for name in "BL":
        if not getattr(model, name).any():
            raise ParameterError(name, Described("zero"), "a matrix that is not zero")
    units = _Units.of(model)
    # the first states work nearly always; where a solver fails, other states of the same problem
    # help
    return first_that_passes(
        partial(_designed, model, form, margin, units, start / units.states, rounds, by)
        for start in (np.eye(len(model.A)), _inverse_root(units.correlation))
        for rounds in (1, 2)
        for by in solvers
    )


def _designed(
    model: ErrorModel, form: Form, margin: float, units: _Units, S: Array, rounds: int, by: Solver
) -> FilterDesign:
    """Design in the states S x, and then in those in which a first solution P is the identity."""
    problems = _problems(_shape(model), form, by)
    for _ in range(rounds):
        P = problems.smallest_gamma(units.scaled(model, S))[2]
        S = _square_root(P) @ S
    balanced = units.scaled(model, S)
    gamma, status, _, _ = problems.smallest_gamma(balanced)
    P, Q = problems.least_variance(balanced, gamma * (1 + margin))
    gain = np.linalg.solve(S, np.linalg.solve(P, Q)) / units.outputs
    P = units.seen**2 * S.T @ P @ S
    gamma *= units.seen
    level = gamma * (1 + margin)
    certificate = certify(model, P, gain, level, form)
    return FilterDesign(model, form, gamma, level, gain, P, certificate, status, by)


def minimise_gamma(
    model: ErrorModel,
    form: Form = "exact",
    *,
    solver: Solver | tuple[Solver, ...] = "clarabel",
) -> tuple[float, Array]:
    r"""Solve P1 (2.23) as it stands: the least gamma over P and Q, and :math:`B_f = P^{-1} Q`.

    There is no second criterion and no certificate. Where many gains attain the least gamma, or
    nearly, the solver decides which one it is: `design_filter` is for filters that are to be run.

    Parameters
    ----------
    model, form, solver
        As in `design_filter`, and so are the errors.

    Returns
    -------
    gamma : float
    gain : ndarray, (n, m)
        B_f.

    Examples
    --------
    >>> import inswsn_lib as iw
    >>> model = iw.ErrorModel(A=[[1]], B=[[1]], C=[[1]], D=[[1]], period=1.0)
    >>> gamma, gain = iw.lmi.minimise_gamma(model)
    >>> print(f"{gamma:.3f} {gain.item():.2f}")
    1.414 1.00
    """
    one_of("form", form, FORMS)
    gamma, _, P, Q = first_that_passes(
        partial(_problems(_shape(model), form, by).smallest_gamma, model) for by in in_order(solver)
    )
    return gamma, np.asarray(np.linalg.solve(P, Q))


def central_gain(
    model: ErrorModel,
    level: float,
    form: Form = "exact",
    *,
    solver: Solver | tuple[Solver, ...] = "clarabel",
) -> Array:
    r"""Return the gain at the analytic centre of the inequality at a level.

    The centre is the pair P, Q that maximises the determinant of the left side of the inequality
    with its sign changed. A path-following method stays near such centres, one level after the
    other, so its gain is about this one wherever it is stopped. There is a centre if B has full
    row rank, so that P is bounded.

    Parameters
    ----------
    model, form, solver
        As in `design_filter`, and so are the errors.
    level : float
        The bound, above the least one, at most 1e100.

    Returns
    -------
    ndarray, (n, m)
        B_f.

    Examples
    --------
    Without measurement noise the gain is the deadbeat one, at whatever level:

    >>> import inswsn_lib as iw
    >>> model = iw.ErrorModel(A=[[1]], B=[[1]], C=[[1]], D=[[0]], period=1.0)
    >>> print(f"{iw.lmi.central_gain(model, level=2.0).item():.3f}")
    1.000
    """
    one_of("form", form, FORMS)
    number("level", level, above=0, most=1e100)
    P, Q = cp.Variable(model.A.shape, symmetric=True), cp.Variable(model.C.T.shape)
    matrix = cp.bmat(inequality(_numbers(model), P, Q, level**2, form))
    centre = cp.Problem(cp.Maximize(cp.log_det(-matrix)))
    first_that_passes(partial(solve, centre, by, accurate=True) for by in in_order(solver))
    return np.asarray(np.linalg.solve(P.value, Q.value))


def certify(model: ErrorModel, P: Array, gain: Array, level: float, form: Form) -> Certificate:
    """Return the certificate of a gain at a level, computed without any solver.

    It is refused if P is not positive definite, the inequality does not hold, the error system is
    not stable in the mean square, or its gain, from its frequency response and by the Riccati
    iteration, is above the level.
    """
    values = np.linalg.eigvalsh(P)
    blocks = np.block(inequality(_numbers(model), P, P @ gain, level**2, form))
    largest = float(np.linalg.eigvalsh(blocks).max() / np.abs(blocks).max())
    A, B = model.A - gain @ model.C, np.hstack([model.B, -gain @ model.D])
    norm, radius = hinf_norm(A, B, model.L), mean_square_radius(A, model.E)
    slack = level * (1 + TOLERANCE)
    # without jitter the norm says it all; the iteration is slow near instability
    stochastic = not model.E.any() or riccati_gain_below(A, model.E, B, model.L, slack)
    refuse_if({
        f"P has the eigenvalue {values.min():.3g}": values.min() <= 0,
        f"the inequality has the eigenvalue {largest:.3g}": largest > TOLERANCE,
        f"the error system has the spectral radius {spectral_radius(A):.6g}": norm == np.inf,
        f"the error system has the mean-square radius {radius:.6g}": radius >= 1,
        f"the norm is {norm:.6g}, above {level:.6g}": norm > slack,
        "the Riccati iteration does not confirm the gain": not stochastic,
    })  # fmt: skip
    return Certificate(largest, float(values.min() / values.max()), norm, stochastic)


def refuse_if(complaints: dict[str, bool]) -> None:
    """Raise what a certificate complains of."""
    failed = [complaint for complaint, fails in complaints.items() if fails]
    if failed:
        raise InfeasibleDesignError(
            f"The design does not pass its certificate: {'; '.join(failed)}."
        )


def inequality(
    numbers: dict[str, Any], P: Any, Q: Any, squared: Any, form: Form
) -> list[list[Any]]:
    """Return the blocks that must be negative, of arrays or of expressions of a convex problem.

    `numbers` has A, B, C, D and E of a model, and L'L as LL; `squared` is the bound squared.
    """
    A, B, C, D, E, LL = (numbers[name] for name in ("A", "B", "C", "D", "E", "LL"))
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
        column = (error.T, np_.T, nq.T, nn, nn)
        rows = [[*row, block] for row, block in zip(rows, column, strict=True)]
        rows.append([error, np_, nq, nn, nn, -P])
    return rows


def _numbers(model: ErrorModel) -> dict[str, Any]:
    return {name: getattr(model, name) for name in "ABCDE"} | {"LL": model.L.T @ model.L}


def _shape(model: ErrorModel) -> tuple[int, int, int, int]:
    return (*model.B.shape, *model.D.shape)


class _Problems:
    """The two convex problems for one shape of model, compiled once and solved with new numbers."""

    def __init__(self, shape: tuple[int, int, int, int], form: Form, solver: Solver) -> None:
        n, p, m, q = shape
        self._solver = solver
        self._guard = threading.Lock()  # the problems hold the numbers of one model at a time
        sizes = {"A": (n, n), "B": (n, p), "C": (m, n), "D": (m, q), "E": (n, n), "LL": (n, n)}
        self._numbers = {name: cp.Parameter(size) for name, size in sizes.items()}
        self._P, self._Q = P, Q = cp.Variable((n, n), symmetric=True), cp.Variable((n, m))
        self._squared, self._level = cp.Variable(), cp.Parameter(nonneg=True)
        least, held = (
            cp.bmat(inequality(self._numbers, P, Q, squared, form)) << 0
            for squared in (self._squared, self._level)
        )
        self.first = cp.Problem(cp.Minimize(self._squared), [least])
        driven = cp.hstack([P @ self._numbers["B"], -(Q @ self._numbers["D"])])
        bound = cp.Variable((p + q, p + q), symmetric=True)  # on B~' P B~
        schur = cp.bmat([[bound, driven.T], [driven, P]])
        self.second = cp.Problem(cp.Minimize(cp.trace(bound)), [held, schur >> 0])

    def smallest_gamma(self, model: ErrorModel) -> tuple[float, str, Array, Array]:
        """Return gamma, the solver's word, P and Q."""
        with self._guard:
            status = self._solve(self.first, model)
            gamma = float(np.sqrt(max(float(self._squared.value), 0.0)))
            return gamma, status, self._P.value, self._Q.value

    def least_variance(self, model: ErrorModel, level: float) -> tuple[Array, Array]:
        """Return P and Q at a level."""
        with self._guard:
            self._level.value = level**2
            self._solve(self.second, model)
            return self._P.value, self._Q.value

    def _solve(self, problem: Any, model: ErrorModel) -> str:
        for name, value in _numbers(model).items():
            self._numbers[name].value = value
        return solve(problem, self._solver)


@lru_cache(maxsize=32)
def _problems(shape: tuple[int, int, int, int], form: Form, solver: Solver) -> _Problems:
    return _Problems(shape, form, solver)


@dataclass(frozen=True, eq=False)
class _Units:
    """Units in which the noise, the states of a Kalman filter and L are of the order of one.

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
        if not np.isfinite(sizes).all():  # a mode grows that is not seen
            P, sizes = np.eye(len(Q)), np.ones(len(Q))
        seen = float(np.linalg.norm(model.L * sizes, 2))
        if not model.D.any():
            outputs = np.linalg.norm(model.C * sizes, axis=1)
            outputs = np.where(outputs > 0, outputs, 1.0)
        return cls(sizes, outputs, seen, P / np.outer(sizes, sizes))

    def scaled(self, model: ErrorModel, S: Array) -> ErrorModel:
        """Return the model with outputs and L in these units, and for the states S x."""
        back = np.linalg.inv(S)
        return replace(
            model, A=S @ model.A @ back, B=S @ model.B, C=model.C @ back / self.outputs[:, None],
            D=model.D / self.outputs[:, None], L=model.L @ back / self.seen,
            E=S @ model.E @ back,
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
