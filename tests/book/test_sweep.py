"""A sweep: its grid, its files, what it refuses, and that it survives whatever is killed."""

from __future__ import annotations

import csv
import json
import os
import random
import signal
import subprocess
import sys
import time
from collections import Counter
from pathlib import Path
from typing import Any

import distributed
import psutil
import pytest
from conftest import MiniProject, make_mini, run_command
from inswsn_book.parameters import chapter_schema
from inswsn_book.project import Project
from inswsn_book.runs import lookup
from inswsn_book.sweep import read_sweep

from inswsn_lib.errors import ParameterError

# A core that takes its time, and tells each time that it is called
CORE = """
import os, time
from dataclasses import dataclass
import numpy as np
from inswsn_lib.errors import InswsnError
from inswsn_lib.evaluation import Scores

@dataclass
class Core:
    scale: float = 2.0

    def scores(self):
        with open(os.environ["MINI_LOG"], "a") as log:
            log.write(f"{self.scale}\\n")
        if self.scale == 13:
            raise InswsnError("Thirteen has no design.")
        time.sleep(float(os.environ.get("MINI_SECONDS", "0")))
        spread = np.linspace(0.9, 1.1, 41)
        return Scores(
            methods={"old": "the old one", "new": "the new one", "none": "nothing"},
            columns={"error": "m"},
            values={
                "old.error": self.scale * spread, "new.error": spread, "none.error": 99 * spread,
            },
            headline="error",
            baselines=frozenset({"none"}),
        )
"""
GRID = tuple(float(scale) for scale in range(2, 10))
WHOLE = os.environ.get("INSWSN_TESTS") == "whole"


class SweepProject:
    """A small project whose chapter has a core, and the command on it."""

    def __init__(self, mini: MiniProject, seconds: float = 0.0) -> None:
        self.project = mini
        source = mini.root / "chapters" / "00-mini.md"
        text = source.read_text(encoding="utf-8")
        named = text.replace("\n---\n", "\ncore: minicore:Core\n---\n", 1)
        source.write_text(named, encoding="utf-8")
        (mini.root / "minicore.py").write_text(CORE, encoding="utf-8")
        self.log = mini.root / "log.txt"
        paths = os.pathsep.join([str(mini.root), *filter(None, [os.environ.get("PYTHONPATH")])])
        self.environment = os.environ | {
            "PYTHONPATH": paths, "MINI_LOG": str(self.log), "MINI_SECONDS": str(seconds),
        }  # fmt: skip

    def words(self, *words: str) -> list[str]:
        return ["sweep", "00", *words, "--out", str(self.folder)]

    @property
    def folder(self) -> Path:
        return self.project.root / "made"

    def run(self, *words: str) -> subprocess.CompletedProcess[str]:
        return run_command(self.project.root, *self.words(*words), env=self.environment)

    def start(self, *words: str) -> subprocess.Popen[bytes]:
        command = [sys.executable, "-m", "inswsn_book", "--root", str(self.project.root)]
        return subprocess.Popen(
            [*command, *self.words(*words)], env=self.environment, cwd=self.project.root,
            stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
        )  # fmt: skip

    def calls(self) -> Counter[float]:
        """How often the core was called, by its parameter."""
        return Counter(map(float, self.log.read_text().split())) if self.log.exists() else Counter()

    def finished(self) -> set[float]:
        """The cells of the grid that are in the store."""
        sweep = read_sweep(self.project, self.project.find("00"), [grid()], [])
        pairs = zip(GRID, sweep.requests, strict=True)
        return {scale for scale, request in pairs if lookup(self.project, request) is not None}

    def table(self, name: str = "sweep") -> list[dict[str, str]]:
        with (self.folder / f"{name}.csv").open(encoding="utf-8", newline="") as stream:
            return list(csv.DictReader(stream))


def grid(values: tuple[float, ...] = GRID) -> str:
    return "scale=" + ",".join(f"{value:g}" for value in values)


@pytest.fixture
def swept(mini: MiniProject) -> SweepProject:
    return SweepProject(mini)


# The grid -----------------------------------------------------------------------------------------


def test_a_grid_goes_through_its_last_axis_fastest(project: Project) -> None:
    axes = ["q_scale=0.1,1", "seed=1,2"]
    sweep = read_sweep(project, project.find("02"), axes, ["runs=64"])
    assert sweep.core == "inswsn_lib.navigation:TrainingAreas"
    assert sweep.places[1] == {"q_scale": 0.1, "seed": 2}
    assert [request.parameters["seed"] for request in sweep.requests] == [1, 2, 1, 2]
    assert all(r.core and r.parameters["runs"] == 64 for r in sweep.requests)


@pytest.mark.parametrize("number", ["01", "02", "61", "90"])
def test_a_sweep_takes_what_a_run_takes(project: Project, number: str) -> None:
    schema = chapter_schema(project.root, number)
    for parameter in schema.parameters:
        if parameter.rule in ("a file", "a regressor"):
            continue
        sweep = read_sweep(
            project, project.find(number), [f"{parameter.name}={parameter.default}"], []
        )
        assert sweep.places == [{parameter.name: parameter.default}]


@pytest.mark.parametrize(
    ("axes", "settings"),
    [
        (["scale"], []),
        (["scale=1", "scale=2"], []),
        (["scale=1,1"], []),
        (["scale=1,1.0"], []),
        (["scale=0"], []),
        (["scale=1,two"], []),
        (["nothing=1"], []),
        (["scale=" + ",".join(str(1 + i / 1000) for i in range(10_001))], []),
        (["scale=1"], ["scale=2"]),
        ([], ["nothing=1"]),
    ],
)
def test_a_grid_that_may_not_be(mini: MiniProject, axes: list[str], settings: list[str]) -> None:
    with pytest.raises(ParameterError):
        read_sweep(mini, mini.find("00"), axes, settings)


# The command --------------------------------------------------------------------------------------


@pytest.mark.long
def test_what_a_sweep_of_a_core_leaves(swept: SweepProject) -> None:
    done = swept.run("--grid", "scale=0.5,4", "--jobs", "1")
    assert done.returncode == 0, done.stderr
    rows = swept.table()
    assert [(row["scale"], row["method"]) for row in rows] == [
        (scale, method) for scale in ("0.5", "4.0") for method in ("old", "new", "none")
    ]
    # 41 even numbers from 3.6 to 4.4: the quantiles 2.5 and 97.5 % are the second from each end
    assert rows[3] | {"low": "", "high": ""} == {
        "scale": "4.0", "method": "old", "column": "error", "quantity": "old.error", "unit": "m",
        "runs": "41", "value": "4.0", "low": "", "high": "",
    }  # fmt: skip
    assert (float(rows[3]["low"]), float(rows[3]["high"])) == pytest.approx((3.62, 4.38))
    leaders = swept.table("leaders")
    assert [(row["best"], row["next"]) for row in leaders] == [("old", "new"), ("new", "old")]
    assert float(leaders[0]["lead"]) == pytest.approx(50)
    facts = json.loads((swept.folder / "sweep.json").read_text())
    assert (facts["core"], facts["grid"]) == ("minicore:Core", {"scale": [0.5, 4.0]})
    figure = (swept.folder / "sweep.svg").read_text()
    assert figure.startswith("<?xml")
    assert "the old one" not in done.stderr  # the terminal has keys, the figure has words
    again = swept.run("--grid", "scale=0.5,4,8", "--jobs", "1")
    assert "1 cells computed, 2 were there." in again.stdout
    assert swept.calls() == {0.5: 1, 4.0: 1, 8.0: 1}
    fresh = swept.run("--grid", "scale=0.5", "--jobs", "1", "--fresh")
    assert fresh.returncode == 0
    assert not (swept.folder / "sweep.svg").exists(), "one value makes no line"
    assert swept.calls()[0.5] == 2


@pytest.mark.long
def test_a_cell_that_is_refused_fails_and_the_others_go_on(swept: SweepProject) -> None:
    done = swept.run("--grid", "scale=1,13,20", "--jobs", "2")
    assert done.returncode == 1
    assert "scale=13.0: failed: Thirteen has no design." in done.stderr
    assert swept.table("failed") == [{"scale": "13.0", "reason": "Thirteen has no design."}]
    assert {row["scale"] for row in swept.table()} == {"1.0", "20.0"}
    assert swept.run("--grid", "scale=1,13,20").returncode == 1
    assert swept.calls() == {1.0: 1, 13.0: 2, 20.0: 1}
    assert swept.run("--grid", "scale=1,20").returncode == 0
    assert not (swept.folder / "failed.csv").exists()


@pytest.mark.long
def test_a_chapter_without_a_core_is_executed(mini: MiniProject) -> None:
    out = mini.root / "made"
    done = run_command(mini.root, "sweep", "00", "--grid", "scale=1,3", "--out", str(out))
    assert done.returncode == 0, done.stderr
    assert (out / "sweep.csv").read_text() == (
        "scale,quantity,unit,runs,value,low,high\n1.0,twice,m,1,21.0,,\n3.0,twice,m,1,63.0,,\n"
    )
    # a run of the same parameters finds it
    shown = run_command(mini.root, "run", "00", "-p", "scale=3")
    assert "unchanged" in shown.stderr


@pytest.mark.parametrize(
    "words",
    [
        ("--grid", "scale=0"),
        ("--runs", "100"),
        ("--dask", "tcp://127.0.0.1:1", "--grid", "scale=1"),
        ("--dask", "nowhere", "--jobs", "2"),
        ("--jobs", "0"),
    ],
)
def test_one_sentence_and_status_2(swept: SweepProject, words: tuple[str, ...]) -> None:
    done = swept.run(*words)
    assert done.returncode == 2
    assert "Traceback" not in done.stderr
    assert not swept.folder.exists()


def test_a_folder_with_other_files_is_left_alone(swept: SweepProject) -> None:
    swept.folder.mkdir()
    (swept.folder / "mine.txt").write_text("mine")
    done = swept.run("--grid", "scale=1")
    assert (done.returncode, "--out" in done.stderr) == (2, True)
    assert [path.name for path in swept.folder.iterdir()] == ["mine.txt"]


# A cluster ----------------------------------------------------------------------------------------


@pytest.mark.long
def test_workers_that_would_find_other_numbers_are_refused(
    swept: SweepProject, monkeypatch: pytest.MonkeyPatch
) -> None:
    # whether there is a folder of recorded data is a part of the key
    swept.environment["INSWSN_DATA"] = ""
    for name, value in swept.environment.items():
        monkeypatch.setenv(name, value)
    monkeypatch.syspath_prepend(swept.project.root)
    options: dict[str, Any] = {"memory_limit": 0, "dashboard_address": ":0", "n_workers": 1}
    words = ("--grid", "scale=1,3")
    with distributed.LocalCluster(threads_per_worker=1, **options) as cluster:
        address = cluster.scheduler_address
        done = swept.run(*words, "--dask", address)
        assert done.returncode == 0, done.stderr
        assert swept.calls() == {1.0: 1, 3.0: 1}
        swept.environment["INSWSN_DATA"] = str(swept.project.root)
        other = swept.run(*words, "--dask", address)
        assert (other.returncode, "another library" in other.stderr) == (2, True)
    with distributed.LocalCluster(threads_per_worker=2, **options) as cluster:
        swept.environment["INSWSN_DATA"] = ""
        two = swept.run("--grid", "scale=5", "--dask", cluster.scheduler_address)
        assert (two.returncode, "has 2 threads" in two.stderr) == (2, True)


# What is killed -----------------------------------------------------------------------------------

SECONDS = 0.15  # of a cell


@pytest.fixture(scope="module")
def undisturbed(tmp_path_factory: pytest.TempPathFactory) -> tuple[bytes, float]:
    """The table of a sweep that nobody disturbed, and how long it took."""
    swept = SweepProject(make_mini(tmp_path_factory.mktemp("undisturbed") / "mini"), SECONDS)
    began = time.monotonic()
    assert swept.start("--grid", grid(), "--jobs", "2").wait(400) == 0
    return (swept.folder / "sweep.csv").read_bytes(), time.monotonic() - began


def workers_of(process: subprocess.Popen[bytes]) -> list[psutil.Process]:
    """The processes that compute, of a command that may be ending."""
    try:
        children = psutil.Process(process.pid).children(recursive=True)
        return [child for child in children if "spawn_main" in " ".join(child.cmdline())]
    except psutil.NoSuchProcess:
        return []


@pytest.mark.long
@pytest.mark.parametrize("moment", range(10) if WHOLE else range(1))
@pytest.mark.parametrize("killed", ["parent", "worker", "both"])
def test_it_survives_whatever_is_killed(
    mini: MiniProject, undisturbed: tuple[bytes, float], killed: str, moment: int
) -> None:
    expected, duration = undisturbed
    swept, chance = SweepProject(mini, SECONDS), random.Random(f"{killed} {moment}")
    process = swept.start("--grid", grid(), "--jobs", "2")
    time.sleep(chance.uniform(0, duration))
    finished, calls = swept.finished(), swept.calls()
    workers = workers_of(process)
    if killed != "parent" and workers:
        chance.choice(workers).send_signal(signal.SIGKILL)
    if killed == "worker":
        assert process.wait(400) == 0
    else:
        process.kill()
        process.wait(10)
        # nobody computes on without the command
        assert not psutil.wait_procs(workers, timeout=20)[1]
        finished, calls = swept.finished(), swept.calls()
    assert swept.start("--grid", grid(), "--jobs", "2").wait(400) == 0
    assert (swept.folder / "sweep.csv").read_bytes() == expected
    again = swept.calls() - calls
    assert not finished & set(again), "a finished cell was computed again"
    assert set(GRID) <= set(swept.calls())
