"""Kernels, compiled and not, against scipy, LAPACK, and products written out."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from lib.kernels.both_ways import unchanged
from random_filters import random_covariances
from scipy.optimize import least_squares
from scipy.stats import foldnorm, norm

from inswsn_lib.kernels import choose
from inswsn_lib.kernels.arrow_columns import arrow_columns
from inswsn_lib.kernels.descend import descend
from inswsn_lib.kernels.eliminated import eliminated
from inswsn_lib.kernels.horizon_steps import horizon_steps
from inswsn_lib.kernels.mean_sizes import mean_sizes
from inswsn_lib.lmi.stochastic import _first
from inswsn_lib.simulation import position_search as search

DESCEND = [choose("descend"), descend, search._descend]


def each_way(source: Any) -> Any:
    """Let a test run the kernel compiled, and as it stands in its file."""
    return pytest.mark.parametrize("run", [choose(source.__name__), source])


# Positions from ranges ----------------------------------------------------------------------------


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


@pytest.mark.parametrize("run", DESCEND)
@pytest.mark.parametrize("seed", range(12))
def test_positions_are_those_of_scipy(seed: int, run: Any) -> None:
    place, height, distance, windows, start, scale = given = drawn(seed)
    with unchanged(given):
        found = run(*given, search._LIMITS)
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


@pytest.mark.parametrize("run", DESCEND)
def test_no_windows_and_windows_that_tell_nothing(run: Any) -> None:
    """All ranges to one anchor: the start is no further from them than before."""
    one, none, ends = np.zeros((2, 2)), np.zeros(0, dtype=int), (np.inf, search._LIMITS)
    assert run(one[:0], one[:0, 0], one[:0, 0], none, one[:0], *ends).shape == (0, 2)
    with np.errstate(all="ignore"):
        (found,) = run(one, one[0], np.ones(2), np.zeros(1, int), one[:1] + 2, *ends)
    assert np.hypot(*found) == pytest.approx(1.0)


# Matrices -----------------------------------------------------------------------------------------


@each_way(eliminated)
@pytest.mark.parametrize("seed", range(20))
def test_inverses_side_by_side_are_those_of_lapack(seed: int, run: Any) -> None:
    rng = np.random.default_rng(seed)
    filters, n, K = rng.integers(0, 4), rng.integers(1, 7), rng.choice([0, 1, 3, 70])
    each = random_covariances(rng, n, filters, K)
    given = np.ascontiguousarray(np.moveaxis(each, 1, -1))
    with unchanged([given]):
        found = np.moveaxis(run(given), -1, 1)
    assert found == pytest.approx(np.linalg.inv(each), rel=1e-10, abs=1e-10)


@each_way(eliminated)
def test_what_has_no_inverse_is_not_finite(run: Any) -> None:
    with np.errstate(all="ignore"):
        assert not np.isfinite(run(np.ones((1, 2, 2, 1)))).all()


@each_way(arrow_columns)
@pytest.mark.parametrize("seed", range(10))
def test_what_unknowns_do_to_the_parts_of_an_arrow_is_a_product(seed: int, run: Any) -> None:
    rng = np.random.default_rng(seed)
    parts, size, d, unknowns = rng.integers(1, 7, size=4)
    unknown = np.repeat(np.arange(unknowns), rng.integers(1, 3, size=unknowns))
    row, column = rng.integers(0, size, size=(2, len(unknown)))
    J, weight = rng.normal(size=(parts, size, d)), rng.normal(size=len(unknown))
    if seed == 0:
        J[-1, 0, 0] = np.nan  # which spoils no other part
    Q = np.zeros((unknowns, size, size))
    for at in ((row, column), (column, row)):
        np.add.at(Q, (unknown, *at), weight / 2)
    a, b = np.triu_indices(d)
    wanted = np.einsum("cpi,apq,cqj->caij", J, Q, J)[:, :, a, b] * np.where(a == b, 1.0, 2**0.5)
    sound, given = np.isfinite(J).all(axis=(1, 2)), (J, unknown, row, column, weight)
    with unchanged(given):
        np.testing.assert_allclose(run(*given)[sound], wanted[sound], rtol=1e-12, atol=1e-12)


@each_way(horizon_steps)
@pytest.mark.parametrize("seed", range(20))
def test_a_gain_holds_for_as_many_steps_as_by_lapack(seed: int, run: Any) -> None:
    """`test_stochastic` holds it against singular values."""
    rng = np.random.default_rng(seed)
    n, p, outputs, jitters = rng.integers(1, 7, size=4)
    A = rng.standard_normal((n, n)) / n**0.5
    E = 0.3 * rng.standard_normal((jitters - 1, n, n)) / n**0.5
    given = A, E, rng.standard_normal((n, p)), rng.standard_normal((outputs, n))
    gains = np.geomspace(0.1, 1e4, 60)
    with unchanged(given):
        held = [run(*given, gain, 40) for gain in gains]
    assert held == [len(_first(40, *given, gain)) for gain in gains]
    assert held[0] == 0
    assert len(set(held)) > 2


@each_way(horizon_steps)
@pytest.mark.parametrize("first", [1e200, np.inf, np.nan])
def test_a_gain_holds_no_longer_than_numbers_do(first: float, run: Any) -> None:
    """And for no steps, if none are asked for."""
    one, none = np.ones((1, 1)), np.zeros((0, 1, 1))
    with np.errstate(all="ignore"):
        for A, L in ((first * one, one), (one, first * one)):
            assert run(A, none, one, L, 1e150, 5) < 5
    assert run(one, none, one, one, 2.0, 0) == 0


# Means of normal numbers --------------------------------------------------------------------------


@each_way(mean_sizes)
@pytest.mark.parametrize("seed", range(20))
def test_mean_sizes_are_those_of_folded_normals(seed: int, run: Any) -> None:
    """The slope of each by its mean is the probability of + less that of -."""
    rng = np.random.default_rng(seed)
    errors, numbers, cells = rng.integers(1, 40), rng.integers(1, 8), rng.integers(1, 7)
    # from errors that are small beside their noise to those of which it is nothing
    deviation = 10.0 ** rng.uniform(-12, 3, errors)
    mean = rng.random((cells, errors)) * (rng.random((cells, errors)) < 0.5)
    given = rng.normal(size=(errors, numbers)), deviation, mean, rng.normal(size=numbers)
    with unchanged(given):
        sizes, slopes = run(*given)
    error = given[0] @ given[3]
    ratio = np.minimum(np.abs(error) / deviation, 30)  # beyond, scipy loses it
    folded = np.where(ratio < 30, deviation * foldnorm.mean(ratio), np.abs(error))
    assert sizes == pytest.approx(mean @ folded, rel=1e-12, abs=1e-12)
    sign = norm.cdf(error / deviation) - norm.sf(error / deviation)
    assert slopes == pytest.approx((mean * sign) @ given[0], rel=1e-12, abs=1e-12)


@each_way(mean_sizes)
@pytest.mark.parametrize("number", [0.0, np.nan, np.inf, 39.9999, 40.0001, -41.0])
def test_a_single_error_far_out_is_its_own_size(number: float, run: Any) -> None:
    size, slope = run(np.ones((1, 1)), np.ones(1), np.ones((1, 1)), np.array([number]))
    wanted = (2 / np.pi) ** 0.5 if number == 0 else abs(number)
    assert size.item() == pytest.approx(wanted, rel=1e-15, nan_ok=True)
    assert slope.item() == pytest.approx(np.sign(number), rel=1e-15, nan_ok=True)
