"""A filter of any recording with an IMU or odometry, and fixes or ranges, that starts by itself."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, Protocol

import numpy as np
from scipy.integrate import cumulative_trapezoid

from inswsn_lib.calibration import slope_velocity
from inswsn_lib.checks import Array, Mask
from inswsn_lib.errors import InswsnError
from inswsn_lib.inertial import (
    ImuNoise,
    InertialMotion,
    Innovations,
    Observation,
    OdometryMotion,
    OdometryNoise,
    PlanarState,
    PositionFixes,
    RangesToAnchors,
    Solution,
    Start,
    Velocities,
    align,
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
_BEFORE, _LONGEST = 0.1, 0.4  # s before the first fix, and share of all, of an alignment
# Of the odometry: the bias of each anchor's ranges is a number, their common scale is not
_SCALE, _ODOMETRY_WALKS = 0.1, (1e-4, 1e-4)
_HEADINGS = 8
_TURNED, _SCALED, _DRIFTING = 0.4, 0.2, 0.05  # rad, 1, rad/s: at the start of odometry


class Correction(Protocol):
    """What corrects a motion by a network, with some numbers that are tuned."""

    @property
    def recording(self) -> Recording:
        """What is corrected."""

    @property
    def fixes(self) -> Fixes:
        """The network."""

    @property
    def start(self) -> Start:
        """Where the filter starts."""

    @property
    def known(self) -> float:
        """From when the start is known well enough to judge, s."""

    @property
    def lever_arm(self) -> Array:
        """From what moves to the tag, m."""

    @property
    def assumed(self) -> Sequence[Finding]:
        """What is taken for granted of the network."""

    @property
    def begins(self) -> list[tuple[float, ...]]:
        """The numbers at which searches begin; the most likely of what they find is taken."""

    @property
    def stated(self) -> int:
        """Of how many of x, y, vx, vy the filter states the errors."""

    @property
    def rate(self) -> Array | None:
        """The angular rate at the times of fixes, if the lever arm turns in space, rad/s."""

    def run(self, *numbers: float, end: float = np.inf, kept: bool = True) -> Solution:
        """Run the filter, which has an event at the time of each fix."""

    def told(self, solution: Solution) -> list[Innovations]:
        """Return the innovations of what is tuned and judged by."""

    def series(self, solution: Solution) -> Whole:
        """Return of which series each component of those is: an axis, or an anchor."""

    def without(self, withheld: Mask) -> Any:
        """Return the same without some fixes."""


@dataclass(frozen=True, eq=False)
class InertialCorrection:
    """An INS, loosely coupled to fixes whose errors are white, or white and coloured.

    Its numbers are those of `ImuNoise`, force and rate, the deviation of the white errors of fixes
    to the side, m, and that of their velocities, m/s, if these were measured; then, if errors of
    fixes are coloured, their deviation, m, and correlation time, s. Where fixes say how good each
    is, the white errors go with that.

    Attributes
    ----------
    recording : Recording
        With an IMU.
    fixes : Fixes
        With velocities, in three dimensions.
    alignment : float
        For how long after the first fix the start is aligned, s; for longer where the heading does
        not show yet.
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
        """Of how many of x, y, vx, vy the filter states the errors: of all."""
        return 4

    @property
    def known(self) -> float:
        """The end of the alignment, s."""
        return self.start.time

    @cached_property
    def begins(self) -> list[tuple[float, ...]]:
        """The numbers at which searches begin: with white errors, and with coloured ones, too."""
        velocity = self.fixes.velocity
        speeds = [_size(velocity[:, :2])] if velocity is not None and self._measured else []
        return _begins((0.02, 0.002), self.fixes, speeds)

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
        """Where the filter starts, by an alignment."""
        force, rate, *sizes = self.begins[0]
        first, last = first_fix(self.fixes), float(self.fixes.time[-1])
        begin = first - _BEFORE if self.given is None else self.given.time
        end = max(begin, first) + self.alignment
        return align(
            self._motion(force, rate), self._observed(*sizes), begin, end, prior=self.given,
            latest=max(end, first + _LONGEST * (last - first)),
        )  # fmt: skip

    def run(self, *numbers: float, end: float = np.inf, kept: bool = True) -> Solution:
        """Run the filter, which has an event at the time of each fix.

        Parameters
        ----------
        numbers : float
        end, kept
            When the data end, s, and what is kept, as in `run_error_state`.
        """
        force, rate, *sizes = numbers
        return run_error_state(
            self._motion(force, rate), self.start, self._observed(*sizes), end=end, kept=kept
        )

    def _observed(self, white: float, *numbers: float) -> list[Observation]:
        fixes, measured = self.fixes, self._measured
        colours = _colour(numbers[measured:], np.nanmedian(shares_of(self.fixes), axis=0))
        observed: list[Observation] = [
            PositionFixes(self._measured_fixes, self.lever_arm, white * shares_of(fixes), *colours)
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

    @property
    def _measured_fixes(self) -> Fixes:
        """The fixes without heights that are held."""
        if not self.held:
            return self.fixes
        return replace(self.fixes, position=self.fixes.position * [1.0, 1.0, np.nan])

    def told(self, solution: Solution) -> list[Innovations]:
        """Return the innovations of fixes, and of their velocities if they were measured."""
        return solution.innovations[: 1 + self._measured]

    def series(self, solution: Solution) -> Whole:
        """Return of which axis each component of the innovations is; those of velocities follow."""
        position = self._measured_fixes.position
        found = axes_of(self.fixes.time, position, self.start, solution)
        if not self._measured:
            return found
        assert self.fixes.velocity is not None
        moving = axes_of(self.fixes.time, self.fixes.velocity, self.start, solution)
        return np.append(found, 3 + moving)

    def without(self, withheld: Mask) -> InertialCorrection:
        """Return the same without some fixes; it starts where this one does."""
        found = replace(self, fixes=_without(self.fixes, withheld))
        vars(found).update(start=self.start, begins=self.begins)
        return found

    def _motion(self, force: float, rate: float) -> InertialMotion:
        return InertialMotion.of(self.recording, ImuNoise(force, rate, *WALKS))


@dataclass(frozen=True, eq=False)
class OdometryCorrection:
    """Dead reckoning on a plane, with fixes, or tightly coupled with ranges.

    Its numbers are those of `OdometryNoise`, speed and rate; then with fixes as those of
    `InertialCorrection`, with ranges the deviations of white errors and of a bias of each anchor,
    m. Ranges have a common scale as a state.

    Attributes
    ----------
    recording : Recording
        With odometry.
    fixes : Fixes
        With velocities; if there are ranges, made of them.
    ranges : Ranges or None
        On the plane.
    alignment : float
        By how much of the data the heading is chosen at which the filter starts, s.
    given : Start, optional
        Where the filter starts.
    assumed : sequence of Finding
        What is taken for granted of the network.
    """

    recording: Recording
    fixes: Fixes
    ranges: Ranges | None
    alignment: float
    given: Start | None = None
    assumed: Sequence[Finding] = ()

    @property
    def lever_arm(self) -> Array:
        """From what moves to the tag, (2,), m."""
        return self.recording.lever_arm[:2]

    @property
    def stated(self) -> int:
        """Of how many of x, y, vx, vy the filter states the errors: the speed is no state."""
        return 2

    @property
    def rate(self) -> None:
        """None: the velocity is that of the wheels."""
        return None

    @property
    def known(self) -> float:
        """When the data end by which the heading was chosen, s."""
        return self.start.time + self.alignment

    @cached_property
    def begins(self) -> list[tuple[float, ...]]:
        """The numbers at which searches begin."""
        if self.ranges is not None:
            return [(0.05, 0.02, 0.2, 0.2)]
        return _begins((0.05, 0.02), self.fixes)

    @cached_property
    def start(self) -> Start:
        """The given one, or the most likely of some headings, at the first fix."""
        if self.given is not None:
            return self.given
        first = first_fix(self.fixes)
        place = self.fixes.position[self.fixes.time == first][0, :2]
        far = 3 * deviation_of(self.fixes) + float(np.linalg.norm(self.lever_arm))
        P = np.diag(np.square([far, far, _TURNED, _SCALED, _DRIFTING]))
        starts = [
            Start(first, PlanarState(place, heading), P)
            for heading in np.linspace(-np.pi, np.pi, _HEADINGS, endpoint=False)
        ]
        return max(
            starts,
            key=lambda s: self._run(s, self.begins[0], first + self.alignment).log_likelihood,
        )

    def run(self, *numbers: float, end: float = np.inf, kept: bool = True) -> Solution:
        """Run the filter, which has an event at the time of each fix.

        Parameters
        ----------
        numbers : float
        end, kept
            When the data end, s, and what is kept, as in `run_error_state`.
        """
        return self._run(self.start, numbers, end, kept=kept)

    def told(self, solution: Solution) -> list[Innovations]:
        """Return the innovations of fixes or ranges."""
        return solution.innovations[:1]

    def series(self, solution: Solution) -> Whole:
        """Return of which axis, or anchor, each component of the innovations is."""
        if self.ranges is None:
            return axes_of(self.fixes.time, self.fixes.position, self.start, solution)
        return self.ranges.anchor[self.ranges.time > self.start.time]

    def without(self, withheld: Mask) -> OdometryCorrection:
        """Return the same without some fixes, or the ranges that they are made of."""
        found = replace(self, fixes=_without(self.fixes, withheld))
        if self.ranges is not None:
            # the stamp of a fix is between those of its ranges
            nearest = np.abs(self.ranges.time[:, None] - self.fixes.time).argmin(axis=1)
            found = replace(found, ranges=self.ranges.kept(~withheld[nearest]))
        vars(found).update(start=self.start, begins=self.begins)
        return found

    def _run(
        self, start: Start, numbers: Sequence[float], end: float, *, kept: bool = True
    ) -> Solution:
        assert self.recording.odometry is not None
        speed, rate, white, *others = numbers
        noise = OdometryNoise(speed, rate, *_ODOMETRY_WALKS)
        observed: Any
        if self.ranges is not None:
            [bias] = others
            observed = RangesToAnchors(self.ranges, self.lever_arm, white, bias=bias, scale=_SCALE)
        else:
            two = np.ones(2)
            colours = _colour(others, two)
            sizes = white * shares_of(self.fixes)[:, :2]
            observed = PositionFixes(_planar(self.fixes), self.lever_arm, sizes, *colours)
        # at the time of each fix the filter says where it is, whether it takes it or not
        silent = Fixes(self.fixes.time, np.full((len(self.fixes), 2), np.nan))
        events = PositionFixes(silent, self.lever_arm, np.ones(2))
        motion = OdometryMotion(self.recording.odometry, noise)
        return run_error_state(motion, start, [observed, events], end=end, gate=GATE, kept=kept)


def correction_of(
    recording: Recording, alignment: float, start: Start | None = None
) -> InertialCorrection | OdometryCorrection:
    """Return the filter for the streams that there are.

    Parameters
    ----------
    recording : Recording
        Odometry comes before an IMU, ranges before fixes.
    alignment : float
        s.
    start : Start, optional
        What is known of it, of `known_start`, or for odometry with a `PlanarState`.

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

    def build(side: float) -> InertialCorrection | OdometryCorrection:
        fixes = network_of(recording, side)
        if recording.odometry is not None:
            return OdometryCorrection(recording, fixes, recording.ranges, alignment, start)
        if fixes.position.shape[1] > 2:
            return InertialCorrection(recording, fixes, alignment, start)
        fixes, assumed = with_height(fixes, recording.height or 0.0)
        return InertialCorrection(recording, fixes, alignment, start, True, assumed)

    if recording.ranges is None or not len(recording.ranges) or recording.height is not None:
        return build(0.0)
    found, side = on_a_side(recording.ranges, build, _likelihood)
    return replace(found, assumed=[*found.assumed, *side]) if side else found


def _likelihood(filtered: Correction) -> tuple[float, float]:
    """Return when a filter starts, s, and the logarithm of its likelihood over the first half."""
    half = float(np.mean(filtered.fixes.time[[0, -1]]))
    solution = filtered.run(*filtered.begins[0], end=half, kept=False)
    return filtered.start.time, solution.log_likelihood


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


def network_of(recording: Recording, side: float = 0.0) -> Fixes:
    """Return what the network alone says: fixes as they are, or of ranges, with velocities.

    Parameters
    ----------
    recording : Recording
    side : float
        Of anchors that lie in a plane, as of `multilaterate_track`.

    Raises
    ------
    InswsnError
        If there is no network, or too few ranges at a time.
    """
    if recording.ranges is not None and len(recording.ranges):
        return slope_velocity(fixes_of(recording.ranges, recording.height, side))
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


def axes_of(time: Array, values: Array, start: Start, solution: Solution) -> Whole:
    """Return of which axis each component of the innovations of fixes or velocities is.

    Parameters
    ----------
    time : ndarray, (rows,)
    values : ndarray, (rows, d)
    start : Start
    solution : Solution
    """
    d = len(solution.states[0].position)
    told = np.isfinite(values[:, :d])
    return np.asarray(np.nonzero(told[time > start.time])[1], dtype=np.int64)


def _begins(
    motion: tuple[float, float], fixes: Fixes, speeds: Sequence[float] = ()
) -> list[tuple[float, ...]]:
    """Return the numbers of a filter on fixes with white errors, and with coloured ones, too."""
    size = deviation_of(fixes)
    return [(*motion, size, *speeds), (*motion, size / 2, *speeds, size, _LASTING)]


def _colour(numbers: Sequence[float], axes: Array) -> list[Array]:
    """Return deviations and correlation times by axis of coloured errors, if there are some."""
    if not numbers:
        return []
    size, lasting = numbers
    return [size * axes, np.full(len(axes), lasting)]


def _planar(fixes: Fixes) -> Fixes:
    return Fixes(fixes.time, fixes.position[:, :2])


def _without(fixes: Fixes, withheld: Mask) -> Fixes:
    """Return fixes of which some are NaN; those of which velocities are made are the others."""
    position = np.where(withheld[:, None], np.nan, fixes.position)
    velocity = fixes.velocity
    if velocity is not None:
        velocity = np.where(withheld[:, None], np.nan, velocity)
    return replace(fixes, position=position, velocity=velocity)
