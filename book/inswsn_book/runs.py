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
import platform
import shutil
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor, as_completed
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field, replace
from datetime import UTC, datetime
from functools import cache
from pathlib import Path
from typing import Any

from inswsn_book.cores import run_core
from inswsn_book.files import swap_folder, text_digest, tree_digest, write_whole
from inswsn_book.ledger import data_digest
from inswsn_book.notebooks import notebook_text, read_source, strip_run
from inswsn_book.parameters import REGRESSOR_RULE, Schema, Value, source_schema
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
    """What a chapter is executed in, beside its sources and its environment."""

    python: str = sys.executable
    threads: int = 1  # that the linear algebra may use
    solver: str = SOLVERS[0]  # of convex problems, where a design does not name one
    variables: Mapping[str, str] = field(default_factory=dict)  # set on top of all others


def chosen_surroundings() -> Surroundings:
    """Return those of the book, but for the solver that ``INSWSN_SOLVER`` names."""
    solver = os.environ.get(SOLVER_VARIABLE) or SOLVERS[0]
    if solver not in SOLVERS:
        raise ParameterError(SOLVER_VARIABLE, solver, 'one of "clarabel", "scs"')
    return Surroundings(solver=solver)


@dataclass(frozen=True)
class Request:
    """What is to be run; parameters that are not set keep their defaults.

    An overlay gives, by path below the checkout, the whole text that stands in the place of that
    file, such as a changed scenario or source. `core` asks for the chapter's core function in place
    of its notebook. The surroundings are those of the book whatever the caller's environment says.
    """

    chapter: str
    parameters: Mapping[str, Value] = field(default_factory=dict)
    surroundings: Surroundings = field(default_factory=Surroundings)
    overlay: Mapping[str, str] = field(default_factory=dict)
    core: bool = False


@dataclass(frozen=True)
class Run:
    """What came of a request."""

    request: Request
    results: Results
    notebook: str | None = None  # executed, without times and paths; None for a core
    files: Mapping[str, str] = field(default_factory=dict)  # written for the reader, by name


#: How a request ends
Outcome = Run | BuildError | InswsnError


class ChapterError(BuildError):
    """A chapter failed; the message names the chapter and the cell and holds the traceback."""

    #: The sentence in which the library refused what it was given, if that was the reason.
    refusal: str | None = None


# The store ----------------------------------------------------------------------------------------


@dataclass(frozen=True)
class _Prepared:
    """A request as it is run now."""

    chapter: Chapter
    schema: Schema
    parameters: dict[str, Value]  # that differ from their defaults
    sources: dict[str, str]  # their digests, for the provenance
    key: str


def _prepare(project: Project, request: Request) -> _Prepared:
    chapter, around = project.find(request.chapter), request.surroundings
    own = chapter.source.read_text(encoding="utf-8")
    source = request.overlay.get(f"chapters/{chapter.source.name}", own)
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
        "python": _version_of(around.python),
        "surroundings": [around.threads, around.solver, dict(around.variables)],
        "overlay": {name: text_digest(text) for name, text in request.overlay.items()},
        "recorded data": data_mirror() is not None,
        "core": request.core,
    }
    key = f"{origin[:_ORIGIN]}-{text_digest(json.dumps(facts, sort_keys=True))[:32]}"
    sources = {"chapter": text_digest(source), "library": library, "locks": locks}
    return _Prepared(chapter, schema, parameters, sources, key)


def request_key(project: Project, request: Request) -> str:
    """Return the key of a request: a digest of all that its run is made from.

    Its first part covers the chapter's source in the checkout, what of the two packages computes,
    and the locks; its second part also the parameters, the surroundings with the version of the
    interpreter, the overlay, a reader's own regressor, and whether there is a local folder of
    recorded data, not which one or what is in it. The data files that a chapter reads are known
    once it has run: they stand in its results with their digests, and `lookup` checks them.
    """
    return _prepare(project, request).key


def lookup(project: Project, request: Request) -> Run | None:
    """Return the run of a request if the store has it and the data that it read are unchanged."""
    entry = _entry(project, request)
    try:
        results = read_results(entry / "results.json")
        notebook = None if request.core else _text_of(entry / "executed.ipynb")
        files = _texts_of(entry / "files") if (entry / "files").is_dir() else {}
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
    with suppress(OSError):  # another process has just removed some
        others = [e for e in entry.parent.iterdir() if e.name[:_ORIGIN] != entry.name[:_ORIGIN]]
        for old in sorted(others, key=lambda e: e.stat().st_mtime, reverse=True)[_KEPT:]:
            shutil.rmtree(old, ignore_errors=True)


def _entry(project: Project, request: Request) -> Path:
    return project.store / request.chapter / request_key(project, request)


def _text_of(path: Path) -> str:
    return path.read_bytes().decode("utf-8")  # line ends as they are


def _texts_of(folder: Path) -> dict[str, str]:
    return {path.name: _text_of(path) for path in sorted(folder.iterdir())}


def _modules_digest(regressor: str) -> str:
    """Return the digest of the reader's own module, or package, that a regressor is in."""
    folder = Path(os.environ.get(MODULES_VARIABLE, str(Path.cwd())))
    top = regressor.partition(":")[0].partition(".")[0]
    files = [folder / f"{top}.py", *(folder / top).rglob("*.py")]
    return tree_digest(folder, [path for path in files if path.is_file()])


@cache
def _version_of(python: str) -> str:
    if python == sys.executable:
        return platform.python_version()
    ask = "import platform; print(platform.python_version())"
    try:
        done = subprocess.run([python, "-c", ask], capture_output=True, text=True, check=True)
    except (OSError, subprocess.CalledProcessError):
        raise ParameterError("python", python, "the path of an interpreter") from None
    return done.stdout.strip()


def book_runs(project: Project) -> list[Run]:
    """Return the runs of all chapters as the book has them; refuse if one is not in the store."""
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
    """Return the run of a request, from the store unless `fresh`.

    A sentence in which the library refuses, in a cell, what a parameter leads it to is raised as it
    is; any other failure is a `ChapterError`.
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
    """Return the runs of requests, in their order; the first failure, or one of `check`, stops all.

    What has ended by then is kept.
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

    `ended` is called in this thread with the place of a request and its run or its failure; what it
    raises stops all, as an interrupt does. Cores are called one after the other in this thread.
    """
    due = []
    for place, request in enumerate(requests):
        found = None if fresh else lookup(project, request)
        if found is None:
            due.append(place)
        else:
            progress.unchanged(project.find(request.chapter).name)
            ended(place, found)
    kernels = _Kernels()

    def one(place: int) -> Outcome:
        try:
            return _run_and_keep(project, requests[place], progress, kernels)
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
            kernels.stop()
            raise


def _published_seconds(project: Project, chapter: str) -> float:
    """Return how long the published run of a chapter took; if there is none, it may be long."""
    made = reference_results(project, chapter).provenance
    return math.inf if made is None else made.seconds


def _run_and_keep(project: Project, request: Request, progress: Progress, kernels: _Kernels) -> Run:
    prepared = _prepare(project, request)
    commit, clean = repository_state(project.root)
    began = time.monotonic()
    if request.core:
        done, machine = compute_core(project, request), machine_facts()
    else:
        done, machine = _execute(project, request, prepared, progress, kernels)
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


def compute_core(project: Project, request: Request) -> Run:
    """Return what the core function of a chapter finds, called in this process."""
    if request.overlay:
        raise InswsnError("A core is called on the files of the checkout, without an overlay.")
    prepared, around = _prepare(project, request), request.surroundings
    values = prepared.schema.check(request.parameters)
    results, files = run_core(project.root, prepared.chapter, values, around.threads, around.solver)
    return Run(request, results, None, files)


def _execute(
    project: Project, request: Request, prepared: _Prepared, progress: Progress, kernels: _Kernels
) -> tuple[Run, dict[str, Any]]:
    """Execute a chapter's notebook; return its run and the facts of its machine."""
    from inswsn_book.execution import execute_notebook, machine_of  # noqa: PLC0415  # takes long

    chapter, around = prepared.chapter, request.surroundings
    place = "before its first cell"

    def tell_cell(number: int, total: int, identity: str) -> None:
        nonlocal place
        place = f"in cell {number} of {total} ({identity})"
        progress.cell(chapter.name, number)

    with (
        _overlaid(project.root, request.overlay) as root,
        tempfile.TemporaryDirectory(prefix=f"inswsn-{chapter.name}-") as name,
    ):
        folder = Path(name)
        notebook = read_source(Chapter(chapter.name, root / "chapters" / chapter.source.name))
        progress.started(chapter.name, len(notebook.cells) + bool(prepared.parameters))
        environment = _environment(project, around)
        own = {
            "IPYTHONDIR": str(folder / "ipython"),
            ROOT_VARIABLE: str(root),
            RESULTS_VARIABLE: str(folder / "results"),
        }
        try:
            executed = execute_notebook(
                notebook, prepared.parameters, folder, around.python, environment | own,
                kernels.add, tell_cell,
            )  # fmt: skip
        except Exception as error:  # whatever papermill, nbclient or the kernel raise
            log = (folder / "kernel.log").read_text(encoding="utf-8", errors="replace")
            raise _failure(chapter.name, place, error, log) from None
        if not (folder / "results" / f"{chapter.number}.json").is_file():
            raise ChapterError(
                f"Chapter {chapter.name} wrote no results file {chapter.number}.json: "
                "its last code cell calls record.write()."
            )
        files = _texts_of(folder / "results")
        results = read_results(folder / "results" / f"{chapter.number}.json")
    del files[f"{chapter.number}.json"]
    results = results.model_copy(update=_shown(executed))
    machine = machine_of(around.python, frozenset(environment.items()))
    return Run(request, results, notebook_text(strip_run(executed)), files), machine


def _failure(name: str, place: str, error: Exception, log: str) -> ChapterError:
    """Return what a user is told of a chapter that failed."""
    said = f"{log}{type(error).__name__}: {error}"
    if hasattr(error, "traceback"):  # papermill's, of a cell
        said = "\n".join(error.traceback)
        place += f":\n\n{error.source}\n"  # type: ignore[attr-defined]
    failure = ChapterError(f"Chapter {name} failed {place}\n{said}")
    if getattr(error, "ename", "") in (InswsnError.__name__, ParameterError.__name__):
        failure.refusal = error.evalue  # type: ignore[attr-defined]
    return failure


class _Kernels:
    """The kernels that are running, so that all of them can be stopped."""

    def __init__(self) -> None:
        self._managers: list[Any] = []
        self._stopping = threading.Event()

    def add(self, manager: Any) -> None:
        """Note a kernel that is about to start."""
        if self._stopping.is_set():
            raise ChapterError("stopped")
        self._managers.append(manager)

    def stop(self) -> None:
        """End all that are running, and let no other start."""
        self._stopping.set()
        for manager in self._managers:
            process = getattr(manager.provisioner, "process", None)
            if process is not None:
                process.terminate()


@contextmanager
def _overlaid(root: Path, overlay: Mapping[str, str]) -> Iterator[Path]:
    """Give a folder that is the checkout, by links, but for the files of an overlay."""
    if not overlay:
        yield root
        return
    with tempfile.TemporaryDirectory(prefix="inswsn-overlay-") as name:
        copy = Path(name).resolve() / "checkout"
        unread = shutil.ignore_patterns(".*", "_build", "runs", "tests")
        shutil.copytree(root, copy, copy_function=os.symlink, ignore=unread)
        for path, text in overlay.items():
            (copy / path).unlink(missing_ok=True)
            write_whole(copy / path, text)
        yield copy


def _shown(executed: Any) -> dict[str, Any]:
    """Return the cell that recorded each quantity, and each table: outputs have them as metadata.

    `ChapterRecord.quantity` and `inswsn_book.show.show_table` leave them there.
    """
    cells, tables = {}, {}
    for cell in executed.cells:
        for output in cell.get("outputs", []):
            metadata = output.get("metadata", {})
            if "quantity" in metadata.get("scrapbook", {}):
                cells[metadata["scrapbook"]["quantity"]] = cell["id"]
            if "table" in metadata:
                tables[metadata["table"]["name"]] = metadata["table"]["cells"]
    return {"cells": cells, "tables": tables}


def _environment(project: Project, surroundings: Surroundings) -> dict[str, str]:
    """Return the environment of kernels: so many threads, nothing personal or left to chance."""
    threads = ("OMP", "OPENBLAS", "MKL", "NUMBA")
    personal = ("PYTHONPATH", "PYTHONSTARTUP", "MATPLOTLIBRC", "MPLBACKEND")
    kept = {name: value for name, value in os.environ.items() if name not in personal}
    if kept.get(DATA_VARIABLE):  # a kernel has a working folder of its own
        kept[DATA_VARIABLE] = str(Path(kept[DATA_VARIABLE]).absolute())
    return kept | {
        **{f"{name}_NUM_THREADS": str(surroundings.threads) for name in threads},
        SOLVER_VARIABLE: surroundings.solver,
        "PYTHONHASHSEED": "0",
        "PYDEVD_DISABLE_FILE_VALIDATION": "1",
        "MPLCONFIGDIR": str(project.build / "matplotlib"),  # its font cache, and no settings
        # where a reader's own modules lie
        MODULES_VARIABLE: os.environ.get(MODULES_VARIABLE, str(Path.cwd())),
        **surroundings.variables,
    }
