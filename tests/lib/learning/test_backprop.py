"""Back-propagation against trainers in numpy, other libraries, limits, and its own repetition."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np
import pytest
import torch
from hypothesis import given, settings, strategies as st
from lib.kernels.both_ways import both
from sklearn.neural_network import MLPRegressor

from inswsn_lib.errors import ParameterError
from inswsn_lib.learning import BackpropRegressor

TRAINERS: list[Any] = ["levenberg-marquardt", "gradient-descent"]


def data(seed: int, n: int = 40, outputs: int = 2) -> tuple[np.ndarray, np.ndarray]:
    """Return a smooth map of two inputs, with noise."""
    rng = np.random.default_rng(seed)
    X = rng.uniform(-2, 3, size=(n, 2))
    clean = np.stack([np.sin((i + 1) * X[:, 0]) + X[:, 1] for i in range(outputs)], axis=1)
    return X, clean + 0.1 * rng.normal(size=clean.shape)


def parts(w: np.ndarray, hidden: int, inputs: int, outputs: int) -> list[np.ndarray]:
    """Return W1, b1, W2 and b2."""
    ends = np.cumsum([hidden * inputs, hidden, outputs * hidden])
    W1, b1, W2, b2 = np.split(w, ends)
    return [W1.reshape(hidden, inputs), b1, W2.reshape(outputs, hidden), b2]


def by_hand(
    machine: BackpropRegressor, X: np.ndarray, Y: np.ndarray, i: int
) -> tuple[np.ndarray, int, float]:
    """Train network i in numpy; return its weights, steps and loss. Slopes by complex steps."""
    Xs, Ys, start, trains = machine._prepare(X, Y)
    decay, validated = machine.weight_decay, not trains.all()

    def residuals(w: np.ndarray, rows: np.ndarray) -> np.ndarray:
        W1, b1, W2, b2 = parts(w, machine.hidden, X.shape[1], Y.shape[1])
        out = np.tanh(Xs[i][rows] @ W1.T + b1) @ W2.T + b2
        return (out - Ys[i][rows]).ravel() / np.sqrt(Ys[i][rows].size)

    def loss(w: np.ndarray) -> float:
        return float(np.sum(residuals(w, trains[i]) ** 2) + decay * w @ w)

    def watched(w: np.ndarray) -> float:
        return float(np.sum(residuals(w, ~trains[i]) ** 2)) if validated else loss(w)

    w, unit = start[i], np.eye(start.shape[1])
    best, failures, speed, damping, step, done = w, 0, 0 * w, 1e-3, 0, False
    while step < machine.epochs and not done and not (validated and failures >= machine.patience):
        J = np.stack([residuals(w + 1e-30j * e, trains[i]).imag / 1e-30 for e in unit], axis=1)
        slope = J.T @ residuals(w, trains[i]) + decay * w
        if machine.trainer == "gradient-descent":
            speed = machine.momentum * speed - 2 * machine.learning_rate * slope
            w, done = w + speed, 2 * np.abs(slope).max() < 1e-7
        else:
            better, done, before = False, np.abs(slope).max() < 1e-7, w
            while not better and damping <= 1e10:
                tried = before - np.linalg.solve(J.T @ J + (decay + damping) * unit, slope)
                better = loss(tried) < loss(before)
                damping *= 0.1 if better else 10
                w = tried if better else before
            done = done or damping > 1e10
        step += 1
        failures += 1
        if watched(w) < watched(best):
            best, failures = w, 0
    return best, step, float(np.sum(residuals(best, trains[i]) ** 2))


@settings(max_examples=25)
@given(
    st.integers(0, 10**6), st.integers(1, 3), st.integers(1, 4), st.integers(1, 3),
    st.sampled_from([0.0, 0.03]), st.sampled_from([0.0, 0.4]), st.sampled_from(TRAINERS),
)  # fmt: skip
def test_it_trains_as_by_hand(
    seed: int, inputs: int, hidden: int, outputs: int, decay: float, held: float, trainer: Any
) -> None:
    """Both steppers, compiled and not, with and without samples that stop each network."""
    rng = np.random.default_rng(seed)
    X, Y = rng.normal(size=(14, inputs)), rng.normal(size=(14, outputs))
    machine = BackpropRegressor(
        hidden, trainer, epochs=5, learning_rate=0.2, momentum=0.7, weight_decay=decay,
        validation_share=held, patience=2, scaling="standard", networks=3,
    )  # fmt: skip
    ways = both(lambda: BackpropRegressor(**machine.get_params()).fit(X, Y))
    for i in range(3):
        weights, steps, loss = by_hand(machine, X, Y, i)
        for trained in ways:
            assert trained.steps_[i] == steps
            assert trained.weights_[i] == pytest.approx(weights, rel=1e-4, abs=1e-5)
            assert trained.losses_[i] == pytest.approx(loss, rel=1e-5)


@pytest.mark.parametrize("trainer", TRAINERS)
def test_a_network_that_is_done_stays_as_it_is_while_others_go_on(trainer: Any) -> None:
    """Targets of zero and a decay: all weights go to zero soon, and the other goes on."""
    (X, hard), easy = data(13), np.zeros((40, 2))
    decay = 0.5 if trainer == "gradient-descent" else 0.05
    machine = BackpropRegressor(3, trainer, 80, 0.4, weight_decay=decay, scaling="none")
    quick, slow = machine.fit_many([X, X + 1], [easy, 100 * hard])
    _, steps, _ = by_hand(quick, X, easy, 0)
    assert quick.steps_[0] == steps < slow.steps_[0]
    assert np.abs(quick.weights_).max() < 1e-5


@pytest.mark.parametrize("outputs", [1, 3])
def test_it_predicts_as_the_network_of_scikit_learn(outputs: int) -> None:
    """Their network, given our weights."""
    X, y = data(1, outputs=outputs)
    machine = BackpropRegressor(hidden=4, epochs=3, scaling="none").fit(X, y)
    W1, b1, W2, b2 = parts(machine.weights_[0], 4, 2, outputs)
    theirs = MLPRegressor(hidden_layer_sizes=(4,), activation="tanh", max_iter=1)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # it has not converged
        theirs.fit(X, y if outputs > 1 else y[:, 0])
    theirs.coefs_, theirs.intercepts_ = [W1.T, W2.T], [b1, b2]
    assert machine.predict(X) == pytest.approx(theirs.predict(X).reshape(y.shape), abs=1e-12)


@pytest.mark.parametrize("hidden", [1, 9])
def test_the_first_weights_spread_the_bends_over_the_data(hidden: int) -> None:
    """Nguyen and Widrow: rows of length 0.7 h^(1/d) for data on [-1, 1], offsets evenly to that."""
    rng = np.random.default_rng(3)
    X, y = rng.uniform(-1, 1, size=(30, 2)), rng.normal(size=(30, 3))
    X[:2] = [-1, -1], [1, 1]
    size = 0.7 * hidden**0.5
    evenly = size * np.linspace(-1, 1, hidden) if hidden > 1 else np.zeros(1)
    for move, stretch in ((0.0, 1.0), (np.array([5.0, -2.0]), np.array([0.1, 40.0]))):
        machine = BackpropRegressor(hidden=hidden, scaling="none")
        start = machine._prepare(X * stretch + move, y)[2][0]
        W1, b1, W2, b2 = parts(start, hidden, 2, 3)
        rows, offsets = W1 * stretch, b1 + W1 @ (move * np.ones(2))
        assert np.linalg.norm(rows, axis=1) == pytest.approx(np.full(hidden, size))
        assert offsets * np.sign(rows[:, 0]) == pytest.approx(evenly, abs=1e-12)
        last = np.concatenate([W2.ravel(), b2])
        assert -1 <= last.min() < 0 < last.max() <= 1


def test_a_column_that_does_not_vary_spreads_nothing() -> None:
    start = BackpropRegressor(4)._prepare(np.ones((5, 1)), np.zeros((5, 1)))[2]
    assert np.isfinite(start).all()


@pytest.mark.parametrize(("share", "held"), [(0.0, 0), (0.15, 3), (0.24, 5), (0.9, 18), (0.99, 19)])
def test_a_share_is_held_back_and_one_sample_is_left_to_train(share: float, held: int) -> None:
    X, y = data(4, n=20)
    trains = BackpropRegressor(validation_share=share, networks=3)._prepare(X, y)[3]
    assert (~trains).sum(axis=1).tolist() == [held] * 3
    assert held in (0, 19) or len(np.unique(trains, axis=0)) == 3


def test_the_trainers_agree_on_the_optimum() -> None:
    """The best of six starts of a small problem with weight decay, by two ways."""
    X, y = data(7, n=25)
    found = []
    for trainer, epochs in zip(TRAINERS, (300, 6000), strict=True):
        machine = BackpropRegressor(2, trainer, epochs, 0.1, 0.9, weight_decay=0.02, networks=6)
        machine.fit(X, y)
        found.append(np.min(machine.losses_ + 0.02 * np.sum(machine.weights_**2, axis=1)))
    assert found == pytest.approx([found[0]] * 2, rel=1e-6)


@pytest.mark.parametrize("scaling", ["range", "standard"])
def test_units_change_nothing_but_the_units(scaling: Any) -> None:
    X, y = data(14)
    new = data(15)[0]
    sizes, moves = np.array([1000.0, 0.02]), np.array([-7.0, 300.0])
    plain, other = (BackpropRegressor(4, epochs=6, scaling=scaling, networks=2) for _ in range(2))
    plain.fit(X, y)
    other.fit(X * sizes + moves, y * [0.5, 60.0] + [9.0, -2.0])
    expected = plain.predict(new) * [0.5, 60.0] + [9.0, -2.0]
    assert other.predict(new * sizes + moves) == pytest.approx(expected, rel=1e-6, abs=1e-6)
    assert other.losses_ == pytest.approx(plain.losses_)
    assert plain.predict_each(new).shape == (2, 40, 2)
    assert plain.predict(new) == pytest.approx(plain.predict_each(new).mean(axis=0))
    unscaled = BackpropRegressor(4, epochs=6, scaling="none", networks=2).fit(X, y).predict(new)
    assert np.abs(unscaled - plain.predict(new)).max() > 1e-3


@contextmanager
def threads(number: int) -> Iterator[None]:
    before = torch.get_num_threads()
    torch.set_num_threads(number)
    try:
        yield
    finally:
        torch.set_num_threads(before)


@pytest.mark.parametrize("trainer", TRAINERS)
def test_it_repeats_itself_bit_for_bit_whatever_the_threads(trainer: Any) -> None:
    X, y = data(11, n=3000)
    found = []
    for number in (1, 2, 1):
        with threads(number):
            machine = BackpropRegressor(20, trainer, 3, networks=4)
            found.append((machine.fit(X, y).weights_, machine.predict(X)))
            assert torch.get_num_threads() == number
    for weights, predicted in found[1:]:
        assert np.array_equal(weights, found[0][0])
        assert np.array_equal(predicted, found[0][1])
    other = BackpropRegressor(20, trainer, 3, networks=4, random_state=1)
    assert np.abs(other.fit(X, y).weights_ - found[0][0]).max() > 1e-3


@pytest.mark.parametrize("trainer", TRAINERS)
def test_many_networks_and_data_sets_at_once_are_each_trained_as_alone(trainer: Any) -> None:
    sets, scale = [data(seed) for seed in range(20, 23)], [1.0, 10.0, 0.1]
    Xs, ys = [X for X, _ in sets], [s * y for s, (_, y) in zip(scale, sets, strict=True)]
    machine = BackpropRegressor(4, trainer, 12, networks=2, random_state=5, validation_share=0.25)
    together = machine.fit_many(Xs, ys)
    assert not hasattr(machine, "weights_")
    for i, (X, y) in enumerate(zip(Xs, ys, strict=True)):
        alone = BackpropRegressor(**machine.get_params() | {"random_state": 5 + i}).fit(X, y)
        assert together[i].get_params() == alone.get_params()
        assert together[i].weights_ == pytest.approx(alone.weights_, rel=1e-7, abs=1e-9)
        assert together[i].losses_ == pytest.approx(alone.losses_, rel=1e-7)
        assert together[i].steps_.tolist() == alone.steps_.tolist()
        assert together[i].predict(X) == pytest.approx(alone.predict(X), abs=1e-7 * scale[i])
        one = BackpropRegressor(**alone.get_params() | {"networks": 1}).fit(X, y)
        assert alone.weights_[:1] == pytest.approx(one.weights_, rel=1e-7, abs=1e-9)
        assert np.abs(alone.weights_[1] - alone.weights_[0]).max() > 1e-3
    (again,) = machine.fit_many(Xs[2:], ys[2:], [2])
    assert again.weights_ == pytest.approx(together[2].weights_, rel=1e-7, abs=1e-9)
    assert machine.fit_many([], []) == []


def test_steps_that_overflow_leave_the_best_weights() -> None:
    X, y = data(16)
    for rate in (10.0, 1e300):
        machine = BackpropRegressor(5, "gradient-descent", 2000, rate, 0.99, networks=3).fit(X, y)
        tiny = BackpropRegressor(5, "gradient-descent", 1, 1e-300, networks=3).fit(X, y)
        assert np.isfinite(machine.weights_).all()
        assert (machine.losses_ <= tiny.losses_ * (1 + 1e-12)).all()
    assert machine.weights_ == pytest.approx(tiny.weights_)  # no step was a good one
    assert machine.steps_.max() < 100  # and the network is given up


@pytest.mark.parametrize("trainer", TRAINERS)
def test_a_network_that_overflows_holds_up_no_other(trainer: Any) -> None:
    X, y = data(16, n=15)
    machine = BackpropRegressor(2, trainer, 150, 0.01, 0.9, scaling="none")
    for broken, beside in both(lambda: machine.fit_many([X, X], [1e200 * y, y], [1, 2])):
        (alone,) = machine.fit_many([X], [y], [2])
        assert broken.steps_.max() < 100
        assert beside.weights_ == pytest.approx(alone.weights_, rel=1e-6)
        assert beside.steps_ == alone.steps_


def test_a_damping_that_has_fallen_far_can_rise_again() -> None:
    """A case in which the damping fell to zero, where no factor raises it: no step ended."""
    rng = np.random.default_rng(43)
    X = rng.uniform(-1, 1, (30, 1))
    y = np.sin(5 * X[:, 0]) * X[:, 0] ** 2 + 3 * rng.normal(size=30)
    machine = BackpropRegressor(1, epochs=600, weight_decay=1e-2, networks=5).fit(X, y)
    assert machine.steps_.max() > 325  # at a tenth a step, below the least positive number
    assert np.isfinite(machine.losses_).all()


def fit(machine: BackpropRegressor) -> Any:
    return machine.fit([[0.0], [1.0]], [0.0, 1.0])


def fit_many(machine: BackpropRegressor) -> Any:
    return machine.fit_many([[[0.0], [1.0]]], [[0.0, 1.0]])


@pytest.mark.parametrize("call", [fit, fit_many])
@pytest.mark.parametrize(
    "parameters",
    [
        {"hidden": 0}, {"hidden": 2.0}, {"epochs": 0}, {"patience": 0}, {"networks": 0},
        {"random_state": -1}, {"random_state": None}, {"learning_rate": 0.0}, {"momentum": 1.0},
        {"momentum": -0.1}, {"weight_decay": -1e-9}, {"validation_share": 1.0},
        {"validation_share": -0.1}, {"trainer": "l-bfgs"}, {"scaling": "log"},
    ],
)  # fmt: skip
def test_a_parameter_that_cannot_be_is_refused(
    call: Callable[[BackpropRegressor], Any], parameters: dict[str, Any]
) -> None:
    *_, (name, value) = parameters.items()
    with pytest.raises(ParameterError, match=rf"{name} .* not {value!r}"):
        call(BackpropRegressor(**parameters))


def test_data_sets_that_do_not_fit_together_are_refused() -> None:
    X, y = data(17)
    with pytest.raises(ParameterError, match="the shapes of Xs and ys must be"):
        BackpropRegressor().fit_many([X, X[1:]], [y, y[1:]])
    with pytest.raises(ParameterError, match="must be of the same length, not 2, 1 and 2"):
        BackpropRegressor().fit_many([X, X], [y])
