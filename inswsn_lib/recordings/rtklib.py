"""An IMU of a phone's class, logged by RTKLIB, and RTK positions and velocities at 4 Hz.

So are the recordings of rtklibexplorer/GNSS_IMU: a drive, and a walk with the device in the hand.
"""

from __future__ import annotations

import re
from contextlib import suppress
from pathlib import Path

import numpy as np

from inswsn_lib.checks import Array, number
from inswsn_lib.errors import InswsnError
from inswsn_lib.files import read_bytes
from inswsn_lib.inertial import Earth
from inswsn_lib.recordings.files import Place, digests_of, files_of, pick
from inswsn_lib.recordings.rows import Row, all_lines, lines_of, numbers, reading
from inswsn_lib.streams import Fixes, Imu, Recording, check_increase

#: From a sample to its arrival in the log (s). The files do not tell it: with this one the IMU's
#: forward acceleration agrees best with the RTK speed, early in the drive and late. (The author of
#: the recording stretches the device's time between the tag's start and its end, and takes 0.125 s
#: off. But the first row arrives 0.14 s after the start: his lag changes by as much on the way.)
LATENCY = 0.155
_STANDARD_GRAVITY = 9.80665  # m/s^2, the unit of the accelerometers
# Of the time tag, in bytes: its first word, where the start is, its seconds and their fraction, and
# the records
_WORD, _SECONDS, _FRACTION, _RECORDS = b"TIMETAG RTKLIB", 64, 68, 76
_ENDING = 2  # bytes at the end of a line when the log was written; version control keeps one
_MOMENT = re.compile(r"\d{4}/\d\d/\d\d \d\d:\d\d:\d\d(\.\d+)?")
# Of a row of a solution, without date and time: all that RTKLIB writes of a position, and with it
# of a velocity
_POSITION, _VELOCITY = 13, 16


def read_rtklib(place: Place, latency: float = LATENCY) -> Recording:
    """Read the one log ``*.csv`` that has a time tag ``*.csv.tag``, and the one ``*.pos``.

    Time is GPS time as RTKLIB counts it, seconds since 1970 without leap seconds. The IMU's axes
    are its own: back, to the right, up in the car; in the walker's hand, by the author's account,
    turned by a quarter about the last. Of the walk, logged at 152 Hz, a third of the rows are those
    before them with another time stamp; they are kept. Positions are east, north and up of the
    first fix that is good, or of the first if none is.

    Parameters
    ----------
    place : str, Path, or mapping of str to Path
        A folder, or files by their names.
    latency : float
        From a sample to its arrival in the log, s. It was found for the drive. Of the walk it is
        not known: its rates follow the course best with 0.22 s, and hardly less with 0.1 s more or
        less.

    Raises
    ------
    InswsnError
        If a file is not there or is spoilt.

    Examples
    --------
    >>> from inswsn_lib.recordings.rtklib import read_rtklib
    >>> read_rtklib({})
    Traceback (most recent call last):
        ...
    inswsn_lib.errors.InswsnError: There is no file *.csv.tag.
    """
    files = files_of(place)
    tag, solution = pick(files, "*.csv.tag"), pick(files, "*.pos")
    log = pick(files, tag.name.removesuffix(".tag"))
    time, rate, force = read_log(log, tag, number("latency", latency))
    with reading(log):
        imu = Imu(time, rate, force)
    moments, values = read_solution(solution)
    good = values[:, 3] == 1
    places = np.column_stack([np.deg2rad(values[:, :2]), values[:, 2]])
    origin = places[int(np.argmax(good))]
    with reading(solution):
        fixes = Fixes(
            time=moments,
            position=Earth(*origin).local(places),
            velocity=values[:, [14, 13, 15]] if values.shape[1] >= _VELOCITY else None,
            deviation=values[:, [6, 5, 7]],
            good=good,
        )
    return Recording(
        "rtklib",
        imu=imu,
        fixes=fixes,
        origin=origin,
        digests=digests_of(log, tag, solution),
    )


def read_log(path: Path, tag: Path, latency: float) -> tuple[Array, Array, Array]:
    """Return GPS time (s), rate (rad/s) and specific force (m/s^2) along the IMU's axes.

    A row of the log has specific force (g), rate (deg/s), and the device's time (ms). The first row
    and the last are parts of rows, and dropped. RTKLIB's time tag tells when each piece of the log
    arrived; a line through the arrivals makes GPS time of the device's time, less the latency.

    Parameters
    ----------
    path, tag : Path
        The log and its time tag.
    latency : float
        s.
    """
    lines = all_lines(path)
    values = numbers(path, [(n, line.split(",")) for n, line in lines[1:-1]], 7)
    with reading(tag):
        data = read_bytes(tag)
        if not data.startswith(_WORD) or len(data) < _RECORDS:
            raise InswsnError("it is not an RTKLIB time tag.")
        if (len(data) - _RECORDS) % 8:
            raise InswsnError("it ends within a record.")
        start = float(np.frombuffer(data, "<u4", 1, _SECONDS)[0])
        start += float(np.frombuffer(data, "<f8", 1, _FRACTION)[0])
        # records: ms since the start, and how many bytes the log had
        records = np.frombuffer(data, "<u4", offset=_RECORDS).reshape(-1, 2).astype(np.int64)
        ticks, lengths = records.T
        ends = np.cumsum([len(line) + _ENDING for _, line in lines])[1:-1]
        if ends[-1] > lengths.max(initial=0):
            raise InswsnError(f"it ends before {path.name} does.")
        arrival = ticks[np.searchsorted(lengths, ends)] / 1e3
    device = values[:, 6] / 1e3
    with reading(path):
        check_increase("the device's time", device, first=2)
        if len(device) < 2:
            raise InswsnError("one row is too few for a line through arrivals.")
    middle = device.mean()
    slope, offset = np.polyfit(device - middle, arrival, 1)
    time = start + (offset + slope * (device - middle)) - latency
    return time, np.deg2rad(values[:, 3:6]), values[:, :3] * _STANDARD_GRAVITY


def read_solution(path: Path) -> tuple[Array, Array]:
    """Return GPS time (s) and the numbers after date and time of an RTKLIB solution.

    RTKLIB counts GPS time as if it had UTC's calendar.
    """
    split = [(n, line.split()) for n, line in lines_of(path)]
    rows = [(n, cells) for n, cells in split if not cells[0].startswith("%")]
    if others := [n for n, cells in split if cells[:2] in (["%", "UTC"], ["%", "JST"])]:
        raise InswsnError(f"{path} has {split[others[0] - 1][1][1]} in its head; it must be GPST.")
    columns = max(len(rows[0][1]) if rows else 0, 2 + _POSITION)
    values = numbers(path, [(n, ["0", "0", *cells[2:]]) for n, cells in rows], columns)[:, 2:]
    if (np.abs(values[:, :2]) > (90, 360)).any():
        raise InswsnError(f"{path} has no latitude and longitude in degrees.")
    return np.array([_moment(path, row) for row in rows]), values


def _moment(path: Path, row: Row) -> float:
    line, cells = row
    said = " ".join(cells[:2])
    with suppress(ValueError):  # no such month, or day
        if _MOMENT.fullmatch(said):
            return float(np.datetime64(said.replace("/", "-"), "us").astype(float) / 1e6)
    raise InswsnError(
        f"{path} has {said[:40]!r} in line {line}; it must be a date and time, such as "
        "2025/07/08 19:34:18.499."
    )
