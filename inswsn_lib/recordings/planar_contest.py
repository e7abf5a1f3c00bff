"""Filters on a recording of a vehicle on a plane, with odometry and ranges."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import pandas as pd

from inswsn_lib.checks import Array, Mask
from inswsn_lib.errors import InswsnError
from inswsn_lib.estimation import (
    OdometryMotion,
    OdometryNoise,
    PositionFixes,
    RangesToAnchors,
    Solution,
    Start,
    align_planar,
    multilaterate_track,
    run_error_state,
    smooth,
)
from inswsn_lib.evaluation import Tuning, search_pattern
from inswsn_lib.recordings.contest import TRIALS, Contestant
from inswsn_lib.recordings.estimates import Estimate, lag_one, of_solution, scores, unlikely
from inswsn_lib.streams import Fixes, Odometry, Ranges, Recording, Whole

_GATE = 16.0
_WALKS = (1e-3, 1e-5)  # of scale, 1/s^0.5, and of the rate's bias, rad/s/s^0.5
_SCALE = 0.1  # deviation of a scale that all ranges have in common
_DRIVE = ((0.05, 0.02), (2.0, 2.0))  # noises of speed and rate


@dataclass(frozen=True, eq=False)
class PlanarContest:
    """Odometry alone, multilateration alone, and filters of both, on equal terms.

    Filters are tuned by the likelihood of their innovations in the first part, and judged on the
    rest. They start from a heading that the first ranges tell. Nobody's velocity is judged.

    Attributes
    ----------
    recording : Recording
        With odometry, ranges to anchors on the plane, and a reference to judge by.
    window : float
        Of multilateration, s: a fix takes the ranges of so long.
    share : float
        Of the time between the first and the last fix in which filters are tuned.
    alignment : float
        For how long the start is aligned, s.
    trials : int
        Of each search.

    Raises
    ------
    InswsnError
        If a stream is missing, or the alignment does not tell the heading.

    Examples
    --------
    >>> from inswsn_lib.recordings import PlanarContest
    >>> from inswsn_lib.streams import Recording
    >>> PlanarContest(Recording("empty"), window=1.0).table()
    Traceback (most recent call last):
    ...
    inswsn_lib.errors.InswsnError: The recording empty has no odometry: this contest needs one.
    """

    recording: Recording
    window: float
    share: float = 0.5
    alignment: float = 10.0
    trials: int = TRIALS

    @cached_property
    def streams(self) -> tuple[Odometry, Ranges]:
        """Odometry, and the ranges while it is on."""
        found = {name: getattr(self.recording, name) for name in ("odometry", "ranges")}
        for name in ("odometry", "ranges", "reference"):
            if getattr(self.recording, name) is None:
                raise InswsnError(
                    f"The recording {self.recording.name} has no {name}: this contest needs one."
                )
        odometry, ranges = found["odometry"], found["ranges"]
        return odometry, ranges.part(float(odometry.time[0]), float(odometry.time[-1]))

    @cached_property
    def fixes(self) -> Fixes:
        """The network alone; a fix is stamped at the end of its window, when it is there."""
        ranges = self.streams[1]
        fixes = multilaterate_track(ranges, self.window)
        ends = ranges.time[0] + self.window * (
            1 + np.floor((fixes.time - ranges.time[0]) / self.window)
        )
        return replace(fixes, time=np.minimum(ends, ranges.time[-1]))

    @property
    def split(self) -> float:
        """Until when filters are tuned, s."""
        first, last = self.fixes.time[[0, -1]]
        return float(first + self.share * (last - first))

    @cached_property
    def truth(self) -> Array:
        """Position of the tag at the times of fixes, (fixes, 2), m."""
        reference = self.recording.reference
        assert reference is not None  # asked by `streams`
        return np.column_stack(
            [np.interp(self.fixes.time, reference.time, x) for x in reference.position.T[:2]]
        )

    @cached_property
    def start(self) -> Start:
        """Where filters start."""
        ranges = self.streams[1]
        begin = float(ranges.time[0]) - 1e-3
        motion = self._motion(*_DRIVE[0])
        heard = RangesToAnchors(ranges, self._arm, white=0.5, bias=0.5, scale=_SCALE)
        place = self.fixes.position[np.isfinite(self.fixes.position).all(axis=1)][0]
        wide = (3.0, 0.1, 0.02)
        return align_planar(motion, [heard], begin, begin + self.alignment, place, wide)

    @cached_property
    def contestants(self) -> dict[str, Contestant]:
        """The filters."""
        (begin, ratios), deviation = _DRIVE, self.fixes.deviation
        assert deviation is not None  # multilateration has it
        size = float(np.nanmedian(deviation))
        return {
            "loosely coupled, coloured fixes": Contestant(
                self.loose, (*begin, size / 2, size, 3.0), (*ratios, 2.0, 2.0, 2.0)
            ),
            "tightly coupled, biases and a scale": Contestant(
                self.tight, (*begin, 0.2, 0.1, 3.0, 0.1), (*ratios, 2.0, 2.0, 2.0, 3.0)
            ),
        }

    def loose(
        self, speed: float, rate: float, white: float, coloured: float, time: float,
        *, end: float = np.inf, kept: bool = True,
    ) -> Solution:  # fmt: skip
        """Run the filter on fixes.

        Parameters
        ----------
        speed, rate : float
            Of `OdometryNoise`.
        white, coloured : float
            Standard deviations of fixes, m.
        time : float
            Of the coloured errors, s.
        end, kept
            When the data end, s, and what is kept, as in `run_error_state`.
        """
        ones = np.ones(2)
        fixes = PositionFixes(self.fixes, self._arm, white * ones, coloured * ones, time * ones)
        return run_error_state(self._motion(speed, rate), self.start, [fixes], end=end, kept=kept)

    def tight(
        self, speed: float, rate: float, white: float, coloured: float, time: float, bias: float,
        *, end: float = np.inf, kept: bool = True,
    ) -> Solution:  # fmt: skip
        """Run the filter on ranges, with a bias of each anchor and a scale of all.

        Parameters
        ----------
        speed, rate : float
            Of `OdometryNoise`.
        white, coloured : float
            Standard deviations of ranges, m.
        time : float
            Of the coloured errors, s.
        bias : float
            Standard deviation of the bias of an anchor, m.
        end, kept
            When the data end, s, and what is kept, as in `run_error_state`.
        """
        ranges = RangesToAnchors(
            self.streams[1], self._arm, white, bias, coloured, time, scale=_SCALE
        )
        motion = self._motion(speed, rate)
        return run_error_state(
            motion, self.start, [ranges, self._silent], end=end, kept=kept, gate=_GATE
        )

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
        """Dead reckoning, the filters with their numbers, and the smoother of the tight one."""
        found = {
            "odometry alone": run_error_state(self._motion(*_DRIVE[0]), self.start, [self._silent])
        }
        for name, each in self.contestants.items():
            found[name] = each.run(*self.tuned[name].best)
        return found | {"smoother": smooth(found["tightly coupled, biases and a scale"])}

    @cached_property
    def estimates(self) -> dict[str, Estimate]:
        """What every method says at the times of fixes; the network first."""
        found = {"network alone": Estimate(self.fixes.position)}
        for name, solution in self.solutions.items():
            found[name] = of_solution(solution, self._arm, self.fixes.time).places()
        return found

    @cached_property
    def judged(self) -> Mask:
        """The fixes after the split, where there is one."""
        there = np.isfinite(self.fixes.position).all(axis=1)
        return np.asarray(there & (self.fixes.time > max(self.split, self.start.time)))

    def table(self) -> pd.DataFrame:
        """Return the scores of every method on the judged fixes, as `RecordedContest.table`."""
        rows = self.judged
        network = self.fixes.position[rows] - self.truth[rows]
        found = {}
        for name, each in self.estimates.items():
            found[name] = scores(each.part(rows), self.truth[rows], network, self.window)
        for name in self.contestants:
            found[name] |= lag_one(self.solutions[name], self._labels(name), self.split)
        table = pd.DataFrame(found).T
        return table.assign(causal=[name != "smoother" for name in table.index])

    def _labels(self, name: str) -> Whole:
        """Return which series each component of the innovations is of: an axis, or an anchor."""
        if name.startswith("tight"):
            ranges = self.streams[1]
            return ranges.anchor[ranges.time > self.start.time]
        there = np.isfinite(self.fixes.position)[self.fixes.time > self.start.time]
        return np.asarray(np.nonzero(there)[1], dtype=np.int64)

    @property
    def _silent(self) -> PositionFixes:
        nothing = replace(self.fixes, position=np.full_like(self.fixes.position, np.nan))
        return PositionFixes(nothing, self._arm, np.ones(2))

    @property
    def _arm(self) -> Array:
        return np.asarray(self.recording.lever_arm[:2])

    def _motion(self, speed: float, rate: float) -> OdometryMotion:
        return OdometryMotion(self.streams[0], OdometryNoise(speed, rate, *_WALKS))
