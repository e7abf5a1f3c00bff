"""Monte Carlo: streams that do not depend on how many runs follow."""

from __future__ import annotations

import numpy as np
import pytest

from inswsn_lib.errors import ParameterError
from inswsn_lib.evaluation import GROUP, monte_carlo


def draw(rng: np.random.Generator, runs: int) -> dict[str, np.ndarray]:
    return {"x": rng.standard_normal((3, runs)), "y": rng.random((2, 2, runs))}


@pytest.mark.parametrize("runs", [1, GROUP - 1, GROUP, GROUP + 1, 200])
def test_a_run_is_the_same_however_many_follow(runs: int) -> None:
    many, few = monte_carlo(draw, 300, seed=5), monte_carlo(draw, runs, seed=5)
    for name, array in few.items():
        assert array.shape[-1] == runs
        assert np.array_equal(array, many[name][..., :runs])


def test_seeds_and_groups_have_streams_of_their_own() -> None:
    a, b = (monte_carlo(draw, 2 * GROUP, seed=seed)["x"] for seed in (5, 6))
    assert not np.isclose(a, b).any()
    assert not np.isclose(a[:, :GROUP], a[:, GROUP:]).any()
    # 384 correlations of standard normal triples would be off zero by more only once in 10,000
    assert abs(np.corrcoef(a[:, :GROUP].ravel(), a[:, GROUP:].ravel())[0, 1]) < 3.9 / 192**0.5


@pytest.mark.parametrize(("first", "runs"), [(0, 300), (GROUP, 100), (2 * GROUP, 172), (256, 1)])
def test_a_run_is_the_same_in_whatever_call(first: int, runs: int) -> None:
    whole, part = monte_carlo(draw, 300, seed=5), monte_carlo(draw, runs, seed=5, first=first)
    for name, array in part.items():
        assert np.array_equal(array, whole[name][..., first : first + runs])


@pytest.mark.parametrize(
    ("runs", "seed", "first"), [(0, 1, 0), (1, -1, 0), (1, 1, 1), (1, 1, -GROUP)]
)
def test_what_cannot_be_is_refused(runs: int, seed: int, first: int) -> None:
    with pytest.raises(ParameterError):
        monte_carlo(draw, runs, seed, first=first)
