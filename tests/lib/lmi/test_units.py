"""Units: what a solver is given does not depend on the units that a model comes in."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st
from random_systems import in_units

from inswsn_lib import ErrorModel
from inswsn_lib.lmi.units import Units


@settings(max_examples=30)
@given(st.integers(0, 10**6), st.floats(0, 16))
def test_in_them_a_kalman_predictor_has_unit_covariances(seed: int, decades: float) -> None:
    """P = I and the innovation's covariance I: the Riccati equation, written out in the units."""
    rng = np.random.default_rng(seed)
    A = rng.normal(size=(3, 3))
    A *= rng.uniform(0.2, 1.3) / np.abs(np.linalg.eigvals(A)).max()
    B, C, D = (rng.normal(size=size) for size in ((3, 3), (2, 3), (2, 2)))
    model = in_units(ErrorModel(A=A, B=B, C=C, D=D, period=1.0), rng, decades)
    scaled = Units.of(model).scaled(model)
    A, B, C, D, eye = scaled.A, scaled.B, scaled.C, scaled.D, np.eye(3)
    assert pytest.approx(np.eye(2), abs=1e-6) == C @ C.T + D @ D.T
    assert A @ (eye - C.T @ C) @ A.T + B @ B.T == pytest.approx(eye, abs=1e-5)
    assert np.linalg.norm(scaled.L, 2) == pytest.approx(1)


def test_a_random_walk_by_hand() -> None:
    """P = 1.618, the golden ratio, and the innovation's variance P + 1, in any unit."""
    golden = (1 + 5**0.5) / 2
    for unit, output in ((1.0, 1.0), (1e9, 1e-7)):
        model = ErrorModel(A=[[1]], B=[[unit]], C=[[output / unit]], D=[[output]], period=1.0)
        units = Units.of(model)
        assert units.states.item() * unit == pytest.approx(golden**-0.5)
        assert units.back.item() / unit == pytest.approx(golden**0.5)
        assert units.outputs.item() * output == pytest.approx((golden + 1) ** -0.5)
        assert units.seen / unit == pytest.approx(golden**0.5)


def test_a_mode_that_grows_unseen_leaves_the_units_of_the_model() -> None:
    """There is no predictor; what is given is finite."""
    model = ErrorModel(A=np.diag([2.0, 0.5]), B=np.eye(2), C=[[0, 1]], D=[[1]], period=1.0)
    scaled = Units.of(model).scaled(model)
    for name in "ABCDL":
        assert np.isfinite(getattr(scaled, name)).all()
        assert np.abs(getattr(scaled, name)).max() < 10
