"""Filters of recordings with an IMU or odometry, and fixes or ranges, that start by themselves."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, ClassVar

import numpy as np
from scipy.integrate import cumulative_trapezoid
from scipy.ndimage import uniform_filter1d

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
    smooth,
)
from inswsn_lib.logs.blocks import interpolate
from inswsn_lib.logs.findings import FALSE_ALARM, Finding
from inswsn_lib.logs.network_fixes import (
    HELD,
    UP,
    fix_deviation,
    fixes_of,
    is_level,
    named_plane,
    network_of,
    refusal,
    roughness,
    shares_of,
    shortest,
    with_height,
)
from inswsn_lib.logs.window_fits import PERIODS, in_a_plane
from inswsn_lib.streams import Fixes, Imu, Ranges, Recording, Whole

#: Of the random walks of the IMU's biases, which no short recording tells
WALKS = (1e-3, 1e-4)
#: Ranges that lie four deviations from what is expected are left out
GATE = 16.0
_LASTING = 3.0  # s, of the coloured errors of fixes at the begin of the search
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
WHEELS = "coloured fixes, and the speed of wheels"
#: After the name of a filter that has it, too
STANDSTILL = ", and zero velocity where it stands"
#: Filters that are there for any body
USUAL = (WHITE, COLOURED, TIGHT, PLANAR_TIGHT)
# A body that goes faster than a runner is a vehicle: m/s, of a quantile; how often it is said not
# to slip, s, and how fast it may at first, m/s
_RUNNER, _QUANTILE, _SLIP_STEP, _SLIP = 6.0, 0.8, 0.2, 0.3
# m/s, the deviation of a velocity that is zero, and the least share of the time that it must be
_STANDS, _STANDING = 0.02, 0.03
_WHEEL, _MOVING = 0.1, 0.5  # m/s: of a speed by wheels, and of what tells where forward is
#: Takes numbers, and which fixes are withheld
Observing = Callable[[Sequence[float], Mask | None], list[Observation]]
_WINDOW = 1.0  # s, over which an IMU is quiet
_QUIETEST, _QUIET = 0.02, 2.5  # a share of all windows, and times the level that these have
_CONTRAST = 4.0  # times that level the median of one must be: else it never stands, or never moves
_LASTS = 2.0  # s, before it is believed
#: Between updates, s
_STILL_STEP = 0.2
_SPEED, _TOLD = 0.1, 0.3  # m/s, by fixes: what is let pass, and the largest deviation that tells
_FEWEST_FIXES = 3  # fixes


@dataclass(frozen=True, eq=False)
class Rung:
    """A filter on a recording.

    Attributes
    ----------
    run : callable
        Takes the numbers, and by name ``start``, ``end``, and ``kept`` as `run_error_state`, and
        ``gone``, which fixes are withheld; returns a solution, with an event at each fix's time.
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

    def likely(self, *numbers: float, end: float) -> float:
        """Return the log-likelihood of its innovations until a time, s."""
        return self.run(*numbers, end=end, kept=False).log_likelihood


@dataclass(frozen=True, eq=False)
class Correction(ABC):
    """Filters of a motion that is coupled to fixes, or to ranges.

    Attributes
    ----------
    recording : Recording
        With what moves.
    fixes : Fixes
        With velocities; if there are ranges, made of them.
    alignment : float
        For how long after the first fix the start is aligned, s, or a quarter of the recording if
        that is shorter; for longer where the heading does not show yet.
    given : Start, optional
        What is known of the start.
    held : bool
        Whether the fixes' heights were not measured, but are held.
    assumed : list of Finding
        What is taken for granted of the network.
    """

    recording: Recording
    fixes: Fixes
    alignment: float
    given: Start | None = None
    held: bool = False
    assumed: list[Finding] = field(default_factory=list)

    #: Of how many of x, y, vx, vy the filters state the errors
    stated: ClassVar[int]
    #: Times its variance, beyond which a component is left out; of loosely coupled filters
    gate: ClassVar[float]

    @property
    def lever_arm(self) -> Array:
        """From what moves to the tag, (3,) or on a plane (2,), m."""
        return self.recording.lever_arm

    @property
    def rate(self) -> Array | None:
        """What the gyroscopes say at the times of fixes, (fixes, 3), rad/s; None by odometry."""
        return None

    @property
    @abstractmethod
    def rungs(self) -> dict[str, Rung]:
        """The filters by name."""

    @property
    @abstractmethod
    def start(self) -> Start:
        """Where the filters start."""

    @abstractmethod
    def motion(self, first: float, second: float) -> Any:
        """Return the motion with the first two numbers of a filter, the noises of its sensors."""

    def run(
        self, observed: Sequence[Observation], first: float, second: float,
        start: Start | None = None, *, end: float = np.inf, kept: bool = True,
        gate: float | None = None,
    ) -> Solution:  # fmt: skip
        """Run a filter on observations of one's own, with an event at the time of each fix.

        The numbers are those of `motion`, the last ones as in `run_error_state`.
        """
        d = len(self.lever_arm)
        nothing = Fixes(self.fixes.time, np.full((len(self.fixes), d), np.nan))
        silent = PositionFixes(nothing, self.lever_arm, np.ones(d))
        return run_error_state(
            self.motion(first, second), self.start if start is None else start,
            [*observed, silent], end=end, kept=kept, gate=self.gate if gate is None else gate,
        )  # fmt: skip

    @property
    def middle(self) -> float:
        """The middle of the time of fixes, s."""
        return float(np.mean(self.fixes.time[[0, -1]]))

    @property
    def _first_and_last(self) -> tuple[float, float]:
        """The times of the first fix that is there, and of the last, s."""
        there = np.isfinite(self.fixes.position).all(axis=1)
        return float(self.fixes.time[there][0]), float(self.fixes.time[-1])

    def _rung(
        self, observed: Observing, begin: tuple[float, ...], series: list[tuple[Array, Whole]],
        lasting: int | None = None, gate: float | None = None,
    ) -> Rung:  # fmt: skip
        """Return a filter whose numbers after those of the motion are of what is observed."""

        def run(*numbers: float, gone: Mask | None = None, **how: Any) -> Solution:
            first, second, *others = numbers
            return self.run(observed(others, gone), first, second, gate=gate, **how)

        return Rung(run, begin, series, lasting)

    def _fixes_left(self, gone: Mask | None) -> Fixes:
        """Return the fixes without those that are withheld."""
        if gone is None:
            return self.fixes
        position, velocity = self.fixes.position, self.fixes.velocity
        assert velocity is not None
        return replace(
            self.fixes, position=np.where(gone[:, None], np.nan, position),
            velocity=np.where(gone[:, None], np.nan, velocity),
        )  # fmt: skip

    def _ranges_left(self, gone: Mask | None) -> Ranges:
        """Return the ranges without those of fixes that are withheld."""
        ranges = self.recording.ranges
        assert ranges is not None
        if gone is None:
            return ranges
        # the stamp of a fix is between those of its ranges
        middles = (self.fixes.time[1:] + self.fixes.time[:-1]) / 2
        return ranges.kept(~gone[np.searchsorted(middles, ranges.time)])


class InertialCorrection(Correction):
    """An INS in space, coupled to fixes, or to ranges, whose errors are white, or lasting, too.

    Numbers of all its filters are first those of `ImuNoise`, force and rate. On fixes they go on
    with the deviation of the white errors of fixes to the side, m, and that of their velocities,
    m/s, if these were measured; then, if errors of fixes last, their deviation, m, and correlation
    time, s; then that of wheels, which slip to no side, m/s. Where fixes say how good each is,
    their errors go with that. On ranges: the deviation of white errors, that of coloured ones, m,
    the correlation time of these, s, and the deviation of a bias of each anchor, m.
    """

    stated = 4
    gate = np.inf

    @cached_property
    def rungs(self) -> dict[str, Rung]:
        """The filters by name."""
        velocity, size = self.fixes.velocity, fix_deviation(self.fixes)
        assert velocity is not None
        series, speeds = [_series(self.fixes.time, self._measured_part(self.fixes).position)], []
        if self._measured:
            speeds = [roughness(velocity[:, :2])]
            series.append(_series(self.fixes.time, velocity, first=3))
        white = (0.02, 0.002, size, *speeds)
        coloured = (0.02, 0.002, size / 2, *speeds, size, _LASTING)
        lasting = len(coloured) - 1
        found = {
            WHITE: self._rung(self._observed, white, series),
            COLOURED: self._rung(self._observed, coloured, series, lasting),
        }
        name, observed = COLOURED, self._observed
        if (heard := self.recording.ranges) is not None:
            begin = (0.02, 0.001, size / 2, size / 2, 1.0, size / 4)
            times = [(heard.time, heard.anchor)]
            found[TIGHT] = self._rung(self._observed_ranges, begin, times, 4, GATE)
        elif self.recording.odometry is not None:
            name, observed, coloured = WHEELS, self._observed_wheels, (*coloured, _WHEEL)
        elif _is_vehicle(velocity[self.fixes.time <= self.middle]):
            name, observed, coloured = LATERAL, self._observed_wheels, (*coloured, _SLIP)
        found[name] = self._rung(observed, coloured, series, lasting)

        def still(numbers: Sequence[float], gone: Mask | None) -> list[Observation]:
            time = self._standstills(self._fixes_left(gone))
            zero = Velocities(time, np.zeros((len(time), 3)), np.full(3, _STANDS))
            return [*observed(numbers, gone), *([zero] if len(time) else [])]

        if len(self._standstills(self.fixes)) * _STILL_STEP > _STANDING * np.ptp(self.fixes.time):
            found[name + STANDSTILL] = self._rung(still, coloured, series, lasting)
        return found

    def _standstills(self, fixes: Fixes) -> Array:
        imu = self.recording.imu
        assert imu is not None
        return standstill_times(imu, fixes, fix_deviation(self.fixes), self.middle)

    @cached_property
    def axes(self) -> Array:
        """Turns vectors of the IMU into axes of a vehicle: forward, left, up, (3, 3).

        Forward is where it goes, by a filter on the first half of the fixes; up is near the mean
        vertical.
        """
        coloured = self.rungs[COLOURED]
        solution = smooth(coloured.run(*coloured.begin, end=self.middle))
        R = np.array([state.attitude for state in solution.states])
        fast = _RUNNER if self.recording.odometry is None else _MOVING
        moving = np.linalg.norm(solution.velocity, axis=1) > fast
        forward = np.einsum("kji,kj->i", R[moving], solution.velocity[moving])
        left = np.cross(R[:, 2].mean(axis=0), forward)
        rows = [forward, left, np.cross(forward, left)]
        return np.array([row / np.linalg.norm(row) for row in rows])

    @cached_property
    def rate(self) -> Array:
        """What the gyroscopes say at the times of fixes, (fixes, 3), rad/s."""
        imu = self.recording.imu
        assert imu is not None
        return interpolate(imu.time, imu.rate, self.fixes.time)

    @property
    def _measured(self) -> bool:
        """Whether velocities of fixes were measured, and are not slopes of fixes."""
        fixes = self.recording.fixes
        return self.recording.ranges is None and fixes is not None and fixes.velocity is not None

    @cached_property
    def start(self) -> Start:
        """Where the filters start, by an alignment."""
        force, rate, *sizes = self.rungs[WHITE].begin
        first, last = self._first_and_last
        begin = first - _BEFORE if self.given is None else self.given.time
        end = max(begin, first) + min(self.alignment, _SHORTER * (last - first))
        return align(
            self.motion(force, rate), self._observed(sizes), begin, end, prior=self.given,
            latest=max(end, first + _LONGEST * (last - first)),
        )  # fmt: skip

    def motion(self, first: float, second: float) -> InertialMotion:
        """Return the integration of the IMU with noises of force and rate as of `ImuNoise`."""
        return replace(self._motion, noise=ImuNoise(first, second, *WALKS))

    @cached_property
    def _motion(self) -> InertialMotion:
        return InertialMotion.of(self.recording, ImuNoise(0.0, 0.0, *WALKS))

    def _observed(self, numbers: Sequence[float], gone: Mask | None = None) -> list[Observation]:
        (white, *others), measured = numbers, self._measured
        fixes, shares = self._fixes_left(gone), shares_of(self.fixes)
        colours = _colour(others[measured:], np.nanmedian(shares, axis=0))
        observed: list[Observation] = [
            PositionFixes(self._measured_part(fixes), self.lever_arm, white * shares, *colours)
        ]
        if measured:
            assert fixes.velocity is not None
            observed.append(
                Velocities(fixes.time, fixes.velocity, others[0] * UP, self.rate, self.lever_arm)
            )
        if self.held:
            heights = replace(fixes, position=fixes.position * [np.nan, np.nan, 1.0])
            observed.append(PositionFixes(heights, self.lever_arm, np.full(3, HELD)))
        return observed

    def _observed_wheels(
        self, numbers: Sequence[float], gone: Mask | None = None
    ) -> list[Observation]:
        """Observe that a vehicle slips to no side, and by odometry how fast it goes."""
        *sizes, white = numbers
        odometry = self.recording.odometry
        if odometry is None:
            time = np.arange(self.fixes.time[0], self.fixes.time[-1], _SLIP_STEP)
            speed = np.full(len(time), np.nan)
        else:  # a speed is the mean of its step
            time, speed = (odometry.time[1:] + odometry.time[:-1]) / 2, odometry.speed[1:]
        wheels = WheelSpeeds(time, speed, self.axes, np.full(3, white))
        return [*self._observed(sizes, gone), wheels]

    def _observed_ranges(
        self, numbers: Sequence[float], gone: Mask | None = None
    ) -> list[Observation]:
        white, coloured, time, bias = numbers
        heard = self._ranges_left(gone)
        return [RangesToAnchors(heard, self.lever_arm, white, bias, coloured, time)]

    def _measured_part(self, fixes: Fixes) -> Fixes:
        """Return fixes without heights that are held."""
        return replace(fixes, position=fixes.position * [1, 1, np.nan]) if self.held else fixes


class OdometryCorrection(Correction):
    """Dead reckoning on a plane, with fixes, or tightly coupled with ranges.

    Numbers of all its filters are first those of `OdometryNoise`, speed and rate; then on fixes as
    those of `InertialCorrection`, on ranges the deviations of white errors and of a bias of each
    anchor, m. Ranges have a common scale as a state. The speed is no state.
    """

    stated = 2
    gate = GATE

    @property
    def lever_arm(self) -> Array:
        """From what moves to the tag, (2,), m."""
        return self.recording.lever_arm[:2]

    @cached_property
    def rungs(self) -> dict[str, Rung]:
        """The filters by name."""
        motion, size = (0.05, 0.02), fix_deviation(self.fixes)
        series = [_series(self.fixes.time, self.fixes.position[:, :2])]
        coloured = (*motion, size / 2, size, _LASTING)
        found = {
            WHITE: self._rung(self._observed, (*motion, size), series),
            COLOURED: self._rung(self._observed, coloured, series, len(coloured) - 1),
        }
        if (heard := self.recording.ranges) is not None:
            times = [(heard.time, heard.anchor)]
            found[PLANAR_TIGHT] = self._rung(self._observed_ranges, (*motion, 0.2, 0.2), times)
        return found

    @cached_property
    def start(self) -> Start:
        """The given one, or where an alignment by a bank of headings ends."""
        if self.given is not None:
            return self.given
        first, last = self._first_and_last
        place = self.fixes.position[self.fixes.time == first][0, :2]
        far = 3 * fix_deviation(self.fixes) + float(np.linalg.norm(self.lever_arm))
        tight = self.recording.ranges is not None
        speed, rate, *sizes = self.rungs[PLANAR_TIGHT if tight else WHITE].begin
        observed = (self._observed_ranges if tight else self._observed)(sizes)
        begin, window = first - 1e-3, min(self.alignment, _SHORTER * (last - first))
        while True:
            try:
                return align_planar(
                    self.motion(speed, rate), observed, begin, begin + window, place,
                    (far, _SCALED, _DRIFTING),
                )  # fmt: skip
            except InswsnError:
                window *= 2
                if not 0 < window <= _LONGEST * (last - first):  # 0 of a single fix
                    raise

    def motion(self, first: float, second: float) -> OdometryMotion:
        """Return the integration of odometry with noises of speed and rate (`OdometryNoise`)."""
        assert self.recording.odometry is not None
        noise = OdometryNoise(first, second, *_ODOMETRY_WALKS)
        return OdometryMotion(self.recording.odometry, noise)

    def _observed(self, numbers: Sequence[float], gone: Mask | None = None) -> list[Observation]:
        (white, *others), fixes = numbers, self._fixes_left(gone)
        planar = Fixes(fixes.time, fixes.position[:, :2])
        sizes = white * shares_of(self.fixes)[:, :2]
        return [PositionFixes(planar, self.lever_arm, sizes, *_colour(others, np.ones(2)))]

    def _observed_ranges(
        self, numbers: Sequence[float], gone: Mask | None = None
    ) -> list[Observation]:
        (white, bias), heard = numbers, self._ranges_left(gone)
        return [RangesToAnchors(heard, self.lever_arm, white, bias=bias, scale=_SCALE)]


def correction_of(
    recording: Recording, alignment: float, start: Start | None = None, period: float | None = None
) -> Correction:
    """Return the filters for the streams that there are, with the arguments of `Ladder`.

    Ranges come before fixes; odometry before an IMU, unless the network is in space.
    """
    planar = is_planar(recording)
    motion = recording.odometry if planar else recording.imu
    if motion is None or not len(motion):
        raise InswsnError(
            f"The recording {recording.name} has neither an IMU nor odometry: there is nothing to "
            "correct fixes with."
        )
    recording = recording.part(float(motion.time[0]), float(np.nextafter(motion.time[-1], np.inf)))
    ranges = recording.ranges
    if planar and ranges is not None and ranges.anchors.shape[1] > 2:
        raise InswsnError(
            f"The recording {recording.name} has odometry, which moves on a plane, and anchors in "
            "three dimensions: leave out z_m, and have ranges along the plane."
        )

    def build(fixes: Fixes) -> Correction:
        if planar:
            return OdometryCorrection(recording, fixes, alignment, start)
        if fixes.position.shape[1] > 2:
            return InertialCorrection(recording, fixes, alignment, start)
        fixes, assumed = with_height(fixes, recording.height or 0.0)
        return InertialCorrection(recording, fixes, alignment, start, True, [assumed])

    periods = PERIODS if period is None else (period,)
    if ranges is None or not len(ranges) or recording.height is not None:
        return build(network_of(recording, periods))
    return _on_a_side(ranges, periods, build)


def _on_a_side(
    ranges: Ranges, periods: Sequence[float], build: Callable[[Fixes], Correction]
) -> Correction:
    """Return the filters on that side of the anchors' plane which fits the motion."""
    normal = in_a_plane(ranges)
    if normal is None:
        return build(fixes_of(ranges, periods))
    if (fixes := shortest(ranges, periods)) is not None:
        return build(fixes)
    found: dict[float, tuple[Correction, float, float]] = {}
    said = ""
    for side in (-1.0, 1.0):
        try:
            filters = build(fixes_of(ranges, periods, side=side))
            white, begun = filters.rungs[WHITE], filters.start.time
            likely = white.likely(*white.begin, end=filters.middle)
            found[side] = filters, begun, likely
        except InswsnError as error:
            said = said or str(error)
    if not found:
        raise InswsnError(f"The anchors lie in a plane, and on neither side of it: {said}")
    if len(found) == 1:
        gain = np.inf if -1.0 in found else -np.inf
    else:
        (_, start, below), (_, other, above) = found.values()
        # one that starts later could not be trusted before
        gain = below - above if start == other else np.inf * (other - start)
    bound = float(-np.log(FALSE_ALARM))
    level, told = is_level(normal), abs(gain) >= bound
    if not told and not level:
        raise refusal(ranges, normal)
    side = 1.0 if gain <= -bound else -1.0
    where = ("below" if side < 0 else "above") if level else "on the side that fits the motion"
    plane = named_plane(ranges, normal)
    says = f"the anchors lie in a plane, {plane}; the tag is taken to be {where}"
    if not told:
        says += ", which the motion does not tell and matters to heights alone"
    chosen, *_ = found[side]
    chosen.assumed.append(
        Finding("side", "anchors", float(-side * gain), bound, np.inf, told or None, says)
    )
    return chosen


def is_planar(recording: Recording) -> bool:
    """Tell whether the filters are of odometry on a plane, and not of an IMU in space."""
    if recording.odometry is None or recording.imu is None:
        return recording.odometry is not None
    if recording.ranges is not None and len(recording.ranges):
        return bool(recording.ranges.anchors.shape[1] == 2)
    return recording.fixes is None or bool(recording.fixes.position.shape[1] == 2)


def turned_by_gyroscope(recording: Recording) -> Recording | None:
    """Return a recording whose odometry turns as its IMU does about the vertical, if it has both.

    Up is the mean specific force: the vehicle goes on a plane, and comes to rest as fast as it
    began to move.
    """
    odometry, imu = recording.odometry, recording.imu
    if odometry is None or imu is None or len(imu) < 2:
        return None
    up = imu.force.mean(axis=0)
    size = float(np.linalg.norm(up))
    rate = imu.rate @ up / (size if size > 0 else 1.0)
    turned = cumulative_trapezoid(rate, imu.time, initial=0.0)
    begins, ends = odometry.time[:-1], odometry.time[1:]
    inside = (begins >= imu.time[0]) & (ends <= imu.time[-1])
    means = np.diff(np.interp(odometry.time, imu.time, turned)) / (ends - begins)
    mean = np.append(odometry.rate[0], np.where(inside, means, odometry.rate[1:]))
    return replace(recording, odometry=replace(odometry, rate=mean), imu=None)


def _series(time: Array, values: Array, first: int = 0) -> tuple[Array, Whole]:
    """Return the times of the components (rows, d) that are there, and their series."""
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


def standstill_times(imu: Imu, fixes: Fixes, deviation: float, until: float) -> Array:
    r"""Return times at which a body stands still, (n,), s.

    It stands where specific force and angular rate vary as little as in the quietest windows (the
    detector of variances; Skog, Händel, Nilsson and Rantakokko 2010), and the line through the
    fixes since then has no speed: less than 0.1 m/s, or than three of its deviations,
    :math:`\sigma \sqrt{12 / n} / T`. None of these fixes may lie off, nor the last have another
    velocity: a car can leave so gently that its IMU is as quiet as before. Each time is told by
    what was before it alone, but for the level of the quietest windows, which is that of the
    recording's first part, until a time (s). The deviation is that of fixes, m.
    """
    quiet = is_quiet(imu, until)
    edges = np.flatnonzero(np.diff(np.concatenate([[False], quiet, [False]]).astype(int)))
    there = np.isfinite(fixes.position[:, :2]).all(axis=1)
    time, place = fixes.time[there], fixes.position[there, :2]
    speed = np.zeros(len(time))
    if fixes.velocity is not None:
        speed = np.linalg.norm(fixes.velocity[there, :2], axis=1)
    found = []
    for first, last in zip(edges[::2], edges[1::2] - 1, strict=True):
        begin, end = imu.time[first] - _WINDOW, imu.time[last]
        for at in np.arange(begin + _LASTS, end, _STILL_STEP):
            inside = slice(*np.searchsorted(time, [begin, at]))
            if _stands(time[inside], place[inside], speed[inside], deviation):
                found.append(float(at))
    return np.array(found)


def is_quiet(imu: Imu, until: float) -> Mask:
    """Tell of each sample whether the window that ends with it is quiet."""
    rows = max(round(_WINDOW / float(np.median(np.diff(imu.time)))), 2)
    quiet, contrast = np.ones(len(imu), dtype=bool), 0.0
    for vectors in (imu.force, imu.rate):
        variance = np.zeros(len(imu))
        for column in vectors.T:  # one at a time: they are long
            apart = column - column.mean()
            mean, square = (
                uniform_filter1d(x, rows, origin=(rows - 1) // 2) for x in (apart, apart**2)
            )
            variance += np.maximum(square - mean**2, 0)
        size = np.sqrt(variance)
        first = size[rows:][imu.time[rows:] <= until]
        if not len(first):
            return np.zeros(len(imu), dtype=bool)
        level = float(np.quantile(first, _QUIETEST))
        quiet &= size <= _QUIET * level
        contrast = max(contrast, float(np.median(first)) / max(level, 1e-300))
    quiet[:rows] = False
    return quiet & (contrast > _CONTRAST)


def _stands(time: Array, place: Array, speed: Array, deviation: float) -> bool:
    if len(time) < _FEWEST_FIXES or time[-1] <= time[0]:
        return False
    off = np.linalg.norm(place - np.median(place, axis=0), axis=1)
    if off.max() > 4 * deviation or speed[-1] > _SPEED:
        return False
    slope = np.polyfit(time - time[0], place, 1)[0]
    expected = deviation * np.sqrt(12 / len(time)) / float(time[-1] - time[0])
    return bool(expected < _TOLD and np.linalg.norm(slope) < max(_SPEED, 3 * expected))
