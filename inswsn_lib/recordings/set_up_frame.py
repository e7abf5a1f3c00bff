"""Whether clock, frame and lever arm of ranges or fixes are those of the reference."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
from scipy.stats import t

from inswsn_lib.calibration.fit import calibrate
from inswsn_lib.calibration.results import Calibration
from inswsn_lib.errors import InswsnError
from inswsn_lib.recordings.findings import FALSE_ALARM, Finding
from inswsn_lib.streams import Recording

_BLOCK = 5.0  # s
_TURN, _LATE, _SHIFT = 3.0, 0.02, 3.0  # degrees, s, times the noise: what is let pass
_TURN_TOLD, _LATE_TOLD = 20.0, 1.0  # the widest bounds with which they are told
_ARM, _ARM_TOLD = 0.5, 3.0  # times the noise: what is let pass, and the widest bound
_UNJUDGED = ("clock", "turn", "shift", "lever arm", "bias", "scale")
_ANY = dict.fromkeys(_UNJUDGED, 1e9)  # bounds judge, and no limit
_REACH, _NEAR = 5.0, 0.3  # s, of clocks that are tried, first and when the clock is right


def unknown(name: str, subject: str, says: str) -> Finding:
    """Return that the data cannot tell something, and why."""
    return Finding(name, subject, np.nan, np.nan, np.nan, None, says)


def on_time(recording: Recording, source: str, kinds: tuple[str, ...]) -> tuple[Finding, Recording]:
    """Return whether stamps are by the reference's clock, and a recording whose stamps are.

    Parameters
    ----------
    recording : Recording
    source : str
        ``"ranges"`` or ``"fixes"``.
    kinds : tuple of str
        What else is estimated.
    """
    who = f"{source} and reference"
    found = _calibrated(recording, source, ("clock", *kinds), _REACH)
    if isinstance(found, str):
        return unknown("time", who, found), recording
    value, deviation = found.told["clock"]
    bound = _LATE + float(t.isf(FALSE_ALARM / 2, found.blocks - 1)) * deviation
    fits: bool | None = bool(abs(value) <= bound)
    late = "late" if value > 0 else "early"
    says = f"stamps of {source} are {abs(value):.2g} s {late} (± {deviation:.2g} s)"
    if fits and bound > _LATE_TOLD:
        fits, says = None, "too little moves to tell"
    if fits is False:  # what moves is elsewhere, so that anchors or the frame seem wrong
        stream = getattr(recording, source)
        right = {source: replace(stream, time=stream.time - value)}
        recording = replace(recording, **right)
    return Finding("time", who, value, -bound, bound, fits, says), recording


def check_frame(recording: Recording, source: str, more: tuple[str, ...] = ()) -> Iterator[Finding]:
    """Yield how the reference is turned and shifted, and where on the body the tag is.

    Ranges that see another point of the body make the reference seem shifted, and a shift makes the
    lever arm seem wrong: where both do, the one is wrong that leaves less.

    Parameters
    ----------
    recording : Recording
    source : str
        ``"ranges"``, to anchors that are right, or ``"fixes"``.
    more : tuple of str
        What else is estimated.
    """
    who = f"{source} and reference"
    reference = recording.reference
    assert reference is not None
    framed = _calibrated(recording, source, ("clock", "frame", *more))
    if isinstance(framed, str):
        frame = [unknown("frame", who, framed)]
    else:
        frame = [_frame(who, framed, kind) for kind in ("turn", "shift")]
    if reference.attitude is None:
        yield from frame
        return
    held = _calibrated(recording, source, ("clock", "lever arm", *more))
    if isinstance(held, str):
        yield from (*frame, unknown("lever arm", who, held))
        return
    arm = _lever_arm(who, held, recording)
    if arm.fits is False and any(each.fits is False for each in frame):
        assert not isinstance(framed, str)
        says = "another explanation fits better"
        if held.after < framed.after:
            frame = [replace(each, fits=True, says=says) for each in frame]
        else:
            arm = replace(arm, fits=True, says=says)
    yield from (*frame, arm)


def _calibrated(
    recording: Recording, source: str, kinds: tuple[str, ...], reach: float = _NEAR
) -> Calibration | str:
    """Return a calibration, or why there is none."""
    try:
        return calibrate(recording, kinds, source=source, block=_BLOCK, reach=reach, limits=_ANY)
    except InswsnError as error:
        return str(error).rstrip(".")


def _frame(who: str, found: Calibration, kind: str) -> Finding:
    factor, unit, verb = (np.degrees(1.0), "deg", "turned") if kind == "turn" else (
        1.0, "m", "shifted"
    )  # fmt: skip
    let = _TURN if kind == "turn" else _SHIFT * found.after
    mine = np.array([pair for name, pair in found.told.items() if name.startswith(kind)]) * factor
    size, worst = float(np.linalg.norm(mine[:, 0])), float(mine[:, 1].max())
    q = float(t.isf(FALSE_ALARM / (4 * len(mine)), found.blocks - 1))
    bound = let + q * worst * float(np.sqrt(len(mine)))
    fits: bool | None = size <= bound
    says = f"the reference is {verb} by {size:.2g} {unit} (± {worst:.2g} {unit})"
    if fits and kind == "turn" and bound > _TURN_TOLD:
        fits, says = None, "too little moves to tell"
    return Finding("frame", f"{who}, {kind}", size, 0, bound, fits, says)


def _lever_arm(who: str, found: Calibration, recording: Recording) -> Finding:
    """Judge where ranges or fixes see the tag, against where it is said to be."""
    mine = np.array([p for name, p in found.told.items() if name.startswith("lever arm")])
    off = np.abs(mine[:, 0] - recording.lever_arm[: len(mine)])
    q = float(t.isf(FALSE_ALARM / (2 * len(mine)), found.blocks - 1))
    bounds = _ARM * found.after + q * mine[:, 1]
    worst = int(np.argmax(off / bounds))
    value, bound = float(off[worst]), float(bounds[worst])
    fits: bool | None = value <= bound
    where = ", ".join(f"{arm:.2g} ± {deviation:.2g}" for arm, deviation in mine)
    says = f"by {who.partition(' ')[0]} the tag is at ({where}) m in the axes of the body"
    if fits and bounds.max() > _ARM_TOLD * found.after:
        fits, says = None, "too little turns to tell"
    return Finding("lever arm", who, value, 0, bound, fits, says)
