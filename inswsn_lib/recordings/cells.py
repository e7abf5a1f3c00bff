"""What the cells of a CSV file may hold: what every reader of them takes and refuses."""

from __future__ import annotations

from contextlib import suppress
from pathlib import Path
from typing import NamedTuple

from inswsn_lib.errors import InswsnError

#: Numbers of this size are no lengths or speeds
LARGEST = 1e15
#: Units of time stamps, and how many of each make a second
UNITS = {"s": 1.0, "ms": 1e3, "us": 1e6, "ns": 1e9}
#: Seconds of this size are stamps in a smaller unit: the year 5138
LARGEST_TIME = 1e11
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
    unit: str = ""  # of time stamps, which become seconds

    @property
    def dates(self) -> bool:
        """Whether cells may be dates and times."""
        return self.unit == "s"

    @property
    def per_second(self) -> float:
        """By what numbers are divided."""
        return UNITS.get(self.unit, 1.0)

    @property
    def largest(self) -> float:
        """Below which size numbers are."""
        return LARGEST_TIME * self.per_second if self.unit else LARGEST


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
