"""The LS-SVM against a case solved by hand, its optimality conditions, and another library."""

from __future__ import annotations

import warnings

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st
from sklearn.exceptions import SkipTestWarning
from sklearn.kernel_ridge import KernelRidge
from sklearn.utils.estimator_checks import check_estimator

from inswsn_lib.errors import ParameterError
from inswsn_lib.learning import LSSVMRegressor


def data(seed: int, n: int = 30, outputs: int = 2) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(seed)
    return rng.normal(size=(n, 3)), rng.normal(size=(n, outputs))


@pytest.mark.parametrize("kernel", ["rbf", "linear", "polynomial"])
def test_it_is_an_estimator(kernel: str) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", SkipTestWarning)  # of a check that needs a setting of scipy
        check_estimator(LSSVMRegressor(kernel=kernel))  # type: ignore[arg-type]


def test_three_points_by_hand() -> None:
    """Linear kernel, x = -1, 0, 1, y = 0, 1, 5, eta = 1.

    The mean of x is zero, so b is the mean of y, 2, and the slope is x'y / (x'x + 1/eta) = 5/3;
    the multipliers are the residuals times eta.
    """
    X, y = np.array([[-1.0], [0.0], [1.0]]), np.array([0.0, 1.0, 5.0])
    machine = LSSVMRegressor(eta=1.0, kernel="linear").fit(X, y)
    assert machine.bias_ == pytest.approx(2)
    assert machine.predict([[3.0]]) == pytest.approx([2 + 3 * 5 / 3])
    assert machine.alpha_ == pytest.approx(y - 2 - 5 / 3 * X[:, 0])


@settings(deadline=None)
@given(
    st.integers(0, 10**6), st.floats(0.1, 10), st.floats(1e-3, 1e3),
    st.sampled_from(["rbf", "linear", "polynomial"]),
)  # fmt: skip
def test_the_optimality_conditions_hold(seed: int, sigma: float, eta: float, kernel: str) -> None:
    """P1 (3.6): the multipliers sum to zero, and each is eta times its residual."""
    X, y = data(seed)
    machine = LSSVMRegressor(sigma, eta, kernel).fit(X, y)  # type: ignore[arg-type]
    size = np.abs(machine.alpha_).max()
    assert np.abs(machine.alpha_.sum(axis=0)).max() < 1e-9 * size * len(X)
    residual = y - machine.predict(X)
    assert machine.alpha_ == pytest.approx(eta * residual, abs=1e-6 * (eta + size))


@given(st.integers(0, 10**6), st.floats(0.3, 5), st.floats(0.01, 100))
@settings(deadline=None)
def test_with_its_bias_taken_out_it_is_kernel_ridge(seed: int, sigma: float, eta: float) -> None:
    X, y = data(seed)
    machine = LSSVMRegressor(sigma, eta).fit(X, y)
    ridge = KernelRidge(alpha=1 / eta, kernel="rbf", gamma=1 / (2 * sigma**2))
    ridge.fit(X, y - machine.bias_)
    new = data(seed + 1)[0]
    assert machine.predict(new) == pytest.approx(ridge.predict(new) + machine.bias_, abs=1e-8)


def test_little_weight_on_the_errors_leaves_the_mean() -> None:
    X, y = data(1)
    flat = LSSVMRegressor(eta=1e-9).fit(X, y).predict(X)
    assert flat == pytest.approx(np.tile(y.mean(axis=0), (len(y), 1)), abs=1e-6)


def test_much_weight_on_the_errors_interpolates() -> None:
    X, y = data(2)
    assert LSSVMRegressor(sigma=0.5, eta=1e9).fit(X, y).predict(X) == pytest.approx(y, abs=1e-6)


def test_a_wide_kernel_is_ridge_regression() -> None:
    """exp(-d^2 / 2 s^2) is 1 - d^2 / 2 s^2: linear in x, with the ridge s^2 / eta."""
    X, y = data(3, outputs=1)
    y = y[:, 0]
    sigma, eta = 1000.0, 1e5
    machine = LSSVMRegressor(sigma, eta).fit(X, y)
    centred, target = X - X.mean(axis=0), y - y.mean()
    slope = np.linalg.solve(centred.T @ centred + sigma**2 / eta * np.eye(3), centred.T @ target)
    far = 20 * data(4)[0]
    by_hand = y.mean() + (far - X.mean(axis=0)) @ slope
    assert machine.predict(far) == pytest.approx(by_hand, abs=0.02 * np.abs(by_hand).max())


def test_outputs_do_not_mix() -> None:
    X, y = data(5)
    together = LSSVMRegressor(2.0, 10.0).fit(X, y).predict(X)
    for i in range(2):
        alone = LSSVMRegressor(2.0, 10.0).fit(X, y[:, i]).predict(X)
        assert together[:, i] == pytest.approx(alone)


@pytest.mark.parametrize(
    ("parameters", "said"),
    [
        ({"sigma": 0.0}, "sigma is 0.0"),
        ({"sigma": True}, "sigma is True"),
        ({"eta": -1.0}, "eta is -1.0"),
        ({"eta": float("nan")}, "eta is nan"),
        ({"eta": float("inf")}, "eta is inf"),
        ({"sigma": "wide"}, "sigma is 'wide'"),
        ({"kernel": "cosine"}, "kernel is 'cosine'"),
        ({"kernel": "polynomial", "degree": 0}, "degree is 0"),
        ({"degree": 1.5}, "degree is 1.5"),
    ],
)
def test_a_parameter_that_cannot_be_is_refused(parameters: dict[str, object], said: str) -> None:
    with pytest.raises(ParameterError, match=said):
        LSSVMRegressor(**parameters).fit([[0.0], [1.0]], [0.0, 1.0])  # type: ignore[arg-type]
