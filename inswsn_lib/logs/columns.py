"""Columns of a CSV file, and which of them a recording of an INS and a sensor network has."""

from __future__ import annotations

import csv
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import chain
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from inswsn_lib.checks import Array
from inswsn_lib.errors import InswsnError
from inswsn_lib.files import read_pieces
from inswsn_lib.logs.cells import UNITS, Column, Sheet, lines_in, parse, split

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
    instead : mapping of tuple of str to tuple of str
        Those that may stand in the place of some that must be there.
    """

    required: tuple[str, ...]
    groups: tuple[tuple[str, ...], ...] = ()
    gaps: tuple[str, ...] = ()
    texts: tuple[str, ...] = ()
    instead: Mapping[tuple[str, ...], tuple[str, ...]] = field(default_factory=dict)

    @property
    def names(self) -> tuple[str, ...]:
        """All columns that there may be."""
        others = (*self.groups, *self.instead.values())
        return (*self.required, *(name for group in others for name in group))

    def of(self, header: Sequence[str]) -> tuple[str, ...]:
        """Return the columns that must be there, those in their place if some of these are."""
        required = self.required
        for names, others in self.instead.items():
            if set(others) & set(header) and not set(names) <= set(header):
                required = (*(name for name in required if name not in names), *others)
        return required


_TRACKS = Layout((TIME, *INS, *WSN[:2]), (WSN[2:], REFERENCE), gaps=(*WSN, *REFERENCE))
_STAMPS = {f"{word}_{unit}": unit for unit in UNITS for word in ("time", "t")}
#: Units that columns may be said to have, by the end of their names, and how large each is
FACTORS: dict[str, dict[str, float]] = {
    "s": {unit: 1 / size for unit, size in UNITS.items()},
    "m": {"m": 1.0, "cm": 1e-2, "mm": 1e-3, "km": 1e3, "ft": 0.3048},
    "mps": {"m/s": 1.0, "km/h": 1 / 3.6, "knots": 1852 / 3600},
    "radps": {"rad/s": 1.0, "deg/s": np.pi / 180},
    "mps2": {"m/s^2": 1.0, "g": 9.80665, "mg": 9.80665e-3},
    "deg": {"deg": 1.0, "rad": 180 / np.pi},
}
#: Of a column, what it is called in a file, and its unit
Named = Mapping[str, tuple[str, str]]
_SEPARATORS = ",;\t"
_Table = dict[str, NDArray[Any]]


def read_columns(path: Path) -> dict[str, Array]:
    """Return the columns of INS, network and reference, a network's missing velocity all NaN.

    Their entry k is row k + 2 of the file, comments and blank lines not counted.
    """
    return _with_velocities(read_table(path, _TRACKS))


def columns_of(path: Path, data: bytes) -> dict[str, Array]:
    """Return what `read_columns` does of what is in a file.

    The path is named in sentences, and not looked at.
    """
    return _with_velocities(_table_of(path, [data], _TRACKS, {}))


def _with_velocities(table: _Table) -> _Table:
    return dict.fromkeys(WSN[2:], np.full(len(table[TIME]), np.nan)) | table


def read_table(path: Path, layout: Layout, named: Named | None = None) -> _Table:
    """Return the columns of a CSV file that a layout names; others are ignored.

    Entry k of each is row k + 2 of the file, comments and blank lines not counted. Columns of
    numbers are floats, NaN where a cell is empty; columns of words are strings.

    Parameters
    ----------
    path : Path
    layout : Layout
    named : mapping of str to (str, str), optional
        What columns of the layout are called in the file, and their units; others have their own
        names.
    """
    return _table_of(path, read_pieces(path), layout, named or {})


def _table_of(path: Path, pieces: Iterable[bytes], layout: Layout, named: Named) -> _Table:
    try:
        there = {*layout.names, *_STAMPS, *(name for name, _ in named.values())}
        separator, header, blocks = opened(pieces, there)
        columns = _columns(path, header, layout, named)
        sheet = Sheet(path, separator, len(header), tuple(columns.values()))
        table = dict(zip(columns, parse(sheet, blocks), strict=True))
    except UnicodeDecodeError:
        raise InswsnError(f"{path} is not a CSV file: it is not UTF-8.") from None
    except csv.Error as error:
        raise InswsnError(f"{path} is not a CSV file: {str(error).strip()}.") from None
    for name, cells in table.items():
        empty = cells == "" if name in layout.texts else np.isnan(cells)
        if name not in layout.gaps and empty.any():
            what = "word" if name in layout.texts else "number"
            raise InswsnError(
                f"{path}: an empty cell is in column {name}, row {int(np.argmax(empty)) + 2}; it "
                f"must hold a {what}, or the row must be left out."
            )
    return table


def opened(pieces: Iterable[bytes], names: set[str]) -> tuple[str, list[str], Iterator[list[str]]]:
    """Return separator and header of a CSV file, and the lines after it, some megabytes at a time.

    Parameters
    ----------
    pieces : iterable of bytes
        Of the file.
    names : set of str
        Of columns, by which a header behind ``#`` or ``%`` is known.
    """
    blocks = lines_in(pieces)
    lines = next(blocks)
    lines[:1] = [line.removeprefix("\ufeff") for line in lines[:1]]
    _, end, head = _headed(lines, names)
    separator = max(_SEPARATORS, key=head.count)
    header = [name.strip() for name in split([head.strip()], separator)[0]] if head.strip() else []
    rest = (
        [line for line in block if line.strip() and line[0] != "#"]
        for block in chain([lines[end:]], blocks)
    )
    return separator, header, (block for block in rest if block)


def _headed(lines: list[str], names: set[str]) -> tuple[int, int, str]:
    """Return the header, which may stand behind ``#`` or ``%``.

    It is the first line that is no comment, or of the comments before it, if a name of a column
    stands in none of its cells, the one in which most do. Before it stands how many do, and how
    many lines it ends.
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


def _columns(path: Path, header: list[str], layout: Layout, named: Named) -> dict[str, Column]:
    """Return the columns to read; refuse a header without those that must be there."""
    if not header:
        raise InswsnError(f"{path} is empty; it must be a CSV file with a header.")
    # what columns of the layout are called here, and their units
    called = {name: (name, "") for name in layout.names if name in header}
    if TIME not in named and (stamps := _stamps(path, header)) in header:
        called[TIME] = stamps, _STAMPS[stamps]
    called |= named
    if lacking := [name for name, _ in called.values() if name not in header]:
        raise InswsnError(_lacks(path, lacking, header))
    there = [name for name in dict.fromkeys(layout.names) if name in called]
    for name, _ in map(called.__getitem__, there):
        if header.count(name) > 1:
            raise InswsnError(f"{path} has the column {name} more than once.")
    if lacking := [name for name in layout.of(there) if name not in there]:
        raise InswsnError(_lacks(path, lacking, header))
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
            column, header.index(column), name in layout.texts, name in layout.gaps,
            (unit or "s") if name == TIME else "", units_of(name).get(unit, 1.0),
        )  # fmt: skip
    return found


def units_of(name: str) -> dict[str, float]:
    """Return the units that a column may have, and how many of the wanted unit each is."""
    return FACTORS.get(name.rpartition("_")[2], {})


def _lacks(path: Path, names: list[str], header: list[str]) -> str:
    return f"{path} has no column {', '.join(names)}; it has {', '.join(header)[:200]}."


def _stamps(path: Path, header: list[str]) -> str:
    """Return the column of time stamps: that in s, or else the one in another unit."""
    there = [name for name in header if name in _STAMPS]
    if TIME in there or not there:
        return TIME
    if len(there) > 1:
        raise InswsnError(f"{path} has the columns {', '.join(there)}; it must have one of them.")
    return there[0]
