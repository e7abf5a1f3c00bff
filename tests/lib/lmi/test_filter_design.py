"""Designs against closed forms, known values, and their own certificates."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st
from scipy.linalg import solve_discrete_are

from inswsn_lib.errors import ParameterError
from inswsn_lib.lmi import (
    InfeasibleDesignError,
    certify,
    design_filter,
    hinf_norm,
    inequality,
    minimise_gamma,
)
from inswsn_lib.models import ErrorModel


def positions_only(period: float) -> ErrorModel:
    full = ErrorModel.p1(period)
    return ErrorModel(A=full.A, B=full.B, C=np.eye(2, 4), D=np.eye(2), L=full.L, E=full.E,
                      period=period)  # fmt: skip


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
    assert design_filter(model).gamma == pytest.approx(exact, abs=digits)
    assert design_filter(model, "printed").gamma == pytest.approx(printed, abs=digits)


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


@pytest.mark.parametrize("margin", [0.0, -1.0, float("nan"), float("inf"), 1e10])
def test_a_margin_that_is_none_is_refused(margin: float) -> None:
    with pytest.raises(ParameterError, match="margin is"):
        design_filter(ErrorModel.p1(0.2), margin=margin)


@pytest.mark.parametrize("form", ["exact", "printed"])
@pytest.mark.parametrize("size", [1.0, 4.0])
def test_without_measurement_noise_it_is_deadbeat(form: str, size: float) -> None:
    """D = 0: A_f = 0, B_f = A, and gamma is the norm of L B, in both forms and for any T."""
    for period in (0.2, 1.0):
        model = ErrorModel.p1(period, process_noise=(size, size), measurement_noise=(0.0, 0.0))
        design = design_filter(model, form)  # type: ignore[arg-type]
        assert design.gamma == pytest.approx(size, rel=1e-6)
        assert design.gain == pytest.approx(model.A, abs=1e-6)
        assert np.abs(design.A_f).max() < 1e-6


def test_the_deadbeat_filter_has_the_closed_form_gain() -> None:
    """A_f = 0: the error is L (B w - A D v), whose gain is the root of lmax(BB' + A DD' A')."""
    model = ErrorModel.p1(0.2, process_noise=(4.0, 4.0), measurement_noise=(0.2, 0.2))
    gain = np.linalg.norm(np.hstack([model.B, -model.A @ model.D]), 2)
    assert hinf_norm(np.zeros((4, 4)), np.hstack([model.B, -model.A @ model.D]), model.L) == (
        pytest.approx(gain)
    )
    # the design is no worse than that, and here nearly as good
    assert gain * (1 - 1e-3) < design_filter(model).gamma <= gain * (1 + 1e-7)


def random_model(seed: int, jitter: bool) -> ErrorModel:
    rng = np.random.default_rng(seed)
    n, m, p, q = (int(rng.integers(1, high)) for high in (5, 4, 4, 4))
    A = rng.normal(size=(n, n))
    A *= rng.uniform(0.1, 1.3) / np.abs(np.linalg.eigvals(A)).max()
    return ErrorModel(
        A=A, B=rng.normal(size=(n, p)), C=rng.normal(size=(m, n)), D=rng.normal(size=(m, q)),
        L=rng.normal(size=(2, n)), E=0.1 * rng.normal(size=(n, n)) if jitter else np.zeros((n, n)),
        period=1.0,
    )  # fmt: skip


@settings(deadline=None, max_examples=60)
@given(st.integers(0, 2**32 - 1), st.booleans())
def test_a_design_that_is_returned_keeps_its_word(seed: int, jitter: bool) -> None:
    model = random_model(seed, jitter)
    try:
        design = design_filter(model)
    except InfeasibleDesignError:
        return
    A, B = design.A_f, np.hstack([model.B, -design.gain @ model.D])
    assert hinf_norm(A, B, model.L) <= design.level * (1 + 1e-5)
    assert design.buildable is not jitter
    if not jitter and design.status == "optimal":
        # no filter of this order can be below gamma: the norm of the design is not
        assert hinf_norm(A, B, model.L) >= design.gamma * (1 - 1e-4)
    try:
        printed = design_filter(model, "printed")
    except InfeasibleDesignError:
        return
    exact = {design.status, printed.status} == {"optimal"}
    assert design.gamma <= printed.gamma * (1 + (1e-5 if exact else 1e-3))


@settings(deadline=None, max_examples=30)
@given(st.integers(0, 2**32 - 1), st.floats(-3, 3), st.floats(-3, 3))
def test_units_change_neither_gamma_nor_the_filter(seed: int, a: float, b: float) -> None:
    model = random_model(seed, jitter=False)
    n, m = len(model.A), len(model.C)
    S, W = np.diag(10.0 ** np.linspace(a, b, n)), np.diag(10.0 ** np.linspace(b, a, m))
    back = np.linalg.inv(S)
    other = ErrorModel(
        A=S @ model.A @ back, B=S @ model.B, C=W @ model.C @ back, D=W @ model.D, L=model.L @ back,
        E=model.E, period=1.0,
    )  # fmt: skip
    try:
        one, two = design_filter(model), design_filter(other)
    except InfeasibleDesignError:
        return
    assert two.gamma == pytest.approx(one.gamma, rel=1e-4)


def test_the_printed_form_forces_a_small_spectral_radius() -> None:
    """An unobservable mode of 0.8: the exact form has a filter, the printed one has none."""
    one = np.eye(1)
    model = ErrorModel(A=0.8 * one, B=one, C=0 * one, D=one, L=one, E=0 * one, period=1.0)
    assert design_filter(model).gamma == pytest.approx(5.0, rel=1e-5)  # 1 / (1 - 0.8)
    with pytest.raises(InfeasibleDesignError):
        design_filter(model, "printed")
    # at 0.7, below the root of one half, both have one
    model = ErrorModel(A=0.7 * one, B=one, C=0 * one, D=one, L=one, E=0 * one, period=1.0)
    assert design_filter(model, "printed").gamma > design_filter(model).gamma


def test_an_unstable_mode_that_is_not_seen_has_no_filter() -> None:
    model = ErrorModel(A=np.diag([1.1, 0.5]), B=np.eye(2), C=np.array([[0.0, 1.0]]), D=np.eye(1),
                       L=np.eye(2), E=np.zeros((2, 2)), period=1.0)  # fmt: skip
    with pytest.raises(InfeasibleDesignError):
        design_filter(model)


def test_a_mode_that_l_does_not_see_must_be_stable_in_the_mean_square() -> None:
    model = ErrorModel(
        A=np.diag([0.5, 0.9]), B=np.eye(2), C=np.array([[1.0, 0.0]]), D=np.eye(1),
        L=np.array([[1.0, 0.0]]), E=np.diag([0.0, 0.6]), period=1.0,
    )  # fmt: skip
    with pytest.raises(InfeasibleDesignError):
        design_filter(model)


def test_few_feasible_designs_are_refused() -> None:
    """A stable plant always has a filter: the zero gain. None of 60 may be refused."""
    for seed in range(60):
        model = random_model(seed, jitter=False)
        if np.abs(np.linalg.eigvals(model.A)).max() < 0.95:
            assert design_filter(model).gamma > 0


def test_a_certificate_that_fails_raises() -> None:
    model = ErrorModel.p1(0.2)
    design = design_filter(model)
    certify(model, design.P, design.gain, design.level, "exact")
    for P, gain, level, said in (
        (-design.P, design.gain, design.level, "P has the eigenvalue -"),
        (0.5 * design.P, design.gain, design.level, "the inequality has the eigenvalue"),
        (design.P, design.gain, 0.99 * design.gamma, "the norm is 1.4"),
        (design.P, np.zeros((4, 4)), design.level, "has the spectral radius 1"),
        (design.P, 3 * design.gain, design.level, "the norm is inf"),
    ):
        with pytest.raises(InfeasibleDesignError, match=f"not pass its certificate:.*{said}"):
            certify(model, P, gain, level, "exact")


def test_a_certificate_with_jitter_that_fails_raises() -> None:
    """Without jitter the scalar has the gain 1 / (1 - 0.5) = 2; with it more, or none."""
    one = np.eye(1)
    model = ErrorModel(A=0.5 * one, B=one, C=one, D=one, L=one, E=0.5 * one, period=1.0)
    gain, P = np.zeros((1, 1)), 3 * one  # 1 / (sqrt(1 - 0.25) - 0.5) = 2.73
    with pytest.raises(InfeasibleDesignError, match="Riccati iteration does not confirm"):
        certify(model, P, gain, 2.5, "exact")
    shaken = replace(model, E=0.9 * one)
    with pytest.raises(InfeasibleDesignError, match=r"mean-square radius 1\.06"):
        certify(shaken, P, gain, 1e3, "exact")


@pytest.mark.parametrize(
    ("P", "gain", "level", "said"),
    [
        (np.eye(3), np.eye(4), 2.0, "P is 'of shape"),
        (np.full((4, 4), np.nan), np.eye(4), 2.0, "P is"),
        (np.eye(4), np.eye(3), 2.0, "gain is"),
        (np.eye(4), np.eye(4), -1.0, "level is -1"),
        (np.eye(4), np.eye(4), float("nan"), "level is nan"),
    ],
)
def test_what_cannot_be_certified_is_refused(
    P: np.ndarray, gain: np.ndarray, level: float, said: str
) -> None:
    with pytest.raises(ParameterError, match=said):
        certify(ErrorModel.p1(0.2), P, gain, level, "exact")


@pytest.mark.parametrize("name", ["B", "L"])
def test_without_disturbance_or_output_there_is_nothing_to_design(name: str) -> None:
    model = replace(ErrorModel.p1(0.2), **{name: np.zeros((4, 4))})
    with pytest.raises(ParameterError, match=f"{name} is 'zero'"):
        design_filter(model)


def test_designs_exist_at_the_corners_of_a_wide_range() -> None:
    """Where the solver fails at first, other states of the same problem help."""
    for period, b, d in ((0.05, 0.1, 10.0), (0.05, 10.0, 0.1), (2.0, 10.0, 0.1)):
        full = ErrorModel.p1(period, 0.02, process_noise=(b, b), measurement_noise=(d, d))
        for rows in (2, 4):
            model = replace(full, C=full.C[:rows], D=full.D[:rows, :rows])
            for form in ("exact", "printed"):
                assert design_filter(model, form, margin=1e-3).gamma > 0  # type: ignore[arg-type]


def test_the_inequality_is_the_lemma_written_out() -> None:
    """Schur complements of the blocks give (2.16) and, for the printed form, its double count."""
    rng = np.random.default_rng(5)
    model = ErrorModel.p1(0.2, 0.1, process_noise=(0.5, 0.3), measurement_noise=(0.4, 0.2))
    root = rng.normal(size=(4, 4))
    P, gain, g = root @ root.T + 4 * np.eye(4), rng.normal(size=(4, 4)), 3.0
    A, B = model.A - gain @ model.C, np.hstack([model.B, -gain @ model.D])
    for form, count in (("exact", 1), ("printed", 2)):
        blocks = np.block(inequality(model, P, P @ gain, g**2, form))  # type: ignore[arg-type]
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


def test_a_form_or_a_solver_that_is_none() -> None:
    for solve in (design_filter, minimise_gamma):
        with pytest.raises(ParameterError, match="form is 'other'"):
            solve(ErrorModel.p1(0.2), "other")  # type: ignore[operator]
        with pytest.raises(ParameterError, match="solver is 'other'"):
            solve(ErrorModel.p1(0.2), solver="other")  # type: ignore[operator]


@pytest.mark.parametrize("form", ["exact", "printed"])
def test_two_solvers_find_one_filter(form: str) -> None:
    """An interior-point and a first-order method, at the same second criterion."""
    for model in (ErrorModel.p1(0.2, 0.01), positions_only(0.2)):
        one, two = (design_filter(model, form, solver=s) for s in ("clarabel", "scs"))  # type: ignore[arg-type]
        assert two.gamma == pytest.approx(one.gamma, rel=1e-6)
        assert two.gain == pytest.approx(one.gain, abs=1e-3)


@pytest.mark.parametrize("form", ["exact", "printed"])
def test_the_plain_problem_has_the_gamma_of_the_design(form: str) -> None:
    for model in (ErrorModel.p1(0.2), ErrorModel.p1(1.0, 0.1), positions_only(0.2)):
        gamma, gain = minimise_gamma(model, form)  # type: ignore[arg-type]
        design = design_filter(model, form)  # type: ignore[arg-type]
        assert gamma == pytest.approx(design.gamma, rel=1e-5)
        driven = np.hstack([model.B, -gain @ model.D])
        assert hinf_norm(model.A - gain @ model.C, driven, model.L) <= gamma * (1 + 1e-4)


def test_exact_velocities_make_the_position_a_random_walk() -> None:
    """Noise in the positions alone: gamma^2 = b^2 + d^2 for every period, and A_f = 0."""
    for period in (0.2, 1.0):
        model = ErrorModel.p1(period, process_noise=(4.0, 4.0), measurement_noise=(0.21, 0.0))
        gamma, gain = minimise_gamma(model)
        assert gamma == pytest.approx((4**2 + 0.21**2) ** 0.5, rel=1e-7)
        assert gain == pytest.approx(model.A, abs=1e-6)
