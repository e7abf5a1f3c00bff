"""The constant-gain filter: its recursion, its deadbeat case, and gaps."""

from __future__ import annotations

import numpy as np
import pytest

from inswsn_lib.errors import ParameterError
from inswsn_lib.evaluation import monte_carlo
from inswsn_lib.filters import deadbeat_gain, run_hinfinity
from inswsn_lib.lmi import design_filter
from inswsn_lib.models import ErrorModel

MODEL = ErrorModel.p1(0.2)
Y = np.random.default_rng(7).normal(size=(12, 4, 3))


def test_it_is_the_recursion_of_p1() -> None:
    design = design_filter(MODEL)
    x = np.zeros((4, 3))
    for measured, estimate in zip(Y, run_hinfinity(design, Y), strict=True):
        assert estimate == pytest.approx(x)
        x = design.A_f @ x + design.gain @ measured


def test_deadbeat_carries_the_last_measurement_one_step() -> None:
    gain = deadbeat_gain(MODEL)
    assert gain == pytest.approx(MODEL.A)
    predicted = run_hinfinity((MODEL, gain), Y)
    assert predicted[1:] == pytest.approx(np.einsum("ij,kjr->kir", MODEL.A, Y[:-1]))
    assert run_hinfinity((MODEL, gain), Y, predicted=False) == pytest.approx(Y)


def test_a_gap_is_dead_reckoning() -> None:
    y = Y.copy()
    y[5:] = np.nan
    estimates = run_hinfinity((MODEL, deadbeat_gain(MODEL)), y, predicted=False)
    for k in range(5, 12):
        assert estimates[k] == pytest.approx(np.linalg.matrix_power(MODEL.A, k - 4) @ Y[4])


def test_runs_do_not_depend_on_one_another() -> None:
    design = design_filter(MODEL)
    together = run_hinfinity(design, Y)
    for run in range(3):
        alone = run_hinfinity(design, Y[:, :, [run]])
        assert together[:, :, [run]] == pytest.approx(alone, abs=1e-12)


def test_a_measurement_that_cannot_be_inverted() -> None:
    half = ErrorModel(A=MODEL.A, B=MODEL.B, C=np.eye(2, 4), D=np.eye(2), L=MODEL.L, E=MODEL.E,
                      period=0.2)  # fmt: skip
    with pytest.raises(ParameterError, match="square and invertible"):
        deadbeat_gain(half)


def test_monte_carlo_has_the_covariance_of_the_exact_recursion() -> None:
    """S+ = (A - B_f C) S (A - B_f C)' + Q + B_f R B_f', from the covariance of the first state."""
    model = ErrorModel.p1(0.2, process_noise=(0.05, 0.2), measurement_noise=(0.3, 0.1))
    design = design_filter(model)
    steps, runs = 30, 8192

    def simulate(rng: np.random.Generator, count: int) -> dict[str, np.ndarray]:
        x = 2.0 * rng.standard_normal((4, count))
        states, y = np.empty((2, steps, 4, count))
        for k in range(steps):
            states[k], y[k] = x, model.C @ x + model.D @ rng.standard_normal((4, count))
            x = model.A @ x + model.B @ rng.standard_normal((4, count))
        return {"states": states, "y": y}

    drawn = monte_carlo(simulate, runs, seed=31)
    errors = drawn["states"] - run_hinfinity(design, drawn["y"])
    exact = 4.0 * np.eye(4)
    for k in range(steps):
        found = errors[k] @ errors[k].T / runs
        # relative standard error of a variance: 1.6 %; 120 of them, four and a half of it
        assert np.diag(found) == pytest.approx(np.diag(exact), rel=0.07)
        driven = design.gain @ model.measurement_covariance @ design.gain.T
        exact = design.A_f @ exact @ design.A_f.T + model.process_covariance + driven
