"""Columns of CSV files, read some megabytes at a time; those of a recording of INS and network."""

from __future__ import annotations

import csv
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
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
from inswsn_lib.files import read_pieces

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
_PLAIN = re.compile(r"[0-9.eE+-]*")  # of such signs float takes numbers alone
_ONLY_NUMBERS = re.compile(r"[0-9.eE+,;\t\n-]*")

#: Of a column, what it is called in a file, and its unit
Named = Mapping[str, tuple[str, str]]
Table = dict[str, NDArray[Any]]


@dataclass(frozen=True)
class Layout:
    """Which columns a CSV file has: those that must be there, and groups that may be left out.

    Cells of `gaps` may be empty; those of `texts` hold words, all others numbers. The columns of
    `instead` may stand in the place of some that must be there.
    """

    required: tuple[str, ...]
    groups: tuple[tuple[str, ...], ...] = ()
    gaps: tuple[str, ...] = ()
    texts: tuple[str, ...] = ()
    instead: Mapping[tuple[str, ...], tuple[str, ...]] = field(default_factory=dict)

    @property
    def names(self) -> tuple[str, ...]:
        """All columns that there may be."""
        return tuple(dict.fromkeys(chain(self.required, *self.groups, *self.instead.values())))

    def of(self, header: Sequence[str]) -> tuple[str, ...]:
        """Return the columns that must be there, those in their place if some of these are."""
        required = self.required
        for names, others in self.instead.items():
            if set(others) & set(header) and not set(names) <= set(header):
                required = (*(name for name in required if name not in names), *others)
        return required


class Column(NamedTuple):
    """A column that is read: its name and place in the header, and what its cells hold."""

    name: str
    place: int
    text: bool = False  # else numbers
    unit: str = ""  # of time stamps
    size: float = 1.0  # how many of its unit make one of the wanted unit

    @property
    def largest(self) -> float:
        """Below which size numbers are."""
        return _LARGEST_TIME * self.size if self.unit else LARGEST


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

    Entry k of each is row k + 2 of the file, comments and blank lines not counted. Columns of
    numbers are floats, NaN where a cell is empty; columns of words are strings. `named` tells what
    columns are called in the file, and their units, if they have not their own names.
    """
    named = named or {}
    names = {*layout.names, *_STAMPS, *(name for name, _ in named.values())}
    try:
        separator, header, blocks = opened(pieces or read_pieces(path), names)
        columns = _columns(path, header, layout, named)
        found = parse(path, [*columns.values()], separator, len(header), blocks)
    except UnicodeDecodeError:
        raise InswsnError(f"{path} is not a CSV file: it is not UTF-8.") from None
    except csv.Error as error:
        raise InswsnError(f"{path} is not a CSV file: {str(error).strip()}.") from None
    table = dict(zip(columns, found, strict=True))
    for name, cells in table.items():
        empty = cells == "" if name in layout.texts else np.isnan(cells)
        if name not in layout.gaps and empty.any():
            raise InswsnError(
                f"{path}: an empty cell is in column {name}, row {int(np.argmax(empty)) + 2}; it "
                f"must hold a {'word' if name in layout.texts else 'number'}, or the row must be "
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
    _, end, head = _headed(lines, names)
    separator = max(_SEPARATORS, key=head.count)
    header = [name.strip() for name in _split([head.strip()], separator)[0]] if head.strip() else []
    rest = (
        [line for line in block if line.strip() and line[0] != "#"]
        for block in chain([lines[end:]], blocks)
    )
    return separator, header, (block for block in rest if block)


def _headed(lines: list[str], names: set[str]) -> tuple[int, int, str]:
    """Return how many names stand in the header, how many lines it ends, and the header.

    It is the first line that is no comment, or of the comments before it, if a name of a column
    stands in none of its cells, the one in which most do.
    """
    found = []
    for end, line in enumerate(lines, start=1):
        head = line.lstrip("#% ")
        cells = re.split(f"[{_SEPARATORS} ]", head)
        found.append((sum(cell.strip(' "') in names for cell in cells), end, head))
        if line.strip() and line[0] not in "#%":
            break
    else:
        found.append((0, len(lines) + 1, ""))
    return found[-1] if found[-1][0] else max(found)


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
        found[name] = Column(
            column, header.index(column), name in layout.texts,
            (unit or "s") if name == TIME else "", units_of(name).get(unit, 1.0),
        )  # fmt: skip
    return found


def units_of(name: str) -> dict[str, float]:
    """Return the units that a column may have, and how many of each make one of the wanted."""
    return _SIZES.get(name.rpartition("_")[2], {})


def parse(
    path: Path, columns: Sequence[Column], separator: str, width: int, blocks: Iterable[list[str]]
) -> list[NDArray[Any]]:
    """Return columns of a file: floats, NaN where a cell is empty, or words.

    Blocks are lines after the header, each of as many cells; none is blank or a comment.
    """
    parts: list[list[NDArray[Any]]] = [
        [np.empty(0, dtype=object if column.text else float)] for column in columns
    ]
    first, dated = 2, False  # the header is row 1
    for lines in blocks:
        found = _plain_numbers(columns, separator, width, lines)
        if not found:
            rows = _split(lines, separator)
            for row, cells in enumerate(rows, start=first):
                if len(cells) != width:
                    raise InswsnError(
                        f"{path} has {len(cells)} cells in row {row}; there must be {width}, as in "
                        "the header."
                    )
            if len(rows) < len(lines):
                raise csv.Error("a cell goes over several lines")
            if first == 2:
                dated = any(c.unit == "s" and bool(_ISO.match(rows[0][c.place])) for c in columns)
            for column in columns:
                texts = [cells[column.place].strip() for cells in rows]
                if separator != "," and not any("." in text for text in texts):
                    texts = [text.replace(",", ".") for text in texts]
                found.append(_cells(path, column, texts, first, dated))
        for part, values in zip(parts, found, strict=True):
            part.append(values)
        first += len(lines)
    return [np.concatenate(part) for part in parts]


def _plain_numbers(
    columns: Sequence[Column], separator: str, width: int, lines: list[str]
) -> list[NDArray[Any]]:
    """Return the columns of lines that hold nothing but numbers, or none; three times as fast."""
    if any(c.text for c in columns) or not _ONLY_NUMBERS.fullmatch("\n".join(lines)):
        return []
    with suppress(ValueError):  # what is no number, or rows that differ in length
        table = np.loadtxt(lines, delimiter=separator, ndmin=2)
        if table.shape[1] == width:
            found = [(table[:, column.place], column) for column in columns]
            if all((np.abs(values) <= column.largest).all() for values, column in found):
                return [values / column.size for values, column in found]
    return []


def _cells(path: Path, column: Column, texts: list[str], first: int, dated: bool) -> NDArray[Any]:
    """Return cells as words or floats; refuse words and what is no length, speed or time."""
    if column.text:
        return np.array(texts, dtype=object)
    read = np.vectorize(_seconds, otypes=[float]) if dated and column.unit == "s" else floats
    found = read(texts)
    for row in np.flatnonzero(~(np.abs(found) <= column.largest)).tolist():
        if texts[row].lower() in ("", "nan"):
            continue
        or_else = ", or a date and time by ISO 8601" if column.unit == "s" else ""
        sizes = [unit for unit in UNITS if abs(found[row]) < _LARGEST_TIME * UNITS[unit]]
        if column.unit and sizes:
            or_else += f"; it seems to be in {sizes[0]}, of which the column is time_{sizes[0]}"
        raise InswsnError(
            f"{path} has {texts[row][:40]!r} in column {column.name}, row {first + row}; it must "
            f"be a finite number below {column.largest:.0e}{or_else}."
        )
    return found / column.size


def floats(texts: list[str]) -> Array:
    """Return cells as floats, NaN where there is no number."""
    with suppress(ValueError):
        if _PLAIN.fullmatch("".join(texts)):
            return np.array([float(text) if text else nan for text in texts])
    return np.array([float(text) if _NUMBER.fullmatch(text) else nan for text in texts])


def _seconds(text: str) -> float:
    """Return a date and time as seconds since 1970, UTC where no zone is named; else NaN."""
    if _ISO.match(text):
        with suppress(ValueError):
            moment = datetime.fromisoformat(text)
            return (moment if moment.tzinfo else moment.replace(tzinfo=UTC)).timestamp()
    return nan
