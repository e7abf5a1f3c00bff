"""A small robot among four modules of ultra-wideband radio, with wheels that tell their speed.

So is the labyrinth, Indoor_UWB of TUC-ProAut/libRSF: one range and one row of odometry in each step
of 0.13 s, and the position by the ground truth.
"""

from __future__ import annotations

from collections import defaultdict

import numpy as np

from inswsn_lib.checks import Array
from inswsn_lib.errors import InswsnError
from inswsn_lib.logs.files import Place, digests_of, files_of, pick
from inswsn_lib.logs.rows import Row, lines_of, numbered_ranges, numbers, reading
from inswsn_lib.streams import Odometry, Ranges, Recording, Reference

# Of each kind of line, the numbers after its word (those of the readme): time, range, variance, the
# module's position and number, quality | time, speeds of two wheels and sideways, half the distance
# of the wheels, variances | time, position, covariance
_COLUMNS = {"range2": 7, "odom2diff": 8, "point2": 7}


def read_labyrinth(place: Place) -> Recording:
    """Read the one ``*_Input.txt`` and the one ``*_GT.txt`` of a folder.

    The readme calls the first wheel the right one, and the number after the speeds the distance of
    the wheels. The ground truth tells otherwise, and so does the program of those who recorded it:
    the robot turns to the left by (second less first) / (2 x number).

    Examples
    --------
    >>> from inswsn_lib.logs.labyrinth import read_labyrinth
    >>> read_labyrinth({})
    Traceback (most recent call last):
        ...
    inswsn_lib.errors.InswsnError: There is no file *_Input.txt.
    """
    files = files_of(place)
    paths = pick(files, "*_Input.txt"), pick(files, "*_GT.txt")
    rows: dict[str, list[Row]] = defaultdict(list)
    for path in paths:
        for line, text in lines_of(path):
            word, *cells = text.split()
            if word not in _COLUMNS:
                raise InswsnError(
                    f"{path} has {word[:40]!r} in line {line}; it must be {' or '.join(_COLUMNS)}."
                )
            rows[word].append((line, cells))
    with reading(paths[1]):
        truth = numbers(paths[1], rows["point2"], _COLUMNS["point2"])
        reference = Reference(time=truth[:, 0], position=truth[:, 1:3])
    with reading(paths[0]):
        heard, driven = (numbers(paths[0], rows[w], _COLUMNS[w]) for w in ("range2", "odom2diff"))
        first, second, half = driven[:, 1], driven[:, 2], driven[:, 4]
        if (half <= 0).any():
            raise InswsnError(f"the distance of the wheels is {half.min():g}; it must be positive.")
        return Recording(
            "labyrinth",
            odometry=Odometry(
                time=driven[:, 0],
                speed=(first + second) / 2,
                rate=(second - first) / (2 * half),
            ),
            ranges=_ranges(heard),
            reference=reference,
            digests=digests_of(*paths),
        )


def _ranges(heard: Array) -> Ranges:
    """Return the ranges; each tells where its module is, which must not move."""
    modules, first, which = np.unique(heard[:, 5], return_index=True, return_inverse=True)
    anchors = heard[first, 3:5]
    moved = (heard[:, 3:5] != anchors[which]).any(axis=1)
    if moved.any():
        row = int(np.argmax(moved))
        raise InswsnError(
            f"the module {modules[which[row]]:g} is elsewhere in range {row + 1} than before; it "
            "must stay in its place."
        )
    return numbered_ranges(heard[:, 0], heard[:, 5], heard[:, 1], modules, anchors)
