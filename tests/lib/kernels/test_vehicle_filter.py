"""The compiled epochs of the vehicle's filter against those in numpy."""

from __future__ import annotations

from dataclasses import fields, replace
from functools import cache
from typing import Any

import numpy as np
import pytest
from lib.vehicle.made_drive import KNOWN, PERIOD, make_drive
from scipy.spatial.transform import Rotation

from inswsn_lib.inertial import metres
from inswsn_lib.kernels import PLAIN
from inswsn_lib.simulation import Drive
from inswsn_lib.vehicle import FilterSettings, VehicleRun, VehicleState
from inswsn_lib.vehicle.filter import _advance

EXTRAS = [(), ("compass",), ("gps", "mounting"), ("mounting", "compass", "gps")]


@cache
def with_gaps() -> Drive:
    """Twelve seconds with three runs, in which measurements are missing here and there."""
    drive, rng = make_drive(12, 3, seed=3), np.random.default_rng(3)
    names = ("gps_position", "gps_velocity", "compass")
    told = {name: getattr(drive, name).copy() for name in names}
    for values in told.values():
        values[1:][rng.random(values[1:].shape) < 0.2] = np.nan
    told["gps_position"][5], told["compass"][7] = np.nan, 1.0
    return replace(drive, **told)


def begun(drive: Drive, settings: FilterSettings, branches: int, seed: int) -> VehicleState:
    """Return where some runs begin, at random near the drive, each with errors that it knows."""
    rng, n = np.random.default_rng(seed), settings.states
    truth = drive.reference
    assert truth.attitude is not None
    root = 0.1 * rng.standard_normal((branches, n, n)) + np.eye(n)
    place = np.broadcast_to(truth.position[4], (branches, 3))
    size = np.sqrt(np.diagonal(settings.initial_covariance(place), axis1=1, axis2=2))[..., None]
    P = root @ np.swapaxes(root, 1, 2) * size * np.swapaxes(size, 1, 2)
    turns = Rotation.from_rotvec(0.1 * rng.standard_normal((branches, 3))).as_matrix()
    x = 0.1 * size[..., 0] * rng.standard_normal((branches, n))
    return VehicleState(
        position=place + 20 * rng.standard_normal((branches, 3)) / metres(place),
        velocity=truth.velocity[4] + rng.standard_normal((branches, 3)),
        attitude=turns @ truth.attitude[4],
        accelerometer_bias=0.1 * rng.standard_normal((branches, 3)),
        gyro_drift=0.01 * rng.standard_normal((branches, 3)),
        error=x, covariance=P,
    )  # fmt: skip


def both(
    monkeypatch: pytest.MonkeyPatch, drive: Drive, settings: FilterSettings, *rest: Any
) -> tuple[VehicleRun, VehicleRun]:
    """Return what the filter makes of a drive, compiled and as plain numpy."""
    monkeypatch.delenv(PLAIN, raising=False)
    compiled = _advance(drive, settings, *rest)
    monkeypatch.setenv(PLAIN, "1")
    return compiled, _advance(drive, settings, *rest)


def assert_alike(one: VehicleRun, two: VehicleRun) -> None:
    """States to a millionth of their own deviation, where a place is rounded to 1e-9 m."""
    deviation = np.sqrt(np.diagonal(two.states.covariance, axis1=2, axis2=3))
    for name, where in (
        ("position", slice(0, 3)), ("velocity", slice(3, 6)),
        ("accelerometer_bias", slice(9, 12)), ("gyro_drift", slice(12, 15)),
        ("error", slice(None)),
    ):  # fmt: skip
        apart = getattr(one.states, name) - getattr(two.states, name)
        assert np.abs(apart / deviation[..., where]).max() < 1e-6
    assert one.states.attitude == pytest.approx(two.states.attitude, abs=1e-9)
    size = deviation[..., None] * deviation[..., None, :]
    assert np.abs((one.states.covariance - two.states.covariance) / size).max() < 1e-9
    apart = np.moveaxis(one.first - two.first, 1, 2) / deviation[..., :3]
    assert np.abs(apart).max() < 1e-6
    spread = np.moveaxis(np.diagonal(two.innovation_covariances, axis1=1, axis2=2), 2, 1)
    own = np.sqrt(np.where(spread > 0, spread, 1.0))
    assert one.innovations / own == pytest.approx(two.innovations / own, abs=1e-6, nan_ok=True)
    size = own[:, :, None] * own[:, None]
    covariances = (run.innovation_covariances / size for run in (one, two))
    assert next(covariances) == pytest.approx(next(covariances), abs=1e-9)


@pytest.mark.parametrize("feedback", [True, False])
@pytest.mark.parametrize("extra", EXTRAS)
@pytest.mark.parametrize("seed", [0, 1])
def test_it_is_the_filter_in_numpy(
    extra: tuple[str, ...], feedback: bool, seed: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Branches of three runs from epochs of their own, with gaps and outages, steps uneven."""
    rng = np.random.default_rng([seed, len(extra)])
    drive, settings = with_gaps(), replace(KNOWN, extra=extra, substeps=int(rng.integers(1, 8)))
    branches = 5
    which, begin = rng.integers(0, 3, branches), rng.integers(0, 5, branches)
    heard, sensed = rng.random((2, 8)) < 0.7
    state = begun(drive, settings, branches, seed)
    kept = {f.name: getattr(state, f.name).copy() for f in fields(state)}
    one, two = both(
        monkeypatch, drive, settings, state, which, begin, heard, sensed, feedback
    )  # fmt: skip
    assert_alike(one, two)
    assert np.isnan(one.innovations).any()
    assert np.isfinite(one.innovations).any()
    assert all(np.array_equal(getattr(state, name), value) for name, value in kept.items())


def test_one_run_without_a_step(monkeypatch: pytest.MonkeyPatch) -> None:
    drive, one_epoch = with_gaps(), np.ones(1, dtype=bool)
    state = begun(drive, KNOWN, 1, 0)
    zero = np.zeros(1, dtype=np.intp)
    one, two = both(
        monkeypatch, drive, KNOWN, state, zero, zero, one_epoch, one_epoch, False
    )  # fmt: skip
    assert np.array_equal(one.states.covariance[0], state.covariance)
    assert_alike(one, two)


def test_it_turns_by_large_angles_alike(monkeypatch: pytest.MonkeyPatch) -> None:
    """A car that spins, 0.4 rad a sample, and an error of half a radian that is fed back."""
    drive = make_drive(6, 1)
    turns = drive.rotation_increments + np.array([0.1, -0.2, 0.3])[:, None] * PERIOD * 100
    drive = replace(drive, rotation_increments=turns)
    state = begun(drive, KNOWN, 1, 5)
    state.error[:, 6:9] = [[0.5, -0.3, 0.2]]
    zero, epochs = np.zeros(1, dtype=np.intp), np.ones(3, dtype=bool)
    assert_alike(*both(monkeypatch, drive, KNOWN, state, zero, zero, epochs, epochs, True))
