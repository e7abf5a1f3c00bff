"""By which clock, axes and unit vectors of two sources are alike: every candidate against others.

What one source sees is, for a signed permutation P and a factor k, k P times what another tells of
the same motion, whatever the mean of each. By moments alone all candidates have a closed form.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import permutations, product

import numpy as np
from scipy.spatial.transform import Rotation
from scipy.stats import f, t

from inswsn_lib.checks import Array, Mask
from inswsn_lib.logs.blocks import FEWEST, block_starts
from inswsn_lib.logs.findings import FALSE_ALARM, Finding, judged

#: For a clock that is late: what is seen, what is told (n, d), and which rows both have
Pairs = Callable[[float], tuple[Array, Array, Mask]]

BLOCK = 5.0  # s, longer than errors last
REACH = 20.0  # s, of clocks that are tried
HOUR, HOURS = 3600.0, 14  # s, and how many of them: zones of time

_LEAP = 18  # s, since 2017
_NEAR = 1.0  # s: farther clocks are looked for before others are
_STEP, _COARSE = 0.05, 0.25  # s, of the clocks that are tried, and in other zones of time first
_SHARED = 0.25  # of the rows, that a clock must leave
_SAME = 0.5  # s, of independent clocks
_FAR = 9.0  # squared deviations, beyond which a row counts less
_OBLIQUE = 20.0  # degrees: what is turned farther has no axes of another name
_TELLS, _WIDE = 3.0, 4.0  # deviations of the slope, and between which factors it is told
_UNIT = 1.16  # by how much a ratio may be off its unit
_NAMES = "xyz"


def signed_permutations(dimensions: int) -> list[Array]:
    """Return the 2, 8 or 48 matrices that exchange and reverse axes, the identity first."""
    found = [
        np.eye(dimensions)[list(order)] * np.array(signs)[:, None]
        for order in permutations(range(dimensions))
        for signs in product((1.0, -1.0), repeat=dimensions)
    ]
    return sorted(found, key=lambda P: -float(np.trace(P)))


def in_words(P: Array) -> str:
    """Return what axes are, by those that they should be."""
    if len(P) == 1:
        return "the other way round"
    axes = [f"{'-' if row.min() < 0 else ''}{_NAMES[int(np.abs(row).argmax())]}" for row in P]
    return ", ".join(axes) + (" (mirrored)" if np.linalg.det(P) < 0 else "")


def units_of(low: float, high: float, units: dict[str, float]) -> list[str]:
    """Return the units with which a ratio of what is logged to what should be is explained."""
    low, high = low / _UNIT, high * _UNIT
    return [unit for unit, size in units.items() if low < size < high]


@dataclass(frozen=True)
class Slope:
    """Between which factors the truth lies if both sources have errors (Frisch 1934).

    The factor by errors of what is seen alone, and that by errors of what is told alone; each is
    widened by the quantile of Student's distribution for a false alarm, by a jackknife over blocks.
    """

    low: float
    high: float
    widened: tuple[float, float]
    tells: bool

    def outside(self, low: float, high: float) -> bool:
        """Tell whether no factor between two bounds is possible."""
        return self.tells and (self.widened[0] > high or self.widened[1] < low)

    def judged(
        self, name: str, subject: str, let: tuple[float, float], units: dict[str, float],
        says: str, right: str = "",
    ) -> Finding:  # fmt: skip
        """Return whether the factor may be between two bounds, or what unit explains it."""
        wrong, value = self.outside(*let), float(np.clip(1.0, self.low, self.high))
        if not self.tells or (not wrong and self.high > _WIDE * self.low):
            return Finding(name, subject, value, *let, None, "too little turns or moves to tell")
        if wrong and (found := units_of(self.low, self.high, units)):
            says += f": it may be {' or '.join(found)}"
        return Finding(name, subject, value, *let, not wrong, says if wrong else right or says)

    def __str__(self) -> str:
        """Return one number, or two where they differ."""
        if self.high < 1.1 * self.low:
            return f"{np.sqrt(self.low * self.high):.3g}"
        return f"{self.low:.3g} to {self.high:.3g}"


class Likeness:
    """How alike two sources are, by clock and signed permutation, with rows at some times (n,).

    Clocks are tried in steps up to a reach (s) around those of zones of time. Where they are
    centred, the means of both are no matter.
    """

    def __init__(
        self,
        pairs: Pairs,
        time: Array,
        reach: float = REACH,
        *,
        step: float = _STEP,
        zones: Sequence[float] = (0.0,),
        centred: bool = True,
    ) -> None:
        self.pairs, self.time, self.centred = pairs, time, centred
        count = round(reach / step)
        clocks = np.add.outer(zones, step * np.arange(-count, count + 1)).ravel()
        self.clocks: Array = clocks[np.argsort(np.abs(clocks), kind="stable")]
        self.weight = np.ones(len(time))
        self.matrices: list[Array] = []
        self._scan()
        if not self.empty:  # once more, with less of what fits nothing
            misfit = self.misfit(*self.best)
            there = np.isfinite(misfit)
            size = np.mean(misfit[there] ** 2) + 1e-300
            self.weight[there] = 1 / (1 + misfit[there] ** 2 / (_FAR * size))
            self._scan()
            self._rows = self._independent()
            self.nearest, self.clock = self._clock()

    @classmethod
    def of_any_zone(cls, pairs: Pairs, time: Array) -> Likeness | None:
        """Return it by near clocks, or by those of other zones of time if these tell more.

        None if there are too few blocks.
        """
        found = cls(pairs, time)
        if not found.tells:
            zones = HOUR * np.arange(-HOURS, HOURS + 1)
            coarse = cls(pairs, time, step=_COARSE, zones=zones.tolist())
            if not coarse.empty and (hour := round(coarse.best[0] / HOUR)):
                far = cls(pairs, time, zones=(0.0, hour * HOUR))
                found = far if far.tells else found
        return None if found.empty or len(block_starts(time, BLOCK)) < FEWEST else found

    @property
    def tells(self) -> bool:
        """Whether a factor is told."""
        return not self.empty and self.slope().tells

    @property
    def empty(self) -> bool:
        """Whether no clock leaves enough rows that change."""
        return not len(self.clocks)

    @property
    def best(self) -> tuple[float, Array]:
        """The clock and the matrix that are most alike."""
        row, column = np.unravel_index(int(np.argmax(self.score)), self.score.shape)
        return float(self.clocks[row]), self.matrices[int(column)]

    @property
    def turned(self) -> tuple[float, Array]:
        """The clock and the rotation that are most alike."""
        k = int(np.argmax(self._any_turn))
        return float(self.clocks[k]), self._turns[k]

    def explained(self, clock: float, matrix: Array) -> tuple[float, float]:
        """Return the squared correlation, and what is seen over its part in what is told."""
        seen, told, w, _ = self._at(clock)
        C, S, T = _moments(seen, told, w)
        part = max(float(np.sum(matrix * C)), 1e-300)
        return part**2 / (S * T), S / part

    def _scan(self) -> None:
        """Score each clock with each matrix by the logarithm of its likelihood, but for a size."""
        moments, rows, kept = [], [], []
        for clock in self.clocks.tolist():
            seen, told, w, _ = self._at(clock)
            C, S, T = _moments(seen, told, w)
            if len(w) >= max(_SHARED * len(self.time), 2 * FEWEST) and S > 0 and T > 0:
                moments.append(C / np.sqrt(S * T))
                rows.append(len(w))
                kept.append(clock)
        self.clocks, cross = np.array(kept), np.array(moments)
        if not kept:
            return
        self.matrices = self.matrices or signed_permutations(cross.shape[1])
        left, values, right = np.linalg.svd(cross)
        proper = np.linalg.det(left @ right)
        left[:, :, -1] *= proper[:, None]
        values[:, -1] *= proper
        alike = np.einsum("pij,nij->np", np.array(self.matrices), cross)
        alike = np.column_stack([alike, values.sum(axis=1)])  # the last is of any turn
        score = -np.array(rows)[:, None] * np.log(1 - np.clip(alike, 0, 1 - 1e-9) ** 2)
        self.score, self._any_turn, self._turns = score[:, :-1], score[:, -1], left @ right

    def _at(self, clock: float) -> tuple[Array, Array, Array, Mask]:
        """Return what is seen and told, free of their means, weights, and which rows have both."""
        seen, told, rows = self.pairs(clock)
        seen, told, w = seen[rows], told[rows], self.weight[rows]
        if self.centred:
            total = max(float(w.sum()), 1e-300)
            seen, told = seen - w @ seen / total, told - w @ told / total
        return seen, told, w, rows

    def _left(self, clock: float, matrix: Array) -> Array:
        """Return what is seen and not told, weighted, (n, d); NaN where a source is not there."""
        seen, told, w, rows = self._at(clock)
        C, _, T = _moments(seen, told, w)
        k = max(float(np.sum(matrix * C)), 0.0) / max(T, 1e-300)
        found = np.full((len(rows), len(matrix)), np.nan)
        found[rows] = np.sqrt(w)[:, None] * (seen - k * told @ matrix.T)
        return found

    def misfit(self, clock: float, matrix: Array) -> Array:
        """Return by how much each row is not alike, (n,); NaN where a source is not there."""
        return np.asarray(np.linalg.norm(self._left(clock, matrix), axis=1))

    def _independent(self) -> float:
        """Return how many rows of a block are as good as independent, by sums of what is left."""
        off = self._left(*self.best)
        there = np.isfinite(off).all(axis=1)
        off, starts = off[there], block_starts(self.time[there], BLOCK)
        sums = np.sum(np.add.reduceat(off, starts, axis=0) ** 2)
        effect = max(float(sums / max(np.sum(off**2), 1e-300)), 1.0)
        return max(len(off) / len(starts) / effect, 1.0)

    def _clock(self) -> tuple[float, float]:
        """Return the clock with which axes fit best, and that by which stamps are far too late.

        A far clock must beat all near ones, with any axes and with any turn.
        """
        own, near = self.score[:, 0], np.flatnonzero(np.abs(self.clocks) <= _NEAR)
        peak = float(self.clocks[np.argmax(own)])
        if not len(near):
            return peak, peak
        here = float(self.clocks[near[np.argmax(own[near])]])
        if abs(peak) <= _NEAR:
            return here, 0.0
        best, turn = self.misfit(peak, self.matrices[0]), near[np.argmax(self._any_turn[near])]
        row, column = np.unravel_index(np.argmax(self.score[near]), self.score[near].shape)
        others = (
            (here, self.matrices[0]),
            (float(self.clocks[turn]), self._turns[turn]),
            (float(self.clocks[near[row]]), self.matrices[int(column)]),
        )
        tries = round(float(np.ptp(self.clocks)) / _SAME)
        far = all(self.compared(best, self.misfit(*each), tries)[0] > 0 for each in others)
        return (peak, peak) if far else (here, 0.0)

    @property
    def late(self) -> float:
        """By how much stamps are late, s: nothing unless it fits better than what was logged."""
        if self.clock or not self.nearest:
            return self.clock
        mine, other = (self.misfit(clock, self.matrices[0]) for clock in (self.nearest, 0.0))
        tries = round(2 * _NEAR / _SAME)
        return self.nearest if self.compared(mine, other, tries)[0] > 0 else 0.0

    def compared(self, mine: Array, other: Array, tries: int = 1) -> tuple[int, float]:
        """Return 1 if other misfits are larger, -1 if smaller, 0 if none can tell; and the ratio.

        Two tests of which either is enough: the means of the squared misfits are compared by
        Fisher's distribution with as many degrees of freedom as rows are independent; and the
        differences of the misfits, averaged over blocks, with their deviation by Student's. The
        first is sharp where what is wrong is much larger than noise, the second where both misfits
        have much in common. The level is that of the first of some tries.
        """
        both = np.isfinite(mine) & np.isfinite(other)
        starts = block_starts(self.time[both], BLOCK) if both.any() else np.arange(0)
        if len(starts) < FEWEST:
            return 0, 1.0
        mine, other = mine[both], other[both]
        ratio = float((np.mean(other**2) + 1e-300) / (np.mean(mine**2) + 1e-300))
        level, free = FALSE_ALARM / (4 * tries), self._rows * len(starts)
        means = np.add.reduceat(other - mine, starts) / np.diff([*starts.tolist(), len(mine)])
        z = means.mean() / max(means.std(ddof=1) / np.sqrt(len(starts)), 1e-300)
        enough, bound = f.isf(level, free, free), t.isf(level, len(starts) - 1)
        if ratio >= enough or (z >= bound and ratio > 1):
            return 1, ratio
        return -int(ratio <= 1 / enough or (z <= -bound and ratio < 1)), ratio

    def axes(self, subject: str, what: str) -> Finding:
        """Return whether the identity fits better than every other signed permutation.

        Each has its own best clock, near nought or that of the identity. A turn that is far from
        all of them is no other axes. `what` says whose axes they are.
        """
        others, mine = self.matrices[1:], self.misfit(self.nearest, self.matrices[0])
        apart = np.minimum(np.abs(self.clocks), np.abs(self.clocks - self.nearest))
        near = np.flatnonzero(apart <= max(_NEAR, float(apart.min())))
        tries = len(others) * (1 + round(min(2 * _NEAR, float(np.ptp(self.clocks))) / _SAME))
        best = near[np.argmax(self.score[near, 1:], axis=0)]
        found = [
            self.compared(mine, self.misfit(float(self.clocks[k]), P), tries)
            for k, P in zip(best, others, strict=True)
        ]
        side, ratio = (np.array(x) for x in zip(*found, strict=True))
        nearest, like = int(np.argmin(ratio)), int(np.sum(side <= 0))
        fits: bool | None = True
        says = f"{what} axes are as they should be: no others of {len(others)} fit as well"
        if side[nearest] < 0 and not self._oblique(int(best[nearest]), others[nearest]):
            fits = False
            says = f"{what} axes, by those that they should be, are {in_words(others[nearest])}"
        elif like:
            fits = None
            such = others[int(np.argmin(np.where(side > 0, np.inf, ratio)))]
            says = (
                f"too little turns for the data to tell {what} axes from {like} others of "
                f"{len(others)}, such as {in_words(such)}"
            )
        return Finding("axes", subject, float(ratio[nearest]), 1.0, np.inf, fits, says)

    def _oblique(self, k: int, P: Array) -> bool:
        """Tell whether a turn that is far from a permutation fits much better than it."""
        if len(P) == 1 or np.linalg.det(P) < 0:
            return False
        clock, turn, off = float(self.clocks[k]), self._turns[k], np.eye(3)
        off[: len(P), : len(P)] = turn @ P.T
        if np.degrees(Rotation.from_matrix(off).magnitude()) < _OBLIQUE:
            return False
        return self.compared(self.misfit(clock, turn), self.misfit(clock, P))[0] > 0

    def slope(self) -> Slope:
        """Return the factor, with the axes that are most alike, and their clock."""
        clock, P = self.best
        seen, told, w, rows = self._at(clock)
        each = [seen * (told @ P.T), seen**2, told**2]
        products = w[:, None] * np.sum(each, axis=2).T
        sums = np.add.reduceat(products, block_starts(self.time[rows], BLOCK))
        C, S, T = (sums.sum(axis=0) - np.vstack([sums, np.zeros(3)])).T  # the last is the whole
        with np.errstate(divide="ignore", invalid="ignore"):
            found = np.array([C / T, S / C])
        G, (low, high) = len(sums), found[:, -1].tolist()
        spread = np.sqrt((G - 1) / G * np.sum((found[:, :-1] - found[:, -1:]) ** 2, axis=1))
        tells = bool(G >= FEWEST and low > _TELLS * spread[0] and np.isfinite(spread).all())
        off = float(t.isf(FALSE_ALARM / 2, max(G - 1, 1))) * spread
        return Slope(low, high, (float(low - off[0]), float(high + off[1])), tells)


def _moments(seen: Array, told: Array, w: Array) -> tuple[Array, float, float]:
    """Return the cross moment (d, d), and the sums of squares."""
    return (w * seen.T) @ told, float(np.sum(w @ seen**2)), float(np.sum(w @ told**2))


def late(
    who: str, stamps: str, value: float, deviation: float, quantile: float, let: float
) -> Finding:
    """Return whether stamps are late, by a value and its deviation."""
    bound, size = let + quantile * deviation, abs(value)
    how = "late" if value > 0 else "early"
    says = f"{stamps} are {round(size, 3):g} s {how} (± {deviation:.2g} s)"
    hours = round(size / HOUR)
    if hours and abs(size - hours * HOUR) < 2 * REACH:
        says += f": {hours} h are as of another zone of time"
    if round(size) == _LEAP:
        says += f": GPS time is {_LEAP} s ahead of UTC"
    return judged("time", who, value, -bound, bound, says, says)
