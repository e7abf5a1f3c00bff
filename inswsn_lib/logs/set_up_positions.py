"""Whether ranges or fixes go with a reference, and anchors are where they are said to be."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.stats import t

from inswsn_lib.checks import Array, Mask
from inswsn_lib.errors import InswsnError
from inswsn_lib.logs.blocks import FEWEST, block_starts, deviation_of
from inswsn_lib.logs.calibration import Calibration, calibrate, fitted, fixes_of
from inswsn_lib.logs.findings import FALSE_ALARM, Finding, unknown
from inswsn_lib.logs.likeness import BLOCK, Likeness, late, units_of
from inswsn_lib.logs.model import KINDS, Model, ReferenceMotion, Rows, State
from inswsn_lib.logs.window_fits import PERIODS, enough_ranges, fit_windows, window_ranges
from inswsn_lib.streams import Fixes, Ranges, Recording, Reference

_UNITS = {"feet": 3.2808, "inches": 39.37, "cm": 100.0, "mm": 1000.0, "km": 1e-3}
_OTHER = {unit: 1 / size for unit, size in _UNITS.items() if unit != "km"}
_SIZE = (0.67, 1.5)  # of a unit that is right
_AS_GOOD = 1.5  # times the noise that is left without wrong anchors: then it is the frame
_LET, _WIDEST = 3.0, 3.0  # times the noise of a range: a place or a bias that is let pass; times
# that: the bound with which they are told
_NOISE = 0.05  # m, the least
_UNTOLD = {
    "place": "the tag moves too little about it to tell where it is",
    "bias": "its ranges change too much for a bias to be told",
}
_MOST = 4000  # ranges by which a unit is tried, and fixes by which axes are
# What is let pass, and the widest bounds that tell: s, degrees, times the noise, times the noise,
# and of a distance
_PASSED = {"clock": 0.02, "turn": 3.0, "shift": 3.0, "lever arm": 0.5, "scale": 0.05}
_TOLD = {"clock": 1.0, "turn": 20.0, "shift": np.inf, "lever arm": 3.0, "scale": 0.1}
_ANY = dict.fromkeys(KINDS, 1e9)
_NEAR = 1.5  # s, of clocks that are tried; farther ones are found before
_BLOCKS, _CORRELATED = (BLOCK, 10.0, 20.0, 40.0), 0.3  # s, and of means of blocks on end
_FITTED = 8000  # rows that are fitted
_AS_WELL = -2 * float(np.log(FALSE_ALARM))  # of twice a logarithm of likelihoods
_NAMES = {"clock": "a late clock", "frame": "a turned or shifted reference",
          "lever arm": "another lever arm", "scale": "a scale of ranges"}  # fmt: skip


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
        yield from _biases(found)
    says = "without a reference a mirrored or turned frame of the anchors cannot be told"
    yield unknown("axes", "ranges", says)
    yield unknown("time", "ranges", "without a reference their clock cannot be told")


def _disagreement(ranges: Ranges) -> float:
    """Return by how much ranges of an interval do not meet, m; infinite if too few are heard."""
    ranges = ranges.kept(np.isfinite(ranges.distance))
    if len(ranges) < FEWEST:
        return np.inf
    fit = fit_windows(window_ranges(ranges, enough_ranges(ranges) or PERIODS[-1]))
    return fit.noise if np.sum(~fit.bad) >= FEWEST else np.inf


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
    anchors = _anchors(_seen(right, motion), motion, arm)
    wrong = [k for k, pair in anchors.items() if any(each.fits is False for each in pair)]
    findings = list(told.findings())
    if wrong:
        others = replace(recording, ranges=ranges.kept(~np.isin(ranges.anchor, wrong)))
        without = Explanations(others, "ranges", clock)
        turned = any(each.name == "frame" and each.fits is False for each in findings)
        if turned and told.noise <= _AS_GOOD * without.noise:
            anchors = _not_told(anchors)
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


def _anchors(ranges: Ranges, motion: ReferenceMotion, lever_arm: Array) -> dict[int, list[Finding]]:
    """Return whether each anchor's place and bias are right, by the number of the anchor."""
    rows = Rows.of(ranges)
    first = State.nothing(rows, lever_arm)
    off = Model(motion, rows, []).residual(first)
    middles = {k: float(np.median(off[rows.which == k])) for k in np.unique(rows.which).tolist()}
    let, found = _LET * max(deviation_of(rows.level(off)), _NOISE), {}
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
            _anchor(kind, name, value, fit.deviations, fit.blocks, let, len(middles))
            for kind, value, fit in (("place", -place.values, place), ("bias", bias.values, bias))
        ]
        better = int(bias.after <= place.after)  # what leaves less is what is wrong
        if pair[better].fits is False:
            says = "another explanation fits better"
            pair[1 - better] = replace(pair[1 - better], fits=True, says=says)
        found[k] = pair
    if sum(any(each.fits is False for each in pair) for pair in found.values()) > len(found) / 2:
        return _not_told(found)
    return found


def _not_told(found: dict[int, list[Finding]]) -> dict[int, list[Finding]]:
    """Return that nothing is told of anchors, since the frame is wrong."""
    says = "most anchors seem to be elsewhere, so that it is the frame that is wrong"
    return {k: [replace(x, fits=None, says=says) for x in pair] for k, pair in found.items()}


def _usual(biases: dict[int, float], k: int) -> float:
    """Return the median of the biases of other anchors."""
    return float(np.median([bias for other, bias in biases.items() if other != k] or [0.0]))


def _anchor(
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
    return told_within(found, _WIDEST * let, _UNTOLD[kind])


def _biases(found: Calibration) -> Iterator[Finding]:
    """Yield whether each anchor's bias, by ranges alone, is as those of the others."""
    let, biases = _LET * max(found.after, _NOISE), dict(enumerate(found.values.tolist()))
    for k, name in enumerate(found.names):
        value, deviation = np.array([biases[k] - _usual(biases, k)]), found.deviations[[k]]
        anchor = name.removeprefix("bias ")
        yield _anchor("bias", anchor, value, deviation, found.blocks, let, len(biases))


class _Fit(NamedTuple):
    found: Calibration | None
    residual: Array
    says: str  # why nothing is found


class Explanations:
    """Which of clock, frame, lever arm and scale explain why ranges or fixes do not fit.

    Each set of them is fitted at once by `calibrate`, beside a bias of each anchor. Sets are
    compared by the loss of their residuals, penalised for their freedom as by Schwarz (1978), with
    as many rows as would be independent: what explains most is taken first, and what another one
    makes needless is given back. Stamps of the source were late by the clock, s, and are no more.
    """

    def __init__(self, recording: Recording, source: str, clock: float) -> None:
        stream, reference = getattr(recording, source), recording.reference
        assert reference is not None
        if len(stream) > _FITTED:
            some = np.random.default_rng(0).choice(len(stream), _FITTED, replace=False)
            stream = stream.kept(np.isin(np.arange(len(stream)), some))
        self.recording = replace(recording, **{source: stream})
        self.source, self.clock = source, clock
        arm = ("lever arm",) if reference.attitude is not None else ()
        self.kinds: tuple[str, ...] = ("clock", "frame", *arm)
        self._also: tuple[str, ...] = ()
        if source == "ranges":
            self.kinds, self._also = (*self.kinds, "scale"), ("bias",)
        rows = Rows.of(stream)
        motion = ReferenceMotion(reference, rows.dimension)
        self._model = Model(motion, rows.part(motion.covers(rows.time, 2 * _NEAR)), [])
        self._block, self._wider = BLOCK, 1.0
        self._fits: dict[frozenset[str], _Fit] = {}
        self._as_well: dict[str, list[str]] = {}
        self.chosen: tuple[str, ...] = ()
        if len(self._model.rows.time):
            self._measure(self.fit(*self.kinds).residual)
            self._fits.clear()
            self._choose()

    def _parts(self, values: Array, seconds: float) -> Iterator[tuple[Array, NDArray[np.intp]]]:
        """Yield the values of each anchor, and where its blocks begin."""
        rows = self._model.rows
        for k in np.unique(rows.which):
            mine = rows.which == k
            yield values[mine], block_starts(rows.time[mine], seconds)

    def _measure(self, miss: Array) -> None:
        """Find how long blocks are whose means are hardly correlated.

        By what is left of the correlation (a process of the first order, estimated too small by one
        over the number of blocks) variances are larger.
        """
        for self._block in _BLOCKS:
            both, own = 0.0, 0.0
            for part, starts in self._parts(np.arctan2(miss, deviation_of(miss)), self._block):
                means = np.add.reduceat(part, starts) / np.diff(starts, append=len(part))
                means = means - means.mean()
                both, own = both + float(means[1:] @ means[:-1]), own + float(means @ means)
            related = float(np.clip(both / max(own, 1e-300) + 1 / len(means), 0.0, 0.8))
            self._wider = (1 + related) / (1 - related)
            if related < _CORRELATED:
                break

    def fit(self, *kinds: str) -> _Fit:
        """Return the fit of some kinds, beside a bias of each anchor."""
        key = frozenset(kinds)
        if key not in self._fits:
            self._fits[key] = self._fitted(tuple(k for k in self.kinds if k in key))
        return self._fits[key]

    def _fitted(self, kinds: tuple[str, ...]) -> _Fit:
        state = State.nothing(self._model.rows, np.array(self.recording.lever_arm, dtype=float))
        names, found, says = (*kinds, *self._also), None, ""
        try:
            if names:
                found = calibrate(
                    self.recording, names, source=self.source, block=self._block, reach=_NEAR,
                    limits=_ANY,
                )  # fmt: skip
                state = found.state
        except InswsnError as error:
            says = str(error).rstrip(".")
        return _Fit(found, self._model.residual(state), says)

    def _choose(self) -> None:
        while True:
            gains = {
                kind: self._gain(self.fit(*self.chosen), self.fit(*self.chosen, kind))
                for kind in self.kinds
                if kind not in self.chosen
            }
            best = max(gains, key=lambda kind: gains[kind], default="")
            if not best or gains[best] <= 0:
                break
            self.chosen = (*self.chosen, best)
            least = max(0.0, gains[best] - _AS_WELL)
            self._as_well[best] = [k for k, gain in gains.items() if k != best and gain > least]
        for kind in self.chosen[:-1]:
            others = tuple(other for other in self.chosen if other != kind)
            if self._gain(self.fit(*others), self.fit(*self.chosen)) <= 0:
                self.chosen = others

    def _gain(self, less: _Fit, more: _Fit) -> float:
        """Return by how much more likely the freer of two fits is, twice its logarithm."""
        if more.found is None:
            return -np.inf
        noise = max(min(deviation_of(each.residual) for each in (less, more)), 1e-6)
        old, new = (
            2 * float((np.sqrt(1 + (each.residual / noise) ** 2) - 1).sum())
            for each in (less, more)
        )
        effect = self._effect(more.residual / noise)
        rows = max(len(more.residual) / effect, 2.0)
        free = len(more.found.names) - (len(less.found.names) if less.found else 0)
        return float((old - new) / effect - free * np.log(rows))

    def _effect(self, miss: Array) -> float:
        """Return how many rows tell as much as one that is independent, by sums over blocks."""
        total, count = 0.0, 0.0
        for part, starts in self._parts(miss / np.sqrt(1 + miss**2), self._block):
            own = part - part.mean()
            total += float(np.sum(np.add.reduceat(own, starts) ** 2))
            count += float(own @ own)
        return max(total / max(count, 1e-300), 1.0)

    @property
    def noise(self) -> float:
        """The deviation of what is left by the explanations that are chosen, m."""
        found = self.fit(*self.chosen).found
        return np.inf if found is None else found.after

    @property
    def late(self) -> float:
        """By how much stamps of the source are still late, s, if that is what explains."""
        found = self.fit(*self.chosen).found
        return found.told["clock"][0] if found and "clock" in self.chosen else 0.0

    def findings(self) -> Iterator[Finding]:
        """Yield whether each kind is as it should be, beside those that explain."""
        for kind in self.kinds if len(self._model.rows.time) else ():
            fit, who = self.fit(*self.chosen, kind), f"{self.source} and reference"
            if fit.found is None:
                yield unknown("time" if kind == "clock" else kind, who, fit.says)
                continue
            explains = kind in self.chosen or (kind == "clock" and self.clock != 0)
            others = [k for k in self._as_well.get(kind, []) if k not in self.chosen]
            also = f"; {' or '.join(_NAMES[k] for k in others)} explains it as well"
            found = replace(fit.found, covariance=self._wider * fit.found.covariance)
            for each in self._judged(kind, who, found):
                if each.fits is False and not explains:
                    yield replace(each, fits=True, says="other explanations fit as well")
                elif each.fits is False and others:
                    yield replace(each, says=each.says + also)
                else:
                    yield each

    def _judged(self, kind: str, who: str, found: Calibration) -> Iterator[Finding]:
        if kind == "clock":
            value, deviation = found.told[kind]
            stamps, q = f"stamps of {self.source}", quantile(found.blocks, 1)
            each = late(who, stamps, self.clock + value, deviation, q, _PASSED[kind])
            yield told_within(each, _TOLD[kind], "too little moves to tell")
        elif kind == "frame":
            yield from (_frame(who, found, part) for part in ("turn", "shift"))
        elif kind == "lever arm":
            yield _lever_arm(who, found, self.recording)
        else:
            yield _scale(who, found)


def quantile(blocks: int, tests: int) -> float:
    """Return the quantile of Student's distribution for a false alarm in one of some tests."""
    return float(t.isf(FALSE_ALARM / (2 * tests), blocks - 1))


def told_within(found: Finding, widest: float, says: str) -> Finding:
    """Return a finding, or that its bound is too wide for it to tell that something fits."""
    return replace(found, fits=None, says=says) if found.fits and found.high > widest else found


def _told(found: Calibration, kind: str) -> Array:
    """Return values and deviations of a kind, (p, 2)."""
    return np.array([pair for name, pair in found.told.items() if name.startswith(kind)])


def _frame(who: str, found: Calibration, kind: str) -> Finding:
    factor, unit, verb, let = (
        (np.degrees(1.0), "deg", "turned", _PASSED[kind])
        if kind == "turn"
        else (1.0, "m", "shifted", _PASSED[kind] * found.after)
    )
    values, deviations = factor * _told(found, kind).T
    size, worst, count = float(np.linalg.norm(values)), float(deviations.max()), len(values)
    bound = let + quantile(found.blocks, 2 * count) * worst * float(np.sqrt(count))
    says = f"the reference is {verb} by {size:.2g} {unit} (± {worst:.2g} {unit})"
    each = Finding("frame", f"{who}, {kind}", size, 0, bound, size <= bound, says)
    return told_within(each, _TOLD[kind], "too little moves to tell")


def _lever_arm(who: str, found: Calibration, recording: Recording) -> Finding:
    """Judge where ranges or fixes see the tag, against where it is said to be."""
    mine = _told(found, "lever arm")
    off = np.abs(mine[:, 0] - recording.lever_arm[: len(mine)])
    bounds = _PASSED["lever arm"] * found.after + quantile(found.blocks, len(mine)) * mine[:, 1]
    worst = int(np.argmax(off / bounds))
    value, bound = float(off[worst]), float(bounds[worst])
    fits: bool | None = value <= bound
    where = ", ".join(f"{arm:.2g} ± {deviation:.2g}" for arm, deviation in mine)
    says = f"by {who.partition(' ')[0]} the tag is at ({where}) m in the axes of the body"
    if fits and bounds.max() > _TOLD["lever arm"] * found.after:
        fits, says = None, "too little turns to tell"
    return Finding("lever arm", who, value, 0, bound, fits, says)


def _scale(who: str, found: Calibration) -> Finding:
    """Judge the mean of what ranges of the anchors have too much in proportion to distance."""
    mine = np.array([name.startswith("scale") for name in found.names])
    part = found.covariance[np.ix_(mine, mine)]
    weight = np.linalg.pinv(part).sum(axis=0)
    weight = weight / weight.sum()
    value, deviation = float(weight @ found.values[mine]), float(np.sqrt(weight @ part @ weight))
    bound = _PASSED["scale"] + quantile(found.blocks, 1) * deviation
    if not bound <= _TOLD["scale"]:
        return unknown("scale", who, "distances change too little to tell a scale by")
    says = f"ranges grow by {1 + value:.3g} m for each metre (± {deviation:.2g})"
    return Finding("scale", who, 1 + value, 1 - bound, 1 + bound, abs(value) <= bound, says)
