"""Baselines that every entry is compared with; they enter as any other entry does."""

from __future__ import annotations

from collections import deque
from dataclasses import replace
from typing import ClassVar

import numpy as np

from inswsn_lib import inertial as nav
from inswsn_lib.benchmark.events import Answer, Event, Task
from inswsn_lib.calibration import multilaterate_track
from inswsn_lib.checks import Array
from inswsn_lib.errors import InswsnError
from inswsn_lib.inertial.error_state import antenna
from inswsn_lib.streams import Fixes, Imu, Odometry, Ranges

_SLOPE = 5  # fixes
_OLD = 3.0  # a slope is taken of fixes that span no more than this many times their number
_ALIGNMENT, _AGAIN = 20.0, 5.0  # s, the window, and how long after a failure it is tried again
_UP = np.array([1.0, 1.0, 2.0])  # errors of fixes upwards, times those to the side
_WALKS = (1e-3, 1e-4)  # of the biases of an IMU
_SLOWEST = 0.3  # m/s, at which the way that fixes go tells the heading


class LastFixes:
    """Fixes as they come, or by multilateration of the last ranges, and where they go.

    Parameters
    ----------
    task : Task
    """

    def __init__(self, task: Task) -> None:
        self.task = task
        self.heard: deque[Event] = deque()
        self.fresh = False
        self.new: list[Event] = []
        self.kept: deque[tuple[float, Array]] = deque(maxlen=_SLOPE * task.sources)

    def take(self, event: Event) -> None:
        """Take a range or a fix."""
        if event.kind == "range":
            self.heard.append(event)
            self.fresh = True
        elif event.kind == "fix":
            self.new.append(event)

    def at(self, time: float) -> list[tuple[float, Array, int]]:
        """Return the fixes since the last question: time, position, and source of each."""
        while self.heard and self.heard[0].time <= time - self.task.period:
            self.heard.popleft()
        if self.fresh:
            self.new += self._multilaterated(self.heard)
        d = self.task.dimension
        found = [(event.time, event.values[:d], event.source) for event in self.new]
        self.kept += [(t, position[:2]) for t, position, _ in found]
        self.new, self.fresh = [], False
        return found

    def _multilaterated(self, heard: deque[Event]) -> list[Event]:
        ranges = Ranges(
            np.array([event.time for event in heard]),
            np.array([event.source for event in heard]),
            np.array([event.values[0] for event in heard]),
            self.task.anchors,
            self.task.names,
        )
        fixes = multilaterate_track(ranges, 2 * self.task.period)
        place = fixes.position[0]
        return [] if np.isnan(place).any() else [Event(float(fixes.time[0]), "fix", place)]

    def line(self) -> tuple[float, Array, Array]:
        """Return time and position of the last fix, mean over sources, and the slope."""
        last = list(self.kept)[-self.task.sources :]
        time, place = np.mean([t for t, _ in last]), np.mean([p for _, p in last], axis=0)
        times, places = (np.array(each) for each in zip(*self.kept, strict=True))
        apart = times - times.mean()
        longest = _OLD * _SLOPE * self.task.period
        if len(times) < self.kept.maxlen or np.ptp(times) > longest:  # type: ignore[operator]
            return float(time), place, np.zeros(2)
        return float(time), place, apart @ places / (apart @ apart)


class Network:
    """The network alone: the last fix, and the slope of the line through five of them.

    In an outage it says what it said before. A fix by ranges is of the middle of a period.
    """

    def __init__(self, task: Task) -> None:
        self.fixes = LastFixes(task)

    def step(self, event: Event) -> Answer | None:
        """Take an event."""
        self.fixes.take(event)
        if event.kind != "ask":
            return None
        self.fixes.at(event.time)
        return self.answer(event.time) if self.fixes.kept else None

    def answer(self, time: float) -> Answer:
        """Return the answer to a question at a time, s."""
        _, place, slope = self.fixes.line()
        return Answer(place, slope)


class StandStill(Network):
    """The last fix, and no velocity."""

    def answer(self, time: float) -> Answer:
        """Return the answer to a question at a time, s."""
        return Answer(self.fixes.line()[1], np.zeros(2))


class GoOn(Network):
    """Go on from the last fix at the last velocity."""

    def answer(self, time: float) -> Answer:
        """Return the answer to a question at a time, s."""
        since, place, slope = self.fixes.line()
        return Answer(place + (time - since) * slope, slope)


class LooselyCoupled:
    """The loosely coupled error-state filter of fixes with coloured errors.

    Until it is aligned in motion, it goes on from fix to fix.
    """

    tunable: ClassVar = {
        "force": (0.02, 2.0), "rate": (0.002, 2.0), "white": (0.04, 1.5), "coloured": (0.08, 1.5),
        "time": (3.0, 1.5),
    }  # fmt: skip

    def __init__(self, task: Task) -> None:
        self.task, self.before = task, GoOn(task)
        self.imu: list[Event] = []
        self.seen: list[tuple[float, Array, int]] = []
        self.filter: nav.ErrorStateFilter | None = None
        self.first, self.next = -np.inf, np.inf

    def step(self, event: Event) -> Answer | None:
        """Take an event."""
        if event.kind == "imu":
            self.imu.append(event)
        self.before.fixes.take(event)
        if event.kind != "ask":
            return None
        found = self.before.fixes.at(event.time)
        if self.filter is None:
            self.seen += found
            self._try(event.time)
        if self.filter is None:
            return self.before.answer(event.time) if self.before.fixes.kept else None
        return self._go(event.time, found)

    def _go(self, time: float, found: list[tuple[float, Array, int]]) -> Answer:
        """Filter the fixes, go on to a time, and answer."""
        running = self.filter
        assert running is not None
        motion = self._motion()
        for at, place, source in sorted(found, key=lambda fix: fix[0]):
            if at > running.time:
                running.predict(motion, at)
            if at >= running.time:
                running.measure(source, self._fixes([at], [place]))
        if time > running.time:
            running.predict(motion, time)
        while len(self.imu) > 2 and self.imu[1].time <= running.time:
            self.imu.pop(0)
        return answer_of(running, self.task.lever_arm)

    def _try(self, time: float) -> None:
        """Align on the last fixes, if it is time to."""
        if not self.seen or len(self.imu) < 2:
            return
        if self.next == np.inf:
            self.next = self.seen[0][0] + min(_ALIGNMENT, 0.8 * self.task.warm_up)
        if time < self.next:
            return
        window = min(_ALIGNMENT, 0.8 * self.task.warm_up)
        self.seen = [fix for fix in self.seen if fix[0] >= time - window]
        self.imu = [event for event in self.imu if event.time >= time - window - 0.1]
        own = [[fix for fix in self.seen if fix[2] == k] for k in range(self.task.sources)]
        white = np.full(3, 0.1) * _UP
        try:
            observed = [
                nav.PositionFixes(fixes_of([f[0] for f in mine], [f[1] for f in mine]),
                                  self.task.lever_arm, white)
                for mine in own if mine
            ]  # fmt: skip
            start = nav.align(self._motion(), observed, time - window, time)
        except InswsnError:
            self.next = time + _AGAIN
            return
        kinds = [self._fixes([0.0], [np.zeros(3)])] * self.task.sources
        self.filter = nav.ErrorStateFilter(start, kinds)

    def _fixes(self, times: list[float], places: list[Array]) -> nav.PositionFixes:
        numbers = self.task.numbers
        return nav.PositionFixes(
            fixes_of(times, places), self.task.lever_arm, numbers["white"] * _UP,
            numbers["coloured"] * _UP, np.full(3, numbers["time"]),
        )  # fmt: skip

    def _motion(self) -> nav.InertialMotion:
        values = np.array([event.values for event in self.imu])
        imu = Imu(np.array([event.time for event in self.imu]), values[:, :3], values[:, 3:])
        noise = nav.ImuNoise(self.task.numbers["force"], self.task.numbers["rate"], *_WALKS)
        return nav.InertialMotion(imu, noise)


class PlanarFilter:
    """Dead reckoning by odometry, corrected by each range; ranges share a scale.

    The start is the first fix after the vehicle moves, and the way that fixes go.
    """

    tunable: ClassVar = {
        "speed": (0.05, 2.0), "rate": (0.02, 2.0), "white": (0.3, 2.0), "scale": (0.05, 2.0),
    }  # fmt: skip
    ends: ClassVar = np.inf

    def __init__(self, task: Task) -> None:
        self.task, self.before = task, GoOn(task)
        self.new: list[Event] = []
        self.last: Event | None = None
        self.filter: nav.ErrorStateFilter | None = None
        self.begin = np.inf

    def step(self, event: Event) -> Answer | None:
        """Take an event."""
        self.begin = min(self.begin, event.time)
        self.before.fixes.take(event)
        if self.filter is not None and event.kind in ("odometry", "range", "ask"):
            self._go(event)
        if event.kind == "odometry":
            self.last = event
        if event.kind != "ask":
            return None
        self.before.fixes.at(event.time)
        if self.filter is not None:
            answer = answer_of(self.filter, self.task.lever_arm[:2])
            # the error of the velocity is that of the wheels, which is no state of the filter
            return replace(answer, covariance=np.asarray(answer.covariance)[:2, :2])
        if self.before.fixes.kept:
            self._try(event.time)
            return self.before.answer(event.time)
        return None

    def _go(self, event: Event) -> None:
        running, row = self.filter, event if event.kind == "odometry" else self.last
        assert running is not None
        assert row is not None
        if event.time > running.time:
            odometry = Odometry(np.array([event.time]), row.values[:1], row.values[1:])
            noise = nav.OdometryNoise(
                self.task.numbers["speed"], self.task.numbers["rate"], 1e-4, 1e-4
            )
            running.predict(nav.OdometryMotion(odometry, noise), event.time)
        if event.kind == "range" and event.time <= self.begin + self.ends * self.task.warm_up:
            running.measure(0, self._ranges(event))

    def _try(self, time: float) -> None:
        since, place, slope = self.before.fixes.line()
        if self.last is None or np.hypot(*slope) < _SLOWEST:
            return
        state = nav.PlanarState(place + (time - since) * slope, float(np.arctan2(*slope[::-1])))
        spread = np.square([self.task.period, self.task.period, 0.5, 0.1, 0.05])
        start = nav.Start(time, state, np.diag(spread))
        event = Event(time, "range", np.zeros(1))
        self.filter = nav.ErrorStateFilter(start, [self._ranges(event)])

    def _ranges(self, event: Event) -> nav.RangesToAnchors:
        heard = Ranges(
            np.array([event.time]), np.array([event.source]), event.values, self.task.anchors,
            self.task.names,
        )  # fmt: skip
        numbers = self.task.numbers
        return nav.RangesToAnchors(
            heard, self.task.lever_arm[:2], numbers["white"], scale=numbers["scale"]
        )


class DeadReckoning(PlanarFilter):
    """Odometry alone, from where the planar filter is at the end of the warm-up."""

    ends: ClassVar = 1.0


def fixes_of(times: list[float], places: list[Array]) -> Fixes:
    """Return fixes at some times, in their order."""
    order = np.argsort(times, kind="stable")
    return Fixes(np.array(times)[order], np.array(places)[order])


def answer_of(running: nav.ErrorStateFilter, lever_arm: Array) -> Answer:
    """Return a filter's estimate of the tag.

    Parameters
    ----------
    running : ErrorStateFilter
    lever_arm : ndarray, (3,) or (2,)
    """
    found, P = antenna([running.state], running.covariance[None], lever_arm)
    return Answer(found[0, :2], found[0, 2:], P[0])
