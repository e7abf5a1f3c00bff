"""Whether ranges or fixes have the unit, the frame and the clock of a reference."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.stats import t

from inswsn_lib.calibration.blocks import FEWEST, block_starts
from inswsn_lib.calibration.fit import calibrate
from inswsn_lib.calibration.linear_fit import fit_linear
from inswsn_lib.calibration.reference_motion import ReferenceMotion
from inswsn_lib.calibration.start import fixes_of
from inswsn_lib.checks import Array
from inswsn_lib.errors import InswsnError
from inswsn_lib.recordings.findings import FALSE_ALARM, Finding
from inswsn_lib.recordings.set_up_anchors import biases_alone, check_anchors
from inswsn_lib.recordings.set_up_frame import check_frame, on_time, unknown
from inswsn_lib.recordings.signed_axes import judge_axes, signed_permutations, unit_of
from inswsn_lib.streams import Fixes, Ranges, Recording

_BLOCK = 5.0  # s
_UNITS = {"feet": 3.2808, "inches": 39.37, "cm": 100.0, "mm": 1000.0, "km": 1e-3}
_ANCHORS = {"feet": 1 / 3.2808, "inches": 1 / 39.37, "cm": 1e-2, "mm": 1e-3}
_SIZE = (0.67, 1.5)  # of a unit that is right
_SCALE = 0.05  # too much in proportion to distance, that is let pass
_SCALE_TOLD = 0.1  # the widest bound with which a scale is told
_MOST = 4000  # ranges by which a unit is tried


@dataclass(frozen=True, eq=False)
class _Sight:
    """Ranges while the reference is there, with their distances by it."""

    ranges: Ranges
    distance: Array
    direction: Array  # from the anchor to the tag


def check_positions(recording: Recording) -> Iterator[Finding]:
    """Yield what can be found of ranges and fixes, by the reference where there is one."""
    if recording.ranges is not None and len(recording.ranges):
        if recording.reference is None:
            yield from _alone(recording.ranges)
        else:
            yield from _ranges(recording, recording.ranges)
    if recording.fixes is not None and recording.reference is not None:
        d = min(recording.fixes.position.shape[1], recording.reference.position.shape[1])
        motion = ReferenceMotion(recording.reference, d)
        axes = _axes("fixes and reference", "the fixes'", recording, recording.fixes, motion)
        yield axes
        if axes.fits is not False:
            late, recording = on_time(recording, "fixes", ("frame",))
            yield late
            yield from check_frame(recording, "fixes")


def _alone(ranges: Ranges) -> Iterator[Finding]:
    """Try units by how well ranges meet in one point; nothing else can be told."""
    some = ranges.part(end=float(ranges.time[min(len(ranges), _MOST) - 1]))
    noises = {}
    for unit, size in {"m": 1.0, **_UNITS}.items():
        scaled = replace(some, distance=some.distance / size)
        noises[unit] = _disagreement(scaled)
    best = min(noises, key=lambda unit: noises[unit])
    if np.isinf(noises[best]):
        yield unknown("unit", "ranges", "too few are heard at a time to meet in a point")
    else:
        ratio = noises["m"] / max(noises[best], 1e-9)
        says = "they meet best in m" if best == "m" else f"they meet best if they are in {best}"
        yield Finding("unit", "ranges", ratio, 0, 2, ratio <= 2, says)
    try:
        found = calibrate(Recording("", ranges=ranges), ("bias",), block=_BLOCK)
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
    d = ranges.anchors.shape[1]
    who = "ranges and reference"
    if recording.reference.position.shape[1] < d:
        yield unknown("axes", who, "the reference has fewer coordinates than the anchors")
        return
    motion = ReferenceMotion(recording.reference, d)
    sight = _seen(recording, ranges, motion)
    if len(sight.ranges) < 2 * FEWEST:
        yield unknown("unit", who, "they share too little time")
        return
    unit = _unit(sight)
    yield unit
    if not unit.fits:
        yield unknown("axes", who, "nothing else is told before the unit is right")
        return
    axes = _axes(who, "the reference's", recording, ranges, motion)
    yield axes
    if axes.fits is False:
        return
    late, recording = on_time(recording, "ranges", ("bias",))
    yield late
    assert recording.ranges is not None
    sight = _seen(recording, recording.ranges, motion)
    wrong: list[int] = []
    for finding, anchor in check_anchors(sight.ranges, sight.distance, sight.direction):
        yield finding
        wrong += [anchor] if finding.fits is False else []
    scale = _scale(sight)
    yield scale
    # what grows with distance would be taken for a lever arm, or a shift
    more = ("bias", "scale") if scale.fits is False else ("bias",)
    recording = replace(recording, ranges=_without(recording.ranges, wrong))
    yield from check_frame(recording, "ranges", more)


def _seen(recording: Recording, ranges: Ranges, motion: ReferenceMotion) -> _Sight:
    rows = motion.covers(ranges.time) & np.isfinite(ranges.distance)
    kept = ranges.kept(rows)
    tag = motion.carried(kept.time, np.asarray(recording.lever_arm, dtype=float))
    apart = tag - kept.anchors[kept.anchor]
    distance = np.maximum(np.linalg.norm(apart, axis=1), 1e-9)
    return _Sight(kept, distance, apart / distance[:, None])


def _unit(sight: _Sight) -> Finding:
    """Compare ranges with distances; no chance makes the median ratio so wrong."""
    ratio = float(np.median(sight.ranges.distance / sight.distance))
    fits = _SIZE[0] <= ratio <= _SIZE[1]
    units = [f"ranges in {unit}" for unit in unit_of(ratio, _UNITS)]
    units += [f"anchors in {unit}" for unit in unit_of(ratio, _ANCHORS)]
    says = "ranges are as long as the distances" if fits else (
        f"ranges are {ratio:.3g} times the distances" + (f": {', '.join(units)}" if units else "")
    )  # fmt: skip
    return Finding("unit", "ranges and reference", ratio, *_SIZE, fits, says)


def _axes(
    who: str, what: str, recording: Recording, source: Ranges | Fixes, motion: ReferenceMotion
) -> Finding:
    """Compare fixes with the track, its axes exchanged and reversed, and shifted as is best."""
    fixes = fixes_of(source) if isinstance(source, Ranges) else source
    there = np.isfinite(fixes.position).all(axis=1) & motion.covers(fixes.time)
    time, place = fixes.time[there], fixes.position[there, : motion.d]
    starts: NDArray[np.intp] = block_starts(time, _BLOCK) if len(time) else np.arange(0)
    if len(starts) < FEWEST:
        return unknown("axes", who, "too few fixes while the reference is there")
    track = motion.carried(time, np.asarray(recording.lever_arm, dtype=float)) - motion.middle
    matrices = signed_permutations(motion.d)
    misfits = np.empty((len(time), len(matrices)))
    for k, P in enumerate(matrices):
        off = place - track @ P.T
        misfits[:, k] = np.linalg.norm(off - np.median(off, axis=0), axis=1)
    return judge_axes(who, what, misfits, starts, matrices)


def _scale(sight: _Sight) -> Finding:
    """Fit what ranges have too much in proportion to distance, beside each anchor's bias."""
    heard = np.unique(sight.ranges.anchor)
    own = (sight.ranges.anchor[:, None] == heard).astype(float)
    off = sight.ranges.distance - sight.distance
    columns = np.column_stack([sight.distance, own])
    line = fit_linear(columns, off, sight.ranges.time, _BLOCK)
    who = "ranges and reference"
    if line is None or not np.isfinite(line.deviations[0]):
        return unknown("scale", who, "distances change too little to tell a scale by")
    value = float(line.values[0])
    bound = _SCALE + float(t.isf(FALSE_ALARM / 2, line.blocks - 1)) * float(line.deviations[0])
    if bound > _SCALE_TOLD:
        return unknown("scale", who, "distances change too little to tell a scale by")
    fits = bool(abs(value) <= bound)
    says = f"ranges grow by {1 + value:.3g} m for each metre (± {line.deviations[0]:.2g})"
    return Finding("scale", who, 1 + value, 1 - bound, 1 + bound, fits, says)


def _without(ranges: Ranges | None, wrong: list[int]) -> Ranges:
    """Return ranges to anchors that are right."""
    assert ranges is not None
    return ranges.kept(~np.isin(ranges.anchor, wrong))
