"""Informations side by side: inverses against LAPACK, and what is too large to be kept."""

from __future__ import annotations

import numpy as np
import pytest
from random_filters import random_covariances, random_model

from inswsn_lib.errors import ParameterError
from inswsn_lib.filters import run_federated, run_kalman
from inswsn_lib.filters.information import inverses
from inswsn_lib.models import ErrorModel


@pytest.mark.parametrize(("size", "count"), [(1, 1), (1, 5), (3, 1), (3, 5), (6, 2)])
def test_inverses_are_those_of_each_matrix(size: int, count: int) -> None:
    P = random_covariances(np.random.default_rng(size), size, 2, count)
    found = inverses(np.moveaxis(P, 1, -1))
    assert np.moveaxis(found, -1, 1) == pytest.approx(np.linalg.inv(P), rel=1e-9)


@pytest.mark.parametrize("runs", [1, 3])
def test_an_inverse_that_would_be_wrong_in_its_sixth_digit_is_refused(runs: int) -> None:
    """Of [[1, c], [c, 1]] it has 1 / (1 - c^2) in its diagonal, and so is the loss of digits."""

    def pair(c: float) -> np.ndarray:
        return np.repeat(np.array([[1, c], [c, 1]])[:, :, None], runs, axis=2)

    near = pair(np.sqrt(1 - 1e-8))
    exact = np.array([[1, -1], [-1, 1]]) * 1e8
    np.testing.assert_allclose(inverses(near)[..., 0], exact, rtol=1e-7)
    for c in (np.sqrt(1 - 1e-10), 1.0):
        with pytest.raises(ParameterError, match=r"measurement_covariance .* not so small"):
            inverses(pair(c))


def wide(m: int) -> ErrorModel:
    """One state, measured m times."""
    return ErrorModel(A=[[1]], B=[[1]], C=np.ones((m, 1)), D=np.eye(m), period=1.0)


def test_as_many_components_as_an_integer_has_bits_for() -> None:
    rng = np.random.default_rng(41)
    y = rng.normal(size=(2, 3, 62, 4))
    y[rng.random(y.shape) < 0.3] = np.nan
    y[:, 1, :-1, 0] = np.nan  # the highest alone is told from none
    options = {"initial_covariance": np.eye(1)}
    found = run_federated(wide(62), y, measurement_covariance=[np.eye(62)] * 2, **options)
    expected = run_kalman(wide(124), np.concatenate(y, axis=1), **options)
    assert found == pytest.approx(expected, abs=1e-10)
    with pytest.raises(ParameterError, match=r"measurements .* not 63"):
        run_federated(wide(63), np.zeros((1, 3, 63, 2)), measurement_covariance=[np.eye(63)],
                      **options)  # fmt: skip


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("measurement_covariance", np.eye(3)),
        ("measurement_covariance", np.zeros((2, 3, 3))),
        ("initial_covariance", np.zeros((2, 2))),
        ("process_covariance", -np.eye(2)),
        ("process_covariance", np.eye(3)),
    ],
)
def test_what_does_not_fit_is_refused(name: str, value: np.ndarray) -> None:
    given = {
        "measurements": np.zeros((2, 5, 3, 1)),
        "measurement_covariance": [np.eye(3)] * 2,
        "initial_covariance": np.eye(2),
    }
    model = random_model(np.random.default_rng(1), 2, 3)
    with pytest.raises(ParameterError) as caught:
        run_federated(model, **(given | {name: value}))
    assert caught.value.name == name


def test_a_state_that_becomes_certain_is_refused() -> None:
    model = ErrorModel(A=np.diag([1, 0]), B=np.zeros((2, 1)), C=np.eye(2), D=np.eye(2), period=1.0)
    with pytest.raises(ParameterError, match=r"process_covariance .* not singular"):
        run_federated(model, np.zeros((1, 3, 2, 1)), measurement_covariance=[np.eye(2)],
                      initial_covariance=np.eye(2))  # fmt: skip
