"""Monte Carlo: streams that do not depend on how many runs follow."""

from __future__ import annotations

import numpy as np
import pytest

from inswsn_lib.errors import ParameterError
from inswsn_lib.evaluation import GROUP, monte_carlo


def draw(rng: np.random.Generator, runs: int) -> dict[str, np.ndarray]:
    return {"x": rng.standard_normal((3, runs)), "y": rng.random((2, 2, runs))}


@pytest.mark.parametrize(
    ("first", "runs"),
    [(0, 1), (0, GROUP - 1), (0, GROUP), (0, GROUP + 1), (GROUP, 100), (2 * GROUP, 172), (256, 1)],
)
def test_a_run_is_the_same_however_many_follow_and_in_whatever_call(first: int, runs: int) -> None:
    whole, part = monte_carlo(draw, 300, seed=5), monte_carlo(draw, runs, seed=5, first=first)
    for name, array in part.items():
        assert np.array_equal(array, whole[name][..., first : first + runs])


def test_what_a_seed_stands_for() -> None:
    """The streams are those of numpy's seed sequence, one for each group of 64."""
    found = monte_carlo(draw, 2 * GROUP, seed=5)["x"]
    for group in (0, 1):
        rng = np.random.default_rng(np.random.SeedSequence(5, spawn_key=(group,)))
        expected = rng.standard_normal((3, 64))
        assert np.array_equal(found[:, 64 * group : 64 * (group + 1)], expected)


@pytest.mark.parametrize(
    ("runs", "seed", "first", "said"),
    [(0, 1, 0, "runs"), (1, -1, 0, "seed"), (1, 1, 1, "first"), (1, 1, -GROUP, "first")],
)
def test_what_cannot_be_is_refused(runs: int, seed: int, first: int, said: str) -> None:
    with pytest.raises(ParameterError, match=f"^{said} must be"):
        monte_carlo(draw, runs, seed, first=first)


def test_what_is_kept_of_some_runs_at_a_time_is_that_of_all() -> None:
    def largest(drawn: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
        sizes.append(drawn["x"].shape[1])
        return {"x": drawn["x"].max(axis=0)}

    sizes: list[int] = []
    whole = monte_carlo(draw, 300, seed=5, first=GROUP)["x"].max(axis=0)
    found = monte_carlo(draw, 300, seed=5, first=GROUP, keep=largest, at_once=2 * GROUP)
    assert np.array_equal(found["x"], whole)
    assert sizes == [128, 128, 44]
    with pytest.raises(ParameterError, match=r"^at_once must be"):
        monte_carlo(draw, 300, seed=5, keep=largest, at_once=GROUP + 1)
