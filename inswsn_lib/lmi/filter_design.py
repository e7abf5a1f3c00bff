"""The H-infinity filter of P1 and P2 as a convex problem, each design with its own certificate."""

from __future__ import annotations

import threading
from functools import lru_cache, partial
from typing import Any

import cvxpy as cp
import numpy as np
from scipy.linalg import block_diag, solve_discrete_lyapunov

from inswsn_lib.checks import Array, number, one_of
from inswsn_lib.errors import Described, ParameterError
from inswsn_lib.lmi.bounds import dual_bound
from inswsn_lib.lmi.designs import (
    LARGEST_GAP,
    Certificate,
    FilterDesign,
    Form,
    InfeasibleDesignError,
    Solver,
    told_gap,
)
from inswsn_lib.lmi.norms import hinf_norm, spectral_radius
from inswsn_lib.lmi.solvers import first_that_passes, in_order, solve
from inswsn_lib.lmi.stochastic import mean_square_radius, riccati_gain_below
from inswsn_lib.lmi.units import Units
from inswsn_lib.models import ErrorModel

FORMS = ("exact", "printed")
#: Far above it the least bound is lost in rounding
LARGEST_MARGIN = 1e9
#: A solver's answer may break the inequality, and the level, by this share
TOLERANCE = 1e-6
# Numbers of a scaled problem that are as small are nothing to a solver
_FAINT = 1e-7
# Attempts: a share of the largest variance to which the others are raised in the units, and how
# much a filter may change in a step for it to be designed in differences
_ATTEMPTS = ((1e-15, 0.1), (1e-15, np.inf), (1e-8, np.inf), (1e-4, np.inf), (1.0, np.inf))


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
    Kalman predictor, if there is no jitter. States that L does not see may have any gain that keeps
    them stable.

    All is solved in units in which a Kalman predictor's error and innovation have the covariance I,
    and, where a step changes little, for the change of a step. So neither the units of the model
    nor a short period matter. What comes of it must pass a certificate that knows of no solver.

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
        passes the certificate: what bounds the least gamma from below, and the gain of a filter
        that was found, must be within a thousandth. So it is where a stable mode has next to no
        process noise: the least gamma is then approached, and not attained.
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
    # the first units work nearly always; where a solver fails, others of the same problem help
    return first_that_passes(
        partial(_designed, model, form, margin, *attempt, by)
        for attempt in _ATTEMPTS
        for by in solvers
    )


def _designed(
    model: ErrorModel, form: Form, margin: float, least: float, change: float, by: Solver
) -> FilterDesign:
    """Make one attempt at a design."""
    units = Units.of(model, least)
    numbers = _in_differences(units.scaled(model), units.moved(model), change)
    problems = _problems(_shape(model), form, by)
    gamma, status, gain, lower = problems.smallest_gamma(units.scaled(model), *numbers)
    upper = _worst_gain(model, units, gain, gamma * (1 + LARGEST_GAP / 2), form)
    P, gain = problems.least_variance(*numbers, gamma * (1 + margin))
    gain = np.where(np.abs(gain) < _FAINT, 0.0, gain)  # axes that have no part in each other
    gamma, level = units.seen * gamma, units.seen * gamma * (1 + margin)
    bounds = min(units.seen * lower, gamma), max(upper, gamma)  # so that gamma is held to them, too
    certificate = certify(model, P, gain, level, form, bounds, units)
    return FilterDesign(
        model, form, gamma, level, units.back @ gain @ units.outputs,
        units.seen**2 * units.states.T @ P @ units.states, certificate, status, by,
    )  # fmt: skip


def _worst_gain(model: ErrorModel, units: Units, gain: Array, level: float, form: Form) -> float:
    """Return the worst case of a gain in `units`, or with jitter the level if that is confirmed.

    The printed form is the exact one of an error system with a further jitter, its own A_f.
    """
    if form == "exact" and not model.E.any():
        return hinf_norm(*_error_system(model, units.back @ gain @ units.outputs))
    scaled = units.scaled(model)
    A, B, L = _error_system(scaled, gain)
    jitters = np.stack([scaled.E, A]) if form == "printed" else scaled.E
    return units.seen * level if riccati_gain_below(A, jitters, B, L, level) else np.inf


def _error_system(model: ErrorModel, gain: Array) -> tuple[Array, Array, Array]:
    return model.A - gain @ model.C, np.hstack([model.B, -gain @ model.D]), model.L


def minimise_gamma(
    model: ErrorModel,
    form: Form = "exact",
    *,
    solver: Solver | tuple[Solver, ...] = "clarabel",
) -> tuple[float, Array]:
    r"""Solve P1 (2.23) as it stands: the least gamma over P and Q, and :math:`B_f = P^{-1} Q`.

    There is no second criterion, no change of units and no certificate: gamma squared is what the
    solver calls accurate, about 1e-8 absolutely. Where many gains attain the least gamma, or
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
    P, Q = cp.Variable(model.A.shape, symmetric=True), cp.Variable(model.C.T.shape)
    squared = cp.Variable()
    least = cp.bmat(inequality(_numbers(model), P, Q, squared, form)) << 0
    problem = cp.Problem(cp.Minimize(squared), [least])
    gain = first_that_passes(partial(_solved_gain, problem, P, Q, by) for by in in_order(solver))
    return float(np.sqrt(max(float(squared.value), 0.0))), gain


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
    return first_that_passes(
        partial(_solved_gain, centre, P, Q, by, accurate=True) for by in in_order(solver)
    )


def _solved_gain(problem: Any, P: Any, Q: Any, by: Solver, *, accurate: bool = False) -> Array:
    solve(problem, by, accurate=accurate)
    return np.asarray(np.linalg.solve(P.value, Q.value))


def certify(
    model: ErrorModel,
    P: Array,
    gain: Array,
    level: float,
    form: Form,
    bounds: tuple[float, float],
    units: Units,
) -> Certificate:
    """Return the certificate of P and a gain in `units` at a level, computed without any solver.

    It is refused if P is not positive definite, the inequality does not hold, the error system is
    not stable in the mean square, its gain, from its frequency response and by the Riccati
    iteration, is above the level; or if the bounds on the least gamma are far apart, or refuted.
    Level, bounds and the norm are of the model itself, which no units have rounded.
    """
    scaled, own = units.scaled(model), level / units.seen
    values = np.linalg.eigvalsh(P)
    blocks = np.block(inequality(_numbers(scaled), P, P @ gain, own**2, form))
    largest = float(np.linalg.eigvalsh(blocks).max() / np.abs(blocks).max())
    norm = hinf_norm(*_error_system(model, units.back @ gain @ units.outputs))
    A, B, L = _error_system(scaled, gain)
    radius = mean_square_radius(A, scaled.E)
    slack, (lower, upper) = level * (1 + TOLERANCE), bounds
    jitters = bool(model.E.any())  # without them the norm says it all
    confirmed = not jitters or riccati_gain_below(A, scaled.E, B, L, own * (1 + TOLERANCE))
    plain = form == "exact" and not jitters
    refuse_if({
        f"P has the eigenvalue {values.min():.3g}": values.min() <= 0,
        f"the inequality has the eigenvalue {largest:.3g}": largest > TOLERANCE,
        f"the error system has the spectral radius {spectral_radius(A):.6g}": norm == np.inf,
        f"the error system has the mean-square radius {radius:.6g}": radius >= 1,
        f"the norm is {norm:.6g}, above {level:.6g}": norm > slack,
        "the Riccati iteration does not confirm the gain": not confirmed,
        f"the norm is {norm:.6g}, below what no filter can have, {lower:.6g}": (
            plain and norm < lower * (1 - TOLERANCE)
        ),
        told_gap(lower, upper): not upper <= lower * (1 + LARGEST_GAP),
    })  # fmt: skip
    smallest = float(values.min() / values.max())
    return Certificate(largest, smallest, norm, lower, upper)


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
    r"""Return the blocks that must be negative, of arrays or of expressions of a convex problem.

    `squared` is the bound squared. With `_numbers` it is the inequality as it stands. For steps
    that change little `_in_differences` adds the fourth row and column to the first, which are then
    divided by t, as Q is; L too is t times that of the model. With :math:`\Delta = P(A - I) - QC`
    the upper left block becomes :math:`(\Delta + \Delta') / t^2 + L'L`, in which nothing cancels:
    where A goes to I with the period, and t with its root, this is the inequality of continuous
    time.
    """
    slow, fast = (
        [P @ numbers[kind + "A"] - Q @ numbers[kind + "C"], P @ numbers[kind + "B"],
         -(Q @ numbers[kind + "D"])] for kind in ("slow ", "")
    )  # fmt: skip
    jitter, n, p, q = P @ numbers["E"], P.shape[0], fast[1].shape[1], fast[2].shape[1]
    nn, np_, nq, pq = (np.zeros(s) for s in ((n, n), (n, p), (n, q), (p, q)))
    rows = [
        [slow[0] + slow[0].T + numbers["LL"], *slow[1:], fast[0].T, jitter.T],
        [slow[1].T, -squared * np.eye(p), pq, fast[1].T, np_.T],
        [slow[2].T, pq.T, -squared * np.eye(q), fast[2].T, nq.T],
        [*fast, -P, nn],
        [jitter, np_, nq, nn, -P],
    ]
    if form == "printed":
        copy = P @ numbers["copied A"] - Q @ numbers["C"]
        column = (copy.T, np_.T, nq.T, nn, nn)
        rows = [[*row, block] for row, block in zip(rows, column, strict=True)]
        rows.append([copy, np_, nq, nn, nn, -P])
    return rows


def _numbers(model: ErrorModel) -> dict[str, Array]:
    """Return the numbers of the inequality as it stands, whose upper left block is L'L - P."""
    A, B, C, D = model.A, model.B, model.C, model.D
    return {
        "slow A": -np.eye(len(A)) / 2, "slow B": 0 * B, "slow C": 0 * C, "slow D": 0 * D,
        "A": A, "B": B, "C": C, "D": D, "E": model.E, "LL": model.L.T @ model.L, "copied A": A,
    }  # fmt: skip


def _in_differences(
    model: ErrorModel, moved: Array, change: float
) -> tuple[float, dict[str, Array]]:
    """Return t and the numbers of the inequality, for a model in `Units` and its A - I.

    t squared is how much a filter changes in a step, at most 1. If that is more than `change`, the
    numbers are those of the inequality as it stands, with t = 1. Gamma is t times that of the
    model: that of slow models goes with 1 / t.
    """
    A, B, C, D = model.A, model.B, model.C, model.D
    most = max(float(np.linalg.norm(X, 2)) ** k for X, k in ((moved, 1), (B, 2), (C, 2)))
    if most > change:
        return 1.0, _numbers(model)
    t = min(1.0, most) ** 0.5
    return t, {
        "slow A": moved / t**2, "slow B": B / t, "slow C": C / t, "slow D": D,
        "A": moved / t, "B": B, "C": C, "D": t * D,
        "E": model.E / t, "LL": model.L.T @ model.L, "copied A": A / t,
    }  # fmt: skip


def _shape(model: ErrorModel) -> tuple[int, int, int, int]:
    return (*model.B.shape, *model.D.shape)


class _Problems:
    """The two convex problems for one shape of model, compiled once and solved with new numbers."""

    def __init__(self, shape: tuple[int, int, int, int], form: Form, solver: Solver) -> None:
        n, p, m, q = shape
        self._form, self._solver = form, solver
        self._guard = threading.Lock()  # the problems hold the numbers of one model at a time
        sizes = {"A": (n, n), "B": (n, p), "C": (m, n), "D": (m, q), "E": (n, n), "LL": (n, n)}
        sizes |= {f"slow {name}": sizes[name] for name in "ABCD"} | {"copied A": (n, n)}
        self._numbers = {name: cp.Parameter(size) for name, size in sizes.items()}
        self._P, self._Q = P, Q = cp.Variable((n, n), symmetric=True), cp.Variable((n, m))
        self._squared, self._level = cp.Variable(), cp.Parameter(nonneg=True)
        self._least, held = (
            cp.bmat(inequality(self._numbers, P, Q, squared, form)) << 0
            for squared in (self._squared, self._level)
        )
        self.first = cp.Problem(cp.Minimize(self._squared), [self._least])
        driven = cp.hstack([P @ self._numbers["B"], -(Q @ self._numbers["D"])])
        bound = cp.Variable((p + q, p + q), symmetric=True)  # on B~' P B~
        schur = cp.bmat([[bound, driven.T], [driven, P]])
        self.second = cp.Problem(cp.Minimize(cp.trace(bound)), [held, schur >> 0])

    def smallest_gamma(
        self, model: ErrorModel, step: float, numbers: dict[str, Array]
    ) -> tuple[float, str, Array, float]:
        """Return gamma, the solver's word, the gain, and what gamma cannot be below."""
        with self._guard:
            self._take(numbers)
            status = solve(self.first, self._solver)
            gamma = float(np.sqrt(max(float(self._squared.value), 0.0))) / step
            gain = step * np.linalg.solve(self._P.value, self._Q.value)
            dual = self._least.dual_value
        (n, m), upper = self._Q.shape, np.triu_indices(len(model.A))

        def left_side(unknown: Array) -> Array:
            P = np.zeros((n, n))
            P[upper] = P.T[upper] = unknown[: len(upper[0])]
            Q = unknown[len(upper[0]) : -1].reshape(n, m)
            return np.block(inequality(numbers, P, Q, unknown[-1], self._form))

        cost = np.eye(len(upper[0]) + n * m + 1)[-1]
        squared = dual_bound(dual, _inside(model, numbers, step, self._form), left_side, cost)
        one_step = float(np.linalg.norm(model.L @ model.B, 2))  # which no filter undoes
        return gamma, status, gain, max(one_step, float(np.sqrt(max(squared, 0.0))) / step)

    def least_variance(
        self, step: float, numbers: dict[str, Array], level: float
    ) -> tuple[Array, Array]:
        """Return P and the gain at a level."""
        with self._guard:
            self._take(numbers)
            self._level.value = (step * level) ** 2
            solve(self.second, self._solver)
            P = self._P.value
            return P / step**2, step * np.linalg.solve(P, self._Q.value)

    def _take(self, numbers: dict[str, Array]) -> None:
        """Give the problems the numbers of a model.

        What is faint is given as nothing: a solver would stumble over it.
        """
        for name, value in numbers.items():
            faint = np.abs(value) < _FAINT * max(1.0, np.abs(value).max())
            self._numbers[name].value = np.where(faint, 0.0, value)


@lru_cache(maxsize=32)
def _problems(shape: tuple[int, int, int, int], form: Form, solver: Solver) -> _Problems:
    return _Problems(shape, form, solver)


def _inside(model: ErrorModel, numbers: dict[str, Array], t: float, form: Form) -> Array:
    """Return the dual solution of the inequality that a Kalman predictor gives, in `Units`.

    It is the covariance of t e, w, v, e+ - e (e+ as the inequality stands) and a noise, for the
    least w and v that lead to an error e+ and are not seen: with the predictor's covariance I,
    e = (I - C'C) A' e+, w = B' e+ and v = -D'CA' e+. All have noises of their own besides.
    """
    A, B, C, D, eye = model.A, model.B, model.C, model.D, np.eye(len(model.A))
    before = (eye - C.T @ C) @ A.T
    copies = 2 if form == "printed" else 1
    after = eye
    if spectral_radius(before) < 1:  # else there is no predictor
        after = solve_discrete_lyapunov(before, (1 + copies) * eye)
    less = 1.0 if numbers["slow B"].any() else 0.0
    linear = np.vstack([t * before, B.T, -D.T @ C @ A.T, eye - less * before])
    own = np.vstack([t * eye, 0 * B.T, 0 * D.T @ C, -less * eye])  # of e
    free = np.diag(np.repeat([0.0, 1.0, 0.0], [len(A), B.shape[1] + D.shape[1], len(A)]))
    return np.asarray(block_diag(linear @ after @ linear.T + own @ own.T + free, *[eye] * copies))
