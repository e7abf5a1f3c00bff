"""A sweep: one request for each cell of a grid of parameters, and a table over their runs.

Cells are computed on Dask, by processes of this machine or by the workers of a scheduler. Each run
goes to the one store as it ends, so that a cell which is there is not computed again.
"""

from __future__ import annotations

import itertools
import json
import logging
import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass
from difflib import get_close_matches
from functools import cache
from pathlib import Path
from typing import Any

import inswsn_lib
from inswsn_book.make.answer import unit_of, value_of
from inswsn_book.make.chapters import chapter_with, gather_parameters
from inswsn_book.record.files import check_folder, made_folder, text_digest, write_whole
from inswsn_book.record.parameters import Schema, Value
from inswsn_book.record.progress import Progress, Quiet
from inswsn_book.record.project import Chapter, Project, is_checkout
from inswsn_book.record.provenance import available_cores, machine_facts, repository_state
from inswsn_book.run.cores import SCORES, asked_schema, core_name, evidence_of
from inswsn_book.run.store import Request, Run, keep, lookup, request_key, run
from inswsn_lib import __version__
from inswsn_lib.errors import BuildError, InswsnError, ParameterError
from inswsn_lib.files import read_text

MOST_CELLS = 10_000
_MOST_ROWS = 40
_CONNECT_SECONDS = 5
# Where no worker is left, so long a new one is waited for
_PATIENCE_SECONDS = 20.0
# How often the processes of this machine are started, if one ends at once
_STARTS = 3
# An interrupt is for the command, which ends its workers
_IGNORE_INTERRUPTS = "import signal; signal.signal(signal.SIGINT, signal.SIG_IGN)"


@dataclass(frozen=True)
class Sweep:
    """A chapter over a grid: axes with the values that they go through, and fixed settings.

    `core` names the function that is called in each cell; without one the notebook is executed.
    The figure shows `of`, a finding or a column of the core, by default its headline.
    """

    chapter: Chapter
    schema: Schema
    core: str | None
    axes: Mapping[str, tuple[Value, ...]]
    settings: Mapping[str, Value]
    of: str | None = None

    @property
    def places(self) -> list[dict[str, Value]]:
        """The values of each cell on the axes; the last axis goes fastest."""
        values = itertools.product(*self.axes.values())
        return [dict(zip(self.axes, cell, strict=True)) for cell in values]

    @property
    def requests(self) -> list[Request]:
        """What is run in each cell."""
        return [
            Request(self.chapter.id, {**self.settings, **place}, core=self.core is not None)
            for place in self.places
        ]


def read_sweep(
    project: Project,
    chapter: Chapter,
    axes: Iterable[str],
    settings: Iterable[str],
    of: str | None = None,
) -> Sweep:
    """Return the sweep that a user asks for; refuse names and values that may not be."""
    axes, settings, data = [*axes], [*settings], project.root / "data"
    names = [word.partition("=")[0] for word in (*axes, *settings)]
    evidence = evidence_of(project, chapter)  # whose core is quicker than a lesson's notebook
    if evidence and set(names) <= asked_schema(project.root, evidence, names).defaults.keys():
        chapter = evidence
    chapter = chapter_with(project, chapter, names)
    schema = asked_schema(project.root, chapter, names)
    core = core_name(read_text(chapter.source))
    if of and core is None:
        raise ParameterError("--of", of, "left out: the chapter has no core to tell findings")
    found: dict[str, tuple[Value, ...]] = {}
    for axis in axes:
        name, equals, text = axis.partition("=")
        if not equals or name in found:
            raise ParameterError("--grid", axis, "name=value,value,..., given once for each name")
        values = [
            gather_parameters(schema, (f"{name}={part}",), None, data)[name]
            for part in _parts(text)
        ]
        if len({*map(str, values)}) < len(values):
            raise ParameterError("--grid", axis, "a list without repeated values")
        found[name] = tuple(values)
    chosen = gather_parameters(schema, settings, None, data)
    for name in chosen:
        if name in found:
            raise ParameterError("-p", f"{name}={chosen[name]}", "left out if --grid varies it")
    count = math.prod(map(len, found.values()))
    if count > MOST_CELLS:
        raise ParameterError("--grid", count, f"of at most {MOST_CELLS} cells")
    return Sweep(chapter, schema, core, found, chosen, of)


def _parts(text: str) -> list[str]:
    """Return the values of an axis, which commas part; those within brackets belong to a list."""
    parts, depth = [""], 0
    for sign in text:
        depth += (sign == "[") - (sign == "]")
        if sign == "," and not depth:
            parts.append("")
        else:
            parts[-1] += sign
    return parts


def run_sweep(
    project: Project,
    sweep: Sweep,
    progress: Progress,
    *,
    out: Path | None = None,
    jobs: int | None = None,
    dask: str | None = None,
    fresh: bool = False,
) -> tuple[list[str], int]:
    """Compute the cells of a sweep that are not in the store, and write its files.

    Returned is what the terminal tells, and how many cells failed. `dask` is the address of a
    scheduler, in place of `jobs` processes of this machine. A cell that fails leaves a reason; a
    worker that would find other numbers, and a scheduler that goes away, end the sweep.
    """
    if dask is not None and jobs is not None:
        raise ParameterError("--jobs", jobs, "left out if --dask is given, which has workers")
    wanted = json.dumps([sweep.axes, sweep.settings])
    name = f"{sweep.chapter.source.stem}-sweep-{text_digest(wanted)[:8]}"
    folder = out or project.root / "runs" / name
    check_folder(folder)
    requests, places = sweep.requests, sweep.places
    found = [None if fresh else lookup(project, request) for request in requests]
    outcomes: dict[int, Run | str] = {c: run for c, run in enumerate(found) if run is not None}
    due = {c: request for c, request in enumerate(requests) if c not in outcomes}
    there = len(outcomes)
    progress.say(
        f"{sweep.core or sweep.chapter.source.stem}: {there} of {len(requests)} cells are there"
    )
    progress.started(name, len(requests))

    def ended(cell: int, outcome: Run | str) -> None:
        # a worker of this machine has put it there already
        if isinstance(outcome, Run) and (fresh or lookup(project, requests[cell]) is None):
            keep(project, requests[cell], outcome)
        outcomes[cell] = outcome
        progress.cell(name, len(outcomes))
        if isinstance(outcome, str):
            values = ", ".join(f"{name}={value}" for name, value in places[cell].items())
            progress.say(f"{values or 'the one cell'}: failed: {outcome}")

    if due:
        with _client(dask, min(jobs or available_cores(), len(due))) as client:
            _compute(client, project, fresh, due, ended)
    progress.finished(name)
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
    with ExitStack() as stack:
        stack.enter_context(dask.config.set(options))
        where = address or stack.enter_context(_local_cluster(jobs))
        try:
            client = distributed.Client(where, timeout=_CONNECT_SECONDS)
        except (OSError, ValueError, ImportError, TypeError):
            raise ParameterError(
                "--dask", address, "the address of a Dask scheduler that answers"
            ) from None
        stack.enter_context(client)
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

    futures = {
        client.submit(
            _compute_cell, str(project.root), request, _state(project, request), fresh, pure=False
        ): cell
        for cell, request in due.items()
    }
    while futures:
        try:
            for future in _done(client, [*futures]):
                ended(futures.pop(future), _outcome(future))
        except CancelledError:
            raise _left("The Dask scheduler is gone") from None


def _done(client: Any, futures: Sequence[Any]) -> set[Any]:
    """Return the futures that have ended, once one has; do not wait where nobody computes."""
    import distributed  # noqa: PLC0415

    seen = True
    while True:
        try:
            waited = distributed.wait(
                futures, timeout=_PATIENCE_SECONDS / 2, return_when="FIRST_COMPLETED"
            )
            return {*waited.done}
        except TimeoutError:
            there = bool(client.nthreads())
            if not (seen or there):
                raise _left("No worker is left at the Dask scheduler") from None
            seen = there


def _outcome(future: Any) -> Run | str:
    import distributed  # noqa: PLC0415

    try:
        found: Run | str = future.result()
    except distributed.scheduler.KilledWorker:
        return "each process that computed it ended before it had"
    return found


def _left(reason: str) -> BuildError:
    return BuildError(
        f"{reason}; what is finished is kept, and the same command goes on from there."
    )


def _compute_cell(root: str, request: Request, state: str, fresh: bool) -> Run | str:
    """Run a request in a worker; return why it failed, if it did.

    A worker is refused that would find other numbers: whose state is not the command's, or that
    computes in several threads.
    """
    import distributed  # noqa: PLC0415

    worker = distributed.get_worker()
    here = Path(root)
    project = Project(here if is_checkout(here) else Path(inswsn_lib.__file__).parents[1])
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


def _write(
    project: Project, sweep: Sweep, folder: Path, outcomes: Sequence[Run | str], there: int
) -> tuple[list[str], int]:
    """Write the files of a sweep, all or none."""
    import pandas as pd  # noqa: PLC0415  # what refuses a grid needs no numerics

    found = list(zip(sweep.places, outcomes, strict=True))
    runs = [(place, run) for place, run in found if isinstance(run, Run)]
    told = [*_findings(sweep, runs), *_idle(sweep, runs)]  # which may refuse what is asked for
    scores = [(place, json.loads(run.files[SCORES])) for place, run in runs if sweep.core]
    tables = {
        "sweep": [row for place, run in runs for row in _rows(place, run, sweep.core is not None)],
        "leaders": [{**place, **words["leader"]} for place, words in scores if "leader" in words],
        "failed": [{**place, "reason": said} for place, said in found if isinstance(said, str)],
    }
    # each number with all its digits
    frames = {name: pd.DataFrame(rows, dtype=object) for name, rows in tables.items()}
    with made_folder(folder) as made:
        for name, frame in frames.items():
            if len(frame) or name == "sweep":
                write_whole(made / f"{name}.csv", frame.to_csv(index=False, lineterminator="\n"))
        if scores:
            _write_figure(made / "sweep.svg", sweep, pd.DataFrame(tables["sweep"]), scores[0][1])
        write_whole(made / "sweep.json", _provenance(project, sweep))
    leaders = [] if sweep.core else ["The chapter has no core, and so no figure and no leaders."]
    if tables["leaders"]:
        short, many = "{:.4g}".format, _MOST_ROWS
        leaders = [frames["leaders"].to_string(index=False, max_rows=many, float_format=short)]
    computed = f"{len(runs) - there} cells computed, {there} were there."
    return [*leaders, *told, computed, f"The sweep is in {folder}"], len(frames["failed"])


def _findings(sweep: Sweep, runs: Sequence[tuple[Mapping[str, Value], Run]]) -> Iterator[str]:
    """Tell what is asked for, or what the scores amount to, in each cell, with its unit."""
    for place, each in runs if sweep.core else ():
        found = {quantity.name: quantity for quantity in each.results.quantities}
        if sweep.of and sweep.of not in found:
            near = get_close_matches(sweep.of, found, 1, 0)[0]
            raise ParameterError("--of", sweep.of, f"a finding or a column, such as {near}")
        values = ", ".join(f"{n} = {v}{unit_of(sweep.schema[n].unit)}" for n, v in place.items())
        for name in [sweep.of] if sweep.of else json.loads(each.files[SCORES])["findings"]:
            yield f"{values}: {name} = {value_of(found[name])}"


def _idle(sweep: Sweep, runs: Sequence[tuple[Mapping[str, Value], Run]]) -> Iterator[str]:
    """Tell of each axis that changes nothing."""
    for axis in sweep.axes:
        groups: dict[str, list[Any]] = {}
        for place, each in runs:
            others = json.dumps({n: v for n, v in place.items() if n != axis})
            groups.setdefault(others, []).append(each.results.quantities)
        same = all(quantities == group[0] for group in groups.values() for quantities in group)
        if same and len(runs) > len(groups):
            yield f"{axis} changes no number of the sweep; `inswsn run` tells what depends on it."


def _rows(place: Mapping[str, Value], run: Run, of_core: bool) -> Iterator[dict[str, Any]]:
    for quantity in run.results.quantities:
        method, _, column = quantity.name.rpartition(".")
        low, high = quantity.interval or (None, None)
        row: dict[str, Any] = {"method": method, "column": column} if of_core else {}
        row |= {
            "quantity": quantity.name, "unit": quantity.unit, "runs": quantity.runs,
            "value": quantity.value, "low": low, "high": high,
        }  # fmt: skip
        # an axis may be called as a column is, such as runs
        yield {**place, **{name: value for name, value in row.items() if name not in place}}


def _write_figure(path: Path, sweep: Sweep, frame: Any, words: Mapping[str, Any]) -> None:
    """Draw the headline of each method over the axes, if they can be drawn."""
    from inswsn_lib.plotting import draw_scores  # noqa: PLC0415

    units = {name: sweep.schema[name].unit for name in sweep.axes}
    frame = frame.rename(columns={"value": "median"}).astype({"low": float, "high": float})
    shown, methods, of = words.get("headline", ""), words.get("methods", {}), sweep.of
    if not (shown or of):  # of findings alone the first is drawn
        of = next(iter(words["findings"]))
    if of is not None:
        frame = frame[frame["quantity"] == of]
        shown, method = frame[["column", "method"]].iloc[0]
        methods = {method: methods.get(method, of)}
    published = {name: sweep.schema[name].default for name in sweep.axes}
    with suppress(ParameterError):  # such as three axes
        fig = draw_scores(frame, units, shown, methods, published=published)
        # a file is passed on without the page that explains it
        fig.supxlabel("Bands: 95 %. Dotted: the published value.", fontsize="small")
        facts = {"Title": str(sweep.core), "Date": None, "Creator": None}
        fig.savefig(path, format="svg", metadata=facts, facecolor="white")


def _provenance(project: Project, sweep: Sweep) -> str:
    commit, clean = repository_state(project.root)
    facts = {
        "version": __version__,
        "commit": commit,
        "clean": clean,
        "chapter": sweep.chapter.source.stem,
        "core": sweep.core,
        "grid": {name: list(values) for name, values in sweep.axes.items()},
        "parameters": sweep.schema.check(sweep.settings),
        "machine of the command": machine_facts(),
    }
    return json.dumps(facts, indent=2, ensure_ascii=False) + "\n"
