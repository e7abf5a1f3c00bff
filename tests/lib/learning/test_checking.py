"""Data are checked as scikit-learn checks them, whichever way is taken."""

from __future__ import annotations

from typing import Any

import numpy as np
import pandas as pd
import pytest
from hypothesis import given, strategies as st
from hypothesis.extra.numpy import array_shapes, arrays
from sklearn.base import BaseEstimator, RegressorMixin
from sklearn.exceptions import NotFittedError
from sklearn.utils.validation import check_is_fitted, validate_data

from inswsn_lib.learning import HoldRegressor
from inswsn_lib.learning.checking import data_to_fit, data_to_predict


class Machine(RegressorMixin, BaseEstimator):  # type: ignore[misc]
    """An estimator that checks its data and does nothing else."""

    def fit(self, X: Any, y: Any) -> Machine:
        data_to_fit(self, X, y)
        return self


def outcome(call: Any, *arguments: Any) -> Any:
    """Return what comes of a call, or what is raised."""
    try:
        return call(*arguments)
    except Exception as error:
        return type(error), str(error)


def sklearn_to_fit(estimator: BaseEstimator, X: Any, y: Any) -> Any:
    checked = validate_data(estimator, X, y, multi_output=True, y_numeric=True, dtype=np.float64)
    return checked[0], np.asarray(checked[1], dtype=np.float64)


def sklearn_to_predict(estimator: BaseEstimator, X: Any) -> Any:
    check_is_fitted(estimator)
    return validate_data(estimator, X, reset=False, dtype=np.float64)


def values(most: int) -> Any:
    """Return arrays that are in order, and such as are not."""
    shapes = array_shapes(min_dims=0, max_dims=3, min_side=0, max_side=most)
    kinds = st.sampled_from([np.float64, np.float32, np.int64, np.complex128, ">f8"])
    return kinds.flatmap(lambda kind: arrays(kind, shapes))


@given(values(4), values(4), values(4))
def test_it_answers_as_scikit_learn_does(X: Any, y: Any, ahead: Any) -> None:
    own, other = Machine(), Machine()
    for call, reference, data in (
        (data_to_fit, sklearn_to_fit, (X, y)),
        (data_to_predict, sklearn_to_predict, (ahead,)),
        (data_to_predict, sklearn_to_predict, (X,)),
        (data_to_fit, sklearn_to_fit, (X, X)),
        (data_to_predict, sklearn_to_predict, (X,)),
    ):
        np.testing.assert_equal(outcome(call, own, *data), outcome(reference, other, *data))
        assert vars(own) == vars(other)


@pytest.mark.parametrize("wrong", [np.nan, np.inf, -np.inf])
def test_one_value_that_is_not_finite_is_refused(wrong: float) -> None:
    X, y = np.zeros((5, 2)), np.zeros(5)
    machine = Machine()
    data_to_fit(machine, X, y)
    for place in (X, y):
        place[3] = wrong
        with pytest.raises(ValueError, match="contains"):
            data_to_fit(machine, X, y)
        place[3] = 0.0
    X[0, 1] = wrong
    with pytest.raises(ValueError, match="contains"):
        data_to_predict(machine, X)


def test_plain_arrays_come_back_as_they_are() -> None:
    X, y = np.zeros((5, 2)), np.zeros((5, 3))
    machine = Machine()
    inputs, targets = data_to_fit(machine, X, y)
    assert inputs is X
    assert targets is y
    assert data_to_predict(machine, X) is X


def test_what_is_not_fitted_does_not_predict() -> None:
    with pytest.raises(NotFittedError):
        data_to_predict(Machine(), np.zeros((1, 1)))


def test_names_of_inputs_are_kept_and_missed() -> None:
    frame = pd.DataFrame({"time": [0.0, 1.0]})
    machine = HoldRegressor().fit(frame, [1.0, 2.0])
    assert machine.feature_names_in_.tolist() == ["time"]
    with pytest.warns(UserWarning, match="does not have valid feature names"):
        machine.predict(np.zeros((1, 1)))
    machine.fit(np.zeros((2, 1)), np.zeros(2))
    assert not hasattr(machine, "feature_names_in_")
