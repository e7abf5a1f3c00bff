"""Checks of a filter: on filters that are consistent, and on what is wrong by a known amount."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import pytest
from conftest import WHOLE
from scipy.stats import binom, chi2

from inswsn_lib import ErrorModel
from inswsn_lib.evaluation import FALSE_ALARM
from inswsn_lib.inertial import Innovations, Solution, Start
from inswsn_lib.logs import Finding, check_filter, check_innovations, check_nees
from inswsn_lib.logs.estimates import innovations_of
from inswsn_lib.logs.filter_checks import FilterRun, check_outliers, say_noise

N = 1000
RUNS = 2000 if WHOLE else 500
#: False alarms of so many filters at the stated rate; more come once in ten thousand times
MOST = int(binom.isf(1e-4, RUNS, FALSE_ALARM))


class Filters(NamedTuple):
    """Innovations and errors of filters (steps, 4, runs), and what they say of them."""

    innovations: np.ndarray
    S: np.ndarray
    errors: np.ndarray
    P: np.ndarray


@pytest.fixture(scope="module")
def right() -> Filters:
    """Kalman filters on what their own model has made, with fixes at every second step and gaps."""
    rng, steps, P0 = np.random.default_rng(1), 800, np.diag([1.0, 1.0, 0.01, 0.01])
    model = ErrorModel.p1(0.2, process_noise=(0.001, 0.01), measurement_noise=(0.2, 0.1))
    x = np.empty((steps, 4, RUNS))
    x[0] = np.sqrt(P0) @ rng.normal(size=(4, RUNS))
    for k in range(steps - 1):
        x[k + 1] = model.A @ x[k] + model.B @ rng.normal(size=(4, RUNS))
    y = x + model.D @ rng.normal(size=x.shape)
    y[1::2], y[200:280], y[rng.random(steps) < 0.1] = np.nan, np.nan, np.nan
    run = FilterRun.of(model, y, P0)
    return Filters(run.innovations, run.design.innovation, run.states - x, run.design.filtered)


def found_of(filters: Filters, runs: int, factor: float = 1.0) -> dict[str, list[bool | None]]:
    """Return by check whether filters fit; innovations and errors are so many times as large."""
    told: dict[str, list[bool | None]] = {}
    for r in range(runs):
        every = check_filter(factor * filters.innovations[:, :, r], filters.S)
        for each in [*every, check_nees(factor * filters.errors[:, :, r], filters.P)]:
            told.setdefault(each.name, []).append(each.fits)
    return told


def test_a_consistent_filter_fails_a_check_once_in_a_thousand_times(right: Filters) -> None:
    """With gaps; errors of neighbouring steps hang together."""
    told = found_of(right, RUNS)
    assert {*told} == {"size", "colour", "whiteness", "errors"}
    for name, fits in told.items():
        assert len(fits) == RUNS
        assert fits.count(False) <= MOST, name
        assert fits.count(None) <= (0.1 * RUNS if name == "errors" else 0), name


def test_a_filter_that_takes_its_noise_for_too_small_is_found(right: Filters) -> None:
    """1,300 components tell a fifth, fewer independent errors a half."""
    told = found_of(right, 100, 1.2)
    assert told["size"].count(False) >= 99
    assert told["colour"].count(False) <= 1  # which does not ask for the size
    assert found_of(right, 100, 1.5)["errors"].count(False) >= 75


@pytest.mark.parametrize(("memory", "told"), [(3, 0.9), (10, 0.6), (100, 0.0)])
def test_errors_that_last_are_counted_as_fewer(memory: int, told: float) -> None:
    """Of Gauss-Markov errors, 300 of each: twice the rate at most, and unknown if they last."""
    rng, phi = np.random.default_rng(memory), np.exp(-1 / memory)
    e = np.empty((300, 2, RUNS))
    e[0] = rng.normal(size=e[0].shape)
    for k in range(1, len(e)):
        e[k] = phi * e[k - 1] + np.sqrt(1 - phi**2) * rng.normal(size=e[0].shape)
    P = np.broadcast_to(np.eye(2), (300, 2, 2))
    found = [check_nees(e[:, :, r], P).fits for r in range(RUNS)]
    assert found.count(False) <= binom.isf(1e-4, RUNS, 2 * FALSE_ALARM)
    assert found.count(True) >= told * RUNS


def told(values: np.ndarray, series: np.ndarray | None = None) -> dict[str, Finding]:
    which = np.zeros(len(values), dtype=int) if series is None else series
    return {each.name: each for each in check_innovations(values**2, values, which)}


def test_the_bounds_of_the_size_are_those_of_many_squares() -> None:
    """By the central limit the mean of n squares is within 3.29 sqrt(2/n) of 1, up to 5,000."""
    for count, far in ((2000, 0.104), (5000, 0.0658), (20_000, 0.0658)):
        found = told(np.random.default_rng(1).normal(size=count))["size"]
        assert [found.low, found.high] == pytest.approx([1 - far, 1 + far], abs=4e-3)


def test_what_is_too_small_to_matter_is_not_told_however_long_a_recording_is() -> None:
    rng = np.random.default_rng(3)
    white = rng.normal(size=200_000)
    assert all(each.fits for each in told(1.02 * (white[1:] + 0.02 * white[:-1])).values())
    assert not told(white[1:] + 0.1 * white[:-1])["colour"].fits


@pytest.mark.parametrize(("factor", "says"), [(1.2, "too small"), (0.8, "too large")])
def test_innovations_of_another_size_are_told(factor: float, says: str) -> None:
    found = told(factor * np.random.default_rng(2).normal(size=N))["size"]
    assert found.fits is False
    assert says in found.says
    assert found.value == pytest.approx(factor**2, rel=0.1)
    assert says in say_noise([found])


def test_coloured_innovations_are_told_whichever_series_they_are_of() -> None:
    """One of three series keeps half of its value from row to row."""
    rng = np.random.default_rng(3)
    values = rng.normal(size=(N, 3))
    for k in range(1, N):
        values[k, 1] = 0.5 * values[k - 1, 1] + np.sqrt(0.75) * values[k, 1]
    found = told(values.ravel(), np.tile(np.arange(3), N))
    assert found["size"].fits
    assert found["colour"].fits is False
    assert found["colour"].value == pytest.approx(0.5, abs=0.1)
    assert found["whiteness"].fits is False


def test_a_correlation_at_a_later_lag_is_seen_by_ljung_and_box_alone() -> None:
    values = np.random.default_rng(4).normal(size=N)
    later = values.copy()
    later[5:] = np.sqrt(0.5) * (values[5:] + values[:-5])
    found = told(later)
    assert found["colour"].fits
    assert found["whiteness"].fits is False


def test_a_series_that_changes_its_sign_at_every_step() -> None:
    """Its autocorrelations are (-1)^k, so that Q = (n + 2)/n * sum (n - k), of one lag for each 60.

    With values between that are missing it is the same at every second step.
    """
    n = 200
    values = (-1.0) ** np.arange(n)
    found = told(values)
    assert found["colour"].value == pytest.approx(-1.0)
    assert found["whiteness"].value == pytest.approx((n + 2) / n * np.sum(n - np.arange(1, 4)))
    assert found["whiteness"].high == pytest.approx(chi2.isf(1e-3, 3))
    gaps = np.full((2 * n, 1), np.nan)
    gaps[::2, 0] = values
    with_gaps = check_filter(gaps, np.ones((2 * n, 1, 1)))
    assert [each[1:] for each in map(vars_of, with_gaps)] == [
        pytest.approx(each[1:]) for each in map(vars_of, found.values())
    ]


def vars_of(found: Finding) -> tuple[str, float, float, float]:
    return found.name, found.value, found.low, found.high


def test_innovations_that_are_zero_tell_nothing_of_their_colour() -> None:
    assert {name: x.fits for name, x in told(np.zeros(N)).items()} == {
        "size": False, "colour": None, "whiteness": None,
    }  # fmt: skip


def test_few_innovations_tell_nothing() -> None:
    assert [each.fits for each in told(np.ones(29)).values()] == [None]
    found = told(np.random.default_rng(5).normal(size=60), np.arange(60) % 3)
    fits = {name: each.fits for name, each in found.items()}
    assert fits == {"size": True, "colour": None, "whiteness": None}
    assert say_noise([*found.values()]).endswith("too few to tell colour, whiteness")


def test_outliers_are_counted_by_measurement() -> None:
    time, sizes = np.arange(4.0), [[0, 0], [0, 4.1], [3.9, 3.9], [0]]
    values, series = [np.array(each) for each in sizes], np.array([0, 1, 0, 1, 0, 1, 0])
    told = Innovations(time, values, [1 + 0 * x for x in values], [], np.zeros(4))
    ends = [Start(at, None, np.eye(1)) for at in (-1.0, 9.0)]
    solution = Solution(*[None] * 6, [told], 0.0, *ends)
    found = innovations_of(solution, [(np.array([0, 0, 1, 1, 2, 2, 3.0]), series)])
    assert found["near"].tolist() == [True, True, False, False, True, True, True]
    checked = check_outliers(found.drop_duplicates("measurement")["near"].to_numpy())
    assert (checked.value, checked.fits) == (0.25, False)
    assert check_outliers(np.arange(1000) >= 9).fits
    assert check_outliers(np.empty(0, dtype=bool)).fits
