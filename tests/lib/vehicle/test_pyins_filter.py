"""The feedback filter of pyins on a drive, beside this library's."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from lib.vehicle.made_drive import KNOWN, changed, make_drive

from inswsn_lib.errors import ParameterError
from inswsn_lib.vehicle import (
    Drive,
    PeerRun,
    VehicleRun,
    metres,
    run_pyins_filter,
    run_vehicle_filter,
)

LAST = 25
TOLD = replace(KNOWN, yaw=float(np.deg2rad(2)), tilt=float(np.deg2rad(1)))


@cache
def driven() -> Drive:
    """Two runs, aligned 2 degrees off, one of them without some fixes."""
    drive = make_drive(30, 2, seed=9, compass_bias=float(np.deg2rad(2)))
    position, velocity = drive.gps_position.copy(), drive.gps_velocity.copy()
    for k in (7, 12, 13):
        position[k, :, 1] = velocity[k, :, 1] = np.nan
    return changed(drive, gps_position=position, gps_velocity=velocity)


@cache
def both(run: int) -> tuple[VehicleRun, PeerRun]:
    mine = run_vehicle_filter(driven(), TOLD, aiding=False, last=LAST)
    return mine, run_pyins_filter(driven(), TOLD, LAST, run=run, step=0.2)


@pytest.mark.parametrize("run", [0, 1])
def test_the_two_agree(run: int) -> None:
    """To the last fix but one: pyins leaves out a fix at the very end.

    Angles are small here. Where the yaw is unknown to 5 degrees, velocities part by 0.3 of their
    deviation until it is found: the two feed back in their own frames.
    """
    mine, other = both(run)
    assert other.position.shape == other.velocity.shape == (LAST + 1, 3)
    sigma = np.sqrt(np.diagonal(mine.states.covariance, axis1=2, axis2=3)[:, run])
    far = (mine.position[..., run] - other.position) / sigma[:, :3]
    assert np.abs(far[:LAST]).max() < 0.02
    fast = (mine.velocity[..., run] - other.velocity) / sigma[:, 3:6]
    assert np.abs(fast[:LAST]).max() < 0.12


def test_the_two_hear_gps() -> None:
    """Far from what either gives without: the agreement above is not that of an INS alone."""
    mine = both(0)[0]
    deaf = run_vehicle_filter(driven(), TOLD, aiding=False, outages=[(1, LAST + 1)], last=LAST)
    size = metres(mine.states.position[:, 0])
    sigma = np.sqrt(np.diagonal(mine.states.covariance, axis1=2, axis2=3)[:, 0, :3]) * size
    gap = (mine.position[..., 0] - deaf.position[..., 0]) * size
    assert np.abs(gap / sigma)[LAST // 2 : LAST].max() > 1


def test_it_is_near_the_reference() -> None:
    """GPS is good to 3 m; the mean of its errors over half a minute to less."""
    other = both(0)[1]
    true = driven().reference
    gap = (other.position - true.position[: LAST + 1]) * metres(true.position[: LAST + 1])
    assert np.abs(gap[5:]).max() < 8
    assert np.abs(other.velocity - true.velocity[: LAST + 1])[5:].max() < 0.5


@pytest.mark.parametrize("extra", [("compass",), ("mounting",), ("gps",)])
def test_extra_states_are_refused(extra: tuple[str, ...]) -> None:
    with pytest.raises(ParameterError, match="empty for pyins"):
        run_pyins_filter(driven(), replace(KNOWN, extra=extra), LAST)


@pytest.mark.parametrize(("run", "last"), [(2, 5), (-1, 5), (0, 0), (0, 31), (0, -3)])
def test_a_run_or_an_end_that_is_not_there(run: int, last: int) -> None:
    with pytest.raises(ParameterError, match="run and last"):
        run_pyins_filter(driven(), TOLD, last, run=run)
