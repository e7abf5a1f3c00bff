"""What the cells of a CSV file may hold: what every reader of them takes and refuses."""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

from inswsn_lib.errors import InswsnError

#: Numbers of this size are no lengths, speeds or seconds
LARGEST = 1e15
#: Cells in which no number stands, in small letters
NOT_THERE = ("", "nan")
#: How a date and time by ISO 8601 begins
ISO = r"\d{4}-?\d\d-?\d\d[T ]\d\d"
#: Rows that tell the decimal sign
PEEK = 1000


class Column(NamedTuple):
    """A column that is read: its name, its place in the header, and what its cells may hold."""

    name: str
    place: int
    words: bool  # else numbers
    gaps: bool  # cells may be empty
    dates: bool  # or dates and times


class Sheet(NamedTuple):
    """A CSV file whose lines, the header first, all have as many cells as it has columns."""

    path: Path  # to name in a sentence
    data: bytes
    separator: str
    width: int
    columns: tuple[Column, ...]  # that are read


def decimal_sign(texts: str, separator: str) -> str:
    """Return the decimal sign of cells: a comma may be one where it does not separate."""
    return "." if separator == "," else max(".,", key=texts.count)


def refused(path: Path, column: Column, cell: str, row: int) -> InswsnError:
    """Return what is said of a cell in a row, from 0, that holds no number."""
    empty = ", or empty where there is no fix" if column.gaps else ""
    or_else = ", or a date and time by ISO 8601" if column.dates else empty
    return InswsnError(
        f"{path} has {cell[:40]!r} in column {column.name}, row {row + 2}; it must be a finite "
        f"number below {LARGEST:.0e}{or_else}."
    )
