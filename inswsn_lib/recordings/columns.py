"""Columns of a CSV file, and which of them a recording of an INS and a sensor network has."""

from __future__ import annotations

import csv
import re
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from inswsn_lib.checks import Array
from inswsn_lib.errors import InswsnError
from inswsn_lib.files import read_bytes
from inswsn_lib.recordings import plain_cells
from inswsn_lib.recordings.cells import UNITS, Column, Sheet

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


@dataclass(frozen=True)
class Layout:
    """Which columns a CSV file has.

    Attributes
    ----------
    required : tuple of str
        Those that must be there.
    groups : tuple of tuple of str
        Those that may be left out, each together with the others of its group.
    gaps : tuple of str
        Those whose cells may be empty.
    texts : tuple of str
        Those that hold words; all others hold numbers.
    """

    required: tuple[str, ...]
    groups: tuple[tuple[str, ...], ...] = ()
    gaps: tuple[str, ...] = ()
    texts: tuple[str, ...] = ()

    @property
    def names(self) -> tuple[str, ...]:
        """All columns that there may be."""
        return (*self.required, *(name for group in self.groups for name in group))


_TRACKS = Layout((TIME, *INS, *WSN[:2]), (WSN[2:], REFERENCE), gaps=(*WSN, *REFERENCE))
_STAMPS = {f"{word}_{unit}": unit for unit in UNITS for word in ("time", "t")}
_SEPARATORS = ",;\t"
_SMALL = 500_000  # bytes that are read without pandas in the time in which it is loaded
_Table = dict[str, NDArray[Any]]


def read_columns(path: Path) -> dict[str, Array]:
    """Return the columns of INS, network and reference, a network's missing velocity all NaN.

    Their entry k is row k + 2 of the file, comments and blank lines not counted.
    """
    return _with_velocities(read_table(path, _TRACKS))


def columns_of(path: Path, data: bytes) -> dict[str, Array]:
    """Return what `read_columns` does of what is in a file, without pandas.

    The path is named in sentences, and not looked at.
    """
    return _with_velocities(_table_of(path, data, _TRACKS, plain_cells.parse))


def _with_velocities(table: _Table) -> _Table:
    return dict.fromkeys(WSN[2:], np.full(len(table[TIME]), np.nan)) | table


def read_table(path: Path, layout: Layout) -> _Table:
    """Return the columns of a CSV file that a layout names; others are ignored.

    Entry k of each is row k + 2 of the file, comments and blank lines not counted. Columns of
    numbers are floats, NaN where a cell is empty; columns of words are strings.
    """
    data = read_bytes(path)
    if len(data) < _SMALL:
        return _table_of(path, data, layout, plain_cells.parse)
    from inswsn_lib.recordings import pandas_cells  # noqa: PLC0415  # it takes long to load

    return _table_of(path, data, layout, pandas_cells.parse)


def _table_of(path: Path, data: bytes, layout: Layout, parse: Callable[[Sheet], _Table]) -> _Table:
    try:
        data = _headed(_as_utf8(data), {*layout.names, *_STAMPS})
        head = data[: data.find(b"\n") + 1].decode().strip()
        separator = max(_SEPARATORS, key=head.count)
        header = [name.strip() for name in _cells(head, separator)] if data else []
        stamps = _stamps(path, header)
        renamed = [TIME if name == stamps else name for name in header]
        columns = tuple(
            Column(
                header[k := renamed.index(name)], k, name in layout.texts, name in layout.gaps,
                _STAMPS[stamps] if name == TIME else "",
            )
            for name in _wanted(path, renamed, layout)
        )  # fmt: skip
        _refuse_other_lengths(path, data, separator, len(header))
        table = parse(Sheet(path, data, separator, len(header), columns))
        return {TIME if name == stamps else name: cells for name, cells in table.items()}
    except UnicodeDecodeError:
        raise InswsnError(f"{path} is not a CSV file: it is not UTF-8.") from None
    except csv.Error as error:
        raise InswsnError(f"{path} is not a CSV file: {str(error).strip()}.") from None


def _as_utf8(data: bytes) -> bytes:
    """Return what a file holds with line feeds alone; refuse what is no text."""
    data = data.removeprefix(b"\xef\xbb\xbf")
    if not data.isascii():
        data.decode()
    if b"\r" in data:
        data = data.replace(b"\r\n", b"\n").replace(b"\r", b"\n")
    return data if data.endswith(b"\n") else data + b"\n"


def _ends(data: bytes, sign: str = "\n") -> NDArray[np.intp]:
    return np.flatnonzero(np.frombuffer(data, np.uint8) == ord(sign))


def _headed(data: bytes, names: set[str]) -> bytes:
    """Return the header, which may stand behind ``#`` or ``%``, and the lines that are no comments.

    It is the first line that is no comment, or of the comments before it, if a name of a column
    stands in none of its cells, the one in which most do.
    """
    end, lines = 0, [(0, b"", 0)]  # how many names each has, and where it ends
    while end < len(data):
        begin, end = end, data.index(b"\n", end) + 1
        line = data[begin:end].lstrip(b"#% ")
        cells = re.split(f"[{_SEPARATORS} ]", line.decode())
        lines.append((sum(cell.strip(' "\n') in names for cell in cells), line, end))
        if data[begin : begin + 1] not in b"#%" and line.strip():
            break
    else:
        lines.append((0, b"", end))
    _, header, end = lines[-1] if lines[-1][0] else max(lines[::-1], key=lambda each: each[0])
    return header + _without_comments(data[end:])


def _without_comments(data: bytes) -> bytes:
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


def _cells(line: str, separator: str) -> list[str]:
    return next(csv.reader([line], delimiter=separator, skipinitialspace=True, strict=True))


def _stamps(path: Path, header: list[str]) -> str:
    """Return the column of time stamps: that in s, or else the one in another unit."""
    there = [name for name in header if name in _STAMPS]
    if TIME in there or not there:
        return TIME
    if len(there) > 1:
        raise InswsnError(f"{path} has the columns {', '.join(there)}; it must have one of them.")
    return there[0]


def _wanted(path: Path, header: list[str], layout: Layout) -> list[str]:
    """Return the columns to read; refuse a header without those that must be there."""
    if not header:
        raise InswsnError(f"{path} is empty; it must be a CSV file with a header.")
    for name in layout.names:
        if header.count(name) > 1:
            raise InswsnError(f"{path} has the column {name} more than once.")
    if lacking := [name for name in layout.required if name not in header]:
        raise InswsnError(
            f"{path} has no column {', '.join(lacking)}; it has {', '.join(header)[:200]}."
        )
    for together in layout.groups:
        some = [name for name in together if name in header]
        if some and len(some) < len(together):
            raise InswsnError(
                f"{path} has only {', '.join(some)} of the columns {', '.join(together)}; it "
                "must have all of them, or none."
            )
    return [name for name in layout.names if name in header]


def _refuse_other_lengths(path: Path, data: bytes, separator: str, cells: int) -> None:
    """Refuse a file with a line that has another number of cells than the header."""
    ends, signs = _ends(data), _ends(data, separator)
    if b'"' not in data and signs.size == ends.size * (cells - 1):
        each = signs.reshape(ends.size, cells - 1)
        if (each[1:, 0] > ends[:-1]).all() and (each[:, -1] < ends).all():
            return
    # a separator may stand within quotes: lines with one are split, and those with a wrong count
    others = np.diff(np.searchsorted(signs, ends), prepend=0) != cells - 1
    others |= np.diff(np.searchsorted(_ends(data, '"'), ends), prepend=0) > 0
    for row in np.flatnonzero(others).tolist():
        begin = int(ends[row - 1]) + 1 if row else 0
        there = len(_cells(data[begin : int(ends[row])].decode(), separator))
        if there != cells:
            raise InswsnError(
                f"{path} has {there} cells in row {row + 1}; there must be {cells}, as in the "
                "header."
            )
