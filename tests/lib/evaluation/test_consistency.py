"""Normalised squares and their bounds, against closed forms."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, strategies as st
from scipy.stats import norm

from inswsn_lib.errors import ParameterError
from inswsn_lib.evaluation import mean_bounds, normalised_squares


def test_by_hand() -> None:
    errors = np.array([[[2.0, np.nan], [3.0, 0.0]]])
    assert normalised_squares(errors, np.diag([4.0, 9.0]))[0, 0] == pytest.approx(2.0)
    # of the second run one component is missing, and of a third both would be
    assert normalised_squares(errors, np.eye(2))[0, 1] == 0.0
    assert np.isnan(normalised_squares(np.full((1, 2, 1), np.nan), np.eye(2))[0, 0])
    # what is missing is left out, not taken for zero: S = [[2, 1], [1, 2]], first component alone
    lone = np.array([[[2.0], [np.nan]]])
    assert normalised_squares(lone, [[2.0, 1.0], [1.0, 2.0]])[0, 0] == pytest.approx(4 / 2)
    # S = [[2, 1], [1, 2]]: e'S^-1 e = 2 (a^2 - a b + b^2) / 3
    assert normalised_squares(errors[:, :, :1], [[2.0, 1.0], [1.0, 2.0]])[0, 0] == pytest.approx(
        2 * (4 - 6 + 9) / 3
    )


def of_each_run(steps: int, n: int, runs: int, seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Return errors, some of them missing, and covariances that each run has for itself."""
    rng = np.random.default_rng(seed)
    errors, roots = rng.normal(size=(steps, n, runs)), rng.normal(size=(steps, n, n, runs))
    errors[rng.random(errors.shape) < 0.2] = np.nan
    S = np.einsum("kijr,kljr->kilr", roots, roots) + 0.1 * np.eye(n)[:, :, None]
    return errors, S


@given(st.integers(1, 4), st.integers(1, 4), st.integers(1, 4), st.integers(0, 1000))
def test_each_run_has_covariances_of_its_own(steps: int, n: int, runs: int, seed: int) -> None:
    """Step by step and run by run, by an inverse; sizes that are equal are not confused."""
    errors, S = of_each_run(steps, n, runs, seed)
    found = normalised_squares(errors, S)
    assert found.shape == (steps, runs)
    for k in range(steps):
        for r in range(runs):
            there = ~np.isnan(errors[k, :, r])
            e, P = errors[k, there, r], S[k, :, :, r][np.ix_(there, there)]
            if there.any():
                assert found[k, r] == pytest.approx(e @ np.linalg.inv(P) @ e, rel=1e-6)
            else:
                assert np.isnan(found[k, r])


def test_covariances_that_all_runs_share_may_be_given_to_each() -> None:
    errors, S = of_each_run(5, 3, 7, 4)
    shared = np.broadcast_to(S[..., :1], S.shape)
    expected = normalised_squares(errors, S[..., 0])
    assert normalised_squares(errors, shared) == pytest.approx(expected, nan_ok=True)


def test_gaussian_errors_have_as_many_degrees_of_freedom_as_components() -> None:
    """Drawn with the covariances of each run: the mean is 3, with a variance of 6 / 4,000."""
    _, S = of_each_run(40, 3, 100, 12)
    roots = np.linalg.cholesky(np.moveaxis(S, 3, 1))
    draws = np.random.default_rng(13).normal(size=(40, 100, 3, 1))
    errors = np.moveaxis((roots @ draws)[..., 0], 2, 1)
    squares = normalised_squares(errors, S)
    assert squares.mean() == pytest.approx(3, abs=4 * np.sqrt(6 / 4000))
    low, high = mean_bounds(4000, 3, 0.9999)
    assert low < squares.mean() < high


@pytest.mark.parametrize("shape", [(5, 3, 3, 6), (4, 3, 3, 7), (5, 2, 3, 7), (5, 3, 3, 7, 1)])
def test_covariances_of_another_shape_are_refused(shape: tuple[int, ...]) -> None:
    with pytest.raises(ParameterError, match="errors and covariances"):
        normalised_squares(np.zeros((5, 3, 7)), np.ones(shape))


def test_one_run_with_a_wrong_covariance_is_refused() -> None:
    errors, S = of_each_run(4, 3, 2, 1)
    errors[2, :, 1] = 1.0
    S[2, :, :, 1] = -np.eye(3)
    with pytest.raises(ParameterError, match="not positive definite"):
        normalised_squares(errors, S)


def test_unchanged_by_units_of_the_components() -> None:
    rng = np.random.default_rng(3)
    errors, root = rng.normal(size=(5, 3, 7)), rng.normal(size=(5, 3, 3))
    S = root @ np.swapaxes(root, 1, 2) + np.eye(3)
    M = np.diag([1e3, 1e-3, 1.0])
    assert normalised_squares(M @ errors, M @ S @ M) == pytest.approx(normalised_squares(errors, S))


def test_bounds_of_one_square_of_one_degree_are_those_of_the_normal_law() -> None:
    low, high = mean_bounds(1, 1, 0.9)
    assert high == pytest.approx(norm.ppf(0.975) ** 2)
    assert low == pytest.approx(norm.ppf(0.525) ** 2)


def test_bounds_close_in_as_the_square_root_of_the_count() -> None:
    low, high = mean_bounds(40_000, 4)
    # mean 4, variance 8 / count
    assert (low, high) == pytest.approx(
        (4 - 1.96 * np.sqrt(8 / 40_000), 4 + 1.96 * np.sqrt(8 / 40_000)), abs=2e-4
    )


@pytest.mark.parametrize("arguments", [(0, 4), (1, 0), (1, 4, 0.0), (1, 4, 1.0)])
def test_bounds_that_cannot_be(arguments: tuple[float, ...]) -> None:
    with pytest.raises(ParameterError):
        mean_bounds(*arguments)


def test_what_does_not_fit_is_refused() -> None:
    with pytest.raises(ParameterError, match="errors and covariances"):
        normalised_squares(np.zeros((2, 3)), np.eye(3))
    with pytest.raises(ParameterError, match="not positive definite"):
        normalised_squares(np.zeros((2, 3, 1)), np.zeros((3, 3)))
