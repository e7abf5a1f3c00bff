"""The disguise and the prefix test, with entries that peek."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
import pytest

from inswsn_lib.benchmark import Answer, Disguise, Event, Task, changed_after, first_difference
from inswsn_lib.benchmark.guards import same

Answers = list[Answer | None]
LATER: list[Event] = []


def stream(count: int = 40) -> list[Event]:
    """A fix in every second, and a question half a second later."""
    rng = np.random.default_rng(3)
    fixes = [Event(float(t), "fix", rng.normal(size=4)) for t in range(count)]
    asked = [Event(t + 0.5, "ask", np.zeros(0)) for t in range(count)]
    return sorted(fixes + asked, key=lambda event: event.time)


def last_fix(events: Sequence[Event]) -> Answers:
    found: Answers = []
    last = None
    for event in events:
        if event.kind == "ask":
            found.append(last)
        else:
            last = Answer(event.values[:2], covariance=np.eye(2))
    return found


def through_the_array(events: Sequence[Event]) -> Answers:
    """Each value is a row of one array, whose next row can be had."""
    held = [event for event in events if event.kind == "fix"]
    rows = iter(np.array([event.values for event in held]))
    found: Answers = []
    for event in events:
        if event.kind != "ask":
            row = next(rows)
            continue
        behind = row.base
        assert behind is not None
        here = int(np.flatnonzero((behind == row).all(axis=1))[0])
        found.append(Answer(behind[min(here + 1, len(behind) - 1), :2]))
    return found


def through_a_global(events: Sequence[Event]) -> Answers:
    LATER[:] = [event for event in events if event.kind == "fix"]
    asked = [event.time for event in events if event.kind == "ask"]
    return [Answer([float(np.mean([e.values[0] for e in LATER])), 0.0]) for _ in asked]


def with_a_memory() -> Callable[[Sequence[Event]], Answers]:
    """It keeps what it was given, and looks it up when it is run again."""
    memory: list[Answers] = []

    def answers(events: Sequence[Event]) -> Answers:
        memory.append(last_fix(events))
        return memory[0][1:] + memory[0][:1] if len(memory) > 1 else memory[0]

    return answers


@pytest.mark.parametrize("seed", range(5))
def test_who_peeks_is_found_and_who_does_not_is_not(seed: int) -> None:
    events = stream()
    assert first_difference(last_fix, events, seed) is None
    for peeking in (through_the_array, through_a_global, with_a_memory()):
        assert first_difference(peeking, events, seed) is not None


def test_who_peeks_one_step_is_found_between_30_and_70_percent() -> None:
    """At the one answer that sees the first of what has changed."""
    found = {first_difference(through_the_array, stream(), seed) for seed in range(20)}
    assert all(time is not None and 12 <= time <= 29 for time in found)
    assert len(found) > 5


def test_a_change_leaves_questions_and_what_was_before() -> None:
    events = stream()
    changed = changed_after(events, 30, seed=0)
    assert changed[:31] == events[:31]
    questions = [event for event in events if event.kind == "ask"]
    assert [event for event in changed if event.kind == "ask"] == questions
    later = [e.values for e in changed[31:] if e.kind == "fix"]
    assert len(later) < len([e for e in events[31:] if e.kind == "fix"])
    before = {e.time: e.values for e in events}
    assert all((e.values != before[e.time]).all() for e in changed[31:] if e.kind == "fix")


def test_answers_differ_by_a_bit_or_by_a_part() -> None:
    one = Answer([1.0, 2.0], [0.0, 0.0])
    assert same(one, Answer(np.array([1.0, 2.0]), np.zeros(2)))
    assert not same(one, Answer([np.nextafter(1.0, 2.0), 2.0], [0.0, 0.0]))
    assert not same(one, Answer([1.0, 2.0]))
    assert not same(one, None)


def test_a_disguise_keeps_distances_and_is_undone() -> None:
    """In the frame of the disguise: moved by its shift, turned by its angle."""
    anchors = np.array([[0.0, 0.0, 1.0], [3.0, 4.0, 2.0]])
    disguise = Disguise.drawn(seed=7, begin=100.0)
    task = disguise.task(Task(("fix",), 3, 1.0, anchors=anchors))
    assert np.isclose(np.linalg.norm(np.diff(task.anchors, axis=0)), np.sqrt(26))
    assert np.isclose(np.diff(task.anchors[:, 2])[0], 1.0)  # it turns about the vertical
    assert np.abs(task.anchors - anchors).min() > 0.1
    fix = Event(103.0, "fix", np.array([3.0, 4.0, 2.0, 0.1, 0.1, 0.2]))
    given = disguise.event(fix)
    np.testing.assert_allclose(given.values, [*task.anchors[1], 0.1, 0.1, 0.2])
    assert given.time == pytest.approx(3.0 + disguise.delay)
    turn = disguise.turn[:2, :2]
    P = np.diag([4.0, 1.0, 9.0, 2.0])
    both = np.block([[turn, np.zeros((2, 2))], [np.zeros((2, 2)), turn]])
    told = Answer(given.values[:2], turn @ [1.0, -2.0], both @ P @ both.T)
    undone = disguise.answer(told)
    np.testing.assert_allclose(undone.position, [3.0, 4.0], atol=1e-9)
    np.testing.assert_allclose(undone.velocity, [1.0, -2.0], atol=1e-12)  # type: ignore[arg-type]
    np.testing.assert_allclose(undone.covariance, P, atol=1e-12)  # type: ignore[arg-type]


def test_ranges_and_inertial_data_are_not_turned() -> None:
    disguise = Disguise.drawn(seed=7, begin=0.0)
    for kind in ("imu", "odometry", "range"):
        values = np.arange(6.0)
        assert disguise.event(Event(1.0, kind, values)).values is values
