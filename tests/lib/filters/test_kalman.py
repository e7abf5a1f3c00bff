"""The Kalman filter against least squares, the Riccati equation, closed forms and gaps."""

from __future__ import annotations

import warnings

import numpy as np
import pytest
from hypothesis import given, strategies as st
from scipy.linalg import block_diag, solve_discrete_are

from inswsn_lib.errors import ParameterError
from inswsn_lib.evaluation import mean_bounds, normalised_squares
from inswsn_lib.filters import design_kalman, run_kalman
from inswsn_lib.models import ErrorModel


def random_model(rng: np.random.Generator, n: int, m: int) -> ErrorModel:
    return ErrorModel(
        A=rng.normal(size=(n, n)) / np.sqrt(n), B=rng.normal(size=(n, n)),
        C=rng.normal(size=(m, n)), D=np.eye(m) + 0.3 * rng.normal(size=(m, m)),
        L=np.eye(n), E=np.zeros((n, n)), period=1.0,
    )  # fmt: skip


def least_squares(model: ErrorModel, y: np.ndarray, P0: np.ndarray) -> np.ndarray:
    """Return the last state that fits all measurements best, by one big weighted regression.

    Unknowns are all states. Rows: the prior of the first, each transition, each measurement.
    """
    steps, n = len(y), len(model.A)
    design, right, weights = [], [], []
    row = np.zeros((n, n * steps))
    row[:, :n] = np.eye(n)
    design, right, weights = [row], [np.zeros(n)], [np.linalg.inv(P0)]
    for k in range(1, steps):
        row = np.zeros((n, n * steps))
        row[:, (k - 1) * n : k * n], row[:, k * n : (k + 1) * n] = -model.A, np.eye(n)
        design.append(row)
        right.append(np.zeros(n))
        weights.append(np.linalg.inv(model.process_covariance))
    for k, measured in enumerate(y):
        seen = ~np.isnan(measured)
        row = np.zeros((seen.sum(), n * steps))
        row[:, k * n : (k + 1) * n] = model.C[seen]
        design.append(row)
        right.append(measured[seen])
        weights.append(np.linalg.inv(model.measurement_covariance[np.ix_(seen, seen)]))
    H, W = np.vstack(design), block_diag(*weights)
    return np.linalg.solve(H.T @ W @ H, H.T @ W @ np.concatenate(right))[-n:]


@given(st.integers(0, 2**32 - 1), st.integers(1, 4), st.integers(1, 3), st.floats(0, 0.9))
def test_it_is_the_least_squares_estimate_whatever_is_missing(
    seed: int, n: int, m: int, missing: float
) -> None:
    rng = np.random.default_rng(seed)
    model = random_model(rng, n, m)
    y = rng.normal(size=(6, m, 3))
    y[rng.random(y.shape) < missing] = np.nan  # another pattern in each run
    P0 = np.diag(rng.uniform(0.5, 2, n))
    estimates = run_kalman(model, y, initial_covariance=P0)
    for run in range(3):
        expected = least_squares(model, y[:, :, run], P0)
        assert estimates[-1, :, run] == pytest.approx(expected, rel=1e-6, abs=1e-7)


def test_the_steady_state_is_that_of_the_riccati_equation() -> None:
    model = ErrorModel.p1(0.2, process_noise=(0.3, 0.1), measurement_noise=(0.2, 0.5))
    design = design_kalman(model, np.ones((400, 4), bool), initial_covariance=np.eye(4))
    P = solve_discrete_are(
        model.A.T, model.C.T, model.process_covariance, model.measurement_covariance
    )
    assert design.predicted[-1] == pytest.approx(P, rel=1e-9, abs=1e-12)


def test_the_golden_ratio_gain() -> None:
    """x+ = x + w, y = x + v with unit variances: P = 1 + P/(P+1), so K = (sqrt 5 - 1)/2."""
    one = np.eye(1)
    model = ErrorModel(A=one, B=one, C=one, D=one, L=one, E=0 * one, period=1.0)
    design = design_kalman(model, np.ones((60, 1), bool), initial_covariance=one)
    assert design.gains[-1, 0, 0] == pytest.approx((np.sqrt(5) - 1) / 2, abs=1e-12)


def test_without_noise_in_the_measurement_it_follows_the_measurement() -> None:
    model = ErrorModel.p1(0.2, measurement_noise=(0.0, 0.0))
    y = np.random.default_rng(1).normal(size=(5, 4, 2))
    kept = run_kalman(model, y, initial_covariance=np.eye(4))
    assert kept == pytest.approx(y, abs=1e-9)
    ahead = run_kalman(model, y, initial_covariance=np.eye(4), predicted=True)
    assert ahead[1:] == pytest.approx(np.einsum("ij,kjr->kir", model.A, y[:-1]), abs=1e-9)
    assert not ahead[0].any()


def test_an_outage_is_dead_reckoning_with_the_last_velocity() -> None:
    model = ErrorModel.p1(0.2, process_noise=(0.1, 0.1), measurement_noise=(0.1, 0.1))
    y = np.ones((30, 4, 1))
    y[10:] = np.nan
    x = run_kalman(model, y, initial_covariance=np.eye(4))[:, :, 0]
    steps = np.arange(20)[:, None]
    assert x[10:, 2:] == pytest.approx(np.broadcast_to(x[9, 2:], (20, 2)))
    assert x[10:, :2] == pytest.approx(x[9, :2] + 0.2 * (steps + 1) * x[9, 2:])
    design = design_kalman(model, ~np.isnan(y[:, :, 0]), initial_covariance=np.eye(4))
    assert not design.gains[10:].any()
    assert (np.diff(design.filtered[9:, 0, 0]) > 0).all()


def test_a_first_state_of_each_run_with_patterns_of_their_own() -> None:
    model = ErrorModel.p1(0.2, process_noise=(0.1, 0.1), measurement_noise=(0.3, 0.3))
    rng = np.random.default_rng(4)
    y, start = rng.normal(size=(9, 4, 5)), rng.normal(size=(4, 5))
    y[3:6, :, 1] = np.nan
    y[:, 2, 3] = np.nan
    together = run_kalman(model, y, initial_covariance=np.eye(4), initial_state=start)
    for run in range(5):
        alone = run_kalman(model, y[:, :, [run]], initial_covariance=np.eye(4),
                           initial_state=start[:, run])  # fmt: skip
        assert together[:, :, [run]] == pytest.approx(alone, abs=1e-12)
    # a first state shifts the problem: with no measurement it is carried on as it is
    y[:] = np.nan
    carried = run_kalman(model, y, initial_covariance=np.eye(4), initial_state=start)
    assert carried[-1] == pytest.approx(np.linalg.matrix_power(model.A, 8) @ start)


def test_covariances_may_change_with_time() -> None:
    model = ErrorModel.p1(0.2)
    Q = np.stack([0.1 * (k + 1) * np.eye(4) for k in range(8)])
    R = np.stack([0.5 * (8 - k) * np.eye(4) for k in range(8)])
    y = np.random.default_rng(2).normal(size=(8, 4, 1))
    whole = run_kalman(model, y, initial_covariance=np.eye(4), process_covariance=Q,
                       measurement_covariance=R)  # fmt: skip
    # step by step by the textbook's formulas
    x, P = np.zeros(4), np.eye(4)
    for k in range(8):
        K = P @ np.linalg.inv(P + R[k])
        x, P = x + K @ (y[k, :, 0] - x), (np.eye(4) - K) @ P
        assert whole[k, :, 0] == pytest.approx(x)
        x, P = model.A @ x, model.A @ P @ model.A.T + Q[k]


def test_the_errors_are_as_large_as_the_filter_says() -> None:
    """NEES and NIS of 400 runs; a true filter leaves the bounds once in 10,000 times."""
    rng = np.random.default_rng(20120707)
    model = ErrorModel.p1(0.2, process_noise=(0.05, 0.1), measurement_noise=(0.2, 0.3))
    steps, runs, P0 = 60, 400, np.diag([1.0, 1.0, 0.25, 0.25])
    x = np.linalg.cholesky(P0) @ rng.standard_normal((4, runs))
    states, y = np.empty((2, steps, 4, runs))
    for k in range(steps):
        states[k] = x
        y[k] = model.C @ x + model.D @ rng.standard_normal((4, runs))
        x = model.A @ x + model.B @ rng.standard_normal((4, runs))
    y[20:30] = np.nan
    design = design_kalman(model, ~np.isnan(y[:, :, 0]), initial_covariance=P0)
    filtered = run_kalman(model, y, initial_covariance=P0)
    ahead = run_kalman(model, y, initial_covariance=P0, predicted=True)
    nees = normalised_squares(states - filtered, design.filtered)
    low, high = mean_bounds(runs, 4, 0.9999)
    # at single steps, since errors of neighbouring steps are not independent
    for k in (0, 15, 29, 30, 59):
        assert low < nees[k].mean() < high
    nis = normalised_squares(y - model.C @ ahead, design.innovation)
    low, high = mean_bounds(50 * runs, 4, 0.9999)  # innovations are independent
    assert low < np.nanmean(nis) < high


@pytest.mark.parametrize(
    ("measurements", "options", "said"),
    [
        (np.zeros((5, 4)), {}, "measurements is 'of shape"),
        (np.zeros((5, 3, 1)), {}, "measurements is 'of shape"),
        (np.full((5, 4, 1), np.inf), {}, "infinite"),
        (np.zeros((5, 4, 1)), {"initial_covariance": np.eye(3)}, "initial_covariance"),
        (np.zeros((5, 4, 1)), {"initial_covariance": -np.eye(4)}, "not positive semidefinite"),
        (np.zeros((5, 4, 1)), {"process_covariance": np.triu(np.ones((4, 4)))}, "not symmetric"),
        (np.zeros((5, 4, 1)), {"measurement_covariance": np.zeros((9, 4, 4))}, "measurement_cov"),
        (
            np.zeros((5, 4, 1)),
            {"measurement_covariance": np.zeros((4, 4)), "initial_covariance": np.zeros((4, 4))},
            "singular",
        ),
        (np.zeros((5, 4, 1)), {"initial_state": np.zeros(3)}, "initial_state"),
    ],
)
def test_what_does_not_fit_is_refused(
    measurements: np.ndarray, options: dict[str, np.ndarray], said: str
) -> None:
    model = ErrorModel.p1(0.2)
    with pytest.raises(ParameterError, match=said):
        run_kalman(model, measurements, **({"initial_covariance": np.eye(4)} | options))


def test_a_mask_that_is_no_mask_is_refused() -> None:
    with pytest.raises(ParameterError, match="available"):
        design_kalman(ErrorModel.p1(0.2), np.ones((3, 4)), initial_covariance=np.eye(4))


def test_runs_that_lose_other_measurements_are_each_filtered_by_themselves() -> None:
    """More runs than are carried at once, the last of each group included."""
    model = ErrorModel.p1(0.2, process_noise=(0.05, 0.1), measurement_noise=(0.2, 0.3))
    y = np.random.default_rng(21).standard_normal((6, 4, 1030))
    y[np.random.default_rng(22).random(y.shape) < 0.2] = np.nan
    together = run_kalman(model, y, initial_covariance=np.eye(4))
    for run in (0, 510, 511, 512, 1023, 1024, 1029):
        alone = run_kalman(model, y[:, :, [run]], initial_covariance=np.eye(4))
        assert together[:, :, [run]] == pytest.approx(alone, abs=1e-12)


def test_numbers_whose_sum_overflows_are_filtered_without_a_word() -> None:
    model = ErrorModel.p1(1.0)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        estimates = run_kalman(model, np.full((2, 4, 3), 1e308), initial_covariance=np.eye(4))
    assert np.isfinite(estimates[0]).all()
    assert estimates[0, 2] == pytest.approx(0.5e308)
