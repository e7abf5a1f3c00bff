"""Outages in a recording: what each estimator makes of the time in which fixes are withheld."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import pandas as pd

from inswsn_lib.checks import Array
from inswsn_lib.errors import InswsnError
from inswsn_lib.evaluation import block_ratio
from inswsn_lib.inertial import Solution, smooth
from inswsn_lib.logs.correction import USUAL
from inswsn_lib.logs.ladder import Ladder
from inswsn_lib.streams import Whole

_FEWEST, _MOST = 3, 200  # outages
_STRETCH = 1.5  # times its length, that the fixes of an outage may take
#: What costs nothing, and what knows the fixes after the outage
STILL, ON, STRAIGHT = (
    "stand still at the last fix", "go on at the last velocity", "straight to the next fix",
)  # fmt: skip
COASTING, SMOOTHED = "coasting filter", "smoother, fixes on both sides"


@dataclass(frozen=True, eq=False)
class Outages:
    """Outages of fixes in the judged part of a recording, each in a replay of its own.

    An outage begins at every `every`-th second at which the fix and the truth are there. Up to it
    all estimators have the same fixes; in it they have the motion, or nothing. What one says is
    held against the truth at the times of the fixes that are withheld. Where there is no reference
    these fixes are the truth, with errors of their own.

    Attributes
    ----------
    ladder : Ladder
    longest : float
        Of outages, s.
    every : float
        Between the begins of outages, s.

    Examples
    --------
    >>> from inswsn_lib.logs import Ladder, Outages
    >>> from inswsn_lib.streams import Recording
    >>> Outages(Ladder(Recording("empty"))).starts
    Traceback (most recent call last):
    ...
    inswsn_lib.errors.InswsnError: The recording empty has neither an IMU nor odometry: there is \
nothing to correct fixes with.
    """

    ladder: Ladder
    longest: float = 10.0
    every: float = 4.0

    @cached_property
    def starts(self) -> Whole:
        """The last fix before each outage, (outages,)."""
        return self.begins(self.ladder.split, float(self.ladder.fixes.time[-1]))

    @property
    def steps(self) -> int:
        """Fixes that the longest outage takes."""
        return max(round(self.longest / self.ladder.step), 1)

    @cached_property
    def solutions(self) -> dict[str, Solution]:
        """The runs of filters, which outages begin from: the likeliest on fixes, then others."""
        names = [self.ladder.corrected, *(n for n in self.ladder.rungs if n not in USUAL)]
        return {name: self.ladder.solution(name) for name in names}

    @cached_property
    def errors(self) -> dict[str, Array]:
        """Horizontal errors of what a system could have done, (outages, steps), m, by method."""
        network = self.ladder.network.state[self.starts]
        still = np.hstack([network[:, :2], np.zeros((len(network), 2))])
        name, *others = self.solutions
        filtered = self.ladder.of(self.solutions[name]).state[self.starts]
        found = {
            STILL: self._on(still),
            ON: self._on(network),
            "go on at the filter's velocity": self._on(filtered),
            COASTING: self._replayed(name),
        }
        return found | {f"coasting, {n}": self._replayed(n) for n in others}

    @cached_property
    def oracles(self) -> dict[str, Array]:
        """Errors of what knows more than a system could, likewise."""
        found = {
            STRAIGHT: self._straight(),
            SMOOTHED: self._replayed(next(iter(self.solutions)), smoothed=True),
        }
        if self.ladder.recording.reference is not None:
            found["go on at the true velocity"] = self._on(self.ladder.truth[self.starts])
        return found

    def table(self, lengths: Sequence[float] = (2.0, 5.0, 10.0), other: str = ON) -> pd.DataFrame:
        """Return RMS errors over outages of these lengths, m, and ratios to another row, going on.

        Parameters
        ----------
        lengths : sequence of float
            s, up to the longest.
        other : str
            The row to which ratios are.

        Returns
        -------
        DataFrame
            A row for each method, oracles last (``oracle``), with the count of ``outages``; for
            each length ``rms N s``, and ``ratio N s``, ``low N s`` and ``high N s`` of it, with
            intervals by `block_ratio` over outages, of which those that overlap are in one block.
        """
        everything = self.errors | self.oracles
        rows: dict[str, dict[str, float | bool]] = {}
        for name, error in everything.items():
            rows[name] = {"oracle": name in self.oracles, "outages": len(self.starts)}
            for length in lengths:
                told = self.ratio(error, everything[other], length)
                columns = [f"{what} {length:g} s" for what in ("rms", "ratio", "low", "high")]
                rows[name] |= dict(zip(columns, told, strict=True))
        return pd.DataFrame(rows).T

    def ratio(self, error: Array, other: Array, length: float) -> tuple[float, ...]:
        """Return an RMS error over outages of a length, s, its ratio to another, and the interval.

        Both are (outages, steps), m. Of outages in which the truth is known; NaN if these are fewer
        than three.
        """
        steps = max(1, round(self.steps * length / self.longest))
        both = np.square([error[:, :steps], other[:, :steps]])
        there = np.isfinite(both).any(axis=2).all(axis=0)
        if there.sum() < _FEWEST:
            return (np.nan,) * 4
        mine, theirs = np.nanmean(both[:, there], axis=2)
        block = max(1, int(np.ceil(length / self.every)))
        return float(np.sqrt(mine.mean())), *block_ratio(mine, theirs, block)

    def begins(self, begin: float, end: float) -> Whole:
        """Return the last fixes before outages that lie between two times, s, (outages,).

        `InswsnError` is raised if there is room for fewer than three.
        """
        time = self.ladder.fixes.time
        states = np.hstack([self.ladder.network.state, self.ladder.truth[:, :2]])
        there = np.asarray(np.isfinite(states).all(axis=1))
        there &= (time > max(begin, self.ladder.start.time)) & (time + self.longest < end)
        after = np.arange(len(there)) + self.steps + 1
        next_ = np.minimum(after, len(there) - 1)
        there &= (after < len(there)) & np.isfinite(states[next_, 0])
        # rows that are missing would make it longer
        there &= time[next_ - 1] - time <= _STRETCH * self.longest + self.ladder.step
        found: list[int] = []
        for k in np.flatnonzero(there):
            if not found or time[k] - time[found[-1]] >= self.every:
                found.append(int(k))
        if len(found) > _MOST:  # as many as are enough, all over the time
            found = [found[k] for k in np.linspace(0, len(found) - 1, _MOST).astype(int)]
        if len(found) < _FEWEST:
            raise InswsnError(
                f"{self.ladder.recording.name} has room for {len(found)} outages of "
                f"{self.longest:g} s; three are needed."
            )
        return np.array(found)

    def ahead(self, starts: Whole) -> Whole:
        """Return the rows of the fixes that are withheld, (outages, steps)."""
        return np.asarray(starts[:, None] + 1 + np.arange(self.steps))

    def apart(self, places: Array, starts: Whole) -> Array:
        """Return the distances of places (outages, steps, 2) from the truth."""
        truth = self.ladder.truth[self.ahead(starts), :2]
        return np.asarray(np.linalg.norm(places - truth, axis=2))

    def _on(self, states: Array) -> Array:
        """Return the errors of going straight on from states (outages, 4)."""
        time = self.ladder.fixes.time
        passed = time[self.ahead(self.starts)] - time[self.starts, None]
        places = states[:, None, :2] + passed[:, :, None] * states[:, None, 2:]
        return self.apart(places, self.starts)

    def _straight(self) -> Array:
        """Return the errors of the straight line from the last fix to the next one."""
        time, state = self.ladder.fixes.time, self.ladder.network.state
        rows = self.ahead(self.starts)
        after = rows[:, -1] + 1
        share = (time[rows] - time[self.starts, None]) / (time[after] - time[self.starts])[:, None]
        first, last = (state[k, None, :2] for k in (self.starts, after))
        return self.apart(first + share[:, :, None] * (last - first), self.starts)

    def _replayed(self, name: str, *, smoothed: bool = False) -> Array:
        """Return the errors of a filter without fixes, or of its smoother with those after."""
        found = [self._replay(name, int(k), smoothed=smoothed) for k in self.starts]
        return self.apart(np.array(found), self.starts)

    def _replay(self, name: str, k: int, *, smoothed: bool) -> Array:
        """Return where the filter is at the fixes that are withheld after one, (steps, 2)."""
        ladder, fixes, after = self.ladder, self.ladder.fixes, k + 1 + self.steps
        start, last = ladder.start_after(self.solutions[name], k), after + self.steps * smoothed
        gone = np.ones(len(fixes), dtype=bool)
        gone[after:last] = False
        end = float(fixes.time[min(last, len(fixes) - 1)])
        run = ladder.rungs[name].run(*ladder.tuned(name).best, start=start, end=end, gone=gone)
        return ladder.of(smooth(run) if smoothed else run).state[k + 1 : after, :2]
