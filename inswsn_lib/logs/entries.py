"""An estimator of your own on the ladder of a recording: it is given events one at a time.

An entry is a class in a file. It is code that runs with the rights of who wrote it, in this
process. It gets what will come (`Task`), is given what sensors said one event after the other, and
answers when it is asked where the tag is.

.. code-block:: python

    from inswsn_lib.logs import Answer


    class StandStill:
        numbers = {}

        def __init__(self, task):
            self.last = None

        def step(self, event):
            if event.kind == "fix":
                self.last = event.values[:2]
            if event.kind == "ask" and self.last is not None:
                return Answer(self.last)
"""

from __future__ import annotations

import runpy
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import repeat
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike

from inswsn_lib.checks import Array, Mask, array, covariance, number
from inswsn_lib.errors import Described, InswsnError, ParameterError
from inswsn_lib.evaluation import most_likely
from inswsn_lib.inertial.mechanization import GRAVITY
from inswsn_lib.logs.estimates import Estimate
from inswsn_lib.logs.ladder import Ladder
from inswsn_lib.streams import Recording, Whole


@dataclass(frozen=True, eq=False)
class Task:
    """What an entry is given before the first event.

    Attributes
    ----------
    streams : tuple of str
        The kinds of events that will come: ``"imu"``, ``"odometry"``, ``"range"``, ``"fix"``.
    period : float
        Median time between questions, s.
    anchors : ndarray, (N, 2 or 3)
        m; none without ranges.
    lever_arm : ndarray, (3,)
        From the IMU to the tag or antenna, which is asked for, in the axes of the body, m.
    gravity : float
        m/s^2, along -z.
    numbers : mapping of str to float
        The tuned numbers of the entry.

    Examples
    --------
    >>> from inswsn_lib.logs import Task
    >>> Task(("fix",), period=1.0).numbers
    {}
    """

    streams: tuple[str, ...]
    period: float
    anchors: Array = field(default_factory=lambda: np.zeros((0, 3)))
    lever_arm: Array = field(default_factory=lambda: np.zeros(3))
    gravity: float = GRAVITY
    numbers: Mapping[str, float] = field(default_factory=dict)


class Event(NamedTuple):
    """A sensor's reading, or a question.

    Attributes
    ----------
    time : float
        s.
    kind : str
        ``"imu"``: angular rate and specific force, (6,), rad/s and m/s^2. ``"odometry"``: speed and
        rate of the heading, (2,), m/s and rad/s, means of the interval that ends now. ``"range"``:
        (1,), m. ``"fix"``: position, (2,) or (3,), m. ``"ask"``: (0,).
    values : ndarray
    source : int
        The anchor of a range.
    """

    time: float
    kind: str
    values: Array
    source: int = 0


@dataclass(frozen=True, eq=False)
class Answer:
    """Where the tag or antenna is at the time of a question.

    Attributes
    ----------
    position : array_like, (2,)
        Horizontal, m.
    velocity : array_like, (2,), or None
        m/s.
    covariance : array_like, (4, 4) or (2, 2), or None
        Of the errors of position and velocity, or of position.
    """

    position: ArrayLike
    velocity: ArrayLike | None = None
    covariance: ArrayLike | None = None


def judge(entry: Any, recording: Recording | Ladder, *, seed: int | None = None) -> pd.DataFrame:
    """Return the ladder of a recording with an entry on it.

    The entry is asked at the time of each fix, after it is given that. Its numbers are tuned as
    those of the filters of P1's form are, by the size of its errors in the first part. Then the
    data after a moment that is drawn are left out: all answers up to it must be the same.

    Parameters
    ----------
    entry : str or callable
        ``"mine.py:Mine"``, or what takes a `Task` and returns an object with a method ``step`` that
        takes an `Event` and returns an `Answer` or None. An attribute ``numbers``, if it has one,
        maps names to positive numbers at which their search begins.
    recording : Recording or Ladder
        With a reference.
    seed : int, optional
        Of the moment; by default another one each time.

    Returns
    -------
    DataFrame
        As of `Ladder.table`, with a row for the entry.

    Raises
    ------
    InswsnError
        If there is no such entry, it gives no answer where it is judged, or later data change
        earlier answers.

    Examples
    --------
    >>> from inswsn_lib import logs
    >>> logs.judge("mine.txt", logs.load)
    Traceback (most recent call last):
        ...
    inswsn_lib.errors.ParameterError: entry must be path/to/file.py:Class, not 'mine.txt'.
    """
    name, made = _entry(entry)
    ladder = recording if isinstance(recording, Ladder) else Ladder(recording)
    judged, first = ladder.judged, ladder.usable & (ladder.fixes.time <= ladder.split)
    task, events = _events(ladder)
    begin, numbers = _numbers(made), dict[str, float]()

    def answers(events: Sequence[Event], numbers: Mapping[str, float]) -> Estimate:
        return _answers(name, made(replace(task, numbers=numbers)), events, len(ladder.fixes))

    if begin:
        early = [event for event in events if event.time <= ladder.split]
        _refuse_silent(name, ladder, answers(early, begin), first)

        def likely(*values: float) -> float:
            state = answers(early, dict(zip(begin, values, strict=True))).state[first, :2]
            squares = np.square(state - ladder.truth[first, :2]).sum(axis=1)
            return -len(squares) * float(np.log(squares.mean()))

        search = most_likely(name, [*begin.values()], likely)
        numbers = dict(zip(begin, search.best, strict=True))
    found = answers(events, numbers)
    _refuse_silent(name, ladder, found, judged)
    # an entry whose answers change if later data are left out is refused
    asked = [k for k, event in enumerate(events) if event.kind == "ask"]
    last = int(np.random.default_rng(seed).integers(len(asked) // 4, 3 * len(asked) // 4))
    again = answers(events[: asked[last] + 1], numbers)
    same = (again.state == found.state) | (np.isnan(again.state) & np.isnan(found.state))
    wrong = ~same[: last + 1].all(axis=1)
    if wrong.any():
        at = ladder.fixes.time[np.argmax(wrong)]
        raise InswsnError(
            f"{name} is not causal: data after {ladder.fixes.time[last]:.6g} s change its answer "
            f"at {at:.6g} s."
        )
    return ladder.table({name: found})


def _entry(entry: Any) -> tuple[str, Callable[[Task], Any]]:
    if callable(entry):
        return str(getattr(entry, "__name__", "entry")), entry
    path, _, name = str(entry).rpartition(":")
    if not path.endswith(".py") or not name.isidentifier():
        raise ParameterError("entry", entry, "path/to/file.py:Class")
    if not Path(path).is_file():
        raise ParameterError("entry", entry, "in a file that exists")
    try:
        made = runpy.run_path(path, run_name=f"entry_{Path(path).stem}")[name]
    except Exception as error:
        raise InswsnError(f"{path} does not give {name}: {type(error).__name__}: {error}") from None
    if not callable(made):
        raise ParameterError("entry", entry, "a class, or a function of a Task")
    return name, made


def _numbers(made: Any) -> dict[str, float]:
    """Return the numbers that an entry wants tuned."""
    given = getattr(made, "numbers", {})
    if not isinstance(given, Mapping):
        raise ParameterError("numbers", given, "a mapping of names to positive numbers")
    return {str(name): number(f"numbers[{name!r}]", x, above=0) for name, x in given.items()}


def _events(ladder: Ladder) -> tuple[Task, list[Event]]:
    """Return the events of a recording and the questions, in the order of time."""
    recording, fixes = ladder.filters.recording, ladder.fixes
    events = [Event(time, "ask", np.empty(0)) for time in fixes.time.tolist()]

    def tell(kind: str, times: Array, values: Array, sources: Whole | int = 0) -> None:
        source = np.broadcast_to(sources, len(times)).tolist()
        events.extend(map(Event, times.tolist(), repeat(kind), values, source))

    if (imu := recording.imu) is not None:
        tell("imu", imu.time, np.hstack([imu.rate, imu.force]))
    if (driven := recording.odometry) is not None:
        tell("odometry", driven.time, np.column_stack([driven.speed, driven.rate]))
    anchors = np.zeros((0, 3))
    if (heard := recording.ranges) is not None:
        anchors = heard.anchors
        tell("range", heard.time, heard.distance[:, None], heard.anchor)
    there = np.isfinite(fixes.position).all(axis=1)
    tell("fix", fixes.time[there], fixes.position[there])
    events.sort(key=lambda event: (event.time, event.kind == "ask"))
    kinds = tuple(sorted({event.kind for event in events} - {"ask"}))
    return Task(kinds, ladder.step, anchors, recording.lever_arm), events


def _answers(name: str, mine: Any, events: Sequence[Event], count: int) -> Estimate:
    """Return what an entry says at each question, NaN where nothing."""
    state, P = np.full((count, 4), np.nan), np.full((count, 4, 4), np.nan)
    sizes, k = set(), 0
    for event in events:
        answer = mine.step(event)
        if event.kind != "ask":
            continue
        if answer is not None:
            if not isinstance(answer, Answer):
                raise ParameterError(f"what {name} answers", answer, "an Answer or None")
            state[k, :2] = array("position", answer.position, (2,))
            if answer.velocity is not None:
                state[k, 2:] = array("velocity", answer.velocity, (2,))
            if answer.covariance is not None:
                own = covariance("covariance", answer.covariance, (4, 4), (2, 2))
                P[k, : len(own), : len(own)] = own
                sizes.add(len(own))
        k += 1
    size = min(sizes, default=0)
    lacking = np.isfinite(state[:, 0]) & np.isnan(P[:, 0, 0])
    if size and lacking.any():
        given = Described(f"missing in {lacking.sum()} answers")
        raise ParameterError("covariance", given, "in every answer, or in none")
    return Estimate(state, P[:, :size, :size] if size else None)


def _refuse_silent(name: str, ladder: Ladder, found: Estimate, rows: Mask) -> None:
    silent = rows & ~np.isfinite(found.state[:, :2]).all(axis=1)
    if silent.any():
        after = ladder.fixes.time[silent][0] - ladder.fixes.time[0]
        raise InswsnError(f"{name} gives no answer {after:.6g} s after the first fix.")
