"""An IMU of a phone's class, logged by RTKLIB, and RTK positions and velocities at 4 Hz.

So are the recordings of rtklibexplorer/GNSS_IMU: a drive, and a walk with the device in the hand.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path

import numpy as np

from inswsn_lib.checks import Array, number
from inswsn_lib.errors import InswsnError
from inswsn_lib.files import read_bytes, read_text
from inswsn_lib.inertial import Earth
from inswsn_lib.logs.columns import Row, check_clock, lines_of, numbers, reading
from inswsn_lib.logs.files import Place, digests_of, files_of, pick
from inswsn_lib.streams import Fixes, Imu, Recording

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
_WEEK = re.compile(r"\d{1,4} \d{1,6}(\.\d+)?")
_ZERO, _WEEKS = 315_964_800.0, 604_800.0  # s: 1980-01-06, where weeks begin, and their length
_PLACES = (
    ("latitude(deg)", "longitude(deg)", "height(m)"),
    ("e-baseline(m)", "n-baseline(m)", "u-baseline(m)"),
)
# What RTKLIB writes after date and time of a position, then of a velocity
_POSITION = ["Q", "ns", "sdn", "sde", "sdu", "sdne", "sdeu", "sdun", "age", "ratio"]
_VELOCITY = ["vn", "ve", "vu", "sdvn", "sdve", "sdvu", "sdvne", "sdveu", "sdvun"]
_MOST_Q = 7
_METRES = re.compile(r"[-+]?\d+\.\d{4}")  # so RTKLIB writes them; degrees have nine decimals


def read_rtklib(place: Place, latency: float = LATENCY) -> Recording:
    """Read the one log ``*.csv`` that has a time tag ``*.csv.tag``, and the one ``*.pos``.

    Time is GPS time as RTKLIB counts it, seconds since 1970 without leap seconds. The IMU's axes
    are its own: back, to the right, up in the car; in the walker's hand, by the author's account,
    turned by a quarter about the last. Of the walk, logged at 152 Hz, a third of the rows are those
    before them with another time stamp; they are kept. Positions are east, north and up of the
    first fix that is good, or of the first if none is; of the base, without an origin, if the
    solution has baselines.

    Parameters
    ----------
    place : str, Path, or mapping of str to Path
        A folder, or files by their names.
    latency : float
        From a sample to its arrival in the log, s. It was found for the drive. Of the walk it is
        not known: rates follow the course best with 0.22 s, and hardly less 0.1 s from that.
    """
    files = files_of(place)
    tag, solution = pick(files, "*.csv.tag"), pick(files, "*.pos")
    log = pick(files, tag.name.removesuffix(".tag"))
    imu = _read_log(log, tag, number("latency", latency))
    moments, found = read_solution(solution)

    def columns(*names: str) -> Array | None:
        there = [found[name] for name in names if name in found]
        return np.column_stack(there) if len(there) == len(names) else None

    good, origin = found["Q"] == 1, None
    position = columns("e-baseline", "n-baseline", "u-baseline")
    if position is None:
        angles = np.deg2rad([found["latitude"], found["longitude"]])
        places = np.column_stack([*angles, found["height"]])
        origin = places[int(np.argmax(good))]
        position = Earth(*origin).local(places)
    with reading(solution):
        check_clock("Fixes", moments)
        velocity, deviation = columns("ve", "vn", "vu"), columns("sde", "sdn", "sdu")
        fixes = Fixes(moments, position, velocity, deviation, good)
    digests = digests_of(log, tag, solution)
    return Recording("rtklib", imu=imu, fixes=fixes, origin=origin, digests=digests)


def _read_log(path: Path, tag: Path, latency: float) -> Imu:
    """Return what the IMU measured, by GPS time.

    A row of the log has specific force (g), rate (deg/s), and the device's time (ms). The first row
    and the last are parts of rows, and dropped. RTKLIB's time tag tells when each piece of the log
    arrived; a line through the arrivals makes GPS time of the device's time, less the latency.
    """
    lines = read_text(path).splitlines()
    rows = [(n, line.split(",")) for n, line in enumerate(lines, start=1)]
    values = numbers(path, rows[1:-1], 7)
    with reading(tag):
        data = read_bytes(tag)
        if not data.startswith(_WORD) or len(data) < _RECORDS:
            raise InswsnError("it is not an RTKLIB time tag.")
        start = float(np.frombuffer(data, "<u4", 1, _SECONDS)[0])
        start += float(np.frombuffer(data, "<f8", 1, _FRACTION)[0])
        # records: ms since the start, and how many bytes the log had
        ticks, lengths = np.frombuffer(data, "<u4", offset=_RECORDS).reshape(-1, 2).T.astype(int)
        ends = np.cumsum([len(line) + _ENDING for line in lines])[1:-1]
        if ends[-1] > lengths.max(initial=0):
            raise InswsnError(f"it ends before {path.name} does.")
        arrival = ticks[np.searchsorted(lengths, ends)] / 1e3
    with reading(path):
        device = values[:, 6] / 1e3
        check_clock("the device's time", device, first=2)
        if len(device) < 2:
            raise InswsnError("one row is too few for a line through arrivals.")
        slope, offset = np.polyfit(device - device.mean(), arrival, 1)
        time = start + (offset + slope * (device - device.mean())) - latency
        return Imu(time, np.deg2rad(values[:, 3:6]), values[:, :3] * _STANDARD_GRAVITY)


def read_solution(path: Path) -> tuple[Array, dict[str, Array]]:
    """Return GPS time (s) and the columns of an RTKLIB solution, by their names without units.

    RTKLIB counts GPS time as if it had UTC's calendar. Without a head a file has latitude and
    longitude in degrees and height, with or without velocities; one that may have something else is
    refused.
    """
    split = [(n, line.split()) for n, line in lines_of(path)]
    rows = [(n, cells) for n, cells in split if not cells[0].startswith("%")]
    names = _head(path, [" ".join(cells).lstrip("% ").split() for _, cells in split])
    headless = not names
    if headless:
        width = len(rows[0][1]) - 2 - len(_PLACES[0]) if rows else 0
        velocity = _VELOCITY[: max(width - len(_POSITION), 0)]
        names = [*_PLACES[0], *_POSITION, *(velocity if len(velocity) in (3, 9) else ())]
    values = numbers(path, [(n, ["0", "0", *cells[2:]]) for n, cells in rows], 2 + len(names))
    found = {name.partition("(")[0]: x for name, x in zip(names, values.T[2:], strict=True)}
    # baselines, and coordinates along axes of the Earth, are in metres
    in_metres = all(_METRES.fullmatch(cell) for _, cells in rows for cell in cells[2:5])
    if headless and (in_metres or not np.isin(found["Q"], range(_MOST_Q + 1)).all()):
        raise InswsnError(
            f"{path} has no head, and its columns may not be latitude and longitude in degrees, "
            f"height and Q: line {rows[0][0]} begins {' '.join(rows[0][1][:6])}. Keep the line "
            "that begins %  GPST."
        )
    return np.array([_moment(path, row) for row in rows]), found


def _head(path: Path, lines: Sequence[list[str]]) -> list[str]:
    """Return what the columns after date and time are called; nothing without a head."""
    heads = {tuple(cells) for cells in lines if cells and cells[0] in ("GPST", "UTC", "JST")}
    if not heads:
        return []
    clock, *names = min(heads)
    if clock != "GPST":
        raise InswsnError(f"{path} has {clock} in its head; it must be GPST.")
    if tuple(names[:3]) not in _PLACES or "Q" not in names:
        raise InswsnError(
            f"{path} has {', '.join(names[:4])} in its head; it must have "
            f"{' or '.join(', '.join(each) for each in _PLACES)}, and then Q."
        )
    return names


def _moment(path: Path, row: Row) -> float:
    line, cells = row
    said = " ".join(cells[:2])
    with suppress(ValueError):  # no such month, or day
        if _MOMENT.fullmatch(said):
            return float(np.datetime64(said.replace("/", "-"), "us").astype(float) / 1e6)
        if _WEEK.fullmatch(said) and float(cells[1]) < _WEEKS:
            return _ZERO + _WEEKS * int(cells[0]) + float(cells[1])
    raise InswsnError(
        f"{path} has {said[:40]!r} in line {line}; it must be a date and time, such as "
        "2025/07/08 19:34:18.499, or a GPS week and its seconds."
    )
