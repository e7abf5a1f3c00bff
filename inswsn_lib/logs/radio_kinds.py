"""Three kinds of recordings of a ranging radio, as other projects' repositories have them."""

from __future__ import annotations

import struct
import zlib
from collections import defaultdict
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from inswsn_lib.checks import Array, array
from inswsn_lib.errors import InswsnError
from inswsn_lib.files import read_bytes
from inswsn_lib.logs.columns import (
    Row,
    check_twins,
    lines_of,
    numbered_ranges,
    numbers,
    reading,
    unit_quaternions,
)
from inswsn_lib.logs.files import Place, digests_of, files_of, pick
from inswsn_lib.streams import Imu, Odometry, Recording, Reference, check_increase

#: Of INRoL, from the IMU to the tag in the IMU's axes (m), as parameter.yaml of the repository has
LEVER_ARM = (0.0, 0.0, 0.010)

# Of each variable of plaza, the columns: time, distance and turn since the row before |
# time, position and heading | time, antenna, node and range | node and position
_PLAZA = {"DR": 3, "GT": 4, "TD": 4, "TL": 3}

# Of each kind of line of the labyrinth, the numbers after its word (those of the readme): time,
# range, variance, the module's position and number, quality | time, speeds of two wheels and
# sideways, half the distance of the wheels, variances | time, position, covariance
_LABYRINTH = {"range2": 7, "odom2diff": 8, "point2": 7}


def read_inrol(place: Place) -> Recording:
    """Read ``anchor.txt``, ``imu.txt``, ``imu_pose.txt`` and ``uwb.txt``.

    Ranges of one exchange have one time stamp. One that was written after a later one is put in its
    place; nothing else is changed.
    """
    files = files_of(place)
    paths = [pick(files, f"{name}.txt") for name in ("anchor", "imu", "imu_pose", "uwb")]
    # number, position and attitude | row, time, rate and force | time, position and attitude |
    # row, time, anchor and range
    anchors, sensed, poses, heard = (
        numbers(path, [(n, line.split()) for n, line in lines_of(path)], columns)
        for path, columns in zip(paths, (8, 8, 8, 4), strict=True)
    )
    with reading(paths[0]):
        check_twins(anchors[:, 0].tolist())
    with reading(paths[1]):
        imu = Imu(time=sensed[:, 1], rate=sensed[:, 2:5], force=sensed[:, 5:8])
    with reading(paths[2]):
        reference = Reference(poses[:, 0], poses[:, 1:4], unit_quaternions(poses[:, 4:8]))
    with reading(paths[3]):
        ranges = numbered_ranges(heard[:, 1:], anchors[:, 0], anchors[:, 1:4])
    return Recording(
        "inrol", imu=imu, ranges=ranges, reference=reference, lever_arm=np.array(LEVER_ARM),
        digests=digests_of(*paths),
    )  # fmt: skip


def read_plaza(place: Place) -> Recording:
    """Read the one ``.mat`` file of a folder.

    Increments of heading are to the left. The heading is that of the front or of the rear, ranges
    are not in order, and are given as they are; `known.yaml` tells more.
    """
    path = pick(files_of(place), "*.mat")
    found = read_matrices(path)
    with reading(path):
        dead, truth, heard, nodes = (
            array(name, found.get(name, ()), ("rows", columns)) for name, columns in _PLAZA.items()
        )
        check_twins(nodes[:, 0].tolist())
        half = _heading(truth) / 2
        attitude = np.column_stack([0 * half, 0 * half, np.sin(half), np.cos(half)])
        return Recording(
            "plaza",
            odometry=_odometry(dead, truth[:, 0]),
            ranges=numbered_ranges(heard[:, [0, 2, 3]], nodes[:, 0], nodes[:, 1:]),
            reference=Reference(truth[:, 0], truth[:, 1:3], attitude),
            digests=digests_of(path),
        )


def _heading(truth: Array) -> Array:
    """Return the heading, which is told of the front or of the rear: the robot drives forwards."""
    step, heading = np.diff(truth[:, 1:3], axis=0), truth[:, 3]
    ahead = np.sum(step[:, 0] * np.cos(heading[1:]) + step[:, 1] * np.sin(heading[1:]))
    return np.asarray(np.unwrap(heading) + np.pi * (ahead < 0))


def _odometry(dead: Array, reference: Array) -> Odometry:
    """Return speed and rate over the intervals; the first begins with the reference's row before.

    Where there is none, nobody knows how long it was, and it is left out.
    """
    time = dead[:, 0]
    check_increase("DR", time)
    begin = np.concatenate([reference[reference < time[:1]][-1:], time[:-1]])
    rows = slice(len(time) - len(begin), None)
    interval = time[rows] - begin
    return Odometry(time[rows], dead[rows, 1] / interval, dead[rows, 2] / interval)


def read_labyrinth(place: Place) -> Recording:
    """Read the one ``*_Input.txt`` and the one ``*_GT.txt`` of a folder.

    The readme calls the first wheel the right one, and the number after the speeds the distance of
    the wheels. The ground truth tells otherwise, and so does the program of those who recorded it:
    the robot turns to the left by (second less first) / (2 x number).
    """
    files = files_of(place)
    paths = pick(files, "*_Input.txt"), pick(files, "*_GT.txt")
    rows: dict[str, list[Row]] = defaultdict(list)
    for path in paths:
        for line, text in lines_of(path):
            word, *cells = text.split()
            if word not in _LABYRINTH:
                raise InswsnError(
                    f"{path} has {word[:40]!r} in line {line}; it must be "
                    f"{' or '.join(_LABYRINTH)}."
                )
            rows[word].append((line, cells))
    heard, driven, truth = (
        numbers(paths[word == "point2"], rows[word], columns)
        for word, columns in _LABYRINTH.items()
    )
    with reading(paths[1]):
        reference = Reference(time=truth[:, 0], position=truth[:, 1:3])
    with reading(paths[0]):
        first, second, half = driven[:, 1], driven[:, 2], driven[:, 4]
        if (half <= 0).any():
            raise InswsnError(f"the distance of the wheels is {half.min():g}; it must be positive.")
        odometry = Odometry(driven[:, 0], (first + second) / 2, (second - first) / (2 * half))
        # each range tells where its module is, which does not move
        modules, once = np.unique(heard[:, 5], return_index=True)
        ranges = numbered_ranges(heard[:, [0, 5, 1]], modules, heard[once, 3:5])
    return Recording(
        "labyrinth", odometry=odometry, ranges=ranges, reference=reference,
        digests=digests_of(*paths),
    )  # fmt: skip


# Matrices in a MATLAB file of level 5, such as MATLAB writes by default. ``scipy.io.loadmat`` ends
# the whole process where such a file is spoilt, so the few elements that are needed are read here.
_HEAD = 128  # bytes: a text, the version, and the order of bytes
_MATRIX, _PACKED = 14, 15
_NUMBERS = {1: "i1", 2: "u1", 3: "i2", 4: "u2", 5: "i4", 6: "u4", 7: "f4", 9: "f8", 12: "i8",
            13: "u8"}  # fmt: skip
_FULL = range(6, 16)  # classes of arrays of numbers: no cells, structures, texts, sparse ones
_LARGEST = 10**8  # bytes of an element when it is unpacked; a longer one is cut


def read_matrices(path: Path) -> dict[str, Array]:
    """Return the matrices of real numbers in a MATLAB file, by their names."""
    with reading(path):
        data = read_bytes(path)
        if data[_HEAD - 2 : _HEAD] != b"IM":
            raise InswsnError("it is not a MATLAB file of level 5.")
        return dict(_matrices(data[_HEAD:]))


def _matrices(data: bytes) -> Iterator[tuple[str, Array]]:
    """Yield name and numbers of each matrix; its elements are flags, shape, name and numbers."""
    for kind, body in _elements(data):
        if kind == _PACKED:
            unpacker = zlib.decompressobj()
            try:
                yield from _matrices(unpacker.decompress(body, _LARGEST))
            except zlib.error:
                raise InswsnError("what it has packed cannot be unpacked.") from None
        parts = list(_elements(body)) if kind == _MATRIX else []
        if len(parts) < 4 or np.frombuffer(parts[0][1], "<u4")[0] & 0xFF not in _FULL:
            continue
        (_, shape), (_, name), (type_, values) = parts[1:4]
        if type_ not in _NUMBERS:
            raise InswsnError(f"it has numbers of the type {type_}, which are not read.")
        sizes = np.frombuffer(shape, "<i4").tolist()
        found = np.frombuffer(values, "<" + _NUMBERS[type_]).astype(float)
        yield name.decode("ascii"), found.reshape(sizes, order="F")


def _elements(data: bytes) -> Iterator[tuple[int, bytes]]:
    """Yield type and bytes of the elements that stand one after the other."""
    at = 0
    while at < len(data):
        if len(data) < at + 8:
            raise InswsnError("it ends too early.")
        kind, size = struct.unpack_from("<II", data, at)
        begin = at + 8
        if small := kind >> 16:  # up to four bytes stand in the head itself
            kind, size, begin = kind & 0xFFFF, small, at + 4
        if begin + size > len(data):
            raise InswsnError("it ends too early.")
        yield kind, data[begin : begin + size]
        at = at + 8 if small else begin + size + (0 if kind == _PACKED else -size % 8)
