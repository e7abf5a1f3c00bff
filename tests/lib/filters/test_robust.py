"""The robust rivals: the Kalman filter where nothing is wrong, their rules by hand, and gains."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given, strategies as st
from hypothesis.extra.numpy import arrays
from random_filters import gappy
from scipy.stats import chi2

from inswsn_lib.errors import ParameterError
from inswsn_lib.filters import adaptive, gating, huber, run_kalman, run_robust
from inswsn_lib.models import ErrorModel

MODEL = ErrorModel.p1(0.2, process_noise=(0.05, 0.1), measurement_noise=(0.2, 0.3))
P0 = np.diag([1.0, 1.0, 0.25, 0.25])
ALL = np.ones((1, 2), bool)
R = np.array([[4.0, 1.0], [1.0, 1.0]])
PRIOR = np.array([[[5.0, 0.0], [0.0, 3.0]]])


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


def position_error(states: np.ndarray, estimates: np.ndarray) -> float:
    return float(np.sqrt(np.mean((states - estimates)[:, :2] ** 2)))


def robust(y: np.ndarray, policy: Any, **options: Any) -> np.ndarray:
    return run_robust(MODEL, y, policy=policy, initial_covariance=P0, **options)


@pytest.mark.parametrize("policy", [gating(1 - 1e-15), huber(1e9)])
@pytest.mark.parametrize("predicted", [False, True])
def test_a_policy_that_never_acts_is_the_kalman_filter(policy: Any, predicted: bool) -> None:
    rng = np.random.default_rng(1)
    y, start = 0.1 * gappy(rng, (1, 30, 4, 5))[0], 0.1 * rng.normal(size=(4, 5))
    options: dict[str, Any] = {"initial_state": start, "predicted": predicted}
    plain = run_kalman(MODEL, y, initial_covariance=P0, **options)
    assert robust(y, policy, **options) == pytest.approx(plain, abs=1e-9)


def test_a_gate_by_hand() -> None:
    """Of one and two components, at their own point of chi-squared; patience counts on end."""
    S = PRIOR[0] + R
    edge = np.linalg.cholesky(S) @ [0.0, np.sqrt(chi2.ppf(0.99, 2))]
    far = np.array([10 * edge])
    step = gating(0.99, patience=2)(R, 1)
    assert step(np.array([0.999 * edge]), PRIOR, ALL)[1].all()
    assert not step(np.array([1.001 * edge]), PRIOR, ALL)[1].any()
    assert not step(far, PRIOR, ALL)[1].any()
    R_used, used = step(far, PRIOR, ALL)  # the third on end
    assert used.all()
    assert R_used[0] == pytest.approx(R)
    assert step(far, PRIOR, ALL)[1].all()  # still lost
    assert step(0 * far, PRIOR, ALL)[1].all()
    assert not step(far, PRIOR, ALL)[1].any()
    step = gating()(R, 1)  # 0.999, and five on end
    kept = [bool(step(far, PRIOR, ALL)[1].all()) for _ in range(7)]
    assert kept == [False] * 5 + [True] * 2
    edge *= np.sqrt(chi2.ppf(0.999, 2) / chi2.ppf(0.99, 2))
    for factor in (0.999, 1.001):
        used = gating()(R, 1)(np.array([factor * edge]), PRIOR, ALL)[1]
        assert used.all() == (factor < 1)
    one = np.array([[False, True]])
    size = np.sqrt(chi2.ppf(0.99, 1) * S[1, 1])
    for factor, kept in ((0.999, True), (1.001, False)):
        step = gating(0.99, patience=2)(R, 1)
        assert step(np.array([[np.nan, factor * size]]), PRIOR, one)[1].tolist() == [[False, kept]]
    assert not step(np.full((1, 2), np.nan), PRIOR, ~ALL)[1].any()


def test_a_huber_update_by_hand() -> None:
    """Variances 9 and 4: an innovation of 12 is 4 deviations, and its variance is doubled by 2."""
    used, there = huber(2.0)(R, 1)(np.array([[-12.0, 3.9]]), PRIOR, ALL)
    assert there is ALL
    assert used[0] == pytest.approx(R + np.diag([9.0, 0.0]))
    missing = np.array([[False, True]])
    used, _ = huber(2.0)(R, 1)(np.array([[np.nan, 8.0]]), PRIOR, missing)
    assert used[0] == pytest.approx(R + np.diag([0.0, 4.0]))
    edge = np.array([[3 * 1.345, 0.0]])  # without an argument: 1.345 deviations of Huber
    for factor in (0.999, 1.001):
        used, _ = huber()(R, 1)(factor * edge, PRIOR, ALL)
        assert (used[0, 0, 0] > R[0, 0]) == (factor > 1)


def test_an_adaptive_variance_by_hand() -> None:
    step = adaptive(0.9)(R, 1)
    used, there = step(np.array([[7.0, 0.0]]), PRIOR, ALL)
    # 0.9 * 4 + 0.1 * (49 - 5), and 0.9 * 1 + 0.1 * (0 - 3)
    assert used[0] == pytest.approx(np.diag([8.0, 0.6]))
    assert there is ALL
    used, _ = step(np.array([[np.nan, 1e9]]), PRIOR, np.array([[False, True]]))
    assert used[0] == pytest.approx(np.diag([8.0, 1e4]))  # kept, and at most ten thousand times
    used, _ = adaptive(0.9)(R, 1)(np.array([[1e9, 0.0]]), PRIOR, ALL)
    assert used[0, 0, 0] == pytest.approx(4e4)  # of the modelled variance
    used, _ = adaptive(0.1)(R, 1)(np.zeros((1, 2)), PRIOR, ALL)
    assert used[0] == pytest.approx(np.diag([0.04, 0.01]))  # a hundredth at least


@given(
    rows=arrays(float, (4, 4), elements=st.floats(-50, 50)),
    innovation=arrays(float, (1, 4), elements=st.floats(-1e4, 1e4)),
)
def test_the_r_of_a_huber_update_is_a_covariance(rows: np.ndarray, innovation: np.ndarray) -> None:
    """A prediction whose components are all but one and the same once made it indefinite."""
    modelled = MODEL.measurement_covariance
    used, _ = huber()(modelled, 1)(innovation, (rows @ rows.T)[None], np.ones((1, 4), dtype=bool))
    assert np.linalg.eigvalsh(used[0] - modelled).min() >= -1e-9 * np.abs(used).max()


def test_what_a_policy_says_is_done() -> None:
    """A policy with a tenth of R that leaves out the velocities is the Kalman filter told so."""

    def sure(modelled: np.ndarray, runs: int) -> Any:
        assert (modelled.shape, runs) == ((4, 4), 3)
        only = np.array([True, True, False, False])
        return lambda e, prior, there: (np.broadcast_to(modelled / 10, prior.shape), there & only)

    y = np.random.default_rng(9).normal(size=(20, 4, 3))
    halves = np.where(np.arange(4)[:, None] < 2, y, np.nan)
    told = run_kalman(MODEL, halves, initial_covariance=P0,
                      measurement_covariance=MODEL.measurement_covariance / 10)  # fmt: skip
    assert robust(y, sure) == pytest.approx(told, abs=1e-9)


def test_on_clean_data_little_is_lost_and_on_outliers_much_is_won() -> None:
    bursts = np.ones(100)
    bursts[20::10] = 30.0
    for policy in (gating(), huber()):
        for factor, most in ((np.ones(100), 1.1), (bursts, 0.5)):
            states, y = simulate(300, 2, factor)
            plain = position_error(states, run_kalman(MODEL, y, initial_covariance=P0))
            assert position_error(states, robust(y, policy)) < most * plain


def test_an_adaptive_r_finds_the_noise() -> None:
    states, y = simulate(300, 3, np.full(200, 5.0))
    told = run_kalman(
        MODEL, y, initial_covariance=P0, measurement_covariance=25 * MODEL.measurement_covariance
    )
    best, plain = (
        position_error(states, each) for each in (told, run_kalman(MODEL, y, initial_covariance=P0))
    )
    assert position_error(states, robust(y, adaptive())) < 1.15 * best < plain


def test_a_policy_keeps_nothing_from_one_call_to_the_next_nor_from_run_to_run() -> None:
    _, y = simulate(20, 6, np.full(30, 3.0))
    for policy in (gating(0.9), huber(), adaptive()):
        first = robust(y, policy)
        assert np.array_equal(first, robust(y, policy))
        assert robust(y[:, :, 3:7], policy) == pytest.approx(first[:, :, 3:7], abs=1e-12)


@pytest.mark.parametrize(
    ("name", "make"),
    [
        ("probability", lambda: gating(1.0)),
        ("probability", lambda: gating(0.0)),
        ("patience", lambda: gating(0.9, -1)),
        ("threshold", lambda: huber(0.0)),
        ("forgetting", lambda: adaptive(1.0)),
        ("forgetting", lambda: adaptive(0.0)),
        (
            "initial_covariance",
            lambda: run_robust(MODEL, np.zeros((2, 4, 1)), policy=huber(), initial_covariance=R),
        ),
    ],
)
def test_what_cannot_be_is_refused(name: str, make: Any) -> None:
    with pytest.raises(ParameterError) as caught:
        make()
    assert caught.value.name == name
