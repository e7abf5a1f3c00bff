"""The compiled filter of runs with gaps of their own is the plain one."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np
import pytest
from random_filters import random_covariances, random_model

from inswsn_lib.errors import ParameterError
from inswsn_lib.filters import kalman
from inswsn_lib.kernels import choose
from inswsn_lib.models import ErrorModel


def filled(run: Callable[..., Any], *given: Any) -> tuple[Any, ...]:
    """Return what a form of the filter fills, and what it returns."""
    *_, x, _, y, own, _, _ = given
    states = np.zeros((len(y), 1 + own.max(), x.shape[1]))
    return states, *run(*given, states)


compiled = partial(filled, choose("kalman_runs", kalman._each_run))
plainly = partial(filled, kalman._each_run)


def arguments(
    rng: np.random.Generator, n: int, m: int, steps: int, runs: int, *, varying: bool = False,
    certainty: float = 1.0, predicted: bool = False,
) -> list[Any]:  # fmt: skip
    model = random_model(rng, n, m)
    model = model.with_covariances(
        model.process_covariance * rng.choice([1, 1e8]), model.measurement_covariance
    )
    Q, R = (random_covariances(rng, size, steps) if varying else None for size in (n, m))
    noise = kalman._Noise.of(model, Q, R, steps)
    start = kalman._Covariances.start(model, certainty * random_covariances(rng, n))
    there = rng.random((steps, m, runs)) < rng.choice([0.1, 0.6, 1.0])
    parts = (
        model.A, model.C, noise.Q, noise.driving, noise.R, noise.root, noise.limits, start.P,
        start.root, rng.normal(size=(n, runs)), there, there * rng.normal(size=there.shape),
        np.arange(n), np.arange(m),
    )  # fmt: skip
    return [*map(np.ascontiguousarray, parts), predicted]


@pytest.mark.parametrize("seed", range(40))
def test_it_is_the_plain_filter(seed: int) -> None:
    rng = np.random.default_rng(seed)
    n, m = rng.integers(1, 7), rng.integers(1, 7)
    given = arguments(
        rng, n, m, rng.integers(1, 30), rng.choice([1, 2, 31, 32, 33, 70]), varying=seed % 3 == 0,
        certainty=10.0 ** rng.integers(-2, 12), predicted=seed % 2 == 0,
    )  # fmt: skip
    before = [np.array(each) for each in given]
    ours, plain = compiled(*given), plainly(*given)
    assert all(np.array_equal(a, b) for a, b in zip(given, before, strict=True))
    states, x, P, W, certain = ours
    assert not certain
    scale = np.abs(plain[0]).max(axis=0) + 1e-300
    assert (np.abs(states - plain[0]) / scale).max() < 1e-8
    assert x == pytest.approx(plain[1], rel=1e-8, abs=1e-8 * np.abs(plain[1]).max())
    size = np.sqrt(np.diagonal(plain[2], axis1=1, axis2=2))
    for found in (P, W @ np.swapaxes(W, 1, 2)):
        assert (np.abs(found - plain[2]) / size[:, None] / size[:, :, None]).max() < 1e-8


def test_no_steps_and_no_runs() -> None:
    rng = np.random.default_rng(0)
    for steps, runs in ((0, 3), (4, 0)):
        states, x, P, *_ = compiled(*arguments(rng, 2, 1, steps, runs))
        assert (states.shape, x.shape, P.shape) == ((steps, 2, runs), (2, runs), (runs, 2, 2))


def test_a_second_piece_goes_on_where_the_first_ended() -> None:
    """Also where the last step was by square roots."""
    for certainty in (1.0, 1e9):
        given = arguments(np.random.default_rng(5), 3, 2, 12, 40, certainty=certainty)
        *told, P, W, x, there, y, own, outputs, predicted = given
        whole, *_ = compiled(*given)
        found = []
        for part in (slice(0, 1), slice(1, 2), slice(2, None)):
            piece = (np.ascontiguousarray(each[part]) for each in (there, y))
            states, x, P, W, _ = compiled(*told, P, W, x, *piece, own, outputs, predicted)
            found.append(states)
        assert np.concatenate(found) == pytest.approx(whole, rel=1e-10, abs=1e-10)


def test_a_certain_innovation_is_told() -> None:
    model = ErrorModel(A=[[1]], B=[[0]], C=[[1]], D=[[0]], period=1.0)
    y = np.array([[1.0, np.nan], [1.0, 2.0]]).reshape(2, 1, 2)
    with pytest.raises(ParameterError, match="an innovation has no variance"):
        kalman.run_kalman(model, y, initial_covariance=[[0]])
