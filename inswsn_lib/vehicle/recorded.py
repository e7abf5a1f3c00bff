"""A recorded drive: its original files, what they hold, and a `Drive` with emulated aids.

The recording is drive_0708 of rtklibexplorer/GNSS_IMU (BSD-3): a car with an IMU of a phone's class
at 100 Hz, and RTK positions and velocities at 4 Hz on the roof. The files are not part of this
project: they are fetched, or taken from a local mirror, and their digests are known.
"""

from __future__ import annotations

import contextlib
import logging
import os
import warnings
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from pyins import earth
from pyins.strapdown import compute_increments_from_imu
from pyins.util import ACCEL_COLS, GYRO_COLS

from inswsn_lib.errors import InswsnError, ParameterError
from inswsn_lib.files import DATA_VARIABLE
from inswsn_lib.vehicle.drive import Drive, Place, Reference

with warnings.catch_warnings():
    # pooch imports tqdm, which in a notebook without widgets warns on stderr
    warnings.simplefilter("ignore")
    import pooch

Array = NDArray[np.float64]


_OWNER, _REPOSITORY = "rtklibexplorer", "GNSS_IMU"
_COMMIT = "8235ee6c5f349db529bf43ad556a3769b346b5a1"
_FOLDER = "data/drive_0708"
_URL = f"https://raw.githubusercontent.com/{_OWNER}/{_REPOSITORY}/{_COMMIT}/{_FOLDER}/"
_PLACE = Path(f"{_OWNER}__{_REPOSITORY}", _COMMIT, _FOLDER)
_IMU, _TAG, _POSITIONS = "imu_1934.csv", "imu_1934.csv.tag", "gnss_1934_sf.pos"
_DIGESTS = {
    _IMU: "f1126bf3b36efc4bef2dd2c7d93bb2a0e1b4ce714005cbea00a9218ad0b3b7a9",
    _TAG: "d30d13d5641df367559472b91b48325601a87c986bf2bb6af368684a36b5ec96",
    _POSITIONS: "618fba5c7193e8eb448faf95c79c0d198233d5f4e5ad8ffec652893911ff7133",
}
# To connect, and between two pieces of an answer (s).
_TIMEOUT = (10.0, 30.0)

#: From a sample to its arrival in the log (s). The files do not tell it: with this one the IMU's
#: forward acceleration agrees best with the RTK speed, early in the drive and late. (The author of
#: the recording stretches the device's time between the tag's start and its end, and takes 0.125 s
#: off. But the first row arrives 0.14 s after the start: his lag changes by as much on the way.)
LATENCY = 0.155
#: The IMU's period on the even grid (s)
PERIOD = 0.01
#: Standard gravity, the unit of the accelerometers (m/s^2)
STANDARD_GRAVITY = 9.80665
# The IMU lies with x back, y right, z up: its axes to forward, right, down.
_AXES = np.array([-1.0, 1.0, -1.0])

_IMU_COLUMNS = (
    *(f"specific force {axis} (g)" for axis in "xyz"),
    *(f"rate {axis} (deg/s)" for axis in "xyz"),
    "device time (ms)",
)
_POSITION_COLUMNS = (
    "GPST", "latitude(deg)", "longitude(deg)", "height(m)", "Q", "ns",
    "sdn(m)", "sde(m)", "sdu(m)", "sdne(m)", "sdeu(m)", "sdun(m)", "age(s)", "ratio",
    "vn(m/s)", "ve(m/s)", "vu(m/s)",
)  # fmt: skip
_LATITUDE, _LONGITUDE, _HEIGHT, _QUALITY = 0, 1, 2, 3
_NORTH, _EAST, _UP = 13, 14, 15

# The time tag of RTKLIB: its name, the bytes before the records, and where the time is in them.
_MAGIC, _HEADER, _SECONDS, _FRACTION = b"TIMETAG RTKLIB", 76, 64, 68
# An IMU tells little in fewer rows than this.
_FEWEST = 10
# Specific force in the median (g): of a car on a road it is near 1.
_LIGHTEST, _HEAVIEST = 0.8, 1.25
# The greatest rate of a drive (deg/s): turns have more than the first, a car less than the second.
_SLOWEST, _FASTEST = 1.0, 1000.0
# The IMU may be silent for this long (s).
_SILENCE = 0.1
# The device's clock and the log's may differ by this share, and by this much anywhere (s).
_CLOCKS, _STRAY = 0.01, 0.25
# Stamps of positions have three decimals (s).
_STAMP = 0.002
# Velocities and positions, rates and courses may differ by this share.
_SHARE = 0.25
# A course is known well above this speed (m/s), and turns tell a unit above this rate (rad/s).
_STEADY, _TURNING = 3.0, 0.05
_LIKENESS = 0.8


class DriveUnavailableError(InswsnError):
    """The files of the recorded drive cannot be had: no network, and no local mirror.

    Examples
    --------
    It is raised as well where the cache cannot be written, here because a file is in its place:

    >>> import os
    >>> from pathlib import Path
    >>> from tempfile import TemporaryDirectory
    >>> from unittest.mock import patch
    >>> from inswsn_lib.vehicle import DriveUnavailableError, load_drive
    >>> with TemporaryDirectory() as folder, patch.dict(os.environ, {"INSWSN_DATA": ""}):
    ...     _ = Path(folder, "taken").write_text("")
    ...     try:
    ...         load_drive(cache=Path(folder, "taken"))
    ...     except DriveUnavailableError as error:
    ...         print("without the drive:", type(error).__mro__[1].__name__)
    without the drive: InswsnError
    """


@dataclass(frozen=True, eq=False)
class ImuRecording:
    """The IMU's samples as they were taken.

    Attributes
    ----------
    time : ndarray, (samples,)
        GPS time as RTKLIB counts it: seconds since 1970, without leap seconds.
    specific_force : ndarray, (samples, 3)
        Forward, right, down, along the IMU's axes (m/s^2).
    rate : ndarray, (samples, 3)
        The angular rate about the same axes (rad/s).
    """

    time: Array
    specific_force: Array
    rate: Array


@dataclass(frozen=True, eq=False)
class Track:
    """The RTK solution, in even steps.

    Attributes
    ----------
    time : ndarray, (rows,)
        Of a file: GPS time as in `ImuRecording`. Of a drive: seconds from its first epoch.
    position : ndarray, (rows, 3)
        Latitude and longitude (rad), height above the ellipsoid (m).
    velocity : ndarray, (rows, 3)
        East, north, up (m/s).
    quality : ndarray of int, (rows,)
        Q of RTKLIB: 1 with whole-number ambiguities, 2 with real ones, more for less.

    Examples
    --------
    Speed and course follow from the velocity:

    >>> import numpy as np
    >>> from inswsn_lib.vehicle.recorded import Track
    >>> velocity = np.array([[3.0, 4.0, 0.0], [5.0, 0.0, 0.0]])  # east, north, up
    >>> track = Track(np.array([0.0, 0.25]), np.zeros((2, 3)), velocity, np.array([1, 2]))
    >>> track.speed.tolist(), np.degrees(track.course).round(1).tolist()
    ([5.0, 5.0], [36.9, 90.0])
    """

    time: Array
    position: Array
    velocity: Array
    quality: NDArray[np.int64]

    @property
    def speed(self) -> Array:
        """Speed over ground (m/s), (rows,)."""
        return np.asarray(np.hypot(self.velocity[:, 0], self.velocity[:, 1]))

    @property
    def course(self) -> Array:
        """Course over ground (rad), clockwise from north, in (-pi, pi], (rows,)."""
        return np.asarray(np.arctan2(self.velocity[:, 0], self.velocity[:, 1]))


@dataclass(frozen=True, eq=False)
class RecordedDrive:
    """The recording on even grids: the IMU at 100 Hz, epochs at 1 Hz.

    The epochs are the rows of the RTK solution that are nearest to whole GPS seconds, as they are
    (their stamps end in .999); nothing of RTK is interpolated. The IMU's grid goes through the
    epochs.

    Attributes
    ----------
    start : float
        The first epoch, GPS time as in `ImuRecording`.
    time : ndarray, (epochs,)
        Seconds from the first epoch, 1 s apart.
    period : float
        Of the IMU (s).
    rotation_increments, velocity_increments : ndarray, (samples, 3)
        As in `Drive` (rad, m/s), along the IMU's axes forward, right, down: how the IMU is mounted
        in the car is not corrected. samples is (epochs - 1) times 100.
    position : ndarray, (epochs, 3)
        RTK latitude and longitude (rad), height (m).
    velocity : ndarray, (epochs, 3)
        RTK east, north, up (m/s).
    track : Track
        The whole RTK solution from the first epoch to the last.

    Examples
    --------
    One of the same form can be made: a car that is parked, with an IMU that is at rest.

    >>> import numpy as np
    >>> from inswsn_lib.vehicle import RecordedDrive
    >>> from inswsn_lib.vehicle.recorded import Track
    >>> position, velocity = np.zeros((3, 3)), np.zeros((3, 3))
    >>> track = Track(np.arange(3.0), position, velocity, quality=np.array([1, 1, 2]))
    >>> parked = RecordedDrive(
    ...     start=1.4e9, time=np.arange(3.0), period=0.01, rotation_increments=np.zeros((200, 3)),
    ...     velocity_increments=np.tile([0.0, 0.0, -0.0978], (200, 1)), position=position,
    ...     velocity=velocity, track=track,
    ... )
    >>> round(parked.fixed_share, 2)
    0.67
    """

    start: float
    time: Array
    period: float
    rotation_increments: Array
    velocity_increments: Array
    position: Array
    velocity: Array
    track: Track

    @property
    def fixed_share(self) -> float:
        """The share of the RTK solution with whole-number ambiguities (Q is 1)."""
        return float(np.mean(self.track.quality == 1))


def load_drive(cache: Path | None = None) -> RecordedDrive:
    """Return the recorded drive: fetch, read and resample it.

    Parameters
    ----------
    cache : Path, optional
        As in `fetch_drive`.

    Returns
    -------
    RecordedDrive
        At 100 Hz and 1 Hz.

    Raises
    ------
    DriveUnavailableError
        If the files cannot be fetched.
    InswsnError
        If a local mirror lacks a file or has a wrong one.

    Examples
    --------
    The recorded data are not part of the project. A mirror that is named and is not there is
    refused:

    >>> import os
    >>> from unittest.mock import patch
    >>> from inswsn_lib.vehicle import load_drive
    >>> with patch.dict(os.environ, {"INSWSN_DATA": "no-such-folder"}):
    ...     load_drive()  # doctest: +ELLIPSIS
    Traceback (most recent call last):
        ...
    inswsn_lib.errors.InswsnError: INSWSN_DATA is 'no-such-folder', which is not a folder; ...
    """
    files = fetch_drive(cache)
    return resample(read_imu(files[_IMU], files[_TAG]), read_positions(files[_POSITIONS]))


def fetch_drive(cache: Path | None = None) -> dict[str, Path]:
    """Return where the three original files are; fetch those that are not there.

    If the environment variable `DATA_VARIABLE` is set, it names a local mirror, and nothing is
    fetched. Else the files come from GitHub once and stay in the cache, which has a mirror's
    layout. Digests are checked each time.

    Parameters
    ----------
    cache : Path, optional
        Folder for what is fetched; the user's cache by default.

    Returns
    -------
    dict of str to Path
        By file name.

    Raises
    ------
    DriveUnavailableError
        If a file cannot be fetched, or what came is not the file.
    InswsnError
        If the mirror is not a folder, lacks a file, or has one with a wrong digest.
    """
    mirror = os.environ.get(DATA_VARIABLE)
    if mirror:
        return _from_mirror(Path(mirror))
    store = pooch.create(
        path=(cache or pooch.os_cache("inswsn")) / _PLACE,
        base_url=_URL,
        registry={name: f"sha256:{digest}" for name, digest in _DIGESTS.items()},
    )
    with _quiet(pooch.get_logger()):
        return {name: _fetch(store, name) for name in _DIGESTS}


def _from_mirror(root: Path) -> dict[str, Path]:
    if not root.is_dir():
        raise InswsnError(
            f"{DATA_VARIABLE} is {str(root)!r}, which is not a folder; it may name a local mirror "
            "of the recorded data."
        )
    files = {name: root / _PLACE / name for name in _DIGESTS}
    for name, path in files.items():
        if not path.is_file():
            raise InswsnError(
                f"There is no file {path}; the mirror that {DATA_VARIABLE} names may have it."
            )
        if pooch.file_hash(str(path)) != _DIGESTS[name]:
            raise InswsnError(
                f"{path} is not the original {name}: its SHA-256 does not begin with "
                f"{_DIGESTS[name][:12]}."
            )
    return files


def _fetch(store: pooch.Pooch, name: str) -> Path:
    try:
        return Path(store.fetch(name, downloader=pooch.HTTPDownloader(timeout=_TIMEOUT)))
    except (OSError, ValueError) as error:  # requests' errors are OSErrors; ValueError: the digest
        said = type(error).__name__ if isinstance(error, OSError) else "its SHA-256 is another"
        raise DriveUnavailableError(
            f"The recorded drive's file {name} could not be fetched from {_URL} ({said}); "
            f"{DATA_VARIABLE} may name a local mirror of it."
        ) from None


@contextlib.contextmanager
def _quiet(logger: logging.Logger) -> Iterator[None]:
    """Keep pooch from telling on stderr what it fetches."""
    level = logger.level
    logger.setLevel(logging.ERROR)
    try:
        yield
    finally:
        logger.setLevel(level)


def read_imu(path: Path, tag: Path) -> ImuRecording:
    """Read the IMU's log and its time tag.

    A row of the log has specific force (g) and rate (deg/s) along x back, y right, z up, and the
    device's time (ms). The first row and the last are parts of rows, and dropped. The time tag
    tells when each piece of the log arrived; a line through the arrivals makes GPS time of the
    device's time, less `LATENCY`.

    Parameters
    ----------
    path, tag : Path
        The log, a CSV file without a header, and RTKLIB's time tag of it.

    Raises
    ------
    InswsnError
        In one sentence, with column and row where there is one, if a file is missing, empty, cut or
        of another kind; a row has a wrong number of cells, or a cell that is no finite number; the
        device's time repeats, goes back or jumps, or is not that of the tag; or values are not
        plausible in g and deg/s.
    """
    lines = _text(path).split("\n")
    endings = len(lines) - 1
    if not lines[-1]:
        lines.pop()
    if len(lines) < _FEWEST + 2:
        raise InswsnError(f"{path} has {len(lines)} rows; it may have {_FEWEST + 2} or more.")
    log = _read_tag(tag)
    values = _numbers(path, [line.split(",") for line in lines[1:-1]], _IMU_COLUMNS, first_row=2)
    device = values[:, 6]
    _check_increasing(path, _IMU_COLUMNS[6], device / 1e3, first_row=2, longest=_SILENCE)
    _check_imu_units(path, values)
    ends = _line_ends(path, tag, lines, endings, int(log.places[-1]))[1:-1]
    arrival = log.ticks[np.searchsorted(log.places, ends)]
    return ImuRecording(
        time=log.start + _arrivals_line(path, tag, device / 1e3, arrival) - LATENCY,
        specific_force=values[:, :3] * STANDARD_GRAVITY * _AXES,
        rate=np.deg2rad(values[:, 3:6]) * _AXES,
    )


@dataclass(frozen=True, eq=False)
class _TimeTag:
    """Start (GPS time, s), and when (s from the start) the log had grown to which byte."""

    start: float
    ticks: Array
    places: NDArray[np.int64]


def _read_tag(path: Path) -> _TimeTag:
    """Read a time tag as RTKLIB's stream.c writes it, all little-endian.

    60 bytes of name, the tick of the start (uint32, ms of no known origin), its GPS time (uint32
    seconds, float64 fraction); then records of tick from the start (uint32, ms) and length of the
    log (uint32, bytes).
    """
    data = _bytes(path)
    if not data.startswith(_MAGIC):
        raise InswsnError(f"{path} is not a time tag of RTKLIB: it does not begin as one.")
    if len(data) < _HEADER + 16 or (len(data) - _HEADER) % 8:
        raise InswsnError(
            f"{path} is cut: it has {len(data)} bytes; a time tag may have {_HEADER} and 8 for "
            "each of two or more records."
        )
    seconds = np.frombuffer(data, "<u4", 1, _SECONDS)[0]
    start = float(seconds) + float(np.frombuffer(data, "<f8", 1, _FRACTION)[0])
    records = np.frombuffer(data, "<u4", offset=_HEADER).reshape(-1, 2).astype(np.int64)
    back = (np.diff(records, axis=0) < 0).any(axis=1)
    if back.any():
        raise InswsnError(
            f"{path} goes back in record {int(np.argmax(back)) + 2}; times and lengths may only "
            "increase."
        )
    return _TimeTag(start, records[:, 0] / 1e3, records[:, 1])


def _line_ends(path: Path, tag: Path, lines: list[str], endings: int, length: int) -> Array:
    """Return the byte that each line ended with in the log as it was written.

    Version control may have changed two bytes at the end of each line into one, or one into two.
    """
    lengths = np.array([len(line.rstrip("\r")) for line in lines])
    for ending in (1, 2):
        if lengths.sum() + ending * endings == length:
            return np.cumsum(lengths + ending)
    raise InswsnError(
        f"{path} has {lengths.sum() + endings} bytes where {tag} tells of {length}; one of them is "
        "cut, or they are not of one recording."
    )


def _arrivals_line(path: Path, tag: Path, device: Array, arrival: Array) -> Array:
    """Return the device's times (s) on the log's clock: the line through the arrivals."""
    middle = device.mean()
    slope, offset = np.polyfit(device - middle, arrival, 1)
    line = np.asarray(offset + slope * (device - middle))
    stray = np.abs(arrival - line)
    what = ""
    if abs(slope - 1) > _CLOCKS:
        what = f"goes {1 / slope:.3g} times as fast"
    elif stray.max() > _STRAY:
        what = f"is {stray.max():.2g} s off in row {int(np.argmax(stray)) + 2}"
    if what:
        raise InswsnError(
            f"{path}: {_IMU_COLUMNS[6]} {what}, by the arrivals in {tag}; both may be of one "
            "recording, without a gap, the device's time in ms."
        )
    return line


def _check_imu_units(path: Path, values: Array) -> None:
    force = float(np.median(np.linalg.norm(values[:, :3], axis=1)))
    if not _LIGHTEST <= force <= _HEAVIEST:
        ratios = {"m/s^2": STANDARD_GRAVITY, "mg": 1e3}
        looks = [unit for unit, size in ratios.items() if _LIGHTEST < force / size < _HEAVIEST]
        raise InswsnError(
            f"{path} has a specific force of {force:.4g} in the median{_as_with(looks)}; on a road "
            "it may be near 1, in g."
        )
    rate = float(np.abs(values[:, 3:6]).max())
    if not _SLOWEST <= rate <= _FASTEST:
        looks = ["rad/s"] if rate < _SLOWEST else []
        raise InswsnError(
            f"{path} has rates of at most {rate:.4g}{_as_with(looks)}; those of a drive may be "
            f"from {_SLOWEST:g} to {_FASTEST:g}, in deg/s."
        )


def _as_with(units: Sequence[str]) -> str:
    return f", as with {units[0]}" if units else ""


def read_positions(path: Path) -> Track:
    """Read an RTK solution that RTKLIB wrote: latitude, longitude, height, and velocities.

    Parameters
    ----------
    path : Path
        A ``.pos`` file in GPS time, in even steps that fill a second.

    Raises
    ------
    InswsnError
        In one sentence, with column and row (line of the file) where there is one, if the file is
        missing, empty or cut; its columns are others, or its time is not GPS time; a row has a
        wrong number of cells, or a cell that is no finite number; times repeat, go back, or are
        not even; there is no such latitude, longitude or Q; or the velocities are not those of the
        positions, as with another unit or order.
    """
    lines = _text(path).split("\n")
    if lines.pop():
        raise InswsnError(f"{path} is cut: its last row has no end.")
    first = next((i for i, line in enumerate(lines) if not line.startswith("%")), len(lines))
    names = _read_header(path, lines[:first])
    rows = [line.split() for line in lines[first:]]
    if len(rows) < _FEWEST:
        raise InswsnError(f"{path} has {len(rows)} rows of positions; it may have {_FEWEST}.")
    _check_cells(path, rows, len(names) + 1, first + 1)
    time = np.array([_gps_time(path, row[:2], i) for i, row in enumerate(rows, start=first + 1)])
    values = _numbers(path, [row[2:] for row in rows], names[1:], first_row=first + 1)
    _check_increasing(path, names[0], time, first_row=first + 1)
    _check_even(path, time, first_row=first + 1)
    _check_ranges(path, values, first_row=first + 1)
    track = Track(
        time=time,
        position=np.column_stack(
            [np.deg2rad(values[:, [_LATITUDE, _LONGITUDE]]), values[:, _HEIGHT]]
        ),
        velocity=values[:, [_EAST, _NORTH, _UP]],
        quality=values[:, _QUALITY].astype(np.int64),
    )
    _check_velocities(path, track)
    return track


def _read_header(path: Path, comments: list[str]) -> list[str]:
    names = next(
        (line.lstrip("% ").split() for line in comments if _POSITION_COLUMNS[1] in line), None
    )
    if names is None:
        raise InswsnError(f"{path} has no line that begins with % and names its columns.")
    for number, wanted in enumerate(_POSITION_COLUMNS):
        got = names[number] if number < len(names) else "none"
        if got != wanted:
            raise InswsnError(
                f"{path} has the column {got!r} as number {number + 1}, not {wanted}."
            )
    return names


def _gps_time(path: Path, cells: Sequence[str], row: int) -> float:
    text = " ".join(cells)
    try:
        # the zone is a formality: RTKLIB counts GPS time as if it had UTC's calendar
        moment = datetime.strptime(text, "%Y/%m/%d %H:%M:%S.%f").replace(tzinfo=UTC)
    except ValueError:
        raise InswsnError(
            f"{path} has {text[:40]!r} in column GPST, row {row}; it may be a date and a time."
        ) from None
    return moment.timestamp()


def _check_even(path: Path, time: Array, first_row: int) -> None:
    """Refuse times that are not a whole number of even steps a second."""
    rate = _rows_a_second(time)
    off = np.abs(time - time[0] - np.arange(time.size) / rate) > _STAMP
    if off.any():
        raise InswsnError(
            f"{path} leaves its even steps of {1 / rate:.4g} s in row "
            f"{int(np.argmax(off)) + first_row}; no row may be missing, and steps may fill a "
            "second."
        )


def _check_ranges(path: Path, values: Array, first_row: int) -> None:
    quality = values[:, _QUALITY]
    wrong = np.column_stack(
        [
            np.abs(values[:, _LATITUDE]) > 90,
            np.abs(values[:, _LONGITUDE]) > 180,
            np.zeros(len(values), dtype=bool),
            (quality != np.round(quality)) | (quality < 1) | (quality > 7),
        ]
    )
    if wrong.any():
        row, column = (int(i[0]) for i in np.nonzero(wrong))
        raise InswsnError(
            f"{path} has {values[row, column]:.9g} in column {_POSITION_COLUMNS[column + 1]}, row "
            f"{row + first_row}; there is no such value."
        )


def _check_velocities(path: Path, track: Track) -> None:
    """Compare what velocities add up to with where the car went, second by second."""
    whole = slice(None, None, _rows_a_second(track.time))
    latitude, _, height = track.position[whole].T
    north, _, east = earth.principal_radii(np.rad2deg(latitude), height)
    sizes = np.column_stack([east, north])[1:]
    went = np.diff(track.position[whole, [1, 0]], axis=0) * sizes
    told = np.diff(_integral(track.time, track.velocity[:, :2])[whole], axis=0)
    apart = _rms(went - told)
    # two fixes are a decimetre apart at rest
    if apart > _SHARE * max(_rms(went), _rms(told)) + 0.1:
        raise InswsnError(
            f"{path}: velocities and changes of position are {_rms(told):.3g} m and "
            f"{_rms(went):.3g} m a second, and {apart:.3g} m apart; vn, ve, vu may be in m/s, "
            "latitude and longitude in degrees."
        )


def _rows_a_second(time: Array) -> int:
    return max(1, round(1 / float(np.median(np.diff(time)))))


def _rms(values: Array) -> float:
    """Return the root mean square of numbers (n,), or of the lengths of vectors (n, m)."""
    return float(np.sqrt(np.sum(values**2) / len(values)))


def resample(imu: ImuRecording, track: Track) -> RecordedDrive:
    """Put a recording on even grids; the time that IMU and RTK share is kept.

    The IMU's samples are integrated (trapezoids), the integrals interpolated on the grid, and their
    differences taken: what the IMU summed up to is kept. Coning, sculling and the rotation within a
    sample are then corrected as `pyins` does for sensors of increments.

    Parameters
    ----------
    imu : ImuRecording
        The samples.
    track : Track
        The RTK solution, as `read_positions` returns it.

    Raises
    ------
    InswsnError
        If the two share less than 2 s, or the IMU's turns are not those of the course.
    """
    rows = _epochs(imu, track)
    start = float(track.time[rows[0]])
    seconds = len(rows) - 1
    # pyins wants one more sample, before the first
    grid = PERIOD * np.arange(-1.0, round(seconds / PERIOD) + 1)
    rotation, velocity = (
        integrate_to_grid(imu.time - start, x, grid) for x in (imu.rate, imu.specific_force)
    )
    increments = _correct(grid, rotation, velocity)
    shared = slice(rows[0], rows[-1] + 1)
    drive = RecordedDrive(
        start=start,
        time=np.arange(seconds + 1.0),
        period=PERIOD,
        rotation_increments=increments[:, :3],
        velocity_increments=increments[:, 3:],
        position=track.position[rows],
        velocity=track.velocity[rows],
        track=Track(
            time=track.time[shared] - start,
            position=track.position[shared],
            velocity=track.velocity[shared],
            quality=track.quality[shared],
        ),
    )
    _check_turns(drive)
    return drive


def _epochs(imu: ImuRecording, track: Track) -> NDArray[np.intp]:
    """Return the rows nearest to whole seconds that the IMU covers."""
    rate = _rows_a_second(track.time)
    first = int(np.argmin(np.abs(track.time[:rate] - np.round(track.time[:rate]))))
    rows: NDArray[np.intp] = np.arange(first, len(track.time), rate, dtype=np.intp)
    time = track.time[rows]
    # a sample before the first epoch, and a little more
    rows = rows[(time - 1.5 * PERIOD > imu.time[0]) & (time + 0.5 * PERIOD < imu.time[-1])]
    if len(rows) < 3:
        raise InswsnError(
            f"The IMU's log goes from {_clock(imu.time[0])} to {_clock(imu.time[-1])} and the RTK "
            f"solution from {_clock(track.time[0])} to {_clock(track.time[-1])} GPS time; they may "
            "share 2 s or more."
        )
    return rows


def _clock(time: float) -> str:
    return datetime.fromtimestamp(float(time), tz=UTC).strftime("%Y/%m/%d %H:%M:%S")


def integrate_to_grid(time: Array, values: Array, grid: Array) -> Array:
    """Return the integrals of sampled values between the points of a grid.

    Parameters
    ----------
    time : ndarray, (samples,)
        Of the samples (s), increasing.
    values : ndarray, (samples, n)
        The samples, which straight lines join.
    grid : ndarray, (points,)
        Within the samples' time (s), increasing.

    Returns
    -------
    ndarray, (points - 1, n)
        Between two samples an integral grows evenly.

    Raises
    ------
    ParameterError
        If the grid leaves the samples' time.
    """
    if grid[0] < time[0] or grid[-1] > time[-1]:
        raise ParameterError(
            "grid", f"{grid[0]:g} to {grid[-1]:g} s", f"within {time[0]:g} to {time[-1]:g} s"
        )
    integral = _integral(time, values)
    return np.diff(np.column_stack([np.interp(grid, time, x) for x in integral.T]), axis=0)


def _integral(time: Array, values: Array) -> Array:
    """Return the integral by trapezoids, of the values' shape, from zero."""
    pieces = np.diff(time)[:, None] * (values[1:] + values[:-1]) / 2
    return np.vstack([np.zeros((1, values.shape[1])), np.cumsum(pieces, axis=0)])


def _correct(grid: Array, rotation: Array, velocity: Array) -> Array:
    """Return corrected increments of rotation and velocity, (samples - 1, 6)."""
    table = pd.DataFrame(
        np.hstack([rotation, velocity]), index=grid[1:], columns=[*GYRO_COLS, *ACCEL_COLS]
    )
    return np.asarray(compute_increments_from_imu(table, "increment").to_numpy()[:, 1:])


def _check_turns(drive: RecordedDrive) -> None:
    """Refuse an IMU whose turns are not those of the course: another drive, or another unit."""
    course = np.arctan2(drive.velocity[:, 0], drive.velocity[:, 1])
    told = np.diff(np.unwrap(course))
    moving = np.hypot(drive.velocity[:, 0], drive.velocity[:, 1]) > _STEADY
    moving = moving[1:] & moving[:-1]
    turned = drive.rotation_increments[:, 2].reshape(len(told), -1).sum(axis=1)
    told, turned = told[moving], turned[moving]
    if told.size < _FEWEST or _rms(told) < _TURNING:
        return
    likeness = float(told @ turned / np.sqrt((told @ told) * (turned @ turned)))
    ratio = _rms(turned) / _rms(told)
    if likeness < _LIKENESS or not 1 / (1 + _SHARE) < ratio < 1 + _SHARE:
        raise InswsnError(
            f"The IMU turns {ratio:.3g} times as much as the RTK course, with a correlation of "
            f"{likeness:.2g}; both may be of one drive, the IMU's rates in deg/s, its z axis up."
        )


def emulate_sensors(
    recorded: RecordedDrive,
    *,
    runs: int,
    seed: int,
    gps_position_sd: float = 3.0,
    gps_velocity_sd: float = 0.05,
    compass_sd: float = float(np.deg2rad(0.15)),
    hold_below: float = 1.0,
    mounting: Array | None = None,
    places: Sequence[Place] = (),
) -> Drive:
    """Return a drive of the recorded IMU with GPS and compass emulated from RTK.

    White noise makes them, new in each run; the IMU is the same in all. The car has no compass: it
    is emulated by the course over ground, which is the yaw of a car that does not slip. At low
    speed there is no course, and the last one is held; before the car has moved for the first
    time, the first course it will have is taken. Noise is on top of held courses too.

    Parameters
    ----------
    recorded : RecordedDrive
        The recording.
    runs : int
        How many.
    seed : int
        Of the noise.
    gps_position_sd : float
        Standard deviation along each of east, north and up (m).
    gps_velocity_sd : float
        The same of velocity (m/s).
    compass_sd : float
        Of the compass (rad).
    hold_below : float
        The speed below which the course is held (m/s).
    mounting : ndarray, (3, 3) or (runs, 3, 3), optional
        Rotation from the IMU's axes to those of the vehicle; the same axes by default.
    places : sequence of Place
        Where outages are to begin.

    Returns
    -------
    Drive
        Its increments are one read-only array that all runs share, unless each has its mounting.

    Raises
    ------
    ParameterError
        If a number may not be what it is, `mounting` is no rotation, a place is not in the drive,
        or the car is never as fast as `hold_below`.

    Examples
    --------
    A recording of a car on its way north at 10 m/s; without noise the compass is the course, and
    GPS is RTK.

    >>> import numpy as np
    >>> from inswsn_lib.vehicle import RecordedDrive, emulate_sensors, metres
    >>> from inswsn_lib.vehicle.recorded import Track
    >>> velocity = np.tile([0.0, 10.0, 0.0], (3, 1))
    >>> position = np.outer([0.0, 10.0, 20.0], [1 / metres(np.zeros(3))[0], 0.0, 0.0])
    >>> still = np.zeros((20, 3))
    >>> track = Track(np.arange(3.0), position, velocity, np.ones(3, int))
    >>> recorded = RecordedDrive(
    ...     0.0, np.arange(3.0), 0.1, still, still + [0.0, 0.0, -0.98], position, velocity, track
    ... )
    >>> exact = emulate_sensors(
    ...     recorded, runs=2, seed=0, gps_position_sd=0.0, gps_velocity_sd=0.0, compass_sd=0.0
    ... )
    >>> exact.runs, exact.origin, exact.compass[:, 0].tolist()
    (2, 'recorded', [0.0, 0.0, 0.0])
    >>> bool((exact.gps_position[:, :, 0] == recorded.position).all())
    True
    """
    _check_whole("runs", runs, 1)
    _check_whole("seed", seed, 0)
    for name, value in (
        ("gps_position_sd", gps_position_sd),
        ("gps_velocity_sd", gps_velocity_sd),
        ("compass_sd", compass_sd),
        ("hold_below", hold_below),
    ):
        if not (np.isfinite(value) and value >= 0):
            raise ParameterError(name, value, "a finite number, zero or more")
    rotation = _check_mounting(mounting, runs)
    rng = np.random.default_rng(seed)
    epochs = len(recorded.time)
    metres = gps_position_sd * rng.standard_normal((epochs, 3, runs))
    speeds = gps_velocity_sd * rng.standard_normal((epochs, 3, runs))
    angles = compass_sd * rng.standard_normal((epochs, runs))
    return Drive(
        time=recorded.time,
        period=recorded.period,
        rotation_increments=_mount(recorded.rotation_increments, rotation, runs),
        velocity_increments=_mount(recorded.velocity_increments, rotation, runs),
        gps_position=_displace(recorded.position, metres),
        gps_velocity=recorded.velocity[:, :, None] + speeds,
        compass=_wrap(_held_course(recorded.velocity, hold_below)[:, None] + angles),
        reference=Reference(position=recorded.position, velocity=recorded.velocity),
        places=tuple(places),
        origin="recorded",
    )


def _check_whole(name: str, value: int, least: int) -> None:
    if isinstance(value, bool) or not isinstance(value, int | np.integer) or value < least:
        raise ParameterError(name, value, f"a whole number, {least} or more")


def _check_mounting(mounting: Array | None, runs: int) -> Array | None:
    if mounting is None:
        return None
    rotation = np.asarray(mounting, dtype=float)
    if rotation.shape not in {(3, 3), (runs, 3, 3)}:
        raise ParameterError(
            "mounting", f"of shape {rotation.shape}", f"of shape (3, 3) or {(runs, 3, 3)}"
        )
    product = rotation @ np.swapaxes(rotation, -1, -2)
    if not (np.allclose(product, np.eye(3), atol=1e-6) and (np.linalg.det(rotation) > 0).all()):
        raise ParameterError("mounting", rotation.tolist(), "a rotation: orthogonal, of det 1")
    return rotation


def _mount(increments: Array, rotation: Array | None, runs: int) -> Array:
    """Return increments (samples, 3) turned into the vehicle's axes, (samples, 3, runs)."""
    if rotation is not None and rotation.ndim == 3:
        columns = np.moveaxis(rotation, 0, -1).transpose(1, 0, 2)
        return (increments @ columns.reshape(3, -1)).reshape(len(increments), 3, runs)
    turned = increments if rotation is None else increments @ rotation.T
    return np.broadcast_to(turned[:, :, None], (*turned.shape, runs))


def _displace(position: Array, metres: Array) -> Array:
    """Move (latitude, longitude, height), (epochs, 3), by metres north, east, up."""
    latitude, _, height = position.T
    north, _, east = earth.principal_radii(np.rad2deg(latitude), height)
    sizes = np.column_stack([1 / north, 1 / east, np.ones_like(height)])
    return np.asarray(position[:, :, None] + metres * sizes[:, :, None])


def _held_course(velocity: Array, hold_below: float) -> Array:
    """Return the course (rad), (epochs,), of velocities (epochs, 3), without low speeds."""
    speed = np.hypot(velocity[:, 0], velocity[:, 1])
    known = np.flatnonzero(speed >= hold_below)
    if known.size == 0:
        raise ParameterError(
            "hold_below", hold_below, f"{speed.max():.3g} m/s, the greatest speed, or less"
        )
    last = np.searchsorted(known, np.arange(speed.size), side="right") - 1
    kept = velocity[known[np.maximum(last, 0)]]
    return np.asarray(np.arctan2(kept[:, 0], kept[:, 1]))


def _wrap(angle: Array) -> Array:
    """Return angles in (-pi, pi]."""
    wrapped = np.pi - np.mod(np.pi - angle, 2 * np.pi)
    # the remainder of a number just below zero is rounded to the whole turn
    return np.asarray(np.where(wrapped <= -np.pi, np.pi, wrapped))


def _bytes(path: Path) -> bytes:
    try:
        data = path.read_bytes()
    except FileNotFoundError:
        raise InswsnError(f"There is no file {path}.") from None
    except IsADirectoryError:
        raise InswsnError(f"{path} is a folder; it may be a file.") from None
    if not data:
        raise InswsnError(f"{path} is empty.")
    return data


def _text(path: Path) -> str:
    try:
        return _bytes(path).decode("ascii")
    except UnicodeDecodeError as error:
        raise InswsnError(f"{path} is not text: byte {error.start + 1} is not ASCII.") from None


def _check_cells(path: Path, rows: list[list[str]], count: int, first_row: int) -> None:
    for number, row in enumerate(rows, start=first_row):
        if len(row) != count:
            raise InswsnError(f"{path} has {len(row)} cells in row {number}; it may have {count}.")


def _numbers(path: Path, rows: list[list[str]], names: Sequence[str], first_row: int) -> Array:
    """Return cells as finite numbers, (rows, columns)."""
    _check_cells(path, rows, len(names), first_row)
    values = np.array([[_number(cell) for cell in row] for row in rows])
    wrong = ~np.isfinite(values)
    if wrong.any():
        row, column = (int(i[0]) for i in np.nonzero(wrong))
        raise InswsnError(
            f"{path} has {rows[row][column].strip()[:40]!r} in column {names[column]}, row "
            f"{row + first_row}; it may be a finite number."
        )
    return values


def _number(cell: str) -> float:
    try:
        return float(cell)
    except ValueError:
        return np.nan


def _check_increasing(
    path: Path, name: str, time: Array, first_row: int, longest: float = np.inf
) -> None:
    steps = np.diff(time)
    if (steps <= 0).any():
        row = int(np.argmax(steps <= 0)) + 1
        what = "repeats" if steps[row - 1] == 0 else "goes back"
        raise InswsnError(
            f"{path}: column {name} {what} in row {row + first_row}; time may only increase."
        )
    if (steps > longest).any():
        row = int(np.argmax(steps > longest)) + 1
        raise InswsnError(
            f"{path}: column {name} jumps by {steps[row - 1]:.3g} s in row {row + first_row}; "
            f"{longest:g} s may be missing."
        )
