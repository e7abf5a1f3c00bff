"""Whether each anchor is where it is said to be, and whether its ranges are far too long."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from inswsn_lib.checks import Array
from inswsn_lib.errors import InswsnError
from inswsn_lib.logs.blocks import deviation_of
from inswsn_lib.logs.calibration import Calibration, fitted
from inswsn_lib.logs.explanations import quantile, told_within
from inswsn_lib.logs.findings import Finding, unknown
from inswsn_lib.logs.likeness import BLOCK
from inswsn_lib.logs.model import Model, Rows, State
from inswsn_lib.logs.reference_motion import ReferenceMotion
from inswsn_lib.streams import Ranges

_LET = 3.0  # times the noise of a range: a place or a bias that is let pass
_TOLD = 3.0  # times that: the widest bound with which they are told
_LEAST = 0.05  # m, of the noise
_UNTOLD = {
    "place": "the tag moves too little about it to tell where it is",
    "bias": "its ranges change too much for a bias to be told",
}


def check_anchors(
    ranges: Ranges, motion: ReferenceMotion, lever_arm: Array
) -> dict[int, list[Finding]]:
    """Return whether each anchor's place and bias are right, by the number of the anchor.

    Parameters
    ----------
    ranges : Ranges
        While the reference is there.
    motion : ReferenceMotion
    lever_arm : ndarray, (3,)
        m.
    """
    rows = Rows.of(ranges)
    first = State.nothing(rows, lever_arm)
    off = Model(motion, rows, []).residual(first)
    middles = {k: float(np.median(off[rows.which == k])) for k in np.unique(rows.which).tolist()}
    let, found = _LET * max(deviation_of(rows.level(off)), _LEAST), {}
    for k, name in ((k, ranges.names[k]) for k in middles):
        own = replace(rows, value=rows.value - _usual(middles, k)).part(rows.which == k)
        try:
            # where an anchor is, is told by how the track would have to be shifted
            place, bias = (fitted(Model(motion, own, [x]), first, BLOCK) for x in ("shift", "bias"))
        except InswsnError:
            seldom = "it is heard too seldom"
            found[k] = [unknown(kind, f"anchor {name}", seldom) for kind in _UNTOLD]
            continue
        pair = [
            _judged(kind, name, value, fit.deviations, fit.blocks, let, len(middles))
            for kind, value, fit in (("place", -place.values, place), ("bias", bias.values, bias))
        ]
        better = int(bias.after <= place.after)  # what leaves less is what is wrong
        if pair[better].fits is False:
            says = "another explanation fits better"
            pair[1 - better] = replace(pair[1 - better], fits=True, says=says)
        found[k] = pair
    if sum(any(each.fits is False for each in pair) for pair in found.values()) > len(found) / 2:
        return not_told(found)
    return found


def not_told(found: dict[int, list[Finding]]) -> dict[int, list[Finding]]:
    """Return that nothing is told of anchors, since the frame is wrong."""
    says = "most anchors seem to be elsewhere, so that it is the frame that is wrong"
    return {k: [replace(x, fits=None, says=says) for x in pair] for k, pair in found.items()}


def _usual(biases: dict[int, float], k: int) -> float:
    """Return the median of the biases of other anchors."""
    return float(np.median([bias for other, bias in biases.items() if other != k] or [0.0]))


def _judged(
    kind: str, name: str, values: Array, deviations: Array, blocks: int, let: float, many: int
) -> Finding:
    """Judge the displacement or the bias of one of many anchors."""
    d, worst, size = len(values), float(deviations.max()), float(np.linalg.norm(values))
    bound = let + quantile(blocks, many * d) * worst * float(np.sqrt(d))
    value = size if kind == "place" else float(values[0])
    fits = size <= bound
    if kind == "place":
        where = ", ".join(f"{x:.2g}" for x in values)
        wrong = f"by its ranges it is ({where}) m from where it is said to be (± {worst:.2g} m)"
        says = "it is where it is said to be" if fits else wrong
    else:
        why = "it is not in line of sight, or elsewhere" if value > 0 else "it is elsewhere"
        wrong = f"its ranges are {value:.2g} m longer than others (± {worst:.2g} m): {why}"
        says = "its ranges are as long as others" if fits else wrong
    low = 0.0 if kind == "place" else -bound
    found = Finding(kind, f"anchor {name}", value, low, bound, fits, says)
    return told_within(found, _TOLD * let, _UNTOLD[kind])


def biases_alone(found: Calibration) -> Iterator[Finding]:
    """Yield whether each anchor's bias, by ranges alone, is as those of the others."""
    let, biases = _LET * max(found.after, _LEAST), dict(enumerate(found.values.tolist()))
    for k, name in enumerate(found.names):
        value, deviation = np.array([biases[k] - _usual(biases, k)]), found.deviations[[k]]
        anchor = name.removeprefix("bias ")
        yield _judged("bias", anchor, value, deviation, found.blocks, let, len(biases))
