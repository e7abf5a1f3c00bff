"""The command `inswsn benchmark`, the rows that it keeps, and the page that shows them."""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from conftest import Done, MiniProject
from inswsn_book.leaderboard import LEADERBOARD, keep_rows, result_lines
from inswsn_book.project import Project
from made_recording import made, made_imu

from inswsn_lib.benchmark import TRACKS, Result, running
from inswsn_lib.benchmark.courses import make_course
from inswsn_lib.benchmark.running import Scored
from inswsn_lib.benchmark.scoring import Errors

NETWORK = "inswsn_lib.benchmark.baselines:Network"


def result(entry: str = "mine.py:Mine", *, causal: bool = True, nees: float = 1.25) -> Result:
    errors = Errors(np.full(3, 0.04), 0.5, nees)
    judged = Scored("inrol/1", errors, {"gain": 2.0}, (((2.0,), 0.25),), 123.4, causal=causal)
    return Result(
        entry,
        "network",
        "abc1234",
        24,
        0,
        (judged,),
        (NETWORK,),
        0.8,
        0.7,
        0.9,
        ("x is left out.",),
    )


@pytest.fixture
def small(monkeypatch: pytest.MonkeyPatch) -> None:
    """One made recording in place of the track's, and the network for a baseline."""
    recording = replace(made(2, seconds=12.0, rate=120.0), imu=made_imu(2, seconds=12.0))
    course = make_course(recording, TRACKS["two-clusters"])
    monkeypatch.setattr(running, "track_courses", lambda *_: ([course], ()))
    monkeypatch.setattr(running, "BASELINES", {NETWORK: ""})


def test_a_result_is_told_in_lines() -> None:
    assert result_lines(result()) == [
        "mine.py:Mine on network, 24 trials, abc1234",
        "    inrol/1: 0.2 m, 0.5 m/s; best of the baselines: Network",
        "    ahead: 0.8 of its error, 0.7 to 0.9; consistent (NEES 1.2); 123 us a step; causal",
        "    x is left out.",
    ]
    lines = result_lines(result(causal=False, nees=np.nan))
    assert lines[2].endswith("no covariance; 123 us a step; not causal")


def test_rows_are_kept_once_for_each_entry_and_track(mini: MiniProject) -> None:
    project = Project(mini.root)
    keep_rows(project, [result(), result("other")])
    keep_rows(project, [result(nees=3.0)])
    rows = json.loads((mini.root / LEADERBOARD).read_text(encoding="utf-8"))["rows"]
    assert [(row["entry"], row["consistency"]) for row in rows] == [
        ("mine.py:Mine", "inconsistent"),
        ("other", "consistent"),
    ]
    assert rows[0]["recordings"][0]["log"] == [[[2.0], 0.25]]
    assert rows[0]["made"]["inswsn"]


@pytest.mark.usefixtures("small")
def test_what_contributing_says_of_entering_is_so(
    root: Path, mini: MiniProject, inswsn: Callable[..., Done]
) -> None:
    """Its file, its command, in ten lines."""
    text = (root / "CONTRIBUTING.md").read_text(encoding="utf-8")
    section = text.partition("## Enter the benchmark")[2].partition("\n## ")[0]
    code = re.findall(r"```python\n(.*?)```", section, re.DOTALL)[0]
    assert len([line for line in code.splitlines() if line]) == 10
    (words,) = re.findall(r"`\.venv/bin/inswsn (benchmark .*?)`", section)
    (mini.root / "mine.py").write_text(code, encoding="utf-8")
    done = inswsn(mini.root, *words.split(), "--trials", "2", "--keep")
    assert done.returncode == 0, done.stderr
    first, *_, last = done.stdout.splitlines()
    assert first.startswith("mine.py:Mine on two-clusters, 2 trials")
    assert last == f"wrote {LEADERBOARD}"
    rows = json.loads((mini.root / LEADERBOARD).read_text(encoding="utf-8"))["rows"]
    assert {row["entry"] for row in rows} == {"mine.py:Mine", NETWORK}


@pytest.mark.usefixtures("small")
def test_an_entry_that_fails_is_told_in_one_sentence(
    mini: MiniProject, inswsn: Callable[..., Done]
) -> None:
    (mini.root / "mine.py").write_text("def mine(task): raise ValueError('no')", encoding="utf-8")
    done = inswsn(mini.root, "benchmark", "mine.py:mine", "--keep")
    assert done.returncode == 2
    assert done.stdout == ""
    said = "inswsn: mine.py:mine failed: ValueError: no (line 1 of mine.py)."
    assert done.stderr.splitlines()[-1] == said
    assert not (mini.root / LEADERBOARD).exists()


def test_the_page_shows_rows_and_those_that_are_not_causal_last(render: Callable[..., str]) -> None:
    rows = []
    for each in (result("b", causal=False), result("a:Best"), result("c", nees=np.nan)):
        made_of = {"day": "2026-01-02", "python": "3.11", "cpu": "some"}
        rows.append(each.row() | {"made": made_of})
    text = render("benchmarks", leaderboard={"rows": rows})
    table = text.partition(":name: tbl-leaderboard-network")[2].partition(":::::")[0]
    assert re.findall(r"^\* - (.+)$", table, re.MULTILINE) == [
        "entry",
        "Best",
        "c",
        "b (not causal)",
    ]
    assert "0.8 (0.7 to 0.9), ahead" in table
    assert "–, no covariance" in table
    assert "tbl-leaderboard-vehicle" not in text


def test_the_page_of_this_checkout_has_every_track(render: Callable[..., str]) -> None:
    text = render("benchmarks")
    assert [track for track in TRACKS if f"tbl-leaderboard-{track}" not in text] == []
