"""A sweep: one request for each cell of a grid of parameters, and a table over their runs.

Cells are computed on Dask, by processes of this machine or by the workers of a scheduler. Each run
goes to the one store as it ends, so that a cell which is there is not computed again.
"""

from __future__ import annotations

import io
import itertools
import json
import logging
import math
import sys
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from functools import cache
from pathlib import Path
from typing import Any

from rich import progress as bars
from rich.console import Console
from rich.table import Table

import inswsn_lib
from inswsn_book.cores import SCORES, core_name
from inswsn_book.files import text_digest, write_whole
from inswsn_book.parameters import Schema, Value, chapter_schema
from inswsn_book.progress import Bars, Quiet
from inswsn_book.project import Chapter, Project, is_checkout
from inswsn_book.provenance import available_cores, machine_facts, repository_state
from inswsn_book.running import gather_parameters
from inswsn_book.runs import Request, Run, chosen_surroundings, keep, lookup, request_key, run
from inswsn_lib import __version__
from inswsn_lib.errors import BuildError, InswsnError, ParameterError

MOST_CELLS = 10_000
_MOST_ROWS = 40
_CONNECT_SECONDS = 5
# How often the processes of this machine are started, if one ends at once
_STARTS = 3
# An interrupt is for the command, which ends its workers
_IGNORE_INTERRUPTS = "import signal; signal.signal(signal.SIGINT, signal.SIG_IGN)"
_FILES = ("sweep.csv", "leaders.csv", "failed.csv", "sweep.svg", "sweep.json")

Row = dict[str, Any]


# The grid -----------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Sweep:
    """A chapter over a grid: axes with the values that they go through, and fixed settings.

    `core` names the function that is called in each cell; without one the notebook is executed.
    """

    chapter: Chapter
    schema: Schema
    core: str | None
    axes: Mapping[str, tuple[Value, ...]]
    settings: Mapping[str, Value]

    @property
    def places(self) -> list[dict[str, Value]]:
        """The values of each cell on the axes; the last axis goes fastest."""
        values = itertools.product(*self.axes.values())
        return [dict(zip(self.axes, cell, strict=True)) for cell in values]

    @property
    def requests(self) -> list[Request]:
        """What is run in each cell."""
        around, core = chosen_surroundings(), self.core is not None
        return [
            Request(self.chapter.number, {**self.settings, **place}, around, core=core)
            for place in self.places
        ]


def read_sweep(
    project: Project, chapter: Chapter, axes: Iterable[str], settings: Iterable[str]
) -> Sweep:
    """Return the sweep that a user asks for; refuse names and values that may not be."""
    schema, data = chapter_schema(project.root, chapter.number), project.root / "data"
    found: dict[str, tuple[Value, ...]] = {}
    for axis in axes:
        name, equals, text = axis.partition("=")
        if not equals or name in found:
            raise ParameterError("--grid", axis, "name=value,value,..., once for each name")
        values = [
            gather_parameters(schema, (f"{name}={part}",), None, data)[name]
            for part in text.split(",")
        ]
        if len(set(values)) < len(values):
            raise ParameterError("--grid", axis, "a list without repetitions")
        found[name] = tuple(values)
    chosen = gather_parameters(schema, settings, None, data)
    for name in chosen:
        if name in found:
            raise ParameterError("-p", f"{name}={chosen[name]}", f"left out: --grid varies {name}")
    count = math.prod(map(len, found.values()))
    if count > MOST_CELLS:
        raise ParameterError("--grid", f"of {count} cells", f"of {MOST_CELLS} cells at most")
    core = core_name(chapter.source.read_text(encoding="utf-8"))
    return Sweep(chapter, schema, core, found, chosen)


# Computing ----------------------------------------------------------------------------------------


class SweepProgress(Bars):
    """Shows how many cells are done."""

    def __init__(self, console: Console | None = None) -> None:
        super().__init__(
            console,
            bars.TextColumn("{task.description}"),
            bars.BarColumn(bar_width=24),
            bars.TextColumn("{task.completed:.0f} of {task.total:.0f} cells"),
            bars.TimeRemainingColumn(),
        )

    def started(self, name: str, cells: int, there: int) -> None:
        """Say how many cells there are, and how many of them are in the store."""
        self._task = self._bars.add_task(name, total=cells, completed=there)
        self.say(f"{name}: {cells} cell{'s' if cells != 1 else ''}, of which {there} are there")

    def ended(self, place: Mapping[str, Value], failure: str | None) -> None:
        """Say that a cell has ended."""
        self._bars.advance(self._task)
        cell = ", ".join(f"{name}={value}" for name, value in place.items()) or "the one cell"
        if failure is not None:
            self.say(f"{cell}: failed: {failure}")
        elif not self._live:
            self.say(f"{cell}: done")


def run_sweep(
    project: Project,
    sweep: Sweep,
    progress: SweepProgress,
    *,
    out: Path | None = None,
    jobs: int | None = None,
    dask: str | None = None,
    fresh: bool = False,
) -> Finished:
    """Compute the cells of a sweep that are not in the store, and write its files.

    `dask` is the address of a scheduler, in place of `jobs` processes of this machine. A cell that
    fails leaves a reason; a worker that would find other numbers, and a scheduler that goes away,
    end the sweep.
    """
    if dask is not None and jobs is not None:
        raise ParameterError("--jobs", jobs, "left out: the cluster of --dask has its own workers")
    wanted = json.dumps([sweep.axes, sweep.settings, chosen_surroundings().solver])
    name = f"{sweep.chapter.name}-sweep-{text_digest(wanted)[:8]}"
    folder = out or project.root / "runs" / name
    if folder.exists() and (
        not folder.is_dir() or {path.name for path in folder.iterdir()} - set(_FILES)
    ):
        raise ParameterError("--out", str(folder), "a new folder, or one that holds a sweep alone")
    requests, places = sweep.requests, sweep.places
    found = {} if fresh else {c: lookup(project, request) for c, request in enumerate(requests)}
    outcomes: dict[int, Run | str] = {cell: run for cell, run in found.items() if run is not None}
    due = {cell: request for cell, request in enumerate(requests) if cell not in outcomes}
    there = len(outcomes)
    progress.started(sweep.core or sweep.chapter.name, len(requests), there)

    def ended(cell: int, outcome: Run | str) -> None:
        # a worker of this machine has put it there already
        if isinstance(outcome, Run) and (fresh or lookup(project, requests[cell]) is None):
            keep(project, requests[cell], outcome)
        outcomes[cell] = outcome
        progress.ended(places[cell], outcome if isinstance(outcome, str) else None)

    if due:
        with _client(dask, min(jobs or available_cores(), len(due))) as client:
            _compute(client, project, fresh, due, ended)
    return _write(project, sweep, folder, [outcomes[cell] for cell in sorted(outcomes)], there)


@contextmanager
def _client(address: str | None, jobs: int) -> Iterator[Any]:
    """Have the workers of a scheduler, or processes of this machine, which end with it."""
    import dask  # noqa: PLC0415  # they take a second to load
    import distributed  # noqa: PLC0415

    for name in ("distributed", "tornado.application", "asyncio"):
        # Dask's tracebacks are kept from the terminal: what they mean is told in a sentence
        logging.getLogger(name).setLevel(logging.CRITICAL + 1)
    # one thread each, and without Dask's own settings of the allocator: they slow large arrays
    threads = {f"{name}_NUM_THREADS": 1 for name in ("OMP", "OPENBLAS", "MKL", "NUMBA")}
    options = {
        "distributed.nanny.pre-spawn-environ": threads,
        "distributed.comm.timeouts.connect": _CONNECT_SECONDS,
    }
    with dask.config.set(options):
        if address is None:
            with _local_cluster(jobs) as cluster, distributed.Client(cluster) as client:
                yield client
            return
        try:
            client = distributed.Client(address, timeout=_CONNECT_SECONDS)
        except (OSError, ValueError, ImportError, TypeError):
            raise ParameterError(
                "--dask", address, "the address of a Dask scheduler that answers"
            ) from None
        with client:
            if not client.nthreads():
                raise InswsnError(f"The Dask scheduler at {address} has no worker.")
            yield client


def _local_cluster(jobs: int) -> Any:
    import distributed  # noqa: PLC0415

    for _ in range(_STARTS):
        try:
            return distributed.LocalCluster(
                n_workers=jobs, threads_per_worker=1, memory_limit=0, dashboard_address=None,
                silence_logs=logging.CRITICAL, preload=[_IGNORE_INTERRUPTS],
            )  # fmt: skip
        except RuntimeError:  # a process ended before it had begun: it is not replaced then
            continue
    raise BuildError("No process of this machine stayed alive long enough to compute.")


def _compute(
    client: Any,
    project: Project,
    fresh: bool,
    due: Mapping[int, Request],
    ended: Callable[[int, Run | str], None],
) -> None:
    """Share cells out; tell of each as it ends."""
    from concurrent.futures import CancelledError  # noqa: PLC0415

    import distributed  # noqa: PLC0415

    futures = {
        client.submit(
            _compute_cell, str(project.root), request, _state(project, request), fresh, pure=False
        ): cell
        for cell, request in due.items()
    }
    for future in distributed.as_completed(futures, loop=client.loop):
        try:
            outcome = future.result()
        except CancelledError:
            raise BuildError(
                "The Dask scheduler is gone; what is finished is kept, and the same command goes "
                "on from there."
            ) from None
        except distributed.scheduler.KilledWorker:
            outcome = "each process that computed it ended before it had"
        ended(futures[future], outcome)
        future.release()


def _compute_cell(root: str, request: Request, state: str, fresh: bool) -> Run | str:
    """Run a request in a worker; return why it failed, if it did.

    A worker is refused that would find other numbers: whose state is not the command's, or that
    computes in several threads.
    """
    import distributed  # noqa: PLC0415

    worker = distributed.get_worker()
    here = Path(root)
    project = Project(here if is_checkout(here) else Path(inswsn_lib.__file__).parents[1])
    request = replace(request, surroundings=replace(request.surroundings, python=sys.executable))
    if worker.state.nthreads != 1:
        raise InswsnError(
            f"The Dask worker at {worker.address} has {worker.state.nthreads} threads; start it "
            "with --nthreads 1, and more of them on a machine with more cores."
        )
    try:
        if _state(project, request) == state:
            return run(project, request, Quiet(), fresh=fresh)
    except Exception as error:
        known = isinstance(error, InswsnError | BuildError)
        return str(error) if known else f"{type(error).__name__}: {error}"
    raise InswsnError(
        f"The Dask worker at {worker.address} has another library, other locks or another chapter "
        "than this command; install the same checkout there and restart it."
    )


def _state(project: Project, request: Request) -> str:
    """Return the key of a request, and what of the library this process has loaded."""
    return f"{request_key(project, request)}-{_loaded_library()}"


@cache
def _loaded_library() -> str:
    return Project(Path()).computing_digest()  # as it was when this process was first asked


# What a sweep leaves ------------------------------------------------------------------------------


@dataclass(frozen=True)
class Finished:
    """A sweep that has come to its end: its folder, and what the terminal tells of it.

    Rows have the values of a cell on the axes: those of the leaders also ``best``, ``error``,
    ``next``, and by how many per cent the best is below the next, ``lead`` and ``within``; those
    that failed the ``reason``.
    """

    folder: Path
    leaders: list[Row]
    failed: list[Row]
    computed: int
    there: int
    no_figure: str  # why there is none


def _write(
    project: Project, sweep: Sweep, folder: Path, outcomes: Sequence[Run | str], there: int
) -> Finished:
    """Write the files of a sweep, each whole or not at all."""
    import pandas as pd  # noqa: PLC0415  # what refuses a grid needs no numerics

    found = list(zip(sweep.places, outcomes, strict=True))
    runs = [(place, run) for place, run in found if isinstance(run, Run)]
    failed = [{**place, "reason": reason} for place, reason in found if isinstance(reason, str)]
    rows = [row for place, run in runs for row in _rows(place, run, sweep.core is not None)]
    leaders = [
        {**place, **json.loads(run.files[SCORES])["leader"]} for place, run in runs if sweep.core
    ]
    for name, table in (("sweep", rows), ("leaders", leaders), ("failed", failed)):
        path = folder / f"{name}.csv"
        path.unlink(missing_ok=True)
        if table or name == "sweep":
            frame = pd.DataFrame(table, dtype=object)  # each number with all its digits
            write_whole(path, frame.to_csv(index=False, lineterminator="\n"))
    no_figure = _write_figure(folder / "sweep.svg", sweep, pd.DataFrame(rows), runs)
    write_whole(folder / "sweep.json", _provenance(project, sweep, len(failed)))
    return Finished(folder, leaders, failed, len(runs) - there, there, no_figure)


def _rows(place: Mapping[str, Value], run: Run, of_core: bool) -> Iterator[Row]:
    for quantity in run.results.quantities:
        method, _, column = quantity.name.rpartition(".")
        low, high = quantity.interval or (None, None)
        row: Row = {"method": method, "column": column} if of_core else {}
        row |= {
            "quantity": quantity.name, "unit": quantity.unit, "runs": quantity.runs,
            "value": quantity.value, "low": low, "high": high,
        }  # fmt: skip
        # an axis may be called as a column is, such as runs
        yield {**place, **{name: value for name, value in row.items() if name not in place}}


def _write_figure(path: Path, sweep: Sweep, frame: Any, runs: Sequence[tuple[Any, Run]]) -> str:
    """Draw the figure, or return why there is none."""
    from inswsn_lib.plotting import draw_scores  # noqa: PLC0415

    path.unlink(missing_ok=True)
    if sweep.core is None or not runs:
        return "no cell is complete." if sweep.core else "the chapter has no core, and no headline."
    words = json.loads(runs[0][1].files[SCORES])
    methods = {m: label for m, label in words["methods"].items() if m not in words["baselines"]}
    units = {name: sweep.schema[name].unit for name in sweep.axes}
    try:
        fig = draw_scores(
            frame.rename(columns={"value": "median"}), units, words["headline"], methods
        )
    except ParameterError as error:
        return str(error)
    # a file is passed on without the page that explains it
    told = "Lines: medians of the runs. Bands: from 2.5 to 97.5 % of them."
    fig.supxlabel(told, fontsize="small")
    facts = {"Title": f"{sweep.core}. {told}", "Date": None, "Creator": None}
    stream = io.StringIO()
    fig.savefig(stream, format="svg", metadata=facts, facecolor="white")
    write_whole(path, stream.getvalue())
    return ""


def _provenance(project: Project, sweep: Sweep, failed: int) -> str:
    commit, clean = repository_state(project.root)
    settings = sweep.schema.check(sweep.settings)
    facts = {
        "version": __version__,
        "commit": commit,
        "clean": clean,
        "chapter": sweep.chapter.name,
        "core": sweep.core,
        "grid": {name: list(values) for name, values in sweep.axes.items()},
        "parameters": {name: v for name, v in settings.items() if name not in sweep.axes},
        "solver": chosen_surroundings().solver,
        "failed cells": failed,
        "finished": datetime.now(UTC).strftime("%Y-%m-%d %H:%M UTC"),
        "machine of the command": machine_facts(),
    }
    return json.dumps(facts, indent=2, ensure_ascii=False) + "\n"


def show_leaders(sweep: Sweep, finished: Finished, console: Console) -> None:
    """Write which method leads in each cell, and by how much."""
    if not finished.leaders:
        return
    table = Table(*sweep.axes, "best", "error", "next", "lead", box=None, pad_edge=False)
    for row in finished.leaders[:_MOST_ROWS]:
        lead = "" if row["next"] is None else f"{row['lead']:.2f} ± {row['within']:.2f} %"
        places = (str(row[name]) for name in sweep.axes)
        table.add_row(*places, row["best"], f"{row['error']:.4g}", row["next"] or "", lead)
    console.print(table)
    if len(finished.leaders) > _MOST_ROWS:
        console.print(f"and {len(finished.leaders) - _MOST_ROWS} cells more, in leaders.csv")
