"""Positions from ranges, compiled, not, and in numpy, are those that scipy finds."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from scipy.optimize import least_squares

from inswsn_lib.kernels import choose
from inswsn_lib.kernels.descend import descend
from inswsn_lib.simulation import position_search as search

FORMS = [choose("descend"), descend, search._descend]


def drawn(seed: int) -> tuple[Any, ...]:
    """Return windows of ranges, some of them to an anchor at the place, some outliers."""
    rng = np.random.default_rng(seed)
    d, counts = 2 + seed % 2, rng.integers(6, 12, rng.integers(1, 12))
    rows = np.repeat(np.arange(len(counts)), counts)
    place = rng.uniform(-20, 20, (len(rows), d))
    height = rng.choice([0.0, 1.5]) * rng.random(len(rows))
    truth = rng.uniform(-10, 10, (len(counts), d))
    at = np.cumsum(counts) - counts
    place[at[:2]] = truth[:2]
    distance = np.sqrt(np.sum((truth[rows] - place) ** 2, axis=1) + height**2)
    distance += 0.3 * rng.normal(size=len(rows)) + 5 * (rng.random(len(rows)) < 0.05)
    start = truth + rng.normal(size=truth.shape)
    return place, height, distance, at, start, (np.inf, 0.4)[seed // 2 % 2]


@pytest.mark.parametrize("run", FORMS)
@pytest.mark.parametrize("seed", range(12))
def test_they_are_those_of_scipy(seed: int, run: Any) -> None:
    place, height, distance, windows, start, scale = given = drawn(seed)
    before = [np.copy(each) for each in given]
    found = run(*given, search._LIMITS)
    assert all(np.array_equal(*each) for each in zip(given, before, strict=True))
    apart = []
    for w, part in enumerate(np.split(np.arange(len(distance)), windows[1:])):

        def miss(p: np.ndarray, part: np.ndarray = part) -> np.ndarray:
            away = np.sqrt(np.sum((p - place[part]) ** 2, axis=1) + height[part] ** 2)
            return np.asarray(distance[part] - away)

        loss = {"loss": "linear"} if np.isinf(scale) else {"loss": "soft_l1", "f_scale": scale}
        ends = dict.fromkeys(("ftol", "xtol", "gtol"), 1e-12)
        near, far = (least_squares(miss, p, **loss, **ends) for p in (found[w], start[w]))
        cost = least_squares(miss, found[w], max_nfev=1, **loss).cost
        # nothing is better, but at an anchor's cusp a little, and another way leads there
        assert min(near.cost, far.cost) > (1 - 1e-5) * cost
        apart.append(np.abs(far.x - found[w]).max())
    assert np.sum(np.array(apart) > 1e-5) <= 1


def test_no_windows_and_windows_that_tell_nothing() -> None:
    """All ranges to one anchor: the start is no further from them than before."""
    one, none = np.zeros((2, 2)), np.zeros(0, dtype=int)
    for run in FORMS:
        args = np.inf, search._LIMITS
        assert run(one[:0], one[:0, 0], one[:0, 0], none, one[:0], *args).shape == (0, 2)
        with np.errstate(all="ignore"):
            (found,) = run(one, one[0], np.ones(2), np.zeros(1, int), one[:1] + 2, *args)
        assert np.hypot(*found) == pytest.approx(1.0)
