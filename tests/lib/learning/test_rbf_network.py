"""The growing network against interpolation, a first step by hand, and its own goal."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from inswsn_lib.errors import ParameterError
from inswsn_lib.learning import RBFNetworkRegressor


def data(seed: int, n: int = 12) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(seed)
    return rng.normal(size=(n, 2)), rng.normal(size=(n, 2))


def grown(X: np.ndarray, y: np.ndarray, spread: float, most: int) -> list[int]:
    """Return the centres by Gram and Schmidt: each time the direction that explains most."""
    distances = np.linalg.norm(X[:, None] - X[None], axis=2)
    candidates = 0.5 ** ((distances / spread) ** 2)
    chosen: list[int] = []
    basis = np.zeros((len(X), 0))
    for _ in range(most):
        rest = candidates - basis @ (basis.T @ candidates)
        rest /= np.maximum(np.linalg.norm(rest, axis=0), 1e-12)
        explained = ((rest.T @ y) ** 2).sum(axis=1)
        explained[chosen] = 0
        chosen.append(int(np.argmax(explained)))
        basis = np.column_stack([basis, rest[:, chosen[-1]]])
    return chosen


@settings(max_examples=30)
@given(st.integers(0, 10**6), st.floats(0.5, 1.5), st.integers(1, 4))
def test_it_chooses_what_explains_most_and_solves_for_all(
    seed: int, spread: float, most: int
) -> None:
    X, y = data(seed)
    network = RBFNetworkRegressor(spread, max_neurons=most).fit(X, y)
    centres = X[grown(X, y, spread, most)]
    assert np.array_equal(network.centres_, centres)
    squares = ((X[:, None] - centres[None]) ** 2).sum(axis=2)
    design = np.column_stack([0.5 ** (squares / spread**2), np.ones(len(X))])
    weights = np.linalg.pinv(design) @ y
    assert network.predict(X) == pytest.approx(design @ weights, abs=1e-6)
    assert network.weights_ == pytest.approx(weights[:-1], rel=1e-5, abs=1e-5)
    assert network.bias_ == pytest.approx(weights[-1], rel=1e-5, abs=1e-5)
    assert network.errors_[0] == pytest.approx(np.mean((y - y.mean(axis=0)) ** 2))
    assert network.errors_[-1] == pytest.approx(np.mean((y - design @ weights) ** 2), abs=1e-9)
    assert np.all(np.diff(network.errors_) <= 1e-9 * network.errors_[0])


def test_with_a_neuron_for_each_sample_it_interpolates() -> None:
    X, y = data(1)
    network = RBFNetworkRegressor(spread=1.0).fit(X, y)
    assert len(network.centres_) <= len(X)
    assert network.predict(X) == pytest.approx(y, abs=1e-8)


def test_it_stops_when_the_others_are_spanned() -> None:
    """What is left of a neuron beside those chosen, by a QR factorisation, over what it was."""

    def share(neuron: np.ndarray, before: np.ndarray) -> float:
        basis, _ = np.linalg.qr(before)
        for _ in range(2):  # again, for what rounding has left
            neuron = neuron - basis @ (basis.T @ neuron)
        return float(neuron @ neuron)

    rng = np.random.default_rng(113)  # what is left is near 1e-14, from either side
    X, y = rng.uniform(0, 3, (60, 1)), rng.normal(size=60)
    network = RBFNetworkRegressor(spread=0.5).fit(X, y)
    neurons = np.exp2(-(((X - X.T) / 0.5) ** 2))
    neurons /= np.linalg.norm(neurons, axis=0)
    place = [int(np.flatnonzero(centre == X)[0]) for centre in network.centres_]
    chosen, others = neurons[:, place], np.delete(neurons, place, axis=1)
    assert share(chosen[:, -1], chosen[:, :-1]) > 1e-14
    assert max(share(neuron, chosen) for neuron in others.T) <= 1e-14


def test_it_stops_at_the_goal_and_not_before() -> None:
    X, y = data(2)
    network = RBFNetworkRegressor(spread=1.0, goal=0.3).fit(X, y)
    assert network.errors_[-1] <= 0.3 < network.errors_[-2]
    assert len(network.errors_) == len(network.centres_) + 1
    exact = RBFNetworkRegressor(spread=1.0, goal=float(network.errors_[-1])).fit(X, y)
    assert len(exact.centres_) == len(network.centres_)
    none = RBFNetworkRegressor(goal=1e6).fit(X, y)
    assert len(none.centres_) == 0
    assert none.predict(X) == pytest.approx(np.tile(y.mean(axis=0), (len(y), 1)))


def test_it_has_no_more_neurons_than_allowed() -> None:
    X, y = data(3)
    for most, found in ((0, 0), (1, 1), (5, 5), (50, 12)):
        assert len(RBFNetworkRegressor(0.1, max_neurons=most).fit(X, y).centres_) == found


def test_equal_samples_are_one_neuron() -> None:
    X = np.array([[0.0], [0.0], [1.0], [1.0]])
    network = RBFNetworkRegressor(spread=0.5).fit(X, [0.0, 2.0, 3.0, 5.0])
    assert len(network.centres_) <= 2
    assert network.predict([[0.0], [1.0]]) == pytest.approx([1.0, 4.0])


@pytest.mark.parametrize(
    "parameter",
    [("spread", 0.0), ("goal", -1.0), ("goal", np.nan), ("max_neurons", -1), ("max_neurons", 2.5)],
)
def test_a_parameter_that_cannot_be_is_refused(parameter: tuple[str, Any]) -> None:
    name, value = parameter
    with pytest.raises(ParameterError, match=rf"{name} .* not {value!r}"):
        RBFNetworkRegressor(**{name: value}).fit([[0.0], [1.0]], [0.0, 1.0])
