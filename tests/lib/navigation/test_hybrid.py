"""The hybrid against a navigator that goes step by step, closed forms, and a changed future."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st
from sklearn.base import BaseEstimator, clone
from sklearn.ensemble import RandomForestRegressor
from sklearn.exceptions import NotFittedError
from sklearn.linear_model import LinearRegression, Ridge
from sklearn.neighbors import KNeighborsRegressor
from sklearn.pipeline import make_pipeline
from sklearn.preprocessing import PolynomialFeatures, StandardScaler
from sklearn.utils.validation import check_is_fitted

from inswsn_lib.errors import ParameterError
from inswsn_lib.filters import deadbeat_gain, run_hinfinity, run_kalman
from inswsn_lib.learning import BackpropRegressor, LSSVMRegressor
from inswsn_lib.models import ErrorModel
from inswsn_lib.navigation import HybridNavigator, fit_many, observable_inputs
from inswsn_lib.navigation.hybrid import Filter
from inswsn_lib.recordings import read_recording

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
            if self.silence == n.patience + 1 and len(pairs) >= n.least:
                X, Y = (np.stack(part) for part in zip(*pairs, strict=True))
                by = (True, True) if n.scaled else (False, False)
                self.outer = StandardScaler(with_mean=by[0], with_std=by[1]).fit(Y)
                inner = StandardScaler(with_mean=by[0], with_std=by[1])
                self.machine = make_pipeline(inner, clone(n.regressor))
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
    st.integers(0, 3), st.integers(1, 6), st.sampled_from([None, 6, 9]),
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
    fits = 0
    for r in range(runs):
        online = StepByStep(navigator)
        found = [online.step(y[k, :, r], u[k, :, r]) for k in range(steps)]
        expected, predicting = map(np.stack, zip(*found, strict=True))
        assert run.predicting[:, r].tolist() == predicting.tolist()
        assert run.estimates[:, :, r] == pytest.approx(expected, rel=1e-6, abs=1e-8)
        fits += int(np.sum(np.diff(predicting, prepend=False) & predicting))
    assert (
        run.fits == fits or absent
    )  # a gap whose inputs are missing is trained for, or seen twice


@pytest.mark.parametrize("make", [kalman, hinfinity])
@pytest.mark.parametrize("feedback", [False, True])
@settings(max_examples=15)
@given(k=st.integers(0, 59), seed=st.integers(0, 10**6), others=st.booleans())
def test_no_estimate_knows_the_future(
    make: Filter, feedback: bool, k: int, seed: int, others: bool
) -> None:
    """All that comes after a step is replaced, outages included; the estimates up to it stay."""
    y, rng = noise(1, 60, 2, (20, 28), (40, 50)), np.random.default_rng(seed)
    y[34:36, :, 1] = np.nan  # the runs are not alike
    u = rng.normal(size=(60, 2, 2))
    other, other_u = y.copy(), u.copy()
    other[k + 1 :] *= rng.normal(size=other[k + 1 :].shape)
    other_u[k + 1 :] = rng.normal(size=other_u[k + 1 :].shape)
    navigator = HybridNavigator(make, LSSVMRegressor(2.0, 10.0), feedback=feedback)
    before = navigator.run(y, u)
    after = navigator.run(other, other_u)
    assert np.array_equal(after.estimates[: k + 1], before.estimates[: k + 1])
    if k < 59:
        assert not np.array_equal(after.estimates, before.estimates)
    if others:  # other outages, another length: as many numbers at once are not summed alike
        other[k + 1 :, :, 0] = rng.normal(size=other[k + 1 :, :, 0].shape)
        other[k + 1 :][rng.random(59 - k) < 0.5] = np.nan
        end = int(rng.integers(k + 1, 61))
        after = navigator.run(other[:end], other_u[:end])
        assert after.estimates[: k + 1] == pytest.approx(before.estimates[: k + 1], abs=1e-9)
        assert np.array_equal(after.predicting[: k + 1], before.predicting[: k + 1])


def line(steps: int = 60) -> tuple[np.ndarray, np.ndarray]:
    """Return times, and errors that grow on straight lines, other ones in each of three runs."""
    rng = np.random.default_rng(2)
    time = 0.2 * np.arange(steps)[:, None]
    return time, rng.normal(size=(4, 3)) + rng.normal(size=(4, 3)) * time[:, :, None]


@pytest.mark.parametrize("scaled", [False, True])
def test_a_straight_line_is_carried_on(scaled: bool) -> None:
    """Errors that are linear in time, measured without noise, and a regression on time."""
    time, error = line()
    y = error.copy()
    gaps = silent(60, (15, 25), (40, 60))
    y[gaps] = np.nan
    run = HybridNavigator(same, LinearRegression(), scaled=scaled).run(y, time)
    assert run.estimates == pytest.approx(error, abs=1e-9)
    assert np.array_equal(run.predicting, np.repeat(gaps[:, None], 3, axis=1))
    assert run.fits == 6


@pytest.mark.parametrize("make", [kalman, hinfinity])
def test_in_training_mode_it_is_the_filter(make: Filter) -> None:
    y = noise(3, 50, 4, (20, 30), (40, 50))
    y[12:14, :, 2] = np.nan
    run = HybridNavigator(make, Ridge()).run(y, np.arange(50.0)[:, None])
    alone = make(y)
    heard = ~np.isnan(y).all(axis=1)
    assert np.array_equal(run.predicting, ~heard)
    assert np.array_equal(
        run.estimates.swapaxes(1, 2)[heard], alone.swapaxes(1, 2)[heard]
    )  # bit for bit
    assert (run.estimates.swapaxes(1, 2)[~heard] != alone.swapaxes(1, 2)[~heard]).all()


@pytest.mark.parametrize("feedback", [False, True])
def test_what_the_filter_says_inside_an_outage_is_not_used(feedback: bool) -> None:
    y = noise(4, 40, 2, (15, 22), (30, 40))
    u = np.random.default_rng(5).normal(size=(40, 1))
    runs = [
        HybridNavigator(lambda y, v=value: np.nan_to_num(y, nan=v), Ridge(), feedback=feedback)
        for value in (0.0, 1e6, np.nan)
    ]
    first, *others = (navigator.run(y, u).estimates for navigator in runs)
    for other in others:
        assert np.array_equal(first, other)


def test_patience_leaves_the_first_steps_of_a_gap_to_the_filter() -> None:
    y = noise(6, 40, 1, (12, 15), (20, 24), (30, 40))
    run = HybridNavigator(kalman, Ridge(), patience=3).run(y, np.arange(40.0)[:, None])
    expected = silent(40, (23, 24), (33, 40))
    assert run.predicting[:, 0].tolist() == expected.tolist()
    assert np.array_equal(run.estimates[~expected], kalman(y)[~expected])


@pytest.mark.parametrize("feedback", [False, True])
def test_the_window_is_all_that_trains(feedback: bool) -> None:
    """With 12 pairs before step 30, none is from before step 18; nor the estimate before it."""
    y, u = noise(7, 40, 2, (30, 40)), np.random.default_rng(8).normal(size=(40, 2))
    first = 18 - feedback

    def outage(window: int | None, changed: int) -> np.ndarray:
        other, other_u = y.copy(), u.copy()
        other[:changed] += 5.0
        other_u[:18] *= -3.0 if changed else 1.0
        navigator = HybridNavigator(same, Ridge(), feedback=feedback, window=window)
        return navigator.run(other, other_u).estimates[30:]

    assert np.array_equal(outage(12, 0), outage(12, first))
    assert not np.allclose(outage(12, 0), outage(12, first + 1))
    assert not np.allclose(outage(None, 0), outage(None, first))


@pytest.mark.parametrize(("feedback", "enough"), [(False, 10), (True, 11)])
def test_with_too_few_pairs_the_filter_goes_on(feedback: bool, enough: int) -> None:
    """With feedback the first step is none, since it has no step before."""
    for heard in (enough - 1, enough):
        y = noise(9, 25, 1, (heard, 25))
        run = HybridNavigator(kalman, Ridge(), feedback=feedback).run(y, np.zeros((25, 1)))
        assert run.predicting.sum() == (0 if heard < enough else 25 - heard)
        assert run.fits == (heard == enough)
        if heard < enough:
            assert np.array_equal(run.estimates, kalman(y))
    never = np.full((25, 4, 1), np.nan)
    assert not HybridNavigator(kalman, Ridge()).run(never, np.zeros((25, 1))).predicting.any()


@pytest.mark.parametrize("scaled", [False, True])
def test_fed_back_estimates_follow_the_recursion(scaled: bool) -> None:
    """x+ = F x + c: a regression on the step before finds it, and the gap is F's powers."""
    rng = np.random.default_rng(10)
    F = np.array([[0.9, 0.2], [-0.3, 0.95]])
    c, x = rng.normal(size=(2, 3)), rng.normal(size=(2, 3))
    error = np.empty((50, 2, 3))
    for k in range(50):
        error[k] = x
        x = F @ x + c
    y = error.copy()
    y[25:35], y[42:] = np.nan, np.nan
    navigator = HybridNavigator(same, LinearRegression(), feedback=True, scaled=scaled)
    run = navigator.run(y)
    assert run.estimates == pytest.approx(error, abs=1e-7)
    assert run.predicting.sum() == 3 * 18


def test_an_input_beside_the_fed_back_estimate() -> None:
    """x+ = 0.8 x + u+: the input of the step itself counts, in the gap too."""
    u = np.random.default_rng(11).normal(size=(40, 1, 2))
    error = np.zeros((40, 1, 2))
    for k in range(1, 40):
        error[k] = 0.8 * error[k - 1] + u[k]
    y = error.copy()
    y[20:] = np.nan
    run = HybridNavigator(same, LinearRegression(), feedback=True).run(y, u)
    assert run.estimates == pytest.approx(error, abs=1e-9)


def test_scaling_means_nothing_to_least_squares() -> None:
    y, u = noise(12, 60, 2, (30, 45)), np.random.default_rng(13).normal(size=(60, 3))
    u = u * [1e3, 1.0, 1e-2] + [5e3, 0.0, 1.0]
    plain, scaled = (
        HybridNavigator(kalman, LinearRegression(), scaled=s).run(y, u).estimates
        for s in (False, True)
    )
    assert scaled == pytest.approx(plain, abs=1e-8)
    ridge = HybridNavigator(kalman, Ridge(100.0), scaled=False).run(y, u).estimates
    assert np.abs(ridge - HybridNavigator(kalman, Ridge(100.0)).run(y, u).estimates).max() > 0.01


def test_an_input_that_did_not_vary_is_no_unit() -> None:
    """0.1 thirty times has a deviation of 3e-17; a nearest neighbour would see nothing else."""
    y, u = noise(14, 40, 1, (30, 40)), np.full((40, 2), 0.1)
    u[:, 0] = np.arange(40)
    u[30:] = [3.2, 0.2]
    assert np.std(u[:30, 1]) > 0
    run = HybridNavigator(same, KNeighborsRegressor(1)).run(y, u)
    assert run.estimates[30:, :, 0] == pytest.approx(np.tile(y[3, :, 0], (10, 1)))


@pytest.mark.parametrize(
    "regressor",
    [
        KNeighborsRegressor(3),
        RandomForestRegressor(5, random_state=0),
        make_pipeline(PolynomialFeatures(2), Ridge()),
        LSSVMRegressor(1.0, 10.0),
        BackpropRegressor(3, epochs=10, networks=2),
    ],
)
def test_any_regressor_is_trained_on_the_pairs_before_the_outage(regressor: Any) -> None:
    """The same by hand: fitted on the filter's estimates, asked for the inputs of the gap."""
    y, u = noise(15, 36, 3, (24, 36)), np.random.default_rng(16).normal(size=(36, 2, 3))
    before = clone(regressor)
    run = HybridNavigator(kalman, regressor, scaled=False).run(y, u)
    for r in range(3):
        machine = clone(before)
        if isinstance(machine, BackpropRegressor):
            machine.set_params(random_state=r)  # each run has random numbers of its own
        machine.fit(u[:24, :, r], kalman(y)[:24, :, r])
        expected = machine.predict(u[24:, :, r])
        assert run.estimates[24:, :, r] == pytest.approx(expected, rel=1e-6, abs=1e-9)
    assert run.fits == 3
    with pytest.raises(NotFittedError):
        check_is_fitted(regressor)
    assert repr(regressor) == repr(before)


@pytest.mark.filterwarnings("ignore:A column-vector y")  # which the navigator always passes
def test_a_regressor_of_one_output_predicts_one_column() -> None:
    y = noise(17, 30, 2, (20, 30), m=1)
    u = np.arange(30.0)[:, None]
    run = HybridNavigator(same, RandomForestRegressor(3, random_state=0)).run(y, u)
    assert run.estimates.shape == (30, 1, 2)
    assert np.isfinite(run.estimates).all()


def test_many_are_trained_as_each() -> None:
    rng = np.random.default_rng(18)
    Xs, ys = list(rng.normal(size=(3, 20, 2))), list(rng.normal(size=(3, 20, 2)))
    ridge = Ridge(0.1)
    for machine, X, y in zip(fit_many(ridge, Xs, ys), Xs, ys, strict=True):
        design = np.column_stack([X, np.ones(20)])
        by_hand = np.linalg.solve(design.T @ design + np.diag([0.1, 0.1, 0.0]), design.T @ y)
        assert machine.predict(X) == pytest.approx(design @ by_hand)
    assert not hasattr(ridge, "coef_")
    networks = fit_many(BackpropRegressor(2, epochs=3), Xs, ys)
    assert [machine.random_state for machine in networks] == [0, 1, 2]


def test_the_network_of_a_run_depends_on_no_other_run() -> None:
    """Its random numbers follow its own place among the runs, whatever gaps the others have."""
    u = np.random.default_rng(19).normal(size=(40, 2, 3))
    gaps = noise(20, 40, 3, (30, 40))
    mixed = gaps.copy()
    mixed[12:15, :, 0] = np.nan
    learner = BackpropRegressor(3, epochs=5)
    one, other = (HybridNavigator(same, learner).run(y, u).estimates for y in (gaps, mixed))
    assert one[:, :, 1:] == pytest.approx(other[:, :, 1:], rel=1e-9)


def test_on_the_recording(root: Path) -> None:
    """Predictor mode in the outages of the recording, and nowhere else; numbers everywhere."""
    recording = read_recording(root / "data" / "examples" / "ins-wsn.csv")
    model = ErrorModel.p1(
        recording.period, process_noise=(0.05, 0.05), measurement_noise=(0.5, 0.1)
    )

    def heard_filter(y: np.ndarray) -> np.ndarray:
        return run_kalman(model, y, initial_covariance=np.eye(4))

    navigator = HybridNavigator(heard_filter, LSSVMRegressor(3.0, 10.0), patience=3)
    measured = recording.measurements
    run = navigator.run(measured, recording.ins)
    assert len(recording.outages) > 0
    absent = np.isnan(recording.ins).any(axis=1)  # rows that the file lacks
    expected = silent(len(measured), *((a + 3, b) for a, b in recording.outages)) & ~absent
    assert np.array_equal(run.predicting[:, 0], expected)
    assert np.isfinite(run.estimates).all()
    assert np.array_equal(run.estimates[~expected], heard_filter(measured)[~expected])
    for inputs in observable_inputs(recording.time, recording.ins[:, :, None]).values():
        assert np.isfinite(navigator.run(measured, inputs).estimates).all()


@settings(max_examples=30)
@given(st.integers(0, 10**6))
def test_what_can_be_observed_of_a_constant_acceleration(seed: int) -> None:
    """Its change of velocity over any period is that acceleration."""
    rng = np.random.default_rng(seed)
    time = 100 + np.cumsum(rng.uniform(0.05, 0.5, 20))
    a, v, p = rng.normal(size=(3, 2, 4))
    t = (time - time[0])[:, None, None]
    ins = np.concatenate([p + v * t + a * t**2 / 2, v + a * t], axis=1)
    found = observable_inputs(time, ins)
    assert set(found) == {"time", "motion", "inertial"}
    assert np.array_equal(found["motion"], ins)
    assert found["time"] == pytest.approx(np.broadcast_to(t, (20, 1, 4)))
    assert np.array_equal(found["inertial"][:, :1], found["time"])
    assert found["inertial"][1:, 1:] == pytest.approx(np.broadcast_to(a, (19, 2, 4)), abs=1e-8)
    assert np.isnan(found["inertial"][0, 1:]).all()  # no change of velocity is known yet


def test_the_indicated_acceleration_is_that_of_the_last_period() -> None:
    """A step of the velocity shows at its own step, not before."""
    ins = np.zeros((10, 4, 1))
    ins[6:, 2] = 1.0
    acceleration = observable_inputs(0.5 * np.arange(10), ins)["inertial"][:, 1, 0]
    assert np.flatnonzero(acceleration[1:]).tolist() == [5]
    assert acceleration[6] == pytest.approx(2.0)


@pytest.mark.parametrize(
    ("time", "shape", "said"),
    [
        (np.arange(5.0), (5, 3, 1), "ins is 'of shape"),
        (np.arange(5.0), (5, 4), "ins is 'of shape"),
        (np.arange(1.0), (1, 4, 1), "ins is 'of shape"),
        (np.arange(4.0), (5, 4, 1), "time is 'of shape"),
        (np.zeros(5), (5, 4, 1), "time is 'of shape"),
        (np.array([0, 1, 2, np.nan, 4]), (5, 4, 1), "time is 'of shape"),
    ],
)
def test_what_cannot_be_observed_is_refused(
    time: np.ndarray, shape: tuple[int, ...], said: str
) -> None:
    with pytest.raises(ParameterError, match=said):
        observable_inputs(time, np.zeros(shape))


@pytest.mark.parametrize(
    ("options", "said"),
    [
        ({"window": 0}, "window is 0"),
        ({"window": 10.0}, "window is 10.0"),
        ({"least": 0}, "least is 0"),
        ({"least": True}, "least is True"),
        ({"patience": -1}, "patience is -1"),
        ({"filter": 3}, "filter is 3"),
        ({"regressor": "LinearRegression"}, "regressor is 'LinearRegression'"),
        ({"regressor": np.mean}, "regressor is <"),
    ],
)
def test_a_navigator_that_cannot_be_is_refused(options: dict[str, Any], said: str) -> None:
    with pytest.raises(ParameterError, match=said):
        HybridNavigator(**{"filter": same, "regressor": Ridge()} | options)


@pytest.mark.parametrize(
    ("filter_", "y", "u", "said"),
    [
        (same, np.zeros((5, 4)), np.zeros((5, 1)), "measurements is 'of shape"),
        (same, np.zeros((5, 4, 1)), None, "inputs is None"),
        (same, np.zeros((5, 4, 1)), np.zeros((4, 1)), "inputs is 'of shape"),
        (same, np.zeros((5, 4, 1)), np.zeros((5, 1, 2)), "inputs is 'of shape"),
        (same, np.zeros((5, 4, 1)), np.full((5, 1), np.inf), "inputs is 'infinite'"),
        (lambda y: y[1:], np.zeros((5, 4, 1)), np.zeros((5, 1)), "filter is 'one that returns"),
        (lambda y: y[:, 0], np.zeros((5, 4, 1)), np.zeros((5, 1)), "filter is 'one that returns"),
        (lambda y: y * np.nan, noise(1, 15, 1, (12, 15)), np.zeros((15, 1)), "filter is 'one with"),
    ],
)
def test_what_does_not_fit_is_refused(
    filter_: Filter, y: np.ndarray, u: np.ndarray | None, said: str
) -> None:
    with pytest.raises(ParameterError, match=said):
        HybridNavigator(filter_, Ridge()).run(y, u)


class Odd(BaseEstimator):  # type: ignore[misc]
    """Predicts one column for all outputs, or what is no number, or cannot be trained."""

    def __init__(self, how: str = "one") -> None:
        self.how = how

    def fit(self, X: np.ndarray, y: np.ndarray) -> Odd:
        if self.how == "fit":
            raise ValueError("no such thing")
        return self

    def predict(self, X: np.ndarray) -> np.ndarray:
        return np.zeros(len(X)) if self.how == "one" else np.full((len(X), 2), np.nan)


@pytest.mark.parametrize(
    ("how", "why"),
    [
        ("one", r"Odd, which predicts \(4,\)"),
        ("nan", "Odd, which predicts .* not finite"),
        ("fit", "Odd, whose fit fails: ValueError: no such thing"),
    ],
)
def test_a_regressor_that_will_not_do_is_named(how: str, why: str) -> None:
    y = noise(24, 20, 1, (16, 20))
    with pytest.raises(ParameterError, match=why):
        HybridNavigator(same, Odd(how)).run(y, np.arange(20.0)[:, None])


def test_a_window_below_the_least_number_of_pairs_still_trains() -> None:
    """Two pairs make a line."""
    y = np.arange(20.0)[:, None, None] * np.ones((1, 2, 1))
    y[15:] = np.nan
    run = HybridNavigator(same, LinearRegression(), window=2).run(y, np.arange(20.0)[:, None])
    assert run.estimates[15:, 0, 0] == pytest.approx(np.arange(15.0, 20.0))
