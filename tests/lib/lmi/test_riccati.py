"""The Riccati route against closed forms, the convex problem, and a control library's synthesis."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from inswsn_lib.errors import ParameterError
from inswsn_lib.filters import predictor_gain
from inswsn_lib.lmi import design_filter, hinf_norm, riccati_filter, riccati_gamma
from inswsn_lib.models import ErrorModel


def positions_only(period: float) -> ErrorModel:
    full = ErrorModel.p1(period)
    return ErrorModel(A=full.A, B=full.B, C=np.eye(2, 4), D=np.eye(2), L=full.L, E=full.E,
                      period=period)  # fmt: skip


@pytest.mark.parametrize(("b", "d"), [(1.0, 1.0), (0.2, 3.0), (5.0, 0.1)])
def test_a_random_walk_has_a_deadbeat_filter(b: float, d: float) -> None:
    """gamma^2 = b^2 + d^2, at the gain 1."""
    one = np.eye(1)
    model = ErrorModel(A=one, B=b * one, C=one, D=d * one, L=one, E=0 * one, period=1.0)
    gamma = riccati_gamma(model)
    assert gamma == pytest.approx((b**2 + d**2) ** 0.5, rel=1e-7)
    gain = riccati_filter(model, gamma)
    assert gain is not None
    assert gain.item() == pytest.approx(1, abs=1e-3)


@pytest.mark.parametrize("model", [ErrorModel.p1(0.2), ErrorModel.p1(0.02), positions_only(0.2)])
def test_it_agrees_with_the_convex_problem(model: ErrorModel) -> None:
    assert riccati_gamma(model) == pytest.approx(design_filter(model).gamma, rel=1e-6)


def test_for_a_large_bound_it_is_the_kalman_predictor() -> None:
    model = ErrorModel.p1(0.2, process_noise=(0.3, 0.2), measurement_noise=(0.5, 0.4))
    gain = riccati_filter(model, 1e6)
    assert gain is not None
    assert gain == pytest.approx(predictor_gain(model), abs=1e-9)


def test_what_it_returns_keeps_its_bound() -> None:
    model = positions_only(0.2)
    least = riccati_gamma(model)
    assert riccati_filter(model, 0.999 * least) is None
    for factor in (1.001, 1.1, 2.0):
        gain = riccati_filter(model, factor * least)
        assert gain is not None
        driven = np.hstack([model.B, -gain @ model.D])
        assert hinf_norm(model.A - gain @ model.C, driven, model.L) <= factor * least * (1 + 1e-9)


def test_an_unstable_mode_that_is_not_seen_has_no_filter() -> None:
    model = ErrorModel(A=np.diag([1.1, 0.5]), B=np.eye(2), C=np.array([[0.0, 1.0]]), D=np.eye(1),
                       L=np.eye(2), E=np.zeros((2, 2)), period=1.0)  # fmt: skip
    assert riccati_gamma(model) == np.inf


def synthesis_exists(model: ErrorModel, gamma: float) -> bool:
    """Ask SLICOT's SB10DD for any controller, of any structure, that corrects a copy of the model.

    The error obeys e+ = A e + B w - u, and z_{k+1} = L e_{k+1} is what u at step k can act on.
    """
    slycot = pytest.importorskip("slycot", reason="wheels are locked for Linux alone")
    n, k, out = len(model.A), len(model.C), len(model.L)
    p, q = model.B.shape[1], model.D.shape[1]
    B = np.hstack([model.B, np.zeros((n, q)), -np.eye(n)])
    C = np.vstack([model.L @ model.A, model.C])
    D = np.block(
        [
            [model.L @ model.B, np.zeros((out, q)), -model.L],
            [np.zeros((k, p)), model.D, np.zeros((k, n))],
        ]
    )
    try:
        slycot.sb10dd(n, p + q + n, out + k, n, k, gamma, model.A, B, C, D)
    except slycot.exceptions.SlycotArithmeticError:
        return False
    return True


@pytest.mark.parametrize(
    "model",
    [
        ErrorModel.p1(0.2),
        ErrorModel.p1(1.0, process_noise=(0.3, 0.2), measurement_noise=(0.5, 0.4)),
        positions_only(0.2),
    ],
)
def test_a_synthesis_of_any_structure_has_the_same_least_gamma(model: ErrorModel) -> None:
    least = design_filter(model).gamma
    assert synthesis_exists(model, 1.001 * least)
    assert not synthesis_exists(model, 0.999 * least)


@pytest.mark.parametrize("size", [0.001, 1.0, 1000.0])
def test_a_push_that_is_seen_one_step_later(size: float) -> None:
    """L B = 0: one step tells nothing of the scale."""
    model = ErrorModel(
        A=np.array([[1.0, 0.2], [0.0, 1.0]]), B=np.array([[0.0], [size]]), C=np.eye(2),
        D=size * np.eye(2), L=np.array([[1.0, 0.0]]), E=np.zeros((2, 2)), period=0.2,
    )  # fmt: skip
    assert riccati_gamma(model) == pytest.approx(design_filter(model).gamma, rel=1e-5)


def test_a_gamma_far_above_what_one_step_does() -> None:
    model = positions_only(0.005)
    assert riccati_gamma(model) == pytest.approx(design_filter(model).gamma, rel=1e-5)
    assert riccati_gamma(model) > 150


def test_an_output_of_its_own_scale() -> None:
    """L = 100 of one state alone: gamma is that of L = 1 times 100."""
    L = np.array([[0.0, 0.0, 1.0, 0.0]])
    one, hundred = (replace(ErrorModel.p1(0.2), L=s * L) for s in (1.0, 100.0))
    assert riccati_gamma(hundred) == pytest.approx(100 * riccati_gamma(one), rel=1e-7)
    assert riccati_gamma(one) == pytest.approx(design_filter(one).gamma, rel=1e-5)


def test_what_it_cannot_do_is_refused() -> None:
    with pytest.raises(ParameterError, match="B is"):
        riccati_gamma(ErrorModel.p1(0.2, process_noise=(1.0, 0.0)))
    with pytest.raises(ParameterError, match="B, L is 'zero'"):
        riccati_gamma(replace(ErrorModel.p1(0.2), L=np.zeros((1, 4))))
    for relative in (0.0, -1.0, float("nan"), 1.0, 1e-17):
        with pytest.raises(ParameterError, match="relative is"):
            riccati_gamma(ErrorModel.p1(0.2), relative)
    with pytest.raises(ParameterError, match="E is"):
        riccati_gamma(ErrorModel.p1(0.2, 0.01))
    with pytest.raises(ParameterError, match="D is"):
        riccati_gamma(ErrorModel.p1(0.2, measurement_noise=(0.0, 1.0)))
    for gamma in (0.0, -1.0, float("nan"), float("inf"), 1e200):
        with pytest.raises(ParameterError, match="gamma is"):
            riccati_filter(ErrorModel.p1(0.2), gamma)
