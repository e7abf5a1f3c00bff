"""Analytic centres: deadbeat at every level without measurement noise, and not with it."""

from __future__ import annotations

import numpy as np
import pytest

from inswsn_lib.errors import ParameterError
from inswsn_lib.lmi import InfeasibleDesignError, central_gain, design_filter
from inswsn_lib.models import ErrorModel


@pytest.mark.parametrize("form", ["exact", "printed"])
@pytest.mark.parametrize("period", [0.2, 1.0])
@pytest.mark.parametrize("over", [1.005, 1.1, 2.0])
def test_without_measurement_noise_it_is_deadbeat(form: str, period: float, over: float) -> None:
    model = ErrorModel.p1(period, 0.01, process_noise=(3.0, 1.0), measurement_noise=(0.0, 0.0))
    gain = central_gain(model, over * 3.0 * (1 + 1e-4), form)  # type: ignore[arg-type]
    assert gain == pytest.approx(model.A, abs=1e-7)


def test_with_measurement_noise_it_is_not() -> None:
    model = ErrorModel.p1(0.2, process_noise=(4.0, 4.0), measurement_noise=(0.19, 0.19))
    gain = central_gain(model, 1.005 * design_filter(model).gamma)
    assert 1e-6 < np.abs(model.A - gain).max() < 1e-3


def test_a_scalar_with_another_output() -> None:
    """D = 0: Gamma is free and zero at the centre, so the gain is A / C."""
    one = np.eye(1)
    model = ErrorModel(A=0.5 * one, B=one, C=4 * one, D=0 * one, L=one, E=0 * one, period=1.0)
    assert central_gain(model, 3.0).item() == pytest.approx(0.125, abs=1e-8)


def test_below_the_least_gamma_there_is_none() -> None:
    model = ErrorModel.p1(0.2)
    with pytest.raises(InfeasibleDesignError):
        central_gain(model, 0.9 * design_filter(model).gamma)


def test_what_cannot_be_is_refused() -> None:
    model = ErrorModel.p1(0.2)
    with pytest.raises(ParameterError, match="form is 'other'"):
        central_gain(model, 2.0, "other")  # type: ignore[arg-type]
    for level in (0.0, -1.0, float("nan"), float("inf")):
        with pytest.raises(ParameterError, match="level is"):
            central_gain(model, level)
