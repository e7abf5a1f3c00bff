"""Whether ranges or fixes have the unit, the axes, the clock and the frame of a reference."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from inswsn_lib.checks import Array, Mask
from inswsn_lib.errors import InswsnError
from inswsn_lib.logs.blocks import FEWEST
from inswsn_lib.logs.calibration import calibrate
from inswsn_lib.logs.explanations import Explanations
from inswsn_lib.logs.findings import Finding, unknown
from inswsn_lib.logs.likeness import BLOCK, Likeness, units_of
from inswsn_lib.logs.reference_motion import ReferenceMotion
from inswsn_lib.logs.set_up_anchors import biases_alone, check_anchors, not_told
from inswsn_lib.logs.start import fixes_of
from inswsn_lib.streams import Fixes, Ranges, Recording, Reference

_UNITS = {"feet": 3.2808, "inches": 39.37, "cm": 100.0, "mm": 1000.0, "km": 1e-3}
_OTHER = {unit: 1 / size for unit, size in _UNITS.items() if unit != "km"}
_SIZE = (0.67, 1.5)  # of a unit that is right
_AS_GOOD = 1.5  # times the noise that is left without wrong anchors: then it is the frame
_MOST = 4000  # ranges by which a unit is tried, and fixes by which axes are


def check_positions(recording: Recording) -> Iterator[Finding]:
    """Yield what can be found of ranges and fixes, by the reference where there is one."""
    ranges, fixes, reference = recording.ranges, recording.fixes, recording.reference
    if ranges is not None and len(ranges):
        yield from _alone(ranges) if reference is None else _ranges(recording, ranges, reference)
    if fixes is not None and len(fixes) and reference is not None:
        yield from _fixes(recording, fixes, reference)


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
    fixes = fixes.kept(np.asarray(np.isfinite(fixes.position).all(axis=1)))
    if len(fixes) < FEWEST:
        return np.inf
    rows = np.searchsorted(fixes.time, ranges.time).clip(0, len(fixes) - 1)
    apart = np.linalg.norm(fixes.position[rows] - ranges.anchors[ranges.anchor], axis=1)
    return float(np.median(np.abs(ranges.distance - apart)))


def _ranges(recording: Recording, ranges: Ranges, reference: Reference) -> Iterator[Finding]:
    d, who = ranges.anchors.shape[1], "ranges and reference"
    if reference.position.shape[1] < d:
        yield unknown("axes", who, "the reference has fewer coordinates than the anchors")
        return
    motion = ReferenceMotion(reference, d)
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
    axes = _axes(alike, who, "the reference's")
    if known:
        yield from (unit, unknown("axes", who, "nothing else is told before the unit is right"))
    elif axes.fits is False:
        yield axes
    else:
        yield from (axes, unit)
    if axes.fits is False or not unit.fits:
        return
    told = Explanations(recording, "ranges", clock)
    right = replace(ranges, time=ranges.time - told.late)
    anchors = check_anchors(_seen(right, motion), motion, arm)
    wrong = [k for k, pair in anchors.items() if any(each.fits is False for each in pair)]
    findings = list(told.findings())
    if wrong:
        others = replace(recording, ranges=ranges.kept(~np.isin(ranges.anchor, wrong)))
        without = Explanations(others, "ranges", clock)
        turned = any(each.name == "frame" and each.fits is False for each in findings)
        if turned and told.noise <= _AS_GOOD * without.noise:
            anchors = not_told(anchors)
        else:
            findings = list(without.findings())
    for pair in anchors.values():
        yield from pair
    yield from findings


def _fixes(recording: Recording, fixes: Fixes, reference: Reference) -> Iterator[Finding]:
    d = min(fixes.position.shape[1], reference.position.shape[1])
    fixes, who = replace(fixes, position=fixes.position[:, :d]), "fixes and reference"
    alike = _likeness(recording, fixes, ReferenceMotion(reference, d))
    if alike is not None and (slope := alike.slope()).outside(*_SIZE):
        units = _named(slope.low, slope.high, "fixes", "the reference")
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
        fixes = replace(fixes, time=fixes.time - clock)
        yield from Explanations(replace(recording, fixes=fixes), "fixes", clock).findings()


def _seen(ranges: Ranges, motion: ReferenceMotion) -> Ranges:
    """Return ranges while the reference is there."""
    return ranges.kept(motion.covers(ranges.time) & np.isfinite(ranges.distance))


def _unit(ratio: float) -> tuple[Finding, bool]:
    """Judge the median ratio of ranges and distances, and whether a wrong unit explains it."""
    fits, units = _SIZE[0] <= ratio <= _SIZE[1], _named(ratio, ratio, "ranges", "anchors")
    says = f"ranges are {ratio:.3g} times the distances"
    says += f": {', '.join(units)}" if units else ""
    says = "ranges are as long as the distances" if fits else says
    found = Finding("unit", "ranges and reference", ratio, *_SIZE, fits, says)
    return found, bool(units) and not fits


def _named(low: float, high: float, seen: str, told: str) -> list[str]:
    """Return the units of what is seen, or of what is told, that explain a ratio of both."""
    sizes = {f"{seen} in {unit}": size for unit, size in _UNITS.items()}
    return units_of(low, high, sizes | {f"{told} in {unit}": x for unit, x in _OTHER.items()})


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
