"""Cells of a CSV file: what they may hold, read some megabytes at a time.

Long blocks that hold plain numbers alone are read by pandas where there is one, four times as fast.
"""

from __future__ import annotations

import csv
import re
from collections.abc import Iterable, Iterator
from contextlib import suppress
from datetime import UTC, datetime
from io import StringIO
from itertools import chain
from math import nan
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from inswsn_lib.checks import Array
from inswsn_lib.errors import InswsnError

#: Numbers of this size are no lengths or speeds
LARGEST = 1e15
#: Units of time stamps, and how many of each make a second
UNITS = {"s": 1.0, "ms": 1e3, "us": 1e6, "ns": 1e9}
#: Seconds of this size are stamps in a smaller unit: the year 5138
LARGEST_TIME = 1e11
#: How a date and time by ISO 8601 begins
_ISO = re.compile(r"\d{4}-?\d\d-?\d\d[T ]\d\d")
# what a number may be: float takes other digits, and digits in groups, too
_NUMBER = re.compile(r"[-+]?(\d+\.?\d*|\.\d+)(e[-+]?\d+)?|[-+]?inf(inity)?", re.A | re.I)
_PLAIN = re.compile(r"[0-9.eE+-]*")  # of such signs float takes numbers alone
_ONLY_NUMBERS = re.compile(r"[0-9.eE+,;\t\n-]*")
_LONG = 20_000  # lines, that are read without pandas in the time in which it is loaded
_NOT_THERE = ("", "nan")  # in small letters
_PEEK = 1000  # rows that tell the decimal sign


class Column(NamedTuple):
    """A column that is read: its name, its place in the header, and what its cells may hold."""

    name: str  # in the header
    place: int
    words: bool = False  # else numbers
    gaps: bool = False  # cells may be empty
    unit: str = ""  # of time stamps, which become seconds
    factor: float = 1.0  # by which other numbers are multiplied

    @property
    def dates(self) -> bool:
        """Whether cells may be dates and times."""
        return self.unit == "s"

    @property
    def largest(self) -> float:
        """Below which size numbers are."""
        return LARGEST_TIME * UNITS[self.unit] if self.unit else LARGEST

    def scaled(self, values: Array) -> Array:
        """Return numbers in the unit that is wanted."""
        if self.unit:
            return values / UNITS[self.unit]
        return values if self.factor == 1 else values * self.factor


class Sheet(NamedTuple):
    """How a CSV file is written, and what is read of it."""

    path: Path  # to name in a sentence
    separator: str
    width: int  # cells of each line
    columns: tuple[Column, ...]


def lines_in(pieces: Iterable[bytes]) -> Iterator[list[str]]:
    """Yield the lines of a text in UTF-8, those of some megabytes at a time."""
    rest = b""
    for piece in chain(pieces, [b"\n"]):
        text, end, rest = (rest + piece).rpartition(b"\n")
        if end:
            lines = (text + end).decode().replace("\r\n", "\n").replace("\r", "\n")
            yield lines.split("\n")[:-1]


def split(lines: Iterable[str], separator: str) -> list[list[str]]:
    """Return the cells of each line."""
    return list(csv.reader(lines, delimiter=separator, skipinitialspace=True, strict=True))


def parse(sheet: Sheet, blocks: Iterable[list[str]]) -> list[NDArray[Any]]:
    """Return the columns of a file: floats, NaN where a cell is empty, or words.

    Blocks are lines after the header, of which none is blank or a comment.
    """
    parts: list[list[NDArray[Any]]] = [
        [np.empty(0, dtype=object if column.words else float)] for column in sheet.columns
    ]
    first, signs = 2, None  # the header is row 1
    for lines in blocks:
        if quick := _plain_numbers(sheet, lines):
            for part, values in zip(parts, quick, strict=True):
                part.append(values)
            first += len(lines)
            continue
        rows = split(lines, sheet.separator)
        for row, cells in enumerate(rows, start=first):
            if len(cells) != sheet.width:
                raise InswsnError(
                    f"{sheet.path} has {len(cells)} cells in row {row}; there must be "
                    f"{sheet.width}, as in the header."
                )
        if len(rows) < len(lines):
            raise csv.Error("a cell goes over several lines")
        signs = signs or _signs(sheet, rows[:_PEEK])
        for part, column in zip(parts, sheet.columns, strict=True):
            texts = [cells[column.place].strip() for cells in rows]
            found = np.array(texts, dtype=object)
            part.append(
                found if column.words else _numbers(sheet.path, column, texts, signs, first)
            )
        first += len(rows)
    return [np.concatenate(part) for part in parts]


def _plain_numbers(sheet: Sheet, lines: list[str]) -> list[Array]:
    """Return the columns of lines that hold nothing but numbers; none where one is not so."""
    text = "\n".join(lines)
    if len(lines) < _LONG or any(column.words for column in sheet.columns):
        return []
    even = all(line.count(sheet.separator) == sheet.width - 1 for line in lines)
    if not even or not _ONLY_NUMBERS.fullmatch(text):
        return []
    try:
        import pandas as pd  # noqa: PLC0415  # it takes long to load, and a page has none
    except ImportError:
        return []
    with suppress(ValueError):  # no number
        table = pd.read_csv(
            StringIO(text), sep=sheet.separator, header=None, names=range(sheet.width),
            index_col=False, usecols=[c.place for c in sheet.columns], dtype=float,
        )  # fmt: skip
        found = [table[column.place].to_numpy() for column in sheet.columns]
        if not any(
            (np.abs(x) > c.largest).any() for x, c in zip(found, sheet.columns, strict=True)
        ):
            return [c.scaled(x) for x, c in zip(found, sheet.columns, strict=True)]
    return []


class _Signs(NamedTuple):
    decimal: str
    dated: bool  # time stamps are dates


def _signs(sheet: Sheet, rows: list[list[str]]) -> _Signs:
    """Return what the first rows tell: a comma may be decimal where it does not separate."""
    seen = "".join(row[c.place] for row in rows for c in sheet.columns if not c.words)
    dates = [
        bool(_ISO.match(row[c.place].strip())) for c in sheet.columns if c.dates for row in rows
    ]
    decimal = "." if sheet.separator == "," else max(".,", key=seen.count)
    return _Signs(decimal, 2 * sum(dates) > len(dates))


def _numbers(path: Path, column: Column, texts: list[str], signs: _Signs, first: int) -> Array:
    """Return cells as floats; refuse words and what is no length, speed or time."""
    pointed = texts
    if signs.decimal != ".":
        pointed = [text.replace(signs.decimal, ".") for text in texts]
    dated = column.dates and signs.dated
    found = np.array([_seconds(text) for text in pointed]) if dated else floats(pointed)
    if not dated and any(texts[row].lower() not in _NOT_THERE for row in _missing(found)):
        # a column may have points for all that where others have commas
        found = floats(texts)
    wrong = np.abs(found) > column.largest
    wrong[[row for row in _missing(found) if texts[row].lower() not in _NOT_THERE]] = True
    if wrong.any():
        row = int(np.argmax(wrong))
        raise _refused(path, column, texts[row], first + row)
    return column.scaled(found)


def _missing(found: Array) -> list[int]:
    return np.flatnonzero(np.isnan(found)).tolist()


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


def _refused(path: Path, column: Column, cell: str, row: int) -> InswsnError:
    """Return what is said of a cell in a row that holds no number, or too large a one."""
    empty = ", or empty where there is no fix" if column.gaps else ""
    or_else = ", or a date and time by ISO 8601" if column.dates else empty
    seems = ""
    with suppress(ValueError):
        sizes = [unit for unit in UNITS if abs(float(cell)) < LARGEST_TIME * UNITS[unit]]
        if column.unit and sizes:
            seems = f"; it seems to be in {sizes[0]}, of which the column is time_{sizes[0]}"
    return InswsnError(
        f"{path} has {cell[:40]!r} in column {column.name}, row {row}; it must be a finite "
        f"number below {column.largest:.0e}{or_else}{seems}."
    )
