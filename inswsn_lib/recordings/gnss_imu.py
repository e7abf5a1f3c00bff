"""A car with an IMU of a phone's class at 100 Hz and RTK positions and velocities at 4 Hz.

The recording is drive_0708 of rtklibexplorer/GNSS_IMU (BSD-3). The bytes of its files are known, so
they are read as they are.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
from scipy.integrate import cumulative_trapezoid

from inswsn_lib.checks import Array
from inswsn_lib.kernels import import_numba_user
from inswsn_lib.recordings.files import Source, locate
from inswsn_lib.recordings.rtklib import LATENCY, read_log, read_solution
from inswsn_lib.vehicle import RecordedDrive, Track

strapdown, util = map(import_numba_user, ("pyins.strapdown", "pyins.util"))

_IMU, _TAG, _POSITIONS = "imu_1934.csv", "imu_1934.csv.tag", "gnss_1934_sf.pos"
DRIVE = Source(
    "rtklibexplorer/GNSS_IMU",
    "8235ee6c5f349db529bf43ad556a3769b346b5a1",
    "data/drive_0708",
    {
        _IMU: "f1126bf3b36efc4bef2dd2c7d93bb2a0e1b4ce714005cbea00a9218ad0b3b7a9",
        _TAG: "d30d13d5641df367559472b91b48325601a87c986bf2bb6af368684a36b5ec96",
        _POSITIONS: "618fba5c7193e8eb448faf95c79c0d198233d5f4e5ad8ffec652893911ff7133",
    },
)

#: The IMU's period on the even grid (s)
PERIOD = 0.01
_AXES = np.array([-1.0, 1.0, -1.0])  # the IMU lies with x back, y right, z up
_RATE = 4  # rows of the RTK solution a second


def load_drive(cache: Path | None = None) -> RecordedDrive:
    """Return the recorded drive; its files are fetched once, or come from a local mirror.

    The IMU's samples are integrated (trapezoids), the integrals interpolated on the grid, and their
    differences taken: what the IMU summed up to is kept. Coning, sculling and the rotation within a
    sample are then corrected as `pyins` does for sensors of increments.

    Parameters
    ----------
    cache : Path, optional
        Folder for what is fetched; the user's cache by default.

    Raises
    ------
    InswsnError
        If the files cannot be fetched (`RecordingUnavailableError`), or the mirror that
        ``INSWSN_DATA`` names lacks one or has another in its place.

    Examples
    --------
    >>> from unittest.mock import patch
    >>> import inswsn_lib as iw
    >>> with patch.dict("os.environ", INSWSN_DATA="nowhere"):
    ...     iw.load_drive()  # doctest: +ELLIPSIS
    Traceback (most recent call last):
        ...
    inswsn_lib.recordings.files.RecordingUnavailableError: There is no file nowhere...
    """
    files = locate(DRIVE, cache)
    time, sensed = _read_imu(files[_IMU], files[_TAG])
    rtk = _read_positions(files[_POSITIONS])
    rows = np.arange(int(np.argmax(rtk.time[:_RATE] % 1)), len(rtk.time), _RATE)  # stamps end .999
    # epochs that the IMU covers, with a sample before the first and a little more
    at = rtk.time[rows]
    rows = rows[(at - 1.5 * PERIOD > time[0]) & (at + 0.5 * PERIOD < time[-1])]
    start, seconds = float(rtk.time[rows[0]]), len(rows) - 1
    grid = PERIOD * np.arange(-1.0, round(seconds / PERIOD) + 1)
    integrals = cumulative_trapezoid(sensed, time - start, axis=0, initial=0)
    ends = np.column_stack([np.interp(grid, time - start, x) for x in integrals.T])
    samples = pd.DataFrame(np.diff(ends, axis=0), grid[1:], [*util.GYRO_COLS, *util.ACCEL_COLS])
    increments = strapdown.compute_increments_from_imu(samples, "increment").to_numpy()[:, 1:]
    shared = slice(rows[0], rows[-1] + 1)
    return RecordedDrive(
        start=start,
        time=np.arange(seconds + 1.0),
        period=PERIOD,
        rotation_increments=increments[:, :3],
        velocity_increments=increments[:, 3:],
        position=rtk.position[rows],
        velocity=rtk.velocity[rows],
        track=Track(
            rtk.time[shared] - start,
            rtk.position[shared],
            rtk.velocity[shared],
            rtk.quality[shared],
        ),
    )


def _read_imu(path: Path, tag: Path) -> tuple[Array, Array]:
    """Return GPS time (s), and rate (rad/s) and specific force (m/s^2) forward, right, down."""
    time, rate, force = read_log(path, tag, LATENCY)
    return time, np.hstack([rate * _AXES, force * _AXES])


def _read_positions(path: Path) -> Track:
    time, values = read_solution(path)
    return Track(
        time=time,
        position=np.column_stack([np.deg2rad(values[:, :2]), values[:, 2]]),
        velocity=values[:, [14, 13, 15]],
        quality=values[:, 3].astype(np.int64),
    )
