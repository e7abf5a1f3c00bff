"""Many runs of an experiment over a grid: shared out, kept as they come, and summed up."""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable, Mapping
from concurrent.futures import FIRST_COMPLETED, Future, wait
from contextlib import ExitStack
from dataclasses import replace
from functools import partial
from pathlib import Path

from inswsn_book.project import Project
from inswsn_book.provenance import available_cores
from inswsn_book.sweep_plan import BLOCK, Plan, changed_since, default_folder
from inswsn_book.sweep_progress import SweepProgress
from inswsn_book.sweep_results import Finished, cell_name, write_results
from inswsn_book.sweep_store import Store, check_folder
from inswsn_book.sweep_tasks import Outcome, Task, library_state, own_source
from inswsn_book.sweep_workers import (
    WorkerDiedError,
    Workers,
    dask_workers,
    local_workers,
)
from inswsn_lib.errors import BuildError, ParameterError

#: How often a task is tried in one call
ATTEMPTS = 3
_PAUSE = 1.0  # s; so often it is looked who is there


def run_sweep(
    project: Project,
    plan: Plan,
    progress: SweepProgress,
    *,
    out: Path | None = None,
    jobs: int | None = None,
    dask: str | None = None,
    fresh: bool = False,
    block: int = BLOCK,
    workers: Workers | None = None,
) -> Finished:
    """Compute what is not there of a sweep, and write its files.

    Parameters
    ----------
    project : Project
        The checkout.
    plan : Plan
        The sweep.
    progress : SweepProgress
        Told how it goes.
    out : Path, optional
        The folder. Default: one below ``runs/``.
    jobs : int, optional
        Processes. Default: one a core.
    dask : str, optional
        The address of a scheduler, in place of processes of this machine.
    fresh : bool
        Drop what is there.
    block : int
        Groups of runs of a task, at most.
    workers : Workers, optional
        Who computes, in place of processes of this machine.

    Raises
    ------
    ParameterError
        If the folder is of another kind, nobody answers at the address, or there are both `jobs`
        and `dask`.
    InswsnError
        If the folder holds a sweep made from something else, or another one runs there.
    BuildError
        If the scheduler of a cluster is gone, or a file that the numbers depend on is changed
        meanwhile.
    """
    if dask is not None and plan.experiment is None:
        raise ParameterError("--dask", dask, "left out: this chapter is executed as a whole")
    if dask is not None and jobs is not None:
        raise ParameterError("--jobs", jobs, "left out: the cluster of --dask has its own workers")
    folder = out or default_folder(project, plan)
    check_folder(folder)
    with ExitStack() as stack:
        if dask is not None:  # a wrong address leaves nothing behind
            workers = stack.enter_context(dask_workers(dask, own_source(plan.source)))
        store = stack.enter_context(Store(folder, plan.made_from, fresh=fresh))
        done = store.done()
        wanted = len(plan.grid.places()) * plan.parts
        kept = sum(part < plan.parts for parts in done.values() for part in parts)
        store.forget_failures()
        sweep = _Sweep(plan, store, progress, partial(changed_since, project, plan))
        size = plan.runs_of_part
        progress.started(plan.name, kept * size, wanted * size, plan.counted)
        at_once = workers.size() if workers else jobs or available_cores()
        tasks = plan.shared_out(done, block, at_once)
        if tasks:
            if workers is None:
                jobs = min(at_once, len(tasks))
                workers = stack.enter_context(local_workers(jobs))
                store.note(f"{jobs} process{'es' if jobs > 1 else ''} of this machine")
            else:
                store.note(f"the Dask cluster at {dask}" if dask else type(workers).__name__)
            try:
                sweep.work(tasks, workers)
            except KeyboardInterrupt:
                progress.say(
                    f"What is finished is kept in {store.folder}; the same command goes on."
                )
                raise
        return write_results(project, plan, store, kept=kept * size, computed=sweep.computed * size)


def _waits(task: Task, flying: Mapping[Future[Outcome], Task]) -> bool:
    """Tell whether a task has to wait, since one that may have ended a worker is computed alone."""
    return bool(flying) and (task.suspect or any(other.suspect for other in flying.values()))


class _Sweep:
    """The loop of a sweep; it knows nothing of who computes."""

    def __init__(
        self,
        plan: Plan,
        store: Store,
        progress: SweepProgress,
        changed: Callable[[], list[str]],
    ) -> None:
        self._plan, self._store, self._progress = plan, store, progress
        self._changed = changed
        self._names = [cell_name(place) for place in plan.grid.places()]
        self._failed: set[int] = set()
        self._left = [plan.parts] * len(self._names)
        for cell, parts in store.done().items():
            self._left[cell] -= sum(part < plan.parts for part in parts)
        self._library = library_state(own_source(plan.source))
        self.computed = 0

    def work(self, tasks: deque[Task], workers: Workers) -> None:
        """Share tasks out until none is left; few are under way at a time."""
        flying: dict[Future[Outcome], Task] = {}
        told = ""
        while tasks or flying:
            trouble = workers.look()
            if trouble and trouble != told:
                self._progress.say(trouble)
            told = trouble
            while tasks and workers.has_room() and not _waits(tasks[0], flying):
                task = self._still_wanted(tasks.popleft())
                if task.cells:
                    flying[workers.submit(self._plan.compute, task)] = task
            if tasks and not flying:
                time.sleep(_PAUSE)  # until there is a worker
            finished, _ = wait(flying, timeout=_PAUSE, return_when=FIRST_COMPLETED)
            for future in finished:
                task = flying.pop(future)
                try:
                    again = self._taken(task, workers.outcome(future))
                except WorkerDiedError as death:
                    if death.shared and not task.suspect:  # after all others, and alone
                        tasks.append(replace(task, suspect=True))
                        continue
                    again = {cell: str(death) for cell, _ in task.cells}
                tasks.extendleft(reversed(self._tried_again(task, again)))

    def _still_wanted(self, task: Task) -> Task:
        """Return the task without the cells that have failed meanwhile."""
        return replace(task, cells=tuple(c for c in task.cells if c[0] not in self._failed))

    def _taken(self, task: Task, outcome: Outcome) -> dict[int, str]:
        """Keep what was computed; return the cells to be tried again, and why."""
        if outcome.done and outcome.library != self._library:  # a worker that came later
            reason = f"a worker has another library: {outcome.library}, not {self._library}"
            return {cell: reason for cell, _ in task.cells}
        if outcome.done and (changed := self._changed()):
            raise BuildError(
                f"Another {' and another '.join(changed)} than when the sweep began: what was "
                "finished before is kept. Put it back and give the same command, or begin anew by "
                "--fresh."
            )
        self._store.add(outcome.done)
        self.computed += len(outcome.done)
        self._progress.advanced(len(outcome.done) * self._plan.runs_of_part)
        for cell, reason in outcome.refused.items():
            self._fail(cell, reason)
        for cell in {cell for cell, _, _ in outcome.done}:
            self._left[cell] -= len(task.parts)
            if not self._left[cell]:
                left = sum(map(bool, self._left)) - len(self._failed)
                self._progress.cell(self._names[cell], left)
        return outcome.failed

    def _tried_again(self, task: Task, reasons: dict[int, str]) -> list[Task]:
        """Return a task for each cell that may be tried again; the others have failed."""
        alone = []
        for cell, values in task.cells:
            if cell not in reasons or cell in self._failed:
                continue
            if task.attempt + 1 < ATTEMPTS:
                alone.append(replace(task, cells=((cell, values),), attempt=task.attempt + 1))
            else:
                self._fail(cell, f"{reasons[cell]} (tried {ATTEMPTS} times)")
        return alone

    def _fail(self, cell: int, reason: str) -> None:
        if cell not in self._failed:
            self._failed.add(cell)
            self._store.fail(cell, reason)
            self._progress.failed(self._names[cell], reason)
