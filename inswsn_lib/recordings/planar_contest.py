"""Filters on a recording of a vehicle on a plane, with odometry and ranges."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import ClassVar

import numpy as np

from inswsn_lib.calibration import multilaterate_track
from inswsn_lib.checks import Array
from inswsn_lib.inertial import (
    OdometryMotion,
    OdometryNoise,
    RangesToAnchors,
    Solution,
    Start,
    align_planar,
    run_error_state,
    smooth,
)
from inswsn_lib.recordings.contest import COLOURED, Contestant, RecordedContest
from inswsn_lib.recordings.difference_filters import Family
from inswsn_lib.recordings.estimates import Estimate, of_solution
from inswsn_lib.streams import Fixes

_WALKS = (1e-3, 1e-5)  # of scale, 1/s^0.5, and of the rate's bias, rad/s/s^0.5
_DRIVE = ((0.05, 0.02), (2.0, 2.0))  # noises of speed and rate
_TIGHT = "tightly coupled, biases and a scale"


@dataclass(frozen=True, eq=False)
class PlanarContest(RecordedContest):
    """Odometry alone, multilateration alone, and filters of both, on equal terms.

    A `RecordedContest` on the plane: ``force`` and ``rate`` are the noises of `OdometryNoise`.
    Filters start from a heading that the first ranges tell. Nobody's velocity is judged.

    Attributes
    ----------
    recording : Recording
        With odometry, ranges to anchors on the plane, and a reference to judge by.
    share, alignment, trials, period
        As of `RecordedContest`; a fix takes the ranges of a period.

    Raises
    ------
    InswsnError
        If a stream is missing, or the alignment does not tell the heading.

    Examples
    --------
    >>> from inswsn_lib.recordings import PlanarContest
    >>> from inswsn_lib.streams import Recording
    >>> PlanarContest(Recording("a")).table()
    Traceback (most recent call last):
    ...
    inswsn_lib.errors.InswsnError: The recording a has no odometry: a contest of filters needs one.
    """

    alignment: float = 10.0
    period: float = 1.0
    scale: ClassVar[float] = 0.1
    families: ClassVar[Mapping[str, Family]] = {}
    needed: ClassVar[Sequence[str]] = ("odometry", "ranges", "reference")

    @cached_property
    def fixes(self) -> Fixes:
        """The network alone; a fix is stamped at the end of its window, when it is there."""
        fixes, first = multilaterate_track(self.heard, self.period), self.heard.time[0]
        ends = first + self.period * (1 + np.floor((fixes.time - first) / self.period))
        return replace(fixes, time=np.minimum(ends, self.heard.time[-1]))

    @cached_property
    def network(self) -> Estimate:
        """What the fixes alone say."""
        return Estimate(self.fixes.position)

    @cached_property
    def truth(self) -> Array:
        """Position of the tag at the times of fixes, (fixes, 2), m."""
        reference = self.recording.reference
        assert reference is not None  # asked by `moved`
        return np.column_stack(
            [np.interp(self.fixes.time, reference.time, x) for x in reference.position.T[:2]]
        )

    @cached_property
    def start(self) -> Start:
        """Where filters start."""
        begin = float(self.heard.time[0]) - 1e-3
        heard = RangesToAnchors(self.heard, self.arm, white=0.5, bias=0.5, scale=self.scale)
        place = self.fixes.position[np.isfinite(self.fixes.position).all(axis=1)][0]
        wide = (3.0, 0.1, 0.02)
        motion = self.motion(*_DRIVE[0])
        return align_planar(motion, [heard], begin, begin + self.alignment, place, wide)

    @cached_property
    def contestants(self) -> dict[str, Contestant]:
        """The filters."""
        (begin, ratios), deviation = _DRIVE, self.fixes.deviation
        assert deviation is not None  # multilateration has it
        size = float(np.nanmedian(deviation))
        loose = (*begin, size / 2, size, 3.0), (*ratios, 2.0, 2.0, 2.0)
        tight = (*begin, 0.2, 0.1, 3.0, 0.1), (*ratios, 2.0, 2.0, 2.0, 3.0)
        return {COLOURED: Contestant(self.loose, *loose), _TIGHT: Contestant(self.tight, *tight)}

    @cached_property
    def solutions(self) -> dict[str, Solution]:
        """Dead reckoning, the filters with their numbers, and the smoother of the tight one."""
        alone = run_error_state(self.motion(*_DRIVE[0]), self.start, [self.silent])
        found = {n: each.run(*self.tuned[n].best) for n, each in self.contestants.items()}
        return {"odometry alone": alone, **found, "smoother": smooth(found[_TIGHT])}

    @cached_property
    def estimates(self) -> dict[str, Estimate]:
        """What every method says at the times of fixes; the network first."""
        return {"network alone": self.network} | {
            name: of_solution(solution, self.arm, self.fixes.time).places()
            for name, solution in self.solutions.items()
        }

    def motion(self, force: float, rate: float) -> OdometryMotion:
        """Return the integration of the odometry with these noises of `OdometryNoise`.

        Parameters
        ----------
        force, rate : float
            Of the speed and of the rate of turn.
        """
        return OdometryMotion(self.moved, OdometryNoise(force, rate, *_WALKS))
