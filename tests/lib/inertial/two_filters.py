"""What two filters made of P3's simulated drive before they became one, kept as a file.

Until commit e4ca30d one filter knew the round and turning Earth, for P3's car, and another a level
frame that does not turn, for logs. `python tests/lib/inertial/two_filters.py` at that commit
wrote tests/data/two-filters.npz: positions, velocities, attitudes and deviations with GPS, after 40
s without, and when GPS is back.
"""

from __future__ import annotations

from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from lib.vehicle.made_drive import on_the_way
from scipy.spatial.transform import Rotation

import inswsn_lib as iw
from inswsn_lib import inertial as nav
from inswsn_lib.checks import Array
from inswsn_lib.inertial import metres
from inswsn_lib.simulation import Drive
from inswsn_lib.streams import Fixes, Imu
from inswsn_lib.vehicle import FilterSettings, run_vehicle_filter

KEPT = Path(__file__).parents[2] / "data" / "two-filters.npz"
#: GPS is lost after the first of these epochs and until the second
LOST, BACK = 160, 200
EPOCHS = [40, LOST, BACK, BACK + 20]
EXTRA = ("compass", "mounting", "gps")
#: Period of the IMU, epoch of the start, extra states, and how the filter runs
CASES: dict[str, tuple[float, int, tuple[str, ...], dict[str, Any]]] = {
    "aided": (0.02, 0, (), {}),
    "aided, slow IMU": (0.1, 0, (), {}),
    "bare": (0.02, 0, (), {"aided_outages": False}),
    "gps": (0.02, 0, (), {"aiding": False}),
    "gps, slow IMU": (0.1, 0, (), {"aiding": False}),
    "open": (0.02, 0, (), {"feedback": False}),
    "extra": (0.02, 0, EXTRA, {}),
    "extra, open": (0.02, 0, EXTRA, {"feedback": False}),
    "moving": (0.02, 300, (), {}),
}


@cache
def scenario(period: float) -> Any:
    p3 = iw.load_scenario(iw.data_file("scenarios/p3.yaml"))
    return iw.with_values(p3, imu_period=period)


@cache
def drive_of(period: float, begin: int) -> Drive:
    """Return two runs of P3's drive, from an epoch on."""
    drive = iw.simulate_drive(scenario(period), runs=2, seed=52)
    return on_the_way(drive, begin)


def on_the_round_earth(name: str) -> dict[str, Array]:
    """Return what P3's filter makes of a case, by the name of what it is."""
    period, begin, extra, options = CASES[name]
    drive = drive_of(period, begin)
    told = FilterSettings.from_settings(scenario(period), extra=extra)
    run = run_vehicle_filter(
        drive, told, outages=[(LOST + 1, BACK + 1)], last=EPOCHS[-1], **options
    )
    states = run.states[EPOCHS].corrected()
    deviation = np.sqrt(np.diagonal(states.covariance, axis1=2, axis2=3)).copy()
    deviation[..., :3] *= metres(states.position)
    return {
        "position": states.position, "velocity": states.velocity, "attitude": states.attitude,
        "accelerometer_bias": states.accelerometer_bias, "gyro_drift": states.gyro_drift,
        "error": states.error[..., 15:], "deviation": deviation,
        "first": np.moveaxis(run.first[EPOCHS], 1, 2),
    }  # fmt: skip


def in_a_flat_frame(period: float, *, rest: float = 0.02) -> dict[str, Array]:
    """Return what the filter of logs makes of the first run, flat: east, north and up of its start.

    The rates are those of sensors on a turning Earth; all that matters is that both take the same.
    """
    drive = drive_of(period, 300)
    true = drive.reference
    assert true.attitude is not None
    size = metres(true.position[0])

    def local(position: Array) -> Array:
        return ((position - true.position[0]) * size)[:, [1, 0, 2]]

    t = period * np.arange(len(drive.rotation_increments))
    force = drive.velocity_increments[:, :, 0] / period
    imu = Imu(t, drive.rotation_increments[:, :, 0] / period, force)
    noise = nav.ImuNoise(0.02, 0.002, 1e-3, 1e-5)
    lost = np.zeros(len(drive.time), dtype=bool)
    lost[LOST + 1 : BACK + 1] = True
    place, velocity = local(drive.gps_position[:, :, 0]), drive.gps_velocity[:, :, 0].copy()
    place[lost], velocity[lost] = np.nan, np.nan
    here = slice(1, EPOCHS[-1] + 1)
    wrong = Rotation.from_rotvec([rest, -rest, rest]).as_matrix()
    state = nav.InertialState(place[0], velocity[0], true.attitude[0] @ wrong)
    spread = np.repeat([3.0, 0.1, 0.05, 0.05, 0.002], 3)
    solution = nav.run_error_state(
        nav.InertialMotion(imu, noise), nav.Start(0.0, state, np.diag(spread**2)),
        [
            nav.PositionFixes(
                Fixes(drive.time[here], place[here]), np.array([0.5, 0.2, -1.0]),
                np.full(3, 2.0), np.full(3, 2.0), np.full(3, 60.0),
            ),
            nav.Velocities(drive.time[here], velocity[here], np.full(3, 0.1)),
        ],
    )  # fmt: skip
    at = solution.at(drive.time[EPOCHS])
    return {
        "row": np.array([solution.states[k].row for k in at]),
        "deviation": np.sqrt(np.diagonal(solution.covariances[at], axis1=1, axis2=2)),
        "smoothed": nav.smooth(solution).position[at],
    }


def record() -> None:
    """Write what the filters of today make of all cases."""
    found = {f"{c}: {n}": x for c in CASES for n, x in on_the_round_earth(c).items()}
    for period in (0.02, 0.1):
        found |= {f"flat {period}: {n}": x for n, x in in_a_flat_frame(period).items()}
    np.savez_compressed(KEPT, **found)


if __name__ == "__main__":
    record()
