"""A sweep: its grid, its files, and whom it refuses."""

from __future__ import annotations

import json
import sys
import time
from collections.abc import Callable, Iterator

import distributed
import pytest
from conftest import Command, MiniProject, SweepProject
from inswsn_book.make.sweep import read_sweep
from inswsn_book.record.parameters import chapter_schema
from inswsn_book.record.project import Project
from inswsn_book.run.store import Request, lookup

from inswsn_lib.errors import ParameterError


@pytest.fixture
def swept(mini: MiniProject, monkeypatch: pytest.MonkeyPatch) -> SweepProject:
    """A sweep that this process can compute."""
    made = SweepProject(mini)
    monkeypatch.setenv("MINI_LOG", str(made.log))
    monkeypatch.syspath_prepend(mini.root)
    monkeypatch.delitem(sys.modules, "minicore", raising=False)
    return made


@pytest.fixture(scope="module")
def cluster() -> Iterator[Callable[[int], str]]:
    """Return the address of a scheduler with one worker of so many threads, in this process."""
    made: dict[int, distributed.LocalCluster] = {}

    def address(threads: int = 1) -> str:
        if threads not in made:
            made[threads] = distributed.LocalCluster(
                n_workers=1, threads_per_worker=threads, processes=False, dashboard_address=None,
                protocol="tcp",
            )  # fmt: skip
        return str(made[threads].scheduler_address)

    yield address
    for each in made.values():
        each.close()


# The grid -----------------------------------------------------------------------------------------


def test_a_grid_goes_through_its_last_axis_fastest(project: Project) -> None:
    axes = ["q_scale=0.1,1", "seed=1,2"]
    sweep = read_sweep(project, project.by_id("p1-training"), axes, ["runs=64"])
    assert sweep.core == "inswsn_lib.navigation:TrainingAreas"
    assert sweep.places[1] == {"q_scale": 0.1, "seed": 2}
    assert [request.parameters["seed"] for request in sweep.requests] == [1, 2, 1, 2]
    assert all(r.core and r.parameters["runs"] == 64 for r in sweep.requests)


@pytest.mark.parametrize("number", ["p1-lmi", "p1-training", "61", "your-own-data"])
def test_a_sweep_takes_what_a_run_takes(project: Project, number: str) -> None:
    chapter = project.by_id(number)
    for parameter in chapter_schema(project.root, number).parameters:
        if parameter.rule not in ("a file", "a folder", "a regressor"):
            axis = f"{parameter.name}={parameter.default}"
            sweep = read_sweep(project, chapter, [axis], [])
            assert sweep.places == [{parameter.name: parameter.default}]


@pytest.mark.parametrize(
    ("axes", "settings"),
    [
        (["scale"], []),
        (["scale=1", "scale=2"], []),
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


@pytest.mark.parametrize(
    ("axis", "values"),
    [
        ("heading=0,0.2", (0.0, 0.2)),
        ("position=[0, 0],[1, 2]", ([0, 0], [1, 2])),
        ("range_noise=0.3,0.4", (0.3, 0.4)),
    ],
)
def test_a_lesson_sweeps_its_evidence_and_its_scene(
    project: Project, axis: str, values: tuple[object, ...]
) -> None:
    sweep = read_sweep(project, project.find("2"), [axis], [])
    assert (sweep.chapter.id, next(iter(sweep.axes.values()))) == ("p1-training", values)


def test_what_is_asked_of_a_chapter_without_a_core_is_refused(project: Project) -> None:
    with pytest.raises(ParameterError, match="--of must be left out: the chapter has no core"):
        read_sweep(project, project.find("recorded-data"), ["seed=1,2"], [], "gamma")


# What it leaves -----------------------------------------------------------------------------------


def test_what_a_sweep_of_a_core_leaves(
    swept: SweepProject, inswsn: Command, cluster: Callable[..., str]
) -> None:
    root, at = swept.project.root, ("--dask", cluster())
    done = inswsn(root, *swept.words("0.5,4", *at))
    assert done.returncode == 0, done.stderr
    found = swept.table()
    rows = [row for row in found if row["method"] != "ratio"]
    assert [row["value"] for row in found if row["method"] == "ratio"] == ["0.5", "4.0"]
    assert [(row["scale"], row["method"]) for row in rows] == [
        (scale, method) for scale in ("0.5", "4.0") for method in ("old", "new", "none")
    ]
    # 41 even numbers from 3.6 to 4.4: 2.5 % of 42 is a twentieth of a step beyond the first
    ends = float(rows[3].pop("low")), float(rows[3].pop("high"))
    assert ends == pytest.approx((3.601, 4.399))
    assert rows[3] == {
        "scale": "4.0", "method": "old", "column": "error", "quantity": "old.error", "unit": "m",
        "runs": "41", "value": "4.0",
    }  # fmt: skip
    leaders = swept.table("leaders")
    assert [(row["best"], row["next"]) for row in leaders] == [("old", "new"), ("new", "old")]
    assert float(leaders[0]["lead"]) == pytest.approx(50)
    facts = json.loads((swept.folder / "sweep.json").read_text())
    assert (facts["core"], facts["grid"]) == ("minicore:Core", {"scale": [0.5, 4.0]})
    assert (swept.folder / "sweep.svg").read_text().startswith("<?xml")
    assert "the old one" not in done.stderr  # the terminal has keys, the figure has words
    assert "scale = 4.0: ratio.old-over-new = 4 (4 to 4)" in done.stdout
    assert "changes no number" not in done.stdout

    # one finding is drawn, and an axis that changes nothing is named
    done = inswsn(root, *swept.words("0.5,4", *at, "--of", "ratio.old-over-new"))
    assert done.stdout.count("ratio.old-over-new") == 2
    done = inswsn(root, *swept.words("0.5,4", *at, "--of", "ratio.old"))
    assert done.stderr.endswith("such as ratio.old-over-new, not 'ratio.old'.\n")
    assert "scale changes no number" in inswsn(root, *swept.words("6,7", *at)).stdout

    # what is there is not computed again, what failed is tried again, and the others go on
    done = inswsn(root, *swept.words("0.5,13,20", *at))
    assert done.returncode == 1
    assert "2 cells are there" not in done.stderr
    assert "1 cells computed, 1 were there." in done.stdout
    assert "scale=13.0: failed: Thirteen has no design." in done.stderr
    assert "1 of 3 cells failed, with the reasons in failed.csv" in done.stderr
    assert swept.table("failed") == [{"scale": "13.0", "reason": "Thirteen has no design."}]
    assert {row["scale"] for row in swept.table()} == {"0.5", "20.0"}
    assert inswsn(root, *swept.words("13", *at)).returncode == 1
    assert swept.calls() == {0.5: 1, 4.0: 1, 6.0: 1, 7.0: 1, 13.0: 2, 20.0: 1}
    assert inswsn(root, *swept.words("0.5", *at, "--fresh")).returncode == 0
    assert swept.calls()[0.5] == 2
    assert sorted(path.name for path in swept.folder.glob("*.*")) == [
        ".inswsn-run", "leaders.csv", "sweep.csv", "sweep.json",
    ], "one value makes no line, and none has failed"  # fmt: skip


def test_a_chapter_without_a_core_is_executed(
    mini: MiniProject, inswsn: Command, cluster: Callable[..., str]
) -> None:
    words = ["sweep", "00", "--grid", "scale=1,3", "--out", "made", "--dask", cluster()]
    done = inswsn(mini.root, *words)
    assert done.returncode == 0, done.stderr
    assert (mini.root / "made" / "sweep.csv").read_text() == (
        "scale,quantity,unit,runs,value,low,high\n1.0,twice,m,1,21.0,,\n3.0,twice,m,1,63.0,,\n"
    )
    assert "The chapter has no core, and so no figure and no leaders." in done.stdout
    # a run of the same parameters finds it
    assert lookup(mini, Request("00", {"scale": 3.0})) is not None


@pytest.mark.parametrize(
    ("threads", "said"), [(1, "has another library, other locks or another"), (2, "has 2 threads")]
)
def test_workers_that_would_find_other_numbers_are_refused(
    swept: SweepProject,
    inswsn: Command,
    cluster: Callable[..., str],
    monkeypatch: pytest.MonkeyPatch,
    threads: int,
    said: str,
) -> None:
    if threads == 1:
        monkeypatch.setattr("inswsn_book.make.sweep._state", lambda *_: str(time.monotonic_ns()))
    done = inswsn(swept.project.root, *swept.words("5", "--dask", cluster(threads)))
    assert (done.returncode, done.stdout) == (2, "")
    assert said in done.stderr
    assert not swept.calls()
    assert not swept.folder.exists()


@pytest.mark.parametrize("comes", [False, True])
def test_a_sweep_whose_only_worker_is_gone_takes_a_new_one_or_ends(
    swept: SweepProject, inswsn: Command, monkeypatch: pytest.MonkeyPatch, comes: bool
) -> None:
    scheduler = distributed.LocalCluster(
        n_workers=0, processes=False, dashboard_address=None, protocol="tcp"
    )
    workers = []

    def start() -> None:
        async def started() -> distributed.Worker:
            return await distributed.Worker(scheduler.scheduler_address, nthreads=1)

        workers.append(scheduler.sync(started))

    monkeypatch.setattr("inswsn_book.make.sweep._PATIENCE_SECONDS", 20.0 if comes else 0.2)
    asked = []

    def leave(*_: object) -> str:  # asked when cells are shared out, and by who computes them
        if not asked:
            asked.append(1)
            scheduler.sync(workers.pop().close)
            if comes:
                start()
        return "state"

    monkeypatch.setattr("inswsn_book.make.sweep._state", leave)
    with scheduler:
        start()
        done = inswsn(
            swept.project.root, *swept.words("5", "--dask", str(scheduler.scheduler_address))
        )
        for worker in workers:  # the cluster did not start it, and so does not end it
            scheduler.sync(worker.close)
    if comes:
        assert done.returncode == 0, done.stderr
        assert swept.calls() == {5.0: 1}
    else:
        assert done.returncode == 1
        assert "No worker is left at the Dask scheduler; what is finished is kept" in done.stderr
        assert not swept.calls()
