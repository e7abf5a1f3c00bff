"""Disturbances: their moments, by closed forms, and what they leave alone."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from inswsn_lib.errors import ParameterError
from inswsn_lib.simulation import drifting, heavy_tailed, losing

TIME = np.linspace(0, 90, 3601)


def rng(seed: int) -> np.random.Generator:
    return np.random.default_rng(seed)


def test_heavy_tails_have_the_variance_of_students_t() -> None:
    normal = rng(1).standard_normal((2000, 2, 100))
    disturbed = heavy_tailed(normal, 6.0, rng(2))
    # nu / (nu - 2); the fourth moment is finite above four degrees, so the mean square settles
    assert np.mean(disturbed**2) == pytest.approx(1.5, rel=0.02)
    # one factor for all components of a fix, and another for each step and run
    factors = disturbed / normal
    assert factors[:, 0] == pytest.approx(factors[:, 1])
    assert len(np.unique(factors[:, 0].round(12))) > 0.999 * 200_000
    # the squared factor is nu over a chi-square of nu: the mean of its inverse is 1
    assert np.mean(factors[:, 0] ** -2) == pytest.approx(1, abs=4 * (2 / 6 / 200_000) ** 0.5)


def test_drift_of_a_frozen_acceleration_is_a_parabola() -> None:
    period, time = 0.25, 0.25 * np.arange(41)[:, None, None]
    added = drifting(np.zeros((41, 4, 3)), period, rng(4), deviation=2.0, correlation_time=1e12)
    acceleration = added[1, 2:] / period
    assert added[:, 2:] == pytest.approx(acceleration * time, rel=1e-4, abs=1e-4)
    assert added[:, :2] == pytest.approx(acceleration * time**2 / 2, rel=1e-4, abs=1e-3)
    errors = np.arange(41 * 12).reshape(41, 4, 3)
    onto = drifting(errors, period, rng(4), deviation=2.0, correlation_time=1e12)
    assert onto == pytest.approx(errors + added)


def test_drift_has_the_stated_deviation_and_correlation_from_the_first_step() -> None:
    added = drifting(np.zeros((41, 4, 20_000)), 0.5, rng(6), deviation=2.0, correlation_time=4.0)
    acceleration = np.diff(added[:, 2:], axis=0) / 0.5
    # standard errors: 0.5 % of a deviation, 0.007 of a correlation; each axis has its own
    assert acceleration.std(axis=2) == pytest.approx(np.full((40, 2), 2.0), rel=0.03)
    assert abs(np.corrcoef(acceleration[0])[0, 1]) < 0.035
    for lag in (1, 8):
        lagged = np.mean(acceleration[lag:] * acceleration[:-lag]) / 4
        assert lagged == pytest.approx(np.exp(-0.5 * lag / 4), abs=0.02)


def test_lost_fixes_are_whole_and_the_others_untouched() -> None:
    errors = rng(7).standard_normal((200, 4, 50))
    left = losing(errors, 0.3, rng(8))
    lost = np.isnan(left)
    assert (lost == lost[:, :1]).all()
    # each by itself: standard errors of the share and of the correlation of neighbours are 0.5, 1 %
    assert lost[:, 0].mean() == pytest.approx(0.3, abs=0.02)
    for one, other in ((lost[1:, 0], lost[:-1, 0]), (lost[:, 0, 1:], lost[:, 0, :-1])):
        assert abs(np.corrcoef(one.ravel(), other.ravel())[0, 1]) < 0.04
    assert np.array_equal(left[~lost], errors[~lost])
    assert np.array_equal(losing(errors, 0.0, rng(9)), errors)
    assert np.isnan(losing(errors, 1.0, rng(9))).all()


DRIFT: dict[str, Any] = {"errors": np.zeros((3, 4, 2)), "period": 1.0, "deviation": 1.0,
                         "correlation_time": 1.0}  # fmt: skip


@pytest.mark.parametrize(
    ("disturb", "right", "changes"),
    [
        (heavy_tailed, {"errors": [[[1.0]]], "degrees": 2.1}, {"errors": 0, "degrees": 2}),
        (losing, {"errors": [[[1.0]]], "share": 0.5}, {"errors": [[1.0]], "share": 1.1}),
        (drifting, DRIFT, {"errors": np.zeros((3, 3, 2)), "period": 0, "deviation": -1,
                           "correlation_time": 0}),
    ],
)  # fmt: skip
def test_what_cannot_be_is_refused(
    disturb: Callable[..., Any], right: dict[str, Any], changes: dict[str, Any]
) -> None:
    disturb(**right, rng=rng(1))
    for name, value in changes.items():
        with pytest.raises(ParameterError, match=f"^{name} must be"):
            disturb(**right | {name: value}, rng=rng(1))
