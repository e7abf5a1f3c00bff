"""Whole runs on a small recording, by entries whose result is known."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
from made_recording import made_drive

from inswsn_lib.benchmark import EntryError, Result, compare, run, running
from inswsn_lib.errors import ParameterError
from inswsn_lib.recordings import write_csv

NETWORK = "inswsn_lib.benchmark.baselines:Network"
HEAD = """
import os
from dataclasses import replace
import numpy as np
from inswsn_lib.benchmark import Answer
from inswsn_lib.benchmark.baselines import Network
"""
ENTRIES = {
    "Same": "class Same(Network): pass",
    "Off": """
class Off(Network):
    def answer(self, time):
        return replace(super().answer(time), position=super().answer(time).position + [0, 1000])
""",
    "Tuned": """
class Tuned(Network):
    tunable = {"away": (1.0, 2.0), "other": (1.0, 2.0)}
    def answer(self, time):
        away = self.fixes.task.numbers["away"] - 4
        return replace(super().answer(time), position=super().answer(time).position + [away, 0])
""",
    "Chance": """
class Chance(Network):
    def answer(self, time):
        off = int.from_bytes(os.urandom(4), "little") / 2**32
        return replace(super().answer(time), position=super().answer(time).position + [off, 0])
""",
    "Silent": "class Silent:\n    def __init__(self, task): pass\n    def step(self, event): pass",
    "Remembers": """
class Remembers:
    def __init__(self, task):
        self.track = np.loadtxt(os.path.join(os.path.dirname(__file__), "track.txt"))
    def step(self, event):
        if event.kind == "ask":
            return Answer([np.interp(event.time, self.track[:, 0], x) for x in self.track.T[1:]])
""",
    "Smoother": """
class Smoother(Network):
    causal = False
    def __init__(self, task, events):
        super().__init__(task)
        self.later = len([event for event in events if event.kind == "ask"])
    def answer(self, time):
        return Answer([self.later, 0.0])
""",
    "function": "def function(task):\n    return Network(task)",
}


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A recording of 24 s and entries in a file; the network is the one baseline, to be quick."""
    monkeypatch.setattr(running, "BASELINES", {NETWORK: ""})
    recording = made_drive(1, seconds=24.0)
    write_csv(recording, tmp_path / "drive")
    own = tmp_path / "own"
    own.mkdir()
    (own / "mine.py").write_text(HEAD + "\n\n".join(ENTRIES.values()), encoding="utf-8")
    assert recording.reference is not None
    track = np.column_stack([recording.reference.time, recording.reference.position])
    np.savetxt(own / "track.txt", track)
    return tmp_path


def judge(folder: Path, name: str, trials: int = 2) -> Result:
    return run(f"{folder / 'own' / 'mine.py'}:{name}", trials=trials, folder=folder / "drive")


def test_what_is_as_good_as_the_best_is_level(folder: Path) -> None:
    found = judge(folder, "Same")
    assert (found.ratio, found.low, found.high, found.word) == (1.0, 1.0, 1.0, "level")
    assert found.best == (NETWORK,)
    assert found.entry == "mine.py:Same"
    assert found.causal
    assert found.judged[0].cost > 0
    assert found.consistency == "no covariance"
    assert re.fullmatch(r"inswsn \S+|[0-9a-f]{7,}(-dirty)?", found.commit)


def test_what_is_a_kilometre_off_is_behind_by_that(folder: Path) -> None:
    """The error of the network beside 1 km can be left out to a thousandth."""
    found = judge(folder, "Off")
    assert found.judged[0].errors.rms == pytest.approx(1000, rel=5e-3)
    network = found.judged[0].errors.rms / found.ratio
    assert 0.02 < network < 5
    assert found.word == "behind"


def test_numbers_are_tuned_with_the_trials_that_there_are(folder: Path) -> None:
    """From 1 by factors of two to 4; the other number changes nothing."""
    found = judge(folder, "Tuned", trials=9).judged[0]
    assert found.numbers["away"] == 4.0
    assert len(found.log) == 9
    assert min(found.log, key=lambda trial: trial[1])[0][0] == 4.0
    few = judge(folder, "Tuned", trials=2).judged[0]
    assert [numbers for numbers, _ in few.log] == [(1.0, 1.0), (2.0, 1.0)]


def test_what_changes_from_run_to_run_is_refused(folder: Path) -> None:
    with pytest.raises(EntryError, match=r"Chance is not causal: data after it changed its answer"):
        judge(folder, "Chance")


def test_who_does_not_answer_is_refused(folder: Path) -> None:
    with pytest.raises(EntryError, match=r"Silent gave no answer .* questions after 3\.\d+ s must"):
        judge(folder, "Silent")


def test_the_track_by_heart_does_not_fit(folder: Path) -> None:
    """It is turned, shifted and at another time: tens of metres away, on a track of metres."""
    found = judge(folder, "Remembers")
    assert found.word == "behind"
    assert found.judged[0].errors.rms > 10


def test_who_is_given_all_is_told_from_who_is_not(folder: Path) -> None:
    """It knows of all questions when it answers the first."""
    found = judge(folder, "Smoother")
    assert not found.causal
    assert found.row()["causal"] is False


def test_a_function_may_be_an_entry_and_all_are_compared(folder: Path) -> None:
    name = f"{folder / 'own' / 'mine.py'}:function"
    mine, network = compare([name], folder=folder / "drive", seed=3)
    assert (mine.entry, network.entry) == ("mine.py:function", NETWORK)
    assert mine.ratio == network.ratio == 1.0
    assert mine.row()["recordings"][0]["position"] == network.judged[0].errors.rms


def test_mistakes_are_told_before_anything_runs() -> None:
    for given, said in (
        ({"trials": 0}, "trials"),
        ({"seed": -1}, "seed"),
        ({"timeout": 0}, "time"),
    ):
        with pytest.raises(ParameterError, match=said):
            run(NETWORK, **given)  # type: ignore[arg-type]
