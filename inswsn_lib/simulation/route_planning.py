"""Planning a route with a seed: eight places for outages, of P3's kinds, and roads between them."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from inswsn_lib.checks import Array, whole
from inswsn_lib.errors import InswsnError, ParameterError
from inswsn_lib.scenario import Range, Setting, between, from_settings
from inswsn_lib.simulation.drive import Place
from inswsn_lib.simulation.route import NONE, ROUNDING, Piece, Route

_FIRST, _LAST = 110, 100  # s: the first place after the start, the last before the end
_JITTER, _APART = 8, 100  # s: of a place's start; between the starts of two places
_LENGTH = 52  # s: so that outages of 50 s, and a window's rounding, stay within a place
_TURN_MIDDLE = 20.0  # s after the start of a 90-degree turn's place
_BEND_RAMP = 3.0  # s from one curvature to the next of a continuous curve
_STEEPEST = 1.875  # the largest slope of the step S of a route
_SHORTEST = 0.8  # s: of a flank; the springs of a car follow nothing that is quicker
_WAVES = 5


@dataclass(frozen=True)
class RouteLimits:
    """The limits of a driver, from the settings of these names; a pair is a range to draw from."""

    duration: float = between(1200, 1800)  # whole seconds
    standstill_at_start: float = between(0, 60)  # s
    standstill: Range = between(1, 30)  # s
    cruise_speed: Range = between(8, 25)  # m/s
    turn_speed: Range = between(2, 8)  # m/s, in 90-degree turns
    acceleration: Range = between(0.5, 4)  # m/s^2, the largest of a change of speed
    deceleration: Range = between(0.5, 4)
    jerk: float = between(0.5, 10)  # m/s^3, along the road
    turn_lateral: Range = between(0.5, 4)  # m/s^2, the lateral acceleration in 90-degree turns,
    curve_lateral: Range = between(0.5, 4)  # in curves,
    bend_lateral: Range = between(0.1, 2)  # and on a road that goes on curving
    lateral_jerk: float = between(0.5, 10)  # m/s^3, where turns and curves begin and end
    grade: float = between(0, 0.1)  # rad, root mean square of the slope of the road
    grade_wavelength: Range = between(100, 10_000)  # m


def plan_route(settings: Mapping[str, Setting], route: int = 0) -> Route:
    """Plan a route with eight places, in P3's order of kinds, with a seed.

    Each place starts at a whole second, 90 s or more after the start of the drive and 100 s or more
    after the start of the place before it, and keeps to its kind for 50 s. Routes differ in
    lengths, angles, directions, speeds, slopes and the course at the start, not in their duration.
    """
    limits = from_settings(RouteLimits, settings)
    if limits.duration != int(limits.duration):
        raise ParameterError("duration", limits.duration, "a whole number of seconds")
    rng = np.random.default_rng(whole("route", route))
    course, waves = float(rng.uniform(-np.pi, np.pi)), _waves(limits, rng)
    driver = _Driver(limits, rng)
    driver.go(limits.standstill_at_start)
    places = tuple(map(Place, _PLACES, _place_starts(int(limits.duration), rng)))
    for place in places:
        _fill(driver, place.start, driver.draw(*limits.cruise_speed))
        _PLACES[place.name](driver)
        if driver.clock < place.start + _LENGTH:
            driver.go_until(place.start + _LENGTH)
    _fill(driver, int(limits.duration), 0.0)
    return Route(tuple(driver.pieces), course, places, waves, route)


class _Driver:
    """Drives pieces one after the other, from a speed (m/s) and a time (s) on."""

    def __init__(
        self, limits: RouteLimits, rng: np.random.Generator, speed: float = 0.0, clock: float = 0.0
    ) -> None:
        self.limits, self.rng, self.speed, self.clock = limits, rng, speed, clock
        self.pieces: list[Piece] = []

    def draw(self, low: float, high: float) -> float:
        """Draw a number evenly."""
        return float(self.rng.uniform(low, high))

    def side(self) -> float:
        """Draw right (1) or left (-1)."""
        return float(self.rng.choice([-1.0, 1.0]))

    def trial(self) -> _Driver:
        """Return a driver that goes on from here, whose pieces can be joined or left."""
        return _Driver(self.limits, self.rng, self.speed, self.clock)

    def join(self, other: _Driver) -> None:
        """Add the pieces of a trial, wherever it began."""
        self.pieces += other.pieces
        self.clock += sum(piece.duration for piece in other.pieces)
        self.speed = other.speed

    def go(self, seconds: float, acceleration: Range = NONE, course_rate: Range = NONE) -> None:
        """Go straight on at the present speed, or stand, or as is told."""
        if seconds > 0:
            self.pieces.append(Piece(seconds, self.speed, acceleration, course_rate))
            self.clock += seconds
            self.speed += seconds * sum(acceleration) / 2

    def go_until(self, time: float) -> None:
        """Go straight on until a time; refuse a time that has passed."""
        if self.clock > time + ROUNDING:
            raise InswsnError(
                "With these settings of the route a manoeuvre takes too long:"
                f" it should be over after {time:.1f} s and is after {self.clock:.1f} s."
            )
        self.go(time - self.clock)

    def reach(self, speed: float, gently: bool = False) -> None:
        """Brake or accelerate, within the limits of acceleration and jerk, or at the least."""
        change = speed - self.speed
        most = self.limits.acceleration if change > 0 else self.limits.deceleration
        strength = most[0] if gently else self.draw(*most)
        for seconds, acceleration in _pulse(change, strength, self.limits.jerk):
            self.go(seconds, acceleration)
        self.speed = speed  # without the rounding of the sums

    def turn(self, degrees: Range, lateral: Range, side: float | None = None) -> None:
        """Turn at the present speed by an angle and a lateral acceleration that are drawn."""
        angle = (self.side() if side is None else side) * np.radians(self.draw(*degrees))
        strength, steepest = self.draw(*lateral) / self.speed, self.limits.lateral_jerk / self.speed
        for seconds, rate in _pulse(angle, strength, steepest):
            self.go(seconds, course_rate=rate)


def _pulse(total: float, most: float, steepest: float) -> list[tuple[float, Range]]:
    """Return the flanks and the plateau of a pulse with a given integral: seconds, and from to.

    The height is `most`, or less where the integral is too small to reach it with flanks that are
    not steeper than `steepest`, nor shorter than a car can follow.
    """
    size = abs(total)
    if size == 0.0:
        return []
    height = min(most, float(np.sqrt(size * steepest / _STEEPEST)))
    ramp = max(_STEEPEST * height / steepest, _SHORTEST)
    height = min(height, size / ramp)
    plateau = size / height - ramp
    top = float(np.copysign(height, total))
    return [(ramp, (0.0, top)), (plateau, (top, top)), (ramp, (top, 0.0))]


def _square_turn(driver: _Driver) -> None:
    """Brake, turn by about 90 degrees, accelerate: the turn lies in the middle of an outage."""
    cruise, middle = driver.speed, driver.clock + _TURN_MIDDLE + driver.draw(-2, 2)
    trial = driver.trial()
    trial.reach(trial.draw(*driver.limits.turn_speed))
    braked = trial.clock
    trial.turn((86, 94), driver.limits.turn_lateral)
    driver.go_until(middle - (trial.clock + braked) / 2 + driver.clock)
    driver.join(trial)
    driver.reach(cruise)


def _long_straight(driver: _Driver) -> None:
    """Go straight on, a little faster and slower."""
    (least, most), cruise = driver.limits.cruise_speed, driver.speed
    for _ in range(2):
        driver.go(driver.draw(8, 14))
        driver.reach(driver.draw(max(cruise - 1.5, least), min(cruise + 1.5, most)))


def _stop_and_start(driver: _Driver) -> None:
    """Brake to a standstill, stand, and start again within an outage."""
    cruise, start = driver.speed, driver.clock
    driver.go(driver.draw(3, 6))
    driver.reach(0.0)
    driver.go(min(driver.draw(*driver.limits.standstill), max(start + 32 - driver.clock, 5)))
    driver.reach(cruise)


def _two_turns(driver: _Driver) -> None:
    """Take two turns of about 90 degrees one after the other."""
    cruise = driver.speed
    driver.go(driver.draw(2, 4))
    driver.reach(driver.draw(*driver.limits.turn_speed))
    driver.turn((80, 100), driver.limits.turn_lateral)
    driver.go(driver.draw(3, 5))
    driver.turn((80, 100), driver.limits.turn_lateral)
    driver.reach(cruise)


def _straight_curve_straight(driver: _Driver) -> None:
    """Go straight, through one curve, and straight again."""
    driver.go(driver.draw(9, 13))
    driver.turn((40, 70), driver.limits.curve_lateral)


def _braking_and_accelerating(driver: _Driver) -> None:
    """Brake and accelerate twice on a straight."""
    cruise = driver.speed
    for _ in range(2):
        driver.go(driver.draw(3, 5))
        driver.reach(cruise * driver.draw(0.35, 0.5))
        driver.go(driver.draw(1, 3))
        driver.reach(cruise)


def _s_curve(driver: _Driver) -> None:
    """Take a curve to one side and at once one to the other."""
    driver.go(driver.draw(3, 6))
    side = driver.side()
    for each in (side, -side):
        driver.turn((30, 50), driver.limits.curve_lateral, each)
        driver.go(driver.draw(0, 1))


def _continuous_curve(driver: _Driver) -> None:
    """Follow a road that curves to one side for as long as the place lasts, now more, now less."""
    side, left = driver.side() / driver.speed, _LENGTH - _BEND_RAMP
    last = 0.0
    while left > 0:
        rate = side * driver.draw(*driver.limits.bend_lateral)
        seconds = driver.draw(4, 9)
        driver.go(_BEND_RAMP, course_rate=(last, rate))
        driver.go(seconds, course_rate=(rate, rate))
        last, left = rate, left - (seconds + _BEND_RAMP)
    driver.go(_BEND_RAMP, course_rate=(last, 0.0))


_PLACES: dict[str, Callable[[_Driver], None]] = {
    "90-degree turn": _square_turn,
    "long straight": _long_straight,
    "stop and start": _stop_and_start,
    "two turns": _two_turns,
    "straight, curve, straight": _straight_curve_straight,
    "braking and accelerating": _braking_and_accelerating,
    "S-curve": _s_curve,
    "continuous curve": _continuous_curve,
}


def _crossing(driver: _Driver) -> None:
    driver.reach(driver.draw(*driver.limits.turn_speed))
    driver.turn((75, 105), driver.limits.turn_lateral)
    _other_speed(driver)


def _curve(driver: _Driver) -> None:
    driver.turn((15, 60), driver.limits.curve_lateral)


def _red_light(driver: _Driver) -> None:
    driver.reach(0.0)
    driver.go(driver.draw(*driver.limits.standstill))
    _other_speed(driver)


def _other_speed(driver: _Driver) -> None:
    driver.reach(driver.draw(*driver.limits.cruise_speed))


_BETWEEN = (_crossing, _crossing, _curve, _curve, _red_light, _other_speed)


def _fill(driver: _Driver, until: int, speed: float) -> None:
    """Drive on until a time and reach it at a speed, with what fits at random in between."""
    if driver.speed == 0.0:
        _other_speed(driver)
    fits = True
    while fits:
        before = driver.clock
        for k in driver.rng.permutation(len(_BETWEEN)):
            trial = driver.trial()
            trial.go(trial.draw(2, 8))
            _BETWEEN[k](trial)
            reached = trial.trial()
            reached.reach(speed, gently=True)  # so that what is drawn later is in time
            if reached.clock <= until:
                driver.join(trial)
                break
        fits = driver.clock > before
    driver.reach(speed)
    driver.go_until(until)


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
