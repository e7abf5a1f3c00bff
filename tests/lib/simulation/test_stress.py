"""Disturbances: their moments, by closed forms, and what they leave alone."""

from __future__ import annotations

import numpy as np
import pytest

from inswsn_lib.errors import ParameterError
from inswsn_lib.simulation import drifting, heavy_tailed, losing


def test_heavy_tails_have_the_variance_of_students_t() -> None:
    rng = np.random.default_rng(1)
    disturbed = heavy_tailed(rng.standard_normal((2000, 2, 100)), 6.0, rng)
    # nu / (nu - 2); the fourth moment is finite above four degrees, so the mean square settles
    assert np.mean(disturbed**2) == pytest.approx(1.5, rel=0.02)
    # one factor for all components of a fix
    assert np.corrcoef(np.abs(disturbed[:, 0]).ravel(), np.abs(disturbed[:, 1]).ravel())[0, 1] > 0.1


def test_many_degrees_of_freedom_are_gaussian() -> None:
    errors = np.random.default_rng(2).standard_normal((50, 2, 10))
    assert heavy_tailed(errors, 1e9, np.random.default_rng(3)) == pytest.approx(errors, rel=1e-3)


def test_drift_of_a_frozen_acceleration_is_a_parabola() -> None:
    rng, period = np.random.default_rng(4), 0.25
    added = drifting(np.zeros((41, 4, 3)), period, rng, deviation=2.0, correlation_time=1e12)
    time = period * np.arange(41)[:, None, None]
    acceleration = added[1, 2:] / period
    assert added[:, 2:] == pytest.approx(acceleration * time, rel=1e-4, abs=1e-4)
    assert added[:, :2] == pytest.approx(acceleration * time**2 / 2, rel=1e-4, abs=1e-3)


def test_drift_of_white_acceleration_is_a_random_walk() -> None:
    rng, period = np.random.default_rng(5), 0.2
    added = drifting(np.zeros((51, 4, 4000)), period, rng, deviation=0.3, correlation_time=1e-9)
    expected = 0.3 * period * np.sqrt(np.arange(51))
    # standard error of a deviation from 8,000 draws: 0.8 %; five of them
    assert added[:, 2:].std(axis=(1, 2)) == pytest.approx(expected, rel=0.04)


def test_drift_has_the_stated_correlation() -> None:
    added = drifting(
        np.zeros((400, 4, 500)), 0.5, np.random.default_rng(6), deviation=1.0, correlation_time=2.0
    )
    acceleration = np.diff(added[:, 2:], axis=0) / 0.5
    assert acceleration.std() == pytest.approx(1.0, rel=0.03)
    lagged = np.mean(acceleration[4:] * acceleration[:-4]) / np.mean(acceleration**2)
    assert lagged == pytest.approx(np.exp(-1), abs=0.03)


def test_lost_fixes_are_whole_and_the_others_untouched() -> None:
    errors = np.random.default_rng(7).standard_normal((200, 4, 50))
    left = losing(errors, 0.3, np.random.default_rng(8))
    lost = np.isnan(left).any(axis=1)
    assert np.isnan(left).all(axis=1)[lost].all()
    assert lost.mean() == pytest.approx(0.3, abs=0.03)
    assert np.array_equal(left[~np.isnan(left)], errors[~np.isnan(left)])
    assert np.array_equal(losing(errors, 0.0, np.random.default_rng(9)), errors)
    assert np.isnan(losing(errors, 1.0, np.random.default_rng(9))).all()


def test_errors_are_kept_and_whole_numbers_are_taken() -> None:
    errors = np.arange(24).reshape(3, 4, 2)
    drawn = {"period": 0.5, "deviation": 1.0, "correlation_time": 2.0}
    added = drifting(np.zeros((3, 4, 2)), rng=np.random.default_rng(11), **drawn)
    assert drifting(errors, rng=np.random.default_rng(11), **drawn) == pytest.approx(errors + added)
    assert np.array_equal(added[0], np.zeros((4, 2)))


def test_the_drift_is_stationary_from_the_first_step_and_each_axis_has_its_own() -> None:
    added = drifting(
        np.zeros((3, 4, 20_000)), 0.1, np.random.default_rng(12), deviation=2.0, correlation_time=5
    )
    first = added[1, 2:] / 0.1
    # standard errors: 0.5 % of a deviation, 0.007 of a correlation
    assert first.std(axis=1) == pytest.approx([2.0, 2.0], rel=0.03)
    assert abs(np.corrcoef(first)[0, 1]) < 0.035


def test_each_step_and_run_is_disturbed_by_itself() -> None:
    ones = np.ones((60, 2, 60))
    factors = heavy_tailed(ones, 5.0, np.random.default_rng(13))[:, 0]
    assert len(np.unique(factors)) == factors.size
    lost = np.isnan(losing(ones, 0.5, np.random.default_rng(14)))[:, 0]
    # a share of 3,600 draws; of 60 draws in a row or column: some differ, and none is constant
    for line in (*lost, *lost.T):
        assert 0 < line.sum() < 60
    assert len(np.unique(lost, axis=0)) == 60


@pytest.mark.parametrize("errors", [np.zeros((3, 4)), [[1.0]], np.zeros((3, 3, 2))])
def test_errors_of_another_shape_are_refused(errors: np.ndarray) -> None:
    with pytest.raises(ParameterError, match="errors is"):
        drifting(errors, 0.2, np.random.default_rng(1), deviation=0.1, correlation_time=1.0)
    if np.ndim(errors) != 3:
        with pytest.raises(ParameterError, match="errors is"):
            heavy_tailed(errors, 3.0, np.random.default_rng(1))
        with pytest.raises(ParameterError, match="errors is"):
            losing(errors, 0.3, np.random.default_rng(1))


def test_what_cannot_be_is_refused() -> None:
    rng, errors = np.random.default_rng(10), np.zeros((3, 4, 2))
    with pytest.raises(ParameterError, match="degrees"):
        heavy_tailed(errors, 2.0, rng)
    with pytest.raises(ParameterError, match="share"):
        losing(errors, 1.1, rng)
    with pytest.raises(ParameterError, match="degrees"):
        heavy_tailed(errors, np.inf, rng)
    for changed in (
        {"period": 0.0},
        {"correlation_time": 0.0},
        {"deviation": -1.0},
        {"period": np.inf},
        {"deviation": np.nan},
    ):
        given = {"period": 0.2, "deviation": 0.1, "correlation_time": 1.0} | changed
        period = given.pop("period")
        with pytest.raises(ParameterError, match=next(iter(changed))):
            drifting(errors, period, rng, **given)
