"""Made logs of which all is right are not taken for wrong, and spoilt ones are told by the name."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
from made_logs import MADE_LOGS
from scipy.spatial.transform import Rotation

from inswsn_lib.recordings import Finding, check_set_up
from inswsn_lib.recordings.likeness import signed_permutations
from inswsn_lib.streams import Recording, Reference

Random = np.random.Generator
Spoilt = tuple[Recording, tuple[str, str]]  # and what the right finding is called and says
Spoiler = Callable[[Recording, Random], Spoilt | None]


def other(recording: Recording, name: str, **columns: Any) -> Recording:
    changed: dict[str, Any] = {name: replace(getattr(recording, name), **columns)}
    return replace(recording, **changed)


def late(name: str, *sizes: tuple[float, float]) -> Spoiler:
    """Stamps are late by as many seconds, or hours."""

    def spoil(right: Recording, rng: Random) -> Spoilt | None:
        stream = getattr(right, name)
        if stream is None or (right.reference is None and name != "fixes"):
            return None
        low, high = sizes[int(rng.integers(len(sizes)))]
        by = float(np.exp(rng.uniform(np.log(low), np.log(high))) * rng.choice([-1, 1]))
        by = round(by / 3600) * 3600.0 if high > 1000 else by
        return other(right, name, time=stream.time + by), ("time", f"{abs(by)}")

    return spoil


def times(name: str, column: str, units: dict[float, str]) -> Spoiler:
    """Values are in another unit; 0 stands for increments of a period."""

    def spoil(right: Recording, rng: Random) -> Spoilt | None:
        stream, reference = getattr(right, name), right.reference
        if stream is None or (reference is None and name == "fixes"):
            return None
        unit = float(rng.choice(list(units)))
        size = unit or float(np.median(np.diff(stream.time)))
        if (unit, column) == (-1.0, "speed") and (reference is None or reference.attitude is None):
            return None
        changed = {column: getattr(stream, column) * size}
        if name == "fixes" and stream.velocity is not None:
            changed["velocity"] = stream.velocity * size
        right_name = "odometry" if name == "odometry" else "unit"
        return other(right, name, **changed), (right_name, units[unit])

    return spoil


def axes(right: Recording, rng: Random) -> Spoilt | None:
    """Axes of the gyroscope are others; of a car, which turns one way, z is reversed."""
    if right.imu is None or right.reference is None:
        return None
    P = np.diag([1.0, 1.0, -1.0])
    if right.ranges is not None and right.reference.attitude is None:
        return None
    if right.ranges is not None:
        P = signed_permutations(3)[int(rng.integers(1, 48))]
    return other(right, "imu", rate=right.imu.rate @ P.T), ("axes", "gyro")


def anchors(change: Callable[[Any, Random], Any], name: str) -> Spoiler:
    def spoil(right: Recording, rng: Random) -> Spoilt | None:
        if right.ranges is None:
            return None
        return other(right, "ranges", anchors=change(right.ranges.anchors, rng)), (name, "")

    return spoil


def turned(places: Any, rng: Random) -> Any:
    angle = np.radians(rng.uniform(8, 35)) * rng.choice([-1, 1])
    c, s = np.cos(angle), np.sin(angle)
    turn = np.eye(places.shape[1])
    turn[:2, :2] = [[c, -s], [s, c]]
    return (places - places.mean(axis=0)) @ turn.T + places.mean(axis=0)


def one_moved(places: Any, rng: Random) -> Any:
    moved = places.copy()
    way = rng.normal(size=places.shape[1])
    moved[rng.integers(len(places))] += rng.uniform(1.5, 3) * way / np.linalg.norm(way)
    return moved


def too_long(right: Recording, rng: Random) -> Spoilt | None:
    if right.ranges is None:
        return None
    factor = rng.uniform(1.12, 1.3)
    return other(right, "ranges", distance=right.ranges.distance * factor), ("scale", "")


def arm(right: Recording, rng: Random) -> Spoilt | None:
    if right.imu is None or right.ranges is None or right.reference is None:
        return None
    if right.reference.attitude is None:
        return None
    way = rng.normal(size=3)
    wrong = right.lever_arm + rng.uniform(0.4, 1) * way / np.linalg.norm(way)
    return replace(right, lever_arm=wrong), ("lever arm", "")


def held(right: Recording, rng: Random) -> Spoilt | None:
    if right.fixes is None:
        return None
    often, fixes = int(rng.integers(2, 8)), right.fixes
    rows = np.arange(len(fixes)) // often * often
    velocity = None if fixes.velocity is None else fixes.velocity[rows]
    return other(right, "fixes", position=fixes.position[rows], velocity=velocity), (
        "values", f"stands in {often} rows")  # fmt: skip


def jammed(right: Recording, rng: Random) -> Spoilt | None:
    """The logger falls behind for a while, twice, and catches up."""
    if right.reference is None:
        return None
    time = right.reference.time.copy()
    for _ in range(2):
        begin, by = rng.uniform(0.1, 0.8) * time[-1], rng.uniform(0.6, 1.5)
        jam = (time >= begin) & (time < begin + by)
        time[jam] = begin + by + 1e-5 * np.arange(jam.sum())
        after = np.flatnonzero(~jam & (time <= begin + by + 1e-5 * jam.sum()) & (time > begin))
        time[after] = begin + by + 1e-5 * (jam.sum() + np.arange(len(after)))
    time = np.maximum.accumulate(time) + 1e-7 * np.arange(len(time))
    return other(right, "reference", time=time), ("stamps", "fall behind")


def wrong_rows(right: Recording, rng: Random) -> Spoilt | None:
    """Stretches of a reference are elsewhere."""
    if right.reference is None or right.ranges is None or np.diff(right.reference.time)[0] > 0.06:
        return None
    reference: Reference = right.reference
    place = reference.position.copy()
    for _ in range(int(rng.integers(1, 6))):
        begin = int(rng.uniform(0.05, 0.9) * len(place))
        rows, way = slice(begin, begin + int(rng.integers(1, 150))), rng.normal(size=place.shape[1])
        place[rows] += rng.uniform(1.5, 4) * way / np.linalg.norm(way)
    return other(right, "reference", position=place), ("values", "no motion joins")


def mounted(right: Recording, rng: Random) -> Spoilt | None:
    if right.imu is None or right.reference is None or right.ranges is None:
        return None
    if right.reference.attitude is None:
        return None
    turn = Rotation.from_rotvec(np.radians(rng.uniform(12, 30)) * np.eye(3)[rng.integers(3)])
    imu = right.imu
    return other(right, "imu", rate=turn.apply(imu.rate), force=turn.apply(imu.force)), (
        "mounting", "")  # fmt: skip


_LENGTHS = {3.2808: "in feet", 100.0: "in cm", 1000.0: "in mm"}
_RATES, _SIGN = {57.29578: "in deg/s", 1000.0: "in mrad/s"}, {-1.0: "its sign is another"}
SPOILERS: dict[str, Spoiler] = {
    "imu late": late("imu", (1.0, 15.0), (3600, 20000)),
    "fixes late": late("fixes", (1.0, 19.0), (3600, 20000)),
    "ranges late": late("ranges", (0.3, 19.0), (3600, 20000)),
    "rates in another unit": times("imu", "rate", _RATES | {0.0: "increments"}),
    "forces in another unit": times(
        "imu", "force", {1 / 9.80665: "in g", 100.0: "in cm/s^2", 0.0: "increments"}
    ),
    "ranges in another unit": times("ranges", "distance", _LENGTHS),
    "fixes in another unit": times("fixes", "position", _LENGTHS),
    "speed in another unit": times("odometry", "speed", {3.6: "in km/h", 100.0: "in cm/s"} | _SIGN),
    "turns in another unit": times("odometry", "rate", {57.29578: "in deg/s"} | _SIGN),
    "axes": axes,
    "mounted": mounted,
    "anchors turned": anchors(turned, "frame"),
    "an anchor moved": anchors(one_moved, "place"),
    "ranges too long": too_long,
    "lever arm": arm,
    "held": held,
    "jammed": jammed,
    "wrong rows": wrong_rows,
}
Tell = Callable[[str], None]
Size = Callable[[int, int], int]


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


def test_spoilt_logs_are_told_by_the_name(seed: int, size: Size, tell: Tell) -> None:
    """At least four of five of all, and the half of each kind of fault."""
    drawn: Counter[str] = Counter()
    named: Counter[str] = Counter()
    missed = []
    for draw in range(seed, seed + size(1, 20)):
        for k, (name, spoil) in enumerate(SPOILERS.items()):
            rng = np.random.default_rng([draw, k])
            for make in MADE_LOGS.values():
                made = spoil(make(draw + 5000), rng)
                if made is None:
                    continue
                spoilt, (right, words) = made
                found = wrong(check_set_up(spoilt))
                drawn[name] += 1
                if any(_tells(each, right, words) for each in found):
                    named[name] += 1
                else:
                    missed.append((name, spoilt.name, [(f.name, f.says) for f in found]))
                if size(1, 2) == 1:
                    break
    rates = {name: f"{named[name]} of {drawn[name]}" for name in SPOILERS}
    tell(
        f"{sum(named.values())} of {sum(drawn.values())} spoilt logs are told by the name: {rates}"
    )
    assert sum(named.values()) >= 0.8 * sum(drawn.values()), missed
    assert all(named[name] >= drawn[name] // 2 for name in SPOILERS), missed


def _tells(found: Finding, right: str, words: str) -> bool:
    """Whether a finding has the name and the words, or for a clock what is within half a second."""
    if found.name != right or right != "time":
        return found.name == right and words in found.says
    return abs(abs(found.value) - float(words)) < 0.6
