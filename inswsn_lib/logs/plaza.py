"""A robot on a field among four nodes of a ranging radio.

So are the data "Navigating with Ranging Radios" of Carnegie Mellon University, as MATLAB files of
borglab/gtsam. What was found by computation, in Plaza2_.mat:

- GT's heading is that of the rear: with half a turn added it is the course (in Plaza1_.mat it is
  the course). Increments of heading are to the left. Ranges, dead reckoning and reference have one
  clock. In Plaza1_.mat some ranges are written after later ones.
- Dead reckoning is not measured apart from the reference. Each increment of heading is 0.985 times
  GT's less 6.967e-4 rad, to the last digit; increments of distance are GT's to a tenth of a
  millimetre. Whoever estimates a scale and a bias of the rate has the heading of the reference.
- Ranges are 1.069 times the distance, to every node; so the median is 2 to 4 m too long. They are
  given as they are.
"""

from __future__ import annotations

import numpy as np

from inswsn_lib.checks import Array, array
from inswsn_lib.logs.files import Place, digests_of, files_of, pick
from inswsn_lib.logs.matlab import read_tables
from inswsn_lib.logs.rows import check_twins, numbered_ranges, reading
from inswsn_lib.streams import Odometry, Recording, Reference, check_increase

# Of each variable that is read, the columns: time, distance and turn since the row before |
# time, position and heading | time, antenna, node and range | node and position
_COLUMNS = {"DR": 3, "GT": 4, "TD": 4, "TL": 3}


def read_plaza(place: Place) -> Recording:
    """Read the one ``.mat`` file of a folder.

    Examples
    --------
    >>> from inswsn_lib.logs.plaza import read_plaza
    >>> read_plaza({})
    Traceback (most recent call last):
        ...
    inswsn_lib.errors.InswsnError: There is no file *.mat.
    """
    path = pick(files_of(place), "*.mat")
    found = read_tables(path)
    with reading(path):
        dead, truth, heard, nodes = (
            array(name, found.get(name, ()), ("rows", columns))
            for name, columns in _COLUMNS.items()
        )
        check_twins(nodes[:, 0].tolist())
        heard = heard[np.argsort(heard[:, 0], kind="stable")]
        half = _heading(truth) / 2
        return Recording(
            "plaza",
            odometry=_odometry(dead, truth[:, 0]),
            ranges=numbered_ranges(
                heard[:, 0], heard[:, 2], heard[:, 3], nodes[:, 0], nodes[:, 1:]
            ),
            reference=Reference(
                time=truth[:, 0],
                position=truth[:, 1:3],
                attitude=np.column_stack([0 * half, 0 * half, np.sin(half), np.cos(half)]),
            ),
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
