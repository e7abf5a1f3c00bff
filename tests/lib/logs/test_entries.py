"""An entry of one's own on the ladder of a recording: what it gets, and what it may not do."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from made_recording import made, made_imu

from inswsn_lib.errors import InswsnError
from inswsn_lib.inertial import Start
from inswsn_lib.logs import Answer, Event, Ladder, Task, judge
from inswsn_lib.logs.ladder import NETWORK

MINE = """
from inswsn_lib.logs import Answer


class Mine:
    numbers = {"share": 0.5}

    def __init__(self, task):
        self.share, self.at = min(task.numbers["share"], 1), None

    def step(self, event):
        if event.kind == "fix":
            new = event.values[:2]
            self.at = new if self.at is None else self.at + self.share * (new - self.at)
        return Answer(self.at) if event.kind == "ask" and self.at is not None else None
"""


@pytest.fixture(scope="module")
def ladder() -> Ladder:
    recording = replace(made(4, seconds=40.0), imu=made_imu(4, seconds=40.0))
    found = Ladder(recording, begins=1)
    vars(found)["rungs"] = {}
    vars(found)["difference"] = None
    vars(found.filters)["start"] = Start(8.0, None, np.eye(15))
    vars(found)["alone"] = found.network
    return found


class LastFix:
    """The network alone, which the ladder has as well."""

    def __init__(self, task: Task) -> None:
        self.task, self.last, self.kinds = task, np.zeros(2), set[str]()

    def step(self, event: Event) -> Answer | None:
        self.kinds.add(event.kind)
        if event.kind == "fix":
            self.last = event.values[:2]
        return Answer(self.last) if event.kind == "ask" else None


def test_the_last_fix_is_the_network(ladder: Ladder) -> None:
    table = judge(LastFix, ladder, seed=0)
    columns = ["position", "position_ratio", "position_low"]
    assert table.loc["LastFix", columns].tolist() == table.loc[NETWORK, columns].tolist()
    assert np.isnan(table.loc["LastFix", "velocity"])


def test_an_entry_from_a_file_has_its_numbers_tuned(ladder: Ladder, tmp_path: Path) -> None:
    (tmp_path / "mine.py").write_text(MINE, encoding="utf-8")
    table = judge(f"{tmp_path / 'mine.py'}:Mine", ladder, seed=0)
    # what goes at half a metre a second cannot be averaged for long
    assert 0.5 < table.loc["Mine", "position_ratio"] < 1.05


def test_events_come_in_order_and_the_question_last(ladder: Ladder) -> None:
    seen: list[Event] = []

    class Listens(LastFix):
        def step(self, event: Event) -> Answer | None:
            seen.append(event)
            return super().step(event)

    made_of: list[Task] = []

    def entry(task: Task) -> Listens:
        made_of.append(task)
        seen.clear()
        return Listens(task)

    judge(entry, ladder, seed=0)
    assert made_of[0].streams == ("fix", "imu", "range")
    keys = [(event.time, event.kind == "ask") for event in seen]
    assert keys == sorted(keys)
    assert {event.values.shape for event in seen if event.kind == "imu"} == {(6,)}


def test_who_looks_ahead_is_told(ladder: Ladder) -> None:
    """It keeps what it saw in another run."""
    kept: list[Any] = []

    class Remembers(LastFix):
        def step(self, event: Event) -> Answer | None:
            answer = super().step(event)
            if event.kind == "ask":
                kept.append(event.time)
                return Answer(self.last + 1e-9 * len(kept))
            return answer

    with pytest.raises(InswsnError, match=r"^Remembers is not causal: data after"):
        judge(Remembers, ladder, seed=3)


def test_what_an_entry_must_be() -> None:
    with pytest.raises(InswsnError, match="has no reference"):
        judge(LastFix, replace(made(1), imu=made_imu(1), reference=None))
    for entry, says in (
        ("mine.txt", "path/to/file.py:Class, not 'mine.txt'"),
        ("nowhere.py:Mine", "in a file that exists, not 'nowhere.py:Mine'"),
    ):
        with pytest.raises(InswsnError, match=f"^entry must be {says}"):
            judge(entry, Ladder(made(1)))


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("import nothing_of_that_name", "does not give Mine: ModuleNotFoundError"),
        ("Mine = 3", "entry must be a class, or a function of a Task"),
        (MINE.replace('{"share": 0.5}', "[1]"), "numbers must be a mapping"),
        (MINE.replace("0.5}", "-1}"), r"numbers\['share'\] must be"),
        (MINE.replace("Answer(self.at) if", "self.at if"), "must be an Answer or None"),
        (MINE.replace("Answer(self.at) if", "Answer(3.0) if"), "position must be"),
        (MINE.replace('"ask" and', '"never" and'), "Mine gives no answer"),
        (MINE.replace("(self.at) if", "(self.at, None, [[1, 0], [0, 1]][: int(event.time > 9) * 2]"
                      " or None) if"), "covariance must be in every answer, or in none, not"),
    ],
)  # fmt: skip
def test_an_entry_that_does_not_fit_is_told_in_a_sentence(
    ladder: Ladder, tmp_path: Path, text: str, says: str
) -> None:
    (tmp_path / "mine.py").write_text(text, encoding="utf-8")
    with pytest.raises(InswsnError, match=says):
        judge(f"{tmp_path / 'mine.py'}:Mine", ladder, seed=0)
