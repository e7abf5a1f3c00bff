"""Filters on a recording with an IMU and fixes or ranges, tuned on its first part."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, ClassVar

import numpy as np
import pandas as pd

from inswsn_lib.calibration import multilaterate_track, slope_velocity
from inswsn_lib.checks import Array, Mask
from inswsn_lib.errors import InswsnError
from inswsn_lib.evaluation import Tuning, search_pattern
from inswsn_lib.inertial import (
    ImuNoise,
    InertialMotion,
    PositionFixes,
    RangesToAnchors,
    Solution,
    Start,
    run_error_state,
    smooth,
    smooth_with_lag,
)
from inswsn_lib.recordings.correction import GATE, UP, WALKS, InertialCorrection
from inswsn_lib.recordings.difference_filters import FAMILIES, DifferenceFilters, Family
from inswsn_lib.recordings.estimates import (
    Estimate,
    lag_one,
    of_solution,
    scores,
    truth_at,
    unlikely,
)
from inswsn_lib.streams import Fixes, Ranges, Recording, Whole

#: Trials that the search for the numbers of a filter has
TRIALS = 24
_LAG = 2.0  # s, of the fixed-lag smoother
#: The filter that others are compared with
COLOURED = "loosely coupled, coloured fixes"
_AXES = (2.0, 2.0, 1.5)  # ratios of the steps of a search


@dataclass(frozen=True, eq=False)
class Contestant:
    """An error-state filter, where the search for its numbers begins, and its steps.

    Attributes
    ----------
    run : callable
        Takes the numbers, the time at which the data end, s, and what is kept.
    begin, ratios : sequence of float
    """

    run: Callable[..., Solution]
    begin: Sequence[float]
    ratios: Sequence[float]


@dataclass(frozen=True, eq=False)
class FixesContest:
    """The loosely coupled filter on a recording with an IMU and fixes, and its smoothers.

    It is tuned by the likelihood of its innovations on the first part of the recording. The fixes
    that are called good stand for the truth: only while they are withheld does a method face it.

    Attributes
    ----------
    recording : Recording
        With an IMU and fixes, as of satellites.
    share : float
        Of the time between the first and the last fix in which filters are tuned.
    alignment : float
        For how long after the first fix the start is aligned, s.
    trials : int
        Of each search.

    Raises
    ------
    InswsnError
        If a stream is missing, or the alignment does not tell the heading.

    Examples
    --------
    >>> from inswsn_lib.recordings import FixesContest
    >>> from inswsn_lib.streams import Recording
    >>> FixesContest(Recording("empty")).start
    Traceback (most recent call last):
    ...
    inswsn_lib.errors.InswsnError: The recording empty has no imu: a contest of filters needs one.
    """

    recording: Recording
    share: float = 0.5
    alignment: float = 20.0
    trials: int = TRIALS
    needed: ClassVar[Sequence[str]] = ("imu", "fixes")
    begin: ClassVar[Sequence[float]] = (0.05, 0.002, 0.02, 0.02, 3.0)

    @cached_property
    def moved(self) -> Any:
        """The IMU or the odometry, of a recording that has all that is needed."""
        for name in self.needed:
            if getattr(self.recording, name) is None:
                raise InswsnError(
                    f"The recording {self.recording.name} has no {name}: a contest of filters "
                    "needs one."
                )
        return getattr(self.recording, self.needed[0])

    @cached_property
    def fixes(self) -> Fixes:
        """Those while the IMU is on, with the velocity of a line through five where none is."""
        begin, end = self.moved.time[[0, -1]]
        assert self.recording.fixes is not None
        fixes = self.recording.fixes.part(float(begin), float(end))
        return fixes if fixes.velocity is not None else slope_velocity(fixes)

    @property
    def split(self) -> float:
        """Until when filters are tuned, s."""
        first, last = self.fixes.time[[0, -1]]
        return float(first + self.share * (last - first))

    @cached_property
    def truth(self) -> Array:
        """Horizontal position and velocity at the times of fixes, (fixes, 4); NaN if not good."""
        good = self.fixes.good
        state = self.network.state.copy()
        if good is not None:
            state[~good] = np.nan
        return state

    @cached_property
    def start(self) -> Start:
        """Where filters start, aligned on the first fixes."""
        return InertialCorrection(self.recording, self.fixes, self.alignment).start

    @cached_property
    def network(self) -> Estimate:
        """What the fixes alone say."""
        assert self.fixes.velocity is not None
        return Estimate(np.hstack([self.fixes.position[:, :2], self.fixes.velocity[:, :2]]))

    @cached_property
    def contestants(self) -> dict[str, Contestant]:
        """The error-state filters."""
        return {COLOURED: Contestant(self.loose, self.begin, (*_AXES, 1.5, 1.5))}

    def loose(
        self, force: float, rate: float, white: float, coloured: float = 0.0, time: float = 1.0,
        *, end: float = np.inf, kept: bool = True,
    ) -> Solution:  # fmt: skip
        """Run the loosely coupled filter, on fixes.

        Parameters
        ----------
        force, rate : float
            Of `ImuNoise`.
        white, coloured : float
            Standard deviations of fixes to the side, m; upwards they are taken twice as large.
        time : float
            Of the coloured errors, s.
        end, kept
            When the data end, s, and what is kept, as in `run_error_state`.
        """
        up = UP[: len(self.arm)]
        colour = (coloured * up, np.full(len(up), time)) if coloured else ()
        fixes = PositionFixes(self.fixes, self.arm, white * up, *colour)
        return run_error_state(self.motion(force, rate), self.start, [fixes], end=end, kept=kept)

    @cached_property
    def tuned(self) -> dict[str, Tuning[tuple[float, ...]]]:
        """The searches, by the likelihood of innovations up to the split."""
        return {
            name: search_pattern(
                name, each.begin, each.ratios, unlikely(each.run, self.split), most=self.trials
            )
            for name, each in self.contestants.items()
        }

    @cached_property
    def solutions(self) -> dict[str, Solution]:
        """The error-state filters with their numbers, and smoothers of the coloured loose one."""
        found = {n: each.run(*self.tuned[n].best) for n, each in self.contestants.items()}
        return found | {
            f"fixed-lag smoother, {_LAG:g} s": smooth_with_lag(found[COLOURED], _LAG),
            "smoother": smooth(found[COLOURED]),
        }

    @property
    def arm(self) -> Array:
        """The lever arm, as long as a fix has components, m."""
        return np.asarray(self.recording.lever_arm[: self.fixes.position.shape[1]])

    def motion(self, force: float, rate: float) -> Any:
        """Return the integration of the IMU with these noises of `ImuNoise`.

        Parameters
        ----------
        force, rate : float
        """
        return InertialMotion.of(self.recording, ImuNoise(force, rate, *WALKS))

    @property
    def silent(self) -> PositionFixes:
        """The times of fixes without any: events at which a filter says where it is."""
        nothing = replace(self.fixes, position=np.full_like(self.fixes.position, np.nan))
        return PositionFixes(nothing, 0 * self.arm, np.ones(len(self.arm)))


@dataclass(frozen=True, eq=False)
class RecordedContest(FixesContest):
    """Filters on one recording on equal terms, and the network that they must beat.

    The network is multilateration of the ranges of each period, with the velocity of a line through
    five fixes. Filters are tuned on the first part of the recording, with the same trials each, and
    judged on the rest: those that have a likelihood by that of their innovations, which asks for no
    reference; those of P1's form by their errors. What is called causal uses nothing later, but for
    the IMU's sample after a fix (10 ms at 100 Hz) and the scale of the robust loss of
    `multilaterate_track`, which is of the whole recording.

    Attributes
    ----------
    recording : Recording
        With an IMU, ranges to anchors in three dimensions, and a reference to judge by.
    share, alignment, trials
        As of `FixesContest`.
    period : float
        Of the network's fixes, s.

    Raises
    ------
    InswsnError
        If a stream is missing, or the alignment does not tell the heading.

    Examples
    --------
    >>> from inswsn_lib.recordings import RecordedContest
    >>> from inswsn_lib.streams import Recording
    >>> RecordedContest(Recording("empty")).table()
    Traceback (most recent call last):
    ...
    inswsn_lib.errors.InswsnError: The recording empty has no imu: a contest of filters needs one.
    """

    period: float = 0.2
    scale: ClassVar[float] = 0.0  # deviation of a scale that all ranges have in common
    families: ClassVar[Mapping[str, Family]] = FAMILIES  # of filters of P1's form
    needed: ClassVar[Sequence[str]] = ("imu", "ranges", "reference")
    begin: ClassVar[Sequence[float]] = (0.02, 0.002, 0.04, 0.08, 3.0)

    @cached_property
    def heard(self) -> Ranges:
        """The ranges while the IMU or the odometry is on."""
        begin, end = self.moved.time[[0, -1]]
        assert self.recording.ranges is not None
        return self.recording.ranges.part(float(begin), float(end))

    @cached_property
    def fixes(self) -> Fixes:
        """The network."""
        return slope_velocity(multilaterate_track(self.heard, self.period))

    @cached_property
    def truth(self) -> Array:
        """Horizontal position and velocity of the tag at the times of fixes, (fixes, 4)."""
        return truth_at(self.recording, self.fixes.time)

    @cached_property
    def usable(self) -> Mask:
        """The fixes at which network and reference say where the tag is, after the alignment."""
        there = np.isfinite(np.column_stack([self.network.state, self.truth])).all(axis=1)
        return np.asarray(there & (self.fixes.time > self.start.time))

    @property
    def judged(self) -> Mask:
        """The usable fixes after the split."""
        return self.usable & (self.fixes.time > self.split)

    @cached_property
    def difference(self) -> DifferenceFilters:
        """P1's form: an INS that is never corrected, and filters of its difference to fixes.

        :meta private:
        """
        free = run_error_state(self.motion(0.02, 0.002), self.start, [self.silent])
        ins = of_solution(free, self.recording.lever_arm, self.fixes.time)
        return DifferenceFilters(ins.state, self.network.state, self.period)

    @cached_property
    def contestants(self) -> dict[str, Contestant]:
        """The error-state filters."""
        white = Contestant(self.loose, (0.02, 0.002, 0.1), _AXES)
        tight = (0.02, 0.001, 0.05, 0.06, 1.0, 0.02), (*_AXES, 1.5, 2.0, 2.0)
        return {
            "loosely coupled, white fixes": white,
            **super().contestants,
            "tightly coupled, coloured ranges": Contestant(self.tight, *tight),
        }

    def tight(
        self, force: float, rate: float, white: float, coloured: float, time: float, bias: float,
        *, end: float = np.inf, kept: bool = True,
    ) -> Solution:  # fmt: skip
        """Run the tightly coupled filter, on ranges, each anchor with a bias and a coloured error.

        Parameters
        ----------
        force, rate : float
            Of `ImuNoise`.
        white, coloured : float
            Standard deviations of ranges, m.
        time : float
            Of the coloured errors, s.
        bias : float
            Standard deviation of a constant bias of each anchor, m; 0 for none.
        end, kept
            When the data end, s, and what is kept, as in `run_error_state`.
        """
        ranges = RangesToAnchors(
            self.heard, self.arm, white, bias, coloured, time, scale=self.scale
        )
        motion = self.motion(force, rate)
        return run_error_state(
            motion, self.start, [ranges, self.silent], end=end, kept=kept, gate=GATE
        )

    @cached_property
    def tuned(self) -> dict[str, Tuning[tuple[float, ...]]]:
        """The searches: by the likelihood of innovations, or by errors, up to the split."""
        found = super().tuned
        first = self.usable & (self.fixes.time <= self.split)
        for name, family in self.families.items():
            found[name] = search_pattern(
                name, family.begin, family.ratios, self._erring(name, first), most=self.trials
            )
        return found

    @cached_property
    def estimates(self) -> dict[str, Estimate]:
        """What every method says at the times of fixes; the network first, smoothers last."""
        found = {"network alone": self.network} | {
            name: self.difference.run(name, *self.tuned[name].best) for name in FAMILIES
        }
        found |= {"P1's published HF, predicted": self.difference.published}
        for name, solution in self.solutions.items():
            found[name] = of_solution(solution, self.recording.lever_arm, self.fixes.time)
        return found

    def table(self) -> pd.DataFrame:
        """Return the scores of every method on the judged fixes.

        Returns
        -------
        DataFrame
            RMS errors ``position`` (m) and ``velocity`` (m/s), horizontal; their ratios to those of
            the network with intervals by a block bootstrap (``position_ratio``, ``position_low``,
            ``position_high``, and of velocity); ``nees`` of both, over 4; ``nis`` and ``lag1``, the
            largest autocorrelation of neighbouring innovations, over all components, if they are
            known; ``causal``.
        """
        rows = self.judged
        network = self.network.state[rows] - self.truth[rows]
        found = {}
        for name, each in self.estimates.items():
            found[name] = scores(each.part(rows), self.truth[rows], network, self.period)
        for name in self.contestants:
            found[name] |= lag_one(self.solutions[name], self._labels(name), self.split)
        table = pd.DataFrame(found).T
        return table.assign(causal=[not name.endswith(("smoother", " s")) for name in table.index])

    def compare(self, name: str, other: str) -> dict[str, tuple[float, float, float]]:
        """Return RMS errors of a method over those of another on the judged fixes, with intervals.

        Parameters
        ----------
        name, other : str
            Rows of `table`.

        Returns
        -------
        dict of str to (ratio, low, high)
            Of ``position`` and ``velocity``, by the block bootstrap of `table`.
        """
        rows = self.judged
        theirs = self.estimates[other].state[rows] - self.truth[rows]
        found = scores(self.estimates[name].part(rows), self.truth[rows], theirs, self.period)
        ends = ("ratio", "low", "high")
        ratios = {of: [found[f"{of}_{end}"] for end in ends] for of in ("position", "velocity")}
        return {of: (ratio, low, high) for of, (ratio, low, high) in ratios.items()}

    def _labels(self, name: str) -> Whole:
        """Return which series each component of the innovations is of: an axis, or an anchor."""
        if name.startswith("tight"):
            return self.heard.anchor[self.heard.time > self.start.time]
        there = np.isfinite(self.fixes.position)[self.fixes.time > self.start.time]
        return np.asarray(np.nonzero(there)[1], dtype=np.int64)

    def _erring(self, name: str, rows: Mask) -> Callable[..., float]:
        """Return the loss of a filter of P1's form: errors over the network's, mean of both."""
        network = np.square(self.network.state - self.truth)[rows]

        def loss(*numbers: float) -> float:
            squares = np.square(self.difference.run(name, *numbers).state - self.truth)[rows]
            halves = [
                np.sqrt(squares[:, part].sum() / network[:, part].sum())
                for part in (slice(0, 2), slice(2, 4))
            ]
            return float(np.mean(halves))

        return loss
