"""Leave-one-out in closed form against leaving out, and what selection returns."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from inswsn_lib.errors import ParameterError
from inswsn_lib.learning import LSSVMRegressor, SelectedLSSVM, select_lssvm
from inswsn_lib.learning.selection import ETAS, SIGMAS

PAIRS = {"sigmas": [0.3, 1.0, 5.0], "etas": [0.1, 3.0, 100.0]}


def data(seed: int, n: int = 12) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(seed)
    X = rng.normal(size=(n, 2))
    return X, np.column_stack([np.sin(2 * X[:, 0]), X[:, 1]]) + 0.3 * rng.normal(size=(n, 2))


def left_out(X: np.ndarray, y: np.ndarray, machine: LSSVMRegressor) -> np.ndarray:
    """Return the mean absolute errors of machines that are trained without one sample each."""
    errors = []
    for i in range(len(X)):
        rest = np.arange(len(X)) != i
        errors.append(np.abs(machine.fit(X[rest], y[rest]).predict(X[[i]]) - y[i])[0])
    return np.mean(errors, axis=0)


@settings(max_examples=15)
@given(st.integers(0, 10**6), st.sampled_from(["rbf", "linear", "polynomial"]), st.integers(1, 3))
def test_the_closed_form_is_leaving_out(seed: int, kernel: Any, degree: int) -> None:
    X, y = data(seed)
    found = select_lssvm(X, y, **PAIRS, kernel=kernel, degree=degree)
    expected = np.array(
        [
            [left_out(X, y, LSSVMRegressor(sigma, eta, kernel, degree)) for eta in PAIRS["etas"]]
            for sigma in PAIRS["sigmas"]
        ]
    )
    assert found.by_output == pytest.approx(expected, rel=1e-5, abs=1e-6)
    assert found.errors == pytest.approx(expected.mean(axis=2), rel=1e-5, abs=1e-6)
    i, j = np.unravel_index(np.argmin(found.errors), (3, 3))
    assert (found.sigma, found.eta) == (PAIRS["sigmas"][i], PAIRS["etas"][j])
    flat = select_lssvm(X, y[:, 1], **PAIRS, kernel=kernel, degree=degree)
    assert flat.errors == pytest.approx(found.by_output[:, :, 1])


def test_the_holdout_trains_on_the_first_and_scores_the_rest() -> None:
    X, y = data(2, n=20)
    options: dict[str, Any] = {"kernel": "polynomial", "degree": 3}
    found = select_lssvm(X, y, [1.0, 2.0], [1.0, 50.0], trained_on=12, **options)
    machine = LSSVMRegressor(2.0, 50.0, **options).fit(X[:12], y[:12])
    expected = np.abs(machine.predict(X[12:]) - y[12:]).mean(axis=0)
    assert found.by_output[1, 1] == pytest.approx(expected)


@settings(max_examples=15)
@given(st.integers(0, 10**6))
def test_it_trains_with_the_pair_that_leaves_out_best(seed: int) -> None:
    X, y = data(seed)
    machine = SelectedLSSVM(tuple(PAIRS["sigmas"]), tuple(PAIRS["etas"])).fit(X, y)
    best = select_lssvm(X, y, **PAIRS)
    assert np.array_equal(machine.selection_.errors, best.errors)
    new = np.random.default_rng(seed + 1).normal(size=(20, 2))
    expected = LSSVMRegressor(best.sigma, best.eta).fit(X, y).predict(new)
    assert np.array_equal(machine.predict(new), expected)


def test_it_smooths_noise_and_follows_what_is_clear() -> None:
    x, z = np.linspace(-2, 2, 40)[:, None], np.random.default_rng(1).normal(size=40)
    clear, noise = SelectedLSSVM().fit(x, np.sin(4 * x[:, 0])), SelectedLSSVM().fit(x, z)
    assert clear.selection_.errors.shape == (len(SIGMAS), len(ETAS)) == (10, 9)
    assert (SIGMAS[0], SIGMAS[-1], ETAS[0], ETAS[-1]) == pytest.approx((0.125, 64, 0.01, 100))
    assert clear.predict(x) == pytest.approx(np.sin(4 * x[:, 0]), abs=0.05)
    assert np.std(noise.predict(x)) < 0.5 * np.std(z)


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"X": [[1.0], [np.nan]]}, "X .* not NaN or infinite"),
        ({"y": [1.0]}, "y .* not of shape"),
        ({"sigmas": []}, "sigmas must be one or more positive numbers, not empty."),
        ({"sigmas": [1.0, 0.0]}, "sigmas must be .*0.0"),
        ({"etas": [-1.0]}, "etas must be .*-1.0"),
        ({"trained_on": 0}, "trained_on .* not 0"),
        ({"trained_on": 2}, "trained_on .* not 2"),
        ({"kernel": "none"}, "kernel .* not 'none'"),
        ({"degree": 0}, "degree .* not 0"),
        ({"X": [[1.0]], "y": [1.0]}, "X .* not 1 sample"),
    ],
)
def test_what_cannot_be_is_refused(changes: dict[str, Any], said: str) -> None:
    arguments: dict[str, Any] = {"X": [[1.0], [2.0]], "y": [1.0, 2.0]}
    with pytest.raises(ParameterError, match=said):
        select_lssvm(**(arguments | {"sigmas": [1.0], "etas": [1.0]} | changes))


def test_two_samples_can_be_left_out_and_held_out() -> None:
    """Each is predicted by the other; the bias of a machine with one sample is its target."""
    for first in (None, 1):
        found = select_lssvm([[0.0], [1.0]], [1.0, 4.0], [1.0], [1.0], trained_on=first)
        assert found.errors == pytest.approx(np.array([[3.0]]))
