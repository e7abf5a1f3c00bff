"""Normalised squares and their bounds, against closed forms."""

from __future__ import annotations

import numpy as np
import pytest
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
