"""What holds for every filter: compiled or not, alone or beside other runs, with nothing to do."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from lib.kernels.both_ways import both, unchanged
from random_filters import PATTERNS, gappy, random_covariances, random_model, random_weights

import inswsn_lib as iw

Run = Callable[..., np.ndarray]
ALL = (True, True, True)


def lost(y: np.ndarray) -> np.ndarray:
    """Some messages, of each run its own."""
    return y[:, :, 0] > 0.5


def every(rng: np.random.Generator, steps: int) -> dict[str, Run]:
    """Return filters of three states from two numbers of each of three clusters, by their names."""
    model = random_model(rng, 3, 2)
    gain = 0.2 * rng.normal(size=(3, 2))
    Q, R = random_covariances(rng, 3, steps), random_covariances(rng, 2, 3)
    some: dict[str, Any] = {"initial_covariance": random_covariances(rng, 3),
                            "process_covariance": Q, "measurement_covariance": R}  # fmt: skip
    one = some | {"measurement_covariance": R[0]}
    start = {"initial_covariance": some["initial_covariance"]}
    stacked = {
        heard: (
            iw.ErrorModel(A=model.A, B=model.B, C=np.vstack([model.C] * sum(heard)),
                          D=np.eye(2 * sum(heard)), period=1.0),
            np.hstack([gain] * sum(heard)),
        )
        for heard in PATTERNS
    }  # fmt: skip
    designs, weights, margins = [(model, gain)] * 3, random_weights(rng, 3), rng.random((3, steps))

    def federated(reset: str = "fusion", **how: Any) -> Run:
        return lambda y, **more: iw.run_federated(model, y, reset=reset, **some, **how, **more)

    def distributed(weights: Any, handover: str, **how: Any) -> Run:
        return lambda y, **more: iw.run_distributed(
            designs, y, weights=weights, handover=handover, **how, **more
        )

    return {
        "kalman": lambda y, **more: iw.run_kalman(model, y[0], **one, **more),
        "robust": lambda y, **more: iw.run_robust(
            model, y[0], policy=iw.huber(), **start, **more
        ),
        "hinfinity": lambda y, **more: iw.run_hinfinity((model, gain), y[0], **more),
        "switched": lambda y, **more: iw.run_switched(stacked, y, **more),
        "federated": federated(),
        "federated, zero reset": federated("zero", interval=3),
        "federated, no reset": federated("none", predicted=True),
        "federated, shares": federated(predicted=True, sharing=[0.5, 0.2, 0.1, 0.2]),
        "federated, lost": lambda y, **more: federated("none")(y, lost=lost(y), **more),
        "federated, lost and reset": lambda y, **more: federated(interval=2)(
            y, lost=lost(y), **more
        ),
        "intersection": lambda y, **more: iw.run_fused_locals(model, y, **some, **more),
        "best": lambda y, **more: iw.run_fused_locals(
            model, y, rule="best", predicted=True, **some, **more
        ),
        "restart": distributed(weights, "restart", delay=(0, 9, 1)),
        "constant": distributed(weights[ALL], "constant"),
        "fading": distributed(weights, "fading", margins=margins),
    }  # fmt: skip


NAMES = [*every(np.random.default_rng(), 1)]


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("shared", [False, True])
@pytest.mark.parametrize("name", NAMES)
def test_it_gives_the_same_compiled_and_plain_and_alone(name: str, shared: bool, seed: int) -> None:
    rng, steps = np.random.default_rng(seed), (12, 30, 1, 12)[seed]
    run = every(rng, steps)[name]
    y, start = gappy(rng, (3, steps, 2, 5), shared=shared), rng.normal(size=(3, 5))
    with unchanged([y, start]):
        compiled, plain = both(lambda: run(y, initial_state=start))
    close = {"rtol": 1e-7, "atol": 1e-8 * np.abs(plain).max()}
    np.testing.assert_allclose(compiled, plain, **close)
    for r in range(5):
        alone = run(y[..., [r]], initial_state=start[:, r])
        np.testing.assert_allclose(compiled[..., [r]], alone, **close)


@pytest.mark.parametrize(("steps", "runs"), [(0, 4), (6, 0)])
@pytest.mark.parametrize("name", NAMES)
def test_no_steps_and_no_runs(name: str, steps: int, runs: int) -> None:
    run = every(np.random.default_rng(1), steps)[name]
    for found in both(lambda: run(np.zeros((3, steps, 2, runs)))):
        assert found.shape == (steps, 3, runs)


@pytest.mark.parametrize("name", NAMES)
def test_measurements_and_starts_of_another_shape_are_refused(name: str) -> None:
    run = every(np.random.default_rng(1), 6)[name]
    with pytest.raises(iw.ParameterError, match=r"(measurements|designs) .* not of shape"):
        run(np.zeros((3, 6, 1, 4)))
    with pytest.raises(iw.ParameterError, match="initial_state"):
        run(np.zeros((3, 6, 2, 4)), initial_state=np.zeros(4))


@pytest.mark.parametrize("seed", range(40))
def test_the_kalman_filter_of_any_size_is_the_same_compiled_and_plain(seed: int) -> None:
    """Whole and in pieces; from starts that may need square roots, to the end or for a while."""
    rng = np.random.default_rng(seed)
    n, m, steps = (int(x) for x in rng.integers(1, [7, 7, 30]))
    runs = int(rng.choice([1, 2, 31, 32, 33, 70, 100]))
    model = random_model(rng, n, m)
    larger = model.process_covariance * rng.choice([1, 1e8])
    model = model.with_covariances(larger, model.measurement_covariance)
    noise: dict[str, Any] = {
        "initial_covariance": 10.0 ** rng.integers(-2, 12) * random_covariances(rng, n)
    }
    if seed % 3 == 0:
        noise |= {"process_covariance": random_covariances(rng, n, steps),
                  "measurement_covariance": random_covariances(rng, m, steps)}  # fmt: skip
    own = runs if seed % 2 else 1  # another pattern in each run, or the same
    there = rng.random((steps, m, own)) < rng.choice([0.1, 0.6, 1.0])
    if seed % 4 == 1:
        there[: steps // 2] = True
    y = np.where(there, rng.normal(size=(steps, m, runs)), np.nan)
    told = noise | {"initial_state": rng.normal(size=(n, runs)), "predicted": seed % 5 < 2}
    cut = int(rng.integers(0, steps + 1))

    def in_pieces() -> np.ndarray:
        return np.concatenate([*iw.stream_kalman(model, [y[:cut], y[cut:cut], y[cut:]], **told)])

    compiled, plain = both(lambda: iw.run_kalman(model, y, **told))
    size = np.abs(plain).max(axis=0) + 1e-300
    tried = [compiled, *(both(in_pieces) if seed % 3 else ())]
    assert max(np.abs((found - plain) / size).max() for found in tried) < 1e-8
    one, two = both(lambda: iw.design_kalman(model, there[..., 0], **noise))
    scale = np.sqrt(np.diagonal(two.predicted, axis1=1, axis2=2))
    for name in ("predicted", "filtered"):
        apart = (getattr(one, name) - getattr(two, name)) / scale[:, None] / scale[:, :, None]
        assert np.abs(apart).max() < 1e-8
    np.testing.assert_allclose(one.gains, two.gains, rtol=1e-8, atol=1e-10)


@pytest.mark.parametrize("run", [iw.run_federated, iw.run_fused_locals])
def test_a_state_that_is_lost_is_told(run: Any) -> None:
    """A sum of two states is measured 1e14 times better than each is known."""
    model = iw.ErrorModel(A=np.eye(2), B=np.eye(2), C=[[1.0, 1.0]], D=[[1.0]], period=1.0)

    def refused() -> None:
        with pytest.raises(iw.ParameterError, match="lost to rounding"):
            run(model, np.zeros((1, 5, 1, 2)), measurement_covariance=[[[1e-14]]],
                initial_covariance=np.eye(2))  # fmt: skip

    both(refused)


@pytest.mark.parametrize("first", [1.0, np.nan])
def test_a_certain_innovation_is_told(first: float) -> None:
    """Where runs miss measurements of their own, and where they do not."""
    model = iw.ErrorModel(A=[[1]], B=[[0]], C=[[1]], D=[[0]], period=1.0)
    y = np.array([[1.0, first], [1.0, 2.0]]).reshape(2, 1, 2)

    def refused() -> None:
        with pytest.raises(iw.ParameterError, match=r"an innovation has no variance\.$"):
            iw.run_kalman(model, y, initial_covariance=[[0]])

    both(refused)
