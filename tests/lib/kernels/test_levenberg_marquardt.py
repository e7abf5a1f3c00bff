"""The training of networks, compiled and not: alike, and its step that of least squares.

`test_backprop` trains by hand beside it.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from inswsn_lib.kernels import choose, levenberg_marquardt as source
from inswsn_lib.learning.backprop import _RULES

compiled = choose("levenberg_marquardt")
Arrays = tuple[np.ndarray, ...]


def networks(
    seed: int, inputs: int, hidden: int, outputs: int, samples: int, count: int = 4
) -> Arrays:
    """Return inputs, targets, who trains, and first weights."""
    rng = np.random.default_rng(seed)
    X = rng.uniform(-1, 1, (count, samples, inputs))
    Y = np.sin(3 * X.sum(axis=2))[:, :, None] + 0.3 * rng.normal(size=(count, samples, outputs))
    weights = rng.normal(size=(count, hidden * (inputs + 1) + outputs * (hidden + 1)))
    return X, Y, np.ones((count, samples), dtype=bool), weights


def both(arrays: Arrays, decay: float, epochs: int, patience: int = 6) -> tuple[Any, Any]:
    """Train both ways; neither changes what it is given."""
    before = [a.copy() for a in arrays]
    found = [
        train(*arrays, decay, epochs, patience, _RULES)
        for train in (compiled, source.levenberg_marquardt)
    ]
    assert all(np.array_equal(a, b, equal_nan=True) for a, b in zip(arrays, before, strict=True))
    return found[0], found[1]


@pytest.mark.parametrize("seed", range(8))
def test_both_train_alike(seed: int) -> None:
    rng = np.random.default_rng(seed)
    inputs, hidden, outputs, samples = rng.integers([1, 1, 1, 12], [5, 9, 5, 40])
    X, Y, trains, weights = networks(seed, inputs, hidden, outputs, samples)
    if seed % 2:  # each network has another number of samples that train
        trains[:] = rng.random(trains.shape) < rng.uniform(0.3, 0.9, (len(X), 1))
        trains[:, 0] = True
    (ours, steps), (plain, told) = both((X, Y, trains, weights), (0.0, 1e-3)[seed // 2 % 2], 8, 2)
    assert ours == pytest.approx(plain, rel=1e-6, abs=1e-8)
    assert steps.tolist() == told.tolist()
    assert np.abs(ours - weights).max() > 1e-3


def test_each_network_stops_at_its_own_time() -> None:
    """One that is done at once, one that is soon, and one that goes on."""
    X, Y, trains, weights = networks(3, 2, 3, 2, 25, count=3)
    Y[:2], weights[0] = 0, 0
    (ours, steps), (plain, told) = both((X, Y, trains, weights), 0.05, 60)
    assert ours == pytest.approx(plain, rel=1e-5, abs=1e-8)
    assert steps.tolist() == told.tolist()
    assert 1 == steps[0] < steps[1] < steps[2]


@pytest.mark.parametrize("value", [np.nan, np.inf, 1e200])
def test_data_beyond_numbers_stop_one_network_alone(value: float) -> None:
    arrays = networks(4, 1, 2, 1, 15)
    arrays[1][1, 3] = value
    (ours, steps), (plain, told) = both(arrays, 0.0, 5)
    assert steps.tolist() == told.tolist() == [5, 1, 5, 5]
    assert np.array_equal(ours[1], arrays[3][1])
    assert np.array_equal(plain[1], arrays[3][1])
    assert ours == pytest.approx(plain, rel=1e-6)


def test_the_step_is_damped_gauss_newton_by_least_squares() -> None:
    """One sample trains, the Jacobian by differences: a step of the least squares with damping."""
    X, Y, trains, start = networks(5, 2, 2, 2, 6, count=1)
    trains[0, 1:] = False

    def residuals(w: np.ndarray) -> np.ndarray:
        bent = np.tanh(w[:4].reshape(2, 2) @ X[0, 0] + w[4:6])
        return (w[6:10].reshape(2, 2) @ bent + w[10:] - Y[0, 0]) / 2**0.5

    J = [(residuals(start[0] + e) - residuals(start[0] - e)) / 2e-6 for e in 1e-6 * np.eye(12)]
    tall = np.vstack([np.transpose(J), 1e-3**0.5 * np.eye(12)])
    step = np.linalg.lstsq(tall, np.concatenate([residuals(start[0]), np.zeros(12)]))[0]
    W1, b1, W2, b2 = np.split(start[0] - step, [4, 6, 10])
    # the samples held back tell which weights are best: those after the step, which meet them
    bent = np.tanh(X[0, 1:] @ W1.reshape(2, 2).T + b1)
    Y[0, 1:] = bent @ W2.reshape(2, 2).T + b2
    (ours, _), (plain, _) = both((X, Y, trains, start), 0.0, 1)
    for found in (ours, plain):
        assert found[0] == pytest.approx(start[0] - step, abs=1e-6)


def test_decay_is_added_to_the_slope_to_the_last_digit() -> None:
    X, Y, trains, (weights,) = networks(9, 2, 3, 2, 8, count=1)
    Z, T, m = source._sorted(X[0], Y[0], trains[0])
    H, R = source._forward(weights, Z, T, m, 0.0)[2:]
    flat, slope = (source._normal(weights, Z, H, R, m, decay)[-1] for decay in (0.0, 0.1))
    assert slope - flat == pytest.approx(0.1 * weights, abs=1e-15)


def test_no_networks_are_trained() -> None:
    X, Y, trains, weights = (a[:0] for a in networks(6, 1, 2, 1, 9))
    found, steps = compiled(X, Y, trains, weights, 0.0, 5, 6, _RULES)
    assert found.shape == weights.shape
    assert steps.shape == (0,)
