"""What a worker of a sweep computes: groups of runs of cells that share what is drawn."""

from __future__ import annotations

import importlib.util
import io
import os
import platform
import threading
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from rich.console import Console
from threadpoolctl import threadpool_limits

from inswsn_book.experiments import Experiment, Trial, find_experiment
from inswsn_book.files import file_digest
from inswsn_book.parameters import Value
from inswsn_book.project import MODULES_VARIABLE, Project
from inswsn_book.provenance import installed_version
from inswsn_lib.errors import InswsnError, ParameterError
from inswsn_lib.evaluation import GROUP, monte_carlo
from inswsn_lib.files import DATA_VARIABLE
from inswsn_lib.lmi.solvers import chosen_solver

Cell = tuple[int, Mapping[str, Value]]
_KEPT = 4  # trials that a process keeps: tasks that share one follow each other
# what an experiment of one's own may raise; the other cells go on, and so does the command
_ANYTHING = (Exception, SystemExit)
#: What experiments compute with
PACKAGES = ("numpy", "scipy", "cvxpy", "clarabel", "scs")


@dataclass(frozen=True)
class Task:
    """Some groups of runs of some cells.

    Attributes
    ----------
    sweep : str
        A digest that names the sweep.
    source : str
        The experiment: the number of a chapter, or a reader's ``package.module:NAME``; or the name
        of a chapter that is executed.
    inputs : object
        What the experiment reads from ``data/``; or the root of the checkout.
    cells : tuple of (int, mapping)
        Numbers and parameters of the cells; those of an experiment differ in what methods are told.
    parts : tuple of int
        Numbers of the groups; of a chapter that is executed there is one, 0.
    attempt : int
        How often it was tried before.
    suspect : bool
        Whether a worker that had it, among others, died: it is computed with no other under way, so
        that it is known which of them it was.
    """

    sweep: str
    source: str
    inputs: Any
    cells: tuple[Cell, ...]
    parts: tuple[int, ...]
    attempt: int = 0
    suspect: bool = False


@dataclass
class Outcome:
    """What came of a task.

    Attributes
    ----------
    library : str
        What `library_state` returned in the process that computed it.
    done : list of (int, int, bytes)
        Cell, group and content; all groups of a cell or none.
    refused : dict of int to str
        Cells that cannot be computed, with the sentence: trying again would not help.
    failed : dict of int to str
        Cells in which something else was raised.
    """

    library: str
    done: list[tuple[int, int, bytes]] = field(default_factory=list)
    refused: dict[int, str] = field(default_factory=dict)
    failed: dict[int, str] = field(default_factory=dict)


def code_state(source: str = "") -> str:
    """Return what code this process computes with, as a text to compare.

    Of the library, and of each module, it is taken once in a process, since what is imported stays
    as it was when it was read.

    Parameters
    ----------
    source : str
        A reader's own experiment, or empty.

    Raises
    ------
    ParameterError
        If there is no such experiment.
    """
    words = _library_words()
    if source:
        find_experiment(source)  # puts the folder of a reader's own modules on the path
        words += (_module_word(source.partition(":")[0]),)
    return ", ".join(words)


@cache
def _library_words() -> tuple[str, ...]:
    return (
        library_word(),
        f"Python {platform.python_version()}",
        *(f"{name} {installed_version(name)}" for name in PACKAGES),
    )


@cache
def _module_word(module: str) -> str:
    return f"{module} {module_digest(module)[:16]}"


def library_word() -> str:
    """Return the first word of `code_state` as the files are now."""
    project = Project(Path())  # its library is the one that runs
    return f"library {project.computing_digest()[:16]}"


def module_digest(module: str) -> str:
    """Return the digest of the file of a module, empty if it has none; its parents are imported."""
    spec = importlib.util.find_spec(module)
    origin = Path(spec.origin) if spec and spec.origin else None
    return file_digest(origin) if origin and origin.is_file() else ""


def library_state(source: str = "") -> str:
    """Return what the numbers of this process depend on: its code, and the solver of designs.

    Parameters
    ----------
    source : str
        As in `code_state`.

    Raises
    ------
    ParameterError
        If there is no such experiment, or ``INSWSN_SOLVER`` names no solver.
    """
    return f"{code_state(source)}, solver {chosen_solver()}"


def worker_state(source: str) -> tuple[str, str]:
    """Return the `library_state` of a worker, or empty and why there is none.

    A reason is a text, since a `ParameterError` does not survive the way from another process.
    """
    try:
        return library_state(source), ""
    except ParameterError as error:
        missing = error.name == "NAME"
        advice = f" Set {MODULES_VARIABLE} there to the folder of the module." if missing else ""
        return "", f"{error}{advice}"


def own_source(source: str) -> str:
    """Return the source if it is a reader's own experiment, empty for one of the library."""
    return source if ":" in source else ""


def compute_groups(task: Task) -> Outcome:
    """Compute the groups of an experiment; what is raised becomes part of the outcome."""
    outcome = Outcome("unknown")
    state, reason = worker_state(own_source(task.source))
    if reason:  # of this process, and not of the cells: another one may do
        outcome.failed = {cell: reason for cell, _ in task.cells}
        return outcome
    outcome.library = state
    try:
        experiment = find_experiment(task.source)
        # the same order of sums on every machine of one kind. It holds for the process and is never
        # taken back: another thread of a worker of Dask may be in the midst of a task
        threadpool_limits(1)
        _compute(task, experiment, outcome)
    except InswsnError as refusal:
        outcome.refused = {cell: str(refusal) for cell, _ in task.cells}
    except _ANYTHING as error:
        outcome.failed = {cell: _short(error) for cell, _ in task.cells}
    return outcome


def _compute(task: Task, experiment: Experiment, outcome: Outcome) -> None:
    prepared = _prepared(task, experiment)
    judges = {}
    for cell, values in task.cells:
        with _troubles_of(cell, outcome):
            judges[cell] = prepared.judge(cell, values)
    contents: dict[int, list[bytes]] = {cell: [] for cell in judges}
    seed = task.cells[0][1]["seed"]
    assert isinstance(seed, int)
    for part in task.parts:
        drawn = monte_carlo(prepared.trial.draw, GROUP, seed, first=GROUP * part)
        shared = {name: _read_only(values) for name, values in drawn.items()}
        for cell, judge in judges.items():
            if cell in outcome.refused or cell in outcome.failed:
                continue
            with _troubles_of(cell, outcome):
                contents[cell].append(_packed(experiment, judge(shared)))
    for cell, content in contents.items():
        if cell not in outcome.refused and cell not in outcome.failed:
            outcome.done += [(cell, *pair) for pair in zip(task.parts, content, strict=True)]


@contextmanager
def _troubles_of(cell: int, outcome: Outcome) -> Iterator[None]:
    """Note what is raised for a cell: a refusal is final, anything else may be tried again."""
    try:
        yield
    except InswsnError as refusal:
        outcome.refused[cell] = str(refusal)
    except _ANYTHING as error:
        outcome.failed[cell] = _short(error)


def _read_only(values: NDArray[Any]) -> NDArray[Any]:
    """Return a view that refuses to be written to: the judges of all cells are given the same."""
    view = values.view()
    view.flags.writeable = False
    return view


def _packed(experiment: Experiment, found: Mapping[str, Any]) -> bytes:
    """Return the results of a group as bytes, little-endian, (quantities, runs)."""
    rows = []
    for name in experiment.quantities:
        values = np.asarray(found[name], dtype="<f8")
        if values.shape != (GROUP,) or not np.isfinite(values).all():
            raise InswsnError(
                f"{name} is of shape {values.shape}; it may be finite numbers, ({GROUP},)."
                if values.shape != (GROUP,)
                else f"{name} is not finite in {np.sum(~np.isfinite(values))} of {GROUP} runs."
            )
        rows.append(values)
    return np.stack(rows).tobytes()


def unpacked(experiment: Experiment, contents: list[bytes], runs: int) -> dict[str, Any]:
    """Return the results of the first runs of a cell, for each quantity (runs,)."""
    shape = (len(experiment.quantities), GROUP)
    groups = [np.frombuffer(content, dtype="<f8").reshape(shape) for content in contents]
    joined = np.concatenate(groups, axis=1)[:, :runs]
    return dict(zip(experiment.quantities, joined, strict=True))


class _Prepared:
    """A trial, and the judges of the cells that share it; each is designed once a process."""

    def __init__(self, trial: Trial) -> None:
        self.trial = trial
        self._judges: dict[int, Any] = {}

    def judge(self, cell: int, values: Mapping[str, Value]) -> Any:
        with _PREPARING:
            if cell not in self._judges:
                self._judges[cell] = self.trial.judge(values)
            return self._judges[cell]


_PREPARED: dict[tuple[Any, ...], _Prepared] = {}
# a worker of Dask may compute in several threads
_PREPARING = threading.RLock()


def _prepared(task: Task, experiment: Experiment) -> _Prepared:
    shared = {
        name: value for name, value in task.cells[0][1].items() if name not in experiment.told
    }
    key = (task.sweep, *sorted(shared.items()))
    with _PREPARING:
        if key not in _PREPARED:
            while len(_PREPARED) >= _KEPT:
                del _PREPARED[next(iter(_PREPARED))]
            _PREPARED[key] = _Prepared(experiment.begin(task.cells[0][1], task.inputs))
        return _PREPARED[key]


def execute_cell(task: Task) -> Outcome:
    """Execute a chapter with the parameters of a cell; its results file is the content."""
    from inswsn_book.progress import Progress  # noqa: PLC0415
    from inswsn_book.runs import (  # noqa: PLC0415  # reading notebooks is slow
        Request,
        chosen_surroundings,
        run,
    )

    outcome = Outcome(library_state())
    ((cell, values),) = task.cells
    project = Project(task.inputs)
    with _troubles_of(cell, outcome):
        chapter = next(c for c in project.chapters() if c.name == task.source)
        quiet = Progress(Console(file=io.StringIO()))
        done = run(project, Request(chapter.number, values, chosen_surroundings()), quiet)
        outcome.done = [(cell, task.parts[0], done.results.model_dump_json().encode())]
    return outcome


def carried_environment() -> dict[str, str]:
    """Return what a worker on this machine has to know of the environment."""
    found = {MODULES_VARIABLE: os.environ.get(MODULES_VARIABLE, str(Path.cwd()))}
    if os.environ.get(DATA_VARIABLE):
        found[DATA_VARIABLE] = os.environ[DATA_VARIABLE]
    return found


def _short(error: BaseException) -> str:
    """Return an error as one line; of a chapter that failed the last one says what it was."""
    lines = [line for line in str(error).splitlines() if line.strip()] or [""]
    last = lines[0] if len(lines) == 1 else f"{lines[0]} {lines[-1]}"
    return f"{type(error).__name__}: {last}"[:300]
