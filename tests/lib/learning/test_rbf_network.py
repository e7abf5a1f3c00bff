"""The growing network against interpolation, a first step by hand, and its own goal."""

from __future__ import annotations

import warnings

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st
from sklearn.exceptions import SkipTestWarning
from sklearn.utils.estimator_checks import check_estimator

from inswsn_lib.errors import ParameterError
from inswsn_lib.learning import RBFNetworkRegressor


def data(seed: int, n: int = 12) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(seed)
    return rng.normal(size=(n, 2)), rng.normal(size=(n, 2))


def test_it_is_an_estimator() -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", SkipTestWarning)  # of a check that needs a setting of scipy
        check_estimator(RBFNetworkRegressor(max_neurons=20))


def test_with_a_neuron_for_each_sample_it_interpolates() -> None:
    X, y = data(1)
    network = RBFNetworkRegressor(spread=1.0).fit(X, y)
    assert len(network.centres_) <= len(X)
    assert network.predict(X) == pytest.approx(y, abs=1e-8)


@settings(deadline=None, max_examples=40)
@given(st.integers(0, 10**6), st.floats(0.2, 3))
def test_the_error_never_rises(seed: int, spread: float) -> None:
    X, y = data(seed)
    errors = RBFNetworkRegressor(spread=spread).fit(X, y).errors_
    assert errors[0] == pytest.approx(np.mean((y - y.mean(axis=0)) ** 2))  # the bias alone
    assert np.all(np.diff(errors) <= 1e-9 * errors[0])


def test_it_stops_at_the_goal_and_not_before() -> None:
    X, y = data(2)
    network = RBFNetworkRegressor(spread=1.0, goal=0.3).fit(X, y)
    assert network.errors_[-1] <= 0.3 < network.errors_[-2]
    assert len(network.errors_) == len(network.centres_) + 1
    none = RBFNetworkRegressor(goal=1e6).fit(X, y)
    assert len(none.centres_) == 0
    assert none.predict(X) == pytest.approx(np.tile(y.mean(axis=0), (len(y), 1)))


def test_it_has_no_more_neurons_than_allowed() -> None:
    X, y = data(3)
    for most in (0, 1, 5):
        assert len(RBFNetworkRegressor(max_neurons=most).fit(X, y).centres_) == most


def test_a_neuron_is_at_one_half_at_the_spread() -> None:
    network = RBFNetworkRegressor(spread=3.0, max_neurons=1).fit([[0.0], [50.0]], [0.0, 1.0])
    centre = network.centres_[0, 0]
    at = network.predict([[centre], [centre + 3.0], [centre + 1e6]])
    assert (at[1] - at[2]) / (at[0] - at[2]) == pytest.approx(0.5)


def test_the_first_neuron_is_the_one_most_like_the_target() -> None:
    """A target that is one neuron's response: that neuron is chosen, and nothing is left."""
    rng = np.random.default_rng(4)
    X = rng.normal(size=(20, 2))
    target = np.exp(-np.log(2) * np.sum((X - X[7]) ** 2, axis=1))
    network = RBFNetworkRegressor(goal=1e-20).fit(X, target)
    assert network.centres_ == pytest.approx(X[7:8])
    assert network.weights_ == pytest.approx([1.0])
    assert network.bias_ == pytest.approx(0, abs=1e-9)


def test_equal_samples_are_one_neuron() -> None:
    X = np.array([[0.0], [0.0], [1.0], [1.0]])
    network = RBFNetworkRegressor(spread=0.5).fit(X, [0.0, 2.0, 3.0, 5.0])
    assert len(network.centres_) <= 2
    assert network.predict([[0.0], [1.0]]) == pytest.approx([1.0, 4.0])


@pytest.mark.parametrize(
    ("parameters", "said"),
    [
        ({"spread": 0.0}, "spread is 0.0"),
        ({"goal": -1.0}, "goal is -1.0"),
        ({"goal": float("nan")}, "goal is nan"),
        ({"max_neurons": -1}, "max_neurons is -1"),
        ({"max_neurons": 2.5}, "max_neurons is 2.5"),
    ],
)
def test_a_parameter_that_cannot_be_is_refused(parameters: dict[str, object], said: str) -> None:
    with pytest.raises(ParameterError, match=said):
        RBFNetworkRegressor(**parameters).fit([[0.0], [1.0]], [0.0, 1.0])  # type: ignore[arg-type]
