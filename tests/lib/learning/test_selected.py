"""The LS-SVM that chooses against leaving out by hand, and the regressor that holds."""

from __future__ import annotations

import warnings

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st
from sklearn.base import clone
from sklearn.exceptions import NotFittedError, SkipTestWarning
from sklearn.utils.estimator_checks import check_estimator

from inswsn_lib.errors import ParameterError
from inswsn_lib.learning import LSSVMRegressor
from inswsn_lib.learning.selected import ETAS, SIGMAS, HoldRegressor, SelectedLSSVM


def data(seed: int, n: int = 12) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(seed)
    X = rng.normal(size=(n, 2))
    return X, np.column_stack([np.sin(2 * X[:, 0]), X[:, 1]]) + 0.3 * rng.normal(size=(n, 2))


def left_out(X: np.ndarray, y: np.ndarray, sigma: float, eta: float) -> float:
    """Return the mean absolute error of machines that are trained without one sample each."""
    total = 0.0
    for i in range(len(X)):
        rest = np.arange(len(X)) != i
        machine = LSSVMRegressor(sigma, eta).fit(X[rest], y[rest])
        total += np.abs(machine.predict(X[i : i + 1]) - y[i]).mean()
    return total / len(X)


@settings(max_examples=15)
@given(st.integers(0, 10**6))
def test_it_trains_with_the_pair_that_leaves_out_best(seed: int) -> None:
    X, y = data(seed)
    sigmas, etas = (0.3, 1.0, 5.0), (0.1, 3.0, 100.0)
    pairs = [(s, e) for s in sigmas for e in etas]
    sigma, eta = pairs[int(np.argmin([left_out(X, y, *pair) for pair in pairs]))]
    machine = SelectedLSSVM(sigmas, etas).fit(X, y)
    assert (machine.selection_.sigma, machine.selection_.eta) == (sigma, eta)
    new = np.random.default_rng(seed + 1).normal(size=(20, 2))
    expected = LSSVMRegressor(sigma, eta).fit(X, y).predict(new)
    assert np.array_equal(machine.predict(new), expected)


def test_it_smooths_noise_and_follows_what_is_clear() -> None:
    x, z = np.linspace(-2, 2, 40)[:, None], np.random.default_rng(1).normal(size=40)
    clear, noise = SelectedLSSVM().fit(x, np.sin(4 * x[:, 0])), SelectedLSSVM().fit(x, z)
    assert clear.selection_.trials == len(SIGMAS) * len(ETAS)
    assert clear.predict(x) == pytest.approx(np.sin(4 * x[:, 0]), abs=0.05)
    assert np.std(noise.predict(x)) < 0.5 * np.std(z)


def test_shapes_of_targets_are_kept() -> None:
    X, y = data(3)
    assert SelectedLSSVM().fit(X, y).predict(X).shape == (12, 2)
    assert SelectedLSSVM().fit(X, y[:, 0]).predict(X).shape == (12,)
    assert HoldRegressor().fit(X, y).predict(X[:5]).shape == (5, 2)
    assert HoldRegressor().fit(X, y[:, 0]).predict(X[:5]).shape == (5,)


def test_hold_holds() -> None:
    X, y = data(4)
    held = HoldRegressor().fit(X, y)
    assert np.array_equal(held.predict(100 * X), np.tile(y[-1], (12, 1)))
    y[-1] = 0.0  # what it keeps is its own
    assert held.predict(X[:1]).all()


def test_it_is_an_estimator() -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", SkipTestWarning)  # of a check that needs a setting of scipy
        check_estimator(SelectedLSSVM((1.0, 2.0), (1.0, 10.0)))


def test_hold_is_an_estimator() -> None:
    poor = {"check_regressors_train": "it does not look at its inputs"}
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", SkipTestWarning)
        check_estimator(HoldRegressor(), expected_failed_checks=poor)


def test_a_clone_is_untrained() -> None:
    X, y = data(5)
    machine = SelectedLSSVM((1.0,), (2.0,)).fit(X, y)
    again = clone(machine)
    assert again.get_params() == {"sigmas": (1.0,), "etas": (2.0,)}
    with pytest.raises(NotFittedError):
        again.predict(X)


@pytest.mark.parametrize(
    ("sigmas", "etas", "said"),
    [
        ((), (1.0,), "sigmas is"),
        ((0.0,), (1.0,), "sigmas is 0.0"),
        ((1.0,), (-1.0,), "etas is -1.0"),
    ],
)
def test_candidates_that_cannot_be(
    sigmas: tuple[float, ...], etas: tuple[float, ...], said: str
) -> None:
    X, y = data(6)
    with pytest.raises(ParameterError, match=said):
        SelectedLSSVM(sigmas, etas).fit(X, y)
