"""A recording of one's own: a folder of CSV files, a stream each."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from inswsn_lib.checks import Array
from inswsn_lib.errors import InswsnError
from inswsn_lib.inertial import Earth
from inswsn_lib.logs.about import ABOUT, Source, read_about
from inswsn_lib.logs.blocks import block_starts
from inswsn_lib.logs.cells import UNITS
from inswsn_lib.logs.columns import TIME, Layout, read_table
from inswsn_lib.logs.files import Place, digests_of, files_of
from inswsn_lib.logs.rows import (
    check_clock,
    check_twins,
    places_of,
    reading,
    unit_quaternions,
)
from inswsn_lib.streams import Fixes, Imu, Odometry, Ranges, Recording, Reference

Table = dict[str, NDArray[Any]]

_X, _Z = ("x_m", "y_m"), ("z_m",)
#: The columns of a position; in a plane without the last
PLACE = (*_X, *_Z)
_V, _VZ = ("vx_mps", "vy_mps"), ("vz_mps",)
_SD, _SDZ = ("sd_x_m", "sd_y_m"), ("sd_z_m",)
_FORCE = ("force_x_mps2", "force_y_mps2", "force_z_mps2")
_RATE = ("rate_x_radps", "rate_y_radps", "rate_z_radps")
_GEODETIC, _UP = ("lat_deg", "lon_deg"), ("height_m",)
_ATTITUDE = ("qx", "qy", "qz", "qw")
#: Attributes of streams, and the columns that hold them
COLUMNS: dict[str, dict[str, tuple[str, ...]]] = {
    "imu": {"rate": _RATE, "force": _FORCE},
    "odometry": {"speed": ("speed_mps",), "rate": ("rate_radps",)},
    "ranges": {"anchor": ("anchor",), "distance": ("range_m",)},
    "fixes": {
        "position": PLACE,
        "velocity": (*_V, *_VZ),
        "deviation": (*_SD, *_SDZ),
        "good": ("good",),
    },
    "reference": {"position": PLACE, "attitude": _ATTITUDE},
}

ANCHORS = "anchors.csv"
#: The files, and the columns of each
LAYOUTS = {
    "imu.csv": Layout((TIME, *_RATE, *_FORCE)),
    "odometry.csv": Layout((TIME, "speed_mps", "rate_radps")),
    "ranges.csv": Layout((TIME, "anchor", "range_m"), texts=("anchor",)),
    ANCHORS: Layout(("anchor", *_X), (_Z,), texts=("anchor",)),
    "fixes.csv": Layout(
        (TIME, *_X),
        (_Z, _UP, _V, _VZ, _SD, _SDZ, ("good",)),
        gaps=(*_X, *_Z, *_GEODETIC, *_UP, *_V, *_VZ, *_SD, *_SDZ),
        instead={_X: _GEODETIC},
    ),
    "reference.csv": Layout((TIME, *_X), (_Z, _UP, _ATTITUDE), instead={_X: _GEODETIC}),
}
_FIRST = 2  # the row after the header
# Median size of a specific force: of one that may be in g, and above which it is in smaller units
_IN_G, _MOST_FORCE = (0.95, 1.05), 50.0
_MOST_RATE = 35.0  # rad/s: no gyroscope of a phone, a car or a hand goes so far
_SLOWEST = {"imu.csv": 1.0, "odometry.csv": 10.0}  # s, a period with which a motion is lost
_ROWS, _LONGER = 20, 1.5  # that tell a period, or a motion; by how much streams are longer, or less
# A degree is 1.1e5 m. Positions in degrees are farther from 0 than they go, by times; and what else
# tells of the motion tells of more, by times, as does their height, which is in m
_AWAY, _DEGREES, _UPWARDS, _PACE = 30.0, 2e4, 100.0, 2.0  # the last in s


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

    Raises
    ------
    InswsnError
        In one sentence that names the file, and the column and row (the header is row 1), if
        something is missing, is no number, does not increase, or looks like another unit, or if a
        clock was set while it was logged.

    Examples
    --------
    >>> from pathlib import Path
    >>> from tempfile import TemporaryDirectory
    >>> from inswsn_lib.logs.csv_folder import read_csv_folder
    >>> with TemporaryDirectory() as folder:
    ...     _ = Path(folder, "odometry.csv").write_text("time_s,speed_mps,rate_radps\n0,1,0\n")
    ...     read_csv_folder(folder).odometry.speed.tolist()
    [1.0]
    """
    files = files_of(place)
    about, sources = read_about(files[ABOUT], LAYOUTS) if ABOUT in files else ({}, {})
    used = {name: files[name] for name in (*LAYOUTS, ABOUT) if name in files}
    for name, source in sources.items():
        if source.file not in files:
            raise InswsnError(f"{files[ABOUT]}: there is no file {source.file} for {name}.")
        used[name] = files[source.file]
    if "ranges.csv" in used and ANCHORS not in used:
        raise InswsnError(f"{used['ranges.csv']} needs {ANCHORS} beside it; there is none.")
    tables = {
        name: _table(name, used[name], layout, sources.get(name))
        for name, layout in LAYOUTS.items()
        if name in used
    }
    _make_local(used, tables, about)
    spans = [float(np.ptp(tables[name][TIME])) for name in _SLOWEST if name in tables]
    for name, table in tables.items():
        if TIME in table:
            with reading(used[name]):
                _refuse_small_units(name, table[TIME], min(spans, default=0.0))
    streams: dict[str, Any] = {}
    for what, read in _READERS.items():
        if (name := f"{what}.csv") in tables:
            with reading(used[name]):
                streams[what] = read(tables[name], tables.get(ANCHORS, {}))
    for what in ("fixes", "reference"):
        if what in streams:
            with reading(used[f"{what}.csv"]):
                _refuse_degrees(what, streams)
    if not any(len(stream) for stream in streams.values()):
        where = next(iter(files.values())).parent if files else place
        raise InswsnError(
            f"{where} has no rows of a recording; it must have one of "
            f"{', '.join(f'{what}.csv' for what in _READERS)}."
        )
    name = str(about.pop("name", "") or next(iter(used.values())).absolute().parent.name)
    return Recording(name, **streams, **about, digests=digests_of(*used.values()))


def _make_local(used: dict[str, Path], tables: dict[str, Table], about: dict[str, Any]) -> None:
    """Put latitude and longitude into the frame of an origin, the first fix if none is given."""
    for name in ("fixes.csv", "reference.csv"):
        table = tables.get(name, {})
        if _GEODETIC[0] not in table:
            continue
        with reading(used[name]):
            place = np.column_stack([table.pop(column) for column in _GEODETIC])
            there = np.isfinite(place).all(axis=1)
            if (np.abs(place[there]) > (90, 360)).any():
                raise InswsnError(f"{', '.join(_GEODETIC)} are no latitude and longitude, degrees.")
            if not there.any():
                raise InswsnError(f"{', '.join(_GEODETIC)} are empty in all rows.")
            has_height = _UP[0] in table
            height = table.pop(_UP[0], np.zeros(len(place)))
            geodetic = np.column_stack([np.radians(place), height])
            if "origin" not in about:
                first = there & np.isfinite(height)
                good = first & (table["good"] == 1) if "good" in table else first
                about["origin"] = geodetic[int(np.argmax(good if good.any() else first))]
            if not has_height:
                geodetic[:, 2] = about["origin"][2]
            local = Earth(*about["origin"]).local(geodetic)
            table |= dict(zip(PLACE if has_height else _X, local.T, strict=False))


def _table(name: str, path: Path, layout: Layout, source: Source | None) -> Table:
    """Return the columns of a file; refuse no rows, times that do not increase, and twins."""
    with reading(path):
        table = read_table(path, layout, source.columns if source else {})
        if not len(next(iter(table.values()))):
            raise InswsnError(
                "it has a header and no rows; leave out a stream that was not logged."
            )
        if TIME in table:
            repeats = name == "ranges.csv"
            check_clock(f"in {TIME}", table[TIME], repeats=repeats, first=_FIRST)
        if name == ANCHORS:
            check_twins(table["anchor"].tolist())
    return table


def _refuse_small_units(name: str, time: Array, span: float) -> None:
    """Refuse time stamps that seem to be in a smaller unit than s.

    The motion would be sampled too rarely; another stream would last a thousand times as long.
    """
    period = float(np.median(np.diff(time))) if len(time) >= _ROWS else 0.0
    most = _SLOWEST.get(name, min(_SLOWEST.values()))
    if period < most:
        return
    units = [unit for unit, size in UNITS.items() if 10 * period < most * size] or ["ns"]
    if name not in _SLOWEST:
        longer = float(np.ptp(time)) / max(span, 1e-9)
        smaller = UNITS.items() - {("s", 1.0)}
        units = [unit for unit, n in smaller if 1 / _LONGER < longer / n < _LONGER]
    if units:
        unit = units[0]
        raise InswsnError(
            f"{TIME} has a median step of {period:.4g}; it seems to be in {unit}, of which the "
            f"column is time_{unit}, but must be in s."
        )


def _parts(what: str, table: Table) -> dict[str, NDArray[Any]]:
    """Return the attributes of a stream that the table has columns for."""
    found = {"time": table[TIME]}
    for attribute, names in COLUMNS[what].items():
        # what is put together is not kept in columns
        there = [table.pop(name) for name in names if name in table]
        if there:
            found[attribute] = np.column_stack(there) if len(names) > 1 else there[0]
    return found


def _imu(table: Table, _: Table) -> Imu:
    parts = _parts("imu", table)
    rate, force = parts["rate"], parts["force"]
    if max(rate.max(initial=0.0), -rate.min(initial=0.0)) > _MOST_RATE:
        largest = np.abs(rate).max(axis=1)
        row = int(np.argmax(largest > _MOST_RATE))
        raise InswsnError(
            f"the rate in columns {', '.join(_RATE)} is {largest[row]:.4g} in row {row + _FIRST}; "
            "it seems to be in degrees a second, but must be in rad/s."
        )
    usual = float(np.sqrt(np.median(np.einsum("kd,kd->k", force, force))))
    in_g = _IN_G[0] <= usual <= _IN_G[1]
    if in_g or usual > _MOST_FORCE:
        raise InswsnError(
            f"the force in columns {', '.join(_FORCE)} has a median size of {usual:.4g}; it seems "
            f"to be in {'g' if in_g else 'mg or cm/s^2'}, but must be in m/s^2."
        )
    return Imu(**parts)


def _ranges(table: Table, anchors: Table) -> Ranges:
    names = anchors["anchor"].tolist()
    return Ranges(
        time=table[TIME],
        anchor=places_of(table["anchor"].tolist(), names, first=_FIRST),
        distance=table["range_m"],
        anchors=np.column_stack([anchors[name] for name in PLACE if name in anchors]),
        names=tuple(names),
    )


def _fixes(table: Table, _: Table) -> Fixes:
    for names, needed in ((_VZ, _V), (_SDZ, _SD)):
        if names[0] in table and needed[0] not in table:
            raise InswsnError(f"it has {names[0]} without {', '.join(needed)}.")
    parts = _parts("fixes", table)
    if "good" in parts:
        wrong = ~np.isin(parts["good"], (0, 1))
        if wrong.any():
            row = int(np.argmax(wrong))
            raise InswsnError(
                f"{parts['good'][row]:g} is in column good, row {row + _FIRST}; it must be 0 or 1."
            )
        parts["good"] = parts["good"] == 1
    return Fixes(**parts)


def _reference(table: Table, _: Table) -> Reference:
    parts = _parts("reference", table)
    if "attitude" in parts:
        parts["attitude"] = unit_quaternions(parts["attitude"], first=_FIRST)
    return Reference(**parts)


def _refuse_degrees(what: str, streams: dict[str, Any]) -> None:
    """Refuse positions that seem to be latitude and longitude, by what else tells of the motion."""
    stream = streams[what]
    there = np.isfinite(stream.position).all(axis=1)
    time, place = stream.time[there], stream.position[there]
    if len(time) < _ROWS:
        return
    speed, change = _paces(time, place[:, :2])
    near, far = np.sort(np.abs(place[:, :2]).max(axis=0))
    reach = _AWAY * np.ptp(place[:, :2], axis=0).max()
    if not (near <= 90 and far <= 360 and reach < far and min(speed, change) > 0):
        return
    told = {}
    if place.shape[1] > 2 and np.ptp(place[:, 2]) > 0:
        told[PLACE[2]] = _paces(time, place[:, 2:])[1] / change
        if told[PLACE[2]] < _UPWARDS:
            return
    if "imu" in streams and len(streams["imu"]) >= _ROWS:
        imu = streams["imu"]
        starts = block_starts(imu.time, _PACE)
        means = np.add.reduceat(imu.force, starts) / np.diff(starts, append=len(imu))[:, None]
        told["the IMU"] = float(np.linalg.norm(means.std(axis=0))) / change
    if "odometry" in streams:
        told["the odometry"] = float(np.abs(streams["odometry"].speed).mean()) / speed
    if what == "fixes" and "reference" in streams and len(streams["reference"]) >= _ROWS:
        reference = streams["reference"]
        told["the reference"] = _paces(reference.time, reference.position)[0] / speed
    most = max(told, key=lambda by: told[by], default="")
    if told and told[most] > _DEGREES:
        raise InswsnError(
            f"the positions in columns {', '.join(_X)} seem to be latitude and longitude in "
            f"degrees, but must be in m: they go by {speed:.2g} a second, and {most} tells of "
            f"{told[most]:.0e} times as much."
        )


def _paces(time: Array, place: Array) -> tuple[float, float]:
    """Return mean sizes of velocity and acceleration, over some seconds."""
    rows = block_starts(time, _PACE)
    steps = np.diff(time[rows])[:, None]
    velocity = np.diff(place[rows], axis=0) / steps
    change = np.diff(velocity, axis=0) / (steps[1:] + steps[:-1]) * 2
    speed, pushed = (float(np.linalg.norm(x, axis=1).mean()) for x in (velocity, change))
    return speed, pushed


_READERS = {
    "imu": _imu,
    "odometry": lambda table, _: Odometry(**_parts("odometry", table)),
    "ranges": _ranges,
    "fixes": _fixes,
    "reference": _reference,
}
