"""A recording of one's own: a folder of CSV files, a stream each, and ``recording.yaml``."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import yaml

from inswsn_lib.checks import Array, array, number
from inswsn_lib.errors import InswsnError, ParameterError
from inswsn_lib.files import read_yaml
from inswsn_lib.inertial import Earth
from inswsn_lib.logs.blocks import block_starts
from inswsn_lib.logs.columns import (
    TIME,
    UNITS,
    Layout,
    Named,
    Table,
    check_clock,
    check_twins,
    places_of,
    read_table,
    reading,
    unit_quaternions,
    units_of,
)
from inswsn_lib.logs.files import Place, digests_of, files_of
from inswsn_lib.streams import Fixes, Imu, Odometry, Ranges, Recording, Reference

_X, _Z = ("x_m", "y_m"), ("z_m",)
#: The columns of a position; in a plane without the last
PLACE = (*_X, *_Z)
_V, _VZ = ("vx_mps", "vy_mps"), ("vz_mps",)
_SD, _SDZ = ("sd_x_m", "sd_y_m"), ("sd_z_m",)
_FORCE = ("force_x_mps2", "force_y_mps2", "force_z_mps2")
_RATE = ("rate_x_radps", "rate_y_radps", "rate_z_radps")
_GEODETIC, _UP = ("lat_deg", "lon_deg"), ("height_m",)
_INSTEAD = dict(zip(_X, _GEODETIC, strict=True))
_ATTITUDE = ("qx", "qy", "qz", "qw")
#: Attributes of streams, and the columns that hold them
COLUMNS: dict[str, dict[str, tuple[str, ...]]] = {
    "imu": {"rate": _RATE, "force": _FORCE},
    "odometry": {"speed": ("speed_mps",), "rate": ("rate_radps",)},
    "ranges": {"anchor": ("anchor",), "distance": ("range_m",)},
    "fixes": {
        "position": PLACE, "velocity": (*_V, *_VZ), "deviation": (*_SD, *_SDZ), "good": ("good",),
    },
    "reference": {"position": PLACE, "attitude": _ATTITUDE},
}  # fmt: skip
_STREAMS: dict[str, Any] = {
    "imu": Imu, "odometry": Odometry, "ranges": Ranges, "fixes": Fixes, "reference": Reference,
}  # fmt: skip

ANCHORS = "anchors.csv"
#: The files, and the columns of each
LAYOUTS = {
    "imu.csv": Layout((TIME, *_RATE, *_FORCE)),
    "odometry.csv": Layout((TIME, "speed_mps", "rate_radps")),
    "ranges.csv": Layout((TIME, "anchor", "range_m")),
    ANCHORS: Layout(("anchor", *_X), (_Z,)),
    "fixes.csv": Layout(
        (TIME, *_X),
        (_Z, _UP, _V, _VZ, _SD, _SDZ, ("good",)),
        gaps=(*_X, *_Z, *_GEODETIC, *_UP, *_V, *_VZ, *_SD, *_SDZ),
        instead=_INSTEAD,
    ),
    "reference.csv": Layout((TIME, *_X), (_Z, _UP, _ATTITUDE), instead=_INSTEAD),
}
#: What the folder says of the recording, and of how its files are to be read
ABOUT = "recording.yaml"
_WORDS = ("name", "licence", "source")
_HEIGHT = "height_m"
_VECTORS = {"lever_arm_m": "lever_arm", "origin_rad_m": "origin"}

_FIRST = 2  # the row after the header
# Median size of a specific force: of one that may be in g, and above which it is in smaller units
_IN_G, _MOST_FORCE = (0.95, 1.05), 50.0
#: rad/s: no gyroscope of a phone, a car or a hand goes so far
MOST_RATE = 35.0
# s: a period with which a motion is lost; by how much streams last longer than others, or less
_SLOWEST, _ALIKE = {"imu.csv": 1.0, "odometry.csv": 10.0}, 1.5
# A degree is 1.1e5 m. Positions in degrees are farther from 0 than they go, by times, and sensors
# tell of more motion, by times; there are rows enough, and seconds of a block
_AWAY, _DEGREES, _ROWS, _PACE = 30.0, 2e4, 20, 2.0


def read_csv_folder(place: Place) -> Recording:
    r"""Read a folder with any of the files of a recording.

    - ``imu.csv``: ``time_s``, ``rate_x_radps``, ``rate_y_radps``, ``rate_z_radps``,
      ``force_x_mps2``, ``force_y_mps2``, ``force_z_mps2``
    - ``odometry.csv``: ``time_s``, ``speed_mps``, ``rate_radps``
    - ``ranges.csv``: ``time_s``, ``anchor``, ``range_m``, and with it
      ``anchors.csv``: ``anchor``, ``x_m``, ``y_m``; ``z_m``
    - ``fixes.csv``: ``time_s``, ``x_m``, ``y_m``; ``z_m``; ``vx_mps``, ``vy_mps``; ``vz_mps``;
      ``sd_x_m``, ``sd_y_m``; ``sd_z_m``; ``good`` (0 or 1). Where there is no fix, cells are empty.
    - ``reference.csv``: ``time_s``, ``x_m``, ``y_m``; ``z_m``; ``qx``, ``qy``, ``qz``, ``qw``
    - ``recording.yaml``: ``name``, ``licence``, ``source``, ``lever_arm_m`` (x, y, z),
      ``origin_rad_m`` (latitude and longitude, rad, and height, m), ``height_m`` (of the tag, if
      it hardly changes), each of them optional; and how files are to be read that are written
      otherwise, of each column its name, or name and unit:
      ``imu.csv: {file: log.csv, time_s: [Stamp, ms], rate_x_radps: [gx, deg/s], ...}``

    What stands after a semicolon may be left out; other columns are ignored. Header, comments,
    separators, decimal signs and time stamps may be as in `read_recording`. In ``fixes.csv`` and
    ``reference.csv`` there may be ``lat_deg``, ``lon_deg``; ``height_m`` in the place of ``x_m``,
    ``y_m``; ``z_m``: positions are then east, north and up of ``origin_rad_m``, or else of the
    first fix, the first good one if some are.

    Raises `InswsnError` in one sentence that names the file, and the column and row (the header is
    row 1), if something is missing, is no number, does not increase, or looks like another unit, or
    if a clock was set while it was logged.
    """
    files = files_of(place)
    about, sources = _read_about(files[ABOUT]) if ABOUT in files else ({}, {})
    used = {name: files[name] for name in (*LAYOUTS, ABOUT) if name in files}
    for name, (file, _) in sources.items():
        if file not in files:
            raise InswsnError(f"{files[ABOUT]}: there is no file {file} for {name}.")
        used[name] = files[file]
    if "ranges.csv" in used and ANCHORS not in used:
        raise InswsnError(f"{used['ranges.csv']} needs {ANCHORS} beside it; there is none.")
    tables: dict[str, Table] = {}
    for name in LAYOUTS:
        if name in used:
            with reading(used[name]):
                tables[name] = _table(name, used[name], sources.get(name, ("", {}))[1], about)
    spans = [float(np.ptp(tables[name][TIME])) for name in _SLOWEST if name in tables]
    streams: dict[str, Any] = {}
    for what in _STREAMS:
        if (name := f"{what}.csv") in tables:
            with reading(used[name]):
                _refuse_small_units(name, tables[name][TIME], min(spans, default=0.0))
                streams[what] = _stream(what, tables[name], tables.get(ANCHORS, {}))
                if what in ("fixes", "reference"):
                    _refuse_degrees(streams[what], streams.get("imu"), streams.get("odometry"))
    if not streams:
        where = next(iter(files.values())).parent if files else place
        raise InswsnError(
            f"{where} has no rows of a recording; it must have one of "
            f"{', '.join(f'{what}.csv' for what in _STREAMS)}."
        )
    name = str(about.pop("name", "") or next(iter(used.values())).absolute().parent.name)
    return Recording(name, **streams, **about, digests=digests_of(*used.values()))


def _table(name: str, path: Path, named: Named, about: dict[str, Any]) -> Table:
    """Return the columns of a file; refuse one without rows, and clocks that were set."""
    table = read_table(path, LAYOUTS[name], named)
    if not len(next(iter(table.values()))):
        raise InswsnError("it has a header and no rows; leave out a stream that was not logged.")
    if name == ANCHORS:
        check_twins(table["anchor"].tolist())
    else:
        check_clock(f"in {TIME}", table[TIME], repeats=name == "ranges.csv", first=_FIRST)
    if _GEODETIC[0] in table:
        _make_local(table, about)
    return table


def _make_local(table: Table, about: dict[str, Any]) -> None:
    """Put latitude and longitude into the frame of an origin, the first fix if none is given."""
    place = np.column_stack([table.pop(column) for column in _GEODETIC])
    there = np.isfinite(place).all(axis=1)
    if (np.abs(place[there]) > (90, 360)).any():
        raise InswsnError(f"{', '.join(_GEODETIC)} are no latitude and longitude, degrees.")
    if not there.any():
        raise InswsnError(f"{', '.join(_GEODETIC)} are empty in all rows.")
    columns = PLACE if _UP[0] in table else _X
    height = table.pop(_UP[0], np.zeros(len(place)))
    geodetic = np.column_stack([np.radians(place), height])
    if "origin" not in about:
        first = there & np.isfinite(height)
        good = first & (table["good"] == 1) if "good" in table else first
        about["origin"] = geodetic[int(np.argmax(good if good.any() else first))]
    if columns == _X:
        geodetic[:, 2] = about["origin"][2]
    table |= dict(zip(columns, Earth(*about["origin"]).local(geodetic).T, strict=False))


def time_unit(name: str, time: Array, span: float = 0.0) -> str:
    """Return the unit of the time stamps of a stream, ``""`` if nothing tells it.

    The motion would be sampled too rarely, or another stream lasts as long (`span`, s).
    """
    steps = np.diff(time)[np.diff(time) > 0]
    period = float(np.median(steps)) if steps.size else 0.0
    slowest = _SLOWEST.get(name, min(_SLOWEST.values()))
    if period < slowest:
        return "s"
    for unit, size in UNITS.items():
        if 1 / _ALIKE < float(np.ptp(time)) / size / max(span, 1e-9) < _ALIKE:
            return unit
    likely = [unit for unit, size in UNITS.items() if 3 * period / size < slowest]
    return next(iter(likely), "ns") if name in _SLOWEST else ""


def _refuse_small_units(name: str, time: Array, span: float) -> None:
    unit = time_unit(name, time, 0.0 if name in _SLOWEST else span)
    if len(time) >= _ROWS and unit not in ("s", ""):
        raise InswsnError(
            f"{TIME} has a median step of {np.median(np.diff(time)):.4g}; it seems to be in "
            f"{unit}, of which the column is time_{unit}, but must be in s."
        )


def _stream(what: str, table: Table, anchors: Table) -> Any:
    """Return a stream of the columns of a table; refuse other units, and what does not fit."""
    for (name,), needed in ((_VZ, _V), (_SDZ, _SD)):
        if name in table and needed[0] not in table:
            raise InswsnError(f"it has {name} without {', '.join(needed)}.")
    parts: dict[str, Any] = {"time": table[TIME]}
    for attribute, names in COLUMNS[what].items():
        # what is put together is not kept in columns
        if there := [table.pop(name) for name in names if name in table]:
            parts[attribute] = np.column_stack(there) if len(names) > 1 else there[0]
    if what == "imu":
        _refuse_other_units(parts["rate"], parts["force"])
    if what == "ranges":
        known = tuple(anchors["anchor"].tolist())
        parts["anchor"] = places_of(parts["anchor"].tolist(), known, first=_FIRST)
        parts["anchors"] = np.column_stack([anchors[name] for name in PLACE if name in anchors])
        parts["names"] = known
    if "good" in parts:
        for row in np.flatnonzero(~np.isin(parts["good"], (0, 1))).tolist():
            raise InswsnError(
                f"{parts['good'][row]:g} is in column good, row {row + _FIRST}; it must be 0 or 1."
            )
        parts["good"] = parts["good"] == 1
    if "attitude" in parts:
        parts["attitude"] = unit_quaternions(parts["attitude"], first=_FIRST)
    return _STREAMS[what](**parts)


def _refuse_other_units(rate: Array, force: Array) -> None:
    """Refuse rates that seem to be in degrees, and forces in g and the like."""
    largest = max(rate.max(), -rate.min())
    if largest > MOST_RATE:
        row = int(np.argmax((np.abs(rate) > MOST_RATE).any(axis=1)))
        raise InswsnError(
            f"the rate in columns {', '.join(_RATE)} is {np.abs(rate[row]).max():.4g} in row "
            f"{row + _FIRST}; it seems to be in degrees a second, but must be in rad/s."
        )
    usual = float(np.sqrt(np.median(np.einsum("kd,kd->k", force, force))))
    in_g = _IN_G[0] <= usual <= _IN_G[1]
    if in_g or usual > _MOST_FORCE:
        raise InswsnError(
            f"the force in columns {', '.join(_FORCE)} has a median size of {usual:.4g}; it seems "
            f"to be in {'g' if in_g else 'mg or cm/s^2'}, but must be in m/s^2."
        )


def _refuse_degrees(stream: Any, imu: Imu | None, odometry: Odometry | None) -> None:
    """Refuse positions that seem to be latitude and longitude, by what sensors tell of motion."""
    there = np.isfinite(stream.position).all(axis=1)
    time, place = stream.time[there], stream.position[there, :2]
    if len(time) < _ROWS:
        return
    rows = block_starts(time, _PACE)
    steps = np.diff(time[rows])[:, None]
    velocity = np.diff(place[rows], axis=0) / steps
    change = np.diff(velocity, axis=0) / (steps[1:] + steps[:-1]) * 2
    speed, pushed = (float(np.linalg.norm(x, axis=1).mean()) for x in (velocity, change))
    near, far = np.sort(np.abs(place).max(axis=0))
    if near > 90 or not _AWAY * np.ptp(place, axis=0).max() < far <= 360 or speed * pushed == 0:
        return
    told = {}
    if imu is not None and len(imu) >= _ROWS:
        starts = block_starts(imu.time, _PACE)
        means = np.add.reduceat(imu.force, starts) / np.diff(starts, append=len(imu))[:, None]
        told["the IMU"] = float(np.linalg.norm(means.std(axis=0))) / pushed
    if odometry is not None:
        told["the odometry"] = float(np.abs(odometry.speed).mean()) / speed
    most = max(told, key=lambda by: told[by], default="")
    if told and told[most] > _DEGREES:
        raise InswsnError(
            f"the positions in columns {', '.join(_X)} seem to be latitude and longitude in "
            f"degrees, but must be in m: they go by {speed:.2g} a second, and {most} tells of "
            f"{told[most]:.0e} times as much."
        )


# --- recording.yaml ---


def _read_about(path: Path) -> tuple[dict[str, Any], dict[str, tuple[str, Named]]]:
    """Return what it says: attributes of a recording, and files of streams with their columns."""
    about: dict[str, Any] = {}
    sources = {}
    with reading(path):
        said = read_yaml(path)
        if not isinstance(said, dict | None):
            raise InswsnError("it is not a mapping; it must have lines such as 'name: my walk'.")
        for key, value in (said or {}).items():
            if key in LAYOUTS:
                sources[key] = _source(key, value)
            elif key in _VECTORS:
                about[_VECTORS[key]] = array(key, value, (3,))
            elif key == _HEIGHT:
                about["height"] = number(key, value)
            elif key not in _WORDS:
                known = ", ".join((*_WORDS, *_VECTORS, _HEIGHT, *LAYOUTS))
                raise InswsnError(f"the key {key!r} is not known; it must be one of {known}.")
            elif not isinstance(value, str):
                raise ParameterError(key, value, "text")
            else:
                about[key] = value
    return about, sources


def _source(name: str, value: Any) -> tuple[str, Named]:
    """Return where a stream is: of its file, and of each column the name, or name and unit."""
    if not isinstance(value, dict):
        raise ParameterError(name, value, "a mapping such as {time_s: [Timestamp, ms]}")
    file, columns = str(value.get("file", name)), {}
    for column, said in value.items():
        if column == "file":
            continue
        if column not in LAYOUTS[name].names:
            known = ", ".join(LAYOUTS[name].names)
            raise ParameterError(name, column, f"of columns {known}, or file")
        match said:
            case str(called) | [str(called)]:
                columns[column] = called, ""
            case [str(called), str(unit)]:
                if unit not in units_of(column):
                    known = ", ".join(units_of(column)) or "left out"
                    raise ParameterError(f"{name}: the unit of {column}", unit, f"one of {known}")
                columns[column] = called, unit
            case _:
                raise ParameterError(f"{name}: {column}", said, "a name, or [name, unit]")
    return file, columns


def quoted(word: str) -> str:
    """Return a text within quotes, where it is never taken for a number."""
    return str(yaml.safe_dump(word, default_style='"', allow_unicode=True, width=10**6)).strip()


# --- what is written ---


def write_csv(recording: Recording, folder: str | Path) -> None:
    """Write a recording as a folder that `load` reads as the kind ``csv``.

    Numbers are read again to the last bit.

    Parameters
    ----------
    recording : Recording
    folder : str or Path
        Made if it is not there.

    Raises
    ------
    InswsnError
        If a file is there already or cannot be written.

    Examples
    --------
    >>> from tempfile import TemporaryDirectory
    >>> from inswsn_lib import logs, streams
    >>> walk = streams.Odometry(time=[0.0, 1.0, 2.0], speed=[1.0, 1.0, 1.0], rate=[0.0, 0.0, 0.0])
    >>> with TemporaryDirectory() as folder:
    ...     logs.write_csv(streams.Recording("walk", odometry=walk), folder)
    ...     logs.load("csv", folder).span
    (0.0, 2.0)
    """
    folder = Path(folder)
    tables: dict[str, dict[str, Any]] = {}
    for what, stream in recording.streams.items():
        table = tables[f"{what}.csv"] = {TIME: stream.time}
        for attribute, columns in COLUMNS[what].items():
            if (value := getattr(stream, attribute)) is not None:
                # bools become 0 and 1; in a plane there are fewer columns
                table |= dict(zip(columns, np.atleast_2d(np.transpose(value) * 1), strict=False))
    if (ranges := recording.ranges) is not None:
        tables["ranges.csv"]["anchor"] = np.array(ranges.names, dtype=object)[ranges.anchor]
        places = dict(zip(PLACE, ranges.anchors.T, strict=False))
        tables[ANCHORS] = {"anchor": [*ranges.names], **places}
    if taken := [name for name in (*LAYOUTS, ABOUT) if (folder / name).exists()]:
        raise InswsnError(f"{folder} has {', '.join(taken)} already; it must be a new folder.")
    lines = [f"{key}: {quoted(word)}" for key in _WORDS if (word := getattr(recording, key))]
    for key, attribute in _VECTORS.items():
        if (vector := getattr(recording, attribute)) is not None:
            lines.append(f"{key}: {vector.tolist()!r}")
    if recording.height is not None:
        lines.append(f"{_HEIGHT}: {recording.height!r}")
    try:
        folder.mkdir(parents=True, exist_ok=True)
        for name, table in tables.items():
            pd.DataFrame(table).to_csv(folder / name, index=False, lineterminator="\n")
        (folder / ABOUT).write_text("\n".join([*lines, ""]), encoding="utf-8", newline="\n")
    except OSError as error:
        raise InswsnError(f"{folder} cannot be written to: {error.strerror}.") from None
