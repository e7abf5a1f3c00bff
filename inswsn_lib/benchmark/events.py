"""What an entry is told, what it is given, and what it answers."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from inswsn_lib.checks import Array


@dataclass(frozen=True, eq=False)
class Task:
    """What an entry is given before the first event.

    Attributes
    ----------
    streams : tuple of str
        The kinds of events that will come: ``"imu"``, ``"odometry"``, ``"range"``, ``"fix"``.
    dimension : int
        Of anchors and fixes, 2 or 3.
    anchors : ndarray, (N, dimension)
        m; none without ranges.
    names : tuple of str
        Of the anchors.
    warm_up : float
        How long after the first event no question is scored, s; those after it must be answered.
    sources : int
        How many streams of fixes there are.
    lever_arm : ndarray, (3,)
        From the IMU to the tag or antenna, which is asked for, in the axes of the body, m.
    period : float
        Of questions, s, but for gaps.
    gravity : float
        m/s^2, along -z.
    numbers : mapping of str to float
        The tuned numbers of the entry.

    Examples
    --------
    >>> from inswsn_lib.benchmark import Task
    >>> Task(("fix",), dimension=2, period=1.0).sources
    1
    """

    streams: tuple[str, ...]
    dimension: int
    period: float
    anchors: Array = field(default_factory=lambda: np.zeros((0, 2)))
    names: tuple[str, ...] = ()
    warm_up: float = 0.0
    sources: int = 1
    lever_arm: Array = field(default_factory=lambda: np.zeros(3))
    gravity: float = 9.80665
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
        (1,), m. ``"fix"``: position and its standard deviation, NaN if unknown, (2 dimension,), m;
        one by ranges speaks of the middle of its period. ``"ask"``: (0,).
    values : ndarray
    source : int
        The anchor of a range, or which stream of fixes.
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


def plain_task(task: Task) -> dict[str, Any]:
    """Return a task as JSON has it."""
    return {
        name: value.tolist() if isinstance(value, np.ndarray) else value
        for name, value in vars(task).items()
    }


def read_task(plain: dict[str, Any]) -> Task:
    """Return the task that `plain_task` was given."""
    arrays = {name: np.asarray(plain[name], dtype=float) for name in ("anchors", "lever_arm")}
    tuples = {name: tuple(plain[name]) for name in ("streams", "names")}
    return Task(**plain | arrays | tuples)


def plain_event(event: Event) -> list[Any]:
    """Return an event as JSON has it."""
    return [event.time, event.kind, event.values.tolist(), event.source]


def read_event(plain: list[Any]) -> Event:
    """Return the event that `plain_event` was given."""
    time, kind, values, source = plain
    return Event(time, kind, np.array(values), source)
