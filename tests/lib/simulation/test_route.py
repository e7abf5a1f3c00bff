"""A planned route: what a driver keeps to, that it is smooth, and what happens at each place."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings as hypothesis_settings, strategies as st

from inswsn_lib.errors import InswsnError, ParameterError
from inswsn_lib.scenario import Setting, load_scenario, with_values
from inswsn_lib.simulation import Piece, Route
from inswsn_lib.simulation.route import Kinematics
from inswsn_lib.simulation.route_planning import plan_route

Settings = dict[str, Setting]

KINDS = [
    *("90-degree turn", "long straight", "stop and start", "two turns"),
    *("straight, curve, straight", "braking and accelerating", "S-curve", "continuous curve"),
]
SEEDS = range(10)
STEP = 0.05  # s, of the samples in these tests
OUTAGE = 40  # s
TURNING = np.radians(0.5)  # rad/s: what counts as a turn


@pytest.fixture(scope="module")
def settings(root: Path) -> Settings:
    return load_scenario(root / "data/scenarios/p3.yaml")


@pytest.fixture(scope="module")
def routes(settings: Settings) -> list[Route]:
    return [plan_route(settings, seed) for seed in SEEDS]


@pytest.fixture(scope="module")
def drives(routes: list[Route]) -> list[Kinematics]:
    return [r.kinematics(STEP * np.arange(round(r.duration / STEP) + 1)) for r in routes]


def during(drive: Kinematics, route: Route, place: int, seconds: float = OUTAGE) -> dict[str, Any]:
    """What the vehicle does in an outage that begins at a place."""
    first = round(route.places[place][1] / STEP)
    window = slice(first, first + round(seconds / STEP) + 1)
    return {
        name: getattr(drive, name)[window]
        for name in ("distance", "speed", "acceleration", "course", "course_rate")
    }


def turns(course_rate: np.ndarray) -> list[tuple[int, int]]:
    """Where the vehicle turns: first and last sample of each turn."""
    padded = np.concatenate([[False], np.abs(course_rate) > TURNING, [False]])
    edges = np.flatnonzero(np.diff(padded.astype(int)))
    return list(zip(edges[::2], edges[1::2] - 1, strict=True))


@hypothesis_settings(max_examples=60)
@given(seed=st.integers(0, 2**32), duration=st.sampled_from([1200, 1357, 1500, 1800]))
def test_any_seed_gives_a_route(settings: Settings, seed: int, duration: int) -> None:
    route = plan_route(with_values(settings, duration=duration), seed)
    names, starts = zip(*route.places, strict=True)
    assert list(names) == KINDS
    assert all(isinstance(start, int) for start in starts)
    assert route.seed == seed
    assert route.duration == pytest.approx(duration, abs=1e-9)
    assert starts[0] >= 90
    assert min(np.diff(starts)) >= 100
    assert starts[-1] + 50 <= duration


def test_pieces_join(routes: list[Route]) -> None:
    for route in routes:
        spans, speeds, accelerations, rates = (np.array(x) for x in zip(*route.pieces, strict=True))
        for pairs in (accelerations, rates):
            assert np.array_equal(pairs[1:, 0], pairs[:-1, 1])  # no jump
            assert pairs[0, 0] == pairs[-1, 1] == 0
        # the trapezoid is the integral of a step that is odd about its middle
        gained = spans * accelerations.mean(axis=1)
        assert speeds[0] == 0
        assert speeds[1:] == pytest.approx((speeds + gained)[:-1], abs=1e-9)
        assert speeds[-1] + gained[-1] == pytest.approx(0, abs=1e-9)
        assert (speeds >= 0).all()


def test_a_route_by_hand() -> None:
    """From 10 m/s, with S = 1/2, S1 = 5/64 and S2 = 1/112 at the middle of a piece of 4 s.

    Acceleration from 1 to -1 m/s^2: 0 at the middle, 2 - 8 * 5/64 m/s gained; the course turns at
    0.2 to 0.4 rad/s: 0.4 + 0.8 * 5/64 rad; ten metres of road rise and fall by 0.02 rad.
    """
    turn = Piece(4.0, 10.0, (1.0, -1.0), (0.2, 0.4))
    waves = np.array([[0.02, 2 * np.pi / 10, np.pi / 2]])
    route = Route((turn, Piece(1.0, 10.0)), course=0.3, waves=waves)
    assert route.duration == 5
    found = route.kinematics([2.0, 4.0, 4.5])
    end = 40 + 8 - 16 * 2 / 7
    assert found.distance == pytest.approx([20 + 2 - 16 * 2 / 112, end, end + 5])
    assert found.speed == pytest.approx([12 - 8 * 5 / 64, 10, 10])
    assert found.acceleration == pytest.approx([0, 0, 0])
    assert found.course == pytest.approx([0.7 + 0.8 * 5 / 64, 1.5, 1.5])
    assert found.course_rate == pytest.approx([0.3, 0, 0])
    assert found.lateral_acceleration == pytest.approx(found.speed * found.course_rate)
    slope = 0.02 * np.cos(2 * np.pi / 10 * found.distance)
    assert found.grade == pytest.approx(slope, abs=1e-12)
    last = Route((turn,)).kinematics([4.0])
    assert [last.acceleration[0], last.course_rate[0], last.grade[0]] == pytest.approx([-1, 0.4, 0])


def test_a_driver_keeps_to_the_limits(drives: list[Kinematics]) -> None:
    for drive in drives:
        assert drive.speed.min() >= 0
        assert drive.speed.max() <= 16 + 1e-9
        assert -2.2 - 1e-9 <= drive.acceleration.min() < -1.3
        assert 1.0 < drive.acceleration.max() <= 1.6 + 1e-9
        assert 1.9 < np.abs(drive.lateral_acceleration).max() <= 2.4 + 1e-9
        # a mean of the jerk is at most the largest
        assert np.abs(np.diff(drive.acceleration)).max() / STEP <= 2 * (1 + 1e-9)
        assert np.abs(np.diff(drive.lateral_acceleration)).max() / STEP <= 1.5 * (1 + 1e-9)
        # curves at constant speed, and none at rest
        assert np.abs(drive.acceleration * drive.course_rate).max() == 0
        assert np.abs(drive.course_rate[drive.speed < 1e-6]).max() == 0
        assert 0.002 < drive.grade.std() < 0.03


def test_standstills_last_as_they_should(drives: list[Kinematics]) -> None:
    for drive in drives:
        still = np.concatenate([[False], drive.speed < 1e-9, [False]])
        edges = np.flatnonzero(np.diff(still.astype(int)))
        lengths = STEP * np.diff(edges)[::2]
        assert lengths[0] == pytest.approx(20, abs=2 * STEP)
        assert len(lengths) >= 4
        # the last is what is left at the end
        assert lengths[1:-1].min() >= 5 - STEP
        assert lengths[1:-1].max() <= 20 + 2 * STEP


@pytest.mark.parametrize("seed", SEEDS)
class TestPlaces:
    @pytest.fixture
    def at(self, seed: int, drives: list[Kinematics], routes: list[Route]) -> Any:
        return lambda kind, seconds=OUTAGE: during(
            drives[seed], routes[seed], KINDS.index(kind), seconds
        )

    def test_90_degree_turn(self, at: Any) -> None:
        drive = at("90-degree turn")
        change = np.degrees(abs(drive["course"][-1] - drive["course"][0]))
        assert 85 <= change <= 95
        ((first, last),) = turns(drive["course_rate"])
        assert abs((first + last) / 2 * STEP - 20) < 2.5
        assert drive["speed"][first] <= 7 + 1e-9

    def test_long_straight(self, at: Any) -> None:
        drive = at("long straight", 50)
        assert np.ptp(drive["course"]) == 0
        assert drive["distance"][-1] - drive["distance"][0] >= 50 * 11

    def test_stop_and_start(self, at: Any) -> None:
        speed = at("stop and start")["speed"]
        still = np.flatnonzero(speed < 1e-9)
        assert speed[0] > 10
        assert len(still) * STEP >= 5 - STEP
        assert speed[-1] > 1
        assert at("stop and start", 50)["speed"][-1] > 10

    def test_two_turns(self, at: Any) -> None:
        drive = at("two turns")
        found = turns(drive["course_rate"])
        assert len(found) == 2
        for first, last in found:
            assert 75 < np.degrees(abs(drive["course"][last] - drive["course"][first])) < 102
        assert found[1][0] - found[0][1] > 1 / STEP

    def test_straight_curve_straight(self, at: Any) -> None:
        drive = at("straight, curve, straight")
        ((first, last),) = turns(drive["course_rate"])
        assert first * STEP >= 8
        assert (len(drive["course"]) - last) * STEP >= 3
        assert 39 < np.degrees(np.ptp(drive["course"])) < 71
        assert np.ptp(drive["speed"]) == 0

    def test_braking_and_accelerating(self, at: Any) -> None:
        drive = at("braking and accelerating")
        assert np.ptp(drive["course"]) == 0
        assert drive["speed"].min() < 0.55 * drive["speed"][0]
        assert drive["acceleration"].min() < -1
        assert drive["acceleration"].max() > 0.9
        assert drive["speed"].min() > 0

    def test_s_curve(self, at: Any) -> None:
        drive = at("S-curve")
        (a, b), (c, d) = turns(drive["course_rate"])
        signs = np.sign(drive["course_rate"])
        assert (signs[a : b + 1] == signs[a]).all()
        assert (signs[c : d + 1] == -signs[a]).all()
        for first, last in ((a, b), (c, d)):
            assert np.degrees(abs(drive["course"][last] - drive["course"][first])) > 25
        assert (c - b) * STEP < 3

    def test_continuous_curve(self, at: Any) -> None:
        drive = at("continuous curve", 50)
        rate = drive["course_rate"][1:]  # it begins at the start of the place
        assert (np.sign(rate) == np.sign(rate[-1])).all()
        assert np.degrees(np.ptp(at("continuous curve")["course"])) > 45
        assert np.ptp(rate[round(3 / STEP) :]) > 0  # no circle


def test_times_outside_are_refused(routes: list[Route]) -> None:
    for time in (-0.1, 1500.1, np.nan):
        with pytest.raises(ParameterError, match=r"^time must be between 0 and 1500 s, not .*\.$"):
            routes[0].kinematics([time])


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"duration": 600.0}, "duration must be a number between 1200 and 1800, not 600.0."),
        ({"duration": 1500.5}, "duration must be a whole number of seconds, not 1500.5."),
        ({"standstill": [9.0, 8.0]}, "standstill must be"),
        (
            {"jerk": 0.5, "deceleration": [0.5, 0.5], "cruise_speed": [25, 25]},
            "With these settings of the route a manoeuvre takes too long",
        ),
    ],
)
def test_what_may_not_be(settings: Settings, changes: dict[str, Any], said: str) -> None:
    with pytest.raises(InswsnError) as refused:
        plan_route(with_values(settings, **changes))
    assert str(refused.value).startswith(said)


#: Of two routes: how many pieces, their durations (s), each times its number, the length (m), the
#: course at the start (rad), and where the places begin (s). They hold the draws to their order,
#: on which every simulation rests.
KNOWN = {
    0: (427, 323454.67, 14401.321, 0.860556, [113, 286, 476, 668, 848, 1023, 1220, 1404]),
    7: (447, 331894.548, 15590.113, 0.785998, [107, 290, 482, 658, 855, 1030, 1215, 1400]),
}


@pytest.mark.parametrize("seed", KNOWN)
def test_routes_are_what_they_were(settings: Settings, seed: int) -> None:
    route = plan_route(settings, seed)
    length = float(route.kinematics([route.duration]).distance[0])
    starts = [place.start for place in route.places]
    count = len(route.pieces)
    spread = sum(i * piece.duration for i, piece in enumerate(route.pieces))
    found = count, round(spread, 3), round(length, 3), round(route.course, 6), starts
    assert found == KNOWN[seed]
