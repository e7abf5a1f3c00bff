"""The compiled steps of federated filters and fused locals are the plain ones."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from random_filters import random_covariances

from inswsn_lib.errors import ParameterError
from inswsn_lib.filters import run_federated, run_fused_locals
from inswsn_lib.models import ErrorModel

WAYS: list[tuple[Any, dict[str, Any]]] = [
    (run_federated, {}),
    (run_federated, {"reset": "zero", "interval": 3}),
    (run_federated, {"reset": "none", "predicted": True}),
    (run_federated, {"predicted": True, "sharing": [0.5, 0.2, 0.1, 0.2]}),
    (run_fused_locals, {"rule": "intersection"}),
    (run_fused_locals, {"rule": "best", "predicted": True}),
]


def both(monkeypatch: pytest.MonkeyPatch, run: Any, *words: Any, **known: Any) -> list[np.ndarray]:
    found = []
    for plain in ("", "1"):
        monkeypatch.setenv("INSWSN_PLAIN", plain)
        found.append(run(*words, **known))
    return found


@pytest.mark.parametrize(("run", "how"), WAYS)
@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("steps", [1, 12])
def test_they_are_the_plain_steps(
    monkeypatch: pytest.MonkeyPatch, run: Any, how: dict[str, Any], seed: int, steps: int
) -> None:
    rng = np.random.default_rng(seed)
    n, m, runs = 3, 2, 5
    A, C = np.eye(n) + 0.3 * rng.normal(size=(n, n)), rng.normal(size=(m, n))
    B, D = rng.normal(size=(n, n)), rng.normal(size=(m, m))
    model = ErrorModel(A=A, B=B, C=C, D=D, L=np.eye(n), period=1.0)
    y = rng.normal(size=(3, steps, m, runs))
    y[rng.random((3, steps)) < 0.3] = np.nan  # the same in all runs, at times in none
    y[:, steps // 2] = np.nan
    known = {
        "measurement_covariance": random_covariances(rng, m, 3),
        "initial_covariance": random_covariances(rng, n),
        "initial_state": rng.normal(size=n),
    }
    before = y.copy()
    ours, plain = both(monkeypatch, run, model, y, **known, **how)
    assert np.array_equal(y, before, equal_nan=True)
    np.testing.assert_allclose(ours, plain, rtol=1e-8, atol=1e-9 * np.abs(plain).max())


@pytest.mark.parametrize("run", [run_federated, run_fused_locals])
@pytest.mark.parametrize("plain", ["", "1"])
def test_a_state_that_is_lost_is_told(
    monkeypatch: pytest.MonkeyPatch, run: Any, plain: str
) -> None:
    """A sum of two states is measured 1e14 times better than each is known."""
    monkeypatch.setenv("INSWSN_PLAIN", plain)
    eye = np.eye(2)
    model = ErrorModel(A=eye, B=eye, C=[[1.0, 1.0]], D=[[1.0]], L=eye, period=1.0)
    with pytest.raises(ParameterError, match="lost to rounding"):
        run(
            model, np.zeros((1, 5, 1, 2)), measurement_covariance=[[[1e-14]]],
            initial_covariance=eye,
        )  # fmt: skip
