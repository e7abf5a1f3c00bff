"""Whether each anchor is where it is said to be, and whether its ranges are far too long."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from scipy.stats import t

from inswsn_lib.checks import Array
from inswsn_lib.logs.blocks import FEWEST, block_starts
from inswsn_lib.logs.findings import FALSE_ALARM, Finding, unknown
from inswsn_lib.logs.likeness import BLOCK
from inswsn_lib.logs.model import Model, Rows, State
from inswsn_lib.logs.reference_motion import ReferenceMotion
from inswsn_lib.logs.results import Calibration
from inswsn_lib.logs.robust_fit import covariance, deviation_of, fit
from inswsn_lib.streams import Ranges

_LET = 3.0  # times the noise of a range: a place or a bias that is let pass
_TOLD = 3.0  # times that: the widest bound with which they are told
_LEAST = 0.05  # m, of the noise
#: What is said of anchors where the frame is wrong
FRAME = "most anchors seem to be elsewhere, so that it is the frame that is wrong"
_UNTOLD = {
    "place": "the tag moves too little about it to tell where it is",
    "bias": "its ranges change too much for a bias to be told",
}


@dataclass(frozen=True, eq=False)
class _Fitted:
    values: Array
    deviations: Array
    noise: float
    blocks: int


def check_anchors(
    ranges: Ranges, motion: ReferenceMotion, lever_arm: Array
) -> list[tuple[Finding, int]]:
    """Return whether each anchor's place and bias are right, and the number of the anchor.

    Parameters
    ----------
    ranges : Ranges
        While the reference is there.
    motion : ReferenceMotion
    lever_arm : ndarray, (3,)
        m.
    """
    heard = np.unique(ranges.anchor)
    rows = Rows.of(ranges)
    first = State.nothing(rows, lever_arm)
    off = Model(motion, rows, []).residual(first)
    middles = {int(k): float(np.median(off[ranges.anchor == k])) for k in heard}
    own = np.array([middles[int(k)] for k in ranges.anchor])
    noise = max(deviation_of(off - own), _LEAST)
    let = _LET * noise
    found: list[tuple[Finding, int]] = []
    for k in heard:
        mine = ranges.anchor == k
        others = [value for other, value in middles.items() if other != k]
        usual = float(np.median(others)) if others else 0.0
        name, many = ranges.names[k], len(heard)
        own_rows = replace(rows, value=rows.value - usual).part(mine)
        # where an anchor is, is told by how the track would have to be shifted
        place = _fitted(Model(motion, own_rows, ["shift"]), first, noise)
        bias = _fitted(Model(motion, own_rows, ["bias"]), first, noise)
        findings = [
            _judged("place", name, place, let, many), _judged("bias", name, bias, let, many)
        ]  # fmt: skip
        if place and bias and any(each.fits is False for each in findings):
            # what leaves less is what is wrong
            other = int(place.noise < bias.noise)
            if findings[1 - other].fits is False:
                says = "another explanation fits better"
                findings[other] = replace(findings[other], fits=True, says=says)
        found += [(each, int(k)) for each in findings]
    suspects = {k for each, k in found if each.fits is False}
    if len(suspects) <= len(heard) / 2:
        return found
    return [(replace(each, fits=None, says=FRAME), k) for each, k in found]


def _fitted(model: Model, first: State, noise: float) -> _Fitted | None:
    time, count = model.rows.time, len(model.names)
    starts = block_starts(time, BLOCK)
    if len(starts) < FEWEST or len(time) < 2 * count + 2:
        return None
    size = np.full(count, noise)
    state, scale = fit(model, first, noise, lambda _: size)
    found, lost = covariance(model, state, scale, size, starts)
    deviations = np.sqrt(np.diag(found))
    deviations[lost] = np.inf
    values = -state.shift if "shift" in model.kinds else state.bias[model.heard]
    return _Fitted(values, deviations, scale, len(starts))


def _judged(kind: str, name: str, found: _Fitted | None, let: float, many: int) -> Finding:
    """Judge the displacement or the bias of an anchor."""
    who, place = f"anchor {name}", kind == "place"
    if found is None:
        return unknown(kind, who, "it is heard too seldom")
    d, worst = len(found.values), float(found.deviations.max())
    value = float(np.linalg.norm(found.values) if place else found.values[0])
    bound = let + float(t.isf(FALSE_ALARM / (2 * many * d), found.blocks - 1)) * worst * np.sqrt(d)
    fits: bool | None = bool(abs(value) <= bound)
    if not fits and place:
        where = ", ".join(f"{x:.2g}" for x in found.values)
        says = f"by its ranges it is ({where}) m from where it is said to be (± {worst:.2g} m)"
    elif not fits:
        why = "it is not in line of sight, or elsewhere" if value > 0 else "it is elsewhere"
        says = f"its ranges are {value:.2g} m longer than others (± {worst:.2g} m): {why}"
    elif bound > _TOLD * let:
        fits, says = None, _UNTOLD[kind]
    else:
        says = "it is where it is said to be" if place else "its ranges are as long as others"
    return Finding(kind, who, value, 0 if place else -bound, float(bound), fits, says)


def biases_alone(found: Calibration) -> Iterator[Finding]:
    """Yield whether each anchor's bias, by ranges alone, is as those of the others."""
    let, many = _LET * max(found.after, _LEAST), len(found.names)
    for name, (value, deviation) in found.told.items():
        others = [other for each, (other, _) in found.told.items() if each != name]
        fitted = _Fitted(
            np.array([value - float(np.median(others))]),
            np.array([deviation]),
            found.after,
            found.blocks,
        )
        yield _judged("bias", name.removeprefix("bias "), fitted, let, many)
