"""Whether ranges or fixes have the unit, the axes, the clock and the frame of a reference."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from inswsn_lib.checks import Array, Mask
from inswsn_lib.errors import InswsnError
from inswsn_lib.logs.blocks import FEWEST
from inswsn_lib.logs.explanations import Explanations
from inswsn_lib.logs.findings import Finding, unknown
from inswsn_lib.logs.fit import calibrate
from inswsn_lib.logs.likeness import BLOCK, Likeness, units_of
from inswsn_lib.logs.reference_motion import ReferenceMotion
from inswsn_lib.logs.set_up_anchors import FRAME, biases_alone, check_anchors
from inswsn_lib.logs.start import fixes_of
from inswsn_lib.streams import Fixes, Ranges, Recording

_UNITS = {"feet": 3.2808, "inches": 39.37, "cm": 100.0, "mm": 1000.0, "km": 1e-3}
_OTHER = {unit: 1 / size for unit, size in _UNITS.items() if unit != "km"}
_SIZE = (0.67, 1.5)  # of a unit that is right
_AS_GOOD = 1.5  # times the noise that is left without wrong anchors: then it is the frame
_MOST = 4000  # ranges by which a unit is tried, and fixes by which axes are


def check_positions(recording: Recording) -> Iterator[Finding]:
    """Yield what can be found of ranges and fixes, by the reference where there is one."""
    ranges, fixes = recording.ranges, recording.fixes
    if ranges is not None and len(ranges):
        yield from _alone(ranges) if recording.reference is None else _ranges(recording, ranges)
    if fixes is not None and len(fixes) and recording.reference is not None:
        yield from _fixes(recording, fixes)


def _alone(ranges: Ranges) -> Iterator[Finding]:
    """Try units by how well ranges meet in one point; nothing else can be told."""
    some = ranges.part(end=float(ranges.time[min(len(ranges), _MOST) - 1]))
    noises = {
        unit: _disagreement(replace(some, distance=some.distance / size))
        for unit, size in {"m": 1.0, **_UNITS}.items()
    }
    best = min(noises, key=lambda unit: noises[unit])
    if np.isinf(noises[best]):
        yield unknown("unit", "ranges", "too few are heard at a time to meet in a point")
    else:
        ratio = noises["m"] / max(noises[best], 1e-9)
        says = "they meet best in m" if best == "m" else f"they meet best if they are in {best}"
        yield Finding("unit", "ranges", ratio, 0, 2, ratio <= 2, says)
    try:
        found = calibrate(Recording("", ranges=ranges), ("bias",), block=BLOCK)
    except InswsnError as error:
        yield unknown("bias", "ranges", str(error).rstrip("."))
    else:
        yield from biases_alone(found)
    says = "without a reference a mirrored or turned frame of the anchors cannot be told"
    yield unknown("axes", "ranges", says)
    yield unknown("time", "ranges", "without a reference their clock cannot be told")


def _disagreement(ranges: Ranges) -> float:
    """Return by how much ranges of an interval do not meet, m; infinite if too few are heard."""
    try:
        fixes = fixes_of(ranges)
    except InswsnError:
        return np.inf
    there = np.isfinite(fixes.position).all(axis=1)
    if there.sum() < FEWEST:
        return np.inf
    rows = np.searchsorted(fixes.time[there], ranges.time).clip(0, int(there.sum()) - 1)
    d = fixes.position.shape[1]
    apart = fixes.position[there][rows] - ranges.anchors[ranges.anchor, :d]
    off = ranges.distance - np.linalg.norm(apart, axis=1)
    return float(np.median(np.abs(off)))


def _ranges(recording: Recording, ranges: Ranges) -> Iterator[Finding]:
    assert recording.reference is not None
    d, who = ranges.anchors.shape[1], "ranges and reference"
    if recording.reference.position.shape[1] < d:
        yield unknown("axes", who, "the reference has fewer coordinates than the anchors")
        return
    motion = ReferenceMotion(recording.reference, d)
    alike = _likeness(recording, fixes_of(ranges), motion)
    clock = 0.0 if alike is None else alike.clock
    ranges = replace(ranges, time=ranges.time - clock)
    recording = replace(recording, ranges=ranges)
    arm = np.asarray(recording.lever_arm, dtype=float)
    kept = _seen(ranges, motion)
    if len(kept) < 2 * FEWEST:
        yield unknown("unit", who, "they share too little time")
        return
    apart = motion.carried(kept.time, arm) - kept.anchors[kept.anchor]
    distance = np.maximum(np.linalg.norm(apart, axis=1), 1e-9)
    unit, known = _unit(float(np.median(kept.distance / distance)))
    if not unit.fits and known:
        yield unit
        yield unknown("axes", who, "nothing else is told before the unit is right")
        return
    axes = _axes(alike, who, "the reference's")
    yield axes
    if axes.fits is False:
        return
    yield unit
    if not unit.fits:
        return
    kinds = _kinds(recording, "scale")
    told = Explanations(recording, "ranges", kinds, ("bias",), clock)
    right = replace(ranges, time=ranges.time - told.late)
    anchors = check_anchors(_seen(right, motion), motion, arm)
    wrong = [anchor for finding, anchor in anchors if finding.fits is False]
    findings = list(told.findings())
    if wrong:
        others = replace(recording, ranges=ranges.kept(~np.isin(ranges.anchor, wrong)))
        without = Explanations(others, "ranges", kinds, ("bias",), clock)
        turned = any(f.name == "frame" and f.fits is False for f in findings)
        if turned and told.noise <= _AS_GOOD * without.noise:
            anchors = [(unknown(f.name, f.subject, FRAME), k) for f, k in anchors]
        else:
            findings = list(without.findings())
    yield from (finding for finding, _ in anchors)
    yield from findings


def _fixes(recording: Recording, fixes: Fixes) -> Iterator[Finding]:
    reference = recording.reference
    assert reference is not None
    d = min(fixes.position.shape[1], reference.position.shape[1])
    fixes, who = replace(fixes, position=fixes.position[:, :d]), "fixes and reference"
    recording = replace(recording, fixes=fixes)
    alike = _likeness(recording, fixes, ReferenceMotion(reference, d))
    if alike is not None and (slope := alike.slope()).outside(*_SIZE):
        sizes = {f"fixes in {unit}": size for unit, size in _UNITS.items()}
        sizes |= {f"the reference in {unit}": size for unit, size in _OTHER.items()}
        units = units_of(slope.low, slope.high, sizes)
        says = f"fixes move {slope} times as far as the reference"
        says += f": {' or '.join(units)}" if units else ""
        value = float(np.clip(1.0, slope.low, slope.high))
        yield Finding("unit", who, value, *_SIZE, False, says)
        yield unknown("axes", who, "nothing else is told before the unit is right")
        return
    axes = _axes(alike, who, "the fixes'")
    yield axes
    if axes.fits is not False:
        clock = 0.0 if alike is None else alike.clock
        recording = replace(recording, fixes=replace(fixes, time=fixes.time - clock))
        yield from Explanations(recording, "fixes", _kinds(recording), (), clock).findings()


def _kinds(recording: Recording, *more: str) -> tuple[str, ...]:
    assert recording.reference is not None
    arm = () if recording.reference.attitude is None else ("lever arm",)
    return ("clock", "frame", *arm, *more)


def _seen(ranges: Ranges, motion: ReferenceMotion) -> Ranges:
    """Return ranges while the reference is there."""
    return ranges.kept(motion.covers(ranges.time) & np.isfinite(ranges.distance))


def _unit(ratio: float) -> tuple[Finding, list[str]]:
    """Judge the median ratio of ranges and distances, and by which units it is explained."""
    fits = _SIZE[0] <= ratio <= _SIZE[1]
    units = units_of(ratio, ratio, {f"ranges in {unit}": size for unit, size in _UNITS.items()})
    units += units_of(ratio, ratio, {f"anchors in {unit}": size for unit, size in _OTHER.items()})
    says = "ranges are as long as the distances" if fits else (
        f"ranges are {ratio:.3g} times the distances" + (f": {', '.join(units)}" if units else "")
    )  # fmt: skip
    return Finding("unit", "ranges and reference", ratio, *_SIZE, fits, says), units


def _likeness(recording: Recording, fixes: Fixes, motion: ReferenceMotion) -> Likeness | None:
    """Compare fixes with the track; None if there are too few."""
    there = np.flatnonzero(np.isfinite(fixes.position).all(axis=1))
    there = there[:: -(-len(there) // _MOST) or 1]
    time, place = fixes.time[there], fixes.position[there, : motion.d]
    if len(time) < 2 * FEWEST:
        return None
    arm = np.asarray(recording.lever_arm, dtype=float)

    def pairs(clock: float) -> tuple[Array, Array, Mask]:
        return place, motion.carried(time - clock, arm), motion.covers(time - clock)

    return Likeness.of_any_zone(pairs, time)


def _axes(alike: Likeness | None, who: str, what: str) -> Finding:
    if alike is None:
        return unknown("axes", who, "too few fixes while the reference is there")
    return alike.axes(who, what)
