"""Whether each anchor is where it is said to be, and whether its ranges are far too long."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from scipy.stats import t

from inswsn_lib.calibration.blocks import FEWEST, block_starts
from inswsn_lib.calibration.results import Calibration
from inswsn_lib.calibration.robust_fit import covariance, deviation_of, fit
from inswsn_lib.checks import Array
from inswsn_lib.recordings.findings import FALSE_ALARM, Finding
from inswsn_lib.streams import Ranges

_BLOCK = 5.0  # s
_LET = 3.0  # times the noise of a range: a place or a bias that is let pass
_TOLD = 3.0  # times that: the widest bound with which they are told
_LEAST = 0.05  # m, of the noise


@dataclass(frozen=True, eq=False)
class _Anchor:
    """Ranges to one anchor by the places of the tag from it; it may be elsewhere, or biased."""

    apart: Array  # (n, d)
    distance: Array
    placed: bool  # whether it is its place that is unknown, else its bias

    def residual(self, state: Array) -> Array:
        if not self.placed:
            return np.asarray(self.distance - np.linalg.norm(self.apart, axis=1) - state[0])
        return np.asarray(self.distance - np.linalg.norm(self.apart - state, axis=1))

    def jacobian(self, state: Array) -> Array:
        if not self.placed:
            return -np.ones((len(self.apart), 1))
        apart = self.apart - state
        return np.asarray(apart / np.maximum(np.linalg.norm(apart, axis=1), 1e-9)[:, None])

    def moved(self, state: Array, by: Array) -> Array:
        return np.asarray(state + by)


@dataclass(frozen=True, eq=False)
class _Fitted:
    values: Array
    deviations: Array
    noise: float
    blocks: int


def check_anchors(ranges: Ranges, distance: Array, direction: Array) -> list[tuple[Finding, int]]:
    """Return whether each anchor's place and bias are right, and the number of the anchor.

    Parameters
    ----------
    ranges : Ranges
    distance : ndarray, (n,)
        From the anchor, by the reference.
    direction : ndarray, (n, d)
        From the anchor to the tag.
    """
    heard = np.unique(ranges.anchor)
    off = ranges.distance - distance
    middles = {int(k): float(np.median(off[ranges.anchor == k])) for k in heard}
    own = np.array([middles[int(k)] for k in ranges.anchor])
    noise = max(deviation_of(off - own), _LEAST)
    let = _LET * noise
    found: list[tuple[Finding, int]] = []
    for k in heard:
        mine = ranges.anchor == k
        apart = direction[mine] * distance[mine, None]
        others = [value for other, value in middles.items() if other != k]
        usual = float(np.median(others)) if others else 0.0
        name, many = ranges.names[k], len(heard)
        time, long = ranges.time[mine], ranges.distance[mine] - usual
        place = _fitted(apart, long, time, noise, placed=True)
        bias = _fitted(apart, long, time, noise, placed=False)
        findings = [_placed(name, place, let, many), _biased(name, bias, let, many)]
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
    says = "most anchors seem to be elsewhere, so that it is the frame that is wrong"
    return [(replace(each, fits=None, says=says), k) for each, k in found]


def _fitted(
    apart: Array, distance: Array, time: Array, noise: float, *, placed: bool
) -> _Fitted | None:
    starts = block_starts(time, _BLOCK)
    count = apart.shape[1] if placed else 1
    if len(starts) < FEWEST or len(time) < 2 * count + 2:
        return None
    problem, first = _Anchor(apart, distance, placed), np.zeros(count)
    size = np.full(count, noise)
    state, scale = fit(problem, first, noise, lambda _: size)
    found, lost = covariance(problem, state, scale, size, starts)
    deviations = np.sqrt(np.diag(found))
    deviations[lost] = np.inf
    return _Fitted(state, deviations, scale, len(starts))


def _placed(name: str, found: _Fitted | None, let: float, many: int) -> Finding:
    who = f"anchor {name}"
    if found is None:
        return Finding("place", who, np.nan, np.nan, np.nan, None, "it is heard too seldom")
    d = len(found.values)
    size = float(np.linalg.norm(found.values))
    worst = float(found.deviations.max())
    q = float(t.isf(FALSE_ALARM / (2 * many * d), found.blocks - 1))
    bound = let + q * worst * np.sqrt(d)
    if size > bound:
        where = ", ".join(f"{x:.2g}" for x in found.values)
        says = f"by its ranges it is ({where}) m from where it is said to be (± {worst:.2g} m)"
        return Finding("place", who, size, 0, bound, False, says)
    if bound > _TOLD * let:
        says = "the tag moves too little about it to tell where it is"
        return Finding("place", who, size, 0, bound, None, says)
    return Finding("place", who, size, 0, bound, True, "it is where it is said to be")


def _biased(name: str, found: _Fitted | None, let: float, many: int) -> Finding:
    who = f"anchor {name}"
    if found is None:
        return Finding("bias", who, np.nan, np.nan, np.nan, None, "it is heard too seldom")
    value, deviation = float(found.values[0]), float(found.deviations[0])
    q = float(t.isf(FALSE_ALARM / (2 * many), found.blocks - 1))
    bound = let + q * deviation
    fits = bool(abs(value) <= bound)
    if fits and bound > _TOLD * let:
        says = "its ranges change too much for a bias to be told"
        return Finding("bias", who, value, -bound, bound, None, says)
    says = "its ranges are as long as others" if fits else (
        f"its ranges are {value:.2g} m longer than others (± {deviation:.2g} m): "
        + ("it is not in line of sight, or elsewhere" if value > 0 else "it is elsewhere")
    )  # fmt: skip
    return Finding("bias", who, value, -bound, bound, fits, says)


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
        yield _biased(name.removeprefix("bias "), fitted, let, many)
