"""The H-infinity filter of P1 and P2 as a convex problem, each design with its own certificate."""

from __future__ import annotations

from functools import cache, partial

import numpy as np
from scipy.linalg import block_diag, solve_discrete_lyapunov, solve_triangular

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
from inswsn_lib.lmi.solvers import Inequality, first_that_passes, in_order, solve, symmetric_units
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
# Of Newton's method: steps, and the decrement at which rounding is all that is left
_NEWTON, _AT_CENTRE = 100, 1e-9
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
    1. A large margin gives the Kalman predictor, whose gain is one over the golden ratio:

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
            raise ParameterError(name, Described("zero"), "a nonzero matrix")
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
    scaled = units.scaled(model)
    numbers = _in_differences(scaled, units.moved(model), change)
    gamma, status, gain, lower = _smallest_gamma(scaled, *numbers, form, by)
    upper = _worst_gain(model, units, gain, gamma * (1 + LARGEST_GAP / 2), form)
    P, gain = _least_variance(*numbers, gamma * (1 + margin), form, by)
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
        return hinf_norm(*model.error_system(units.back @ gain @ units.outputs))
    scaled = units.scaled(model)
    A, B, L = scaled.error_system(gain)
    jitters = np.stack([scaled.E, A]) if form == "printed" else scaled.E
    return units.seen * level if riccati_gain_below(A, jitters, B, L, level) else np.inf


def minimise_gamma(
    model: ErrorModel, form: Form = "exact", *, solver: Solver | tuple[Solver, ...] = "clarabel"
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
    constant, terms = _linear(_numbers(model), form)
    least = Inequality(constant, terms, np.arange(len(terms)))

    def solved(by: Solver) -> tuple[float, Array]:
        x = solve(np.eye(len(terms))[0], [least], by).x
        return float(np.sqrt(max(x[0], 0.0))), _p_and_gain(x[1:], *model.C.shape[::-1])[1]

    return first_that_passes(partial(solved, by) for by in in_order(solver))


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
    constant, terms = _linear(_numbers(model), form)
    constant, terms = constant + level**2 * terms[0], terms[1:]
    # the x at which the largest eigenvalue is the least is inside
    sunk = np.concatenate([-np.eye(len(constant))[None], terms])
    deepest = Inequality(constant, sunk, np.arange(len(sunk)))

    def solved(by: Solver) -> Array:
        x = _centre(solve(np.eye(len(sunk))[0], [deepest], by).x[1:], constant, terms)
        return _p_and_gain(x, *model.C.shape[::-1])[1]

    return first_that_passes(partial(solved, by) for by in in_order(solver))


def _centre(x: Array, constant: Array, terms: Array) -> Array:
    """Return by Newton's method, from an x inside, the analytic centre of an inequality.

    The decrement, the length of a step as the barrier measures it, tells how far the centre is.
    """
    eye = np.eye(len(constant))
    for _ in range(_NEWTON):
        root = np.linalg.cholesky(-(constant + np.tensordot(x, terms, axes=1)))
        inverse = solve_triangular(root, eye, lower=True)
        seen = (inverse @ terms @ inverse.T).reshape(len(x), -1)
        step = np.linalg.lstsq(seen.T, -eye.ravel(), rcond=None)[0]
        decrement = float(np.linalg.norm(step @ seen))
        if decrement < _AT_CENTRE:
            return x
        x = x + step / (1 + decrement if decrement > 0.25 else 1)
    raise InfeasibleDesignError("The inequality has no analytic centre.")


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
    blocks = inequality(_numbers(scaled), P, P @ gain, own**2, form)
    largest = float(np.linalg.eigvalsh(blocks).max() / np.abs(blocks).max())
    norm = hinf_norm(*model.error_system(units.back @ gain @ units.outputs))
    A, B, L = scaled.error_system(gain)
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
    numbers: dict[str, Array], P: Array, Q: Array, squared: Array | float, form: Form
) -> Array:
    r"""Return the matrix that must be negative; P, Q and the bound squared may be stacks.

    With `_numbers` it is the inequality as it stands. For steps
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
    n, p, q = P.shape[-1], fast[1].shape[-1], fast[2].shape[-1]
    bound = -np.asarray(squared)[..., None, None]
    blocks = {
        (0, 0): slow[0] + slow[0].mT + numbers["LL"],
        (1, 0): slow[1].mT, (1, 1): bound * np.eye(p),
        (2, 0): slow[2].mT, (2, 2): bound * np.eye(q),
        (3, 0): fast[0], (3, 1): fast[1], (3, 2): fast[2], (3, 3): -P,
        (4, 0): P @ numbers["E"], (4, 4): -P,
    }  # fmt: skip
    sizes = [n, p, q, n, n]
    if form == "printed":
        blocks |= {(5, 0): P @ numbers["copied A"] - Q @ numbers["C"], (5, 5): -P}
        sizes.append(n)
    ends = np.cumsum(sizes)
    places = [slice(end - size, end) for end, size in zip(ends, sizes, strict=True)]
    matrix = np.zeros((*P.shape[:-2], ends[-1], ends[-1]))
    for (i, j), block in blocks.items():
        matrix[..., places[i], places[j]] = block
        matrix[..., places[j], places[i]] = block.mT
    return matrix


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


def _linear(numbers: dict[str, Array], form: Form) -> tuple[Array, Array]:
    """Return the constant of the inequality, and what each unknown does: squared, P, Q in turn."""
    squared, P, Q = _units(*numbers["C"].shape[::-1])
    none, *units = inequality(numbers, P, Q, squared, form)
    return none, np.array(units) - none


@cache
def _pattern(sizes: tuple[tuple[str, tuple[int, ...]], ...], form: Form) -> Array:
    """Return what is not zero where an unknown is in the inequality, whatever the numbers."""
    return _linear({name: np.ones(shape) for name, shape in sizes}, form)[1]


def _sizes(numbers: dict[str, Array]) -> tuple[tuple[str, tuple[int, ...]], ...]:
    return tuple((name, value.shape) for name, value in numbers.items())


@cache
def _units(n: int, m: int) -> tuple[Array, Array, Array]:
    """Return the bound squared, P and Q, all nothing, and then with one unknown that is one."""
    symmetric = symmetric_units(n)
    unknowns = 1 + len(symmetric) + n * m
    P = np.zeros((1 + unknowns, n, n))
    P[2 : 2 + len(symmetric)] = symmetric
    Q = np.eye(1 + unknowns, n * m, -2 - len(symmetric)).reshape(-1, m, n).mT
    return np.eye(1 + unknowns, 1, -1)[:, 0], P, Q


def _p_and_gain(x: Array, n: int, m: int) -> tuple[Array, Array]:
    """Return P and the gain from the unknowns of P and Q, (n, n) and (n, m)."""
    P, Q = (np.tensordot(x, units[-len(x) :], axes=1) for units in _units(n, m)[1:])
    return P, np.asarray(np.linalg.solve(P, Q))


def _smallest_gamma(
    model: ErrorModel, step: float, numbers: dict[str, Array], form: Form, by: Solver
) -> tuple[float, str, Array, float]:
    """Return gamma, the solver's word, the gain, and what gamma cannot be below."""
    constant, terms = _linear(_without_faint(numbers), form)
    cost = np.eye(len(terms))[0]
    least = Inequality(constant, terms, np.arange(len(terms)), _pattern(_sizes(numbers), form))
    answer = solve(cost, [least], by)
    gamma = float(np.sqrt(max(answer.x[0], 0.0))) / step
    gain = step * _p_and_gain(answer.x[1:], *model.C.shape[::-1])[1]
    inside = _inside(model, numbers, step, form)
    squared = dual_bound(answer.duals[0], inside, *_linear(numbers, form), cost)
    one_step = float(np.linalg.norm(model.L @ model.B, 2))  # which no filter undoes
    return gamma, answer.status, gain, max(one_step, float(np.sqrt(max(squared, 0.0))) / step)


def _least_variance(
    step: float, numbers: dict[str, Array], level: float, form: Form, by: Solver
) -> tuple[Array, Array]:
    r"""Return P and the gain at a level: the least trace of W with :math:`K'P^{-1}K \le W`."""
    pattern, numbers = _pattern(_sizes(numbers), form)[1:], _without_faint(numbers)
    constant, terms = _linear(numbers, form)
    constant, terms = constant + (step * level) ** 2 * terms[0], terms[1:]
    (m, n), k = numbers["C"].shape, numbers["B"].shape[1] + numbers["D"].shape[1]
    P, Q = (units[2:] for units in _units(n, m)[1:])
    W = symmetric_units(k)

    def schur(B: Array, D: Array) -> Array:
        """Return what W, P and Q do to (W, K'; K, P), K = (P B, Q D), with the sign changed."""
        K = np.concatenate([P @ B, Q @ D], axis=2)
        terms = np.zeros((len(W) + len(P), k + n, k + n))
        terms[: len(W), :k, :k], terms[len(W) :, k:, k:] = -W, -P
        terms[len(W) :, k:, :k], terms[len(W) :, :k, k:] = -K, -K.mT
        return terms

    bound = schur(numbers["B"], -numbers["D"])
    bounded = schur(np.ones_like(numbers["B"]), np.ones_like(numbers["D"]))
    every = np.arange(len(bound))
    x = solve(
        np.concatenate([np.trace(W, axis1=1, axis2=2), np.zeros(len(P))]),
        [Inequality(constant, terms, every[len(W) :], pattern),
         Inequality(np.zeros_like(bound[0]), bound, every, bounded)],
        by,
    ).x  # fmt: skip
    found, gain = _p_and_gain(x[len(W) :], n, m)
    return found / step**2, step * gain


def _without_faint(numbers: dict[str, Array]) -> dict[str, Array]:
    """Return numbers with nothing in place of what is faint: a solver would stumble over it."""
    return {
        name: np.where(np.abs(value) < _FAINT * max(1.0, np.abs(value).max()), 0.0, value)
        for name, value in numbers.items()
    }


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
