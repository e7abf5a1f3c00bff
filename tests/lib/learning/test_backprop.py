"""Back-propagation against autograd, steps by hand, limits, and its promise to repeat itself."""

from __future__ import annotations

import warnings
from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np
import pytest
import torch
from hypothesis import given, settings, strategies as st
from sklearn.exceptions import SkipTestWarning
from sklearn.neural_network import MLPRegressor
from sklearn.utils.estimator_checks import check_estimator

from inswsn_lib.errors import ParameterError
from inswsn_lib.learning import BackpropRegressor
from inswsn_lib.learning.backprop import _normal_equations, _Shape, _Work

TRAINERS = ["levenberg-marquardt", "gradient-descent", "l-bfgs"]


def data(seed: int, n: int = 40, outputs: int = 2) -> tuple[np.ndarray, np.ndarray]:
    """Return a smooth map of two inputs, with noise."""
    rng = np.random.default_rng(seed)
    X = rng.uniform(-2, 3, size=(n, 2))
    clean = np.stack([np.sin((i + 1) * X[:, 0]) + X[:, 1] for i in range(outputs)], axis=1)
    return X, clean + 0.1 * rng.normal(size=clean.shape)


class ByHand:
    """One network in numpy, with back-propagation written out."""

    def __init__(self, start: np.ndarray, X: np.ndarray, y: np.ndarray, decay: float) -> None:
        self.X, self.y, self.decay = X, y, decay
        d, o = X.shape[1], y.shape[1]
        self.h = (len(start) - o) // (d + 1 + o)
        self.ends = np.cumsum([self.h * d, self.h, o * self.h])

    def parts(self, w: np.ndarray) -> list[np.ndarray]:
        W1, b1, W2, b2 = np.split(w, self.ends)
        return [W1.reshape(self.h, -1), b1, W2.reshape(-1, self.h), b2]

    def error(self, w: np.ndarray, of: np.ndarray) -> float:
        W1, b1, W2, b2 = self.parts(w)
        residual = np.tanh(self.X[of] @ W1.T + b1) @ W2.T + b2 - self.y[of]
        return float(np.mean(residual**2))

    def gradient(self, w: np.ndarray, of: np.ndarray) -> np.ndarray:
        W1, b1, W2, b2 = self.parts(w)
        bent = np.tanh(self.X[of] @ W1.T + b1)
        residual = bent @ W2.T + b2 - self.y[of]
        out = 2 * residual / residual.size
        back = out @ W2 * (1 - bent**2)
        flat = [back.T @ self.X[of], back.sum(axis=0), out.T @ bent, out.sum(axis=0)]
        return np.concatenate([part.ravel() for part in flat]) + 2 * self.decay * w


@contextmanager
def threads(number: int) -> Iterator[None]:
    before = torch.get_num_threads()
    torch.set_num_threads(number)
    try:
        yield
    finally:
        torch.set_num_threads(before)


@pytest.mark.parametrize(
    "parameters",
    [
        {"trainer": "levenberg-marquardt"},
        {"trainer": "l-bfgs"},
        {"trainer": "gradient-descent", "learning_rate": 0.1, "momentum": 0.9},
        {"validation_share": 0.2, "networks": 3, "scaling": "standard"},
    ],
)
def test_it_is_an_estimator(parameters: dict[str, object]) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", SkipTestWarning)  # of a check that needs a setting of scipy
        warnings.simplefilter("ignore", UserWarning)  # of torch, of arrays that cannot be written
        check_estimator(BackpropRegressor(epochs=60, **parameters))  # type: ignore[arg-type]


def some_work(
    seed: int, inputs: int, hidden: int, outputs: int, decay: float
) -> tuple[_Work, torch.Tensor]:
    """Return three networks, each with its own data and samples held back."""
    rng = np.random.default_rng(seed)
    shape, samples = _Shape(inputs, hidden, outputs), 6
    trains = rng.random((3, samples)) < 0.6
    trains[:, 0] = True
    work = _Work(
        shape,
        torch.from_numpy(rng.normal(size=(3, samples, inputs))),
        torch.from_numpy(rng.normal(size=(3, samples, outputs))),
        torch.from_numpy(trains),
        decay,
    )
    size = hidden * (inputs + 1) + outputs * (hidden + 1)
    return work, torch.from_numpy(rng.normal(size=(3, size)))


@settings(deadline=None, max_examples=30)
@given(
    st.integers(0, 10**6), st.integers(1, 3), st.integers(1, 4), st.integers(1, 3),
    st.sampled_from([0.0, 0.3]),
)  # fmt: skip
def test_the_normal_equations_are_those_of_autograd(
    seed: int, inputs: int, hidden: int, outputs: int, decay: float
) -> None:
    """J by forward differentiation of the residuals, each weighted by the root of its share."""
    work, weights = some_work(seed, inputs, hidden, outputs, decay)
    normal, slope = _normal_equations(work, weights)
    for i in range(3):
        own = work.trains[i]
        x, t, w = work.inputs[i, own], work.targets[i, own], weights[i]

        def residual(w: torch.Tensor, x: torch.Tensor = x, t: torch.Tensor = t) -> torch.Tensor:
            return (work.shape.forward(w, x) - t).flatten() / np.sqrt(t.numel())

        J, r = torch.func.jacfwd(residual)(w), residual(w)
        expected = (J.T @ J).numpy() + decay * np.eye(len(w))
        assert normal[i].numpy() == pytest.approx(expected, rel=1e-9, abs=1e-11)
        assert slope[i].numpy() == pytest.approx((J.T @ r + decay * w).numpy(), rel=1e-9, abs=1e-11)
    half = work.gradients(weights).numpy() / 2
    assert slope.numpy() == pytest.approx(half, rel=1e-9, abs=1e-11)


@pytest.mark.parametrize("outputs", [1, 3])
def test_it_predicts_as_the_network_of_scikit_learn(outputs: int) -> None:
    """Their network, given our weights."""
    X, y = data(1, outputs=outputs)
    machine = BackpropRegressor(hidden=4, epochs=3, scaling="none").fit(X, y)
    W1, b1, W2, b2 = ByHand(machine.weights_[0], X, y, 0).parts(machine.weights_[0])
    theirs = MLPRegressor(hidden_layer_sizes=(4,), activation="tanh", max_iter=1)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # it has not converged
        theirs.fit(X, y if outputs > 1 else y[:, 0])
    theirs.coefs_, theirs.intercepts_ = [W1.T, W2.T], [b1, b2]
    assert machine.predict(X) == pytest.approx(theirs.predict(X).reshape(y.shape), abs=1e-12)


def test_the_first_weights_spread_the_bends_over_the_data() -> None:
    """Nguyen and Widrow: rows of length 0.7 h^(1/d) for data on [-1, 1], offsets evenly to that."""
    hidden, rng = 9, np.random.default_rng(3)
    X, y = rng.uniform(-1, 1, size=(30, 2)), rng.normal(size=(30, 1))
    X[:2] = [-1, -1], [1, 1]
    for move, stretch in ((0.0, 1.0), (np.array([5.0, -2.0]), np.array([0.1, 40.0]))):
        machine = BackpropRegressor(hidden=hidden, scaling="none")
        start = machine._prepared(X * stretch + move, y).start[0]
        W1, b1, W2, b2 = ByHand(start, X, y, 0).parts(start)
        rows, offsets = W1 * stretch, b1 + W1 @ (move * np.ones(2))
        size = 0.7 * hidden**0.5
        assert np.linalg.norm(rows, axis=1) == pytest.approx(np.full(hidden, size))
        assert np.abs(offsets) == pytest.approx(size * np.abs(np.linspace(-1, 1, hidden)))
        assert np.abs(np.concatenate([W2.ravel(), b2])).max() <= 1


@pytest.mark.parametrize("decay", [0.0, 0.2])
def test_a_first_step_down_the_gradient_by_hand(decay: float) -> None:
    X, y = data(2)
    machine = BackpropRegressor(
        5, "gradient-descent", 1, learning_rate=1e-3, weight_decay=decay, scaling="none"
    )
    start = machine._prepared(X, y).start[0]
    hand, everyone = ByHand(start, X, y, decay), np.arange(len(X))
    expected = start - 1e-3 * hand.gradient(start, everyone)
    machine.fit(X, y)
    assert machine.weights_[0] == pytest.approx(expected, abs=1e-12)
    assert machine.losses_[0] == pytest.approx(hand.error(expected, everyone))
    assert machine.steps_.tolist() == [1]


def test_a_first_step_of_levenberg_and_marquardt_by_hand() -> None:
    """(J'J + (decay + damping) I) step = -(J'r + decay w), with the first damping 0.001."""
    X, y = data(3)
    machine = BackpropRegressor(3, epochs=1, weight_decay=0.05, scaling="none")
    start = machine._prepared(X, y).start[0]
    hand = ByHand(start, X, y, 0.05)

    def residual(w: np.ndarray) -> np.ndarray:
        W1, b1, W2, b2 = hand.parts(w)
        return (np.tanh(X @ W1.T + b1) @ W2.T + b2 - y).ravel() / np.sqrt(y.size)

    nudges = 1e-6 * np.eye(len(start))
    J = np.stack([(residual(start + e) - residual(start - e)) / 2e-6 for e in nudges], axis=1)
    damped = J.T @ J + (0.05 + 1e-3) * np.eye(len(start))
    step = -np.linalg.solve(damped, J.T @ residual(start) + 0.05 * start)
    machine.fit(X, y)
    assert machine.weights_[0] == pytest.approx(start + step, abs=1e-6)


@pytest.mark.parametrize("momentum", [0.0, 0.8])
def test_early_stopping_by_hand(momentum: float) -> None:
    """Gradient descent in numpy that keeps the least error on the samples held back."""
    X, y = data(4, n=15, outputs=1)
    rate, patience, epochs = 0.2, 3, 400
    machine = BackpropRegressor(
        8, "gradient-descent", epochs, rate, momentum, validation_share=0.4, patience=patience,
        scaling="standard", networks=6,
    ).fit(X, y)  # fmt: skip
    job = machine._prepared(X, y)
    assert ((~job.trains).sum(axis=1) == 6).all()
    early = []
    for i in range(6):
        hand, w = ByHand(job.start[i], job.inputs, job.targets, 0), job.start[i]
        trains, held = np.flatnonzero(job.trains[i]), np.flatnonzero(~job.trains[i])
        best, least, failures, speed, steps = w, hand.error(w, held), 0, np.zeros_like(w), 0
        while steps < epochs and failures < patience:
            speed = momentum * speed - rate * hand.gradient(w, trains)
            w, steps, failures = w + speed, steps + 1, failures + 1
            if hand.error(w, held) < least:
                best, least, failures = w, hand.error(w, held), 0
        assert machine.steps_[i] == steps
        assert machine.weights_[i] == pytest.approx(best, abs=1e-8)
        assert machine.losses_[i] == pytest.approx(hand.error(best, trains))
        early.append(steps < epochs)
    assert any(early)


@pytest.mark.parametrize("trainer", TRAINERS[:2])
def test_more_steps_never_make_it_worse_on_what_is_watched(trainer: str) -> None:
    X, y = data(5, n=20, outputs=1)

    def errors(epochs: int) -> np.ndarray:
        machine = BackpropRegressor(
            10, trainer, epochs, 0.05, validation_share=0.3, patience=100, networks=3  # type: ignore[arg-type]
        ).fit(X, y)  # fmt: skip
        job = machine._prepared(X, y)
        return np.array([
            ByHand(w, job.inputs, job.targets, 0).error(w, np.flatnonzero(~trains))
            for w, trains in zip(machine.weights_, job.trains, strict=True)
        ])  # fmt: skip

    watched = np.array([errors(epochs) for epochs in (1, 2, 3, 5, 8, 13, 21, 34)])
    assert (np.diff(watched, axis=0) <= 0).all()
    assert (watched[-1] < watched[0]).all()


def test_of_few_samples_one_is_left_to_train() -> None:
    X, y = [[0.0], [1.0]], [0.0, 1.0]
    machine = BackpropRegressor(2, validation_share=0.9, epochs=20).fit(X, y)
    assert np.isfinite(machine.losses_).all()
    assert BackpropRegressor(validation_share=0.9)._prepared(X, y).trains.sum() == 1


@pytest.mark.parametrize("trainer", ["levenberg-marquardt", "l-bfgs"])
def test_a_linear_target_is_learnt(trainer: str) -> None:
    """A network with small first weights is as linear as one likes."""
    X, _ = data(6)
    y = X @ np.array([[2.0, -1.0], [0.5, 3.0]]) + [1.0, -4.0]
    machine = BackpropRegressor(4, trainer, 3000).fit(X, y)  # type: ignore[arg-type]
    assert machine.losses_[0] < 1e-6
    assert machine.predict(X) == pytest.approx(y, abs=0.05)


def test_gradient_descent_learns_a_linear_target_too() -> None:
    """Less well: it is left with a tenth of a percent of the variance, of which 1/3 is all."""
    X, _ = data(6)
    y = X @ [2.0, -1.0]
    machine = BackpropRegressor(3, "gradient-descent", 2000, 0.1, 0.9).fit(X, y)
    assert machine.losses_[0] < 1e-3 * np.var(y / np.ptp(y) * 2)


def test_the_trainers_agree_on_the_optimum() -> None:
    """The best of six starts of a small problem with weight decay, by three ways."""
    X, y = data(7, n=25)
    decay, found = 0.02, []
    for trainer, epochs in (("levenberg-marquardt", 300), ("gradient-descent", 6000),
                            ("l-bfgs", 2000)):  # fmt: skip
        machine = BackpropRegressor(
            2, trainer, epochs, 0.1, 0.9, weight_decay=decay, networks=6  # type: ignore[arg-type]
        ).fit(X, y)  # fmt: skip
        found.append(np.min(machine.losses_ + decay * np.sum(machine.weights_**2, axis=1)))
    assert found == pytest.approx([found[0]] * 3, rel=1e-6)


@pytest.mark.parametrize("trainer", TRAINERS)
def test_without_bound_the_weight_decay_leaves_the_mean(trainer: str) -> None:
    """All parameters go to 0, which is the mean in units of mean 0 and deviation 1."""
    X, y = data(8)
    rate = 0.4 / 1e6  # below 1 / decay, so that descent converges
    machine = BackpropRegressor(
        5, trainer, 200, rate, weight_decay=1e6, scaling="standard"  # type: ignore[arg-type]
    ).fit(X, y)  # fmt: skip
    assert machine.predict(X) == pytest.approx(np.tile(y.mean(axis=0), (len(X), 1)), abs=1e-4)


def test_the_loss_is_that_of_the_predictions() -> None:
    X, y = data(9)
    machine = BackpropRegressor(6, epochs=5, scaling="standard", networks=3).fit(X, y)
    each = machine.predict_each(X)
    assert each.shape == (3, 40, 2)
    assert machine.losses_ == pytest.approx((((each - y) / y.std(axis=0)) ** 2).mean(axis=(1, 2)))
    assert machine.predict(X) == pytest.approx(each.mean(axis=0))
    assert np.ptp(each, axis=0).max() > 1e-3  # they are not all one network


def test_the_shape_of_the_targets_is_that_of_the_predictions() -> None:
    X, y = data(10, outputs=1)
    column = BackpropRegressor(4, epochs=5, networks=2).fit(X, y)
    flat = BackpropRegressor(4, epochs=5, networks=2).fit(X, y[:, 0])
    assert column.predict(X).shape == (40, 1)
    assert column.predict_each(X).shape == (2, 40, 1)
    assert flat.predict_each(X).shape == (2, 40)
    assert np.array_equal(column.predict(X)[:, 0], flat.predict(X))


@pytest.mark.parametrize("trainer", TRAINERS)
def test_it_repeats_itself_bit_for_bit_whatever_the_threads(trainer: str) -> None:
    X, y = data(11, n=3000)
    found = []
    for number in (1, 2, 1):
        with threads(number):
            machine = BackpropRegressor(20, trainer, 6, networks=4)  # type: ignore[arg-type]
            found.append((machine.fit(X, y).weights_, machine.predict(X)))
            assert torch.get_num_threads() == number
    for weights, predicted in found[1:]:
        assert np.array_equal(weights, found[0][0])
        assert np.array_equal(predicted, found[0][1])
    other = BackpropRegressor(20, trainer, 6, networks=4, random_state=1)  # type: ignore[arg-type]
    assert np.abs(other.fit(X, y).weights_ - found[0][0]).max() > 1e-3


@pytest.mark.parametrize("trainer", TRAINERS)
def test_a_network_does_not_depend_on_those_beside_it(trainer: str) -> None:
    X, y = data(12)
    one, many = (
        BackpropRegressor(5, trainer, 15, networks=n, random_state=3).fit(X, y)  # type: ignore[arg-type]
        for n in (1, 4)
    )
    assert many.weights_[:1] == pytest.approx(one.weights_, rel=1e-7, abs=1e-9)
    two = BackpropRegressor(5, networks=2, random_state=3, validation_share=0.3)._prepared(X, y)
    four = BackpropRegressor(5, networks=4, random_state=3, validation_share=0.3)._prepared(X, y)
    assert np.array_equal(four.start[:2], two.start)
    assert np.array_equal(four.trains[:2], two.trains)
    assert len(np.unique(four.start, axis=0)) == 4


@pytest.mark.parametrize("trainer", TRAINERS)
@pytest.mark.parametrize("held", [0.0, 0.25])
def test_many_data_sets_at_once_are_each_trained_as_alone(trainer: str, held: float) -> None:
    if held and trainer == "l-bfgs":
        held = 0.0
    sets = [data(seed) for seed in range(20, 24)]
    scale = [1.0, 10.0, 0.1, 3.0]
    Xs, ys = [X for X, _ in sets], [s * y for s, (_, y) in zip(scale, sets, strict=True)]
    machine = BackpropRegressor(
        4, trainer, 12, networks=2, random_state=5, validation_share=held  # type: ignore[arg-type]
    )  # fmt: skip
    together = machine.fit_many(Xs, ys)
    assert not hasattr(machine, "weights_")
    for i, (X, y) in enumerate(zip(Xs, ys, strict=True)):
        alone = BackpropRegressor(**machine.get_params() | {"random_state": 5 + i}).fit(X, y)
        assert together[i].get_params() == alone.get_params()
        assert together[i].weights_ == pytest.approx(alone.weights_, rel=1e-7, abs=1e-9)
        assert together[i].losses_ == pytest.approx(alone.losses_, rel=1e-7)
        assert together[i].steps_.tolist() == alone.steps_.tolist()
        assert together[i].predict(X) == pytest.approx(alone.predict(X), abs=1e-7 * scale[i])


def test_no_data_sets_are_no_machines() -> None:
    assert BackpropRegressor().fit_many([], []) == []


@pytest.mark.parametrize("trainer", TRAINERS[:2])
def test_a_finished_network_stays_as_it_is_while_others_go_on(trainer: str) -> None:
    """Targets of zero and a decay: all weights go to zero soon, and the other goes on."""
    (X, hard), easy = data(13), np.zeros((40, 2))
    machine = BackpropRegressor(
        3, trainer, 80, 0.4, weight_decay=0.5, scaling="none"  # type: ignore[arg-type]
    )  # fmt: skip
    if trainer == "levenberg-marquardt":
        machine.set_params(weight_decay=0.05)
    quick, slow = machine.fit_many([X, X + 1], [easy, 100 * hard])
    alone = BackpropRegressor(**machine.get_params()).fit(X, easy)
    assert quick.steps_[0] < slow.steps_[0]
    assert quick.steps_[0] == alone.steps_[0]
    assert quick.weights_ == pytest.approx(alone.weights_, rel=1e-6, abs=1e-9)
    assert np.abs(quick.weights_).max() < 1e-5


@pytest.mark.parametrize("scaling", ["range", "standard"])
def test_units_change_nothing_but_the_units(scaling: str) -> None:
    X, y = data(14)
    new = data(15)[0]
    sizes, moves = np.array([1000.0, 0.02]), np.array([-7.0, 300.0])
    plain = BackpropRegressor(4, epochs=6, scaling=scaling)  # type: ignore[arg-type]
    other = BackpropRegressor(4, epochs=6, scaling=scaling)  # type: ignore[arg-type]
    plain.fit(X, y)
    other.fit(X * sizes + moves, y * [0.5, 60.0] + [9.0, -2.0])
    expected = plain.predict(new) * [0.5, 60.0] + [9.0, -2.0]
    assert other.predict(new * sizes + moves) == pytest.approx(expected, rel=1e-6, abs=1e-6)
    unscaled = BackpropRegressor(4, epochs=6, scaling="none").fit(X, y).predict(new)
    assert np.abs(unscaled - plain.predict(new)).max() > 1e-3


@pytest.mark.parametrize("scaling", ["range", "standard"])
def test_a_column_that_does_not_vary_is_only_moved(scaling: str) -> None:
    """0.1 thirty times has a deviation of 3e-17, which is no unit to measure 0.2 with."""
    X, y = np.full((30, 2), 0.1), np.full((30, 1), 0.1)
    X[:, 0] = np.linspace(0, 1, 30)
    machine = BackpropRegressor(3, epochs=20, scaling=scaling).fit(X, y)  # type: ignore[arg-type]
    assert machine._inputs_scale.there(X[:1] + np.array([0.0, 0.25]))[0, 1] == pytest.approx(0.25)
    assert machine._targets_scale.size == pytest.approx([1.0])


def test_steps_that_overflow_leave_the_best_weights() -> None:
    X, y = data(16)
    for rate in (10.0, 1e300):
        machine = BackpropRegressor(5, "gradient-descent", 2000, rate, 0.99, networks=3).fit(X, y)
        job = machine._prepared(X, y)
        before = [
            ByHand(w, job.inputs, job.targets, 0).error(w, np.arange(len(X))) for w in job.start
        ]
        assert np.isfinite(machine.weights_).all()
        assert (machine.losses_ <= np.array(before) * (1 + 1e-12)).all()
    assert machine.weights_ == pytest.approx(job.start)  # no step was a good one
    assert machine.steps_.max() < 100  # and the network is given up


@pytest.mark.parametrize(
    ("parameters", "said"),
    [
        ({"hidden": 0}, "hidden is 0"),
        ({"hidden": 2.0}, "hidden is 2.0"),
        ({"hidden": True}, "hidden is True"),
        ({"trainer": "adam"}, "trainer is 'adam'"),
        ({"epochs": 0}, "epochs is 0"),
        ({"learning_rate": 0.0}, "learning_rate is 0.0"),
        ({"learning_rate": float("inf")}, "learning_rate is inf"),
        ({"momentum": 1.0}, "momentum is 1.0"),
        ({"momentum": -0.1}, "momentum is -0.1"),
        ({"momentum": "much"}, "momentum is 'much'"),
        ({"weight_decay": -1e-9}, "weight_decay is -1e-09"),
        ({"weight_decay": float("nan")}, "weight_decay is nan"),
        ({"weight_decay": float("inf")}, "weight_decay is inf"),
        ({"weight_decay": None}, "weight_decay is None"),
        ({"validation_share": 1.0}, "validation_share is 1.0"),
        ({"validation_share": True}, "validation_share is True"),
        ({"trainer": "l-bfgs", "validation_share": 0.2}, "validation_share is 0.2"),
        ({"patience": 0}, "patience is 0"),
        ({"scaling": "log"}, "scaling is 'log'"),
        ({"networks": 0}, "networks is 0"),
        ({"random_state": -1}, "random_state is -1"),
        ({"random_state": None}, "random_state is None"),
    ],
)
def test_a_parameter_that_cannot_be_is_refused(parameters: dict[str, object], said: str) -> None:
    X, y = [[0.0], [1.0]], [0.0, 1.0]
    machine = BackpropRegressor(**parameters)  # type: ignore[arg-type]
    with pytest.raises(ParameterError, match=said):
        machine.fit(X, y)
    with pytest.raises(ParameterError, match=said):
        machine.fit_many([X], [y])


def test_data_sets_that_do_not_fit_together_are_refused() -> None:
    X, y = data(17)
    machine = BackpropRegressor(epochs=1)
    with pytest.raises(ParameterError, match="of one shape"):
        machine.fit_many([X, X[1:]], [y, y[1:]])
    with pytest.raises(ParameterError, match="Xs, ys and numbers is '2, 1 and 2'"):
        machine.fit_many([X, X], [y])


def test_every_step_of_levenberg_and_marquardt_lowers_the_loss() -> None:
    """Damping is raised within a step until the loss falls, so no step is lost."""
    X, y = data(23)
    losses = [
        BackpropRegressor(6, epochs=n, networks=3, random_state=2).fit(X, y).losses_
        for n in range(1, 16)
    ]
    assert (np.diff(losses, axis=0) < 0).all()


def test_a_damping_that_has_fallen_far_can_rise_again() -> None:
    """A case in which the damping fell to zero, where no factor raises it: no step ended."""
    rng = np.random.default_rng(43)
    X = rng.uniform(-1, 1, (30, 1))
    y = np.sin(5 * X[:, 0]) * X[:, 0] ** 2 + 3 * rng.normal(size=30)
    machine = BackpropRegressor(1, epochs=600, weight_decay=1e-2, networks=5).fit(X, y)
    assert machine.steps_.max() > 325  # at a tenth a step, below the least positive number
    assert np.isfinite(machine.losses_).all()
