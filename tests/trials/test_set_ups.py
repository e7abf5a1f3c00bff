"""Made logs of which all is right are not taken for wrong, and spoilt ones are told by the name."""

from __future__ import annotations

import shutil
from collections import Counter
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pandas as pd
from made_logs import MADE_LOGS
from spoilers import Spoiler, in_tables, spoilers

from inswsn_lib import logs
from inswsn_lib.errors import InswsnError
from inswsn_lib.logs import Finding, check_set_up
from inswsn_lib.streams import Recording

Random = np.random.Generator
Tell = Callable[[str], None]
Size = Callable[[int, int], int]


def _hours(table: pd.DataFrame, size: float, rng: Random) -> pd.DataFrame:
    return table.assign(time_s=table["time_s"] + 3600.0 * round(size) * rng.choice([-1, 1]))


def _increments(table: pd.DataFrame, _: float, rng: Random) -> pd.DataFrame:
    vector = str(rng.choice(["rate_", "force_"]))
    columns = [name for name in table if name.startswith(vector)]
    return table.assign(**table[columns] * table["time_s"].diff().median())


def _held(table: pd.DataFrame, size: float, _: Random) -> pd.DataFrame:
    """Each value is logged again until there is a new one."""
    rows = np.arange(len(table)) // round(size) * round(size)
    return table.iloc[rows].reset_index(drop=True).assign(time_s=table["time_s"])


def _jammed(table: pd.DataFrame, _: float, rng: Random) -> pd.DataFrame:
    """The logger falls behind for a while, twice, and catches up."""
    time = table["time_s"].to_numpy().copy()
    for _ in range(2):
        begin, by = rng.uniform(0.1, 0.8) * time[-1], rng.uniform(0.6, 1.5)
        jam = (time >= begin) & (time < begin + by)
        time[jam] = begin + by
    return table.assign(time_s=np.maximum.accumulate(time) + 1e-5 * np.arange(len(time)))


def _wrong_rows(table: pd.DataFrame, size: float, rng: Random) -> pd.DataFrame:
    """Stretches are elsewhere."""
    columns = [name for name in ("x_m", "y_m", "z_m") if name in table]
    place = table[columns].to_numpy()
    for _ in range(int(rng.integers(1, 6))):
        begin = int(rng.uniform(0.05, 0.9) * len(place))
        way = rng.normal(size=len(columns))
        place[begin : begin + int(rng.integers(1, 150))] += size * way / np.linalg.norm(way)
    return table.assign(**dict(zip(columns, place.T, strict=True)))


def _own() -> list[Spoiler]:
    hours, often, far = (1.0, 5.0), (2.0, 7.0), (1.5, 4.0)
    return [
        *(
            Spoiler("hours late", f"{name}.csv", in_tables(_hours), ("time",), (), (hours, hours))
            for name in ("imu", "fixes", "ranges")
        ),
        Spoiler("increments", "imu.csv", in_tables(_increments), ("unit",)),
        Spoiler("held", "fixes.csv", in_tables(_held), ("values",), (), (often, often)),
        Spoiler("jammed", "reference.csv", in_tables(_jammed), ("stamps",)),
        Spoiler("wrong rows", "reference.csv", in_tables(_wrong_rows), ("values",), (), (far, far)),
    ]


def turns(right: Recording) -> bool:
    """Whether a tag turns about all axes, and its attitude is told."""
    return bool(right.ranges and right.imu and right.reference and _attitude(right))


def _attitude(right: Recording) -> bool:
    return right.reference is not None and right.reference.attitude is not None


def referred(right: Recording) -> bool:
    return right.reference is not None


def ranged(right: Recording) -> bool:
    """Whether ranges tell rows of a reference, which come often enough for a few to stand out."""
    often = right.reference is not None and np.diff(right.reference.time)[0] < 0.06
    return bool(often and right.ranges)


def always(_: Recording) -> bool:
    return True


#: What is spoilt, and of which logs the data tell it
TOLD: dict[tuple[str, str], Callable[[Recording], bool]] = {
    (file, name): tell
    for tell, files in {
        always: {
            "imu.csv": ["rate in deg/s", "force in g", "force in another unit", "increments"],
            "fixes.csv": ["late clock", "hours late", "held"],
            "ranges.csv": ["ranges in another unit", "ranges too long"],
            "anchors.csv": ["anchors turned", "an anchor moved"],
            "odometry.csv": ["speed in another unit", "rate in deg/s", "sign of the rate"],
        },
        referred: {
            "imu.csv": ["late clock", "hours late"],
            "fixes.csv": ["fixes in another unit"],
            "ranges.csv": ["late clock", "hours late"],
            "reference.csv": ["jammed"],
        },
        turns: {"imu.csv": ["axes of the gyro", "IMU turned"], "recording.yaml": ["lever arm"]},
        _attitude: {"odometry.csv": ["sign of the speed"]},
        ranged: {"reference.csv": ["wrong rows"]},
    }.items()
    for file, names in files.items()
    for name in names
}


def wrong(findings: list[Finding]) -> list[Finding]:
    return [found for found in findings if found.fits is False]


def test_right_logs_are_not_taken_for_wrong(seed: int, size: Size, tell: Tell) -> None:
    """At most one of a hundred."""
    alarms = [
        (kind, draw, found[0])
        for kind, make in MADE_LOGS.items()
        for draw in range(seed, seed + size(2, 170))
        if (found := wrong(check_set_up(make(draw))))
    ]
    count = 3 * size(2, 170)
    tell(f"{len(alarms)} of {count} right logs are taken for wrong")
    assert len(alarms) <= count // 100, alarms


def test_spoilt_logs_are_told_by_the_name(
    seed: int, size: Size, tell: Tell, tmp_path: Path
) -> None:
    """At least four of five of all, and the half of each kind of fault."""
    drawn: Counter[str] = Counter()
    named: Counter[str] = Counter()
    missed = []
    ways = [way for way in (*spoilers(), *_own()) if (way.file, way.name) in TOLD]
    ways = ways[:: size(3, 1)]
    for draw in range(seed, seed + size(1, 20)):
        made = {tmp_path / f"{draw} {kind}": make(draw + 5000) for kind, make in MADE_LOGS.items()}
        for whole, right in made.items():
            logs.write_csv(right, whole)
        for k, way in enumerate(ways):
            rng = np.random.default_rng([draw, k])
            for whole, right in made.items():
                if not (way.fits(whole) and TOLD[way.file, way.name](right)):
                    continue
                folder = shutil.copytree(whole, tmp_path / f"{draw} {k} {whole.name}")
                by, name = way.draw("large", rng), f"{way.file}, {way.name}"
                way.change(folder / way.file, by, rng)
                found = _found(folder)
                drawn[name] += 1
                named[name] += any(_tells(each, way, by) for each in found)
                if not any(_tells(each, way, by) for each in found):
                    missed.append((name, right.name, by, [(f.name, f.says) for f in found]))
                if size(1, 2) == 1:
                    break
    rates = {name: f"{named[name]} of {drawn[name]}" for name in drawn}
    tell(
        f"{sum(named.values())} of {sum(drawn.values())} spoilt logs are told by the name: {rates}"
    )
    assert len(drawn) >= size(len(TOLD) // 3 - 2, len(TOLD)), drawn  # a draw has not all streams
    assert sum(named.values()) >= 0.8 * sum(drawn.values()), missed
    assert all(named[name] >= drawn[name] // 2 for name in drawn), missed


def _found(folder: Path) -> list[Finding]:
    """Return what is wrong with a folder, by its reader or else by the checks."""
    try:
        return wrong(check_set_up(logs.load("csv", folder)))
    except InswsnError as error:
        name = "unit" if "it seems to be in" in str(error) else "refused"
        return [Finding(name, "reader", np.nan, np.nan, np.nan, False, str(error))]


def _tells(found: Finding, way: Spoiler, by: float) -> bool:
    """Whether a finding has the name, and for a clock within half a second the value."""
    if found.name != "time":
        return found.name in way.right
    by = 3600.0 * round(by) if way.name == "hours late" else by
    return "time" in way.right and abs(abs(found.value) - by) < 0.6
