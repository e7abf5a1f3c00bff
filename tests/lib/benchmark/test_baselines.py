"""The baselines, on motions whose answer is known."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from lib.inertial.made import LEVER_ARM, Path, imu_of
from made_recording import made_drive

from inswsn_lib.benchmark import TRACKS, Answer, Course, Event, Task
from inswsn_lib.benchmark.baselines import (
    DeadReckoning,
    GoOn,
    LooselyCoupled,
    Network,
    PlanarFilter,
    StandStill,
)
from inswsn_lib.benchmark.courses import make_course
from inswsn_lib.benchmark.scoring import Errors, errors_of

NUMBERS = {"force": 0.02, "rate": 0.002, "white": 0.02, "coloured": 0.02, "time": 3.0}
PLANAR = {"speed": 0.05, "rate": 0.02, "white": 0.1, "scale": 0.01}
SQUARE = np.array([[0.0, 0.0], [9.0, 0.0], [0.0, 9.0], [9.0, 9.0]])
Entry = type[Network] | type[LooselyCoupled] | type[PlanarFilter]


def run(kind: Entry, task: Task, events: list[Event]) -> list[Answer | None]:
    entry = kind(task)
    answers = [(event.kind, entry.step(event)) for event in events]
    assert all(answer is None for what, answer in answers if what != "ask")
    return [answer for what, answer in answers if what == "ask"]


def straight(sources: int = 1) -> list[Event]:
    """Fixes of a tag at (t, 2 t), of all sources, until 10 s; questions until 15 s."""
    fixes = [
        Event(float(t), "fix", np.array([t, 2 * t, 0.1, 0.1]), source)
        for t in range(11)
        for source in range(sources)
    ]
    asked = [Event(t + 0.5, "ask", np.zeros(0)) for t in range(15)]
    return sorted(fixes + asked, key=lambda event: event.time)


@pytest.mark.parametrize("sources", [1, 2])
def test_the_network_its_last_fix_and_its_slope(sources: int) -> None:
    task = Task(("fix",), 2, 1.0, sources=sources)
    last = {}
    for kind in (Network, StandStill, GoOn):
        found = run(kind, task, straight(sources))[-1]
        assert found is not None
        last[kind] = np.concatenate([found.position, np.asarray(found.velocity)])
    np.testing.assert_allclose(last[Network], [10, 20, 1, 2], atol=1e-9)
    np.testing.assert_allclose(last[StandStill], [10, 20, 0, 0], atol=1e-9)
    np.testing.assert_allclose(last[GoOn], [14.5, 29, 1, 2], atol=1e-9)


def test_the_network_makes_fixes_of_ranges_and_none_of_old_ones() -> None:
    """A tag at (2, 3), heard by four anchors in each of two seconds, then by none."""
    task = Task(("range",), 2, 1.0, anchors=SQUARE, names=tuple("abcd"))
    distance = np.hypot(*(SQUARE - [2.0, 3.0]).T)
    heard = [
        Event(second + 0.2 * k, "range", distance[k : k + 1], k)
        for second in range(2)
        for k in range(4)
    ]
    asked = [Event(second + 0.9, "ask", np.zeros(0)) for second in range(5)]
    entry = Network(task)
    for event in sorted([*heard, *asked], key=lambda event: event.time):
        answer = entry.step(event)
        if event.kind == "ask":
            assert answer is not None
            np.testing.assert_allclose(answer.position, [2.0, 3.0], atol=1e-6)
    assert len(entry.fixes.kept) == 2


def test_before_a_fix_there_is_no_answer() -> None:
    asked = [Event(1.0, "ask", np.zeros(0))]
    for kind in (Network, LooselyCoupled, PlanarFilter):
        assert run(kind, Task(("fix",), 3, 1.0, numbers=NUMBERS), asked) == [None]


def test_the_loosely_coupled_filter_bridges_an_outage_that_others_do_not() -> None:
    """Fixes at 5 Hz of a tag on an arm, 2 cm wrong, until 30 s; then 3 s of a good IMU alone."""
    rng, path = np.random.default_rng(5), Path()
    imu = imu_of(path, 33.0, rng, force=0.002, rate=2e-4)
    events = [
        Event(float(t), "imu", np.concatenate([w, f]))
        for t, w, f in zip(imu.time, imu.rate, imu.force, strict=True)
    ]
    stamps = np.arange(0.1, 30.0, 0.2)
    fixes = path.antenna(stamps) + 0.02 * rng.standard_normal((len(stamps), 3))
    events += [
        Event(float(t), "fix", np.append(x, np.full(3, 0.02)))
        for t, x in zip(stamps, fixes, strict=True)
    ]
    asked = np.arange(0.2, 33.0, 0.2)
    events += [Event(float(t), "ask", np.zeros(0)) for t in asked]
    events.sort(key=lambda event: (event.time, event.kind == "ask"))
    task = Task(
        ("fix", "imu"), 3, 0.2, lever_arm=LEVER_ARM, warm_up=25.0,
        numbers=NUMBERS | {"force": 0.002, "rate": 2e-4, "coloured": 0.005},
    )  # fmt: skip
    truth = np.hstack([path.antenna(asked)[:, :2], path.velocity(asked)[:, :2]])
    outage = asked > 30.0
    found = {}
    for kind in (LooselyCoupled, GoOn):
        answers = run(kind, task, events)
        late = [a for a, out in zip(answers, outage, strict=True) if out and a]
        found[kind] = errors_of(late, truth[outage])
    assert found[LooselyCoupled].rms < 0.15
    assert found[GoOn].rms > 1.0
    assert 0.1 < found[LooselyCoupled].nees < 5


def planar(kind: Entry, course: Course) -> Errors:
    task = replace(course.task, numbers=PLANAR)
    answers = run(kind, task, list(course.events))
    judged = [a for a, rows in zip(answers, course.judged, strict=True) if rows and a]
    return errors_of(judged, course.truth[course.judged])


def test_the_planar_filter_is_better_than_the_network_and_dead_reckoning_drifts() -> None:
    course = make_course(made_drive(3, seconds=60.0), TRACKS["network"])
    network, filtered = planar(Network, course), planar(PlanarFilter, course)
    reckoned = planar(DeadReckoning, course)
    assert filtered.rms < 0.1 < network.rms
    assert filtered.velocity < 0.2
    assert 0.2 < filtered.nees < 3
    assert filtered.rms < reckoned.rms < 5
