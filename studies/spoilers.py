"""What can go wrong with a recording's files: changes of a folder of CSV files, of random sizes.

Each changes one file as a log or its reader would spoil it, and knows by which name
`inswsn_lib.logs.check_set_up` should call that.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd
import yaml

from inswsn_lib.checks import Array
from inswsn_lib.logs.csv_folder import COLUMNS
from inswsn_lib.logs.likeness import signed_permutations

Random = np.random.Generator
Change = Callable[[Path, float, Random], None]
Sizes = tuple[tuple[float, float], tuple[float, float]]

_TIME = "time_s"
_RATE, _FORCE = COLUMNS["imu"]["rate"], COLUMNS["imu"]["force"]
_XY, _XYZ = ("x_m", "y_m"), ("x_m", "y_m", "z_m")
_V = ("vx_mps", "vy_mps", "vz_mps")
_Q = COLUMNS["reference"]["attitude"]
_SECONDS = (1.0, 3.0), (5.0, 20.0)
_LATE = (0.03, 0.15), (0.3, 5.0)
_DEGREES = (2.0, 8.0), (15.0, 45.0)
_METRES = (0.05, 0.2), (0.5, 3.0)


@dataclass(frozen=True)
class Spoiler:
    """One way to spoil a file.

    Attributes
    ----------
    name : str
    file : str
    change : callable
        Takes the path of the file, a size and a generator.
    right : tuple of str
        Names of findings that tell what is wrong; none where no check is meant for it.
    columns : tuple of str
        That the file must have.
    sizes : pairs of float, or None
        Between which small and large sizes are drawn.
    unit : str
        Of the sizes.
    """

    name: str
    file: str
    change: Change
    right: tuple[str, ...] = ()
    columns: tuple[str, ...] = ()
    sizes: Sizes | None = None
    unit: str = ""

    @property
    def classes(self) -> tuple[str, ...]:
        """Of the sizes."""
        return ("small", "large") if self.sizes else ("whole",)

    def fits(self, folder: Path) -> bool:
        """Tell whether a folder has what is spoilt."""
        path = folder / self.file
        return path.is_file() and {*self.columns} <= {*_head(path)}

    def draw(self, kind: str, rng: Random) -> float:
        """Return a size of a class, as likely in each decade."""
        if self.sizes is None:
            return float("nan")
        low, high = np.log(self.sizes[kind == "large"])
        return float(np.exp(rng.uniform(low, high)))


def _head(path: Path) -> list[str]:
    if path.suffix != ".csv":
        return []
    with path.open(encoding="utf-8") as file:
        return file.readline().strip().split(",")


def in_tables(change: Callable[[pd.DataFrame, float, Random], pd.DataFrame]) -> Change:
    """Return what changes the table in a file."""

    def changed(path: Path, size: float, rng: Random) -> None:
        table = pd.read_csv(path, dtype={"anchor": str})
        change(table, size, rng).to_csv(path, index=False, lineterminator="\n")

    return changed


def _text(change: Callable[[str, Random], str]) -> Change:
    """Return what changes the text of a file."""

    def changed(path: Path, _: float, rng: Random) -> None:
        path.write_text(change(path.read_text(encoding="utf-8"), rng), encoding="utf-8")

    return changed


# Time stamps ---------------------------------------------------------------------------------


def _gap(table: pd.DataFrame, size: float, rng: Random) -> pd.DataFrame:
    return table[~_stretch(table, size, rng)]


def _stretch(table: pd.DataFrame, seconds: float, rng: Random) -> pd.Series:
    """Return which rows are in a stretch of some seconds, at most half of all."""
    time = table[_TIME]
    begin, end = time.iloc[0], time.iloc[-1]
    length = min(seconds, (end - begin) / 2)
    first = rng.uniform(begin + 0.2 * length, end - 1.2 * length)
    return (time >= first) & (time < first + length)


def _late(table: pd.DataFrame, size: float, rng: Random) -> pd.DataFrame:
    return table.assign(**{_TIME: table[_TIME] + size * rng.choice([-1, 1])})


def _jump(table: pd.DataFrame, size: float, rng: Random) -> pd.DataFrame:
    first = int(rng.uniform(0.3, 0.7) * len(table))
    later = np.arange(len(table)) >= first
    return table.assign(**{_TIME: table[_TIME] + size * rng.choice([-1, 1]) * later})


def _fast(table: pd.DataFrame, size: float, rng: Random) -> pd.DataFrame:
    begin = table[_TIME].iloc[0]
    return table.assign(**{_TIME: begin + (1 + size) * (table[_TIME] - begin)})


def _milliseconds(table: pd.DataFrame, _: float, rng: Random) -> pd.DataFrame:
    return table.assign(**{_TIME: 1000 * table[_TIME]})


def _rows_twice(table: pd.DataFrame, size: float, rng: Random) -> pd.DataFrame:
    return table.loc[np.repeat(table.index, 1 + (rng.random(len(table)) < size))]


def _stamps_twice(table: pd.DataFrame, size: float, rng: Random) -> pd.DataFrame:
    twice = np.flatnonzero(rng.random(len(table) - 1) < size) + 1
    time = table[_TIME].to_numpy().copy()
    time[twice] = time[twice - 1]
    return table.assign(**{_TIME: time})


def _back(table: pd.DataFrame, size: float, rng: Random) -> pd.DataFrame:
    row = int(rng.integers(len(table) // 4, len(table) - 1))
    time = table[_TIME].to_numpy().copy()
    time[row] = time[row - 1] - size
    return table.assign(**{_TIME: time})


def _dropped(table: pd.DataFrame, size: float, rng: Random) -> pd.DataFrame:
    return table[rng.random(len(table)) > size]


# Values --------------------------------------------------------------------------------------


def _numbers(table: pd.DataFrame) -> list[str]:
    return [name for name in table if name not in (_TIME, "anchor", "good")]


def _frozen(table: pd.DataFrame, size: float, rng: Random) -> pd.DataFrame:
    rows = np.flatnonzero(_stretch(table, size, rng))
    columns = _numbers(table)
    table.loc[rows, columns] = table.loc[rows[:1], columns].to_numpy()
    return table


def _saturated(table: pd.DataFrame, size: float, _: Random) -> pd.DataFrame:
    values = table[_numbers(table)]
    middle, spread = values.mean(), values.std()
    return table.assign(**values.clip(middle - size * spread, middle + size * spread, axis=1))


def _quantised(table: pd.DataFrame, size: float, _: Random) -> pd.DataFrame:
    values = table[_numbers(table)]
    step = size * values.std().replace(0.0, 1.0)
    return table.assign(**(values / step).round() * step)


def _cell(text: tuple[str, ...]) -> Change:
    def changed(table: pd.DataFrame, _: float, rng: Random) -> pd.DataFrame:
        table = table.astype(object)
        column = int(rng.integers(table.shape[1]))
        table.iloc[int(rng.integers(len(table))), column] = str(rng.choice(text))
        return table

    return in_tables(changed)


def _times(columns: tuple[str, ...], factors: tuple[float, ...]) -> Change:
    """Return what multiplies columns by one of some factors."""

    def changed(table: pd.DataFrame, _: float, rng: Random) -> pd.DataFrame:
        there = [name for name in columns if name in table]
        return table.assign(**table[there] * rng.choice(factors))

    return in_tables(changed)


def _scaled(columns: tuple[str, ...]) -> Change:
    return in_tables(lambda table, size, _: table.assign(**table[list(columns)] * (1 + size)))


def _added(columns: tuple[str, ...]) -> Change:
    """Return what adds a vector of some length to columns."""

    def changed(table: pd.DataFrame, size: float, rng: Random) -> pd.DataFrame:
        there = [name for name in columns if name in table]
        way = rng.standard_normal(len(there))
        return table.assign(**table[there] + size * way / np.linalg.norm(way))

    return in_tables(changed)


def _mapped(table: pd.DataFrame, vectors: Iterable[tuple[str, ...]], P: Array) -> pd.DataFrame:
    """Multiply vectors by a matrix, or by as much of it as they have components."""
    for names in vectors:
        there = [name for name in names if name in table]
        if there:
            table[there] = table[there].to_numpy() @ P[: len(there), : len(there)].T
    return table


def _axes(*vectors: tuple[str, ...]) -> Change:
    """Return what exchanges or reverses axes of vectors, all alike."""

    def changed(table: pd.DataFrame, _: float, rng: Random) -> pd.DataFrame:
        width = len([name for name in vectors[0] if name in table])
        others = [P for P in signed_permutations(width) if not np.allclose(P, np.eye(width))]
        return _mapped(table, vectors, others[int(rng.integers(len(others)))])

    return in_tables(changed)


def _exchanged(*pairs: tuple[str, str]) -> Change:
    """Return what exchanges the names of columns."""
    other = {**dict(pairs), **{b: a for a, b in pairs}}
    return in_tables(lambda table, *_: table.rename(columns=other))


def _turned(*vectors: tuple[str, ...]) -> Change:
    """Return what turns vectors about z."""

    def changed(table: pd.DataFrame, size: float, rng: Random) -> pd.DataFrame:
        angle = np.radians(size) * rng.choice([-1, 1])
        turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
        return _mapped(table, [names[:2] for names in vectors], turn)

    return in_tables(changed)


def _hidden(table: pd.DataFrame, size: float, rng: Random) -> pd.DataFrame:
    """Make the ranges of one anchor too long for a stretch."""
    span = table[_TIME].iloc[-1] - table[_TIME].iloc[0]
    rows = _stretch(table, rng.uniform(0.2, 0.5) * span, rng)
    rows &= table["anchor"] == rng.choice(table["anchor"].unique())
    return table.assign(range_m=table["range_m"] + size * rows)


def _echoes(table: pd.DataFrame, size: float, rng: Random) -> pd.DataFrame:
    """Make a tenth of all ranges too long."""
    far = rng.random(len(table)) < 0.1
    return table.assign(range_m=table["range_m"] + far * rng.exponential(size, len(table)))


def _anchor_moved(table: pd.DataFrame, size: float, rng: Random) -> pd.DataFrame:
    columns = [name for name in _XYZ if name in table]
    way = rng.standard_normal(len(columns))
    row = int(rng.integers(len(table)))
    table.loc[row, columns] += size * way / np.linalg.norm(way)
    return table


def _anchors_exchanged(table: pd.DataFrame, _: float, rng: Random) -> pd.DataFrame:
    a, b = rng.choice(len(table), 2, replace=False)
    names = table["anchor"].to_numpy().copy()
    names[[a, b]] = names[[b, a]]
    return table.assign(anchor=names)


def _attitude_inverse(table: pd.DataFrame, *_: object) -> pd.DataFrame:
    return table.assign(qw=-table["qw"])


def _attitude_w_first(table: pd.DataFrame, *_: object) -> pd.DataFrame:
    table[list(_Q)] = table[["qw", "qx", "qy", "qz"]].to_numpy()
    return table


def _lever_arm(path: Path, size: float, rng: Random) -> None:
    about = yaml.safe_load(path.read_text(encoding="utf-8"))
    way = rng.standard_normal(3)
    arm = np.array(about.get("lever_arm_m", [0, 0, 0])) + size * way / np.linalg.norm(way)
    path.write_text(yaml.safe_dump(about | {"lever_arm_m": arm.tolist()}), encoding="utf-8")


def _cut(text: str, rng: Random) -> str:
    return text[: int(rng.uniform(0.3, 0.95) * len(text))]


def _emptied(text: str, _: Random) -> str:
    return text[: text.index("\n") + 1]


# The list ------------------------------------------------------------------------------------


def spoilers() -> list[Spoiler]:
    """Return all ways to spoil a recording."""
    streams = [each for name in COLUMNS for each in _of_any_stream(f"{name}.csv")]
    return [*streams, *_of_imu(), *_of_odometry(), *_of_ranges(), *_of_fixes(), *_of_reference()]


def _of_any_stream(file: str) -> Iterator[Spoiler]:
    share = (0.01, 0.05), (0.2, 0.6)
    yield Spoiler("gap", file, in_tables(_gap), ("gaps",), (), _SECONDS, "s")
    yield Spoiler("late clock", file, in_tables(_late), ("time",), (), _LATE, "s")
    yield Spoiler("clock that jumps", file, in_tables(_jump), ("time", "gaps"), (), _LATE, "s")
    rates = (1e-4, 3e-4), (1e-3, 1e-2)
    yield Spoiler("fast clock", file, in_tables(_fast), ("time",), (), rates)
    yield Spoiler("stamps in ms", file, in_tables(_milliseconds), ("span", "time"))
    yield Spoiler("rows twice", file, in_tables(_rows_twice), ("repeats",), (), share)
    yield Spoiler("stamps twice", file, in_tables(_stamps_twice), ("repeats",), (), share)
    yield Spoiler("a stamp goes back", file, in_tables(_back), (), (), _LATE, "s")
    shares = (0.05, 0.2), (0.4, 0.8)
    yield Spoiler("rows dropped", file, in_tables(_dropped), ("gaps",), (), shares)
    yield Spoiler("frozen values", file, in_tables(_frozen), ("values", "gaps"), (), _SECONDS, "s")
    deviations = (1.5, 2.0), (0.3, 0.8)
    yield Spoiler(
        "saturated", file, in_tables(_saturated), ("values",), (), deviations, "deviations"
    )
    steps = (0.02, 0.1), (1.0, 3.0)
    yield Spoiler("quantised", file, in_tables(_quantised), ("values",), (), steps, "deviations")
    yield Spoiler("an empty cell", file, _cell(("",)))
    yield Spoiler("a word in a cell", file, _cell(("n.a.", "1,5", "1.2.3", "#REF!", "inf")))
    yield Spoiler("cut off", file, _text(_cut))
    yield Spoiler("no rows", file, _text(_emptied))


def _of_imu() -> Iterator[Spoiler]:
    file, both = "imu.csv", (*_RATE, *_FORCE)
    yield Spoiler("force in g", file, _times(_FORCE, (1 / 9.80665,)), ("unit",))
    yield Spoiler("force in another unit", file, _times(_FORCE, (100.0, 3.2808, 102.0)), ("unit",))
    yield Spoiler("rate in deg/s", file, _times(_RATE, (57.29578,)), ("unit",))
    yield Spoiler("rate in another unit", file, _times(_RATE, (1e3, 0.159155)), ("unit",))
    yield Spoiler("axes of the IMU", file, _axes(_RATE, _FORCE), ("axes", "gravity"))
    yield Spoiler("axes of the gyro", file, _axes(_RATE), ("axes",))
    yield Spoiler("axes of the accelerometer", file, _axes(_FORCE), ("axes", "gravity"))
    yield Spoiler("sign of the force", file, _times(_FORCE, (-1.0,)), ("gravity", "axes"))
    yield Spoiler("sign of the rates", file, _times(_RATE, (-1.0,)), ("axes",))
    pairs = tuple(zip(_RATE, _FORCE, strict=True))
    yield Spoiler("rate and force exchanged", file, _exchanged(*pairs), ("unit",))
    yield Spoiler("x and y exchanged", file, _exchanged(_RATE[:2], _FORCE[:2]), ("axes",))
    turned = _turned(_RATE, _FORCE)
    yield Spoiler("IMU turned", file, turned, ("mounting",), both, _DEGREES, "deg")


def _of_odometry() -> Iterator[Spoiler]:
    file, right = "odometry.csv", ("odometry",)
    shares = (0.02, 0.08), (0.2, 1.0)
    yield Spoiler("speed in another unit", file, _times(("speed_mps",), (3.6, 100.0, 1e3)), right)
    yield Spoiler("rate in deg/s", file, _times(("rate_radps",), (57.29578,)), right)
    yield Spoiler("sign of the speed", file, _times(("speed_mps",), (-1.0,)), right)
    yield Spoiler("sign of the rate", file, _times(("rate_radps",), (-1.0,)), right)
    yield Spoiler("speed too large", file, _scaled(("speed_mps",)), right, (), shares)
    yield Spoiler("rate too large", file, _scaled(("rate_radps",)), right, (), shares)
    exchanged = _exchanged(("speed_mps", "rate_radps"))
    yield Spoiler("speed and rate exchanged", file, exchanged, right)


def _of_ranges() -> Iterator[Spoiler]:
    file, place = "ranges.csv", "anchors.csv"
    units, lengths = ("unit",), (3.2808, 39.37, 100.0, 1e3)
    yield Spoiler("ranges in another unit", file, _times(("range_m",), lengths), units)
    yield Spoiler("sign of the ranges", file, _times(("range_m",), (-1.0,)), units)
    yield Spoiler("range and anchor exchanged", file, _exchanged(("range_m", "anchor")))
    yield Spoiler("an anchor hidden", file, in_tables(_hidden), ("bias",), (), _METRES, "m")
    yield Spoiler("echoes", file, in_tables(_echoes), (), (), _METRES, "m")
    long = (0.01, 0.04), (0.1, 0.3)
    yield Spoiler("ranges too long", file, _scaled(("range_m",)), ("scale", "unit"), (), long)
    yield Spoiler("anchors in another unit", place, _times(_XYZ, lengths), units)
    yield Spoiler("axes of the anchors", place, _axes(_XYZ), ("axes",))
    yield Spoiler("anchors' x and y exchanged", place, _exchanged(_XY), ("axes",))
    turned = _turned(_XY)
    yield Spoiler("anchors turned", place, turned, ("frame", "axes"), (), _DEGREES, "deg")
    yield Spoiler("anchors shifted", place, _added(_XYZ), ("frame",), (), _METRES, "m")
    yield Spoiler(
        "an anchor moved", place, in_tables(_anchor_moved), ("place", "bias"), (), _METRES, "m"
    )
    yield Spoiler("two anchors exchanged", place, in_tables(_anchors_exchanged), ("place",))
    arm = (0.05, 0.15), (0.5, 1.5)
    yield Spoiler("lever arm", "recording.yaml", _lever_arm, ("lever arm",), (), arm, "m")


def _of_fixes() -> Iterator[Spoiler]:
    file, unit = "fixes.csv", (3.2808, 100.0, 1e3)
    all_of = (*_XYZ, *_V, *COLUMNS["fixes"]["deviation"])
    yield Spoiler("fixes in another unit", file, _times(all_of, unit), ("unit", "axes", "frame"))
    yield Spoiler("axes of the fixes", file, _axes(_XYZ, _V), ("axes",))
    yield Spoiler("x and y exchanged", file, _exchanged(_XY), ("axes", "itself"))
    turned = _turned(_XY, _V)
    yield Spoiler("fixes turned", file, turned, ("frame", "axes"), (), _DEGREES, "deg")
    yield Spoiler("fixes shifted", file, _added(_XYZ), ("frame",), (), _METRES, "m")
    sign = _times(_V, (-1.0,))
    yield Spoiler("sign of the velocities", file, sign, ("itself", "axes"), _V[:2])


def _of_reference() -> Iterator[Spoiler]:
    file = "reference.csv"
    lengths = (3.2808, 100.0, 1e3)
    yield Spoiler("reference in another unit", file, _times(_XYZ, lengths), ("unit", "axes"))
    yield Spoiler("axes of the reference", file, _axes(_XYZ), ("axes",))
    yield Spoiler("x and y exchanged", file, _exchanged(_XY), ("axes",))
    turned = _turned(_XY)
    yield Spoiler("reference turned", file, turned, ("frame", "axes"), (), _DEGREES, "deg")
    yield Spoiler("reference shifted", file, _added(_XYZ), ("frame",), (), _METRES, "m")
    first, right = in_tables(_attitude_w_first), ("axes", "gravity", "mounting", "odometry")
    yield Spoiler("quaternions with w first", file, first, right, _Q)
    inverse = in_tables(_attitude_inverse)
    yield Spoiler("quaternions of the inverse", file, inverse, right, _Q)
