"""The benchmark: entries and baselines, tuned with the same trials, judged on the rest."""

from __future__ import annotations

import subprocess
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np

from inswsn_lib.benchmark.courses import Course, track_courses
from inswsn_lib.benchmark.events import Answer, Event
from inswsn_lib.benchmark.guards import Disguise, first_difference
from inswsn_lib.benchmark.processes import EntryError, EntryName, EntryProcess, find_entry
from inswsn_lib.benchmark.scoring import CONSISTENT, Errors, errors_of, mean_ratio
from inswsn_lib.checks import Mask, number, whole
from inswsn_lib.errors import InswsnError
from inswsn_lib.evaluation import search_pattern

_HOME = "inswsn_lib.benchmark.baselines"
#: The baselines, and the stream that each of them needs
BASELINES = {
    f"{_HOME}:Network": "",
    f"{_HOME}:StandStill": "",
    f"{_HOME}:GoOn": "",
    f"{_HOME}:LooselyCoupled": "imu",
    f"{_HOME}:PlanarFilter": "odometry",
    f"{_HOME}:DeadReckoning": "odometry",
}
Say = Callable[[str], None]


@dataclass(frozen=True, eq=False)
class Scored:
    """The result of an entry on one recording.

    Attributes
    ----------
    recording : str
    errors : dataclass
        At the judged questions.
    numbers : dict of str to float
        That were found.
    log : tuple
        All trials: the numbers of each, and the RMS error of the position in the first part, m.
    cost : float
        Of a step, microseconds.
    causal : bool
    """

    recording: str
    errors: Errors
    numbers: dict[str, float]
    log: tuple[tuple[tuple[float, ...], float], ...]
    cost: float
    causal: bool


@dataclass(frozen=True, eq=False)
class Result:
    """The result of an entry on a track.

    Attributes
    ----------
    entry, track, commit : str
        The commit is that of the entry's checkout, or the version of inswsn.
    trials, seed : int
        Trials that each search was allowed.
    judged : tuple of Scored
        For each recording.
    best : tuple of str
        The best causal baseline of each recording, by its error in the judged part.
    ratio, low, high : float
        RMS error of the position over that of the best, geometric mean over recordings, and its
        95 % interval.
    left_out : tuple of str
        Recordings that were not there.
    """

    entry: str
    track: str
    commit: str
    trials: int
    seed: int
    judged: tuple[Scored, ...]
    best: tuple[str, ...]
    ratio: float
    low: float
    high: float
    left_out: tuple[str, ...] = field(default=())

    @property
    def causal(self) -> bool:
        """Whether it was given nothing before its time."""
        return all(each.causal for each in self.judged)

    @property
    def word(self) -> str:
        """``"level"`` where the interval holds 1, else ``"ahead"`` or ``"behind"``."""
        if self.low <= 1 <= self.high:
            return "level"
        return "ahead" if self.high < 1 else "behind"

    @property
    def nees(self) -> float:
        """The normalised square of the recording where it is farthest from 1."""
        return max((each.errors.nees for each in self.judged), key=lambda n: abs(np.log(n)))

    @property
    def consistency(self) -> str:
        """Whether its covariance matches its errors."""
        values = [each.errors.nees for each in self.judged]
        if np.isnan(values).any():
            return "no covariance"
        low, high = CONSISTENT
        return "consistent" if low <= min(values) and max(values) <= high else "inconsistent"

    def row(self) -> dict[str, Any]:
        """Return the row of a leaderboard, as JSON has it."""
        return {
            "entry": self.entry,
            "track": self.track,
            "commit": self.commit,
            "trials": self.trials,
            "seed": self.seed,
            "causal": self.causal,
            "ratio": self.ratio,
            "low": self.low,
            "high": self.high,
            "word": self.word,
            "nees": _known(self.nees),
            "consistency": self.consistency,
            "cost": float(np.mean([each.cost for each in self.judged])),
            "recordings": [
                {
                    "name": each.recording,
                    "best": best,
                    "position": each.errors.rms,
                    "velocity": _known(each.errors.velocity),
                    "nees": _known(each.errors.nees),
                    "numbers": each.numbers,
                    "log": each.log,
                }
                for each, best in zip(self.judged, self.best, strict=True)
            ],
        }


def run(
    entry: str | Callable[..., Any], track: str = "network", *, trials: int = 24, seed: int = 0,
    folder: str | Path | None = None, timeout: float = 60.0, say: Say | None = None,
) -> Result:  # fmt: skip
    """Judge an entry on a track, against the baselines.

    Its numbers are found by a search on the first half of each recording, by the RMS error of the
    position, with as many trials as each baseline has. The rest judges. It is given the data in a
    process of its own, turned, shifted and on another clock, and then again with changed data
    after some event, which must leave its answers before that as they were.

    Parameters
    ----------
    entry : str or class
        ``"module:Class"``, ``"path/to/file.py:Class"``, or a class or function at the head of a
        file.
    track : str
        One of `TRACKS`.
    trials : int
        The most of each search.
    seed : int
        Of what is random.
    folder : str or Path, optional
        With a recording of your own as files of CSV, which is taken instead of the track's.
    timeout : float
        How long an answer may take, s.
    say : callable, optional
        Is told what is being done.

    Raises
    ------
    EntryError
        If the entry fails, does not answer, may not do what it does, or is not causal.
    InswsnError
        If the track has no recording.

    Examples
    --------
    >>> from inswsn_lib import benchmark
    >>> benchmark.run("filters.py:Mine", track="network")
    Traceback (most recent call last):
        ...
    inswsn_lib.errors.ParameterError: entry must be in a file that exists, not 'filters.py:Mine'.
    """
    found = compare(
        [entry], track, trials=trials, seed=seed, folder=folder, timeout=timeout, say=say
    )
    return found[0]


def compare(
    entries: Sequence[str | Callable[..., Any]] = (), track: str = "network", *, trials: int = 24,
    seed: int = 0, folder: str | Path | None = None, timeout: float = 60.0, say: Say | None = None,
) -> list[Result]:  # fmt: skip
    """Judge several entries as `run` does; return their results, and those of the baselines.

    Parameters
    ----------
    entries : sequence of str or class
    track, trials, seed, folder, timeout, say
        As there.

    Examples
    --------
    >>> from inswsn_lib import benchmark
    >>> benchmark.compare(trials=0)
    Traceback (most recent call last):
        ...
    inswsn_lib.errors.ParameterError: trials must be a whole number of at least 1, not 0.
    """
    whole("trials", trials, 1)
    whole("seed", seed)
    number("timeout", timeout, above=0)
    mine = [find_entry(entry) for entry in entries]
    baselines = {find_entry(name): needs for name, needs in BASELINES.items()}
    courses, left_out = track_courses(track, folder)
    judged: dict[EntryName, dict[str, Scored]] = {}
    for course in courses:
        able = [name for name, needs in baselines.items() if needs in ("", *course.task.streams)]
        for name in dict.fromkeys([*mine, *able]):
            if say is not None:
                say(f"{course.name}: {name.shown}")
            done = _judge(name, course, trials, seed, timeout)
            judged.setdefault(name, {})[course.name] = done
    best = {}
    for course in courses:
        those = [name for name in baselines if course.name in judged.get(name, {})]
        best[course.name] = min(those, key=lambda n: judged[n][course.name].errors.rms)
    periods = {course.name: course.task.period for course in courses}
    results = []
    for name, of in judged.items():
        theirs = [judged[best[recording]][recording] for recording in of]
        pairs = [
            (each.errors.position, other.errors.position)
            for each, other in zip(of.values(), theirs, strict=True)
        ]
        ratio = mean_ratio(pairs, [periods[recording] for recording in of], seed)
        results.append(
            Result(
                name.shown, track, _commit(name), trials, seed, tuple(of.values()),
                tuple(best[recording].shown for recording in of), *ratio, left_out,
            )
        )  # fmt: skip
    return results


def _judge(name: EntryName, course: Course, trials: int, seed: int, timeout: float) -> Scored:
    """Tune an entry on the first part of a course, judge it on the rest, and hold it to causality.

    The trials share a process; each run that counts has a new one.
    """
    disguise = Disguise.drawn(seed, course.events[0].time)
    task = disguise.task(course.task)
    events = [disguise.event(event) for event in course.events]
    first = events[: len(course.first)]
    with EntryProcess(name, timeout) as process:
        causal, tunable = process.causal, process.tunable

        def loss(*values: float) -> float:
            numbers = dict(zip(tunable, values, strict=True))
            answers = process.answers(task, first, numbers)
            return _errors(name, course, course.tuning[: len(answers)], answers, disguise).rms

        log: tuple[tuple[tuple[float, ...], float], ...] = ()
        numbers: dict[str, float] = {}
        if tunable:
            starts, ratios = zip(*tunable.values(), strict=True)
            search = search_pattern(name.shown, starts, ratios, loss, most=trials)
            numbers = dict(zip(tunable, search.best, strict=True))
            log = tuple(zip(search.candidates, search.losses, strict=True))
    seconds = []

    def answers_to(given: Sequence[Event]) -> list[Answer | None]:
        with EntryProcess(name, timeout) as process:
            found = process.answers(task, given, numbers)
            seconds.append(process.seconds)
        kept.append(found)
        return found

    kept: list[list[Answer | None]] = []
    if causal:
        differs = first_difference(answers_to, events, seed)
        if differs is not None:
            after = differs - events[0].time
            raise EntryError(
                f"{name.shown} is not causal: data after it changed its answer "
                f"{after:.6g} s after the start of {course.name}."
            )
    else:
        answers_to(events)
    errors = _errors(name, course, course.judged, kept[0], disguise)
    return Scored(course.name, errors, numbers, log, 1e6 * seconds[0] / len(events), causal)


def _errors(
    name: EntryName, course: Course, rows: Mask, answers: Sequence[Answer | None],
    disguise: Disguise,
) -> Errors:  # fmt: skip
    """Return the errors at some questions, each of which must be answered."""
    where = np.flatnonzero(rows)
    if not where.size:
        raise InswsnError(f"{course.name} is too short for this track: no question is scored.")
    told = []
    for k in where.tolist():
        answer = answers[k]
        if answer is None:
            after = course.asked[k] - course.events[0].time
            raise EntryError(
                f"{name.shown} gave no answer {after:.6g} s after the start of {course.name}; "
                f"questions after {course.task.warm_up:.6g} s must be answered."
            )
        told.append(disguise.answer(answer))
    return errors_of(told, course.truth[where])


def _commit(name: EntryName) -> str:
    """Return the commit of an entry's checkout, or the version of the library."""
    released = f"inswsn {version('inswsn')}"
    try:
        done = subprocess.run(
            ["git", "-C", str(name.folder), "describe", "--always", "--dirty", "--exclude=*"],
            capture_output=True, text=True, check=False, timeout=10,
        )  # fmt: skip
    except (OSError, subprocess.TimeoutExpired):
        return released
    return done.stdout.strip() or released


def _known(value: float) -> float | None:
    return None if np.isnan(value) else float(value)
