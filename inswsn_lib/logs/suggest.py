"""What a folder of logs seems to hold, in words, and a ``recording.yaml`` to edit."""

from __future__ import annotations

import csv
import re
from contextlib import suppress
from pathlib import Path
from typing import NamedTuple

import numpy as np

from inswsn_lib.checks import Array
from inswsn_lib.errors import InswsnError
from inswsn_lib.files import read_pieces, read_yaml
from inswsn_lib.logs.columns import ANCHOR, TIME, UNITS, Column, opened, parse, units_of
from inswsn_lib.logs.csv_folder import ABOUT, ANCHORS, LAYOUTS, MOST_RATE, quoted, time_unit
from inswsn_lib.logs.files import files_of

_KINDS = (".csv", ".txt", ".log", ".tsv", ".dat")
_WORDS = read_yaml(Path(__file__).with_name("words.yaml"))
# What columns may be called: in small letters, with single underscores, without units
_NAMED: dict[str, str] = _WORDS["names"] | {
    name.format(axis): called + letters
    for name, called in _WORDS["along"].items()
    for axis, letters in _WORDS["axes"].items()
}
_FORCES = "|".join(f"({_NAMED[f'force_{axis}_mps2']})" for axis in "xyz")
_REFERENCE = re.compile(r"ref|truth|mocap|vicon|optitrack|gt", re.I)
_LONG = 20.0  # s, the longest likely period of a stream
_GRAVITY = 8.5, 11.0  # m/s^2, median sizes of a specific force that tell its unit


class _Log(NamedTuple):
    name: str
    header: list[str]
    values: dict[str, Array]  # of columns of numbers, or dates
    time: str  # the column of time stamps, or nothing


def suggest(folder: str | Path) -> str:
    r"""Say what a folder of logs seems to hold, and write a ``recording.yaml`` to edit.

    Columns are known by their names, units by the names or else by the numbers: a median step of
    20 is no period of an IMU in s, and a specific force of the size 1 is in g. By that file `load`
    reads the folder as the kind ``csv``. One that is there is left as it is.

    Parameters
    ----------
    folder : str or Path
        With text files of columns under a header.

    Returns
    -------
    str
        Of each file which stream it seems to be, its columns and units; and what is missing.

    Raises
    ------
    InswsnError
        If there is no such folder, or nothing can be written there.

    Examples
    --------
    >>> from pathlib import Path
    >>> from tempfile import TemporaryDirectory
    >>> from inswsn_lib import logs
    >>> rows = "".join(f"{20 * k},1.5,90\n" for k in range(50))
    >>> with TemporaryDirectory() as folder:
    ...     _ = Path(folder, "car.csv").write_text("Stamp (ms),speed,yaw rate (deg/s)\n" + rows)
    ...     print(logs.suggest(folder).partition(", speed")[0])
    ...     car = logs.load("csv", folder)
    car.csv seems to be odometry: time_s is 'Stamp (ms)' in ms
    >>> car.odometry.time[-1].item(), car.odometry.rate[0].round(4).item()
    (0.98, 1.5708)
    """
    said: list[str] = []
    sources: dict[str, tuple[_Log, dict[str, str]]] = {}
    for name, path in files_of(folder).items():
        if not name.lower().endswith(_KINDS):
            continue
        try:
            log = _log(path)
        except (InswsnError, csv.Error, UnicodeDecodeError) as error:
            said.append(f"{name} is left out: {error}")
            continue
        streams = {what: (log, c) for what, c in _streams(log).items() if what not in sources}
        sources |= streams
        if not streams:
            said.append(f"{name} is left out: its columns {', '.join(log.header)[:200]} are "
                        "those of no stream, or of one that another file has.")  # fmt: skip
    span, lines = 0.0, []
    for what, (log, columns) in sources.items():
        parts = []
        lines += [f"{what}:", f"  file: {quoted(log.name)}"]
        for column, called in columns.items():
            unit, assumed = _unit(what, column, called, log, span)
            if column == TIME:
                span = span or float(np.ptp(log.values[called])) / UNITS[unit]
            lines.append(f"  {column}: [{quoted(called)}{unit and f', {unit}'}]")
            parts.append(f"{column} is {called!r}{unit and f' in {unit}'}{' (assumed)' * assumed}")
        said.append(f"{log.name} seems to be {what.removesuffix('.csv')}: {', '.join(parts)}.")
    there = {what.removesuffix(".csv") for what in sources}
    for words, names in _WORDS["missing"].items():
        if not there & set(names):
            said.append(f"{words}; missing: {' or '.join(names)}.")
    if "ranges" in there and "anchors" not in there:
        said.append(f"Where the anchors are is missing: write {ANCHORS} (anchor, x_m, y_m, z_m).")
    return "\n".join([*said, _write(Path(folder), lines)])


def _log(path: Path) -> _Log:
    """Return what the first megabytes of a file tell of its columns."""
    known = {TIME, *(name for layout in LAYOUTS.values() for name in layout.names)}
    separator, header, blocks = opened(read_pieces(path), known)
    if len(header) < 2 or len(set(header)) < len(header):
        raise InswsnError("it has no header, or one column twice.")
    block: list[str] = next(blocks, [])
    values: dict[str, Array] = {}
    for name in header:
        # stamps may be dates, or too large for seconds
        for unit in ("s", "ns") if _fits(TIME, name) else ("",):
            column = Column(name, unit=unit, size=UNITS.get(unit, 1.0))
            with suppress(InswsnError):
                [found] = parse(path, [column], separator, header, [block])
                if np.isfinite(found).any():
                    values.setdefault(name, found * column.size)
    stamps = (n for n in values if _fits(TIME, n) and (np.diff(values[n]) >= 0).all())
    return _Log(path.name, header, values, next(stamps, ""))


def _plain(name: str) -> tuple[str, str]:
    """Return a column's name in small letters without its unit, and the unit."""
    text = re.sub(r"[\s.-]+", "_", name.strip().lower())
    for unit, written in _WORDS["units"].items():
        if match := re.search(rf"_?[\[(]({written})[\])]$|_({written})$", text):
            return text[: match.start()], unit
    return text, ""


def _fits(column: str, name: str) -> bool:
    return bool(re.fullmatch(_NAMED.get(column, column), _plain(name)[0]))


def _streams(log: _Log) -> dict[str, dict[str, str]]:
    """Return the streams in a file, and what their columns are called there."""
    found = {}
    for what, layout in LAYOUTS.items():
        columns: dict[str, str] = {}
        for column in layout.names:
            for name in log.header:
                number = column != ANCHOR
                if (number and name not in log.values) or name in columns.values():
                    continue
                if name == log.time if column == TIME else _fits(column, name):
                    columns.setdefault(column, name)
        for group in (*layout.groups, (*layout.instead.values(),)):
            if not set(group) <= set(columns):
                columns = {c: called for c, called in columns.items() if c not in group}
        if set(layout.of([*columns])) <= set(columns):
            found[what] = columns
    positions = {"fixes.csv", "reference.csv"} & set(found)
    true = _REFERENCE.search(log.name) or "qx" in found.get("reference.csv", {})
    for what in positions - {"reference.csv" if true else "fixes.csv"}:
        del found[what]
    if positions:
        found.pop(ANCHORS, None)
    return found


def _unit(what: str, column: str, called: str, log: _Log, span: float) -> tuple[str, bool]:
    """Return the unit of a column, and whether it is assumed without a reason."""
    known, said = units_of(column), _plain(called)[1]
    if not known or said in known:
        return said if known else "", False
    values = log.values[called][np.isfinite(log.values[called])]
    if column == TIME:
        if told := time_unit(what, values, span):
            return told, False
        period = np.median(np.diff(values))
        return next((unit for unit in known if period / known[unit] <= _LONG), "ns"), False
    if column.endswith("radps") and np.abs(values).max() > MOST_RATE:
        return "deg/s", False
    if column.startswith("force"):
        axes = [name for name in log.header if re.fullmatch(_FORCES, _plain(name)[0])]
        force = float(np.nanmedian(np.linalg.norm([log.values[name] for name in axes], axis=0)))
        for unit, size in known.items():
            if _GRAVITY[0] < force / size < _GRAVITY[1]:
                return unit, False
    return next(iter(known)), True


def _write(folder: Path, lines: list[str]) -> str:
    path = folder / ABOUT
    if not lines:
        return f"Nothing is written: no file in {folder} is known to be a stream."
    text = "\n".join(["# Suggested by inswsn: check columns and units",
                      "lever_arm_m: [0, 0, 0]  # from the IMU to the antenna or tag, x, y, z",
                      *lines, ""])  # fmt: skip
    try:
        with path.open("x", encoding="utf-8") as file:
            file.write(text)
    except FileExistsError:
        return f"{path} is there already, and left as it is. It would be:\n{text}"
    except OSError as error:
        raise InswsnError(f"{path} cannot be written: {error.strerror}.") from None
    return f"{path} is written; check it, then read the folder as the kind csv."
