"""Filters on a recording with ranges, an IMU and a reference: tuned on its first part, judged after.

The network comes first: fixes by multilateration, a velocity by a line through the last of them.
Filters whose noise has figures are tuned by the likelihood of their innovations, which asks for no
reference; those without a likelihood by their errors in the first part.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import pandas as pd
from scipy.spatial.transform import Rotation, Slerp

from inswsn_lib.checks import Array, Mask
from inswsn_lib.errors import InswsnError
from inswsn_lib.estimation import (
    ImuNoise,
    InertialMotion,
    Observation,
    PositionFixes,
    RangesToAnchors,
    Solution,
    Start,
    align,
    run_error_state,
    smooth,
    smooth_with_lag,
)
from inswsn_lib.evaluation import Tuning, cluster_mean, search_pattern
from inswsn_lib.recordings import Fixes, Recording, multilaterate_track, slope_velocity

#: The most trials that the search for the numbers of a filter has
TRIALS = 48
#: Bootstrap of blocks of this length, s
BLOCK = 10.0
# of the Gauss-Markov walks of biases, which no short recording tells
_WALKS = (1e-3, 1e-4)
# Ranges farther from what is expected than this many deviations squared are left out
_GATE = 16.0
_HALF_WINDOW = 0.075  # s, of the line that makes a velocity of the reference


@dataclass(frozen=True, eq=False)
class Estimate:
    """What a method says at the times of fixes.

    Attributes
    ----------
    position, velocity : ndarray, (fixes, 2)
        Horizontal, of the antenna, m and m/s; NaN where it says nothing.
    covariance : ndarray, (fixes, 4, 4), or None
        Of both, if it says so.
    whitened : ndarray, (fixes, m), or None
        Its innovations over the deviations that it expects.
    """

    position: Array
    velocity: Array
    covariance: Array | None = None
    whitened: Array | None = None


@dataclass(frozen=True, eq=False)
class Contestant:
    """A method, the numbers with which the search for its own begins, and the ratios of its steps.

    Attributes
    ----------
    run : callable
        Takes the numbers and the time at which the data end, s, and returns a `Solution`.
    begin, ratios : sequence of float
    """

    run: Callable[..., Solution]
    begin: Sequence[float]
    ratios: Sequence[float]


@dataclass(frozen=True, eq=False)
class RecordedContest:
    """Filters of one recording on equal terms.

    Attributes
    ----------
    recording : Recording
        With an IMU, ranges and a reference.
    period : float
        Of fixes, s.
    share : float
        Of the recording's time, from its begin, in which filters are tuned; they are judged after.
    alignment : float
        How long the start is aligned, s, from the first fix.
    trials : int
        The most that each search has.
    """

    recording: Recording
    period: float = 0.2
    share: float = 0.5
    alignment: float = 20.0
    trials: int = TRIALS

    @cached_property
    def fixes(self) -> Fixes:
        """The network: multilateration, and a line through five fixes."""
        if self.recording.ranges is None or self.recording.imu is None:
            raise InswsnError(f"{self.recording.name} has no ranges, or no IMU.")
        begin, end = self.recording.imu.time[[0, -1]]
        heard = self.recording.ranges.part(float(begin), float(end))
        return slope_velocity(multilaterate_track(heard, self.period))

    @property
    def split(self) -> float:
        """Until when filters are tuned, s."""
        first, last = self.fixes.time[[0, -1]]
        return float(first + self.share * (last - first))

    @cached_property
    def truth(self) -> tuple[Array, Array]:
        """Position and velocity of the antenna at the times of fixes, (fixes, 2) each."""
        reference = self.recording.reference
        if reference is None:
            raise InswsnError(f"{self.recording.name} has no reference to judge by.")
        track = reference.position
        if reference.attitude is not None:
            track = track + Rotation.from_quat(reference.attitude).apply(self.recording.lever_arm)
        return tuple(  # type: ignore[return-value]
            np.column_stack(columns)
            for columns in zip(
                *(_line(reference.time, x, self.fixes.time) for x in track.T[:2]), strict=True
            )
        )

    @cached_property
    def judged(self) -> Mask:
        """The fixes that are judged: after the split, where the network and the reference are."""
        there = np.isfinite(np.column_stack([self.fixes.position, self.fixes.velocity, *self.truth]))
        return np.asarray(there.all(axis=1) & (self.fixes.time > self.split))

    @cached_property
    def start(self) -> Start:
        """Where filters start, aligned on the fixes of the first seconds."""
        begin = float(self.fixes.time[0]) - self.period / 2
        spread = np.nanmedian(self.fixes.deviation, axis=0) if self.fixes.deviation is not None else 0.1
        white = PositionFixes(self.fixes, self.recording.lever_arm, np.full(3, 1.0) * spread)
        return align(self._motion(0.02, 0.002), [white], begin, begin + self.alignment)

    @cached_property
    def contestants(self) -> dict[str, Contestant]:
        """The methods with numbers of their own."""
        steps = (2.0, 2.0, 1.5)
        return {
            "loose, white": Contestant(self.loose, (0.02, 0.002, 0.1), steps),
            "loose, coloured": Contestant(self.loose, (0.02, 0.002, 0.04, 0.08, 3.0), (*steps, 1.5, 1.5)),
            "tight, white": Contestant(self.tight, (0.02, 0.002, 0.1), steps),
            "tight, coloured": Contestant(self.tight, (0.02, 0.002, 0.1, 0.05, 3.0), (*steps, 1.5, 1.5)),
        }  # fmt: skip

    def loose(
        self, force: float, rate: float, white: float, coloured: float = 0.0, time: float = 1.0,
        *, end: float = np.inf,
    ) -> Solution:  # fmt: skip
        """Run the filter on fixes, whose errors are twice as large upwards.

        Parameters
        ----------
        force, rate : float
            Of `ImuNoise`.
        white, coloured : float
            Horizontal standard deviations, m.
        time : float
            Of the coloured errors, s.
        end : float
            s.
        """
        up = np.array([1.0, 1.0, 2.0])
        colour = (coloured * up, np.full(3, time)) if coloured else ()
        fixes = PositionFixes(self.fixes, self.recording.lever_arm, white * up, *colour)
        return run_error_state(self._motion(force, rate), self.start, [fixes], end=end)

    def tight(
        self, force: float, rate: float, white: float, coloured: float = 0.0, time: float = 1.0,
        bias: float = 0.0, *, end: float = np.inf,
    ) -> Solution:  # fmt: skip
        """Run the filter on ranges, gated; see `loose` and `RangesToAnchors`."""
        ranges = self.recording.ranges
        assert ranges is not None  # asked by `fixes`
        observed = RangesToAnchors(ranges, self.recording.lever_arm, white, bias, coloured, time)
        silent: Observation = PositionFixes(_nothing(self.fixes), np.zeros(3), np.ones(3))
        return run_error_state(
            self._motion(force, rate), self.start, [observed, silent], end=end, gate=_GATE
        )

    @cached_property
    def tuned(self) -> dict[str, Tuning[tuple[float, ...]]]:
        """The searches, by the likelihood of the innovations up to the split."""
        found = {}
        for name, each in self.contestants.items():

            def loss(*numbers: float, run: Callable[..., Solution] = each.run) -> float:
                solution = run(*numbers, end=self.split)
                count = sum(len(kept.squares) for kept in solution.innovations)
                return float(np.exp(-solution.log_likelihood / count))

            found[name] = search_pattern(name, each.begin, each.ratios, loss, most=self.trials)
        return found

    @cached_property
    def solutions(self) -> dict[str, Solution]:
        """The filters with their numbers, and the smoothers of the coloured loose one."""
        found = {n: each.run(*self.tuned[n].best) for n, each in self.contestants.items()}
        loose = found["loose, coloured"]
        return found | {"fixed lag, 2 s": smooth_with_lag(loose, 2.0), "smoother": smooth(loose)}

    def estimate(self, solution: Solution) -> Estimate:
        """Return what a solution says at the times of fixes, of the antenna."""
        times = self.fixes.time
        position, velocity = np.full((2, len(times), 2), np.nan)
        P = np.full((len(times), 4, 4), np.nan)
        inside = (times >= solution.time[0]) & (times <= solution.time[-1])
        rows = [0, 1, 3, 4]
        at = solution.at(times[inside])
        for k, j in zip(np.flatnonzero(inside), at, strict=True):
            state = solution.states[j]
            position[k] = state.antenna(self.recording.lever_arm)[0][:2]
            velocity[k] = state.velocity[:2]
            P[k] = solution.covariances[j][np.ix_(rows, rows)]
        first = solution.innovations[0]
        whitened = None
        if len(first.time) and all(len(value) == 3 for value in first.values):
            whitened = np.full((len(times), 3), np.nan)
            ratio = np.array(first.values) / np.array(first.deviations)
            whitened[np.isin(times, first.time)] = ratio
        return Estimate(position, velocity, P, whitened)

    @cached_property
    def estimates(self) -> dict[str, Estimate]:
        """The network, and every solution."""
        network = Estimate(self.fixes.position[:, :2], self.fixes.velocity[:, :2])  # type: ignore[index]
        return {"network": network} | {n: self.estimate(s) for n, s in self.solutions.items()}

    def table(self) -> pd.DataFrame:
        """Return the scores of every method after the split.

        Returns
        -------
        DataFrame
            RMS errors ``position`` (m) and ``velocity`` (m/s), both over the network's, ``nees``
            (of position and velocity, over 4) and ``lag1``, the largest autocorrelation of
            neighbouring innovations.
        """
        return pd.DataFrame({name: self.score(each) for name, each in self.estimates.items()}).T

    def score(self, estimate: Estimate) -> dict[str, float]:
        """Return the scores of an estimate after the split."""
        rows, (position, velocity) = self.judged, self.truth
        errors = np.hstack([estimate.position - position, estimate.velocity - velocity])[rows]
        network = np.hstack([self.fixes.position[:, :2] - position, self.fixes.velocity[:, :2] - velocity])[rows]  # type: ignore[index]  # fmt: skip
        sizes, theirs = (
            [float(np.sqrt(np.mean(np.sum(e[:, part] ** 2, axis=1)))) for part in (slice(0, 2), slice(2, 4))]
            for e in (errors, network)
        )  # fmt: skip
        found = {
            "position": sizes[0],
            "velocity": sizes[1],
            "position_ratio": sizes[0] / theirs[0],
            "velocity_ratio": sizes[1] / theirs[1],
            "nees": np.nan,
            "lag1": np.nan,
        }
        if estimate.covariance is not None:
            squares = np.einsum(
                "ki,ki->k", errors, np.linalg.solve(estimate.covariance[rows], errors[..., None])[..., 0]
            )
            found["nees"] = float(squares.mean()) / 4
        if estimate.whitened is not None:
            w = estimate.whitened[rows]
            w = w[np.isfinite(w).all(axis=1)]
            found["lag1"] = float(np.max(np.abs((w[1:] * w[:-1]).mean(axis=0) / (w**2).mean(axis=0))))
        return found

    def _motion(self, force: float, rate: float) -> InertialMotion:
        imu = self.recording.imu
        if imu is None:
            raise InswsnError(f"{self.recording.name} has no IMU.")
        return InertialMotion(imu, ImuNoise(force, rate, *_WALKS))


def _line(time: Array, values: Array, at: Array) -> tuple[Array, Array]:
    """Return values at some times, and their slopes by a line through what is around each."""
    inside = (at >= time[0]) & (at <= time[-1])
    found, slopes = np.full((2, len(at)), np.nan)
    found[inside] = np.interp(at[inside], time, values)
    for k in np.flatnonzero(inside):
        near = slice(*np.searchsorted(time, [at[k] - _HALF_WINDOW, at[k] + _HALF_WINDOW]))
        if near.stop - near.start >= 4:
            slopes[k] = np.polyfit(time[near] - at[k], values[near], 1)[0]
    return found, slopes


def _nothing(fixes: Fixes) -> Fixes:
    """Return the times of fixes without any: events at which a filter says where it is."""
    return replace(fixes, position=np.full_like(fixes.position, np.nan))
