r"""A route on roads: straights, curves, turns, stops and starts, and eight places for outages.

A route is a sequence of pieces in time. Along a piece the acceleration along the road :math:`a` and
the rate of the course :math:`\omega` go from one value to another by the step

.. math::
    S(u) = 6 u^5 - 15 u^4 + 10 u^3, \qquad 0 \le u \le 1,

whose first two derivatives vanish at both ends, so that both are twice continuously differentiable
all along the drive. Curves are driven at constant speed :math:`v`: brake, turn, accelerate. So the
curvature :math:`\omega / v` is as smooth, and grows from a straight into an arc as on a clothoid,
but without its corners. Speed, course and distance are the exact integrals.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

from inswsn_lib.checks import whole
from inswsn_lib.errors import InswsnError, ParameterError
from inswsn_lib.scenario import Range, Setting, between, from_settings

Array = NDArray[np.float64]

_FIRST, _LAST = 110, 100  # s: the first place after the start, the last before the end
_JITTER, _APART = 8, 100  # s: of a place's start; between the starts of two places
_LENGTH = 52  # s: so that outages of 50 s, and a window's rounding, stay within a place
_TURN_MIDDLE = 20.0  # s after the start of a 90-degree turn's place
_BEND_RAMP = 3.0  # s from one curvature to the next of a continuous curve
_STEEPEST = 1.875  # the largest slope of the step S
_SHORTEST = 0.8  # s: of a flank; the springs of a car follow nothing that is quicker
_WAVES = 5
_ROUNDING = 1e-9  # s


@dataclass(frozen=True)
class RouteLimits:
    """What a driver keeps to; a pair is a range to draw from.

    Attributes
    ----------
    duration : float
        Of the drive, whole seconds.
    standstill_at_start : float
        s.
    standstill : tuple of two floats
        s.
    cruise_speed, turn_speed : tuple of two floats
        m/s; the latter in 90-degree turns.
    acceleration, deceleration : tuple of two floats
        The largest of a change of speed, m/s^2.
    jerk : float
        Along the road, m/s^3.
    turn_lateral, curve_lateral, bend_lateral : tuple of two floats
        Lateral acceleration in 90-degree turns, in curves, and on a road that goes on curving,
        m/s^2.
    lateral_jerk : float
        Where turns and curves begin and end, m/s^3.
    grade : float
        Root mean square of the slope of the road, rad.
    grade_wavelength : tuple of two floats
        Of the slope, m.
    """

    duration: float = between(1200, 1800)
    standstill_at_start: float = between(0, 60)
    standstill: Range = between(1, 30)
    cruise_speed: Range = between(8, 25)
    turn_speed: Range = between(2, 8)
    acceleration: Range = between(0.5, 4)
    deceleration: Range = between(0.5, 4)
    jerk: float = between(0.5, 10)
    turn_lateral: Range = between(0.5, 4)
    curve_lateral: Range = between(0.5, 4)
    bend_lateral: Range = between(0.1, 2)
    lateral_jerk: float = between(0.5, 10)
    grade: float = between(0, 0.1)
    grade_wavelength: Range = between(100, 10_000)


@dataclass(frozen=True, eq=False)
class Kinematics:
    """The motion along a route, sampled.

    Attributes
    ----------
    time : ndarray, (steps,)
        s, from 0.
    distance : ndarray, (steps,)
        Along the road, m.
    speed, acceleration : ndarray, (steps,)
        Along the road, m/s and m/s^2.
    course : ndarray, (steps,)
        The direction of the velocity, rad, clockwise from north, continuous.
    course_rate : ndarray, (steps,)
        rad/s, positive to the right.
    grade : ndarray, (steps,)
        The slope of the road, rad, positive uphill.
    """

    time: Array
    distance: Array
    speed: Array
    acceleration: Array
    course: Array
    course_rate: Array
    grade: Array

    @property
    def lateral_acceleration(self) -> Array:
        r""":math:`v\,\omega`, which is :math:`v^2` times the curvature; to the right, m/s^2."""
        return self.speed * self.course_rate


@dataclass(frozen=True, eq=False)
class Route:
    """A planned route.

    Attributes
    ----------
    durations : ndarray, (pieces,)
        s.
    accelerations : ndarray, (pieces, 2)
        Along the road at the beginning and the end of each piece, m/s^2.
    course_rates : ndarray, (pieces, 2)
        At the beginning and the end of each piece, rad/s, positive to the right.
    speeds : ndarray, (pieces,)
        At the beginning of each piece, m/s.
    course : float
        At the start, rad, clockwise from north.
    waves : ndarray, (waves, 3)
        Amplitude (rad), wavenumber (rad/m) and phase (rad) of the sines of the distance whose sum
        is the slope of the road.
    places : tuple of tuples of str and int
        The name of each place and the second at which it starts.
    """

    durations: Array
    accelerations: Array
    course_rates: Array
    speeds: Array
    course: float
    waves: Array
    places: tuple[tuple[str, int], ...]

    @property
    def duration(self) -> float:
        """Of the whole drive, s."""
        return float(self.durations.sum())

    @cached_property
    def _starts(self) -> tuple[Array, Array, Array]:
        """Time (s), distance (m) and course (rad) at the beginning of each piece."""
        span = self.durations
        (a, b), (p, q) = self.accelerations.T, self.course_rates.T
        length = self.speeds * span + span**2 * (a / 2 + (b - a) / 7)
        angle = span * (p + q) / 2
        sums = [np.concatenate([[0.0], np.cumsum(x)[:-1]]) for x in (span, length, angle)]
        return sums[0], sums[1], self.course + sums[2]

    def kinematics(self, time: ArrayLike) -> Kinematics:
        r"""Return the motion at some times.

        With :math:`u` the share of a piece of duration T that has passed, and
        :math:`S_1, S_2` the first two integrals of the step S,

        .. math::
            a = a_0 + (a_1 - a_0) S(u), \quad
            v = v_0 + T (a_0 u + (a_1 - a_0) S_1(u)), \quad
            s = s_0 + v_0 T u + T^2 (a_0 u^2 / 2 + (a_1 - a_0) S_2(u)),

        and the same for the rate of the course and the course.

        Parameters
        ----------
        time : array_like, (steps,)
            s since the start.

        Raises
        ------
        ParameterError
            If a time is before the start or after the end.
        """
        t = np.asarray(time, dtype=float)
        if not ((t >= 0) & (t <= self.duration + _ROUNDING)).all():
            raise ParameterError("time", "outside the drive", f"from 0 to {self.duration:g} s")
        starts, distances, courses = self._starts
        piece = np.searchsorted(starts, t, side="right") - 1
        span = self.durations[piece]
        u = np.clip((t - starts[piece]) / span, 0.0, 1.0)
        S = u**3 * (10 + u * (6 * u - 15))
        S1 = u**4 * (2.5 + u * (u - 3))
        S2 = u**5 * (0.5 + u * (u / 7 - 0.5))
        a, da = self.accelerations[piece, 0], np.diff(self.accelerations)[piece, 0]
        w, dw = self.course_rates[piece, 0], np.diff(self.course_rates)[piece, 0]
        v = self.speeds[piece]
        distance = distances[piece] + v * span * u + span**2 * (a * u**2 / 2 + da * S2)
        amplitude, wavenumber, phase = self.waves.T[:, :, None]
        return Kinematics(
            time=t,
            distance=distance,
            speed=np.maximum(v + span * (a * u + da * S1), 0.0),  # no rounding below rest
            acceleration=a + da * S,
            course=courses[piece] + span * (w * u + dw * S1),
            course_rate=w + dw * S,
            grade=(amplitude * np.sin(wavenumber * distance + phase)).sum(axis=0),
        )


def plan_route(settings: Mapping[str, Setting], route: int = 0) -> Route:
    """Plan a route with eight places, in P3's order of kinds.

    Each place starts at a whole second, 90 s or more after the start of the drive and 100 s or more
    after the start of the place before it, and keeps to its kind for 50 s. Routes differ in
    lengths, angles, directions, speeds, slopes and the course at the start, not in their duration.

    Parameters
    ----------
    settings : mapping of str to Setting
        From `load_scenario`; those of `RouteLimits`.
    route : int
        The seed.

    Raises
    ------
    InswsnError
        If a setting is missing, or what is to happen at a place takes too long.
    ParameterError
        If a setting or the seed may not be what it is.
    """
    limits = from_settings(RouteLimits, settings)
    if limits.duration != int(limits.duration):
        raise ParameterError("duration", limits.duration, "whole seconds")
    if limits.turn_speed[1] > limits.cruise_speed[0]:
        raise ParameterError(
            "turn_speed", limits.turn_speed, f"at most {limits.cruise_speed[0]:g}, as in a cruise"
        )
    rng = np.random.default_rng(whole("route", route, 0))
    course, waves = rng.uniform(-np.pi, np.pi), _waves(limits, rng)
    planner = _Planner(limits, rng)
    planner.hold(limits.standstill_at_start)
    places = tuple(zip(_PLACES, _place_starts(int(limits.duration), rng), strict=True))
    for name, start in places:
        _fill(planner, start, planner.draw(limits.cruise_speed))
        _PLACES[name](planner)
        if planner.clock < start + _LENGTH:
            planner.hold_until(start + _LENGTH)
    _fill(planner, int(limits.duration), 0.0)
    columns = np.array(planner.pieces)
    return Route(
        durations=columns[:, 0],
        accelerations=columns[:, 1:3],
        course_rates=columns[:, 3:5],
        speeds=columns[:, 5],
        course=float(course),
        waves=waves,
        places=places,
    )


class _Planner:
    """Puts pieces of a drive one after the other.

    Parameters
    ----------
    limits : RouteLimits
    rng : numpy.random.Generator
    speed : float
        At the start, m/s.
    clock : float
        At the start, s.
    """

    def __init__(
        self,
        limits: RouteLimits,
        rng: np.random.Generator,
        speed: float = 0.0,
        clock: float = 0.0,
    ) -> None:
        self.limits, self.rng, self.speed, self.clock = limits, rng, speed, clock
        # duration, acceleration from and to, rate of the course from and to, speed
        self.pieces: list[tuple[float, float, float, float, float, float]] = []

    def draw(self, between: Range) -> float:
        """Draw a number evenly."""
        return float(self.rng.uniform(*between))

    def side(self) -> float:
        """Draw right (1) or left (-1)."""
        return float(self.rng.choice([-1.0, 1.0]))

    def trial(self) -> _Planner:
        """Return a planner that goes on from here, whose pieces can be joined or left."""
        return _Planner(self.limits, self.rng, self.speed, self.clock)

    def join(self, other: _Planner) -> None:
        """Add the pieces of a trial, wherever it began."""
        self.pieces += other.pieces
        self.clock += sum(piece[0] for piece in other.pieces)
        self.speed = other.speed

    def hold(self, seconds: float) -> None:
        """Go straight on at the present speed, or stand."""
        self._add(seconds, (0.0, 0.0), (0.0, 0.0))

    def hold_until(self, time: float) -> None:
        """Go straight on until a time; refuse a time that has passed."""
        if self.clock > time + _ROUNDING:
            raise InswsnError(
                "With these settings of the route a manoeuvre takes too long:"
                f" it should be over after {time:.1f} s and is after {self.clock:.1f} s."
            )
        self.hold(max(time - self.clock, 0.0))

    def change_speed(self, to: float, gently: bool = False) -> None:
        """Brake or accelerate, within the limits of acceleration and jerk, or at the least."""
        change = to - self.speed
        between = self.limits.acceleration if change > 0 else self.limits.deceleration
        most = between[0] if gently else self.draw(between)
        size, ramp, plateau = _pulse(abs(change), most, self.limits.jerk)
        a = float(np.copysign(size, change))
        for span, pair in ((ramp, (0.0, a)), (plateau, (a, a)), (ramp, (a, 0.0))):
            self._add(span, pair, (0.0, 0.0))
        self.speed = to  # without the rounding of the sums

    def turn(self, angle: float, lateral: float) -> None:
        """Turn at the present speed by an angle (rad, to the right) at a lateral acceleration."""
        jerk = self.limits.lateral_jerk / self.speed
        size, ramp, plateau = _pulse(abs(angle), lateral / self.speed, jerk)
        w = float(np.copysign(size, angle))
        for span, pair in ((ramp, (0.0, w)), (plateau, (w, w)), (ramp, (w, 0.0))):
            self._add(span, (0.0, 0.0), pair)

    def bend(self, rates: list[float], seconds: list[float]) -> None:
        """Go through rates of the course, one after the other, each for some seconds."""
        for before, rate, span in zip([0.0, *rates], [*rates, 0.0], [*seconds, 0.0], strict=True):
            self._add(_BEND_RAMP, (0.0, 0.0), (before, rate))
            self._add(span, (0.0, 0.0), (rate, rate))

    def _add(self, span: float, accelerations: Range, rates: Range) -> None:
        if span > 0:
            self.pieces.append((span, *accelerations, *rates, self.speed))
            self.clock += span
            self.speed += span * sum(accelerations) / 2


def _pulse(total: float, most: float, steepest: float) -> tuple[float, float, float]:
    """Return height, ramp and plateau of a pulse with smooth flanks of a given integral.

    The height is `most`, or less where the integral is too small to reach it with flanks that are
    not steeper than `steepest`, nor shorter than a car can follow.
    """
    if total == 0.0:
        return 0.0, 0.0, 0.0
    height = min(most, float(np.sqrt(total * steepest / _STEEPEST)))
    ramp = max(_STEEPEST * height / steepest, _SHORTEST)
    height = min(height, total / ramp)
    return height, ramp, max(total / height - ramp, 0.0)


def _square_turn(planner: _Planner) -> None:
    """Brake, turn by about 90 degrees, accelerate: the turn lies in the middle of an outage."""
    limits, cruise = planner.limits, planner.speed
    middle = planner.clock + _TURN_MIDDLE + planner.draw((-2, 2))
    trial = planner.trial()
    trial.change_speed(trial.draw(limits.turn_speed))
    braked = trial.clock
    trial.turn(trial.side() * np.radians(trial.draw((86, 94))), trial.draw(limits.turn_lateral))
    planner.hold_until(middle - (trial.clock + braked) / 2 + planner.clock)
    planner.join(trial)
    planner.change_speed(cruise)


def _long_straight(planner: _Planner) -> None:
    """Go straight on, a little faster and slower."""
    (least, most), cruise = planner.limits.cruise_speed, planner.speed
    for _ in range(2):
        planner.hold(planner.draw((8, 14)))
        planner.change_speed(planner.draw((max(cruise - 1.5, least), min(cruise + 1.5, most))))


def _stop_and_start(planner: _Planner) -> None:
    """Brake to a standstill, stand, and start again within an outage."""
    cruise, start = planner.speed, planner.clock
    planner.hold(planner.draw((3, 6)))
    planner.change_speed(0.0)
    planner.hold(min(planner.draw(planner.limits.standstill), max(start + 32 - planner.clock, 5)))
    planner.change_speed(cruise)


def _two_turns(planner: _Planner) -> None:
    """Take two turns of about 90 degrees one after the other."""
    limits, cruise = planner.limits, planner.speed
    planner.hold(planner.draw((2, 4)))
    planner.change_speed(planner.draw(limits.turn_speed))
    for k in range(2):
        if k:
            planner.hold(planner.draw((3, 5)))
        angle = planner.side() * np.radians(planner.draw((80, 100)))
        planner.turn(angle, planner.draw(limits.turn_lateral))
    planner.change_speed(cruise)


def _straight_curve_straight(planner: _Planner) -> None:
    """Go straight, through one curve, and straight again."""
    planner.hold(planner.draw((9, 13)))
    planner.turn(
        planner.side() * np.radians(planner.draw((40, 70))),
        planner.draw(planner.limits.curve_lateral),
    )


def _braking_and_accelerating(planner: _Planner) -> None:
    """Brake and accelerate twice on a straight."""
    cruise = planner.speed
    for _ in range(2):
        planner.hold(planner.draw((3, 5)))
        planner.change_speed(cruise * planner.draw((0.35, 0.5)))
        planner.hold(planner.draw((1, 3)))
        planner.change_speed(cruise)


def _s_curve(planner: _Planner) -> None:
    """Take a curve to one side and at once one to the other."""
    planner.hold(planner.draw((3, 6)))
    side = planner.side()
    for direction in (side, -side):
        angle = direction * np.radians(planner.draw((30, 50)))
        planner.turn(angle, planner.draw(planner.limits.curve_lateral))
        planner.hold(planner.draw((0, 1)))


def _continuous_curve(planner: _Planner) -> None:
    """Follow a road that curves to one side for as long as the place lasts, now more, now less."""
    side, left = planner.side() / planner.speed, _LENGTH - _BEND_RAMP
    rates, seconds = [], []
    while left > 0:
        rates.append(side * planner.draw(planner.limits.bend_lateral))
        seconds.append(planner.draw((4, 9)))
        left -= seconds[-1] + _BEND_RAMP
    planner.bend(rates, seconds)


_PLACES: dict[str, Callable[[_Planner], None]] = {
    "90-degree turn": _square_turn,
    "long straight": _long_straight,
    "stop and start": _stop_and_start,
    "two turns": _two_turns,
    "straight, curve, straight": _straight_curve_straight,
    "braking and accelerating": _braking_and_accelerating,
    "S-curve": _s_curve,
    "continuous curve": _continuous_curve,
}


def _crossing(planner: _Planner) -> None:
    limits = planner.limits
    planner.change_speed(planner.draw(limits.turn_speed))
    angle = planner.side() * np.radians(planner.draw((75, 105)))
    planner.turn(angle, planner.draw(limits.turn_lateral))
    planner.change_speed(planner.draw(limits.cruise_speed))


def _curve(planner: _Planner) -> None:
    angle = planner.side() * np.radians(planner.draw((15, 60)))
    planner.turn(angle, planner.draw(planner.limits.curve_lateral))


def _red_light(planner: _Planner) -> None:
    planner.change_speed(0.0)
    planner.hold(planner.draw(planner.limits.standstill))
    planner.change_speed(planner.draw(planner.limits.cruise_speed))


def _other_speed(planner: _Planner) -> None:
    planner.change_speed(planner.draw(planner.limits.cruise_speed))


_BETWEEN = (_crossing, _crossing, _curve, _curve, _red_light, _other_speed)


def _fill(planner: _Planner, until: int, speed: float) -> None:
    """Drive on until a time and reach it at a speed, with what fits at random in between."""
    if planner.speed == 0.0:
        planner.change_speed(planner.draw(planner.limits.cruise_speed))
    fits = True
    while fits:
        before = planner.clock
        for k in planner.rng.permutation(len(_BETWEEN)):
            trial = planner.trial()
            trial.hold(trial.draw((2, 8)))
            _BETWEEN[k](trial)
            reached = trial.trial()
            reached.change_speed(speed, gently=True)  # so that what is drawn later is in time
            if reached.clock <= until:
                planner.join(trial)
                break
        fits = planner.clock > before
    planner.change_speed(speed)
    planner.hold_until(until)


def _place_starts(duration: int, rng: np.random.Generator) -> list[int]:
    """Draw the second at which each place starts."""
    slot = (duration - _FIRST - _LAST) / (len(_PLACES) - 1)
    jitter = int(min(_JITTER, (slot - _APART) // 2))
    moved = rng.integers(-jitter, jitter + 1, len(_PLACES))
    return [_FIRST + int(k * slot) + int(moved[k]) for k in range(len(_PLACES))]


def _waves(limits: RouteLimits, rng: np.random.Generator) -> Array:
    """Draw the waves of the road: amplitude (rad), wavenumber (rad/m) and phase (rad)."""
    wavelength = rng.uniform(*limits.grade_wavelength, _WAVES)
    amplitude = np.full(_WAVES, limits.grade * np.sqrt(2 / _WAVES))
    return np.stack([amplitude, 2 * np.pi / wavelength, rng.uniform(-np.pi, np.pi, _WAVES)], axis=1)
