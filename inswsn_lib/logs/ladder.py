"""The ladder of estimators on a recording: tuned alike on its first part, judged on the rest."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property, partial

import numpy as np
import pandas as pd

from inswsn_lib.checks import Array, Mask, number, one_of
from inswsn_lib.errors import InswsnError
from inswsn_lib.evaluation import Tuning, most_likely
from inswsn_lib.filters import (
    ErrorStatistics,
    deadbeat_gain,
    gating,
    huber,
    run_hinfinity,
    run_kalman,
    run_robust,
)
from inswsn_lib.inertial import Solution, Start, smooth, smooth_with_lag
from inswsn_lib.lmi import InfeasibleDesignError, design_filter
from inswsn_lib.logs.correction import (
    COLOURED,
    PLANAR_TIGHT,
    WHITE,
    Correction,
    OdometryCorrection,
    Rung,
    correction_of,
)
from inswsn_lib.logs.estimates import (
    OUTLIER,
    Estimate,
    largest_lag_one,
    of_solution,
    scores,
    truth_at,
)
from inswsn_lib.logs.window_fits import PERIODS
from inswsn_lib.models import ErrorModel
from inswsn_lib.streams import Fixes, Recording

_LAG = 2.0  # s, of the fixed-lag smoother
# Rows of the motion, and components of measurements, that a search for numbers takes at the most
_ROWS, _COMPONENTS = 30_000, 6000
_RESTART, _RESTARTS = 10.0, 200  # s, after which a motion that drifts is begun anew
_FREE = (0.02, 0.002)  # the noise figures of a motion that nothing corrects
#: Estimators that are no filters with numbers, or follow from one
NETWORK, ALONE, PUBLISHED = "network alone", "motion alone", "P1's published HF, predicted"
FIXED_LAG, SMOOTHER = f"fixed-lag smoother, {_LAG:g} s", "smoother"
_UNKNOWN = 1e6 * np.eye(4)
# The deviation of the INS's acceleration, m/s^2, where fixes have 0.1 m, and by how many times 0.1
# that of the network's velocity, m/s; then the margin above the least gamma, Huber's threshold, or
# the share of good measurements that a gate gives away.
_TWO = (0.5, 1.0)
#: Filters of P1's form, and the numbers where the search for theirs begins
FAMILIES = {
    "KF": _TWO,
    "HF": (*_TWO, 1.0),
    "KF, Huber update": (*_TWO, 1.345),
    "KF, gating": (*_TWO, 1e-3),
}


@dataclass(frozen=True, eq=False)
class DifferenceFilters:
    """Filters of P1's model, whose measurement is INS less network.

    Both are horizontal positions (m) and velocities (m/s) at fixes, (fixes, 4), NaN where there is
    none; P1's model takes steps for even, of a period (s).
    """

    ins: Array
    network: Array
    period: float

    def run(self, name: str, acceleration: float, ratio: float, own: float = 0.0) -> Estimate:
        """Return what a filter of `FAMILIES` with its numbers says."""
        model, y = difference_model(self.period, acceleration, ratio), self.ins - self.network
        if name == "HF":
            try:
                design = design_filter(model, "exact", margin=own)
            except InfeasibleDesignError:
                return Estimate(np.full_like(y, -np.inf))
            return self._hinfinity(design.model, design.gain, predicted=False)
        if name == "KF":
            found = run_kalman(model, y, initial_covariance=_UNKNOWN)
        else:
            policy = huber(own) if name == "KF, Huber update" else gating(1 - min(own, 0.5))
            found = run_robust(model, y, policy=policy, initial_covariance=_UNKNOWN)
        return Estimate(self.ins - found)

    @property
    def published(self) -> Estimate:
        """P1's filter with the printed gain A: the last fix, carried on by the INS.

        After the measurement of a step it is the network itself.
        """
        model = difference_model(self.period, 1.0, 1.0)
        return self._hinfinity(model, deadbeat_gain(model), predicted=True)

    def _hinfinity(self, model: ErrorModel, gain: Array, *, predicted: bool) -> Estimate:
        """Run an H-infinity filter from the first measurement on."""
        y = self.ins - self.network
        first = int(np.flatnonzero(np.isfinite(y[:, 0]))[0])
        found = np.full_like(y, np.nan)
        found[first:] = run_hinfinity(
            (model, gain), y[first:], initial_state=y[first], predicted=predicted
        )
        return Estimate(self.ins - found)


def difference_model(period: float, acceleration: float, ratio: float) -> ErrorModel:
    """Return P1's model with fixes of 0.1 m; gains depend on ratios alone.

    The INS misses an acceleration of this deviation, m/s^2; that of velocities is `ratio` times
    0.1 m/s.
    """
    noise = (acceleration * period**2 / 2, acceleration * period)
    return ErrorModel.p1(period, process_noise=noise, measurement_noise=(0.1, 0.1 * ratio))


@dataclass(frozen=True, eq=False)
class Ladder:
    """Estimators on one recording on equal terms, and the network that they must beat.

    The network is the fixes, or multilateration of the ranges of each period, with the velocity of
    a line through five fixes where none was measured; a fix by ranges is of the middle of its
    period. Filters have their numbers by `most_likely` on the first part of the recording: by the
    likelihood of their innovations, which asks for no reference, and those of P1's form, of which
    not all have one, by the size of their errors. They are judged on the rest. A vehicle does not
    slip, wheels tell its speed, and what is seen to stand has zero velocity. What is called
    causal uses nothing later, but for the IMU's sample after a fix and the scale of the robust loss
    of `multilaterate_track`, which is of the whole recording.

    Attributes
    ----------
    recording : Recording
        With an IMU or odometry, and fixes or ranges.
    share : float
        Of the time between the first and the last fix in which filters are tuned.
    alignment : float
        For how long after the first fix the start is aligned, s, or a quarter of the recording if
        that is shorter; for longer where the heading does not show yet.
    period : float, optional
        Of fixes by ranges, s; by default the shortest of some in which most have one.
    given : Start, optional
        What is known of the start, as of `known_start`; of odometry, with a `PlanarState`.
    begins : int
        Of each search, as of `most_likely`.

    Raises
    ------
    InswsnError
        If a stream is missing, or the alignment does not tell the heading.

    Examples
    --------
    >>> from inswsn_lib.logs import Ladder
    >>> from inswsn_lib.streams import Recording
    >>> Ladder(Recording("empty")).start
    Traceback (most recent call last):
    ...
    inswsn_lib.errors.InswsnError: The recording empty has neither an IMU nor odometry: there is \
nothing to correct fixes with.
    """

    recording: Recording
    share: float = 0.5
    alignment: float = 20.0
    period: float | None = None
    given: Start | None = None
    begins: int = 3

    def __post_init__(self) -> None:
        number("share", self.share, above=0, below=1)
        number("alignment", self.alignment, above=0)

    @cached_property
    def filters(self) -> Correction:
        """The error-state filters for the streams that there are.

        :meta private:
        """
        return correction_of(self.recording, self.alignment, self.given, self.period)

    @property
    def planar(self) -> bool:
        """Whether filters are of odometry on a plane, and not of an IMU in space."""
        return isinstance(self.filters, OdometryCorrection)

    @property
    def fixes(self) -> Fixes:
        """The network."""
        return self.filters.fixes

    @property
    def start(self) -> Start:
        """Where filters start."""
        return self.filters.start

    @cached_property
    def step(self) -> float:
        """The median time between fixes, s."""
        return float(np.median(np.diff(self.fixes.time)))

    @property
    def window(self) -> float:
        """From how long fixes by ranges are, s."""
        return self.period or min(PERIODS, key=lambda each: abs(each - self.step))

    @property
    def split(self) -> float:
        """Until when filters are tuned, s."""
        first, last = self.fixes.time[[0, -1]]
        return float(first + self.share * (last - first))

    @cached_property
    def network(self) -> Estimate:
        """What the fixes alone say."""
        assert self.fixes.velocity is not None  # `network_of` makes one
        return Estimate(np.hstack([self.fixes.position[:, :2], self.fixes.velocity[:, :2]]))

    @cached_property
    def truth(self) -> Array:
        """Horizontal position and velocity of the tag at the times of fixes, (fixes, 4).

        By the reference; without one by the fixes that are good, which judge only while they are
        withheld; NaN where neither tells.
        """
        if self.recording.reference is not None:
            return truth_at(self.filters.recording, self.fixes.time)
        good = self.fixes.good
        there = np.isfinite(self.fixes.position).all(axis=1) if good is None else good
        return np.where(np.asarray(there)[:, None], self.network.state, np.nan)

    @cached_property
    def usable(self) -> Mask:
        """The fixes at which network and truth say where the tag is, after the alignment."""
        both = np.isfinite(np.hstack([self.network.state[:, :2], self.truth[:, :2]])).all(axis=1)
        return np.asarray(both & (self.fixes.time > self.start.time))

    @property
    def judged(self) -> Mask:
        """The usable fixes after the split, by the reference."""
        if self.recording.reference is None:
            raise InswsnError(
                f"The recording {self.recording.name} has no reference: estimators are judged only "
                "in outages."
            )
        return self.usable & (self.fixes.time > self.split)

    def tuning_end(self, name: str) -> float:
        """Return until when a filter is tuned, s: the split, or earlier in a long recording."""
        recording, series = self.filters.recording, self.rungs[name].series
        moved = recording.odometry if self.planar else recording.imu
        assert moved is not None
        measured = np.sort(np.concatenate([moved.time[:0], *(time for time, _ in series)]))
        ends = [
            time[time > self.start.time][:most][-1:]
            for time, most in ((moved.time, _ROWS), (measured, _COMPONENTS))
        ]
        return float(min(np.concatenate([*ends, [self.split]])))

    @cached_property
    def rungs(self) -> dict[str, Rung]:
        """The error-state filters."""
        return self.filters.rungs

    @cached_property
    def difference(self) -> DifferenceFilters | None:
        """P1's form: an INS that is never corrected, and filters of its difference to fixes.

        None beside odometry.

        :meta private:
        """
        if self.planar:
            return None
        return DifferenceFilters(self.alone.state, self.network.state, self.step)

    @cached_property
    def families(self) -> tuple[str, ...]:
        """The filters of P1's form, beside an IMU and a reference."""
        return tuple(FAMILIES) if self.difference and self.recording.reference else ()

    @cached_property
    def alone(self) -> Estimate:
        """The motion that nothing corrects after the start."""
        return self.unaided()

    def unaided(self, start: Start | None = None, end: float = np.inf) -> Estimate:
        """Return the motion that nothing corrects from a start, until a time, s."""
        return self.of(self.filters.run([], *_FREE, start=start, end=end))

    def start_after(self, solution: Solution, k: int) -> Start:
        """Return where a run goes on from a solution after a fix: its state, and errors of it."""
        event = int(solution.at(self.fixes.time[k : k + 1])[0])
        state = solution.states[event]
        P = solution.covariances[event][: state.errors, : state.errors]
        return Start(float(self.fixes.time[k]), replace(state, own=np.zeros(0)), P)

    @cached_property
    def restarted(self) -> Estimate:
        """The motion alone, begun anew from the filter on fixes every ten seconds, in one piece.

        What it has moved by in each stretch is added to where it was at the end of the one before,
        and so are the changes of its velocity: it drifts, but attitude and biases are the filter's.
        After two hundred stretches it says nothing.
        """
        solution, time = self.solution(self.on_fixes), self.fixes.time
        filtered, found = self.of(solution).state, np.full((len(time), 4), np.nan)
        inside = np.flatnonzero((time >= solution.time[0]) & (time <= solution.time[-1]))
        k, last = int(inside[0]), int(inside[-1])
        last = min(last, int(np.searchsorted(time, time[k] + _RESTARTS * _RESTART)))
        found[k] = filtered[k]
        while k < last:
            end = min(max(int(np.searchsorted(time, time[k] + _RESTART)), k + 1), last)
            start = self.start_after(solution, k)
            alone = self.unaided(start, float(time[end])).state
            ahead, passed = slice(k + 1, end + 1), (time[k + 1 : end + 1] - time[k])[:, None]
            moved = alone[ahead] - filtered[k]
            moved[:, :2] += passed * (found[k, 2:] - filtered[k, 2:])
            found[ahead], k = found[k] + moved, end
        return Estimate(found)

    def statistics(self, truth: Array | None = None) -> ErrorStatistics:
        """Return what tells before a filter runs how much it gains, by the reference.

        Of the fixes, and of the motion that is `restarted`; the truth is that of the ladder, or
        another (fixes, 4).

        :meta private:
        """
        known = np.where(self.usable[:, None], self.truth if truth is None else truth, np.nan)
        ins, network = (each.state - known for each in (self.restarted, self.network))
        return ErrorStatistics.of(ins, network, self.step)

    @cached_property
    def _searches(self) -> dict[str, Tuning[tuple[float, ...]]]:
        return {}

    def tuned(self, name: str) -> Tuning[tuple[float, ...]]:
        """Return the search for the numbers of a filter, up to the split.

        Parameters
        ----------
        name : str
            One of `rungs` or of `families`.
        """
        if name not in self._searches:
            one_of("name", name, (*self.rungs, *self.families))
            if name in self.rungs:
                rung, end = self.rungs[name], self.tuning_end(name)
                likely = partial(rung.likely, end=end)
                found = most_likely(name, rung.begin, likely, begins=self.begins)
                found = self._sized(rung, found) if end < self.split else found
            else:  # those of P1's form take long, and end alike from each begin
                likely, begins = partial(self._by_errors, name), min(self.begins, 2)
                found = most_likely(name, FAMILIES[name], likely, begins=begins)
            self._searches[name] = found
        return self._searches[name]

    def _sized(self, rung: Rung, found: Tuning[tuple[float, ...]]) -> Tuning[tuple[float, ...]]:
        """Return a search in a window, with deviations that fit the whole first part.

        With all deviations times a factor the estimates are the same, and the likelihood is largest
        where the mean NIS is 1.
        """
        told = rung.run(*found.best, end=self.split, kept=False).innovations[: len(rung.series)]
        squares = np.concatenate([each.squares for each in told])
        factor = float(np.sqrt(np.mean(squares[squares < OUTLIER**2])))
        ends = [
            tuple(x if k == rung.lasting else factor * x for k, x in enumerate(numbers))
            for numbers in found.candidates
        ]
        return replace(found, candidates=tuple(ends))

    def _by_errors(self, name: str, *numbers: float) -> float:
        """Return the log-likelihood of errors of one unknown size in position and in velocity."""
        assert self.difference is not None
        first = self.usable & (self.fixes.time <= self.split)
        squares = np.square(self.difference.run(name, *numbers).state - self.truth)[first]
        sums = [float(np.nansum(squares[:, part])) for part in (slice(0, 2), slice(2, 4))]
        return -len(squares) * float(np.sum(np.log([each for each in sums if each > 0])))

    def solution(self, name: str) -> Solution:
        """Return the run of an error-state filter, one of `rungs`, with its numbers."""
        one_of("name", name, tuple(self.rungs))
        return self.rungs[name].run(*self.tuned(name).best)

    def of(self, solution: Solution) -> Estimate:
        """Return what a solution says at the times of fixes."""
        found = of_solution(solution, self.filters.lever_arm, self.fixes.time, self.filters.rate)
        P, stated = found.covariance, self.filters.stated
        return Estimate(found.state, None if P is None else P[:, :stated, :stated])

    @cached_property
    def _run(self) -> tuple[dict[str, Estimate], dict[str, dict[str, float]]]:
        """Estimates, and of filters NIS and lag one; solutions are not kept."""
        found, innovations = {NETWORK: self.network, ALONE: self.alone}, {}
        if self.difference is not None and self.families:
            found |= {n: self.difference.run(n, *self.tuned(n).best) for n in self.families}
            found[PUBLISHED] = self.difference.published
        smoothed = PLANAR_TIGHT if PLANAR_TIGHT in self.rungs else COLOURED
        late: dict[str, Estimate] = {}
        for name, rung in self.rungs.items():
            solution = self.solution(name)
            found[name] = self.of(solution)
            innovations[name] = largest_lag_one(solution, rung.series, self.split)
            if name == smoothed:
                late[FIXED_LAG] = self.of(smooth_with_lag(solution, _LAG))
                late[SMOOTHER] = self.of(smooth(solution))
        return found | late, innovations

    @property
    def estimates(self) -> dict[str, Estimate]:
        """What every estimator says at the times of fixes; the network first, smoothers last."""
        return self._run[0]

    def table(self, more: Mapping[str, Estimate] | None = None) -> pd.DataFrame:
        """Return the scores of every estimator on the judged fixes.

        Parameters
        ----------
        more : mapping of str to Estimate, optional
            Of one's own, as of `judge`.

        Returns
        -------
        DataFrame
            RMS errors ``position`` (m) and ``velocity`` (m/s), horizontal; their ratios to those of
            the network with intervals by `block_ratio` (``position_ratio``, ``position_low``,
            ``position_high``, and of velocity); ``nees`` over its number of components; ``nis`` and
            ``lag1``, the largest autocorrelation of neighbouring innovations, over all components,
            if they are known; ``settled``, whether the search for its numbers is; ``causal``.

        Raises
        ------
        InswsnError
            If there is no reference to judge by.
        """
        rows, nothing = self.judged, {"nis": np.nan, "lag1": np.nan}
        found, innovations = self._run
        table = pd.DataFrame(
            {
                name: self._scores(each, self.network, rows) | innovations.get(name, nothing)
                for name, each in (found | dict(more or {})).items()
            }
        ).T
        searches = self._searches
        settled = [name not in searches or searches[name].settled for name in table.index]
        causal = [name not in (FIXED_LAG, SMOOTHER) for name in table.index]
        return table.assign(settled=settled, causal=causal)

    def compare(self, name: str, other: str) -> dict[str, tuple[float, float, float]]:
        """Return RMS errors of a row of `table` over those of another, with intervals.

        The ratio, low and high of ``position`` and of ``velocity``.
        """
        found = self._scores(self.estimates[name], self.estimates[other], self.judged)
        return {
            of: (found[f"{of}_ratio"], found[f"{of}_low"], found[f"{of}_high"])
            for of in ("position", "velocity")
        }

    def _scores(self, mine: Estimate, other: Estimate, rows: Mask) -> dict[str, float]:
        truth = self.truth[rows]
        return scores(mine.part(rows), truth, other.state[rows] - truth)

    @property
    def corrected(self) -> str:
        """The filter that the data find most likely: tight beside odometry, else one on fixes."""
        return PLANAR_TIGHT if PLANAR_TIGHT in self.rungs else self.on_fixes

    @cached_property
    def on_fixes(self) -> str:
        """The likelier of the loosely coupled filters, with white or with coloured fixes."""
        return min((WHITE, COLOURED), key=lambda name: self.tuned(name).loss)
