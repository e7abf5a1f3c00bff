"""Who computes the tasks of a sweep: processes of this machine, or the workers of Dask."""

from __future__ import annotations

import contextlib
import functools
import logging
import multiprocessing
import os
import signal
import threading
from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import CancelledError, Future, InvalidStateError, ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from multiprocessing.connection import Connection
from typing import Any, Protocol

from inswsn_book.sweep_tasks import (
    PACKAGES,
    Outcome,
    Task,
    carried_environment,
    library_state,
    worker_state,
)
from inswsn_lib.errors import BuildError, InswsnError, ParameterError
from inswsn_lib.lmi.solvers import SOLVER_VARIABLE

_CONNECT_SECONDS = 10
_CHATTY = (
    *("distributed", "distributed.client", "distributed.core", "distributed.utils"),
    *("tornado.application", "asyncio"),
)
Compute = Callable[[Task], Outcome]


class WorkerDiedError(Exception):
    """A process ended before its task did, or the task could not be brought to it and back.

    Parameters
    ----------
    reason : str
        What is known.
    shared : bool
        Whether it had other tasks as well, of which one may have ended it.
    """

    def __init__(self, reason: str, *, shared: bool = False) -> None:
        super().__init__(reason)
        self.shared = shared


class Workers(Protocol):
    """Where tasks go, whoever computes them."""

    def look(self) -> str:
        """Look who is there; return a sentence if nobody computes now, or empty.

        Raises
        ------
        BuildError
            If there is nobody to wait for.
        """

    def size(self) -> int:
        """Return how many tasks are computed at once."""

    def has_room(self) -> bool:
        """Tell whether another task may be submitted; few are kept waiting."""

    def submit(self, compute: Compute, task: Task) -> Future[Outcome]:
        """Begin a task."""

    def outcome(self, future: Future[Outcome]) -> Outcome:
        """Return what came of a finished task.

        Raises
        ------
        WorkerDiedError
            If its process died.
        BuildError
            If there is nobody left to compute.
        """


class _Slot:
    """One process, and the pipe whose end tells it to end as well."""

    def __init__(self) -> None:
        self._reader, self._writer = multiprocessing.Pipe(duplex=False)
        self.pool = ProcessPoolExecutor(
            1,
            mp_context=multiprocessing.get_context("spawn"),
            initializer=_begin,
            initargs=(self._reader, carried_environment()),
        )

    def submit(self, compute: Compute, task: Task) -> Future[Outcome]:
        # the first task starts the process
        with _interrupts_held():
            return self.pool.submit(compute, task)

    def end(self) -> None:
        self._writer.close()
        self._reader.close()
        self.pool.shutdown(wait=False, cancel_futures=True)


@contextlib.contextmanager
def _interrupts_held() -> Iterator[None]:
    """Hold interrupts back: a process that is started meanwhile holds them until it ignores them.

    Otherwise a Ctrl-C while it imports its modules ends it with a traceback.
    """
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def _begin(ending: Connection, environment: Mapping[str, str]) -> None:
    """Prepare a process: an interrupt is for the command, and its end is the end of all."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGINT})
    os.environ.update(environment)

    def wait() -> None:
        # also when the command is killed: the kernel closes the other end of the pipe
        with contextlib.suppress(EOFError, OSError):
            ending.recv()
        os._exit(0)

    threading.Thread(target=wait, daemon=True).start()


class LocalWorkers:
    """Processes of this machine, each on its own, so that it is known which task killed one.

    Parameters
    ----------
    jobs : int
        How many.
    """

    def __init__(self, jobs: int) -> None:
        self._idle = [_Slot() for _ in range(jobs)]
        self._busy: dict[Future[Outcome], _Slot] = {}

    def look(self) -> str:
        """Return empty: a process that died is replaced."""
        return ""

    def size(self) -> int:
        """Return how many processes there are."""
        return len(self._idle) + len(self._busy)

    def has_room(self) -> bool:
        """Tell whether a process is idle."""
        return bool(self._idle)

    def submit(self, compute: Compute, task: Task) -> Future[Outcome]:
        """Begin a task in the process that has been idle for the shortest time, if it lives."""
        slot = self._idle.pop()
        try:
            future = slot.submit(compute, task)
        except BrokenProcessPool:
            slot.end()
            slot = _Slot()
            future = slot.submit(compute, task)
        self._busy[future] = slot
        return future

    def outcome(self, future: Future[Outcome]) -> Outcome:
        """Return what came of a task; a process that died is replaced."""
        slot = self._busy.pop(future)
        try:
            found = future.result()
        except BrokenProcessPool:
            slot.end()
            self._idle.append(_Slot())
            raise WorkerDiedError("the process that computed it ended") from None
        except Exception as error:  # such as what cannot be pickled, either way
            self._idle.append(slot)
            raise WorkerDiedError(f"{type(error).__name__}: {error}"[:300]) from None
        self._idle.append(slot)
        return found

    def stop(self) -> None:
        """End all processes, whatever they do."""
        for slot in (*self._idle, *self._busy.values()):
            slot.end()


@contextlib.contextmanager
def local_workers(jobs: int) -> Iterator[LocalWorkers]:
    """Have processes of this machine, and end them."""
    workers = LocalWorkers(jobs)
    try:
        yield workers
    finally:
        workers.stop()


class DaskWorkers:
    """The workers of a Dask cluster that compute the same numbers as the command would.

    A worker that comes later is asked as those that were there; one that differs gets no task.

    Parameters
    ----------
    client : distributed.Client
        Connected.
    address : str
        As the user gave it, for an error.
    source : str
        A reader's own experiment that the workers have to have, or empty.
    """

    def __init__(self, client: Any, address: str, source: str) -> None:
        self._client, self._address, self._source = client, address, source
        # each with the future of Dask, and the workers that it may go to
        self._flying: dict[Future[Outcome], tuple[Any, frozenset[str]]] = {}
        self._threads: dict[str, int] = {}
        self._reasons: dict[str, str] = {}  # why a worker gets none; empty for one that does

    def look(self) -> str:
        """See who is there; return a sentence on who gets no task, or empty."""
        try:
            there = dict(self._client.nthreads())
            new = [worker for worker in there if worker not in self._reasons]
            found = reasons_against(self._client, new, self._source) if new else {}
        except Exception:  # whatever a connection raises that breaks meanwhile
            raise self._gone() from None
        if self._client.status != "running":
            raise self._gone()
        # one that has gone is asked once more if it comes again
        self._reasons = {w: r for w, r in (self._reasons | found).items() if w in there}
        self._threads = {w: n for w, n in there.items() if not self._reasons[w]}
        for future, (pending, workers) in self._flying.items():
            if workers.isdisjoint(there):  # it would wait for them
                _end(future, CancelledError())
                with contextlib.suppress(Exception):  # if the scheduler has gone, it is told next
                    pending.cancel()
        said = [f"{reason} It gets no task." for reason in self._reasons.values() if reason]
        if not self._threads:
            left = "other worker" if said else "worker left"
            said.append(f"The Dask cluster at {self._address} has no {left}; waiting for one.")
        return " ".join(said)

    def size(self) -> int:
        """Return the number of threads of the workers that get tasks."""
        return sum(self._threads.values())

    def has_room(self) -> bool:
        """Tell whether there are fewer than two tasks a thread of those workers."""
        return len(self._flying) < 2 * self.size()

    def submit(self, compute: Compute, task: Task) -> Future[Outcome]:
        """Begin a task on one of those workers."""
        workers = list(self._threads)
        # the sweep itself tries again, so that it can count
        pending = self._client.submit(
            compute, task, pure=False, retries=0, workers=workers, allow_other_workers=False
        )
        future: Future[Outcome] = Future()
        self._flying[future] = pending, frozenset(workers)
        pending.add_done_callback(functools.partial(_pass_on, future))
        return future

    def outcome(self, future: Future[Outcome]) -> Outcome:
        """Return what came of a task."""
        from distributed import KilledWorker  # noqa: PLC0415

        del self._flying[future]
        try:
            return future.result()
        except (Exception, CancelledError) as error:  # what a worker raises is in the outcome
            if self._client.status != "running":
                raise self._gone() from None
            # Dask counts a death against all tasks that the worker had, also those that waited
            shared = isinstance(error, KilledWorker | CancelledError)
            reason = str(error) or "the workers that could compute it have gone"
            raise WorkerDiedError(
                f"{type(error).__name__}: {reason}"[:300], shared=shared
            ) from None

    def _gone(self) -> BuildError:
        return BuildError(
            f"The Dask scheduler at {self._address} is gone; start it again and give the same "
            "command: what is finished is kept."
        )


def _pass_on(future: Future[Outcome], pending: Any) -> None:
    """Take over what came of a future of Dask, which has ended."""
    try:
        _end(future, pending.result())
    except BaseException as error:  # whatever it is, the sweep waits for it
        _end(future, error)


def _end(future: Future[Outcome], found: Outcome | BaseException) -> None:
    """Give a future its end, unless it has one: a death and a cancel may come at one time."""
    with contextlib.suppress(InvalidStateError):
        if isinstance(found, BaseException):
            future.set_exception(found)
        else:
            future.set_result(found)


@contextlib.contextmanager
def dask_workers(address: str, source: str) -> Iterator[DaskWorkers]:
    """Have the workers of a cluster.

    Parameters
    ----------
    address : str
        Of its scheduler, as ``tcp://host:8786``.
    source : str
        A reader's own experiment that the workers have to have, or empty.

    Raises
    ------
    ParameterError
        If nobody answers there.
    InswsnError
        If there is no worker, or one computes with another library or solver.
    """
    import dask  # noqa: PLC0415  # they take a second to load
    import distributed  # noqa: PLC0415

    with dask.config.set({"distributed.comm.timeouts.connect": _CONNECT_SECONDS}), _quiet():
        try:
            client = distributed.Client(address, timeout=_CONNECT_SECONDS, set_as_default=False)
        except (OSError, ValueError, ImportError, TypeError) as error:
            why = (str(error).splitlines() or [type(error).__name__])[0].rstrip(".")
            raise ParameterError(
                "--dask", address, f"the address of a Dask scheduler that answers ({why})"
            ) from None
        with client:
            check_workers(client, address, source)
            workers = DaskWorkers(client, address, source)
            workers.look()
            yield workers


@contextlib.contextmanager
def _quiet() -> Iterator[None]:
    """Keep the client's tracebacks from the terminal: what they mean is told in a sentence."""
    loggers = [logging.getLogger(name) for name in _CHATTY]
    levels = [logger.level for logger in loggers]
    for logger in loggers:
        logger.setLevel(logging.CRITICAL + 1)
    try:
        yield
    finally:
        for logger, level in zip(loggers, levels, strict=True):
            logger.setLevel(level)


def check_workers(client: Any, address: str, source: str) -> None:
    """Refuse a cluster whose workers would compute other numbers.

    Parameters
    ----------
    client : distributed.Client
        Connected.
    address : str
        Of the scheduler.
    source : str
        A reader's own experiment, or empty.

    Raises
    ------
    InswsnError
        If there is no worker, or one of them has something else, or not what it needs.
    """
    if not client.nthreads():
        raise InswsnError(f"The Dask scheduler at {address} has no worker; start one: dask worker.")
    for reason in reasons_against(client, None, source).values():
        if reason:
            raise InswsnError(reason)


def reasons_against(client: Any, workers: list[str] | None, source: str) -> dict[str, str]:
    """Ask workers what they would compute with.

    Parameters
    ----------
    client : distributed.Client
        Connected.
    workers : list of str or None
        Their addresses; all if None.
    source : str
        A reader's own experiment, or empty.

    Returns
    -------
    dict of str to str
        For each of them why its numbers would be others, or empty.
    """
    own = library_state(source)
    answers = client.run(worker_state, source, workers=workers, on_error="return")
    return {worker: _reason_against(worker, found, own) for worker, found in answers.items()}


def _reason_against(worker: str, found: Any, own: str) -> str:
    if isinstance(found, BaseException):
        return (
            f"The Dask worker at {worker} cannot load this library: {type(found).__name__}: "
            f"{found}."
        )
    state, reason = found
    if reason:
        return f"The Dask worker at {worker} cannot compute: {reason}"
    if state == own:
        return ""
    # another library may tell of other things
    pairs = list(zip(state.split(", "), own.split(", "), strict=False))
    other, here = next((pair for pair in pairs if pair[0] != pair[1]), pairs[0])
    # what is left is the module of the experiment, which both of them have
    remedy = _REMEDIES.get(here.split()[0], "copy the module there")
    return (
        f"The Dask worker at {worker} has {other}, and this command {here}; {remedy}, and restart "
        "the worker: it keeps what it has once loaded."
    )


# what to do about a worker that differs, by the first word of what it differs in
_REMEDIES = {
    **dict.fromkeys(("library", "Python", *PACKAGES), "install the same checkout there"),
    "solver": f"start it with the same {SOLVER_VARIABLE}",
}
