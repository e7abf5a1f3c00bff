"""Guards against cheating: another frame and clock, and changed data."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.transform import Rotation

from inswsn_lib.benchmark.events import Answer, Event, Task
from inswsn_lib.checks import Array

Answers = Sequence[Answer | None]
_FARTHEST, _LONGEST = 100.0, 10000.0  # m and s, of what is shifted and delayed
_DROPPED = 0.1  # of the changed events


@dataclass(frozen=True, eq=False)
class Disguise:
    """A turn about the vertical, a shift and another clock: what was memorised does not fit.

    Attributes
    ----------
    turn : ndarray, (3, 3)
    shift : ndarray, (3,)
        m.
    begin, delay : float
        s; the time `begin` becomes `delay`.

    Examples
    --------
    >>> from inswsn_lib.benchmark import Answer, Disguise
    >>> from inswsn_lib.benchmark.events import Event
    >>> import numpy as np
    >>> disguise = Disguise.drawn(seed=1, begin=0.0)
    >>> fix = disguise.event(Event(5.0, "fix", np.array([1.0, 2.0, 0.1, 0.1])))
    >>> disguise.answer(Answer(fix.values[:2])).position.round(9).tolist()
    [1.0, 2.0]
    """

    turn: Array
    shift: Array
    begin: float
    delay: float

    @classmethod
    def drawn(cls, seed: int, begin: float) -> Disguise:
        """Draw one for a stream that begins at a time, s."""
        rng = np.random.default_rng(seed)
        turn = Rotation.from_rotvec([0.0, 0.0, rng.uniform(0, 2 * np.pi)]).as_matrix()
        shift = rng.uniform(-_FARTHEST, _FARTHEST, 3)
        return cls(np.asarray(turn), shift, begin, float(rng.uniform(0, _LONGEST)))

    def task(self, task: Task) -> Task:
        """Disguise the places of anchors."""
        return replace(task, anchors=self._place(task.anchors))

    def event(self, event: Event) -> Event:
        """Disguise the time of an event, and the place of a fix."""
        values, time = event.values, event.time - self.begin + self.delay
        if event.kind == "fix":
            place, deviation = np.split(values, 2)
            values = np.concatenate([self._place(place), deviation])
        return event._replace(time=time, values=values)

    def answer(self, answer: Answer) -> Answer:
        """Return an answer without the disguise."""
        turn = self.turn[:2, :2]
        position = (np.asarray(answer.position) - self.shift[:2]) @ turn
        velocity = None if answer.velocity is None else np.asarray(answer.velocity) @ turn
        if answer.covariance is None:
            return Answer(position, velocity)
        P = np.asarray(answer.covariance)
        both = np.kron(np.eye(len(P) // 2), turn)
        return Answer(position, velocity, both.T @ P @ both)

    def _place(self, place: Array) -> Array:
        d = place.shape[-1]
        return np.asarray(place @ self.turn[:d, :d].T + self.shift[:d])


def changed_after(events: Sequence[Event], k: int, seed: int) -> list[Event]:
    """Return events of which those after event k have other values, and some are dropped.

    Questions stay as they are.

    Parameters
    ----------
    events : sequence of Event
    k : int
    seed : int

    Examples
    --------
    >>> import numpy as np
    >>> from inswsn_lib.benchmark import Event, changed_after
    >>> events = [Event(t, "range", np.ones(1)) for t in range(3)]
    >>> [event.values.tolist() == [1.0] for event in changed_after(events, k=1, seed=0)]
    [True, True, False]
    """
    rng = np.random.default_rng(seed)
    changed = list(events[: k + 1])
    for event in events[k + 1 :]:
        if event.kind == "ask":
            changed.append(event)
        elif rng.random() > _DROPPED:
            noise = rng.normal(size=len(event.values))
            changed.append(event._replace(values=event.values * (1 + 0.1 * noise) + 0.1 * noise))
    return changed


def first_difference(
    answers: Callable[[Sequence[Event]], Answers], events: Sequence[Event], seed: int = 0
) -> float | None:
    """Return the time of the first answer that data after it have changed; None if none has.

    Parameters
    ----------
    answers : callable
        Takes events and returns the answer to each question.
    events : sequence of Event
    seed : int
        Of the question after which all is changed, between 30 and 70 % of all, and of the changes.

    Examples
    --------
    The mean of all ranges, also of those to come:

    >>> import numpy as np
    >>> from inswsn_lib.benchmark import Answer, Event, first_difference
    >>> heard = [Event(t, "range", np.array([t, 0.0])) for t in range(9)]
    >>> questions = [Event(t + 0.5, "ask", np.zeros(0)) for t in range(9)]
    >>> events = sorted(heard + questions, key=lambda event: event.time)
    >>> def peeking(events):
    ...     mean = np.mean([event.values for event in events if event.kind == "range"], axis=0)
    ...     return [Answer(mean) for event in events if event.kind == "ask"]
    >>> first_difference(peeking, events)
    0.5
    """
    asked = [k for k, event in enumerate(events) if event.kind == "ask"]
    last = int(np.random.default_rng(seed).integers(3 * len(asked) // 10, 7 * len(asked) // 10 + 1))
    before, after = answers(events), answers(changed_after(events, asked[last], seed))
    for k, one, other in zip(asked[: last + 1], before, after, strict=False):
        if not same(one, other):
            return events[k].time
    return None


def same(one: Answer | None, other: Answer | None) -> bool:
    """Tell whether two answers are the same to the last bit."""
    if one is None or other is None:
        return one is other
    pairs = zip(vars(one).values(), vars(other).values(), strict=True)
    return all(
        a is b if a is None or b is None else np.array_equal(np.asarray(a), np.asarray(b))
        for a, b in pairs
    )
