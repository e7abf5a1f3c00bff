"""Rows of other people's files: their numbers, clocks and anchors, and errors for spoilt ones."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from inswsn_lib.checks import Array
from inswsn_lib.errors import InswsnError
from inswsn_lib.files import read_text
from inswsn_lib.logs.columns import LARGEST, floats
from inswsn_lib.streams import Ranges, check_increase

#: The number of a line, from 1, and its cells
Row = tuple[int, Sequence[str]]

# A clock was set where stamps jump by more seconds, and by more times all others
_SET, _JUMP = 3600.0, 50.0
_UNIT = 1e-3  # a quaternion whose length differs from 1 by more is something else
_ROUNDING = 1e-9  # one that differs by less is left as it is


@contextmanager
def reading(path: Path) -> Iterator[None]:
    """Tell in one sentence that names the file what its content makes go wrong."""
    try:
        yield
    except InswsnError as error:
        if str(path) in str(error):
            raise
        raise InswsnError(f"{path}: {error}") from None
    except OSError as error:
        raise InswsnError(f"{path} cannot be read: {error.strerror}.") from None
    except (ValueError, KeyError, IndexError, TypeError, OverflowError) as error:
        raise InswsnError(f"{path} cannot be read: {str(error).strip('.')}.") from None


def lines_of(path: Path) -> list[tuple[int, str]]:
    """Return the lines of a text file with their numbers, without comments and blank ones."""
    lines = enumerate(read_text(path).splitlines(), start=1)
    return [(n, line) for n, line in lines if line.strip() and not line.startswith("#")]


def read_rows(path: Path, columns: int) -> Array:
    """Return the numbers of a text file between blanks, (rows, columns); comments begin with #."""
    return numbers(path, [(n, line.split()) for n, line in lines_of(path)], columns)


def numbers(path: Path, rows: Sequence[Row], columns: int) -> Array:
    """Return rows of a file as finite numbers, (rows, columns); refuse one that is something else.

    The path is named in sentences.
    """
    if not rows:
        raise InswsnError(f"{path} has no row of {columns} numbers.")
    for line, cells in rows:
        if len(cells) != columns:
            raise InswsnError(
                f"{path} has {len(cells)} cells in line {line}; there must be {columns}."
            )
    found = floats([cell for _, cells in rows for cell in cells]).reshape(len(rows), columns)
    for row, column in np.argwhere(~(np.abs(found) < LARGEST)).tolist():
        line, cells = rows[row]
        raise InswsnError(
            f"{path} has {cells[column][:40]!r} in line {line}; it must be a finite number below "
            f"{LARGEST:.0e}."
        )
    return found


def check_clock(what: str, time: Array, *, repeats: bool = False, first: int = 1) -> None:
    """Refuse what `check_increase` does, and time stamps of a clock that was set in between."""
    check_increase(what, time, repeats=repeats, first=first)
    if len(time) < 3:
        return
    steps = np.diff(time)
    row = int(np.argmax(steps))
    rest = float(time[-1] - time[row + 1] + time[row] - time[0])
    if steps[row] > max(_SET, _JUMP * rest):
        raise InswsnError(
            f"{what}: the time stamp jumps by {steps[row]:.6g} s in row {row + 1 + first}, and all "
            f"others are within {rest:.6g} s; a clock may not have been set in between."
        )


def check_twins(anchors: Sequence[object]) -> None:
    """Refuse an anchor that is there more than once."""
    for row, each in enumerate(anchors):
        if each in anchors[:row]:
            raise InswsnError(f"the anchor {_name(each)} is there more than once.")


def places_of(
    wanted: Iterable[object], known: Sequence[object], first: int = 1
) -> NDArray[np.int64]:
    """Return where each anchor stands among those that are known; refuse another.

    `first` is the number of the first row, to name a row in a sentence.
    """
    places = {each: place for place, each in enumerate(known)}
    wanted = list(wanted)
    for row, each in enumerate(wanted, start=first):
        if each not in places:
            raise InswsnError(
                f"the anchor is {_name(each)} in row {row}; it must be one of "
                f"{', '.join(map(_name, known))[:200]}."
            )
    return np.array([places[each] for each in wanted], dtype=np.int64)


def _name(anchor: object) -> str:
    return f"{anchor:g}" if isinstance(anchor, float) else repr(anchor)


def numbered_ranges(heard: Array, numbers: Array, anchors: Array) -> Ranges:
    """Return ranges to anchors that have numbers, in order of time.

    What is heard has time, anchor and distance in a row; an anchor has a number and a place.
    """
    time, which, distance = heard[np.argsort(heard[:, 0], kind="stable")].T
    known = numbers.tolist()
    places = places_of(which.tolist(), known)
    return Ranges(time, places, distance, anchors, tuple(map(_name, known)))


def unit_quaternions(value: Array, first: int = 1) -> Array:
    """Return quaternions (rows, 4) of unit length; refuse what is none, naming the row."""
    length = np.linalg.norm(value, axis=1)
    off = np.abs(length - 1)
    if (off > _UNIT).any():
        row = int(np.argmax(off > _UNIT))
        raise InswsnError(
            f"the quaternion in row {row + first} is {length[row]:.6g} long; it must be of unit "
            "length."
        )
    # those that are already are kept to the last bit
    return np.where(off[:, None] > _ROUNDING, value / length[:, None], value)
