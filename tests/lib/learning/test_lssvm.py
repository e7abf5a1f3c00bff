"""The LS-SVM against a case solved by hand, its optimality conditions, and another library."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given, strategies as st
from sklearn.kernel_ridge import KernelRidge
from sklearn.metrics.pairwise import polynomial_kernel, rbf_kernel

from inswsn_lib.errors import ParameterError
from inswsn_lib.learning import LSSVMRegressor, SelectedLSSVM, kernel_matrix, lssvm

KERNELS = ["rbf", "linear", "polynomial"]


def data(seed: int, n: int = 30, outputs: int = 2) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(seed)
    return rng.normal(size=(n, 3)), rng.normal(size=(n, outputs))


def test_kernels_are_those_of_scikit_learn() -> None:
    X, Z = data(1, 5)[0], data(2, 4)[0]
    sigma, degree = 1.7, 3
    expected = {
        "rbf": rbf_kernel(X, Z, gamma=1 / (2 * sigma**2)),
        "linear": X @ Z.T,
        "polynomial": polynomial_kernel(X, Z, degree=degree, gamma=1 / sigma**2, coef0=1),
    }
    for kernel in KERNELS:
        found = kernel_matrix(X, Z, kernel, sigma, degree)  # type: ignore[arg-type]
        assert found == pytest.approx(expected[kernel])


def test_a_tiny_width_and_a_rank_raise_no_warning() -> None:
    """The diagonal of the polynomial kernel, which overflows, is not formed for another one."""
    X, y = data(1)
    with np.errstate(all="raise", under="ignore"):
        LSSVMRegressor(1e-150, 1.0, degree=3, rank=5).fit(X, y)


def test_three_points_by_hand() -> None:
    """Linear kernel, x = -1, 0, 1, y = 0, 1, 5, eta = 1.

    The mean of x is zero, so b is the mean of y, 2, and the slope is x'y / (x'x + 1/eta) = 5/3;
    the multipliers are the residuals times eta.
    """
    X, y = np.array([[-1.0], [0.0], [1.0]]), np.array([0.0, 1.0, 5.0])
    machine = LSSVMRegressor(eta=1.0, kernel="linear").fit(X, y)
    assert machine.bias_ == pytest.approx([2])
    assert machine.predict([[3.0]]) == pytest.approx([2 + 3 * 5 / 3])
    assert machine.alpha_[:, 0] == pytest.approx(y - 2 - 5 / 3 * X[:, 0])


@given(
    st.integers(0, 10**6), st.floats(0.1, 10), st.floats(1e-3, 1e3), st.sampled_from(KERNELS),
    st.integers(1, 3),
)  # fmt: skip
def test_the_optimality_conditions_hold(
    seed: int, sigma: float, eta: float, kernel: Any, degree: int
) -> None:
    """P1 (3.6): the multipliers sum to zero, and each is eta times its residual."""
    X, y = data(seed)
    machine = LSSVMRegressor(sigma, eta, kernel, degree).fit(X, y)
    size = np.abs(machine.alpha_).max()
    assert np.abs(machine.alpha_.sum(axis=0)).max() < 1e-9 * size * len(X)
    residual = y - machine.predict(X)
    assert machine.alpha_ == pytest.approx(eta * residual, abs=1e-6 * (eta + size))


@given(st.integers(0, 10**6), st.floats(0.3, 5), st.floats(0.01, 100))
def test_with_its_bias_taken_out_it_is_kernel_ridge(seed: int, sigma: float, eta: float) -> None:
    X, y = data(seed)
    machine = LSSVMRegressor(sigma, eta).fit(X, y)
    ridge = KernelRidge(alpha=1 / eta, kernel="rbf", gamma=1 / (2 * sigma**2))
    ridge.fit(X, y - machine.bias_)
    new = data(seed + 1)[0]
    assert machine.predict(new) == pytest.approx(ridge.predict(new) + machine.bias_, abs=1e-8)


def test_a_wide_kernel_is_ridge_regression() -> None:
    """exp(-d^2 / 2 s^2) is 1 - d^2 / 2 s^2: linear in x, with the ridge s^2 / eta."""
    X, y = data(3, outputs=1)
    sigma, eta = 1000.0, 1e5
    machine = LSSVMRegressor(sigma, eta).fit(X, y)
    centred, target = X - X.mean(axis=0), y - y.mean()
    slope = np.linalg.solve(centred.T @ centred + sigma**2 / eta * np.eye(3), centred.T @ target)
    far = 20 * data(4)[0]
    by_hand = y.mean() + (far - X.mean(axis=0)) @ slope
    assert machine.predict(far) == pytest.approx(by_hand, abs=0.02 * np.abs(by_hand).max())


def test_a_kernel_that_is_singular_to_rounding_is_told() -> None:
    with pytest.raises(ParameterError, match="smaller for such a kernel"):
        LSSVMRegressor(sigma=1e3, eta=1e20).fit([[0.0], [1e-9], [0.0]], [0.0, 1.0, 2.0])


@pytest.mark.parametrize(
    "parameters",
    [
        {"sigma": 0.0}, {"sigma": True}, {"eta": 0.0}, {"eta": float("inf")}, {"kernel": "cosine"},
        {"kernel": "polynomial", "degree": 0}, {"degree": 1.5}, {"rank": 0}, {"rank": 3},
        {"rank": 1.5},
    ],
)  # fmt: skip
def test_a_parameter_that_cannot_be_is_refused(parameters: dict[str, Any]) -> None:
    *_, (name, value) = parameters.items()
    with pytest.raises(ParameterError, match=rf"{name} .* not {value!r}"):
        LSSVMRegressor(**parameters).fit([[0.0], [1.0]], [0.0, 1.0])


MANY = 10**7  # rows whose kernels are 800 TB: more than a process can address


@pytest.mark.parametrize(
    ("machine", "rows", "free", "size"),
    [
        (LSSVMRegressor(), 10**5, 79e9, "80 GB"),
        (LSSVMRegressor(), MANY, np.inf, "8e+05 GB"),  # the allocation fails
        (LSSVMRegressor(rank=MANY), MANY, np.inf, "8e+05 GB"),
        (SelectedLSSVM(), 10**5, 479e9, "480 GB"),
        (SelectedLSSVM((1.0,), (1.0,)), MANY, np.inf, "4.8e+06 GB"),
    ],
)
def test_more_rows_than_memory_are_refused_with_a_way_out(
    machine: Any, rows: int, free: float, size: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(lssvm, "_free_memory", lambda: free)
    X = np.linspace(0.0, 1.0, rows)[:, None]
    with pytest.raises(ParameterError) as raised:
        machine.fit(X, X[:, 0])
    assert str(raised.value) == (
        "X must be of fewer rows, or LSSVMRegressor given a smaller rank=, such as rank=1000, "
        f"not of {rows:,} rows, whose kernels take {size} of memory."
    )


def test_memory_that_can_be_had_is_told_by_the_system() -> None:
    psutil = pytest.importorskip("psutil")
    free = lssvm._free_memory()
    assert free == np.inf or 0 < free <= psutil.virtual_memory().total


@pytest.mark.parametrize("kernel", KERNELS)
@pytest.mark.parametrize("n", [128, 129, 300])
def test_many_samples_give_what_the_bordered_system_gives(kernel: Any, n: int) -> None:
    """The kernel is computed some rows at a time; one row may be left over."""
    X, y = data(5, n)
    machine = LSSVMRegressor(2.0, 3.0, kernel).fit(X, y)
    system = np.zeros((n + 1, n + 1))
    system[0, 1:] = system[1:, 0] = 1
    system[1:, 1:] = kernel_matrix(X, X, kernel, 2.0, 2) + np.eye(n) / 3.0
    expected = np.linalg.solve(system, np.vstack([np.zeros((1, 2)), y]))
    assert np.vstack([machine.bias_, machine.alpha_]) == pytest.approx(expected, abs=1e-9)


@pytest.mark.parametrize("kernel", KERNELS)
def test_with_every_sample_a_pivot_a_low_rank_is_the_dense_machine(kernel: Any) -> None:
    X, y = data(6, 200)
    dense = LSSVMRegressor(1.0, 3.0, kernel).fit(X, y)
    low = LSSVMRegressor(1.0, 3.0, kernel, rank=200).fit(X, y)
    new = data(7)[0]
    assert low.predict(new) == pytest.approx(dense.predict(new), rel=1e-9, abs=1e-10)
    assert low.bias_ == pytest.approx(dense.bias_, rel=1e-9)
    assert low.trace_left_ < 1e-12
    assert low.residual_ < 1e-10


@pytest.mark.parametrize(
    ("kernel", "degree", "features"), [("linear", 1, 3), ("polynomial", 2, 10)]
)
def test_so_many_pivots_as_features_are_enough(kernel: Any, degree: int, features: int) -> None:
    """A linear kernel of 3 inputs has 3 features, (1 + x'z)^2 has 1 + 3 + 6."""
    X, y = data(8, 300)
    dense = LSSVMRegressor(1.0, 3.0, kernel, degree).fit(X, y)
    new = data(9)[0]
    for rank in (features, 300):
        low = LSSVMRegressor(1.0, 3.0, kernel, degree, rank).fit(X, y)
        assert low.X_fit_.shape == (features, 3)
        assert low.predict(new) == pytest.approx(dense.predict(new), rel=1e-8, abs=1e-9)
        assert max(low.trace_left_, low.residual_) < 1e-9


def test_a_low_rank_is_the_machine_with_the_kernel_of_its_pivots() -> None:
    """With the kernel k(x, P) K_PP^-1 k(P, z) in the bordered system; the errors by hand, too."""
    X, y = data(10, 150)
    machine = LSSVMRegressor(1.5, 5.0, rank=20).fit(X, y)
    P, new = machine.X_fit_, data(11)[0]
    at_pivots, K = rbf_kernel(P, P, gamma=1 / 4.5), rbf_kernel(X, X, gamma=1 / 4.5)

    def kernel(A: np.ndarray, B: np.ndarray) -> np.ndarray:
        left, right = rbf_kernel(A, P, gamma=1 / 4.5), rbf_kernel(P, B, gamma=1 / 4.5)
        return np.asarray(left @ np.linalg.solve(at_pivots, right))

    system = np.ones((151, 151))
    system[0, 0] = 0
    system[1:, 1:] = kernel(X, X) + np.eye(150) / 5.0
    b, alpha = np.split(np.linalg.solve(system, np.vstack([np.zeros((1, 2)), y])), [1])
    assert machine.predict(new) == pytest.approx(kernel(new, X) @ alpha + b, abs=1e-8)
    assert machine.trace_left_ == pytest.approx(1 - np.trace(kernel(X, X)) / 150, abs=1e-10)
    missed = y - b - alpha / 5.0 - K @ alpha
    residual = np.sqrt(np.mean(missed**2) / np.mean(y**2))
    assert machine.residual_ == pytest.approx(residual, rel=1e-8)


def test_a_larger_rank_has_a_smaller_error() -> None:
    X = data(12, 1500)[0]
    y = np.sin(X[:, 0]) * X[:, 1]
    dense = LSSVMRegressor(2.0, 10.0).fit(X, y)
    machines = [LSSVMRegressor(2.0, 10.0, rank=r).fit(X, y) for r in (20, 80, 320)]
    off = [float(np.abs(m.predict(X) - dense.predict(X)).max()) for m in machines]
    for errors in (off, [m.trace_left_ for m in machines], [m.residual_ for m in machines]):
        assert errors[0] > 3 * errors[1] > 9 * errors[2]
    assert off[-1] < 1e-2


def test_samples_that_are_alike_need_one_pivot_each() -> None:
    X, y = np.repeat([[0.0], [1.0]], 100, axis=0), np.repeat([3.0, 5.0], 100)
    machine = LSSVMRegressor(0.1, 1e3, rank=50).fit(X, y)
    assert sorted(machine.X_fit_[:, 0]) == [0.0, 1.0]
    assert machine.predict([[0.0], [1.0]]) == pytest.approx([3.0, 5.0], abs=1e-4)
    nothing = LSSVMRegressor(kernel="linear", rank=2).fit(np.zeros((5, 1)), np.arange(5.0))
    assert nothing.predict([[7.0]]) == pytest.approx([2.0])
    assert nothing.trace_left_ == 0
