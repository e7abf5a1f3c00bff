"""Run a chapter and keep what it gives: one request, one key, one store.

A `Request` says which chapter is run, with which parameters, in which surroundings, and over which
changed files. `run` and `run_all` look its key up in the store, ``_build/store``, and execute the
chapter only if nothing is there. The book, ``inswsn run``, sweeps and the two studies are sets of
requests.
"""

from __future__ import annotations

import json
import math
import os
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor, as_completed
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from datetime import UTC, datetime
from functools import cache
from pathlib import Path
from typing import Any

from inswsn_book.cores import core_name, run_core
from inswsn_book.execution import ChapterError, Workers, execute_notebook
from inswsn_book.files import swap_folder, text_digest, tree_digest, write_whole
from inswsn_book.ledger import data_digest
from inswsn_book.notebooks import notebook_text, read_source, strip_run
from inswsn_book.parameters import REGRESSOR_RULE, Value, source_schema
from inswsn_book.progress import Progress
from inswsn_book.project import (
    MODULES_VARIABLE,
    RESULTS_VARIABLE,
    ROOT_VARIABLE,
    Chapter,
    Project,
)
from inswsn_book.provenance import available_cores, machine_facts, repository_state
from inswsn_book.results import Provenance, Results, read_results, write_results
from inswsn_lib import __version__
from inswsn_lib.errors import BuildError, InswsnError, ParameterError
from inswsn_lib.files import DATA_VARIABLE, data_mirror

# Raised when the form of the store, or the way in which chapters are executed, changes.
_FORM = 5
# How many digits of a key tell the library, the locks and the chapter's source; and how many
# entries of a chapter are kept that were made from others than the present ones.
_ORIGIN, _KEPT = 12, 3
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


@dataclass(frozen=True)
class Request:
    """What is to be run.

    Attributes
    ----------
    chapter : str
        Its number, two digits.
    parameters : mapping of str to value
        Those that are set; the others keep their defaults.
    surroundings : Surroundings
        Default: those in which the book is made, whatever the caller's environment says.
    overlay : mapping of str to str
        By path below the checkout: the whole text that stands in the place of that file for this
        run, such as a changed scenario or a changed source of a chapter.
    core : bool
        Call the chapter's core function and do not execute its notebook.
    """

    chapter: str
    parameters: Mapping[str, Value] = field(default_factory=dict)
    surroundings: Surroundings = field(default_factory=Surroundings)
    overlay: Mapping[str, str] = field(default_factory=dict)
    core: bool = False


@dataclass(frozen=True)
class Run:
    """What came of a request.

    Attributes
    ----------
    request : Request
    results : Results
        What the chapter recorded.
    notebook : str or None
        The text of the executed notebook, without times and paths; None for a core.
    files : dict of str to str
        The files that the chapter wrote for its reader, by name.
    """

    request: Request
    results: Results
    notebook: str | None = None
    files: Mapping[str, str] = field(default_factory=dict)


#: How a request ends
Outcome = Run | BuildError | InswsnError


# The store ----------------------------------------------------------------------------------------


@dataclass(frozen=True)
class _Prepared:
    """A request as it is run now: its chapter, the path of its source, and its key."""

    chapter: Chapter
    source: str
    parameters: dict[str, Value]  # that differ from their defaults
    sources: dict[str, str]  # for the provenance
    key: str


def _prepare(project: Project, request: Request) -> _Prepared:
    chapter, around = project.find(request.chapter), request.surroundings
    path = chapter.source.relative_to(project.root).as_posix()
    own = chapter.source.read_text(encoding="utf-8")
    source = request.overlay.get(path, own)
    schema = source_schema(source, chapter.source.name)
    checked = {name: schema[name].check(value) for name, value in request.parameters.items()}
    parameters = {name: v for name, v in checked.items() if v != schema[name].default}
    library = project.computing_digest()
    locks = tree_digest(project.root, project.locks)
    origin = text_digest(json.dumps([_FORM, chapter.name, text_digest(own), library, locks]))
    facts = {
        "origin": origin,
        "parameters": parameters,
        "regressors": [
            _modules_digest(str(value))
            for name, value in parameters.items()
            if schema[name].rule == REGRESSOR_RULE
        ],
        "python": _python_version(around.python),
        "surroundings": [around.threads, around.solver, dict(around.variables)],
        "overlay": {name: text_digest(text) for name, text in request.overlay.items()},
        "recorded data": data_mirror() is not None,
        "core": request.core,
    }
    key = f"{origin[:_ORIGIN]}-{text_digest(json.dumps(facts, sort_keys=True))[:32]}"
    sources = {"chapter": text_digest(source), "library": library, "locks": locks}
    return _Prepared(chapter, path, parameters, sources, key)


def request_key(project: Project, request: Request) -> str:
    """Return the key of a request: a digest of all that its run is made from.

    Its first part covers the chapter's source in the checkout, what of the two packages computes,
    and the locks; its second part also the parameters, the surroundings with the version of the
    interpreter, the overlay, a reader's own regressor, and whether there is a local folder of
    recorded data, not which one or what is in it. The data files that a chapter reads are known
    once it has run: they stand in its results with their digests, and `lookup` checks them.

    Raises
    ------
    ParameterError
        If there is no such chapter or parameter, or one may not have its value.
    InswsnError
        If the chapter's parameters cannot be read.
    """
    return _prepare(project, request).key


def lookup(project: Project, request: Request) -> Run | None:
    """Return the run of a request if the store has it and the data that it read are unchanged.

    Raises
    ------
    InswsnError
        As `request_key`.
    """
    entry = _entry(project, request)
    try:
        folder = entry.stat().st_ino
        results = read_results(entry / "results.json")
        notebook = None if request.core else _text_of(entry / "executed.ipynb")
        written = sorted((entry / "files").iterdir()) if (entry / "files").is_dir() else []
        files = {path.name: _text_of(path) for path in written}
        if entry.stat().st_ino != folder:  # another process has put its own there meanwhile
            return lookup(project, request)
    except (InswsnError, OSError, UnicodeDecodeError):
        return None
    for name, digest in results.data.items():
        # what the overlay replaces is a part of the key
        replaced = name.partition("#")[0] in request.overlay
        if not replaced and data_digest(project.root, name) != digest:
            return None
    return Run(request, results, notebook, files)


def keep(project: Project, request: Request, run: Run) -> None:
    """Put a run into the store, whole or not at all, and drop old ones of its chapter.

    Those that were made from another library, other locks or another source of the chapter go, but
    for the last few.

    Raises
    ------
    OSError
        If the store cannot be written.
    """
    entry = _entry(project, request)
    entry.parent.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(dir=entry.parent, prefix="new-") as name:
        made = Path(name) / entry.name
        if run.notebook is not None:
            write_whole(made / "executed.ipynb", run.notebook)
        for file, text in run.files.items():
            write_whole(made / "files" / file, text)
        write_results(run.results, made / "results.json")  # an entry without them is no entry
        try:
            swap_folder(made, entry)
        except OSError:  # another process has just put there what it found for the same key
            if not (entry / "results.json").is_file():
                raise
    _prune(entry)


def _prune(entry: Path) -> None:
    origin = entry.name[:_ORIGIN]
    others = [other for other in entry.parent.iterdir() if not other.name.startswith(origin)]
    for other in sorted(others, key=_modified, reverse=True)[_KEPT:]:
        shutil.rmtree(other, ignore_errors=True)


def _modified(path: Path) -> float:
    try:
        return path.stat().st_mtime
    except OSError:  # another process has just removed it
        return 0.0


def _entry(project: Project, request: Request) -> Path:
    return project.store / request.chapter / request_key(project, request)


def _text_of(path: Path) -> str:
    return path.read_bytes().decode("utf-8")  # line ends as they are


def _modules_digest(regressor: str) -> str:
    """Return the digest of the reader's own module, or package, that a regressor is in."""
    folder = Path(os.environ.get(MODULES_VARIABLE, str(Path.cwd())))
    top = regressor.partition(":")[0].partition(".")[0]
    files = [folder / f"{top}.py", *(folder / top).rglob("*.py")]
    return tree_digest(folder, [path for path in files if path.is_file()])


def _python_version(python: str) -> str:
    own = python == sys.executable
    return ".".join(map(str, sys.version_info[:3])) if own else _asked_version(python)


@cache
def _asked_version(python: str) -> str:
    ask = "import platform; print(platform.python_version())"
    try:
        done = subprocess.run([python, "-c", ask], capture_output=True, text=True, check=True)
    except (OSError, subprocess.CalledProcessError):
        raise ParameterError("python", python, "the path of an interpreter") from None
    return done.stdout.strip()


def book_runs(project: Project) -> list[Run]:
    """Return the runs of all chapters as the book has them, in order, from the store.

    Raises
    ------
    InswsnError
        If a chapter has not been built as it is now.
    """
    runs = []
    for chapter in project.chapters():
        run = lookup(project, Request(chapter.number))
        if run is None:
            raise InswsnError(
                f"Chapter {chapter.number} has not been built as it is now; build it first: "
                "make book."
            )
        runs.append(run)
    return runs


def reference_results(project: Project, number: str) -> Results:
    """Return the reference results of a chapter; without any quantity if there are none yet."""
    try:
        return read_results(project.published / f"{number}.json")
    except InswsnError:  # none yet, or one of an older schema: all of it is new
        return Results(chapter=number, parameters={}, data={}, quantities=())


# Running ------------------------------------------------------------------------------------------


def run(project: Project, request: Request, progress: Progress, *, fresh: bool = False) -> Run:
    """Return the run of a request: from the store unless `fresh`, or executed now and kept.

    Raises
    ------
    ChapterError
        If a cell raises.
    InswsnError
        If the library refuses, in a cell, what a parameter leads it to; the sentence is its own.
    """
    try:
        (done,) = run_all(project, [request], progress, fresh=fresh, jobs=1)
    except ChapterError as failure:
        if failure.refusal is None:
            raise
        raise InswsnError(failure.refusal) from None
    return done


def run_all(
    project: Project,
    requests: Sequence[Request],
    progress: Progress,
    *,
    fresh: bool = False,
    jobs: int | None = None,
    check: Callable[[Run], None] = lambda _: None,
) -> list[Run]:
    """Return the runs of requests, in their order; the first failure stops all.

    Parameters
    ----------
    check : callable, optional
        Called with each run as it ends; what it raises stops all.

    Raises
    ------
    ChapterError
        If a cell raises. The others that run are stopped; those that have ended are kept.
    InswsnError
        If a source cannot be read.
    """
    runs: dict[int, Run] = {}

    def ended(place: int, outcome: Outcome) -> None:
        if not isinstance(outcome, Run):
            raise outcome
        check(outcome)
        runs[place] = outcome

    run_each(project, requests, progress, ended, fresh=fresh, jobs=jobs)
    return [runs[place] for place in range(len(requests))]


def run_each(
    project: Project,
    requests: Sequence[Request],
    progress: Progress,
    ended: Callable[[int, Outcome], None],
    *,
    fresh: bool = False,
    jobs: int | None = None,
) -> None:
    """Run requests side by side, those that take long first, and tell how each of them ends.

    Cores are called one after the other in this thread. `ended` is called in this thread with the
    place of a request and its run or its failure; what it raises stops all, as an interrupt does.
    The other parameters are those of `run_all`.
    """
    due = []
    for place, request in enumerate(requests):
        found = None if fresh else lookup(project, request)
        if found is None:
            due.append(place)
        else:
            progress.unchanged(project.find(request.chapter).name)
            ended(place, found)
    workers = Workers()

    def one(place: int) -> Outcome:
        try:
            return _run_and_keep(project, requests[place], progress, workers)
        except (BuildError, InswsnError) as failure:
            return failure

    for place in due:
        if requests[place].core:
            ended(place, one(place))
    rest = [place for place in due if not requests[place].core]
    rest.sort(key=lambda place: _published_seconds(project, requests[place].chapter), reverse=True)
    with ThreadPoolExecutor(max_workers=jobs or available_cores()) as pool:
        pending = {pool.submit(one, place): place for place in rest}
        try:
            for future in as_completed(pending):
                ended(pending[future], future.result())
        except BaseException:
            for future in pending:
                future.cancel()
            workers.stop()
            raise


def _published_seconds(project: Project, chapter: str) -> float:
    """Return how long the published run of a chapter took; if there is none, it may be long."""
    made = reference_results(project, chapter).provenance
    return math.inf if made is None else made.seconds


def compute_core(project: Project, request: Request) -> Run:
    """Return what the core function of a chapter finds, called in this process.

    Raises
    ------
    InswsnError
        If the chapter has no core, or the core refuses a parameter.
    """
    chapter, around = project.find(request.chapter), request.surroundings
    source = chapter.source.read_text(encoding="utf-8")
    name = core_name(source)
    if name is None:
        raise InswsnError(f"Chapter {request.chapter} has no core.")
    values = source_schema(source, chapter.source.name).check(request.parameters)
    results, files = run_core(
        project.root, request.chapter, name, values, threads=around.threads, solver=around.solver
    )
    return Run(request, results, None, files)


def _run_and_keep(project: Project, request: Request, progress: Progress, workers: Workers) -> Run:
    prepared = _prepare(project, request)
    commit, clean = repository_state(project.root)
    began = time.monotonic()
    if request.core:
        if request.overlay:
            raise InswsnError("A core is called on the files of the checkout, without an overlay.")
        done, machine = compute_core(project, request), machine_facts()
    else:
        done, machine = _execute(project, request, prepared, progress, workers)
    made = Provenance(
        version=__version__,
        commit=commit,
        clean=clean and not request.overlay,
        sources=prepared.sources,
        finished=datetime.now(UTC).strftime("%Y-%m-%d %H:%M UTC"),
        seconds=round(time.monotonic() - began, 1),
        **machine,
    )
    done = replace(done, results=done.results.model_copy(update={"provenance": made}))
    # the key was taken before anything was read
    if request_key(project, request) != prepared.key:
        raise ChapterError(
            f"Chapter {prepared.chapter.name} changed while it was executed, or the library did; "
            "run it again."
        )
    keep(project, request, done)
    if not request.core:
        progress.finished(prepared.chapter.name)
    return done


def _execute(
    project: Project, request: Request, prepared: _Prepared, progress: Progress, workers: Workers
) -> tuple[Run, dict[str, Any]]:
    """Execute a chapter's notebook; return its run and the facts of its machine."""
    chapter, around = prepared.chapter, request.surroundings
    with (
        _overlaid(project.root, request.overlay) as root,
        tempfile.TemporaryDirectory(prefix=f"inswsn-{chapter.name}-") as name,
    ):
        folder = Path(name)
        executed, machine = execute_notebook(
            chapter.name,
            read_source(Chapter(chapter.name, root / prepared.source)),
            prepared.parameters,
            folder,
            around.python,
            _environment(project, root, folder, around),
            workers,
            progress,
        )
        written = folder / "results" / f"{chapter.number}.json"
        if not written.is_file():
            raise ChapterError(
                f"Chapter {chapter.name} wrote no results file {written.name}: "
                "its last code cell calls record.write()."
            )
        results = read_results(written)
        others = [path for path in sorted(written.parent.iterdir()) if path != written]
        files = {path.name: _text_of(path) for path in others}
    results = results.model_copy(update={"cells": _recording_cells(executed)})
    return Run(request, results, notebook_text(strip_run(executed)), files), machine


@contextmanager
def _overlaid(root: Path, overlay: Mapping[str, str]) -> Iterator[Path]:
    """Give a folder that is the checkout, by links, but for the files of an overlay."""
    if not overlay:
        yield root
        return
    with tempfile.TemporaryDirectory(prefix="inswsn-overlay-") as name:
        _link(root, Path(name).resolve(), overlay)
        yield Path(name).resolve()


def _link(source: Path, target: Path, overlay: Mapping[str, str]) -> None:
    target.mkdir(exist_ok=True)
    below: dict[str, dict[str, str]] = {}
    for name, text in overlay.items():
        head, _, rest = name.partition("/")
        below.setdefault(head, {})[rest] = text
    for path in source.iterdir() if source.is_dir() else ():
        if path.name not in below:
            (target / path.name).symlink_to(path)
    for head, changed in below.items():
        if "" in changed:
            (target / head).write_text(changed[""], encoding="utf-8", newline="")
        else:
            _link(source / head, target / head, changed)


def _recording_cells(executed: Any) -> dict[str, str]:
    """Return the cell that recorded each quantity of an executed notebook, by their names.

    `ChapterRecord.quantity` leaves the name in the metadata of an output.
    """
    return {
        output["metadata"]["scrapbook"]["quantity"]: cell["id"]
        for cell in executed.cells
        for output in cell.get("outputs", [])
        if "quantity" in output.get("metadata", {}).get("scrapbook", {})
    }


def _environment(
    project: Project, root: Path, folder: Path, surroundings: Surroundings
) -> dict[str, str]:
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
        ROOT_VARIABLE: str(root),
        RESULTS_VARIABLE: str(folder / "results"),
        # where a reader's own modules lie
        MODULES_VARIABLE: os.environ.get(MODULES_VARIABLE, str(Path.cwd())),
        **surroundings.variables,
    }
