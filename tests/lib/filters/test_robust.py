"""The robust rivals: the Kalman filter where nothing is wrong, better where something is."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, strategies as st
from hypothesis.extra.numpy import arrays

from inswsn_lib.errors import ParameterError
from inswsn_lib.filters import adaptive, gating, huber, run_kalman, run_robust
from inswsn_lib.filters.robust import Policy
from inswsn_lib.models import ErrorModel

MODEL = ErrorModel.p1(0.2, process_noise=(0.05, 0.1), measurement_noise=(0.2, 0.3))
P0 = np.diag([1.0, 1.0, 0.25, 0.25])


def simulate(runs: int, seed: int, factor: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return states and measurements; the measurement noise of step k is scaled by factor[k]."""
    rng = np.random.default_rng(seed)
    x = np.sqrt(P0) @ rng.standard_normal((4, runs))
    states, y = np.empty((2, len(factor), 4, runs))
    for k, scale in enumerate(factor):
        states[k] = x
        y[k] = MODEL.C @ x + scale * MODEL.D @ rng.standard_normal((4, runs))
        x = MODEL.A @ x + MODEL.B @ rng.standard_normal((4, runs))
    return states, y


def error(policy: Policy | None, states: np.ndarray, y: np.ndarray) -> float:
    if policy is None:
        estimates = run_kalman(MODEL, y, initial_covariance=P0)
    else:
        estimates = run_robust(MODEL, y, policy, initial_covariance=P0)
    return float(np.sqrt(np.mean((states - estimates)[:, :2] ** 2)))


@pytest.mark.parametrize("policy", [gating(1 - 1e-15), huber(1e9)])
def test_a_policy_that_never_acts_is_the_kalman_filter(policy: Policy) -> None:
    _, y = simulate(5, 1, np.ones(20))
    y[4:7, :, 1] = np.nan
    y[3, 2, 0] = np.nan
    for predicted in (False, True):
        robust = run_robust(MODEL, y, policy, initial_covariance=P0, predicted=predicted)
        plain = run_kalman(MODEL, y, initial_covariance=P0, predicted=predicted)
        assert robust == pytest.approx(plain, abs=1e-9)


def test_on_clean_data_little_is_lost_and_on_outliers_much_is_won() -> None:
    clean, bursts = np.ones(100), np.ones(100)
    bursts[20::10] = 30.0
    for make in (gating, huber):
        states, y = simulate(300, 2, clean)
        assert error(make(), states, y) < 1.1 * error(None, states, y)
        states, y = simulate(300, 2, bursts)
        assert error(make(), states, y) < 0.5 * error(None, states, y)


def test_a_gate_does_not_lock_the_filter_out() -> None:
    """A step of the state that the model does not know: after some rejections the gate opens."""
    states, y = simulate(100, 5, np.ones(200))
    states[40:, :2] += 20.0
    y[40:, :2] += 20.0

    def after(estimates: np.ndarray) -> float:
        return float(np.sqrt(np.mean((states - estimates)[70:90, :2] ** 2)))

    patient = after(run_robust(MODEL, y, gating(), initial_covariance=P0))
    locked = after(run_robust(MODEL, y, gating(patience=10_000), initial_covariance=P0))
    assert patient < 0.5 * locked


def test_the_influence_of_an_outlier_is_bounded() -> None:
    """Whatever its size, the first measurement moves a Huber filter no further than a large one."""
    wide = 100 * np.eye(4)
    moved = []
    for size in (1e2, 1e4, 1e6):
        y = np.zeros((1, 4, 1))
        y[0, 0, 0] = size
        moved.append(run_robust(MODEL, y, huber(), initial_covariance=wide)[0, 0, 0])
    assert moved[2] == pytest.approx(moved[0], rel=1e-6)
    assert moved[0] < 1.345 * 10.1


@given(
    rows=arrays(float, (4, 4), elements=st.floats(-50, 50)),
    innovation=arrays(float, (1, 4), elements=st.floats(-1e4, 1e4)),
)
def test_the_r_of_a_huber_update_is_a_covariance(rows: np.ndarray, innovation: np.ndarray) -> None:
    """A prediction whose components are all but one and the same once made it indefinite."""
    R = MODEL.measurement_covariance
    step = huber()(R, 1)
    used, there = step(innovation, (rows @ rows.T)[None], np.ones((1, 4), dtype=bool))
    assert there.all()
    assert np.linalg.eigvalsh(used[0] - R).min() >= -1e-9 * np.abs(used).max()


def test_a_policy_keeps_nothing_from_one_call_to_the_next() -> None:
    _, y = simulate(20, 6, np.ones(30))
    for policy in (gating(), huber(), adaptive()):
        first = run_robust(MODEL, y, policy, initial_covariance=P0)
        assert np.array_equal(first, run_robust(MODEL, y, policy, initial_covariance=P0))
        few = run_robust(MODEL, y[:, :, :7], policy, initial_covariance=P0)
        assert few == pytest.approx(first[:, :, :7], abs=1e-12)


@pytest.mark.parametrize("P", [np.eye(3), -np.eye(4), np.full((4, 4), np.nan)])
def test_a_first_covariance_that_is_none(P: np.ndarray) -> None:
    with pytest.raises(ParameterError, match="initial_covariance"):
        run_robust(MODEL, np.zeros((2, 4, 1)), huber(), initial_covariance=P)


def test_an_adaptive_r_finds_the_noise() -> None:
    states, y = simulate(300, 3, np.full(200, 5.0))
    told = run_kalman(
        MODEL, y, initial_covariance=P0, measurement_covariance=25 * MODEL.measurement_covariance
    )
    best = float(np.sqrt(np.mean((states - told)[:, :2] ** 2)))
    assert error(adaptive(), states, y) < 1.15 * best < error(None, states, y)


@pytest.mark.parametrize(
    "make",
    [
        *(lambda: gating(1.0), lambda: huber(0.0), lambda: adaptive(1.0), lambda: gating(0.0)),
        *(lambda: gating(0.9, -1), lambda: huber(float("nan"))),
    ],
)
def test_what_cannot_be_is_refused(make: object) -> None:
    with pytest.raises(ParameterError):
        make()  # type: ignore[operator]
