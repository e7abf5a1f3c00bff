"""The regressors hold to scikit-learn's interface, whichever way their data are checked."""

from __future__ import annotations

import warnings
from typing import Any

import numpy as np
import pandas as pd
import pytest
from hypothesis import given, strategies as st
from hypothesis.extra.numpy import array_shapes, arrays
from sklearn.base import BaseEstimator, RegressorMixin
from sklearn.exceptions import SkipTestWarning
from sklearn.preprocessing import MinMaxScaler, StandardScaler
from sklearn.utils.estimator_checks import check_estimator
from sklearn.utils.validation import check_is_fitted, validate_data

from inswsn_lib.learning import (
    BackpropRegressor,
    HoldRegressor,
    LSSVMRegressor,
    RBFNetworkRegressor,
    Scale,
    SelectedLSSVM,
)
from inswsn_lib.learning.base import joined

ESTIMATORS = {
    "hold": HoldRegressor(),
    "rbf kernel": LSSVMRegressor(),
    "linear kernel": LSSVMRegressor(kernel="linear"),
    "polynomial kernel": LSSVMRegressor(kernel="polynomial"),
    "selected": SelectedLSSVM((1.0, 2.0), (1.0, 10.0)),
    "rbf network": RBFNetworkRegressor(max_neurons=20),
    "levenberg-marquardt": BackpropRegressor(epochs=60),
    "gradient-descent": BackpropRegressor(
        trainer="gradient-descent", learning_rate=0.1, momentum=0.9, epochs=60
    ),
    "early stopping": BackpropRegressor(
        validation_share=0.2, networks=3, scaling="standard", epochs=60
    ),
}


@pytest.mark.parametrize("name", ESTIMATORS)
def test_it_is_an_estimator(name: str) -> None:
    poor = {"check_regressors_train": "it does not look at its inputs"} if name == "hold" else None
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", SkipTestWarning)  # of a check that needs a setting of scipy
        check_estimator(ESTIMATORS[name], expected_failed_checks=poor)


@pytest.mark.parametrize("name", ESTIMATORS)
def test_predictions_have_the_shape_of_the_targets(name: str) -> None:
    rng = np.random.default_rng(1)
    X, y = rng.normal(size=(12, 2)), rng.normal(size=(12, 1))
    machine = ESTIMATORS[name]
    column = machine.fit(X, y).predict(X[:5])
    assert column.shape == (5, 1)
    assert np.array_equal(machine.fit(X, y[:, 0]).predict(X[:5]), column[:, 0])


class Reference(RegressorMixin, BaseEstimator):  # type: ignore[misc]
    """Keeps the last target, with data checked by scikit-learn alone."""

    def fit(self, X: Any, y: Any) -> Reference:
        X, y = validate_data(self, X, y, multi_output=True, y_numeric=True, dtype=np.float64)
        self._flat = y.ndim == 1
        self.last_ = np.array(y, dtype=np.float64).reshape(len(y), -1)[-1]
        return self

    def predict(self, X: Any) -> Any:
        check_is_fitted(self)
        rows = len(validate_data(self, X, reset=False, dtype=np.float64))
        return np.full(rows, self.last_) if self._flat else np.tile(self.last_, (rows, 1))


def outcome(call: Any, *data: Any) -> Any:
    """Return what comes of a call, or what is raised."""
    try:
        result = call(*data)
    except Exception as error:
        return type(error), str(error).replace("Reference", "HoldRegressor")
    return None if isinstance(result, BaseEstimator) else result


def values(most: int) -> Any:
    """Return arrays that are in order, and such as are not."""
    shapes = array_shapes(min_dims=0, max_dims=3, min_side=0, max_side=most)
    kinds = st.sampled_from([np.float64, np.float32, np.int64, np.complex128, ">f8"])
    return kinds.flatmap(lambda kind: arrays(kind, shapes))


@given(values(4), values(4), values(4))
def test_data_are_checked_as_scikit_learn_checks_them(X: Any, y: Any, ahead: Any) -> None:
    own, other = HoldRegressor(), Reference()
    for name, *data in (
        ("fit", X, y), ("predict", ahead), ("predict", X), ("fit", X, X), ("predict", X),
        ("fit", X, np.ones(X.shape[:1])), ("predict", ahead), ("predict", X),
    ):  # fmt: skip
        found, expected = (outcome(getattr(machine, name), *data) for machine in (own, other))
        np.testing.assert_equal(found, expected)
        np.testing.assert_equal(vars(own), vars(other))


def test_names_of_inputs_are_kept_and_missed() -> None:
    frame = pd.DataFrame({"time": [0.0, 1.0]})
    machine = HoldRegressor().fit(frame, [1.0, 2.0])
    assert machine.feature_names_in_.tolist() == ["time"]
    with pytest.warns(UserWarning, match="does not have valid feature names"):
        machine.predict(np.zeros((1, 1)))
    machine.fit(np.zeros((2, 1)), np.zeros(2))
    assert not hasattr(machine, "feature_names_in_")


def test_hold_holds_its_own_copy() -> None:
    y = np.arange(6.0).reshape(3, 2)
    held = HoldRegressor().fit(np.zeros((3, 1)), y)
    y[-1] = 0.0
    assert held.predict([[7.0], [8.0]]).tolist() == [[4.0, 5.0], [4.0, 5.0]]


SCALERS = {
    "range": MinMaxScaler((-1, 1)),
    "standard": StandardScaler(),
    "none": StandardScaler(with_mean=False, with_std=False),
}


@pytest.mark.parametrize("scaling", SCALERS)
def test_columns_of_each_run_are_scaled_as_by_scikit_learn(scaling: Any) -> None:
    values = np.random.default_rng(2).normal(size=(9, 3, 2)) * [[[1.0, 50.0]]] + 7
    scale = Scale.of(values, scaling)
    scaled = scale.transform(values)
    for run in range(2):
        expected = SCALERS[scaling].fit_transform(values[:, :, run])
        assert scaled[:, :, run] == pytest.approx(expected)
        assert np.array_equal(Scale.of(values[:, :, run], scaling).size, scale.size[:, run])
    assert scale.inverse_transform(scaled) == pytest.approx(values)
    assert scale.inverse_transform(scaled[None]) == pytest.approx(values[None])


@pytest.mark.parametrize("scaling", ["range", "standard"])
def test_a_column_that_does_not_vary_is_only_moved(scaling: Any) -> None:
    """0.1 thirty times has a deviation of 3e-17, which is no unit to measure 0.25 with."""
    values = np.full((30, 1), 0.1)
    assert np.std(values) > 0
    scale = Scale.of(values, scaling)
    assert scale.transform(values[:1] + 0.25) == pytest.approx(0.25)


JOINED = {
    "rbf kernel": LSSVMRegressor(1.5, 10.0),
    "linear kernel": LSSVMRegressor(1.0, 10.0, "linear"),
    "polynomial kernel": LSSVMRegressor(2.0, 10.0, "polynomial", 3),
    "low rank": LSSVMRegressor(1.5, 10.0, rank=7),
    "rbf network": RBFNetworkRegressor(2.0, max_neurons=5),
}


def fitted(machine: Any, runs: int, seed: int = 1) -> list[Any]:
    rng = np.random.default_rng(seed)
    samples = [(rng.normal(size=(20, 3)), rng.normal(size=(20, 2))) for _ in range(runs)]
    return [type(machine)(**machine.get_params()).fit(X, Y) for X, Y in samples]


@pytest.mark.parametrize("name", JOINED)
@pytest.mark.parametrize(("runs", "n"), [(1, 1), (4, 1), (3, 6)])
def test_joined_machines_predict_what_each_does(name: str, runs: int, n: int) -> None:
    machines = fitted(JOINED[name], runs)
    before = [machine.predict(np.ones((1, 3))) for machine in machines]
    X = np.random.default_rng(2).normal(size=(runs, n, 3))
    together = joined(machines)
    assert together is not None
    each = np.stack([m.predict(x) for m, x in zip(machines, X, strict=True)])
    assert together(X) == pytest.approx(each, rel=1e-12, abs=1e-12)
    after = [machine.predict(np.ones((1, 3))) for machine in machines]
    assert np.array_equal(before, after)


class Doubled(LSSVMRegressor):
    """One that predicts otherwise, and does not say that it takes stacks."""

    def _predict(self, X: np.ndarray) -> np.ndarray:
        return 2 * super()._predict(X)


def test_machines_that_are_not_alike_are_not_joined() -> None:
    first = fitted(LSSVMRegressor(1.0), 1)[0]
    wider, doubled = fitted(LSSVMRegressor(2.0), 1)[0], fitted(Doubled(1.0), 1)[0]
    longer = LSSVMRegressor(1.0).fit(np.zeros((3, 3)), np.zeros((3, 2)))
    for others in ([wider], [doubled], [longer], [HoldRegressor()]):
        assert joined([first, *others]) is None
    for machine in (doubled, HoldRegressor(), MinMaxScaler()):
        assert joined([machine]) is None
