"""What a worker of a sweep computes: groups of runs of cells that share what is drawn."""

from __future__ import annotations

import importlib.util
import io
import os
import platform
import threading
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console
from threadpoolctl import threadpool_limits

from inswsn_lib.artefact.project import Project
from inswsn_lib.checkout import DATA_VARIABLE
from inswsn_lib.errors import InswsnError
from inswsn_lib.evaluation import GROUP, monte_carlo
from inswsn_lib.experiments import Experiment, Trial, find_experiment
from inswsn_lib.files import text_digest
from inswsn_lib.parameters import Value
from inswsn_lib.plugins import MODULES_VARIABLE

Cell = tuple[int, Mapping[str, Value]]
_KEPT = 4  # trials that a process keeps: tasks that share one follow each other


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
    """

    sweep: str
    source: str
    inputs: Any
    cells: tuple[Cell, ...]
    parts: tuple[int, ...]
    attempt: int = 0


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


@cache
def library_state(module: str = "") -> str:
    """Return what the numbers of this process depend on, as a text to compare.

    Parameters
    ----------
    module : str
        A reader's own module, if the experiment is in one.
    """
    project = Project(Path())  # its library is the one that runs
    words = [project.computing_digest()[:16], platform.python_version(), np.__version__]
    if module:
        spec = importlib.util.find_spec(module)
        origin = Path(spec.origin) if spec and spec.origin else None
        content = origin.read_text(encoding="utf-8") if origin else ""
        words.append(text_digest(content)[:16])
    return " ".join(words)


def own_module(source: str) -> str:
    """Return the module of a reader's own experiment, empty for one of the library."""
    return source.partition(":")[0] if ":" in source else ""


def compute_groups(task: Task) -> Outcome:
    """Compute the groups of an experiment; what is raised becomes part of the outcome."""
    outcome = Outcome("unknown")
    try:
        experiment = find_experiment(task.source)
        outcome.library = library_state(own_module(task.source))
        with threadpool_limits(1):  # the same order of sums on every machine of one kind
            _compute(task, experiment, outcome)
    except InswsnError as refusal:
        outcome.refused = {cell: str(refusal) for cell, _ in task.cells}
    except Exception as error:  # an experiment may raise anything; the others go on
        outcome.failed = {cell: _short(error) for cell, _ in task.cells}
    return outcome


def _compute(task: Task, experiment: Experiment, outcome: Outcome) -> None:
    prepared = _prepared(task, experiment)
    judges = {}
    for cell, values in task.cells:
        try:
            judges[cell] = prepared.judge(cell, values)
        except InswsnError as refusal:
            outcome.refused[cell] = str(refusal)
        except Exception as error:
            outcome.failed[cell] = _short(error)
    contents: dict[int, list[bytes]] = {cell: [] for cell in judges}
    seed = task.cells[0][1]["seed"]
    assert isinstance(seed, int)
    for part in task.parts:
        drawn = monte_carlo(prepared.trial.draw, GROUP, seed, first=GROUP * part)
        for cell, judge in judges.items():
            if cell in outcome.refused or cell in outcome.failed:
                continue
            try:
                contents[cell].append(_packed(experiment, judge(drawn)))
            except InswsnError as refusal:
                outcome.refused[cell] = str(refusal)
            except Exception as error:
                outcome.failed[cell] = _short(error)
    for cell, content in contents.items():
        if cell not in outcome.refused and cell not in outcome.failed:
            outcome.done += [(cell, *pair) for pair in zip(task.parts, content, strict=True)]


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
    from inswsn_lib.artefact.execution import execute_once  # noqa: PLC0415  # papermill is slow
    from inswsn_lib.artefact.progress import Progress  # noqa: PLC0415

    outcome = Outcome(library_state())
    ((cell, values),) = task.cells
    project = Project(task.inputs)
    try:
        chapter = next(c for c in project.chapters() if c.name == task.source)
        quiet = Progress(Console(file=io.StringIO()))
        _, results, _ = execute_once(project, chapter, values, quiet)
        outcome.done = [(cell, task.parts[0], results.model_dump_json().encode())]
    except InswsnError as refusal:
        outcome.refused[cell] = str(refusal)
    except Exception as error:
        outcome.failed[cell] = _short(error)
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
