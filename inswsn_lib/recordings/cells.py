"""Cells of a CSV file: what they may hold, read some megabytes at a time.

Where there is pandas, it reads blocks in which every cell is as it should be, seven times as fast;
all others, and whatever is refused, are read cell by cell.
"""

from __future__ import annotations

import csv
import re
from collections.abc import Iterable, Iterator
from contextlib import suppress
from datetime import UTC, datetime
from io import BytesIO
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
_TRUTH = re.compile(rb"true|false", re.I)
_NOT_THERE = ("", "nan")  # in small letters
_SMALL = 200_000  # bytes that are read without pandas in the time in which it is loaded
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


def whole_lines(pieces: Iterable[bytes]) -> Iterator[bytes]:
    """Yield a text in pieces that end where lines do, with line feeds alone; it must be UTF-8."""
    rest: list[bytes] = []
    for piece in pieces:
        end = piece.rfind(b"\n") + 1
        if end:
            yield _with_line_feeds(b"".join([*rest, piece[:end]]))
            rest = []
        rest.append(piece[end:])
    if any(rest):
        text = _with_line_feeds(b"".join(rest))
        yield text if text.endswith(b"\n") else text + b"\n"


def _with_line_feeds(data: bytes) -> bytes:
    if not data.isascii():
        data.decode()
    return data.replace(b"\r\n", b"\n").replace(b"\r", b"\n") if b"\r" in data else data


def without_comments(data: bytes) -> bytes:
    """Return the lines that neither are blank nor begin with ``#``."""
    ends = _ends(data)
    begins = np.append(0, ends + 1)[:-1]
    first = np.frombuffer(data, np.uint8)[begins]
    kept, done = [], 0
    for line in np.flatnonzero((first <= ord(" ")) | (first == ord("#"))).tolist():
        begin, end = int(begins[line]), int(ends[line]) + 1
        if data[begin : begin + 1] == b"#" or not data[begin:end].strip():
            kept.append(data[done:begin])
            done = end
    return b"".join([*kept, data[done:]]) if kept else data


def split(line: str, separator: str) -> list[str]:
    """Return the cells of a line."""
    return next(csv.reader([line], delimiter=separator, skipinitialspace=True, strict=True))


def parse(sheet: Sheet, blocks: Iterable[bytes]) -> list[NDArray[Any]]:
    """Return the columns of a file: floats, NaN where a cell is empty, or words.

    Blocks are lines after the header, of which none is blank or a comment.
    """
    parts: list[list[NDArray[Any]]] = [[] for _ in sheet.columns]
    row, signs = 0, None
    for block in blocks:
        _refuse_other_lengths(sheet, block, row)
        signs = signs or _signs(sheet, block)
        found = _at_once(sheet, block, signs) or _one_by_one(sheet, block, signs, row)
        for part, values in zip(parts, found, strict=True):
            part.append(values)
        row += block.count(b"\n")
    columns = []
    for column in sheet.columns:
        part = parts.pop(0)  # what is put together is not kept in parts
        part = part or [np.empty(0, dtype=object if column.words else float)]
        columns.append(part[0] if len(part) == 1 else np.concatenate(part))
    return columns


class _Signs(NamedTuple):
    decimal: str
    dated: bool  # time stamps are dates


def _signs(sheet: Sheet, block: bytes) -> _Signs:
    """Return what the first rows tell: a comma may be decimal where it does not separate."""
    lines = block[: 1000 * _PEEK].decode(errors="ignore").split("\n")[:_PEEK]
    rows = [row for row in _rows(sheet, lines) if len(row) == sheet.width]
    numeric = [column.place for column in sheet.columns if not column.words]
    seen = "".join(row[place] for row in rows for place in numeric)
    dates = [
        bool(_ISO.match(row[c.place].strip())) for c in sheet.columns if c.dates for row in rows
    ]
    decimal = "." if sheet.separator == "," else max(".,", key=seen.count)
    return _Signs(decimal, 2 * sum(dates) > len(dates))


def _at_once(sheet: Sheet, block: bytes, signs: _Signs) -> list[NDArray[Any]]:
    """Return the columns by pandas; nothing where a cell is not as it should be."""
    if len(block) < _SMALL:
        return []
    try:
        import pandas as pd  # noqa: PLC0415  # it takes long to load, and a page has none
    except ImportError:
        return []
    texts = [column.words or (column.dates and signs.dated) for column in sheet.columns]
    kinds = {c.place: str if text else float for c, text in zip(sheet.columns, texts, strict=True)}
    empty: Any = {place: ["", "nan", "NaN"] for place, kind in kinds.items() if kind is float}
    with suppress(ValueError):
        table = pd.read_csv(
            BytesIO(block), sep=sheet.separator, decimal=signs.decimal, index_col=False,
            header=None, names=range(sheet.width), usecols=list(kinds), dtype=kinds,
            keep_default_na=False, na_values=empty, skipinitialspace=b" " in block,
        )  # fmt: skip
        found: list[NDArray[Any]] = []
        for column, text in zip(sheet.columns, texts, strict=True):
            values = table[column.place]
            if column.words:
                found.append(values.str.strip().to_numpy(dtype=object))
                continue
            numbers = _dated(values.tolist(), signs.decimal) if text else values.to_numpy()
            if (np.abs(numbers) >= column.largest).any() or (text and np.isnan(numbers).any()):
                return []
            if (numbers * (numbers - 1) == 0).all() and _TRUTH.search(block):
                return []  # pandas takes these words for 1 and 0
            found.append(column.scaled(numbers))
        return found
    return []


def _one_by_one(sheet: Sheet, block: bytes, signs: _Signs, before: int) -> list[NDArray[Any]]:
    rows = list(_rows(sheet, block.decode().split("\n")[:-1]))
    found: list[NDArray[Any]] = []
    for column in sheet.columns:
        texts = [row[column.place].strip() for row in rows]
        if column.words:
            found.append(np.array(texts, dtype=object))
        else:
            found.append(_numbers(sheet.path, column, texts, signs, before))
    return found


def _rows(sheet: Sheet, lines: list[str]) -> Iterator[list[str]]:
    return csv.reader(lines, delimiter=sheet.separator, skipinitialspace=True, strict=True)


def _numbers(path: Path, column: Column, texts: list[str], signs: _Signs, before: int) -> Array:
    """Return cells as floats; refuse words and what is no length, speed or time."""
    there = np.array([text.lower() not in _NOT_THERE for text in texts], dtype=bool)
    if column.dates and signs.dated:
        found = _dated(texts, signs.decimal)
    else:
        found = np.array([_number(text.replace(signs.decimal, ".")) for text in texts])
        if np.isnan(found[there]).any():
            # a column may have points for all that where others have commas
            found = np.array([_number(text) for text in texts])
    wrong = (np.isnan(found) & there) | (np.abs(found) > column.largest)
    if wrong.any():
        row = int(np.argmax(wrong))
        raise _refused(path, column, texts[row], before + row)
    return column.scaled(found)


def _number(text: str) -> float:
    return float(text) if _NUMBER.fullmatch(text) else nan


def _dated(texts: list[str], decimal: str) -> Array:
    return np.array([_seconds(text.strip().replace(decimal, ".")) for text in texts])


def _seconds(text: str) -> float:
    """Return a date and time as seconds since 1970, UTC where no zone is named; else NaN."""
    if _ISO.match(text):
        with suppress(ValueError):
            moment = datetime.fromisoformat(text)
            return (moment if moment.tzinfo else moment.replace(tzinfo=UTC)).timestamp()
    return nan


def _refused(path: Path, column: Column, cell: str, row: int) -> InswsnError:
    """Return what is said of a cell in a row, from 0, that holds no number, or too large a one."""
    empty = ", or empty where there is no fix" if column.gaps else ""
    or_else = ", or a date and time by ISO 8601" if column.dates else empty
    seems = ""
    with suppress(ValueError):
        sizes = [unit for unit in UNITS if abs(float(cell)) < LARGEST_TIME * UNITS[unit]]
        if column.unit and sizes:
            seems = f"; it seems to be in {sizes[0]}, of which the column is time_{sizes[0]}"
    return InswsnError(
        f"{path} has {cell[:40]!r} in column {column.name}, row {row + 2}; it must be a finite "
        f"number below {column.largest:.0e}{or_else}{seems}."
    )


def _ends(data: bytes, sign: str = "\n") -> NDArray[np.intp]:
    return np.flatnonzero(np.frombuffer(data, np.uint8) == ord(sign))


def _refuse_other_lengths(sheet: Sheet, block: bytes, before: int) -> None:
    """Refuse a line that has another number of cells than the header."""
    ends, signs = _ends(block), _ends(block, sheet.separator)
    if b'"' not in block and signs.size == ends.size * (sheet.width - 1):
        apart = signs.reshape(ends.size, sheet.width - 1)
        if not apart.size or ((apart[1:, 0] > ends[:-1]).all() and (apart[:, -1] < ends).all()):
            return
    # a separator may stand within quotes: lines with one are split, and those with a wrong count
    others = np.diff(np.searchsorted(signs, ends), prepend=0) != sheet.width - 1
    others |= np.diff(np.searchsorted(_ends(block, '"'), ends), prepend=0) > 0
    for row in np.flatnonzero(others).tolist():
        begin = int(ends[row - 1]) + 1 if row else 0
        count = len(split(block[begin : int(ends[row])].decode(), sheet.separator))
        if count != sheet.width:
            raise InswsnError(
                f"{sheet.path} has {count} cells in row {before + row + 2}; there must be "
                f"{sheet.width}, as in the header."
            )
