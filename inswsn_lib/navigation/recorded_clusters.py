"""Two clusters of anchors in a recording, whose fixes are fused: P2's setting on recorded data."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import pandas as pd

from inswsn_lib.checks import Array, Mask
from inswsn_lib.errors import InswsnError
from inswsn_lib.filters import intersect
from inswsn_lib.inertial import PositionFixes
from inswsn_lib.logs import Ladder, multilaterate_track
from inswsn_lib.logs.correction import COLOURED
from inswsn_lib.logs.estimates import Estimate, scores
from inswsn_lib.logs.network_fixes import UP
from inswsn_lib.streams import Fixes, Ranges, Whole


@dataclass(frozen=True, eq=False)
class RecordedClusters:
    """Fixes by two halves of the anchors, and what fusion makes of them.

    The anchors are taken in the order of their direction from the middle of all, every other one
    for each cluster. What a fusion must know of errors, their covariance over both clusters, is
    measured in the first part of the recording, against the reference; all is judged on the rest.

    Attributes
    ----------
    ladder : Ladder
        With eight anchors or more.

    Examples
    --------
    >>> from inswsn_lib.navigation import RecordedClusters
    >>> from inswsn_lib.logs import Ladder
    >>> from inswsn_lib.streams import Recording
    >>> RecordedClusters(Ladder(Recording("empty"))).fixes
    Traceback (most recent call last):
    ...
    inswsn_lib.errors.InswsnError: The recording empty has no ranges to cluster.
    """

    ladder: Ladder

    @cached_property
    def fixes(self) -> tuple[Fixes, Fixes]:
        """Those of each cluster."""
        heard = self.ladder.recording.ranges
        if heard is None:
            raise InswsnError(
                f"The recording {self.ladder.recording.name} has no ranges to cluster."
            )
        place = heard.anchors[:, :2] - heard.anchors[:, :2].mean(axis=0)
        order = np.argsort(np.arctan2(place[:, 1], place[:, 0]))
        first, second = (
            multilaterate_track(_only(heard, order[half::2]), self.ladder.window) for half in (0, 1)
        )
        return first, second

    @cached_property
    def positions(self) -> Array:
        """Horizontal fixes of both clusters at the network's times, (2, fixes, 2); NaN if none."""
        times = self.ladder.fixes.time
        return np.stack([_nearest(each, times, self.ladder.window / 2) for each in self.fixes])

    @cached_property
    def errors(self) -> Array:
        """Errors of both clusters, x and y of the first and of the second, (fixes, 4)."""
        return np.hstack(list(self.positions - self.ladder.truth[:, :2]))

    @cached_property
    def covariance(self) -> Array:
        """Of these errors about zero, in the first part, (4, 4)."""
        first = self.ladder.usable & (self.ladder.fixes.time <= self.ladder.split)
        errors = self.errors[first & np.isfinite(self.errors).all(axis=1)]
        return np.asarray(errors.T @ errors / len(errors))

    @property
    def correlation(self) -> tuple[float, float]:
        """Of the errors of both clusters along x and along y, on the judged fixes."""
        x, y, others_x, others_y = self.errors[self.judged].T
        both = [(x, others_x), (y, others_y)]
        along_x, along_y = (float(np.asarray(np.corrcoef(*pair))[0, 1]) for pair in both)
        return along_x, along_y

    @cached_property
    def judged(self) -> Mask:
        """The judged fixes of the contest at which both clusters have one."""
        return np.asarray(self.ladder.judged & np.isfinite(self.errors).all(axis=1))

    @cached_property
    def estimates(self) -> dict[str, Estimate]:
        """Horizontal positions by each method at the network's times."""
        P, (one, two) = self.covariance, self.positions
        blocks = np.stack([P[:2, :2], P[2:, 2:]])
        independent = P * np.kron(np.eye(2), np.ones((2, 2)))
        return {
            "first cluster alone": Estimate(one),
            "second cluster alone": Estimate(two),
            "mean of both": Estimate((one + two) / 2),
            "weighted, as if independent": self._weighted(independent),
            "covariance intersection": self._intersected(blocks),
            "weighted, correlation known": self._weighted(P),
            "all anchors at once": self.ladder.network.places(),
            "filter on the fixes of both": self._filtered(),
            "filter on all anchors at once": self.ladder.estimates[COLOURED].places(),
        }

    def table(self) -> pd.DataFrame:
        """Return the scores on the judged fixes, with ratios to *all anchors at once*.

        Returns
        -------
        DataFrame
            ``position`` (m), ``position_ratio``, ``position_low``, ``position_high`` by
            `block_ratio`, and ``nees`` over 2 of what says a covariance.
        """
        rows, truth = self.judged, self.ladder.truth[:, :2]
        others = self.ladder.network.state[rows, :2] - truth[rows]
        found = {
            name: scores(each.part(rows), truth[rows], others)
            for name, each in self.estimates.items()
        }
        return pd.DataFrame(found).T

    def _weighted(self, covariance: Array) -> Estimate:
        """Return the best linear fusion for a covariance of both (Bar-Shalom and Campo 1986)."""
        H = np.vstack([np.eye(2), np.eye(2)])
        information = np.linalg.solve(covariance, H)
        fused = np.linalg.inv(H.T @ information)
        state = np.hstack(list(self.positions)) @ information @ fused
        return Estimate(state, np.tile(fused, (len(state), 1, 1)))

    def _intersected(self, blocks: Array) -> Estimate:
        there = np.isfinite(self.errors).all(axis=1)
        both = self.positions[:, there].transpose(0, 2, 1)
        state = np.full(self.positions.shape[1:], np.nan)
        fused, P = intersect(both, blocks, weights="trace")
        state[there] = fused.T
        return Estimate(state, np.tile(P, (len(state), 1, 1)))

    def _filtered(self) -> Estimate:
        """Return the loosely coupled filter on both clusters, each with its own coloured errors.

        Its noises are those tuned for all anchors, times what the errors of a cluster are larger by
        in the first part.
        """
        ladder = self.ladder
        force, rate, white, coloured, time = ladder.tuned(COLOURED).best
        first = ladder.usable & (ladder.fixes.time <= ladder.split)
        whole = np.square(ladder.network.state - ladder.truth)[first, :2].mean()
        larger = np.sqrt(np.diag(self.covariance).reshape(2, 2).mean(axis=1) / whole)
        both = [
            PositionFixes(
                fixes, ladder.recording.lever_arm, more * white * UP, more * coloured * UP,
                np.full(3, time),
            )
            for fixes, more in zip(self.fixes, larger, strict=True)
        ]  # fmt: skip
        return ladder.of(ladder.filters.run(both, force, rate)).places()


def _only(ranges: Ranges, anchors: Whole) -> Ranges:
    return ranges.kept(np.isin(ranges.anchor, anchors))


def _nearest(fixes: Fixes, times: Array, most: float) -> Array:
    """Return the horizontal positions whose stamps are nearest to some times, or NaN."""
    after = np.clip(np.searchsorted(fixes.time, times), 1, len(fixes) - 1)
    earlier = times - fixes.time[after - 1] < fixes.time[after] - times
    row = np.where(earlier, after - 1, after)
    there = np.abs(fixes.time[row] - times) <= most
    return np.where(there[:, None], fixes.position[row, :2], np.nan)
