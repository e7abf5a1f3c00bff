"""The steady Kalman predictor and the error of a gain, against closed forms and the recursion."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from inswsn_lib.errors import ParameterError
from inswsn_lib.filters import deadbeat_gain, design_kalman, predictor_gain, steady_error
from inswsn_lib.models import ErrorModel


def scalar(a: float, b: float, c: float, d: float) -> ErrorModel:
    one = np.eye(1)
    return ErrorModel(A=a * one, B=b * one, C=c * one, D=d * one, L=one, E=0 * one, period=1.0)


def test_the_golden_ratio() -> None:
    assert predictor_gain(scalar(1, 1, 1, 1)).item() == pytest.approx((5**0.5 - 1) / 2)


def test_it_is_where_the_recursion_settles() -> None:
    model = ErrorModel.p1(0.3, process_noise=(0.2, 0.1), measurement_noise=(0.5, 0.4))
    K = design_kalman(model, np.ones((300, 4), bool), initial_covariance=np.eye(4)).gains[-1]
    assert predictor_gain(model) == pytest.approx(model.A @ K, abs=1e-9)


@pytest.mark.parametrize("k", [0.2, 0.6, 1.0, 1.4])
def test_the_error_of_a_scalar_gain_by_hand(k: float) -> None:
    """(b^2 + k^2 d^2) / (2 k - k^2)."""
    b, d = 0.7, 0.3
    expected = ((b**2 + k**2 * d**2) / (2 * k - k**2)) ** 0.5
    assert steady_error(scalar(1, b, 1, d), [[k]]) == pytest.approx(expected)


def test_a_deadbeat_error_is_two_noises() -> None:
    model = ErrorModel.p1(0.2, process_noise=(2.0, 1.0), measurement_noise=(0.5, 0.4))
    # x axis: position b^2 + d^2 + T^2 dv^2, velocity bv^2 + dv^2; twice for two axes
    expected = 2 * (2**2 + 0.5**2 + 0.2**2 * 0.4**2 + 1 + 0.4**2)
    assert steady_error(model, deadbeat_gain(model)) == pytest.approx(expected**0.5)


def test_no_gain_has_a_smaller_error_than_the_predictor() -> None:
    model = ErrorModel.p1(0.2, process_noise=(0.3, 0.2))
    best = predictor_gain(model)
    least = steady_error(model, best)
    rng = np.random.default_rng(1)
    for _ in range(50):
        assert steady_error(model, best + 0.05 * rng.standard_normal((4, 4))) > least


def test_an_unstable_error_has_no_steady_state() -> None:
    assert steady_error(scalar(1, 1, 1, 1), [[0.0]]) == np.inf
    for model in (
        scalar(1.2, 1, 0, 1),  # not measured
        scalar(1, 0, 1, 1),  # on the unit circle, not driven
        scalar(1, 1, 0, 0),
        ErrorModel.p1(0.2, process_noise=(1.0, 0.0)),
    ):
        with pytest.raises(ParameterError, match="model is 'without a steady state'"):
            predictor_gain(model)


def test_what_l_does_not_see_does_not_count() -> None:
    model = ErrorModel.p1(0.2, process_noise=(2.0, 1.0), measurement_noise=(0.5, 0.4))
    positions = replace(model, L=np.eye(2, 4))
    expected = 2 * (2**2 + 0.5**2 + 0.2**2 * 0.4**2)
    assert steady_error(positions, deadbeat_gain(model)) == pytest.approx(expected**0.5)


def test_a_gain_of_another_shape_is_refused() -> None:
    for gain in (np.eye(2), [[np.nan]]):
        with pytest.raises(ParameterError, match="gain is"):
            steady_error(scalar(1, 1, 1, 1), gain)
