"""Designs against closed forms, known values, routes that share no code, and their certificates."""

from __future__ import annotations

from dataclasses import replace
from itertools import product
from typing import Any

import numpy as np
import pytest
from conftest import WHOLE
from hypothesis import given, settings, strategies as st
from random_systems import drawn, in_units, positions_only
from scipy.linalg import solve_discrete_are

from inswsn_lib import ErrorModel
from inswsn_lib.errors import ParameterError
from inswsn_lib.lmi import (
    FilterDesign,
    InfeasibleDesignError,
    central_gain,
    design_filter,
    filter_design,
    hinf_norm,
    largest_singular_value,
    mean_square_radius,
    minimise_gamma,
    riccati_filter,
)
from inswsn_lib.lmi.designs import Certificate, Form
from inswsn_lib.lmi.filter_design import certify, inequality
from inswsn_lib.lmi.riccati import riccati_gamma
from inswsn_lib.lmi.stochastic import riccati_gain_below
from inswsn_lib.lmi.units import Units

FORMS: tuple[Form, ...] = ("exact", "printed")
KINDS = ("stable", "unstable", "hidden", "badly scaled")
EACH = 60 if WHOLE else 5
# What may differ between solvers: the relative accuracy of gamma.
CLOSE = 1e-4
WALK = ErrorModel(A=[[1]], B=[[1]], C=[[1]], D=[[1]], period=1.0)


def scalar(**numbers: float) -> ErrorModel:
    matrices = {name: [[number]] for name, number in numbers.items()}
    return ErrorModel(**({"B": [[1]], "C": [[1]], "D": [[1]]} | matrices), period=1.0)  # type: ignore[arg-type]


# Closed forms and known values -------------------------------------------------------------------


@pytest.mark.parametrize(
    ("model", "exact", "printed"),
    [
        # worked out once with another program
        (ErrorModel.p1(0.2), 1.48967, 1.48970),
        (ErrorModel.p1(0.21), 1.49366, 1.49370),
        (positions_only(0.2), 5.635, 8.455),
    ],
)
def test_known_values(model: ErrorModel, exact: float, printed: float) -> None:
    digits = 6e-6 if exact < 5 else 6e-4  # the last digit given
    for form, expected in zip(FORMS, (exact, printed), strict=True):
        design = design_filter(model, form)
        assert design.gamma == pytest.approx(expected, abs=digits)
        assert (design.model, design.form, design.status) == (model, form, "optimal")
        assert minimise_gamma(model, form)[0] == pytest.approx(design.gamma, rel=1e-5)


@pytest.mark.parametrize("margin", [1e-3, 0.01, 0.5])
def test_the_second_criterion_of_a_random_walk(margin: float) -> None:
    """For each gain k up to 1 the least P is a root of a quadratic, and the cost (1 + k^2) P."""
    design = design_filter(WALK, margin=margin)
    assert design.gamma == pytest.approx(2**0.5, rel=1e-7)
    assert design.level == pytest.approx((1 + margin) * design.gamma, rel=1e-12)
    k, g2 = np.linspace(0.5, 1.0, 500_001), 2 * (1 + margin) ** 2
    half = (g2 + (1 + k**2) - (1 - k) ** 2 * g2) / 2
    inside = half**2 >= (1 + k**2) * g2
    P = (half - np.sqrt(np.where(inside, half**2 - (1 + k**2) * g2, np.inf))) / (1 + k**2)
    best = np.argmin(np.where(inside, (1 + k**2) * P, np.inf))
    assert design.gain.item() == pytest.approx(k[best], rel=1e-3)
    assert design.P.item() == pytest.approx(P[best], rel=1e-3)
    assert design.certificate.norm == pytest.approx(np.hypot(1, k[best]) / k[best], rel=1e-3)


def test_with_a_large_margin_it_is_the_kalman_predictor() -> None:
    model = ErrorModel.p1(0.2, process_noise=(0.05, 0.1), measurement_noise=(0.2, 0.3))
    R = model.measurement_covariance
    P = solve_discrete_are(model.A.T, model.C.T, model.process_covariance, R)
    kalman = model.A @ P @ np.linalg.inv(P + R)
    away = [
        np.abs(design_filter(model, margin=margin).gain - kalman).max()
        for margin in (0.01, 0.5, 5.0, 1000.0)
    ]
    assert away == sorted(away, reverse=True)
    assert away[0] > 0.1
    assert away[-1] < 1e-4


@pytest.mark.parametrize("form", FORMS)
def test_without_measurement_noise_it_is_deadbeat(form: Form) -> None:
    """D = 0: A_f = 0, B_f = A, and gamma is the norm of L B, in both forms and for any T."""
    for period, size in ((0.2, 4.0), (1.0, 1.0)):
        model = ErrorModel.p1(period, process_noise=(size, size), measurement_noise=(0.0, 0.0))
        design = design_filter(model, form)
        assert design.gamma == pytest.approx(size, rel=1e-6)
        assert design.gain == pytest.approx(model.A, abs=1e-6)
        assert np.abs(design.A_f).max() < 1e-6
    one = scalar(A=0.5, C=4.0, D=0.0)  # the gain A / C
    assert design_filter(one, form).gain.item() == pytest.approx(0.125, abs=1e-7)


def test_the_printed_form_forces_a_small_spectral_radius() -> None:
    """An unseen mode of 0.8: the exact form has a filter, the printed one has none."""
    assert design_filter(scalar(A=0.8, C=0.0)).gamma == pytest.approx(5.0, rel=1e-5)
    with pytest.raises(InfeasibleDesignError, match=r"says infeasible\.$"):
        design_filter(scalar(A=0.8, C=0.0), "printed")
    # at 0.7, below the root of one half, both have one
    exact, printed = (design_filter(scalar(A=0.7, C=0.0), form).gamma for form in FORMS)
    assert printed > exact == pytest.approx(1 / 0.3, rel=1e-5)


def test_modes_that_are_not_seen_must_be_stable() -> None:
    grows = ErrorModel(A=np.diag([1.1, 0.5]), B=np.eye(2), C=[[0, 1]], D=[[1]], period=1.0)
    jitters = ErrorModel(
        A=np.diag([0.5, 0.9]), B=np.eye(2), C=[[1, 0]], D=[[1]], L=[[1, 0]], E=np.diag([0, 0.6]),
        period=1.0,
    )  # fmt: skip
    for model in (grows, jitters):
        with pytest.raises(InfeasibleDesignError):
            design_filter(model)
    calm = replace(jitters, E=np.diag([0, 0.4]))  # 0.81 + 0.16 < 1
    assert mean_square_radius(design_filter(calm).A_f, calm.E) == pytest.approx(0.97)


@pytest.mark.parametrize("h", [1e-6, 1e-9, 1e-12])
def test_a_walk_that_moves_ever_less_in_a_step(h: float) -> None:
    """With noises of sizes r and 1/r the gain r is the best of continuous time, and gamma 1/r."""
    r = h**0.5
    design = design_filter(ErrorModel(A=[[1]], B=[[r]], C=[[1]], D=[[1 / r]], period=1.0))
    assert r * design.gamma == pytest.approx(1, rel=1e-6)
    assert r * design.certificate.lower == pytest.approx(1, rel=1e-6)


def test_poles_so_near_to_the_circle_that_units_would_round_them() -> None:
    """The least gamma, 730069.6, is from a Riccati equation in 60 digits."""
    model = ErrorModel(
        A=[[0.99999999999155, -1.0917451529289346e-12],
           [-1.091823430789027e-12, 0.9999999999879945]],
        B=[[0.7229125281409174], [1.0059956216078123]],
        C=[[0.06921358628561061, -1.7637289953136792]], D=[[19200197.12239273]],
        L=[[-0.40720479814196736, 0.33582328766508407]], period=1.0,
    )  # fmt: skip
    certificate = design_filter(model).certificate
    assert certificate.lower == pytest.approx(730069.6, rel=1e-5)
    # that of a gain whose last digits are the processor's, and never below the truth
    assert 730069.6 * (1 - 1e-6) <= certificate.upper <= 730069.6 * (1 + 1e-4)


@pytest.mark.parametrize("size", [1.0, 1000.0])
def test_bounds_of_what_is_refused_are_in_the_units_of_the_model(size: float) -> None:
    """A stable mode without noise: gamma is approached, as its part of the gain grows, not met."""
    model = ErrorModel(
        A=np.diag([0.9, 0.5]), B=[[0], [1]], C=[[1, 1]], D=[[1]], L=size * np.eye(2), period=1.0
    )
    with pytest.raises(InfeasibleDesignError, match=rf"between {size:g} and {size * 1.1180:.4g}"):
        design_filter(model)


@pytest.mark.parametrize("route", [design_filter, riccati_gamma])
@pytest.mark.parametrize("size", [1e160, 1e200])
def test_numbers_whose_squares_are_infinite_are_refused(route: Any, size: float) -> None:
    with pytest.raises(InfeasibleDesignError, match="too far apart to be computed with"):
        route(scalar(A=0.5, B=size))


def test_the_design_says_what_it_is() -> None:
    model = ErrorModel.p1(0.2, process_noise=(0.5, 0.4), measurement_noise=(0.3, 0.2))
    design = design_filter(model)
    A, B, L = design.error_system
    assert pytest.approx(model.A - design.gain @ model.C) == A
    assert pytest.approx(np.hstack([model.B, -design.gain @ model.D])) == B
    assert L is model.L
    assert design.buildable
    assert not design_filter(replace(model, E=0.01 * np.eye(4))).buildable
    certificate = design.certificate
    assert certificate.norm == pytest.approx(hinf_norm(A, B, L))


# Random systems -----------------------------------------------------------------------------------


def draw(kind: str, seed: int, jitter: bool = False) -> ErrorModel:
    rng, scaled = np.random.default_rng([KINDS.index(kind), seed]), kind == "badly scaled"
    model = drawn("stable" if scaled else kind, rng, jitter=jitter)
    return in_units(model, rng, 6) if scaled else model


def found(model: ErrorModel, form: Form) -> FilterDesign | None:
    try:
        return design_filter(model, form)
    except InfeasibleDesignError:
        return None


def feasible(model: ErrorModel) -> bool:
    """Tell whether some filter has a bound below a very large one, by the Riccati equation."""
    size = float(np.linalg.norm(model.L @ model.B, 2))  # no filter can be below
    return any(riccati_filter(model, size * 10.0**k) is not None for k in range(7))


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("jitter", [False, True])
def test_designs_of_random_systems(kind: str, jitter: bool) -> None:
    """Without jitter the Riccati equation tells whether there is a filter, and how good."""
    there, angles = 0, np.concatenate([np.linspace(0, np.pi, 501), np.logspace(-5, 0, 100)])
    for seed in range(EACH):
        model = draw(kind, seed, jitter)
        design, printed = found(model, "exact"), found(model, "printed")
        if not jitter:
            assert (design is not None) == feasible(model)
        if printed is not None:  # what the printed form can do, the exact one can
            assert design is not None
            assert design.gamma <= printed.gamma * (1 + CLOSE)
        if design is None:
            continue
        there += 1
        A, B, L = design.error_system
        assert np.linalg.eigvalsh(design.P).min() > 0
        assert mean_square_radius(A, model.E) < 1
        assert largest_singular_value(A, B, L, angles).max() <= design.level * (1 + 1e-6)
        if jitter:
            assert riccati_gain_below(A, model.E, B, L, design.level * (1 + 1e-5))
        else:
            assert riccati_filter(model, design.gamma * (1 + CLOSE)) is not None
            assert riccati_filter(model, design.gamma * (1 - CLOSE)) is None
    assert there > EACH / 4


@settings(max_examples=10)
@given(st.sampled_from(["stable", "badly scaled"]), st.integers(0, 10**6))
def test_a_system_that_is_not_measured_has_its_norm(kind: str, seed: int) -> None:
    """C = 0: no gain helps, and gamma is the peak of the frequency response."""
    model = draw(kind, seed)
    norm = hinf_norm(model.A, model.B, model.L)
    assert design_filter(replace(model, C=0 * model.C)).gamma == pytest.approx(norm, rel=CLOSE)


@settings(max_examples=10)
@given(st.integers(0, 10**6), st.floats(1e-4, 1e4))
def test_gamma_does_not_depend_on_units(seed: int, scale: float) -> None:
    model, rng = draw("stable", seed), np.random.default_rng(seed)
    other = design_filter(in_units(replace(model, L=scale * model.L), rng, 6))
    assert other.gamma == pytest.approx(scale * design_filter(model).gamma, rel=CLOSE)


def test_designs_exist_at_the_corners_of_a_wide_range() -> None:
    """Where the solver fails at first, other states of the same problem help."""
    for period, b, d in ((0.05, 0.1, 10.0), (0.05, 10.0, 0.1), (2.0, 10.0, 0.1)):
        full = ErrorModel.p1(period, 0.02, process_noise=(b, b), measurement_noise=(d, d))
        for rows in (2, 4):
            model = replace(full, C=full.C[:rows], D=full.D[:rows, :rows])
            for form in FORMS:
                design = design_filter(model, form, margin=1e-3)
                assert design.certificate.norm <= design.level * (1 + 1e-6)


def test_other_states_are_tried_where_the_first_fail(monkeypatch: pytest.MonkeyPatch) -> None:
    """And other forms of the problem, by each solver in turn; all give the same design."""
    model, right = positions_only(0.2), filter_design._designed
    expected = design_filter(model)
    asked: list[tuple[tuple[float, float], str]] = []

    def broken(*given_: Any) -> FilterDesign:
        *_, least, change, by = given_
        asked.append(((least, change), by))
        made = right(*given_)
        assert made.gamma == pytest.approx(expected.gamma, rel=1e-6)
        assert made.gain == pytest.approx(expected.gain, abs=1e-3)
        raise InfeasibleDesignError(f"Broken {len(asked)}.")

    monkeypatch.setattr(filter_design, "_designed", broken)
    with pytest.raises(InfeasibleDesignError, match=r"^Broken 1\.$"):
        design_filter(model, solver=("scs", "clarabel"))
    assert asked == list(product(filter_design._ATTEMPTS, ("scs", "clarabel")))


# Certificates -------------------------------------------------------------------------------------


WIDE = (1.0, 1.0)  # bounds that say nothing
PLAIN = Units(np.eye(1), np.eye(1), np.eye(1), 1.0)
ROOT = 2**0.5  # the norm of a walk with the gain 1, where P = 1 alone is left


def certified(
    P: float, gain: float = 1.0, level: float = 1.6, bounds: Any = WIDE, model: Any = WALK
) -> Certificate:
    return certify(model, np.array([[P]]), np.array([[gain]]), level, "exact", bounds, PLAIN)


def largest_of_walk(P: float, gain: float, level: float) -> float:
    """Return the largest eigenvalue of the exact inequality of a random walk, written out."""
    g2, a, q = level**2, (1 - gain) * P, gain * P
    matrix = np.array([
        [1 - P, 0, 0, a, 0], [0, -g2, 0, P, 0], [0, 0, -g2, -q, 0], [a, P, -q, -P, 0],
        [0, 0, 0, 0, -P],
    ])  # fmt: skip
    return float(np.linalg.eigvalsh(matrix)[-1] / np.abs(matrix).max())


@pytest.mark.parametrize(
    ("P", "level", "bounds"),
    [
        (1.01, 1.6, WIDE), (1.27, 1.6, WIDE), (1.1, 1.6, (1.4, 1.4013)),
        # rounding is forgiven; an eigenvalue of 1 - P is over 2.56
        (1.0, ROOT * (1 - 5e-7), WIDE), (1 - 2e-6, 1.6, WIDE),
    ],
)  # fmt: skip
def test_what_passes_is_certified(P: float, level: float, bounds: tuple[float, float]) -> None:
    """With the gain 1 the error of a random walk is w - v, and any P from 1 to 1.28 will do."""
    made = certified(P, level=level, bounds=bounds)
    assert made.largest_eigenvalue == pytest.approx(largest_of_walk(P, 1, level), abs=1e-12)
    assert (made.smallest_eigenvalue_p, made.lower, made.upper) == (1.0, *bounds)


@pytest.mark.parametrize(
    ("P", "gain", "level", "said"),
    [
        (-3.0, 1.0, 1.6, "P has the eigenvalue -3; {}"),
        (0.5, 1.0, 1.6, "{}"),
        (1.1, 1.0, 1.4, "{}; the norm is 1.41421, above 1.4"),
        (
            1.1, 0.0, 1.6,
            "{}; the error system has the spectral radius 1; the error system has the mean-square "
            "radius 1; the norm is inf, above 1.6",
        ),
        (1.0, 1.0, ROOT * (1 - 5e-6), "{}; the norm is 1.41421, above 1.41421"),
        (1 - 3e-6, 1.0, 1.6, "{}"),
    ],
)  # fmt: skip
def test_what_does_not_pass_is_told(P: float, gain: float, level: float, said: str) -> None:
    largest = f"the inequality has the eigenvalue {largest_of_walk(P, gain, level):.3g}"
    with pytest.raises(InfeasibleDesignError) as caught:
        certified(P, gain, level)
    told = said.format(largest)
    assert str(caught.value) == f"The design does not pass its certificate: {told}."


@pytest.mark.parametrize(
    ("bounds", "said"),
    [
        ((1.4, 1.4015), r"only known to lie between 1\.4 and 1\.4015\.$"),
        ((0.0, np.inf), "only known to lie between 0 and inf"),
        ((1.4, np.inf), "only known to lie between 1.4 and inf"),
        ((1.4143, 1.4143), r"the norm is 1\.41421, below what no filter can have, 1\.4143\.$"),
    ],
)
def test_bounds_that_are_far_apart_or_refuted_do_not_pass(
    bounds: tuple[float, float], said: str
) -> None:
    with pytest.raises(InfeasibleDesignError, match=said):
        certified(1.1, bounds=bounds)


def test_a_certificate_with_jitter() -> None:
    """a = e = 1/2, not measured: the gain is 1 / (sqrt(1 - e^2) - a) = 2.73, and 2 without e."""
    model = scalar(A=0.5, C=0.0, E=0.5)
    assert certified(3.2, 0.0, 2.8, model=model).norm == pytest.approx(2)
    with pytest.raises(InfeasibleDesignError, match="the Riccati iteration does not confirm the g"):
        certified(3.2, 0.0, 2.7, model=model)
    with pytest.raises(InfeasibleDesignError, match=r"the mean-square radius 1\.06;.* not confirm"):
        certified(3.2, 0.0, 1e3, model=scalar(A=0.5, C=0.0, E=0.9))


def test_the_inequality_is_the_lemma_written_out() -> None:
    """Schur complements of the blocks give (2.16) and, for the printed form, its double count."""
    rng = np.random.default_rng(5)
    model = replace(ErrorModel.p1(0.2, 0.1), B=rng.normal(size=(4, 3)), D=rng.normal(size=(4, 5)))
    root = rng.normal(size=(4, 4))
    P, gain, g = root @ root.T + 4 * np.eye(4), rng.normal(size=(4, 4)), 3.0
    A, B = model.A - gain @ model.C, np.hstack([model.B, -gain @ model.D])
    for form, count in zip(FORMS, (1, 2), strict=True):
        blocks = np.block(inequality(filter_design._numbers(model), P, P @ gain, g**2, form))
        assert blocks == pytest.approx(blocks.T)
        head, tail = slice(0, 12), slice(12, None)
        schur = (
            blocks[head, head]
            - blocks[head, tail] @ np.linalg.inv(blocks[tail, tail]) @ blocks[tail, head]
        )
        lemma = np.block([
            [count * A.T @ P @ A + model.E.T @ P @ model.E + model.L.T @ model.L - P, A.T @ P @ B],
            [B.T @ P @ A, B.T @ P @ B - g**2 * np.eye(8)],
        ])  # fmt: skip
        assert schur == pytest.approx(lemma, abs=1e-9)


# Solvers, centres, refusals -----------------------------------------------------------------------


@pytest.mark.parametrize(
    ("model", "form"), [(ErrorModel.p1(0.2, 0.01), "printed"), (positions_only(0.2), "exact")]
)
def test_two_solvers_find_one_filter(model: ErrorModel, form: Form) -> None:
    """An interior-point and a first-order method, at the same second criterion."""
    one, two = (design_filter(model, form, solver=s) for s in ("clarabel", "scs"))  # type: ignore[arg-type]
    assert (one.solver, two.solver) == ("clarabel", "scs")
    assert two.gamma == pytest.approx(one.gamma, rel=1e-6)
    assert two.gain == pytest.approx(one.gain, abs=1e-3)


@pytest.mark.parametrize("form", FORMS)
@pytest.mark.parametrize("period", [0.2, 1.0])
def test_the_centre_without_measurement_noise_is_deadbeat(form: Form, period: float) -> None:
    model = ErrorModel.p1(period, 0.01, process_noise=(3.0, 1.0), measurement_noise=(0.0, 0.0))
    for over in (1.005, 2.0):
        assert central_gain(model, over * 3.0003, form) == pytest.approx(model.A, abs=1e-7)
    assert central_gain(scalar(A=0.5, C=4.0, D=0.0), 3.0).item() == pytest.approx(0.125, abs=1e-8)


def test_the_centre_of_a_scalar_by_hand() -> None:
    """Without a measurement Q = P k only costs: k = 0, and the gain with it."""
    assert central_gain(scalar(A=0.5, C=0.0), 4.0).item() == pytest.approx(0, abs=1e-7)
    model = ErrorModel.p1(0.2, process_noise=(4.0, 4.0), measurement_noise=(0.19, 0.19))
    gamma = minimise_gamma(model)[0]
    away = np.abs(model.A - central_gain(model, 1.005 * gamma)).max()
    assert 1e-6 < away < 1e-3  # nearly deadbeat, and not quite
    with pytest.raises(InfeasibleDesignError):
        central_gain(model, 0.9 * gamma)


P1 = ErrorModel.p1(0.2)


@pytest.mark.parametrize(
    ("call", "said"),
    [
        (lambda: design_filter(P1, "other"), "form must be"),
        (lambda: minimise_gamma(P1, "other"), "form must be"),
        (lambda: central_gain(P1, 2.0, "other"), "form must be"),
        (lambda: design_filter(P1, solver="other"), "solver must be"),
        (lambda: minimise_gamma(P1, solver="other"), "solver must be"),
        (lambda: central_gain(P1, 2.0, solver="other"), "solver must be"),
        (lambda: design_filter(P1, margin=0.0), "margin .* above 0 and at most 1e.09, not 0.0"),
        (lambda: design_filter(P1, margin=1.1e9), "margin must be"),
        (lambda: central_gain(P1, 0.0), "level must be .* above 0 and at most 1e.100, not 0.0"),
        (
            lambda: design_filter(replace(P1, B=np.zeros((4, 1)))),
            r"B must be a nonzero matrix, not zero\.$",
        ),
        (lambda: design_filter(replace(P1, L=np.zeros((1, 4)))), "L .* not zero"),
    ],
)
def test_what_cannot_be_is_refused(call: Any, said: str) -> None:
    with pytest.raises(ParameterError, match=f"^{said}"):
        call()
