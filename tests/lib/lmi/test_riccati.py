"""The Riccati route against closed forms, the convex problem, and a control library's synthesis."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from random_systems import positions_only

from inswsn_lib import ErrorModel
from inswsn_lib.errors import ParameterError
from inswsn_lib.filters import predictor_gain
from inswsn_lib.lmi import design_filter, hinf_norm, riccati_filter, riccati_gamma


@pytest.mark.parametrize(("b", "d"), [(1.0, 1.0), (0.2, 3.0), (5.0, 0.1)])
def test_a_random_walk_has_a_deadbeat_filter(b: float, d: float) -> None:
    """gamma^2 = b^2 + d^2, at the gain 1."""
    model = ErrorModel(A=[[1]], B=[[b]], C=[[1]], D=[[d]], period=1.0)
    gamma = riccati_gamma(model)
    least = (b**2 + d**2) ** 0.5
    assert least <= gamma <= least * (1 + 1e-7)
    gain = riccati_filter(model, gamma)
    assert gain is not None
    assert gain.item() == pytest.approx(1, abs=1e-3)
    assert riccati_gamma(model, 1e-2) == pytest.approx(least, rel=1e-2)


def pushed(size: float) -> ErrorModel:
    """What pushes is seen one step later, L B = 0: one step tells nothing of the scale."""
    return ErrorModel(
        A=[[1.0, 0.2], [0.0, 1.0]], B=[[0.0], [size]], C=np.eye(2), D=size * np.eye(2),
        L=[[1.0, 0.0]], period=0.2,
    )  # fmt: skip


@pytest.mark.parametrize(
    "model",
    [
        *(ErrorModel.p1(0.2), ErrorModel.p1(0.02), positions_only(0.2)),
        positions_only(0.005),  # whose gamma is far above what one step does
        *map(pushed, (0.001, 1.0, 1000.0)),
    ],
)
def test_it_agrees_with_the_convex_problem(model: ErrorModel) -> None:
    assert riccati_gamma(model) == pytest.approx(design_filter(model).gamma, rel=5e-6)


def test_for_a_large_bound_it_is_the_kalman_predictor() -> None:
    model = ErrorModel.p1(0.2, process_noise=(0.3, 0.2), measurement_noise=(0.5, 0.4))
    for gamma in (1e6, 1e100):
        gain = riccati_filter(model, gamma)
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
    model = ErrorModel(A=np.diag([1.1, 0.5]), B=np.eye(2), C=[[0.0, 1.0]], D=np.eye(1), period=1.0)
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


@pytest.mark.parametrize("model", [ErrorModel.p1(0.2), positions_only(0.2)])
def test_a_synthesis_of_any_structure_has_the_same_least_gamma(model: ErrorModel) -> None:
    least = riccati_gamma(model)
    assert synthesis_exists(model, 1.001 * least)
    assert not synthesis_exists(model, 0.999 * least)


P1 = ErrorModel.p1(0.2)


@pytest.mark.parametrize(
    ("call", "said"),
    [
        (lambda: riccati_filter(P1, 0.0), "gamma must be .* above 0 and at most 1e.100, not 0.0"),
        (lambda: riccati_filter(P1, 1e101), "gamma must be"),
        (lambda: riccati_gamma(P1, 1e-15), "relative .* at least 1e-14 and below 1, not 1e-15"),
        (lambda: riccati_gamma(P1, 1.0), "relative .* not 1.0"),
        (lambda: riccati_gamma(replace(P1, L=np.zeros((1, 4)))), "B and L must be nonzero"),
        (
            lambda: riccati_gamma(replace(P1, A=P1.A / 2, B=np.zeros((4, 1)))),
            "B and L must be nonzero matrices",
        ),
        *(
            (lambda model=model, find=find: find(model), said)
            for find in (riccati_gamma, lambda model: riccati_filter(model, 2.0))
            for model, said in (
                (ErrorModel.p1(0.2, 0.01), "E must be zero, since the equation has no "),
                (ErrorModel.p1(0.2, measurement_noise=(0.0, 1.0)), "D must be of full row rank"),
                (ErrorModel.p1(0.2, process_noise=(1.0, 0.0)), "B must be one that drives"),
            )
        ),
    ],
)
def test_what_it_cannot_do_is_refused(call: Any, said: str) -> None:
    with pytest.raises(ParameterError, match=f"^{said}"):
        call()
