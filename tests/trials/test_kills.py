"""Whether a build and a sweep that are killed at any moment go on as if nothing had been.

Nothing computes on without the command, nothing is computed twice, no folder stays, and what comes
of it in the end is the same, bit for bit.
"""

from __future__ import annotations

import os
import random
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any

import psutil
import pytest
from inswsn_book.make.sweep import read_sweep
from inswsn_book.record.project import Project
from inswsn_book.run.store import lookup

GRID = "2,3,4,5,6,7,8,9"
# A core is found that is not installed, as that of no chapter is
COMMAND = "import sys; sys.path.append('.'); from inswsn_book.__main__ import main; main()"


def start(root: Path, words: list[str], **variables: str) -> subprocess.Popen[bytes]:
    """Start the command, as a user does."""
    return subprocess.Popen(
        [sys.executable, "-I", "-c", COMMAND, *words], cwd=root, env=os.environ | variables,
        stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, start_new_session=True,
    )  # fmt: skip


def below(process: subprocess.Popen[bytes], word: str = "") -> list[psutil.Process]:
    """Return what a command has started, and the word is in the command of."""
    found = []
    with suppress(psutil.NoSuchProcess):
        for child in psutil.Process(process.pid).children(recursive=True):
            with suppress(psutil.NoSuchProcess):  # it may be ending
                found += [child] if word in " ".join(child.cmdline()) else []
    return found


def end(process: subprocess.Popen[bytes], how: signal.Signals) -> None:
    """End a command; what it has started ends with it."""
    others = below(process)
    process.send_signal(how)
    process.wait(60)
    left = psutil.wait_procs(others, timeout=300)[1]
    assert not left, f"{how.name} left {left} running"


def left_by(process: subprocess.Popen[bytes], root: Path) -> list[Path]:
    """Return the folders that a command left behind."""
    places = (Path(tempfile.gettempdir()), root, root / "_build")
    return [path for place in places for path in place.glob(f".inswsn-*-{process.pid}-*")]


@pytest.mark.whole
def test_what_is_killed_goes_on(
    mini: Any,
    sweep_project: Callable[[str], Any],
    size: Callable[[int, int], int],
    seed: int,
    tell: Callable[[str], None],
    what_stays: Callable[[Project], list[object]],
) -> None:
    number, began = size(1, 20), time.monotonic()
    kill_builds(mini.root, number, random.Random(seed), what_stays)
    kill_sweeps(sweep_project, number, random.Random(seed))
    tell(
        f"{number} of {number} kills of a build and {number} of {number} of a sweep resumed bit "
        "for bit; no process and no folder was left, and no finished cell computed twice, in "
        f"{time.monotonic() - began:.0f} s"
    )


def kill_builds(
    source: Path, number: int, chance: random.Random, what_stays: Callable[[Project], list[object]]
) -> None:
    """Kill a build at so many moments; the first one is not disturbed."""
    stays, seconds = [], 0.0
    for kill in range(1 + number):
        project = Project(shutil.copytree(source, source.parent / f"{kill}"))
        began, how = time.monotonic(), chance.choice([signal.SIGKILL, signal.SIGTERM])
        process = start(project.root, ["book"])
        if kill:
            time.sleep(chance.uniform(0, seconds))
            end(process, how)
            killed, process = process, start(project.root, ["book"])
        assert process.wait(400) == 0
        seconds = seconds or time.monotonic() - began
        stays.append(what_stays(project))
        assert not kill or left_by(killed, project.root) == []
    assert all(found == stays[0] for found in stays)


def kill_sweeps(sweep_project: Callable[[str], Any], number: int, chance: random.Random) -> None:
    """Kill the command, a process that computes, or both; the first sweep is not disturbed."""
    table, seconds, cells = b"", 0.0, len(GRID.split(","))
    for kill in range(1 + number):
        swept = sweep_project(f"swept-{kill}")
        words = swept.words(GRID, "--jobs", "2")
        variables = {"MINI_LOG": str(swept.log), "MINI_SECONDS": "0.15"}
        began, process = time.monotonic(), start(swept.project.root, words, **variables)
        if kill:
            killed, calls = chance.choice(["command", "worker", "both"]), swept.calls()
            time.sleep(chance.uniform(0, seconds))
            workers = below(process, "spawn_main")
            if killed != "command" and workers:
                with suppress(psutil.NoSuchProcess):
                    chance.choice(workers).kill()
            if killed != "worker":
                end(process, signal.SIGKILL)
                there, calls = finished(swept), swept.calls()
                ended, process = process, start(swept.project.root, words, **variables)
        assert process.wait(400) == 0
        seconds, found = seconds or time.monotonic() - began, (swept.folder / "sweep.csv")
        table = table or found.read_bytes()
        assert found.read_bytes() == table
        assert len(finished(swept)) == len(swept.calls()) == cells
        if kill and killed != "worker":
            assert not there & set(swept.calls() - calls), "a finished cell was computed again"
            assert left_by(ended, swept.project.root) == []


def finished(swept: Any) -> set[float]:
    """The cells of the grid that are in the store."""
    mini = swept.project
    requests = read_sweep(mini, mini.find("00"), [f"scale={GRID}"], []).requests
    return {r.parameters["scale"] for r in requests if lookup(mini, r) is not None}
