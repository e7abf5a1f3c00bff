"""Run a chapter and keep what it gives: one request, one key, one store.

A `Request` says which chapter is run, with which parameters, with how many threads, over which
changed files. `run` and `run_all` execute it if nothing is in the store, ``_build/store``. Book,
``inswsn run``, sweeps and studies are sets of requests.
"""

from __future__ import annotations

import ast
import json
import math
import os
import platform
import shutil
import sys
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor, as_completed
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field, replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from inswsn_book.judge.ledger import LEDGER, data_digest
from inswsn_book.record import files, provenance
from inswsn_book.record.imports import Named
from inswsn_book.record.notebooks import notebook_text, read_notebook, read_source, strip_run, woven
from inswsn_book.record.parameters import REGRESSOR_RULE, Value, read_myst, source_schema
from inswsn_book.record.progress import Progress
from inswsn_book.record.project import (
    EXECUTING,
    MODULES_VARIABLE,
    RESULTS_VARIABLE,
    ROOT_VARIABLE,
    Chapter,
    Project,
)
from inswsn_book.record.results import Provenance, Results, read_results
from inswsn_book.run.cores import asked_schema, changed_scenarios, core_name, run_core
from inswsn_lib import __version__
from inswsn_lib.errors import BuildError, InswsnError, ParameterError
from inswsn_lib.files import DATA_VARIABLE, data_mirror, read_text
from inswsn_lib.kernels import PLAIN

# Raised when the form of the store, or the way in which chapters are executed, changes.
_FORM = 8
# How many digits of a key tell the library, the locks and the chapter's source; and how many
# entries of a chapter are kept that were made from others than the present ones.
_ORIGIN, _KEPT = 12, 3


@dataclass(frozen=True)
class Request:
    """What is to be run; parameters that are not set keep their defaults.

    Parameters are the chapter's own or its scene's, see `inswsn_book.run.cores.asked_schema`. An
    overlay gives, by path below the checkout, the whole text that stands in the place of that
    file, such as a changed scenario or source. `core` asks for the chapter's core function in place
    of its notebook. The linear algebra has that many threads; the environment is that of the book
    whatever the caller's says, but for `variables`.
    """

    chapter: str
    parameters: Mapping[str, Value] = field(default_factory=dict)
    threads: int = 1
    variables: Mapping[str, str] = field(default_factory=dict)
    overlay: Mapping[str, str] = field(default_factory=dict)
    core: bool = False
    brief: bool = False  # of a core its findings alone


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


@dataclass(frozen=True)
class _Prepared:
    """A request as it is run now."""

    chapter: Chapter
    source: str
    parameters: dict[str, Value]  # the chapter's own that differ from their defaults
    scene: dict[str, Value]  # the same of its scene
    modules: frozenset[str]  # that it may load
    sources: dict[str, str]  # their digests, for the provenance
    overlay: dict[str, str]  # of the request, and of its scene's parameters
    key: str


def _prepare(project: Project, request: Request) -> _Prepared:
    chapter = project.by_id(request.chapter)
    own = read_text(chapter.source)
    overlay = dict(request.overlay)
    source = request.overlay.get(f"chapters/{chapter.name}.md", own)
    parameters, scene = dict[str, Value](), dict[str, Value]()
    if request.parameters:
        schema = source_schema(source, chapter.source.name)
        if not request.parameters.keys() <= schema.defaults.keys():
            schema = asked_schema(project.root, chapter, request.parameters)
        checked = {name: schema[name].check(value) for name, value in request.parameters.items()}
        set_ = {name: v for name, v in checked.items() if v != schema[name].default}
        parameters = {name: v for name, v in set_.items() if not schema[name].scenario}
        scene = {name: v for name, v in set_.items() if schema[name].scenario}
        overlay |= changed_scenarios(project.root, schema, scene)
    regressors = [n for n in parameters if schema[n].rule == REGRESSOR_RULE]
    code, modules, library = code_of(project, source, chapter.source.name)
    locks = files.tree_digest(project.root, project.locks)
    its_own = [code, library]
    if source != own:
        its_own[:] = code_of(project, own, chapter.source.name)[::2]
    origin = files.text_digest(json.dumps([_FORM, chapter.name, *its_own, locks]))
    facts = {
        "origin": origin,
        "code": [code, library],
        "parameters": parameters,
        "regressors": [_modules_digest(str(parameters[name])) for name in regressors],
        "python": [platform.python_version(), provenance.package_versions()],
        "surroundings": [request.threads, dict(request.variables)],
        "overlay": {name: files.text_digest(text) for name, text in overlay.items()},
        "recorded data": data_mirror() is not None,
        "core": (request.core, request.brief),
    }
    key = f"{origin[:_ORIGIN]}-{files.text_digest(json.dumps(facts, sort_keys=True))[:32]}"
    sources = {"chapter": files.text_digest(source), "library": library, "locks": locks}
    return _Prepared(chapter, source, parameters, scene, modules, sources, overlay, key)


def code_of(project: Project, source: str, name: str) -> tuple[str, frozenset[str], str]:
    """Return the digest of a chapter's code cells, the modules that they may load, and theirs.

    The modules are those of both packages, and what executes chapters.
    """
    imports = project.imports()
    key = f"cells {files.text_digest(source)}"
    with project.parsing:
        code, named = project.memory.of(key, _cells, source, name)
    modules = frozenset(imports.needs(Named(*named))) if named else imports.modules
    modules |= imports.modules & {*EXECUTING}
    return code, modules, imports.digest(modules)


def _cells(source: str, name: str) -> tuple[str, Named | None]:
    """Return the digest of a chapter's code cells, and what they name; None if that is no Python.

    Prose does not count: it is woven anew around what the cells gave.
    """
    cells = [c for c in read_myst(source, name).cells if c.cell_type == "code"]
    core = core_name(source)
    facts = [[c.source, c.metadata.get("tags", [])] for c in cells]
    code = [c.source for c in cells] + ([f"import {core.partition(':')[0]}"] if core else [])
    try:
        named = Named.of(ast.parse("\n".join(code)))
    except SyntaxError:
        named = None
    return files.text_digest(json.dumps([core, *facts])), named


def request_key(project: Project, request: Request) -> str:
    """Return the key of a request: a digest of all that its run is made from.

    Its first part covers the chapter's code cells, the modules that they may load, and the locks;
    prose, comments of modules and docstrings do not count. Of recorded data it covers whether there
    are any. The data files that a chapter reads are known
    once it has run: they stand in its results with their digests, and `lookup` checks them.
    """
    return _prepare(project, request).key


def lookup(
    project: Project, request: Request, say: Callable[[str], None] = lambda _: None
) -> Run | None:
    """Return the run of a request if the store has it and the data that it read are unchanged.

    It is told of an entry that is damaged, which counts as none.
    """
    prepared = _prepare(project, request)
    entry = project.store / request.chapter / prepared.key
    try:
        text = files.read_sealed(entry)
    except FileNotFoundError:
        return None
    if text is None:
        say(f"{entry.relative_to(project.root)} is damaged: it is computed anew")
        return None
    kept = json.loads(text)
    results = Results.model_validate(kept["results"])
    for name, digest in results.data.items():
        # what the overlay replaces is a part of the key
        replaced = name.partition("#")[0] in prepared.overlay
        if not replaced and _data_digest(project, name) != digest:
            return None
    found = Run(request, results, kept["notebook"], kept["files"])
    if results.provenance and results.provenance.sources["chapter"] != prepared.sources["chapter"]:
        found = _weave(found, prepared)
        keep(project, request, found)
    return found


def _data_digest(project: Project, name: str) -> str | None:
    """Return the digest of what a chapter reads; to find the claims of one takes long."""
    path, _, part = name.partition("#")
    if path != LEDGER or not part:
        return data_digest(project.root, name)
    ledger = files.tree_digest(project.root, (project.root / path).glob("*.yaml"))
    found: str | None = project.memory.of(f"{name} {ledger}", data_digest, project.root, name)
    return found


def _weave(run: Run, prepared: _Prepared) -> Run:
    """Return a run of the same code cells as that of the present prose."""
    made = run.results.provenance
    assert made is not None
    sources = made.sources | {"chapter": prepared.sources["chapter"]}
    update: dict[str, Any] = {"provenance": made.model_copy(update={"sources": sources})}
    text = run.notebook
    if text is not None:
        source = read_source(prepared.chapter, prepared.source)
        notebook, ids = woven(source, read_notebook(text))
        update["cells"] = {name: ids[cell] for name, cell in run.results.cells.items()}
        text = notebook_text(notebook)
    return replace(run, results=run.results.model_copy(update=update), notebook=text)


def keep(project: Project, request: Request, run: Run) -> None:
    """Put a run into the store, whole or not at all, and drop old ones of its chapter.

    Those that were made from another library, other locks or another source of the chapter go, but
    for the last few.
    """
    entry, results = _entry(project, request), run.results.model_dump(mode="json")
    kept = {"results": results, "notebook": run.notebook, "files": dict(run.files)}
    files.write_sealed(entry, json.dumps(kept))
    with suppress(OSError):  # another process has just removed some
        own = entry.name[:_ORIGIN]
        others = [e for e in entry.parent.glob("[!.]*") if e.name[:_ORIGIN] != own]
        for old in sorted(others, key=lambda e: e.stat().st_mtime, reverse=True)[_KEPT:]:
            old.unlink()


def _entry(project: Project, request: Request) -> Path:
    return project.store / request.chapter / request_key(project, request)


def _modules_digest(regressor: str) -> str:
    """Return the digest of the reader's own module, or package, that a regressor is in."""
    folder = Path(os.environ.get(MODULES_VARIABLE, str(Path.cwd())))
    top = regressor.partition(":")[0].partition(".")[0]
    own = [folder / f"{top}.py", *(folder / top).rglob("*.py")]
    return files.tree_digest(folder, [path for path in own if path.is_file()])


def book_runs(project: Project) -> list[Run]:
    """Return the runs of all chapters as the book has them; refuse if one is not in the store."""
    found = {c.id: lookup(project, Request(c.id)) for c in project.chapters()}
    for number, run in found.items():
        if run is None:
            raise InswsnError(
                f"Chapter {number} has not been built as it is now; build it first: make book."
            )
    return [run for run in found.values() if run is not None]


def reference_results(project: Project, number: str) -> Results:
    """Return the reference results of a chapter; without any quantity if there are none yet."""
    files.check_listed(project.published)
    try:
        return read_results(project.published / f"{number}.json")
    except InswsnError:  # none yet, or one of an older schema: all of it is new
        return Results(chapter=number, parameters={}, data={}, quantities=())


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


def raise_failure(_: int, outcome: Outcome) -> None:
    """Raise what a request ended with, if it failed: the first failure stops all."""
    if not isinstance(outcome, Run):
        raise outcome


def run_all(
    project: Project,
    requests: Sequence[Request],
    progress: Progress,
    ended: Callable[[int, Outcome], None] = raise_failure,
    *,
    fresh: bool = False,
    jobs: int | None = None,
) -> list[Run]:
    """Run requests side by side, those that take long first; return the runs, in their order.

    `ended` is called in this thread with the place of a request and its run or its failure as each
    ends; what it raises stops all, as an interrupt does. What has ended by then is kept. Cores are
    called one after the other in this thread.
    """
    outcomes: dict[int, Outcome] = {}

    def end(place: int, outcome: Outcome) -> None:
        ended(place, outcome)
        outcomes[place] = outcome

    for place, request in enumerate(requests):
        found = None if fresh else lookup(project, request, progress.say)
        if found is not None:
            progress.unchanged(project.by_id(request.chapter).name)
            end(place, found)
    project.memory.save()
    kernels: list[Any] = []  # their managers

    def one(place: int) -> Outcome:
        try:
            return _run_and_keep(project, requests[place], progress, kernels)
        except (BuildError, InswsnError) as failure:
            return failure

    due = [place for place in range(len(requests)) if place not in outcomes]
    due.sort(key=lambda place: _published_seconds(project, requests[place].chapter), reverse=True)
    for place in due:
        if requests[place].core:
            end(place, one(place))
    with ThreadPoolExecutor(max_workers=jobs or provenance.available_cores()) as pool:
        pending = {pool.submit(one, p): p for p in due if not requests[p].core}
        try:
            for future in as_completed(pending):
                end(pending[future], future.result())
        except BaseException:
            for future in pending:
                future.cancel()
            while not all(future.done() for future in pending):  # one may be about to start
                for kernel in kernels:
                    if process := getattr(kernel.provisioner, "process", None):
                        process.terminate()
                time.sleep(0.05)
            raise
    return [outcome for _, outcome in sorted(outcomes.items()) if isinstance(outcome, Run)]


def _published_seconds(project: Project, chapter: str) -> float:
    """Return how long the published run of a chapter took; if there is none, it may be long."""
    made = reference_results(project, chapter).provenance
    return math.inf if made is None else made.seconds


def _run_and_keep(
    project: Project, request: Request, progress: Progress, kernels: list[Any]
) -> Run:
    prepared = _prepare(project, request)
    (commit, clean), began = provenance.repository_state(project.root), time.monotonic()
    if request.core:
        schema = asked_schema(project.root, prepared.chapter, request.parameters)
        values = schema.check(request.parameters)
        found = run_core(
            project.root, prepared.chapter, values, request.threads, brief=request.brief
        )
        done, machine = Run(request, found[0], None, found[1]), provenance.machine_facts()
    else:
        done, machine = _execute(project, request, prepared, progress, kernels)
    made = Provenance(
        version=__version__,
        commit=commit,
        clean=clean and not prepared.overlay,
        sources=prepared.sources,
        finished=datetime.now(UTC).strftime("%Y-%m-%d %H:%M UTC"),
        seconds=round(time.monotonic() - began, 1),
        **machine,
    )
    own = {**done.results.parameters, **prepared.scene}
    update = {"provenance": made, "parameters": own}
    done = replace(done, results=done.results.model_copy(update=update))
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
    project: Project, request: Request, prepared: _Prepared, progress: Progress, kernels: list[Any]
) -> tuple[Run, dict[str, Any]]:
    """Execute a chapter's notebook; return its run and the facts of its machine."""
    from inswsn_book.run.kernels import execute_notebook  # noqa: PLC0415  # takes long

    chapter = prepared.chapter
    place = "before its first cell"

    def tell_cell(number: int, total: int, identity: str) -> None:
        nonlocal place
        place = f"in cell {number} of {total} ({identity})"
        progress.cell(chapter.name, number)

    with _overlaid(project.root, prepared.overlay) as root, files.temporary_folder() as folder:
        notebook = read_source(chapter, prepared.source)
        progress.started(chapter.name, len(notebook.cells) + bool(prepared.parameters))
        environment = environment_of(project, request)
        own = {
            "IPYTHONDIR": str(folder / "ipython"),
            ROOT_VARIABLE: str(root),
            RESULTS_VARIABLE: str(folder / "results"),
        }
        try:
            executed = execute_notebook(
                notebook, prepared.parameters, folder, environment | own, kernels.append, tell_cell
            )
        except Exception as error:  # whatever papermill, nbclient or the kernel raise
            log = (folder / "kernel.log").read_text(encoding="utf-8", errors="replace")
            raise _failure(chapter.name, place, error, log) from None
        if not (folder / "results" / f"{chapter.id}.json").is_file():
            raise ChapterError(
                f"Chapter {chapter.name} wrote no results file {chapter.id}.json: "
                "its last code cell calls record.write()."
            )
        written = {p.name: p.read_bytes().decode("utf-8") for p in (folder / "results").iterdir()}
    results = Results.model_validate_json(written.pop(f"{chapter.id}.json"))
    machine = json.loads(written.pop(provenance.MACHINE))
    found = machine.pop("executable"), machine["packages"]
    if found != (sys.executable, provenance.package_versions()):
        raise ChapterError(
            f"Chapter {chapter.name} was not executed by {sys.executable} with what is installed "
            f"there: its kernel is {found[0]} with {found[1]}."
        )
    # what nothing names would not be a part of the key
    if unnamed := sorted({*machine.pop("modules")} - prepared.modules):
        raise ChapterError(
            f"Chapter {chapter.name} loads {unnamed[0]}, which neither its cells nor what they "
            "import name; import it by its name."
        )
    results = results.model_copy(update=_shown(executed))
    return Run(request, results, notebook_text(strip_run(executed)), written), machine


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


@contextmanager
def _overlaid(root: Path, overlay: Mapping[str, str]) -> Iterator[Path]:
    """Give a folder that is the checkout, by links, but for the files of an overlay."""
    if not overlay:
        yield root
        return
    with files.temporary_folder() as folder:
        copy = folder.resolve() / "checkout"
        unread = shutil.ignore_patterns(".*", "_build", "runs", "tests")
        shutil.copytree(root, copy, copy_function=os.symlink, ignore=unread)
        for path, text in overlay.items():
            (copy / path).unlink(missing_ok=True)
            files.write_whole(copy / path, text)
        yield copy


def _shown(executed: Any) -> dict[str, Any]:
    """Return the cell that recorded each quantity, each table, and what is said in words.

    Outputs have them as metadata: `ChapterRecord.quantity`, `ChapterRecord.say` and
    `inswsn_book.show` leave them there.
    """
    cells, tables, words = {}, {}, {}
    for cell in executed.cells:
        for output in cell.get("outputs", []):
            metadata = output.get("metadata", {})
            if "quantity" in (glued := metadata.get("scrapbook", {})):
                cells[glued["quantity"]] = cell["id"]
            elif glued:
                words[glued["name"]] = ast.literal_eval(*output["data"].values())
            if table := metadata.get("table"):
                tables[table["name"]] = table["cells"]
                words[table["name"]] = output["data"]["text/plain"].partition("\n\n")[0]
            if shown := metadata.get("inswsn"):
                words[shown["name"]] = shown["caption"]
    return {"cells": cells, "tables": tables, "words": words}


def environment_of(project: Project, request: Request) -> dict[str, str]:
    """Return the environment of kernels: so many threads, nothing personal or left to chance."""
    threads = ("OMP", "OPENBLAS", "MKL", "NUMBA")
    personal = ("PYTHON", "MATPLOTLIB", "MPL")
    kept = {name: value for name, value in os.environ.items() if not name.startswith(personal)}
    if kept.get(DATA_VARIABLE):  # a kernel has a working folder of its own
        kept[DATA_VARIABLE] = str(Path(kept[DATA_VARIABLE]).absolute())
    return kept | {
        **{f"{name}_NUM_THREADS": str(request.threads) for name in threads},
        **{f"PYTHON{name}": "1" for name in ("UTF8", "SAFEPATH", "NOUSERSITE")},
        "PYTHONHASHSEED": "0",
        # compiled whatever the size of the work, so that a number hangs on no cache
        PLAIN: os.environ.get(PLAIN) or "0",
        "PYDEVD_DISABLE_FILE_VALIDATION": "1",
        "MPLCONFIGDIR": str(project.build / "matplotlib"),  # its font cache, and no settings
        # where a reader's own modules lie
        MODULES_VARIABLE: os.environ.get(MODULES_VARIABLE, str(Path.cwd())),
        **request.variables,
    }
