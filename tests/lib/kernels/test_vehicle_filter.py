"""The compiled epochs of the vehicle's filter against those in numpy."""

from __future__ import annotations

from dataclasses import fields, replace

import numpy as np
import pytest
from lib.kernels.both_ways import both, unchanged
from lib.vehicle.made_drive import KNOWN, PERIOD, SENSORS, make_drive, off
from scipy.spatial.transform import Rotation

from inswsn_lib.inertial import metres
from inswsn_lib.simulation import Drive
from inswsn_lib.vehicle import FilterSettings, VehicleState
from inswsn_lib.vehicle.filter import _advance

EXTRAS = [(), ("compass",), ("gps", "mounting"), ("mounting", "compass", "gps")]


def with_gaps(spin: float) -> Drive:
    """Twelve seconds with three runs, in which measurements are missing here and there.

    The car spins by up to 0.4 rad a sample.
    """
    drive, rng = make_drive(12, 3, seed=3), np.random.default_rng(3)
    told = {name: getattr(drive, name).copy() for name in SENSORS[2:]}
    for values in told.values():
        values[1:][rng.random(values[1:].shape) < 0.2] = np.nan
    told["gps_position"][5], told["compass"][7] = np.nan, 1.0
    turns = drive.rotation_increments + spin * np.array([[10.0], [-20.0], [30.0]]) * PERIOD
    return replace(drive, rotation_increments=turns, **told)


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
    x[0, 6:9] = [0.5, -0.3, 0.2]
    return VehicleState(
        position=place + 20 * rng.standard_normal((branches, 3)) / metres(place),
        velocity=truth.velocity[4] + rng.standard_normal((branches, 3)),
        attitude=turns @ truth.attitude[4],
        accelerometer_bias=0.1 * rng.standard_normal((branches, 3)),
        gyro_drift=0.01 * rng.standard_normal((branches, 3)),
        error=x, covariance=P,
    )  # fmt: skip


@pytest.mark.parametrize("feedback", [True, False])
@pytest.mark.parametrize("extra", EXTRAS)
@pytest.mark.parametrize("seed", [0, 1])
def test_it_is_the_filter_in_numpy(extra: tuple[str, ...], feedback: bool, seed: int) -> None:
    """Branches of three runs from epochs of their own, with gaps and outages, steps uneven."""
    rng = np.random.default_rng([seed, len(extra)])
    drive, branches = with_gaps(spin=seed), 5
    settings = replace(KNOWN, extra=extra, substeps=int(rng.integers(1, 8)))
    which, begin = rng.integers(0, 3, branches), rng.integers(0, 5, branches)
    heard, sensed = rng.random((2, 8)) < 0.7
    state = begun(drive, settings, branches, seed)
    told = drive, settings, state, which, begin, heard, sensed
    with unchanged([getattr(state, f.name) for f in fields(state)]):
        one, two = both(lambda: _advance(*told, feedback=feedback))
    assert off(one, two) < 1e-6  # where a place is rounded to 1e-9 m
    size = np.sqrt(np.diagonal(two.states.covariance, axis1=2, axis2=3))
    assert np.abs(np.moveaxis(one.first - two.first, 1, 2) / size[..., :3]).max() < 1e-6
    spread = np.moveaxis(np.diagonal(two.innovation_covariances, axis1=1, axis2=2), 2, 1)
    own = np.sqrt(np.where(spread > 0, spread, 1.0))
    assert one.innovations / own == pytest.approx(two.innovations / own, abs=1e-6, nan_ok=True)
    apart = one.innovation_covariances - two.innovation_covariances
    assert np.abs(apart / (own[:, :, None] * own[:, None])).max() < 1e-9
    assert np.isnan(one.innovations).any()
    assert np.isfinite(one.innovations).any()
