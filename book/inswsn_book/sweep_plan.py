"""What a sweep has to compute: its cells, its groups of runs, and the tasks they make."""

from __future__ import annotations

import platform
from collections import deque
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from inswsn_book.experiments import EXPERIMENTS, Experiment, find_experiment
from inswsn_book.files import file_digest, text_digest, tree_digest
from inswsn_book.parameters import FILE_RULE, REGRESSOR_RULE, Schema, chapter_schema
from inswsn_book.project import Chapter, Project
from inswsn_book.sweep_grid import Grid, read_grid
from inswsn_book.sweep_store import FORM, as_text
from inswsn_book.sweep_tasks import (
    Task,
    code_state,
    compute_groups,
    execute_cell,
    library_word,
    module_digest,
    own_source,
)
from inswsn_book.sweep_workers import Compute
from inswsn_lib.errors import ParameterError
from inswsn_lib.evaluation import GROUP
from inswsn_lib.files import data_mirror
from inswsn_lib.lmi.solvers import chosen_solver

CODE = "library, Python or package"
_OWN_FILES = "file or module of your own"
_FEWEST, _MOST = 40, 1_000_000  # runs; a cell of the most of them takes half a gigabyte to sum up
#: Groups of a task, at most: it takes seconds, so that little is lost when it is
BLOCK = 4
_CELLS = 16  # of a task, at most, for the same reason
_TASKS = 4  # for each that computes, at least: they take unlike times
# what stands in the tables of a sweep beside its axes
_OF_ALL = frozenset(("quantity", "unit", "runs", "low", "high", "reason"))
_OF_CHAPTER = _OF_ALL | {"value", "interval"}
_OF_EXPERIMENT = _OF_ALL | {
    *("method", "mean", "standard_error", "median"),
    *("best", "error", "next", "lead", "within"),
}


@dataclass(frozen=True)
class Plan:
    """A sweep that may be run.

    Attributes
    ----------
    name : str
        What its folder is called.
    source : str
        As in `Task`.
    inputs : object
        As in `Task`.
    compute : callable
        What a worker does with a task.
    experiment : Experiment or None
        None if a chapter is executed in each cell.
    grid : Grid
        The cells.
    runs : int
        Runs of a cell; of a chapter that is executed its parameter ``runs``, or else 1.
    parts : int
        Groups of a cell.
    made_from : dict of str to str
        What the numbers depend on.
    """

    name: str
    source: str
    inputs: Any
    compute: Compute
    experiment: Experiment | None
    grid: Grid
    runs: int
    parts: int
    made_from: Mapping[str, str]

    @property
    def digest(self) -> str:
        """What tells this sweep from others."""
        return text_digest(as_text([self.source, dict(self.made_from)]))

    @property
    def runs_of_part(self) -> int:
        """How many of what is counted are done when a group is."""
        return GROUP if self.experiment else 1

    @property
    def counted(self) -> str:
        """What is counted: of a chapter that is executed, cells."""
        return "runs" if self.experiment else "cells"

    def shared_out(self, done: Mapping[int, set[int]], block: int, at_once: int) -> deque[Task]:
        """Return what is left to do, in tasks small enough that all who compute have some.

        Parameters
        ----------
        done, block
            As in `tasks`.
        at_once : int
            How many tasks are computed at once.
        """
        tasks = self.tasks(done, block)
        while block > 1 and len(tasks) < _TASKS * at_once:
            block //= 2
            tasks = self.tasks(done, block)
        return tasks

    def tasks(self, done: Mapping[int, set[int]], block: int = BLOCK) -> deque[Task]:
        """Return what is left to do, cells that share their runs together.

        Parameters
        ----------
        done : mapping of int to set of int
            Groups that are there, by cell.
        block : int
            Groups of a task, at most.
        """
        told = self.experiment.told if self.experiment else frozenset[str]()
        alike: dict[str, list[tuple[int, Mapping[str, Any]]]] = {}
        for cell, parameters in enumerate(self.grid.cells()):
            drawn = {name: value for name, value in parameters.items() if name not in told}
            alike.setdefault(as_text(drawn), []).append((cell, parameters))
        tasks: deque[Task] = deque()
        for cells in alike.values():
            for first in range(0, self.parts, block):
                wanted = range(first, min(first + block, self.parts))
                due: dict[tuple[int, ...], list[tuple[int, Mapping[str, Any]]]] = {}
                for cell, values in cells:
                    left = tuple(part for part in wanted if part not in done.get(cell, ()))
                    if left:
                        due.setdefault(left, []).append((cell, values))
                tasks += [
                    Task(self.digest, self.source, self.inputs, tuple(group[k : k + _CELLS]), parts)
                    for parts, group in due.items()
                    for k in range(0, len(group), _CELLS)
                ]
        return tasks


def make_plan(
    project: Project, name: str, axes: Iterable[str], settings: Iterable[str], runs: int | None
) -> Plan:
    """Return the sweep that a user asks for.

    Parameters
    ----------
    project : Project
        The checkout.
    name : str
        The number or name of a chapter, or ``package.module:NAME`` of a reader's own experiment.
    axes, settings : iterable of str
        As in `read_grid`.
    runs : int, optional
        Runs of a cell. Default: as the chapter declares, else 1000.

    Raises
    ------
    ParameterError
        If there is no such chapter or experiment, a parameter may not have its value, or
        ``INSWSN_SOLVER`` names no solver.
    InswsnError
        If a source cannot be read.
    """
    data = project.root / "data"
    chapter = None if ":" in name else project.find(name)
    if chapter and chapter.number not in EXPERIMENTS:
        return _plan_chapter(project, chapter, axes, settings, runs)
    source = chapter.number if chapter else name
    experiment = find_experiment(source)
    _check_experiment(experiment)
    axes = tuple(axes)
    _refuse_columns(axes, _OF_EXPERIMENT)
    grid = read_grid(experiment.schema, axes, settings, data)
    count = 1000 if runs is None else runs
    if not _FEWEST <= count <= _MOST:
        raise ParameterError("--runs", count, f"a whole number from {_FEWEST} to {_MOST}")
    facts = {
        CODE: code_state(own_source(source)),
        "solver": chosen_solver(),
        "lock": tree_digest(project.root, project.locks),
        "file below data/": tree_digest(data, [data / name for name in experiment.files]),
        _OWN_FILES: _brought(experiment.schema, grid, data),
    }
    return Plan(
        name=f"sweep-{source.replace(':', '-').replace('.', '-')}",
        source=source,
        inputs=experiment.load(data),
        compute=compute_groups,
        experiment=experiment,
        grid=grid,
        runs=count,
        parts=-(-count // GROUP),
        made_from=_with_grid(facts, source, grid),
    )


def _plan_chapter(
    project: Project,
    chapter: Chapter,
    axes: Iterable[str],
    settings: Iterable[str],
    runs: int | None,
) -> Plan:
    schema, data = chapter_schema(project.root, chapter.number), project.root / "data"
    settings, axes = tuple(settings), tuple(axes)
    _refuse_columns(axes, _OF_CHAPTER)
    if runs is not None:
        if "runs" not in schema.defaults:
            raise ParameterError(
                "--runs", runs, f"left out: chapter {chapter.number} has no parameter runs"
            )
        settings += (f"runs={runs}",)
    grid = read_grid(schema, axes, settings, data)
    facts = {
        CODE: code_state(),
        "solver": chosen_solver(),
        "Python": platform.python_version(),
        "state of recorded data": str(data_mirror() is not None),
        **_files_of_chapter(project, chapter, schema, grid),
    }
    return Plan(
        name=f"sweep-{chapter.number}",
        source=chapter.name,
        inputs=project.root,
        compute=execute_cell,
        experiment=None,
        grid=grid,
        runs=int(grid.values.get("runs", 1)),
        parts=1,
        made_from=_with_grid(facts, chapter.name, grid),
    )


def _files_of_chapter(
    project: Project, chapter: Chapter, schema: Schema, grid: Grid
) -> dict[str, str]:
    """Return the digests of the files that each execution of a chapter reads anew."""
    data = project.root / "data"
    files = [p for p in data.rglob("*") if p.is_file() and project.published not in p.parents]
    return {
        "lock": tree_digest(project.root, project.locks),
        "file below data/": tree_digest(data, files),
        _OWN_FILES: _brought(schema, grid, data),
        "text of the chapter": file_digest(chapter.source),
    }


def changed_since(project: Project, plan: Plan) -> list[str]:
    """Return what the numbers depend on that differs from when the plan was made.

    An experiment reads the files of its parameters when its cells begin; all else it has been
    given, or had been imported. A chapter that is executed reads everything anew in each cell.

    Parameters
    ----------
    project : Project
        The checkout.
    plan : Plan
        The sweep.
    """
    data = project.root / "data"
    if plan.experiment is not None:
        now = {_OWN_FILES: _brought(plan.experiment.schema, plan.grid, data)}
    else:
        chapter = project.find(plan.source)
        schema = chapter_schema(project.root, chapter.number)
        now = _files_of_chapter(project, chapter, schema, plan.grid)
        now[CODE] = plan.made_from[CODE].replace(
            plan.made_from[CODE].split(", ")[0], library_word()
        )
    return [name for name, digest in now.items() if digest != plan.made_from[name]]


def _refuse_columns(axes: Iterable[str], columns: frozenset[str]) -> None:
    for axis in axes:
        name = axis.partition("=")[0].strip()
        if name in columns:
            advice = "; give --runs" if name == "runs" else ""
            raise ParameterError(
                "--grid",
                axis,
                f"another parameter: {name} is a column of a sweep's tables already{advice}",
            )


def _check_experiment(experiment: Experiment) -> None:
    """Refuse what would fail after hours, when results are summed up."""
    for name, columns in (("methods", experiment.methods), ("columns", experiment.columns)):
        if not columns:
            raise ParameterError(f"{name} of the experiment", dict(columns), "one name or more")
    if experiment.headline not in experiment.columns:
        raise ParameterError(
            "headline of the experiment",
            experiment.headline,
            f"one of its columns, {', '.join(experiment.columns)}",
        )
    parameters = [parameter.name for parameter in experiment.schema.parameters]
    for name, words, allowed in (
        ("told", experiment.told, parameters),
        ("undrawn", experiment.undrawn, list(experiment.methods)),
    ):
        for word in sorted(words):
            if word not in allowed:
                raise ParameterError(
                    f"{name} of the experiment", word, f"one of {', '.join(allowed)}"
                )
    if "seed" not in parameters or experiment.schema["seed"].kind != "int":
        raise ParameterError(
            "schema of the experiment",
            ", ".join(parameters),
            "one with a whole number called seed, of which all random numbers come",
        )


def _brought(schema: Schema, grid: Grid, data: Path) -> str:
    """Return the digests of the files that parameters name, and of the modules of regressors.

    Of a module it is the digest of its own file: of what that imports nothing is known.
    """
    digests = {}
    for parameter in schema.parameters:
        for value in grid.axes.get(parameter.name, (grid.values[parameter.name],)):
            word = str(value)
            if parameter.rule == REGRESSOR_RULE:
                digests[word] = module_digest(word.partition(":")[0])
            elif parameter.rule == FILE_RULE and (data / word).is_file():
                digests[word] = file_digest(data / word)
    return as_text(digests)


def _with_grid(facts: Mapping[str, str], source: str, grid: Grid) -> dict[str, str]:
    axes = {name: list(values) for name, values in grid.axes.items()}
    fixed = {name: value for name, value in grid.values.items() if name not in grid.axes}
    return {
        **facts,
        "form of the store": FORM,
        "experiment": source,
        "grid": as_text(list(axes.items())),
        "set of parameters": as_text(fixed),
    }


def default_folder(project: Project, plan: Plan) -> Path:
    """Return the folder of a sweep below ``runs/``, named for its grid and parameters.

    The library has no part in the name: a sweep that was made with another one is found, and
    refused, rather than begun anew without a word.
    """
    names = ("experiment", "grid", "set of parameters")
    text = as_text([plan.made_from[name] for name in names])
    return project.root / "runs" / f"{plan.name}-{text_digest(text)[:8]}"
