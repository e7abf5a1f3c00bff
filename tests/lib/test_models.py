"""The error model: its matrices as P1 prints them, and what it refuses."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given, strategies as st
from hypothesis.extra.numpy import arrays

from inswsn_lib.errors import ParameterError
from inswsn_lib.models import ErrorModel


def test_the_matrices_are_those_of_p1() -> None:
    model = ErrorModel.p1(0.2, 0.0012, process_noise=(4.0, 3.0), measurement_noise=(0.2, 0.1))
    # (2.3), (2.5) and the printed B_f of (5.1), which is A
    assert model.A.tolist() == [[1, 0, 0.2, 0], [0, 1, 0, 0.2], [0, 0, 1, 0], [0, 0, 0, 1]]
    assert model.E.tolist() == [[0, 0, 0.0012, 0], [0, 0, 0, 0.0012], [0] * 4, [0] * 4]
    assert model.C.tolist() == np.eye(4).tolist() == model.L.tolist()
    assert np.diag(model.process_covariance) == pytest.approx([16, 16, 9, 9])
    assert np.diag(model.measurement_covariance) == pytest.approx([0.04, 0.04, 0.01, 0.01])


def test_constant_velocity_error_integrates_to_position() -> None:
    model, x = ErrorModel.p1(0.25), np.array([1.0, -1.0, 0.5, 2.0])
    for _ in range(8):
        x = model.A @ x
    assert x == pytest.approx([1 + 2 * 0.5, -1 + 2 * 2.0, 0.5, 2.0])


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"period": 0.0}, "period"),
        ({"period": float("nan")}, "period"),
        ({"jitter": -1.0}, "jitter"),
        ({"process_noise": (1.0, float("inf"))}, "process_noise"),
        ({"process_noise": 0.01}, "process_noise .* not of shape"),
        ({"process_noise": (0.01,)}, "process_noise .* not of shape"),
        ({"measurement_noise": ("a", 0.1)}, "measurement_noise .* not <U"),
        ({"measurement_noise": (0.1, -1)}, "measurement_noise must be two non-negative"),
        ({"measurement_noise": (-1.0, 1.0)}, "measurement_noise"),
        ({"L": np.eye(3)}, "L must be"),
        ({"L": np.full((1, 4), np.nan)}, "L must be"),
    ],
)
def test_what_cannot_be_is_refused(changes: dict[str, Any], said: str) -> None:
    with pytest.raises(ParameterError, match=said):
        ErrorModel.p1(**({"period": 1.0} | changes))


@pytest.mark.parametrize("name", ["A", "B", "C", "D", "E"])
def test_shapes_that_do_not_fit_are_refused(name: str) -> None:
    fields = {f: getattr(ErrorModel.p1(1.0), f) for f in ("A", "B", "C", "D", "L", "E", "period")}
    with pytest.raises(ParameterError, match=r" must be .* not of shape"):
        ErrorModel(**(fields | {name: np.eye(3)}))
    with pytest.raises(ParameterError, match=rf"{name} .* not of shape"):
        ErrorModel(**(fields | {name: np.ones(4)}))


@given(rows=arrays(float, (4, 4), elements=st.floats(-10, 10)))
def test_covariances_come_back_from_their_factors(rows: np.ndarray) -> None:
    covariance = rows @ rows.T
    model = ErrorModel.p1(0.2, 0.01).with_covariances(covariance, 2 * covariance)
    assert model.process_covariance == pytest.approx(covariance, abs=1e-9)
    assert model.measurement_covariance == pytest.approx(2 * covariance, abs=1e-9)
    assert pytest.approx(model.B.T, abs=1e-9) == model.B  # the symmetric root
    plain = ErrorModel.p1(0.2, 0.01)
    assert np.array_equal(model.A, plain.A)
    assert np.array_equal(model.E, plain.E)
    with pytest.raises(ParameterError, match=r"process .* not one with a negative eigenvalue"):
        plain.with_covariances(-np.eye(4), np.eye(4))


def test_the_model_of_p2_is_that_of_p1_without_jitter() -> None:
    """P2 (2): the velocity error adds T times itself to the position error; nothing else moves."""
    model = ErrorModel.p2(0.02, process_noise=(0.1, 0.2), measurement_noise=(0.3, 0.4))
    expected = np.eye(4)
    expected[0, 2] = expected[1, 3] = 0.02
    assert np.array_equal(model.A, expected)
    assert not model.E.any()
    assert np.diag(model.B).tolist() == [0.1, 0.1, 0.2, 0.2]
    assert np.diag(model.D).tolist() == [0.3, 0.3, 0.4, 0.4]
    with pytest.raises(ParameterError, match="period must be"):
        ErrorModel.p2(-1.0)


def test_a_coloured_error_has_the_variance_and_the_autocorrelation_asked_for() -> None:
    """In the steady state of c, which is its start: X = phi X phi + (1 - phi^2)(1 - s) R."""
    plain = ErrorModel.p1(0.5, measurement_noise=(2.0, 0.5))
    model = plain.with_coloured_noise([1.0, 2.0, 0.0, 4.0], white=[0.25, 0.5, 1.0, 0.1])
    phi, R = model.A[4:, 4:], plain.measurement_covariance
    coloured = R * np.array([0.75, 0.5, 0.0, 0.9])
    np.testing.assert_allclose(
        phi @ coloured @ phi + model.process_covariance[4:, 4:], coloured, atol=1e-15
    )
    np.testing.assert_allclose(coloured + model.measurement_covariance, R, atol=1e-15)
    np.testing.assert_allclose(phi.diagonal(), np.exp([-0.5, -0.25, -np.inf, -0.125]))
    np.testing.assert_array_equal(model.C, np.hstack([plain.C, np.eye(4)]))


@pytest.mark.parametrize(
    "given", [{"correlation_time": -1.0}, {"correlation_time": 1.0, "white": 0.0}]
)
def test_a_coloured_error_that_cannot_be_is_refused(given: dict[str, float]) -> None:
    with pytest.raises(ParameterError, match=list(given)[-1]):
        ErrorModel.p1(0.5).with_coloured_noise(**given)
