"""The compiled iteration of fixes is the plain one, to what the cost can tell apart."""

from __future__ import annotations

import numpy as np
import pytest

from inswsn_lib.kernels import choose
from inswsn_lib.simulation import multilateration as plain

compiled = choose("descend", plain._descend)
LIMITS = plain.LEAST, plain._ITERATIONS, plain._DAMPING, plain._STUCK, plain._GRADIENT, plain._FLAT


@pytest.mark.parametrize("seed", range(20))
def test_it_is_the_plain_iteration(seed: int) -> None:
    """With lost ranges, outliers, places on a node, and more runs than stand side by side."""
    rng = np.random.default_rng(seed)
    most, places, runs = rng.integers(1, 12), rng.integers(1, 5), rng.choice([1, 63, 64, 130])
    nodes = rng.uniform(-20, 20, (most, 2, places, 1))
    truth = np.where(rng.random(places) < 0.2, nodes[0, :, :, 0], rng.uniform(-10, 10, (2, places)))
    weight = (rng.random((most, places, runs)) < rng.choice([0.4, 0.9, 1.0])).astype(float)
    distances = np.hypot(*np.moveaxis(truth[None, :, :, None] - nodes, 1, 0))
    noise = 0.3 * rng.normal(size=weight.shape) + 5 * (rng.random(weight.shape) < 0.05)
    r = weight * np.abs(distances + noise)
    start = truth[:, :, None] + rng.normal(size=(2, places, runs))
    before = [each.copy() for each in (nodes, r, weight, start)]
    found = compiled(nodes, r, weight, start, LIMITS)
    theirs = plain._descend(nodes, r, weight, start, LIMITS)
    for given, kept in zip((nodes, r, weight, start), before, strict=True):
        assert np.array_equal(given, kept)
    cost, least = (
        (plain._miss(nodes, r, weight, each)[1] ** 2).sum(axis=0) for each in (found, theirs)
    )
    fixed = weight.sum(axis=0) >= plain.LEAST
    assert np.abs(cost - least)[fixed] == pytest.approx(0, abs=1e-9)
    # where the cost is flat, or has two minima, a place is less certain than its cost
    same = np.abs(found - theirs).max(axis=0)[fixed] < 1e-5
    assert same.mean() > 0.98 if same.size else True


def test_no_places_and_no_runs() -> None:
    for places, runs in ((0, 3), (2, 0)):
        nodes, r = np.zeros((4, 2, places, 1)), np.zeros((4, places, runs))
        assert compiled(nodes, r, r, np.zeros((2, places, runs)), LIMITS).size == 0
