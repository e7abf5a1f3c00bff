"""A regressor of one output is trained once for each output; others are left as they are."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from sklearn.base import BaseEstimator, RegressorMixin, clone
from sklearn.ensemble import GradientBoostingRegressor
from sklearn.linear_model import LinearRegression
from sklearn.multioutput import MultiOutputRegressor
from sklearn.neighbors import KNeighborsRegressor
from sklearn.svm import SVR

from inswsn_lib.learning import BackpropRegressor, LSSVMRegressor, as_multi_output


class FirstOutput(RegressorMixin, BaseEstimator):
    """Takes several outputs without a word, and predicts the mean of the first alone."""

    def fit(self, X: np.ndarray, y: np.ndarray) -> FirstOutput:
        self.mean_ = np.asarray(y).reshape(len(y), -1)[:, 0].mean()
        return self

    def predict(self, X: np.ndarray) -> np.ndarray:
        return np.full(len(X), self.mean_)


@pytest.mark.parametrize(
    "regressor",
    [LinearRegression(), KNeighborsRegressor(2), LSSVMRegressor(), BackpropRegressor(epochs=2)],
)
def test_what_takes_several_outputs_is_itself(regressor: Any) -> None:
    before = dict(vars(regressor))
    assert as_multi_output(regressor) is regressor
    assert vars(regressor) == before  # the trial was of a clone


@pytest.mark.parametrize(
    "regressor", [SVR(), GradientBoostingRegressor(n_estimators=3, random_state=0), FirstOutput()]
)
def test_what_takes_one_is_trained_for_each(regressor: Any) -> None:
    rng = np.random.default_rng(1)
    X, y = rng.normal(size=(20, 2)), rng.normal(size=(20, 3))
    before = dict(vars(regressor))
    adapted = as_multi_output(regressor)
    assert isinstance(adapted, MultiOutputRegressor)
    predicted = adapted.fit(X, y).predict(X)
    for i in range(3):
        alone = clone(regressor).fit(X, y[:, i]).predict(X)
        assert predicted[:, i] == pytest.approx(alone)
    assert vars(regressor) == before
