"""Noise figures of simulated errors, against the numbers that they were simulated with."""

from __future__ import annotations

import numpy as np
import pytest

from inswsn_lib.errors import ParameterError
from inswsn_lib.evaluation import fit_noise
from inswsn_lib.models import ErrorModel


def test_it_finds_what_the_errors_were_simulated_with() -> None:
    rng = np.random.default_rng(1)
    model = ErrorModel.p1(0.2).with_covariances(np.diag([4, 1, 0.5, 2.0]), np.diag([1, 2, 3, 4.0]))
    steps, runs = 200, 500
    x = np.empty((steps, 4, runs))
    x[0] = 3.0 * rng.standard_normal((4, runs))
    for k in range(steps - 1):
        x[k + 1] = model.A @ x[k] + model.B @ rng.standard_normal((4, runs))
    v = model.D @ rng.standard_normal((steps, 4, runs))
    v[3:5, 1, :7] = np.nan
    found = fit_noise(model.A, x, v)
    # standard error of a variance from 100,000 draws is 0.45 %, from 500 it is 6.3 %
    assert found.process == pytest.approx(model.process_covariance, abs=0.1)
    assert found.measurement == pytest.approx(model.measurement_covariance, abs=0.1)
    assert np.diag(found.initial) == pytest.approx([9] * 4, rel=0.3)


def test_by_hand() -> None:
    found = fit_noise([[1.0]], [[[1.0, 3.0]], [[2.0, 1.0]]], [[[3.0, np.nan]], [[np.nan, 1.0]]])
    assert found.initial == pytest.approx(5.0)  # (1 + 9) / 2
    assert found.process == pytest.approx(2.5)  # (1 + 4) / 2
    assert found.measurement == pytest.approx(5.0)  # (9 + 1) / 2


@pytest.mark.parametrize(
    ("states", "errors", "said"),
    [
        (np.zeros((1, 4, 2)), np.zeros((1, 4, 2)), "states is"),
        (np.zeros((3, 4, 0)), np.zeros((3, 4, 0)), "states is"),
        (np.full((3, 4, 2), np.nan), np.zeros((3, 4, 2)), "states is"),
        (np.zeros((3, 3, 2)), np.zeros((3, 4, 2)), "A is"),
        (np.zeros((3, 4, 2)), np.zeros((3, 4)), "measurement_errors"),
        (np.zeros((3, 4, 2)), np.zeros((2, 4, 2)), "measurement_errors"),
        (np.zeros((3, 4, 2)), np.full((3, 4, 2), np.inf), "measurement_errors"),
        (np.zeros((3, 4, 2)), np.full((3, 4, 2), np.nan), "never complete"),
    ],
)
def test_what_cannot_be_is_refused(states: np.ndarray, errors: np.ndarray, said: str) -> None:
    with pytest.raises(ParameterError, match=said):
        fit_noise(np.eye(4), states, errors)
