"""What a filter is to gain: closed forms, the Yule-Walker property, and simulations."""

import numpy as np
import pytest
from scipy.linalg import solve_discrete_lyapunov
from scipy.signal import lfilter

import inswsn_lib as iw
from inswsn_lib.errors import InswsnError, ParameterError
from inswsn_lib.filters import ErrorStatistics, lasting_ratio
from inswsn_lib.filters.kalman import predicted_covariance

T, SIZE, SPEED = 0.2, 0.1, 0.15  # s, m, m/s


def filtered(model: iw.ErrorModel) -> np.ndarray:
    """Return the covariance after a measurement in the steady state, from the predicted one."""
    P = predicted_covariance(model, iw.predictor_gain(model))
    S = model.C @ P @ model.C.T + model.measurement_covariance
    return P - P @ model.C.T @ np.linalg.solve(S, model.C @ P)


@pytest.mark.parametrize("lasts", [0.0, 0.1, 1.0, 30.0])
@pytest.mark.parametrize("hold", [0.05, 2.0, 100.0])
def test_the_scalar_law_is_the_riccati_equation_with_a_coloured_state(lasts, hold):
    fades, q = np.exp(-T / lasts) if lasts else 0.0, T / hold
    model = iw.ErrorModel(
        A=np.diag([1.0, fades]), B=np.diag(np.sqrt([q, 1 - fades**2])), C=[[1.0, 1.0]],
        D=[[1e-5]], period=T,
    )  # fmt: skip
    assert lasting_ratio(T, lasts, hold) == pytest.approx(filtered(model)[0, 0] ** 0.5, rel=1e-4)


def test_with_white_errors_it_is_the_filter_of_a_random_walk():
    q = T / 3.0  # over the variance of a fix
    P = (-q + np.sqrt(q**2 + 4 * q)) / 2
    assert lasting_ratio(T, 0.0, 3.0) == pytest.approx(np.sqrt(P), rel=1e-12)


def test_what_lasts_counts_against_how_long_the_motion_holds():
    assert lasting_ratio(0.01, 2.0, 5.0) == pytest.approx(lasting_ratio(0.02, 4.0, 10.0), rel=1e-9)
    assert lasting_ratio(0.01, 1e5, 1.0) == pytest.approx(1.0, abs=1e-5)


def drawn(steps=8000, *, seed=0, white=0.3, lasts=2.0, density=0.002, noise=0.0):
    """Return errors of an INS that drifts and of a network, (steps, 4)."""
    rng = np.random.default_rng(seed)
    root = np.linalg.cholesky(density * np.array([[T**3 / 3, T**2 / 2], [T**2 / 2, T]]))
    pushed = np.einsum("ij,saj->sai", root, rng.normal(size=(steps, 2, 2)))
    own = noise * rng.normal(size=(steps, 2))
    speed = np.cumsum(pushed[:, :, 1], axis=0)
    moved = np.vstack([np.zeros((1, 2)), (speed + own)[:-1]]) * T
    ins = np.hstack([np.cumsum(moved + pushed[:, :, 0], axis=0), speed + own])
    fade = np.exp(-T / lasts)
    driving = np.sqrt((1 - fade**2) * (1 - white)) * rng.normal(size=(steps, 2))
    coloured = lfilter([1.0], [1.0, -fade], driving, axis=0)
    position = SIZE * (coloured + np.sqrt(white) * rng.normal(size=(steps, 2)))
    return ins, np.hstack([position, SPEED * rng.normal(size=(steps, 2))])


@pytest.mark.parametrize("noise", [0.0, 0.05])
@pytest.mark.parametrize(("white", "lasts"), [(0.3, 2.0), (0.8, 5.0), (1.0, 1.0)])
def test_simulated_errors_are_left_as_it_says(white, lasts, noise):
    ins, network = drawn(white=white, lasts=lasts, noise=noise)
    told = ErrorStatistics.of(ins, network, T)
    assert told.density == pytest.approx(0.002, rel=0.15)
    assert told.velocity_noise == pytest.approx(noise, abs=0.006)
    assert told.size == pytest.approx((SIZE, SPEED), rel=0.05)
    left = ins - told.run(ins - network)
    found = np.sqrt(np.mean(np.square(left[100:].reshape(-1, 2, 2)), axis=(0, 2))) / told.size
    assert told.ratios() == pytest.approx(found, rel=0.05)
    if lasts > 1:
        assert told.ratios(white=True)[0] < 0.8 * found[0]


def test_gaps_do_not_matter():
    ins, network = drawn()
    whole = ErrorStatistics.of(ins, network, T).ratios()
    network[np.random.default_rng(1).random(len(network)) < 0.2] = np.nan
    assert ErrorStatistics.of(ins, network, T).ratios() == pytest.approx(whole, rel=0.03)


def test_the_model_of_fixes_has_the_measured_covariances():
    told = ErrorStatistics.of(*drawn(4000), T)
    model, p = told.model(), len(told.covariances) - 1
    stationary = solve_discrete_lyapunov(model.A[3:, 3:], model.process_covariance[3:, 3:])
    for lag in range(p):  # of the newest error and the one so many steps before
        block = stationary[:2, 2 * lag : 2 * lag + 2]
        assert block == pytest.approx(told.covariances[lag], abs=1e-9)


def test_too_little_is_declined():
    ins, network = drawn(300, lasts=30.0, white=0.05)
    with pytest.raises(InswsnError, match=r"last for .* s, and .* s: 60 s are too short"):
        ErrorStatistics.of(ins, network, T)
    with pytest.raises(InswsnError, match="30 errors of fixes are too few"):
        ErrorStatistics.of(ins[:30], network[:30], T)
    with pytest.raises(ParameterError, match="ins must be"):
        ErrorStatistics.of(ins[:30], network, T)
    for wrong in ({"period": 0.0}, {"correlation_time": -1.0}, {"hold_time": 0.0}):
        with pytest.raises(ParameterError, match=next(iter(wrong))):
            lasting_ratio(**({"period": T, "correlation_time": 1.0, "hold_time": 1.0} | wrong))
