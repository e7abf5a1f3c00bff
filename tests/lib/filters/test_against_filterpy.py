"""The Kalman filter against another library, and Monte Carlo against the exact recursion."""

from __future__ import annotations

import numpy as np
import pytest
from filterpy.kalman import KalmanFilter

from inswsn_lib.evaluation import monte_carlo
from inswsn_lib.filters import deadbeat_gain, run_hinfinity, run_kalman
from inswsn_lib.lmi import design_filter
from inswsn_lib.models import ErrorModel

MODEL = ErrorModel.p1(0.2, process_noise=(0.05, 0.1), measurement_noise=(0.2, 0.3))
P0 = np.diag([1.0, 2.0, 0.25, 0.5])


def test_it_is_filterpys_filter_with_gaps_and_all() -> None:
    y = np.random.default_rng(13).normal(size=(40, 4, 3))
    y[10:15] = np.nan
    ours = run_kalman(MODEL, y, initial_covariance=P0)
    for run in range(3):
        theirs = KalmanFilter(dim_x=4, dim_z=4)
        theirs.F, theirs.H, theirs.P = MODEL.A, MODEL.C, P0.copy()
        theirs.Q, theirs.R = MODEL.process_covariance, MODEL.measurement_covariance
        for k in range(40):
            theirs.update(None if np.isnan(y[k, 0, run]) else y[k, :, run])
            assert ours[k, :, run] == pytest.approx(theirs.x.ravel(), abs=1e-9)
            theirs.predict()


def simulate(rng: np.random.Generator, runs: int) -> dict[str, np.ndarray]:
    """Draw states and measurements of the model itself over 30 steps."""
    x = np.sqrt(P0) @ rng.standard_normal((4, runs))
    states, y = np.empty((2, 30, 4, runs))
    for k in range(30):
        states[k] = x
        y[k] = MODEL.C @ x + MODEL.D @ rng.standard_normal((4, runs))
        x = MODEL.A @ x + MODEL.B @ rng.standard_normal((4, runs))
    return {"x": states, "y": y}


@pytest.mark.parametrize("which", ["designed", "deadbeat"])
def test_monte_carlo_agrees_with_the_exact_covariance_recursion(which: str) -> None:
    """8,000 runs of a constant-gain filter; a true one leaves the bounds once in 10,000 times."""
    gain = design_filter(MODEL).gain if which == "designed" else deadbeat_gain(MODEL)
    drawn = monte_carlo(simulate, 8000, seed=14)
    errors = drawn["x"] - run_hinfinity((MODEL, gain), drawn["y"])
    A, P = MODEL.A - gain @ MODEL.C, P0
    for k in range(30):
        if k in (0, 1, 5, 29):
            expected = np.sqrt(np.diag(P))
            found = np.sqrt(np.mean(errors[k] ** 2, axis=1))
            assert found == pytest.approx(expected, rel=4.5 / (2 * 8000) ** 0.5)
        P = A @ P @ A.T + MODEL.process_covariance + gain @ MODEL.measurement_covariance @ gain.T
