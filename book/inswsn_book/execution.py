"""Executing chapters in parallel: one process each, with progress, and a clean end when stopped."""

from __future__ import annotations

import json
import math
import os
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Mapping, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ThreadPoolExecutor, wait
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import nbformat

from inswsn_book.cache import Executed, chapter_key, lookup, store
from inswsn_book.checkout import RESULTS_VARIABLE, ROOT_VARIABLE
from inswsn_book.notebooks import (
    notebook_text,
    read_source,
    strip_run,
    unrepeatable_outputs,
)
from inswsn_book.parameters import Value
from inswsn_book.plugins import MODULES_VARIABLE
from inswsn_book.progress import Progress
from inswsn_book.project import Chapter, Project
from inswsn_book.provenance import available_cores, provenance, source_facts
from inswsn_book.publishing import reference_results
from inswsn_book.results import Results, read_results
from inswsn_lib.errors import BuildError, InswsnError, ParameterError
from inswsn_lib.files import DATA_VARIABLE

_STOP_SECONDS = 10.0
# Named here again: what executes chapters imports no numerics. A test holds them to be the same.
SOLVER_VARIABLE = "INSWSN_SOLVER"
SOLVERS = ("clarabel", "scs")


@dataclass(frozen=True)
class Surroundings:
    """What a chapter is executed in, beside its sources and its environment.

    Attributes
    ----------
    python : str
        The interpreter, a path.
    threads : int
        How many threads the linear algebra may use.
    solver : str
        Which one convex problems are given to where a design does not name one.
    variables : mapping of str to str
        Environment variables that are set on top of all others.
    """

    python: str = sys.executable
    threads: int = 1
    solver: str = SOLVERS[0]
    variables: Mapping[str, str] = field(default_factory=dict)


def chosen_surroundings() -> Surroundings:
    """Return those of the book, but for the solver that ``INSWSN_SOLVER`` names.

    Raises
    ------
    ParameterError
        If it names none.
    """
    solver = os.environ.get(SOLVER_VARIABLE) or SOLVERS[0]
    if solver not in SOLVERS:
        raise ParameterError(SOLVER_VARIABLE, solver, 'one of "clarabel", "scs"')
    return Surroundings(solver=solver)


class ChapterError(BuildError):
    """A chapter failed; the message names the chapter and the cell and holds the traceback.

    Attributes
    ----------
    refusal : str or None
        The sentence in which the library refused what it was given, if that was the reason.
    """

    refusal: str | None = None


@dataclass
class _Workers:
    """The processes that are running, so that all of them can be stopped."""

    stopping: threading.Event = field(default_factory=threading.Event)
    _processes: set[subprocess.Popen[str]] = field(default_factory=set)
    _guard: threading.Lock = field(default_factory=threading.Lock)

    def start(self, command: Sequence[str], environment: dict[str, str]) -> subprocess.Popen[str]:
        with self._guard:
            if self.stopping.is_set():
                raise ChapterError("stopped")
            process = subprocess.Popen(
                command,
                env=environment,
                stdin=subprocess.PIPE,  # its end tells the worker that this process is gone
                stdout=subprocess.PIPE,
                stderr=subprocess.PIPE,
                text=True,
                start_new_session=True,  # an interrupt reaches this process only; it stops them
            )
            self._processes.add(process)
        return process

    def ended(self, process: subprocess.Popen[str]) -> None:
        with self._guard:
            self._processes.discard(process)

    def stop(self) -> None:
        with self._guard:
            self.stopping.set()
            running = list(self._processes)
        for process in running:
            process.terminate()
        for process in running:
            try:
                process.wait(_STOP_SECONDS)
            except subprocess.TimeoutExpired:
                process.kill()


def execute_chapters(
    project: Project,
    chapters: Sequence[Chapter],
    progress: Progress,
    *,
    fresh: bool = False,
    jobs: int | None = None,
) -> list[Executed]:
    """Execute every chapter that the cache does not hold, those that take long first.

    Parameters
    ----------
    project : Project
        The checkout.
    chapters : sequence of Chapter
        The chapters.
    progress : Progress
        Told of each chapter and cell.
    fresh : bool
        Execute all of them, whatever the cache holds.
    jobs : int, optional
        How many at once. Default: one a core.

    Returns
    -------
    list of Executed
        In the order of `chapters`.

    Raises
    ------
    ChapterError
        If a cell raises. The other chapters that run are stopped.
    InswsnError
        If a source cannot be read.
    """
    found: dict[str, Executed] = {}
    due: list[Chapter] = []
    for chapter in chapters:
        entry = None if fresh else lookup(project, chapter, chapter_key(project, chapter, {}))
        if entry is None:
            due.append(chapter)
        else:
            found[chapter.name] = entry
            progress.unchanged(chapter.name)
    workers = _Workers()
    with ThreadPoolExecutor(max_workers=jobs or available_cores()) as pool:
        pending: set[Future[Executed]] = {
            pool.submit(_execute, project, chapter, progress, workers)
            for chapter in longest_first(project, due)
        }
        try:
            while pending:
                done, pending = wait(pending, return_when=FIRST_COMPLETED)
                errors = [error for error in map(Future.exception, done) if error is not None]
                if errors:
                    raise together(errors)
                for future in done:
                    found[future.result().chapter.name] = future.result()
        except BaseException:
            for future in pending:
                future.cancel()
            workers.stop()
            raise
    return [found[chapter.name] for chapter in chapters]


def longest_first(project: Project, chapters: Sequence[Chapter]) -> list[Chapter]:
    """Return chapters in the order in which they keep all workers busy to the end.

    A chapter takes as long as its published run took. One without a published run comes first:
    it may take long.

    Parameters
    ----------
    project : Project
        The checkout.
    chapters : sequence of Chapter
        The chapters.

    Returns
    -------
    list of Chapter
        Those that take equally long in the order given.
    """

    def seconds(chapter: Chapter) -> float:
        run = reference_results(project, chapter).provenance
        return math.inf if run is None else run.seconds

    return sorted(chapters, key=seconds, reverse=True)


def together(errors: list[BaseException]) -> BaseException:
    """Return one error that tells all of them if all are failures of chapters, else another one."""
    if all(isinstance(error, ChapterError) for error in errors):
        return ChapterError("\n\n".join(map(str, errors)))
    return next(error for error in errors if not isinstance(error, ChapterError))


def _execute(project: Project, chapter: Chapter, progress: Progress, workers: _Workers) -> Executed:
    """Execute a chapter for the book, and keep it if it may stand there."""
    key = chapter_key(project, chapter, {})
    # always in the same surroundings: a variable of the caller's must not reach the reference
    executed, results, _ = _run(project, chapter, {}, key, progress, workers, Surroundings())
    untrue = [sentence for sentence, held in results.sentences.items() if not held]
    if untrue:
        listing = "\n".join(f"  {sentence}" for sentence in untrue)
        raise ChapterError(
            f"Chapter {chapter.name} has sentences that its results do not bear out:\n{listing}"
        )
    problems = unrepeatable_outputs(executed)
    if problems:
        raise ChapterError(f"Chapter {chapter.name}: " + "\n".join(problems))
    entry = store(project, chapter, key, notebook_text(executed), results)
    progress.finished(chapter.name)
    return entry


def execute_once(
    project: Project,
    chapter: Chapter,
    parameters: Mapping[str, Value],
    progress: Progress,
    surroundings: Surroundings | None = None,
) -> tuple[Any, Results, dict[str, str]]:
    """Execute one chapter with other parameters or in other surroundings, and keep nothing.

    Parameters
    ----------
    project : Project
        The checkout.
    chapter : Chapter
        The chapter.
    parameters : mapping of str to value
        Checked values of declared parameters.
    progress : Progress
        Told of each cell.
    surroundings : Surroundings, optional
        Default: those in which the book is made.

    Returns
    -------
    notebook : nbformat.NotebookNode
        The executed notebook, without times and paths.
    results : Results
        What it recorded.
    files : dict of str to str
        The files that it wrote beside its results, by name.

    Raises
    ------
    ChapterError
        If a cell raises.
    InswsnError
        If the library refuses, in a cell, what a parameter leads it to; the sentence is its own.
    """
    workers = _Workers()
    key = chapter_key(project, chapter, dict(parameters))
    try:
        done = _run(
            project, chapter, parameters, key, progress, workers, surroundings or Surroundings()
        )
    except ChapterError as failure:
        if failure.refusal is None:
            raise
        raise InswsnError(failure.refusal) from None
    except BaseException:
        workers.stop()
        raise
    progress.finished(chapter.name)
    return done


def _run(
    project: Project,
    chapter: Chapter,
    parameters: Mapping[str, Value],
    key: str,
    progress: Progress,
    workers: _Workers,
    surroundings: Surroundings,
) -> tuple[Any, Results, dict[str, str]]:
    sources = source_facts(project, chapter)
    source = read_source(chapter)
    progress.started(chapter.name, len(source.cells) + bool(parameters))
    project.build.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(prefix=f"inswsn-{chapter.name}-") as name:
        folder = Path(name)
        nbformat.write(source, folder / "source.ipynb")
        job = {
            "source": str(folder / "source.ipynb"),
            "target": str(folder / "executed.ipynb"),
            "parameters": dict(parameters),
            "folder": str(folder),
        }
        began = time.monotonic()
        process = workers.start(
            [surroundings.python, "-m", "inswsn_book.worker", json.dumps(job)],
            _environment(project, folder, surroundings),
        )
        try:
            machine = _follow(chapter, process, progress)
        finally:
            workers.ended(process)
        results = folder / "results" / f"{chapter.number}.json"
        if not results.is_file():
            raise ChapterError(
                f"Chapter {chapter.name} wrote no results file {results.name}: "
                "its last code cell calls record.write()."
            )
        seconds = time.monotonic() - began
        executed = nbformat.read(folder / "executed.ipynb", as_version=4)
        added = {
            "cells": recording_cells(executed),
            "provenance": provenance(sources, machine, seconds),
        }
        # the key was taken before anything was read
        if chapter_key(project, chapter, dict(parameters)) != key:
            raise ChapterError(
                f"Chapter {chapter.name} changed while it was executed, or the library did; "
                "run it again."
            )
        files = {
            path.name: path.read_text(encoding="utf-8")
            for path in sorted(results.parent.iterdir())
            if path != results
        }
        return strip_run(executed), read_results(results).model_copy(update=added), files


def recording_cells(executed: Any) -> dict[str, str]:
    """Return the cell that recorded each quantity of an executed notebook, by their names.

    `ChapterRecord.quantity` leaves the name in the metadata of an output.
    """
    return {
        output["metadata"]["scrapbook"]["quantity"]: cell["id"]
        for cell in executed.cells
        for output in cell.get("outputs", [])
        if "quantity" in output.get("metadata", {}).get("scrapbook", {})
    }


def _environment(project: Project, folder: Path, surroundings: Surroundings) -> dict[str, str]:
    """Return the environment of a worker: so many threads a chapter, nothing left to chance."""
    threads = ("OMP", "OPENBLAS", "MKL", "NUMBA")
    personal = ("PYTHONPATH", "PYTHONSTARTUP", "MATPLOTLIBRC", "MPLBACKEND")
    kept = {name: value for name, value in os.environ.items() if name not in personal}
    if kept.get(DATA_VARIABLE):  # a kernel has a working folder of its own
        kept[DATA_VARIABLE] = str(Path(kept[DATA_VARIABLE]).absolute())
    return kept | {
        **{f"{name}_NUM_THREADS": str(surroundings.threads) for name in threads},
        SOLVER_VARIABLE: surroundings.solver,
        "PYTHONHASHSEED": "0",
        "PYTHONUNBUFFERED": "1",
        "PYDEVD_DISABLE_FILE_VALIDATION": "1",
        "IPYTHONDIR": str(folder / "ipython"),
        "MPLCONFIGDIR": str(project.build / "matplotlib"),  # its font cache, and no settings
        ROOT_VARIABLE: str(project.root),
        RESULTS_VARIABLE: str(folder / "results"),
        # where a reader's own modules lie
        MODULES_VARIABLE: os.environ.get(MODULES_VARIABLE, str(Path.cwd())),
        **surroundings.variables,
    }


def _follow(chapter: Chapter, process: subprocess.Popen[str], progress: Progress) -> dict[str, Any]:
    """Read a worker's events until it ends; return its machine, or raise if it failed."""
    assert process.stdout is not None
    assert process.stderr is not None
    noise: list[str] = []
    reader = threading.Thread(target=noise.extend, args=(process.stderr,), daemon=True)
    reader.start()
    event: dict[str, Any] = {}
    last_cell: dict[str, Any] = {}
    for line in process.stdout:
        try:
            event = json.loads(line)
        except json.JSONDecodeError:
            noise.append(line)
            continue
        if "id" in event:
            last_cell = event
            progress.cell(chapter.name, event["cell"] + 1)
    process.wait()
    reader.join()
    if event.get("done"):
        return dict(event["machine"])
    place = (
        f"cell {last_cell['cell'] + 1} of {last_cell['of']} ({last_cell['id']})"
        if last_cell
        else "before its first cell"
    )
    if "failed" in event:
        detail = event.get("traceback") or event["failed"]
        source = f"\n\n{event['source']}\n" if event.get("source") else "\n"
        failure = ChapterError(f"Chapter {chapter.name} failed in {place}:{source}\n{detail}")
        if event.get("name") in (InswsnError.__name__, ParameterError.__name__):
            failure.refusal = event["said"]
        raise failure
    raise ChapterError(
        f"Chapter {chapter.name} ended in {place} with status {process.returncode}:\n"
        + "".join(noise)
    )
