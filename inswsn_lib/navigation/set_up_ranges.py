"""Whether ranges or fixes have the unit, the frame and the clock of a reference."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.stats import t

from inswsn_lib.checks import Array
from inswsn_lib.errors import InswsnError
from inswsn_lib.navigation.recording_checks import FALSE_ALARM, Finding
from inswsn_lib.navigation.set_up_anchors import biases_alone, check_anchors
from inswsn_lib.navigation.signed_axes import judge_axes, signed_permutations, unit_of
from inswsn_lib.recordings.blocks import FEWEST, block_starts
from inswsn_lib.recordings.calibration import Calibration
from inswsn_lib.recordings.calibration_fit import calibrate
from inswsn_lib.recordings.calibration_start import fixes_of
from inswsn_lib.recordings.linear_fit import fit_linear
from inswsn_lib.recordings.recording import Fixes, Ranges, Recording
from inswsn_lib.recordings.reference_motion import ReferenceMotion

_BLOCK = 5.0  # s
_UNITS = {"feet": 3.2808, "inches": 39.37, "cm": 100.0, "mm": 1000.0, "km": 1e-3}
_ANCHORS = {"feet": 1 / 3.2808, "inches": 1 / 39.37, "cm": 1e-2, "mm": 1e-3}
_SIZE = (0.67, 1.5)  # of a unit that is right
_SCALE = 0.05  # too much in proportion to distance, that is let pass
_SCALE_TOLD = 0.1  # the widest bound with which a scale is told
_TURN, _LATE = 3.0, 0.02  # degrees, s: what is let pass
_TURN_TOLD, _LATE_TOLD = 20.0, 1.0  # the widest bounds with which they are told
_ARM, _ARM_TOLD = 0.5, 3.0  # times the noise: what is let pass, and the widest bound
_ANY = dict.fromkeys(
    ("clock", "turn", "shift", "lever arm", "bias"), 1e9
)  # bounds judge, and no limit
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
            yield from _moved(recording, "fixes", ())


def _unknown(name: str, subject: str, says: str) -> Finding:
    return Finding(name, subject, np.nan, np.nan, np.nan, None, says)


def _alone(ranges: Ranges) -> Iterator[Finding]:
    """Try units by how well ranges meet in one point; nothing else can be told."""
    some = ranges.part(end=float(ranges.time[min(len(ranges), _MOST) - 1]))
    noises = {}
    for unit, size in {"m": 1.0, **_UNITS}.items():
        scaled = replace(some, distance=some.distance / size)
        noises[unit] = _disagreement(scaled)
    best = min(noises, key=lambda unit: noises[unit])
    if np.isinf(noises[best]):
        yield _unknown("unit", "ranges", "too few are heard at a time to meet in a point")
    else:
        ratio = noises["m"] / max(noises[best], 1e-9)
        says = "they meet best in m" if best == "m" else f"they meet best if they are in {best}"
        yield Finding("unit", "ranges", ratio, 0, 2, ratio <= 2, says)
    try:
        found = calibrate(Recording("", ranges=ranges), ("bias",), block=_BLOCK)
    except InswsnError as error:
        yield _unknown("bias", "ranges", str(error).rstrip("."))
    else:
        yield from biases_alone(found)
    says = "without a reference a mirrored or turned frame of the anchors cannot be told"
    yield _unknown("axes", "ranges", says)
    yield _unknown("time", "ranges", "without a reference their clock cannot be told")


def _disagreement(ranges: Ranges) -> float:
    """Return by how much ranges of an interval do not meet, as a share of the median range."""
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
        yield _unknown("axes", who, "the reference has fewer coordinates than the anchors")
        return
    motion = ReferenceMotion(recording.reference, d)
    sight = _seen(recording, ranges, motion)
    if len(sight.ranges) < 2 * FEWEST:
        yield _unknown("unit", who, "they share too little time")
        return
    unit = _unit(sight)
    yield unit
    if not unit.fits:
        yield _unknown("axes", who, "nothing else is told before the unit is right")
        return
    axes = _axes(who, "the reference's", recording, ranges, motion)
    yield axes
    if axes.fits is False:
        return
    late = _late(recording, "ranges", ("clock", "bias"))
    yield late
    if late.fits is False:  # what moves is elsewhere, so that anchors seem wrong
        right = replace(ranges, time=ranges.time - late.value)
        recording = replace(recording, ranges=right)
        sight = _seen(recording, right, motion)
    wrong: list[int] = []
    for finding, anchor in check_anchors(sight.ranges, sight.distance, sight.direction):
        yield finding
        wrong += [anchor] if finding.fits is False else []
    scale = _scale(sight)
    yield scale
    # what grows with distance would be taken for a lever arm, or a shift
    more = ("scale",) if scale.fits is False else ()
    recording = replace(recording, ranges=_without(recording.ranges, wrong))
    if motion.has_attitude:
        yield _lever_arm(recording, more)
    yield from _moved(recording, "ranges", more)


def _seen(recording: Recording, ranges: Ranges, motion: ReferenceMotion) -> _Sight:
    rows = motion.covers(ranges.time) & np.isfinite(ranges.distance)
    kept = replace(
        ranges,
        time=ranges.time[rows],
        anchor=ranges.anchor[rows],
        distance=ranges.distance[rows],
    )
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
        return _unknown("axes", who, "too few fixes while the reference is there")
    track = motion.carried(time, np.asarray(recording.lever_arm, dtype=float)) - motion.middle
    matrices = signed_permutations(motion.d)
    misfits = np.empty((len(time), len(matrices)))
    for k, P in enumerate(matrices):
        off = place - track @ P.T
        misfits[:, k] = np.linalg.norm(off - np.median(off, axis=0), axis=1)
    return judge_axes(who, what, misfits, starts, matrices)


def _calibrated(recording: Recording, source: str, kinds: tuple[str, ...]) -> Calibration | str:
    try:
        return calibrate(recording, kinds, source=source, block=_BLOCK, limits=_ANY)
    except InswsnError as error:
        return str(error).rstrip(".")


def _late(recording: Recording, source: str, kinds: tuple[str, ...]) -> Finding:
    who = f"{source} and reference"
    found = _calibrated(recording, source, kinds)
    if isinstance(found, str):
        return _unknown("time", who, found)
    value, deviation = found.told["clock"]
    bound = _LATE + float(t.isf(FALSE_ALARM / 2, found.blocks - 1)) * deviation
    late = "late" if value > 0 else "early"
    fits = abs(value) <= bound
    says = f"stamps of {source} are {abs(value):.2g} s {late} (± {deviation:.2g} s)"
    if fits and bound > _LATE_TOLD:
        return Finding("time", who, value, -bound, bound, None, "too little moves to tell")
    return Finding("time", who, value, -bound, bound, fits, says)


def _scale(sight: _Sight) -> Finding:
    """Fit what ranges have too much in proportion to distance, beside each anchor's bias."""
    heard = np.unique(sight.ranges.anchor)
    own = (sight.ranges.anchor[:, None] == heard).astype(float)
    off = sight.ranges.distance - sight.distance
    columns = np.column_stack([sight.distance, own])
    line = fit_linear(columns, off, sight.ranges.time, _BLOCK)
    who = "ranges and reference"
    if line is None or not np.isfinite(line.deviations[0]):
        return _unknown("scale", who, "distances change too little to tell a scale by")
    value = float(line.values[0])
    bound = _SCALE + float(t.isf(FALSE_ALARM / 2, line.blocks - 1)) * float(line.deviations[0])
    if bound > _SCALE_TOLD:
        return _unknown("scale", who, "distances change too little to tell a scale by")
    fits = abs(value) <= bound
    says = f"ranges grow by {1 + value:.3g} m for each metre (± {line.deviations[0]:.2g})"
    return Finding("scale", who, 1 + value, 1 - bound, 1 + bound, fits, says)


def _without(ranges: Ranges | None, wrong: list[int]) -> Ranges:
    """Return ranges to anchors that are right."""
    assert ranges is not None
    right = ~np.isin(ranges.anchor, wrong)
    return replace(
        ranges,
        time=ranges.time[right],
        anchor=ranges.anchor[right],
        distance=ranges.distance[right],
    )


def _lever_arm(recording: Recording, more: tuple[str, ...]) -> Finding:
    """Judge where ranges see the tag, against where it is said to be; in a frame that is right."""
    who = "ranges and reference"
    found = _calibrated(recording, "ranges", ("clock", "lever arm", "bias", *more))
    if isinstance(found, str):
        return _unknown("lever arm", who, found)
    mine = [pair for name, pair in found.told.items() if name.startswith("lever arm")]
    off = np.abs([value for value, _ in mine] - recording.lever_arm[: len(mine)])
    q = float(t.isf(FALSE_ALARM / (2 * len(mine)), found.blocks - 1))
    bounds = _ARM * found.after + q * np.array([deviation for _, deviation in mine])
    worst = int(np.argmax(off / bounds))
    value, bound = float(off[worst]), float(bounds[worst])
    if bounds.max() > _ARM_TOLD * found.after and value <= bound:
        return Finding("lever arm", who, value, 0, bound, None, "too little turns to tell")
    where = ", ".join(f"{arm:.2g} ± {deviation:.2g}" for arm, deviation in mine)
    says = f"by ranges the tag is at ({where}) m in the axes of the body"
    return Finding("lever arm", who, value, 0, bound, value <= bound, says)


def _moved(recording: Recording, source: str, more: tuple[str, ...]) -> Iterator[Finding]:
    """Judge how the reference is turned and shifted against anchors that are right, or fixes."""
    who = f"{source} and reference"
    kinds: tuple[str, ...] = ("clock", "frame")
    if source == "ranges":
        kinds = ("clock", "frame", "bias", *more)
    found = _calibrated(recording, source, kinds)
    if isinstance(found, str):
        yield _unknown("frame", who, found)
        return
    if source == "fixes":
        yield _late(recording, source, kinds)
    q = float(t.isf(FALSE_ALARM / 6, found.blocks - 1))
    for kind, let, unit in (("turn", _TURN, "deg"), ("shift", 3 * found.after, "m")):
        factor = np.degrees(1.0) if kind == "turn" else 1.0
        mine = [pair for name, pair in found.told.items() if name.startswith(kind)]
        size = float(np.linalg.norm([value for value, _ in mine])) * factor
        worst = max(deviation for _, deviation in mine) * factor
        bound = let + q * worst * np.sqrt(len(mine))
        fits = size <= bound
        verb = "turned" if kind == "turn" else "shifted"
        says = f"the reference is {verb} by {size:.2g} {unit} (± {worst:.2g} {unit})"
        if fits and kind == "turn" and bound > _TURN_TOLD:
            yield Finding("frame", who, size, 0, float(bound), None, "too little moves to tell")
            continue
        yield Finding("frame", f"{who}, {kind}", size, 0, float(bound), fits, says)
