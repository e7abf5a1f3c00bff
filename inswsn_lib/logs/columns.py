"""Columns and rows of text files: CSV, read some megabytes at a time, and other people's kinds."""

from __future__ import annotations

import csv
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from datetime import UTC, datetime
from itertools import chain
from math import nan
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from inswsn_lib.checks import Array
from inswsn_lib.errors import InswsnError
from inswsn_lib.files import read_pieces, read_text
from inswsn_lib.streams import Ranges, check_increase

#: The column of time stamps, s, or dates and times by ISO 8601. A file may have it as ``t_s``, or
#: in another unit, which its name tells: ``time_ms``, ``t_us``, ``time_ns``.
TIME = "time_s"
#: The columns of the INS: position (m) and velocity (m/s) in the horizontal frame of the network
INS = ("ins_x_m", "ins_y_m", "ins_vx_mps", "ins_vy_mps")
#: The columns of the network, in the same frame; empty where there is no fix. A network without
#: velocities may leave out the last two.
WSN = ("wsn_x_m", "wsn_y_m", "wsn_vx_mps", "wsn_vy_mps")
#: The columns of a reference, if there is one
REFERENCE = ("ref_x_m", "ref_y_m", "ref_vx_mps", "ref_vy_mps")

#: The column of words; all others hold numbers
ANCHOR = "anchor"
#: Numbers of this size are no lengths or speeds
LARGEST = 1e15
_LARGEST_TIME = 1e11  # s: seconds of this size are stamps in a smaller unit; it is the year 5138
#: Units of time stamps, and how many of each make a second
UNITS = {"s": 1.0, "ms": 1e3, "us": 1e6, "ns": 1e9}
#: By the end of a column's name its units, and how many of each make one of the wanted unit
_SIZES = {
    "s": UNITS,
    "m": {"m": 1.0, "cm": 1e2, "mm": 1e3, "km": 1e-3, "ft": 1 / 0.3048},
    "mps": {"m/s": 1.0, "km/h": 3.6, "knots": 3600 / 1852},
    "radps": {"rad/s": 1.0, "deg/s": 180 / np.pi},
    "mps2": {"m/s^2": 1.0, "g": 1 / 9.80665, "mg": 1e3 / 9.80665},
    "deg": {"deg": 1.0, "rad": np.pi / 180},
}
_STAMPS = {f"{word}_{unit}": unit for unit in UNITS for word in ("time", "t")}
_SEPARATORS = ",;\t"
#: How a date and time by ISO 8601 begins
_ISO = re.compile(r"\d{4}-?\d\d-?\d\d[T ]\d\d")
# what a number may be: float takes other digits, and digits in groups, too
_NUMBER = re.compile(r"[-+]?(\d+\.?\d*|\.\d+)(e[-+]?\d+)?|[-+]?inf(inity)?", re.A | re.I)

#: Of a column, what it is called in a file, and its unit
Named = Mapping[str, tuple[str, str]]
Table = dict[str, NDArray[Any]]
#: The number of a line, from 1, and its cells
Row = tuple[int, Sequence[str]]

# A clock was set where stamps jump by more seconds, and by more times all others
_SET, _JUMP = 3600.0, 50.0
_UNIT = 1e-3  # a quaternion whose length differs from 1 by more is something else
_ROUNDING = 1e-9  # one that differs by less is left as it is


@dataclass(frozen=True)
class Layout:
    """Which columns a CSV file has: those that must be there, and groups that may be left out.

    Cells of `gaps` may be empty. The columns of `instead` may stand in the place of some that must
    be there.
    """

    required: tuple[str, ...]
    groups: tuple[tuple[str, ...], ...] = ()
    gaps: tuple[str, ...] = ()
    instead: Mapping[str, str] = field(default_factory=dict)

    @property
    def names(self) -> tuple[str, ...]:
        """All columns that there may be."""
        return tuple(dict.fromkeys(chain(self.required, *self.groups, self.instead.values())))

    def of(self, header: Sequence[str]) -> tuple[str, ...]:
        """Return the columns that must be there, those in their place if some of these are."""
        others = {*self.instead.values()} & {*header} and not {*self.instead} <= {*header}
        return tuple(self.instead.get(name, name) if others else name for name in self.required)


class Column(NamedTuple):
    """A column that is read: its name in the header, and what its cells hold."""

    name: str
    text: bool = False  # else numbers
    unit: str = ""  # of time stamps
    size: float = 1.0  # how many of its unit make one of the wanted unit


_TRACKS = Layout((TIME, *INS, *WSN[:2]), (WSN[2:], REFERENCE), gaps=(*WSN, *REFERENCE))


def columns_of(path: Path, data: bytes | None = None) -> dict[str, Array]:
    """Return the columns of INS, network and reference, a network's missing velocity all NaN.

    Their entry k is row k + 2 of the file, comments and blank lines not counted. If data are given,
    they are what is in the file, which is named in sentences, and not looked at.
    """
    table = read_table(path, _TRACKS, pieces=None if data is None else [data])
    return dict.fromkeys(WSN[2:], np.full(len(table[TIME]), np.nan)) | table


def read_table(
    path: Path, layout: Layout, named: Named | None = None, pieces: Iterable[bytes] | None = None
) -> Table:
    """Return the columns of a CSV file that a layout names; others are ignored.

    Entry k of each is row k + 2 of the file, comments and blank lines not counted. Numbers are
    floats, NaN where a cell is empty. `named` tells what columns are called in the file, and their
    units, if they have not their own names.
    """
    named = named or {}
    names = {*layout.names, *_STAMPS, *(name for name, _ in named.values())}
    try:
        separator, header, blocks = opened(pieces or read_pieces(path), names)
        columns = _columns(path, header, layout, named)
        found = parse(path, [*columns.values()], separator, header, blocks)
    except UnicodeDecodeError:
        raise InswsnError(f"{path} is not a CSV file: it is not UTF-8.") from None
    except csv.Error as error:
        raise InswsnError(f"{path} is not a CSV file: {str(error).strip()}.") from None
    table = dict(zip(columns, found, strict=True))
    for name, cells in table.items():
        empty = cells == "" if name == ANCHOR else np.isnan(cells)
        if name not in layout.gaps and empty.any():
            raise InswsnError(
                f"{path}: an empty cell is in column {name}, row {int(np.argmax(empty)) + 2}; it "
                f"must hold a {'word' if name == ANCHOR else 'number'}, or the row must be "
                "left out."
            )
    return table


def _lines_in(pieces: Iterable[bytes]) -> Iterator[list[str]]:
    """Yield the lines of a text in UTF-8, those of some megabytes at a time."""
    rest = b""
    for piece in chain(pieces, [b"\n"]):
        text, end, rest = (rest + piece).rpartition(b"\n")
        if end:
            lines = (text + end).decode().replace("\r\n", "\n").replace("\r", "\n")
            yield lines.split("\n")[:-1]


def opened(pieces: Iterable[bytes], names: set[str]) -> tuple[str, list[str], Iterator[list[str]]]:
    """Return separator and header of a CSV file, and the lines after it, some megabytes at a time.

    By names of columns a header behind ``#`` or ``%`` is known.
    """
    blocks = _lines_in(pieces)
    lines = next(blocks)
    lines[0] = lines[0].removeprefix("\ufeff")
    # the header is the first line that is no comment, or of the comments before it, if a name
    # stands in none of its cells, the one in which most do
    found = []
    for end, line in enumerate([*lines, ","], start=1):
        head = line.lstrip("#% ") if end <= len(lines) else ""
        cells = re.split(f"[{_SEPARATORS} ]", head)
        found.append((sum(cell.strip(' "') in names for cell in cells), end, head))
        if line.strip() and line[0] not in "#%":
            break
    _, end, head = found[-1] if found[-1][0] else max(found)
    separator = max(_SEPARATORS, key=head.count)
    header = [name.strip() for name in _split([head.strip()], separator)[0]] if head.strip() else []
    rest = (
        [line for line in block if line.strip() and line[0] != "#"]
        for block in chain([lines[end:]], blocks)
    )
    return separator, header, (block for block in rest if block)


def _split(lines: Iterable[str], separator: str) -> list[list[str]]:
    return list(csv.reader(lines, delimiter=separator, skipinitialspace=True, strict=True))


def _columns(path: Path, header: list[str], layout: Layout, named: Named) -> dict[str, Column]:
    """Return the columns to read; refuse a header without those that must be there."""
    if not header:
        raise InswsnError(f"{path} is empty; it must be a CSV file with a header.")
    called = {name: (name, "") for name in layout.names if name in header}
    stamps = [name for name in header if name in _STAMPS]
    if stamps and TIME not in (*header, *named):
        if len(stamps) > 1:
            raise InswsnError(
                f"{path} has the columns {', '.join(stamps)}; it must have one of them."
            )
        called[TIME] = stamps[0], _STAMPS[stamps[0]]
    called |= named
    there = [name for name in layout.names if name in called]
    for name in there:
        if header.count(called[name][0]) > 1:
            raise InswsnError(f"{path} has the column {called[name][0]} more than once.")
    lacking = [name for name, _ in called.values() if name not in header]
    if lacking := lacking or [name for name in layout.of(there) if name not in there]:
        raise InswsnError(
            f"{path} has no column {', '.join(lacking)}; it has {', '.join(header)[:200]}."
        )
    for together in layout.groups:
        some = [name for name in together if name in there]
        if some and len(some) < len(together):
            raise InswsnError(
                f"{path} has only {', '.join(some)} of the columns {', '.join(together)}; it "
                "must have all of them, or none."
            )
    found = {}
    for name in there:
        column, unit = called[name]
        time_unit, size = (unit or "s") if name == TIME else "", units_of(name).get(unit, 1.0)
        found[name] = Column(column, name == ANCHOR, time_unit, size)
    return found


def units_of(name: str) -> dict[str, float]:
    """Return the units that a column may have, and how many of each make one of the wanted."""
    return _SIZES.get(name.rpartition("_")[2], {})


def parse(
    path: Path,
    columns: Sequence[Column],
    separator: str,
    header: list[str],
    blocks: Iterable[list[str]],
) -> list[NDArray[Any]]:
    """Return columns of the blocks after the header: floats, NaN where there is none, or words."""
    places = [header.index(column.name) for column in columns]
    parts: list[list[NDArray[Any]]] = [
        [np.empty(0, dtype=object if column.text else float)] for column in columns
    ]
    first, dated = 2, False  # the header is row 1
    for lines in blocks:
        rows = _split(lines, separator)
        for row, cells in enumerate(rows, start=first):
            if len(cells) != len(header):
                raise InswsnError(
                    f"{path} has {len(cells)} cells in row {row}; there must be {len(header)}, as "
                    "in the header."
                )
        if len(rows) < len(lines):
            raise csv.Error("a cell goes over several lines")
        if first == 2:
            stamps = [k for k, column in zip(places, columns, strict=True) if column.unit == "s"]
            dated = any(_ISO.match(rows[0][k]) for k in stamps)
        for part, column, place in zip(parts, columns, places, strict=True):
            texts = [cells[place].strip() for cells in rows]
            if separator != "," and not any("." in text for text in texts):
                texts = [text.replace(",", ".") for text in texts]
            part.append(_cells(path, column, texts, first, dated))
        first += len(rows)
    return [np.concatenate(part) for part in parts]


def _cells(path: Path, column: Column, texts: list[str], first: int, dated: bool) -> NDArray[Any]:
    """Return cells as words or floats; refuse words and what is no length, speed or time."""
    if column.text:
        return np.array(texts, dtype=object)
    read = np.vectorize(_seconds, otypes=[float]) if dated and column.unit == "s" else floats
    found, largest = read(texts), _LARGEST_TIME * column.size if column.unit else LARGEST
    for row in np.flatnonzero(~(np.abs(found) <= largest)).tolist():
        if texts[row].lower() in ("", "nan"):
            continue
        or_else = ", or a date and time by ISO 8601" if column.unit == "s" else ""
        sizes = [unit for unit in UNITS if abs(found[row]) < _LARGEST_TIME * UNITS[unit]]
        if column.unit and sizes:
            or_else += f"; it seems to be in {sizes[0]}, of which the column is time_{sizes[0]}"
        raise InswsnError(
            f"{path} has {texts[row][:40]!r} in column {column.name}, row {first + row}; it must "
            f"be a finite number below {largest:.0e}{or_else}."
        )
    return found / column.size


def floats(texts: list[str]) -> Array:
    """Return cells as floats, NaN where there is no number."""
    return np.array([float(text) if _NUMBER.fullmatch(text) else nan for text in texts])


def _seconds(text: str) -> float:
    """Return a date and time as seconds since 1970, UTC where no zone is named; else NaN."""
    if _ISO.match(text):
        with suppress(ValueError):
            moment = datetime.fromisoformat(text)
            return (moment if moment.tzinfo else moment.replace(tzinfo=UTC)).timestamp()
    return nan


# --- rows ---


@contextmanager
def reading(path: Path) -> Iterator[None]:
    """Tell in one sentence that names the file what its content makes go wrong."""
    try:
        yield
    except InswsnError as error:
        if str(path) in str(error):
            raise
        raise InswsnError(f"{path}: {error}") from None
    except (ValueError, KeyError, IndexError, TypeError, OverflowError) as error:
        raise InswsnError(f"{path} cannot be read: {str(error).strip('.')}.") from None


def lines_of(path: Path) -> list[tuple[int, str]]:
    """Return the lines of a text file with their numbers, without comments and blank ones."""
    lines = enumerate(read_text(path).splitlines(), start=1)
    return [(n, line) for n, line in lines if line.strip() and not line.startswith("#")]


def numbers(path: Path, rows: Sequence[Row], columns: int) -> Array:
    """Return rows of a file as finite numbers, (rows, columns); refuse what is something else."""
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
    """Return where each anchor stands among those that are known; refuse another, by its row."""
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
    for row in np.flatnonzero(off > _UNIT).tolist():
        raise InswsnError(
            f"the quaternion in row {row + first} is {length[row]:.6g} long; it must be of unit "
            "length."
        )
    # those that are already are kept to the last bit
    return np.where(off[:, None] > _ROUNDING, value / length[:, None], value)
