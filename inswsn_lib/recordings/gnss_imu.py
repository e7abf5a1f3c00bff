"""A car with an IMU of a phone's class at 100 Hz and RTK positions and velocities at 4 Hz.

The recording is drive_0708 of rtklibexplorer/GNSS_IMU (BSD-3). The bytes of its files are known, so
they are read as they are.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from pyins.strapdown import compute_increments_from_imu
from pyins.util import ACCEL_COLS, GYRO_COLS
from scipy.integrate import cumulative_trapezoid

from inswsn_lib.checks import Array
from inswsn_lib.recordings.files import Source, locate

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

#: From a sample to its arrival in the log (s). The files do not tell it: with this one the IMU's
#: forward acceleration agrees best with the RTK speed, early in the drive and late. (The author of
#: the recording stretches the device's time between the tag's start and its end, and takes 0.125 s
#: off. But the first row arrives 0.14 s after the start: his lag changes by as much on the way.)
LATENCY = 0.155
#: The IMU's period on the even grid (s)
PERIOD = 0.01
_STANDARD_GRAVITY = 9.80665  # m/s^2, the unit of the accelerometers
_AXES = np.array([-1.0, 1.0, -1.0])  # the IMU lies with x back, y right, z up
_RATE = 4  # rows of the RTK solution a second
# Of the time tag, in bytes: where the start is, its seconds and their fraction, and the records
_SECONDS, _FRACTION, _RECORDS = 64, 68, 76
_ENDING = 2  # bytes at the end of a line when the log was written; version control keeps one


@dataclass(frozen=True, eq=False)
class Track:
    """Position (latitude, longitude, height; rad, m) and velocity (east, north, up; m/s) by RTK.

    Quality is Q of RTKLIB: 1 with whole-number ambiguities, 2 with real ones, more for less.
    """

    time: Array
    position: Array
    velocity: Array
    quality: NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class RecordedDrive:
    """A recording on even grids: the IMU at 100 Hz, epochs at 1 Hz.

    The epochs are rows of the RTK solution, those nearest to whole GPS seconds; nothing of RTK is
    interpolated. The IMU's grid goes through the epochs.

    Attributes
    ----------
    start : float
        The first epoch, GPS time as RTKLIB counts it: seconds since 1970, without leap seconds.
    time : ndarray, (epochs,)
        Seconds from the first epoch.
    period : float
        Of the IMU (s).
    rotation_increments, velocity_increments : ndarray, (samples, 3)
        As in `Drive` (rad, m/s), along the IMU's axes forward, right, down: how it is mounted in
        the car is not corrected.
    position, velocity : ndarray, (epochs, 3)
        Of RTK: latitude, longitude (rad), height (m), and east, north, up (m/s).
    track : Track
        The whole RTK solution, at 4 Hz, with its quality.
    """

    start: float
    time: Array
    period: float
    rotation_increments: Array
    velocity_increments: Array
    position: Array
    velocity: Array
    track: Track


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
    inswsn_lib.errors.InswsnError: There is no file nowhere...
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
    samples = pd.DataFrame(np.diff(ends, axis=0), grid[1:], [*GYRO_COLS, *ACCEL_COLS])
    increments = compute_increments_from_imu(samples, "increment").to_numpy()[:, 1:]
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
    """Return GPS time (s), and rate (rad/s) and specific force (m/s^2) forward, right, down.

    A row of the log has specific force (g) and rate (deg/s) along x back, y right, z up, and the
    device's time (ms). The first row and the last are parts of rows, and dropped. RTKLIB's time tag
    tells when each piece of the log arrived; a line through the arrivals makes GPS time of the
    device's time, less `LATENCY`.
    """
    lines = path.read_text(encoding="ascii").splitlines()
    values = np.array([line.split(",") for line in lines[1:-1]], dtype=float)
    data = tag.read_bytes()
    start = float(np.frombuffer(data, "<u4", 1, _SECONDS)[0])
    start += float(np.frombuffer(data, "<f8", 1, _FRACTION)[0])
    # records: ms since the start, and how many bytes the log had
    ticks, lengths = np.frombuffer(data, "<u4", offset=_RECORDS).reshape(-1, 2).astype(np.int64).T
    ends = np.cumsum([len(line) + _ENDING for line in lines])[1:-1]
    arrival = ticks[np.searchsorted(lengths, ends)] / 1e3
    device = values[:, 6] / 1e3
    middle = device.mean()
    slope, offset = np.polyfit(device - middle, arrival, 1)
    rate = np.deg2rad(values[:, 3:6]) * _AXES
    force = values[:, :3] * _STANDARD_GRAVITY * _AXES
    time = start + (offset + slope * (device - middle)) - LATENCY
    return time, np.hstack([rate, force])


def _read_positions(path: Path) -> Track:
    """Return the RTK solution with GPS time: RTKLIB counts it as if it had UTC's calendar."""
    lines = path.read_text(encoding="ascii").splitlines()
    rows = [line.split() for line in lines if not line.startswith("%")]
    values = np.array([row[2:] for row in rows], dtype=float)
    moments = np.array([f"{row[0].replace('/', '-')}T{row[1]}" for row in rows], "datetime64[us]")
    return Track(
        time=moments.astype(float) / 1e6,
        position=np.column_stack([np.deg2rad(values[:, :2]), values[:, 2]]),
        velocity=values[:, [14, 13, 15]],
        quality=values[:, 3].astype(np.int64),
    )
