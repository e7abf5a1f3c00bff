"""Sweeps: the same numbers however they are shared out, kept whatever ends the command."""

from __future__ import annotations

import io
import json
import os
import signal
import sqlite3
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from concurrent.futures import Future
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
import scipy
from conftest import MiniProject, run_command
from hypothesis import given
from hypothesis import strategies as st
from inswsn_book import sweep_tasks
from inswsn_book.experiments import find_experiment
from inswsn_book.experiments.networked import NETWORKED
from inswsn_book.parameters import read_schema
from inswsn_book.project import MODULES_VARIABLE, Project
from inswsn_book.sweep import ATTEMPTS, run_sweep
from inswsn_book.sweep_grid import read_grid
from inswsn_book.sweep_plan import Plan, make_plan
from inswsn_book.sweep_progress import SweepProgress
from inswsn_book.sweep_results import Finished
from inswsn_book.sweep_store import STORE, Store
from inswsn_book.sweep_tasks import (
    Outcome,
    Task,
    code_state,
    compute_groups,
    library_state,
    unpacked,
    worker_state,
)
from inswsn_book.sweep_workers import (
    DaskWorkers,
    WorkerDiedError,
    check_workers,
    local_workers,
)
from rich.console import Console

from inswsn_lib.errors import BuildError, InswsnError, ParameterError
from inswsn_lib.evaluation import GROUP, monte_carlo

# An experiment with every trouble that a cell may have. It leaves a letter for each group that it
# draws, and its process a file with its number.
OWN = '''
import os
import time
from pathlib import Path

import numpy as np

from inswsn_lib.errors import ParameterError
from inswsn_book.experiments import Experiment
from inswsn_book.parameters import read_schema

HERE = Path(__file__).parent


def leave(name, text="x"):
    with (HERE / name).open("a") as stream:
        stream.write(text)
    return len((HERE / name).read_text())


class Numbers:
    def __init__(self, values, inputs):
        self.values = values

    def draw(self, rng, runs):
        leave("draws")
        leave(f"process-{os.getpid()}")
        time.sleep(self.values["pause"])
        return {"x": self.values["spread"] * rng.standard_normal((5, runs))}

    def judge(self, values):
        trouble = values["trouble"]
        if trouble == "exit":
            raise SystemExit(0)
        if trouble == "refuse":
            raise ParameterError("told", values["told"], "something else")

        def judged(drawn):
            if trouble == "raise" or (trouble == "raise-twice" and leave("raised") <= 2):
                raise RuntimeError("no luck")
            fatal = trouble == "die" or (trouble == "die-of-1" and values["seed"] == 1)
            if fatal or (trouble == "die-once" and leave("died") <= 1):
                os._exit(7)
            if trouble == "spoil":
                drawn["x"] *= 0
            mean = abs(drawn["x"].mean(axis=0) - values["told"])
            if trouble == "nan":
                mean[3] = np.nan
            median = abs(np.median(drawn["x"], axis=0) - values["told"])
            return {"mean.error": mean, "median.error": median}

        return judged


EXPERIMENT = Experiment(
    title="Mean against median",
    schema=read_schema("""
# Seed of all random numbers.
seed: int = 5  # 1; in [0, 1000]
# Standard deviation of a number.
spread: float = 1.0  # m; in (0, inf)
# What is told.
told: float = 0.0  # m; any
# What goes wrong.
trouble: str = "none"  # 1; one of none, refuse, raise, raise-twice, die, die-once, die-of-1, nan, \
spoil, exit
# How long a group takes.
pause: float = 0.0  # s; in [0, 10]
"""),
    begin=Numbers,
    methods={"mean": "the mean", "median": "the median"},
    columns={"error": "m"},
    headline="error",
    told=frozenset({"told", "trouble"}),
)
'''


class Own:
    """A small checkout, and a folder with a module of one's own."""

    def __init__(self, mini: MiniProject, folder: Path) -> None:
        self.project, self.folder = mini, folder
        folder.mkdir()
        # a name of its own, since workers of pytest import many of them
        self.module = f"own_{folder.parent.name.replace('-', '_')}"
        (folder / f"{self.module}.py").write_text(OWN)
        self.name = f"{self.module}:EXPERIMENT"

    def plan(self, *axes: str, runs: int = 200, settings: tuple[str, ...] = ()) -> Plan:
        return make_plan(self.project, self.name, axes, settings, runs)

    def run(self, plan: Plan, out: Path, **options: Any) -> Finished:
        progress = SweepProgress(Console(file=io.StringIO()))
        return run_sweep(self.project, plan, progress, out=out, **options)

    def draws(self) -> int:
        """Return how many groups were drawn since the last call."""
        file = self.folder / "draws"
        count = len(file.read_text()) if file.exists() else 0
        file.unlink(missing_ok=True)
        return count

    def command(self, *words: str, **options: Any) -> subprocess.CompletedProcess[str]:
        return run_command(self.project.root, "sweep", self.name, *words, **options)


@pytest.fixture
def own(mini: MiniProject, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Own]:
    monkeypatch.setenv(MODULES_VARIABLE, str(tmp_path / "modules"))
    monkeypatch.setattr(sys, "path", [*sys.path, str(tmp_path / "modules")])
    made = Own(mini, tmp_path / "modules")
    yield made
    sys.modules.pop(made.module, None)


class InThisProcess:
    """Workers that compute when they are asked; a death is an exception."""

    def __init__(self, tamper: Callable[[Outcome], Outcome] = lambda outcome: outcome) -> None:
        self._tamper = tamper
        self.tasks: list[Task] = []

    def look(self) -> str:
        return ""

    def size(self) -> int:
        return 1

    def has_room(self) -> bool:
        return True

    def submit(self, compute: Callable[[Task], Outcome], task: Task) -> Future[Outcome]:
        self.tasks.append(task)
        future: Future[Outcome] = Future()
        future.set_result(self._tamper(compute(task)))
        return future

    def outcome(self, future: Future[Outcome]) -> Outcome:
        return future.result()


def contents(plan: Plan, folder: Path) -> list[dict[str, np.ndarray]]:
    """Return what the store holds of each cell."""
    assert plan.experiment is not None
    with Store(folder, plan.made_from) as store:
        return [
            unpacked(plan.experiment, store.read(cell, plan.parts), plan.runs)
            for cell in range(len(plan.grid.cells()))
        ]


GRID = ("spread=1,2", "told=0,0.5")


def in_one_call(plan: Plan) -> list[dict[str, np.ndarray]]:
    assert plan.experiment is not None
    return [plan.experiment.run(values, plan.runs) for values in plan.grid.cells()]


@pytest.mark.parametrize("block", [1, 2, 3, 100])
def test_a_sweep_is_one_call_of_monte_carlo_in_any_blocks(
    own: Own, tmp_path: Path, block: int
) -> None:
    plan = own.plan(*GRID, runs=300)
    done = own.run(plan, tmp_path / "out", block=block, workers=InThisProcess())
    assert own.draws() == 2 * 5  # cells that differ in what is told share their runs
    assert (done.computed, done.kept, done.failed) == (4 * 5 * GROUP, 0, {})
    for found, expected in zip(contents(plan, done.folder), in_one_call(plan), strict=True):
        assert found.keys() == expected.keys()
        for name, values in expected.items():
            assert np.array_equal(found[name], values)


def test_a_sweep_is_the_same_in_any_number_of_processes(own: Own, tmp_path: Path) -> None:
    plan = own.plan(*GRID, runs=300)
    own.run(plan, tmp_path / "one", workers=InThisProcess())
    own.run(plan, tmp_path / "two", jobs=2, block=1)
    tables = [(tmp_path / name / "sweep.csv").read_bytes() for name in ("one", "two")]
    assert tables[0] == tables[1]
    assert len(list(own.folder.glob("process-*"))) == 3  # this one, and two others
    table = pd.read_csv(tmp_path / "one" / "sweep.csv")
    assert list(table.columns) == [
        "spread", "told", "method", "quantity", "unit", "runs", "mean", "standard_error", "median",
        "low", "high",
    ]  # fmt: skip
    # by hand: the mean of five standard normal numbers is of size sqrt(2 / (5 pi))
    first = table.iloc[0]
    assert first["mean"] == pytest.approx(np.sqrt(2 / (5 * np.pi)), abs=4 * first["standard_error"])
    drawn = (tmp_path / "one" / "sweep.svg").read_text()
    assert drawn.startswith("<?xml")
    assert "Lines: medians of 300 runs. Bands: from 2.5 to 97.5 % of them." in drawn
    facts = json.loads((tmp_path / "two" / "sweep.json").read_text())
    assert facts["grid"] == {"spread": [1.0, 2.0], "told": [0.0, 0.5]}
    assert facts["runs"] == 300
    assert facts["computed by"] == ["2 processes of this machine"]
    # a call that finds all there computes nothing, and takes nobody's place
    own.run(plan, tmp_path / "two", workers=InThisProcess())
    facts = json.loads((tmp_path / "two" / "sweep.json").read_text())
    assert facts["computed by"] == ["2 processes of this machine"]


def test_more_runs_build_on_those_that_are_there(own: Own, tmp_path: Path) -> None:
    own.run(own.plan(*GRID, runs=100), tmp_path / "out", workers=InThisProcess())
    own.draws()
    plan = own.plan(*GRID, runs=300)
    done = own.run(plan, tmp_path / "out", workers=InThisProcess())
    assert own.draws() == 2 * 3
    assert (done.kept, done.computed) == (4 * 2 * GROUP, 4 * 3 * GROUP)
    own.run(plan, tmp_path / "anew", workers=InThisProcess())
    own.draws()
    assert (tmp_path / "out" / "sweep.csv").read_text() == (
        tmp_path / "anew" / "sweep.csv"
    ).read_text()
    # fewer again: what is too much is left out, and nothing is computed
    done = own.run(own.plan(*GRID, runs=100), tmp_path / "out", workers=InThisProcess())
    assert (own.draws(), done.kept, done.computed) == (0, 4 * 2 * GROUP, 0)
    assert set(pd.read_csv(tmp_path / "out" / "sweep.csv")["runs"]) == {100}


def rows_stored(folder: Path) -> int:
    """Return how many groups the store holds, while another process writes to it."""
    if not (folder / STORE).exists():
        return 0
    base = sqlite3.connect(f"file:{folder / STORE}?mode=ro", uri=True, timeout=30)
    try:
        return int(base.execute("SELECT count(*) FROM done").fetchone()[0])
    except sqlite3.OperationalError:  # its tables are not made yet
        return 0
    finally:
        base.close()


def wait_until(condition: Callable[[], bool], seconds: float = 120) -> None:
    end = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < end
        time.sleep(0.01)


def is_running(process: int) -> bool:
    try:
        os.kill(process, 0)
    except ProcessLookupError:
        return False
    # one that has ended and that nobody has asked about
    return Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()[0] != "Z"


@pytest.mark.long
def test_nothing_is_lost_or_counted_twice_by_a_stop_or_a_kill(own: Own, tmp_path: Path) -> None:
    out, words = tmp_path / "out", [*GRID]
    options = ["--runs", "1280", "-p", "pause=0.05", "--jobs", "1"]
    command = [
        *(sys.executable, "-m", "inswsn_book", "--root", str(own.project.root), "sweep", own.name),
        *(word for axis in words for word in ("--grid", axis)),
        *options,
        *("--out", str(out)),
    ]

    def begun(least: int) -> subprocess.Popen[str]:
        process = subprocess.Popen(
            command, cwd=own.folder, stderr=subprocess.PIPE, stdout=subprocess.PIPE, text=True
        )
        wait_until(lambda: rows_stored(out) >= least or process.poll() is not None)
        assert process.poll() is None
        return process

    stopped = begun(1)
    stopped.send_signal(signal.SIGTERM)
    said = stopped.communicate(timeout=60)[1]
    assert stopped.returncode == 128 + signal.SIGTERM
    assert f"What is finished is kept in {out}; the same command goes on.\n" in said
    assert said.endswith("inswsn: stopped.\n")

    killed = begun(rows_stored(out) + 1)
    killed.send_signal(signal.SIGKILL)
    killed.communicate(timeout=60)
    processes = [int(p.name.partition("-")[2]) for p in own.folder.glob("process-*")]
    wait_until(lambda: not any(map(is_running, processes)))  # nobody works on for nobody
    kept = rows_stored(out)
    total = 4 * 20
    assert 2 <= kept < total
    own.draws()

    done = subprocess.run(command, cwd=own.folder, capture_output=True, text=True, check=True)
    assert f"{(total - kept) * GROUP:,} runs computed, {kept * GROUP:,} were there." in done.stdout
    # cells that differ in what is told are stored together, and so are drawn once
    assert own.draws() == (total - kept) // 2
    plan = own.plan(*GRID, runs=1280, settings=("pause=0.05",))
    for found, expected in zip(contents(plan, out), in_one_call(quick(plan)), strict=True):
        for name, values in expected.items():
            assert np.array_equal(found[name], values)
    anew = own.run(quick(plan), tmp_path / "anew", workers=InThisProcess())
    assert (out / "sweep.csv").read_bytes() == (anew.folder / "sweep.csv").read_bytes()


def test_a_sweep_under_nohup_goes_on_when_the_terminal_is_closed(own: Own, tmp_path: Path) -> None:
    out = tmp_path / "out"
    command = [
        *(sys.executable, "-m", "inswsn_book", "--root", str(own.project.root), "sweep", own.name),
        *("--runs", "640", "-p", "pause=0.1", "--jobs", "1", "--out", str(out)),
    ]
    nohup = ["/bin/sh", "-c", "trap '' HUP; exec \"$@\"", "sh", *command]
    process = subprocess.Popen(
        nohup, cwd=own.folder, stderr=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    )
    wait_until(lambda: rows_stored(out) >= 1 or process.poll() is not None)
    process.send_signal(signal.SIGHUP)
    said = process.communicate(timeout=60)[1]
    assert (process.returncode, said.count("stopped")) == (0, 0)
    assert rows_stored(out) == 10


@pytest.mark.parametrize(
    ("changes", "sentence"),
    [
        (
            {"headline": "eror"},
            "headline of the experiment is 'eror'; it may be one of its columns, error.",
        ),
        (
            {"told": frozenset({"toldd"})},
            "told of the experiment is 'toldd'; it may be one of seed, spread, told, trouble, "
            "pause.",
        ),
        (
            {"undrawn": frozenset({"mode"})},
            "undrawn of the experiment is 'mode'; it may be one of mean, median.",
        ),
        ({"methods": {}}, "methods of the experiment is {}; it may be one name or more."),
        (
            {
                "schema": read_schema("# A mean.\nmean: float = 1.0  # m; any\n"),
                "told": frozenset(),
            },
            "schema of the experiment is 'mean'; it may be one with a whole number called seed, of "
            "which all random numbers come.",
        ),
    ],
)
def test_an_experiment_that_could_not_be_summed_up_is_refused_at_once(
    own: Own, changes: dict[str, Any], sentence: str
) -> None:
    changed = replace(find_experiment(own.name), **changes)
    sys.modules[own.module].EXPERIMENT = changed  # type: ignore[attr-defined]
    with pytest.raises(ParameterError) as refusal:
        own.plan(runs=64)
    assert str(refusal.value) == sentence


def test_a_parameter_that_is_called_as_a_column_is_no_axis(own: Own) -> None:
    experiment = find_experiment(own.name)
    schema = read_schema(
        "# Seed.\nseed: int = 5  # 1; any\n# A mean.\nmean: float = 1.0  # m; any\n"
    )
    sys.modules[own.module].EXPERIMENT = replace(  # type: ignore[attr-defined]
        experiment, schema=schema, told=frozenset()
    )
    assert own.plan(runs=64, settings=("mean=2",)).grid.values["mean"] == 2.0
    with pytest.raises(ParameterError, match="mean is a column of a sweep's tables already"):
        own.plan("mean=0,1", runs=64)


def test_tasks_are_small_enough_for_all_who_compute(own: Own) -> None:
    plan = own.plan("told=" + ",".join(map(str, range(100))), runs=640)
    tasks = plan.shared_out({}, block=4, at_once=1)
    assert len(tasks) == 7 * 3  # of 100 cells 16 at most, of 10 groups 4
    assert max(len(task.cells) for task in tasks) == 16
    assert {len(task.parts) for task in tasks} == {4, 2}
    assert len(plan.shared_out({}, block=4, at_once=8)) == 7 * 5
    assert len(plan.shared_out({}, block=4, at_once=1000)) == 7 * 10


@pytest.mark.long
def test_the_sweep_of_chapter_02_is_its_experiment(project: Project, tmp_path: Path) -> None:
    plan = make_plan(project, "02", ["period=0.2,1.0", "q_scale=1,10"], (), 100)
    progress = SweepProgress(Console(file=io.StringIO()))
    done = run_sweep(project, plan, progress, out=tmp_path / "out", jobs=2)
    assert (done.failed, done.computed, len(done.leaders)) == ({}, 4 * 2 * GROUP, 4)
    inputs = NETWORKED.load(project.root / "data")
    for found, values in zip(contents(plan, done.folder), plan.grid.cells(), strict=True):
        expected = NETWORKED.run(values, 100, inputs)
        assert found.keys() == expected.keys()
        for name, runs in expected.items():
            np.testing.assert_allclose(found[name], runs, rtol=1e-9, atol=1e-12)


def quick(plan: Plan) -> Plan:
    """Return the same sweep without the pauses, which change no number."""
    return replace(plan, grid=replace(plan.grid, values={**plan.grid.values, "pause": 0.0}))


def reasons(folder: Path) -> dict[str, str]:
    table = pd.read_csv(folder / "failed.csv", keep_default_na=False)  # nan is a trouble
    return dict(zip(table["trouble"], table["reason"], strict=True))


def test_a_cell_that_fails_is_tried_again_reported_and_costs_no_other(
    own: Own, tmp_path: Path
) -> None:
    plan = own.plan("trouble=raise,raise-twice,refuse,nan,spoil,exit,none", runs=128)
    done = own.run(plan, tmp_path / "out", workers=InThisProcess())
    assert reasons(done.folder) == {
        "raise": f"RuntimeError: no luck (tried {ATTEMPTS} times)",
        "refuse": "told is 0.0; it may be something else.",
        "nan": "mean.error is not finite in 1 of 64 runs.",
        "spoil": f"ValueError: output array is read-only (tried {ATTEMPTS} times)",
        "exit": f"SystemExit: 0 (tried {ATTEMPTS} times)",
    }
    failed = ("raise", "refuse", "nan", "spoil", "exit")
    assert list(done.failed) == [f"trouble={t}" for t in failed]
    assert (own.folder / "raised").read_text() == "xxxx"  # twice in vain, and one of each group
    table = pd.read_csv(done.folder / "sweep.csv")
    assert sorted(set(table["trouble"])) == ["none", "raise-twice"]
    good = in_one_call(own.plan(runs=128))[0]["mean.error"]
    for trouble in ("none", "raise-twice"):
        rows = table[(table["trouble"] == trouble) & (table["method"] == "mean")]
        assert rows["mean"].tolist() == [good.mean()]

    # the next call tries those that failed, and no other
    workers = InThisProcess()
    again = own.run(plan, tmp_path / "out", workers=workers)
    assert {cell for task in workers.tasks for cell, _ in task.cells} == {0, 2, 3, 4, 5}
    assert again.computed == 0
    assert again.kept == 2 * 2 * GROUP


def test_a_failed_cell_is_told_on_the_command_line_and_succeeds_later(own: Own) -> None:
    words = ("--grid", "told=0,1", "-p", "trouble=raise", "--runs", "64", "--jobs", "1")
    done = own.command(*words)
    assert done.returncode == 1
    said = done.stderr.splitlines()
    assert said[0] == f"told=0.0: failed: RuntimeError: no luck (tried {ATTEMPTS} times)"
    assert said[-1].startswith("inswsn: 2 of 2 cells failed, with the reasons in ")
    assert said[-1].endswith("failed.csv; the same command tries them again.")
    assert "There is no figure: no cell is complete." in done.stdout


def test_a_worker_that_dies_costs_its_own_cell_alone(own: Own, tmp_path: Path) -> None:
    plan = own.plan("trouble=none,die-once,die", runs=64)
    done = own.run(plan, tmp_path / "out", jobs=2)
    assert reasons(done.folder) == {
        "die": f"the process that computed it ended (tried {ATTEMPTS} times)"
    }
    table = pd.read_csv(done.folder / "sweep.csv")
    means = table[table["method"] == "mean"].set_index("trouble")["mean"]
    assert (
        means["none"] == means["die-once"] == in_one_call(own.plan(runs=64))[0]["mean.error"].mean()
    )


def test_a_task_whose_process_died_is_tried_again_cell_by_cell(own: Own, tmp_path: Path) -> None:
    class Mortal(InThisProcess):
        died = False

        def outcome(self, future: Future[Outcome]) -> Outcome:
            if not self.died:
                self.died = True
                raise WorkerDiedError("gone")
            return future.result()

    workers = Mortal()
    done = own.run(own.plan(*GRID, runs=64), tmp_path / "out", workers=workers)
    assert done.failed == {}
    # the task of two cells is tried again as two tasks
    assert [len(task.cells) for task in workers.tasks].count(1) == 2


def test_a_task_that_may_have_ended_a_worker_is_computed_alone(own: Own, tmp_path: Path) -> None:
    """Dask counts a death against all tasks that a worker had; here it has three at once."""

    class Crowd(InThisProcess):
        def __init__(self) -> None:
            super().__init__()
            self.flying: list[Future[Outcome]] = []
            self.seen: list[list[str]] = []  # the troubles that were under way together
            self.struck: set[Future[Outcome]] = set()

        def has_room(self) -> bool:
            return len(self.flying) < 3

        def submit(self, compute: Callable[[Task], Outcome], task: Task) -> Future[Outcome]:
            self.tasks.append(task)
            future: Future[Outcome] = Future()
            future.set_result(Outcome("died") if fatal(task) else compute(task))
            self.flying.append(future)
            if fatal(task):
                self.struck |= set(self.flying)
            elif any(map(died, self.flying)):
                self.struck.add(future)
            return future

        def outcome(self, future: Future[Outcome]) -> Outcome:
            self.flying.remove(future)
            if future in self.struck:
                raise WorkerDiedError("KilledWorker", shared=True)
            return future.result()

    def fatal(task: Task) -> bool:
        return task.cells[0][1]["seed"] == 2

    def died(future: Future[Outcome]) -> bool:
        return future.result().library == "died"

    workers = Crowd()
    done = own.run(own.plan("seed=1,2,3,4,5", runs=64), tmp_path / "out", workers=workers)
    assert done.failed == {"seed=2": f"KilledWorker (tried {ATTEMPTS} times)"}
    assert done.computed == 4 * GROUP
    # once with others, and then alone
    assert sum(map(fatal, workers.tasks)) == 1 + ATTEMPTS
    assert {task.attempt for task in workers.tasks if not fatal(task)} == {0}


def test_results_of_another_library_are_not_mixed_in(own: Own, tmp_path: Path) -> None:
    def other(outcome: Outcome) -> Outcome:
        outcome.library = "another"
        return outcome

    done = own.run(own.plan(runs=64), tmp_path / "out", workers=InThisProcess(other))
    assert done.computed == 0
    assert "a worker has another library: another" in done.failed["the one cell"]


@pytest.mark.long
def test_a_cluster_of_dask_gives_the_same(own: Own, tmp_path: Path) -> None:
    import dask
    import distributed

    plan = own.plan(*GRID, runs=300)
    with (
        dask.config.set({"distributed.worker.daemon": False}),
        distributed.LocalCluster(
            n_workers=2, threads_per_worker=1, processes=True, dashboard_address=None
        ) as cluster,
    ):
        done = own.run(plan, tmp_path / "dask", dask=cluster.scheduler_address, block=1)
        failing = own.plan("trouble=none,raise,refuse", runs=64)
        failed = own.run(failing, tmp_path / "failed", dask=cluster.scheduler_address)
    assert (done.computed, done.failed) == (4 * 5 * GROUP, {})
    own.run(plan, tmp_path / "here", workers=InThisProcess())
    assert (tmp_path / "dask" / "sweep.csv").read_bytes() == (
        tmp_path / "here" / "sweep.csv"
    ).read_bytes()
    assert len(list(own.folder.glob("process-*"))) == 3  # two of the cluster, and this one
    assert list(failed.failed) == ["trouble=raise", "trouble=refuse"]


@pytest.mark.long
def test_a_cell_that_kills_a_worker_of_dask_costs_no_other(own: Own, tmp_path: Path) -> None:
    import dask
    import distributed

    plan = own.plan("seed=1,2,3,4,5", runs=64, settings=("trouble=die-of-1", "pause=0.2"))
    with (
        dask.config.set(
            {"distributed.worker.daemon": False, "distributed.scheduler.allowed-failures": 0}
        ),
        distributed.LocalCluster(
            n_workers=1, threads_per_worker=4, processes=True, dashboard_address=None
        ) as cluster,
    ):
        # the other cells are under way or wait beside it, and each of its deaths strikes them too
        done = own.run(plan, tmp_path / "out", dask=cluster.scheduler_address)
    assert list(done.failed) == ["seed=1"]
    assert done.failed["seed=1"].endswith(f"(tried {ATTEMPTS} times)")
    assert done.computed == 4 * GROUP


def test_an_address_where_nobody_answers(
    own: Own, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    import socket

    from inswsn_book import sweep_workers

    monkeypatch.setattr(sweep_workers, "_CONNECT_SECONDS", 1)
    with socket.socket() as taken:  # bound, and not listening: nobody else gets the port
        taken.bind(("127.0.0.1", 0))
        address = f"tcp://127.0.0.1:{taken.getsockname()[1]}"
        with pytest.raises(ParameterError) as refusal:
            own.run(own.plan(runs=64), tmp_path / "out", dask=address)
    assert not (tmp_path / "out").exists()
    start = f"--dask is '{address}'; it may be the address of a Dask scheduler that answers ("
    assert str(refusal.value).startswith(start)


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        (["--grid", "spread"], "--grid is 'spread'; it may be name=value,value,...."),
        (
            ["--grid", "spread=1", "--grid", "spread=2"],
            "--grid is 'spread=2'; it may be given once for each name: spread is there twice.",
        ),
        (
            ["--grid", "spread=1,2,1.0"],
            "--grid is 'spread=1,2,1.0'; it may be a list without repetitions: 1.0 is repeated.",
        ),
        (["--grid", "spread=0,1"], "spread is 0.0; it may be a number with value > 0."),
        (["--grid", "spread=1,,2"], "spread is ''; it may be a number with value > 0."),
        (
            ["--grid", "other=1"],
            "parameter is 'other'; it may be one of seed, spread, told, trouble, pause.",
        ),
        (["-p", "seed=1.5"], "seed is '1.5'; it may be a whole number with 0 <= value <= 1000."),
        (
            ["-p", "spread=1", "--grid", "spread=1,2"],
            "-p is 'spread=1.0'; it may be left out: --grid varies spread.",
        ),
        (
            ["--grid", "runs=100,200"],
            "--grid is 'runs=100,200'; it may be another parameter: runs is a column of a sweep's "
            "tables already; give --runs.",
        ),
        (
            ["--dask", "tcp://h:1", "--jobs", "2"],
            "--jobs is 2; it may be left out: the cluster of --dask has its own workers.",
        ),
        (["--runs", "39"], "--runs is 39; it may be a whole number from 40 to 1000000."),
        (
            ["--grid", "seed=" + ",".join(map(str, range(101))),
             "--grid", "told=" + ",".join(map(str, range(101)))],
            "--grid is 'of 10201 cells'; it may be of 10000 cells at most.",
        ),
        (
            ["--out", "data"],
            "--out is 'data'; it may be a new or empty folder, or one that holds an earlier sweep "
            "alone.",
        ),
    ],
)  # fmt: skip
def test_a_sweep_is_refused_before_anything_runs(
    own: Own, monkeypatch: pytest.MonkeyPatch, words: list[str], sentence: str
) -> None:
    from click.testing import CliRunner
    from inswsn_book.cli import cli

    monkeypatch.chdir(own.project.root)
    done = CliRunner().invoke(cli, ["--root", str(own.project.root), "sweep", own.name, *words])
    assert isinstance(done.exception, InswsnError)  # of which `main` makes status 2
    assert str(done.exception) == sentence
    assert not (own.project.root / "runs").exists()
    assert own.draws() == 0


def test_one_sentence_and_status_2(mini: MiniProject) -> None:
    done = run_command(mini.root, "sweep", "07", "--grid", "scale=1")
    said = "inswsn: NAME is '07'; it may be one of 00.\n"
    assert (done.returncode, done.stderr, done.stdout) == (2, said, "")
    assert not (mini.root / "runs").exists()


def test_a_module_that_is_not_there(mini: MiniProject) -> None:
    with pytest.raises(ParameterError) as refusal:
        make_plan(mini, "nothing_there:EXPERIMENT", (), (), None)
    assert str(refusal.value) == (
        "NAME is 'nothing_there:EXPERIMENT'; it may be the number of a chapter, or "
        "package.module:NAME, an inswsn_book.experiments.Experiment; importing nothing_there "
        "fails: ModuleNotFoundError: No module named 'nothing_there'."
    )


def test_sweeps_of_different_things_are_not_mixed(own: Own, tmp_path: Path) -> None:
    out = tmp_path / "out"
    own.run(own.plan(*GRID, runs=64), out, workers=InThisProcess())
    before = (out / "sweep.csv").read_bytes()
    for plan, what in (
        (own.plan("spread=1,3", "told=0,0.5", runs=64), "grid"),
        (own.plan(*GRID, runs=64, settings=("seed=6",)), "set of parameters"),
    ):
        with pytest.raises(InswsnError, match=f"was made with another {what}; give another --out"):
            own.run(plan, out, workers=InThisProcess())
    (own.folder / f"{own.module}.py").write_text(OWN + "# changed\n")
    sweep_tasks._module_word.cache_clear()
    changed = own.plan(*GRID, runs=64)
    with pytest.raises(InswsnError, match="another library, Python or package; give another"):
        own.run(changed, out, workers=InThisProcess())
    assert (out / "sweep.csv").read_bytes() == before
    done = own.run(changed, out, workers=InThisProcess(), fresh=True)
    assert (done.kept, done.computed) == (0, 4 * GROUP)


def test_a_process_knows_what_it_has_imported_and_not_what_lies_on_the_disk(own: Own) -> None:
    before = code_state(own.name)
    source = own.folder / f"{own.module}.py"
    source.write_text(OWN + "OTHER = EXPERIMENT\n")
    assert code_state(own.name) == before
    # another name of the module, which this process has imported as it was
    sys.modules[own.module].OTHER = find_experiment(own.name)  # type: ignore[attr-defined]
    assert code_state(f"{own.module}:OTHER") == before
    assert code_state().startswith(sweep_tasks.library_word())
    # the packages that numbers depend on besides the locks
    assert f", scipy {scipy.__version__}, " in code_state()


def test_a_file_that_is_changed_while_a_chapter_is_executed(
    mini: MiniProject, tmp_path: Path
) -> None:
    source, out = mini.root / "chapters" / "00-mini.md", tmp_path / "out"
    text = source.read_text()
    plan = make_plan(mini, "00", ["scale=1,2"], (), None)

    class Edits(InThisProcess):
        taken = 0

        def outcome(self, future: Future[Outcome]) -> Outcome:
            self.taken += 1
            if self.taken == 2:
                source.write_text(text + "\nAnother sentence.\n")
            return super().outcome(future)

    def swept(workers: InThisProcess) -> Finished:
        progress = SweepProgress(Console(file=io.StringIO()))
        return run_sweep(mini, plan, progress, out=out, workers=workers)

    with pytest.raises(BuildError) as failure:  # of which `main` makes status 1
        swept(Edits())
    assert str(failure.value) == (
        "Another text of the chapter than when the sweep began: what was finished before is kept. "
        "Put it back and give the same command, or begin anew by --fresh."
    )
    source.write_text(text)
    done = swept(InThisProcess())
    assert (done.kept, done.computed) == (1, 1)
    values = pd.read_csv(out / "sweep.csv")["value"]
    assert values.tolist() == [21.0, 42.0]


def test_one_cell_has_no_figure(own: Own, tmp_path: Path) -> None:
    done = own.run(own.plan(runs=64), tmp_path / "out", workers=InThisProcess())
    assert done.no_figure == "there is one cell; --grid names an axis."
    assert not (done.folder / "sweep.svg").exists()


def test_one_sweep_at_a_time_in_a_folder(own: Own, tmp_path: Path) -> None:
    plan = own.plan(runs=64)
    with (
        Store(tmp_path / "out", plan.made_from),
        pytest.raises(InswsnError, match="Another sweep is running in"),
    ):
        Store(tmp_path / "out", plan.made_from)
    Store(tmp_path / "out", plan.made_from).__exit__(None, None, None)


def test_a_store_that_is_none(tmp_path: Path) -> None:
    (tmp_path / STORE).write_text("This is a text, and longer than the head of a database. " * 40)
    with pytest.raises(InswsnError, match="is not the store of a sweep"):
        Store(tmp_path, {"grid": "one"})
    with Store(tmp_path, {"grid": "one"}, fresh=True) as store:
        assert store.done() == {}


def test_a_group_is_stored_once_and_a_task_whole(tmp_path: Path) -> None:
    with Store(tmp_path / "out", {"grid": "one"}) as store:
        store.add([(0, 0, b"a"), (0, 1, b"b")])
        with pytest.raises(sqlite3.IntegrityError):
            store.add([(0, 2, b"c"), (0, 1, b"d")])
        assert store.done() == {0: {0, 1}}
        assert store.read(0, 2) == [b"a", b"b"]
        assert store.read(0, 1) == [b"a"]


@pytest.mark.parametrize("fresh", [False, True])
def test_what_a_kill_leaves_of_a_file_is_no_reason_to_refuse_the_folder(
    own: Own, tmp_path: Path, fresh: bool
) -> None:
    out, plan = tmp_path / "out", own.plan(runs=64)
    own.run(plan, out, workers=InThisProcess())
    for name in (".sweep.csv.gky3652j", ".failed.csv.a_b3c4d5", "sweep.sqlite-shm"):
        (out / name).write_text("half")
    done = own.run(plan, out, workers=InThisProcess(), fresh=fresh)
    assert done.kept == (0 if fresh else GROUP)
    assert {path.name for path in out.iterdir()} <= {
        STORE, "sweep.sqlite-shm", ".lock", "sweep.csv", "sweep.json",
    }  # fmt: skip
    (out / ".sweep.csv.gky3652j.bak").write_text("somebody's own")
    with pytest.raises(ParameterError, match="one that holds an earlier sweep alone"):
        own.run(plan, out, workers=InThisProcess())


def test_a_file_that_is_being_written_is_one_that_may_be_left(tmp_path: Path) -> None:
    from inswsn_book.files import write_whole
    from inswsn_book.sweep_store import check_folder

    names: set[str] = set()
    replace = Path.replace

    def look(path: Path, target: Path) -> Path:
        names.add(path.name)
        check_folder(tmp_path)
        return replace(path, target)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(Path, "replace", look)
        for name in ("sweep.csv", "sweep.svg", "sweep.json", "failed.csv"):
            write_whole(tmp_path / name, "text")
    assert len(names) == 4


def test_a_full_disk_is_told_and_loses_nothing(tmp_path: Path) -> None:
    with Store(tmp_path / "out", {"grid": "one"}) as store:
        store.add([(0, 0, b"a")])
        (pages,) = store._base.execute("PRAGMA page_count").fetchone()
        store._base.execute(f"PRAGMA max_page_count = {pages}")
        with pytest.raises(BuildError) as failure:
            store.add([(0, 1, b"b" * 100_000)])
        assert str(failure.value) == (
            "sweep.sqlite: database or disk is full; what is finished is kept."
        )
        assert store.done() == {0: {0}}
    with Store(tmp_path / "out", {"grid": "one"}) as store:
        assert store.read(0, 1) == [b"a"]


def test_a_store_that_cannot_be_opened_is_told(tmp_path: Path) -> None:
    (tmp_path / STORE).mkdir()
    with pytest.raises(BuildError, match="unable to open database file; what is finished is kept"):
        Store(tmp_path, {"grid": "one"})


def test_a_database_of_something_else_is_refused(tmp_path: Path) -> None:
    base = sqlite3.connect(tmp_path / STORE)
    base.execute("CREATE TABLE other (name TEXT)")
    base.close()
    with pytest.raises(InswsnError, match="is not the store of a sweep"):
        Store(tmp_path, {"grid": "one"})


MINE = """
import numpy as np
from sklearn.base import BaseEstimator, RegressorMixin

class L(RegressorMixin, BaseEstimator):
    def fit(self, X, y):
        return self

    def predict(self, X):
        return np.zeros(len(X))
"""


def test_an_edited_file_or_regressor_of_ones_own_is_another_sweep(own: Own, tmp_path: Path) -> None:
    source = own.project.root / "chapters" / "00-mini.md"
    source.write_text(source.read_text().replace("# What the number is", """\
# A learner.
learner: str = "sklearn.linear_model:LinearRegression"  # 1; a regressor
# A table.
table: str = "papers/number.txt"  # 1; a file
# What the number is"""))  # fmt: skip
    module, file = own.folder / f"{own.module}_mine.py", tmp_path / "table.csv"
    module.write_text(MINE)
    file.write_text("1")

    def made_from(*axes: str) -> str:
        settings = (f"table={file}",)
        return make_plan(own.project, "00", axes, settings, None).made_from[
            "file or module of your own"
        ]

    axis = f"learner={own.module}_mine:L,sklearn.linear_model:Ridge"
    before = made_from(axis)
    assert json.loads(before).keys() == {
        str(file), f"{own.module}_mine:L", "sklearn.linear_model:Ridge",
    }  # fmt: skip
    file.write_text("2")
    with_other_file = made_from(axis)
    module.write_text(MINE + "# edited")
    assert len({before, with_other_file, made_from(axis)}) == 3
    sys.modules.pop(f"{own.module}_mine")


def test_the_runs_of_a_chapter_are_no_axis(mini: MiniProject) -> None:
    source = mini.root / "chapters" / "00-mini.md"
    declared = "# How many.\nruns: int = 7  # runs; value > 0\n# What the number is"
    source.write_text(source.read_text().replace("# What the number is", declared))
    with pytest.raises(ParameterError) as refusal:
        make_plan(mini, "00", ["scale=1,2", "runs=200,400"], (), None)
    assert str(refusal.value) == (
        "--grid is 'runs=200,400'; it may be another parameter: runs is a column of a sweep's "
        "tables already; give --runs."
    )
    plan = make_plan(mini, "00", ["scale=1,2"], (), 50)
    assert (plan.runs, plan.runs_of_part, plan.counted) == (50, 1, "cells")


def test_progress_on_a_terminal() -> None:
    console = Console(file=io.StringIO(), force_terminal=True, width=200)

    def shown() -> str:
        stream = console.file
        assert isinstance(stream, io.StringIO)
        progress._bars.refresh()
        return stream.getvalue().rpartition("sweep-02")[2]

    with SweepProgress(console) as progress:
        progress.started("sweep-02", 64, 12_800)
        assert "64 of 12,800 runs" in shown()
        assert "failed" not in shown()
        progress.advanced(1_000)
        progress.cell("told=1", 4)  # the bar tells
        assert "1,064 of 12,800 runs" in shown()
        progress.failed("told=2", "no design")
        progress.failed("told=3", "no design")
        assert "2 failed" in shown()
    stream = console.file
    assert isinstance(stream, io.StringIO)
    assert "told=3: failed: no design" in stream.getvalue()
    assert "told=1" not in stream.getvalue()


def test_another_solver_is_another_sweep(
    own: Own, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    out = tmp_path / "out"
    done = own.run(own.plan(runs=64), out, workers=InThisProcess())
    facts = json.loads((done.folder / "sweep.json").read_text())
    assert facts["made from"]["solver"] == "clarabel"
    monkeypatch.setenv("INSWSN_SOLVER", "scs")
    assert library_state().endswith(", solver scs")
    for plan in (own.plan(runs=64), make_plan(own.project, "00", (), (), None)):
        assert plan.made_from["solver"] == "scs"
    with pytest.raises(InswsnError, match="was made with another solver; give another --out"):
        own.run(own.plan(runs=64), out, workers=InThisProcess())
    monkeypatch.setenv("INSWSN_SOLVER", "simplex")
    for name in (own.name, "00"):
        with pytest.raises(ParameterError, match="INSWSN_SOLVER is 'simplex'; it may be one of"):
            make_plan(own.project, name, (), (), None)


def test_a_chapter_is_executed_with_the_solver_that_is_chosen(
    mini: MiniProject, monkeypatch: pytest.MonkeyPatch
) -> None:
    from inswsn_book import runs

    seen = []

    def executed(_: Any, request: runs.Request, __: Any) -> Any:
        seen.append(request.surroundings.solver)
        raise InswsnError("seen")

    monkeypatch.setattr(runs, "run", executed)
    monkeypatch.setenv("INSWSN_SOLVER", "scs")
    task = Task("", "00-mini", mini.root, ((0, {"scale": 1.0}),), (0,))
    assert sweep_tasks.execute_cell(task).refused == {0: "seen"}
    assert seen == ["scs"]


def test_the_linear_algebra_keeps_to_one_thread_while_others_compute(own: Own) -> None:
    from threadpoolctl import ThreadpoolController

    plan = own.plan(runs=64)
    (task,) = plan.tasks({})
    # numpy and scipy may each have their own
    libraries = ThreadpoolController().select(user_api="blas").lib_controllers
    assert libraries
    for blas in libraries:
        blas.set_num_threads(2)  # conftest.py has set 1, which is left in the end
    try:
        assert compute_groups(task).failed == {}
        # what ends first takes nothing back: another thread may be in the midst of a task
        assert {blas.num_threads for blas in libraries} == {1}
    finally:
        for blas in libraries:
            blas.set_num_threads(1)


def evaluated(text: str) -> Any:
    """Return a task that `eval` computes."""
    return text


def test_a_process_that_dies_idle_or_cannot_answer_is_no_slot_less() -> None:
    compute: Any = eval
    with local_workers(1) as workers:

        def answer(text: str) -> Any:
            return workers.outcome(workers.submit(compute, evaluated(text)))

        process = answer("__import__('os').getpid()")
        os.kill(process, signal.SIGKILL)
        wait_until(lambda: bool(workers._idle[0].pool._broken))  # type: ignore[attr-defined]
        assert answer("1 + 1") == 2
        with pytest.raises(WorkerDiedError, match="pickle"):
            answer("lambda: 0")
        assert workers.has_room()
        assert answer("1 + 2") == 3


def test_an_interrupt_does_not_reach_a_process_that_starts() -> None:
    import multiprocessing

    compute: Any = eval
    before = {process.pid for process in multiprocessing.active_children()}
    with local_workers(1) as workers:
        future = workers.submit(compute, evaluated("0"))
        assert signal.SIGINT not in signal.pthread_sigmask(signal.SIG_BLOCK, ())
        (process,) = {p.pid for p in multiprocessing.active_children()} - before
        lines = Path(f"/proc/{process}/status").read_text().splitlines()
        masks = {name: int(mask, 16) for name, mask in (
            line.split(":") for line in lines if line.startswith(("SigBlk", "SigIgn"))
        )}  # fmt: skip
        assert (masks["SigBlk"] | masks["SigIgn"]) >> (signal.SIGINT - 1) & 1
        assert workers.outcome(future) == 0  # type: ignore[comparison-overlap]


def test_a_module_of_ones_own_is_found_by_a_worker_elsewhere(own: Own, tmp_path: Path) -> None:
    words = "from inswsn_book.sweep_tasks import worker_state; print(worker_state({!r}))"
    done = subprocess.run(
        [sys.executable, "-c", words.format(own.name)],
        cwd=tmp_path, capture_output=True, text=True, check=True,
    )  # fmt: skip
    assert done.stdout == f"{(library_state(own.name), '')}\n"
    assert worker_state("not_there:E")[1].endswith(
        "No module named 'not_there'. Set INSWSN_MODULES there to the folder of the module."
    )


def test_a_module_that_is_no_text(own: Own) -> None:
    import py_compile

    source = own.folder / f"{own.module}.py"
    py_compile.compile(str(source), cfile=str(source.with_suffix(".pyc")))
    source.unlink()
    assert own.module in own.plan(runs=64).made_from["library, Python or package"]


class AFewWorkers:
    """What `check_workers` asks a client of Dask."""

    def __init__(self, *found: object) -> None:
        self._found = found

    def nthreads(self) -> dict[str, int]:
        return {str(number): 1 for number, _ in enumerate(self._found)}

    def run(
        self, compute: Callable[[str], Any], source: str, workers: None, on_error: str
    ) -> dict[str, Any]:
        assert on_error == "return"
        own = compute(source)
        return {str(n): own if f is None else f for n, f in enumerate(self._found)}


def test_workers_that_would_compute_other_numbers_are_refused(own: Own) -> None:
    state = library_state(own.name)
    words = state.split(", ")

    def refusal(*found: object) -> str:
        with pytest.raises(InswsnError) as refused:
            check_workers(AFewWorkers(*found), "tcp://h:1", own.name)
        return str(refused.value)

    check_workers(AFewWorkers(None, (state, "")), "tcp://h:1", own.name)
    assert refusal() == "The Dask scheduler at tcp://h:1 has no worker; start one: dask worker."
    assert refusal(None, ImportError("no")) == (
        "The Dask worker at 1 cannot load this library: ImportError: no."
    )
    assert refusal(("", "No module.")) == "The Dask worker at 0 cannot compute: No module."
    for place, remedy in (
        (0, "install the same checkout there"),
        (3, "install the same checkout there"),
        (-2, "copy the module there"),
        (-1, "start it with the same INSWSN_SOLVER"),
    ):
        other = [*words]
        other[place] = f"{words[place].split()[0]} 0"
        assert refusal((", ".join(other), "")) == (
            f"The Dask worker at 0 has {other[place]}, and this command {words[place]}; {remedy}, "
            "and restart the worker: it keeps what it has once loaded."
        )


class ACluster(AFewWorkers):
    """What `DaskWorkers` asks a client of Dask; a task stays where it is."""

    status = "running"

    def __init__(self, **found: object) -> None:
        super().__init__()
        self.there = found
        self.pinned: list[list[str]] = []
        self.pending: Future[Outcome] = Future()

    def nthreads(self) -> dict[str, int]:
        return dict.fromkeys(self.there, 2)

    def run(
        self, compute: Callable[[str], Any], source: str, workers: Any, on_error: str
    ) -> dict[str, Any]:
        own = compute(source)
        return {name: self.there[name] or own for name in workers or self.there}

    def submit(self, compute: Any, task: Any, **options: Any) -> Future[Outcome]:
        assert not options["allow_other_workers"]
        self.pinned.append(options["workers"])
        return self.pending


def test_a_worker_that_comes_later_and_differs_gets_no_task(own: Own) -> None:
    cluster = ACluster(good=None)
    workers = DaskWorkers(cluster, "tcp://h:1", own.name)
    assert (workers.look(), workers.size(), workers.has_room()) == ("", 2, True)
    cluster.there |= {"other": ("library 0", ""), "blind": ("", "No module."), "late": None}
    said = workers.look()
    assert "The Dask worker at other has library 0, and this command library " in said
    assert "The Dask worker at blind cannot compute: No module. It gets no task." in said
    assert workers.size() == 4
    future = workers.submit(compute_groups, own.plan(runs=64).tasks({})[0])
    assert cluster.pinned == [["good", "late"]]
    # those that may have it go: it would wait for them
    for name in ("good", "late"):
        del cluster.there[name]
    assert workers.look().endswith(
        "The Dask cluster at tcp://h:1 has no other worker; waiting for one."
    )
    assert not workers.has_room()
    with pytest.raises(
        WorkerDiedError, match="the workers that could compute it have gone"
    ) as gone:
        workers.outcome(future)
    assert gone.value.shared
    assert cluster.pending.cancelled()
    # one that comes back under its name is asked again
    cluster.there = {"other": None}
    assert workers.look().startswith("The Dask worker at other has library 0")  # as it was
    cluster.there = {}
    workers.look()
    cluster.there = {"other": None}
    assert (workers.look(), workers.size()) == ("", 2)


@pytest.fixture
def cluster() -> Iterator[Any]:
    """A scheduler and a worker in this process, of which either may be closed."""
    import distributed

    with distributed.LocalCluster(
        n_workers=1, threads_per_worker=1, processes=False, dashboard_address=None
    ) as made:
        yield made


class After(SweepProgress):
    """Does something once when the first runs are done."""

    def __init__(self, act: Callable[[], None], console: Console) -> None:
        super().__init__(console)
        self._act: Callable[[], None] | None = act

    def advanced(self, runs: int) -> None:
        super().advanced(runs)
        if self._act is not None:
            act, self._act = self._act, None
            act()


def test_a_scheduler_that_is_killed(own: Own, tmp_path: Path, cluster: Any) -> None:
    address, out = cluster.scheduler_address, tmp_path / "out"
    plan = own.plan("seed=1,2,3,4,5,6", runs=64)
    progress = After(cluster.close, Console(file=io.StringIO()))
    with pytest.raises(BuildError) as failure:  # of which `main` makes status 1
        run_sweep(own.project, plan, progress, out=out, dask=address)
    assert str(failure.value) == (
        f"The Dask scheduler at {address} is gone; start it again and give the same command: what "
        "is finished is kept."
    )
    done = own.run(plan, out, workers=InThisProcess())
    assert done.kept >= GROUP
    assert done.kept + done.computed == 6 * GROUP


def test_a_cluster_that_lost_its_workers_is_waited_for(
    own: Own, tmp_path: Path, cluster: Any
) -> None:
    said = io.StringIO()
    sentence = (
        f"The Dask cluster at {cluster.scheduler_address} has no worker left; waiting for one.\n"
    )

    class Seen(io.StringIO):
        def write(self, text: str) -> int:
            said.write(text)
            if sentence in said.getvalue():
                cluster.scale(1)
            return len(text)

    def lose() -> None:
        cluster.scale(0)
        wait_until(lambda: not cluster.scheduler.workers)

    progress = After(lose, Console(file=Seen(), width=200))
    plan = own.plan("seed=1,2,3,4,5,6", runs=64)
    done = run_sweep(
        own.project, plan, progress, out=tmp_path / "out", dask=cluster.scheduler_address
    )
    assert said.getvalue().count(sentence) == 1
    assert (done.computed, done.failed) == (6 * GROUP, {})


def test_the_notebook_of_a_chapter_without_an_experiment(mini: MiniProject, tmp_path: Path) -> None:
    mini.chapter(
        "```{code-cell} ipython3\n"
        "from inswsn_lib.errors import ParameterError\n"
        "if scale == 3:\n    raise ParameterError('scale', scale, 'another')\n```"
    )
    out = tmp_path / "out"
    console = Console(file=io.StringIO())
    plan = make_plan(mini, "0", ["scale=1,3"], (), None)
    done = run_sweep(mini, plan, SweepProgress(console), out=out, jobs=1)
    assert done.failed == {"scale=3.0": "scale is 3.0; it may be another."}
    assert (out / "sweep.csv").read_text() == (
        "scale,quantity,unit,runs,value,low,high,interval\n1.0,twice,m,1,21.0,,,\n"
    )
    assert (
        out / "failed.csv"
    ).read_text() == "scale,reason\n3.0,scale is 3.0; it may be another.\n"
    with pytest.raises(ParameterError, match="chapter 00 has no parameter runs"):
        make_plan(mini, "00", (), (), 50)
    with pytest.raises(ParameterError, match="this chapter is executed as a whole"):
        run_sweep(mini, plan, SweepProgress(console), out=out, dask="tcp://h:1")


SCHEMA = read_schema(
    """
# A number.
size: float = 1.0  # m; any
# A count.
count: int = 1  # 1; any
# A switch.
on: bool = true  # 1; any
""".replace("true", "True")
)


@given(
    st.lists(st.floats(allow_nan=False, allow_infinity=False), min_size=1, max_size=6, unique=True),
    st.lists(st.integers(-(10**9), 10**9), min_size=1, max_size=6, unique=True),
)
def test_what_stands_on_an_axis_is_read_as_it_is(sizes: list[float], counts: list[int]) -> None:
    axes = [f"size={','.join(map(repr, sizes))}", f"count={', '.join(map(str, counts))}"]
    grid = read_grid(SCHEMA, axes, ["on=false"], Path())
    assert grid.axes == {"size": tuple(sizes), "count": tuple(counts)}
    assert len(grid.cells()) == len(sizes) * len(counts)
    assert grid.cells()[-1] == {"size": sizes[-1], "count": counts[-1], "on": False}


@given(
    parts=st.integers(1, 30),
    block=st.integers(1, 8),
    done=st.sets(st.tuples(st.integers(0, 3), st.integers(0, 40))),
)
def test_each_group_of_each_cell_is_a_task_once(
    parts: int, block: int, done: set[tuple[int, int]]
) -> None:
    from types import SimpleNamespace

    cells = [{"size": 1.0, "told": t} for t in (1, 2)] + [{"size": 2.0, "told": t} for t in (1, 2)]
    plan: Any = SimpleNamespace(
        experiment=SimpleNamespace(told={"told"}),
        grid=SimpleNamespace(cells=lambda: cells),
        parts=parts, digest="", source="", inputs=None,
    )  # fmt: skip
    held: dict[int, set[int]] = {}
    for cell, part in done:
        held.setdefault(cell, set()).add(part)
    tasks = Plan.tasks(plan, held, block)
    due = [(cell, part) for task in tasks for cell, _ in task.cells for part in task.parts]
    assert len(due) == len(set(due))
    assert set(due) == {(c, p) for c in range(4) for p in range(parts)} - done
    for task in tasks:
        assert len({values["size"] for _, values in task.cells}) == 1
        assert len(task.parts) <= block
        assert len(task.cells) <= 16


def test_the_runs_of_monte_carlo_in_parts() -> None:
    def draw(rng: np.random.Generator, runs: int) -> dict[str, np.ndarray]:
        return {"x": rng.standard_normal(runs)}

    parts = [monte_carlo(draw, GROUP, 3, first=GROUP * part)["x"] for part in range(4)]
    assert np.array_equal(np.concatenate(parts), monte_carlo(draw, 4 * GROUP, 3)["x"])
