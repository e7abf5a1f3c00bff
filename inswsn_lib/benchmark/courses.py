"""Tracks: the recordings an entry runs on, what it is given of them, and where it is judged."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import cycle
from pathlib import Path
from typing import Any

import numpy as np

from inswsn_lib.benchmark.events import Event, Task
from inswsn_lib.calibration import multilaterate_track
from inswsn_lib.checks import Array, Mask, one_of
from inswsn_lib.errors import InswsnError
from inswsn_lib.inertial.mechanization import GRAVITY
from inswsn_lib.recordings import load
from inswsn_lib.recordings.estimates import line_through, tag_track
from inswsn_lib.recordings.files import RecordingUnavailableError
from inswsn_lib.streams import Fixes, Ranges, Recording, Stream

#: Anchors of the two clusters, by their places in the list
CLUSTERS = ((0, 1, 4, 6), (2, 3, 5, 7))
# A question comes when so many ranges more than dimensions were heard, s at the least
_MORE, _PERIOD = 2.5, 0.2
_WARM_UP, _SHARE = 25.0, 1 / 6  # s, and of a recording, before the first question that is scored
_SEED = 2020  # of the places of outages


@dataclass(frozen=True)
class Track:
    """Recordings, what of each is given, and for how long it is withheld.

    Attributes
    ----------
    recordings : tuple of str
    given : str
        ``"ranges"``, ``"fixes"``, or ``"clusters"``: fixes of two halves of the anchors.
    outages : tuple of float
        How long ranges or fixes are withheld, one after the other and again, s; questions are then
        scored in outages alone.
    gaps : tuple of float
        The shortest and the longest time between two outages, s.
    """

    recordings: tuple[str, ...]
    given: str = "ranges"
    outages: tuple[float, ...] = ()
    gaps: tuple[float, float] = (5.0, 10.0)


#: The tracks by their names
TRACKS = {
    "network": Track(("inrol/1", "plaza/2", "labyrinth/1")),
    **{f"outage-{s}": Track(("inrol/1", "plaza/2"), outages=(float(s),)) for s in (2, 5, 10, 20)},
    "two-clusters": Track(("inrol/1",), given="clusters"),
    "vehicle": Track(
        ("rtklib/drive-0708",), given="fixes", outages=(10.0, 20.0, 30.0, 40.0), gaps=(10.0, 20.0)
    ),
}


@dataclass(frozen=True, eq=False)
class Course:
    """One recording of a track.

    Attributes
    ----------
    name : str
    task : Task
    events : tuple of Event
        In the order of time; a question comes after all else of its time.
    truth : ndarray, (questions, 4)
        Horizontal position (m) and velocity (m/s).
    scored : ndarray of bool, (questions,)
        Which questions are scored, before the split for tuning, after it to judge.
    split : float
        The middle of the questions, s.
    """

    name: str
    task: Task
    events: tuple[Event, ...]
    truth: Array
    scored: Mask
    split: float

    @property
    def asked(self) -> Array:
        """The times of the questions, s."""
        return np.array([event.time for event in self.events if event.kind == "ask"])

    @property
    def tuning(self) -> Mask:
        """The questions that entries are tuned by."""
        return np.asarray(self.scored & (self.asked <= self.split))

    @property
    def judged(self) -> Mask:
        """The questions that entries are judged by."""
        return np.asarray(self.scored & (self.asked > self.split))

    @property
    def first(self) -> tuple[Event, ...]:
        """The events up to the split."""
        return tuple(event for event in self.events if event.time <= self.split)


def track_courses(
    track: str, folder: str | Path | None = None
) -> tuple[list[Course], tuple[str, ...]]:
    """Return the courses of a track, and a sentence for each recording that is unavailable.

    Parameters
    ----------
    track : str
        One of `TRACKS`.
    folder : str or Path, optional
        With a recording of your own as files of CSV, which is taken instead of the track's.

    Raises
    ------
    InswsnError
        If there is no course, or a recording lacks what the track asks for.

    Examples
    --------
    >>> from inswsn_lib.benchmark import track_courses
    >>> track_courses("marathon")
    Traceback (most recent call last):
        ...
    inswsn_lib.errors.ParameterError: track must be one of "network", "outage-2", "outage-5", \
"outage-10", "outage-20", "two-clusters", "vehicle", not 'marathon'.
    """
    one_of("track", track, tuple(TRACKS))
    if folder is not None:
        return [make_course(load("csv", folder), TRACKS[track])], ()
    courses, left_out = [], []
    for name in TRACKS[track].recordings:
        try:
            courses.append(make_course(load(name), TRACKS[track]))
        except RecordingUnavailableError as error:
            left_out.append(f"{name} is left out: {error}")
    if not courses:
        raise InswsnError(f"The track {track} has no recording. {left_out[0]}")
    return courses, tuple(left_out)


def make_course(recording: Recording, track: Track) -> Course:
    """Return a course of a recording.

    Parameters
    ----------
    recording : Recording
    track : Track
        Its recordings are not asked for.

    Raises
    ------
    InswsnError
        If the recording lacks what the track asks for.
    """
    if recording.imu is None and recording.odometry is None:
        raise InswsnError(f"{recording.name} has neither imu nor odometry; it needs one.")
    source = _stream(recording, "fixes" if track.given == "fixes" else "ranges")
    begin = max(s.time[0] for s in (source, recording.imu, recording.odometry) if s is not None)
    end = min(s.time[-1] for s in (source, recording.imu, recording.odometry) if s is not None)
    recording = recording.part(begin, end)
    if track.given == "fixes":
        asked, truth, period = _good_fixes(recording)
    else:
        spacing = (source.time[-1] - source.time[0]) / len(source)
        period = max(_PERIOD, round(float(_MORE + source.anchors.shape[1]) * spacing, 1))
        asked = np.arange(begin + period, end, period)
        truth = _reference(recording, asked)
    warm_up = min(_WARM_UP, float(_SHARE * (end - begin)))
    outages = place_outages(begin + warm_up, end, track)
    scored = np.isfinite(truth).all(axis=1) & (asked >= begin + warm_up)
    if outages:
        scored &= inside(asked, outages)
    given, task = _given(recording, track, period)
    withheld = inside(np.array([event.time for event in given]), outages)
    events = [event for event, gone in zip(given, withheld, strict=True) if not gone]
    events += _events("ask", asked, np.empty((len(asked), 0)))
    for kind, stream in (("imu", recording.imu), ("odometry", recording.odometry)):
        if stream is not None:
            events += _events(kind, stream.time, np.column_stack(_columns(stream)))
    ordered = tuple(sorted(events, key=lambda event: (event.time, event.kind == "ask")))
    task = replace(
        task, streams=tuple(sorted({e.kind for e in events} - {"ask"})), period=period,
        warm_up=warm_up, lever_arm=recording.lever_arm, gravity=GRAVITY,
    )  # fmt: skip
    middle = float(asked[0] + asked[-1]) / 2
    return Course(recording.name, task, ordered, truth, scored, middle)


def place_outages(begin: float, end: float, track: Track) -> list[tuple[float, float]]:
    """Return where data are withheld: always the same places.

    Parameters
    ----------
    begin, end : float
        s.
    track : Track
    """
    rng, found = np.random.default_rng(_SEED), []
    at = begin + rng.uniform(*track.gaps)
    for length in cycle(track.outages):
        if at + length > end:
            break
        found.append((at, at + length))
        at += length + rng.uniform(*track.gaps)
    return found


def inside(times: Array, outages: Sequence[tuple[float, float]]) -> Mask:
    """Tell which times lie in an outage, whose first moment does not."""
    found = np.zeros(len(times), dtype=bool)
    for begin, end in outages:
        found |= (times > begin) & (times <= end)
    return found


def _stream(recording: Recording, name: str) -> Any:
    found = getattr(recording, name)
    if found is None:
        raise InswsnError(f"{recording.name} has no {name}, which this track is about.")
    return found


def _events(kind: str, time: Array, values: Array, source: Any = None) -> list[Event]:
    sources = np.zeros(len(time), dtype=int) if source is None else source
    rows = zip(time.tolist(), values, sources.tolist(), strict=True)
    return [Event(t, kind, value, which) for t, value, which in rows]


def _columns(stream: Stream) -> list[Array]:
    return [value for name, value in vars(stream).items() if name != "time"]


def _good_fixes(recording: Recording) -> tuple[Array, Array, float]:
    """Return when there is a good fix, with the truth that it tells, and the period of fixes."""
    fixes: Fixes = _stream(recording, "fixes")
    if fixes.velocity is None:
        raise InswsnError(f"The fixes of {recording.name} have no velocity to judge by.")
    truth = np.hstack([fixes.position[:, :2], fixes.velocity[:, :2]])
    good = np.isfinite(truth).all(axis=1) & (True if fixes.good is None else fixes.good)
    return fixes.time[good], truth[good], float(np.median(np.diff(fixes.time)))


def _reference(recording: Recording, asked: Array) -> Array:
    _stream(recording, "reference")
    time, track = tag_track(recording)
    half = max(0.075, 2.5 * float(np.median(np.diff(time))))
    return line_through(time, track[:, :2], asked, half)


def _given(recording: Recording, track: Track, period: float) -> tuple[list[Event], Task]:
    """Return the events of ranges or fixes, and what a task tells of them."""
    if track.given == "fixes":
        return _fix_events(_stream(recording, "fixes"), 0), Task((), dimension=3, period=period)
    ranges: Ranges = _stream(recording, "ranges")
    d = ranges.anchors.shape[1]
    if track.given == "ranges":
        events = _events("range", ranges.time, ranges.distance[:, None], ranges.anchor)
        return events, Task((), d, period, anchors=ranges.anchors, names=ranges.names)
    if (len(ranges.anchors), d) != (8, 3):
        raise InswsnError(f"Two clusters in space need 8 anchors; {recording.name} has too few.")
    events = []
    for number, members in enumerate(CLUSTERS):
        heard = ranges.kept(np.isin(ranges.anchor, members))
        events += _fix_events(multilaterate_track(heard, period), number)
    return events, Task((), dimension=3, period=period, sources=len(CLUSTERS))


def _fix_events(fixes: Fixes, source: int) -> list[Event]:
    """Return fixes; to both sides they have the same deviation, however the axes lie."""
    known = fixes.deviation is not None
    deviation = np.asarray(fixes.deviation if known else np.full_like(fixes.position, np.nan))
    side = np.sqrt(np.mean(deviation[:, :2] ** 2, axis=1, keepdims=True))
    values = np.hstack([fixes.position, side, side, deviation[:, 2:]])
    there = np.isfinite(fixes.position).all(axis=1)
    return _events("fix", fixes.time[there], values[there], np.full(there.sum(), source))
