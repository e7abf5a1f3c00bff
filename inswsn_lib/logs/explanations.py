"""Which of clock, frame, lever arm and scale explain why ranges or fixes are not as they should.

Each set of them is fitted at once by `calibrate`, beside a bias of each anchor. Sets are compared
by the loss of their residuals, penalised for their freedom as by Schwarz (1978), with as many rows
as would be independent: what explains most is taken first, and what another one makes needless is
given back.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field, replace

import numpy as np
from scipy.stats import t

from inswsn_lib.checks import Array
from inswsn_lib.errors import InswsnError
from inswsn_lib.logs.blocks import block_starts
from inswsn_lib.logs.findings import FALSE_ALARM, Finding, unknown
from inswsn_lib.logs.fit import calibrate
from inswsn_lib.logs.likeness import BLOCK, late
from inswsn_lib.logs.model import Model, Rows, State
from inswsn_lib.logs.reference_motion import ReferenceMotion
from inswsn_lib.logs.results import Calibration
from inswsn_lib.logs.robust_fit import deviation_of
from inswsn_lib.streams import Recording

_TURN, _LATE, _SHIFT, _ARM, _SCALE = 3.0, 0.02, 3.0, 0.5, 0.05  # what is let pass: degrees, s,
# times the noise, times the noise, and of a distance
_TOLD = {"clock": 1.0, "turn": 20.0, "lever arm": 3.0, "scale": 0.1}  # the widest bounds, likewise
_ANY = dict.fromkeys(("clock", "turn", "shift", "lever arm", "bias", "scale"), 1e9)
_NEAR = 1.5  # s, of clocks that are tried; farther ones are found before
_BLOCKS, _CORRELATED = (BLOCK, 10.0, 20.0, 40.0), 0.3  # s, and of means of blocks on end
_MOST = 8000  # rows that are fitted
_AS_WELL = -2 * float(np.log(FALSE_ALARM))  # of twice a logarithm of likelihoods
_NAMES = {"clock": "a late clock", "frame": "a turned or shifted reference",
          "lever arm": "another lever arm", "scale": "a scale of ranges"}  # fmt: skip


@dataclass(frozen=True, eq=False)
class _Fit:
    found: Calibration | str
    residual: Array
    unknowns: int


@dataclass(eq=False)
class Explanations:
    """Sets of explanations of a source, fitted once each.

    Attributes
    ----------
    recording : Recording
        With a reference.
    source : str
        ``"ranges"`` or ``"fixes"``.
    kinds : tuple of str
        Of `calibrate`'s, that may explain.
    also : tuple of str
        What is always fitted.
    clock : float
        By how much the stamps of the source were late, s, and are no more.
    block : float
        s, longer than errors last.
    """

    recording: Recording
    source: str
    kinds: tuple[str, ...]
    also: tuple[str, ...]
    clock: float = 0.0
    block: float = BLOCK
    chosen: tuple[str, ...] = ()
    _fits: dict[frozenset[str], _Fit] = field(default_factory=dict)
    _as_well: dict[str, list[str]] = field(default_factory=dict)

    def __post_init__(self) -> None:
        """Thin the rows, and choose."""
        stream, reference = getattr(self.recording, self.source), self.recording.reference
        assert reference is not None
        if len(stream) > _MOST:
            kept = np.zeros(len(stream), dtype=bool)
            kept[np.random.default_rng(0).choice(len(stream), _MOST, replace=False)] = True
            self.recording = replace(self.recording, **{self.source: stream.kept(kept)})
            stream = getattr(self.recording, self.source)
        rows = Rows.of(stream)
        self._motion = ReferenceMotion(reference, rows.dimension)
        self._rows = rows.part(self._motion.covers(rows.time, 2 * _NEAR))
        if len(self._rows.time):
            self.block, self._wider = self._lasting(self.fit(*self.kinds).residual)
            self._fits.clear()
            self._choose()

    def _lasting(self, miss: Array) -> tuple[float, float]:
        """Return how long blocks are whose means are hardly correlated, s, and a factor.

        By that variances are larger since what is left of the correlation goes on (a process of
        the first order), estimated too small by one over the number of blocks.
        """
        related = 0.0
        for length in _BLOCKS:
            both, own = 0.0, 0.0
            for k in np.unique(self._rows.which):
                mine = self._rows.which == k
                starts = block_starts(self._rows.time[mine], length)
                counts = np.diff(np.append(starts, int(mine.sum())))
                means = np.add.reduceat(np.arctan(miss[mine] / deviation_of(miss)), starts) / counts
                means = means - means.mean()
                both, own = both + float(means[1:] @ means[:-1]), own + float(means @ means)
            related = float(np.clip(both / max(own, 1e-300) + 1 / len(means), 0.0, 0.8))
            if related < _CORRELATED:
                break
        return length, (1 + related) / (1 - related)

    def fit(self, *kinds: str) -> _Fit:
        """Return the fit of some kinds, beside what is always fitted."""
        key = frozenset(kinds)
        if key not in self._fits:
            self._fits[key] = self._fitted(tuple(k for k in self.kinds if k in key))
        return self._fits[key]

    def _fitted(self, kinds: tuple[str, ...]) -> _Fit:
        names = (*kinds, *self.also)
        state = State.nothing(self._rows, np.asarray(self.recording.lever_arm, dtype=float))
        found: Calibration | str = ""
        if names:
            reach = _NEAR if "clock" in kinds else 0.0
            try:
                found = calibrate(
                    self.recording,
                    names,
                    source=self.source,
                    block=self.block,
                    reach=reach,
                    limits=_ANY,
                )
                state = found.state
            except InswsnError as error:
                found = str(error).rstrip(".")
        count = len(found.names) if isinstance(found, Calibration) else 0
        return _Fit(found, Model(self._motion, self._rows, []).residual(state), count)

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
            self._as_well[best] = [
                kind
                for kind, gain in gains.items()
                if kind != best and gain > max(0.0, gains[best] - _AS_WELL)
            ]
        for kind in self.chosen[:-1]:
            others = tuple(other for other in self.chosen if other != kind)
            if self._gain(self.fit(*others), self.fit(*self.chosen)) <= 0:
                self.chosen = others

    def _gain(self, less: _Fit, more: _Fit) -> float:
        """Return by how much more likely the freer of two fits is, twice its logarithm."""
        if not isinstance(more.found, Calibration):
            return -np.inf
        noise = max(min(deviation_of(each.residual) for each in (less, more)), 1e-6)
        losses = [
            2 * (np.sqrt(1 + (each.residual / noise) ** 2) - 1).sum() for each in (less, more)
        ]
        effect = self._effect(more.residual / noise)
        rows = max(len(more.residual) / effect, 2.0)
        free = more.unknowns - less.unknowns
        return float((losses[0] - losses[1]) / effect - free * np.log(rows))

    def _effect(self, miss: Array) -> float:
        """Return how many rows tell as much as one that is independent, by sums over blocks."""
        total, count = 0.0, 0.0
        push = miss / np.sqrt(1 + miss**2)
        for k in np.unique(self._rows.which):
            mine = self._rows.which == k
            own = push[mine] - push[mine].mean()
            starts = block_starts(self._rows.time[mine], self.block)
            total += float(np.sum(np.add.reduceat(own, starts) ** 2))
            count += int(mine.sum()) * float(np.mean(own**2))
        return max(total / max(count, 1e-300), 1.0)

    @property
    def noise(self) -> float:
        """The deviation of what is left by the explanations that are chosen, m."""
        found = self.fit(*self.chosen).found
        return found.after if isinstance(found, Calibration) else np.inf

    def findings(self) -> Iterator[Finding]:
        """Yield whether each kind is as it should be, beside those that explain."""
        if not len(self._rows.time):
            return
        reference = self.recording.reference
        assert reference is not None
        for kind in self.kinds:
            found = self.fit(*self.chosen, kind).found
            name, who = ("time" if kind == "clock" else kind), f"{self.source} and reference"
            if isinstance(found, str):
                yield unknown(name, who, found)
                continue
            found = replace(found, covariance=self._wider * found.covariance)
            for each in self._judged(kind, who, found):
                explains = kind in self.chosen or (kind == "clock" and self.clock != 0)
                if not explains and each.fits is False:
                    says = "other explanations fit as well"
                    yield replace(each, fits=True, says=says)
                elif each.fits is False and self._others(kind):
                    also = " or ".join(_NAMES[other] for other in self._others(kind))
                    yield replace(each, says=f"{each.says}; {also} explains it as well")
                else:
                    yield each

    def _others(self, kind: str) -> list[str]:
        return [other for other in self._as_well.get(kind, []) if other not in self.chosen]

    def _judged(self, kind: str, who: str, found: Calibration) -> Iterator[Finding]:
        if kind == "clock":
            value, deviation = found.told["clock"]
            q = float(t.isf(FALSE_ALARM / 2, found.blocks - 1))
            stamps = f"stamps of {self.source}"
            each = late(who, stamps, self.clock + value, deviation, q, _LATE)
            untold = each.high > _TOLD["clock"]
            yield (
                replace(each, fits=None, says="too little moves to tell")
                if (each.fits and untold)
                else each
            )
        elif kind == "frame":
            yield from (_frame(who, found, part) for part in ("turn", "shift"))
        elif kind == "lever arm":
            yield _lever_arm(who, found, self.recording)
        else:
            yield _scale(who, found)

    @property
    def late(self) -> float:
        """By how much stamps of the source are still late, s, if that is what explains."""
        found = self.fit(*self.chosen).found
        there = "clock" in self.chosen
        return found.told["clock"][0] if there and isinstance(found, Calibration) else 0.0


def _told(found: Calibration, kind: str) -> Array:
    """Return values and deviations of a kind, (p, 2)."""
    return np.array([pair for name, pair in found.told.items() if name.startswith(kind)])


def _frame(who: str, found: Calibration, kind: str) -> Finding:
    turn = kind == "turn"
    factor, unit, verb = (np.degrees(1.0), "deg", "turned") if turn else (1.0, "m", "shifted")
    let = _TURN if turn else _SHIFT * found.after
    mine = _told(found, kind) * factor
    size, worst = float(np.linalg.norm(mine[:, 0])), float(mine[:, 1].max())
    q = float(t.isf(FALSE_ALARM / (4 * len(mine)), found.blocks - 1))
    bound = let + q * worst * float(np.sqrt(len(mine)))
    fits: bool | None = size <= bound
    says = f"the reference is {verb} by {size:.2g} {unit} (± {worst:.2g} {unit})"
    if fits and turn and bound > _TOLD["turn"]:
        fits, says = None, "too little moves to tell"
    return Finding("frame", f"{who}, {kind}", size, 0, bound, fits, says)


def _lever_arm(who: str, found: Calibration, recording: Recording) -> Finding:
    """Judge where ranges or fixes see the tag, against where it is said to be."""
    mine = _told(found, "lever arm")
    off = np.abs(mine[:, 0] - recording.lever_arm[: len(mine)])
    q = float(t.isf(FALSE_ALARM / (2 * len(mine)), found.blocks - 1))
    bounds = _ARM * found.after + q * mine[:, 1]
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
    bound = _SCALE + float(t.isf(FALSE_ALARM / 2, found.blocks - 1)) * deviation
    if not bound <= _TOLD["scale"]:
        return unknown("scale", who, "distances change too little to tell a scale by")
    says = f"ranges grow by {1 + value:.3g} m for each metre (± {deviation:.2g})"
    return Finding("scale", who, 1 + value, 1 - bound, 1 + bound, abs(value) <= bound, says)
