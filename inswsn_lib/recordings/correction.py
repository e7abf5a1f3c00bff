"""Filters of recordings with an IMU or odometry, and fixes or ranges, that start by themselves."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from scipy.integrate import cumulative_trapezoid

from inswsn_lib.calibration import slope_velocity
from inswsn_lib.calibration.window_fits import PERIODS
from inswsn_lib.checks import Array, Mask
from inswsn_lib.errors import InswsnError
from inswsn_lib.inertial import (
    ImuNoise,
    InertialMotion,
    Observation,
    OdometryMotion,
    OdometryNoise,
    PositionFixes,
    RangesToAnchors,
    Solution,
    Start,
    Velocities,
    WheelSpeeds,
    align,
    align_planar,
    run_error_state,
)
from inswsn_lib.recordings.findings import Finding
from inswsn_lib.recordings.network_fixes import HELD, fixes_of, on_a_side, with_height
from inswsn_lib.streams import Fixes, Ranges, Recording, Whole

#: What the errors of fixes upwards are taken for, times those to the side
UP = np.array([1.0, 1.0, 2.0])
#: Of the random walks of the IMU's biases, which no short recording tells
WALKS = (1e-3, 1e-4)
#: Ranges that lie four deviations from what is expected are left out
GATE = 16.0
_LASTING = 3.0  # s, of the coloured errors of fixes at the begin of the search
_OF_SECOND_DIFFERENCES = 1.4826 / np.sqrt(6)  # from their median size to a deviation
_LEAST, _LEAST_SHARE = 1e-3, 0.1  # m, of a deviation, and of one over the median
# Of an alignment: s before the first fix, and shares of all at which it ends, first and at last
_BEFORE, _SHORTER, _LONGEST = 0.1, 0.25, 0.4
# Of the odometry: the bias of each anchor's ranges is a number, their common scale is not
_SCALE, _ODOMETRY_WALKS = 0.1, (1e-3, 1e-5)
_SCALED, _DRIFTING = 0.2, 0.05  # 1, rad/s: at the start of odometry
# Names of filters
WHITE = "loosely coupled, white fixes"
COLOURED = "loosely coupled, coloured fixes"
TIGHT = "tightly coupled, coloured ranges"
PLANAR_TIGHT = "tightly coupled, biases and a scale"
LATERAL = "coloured fixes, and no slip to the side"
# A body that goes faster than a runner is a vehicle: m/s, of a quantile; how often it is said not
# to slip, s, and how fast it may at first, m/s
_RUNNER, _QUANTILE, _SLIP_STEP, _SLIP = 6.0, 0.8, 0.2, 0.3


@dataclass(frozen=True, eq=False)
class Rung:
    """A filter on a recording.

    Attributes
    ----------
    run : callable
        Takes the numbers, and by name ``end``, the time at which the data end (s), and ``kept``, as
        `run_error_state`; returns a solution, which has an event at the time of each fix.
    begin : tuple of float
        The numbers, where the search for them begins.
    series : list of (ndarray, ndarray)
        Of each observation that is judged, the times of the components of its measurements, s, and
        of which series each is: an axis, or an anchor.
    lasting : int, optional
        Which of the numbers is a correlation time; the others are deviations.
    """

    run: Callable[..., Solution]
    begin: tuple[float, ...]
    series: list[tuple[Array, Whole]]
    lasting: int | None = None


@dataclass(frozen=True, eq=False)
class InertialCorrection:
    """An INS in space, coupled to fixes, or to ranges, whose errors are white, or lasting, too.

    Numbers of all its filters are first those of `ImuNoise`, force and rate. On fixes they go on
    with the deviation of the white errors of fixes to the side, m, and that of their velocities,
    m/s, if these were measured; then, if errors of fixes last, their deviation, m, and correlation
    time, s. Where fixes say how good each is, their errors go with that. On ranges: the deviation
    of white errors, that of coloured ones, m, the correlation time of these, s, and the deviation
    of a bias of each anchor, m.

    Attributes
    ----------
    recording : Recording
        With an IMU.
    fixes : Fixes
        With velocities, in three dimensions.
    alignment : float
        For how long after the first fix the start is aligned, s, or a quarter of the recording if
        that is shorter; for longer where the heading does not show yet.
    given : Start, optional
        What is known of the start.
    held : bool
        Whether the fixes' heights were not measured, but are held.
    assumed : sequence of Finding
        What is taken for granted of the network.
    """

    recording: Recording
    fixes: Fixes
    alignment: float
    given: Start | None = None
    held: bool = False
    assumed: Sequence[Finding] = ()

    @property
    def lever_arm(self) -> Array:
        """From the IMU to the tag, (3,), m."""
        return self.recording.lever_arm

    @property
    def stated(self) -> int:
        """Of how many of x, y, vx, vy the filters state the errors: of all."""
        return 4

    @cached_property
    def rungs(self) -> dict[str, Rung]:
        """The filters by name."""
        velocity, size = self.fixes.velocity, deviation_of(self.fixes)
        speeds = [_size(velocity[:, :2])] if velocity is not None and self._measured else []
        series = [series_of(self.fixes.time, self._measured_part(self.fixes).position)]
        if velocity is not None and self._measured:
            series.append(series_of(self.fixes.time, velocity, first=3))
        white = (0.02, 0.002, size, *speeds)
        coloured = (0.02, 0.002, size / 2, *speeds, size, _LASTING)
        found = {
            WHITE: Rung(self._loose, white, series),
            COLOURED: Rung(self._loose, coloured, series, len(coloured) - 1),
        }
        if (heard := self.recording.ranges) is not None:
            begin = (0.02, 0.001, size / 2, size / 2, 1.0, size / 4)
            found[TIGHT] = Rung(self._tight, begin, [(heard.time, heard.anchor)], 4)
        elif velocity is not None and _is_vehicle(velocity):
            found[LATERAL] = Rung(self._lateral, (*coloured, _SLIP), series, len(coloured) - 1)
        return found

    @cached_property
    def axes(self) -> Array:
        """Turns vectors of the IMU into axes of a vehicle: forward, left, up, (3, 3).

        Forward is where it goes, by a filter on the first half of the fixes; up is near the mean
        vertical.
        """
        end = float(np.mean(self.fixes.time[[0, -1]]))
        solution = self._loose(*self.rungs[COLOURED].begin, end=end)
        R = np.array([state.attitude for state in solution.states])
        moving = np.linalg.norm(solution.velocity, axis=1) > _RUNNER
        forward = np.einsum("kji,kj->i", R[moving], solution.velocity[moving])
        left = np.cross(R[:, 2].mean(axis=0), forward)
        rows = [forward, left, np.cross(forward, left)]
        return np.array([row / np.linalg.norm(row) for row in rows])

    def constraint(self, slip: float) -> WheelSpeeds:
        """Return that a vehicle does not slip to the side, nor leave the ground.

        Parameters
        ----------
        slip : float
            Standard deviation, m/s.
        """
        first, last = self.fixes.time[[0, -1]]
        time = np.arange(float(first), float(last), _SLIP_STEP)
        return WheelSpeeds(time, np.full(len(time), np.nan), self.axes, np.array([1.0, slip, slip]))

    def _lateral(self, force: float, rate: float, *numbers: float, **how: Any) -> Solution:
        *sizes, slip = numbers
        fixes = how.pop("fixes", self.fixes)
        observed = [*self._observed(*sizes, fixes=fixes), self.constraint(slip)]
        return self.run(observed, force, rate, **how)

    def unaided(self, name: str, numbers: Sequence[float]) -> list[Observation]:
        """Return what a filter has without fixes and ranges.

        Parameters
        ----------
        name : str
            One of `rungs`.
        numbers : sequence of float
        """
        return [*([self.constraint(numbers[-1])] if name == LATERAL else []), self.silent]

    @cached_property
    def rate(self) -> Array:
        """What the gyroscopes say at the times of fixes, (fixes, 3), rad/s."""
        imu = self.recording.imu
        assert imu is not None
        return np.column_stack([np.interp(self.fixes.time, imu.time, x) for x in imu.rate.T])

    @property
    def _measured(self) -> bool:
        """Whether velocities of fixes were measured, and are not slopes of fixes."""
        fixes = self.recording.fixes
        return self.recording.ranges is None and fixes is not None and fixes.velocity is not None

    @cached_property
    def start(self) -> Start:
        """Where the filters start, by an alignment."""
        force, rate, *sizes = self.rungs[WHITE].begin
        first, last = first_fix(self.fixes), float(self.fixes.time[-1])
        begin = first - _BEFORE if self.given is None else self.given.time
        end = max(begin, first) + min(self.alignment, _SHORTER * (last - first))
        return align(
            self.motion(force, rate), self._observed(*sizes), begin, end, prior=self.given,
            latest=max(end, first + _LONGEST * (last - first)),
        )  # fmt: skip

    def run(
        self, observed: Sequence[Observation], force: float, rate: float,
        start: Start | None = None, *, end: float = np.inf, kept: bool = True, gate: float = np.inf,
    ) -> Solution:  # fmt: skip
        """Run a filter on observations of one's own.

        Parameters
        ----------
        observed : sequence of Observation
        force, rate : float
            Of `ImuNoise`.
        start : Start, optional
            By default that of the recording.
        end, kept, gate
            As in `run_error_state`.
        """
        return run_error_state(
            self.motion(force, rate), self.start if start is None else start, observed,
            end=end, kept=kept, gate=gate,
        )  # fmt: skip

    def withheld(
        self, name: str, numbers: Sequence[float], gone: Mask, start: Start, end: float
    ) -> Solution:
        """Run a filter on fixes without some of them.

        Parameters
        ----------
        name : str
                One of `rungs`, on fixes.
        numbers : sequence of float
        gone : ndarray of bool, (fixes,)
        start : Start
        end : float
            s.
        """
        return self.rungs[name].run(*numbers, start=start, end=end, fixes=without(self.fixes, gone))

    def _loose(self, force: float, rate: float, *sizes: float, **how: Any) -> Solution:
        fixes = how.pop("fixes", self.fixes)
        return self.run(self._observed(*sizes, fixes=fixes), force, rate, **how)

    def _tight(
        self, force: float, rate: float, white: float, coloured: float, time: float, bias: float,
        **how: Any,
    ) -> Solution:  # fmt: skip
        assert self.recording.ranges is not None
        ranges = RangesToAnchors(self.recording.ranges, self.lever_arm, white, bias, coloured, time)
        return self.run([ranges, self.silent], force, rate, gate=GATE, **how)

    def _observed(
        self, white: float, *numbers: float, fixes: Fixes | None = None
    ) -> list[Observation]:
        fixes, measured = self.fixes if fixes is None else fixes, self._measured
        shares = shares_of(self.fixes)
        colours = _colour(numbers[measured:], np.nanmedian(shares, axis=0))
        observed: list[Observation] = [
            PositionFixes(self._measured_part(fixes), self.lever_arm, white * shares, *colours)
        ]
        if measured:
            assert fixes.velocity is not None
            observed.append(
                Velocities(fixes.time, fixes.velocity, numbers[0] * UP, self.rate, self.lever_arm)
            )
        if self.held:
            heights = replace(fixes, position=fixes.position * [np.nan, np.nan, 1.0])
            observed.append(PositionFixes(heights, self.lever_arm, np.full(3, HELD)))
        return observed

    def _measured_part(self, fixes: Fixes) -> Fixes:
        """Return fixes without heights that are held."""
        return replace(fixes, position=fixes.position * [1, 1, np.nan]) if self.held else fixes

    @property
    def silent(self) -> PositionFixes:
        """The times of fixes without any: events at which a filter says where it is."""
        nothing = Fixes(self.fixes.time, np.full((len(self.fixes), 3), np.nan))
        return PositionFixes(nothing, np.zeros(3), np.ones(3))

    def motion(self, force: float, rate: float) -> InertialMotion:
        """Return the integration of the IMU with these noises of `ImuNoise`.

        Parameters
        ----------
        force, rate : float
        """
        return InertialMotion.of(self.recording, ImuNoise(force, rate, *WALKS))


@dataclass(frozen=True, eq=False)
class OdometryCorrection:
    """Dead reckoning on a plane, with fixes, or tightly coupled with ranges.

    Numbers of all its filters are first those of `OdometryNoise`, speed and rate; then on fixes as
    those of `InertialCorrection`, on ranges the deviations of white errors and of a bias of each
    anchor, m. Ranges have a common scale as a state.

    Attributes
    ----------
    recording : Recording
        With odometry.
    fixes : Fixes
        With velocities; if there are ranges, made of them.
    alignment : float
        By how much of the data the heading is found, s, or by a quarter of the recording if that is
        shorter; by more where it does not show yet.
    given : Start, optional
        Where the filters start.
    assumed : sequence of Finding
        What is taken for granted of the network.
    """

    recording: Recording
    fixes: Fixes
    alignment: float
    given: Start | None = None
    assumed: Sequence[Finding] = ()

    @property
    def lever_arm(self) -> Array:
        """From what moves to the tag, (2,), m."""
        return self.recording.lever_arm[:2]

    @property
    def stated(self) -> int:
        """Of how many of x, y, vx, vy the filters state the errors: the speed is no state."""
        return 2

    @property
    def rate(self) -> None:
        """None: the velocity is that of the wheels."""
        return None

    @cached_property
    def rungs(self) -> dict[str, Rung]:
        """The filters by name."""
        motion, size = (0.05, 0.02), deviation_of(self.fixes)
        series = [series_of(self.fixes.time, self.fixes.position[:, :2])]
        coloured = (*motion, size / 2, size, _LASTING)
        found = {
            WHITE: Rung(self._loose, (*motion, size), series),
            COLOURED: Rung(self._loose, coloured, series, len(coloured) - 1),
        }
        if (heard := self.recording.ranges) is not None:
            found[PLANAR_TIGHT] = Rung(
                self._tight, (*motion, 0.2, 0.2), [(heard.time, heard.anchor)]
            )
        return found

    @cached_property
    def start(self) -> Start:
        """The given one, or where an alignment by a bank of headings ends."""
        if self.given is not None:
            return self.given
        first, last = first_fix(self.fixes), float(self.fixes.time[-1])
        place = self.fixes.position[self.fixes.time == first][0, :2]
        far = 3 * deviation_of(self.fixes) + float(np.linalg.norm(self.lever_arm))
        speed, rate, *sizes = self.rungs[PLANAR_TIGHT if self.recording.ranges else WHITE].begin
        observed = [self._ranges(*sizes) if self.recording.ranges else self._fixes(*sizes)]
        begin, window = first - 1e-3, min(self.alignment, _SHORTER * (last - first))
        while True:
            try:
                return align_planar(
                    self.motion(speed, rate), observed, begin, begin + window, place,
                    (far, _SCALED, _DRIFTING),
                )  # fmt: skip
            except InswsnError:
                window *= 2
                if window > _LONGEST * (last - first):
                    raise

    def run(
        self, observed: Sequence[Observation], speed: float, rate: float,
        start: Start | None = None, *, end: float = np.inf, kept: bool = True,
    ) -> Solution:  # fmt: skip
        """Run a filter on observations of one's own.

        Parameters
        ----------
        observed : sequence of Observation
        speed, rate : float
            Of `OdometryNoise`.
        start : Start, optional
            By default that of the recording.
        end, kept
            As in `run_error_state`.
        """
        return run_error_state(
            self.motion(speed, rate), self.start if start is None else start,
            [*observed, self.silent], end=end, gate=GATE, kept=kept,
        )  # fmt: skip

    def withheld(
        self, name: str, numbers: Sequence[float], gone: Mask, start: Start, end: float
    ) -> Solution:
        """Run a filter on fixes, or ranges, without those of some fixes.

        Parameters
        ----------
        name : str
            One of `rungs`.
        numbers : sequence of float
        gone : ndarray of bool, (fixes,)
        start : Start
        end : float
            s.
        """
        rung, ranges = self.rungs[name], self.recording.ranges
        if name != PLANAR_TIGHT or ranges is None:
            return rung.run(*numbers, start=start, end=end, fixes=without(self.fixes, gone))
        # the stamp of a fix is between those of its ranges
        middles = (self.fixes.time[1:] + self.fixes.time[:-1]) / 2
        heard = ranges.kept(~gone[np.searchsorted(middles, ranges.time)])
        return rung.run(*numbers, start=start, end=end, ranges=heard)

    def unaided(self, name: str, numbers: Sequence[float]) -> list[Observation]:
        """Return what a filter has without fixes and ranges: nothing.

        Parameters
        ----------
        name : str
        numbers : sequence of float
        """
        return []

    def _loose(self, speed: float, rate: float, *sizes: float, **how: Any) -> Solution:
        fixes = how.pop("fixes", self.fixes)
        return self.run([self._fixes(*sizes, fixes=fixes)], speed, rate, **how)

    def _tight(self, speed: float, rate: float, *sizes: float, **how: Any) -> Solution:
        ranges = how.pop("ranges", self.recording.ranges)
        return self.run([self._ranges(*sizes, ranges=ranges)], speed, rate, **how)

    def _fixes(self, white: float, *others: float, fixes: Fixes | None = None) -> PositionFixes:
        fixes, two = self.fixes if fixes is None else fixes, np.ones(2)
        sizes = white * shares_of(self.fixes)[:, :2]
        return PositionFixes(_planar(fixes), self.lever_arm, sizes, *_colour(others, two))

    def _ranges(self, *sizes: float, ranges: Ranges | None = None) -> RangesToAnchors:
        (white, bias), ranges = sizes, self.recording.ranges if ranges is None else ranges
        assert ranges is not None
        return RangesToAnchors(ranges, self.lever_arm, white, bias=bias, scale=_SCALE)

    @property
    def silent(self) -> PositionFixes:
        """The times of fixes without any: events at which a filter says where it is."""
        nothing = Fixes(self.fixes.time, np.full((len(self.fixes), 2), np.nan))
        return PositionFixes(nothing, self.lever_arm, np.ones(2))

    def motion(self, speed: float, rate: float) -> OdometryMotion:
        """Return the integration of the odometry with these noises of `OdometryNoise`.

        Parameters
        ----------
        speed, rate : float
        """
        assert self.recording.odometry is not None
        return OdometryMotion(self.recording.odometry, OdometryNoise(speed, rate, *_ODOMETRY_WALKS))


Correction = InertialCorrection | OdometryCorrection


def correction_of(
    recording: Recording, alignment: float, start: Start | None = None, period: float | None = None
) -> Correction:
    """Return the filters for the streams that there are.

    Parameters
    ----------
    recording : Recording
        Odometry comes before an IMU, ranges before fixes.
    alignment : float
        s.
    start : Start, optional
        What is known of it, of `known_start`, or for odometry with a `PlanarState`.
    period : float, optional
        Of fixes by ranges, s; by default the shortest of some in which most have one.

    Raises
    ------
    InswsnError
        If there is nothing that moves, or no network while it does.
    """
    motion = recording.odometry if recording.odometry is not None else recording.imu
    if motion is None or not len(motion):
        raise InswsnError(
            f"The recording {recording.name} has neither an IMU nor odometry: there is nothing to "
            "correct fixes with."
        )
    whole = recording
    recording = recording.part(float(motion.time[0]), float(np.nextafter(motion.time[-1], np.inf)))
    if recording.odometry is not None:
        ranges = recording.ranges
        if ranges is not None and ranges.anchors.shape[1] > 2:
            raise InswsnError(
                f"The recording {whole.name} has odometry, which moves on a plane, and anchors in "
                "three dimensions: leave out z_m, and have ranges along the plane."
            )

    def build(side: float) -> Correction:
        fixes = network_of(recording, side, period)
        if recording.odometry is not None:
            return OdometryCorrection(recording, fixes, alignment, start)
        if fixes.position.shape[1] > 2:
            return InertialCorrection(recording, fixes, alignment, start)
        fixes, assumed = with_height(fixes, recording.height or 0.0)
        return InertialCorrection(recording, fixes, alignment, start, True, assumed)

    if recording.ranges is None or not len(recording.ranges) or recording.height is not None:
        return build(0.0)
    found, side = on_a_side(recording.ranges, build, _likelihood)
    return replace(found, assumed=[*found.assumed, *side]) if side else found


def _likelihood(filters: Correction) -> tuple[float, float]:
    """Return when filters start, s, and the logarithm of a likelihood over the first half."""
    half, rung = float(np.mean(filters.fixes.time[[0, -1]])), filters.rungs[WHITE]
    return filters.start.time, rung.run(*rung.begin, end=half, kept=False).log_likelihood


def turned_by_gyroscope(recording: Recording) -> Recording | None:
    """Return a recording whose odometry turns as its IMU does about the vertical, if it has both.

    Up is the mean specific force: the vehicle goes on a plane, and comes to rest as fast as it
    began to move.

    Parameters
    ----------
    recording : Recording
    """
    odometry, imu = recording.odometry, recording.imu
    if odometry is None or imu is None or len(imu) < 2:
        return None
    up = imu.force.mean(axis=0)
    size = float(np.linalg.norm(up))
    rate = imu.rate @ up / (size if size > 0 else 1.0)
    turned = cumulative_trapezoid(rate, imu.time, initial=0.0)
    ends = np.interp(odometry.time, imu.time, turned)
    steps = np.diff(odometry.time)
    mean = np.append(rate[0], np.diff(ends) / steps)
    inside = (odometry.time >= imu.time[0]) & (odometry.time <= imu.time[-1])
    mean = np.where(inside, mean, odometry.rate)
    return replace(recording, odometry=replace(odometry, rate=mean), imu=None)


def network_of(recording: Recording, side: float = 0.0, period: float | None = None) -> Fixes:
    """Return what the network alone says: fixes as they are, or of ranges, with velocities.

    Parameters
    ----------
    recording : Recording
    side : float
        Of anchors that lie in a plane, as of `multilaterate_track`.
    period : float, optional
        Of fixes by ranges, s; by default the shortest of some in which most have one.

    Raises
    ------
    InswsnError
        If there is no network, or too few ranges at a time.
    """
    if recording.ranges is not None and len(recording.ranges):
        periods = PERIODS if period is None else (period,)
        return slope_velocity(fixes_of(recording.ranges, recording.height, side, periods))
    fixes = recording.fixes
    if fixes is None or not np.isfinite(fixes.position).all(axis=1).any():
        raise InswsnError(
            f"The recording {recording.name} has neither ranges nor fixes while it moves: there is "
            "nothing to correct by."
        )
    return slope_velocity(fixes) if fixes.velocity is None else fixes


def first_fix(fixes: Fixes) -> float:
    """Return when the first fix was, s."""
    return float(fixes.time[np.isfinite(fixes.position).all(axis=1)][0])


def deviation_of(fixes: Fixes) -> float:
    """Return about how large the errors of fixes are, m.

    What they say of themselves, or else what their second differences are if they move steadily.
    """
    if fixes.deviation is not None and np.isfinite(fixes.deviation).any():
        return max(float(np.nanmedian(fixes.deviation[:, :2])), _LEAST)
    return _size(fixes.position[:, :2])


def _size(values: Array) -> float:
    """Return about how large errors of values (rows, 2) are, by their second differences."""
    second = np.diff(values[np.isfinite(values).all(axis=1)], 2, axis=0)
    if not len(second):
        return 1.0
    return max(float(_OF_SECOND_DIFFERENCES * np.median(np.abs(second))), _LEAST)


def shares_of(fixes: Fixes) -> Array:
    """Return deviations of fixes by axis over the median one to the side, (rows, 3).

    Those that a fix does not say are as in the median, and twice as large upwards.

    Parameters
    ----------
    fixes : Fixes
    """
    found = np.tile(UP, (len(fixes), 1))
    if fixes.deviation is not None and np.isfinite(fixes.deviation).any():
        said = fixes.deviation / deviation_of(fixes)
        part = found[:, : said.shape[1]]
        part[:] = np.where(np.isfinite(said), np.maximum(said, _LEAST_SHARE), part)
    return found


def series_of(time: Array, values: Array, first: int = 0) -> tuple[Array, Whole]:
    """Return the times of the components of measurements that are there, and their series.

    Parameters
    ----------
    time : ndarray, (rows,)
        s.
    values : ndarray, (rows, d)
        NaN where missing.
    first : int
        The number of the series of the first component.
    """
    row, axis = np.nonzero(np.isfinite(values))
    return time[row], np.asarray(first + axis, dtype=np.int64)


def _colour(numbers: Sequence[float], axes: Array) -> list[Array]:
    """Return deviations and correlation times by axis of coloured errors, if there are some."""
    if not numbers:
        return []
    size, lasting = numbers
    return [size * axes, np.full(len(axes), lasting)]


def _is_vehicle(velocity: Array) -> bool:
    speed = np.linalg.norm(velocity[np.isfinite(velocity).all(axis=1)], axis=1)
    return bool(len(speed)) and float(np.quantile(speed, _QUANTILE)) > _RUNNER


def _planar(fixes: Fixes) -> Fixes:
    return Fixes(fixes.time, fixes.position[:, :2])


def without(fixes: Fixes, withheld: Mask) -> Fixes:
    """Return fixes of which some are NaN; those of which velocities are made are the others.

    Parameters
    ----------
    fixes : Fixes
    withheld : ndarray of bool, (rows,)
    """
    position = np.where(withheld[:, None], np.nan, fixes.position)
    velocity = fixes.velocity
    if velocity is not None:
        velocity = np.where(withheld[:, None], np.nan, velocity)
    return replace(fixes, position=position, velocity=velocity)
