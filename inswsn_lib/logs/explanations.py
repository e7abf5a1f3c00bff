"""Which of clock, frame, lever arm and scale explain why ranges or fixes are not as they should.

Each set of them is fitted at once by `calibrate`, beside a bias of each anchor. Sets are compared
by the loss of their residuals, penalised for their freedom as by Schwarz (1978), with as many rows
as would be independent: what explains most is taken first, and what another one makes needless is
given back.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.stats import t

from inswsn_lib.checks import Array
from inswsn_lib.errors import InswsnError
from inswsn_lib.logs.blocks import block_starts, deviation_of
from inswsn_lib.logs.calibration import Calibration, calibrate
from inswsn_lib.logs.findings import FALSE_ALARM, Finding, unknown
from inswsn_lib.logs.likeness import BLOCK, late
from inswsn_lib.logs.model import KINDS, Model, Rows, State
from inswsn_lib.logs.reference_motion import ReferenceMotion
from inswsn_lib.streams import Recording

# What is let pass, and the widest bounds that tell: s, degrees, times the noise, times the noise,
# and of a distance
_LET = {"clock": 0.02, "turn": 3.0, "shift": 3.0, "lever arm": 0.5, "scale": 0.05}
_TOLD = {"clock": 1.0, "turn": 20.0, "shift": np.inf, "lever arm": 3.0, "scale": 0.1}
_ANY = dict.fromkeys(KINDS, 1e9)
_NEAR = 1.5  # s, of clocks that are tried; farther ones are found before
_BLOCKS, _CORRELATED = (BLOCK, 10.0, 20.0, 40.0), 0.3  # s, and of means of blocks on end
_MOST = 8000  # rows that are fitted
_AS_WELL = -2 * float(np.log(FALSE_ALARM))  # of twice a logarithm of likelihoods
_NAMES = {"clock": "a late clock", "frame": "a turned or shifted reference",
          "lever arm": "another lever arm", "scale": "a scale of ranges"}  # fmt: skip


class _Fit(NamedTuple):
    found: Calibration | None
    residual: Array
    says: str  # why nothing is found


class Explanations:
    """Sets of explanations of a source, fitted once each, and those that are chosen.

    Parameters
    ----------
    recording : Recording
        With a reference.
    source : str
        ``"ranges"`` or ``"fixes"``.
    clock : float
        By how much the stamps of the source were late, s, and are no more.
    """

    def __init__(self, recording: Recording, source: str, clock: float) -> None:
        stream, reference = getattr(recording, source), recording.reference
        assert reference is not None
        if len(stream) > _MOST:
            some = np.random.default_rng(0).choice(len(stream), _MOST, replace=False)
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
            each = late(who, stamps, self.clock + value, deviation, q, _LET[kind])
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
        (np.degrees(1.0), "deg", "turned", _LET[kind])
        if kind == "turn"
        else (1.0, "m", "shifted", _LET[kind] * found.after)
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
    bounds = _LET["lever arm"] * found.after + quantile(found.blocks, len(mine)) * mine[:, 1]
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
    bound = _LET["scale"] + quantile(found.blocks, 1) * deviation
    if not bound <= _TOLD["scale"]:
        return unknown("scale", who, "distances change too little to tell a scale by")
    says = f"ranges grow by {1 + value:.3g} m for each metre (± {deviation:.2g})"
    return Finding("scale", who, 1 + value, 1 - bound, 1 + bound, abs(value) <= bound, says)
