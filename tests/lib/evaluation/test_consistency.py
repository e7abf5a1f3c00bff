"""Noise figures against those that errors were made with; normalised squares by closed forms."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given, strategies as st
from scipy.stats import chi2, multivariate_normal

from inswsn_lib.errors import ParameterError
from inswsn_lib.evaluation import autocorrelation, fit_noise, mean_bounds, normalised_squares
from inswsn_lib.evaluation.consistency import log_likelihoods
from inswsn_lib.models import ErrorModel


def test_noise_is_what_the_errors_were_simulated_with() -> None:
    rng = np.random.default_rng(1)
    model = ErrorModel.p1(0.2).with_covariances(np.diag([4, 1, 0.5, 2.0]), np.diag([1, 2, 3, 4.0]))
    x = np.empty((200, 4, 500))
    x[0] = 3.0 * rng.standard_normal((4, 500))
    for k in range(199):
        x[k + 1] = model.A @ x[k] + model.B @ rng.standard_normal((4, 500))
    v = model.D @ rng.standard_normal((200, 4, 500))
    v[3:5, 1, :7] = np.nan
    found = fit_noise(model.A, x, v)
    # standard error of a variance from 100,000 draws is 0.45 %, from 500 it is 6.3 %
    assert found.process == pytest.approx(model.process_covariance, abs=0.1)
    assert found.measurement == pytest.approx(model.measurement_covariance, abs=0.1)
    assert np.diag(found.initial) == pytest.approx([9] * 4, rel=0.3)


def test_noise_by_hand() -> None:
    found = fit_noise([[2.0]], [[[1.0, 3.0]], [[2.0, 1.0]]], [[[3.0, np.nan]], [[np.nan, 1.0]]])
    assert found.initial == pytest.approx(5.0)  # (1 + 9) / 2
    assert found.process == pytest.approx(12.5)  # ((2 - 2)^2 + (1 - 6)^2) / 2
    assert found.measurement == pytest.approx(5.0)  # (9 + 1) / 2
    # a measurement of which a component is missing is left out
    pair = fit_noise([[1.0]], np.ones((2, 1, 1)), [[[3.0], [np.nan]], [[1.0], [2.0]]])
    assert pair.measurement.tolist() == [[1, 2], [2, 4]]


@pytest.mark.parametrize(
    ("changed", "said"),
    [
        ({"states": np.zeros((1, 4, 2))}, "states must be .*two or more steps"),
        ({"states": np.zeros((3, 4, 0))}, "states must be .*two or more steps"),
        ({"states": np.full((3, 4, 2), np.nan)}, "states .* not NaN or infinite"),
        ({"A": np.eye(3)}, "A .* not of shape"),
        ({"measurement_errors": np.zeros((2, 4, 2))}, "measurement_errors .* not of shape"),
        ({"measurement_errors": np.full((3, 4, 2), np.inf)}, "measurement_errors .* not infinite"),
        ({"measurement_errors": np.full((3, 4, 2), np.nan)}, "complete at some step"),
    ],
)
def test_errors_that_have_no_noise_figures(changed: dict[str, Any], said: str) -> None:
    right = {"A": np.eye(4), "states": np.ones((3, 4, 2)), "measurement_errors": np.ones((3, 4, 2))}
    assert (fit_noise(**right).process == 0).all()
    with pytest.raises(ParameterError, match=said):
        fit_noise(**right | changed)


def of_each_run(steps: int, n: int, runs: int, seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Return errors, some of them missing, and covariances that each run has for itself."""
    rng = np.random.default_rng(seed)
    errors, roots = rng.normal(size=(steps, n, runs)), rng.normal(size=(steps, n, n, runs))
    errors[rng.random(errors.shape) < 0.2] = np.nan
    S = np.einsum("kijr,kljr->kilr", roots, roots) + 0.1 * np.eye(n)[:, :, None]
    return errors, S


@given(st.integers(1, 4), st.integers(1, 4), st.integers(1, 4), st.integers(0, 1000))
def test_squares_step_by_step_and_run_by_run(steps: int, n: int, runs: int, seed: int) -> None:
    """By an inverse and by scipy, of what is there; sizes that are equal are not confused."""
    errors, S = of_each_run(steps, n, runs, seed)
    shared = S[..., 0]
    for covariances, of in ((S, S), (shared, None)):
        found, likely = (
            normalised_squares(errors, covariances),
            log_likelihoods(errors, covariances),
        )
        assert found.shape == likely.shape == (steps, runs)
        for k in range(steps):
            for r in range(runs):
                there = ~np.isnan(errors[k, :, r])
                P = (shared[k] if of is None else of[k, :, :, r])[np.ix_(there, there)]
                e = errors[k, there, r]
                expected = e @ np.linalg.inv(P) @ e if there.any() else np.nan
                assert found[k, r] == pytest.approx(expected, rel=1e-6, nan_ok=True)
                density = multivariate_normal(cov=P).logpdf(e) if there.any() else np.nan
                assert likely[k, r] == pytest.approx(density, rel=1e-6, abs=1e-6, nan_ok=True)
    constant = normalised_squares(errors, shared[0])
    assert constant[0] == pytest.approx(normalised_squares(errors, shared)[0], nan_ok=True)


def test_gaussian_errors_have_as_many_degrees_of_freedom_as_components() -> None:
    """Drawn with the covariances of each run: the mean is 3, with a variance of 6 / 4,000."""
    _, S = of_each_run(40, 3, 100, 12)
    roots = np.linalg.cholesky(np.moveaxis(S, 3, 1))
    draws = np.random.default_rng(13).normal(size=(40, 100, 3, 1))
    squares = normalised_squares(np.moveaxis((roots @ draws)[..., 0], 2, 1), S)
    assert squares.mean() == pytest.approx(3, abs=4 * np.sqrt(6 / 4000))
    low, high = mean_bounds(4000, 3, 0.9999)
    assert low < squares.mean() < high


@pytest.mark.parametrize("shape", [(5, 3, 3, 6), (4, 3, 3), (2, 2), (5, 3, 3, 7, 1)])
def test_covariances_that_are_none(shape: tuple[int, ...]) -> None:
    with pytest.raises(ParameterError, match=r"covariances .* not of shape"):
        normalised_squares(np.zeros((5, 3, 7)), np.ones(shape))
    with pytest.raises(ParameterError, match=r"errors .* not of shape"):
        normalised_squares(np.zeros(5), np.eye(3))
    errors, S = np.ones((4, 3, 2)), np.moveaxis(np.tile(np.eye(3), (4, 2, 1, 1)), 1, 3).copy()
    assert (normalised_squares(errors, S) == 3).all()
    S[2, :, :, 1] *= -1
    with pytest.raises(ParameterError, match="singular or indefinite"):
        normalised_squares(errors, S)


@pytest.mark.parametrize("degrees", [1, 2, 3, 50, 1000, 200_000])
@pytest.mark.parametrize("probability", [0.5, 0.95, 0.999, 0.999999])
def test_bounds_are_those_of_scipy(degrees: int, probability: float) -> None:
    tails = [(1 - probability) / 2, (1 + probability) / 2]
    assert mean_bounds(1, degrees, probability) == pytest.approx(chi2.ppf(tails, degrees), rel=1e-6)
    of_each = chi2.ppf(tails, 4 * degrees) / degrees
    assert mean_bounds(degrees, 4, probability) == pytest.approx(of_each, rel=1e-6)


@pytest.mark.parametrize("arguments", [(0, 4), (1, 0), (1, 4, 0.0), (1, 4, 1.0)])
def test_bounds_that_cannot_be(arguments: tuple[Any, ...]) -> None:
    with pytest.raises(ParameterError, match=r"(count|degrees|probability) must be"):
        mean_bounds(*arguments)


def test_patterns_of_more_components_than_a_number_has_bits() -> None:
    rng = np.random.default_rng(3)
    e = np.where(rng.random((4, 70, 3)) < 0.5, np.nan, rng.normal(size=(4, 70, 3)))
    assert normalised_squares(e, np.eye(70)) == pytest.approx(np.nansum(e**2, axis=1))


def test_gaps_do_not_change_an_autocorrelation() -> None:
    """Of x_k = 0.8 x_{k-1} + w it is 0.8^k; 100,000 steps tell it to 0.01."""
    rng = np.random.default_rng(3)
    x = np.zeros((100_000, 2))
    for k, w in enumerate(0.6 * rng.standard_normal((len(x) - 1, 2))):
        x[k + 1] = 0.8 * x[k] + w
    x[rng.random(x.shape) < 0.5] = np.nan
    expected = np.tile(0.8 ** np.arange(6), (2, 1)).T
    assert autocorrelation(x, range(6)) == pytest.approx(expected, abs=0.03)
    assert np.isnan(autocorrelation([1.0, np.nan, 1.0], [1])).all()
