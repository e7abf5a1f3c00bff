"""Leave-one-out in closed form against leaving out, and what selection returns."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from inswsn_lib.errors import ParameterError
from inswsn_lib.learning import LSSVMRegressor, leave_one_out, select_lssvm


def data(seed: int, n: int = 15) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(seed)
    X = rng.normal(size=(n, 2))
    return X, np.column_stack([np.sin(X[:, 0]), X[:, 1]]) + 0.1 * rng.normal(size=(n, 2))


@settings(deadline=None, max_examples=30)
@given(st.integers(0, 10**6), st.floats(0.3, 10), st.sampled_from(["rbf", "linear", "polynomial"]))
def test_the_closed_form_is_leaving_out(seed: int, sigma: float, kernel: str) -> None:
    X, y = data(seed)
    etas = np.array([0.1, 1.0, 100.0])
    closed = leave_one_out(X, y, sigma, etas, kernel)  # type: ignore[arg-type]
    for j, eta in enumerate(etas):
        for i in range(len(X)):
            rest = np.arange(len(X)) != i
            machine = LSSVMRegressor(sigma, eta, kernel).fit(X[rest], y[rest])  # type: ignore[arg-type]
            brute = y[i] - machine.predict(X[i : i + 1])[0]
            assert closed[j, i] == pytest.approx(brute, abs=1e-6)


def test_the_best_pair_has_the_least_error() -> None:
    X, y = data(1)
    sigmas, etas = [0.3, 1.0, 3.0], [0.1, 10.0]
    found = select_lssvm(X, y, sigmas, etas)
    assert found.errors.shape == (3, 2)
    assert found.trials == 6
    assert found.errors == pytest.approx(found.by_output.mean(axis=2))
    i, j = sigmas.index(found.sigma), etas.index(found.eta)
    assert found.errors[i, j] == found.errors.min()
    by_hand = np.abs(leave_one_out(X, y, sigmas[i], np.array(etas)))[j].mean()
    assert found.errors[i, j] == pytest.approx(by_hand)


def test_the_holdout_trains_on_the_first_and_scores_the_rest() -> None:
    X, y = data(2, n=20)
    found = select_lssvm(X, y, [1.0, 2.0], [1.0, 50.0], trained_on=12)
    machine = LSSVMRegressor(2.0, 50.0).fit(X[:12], y[:12])
    expected = np.abs(machine.predict(X[12:]) - y[12:]).mean(axis=0)
    assert found.by_output[1, 1] == pytest.approx(expected)


def test_what_is_held_out_does_not_train() -> None:
    X, y = data(3, n=20)
    spoilt = y.copy()
    spoilt[12:] += 100.0
    one, two = (select_lssvm(X, t, [1.0], [10.0], trained_on=12) for t in (y, spoilt))
    assert two.errors[0, 0] == pytest.approx(one.errors[0, 0] + 100, abs=5)
    assert two.errors[0, 0] > 90


def test_one_output_may_be_flat() -> None:
    X, y = data(4)
    flat = select_lssvm(X, y[:, 0], [1.0], [1.0, 10.0])
    column = select_lssvm(X, y[:, :1], [1.0], [1.0, 10.0])
    assert flat.errors == pytest.approx(column.errors)


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"sigmas": []}, "sigmas is"),
        ({"sigmas": [1.0, 0.0]}, "sigmas is 0.0"),
        ({"etas": [-1.0]}, "etas is -1.0"),
        ({"trained_on": 0}, "trained_on is 0"),
        ({"trained_on": 15}, "trained_on is 15"),
        ({"kernel": "none"}, "kernel is 'none'"),
    ],
)
def test_what_cannot_be_is_refused(changes: dict[str, object], said: str) -> None:
    X, y = data(5)
    with pytest.raises(ParameterError, match=said):
        select_lssvm(**({"X": X, "y": y, "sigmas": [1.0], "etas": [1.0]} | changes))  # type: ignore[arg-type]


def test_one_sample_cannot_be_left_out() -> None:
    with pytest.raises(ParameterError, match="X is '1 sample'"):
        select_lssvm([[1.0]], [1.0], [1.0], [1.0])
