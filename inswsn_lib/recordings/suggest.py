"""What a folder of logs seems to hold, in words, and a ``recording.yaml`` to edit."""

from __future__ import annotations

import csv
import os
import re
from contextlib import suppress
from pathlib import Path
from tempfile import NamedTemporaryFile
from typing import NamedTuple

import numpy as np

from inswsn_lib.checks import Array
from inswsn_lib.errors import InswsnError
from inswsn_lib.files import read_pieces
from inswsn_lib.recordings.about import ABOUT, quoted
from inswsn_lib.recordings.cells import UNITS, Column, Sheet, parse
from inswsn_lib.recordings.columns import TIME, opened, units_of
from inswsn_lib.recordings.csv_folder import ANCHORS, LAYOUTS
from inswsn_lib.recordings.files import files_of

_KINDS = (".csv", ".txt", ".log", ".tsv", ".dat")
_AXES = {"x": "(x|east|e)", "y": "(y|north|n)", "z": "(z|up|u)"}
# What columns may be called: in small letters, with single underscores, without units
_NAMED = {
    "lat_deg": "lat(itude)?", "lon_deg": "lon(g|gitude)?", "height_m": "height|alt(itude)?",
    "speed_mps": "speed|velocity|odometer", "rate_radps": "(yaw_?)?rate|omega|gyro_?z",
    "range_m": "range|dist(ance)?", "anchor": "(anchor|node|beacon|responder)(_?id)?|id",
    "good": "good|valid", **{f"q{k}": f"q(uat(ernion)?)?_?{k}" for k in "xyzw"},
}  # fmt: skip
for _name, _called in {
    "rate_{}_radps": "(rate|gyro?(scope)?|w|omega|ang(ular)?_?(rate|vel(ocity)?))_?",
    "force_{}_mps2": "((specific_?)?force|(linear_?)?acc(el(eration|erometer)?)?|a)_?",
    "{}_m": "((pos(ition)?|p|loc(ation)?)_?)?",
    "v{}_mps": "(v|vel(ocity)?|speed)_?",
    "sd_{}_m": "(sd|std|sigma)_?",
}.items():
    _NAMED |= {_name.format(axis): _called + letters for axis, letters in _AXES.items()}
_TIMES = "t|time|(time_?)?stamp|timestamp|seconds(_elapsed)?|epoch|utc|tow"
# Units as they stand in names of columns
_WRITTEN = {
    "ms": "ms|msec|millis", "us": "us|µs|usec|micros", "ns": "ns|nanos", "s": "s|sec",
    "deg/s": "deg/s|dps|deg_s|°/s|degps", "rad/s": "rad/s|radps|rad_s", "mg": "mg", "g": "g",
    "m/s^2": r"m/s\^?2|mps2|m/s²", "m/s": "m/s|mps|m_s", "km/h": "km/h|kmh", "cm": "cm",
    "mm": "mm", "m": "m", "deg": "deg|°", "rad": "rad",
}  # fmt: skip
_REFERENCE = re.compile(r"ref|truth|mocap|vicon|optitrack|gt", re.I)
_LONGEST = {"imu.csv": 0.5, "odometry.csv": 2.0}  # s, of likely periods; of other streams:
_LONG, _ALIKE = 20.0, 1.5  # s, and by how much streams last longer than others, or less
_FASTEST = 35.0  # rad/s
_SIZES = {"m/s^2": (8.5, 11.0), "g": (0.85, 1.15), "mg": (850.0, 1150.0)}  # of gravity


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
        Lines: of each file which stream it seems to be, its columns and units; and what is missing.

    Raises
    ------
    InswsnError
        If there is no such folder, or nothing can be written there.

    Examples
    --------
    >>> from pathlib import Path
    >>> from tempfile import TemporaryDirectory
    >>> from inswsn_lib import recordings
    >>> rows = "".join(f"{20 * k},1.5,90\n" for k in range(50))
    >>> with TemporaryDirectory() as folder:
    ...     _ = Path(folder, "car.csv").write_text("Stamp (ms),speed,yaw rate (deg/s)\n" + rows)
    ...     print(recordings.suggest(folder).partition(", speed")[0])
    ...     car = recordings.load("csv", folder)
    car.csv seems to be odometry: time_s is 'Stamp (ms)' in ms
    >>> car.odometry.time[-1].item(), car.odometry.rate[0].round(4).item()
    (0.98, 1.5708)
    """
    logs, said = [], []
    for name, path in files_of(folder).items():
        if name.lower().endswith(_KINDS):
            try:
                logs.append(_log(path))
            except (InswsnError, csv.Error, UnicodeDecodeError) as error:
                said.append(f"{name} is left out: {error}")
    sources: dict[str, tuple[_Log, dict[str, str]]] = {}
    for log in logs:
        streams = {what: c for what, c in _streams(log).items() if what not in sources}
        sources |= {what: (log, columns) for what, columns in streams.items()}
        if not streams:
            said.append(f"{log.name} is left out: its columns {', '.join(log.header)[:200]} are "
                        "those of no stream, or of one that another file has.")  # fmt: skip
    spans = [float(np.ptp(log.values[c[TIME]])) / UNITS[_unit("imu.csv", TIME, c[TIME], log)[0]]
             for what, (log, c) in sources.items() if what == "imu.csv"]  # fmt: skip
    lines = []
    for what, (log, columns) in sources.items():
        units = {c: _unit(what, c, called, log, *spans) for c, called in columns.items()}
        parts = [
            f"{c} is {called!r}{f' in {unit}' if unit else ''}{' (assumed)' * assumed}"
            for (c, called), (unit, assumed) in zip(columns.items(), units.values(), strict=True)
        ]
        said.append(f"{log.name} seems to be {what.removesuffix('.csv')}: {', '.join(parts)}.")
        lines += [f"{what}:", f"  file: {quoted(log.name)}"] + [
            f"  {c}: [{quoted(called)}, {units[c][0]}]"
            if units[c][0]
            else f"  {c}: {quoted(called)}"
            for c, called in columns.items()
        ]
    return "\n".join([*said, *_missing(set(sources)), _write(Path(folder), lines)])


def _log(path: Path) -> _Log:
    """Return what the first megabytes of a file tell of its columns."""
    known = {TIME, *(name for layout in LAYOUTS.values() for name in layout.names)}
    separator, header, blocks = opened(read_pieces(path), known)
    if len(header) < 2 or len(set(header)) < len(header):
        raise InswsnError("it has no header, or one column twice.")
    block = next(blocks, b"")
    values: dict[str, Array] = {}
    for place, name in enumerate(header):
        # stamps may be dates, or too large for seconds
        for unit in ("s", "ns") if re.fullmatch(_TIMES, _plain(name)[0]) else ("",):
            column = Column(name, place, gaps=True, unit=unit)
            with suppress(InswsnError):
                [found] = parse(Sheet(path, separator, len(header), (column,)), [block])
                if np.isfinite(found).any():
                    values.setdefault(name, found * UNITS.get(unit, 1.0))
    stamps = [
        name for name in values
        if re.fullmatch(_TIMES, _plain(name)[0]) and (np.diff(values[name]) >= 0).all()
    ]  # fmt: skip
    return _Log(path.name, header, values, stamps[0] if stamps else "")


def _plain(name: str) -> tuple[str, str]:
    """Return a column's name in small letters without its unit, and the unit."""
    text = re.sub(r"[\s.-]+", "_", name.strip().lower())
    for unit, written in _WRITTEN.items():
        if match := re.search(rf"_?[\[(]({written})[\])]$|_({written})$", text):
            return text[: match.start()], unit
    return text, ""


def _streams(log: _Log) -> dict[str, dict[str, str]]:
    """Return the streams in a file, and what their columns are called there."""
    found = {}
    for what, layout in LAYOUTS.items():
        columns: dict[str, str] = {}
        for column in layout.names:
            for name in log.header:
                number = column not in layout.texts
                if (number and name not in log.values) or name in columns.values():
                    continue
                fits = _NAMED.get(column, column)
                if name == log.time if column == TIME else re.fullmatch(fits, _plain(name)[0]):
                    columns.setdefault(column, name)
        for group in (*layout.groups, *layout.instead.values()):
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


def _unit(what: str, column: str, called: str, log: _Log, *spans: float) -> tuple[str, bool]:
    """Return the unit of a column, and whether it is assumed without a reason."""
    known, said = units_of(column), _plain(called)[1]
    if not known or said in known:
        return said if known else "", False
    values = log.values[called][np.isfinite(log.values[called])]
    if column == TIME:
        return _time_unit(what, values, *spans), False
    if column.endswith("_deg"):
        return "deg", True
    if column.endswith("radps") and np.abs(values).max() > _FASTEST:
        return "deg/s", False
    if column.startswith("force"):
        axes = [name for name in log.header if re.fullmatch(
            f"({_NAMED['force_x_mps2']})|({_NAMED['force_y_mps2']})|({_NAMED['force_z_mps2']})",
            _plain(name)[0])]  # fmt: skip
        size = float(np.nanmedian(np.linalg.norm([log.values[name] for name in axes], axis=0)))
        for unit, (low, high) in _SIZES.items():
            if low < size < high:
                return unit, False
    return next(iter(known)), True


def _time_unit(what: str, time: Array, *spans: float) -> str:
    """Return the unit with which a stream lasts as long as another, or has a likely period."""
    units = [unit for unit, size in UNITS.items() if np.abs(time).max() < 1e11 * size]
    step = (
        float(
            np.median(
                np.diff(time)[np.diff(time) > 0],
            )
        )
        if np.ptp(time) > 0
        else 0.0
    )
    for span in spans:
        for unit in units:
            if 1 / _ALIKE < np.ptp(time) / UNITS[unit] / max(span, 1e-9) < _ALIKE:
                return unit
    likely = [unit for unit in units if step / UNITS[unit] <= _LONGEST.get(what, _LONG)]
    return (likely or units)[0]


def _missing(there: set[str]) -> list[str]:
    wanted = {
        "Nothing tells the motion": ("imu.csv", "odometry.csv"),
        "There is no network": ("fixes.csv", "ranges.csv"),
        "There is no reference: errors cannot be told but by withheld fixes": ("reference.csv",),
    }
    said = [
        f"{words}; missing: {' or '.join(name.removesuffix('.csv') for name in names)}."
        for words, names in wanted.items() if not set(names) & there
    ]  # fmt: skip
    if "ranges.csv" in there and ANCHORS not in there:
        said.append(f"Where the anchors are is missing: write {ANCHORS} (anchor, x_m, y_m, z_m).")
    return said


def _write(folder: Path, lines: list[str]) -> str:
    """Write the file as a whole, or not at all, and say so."""
    path = folder / ABOUT
    if not lines:
        return f"Nothing is written: no file in {folder} is known to be a stream."
    text = "\n".join(["# Suggested by inswsn: check columns and units",
                      "lever_arm_m: [0, 0, 0]  # from the IMU to the antenna or tag, x, y, z",
                      *lines, ""])  # fmt: skip
    try:
        with NamedTemporaryFile(
            "w", dir=folder, suffix=".new", delete=False, encoding="utf-8"
        ) as f:
            f.write(text)
        try:
            os.link(f.name, path)  # which never writes over a file
        finally:
            Path(f.name).unlink()
    except FileExistsError:
        return f"{path} is there already, and left as it is. It would be:\n{text}"
    except OSError as error:
        raise InswsnError(f"{path} cannot be written: {error.strerror}.") from None
    return f"{path} is written; check it, then read the folder as the kind csv."
