"""The hybrid against a navigator that goes step by step, closed forms, and a changed future."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st
from sklearn.base import BaseEstimator, clone
from sklearn.exceptions import NotFittedError
from sklearn.linear_model import LinearRegression, Ridge
from sklearn.pipeline import make_pipeline
from sklearn.preprocessing import PolynomialFeatures, StandardScaler
from sklearn.utils.validation import check_is_fitted

from inswsn_lib.errors import ParameterError
from inswsn_lib.filters import deadbeat_gain, run_hinfinity, run_kalman
from inswsn_lib.learning import BackpropRegressor, HoldRegressor, LSSVMRegressor
from inswsn_lib.models import ErrorModel
from inswsn_lib.navigation import HybridNavigator, observable_inputs
from inswsn_lib.navigation.hybrid import Filter

MODEL = ErrorModel.p1(0.2, process_noise=(0.05, 0.1), measurement_noise=(0.2, 0.3))


def kalman(y: np.ndarray) -> np.ndarray:
    return run_kalman(MODEL, y, initial_covariance=np.eye(4))


def hinfinity(y: np.ndarray) -> np.ndarray:
    return run_hinfinity((MODEL, 0.3 * deadbeat_gain(MODEL)), y, predicted=False)


def same(y: np.ndarray) -> np.ndarray:
    """Return the measurements themselves, with zero where there are none."""
    return np.nan_to_num(y)


def smoothed(y: np.ndarray) -> np.ndarray:
    """Return exponential averages of the measurements, held while there are none."""
    x, estimates = np.zeros(y.shape[1:]), np.empty(y.shape)
    for k, measured in enumerate(y):
        x = np.where(np.isnan(measured), x, 0.5 * x + 0.5 * measured)
        estimates[k] = x
    return estimates


def silent(steps: int, *gaps: tuple[int, int]) -> np.ndarray:
    """Return which steps are in a gap, (steps,)."""
    found = np.zeros(steps, dtype=bool)
    for first, end in gaps:
        found[first:end] = True
    return found


def noise(seed: int, steps: int, runs: int, *gaps: tuple[int, int], m: int = 4) -> np.ndarray:
    y = np.random.default_rng(seed).normal(size=(steps, m, runs))
    y[silent(steps, *gaps)] = np.nan
    return y


class StepByStep:
    """One run of the hybrid, told of one step after another, with scikit-learn's own scaling."""

    def __init__(self, navigator: HybridNavigator) -> None:
        self.n, self.pairs, self.machine = navigator, [], None
        self.silence, self.past, self.before = 0, [], None

    def step(self, y: np.ndarray, u: np.ndarray) -> tuple[np.ndarray, bool]:
        n = self.n
        self.past.append(y)
        filtered = n.filter(np.stack(self.past)[:, :, None])[-1, :, 0]
        seen = np.concatenate([u, self.before]) if n.feedback and self.past[1:] else u
        told, predicts = not np.isnan(u).any(), False
        if not np.isnan(y).all():
            self.silence, self.machine, estimate = 0, None, filtered
            if told and (not n.feedback or self.past[1:]):
                self.pairs.append((seen, filtered))
        else:
            self.silence += 1
            pairs = self.pairs[-n.window :] if n.window else self.pairs
            enough = min(n.least, n.window or n.least)
            if self.silence == n.patience + 1 and len(pairs) >= enough:
                X, Y = (np.stack(part) for part in zip(*pairs, strict=True))
                by = {"with_mean": n.scaled, "with_std": n.scaled}
                self.outer = StandardScaler(**by).fit(Y)
                self.machine = make_pipeline(StandardScaler(**by), clone(n.regressor))
                self.machine.fit(X, self.outer.transform(Y))
            estimate = filtered
            predicts = told and self.machine is not None
            if predicts:
                estimate = self.outer.inverse_transform(self.machine.predict(seen[None]))[0]
        self.before = estimate
        return estimate, predicts


@settings(max_examples=60)
@given(
    st.integers(0, 10**6), st.floats(0.05, 0.8), st.sampled_from([0.0, 0.1]),
    st.integers(0, 3), st.integers(1, 6), st.sampled_from([None, 4, 6, 9]),
    st.booleans(), st.booleans(),
)  # fmt: skip
def test_it_is_the_navigator_that_is_told_one_step_after_another(
    seed: int, missing: float, absent: float, patience: int, least: int, window: int | None,
    feedback: bool, scaled: bool,
) -> None:  # fmt: skip
    """Outages of any pattern, another one in each run; partly missing is heard.

    A step without an input is the filter's, and the step after is fed back what it said.
    """
    rng = np.random.default_rng(seed)
    steps, runs = 24, 3
    y, u = rng.normal(size=(steps, 2, runs)), rng.normal(size=(steps, 2, runs))
    y[np.repeat(rng.random((steps, 1, runs)) < missing, 2, axis=1)] = np.nan
    y[rng.random(y.shape) < 0.1] = np.nan
    u[rng.random(u.shape) < absent] = np.nan
    navigator = HybridNavigator(
        smoothed, Ridge(1.0), feedback=feedback, scaled=scaled, window=window, least=least,
        patience=patience,
    )  # fmt: skip
    run = navigator.run(y, u)
    for r in range(runs):
        online = StepByStep(navigator)
        found = [online.step(y[k, :, r], u[k, :, r]) for k in range(steps)]
        expected, predicting = map(np.stack, zip(*found, strict=True))
        assert run.predicting[:, r].tolist() == predicting.tolist()
        assert run.estimates[:, :, r] == pytest.approx(expected, rel=1e-6, abs=1e-8)


@pytest.mark.parametrize("make", [kalman, hinfinity])
@pytest.mark.parametrize("feedback", [False, True])
@settings(max_examples=15)
@given(k=st.integers(0, 58), seed=st.integers(0, 10**6))
def test_no_estimate_knows_the_future(make: Filter, feedback: bool, k: int, seed: int) -> None:
    """What comes after a step is replaced, outages included; the estimates up to it stay."""
    y, rng = noise(1, 60, 2, (20, 28), (40, 50)), np.random.default_rng(seed)
    y[34:36, :, 1] = np.nan  # the runs are not alike
    u = rng.normal(size=(60, 2, 2))
    other, other_u = y.copy(), u.copy()
    other[k + 1 :] *= rng.normal(size=other[k + 1 :].shape)
    other_u[k + 1 :] = rng.normal(size=other_u[k + 1 :].shape)
    navigator = HybridNavigator(make, LSSVMRegressor(2.0, 10.0), feedback=feedback)
    before, after = navigator.run(y, u), navigator.run(other, other_u)
    assert np.array_equal(after.estimates[: k + 1], before.estimates[: k + 1])
    assert not np.array_equal(after.estimates, before.estimates)
    # other outages, another length: as many numbers at once are not summed alike
    other[k + 1 :][rng.random(59 - k) < 0.5] = np.nan
    end = int(rng.integers(k + 1, 61))
    after = navigator.run(other[:end], other_u[:end])
    assert after.estimates[: k + 1] == pytest.approx(before.estimates[: k + 1], abs=1e-9)
    assert np.array_equal(after.predicting[: k + 1], before.predicting[: k + 1])


@pytest.mark.parametrize("scaled", [False, True])
@pytest.mark.parametrize("feedback", [False, True])
def test_what_is_linear_is_carried_on(feedback: bool, scaled: bool) -> None:
    """x+ = F x + c u, of which least squares finds F and c, whatever the filter says in a gap."""
    rng = np.random.default_rng(10)
    F, c = np.array([[0.9, 0.2], [-0.3, 0.95]]), np.array([1.0, -2.0])
    u, error = rng.normal(size=(50, 3)), np.zeros((50, 2, 3))
    for k in range(1, 50):
        error[k] = F @ error[k - 1] + np.multiply.outer(c, u[k])
    if not feedback:  # a straight line in the input instead
        error = np.stack([3 * u + 1, 5 - u], axis=1)
    y = error.copy()
    gaps = silent(50, (25, 35), (42, 50))
    y[gaps] = np.nan
    for value in (0.0, 1e6, np.nan):
        navigator = HybridNavigator(
            lambda y, v=value: np.nan_to_num(y, nan=v), LinearRegression(), feedback=feedback,
            scaled=scaled,
        )  # fmt: skip
        run = navigator.run(y, u[:, None, :])
        assert run.estimates == pytest.approx(error, abs=1e-7)
        assert np.array_equal(run.predicting, np.repeat(gaps[:, None], 3, axis=1))


def test_with_feedback_no_input_is_needed() -> None:
    y = 0.8 ** np.arange(40.0)[:, None, None]
    measured = np.where(np.arange(40)[:, None, None] < 20, y, np.nan)
    run = HybridNavigator(same, LinearRegression(), feedback=True).run(measured)
    assert run.estimates == pytest.approx(y, abs=1e-9)


@pytest.mark.parametrize(("feedback", "enough"), [(False, 10), (True, 11)])
def test_with_fewer_than_ten_pairs_the_filter_goes_on(feedback: bool, enough: int) -> None:
    """With feedback the first step is none, since it has no step before."""
    for heard in (enough - 1, enough):
        y = noise(9, 25, 1, (heard, 25))
        run = HybridNavigator(kalman, Ridge(), feedback=feedback).run(y, np.zeros((25, 1)))
        assert run.predicting.sum() == (0 if heard < enough else 25 - heard)
        if heard < enough:
            assert np.array_equal(run.estimates, kalman(y))


@pytest.mark.parametrize(
    "regressor",
    [make_pipeline(PolynomialFeatures(2), Ridge()), BackpropRegressor(3, epochs=10, networks=2)],
)
def test_any_regressor_is_trained_on_the_pairs_before_the_outage(regressor: Any) -> None:
    """The same by hand, of which each run has random numbers of its own, whatever other runs do."""
    y, u = noise(15, 36, 3, (24, 36)), np.random.default_rng(16).normal(size=(36, 2, 3))
    y[12:15, :, 0] = np.nan
    before = clone(regressor)
    run = HybridNavigator(kalman, regressor, scaled=False).run(y, u)
    for r in range(3):
        machine = clone(before)
        if isinstance(machine, BackpropRegressor):
            machine.set_params(random_state=r)
        rows = np.flatnonzero(~np.isnan(y[:24, 0, r]))
        machine.fit(u[rows, :, r], kalman(y)[rows, :, r])
        expected = machine.predict(u[24:, :, r])
        assert run.estimates[24:, :, r] == pytest.approx(expected, rel=1e-6, abs=1e-9)
    with pytest.raises(NotFittedError):
        check_is_fitted(regressor)
    assert repr(regressor) == repr(before)


@settings(max_examples=30)
@given(st.integers(0, 10**6))
def test_what_can_be_observed_of_a_constant_acceleration(seed: int) -> None:
    """Its change of velocity over any period is that acceleration, none at the first step."""
    rng = np.random.default_rng(seed)
    time = 100 + np.cumsum(rng.uniform(0.05, 0.5, 20))
    a, v, p = rng.normal(size=(3, 2, 4))
    t = (time - time[0])[:, None, None]
    ins = np.concatenate([p + v * t + a * t**2 / 2, v + a * t], axis=1)
    found = observable_inputs(time, ins)
    assert list(found) == ["time", "motion", "inertial"]
    assert np.array_equal(found["motion"], ins)
    assert found["time"] == pytest.approx(np.broadcast_to(t, (20, 1, 4)))
    assert np.array_equal(found["inertial"][:, :1], found["time"])
    assert found["inertial"][1:, 1:] == pytest.approx(np.broadcast_to(a, (19, 2, 4)), abs=1e-8)
    assert np.isnan(found["inertial"][0, 1:]).all()


def test_the_indicated_acceleration_is_that_of_the_last_period() -> None:
    """A step of the velocity shows at its own step, not before."""
    ins = np.zeros((10, 4, 1))
    ins[6:, 2] = 1.0
    acceleration = observable_inputs(0.5 * np.arange(10), ins)["inertial"][1:, 1, 0]
    assert acceleration.tolist() == [0, 0, 0, 0, 0, 2.0, 0, 0, 0]


class Odd(BaseEstimator):  # type: ignore[misc]
    """Predicts one column for all outputs, or what is no number, or cannot be trained."""

    def __init__(self, how: str = "one") -> None:
        self.how = how

    def fit(self, X: np.ndarray, y: np.ndarray) -> Odd:
        if self.how == "fit":
            raise ValueError("no such thing")
        return self

    def predict(self, X: np.ndarray) -> np.ndarray:
        return np.zeros(len(X)) if self.how == "one" else np.full((len(X), 4), [0, 0, 0, np.nan])


HEARD, OUTAGE, CLOCK = np.zeros((5, 4, 1)), noise(1, 15, 1, (12, 15)), np.zeros((15, 1))


@pytest.mark.parametrize(
    ("options", "y", "u", "said"),
    [
        ({"window": 0}, OUTAGE, CLOCK, "window .* not 0"),
        ({"least": 0}, OUTAGE, CLOCK, "least .* not 0"),
        ({"patience": -1}, OUTAGE, CLOCK, "patience .* not -1"),
        ({}, HEARD[:, 0, 0], CLOCK, "measurements .* not of shape"),
        ({}, HEARD, None, "inputs .* not None"),
        ({}, HEARD, CLOCK, "inputs .* not of shape"),
        ({}, HEARD, np.zeros((5, 1, 2)), "inputs .* not of shape"),
        ({"filter": lambda y: y[1:]}, OUTAGE, CLOCK, "what filter returns .* not of shape"),
        (
            {"filter": lambda y: y * [[1], [np.nan], [1], [1]]},
            OUTAGE,
            CLOCK,
            "what filter returns .* not NaN or infinite",
        ),
        ({"regressor": Odd()}, OUTAGE, CLOCK, r"regressor .* not Odd, which predicts \(3,\)"),
        ({"regressor": Odd("nan")}, OUTAGE, CLOCK, r"Odd, which predicts \(3, 4\) or not fin"),
        ({"regressor": Odd("fit")}, OUTAGE, CLOCK, "Odd, whose fit fails: ValueError: no such"),
    ],
)
def test_what_does_not_fit_is_refused(
    options: dict[str, Any], y: np.ndarray, u: np.ndarray | None, said: str
) -> None:
    with pytest.raises(ParameterError, match=said):
        HybridNavigator(**({"filter": same, "regressor": HoldRegressor()} | options)).run(y, u)


@pytest.mark.parametrize(
    ("time", "shape", "said"),
    [
        (np.arange(5.0), (5, 3, 1), "ins .* not of shape"),
        (np.arange(4.0), (5, 4, 1), "time .* not of shape"),
        (np.zeros(5), (5, 4, 1), "time must be increasing, not out of order"),
    ],
)
def test_what_cannot_be_observed_is_refused(
    time: np.ndarray, shape: tuple[int, ...], said: str
) -> None:
    with pytest.raises(ParameterError, match=said):
        observable_inputs(time, np.zeros(shape))
