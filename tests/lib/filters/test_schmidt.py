"""Schmidt's filter against the Kalman filter, and against covariances by hand and by runs."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from inswsn_lib.errors import ParameterError
from inswsn_lib.filters import design_kalman, run_kalman, run_schmidt
from inswsn_lib.models import ErrorModel

COLOURED = ErrorModel.p1(0.2, process_noise=(0.02, 0.1), measurement_noise=(0.14, 0.12))
START = np.diag([1.0, 1.0, 0.2, 0.2, 0.14**2, 0.14**2, 0.12**2, 0.12**2])


def test_without_considered_states_it_is_the_kalman_filter_also_where_data_is_missing() -> None:
    y = np.random.default_rng(1).standard_normal((40, 4, 5))
    y[np.random.default_rng(2).random(y.shape) < 0.2] = np.nan
    options: dict[str, Any] = {"initial_covariance": np.eye(4)}
    for predicted in (False, True):
        found = run_schmidt(COLOURED, y, considered=0, predicted=predicted, **options)
        np.testing.assert_allclose(
            found, run_kalman(COLOURED, y, predicted=predicted, **options), atol=1e-12
        )


def test_a_constant_and_an_unknown_offset_by_hand() -> None:
    """P_0 = 4, offset variance 1, noise variance 1: K = 4 / 6, and then by its covariances."""
    model = ErrorModel(A=np.eye(2), B=[[0], [0]], C=[[1, 1]], D=[[1]], period=1.0)
    P0 = np.diag([4.0, 1.0])
    found = run_schmidt(model, [[3], [0]], considered=1, initial_covariance=P0)[:, 0]
    first = 4 / 6
    # errors after the first update: own variance, and its covariance with the offset
    own, shared = (1 - first) ** 2 * 4 + first**2 * 2, -first
    second = (own + shared) / (own + 2 * shared + 1 + 1)
    assert found == pytest.approx([3 * first, 3 * first * (1 - second)])


def test_it_lies_between_a_filter_that_estimates_correlated_errors_and_one_that_ignores() -> None:
    """By 4,000 runs of the model itself; the full Kalman filter is the best linear estimator."""
    model, runs, rng = COLOURED.with_coloured_noise(1.0), 4000, np.random.default_rng(3)
    x = np.sqrt(START) @ rng.standard_normal((8, runs))
    truth, measured = [], []
    for _ in range(60):
        truth.append(x[:4])
        measured.append(model.C @ x)
        x = model.A @ x + model.B @ rng.standard_normal((8, runs))
    error = {
        "full": run_kalman(model, measured, initial_covariance=START)[:, :4],
        "schmidt": run_schmidt(model, measured, considered=4, initial_covariance=START),
        "ignorant": run_kalman(COLOURED, measured, initial_covariance=START[:4, :4]),
    }
    rms = {name: np.sqrt(np.mean((e - truth)[20:, :2] ** 2)) for name, e in error.items()}
    assert rms["full"] < 0.98 * rms["schmidt"]
    assert rms["schmidt"] < rms["ignorant"]
    design = design_kalman(model, np.ones((60, 4), bool), initial_covariance=START)
    told = np.sqrt(np.mean([np.diag(P)[:2] for P in design.filtered[20:]]))
    assert rms["full"] == pytest.approx(told, rel=0.03)


def test_all_states_considered_is_refused() -> None:
    with pytest.raises(ParameterError, match="considered"):
        run_schmidt(COLOURED, np.zeros((2, 4, 1)), considered=4, initial_covariance=np.eye(4))
