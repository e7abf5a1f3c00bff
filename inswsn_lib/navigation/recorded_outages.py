"""Outages in a recording: what each method makes of the time in which fixes are withheld."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
import pandas as pd

from inswsn_lib import learning
from inswsn_lib.checks import Array
from inswsn_lib.errors import InswsnError
from inswsn_lib.evaluation import block_ratio
from inswsn_lib.filters import run_kalman
from inswsn_lib.inertial import PositionFixes, Start, run_error_state, smooth
from inswsn_lib.navigation.hybrid import HybridNavigator, observable_inputs
from inswsn_lib.recordings import FixesContest, RecordedContest
from inswsn_lib.recordings.contest import COLOURED
from inswsn_lib.recordings.correction import UP
from inswsn_lib.recordings.difference_filters import difference_model
from inswsn_lib.recordings.estimates import of_solution
from inswsn_lib.streams import Whole

#: What P1's hybrid learns from, by the names of `observable_inputs`
INPUTS = ("inertial", "motion")
#: Over how many of the latest fixes
WINDOWS = (25, 50)
_UNKNOWN = 1e6 * np.eye(4)
_BLOCK = 10.0  # s, of the bootstrap
_LEARNERS: Mapping[str, Callable[[], Any]] = {
    "BP network": lambda: learning.BackpropRegressor(networks=1),
    "LS-SVM": learning.SelectedLSSVM,
}


@dataclass(frozen=True, eq=False)
class RecordedOutages:
    """Outages of fixes in the judged part of a recording, each in a replay of its own.

    An outage begins at every `every`-th second at which the fix and the truth are there. Up to it
    all methods have the same fixes; in it they have the IMU, or nothing. What a method says is held
    against the truth at the times of the fixes that are withheld.

    Attributes
    ----------
    contest : FixesContest or RecordedContest
        With its tuned filters.
    longest : float
        Of outages, s.
    every : float
        Between the begins of outages, s.

    Examples
    --------
    >>> from inswsn_lib.navigation import RecordedOutages
    >>> from inswsn_lib.recordings import FixesContest
    >>> from inswsn_lib.streams import Recording
    >>> RecordedOutages(FixesContest(Recording("empty"))).starts
    Traceback (most recent call last):
    ...
    inswsn_lib.errors.InswsnError: The recording empty has no imu: a contest of filters needs one.
    """

    contest: FixesContest
    longest: float = 10.0
    every: float = 4.0

    @cached_property
    def starts(self) -> Whole:
        """The last fix before each outage, (outages,)."""
        return self._starts(self.contest.split, float(self.contest.fixes.time[-1]))

    @property
    def steps(self) -> int:
        """Fixes that the longest outage takes."""
        return round(self.longest / float(np.median(np.diff(self.contest.fixes.time))))

    @cached_property
    def errors(self) -> dict[str, Array]:
        """Horizontal errors of what a system could have done, (outages, steps), m, by method."""
        found = {
            "stand still at the last fix": self._carried(np.zeros((len(self.starts), 2))),
            "go on at the last velocity": self._carried(
                self.contest.network.state[self.starts, 2:]
            ),
            "go on at the filter's velocity": self._on(self._filtered),
            "coasting filter": self._coasting(smoothed=False),
        }
        if isinstance(self.contest, RecordedContest):
            found["P1's KF, coasting"] = self._coasting_kalman()
            found |= {f"P1's {name}": self._hybrid(name, self.starts) for name in _LEARNERS}
        return found

    @cached_property
    def oracles(self) -> dict[str, Array]:
        """Errors of what knows more than a system could, likewise."""
        found = {
            "straight to the next fix": self._straight(),
            "smoother, fixes on both sides": self._coasting(smoothed=True),
        }
        if self.contest.recording.reference is not None:
            found["go on at the true velocity"] = self._on(self.contest.truth[self.starts])
        return found

    def table(self, lengths: Sequence[float] = (2.0, 5.0, 10.0)) -> pd.DataFrame:
        """Return RMS errors over outages of these lengths, m, and ratios to going straight on.

        Parameters
        ----------
        lengths : sequence of float
            s, up to the longest.

        Returns
        -------
        DataFrame
            A row for each method, oracles last (``oracle``), with the count of ``outages``; for
            each length ``rms N s``, and ``ratio N s``, ``low N s`` and ``high N s`` of it: to *go
            on at the last velocity*, with intervals by a block bootstrap over outages.
        """
        everything = self.errors | self.oracles
        rows = {}
        for name, error in everything.items():
            row: dict[str, float | bool] = {
                "oracle": name in self.oracles,
                "outages": len(self.starts),
            }
            for length in lengths:
                steps = max(1, round(self.steps * length / self.longest))
                mine, theirs = (
                    np.nanmean(np.square(e[:, :steps]), axis=1)
                    for e in (error, everything["go on at the last velocity"])
                )
                block = min(max(1, round(_BLOCK / self.every)), len(mine) // 3)
                ratio, low, high = block_ratio(mine, theirs, block)
                row |= {
                    f"rms {length:g} s": float(np.sqrt(mine.mean())),
                    f"ratio {length:g} s": ratio,
                    f"low {length:g} s": low,
                    f"high {length:g} s": high,
                }
            rows[name] = row
        return pd.DataFrame(rows).T

    @cached_property
    def settings(self) -> dict[str, tuple[str, int]]:
        """The inputs and the window of each learner, by every second outage of the tuning part."""
        contest = self.contest
        begin, end = contest.start.time + self.longest, contest.split - self.longest
        starts = self._starts(begin, end)[::2]
        choices = [(inputs, window) for inputs in INPUTS for window in WINDOWS]
        return {
            name: min(
                choices,
                key=lambda c: float(np.nanmean(np.square(self._hybrid(name, starts, c)))),
            )
            for name in _LEARNERS
        }

    def _starts(self, begin: float, end: float) -> Whole:
        fixes, truth = self.contest.fixes, self.contest.truth
        states = np.hstack([self.contest.network.state, truth])
        there = np.asarray(np.isfinite(states).all(axis=1))
        there &= (fixes.time > begin) & (fixes.time + self.longest < end)
        after = np.arange(len(there)) + self.steps + 1
        heard = np.isfinite(states[:, 0])
        there &= (after < len(there)) & heard[np.minimum(after, len(there) - 1)]
        found: list[int] = []
        for k in np.flatnonzero(there):
            if not found or fixes.time[k] - fixes.time[found[-1]] >= self.every:
                found.append(int(k))
        if len(found) < 3:
            raise InswsnError(
                f"{self.contest.recording.name} has room for {len(found)} outages of "
                f"{self.longest:g} s; three are needed."
            )
        return np.array(found)

    def _ahead(self, starts: Whole) -> Whole:
        """Return the rows of the fixes that are withheld, (outages, steps)."""
        return np.asarray(starts[:, None] + 1 + np.arange(self.steps))

    def _apart(self, places: Array, starts: Whole) -> Array:
        """Return the distances of places (outages, steps, 2) from the truth."""
        return np.asarray(
            np.linalg.norm(places - self.contest.truth[self._ahead(starts), :2], axis=2)
        )

    def _carried(self, velocities: Array) -> Array:
        return self._on(np.hstack([self.contest.network.state[self.starts, :2], velocities]))

    def _on(self, states: Array) -> Array:
        """Return the errors of going straight on from states (outages, 4)."""
        time = self.contest.fixes.time
        passed = time[self._ahead(self.starts)] - time[self.starts, None]
        places = states[:, None, :2] + passed[:, :, None] * states[:, None, 2:]
        return self._apart(places, self.starts)

    @cached_property
    def _filtered(self) -> Array:
        solution, contest = self.contest.solutions[COLOURED], self.contest
        said = of_solution(solution, contest.recording.lever_arm, contest.fixes.time)
        return said.state[self.starts]

    def _straight(self) -> Array:
        """Return the errors of the straight line from the last fix to the next one."""
        time, state = self.contest.fixes.time, self.contest.network.state
        rows = self._ahead(self.starts)
        after = rows[:, -1] + 1
        share = (time[rows] - time[self.starts, None]) / (time[after] - time[self.starts])[:, None]
        first, last = (state[k, None, :2] for k in (self.starts, after))
        return self._apart(first + share[:, :, None] * (last - first), self.starts)

    def _coasting(self, *, smoothed: bool) -> Array:
        """Return the errors of the filter without fixes, or of its smoother with those after."""
        contest = self.contest
        solution = contest.solutions[COLOURED]
        force, rate, white, coloured, time = contest.tuned[COLOURED].best
        motion, found = contest.motion(force, rate), []
        for k in self.starts:
            event = int(solution.at(contest.fixes.time[k : k + 1])[0])
            n = solution.states[event].errors
            start = Start(
                float(contest.fixes.time[k]),
                replace(solution.states[event], own=np.zeros(0)),
                solution.covariances[event][:n, :n],
            )
            position = np.full_like(contest.fixes.position, np.nan)
            after = k + 1 + self.steps
            if smoothed:
                position[after : after + self.steps] = contest.fixes.position[
                    after : after + self.steps
                ]
            fixes = PositionFixes(
                replace(contest.fixes, position=position), contest.recording.lever_arm,
                white * UP, coloured * UP, np.full(3, time),
            )  # fmt: skip
            last = contest.fixes.time[min(after + self.steps * smoothed, len(position) - 1)]
            run = run_error_state(motion, start, [fixes], end=float(last))
            run = smooth(run) if smoothed else run
            said = of_solution(run, contest.recording.lever_arm, contest.fixes.time)
            found.append(said.state[k + 1 : after, :2])
        return self._apart(np.array(found), self.starts)

    def _hybrid(self, name: str, starts: Whole, choice: tuple[str, int] | None = None) -> Array:
        """Return the errors of P1's hybrid, whose filter and learner have an INS that drifts."""
        inputs, window = choice or self.settings[name]
        time, (ins, y) = self.contest.fixes.time, self._difference(starts)
        navigator = HybridNavigator(self._kalman, _LEARNERS[name](), window=window)
        run = navigator.run(y, observable_inputs(time[-len(ins) :], ins)[inputs])
        return self._corrected(run.estimates, starts)

    def _coasting_kalman(self) -> Array:
        """Return the errors of P1's filter alone, whose INS drifts."""
        return self._corrected(self._kalman(self._difference(self.starts)[1]), self.starts)

    def _kalman(self, measured: Array) -> Array:
        assert isinstance(self.contest, RecordedContest)
        model = difference_model(self.contest.period, *self.contest.tuned["KF"].best)
        return run_kalman(model, measured, initial_covariance=_UNKNOWN)

    def _difference(self, starts: Whole) -> tuple[Array, Array]:
        """Return an INS that drifts, (rows, 4), and INS less network, (rows, 4, outages)."""
        assert isinstance(self.contest, RecordedContest)
        ins, network = self.contest.difference.ins, self.contest.network.state
        first = int(np.flatnonzero(np.isfinite(ins).all(axis=1))[0])
        y = np.repeat((ins - network)[first:, :, None], len(starts), axis=2)
        for outage, k in enumerate(starts - first):
            y[k + 1 : k + 1 + self.steps, :, outage] = np.nan
            y[k + 1 + self.steps :, :, outage] = 0.0  # after the outage nobody asks
        return ins[first:], y

    def _corrected(self, errors: Array, starts: Whole) -> Array:
        """Return the errors of the INS less its errors (rows, 4, outages), in the outages."""
        assert isinstance(self.contest, RecordedContest)
        places = self.contest.difference.ins[-len(errors) :, :2, None] - errors[:, :2]
        ahead = self._ahead(starts) - (len(self.contest.fixes) - len(errors))
        return self._apart(np.array([places[steps, :, k] for k, steps in enumerate(ahead)]), starts)
