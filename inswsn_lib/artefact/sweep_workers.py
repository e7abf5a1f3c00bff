"""Who computes the tasks of a sweep: processes of this machine, or the workers of Dask."""

from __future__ import annotations

import contextlib
import logging
import multiprocessing
import os
import signal
import threading
from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import CancelledError, Future, ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from multiprocessing.connection import Connection
from typing import Any, Protocol

from inswsn_lib.artefact.sweep_tasks import (
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
    """A process ended before its task did, or the task could not be brought to it and back."""


class Workers(Protocol):
    """Where tasks go, whoever computes them."""

    def look(self) -> str:
        """Look who is there; return a sentence if nobody computes now, or empty.

        Raises
        ------
        BuildError
            If there is nobody to wait for.
        """

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
    """The workers of a Dask cluster.

    Parameters
    ----------
    client : distributed.Client
        Connected.
    address : str
        As the user gave it, for an error.
    """

    def __init__(self, client: Any, address: str) -> None:
        self._client, self._address = client, address
        # the sweep itself tries again, so that it can count
        self._pool = client.get_executor(pure=False, retries=0)
        self._flying: set[Future[Outcome]] = set()
        self._threads = 0

    def look(self) -> str:
        """Count the threads of the cluster; return a sentence if there is none."""
        try:
            self._threads = sum(self._client.nthreads().values())
        except Exception:  # whatever a connection raises that breaks meanwhile
            raise self._gone() from None
        if self._client.status != "running":
            raise self._gone()
        if self._threads:
            return ""
        return f"The Dask cluster at {self._address} has no worker left; waiting for one."

    def has_room(self) -> bool:
        """Tell whether there are fewer than two tasks a thread of the cluster."""
        return len(self._flying) < max(2 * self._threads, 1)

    def submit(self, compute: Compute, task: Task) -> Future[Outcome]:
        """Begin a task somewhere."""
        future: Future[Outcome] = self._pool.submit(compute, task)
        self._flying.add(future)
        return future

    def outcome(self, future: Future[Outcome]) -> Outcome:
        """Return what came of a task."""
        self._flying.discard(future)
        try:
            return future.result()
        except (Exception, CancelledError) as error:  # what a worker raises is in the outcome
            if self._client.status != "running":
                raise self._gone() from None
            raise WorkerDiedError(f"{type(error).__name__}: {error}"[:300]) from None

    def _gone(self) -> BuildError:
        return BuildError(
            f"The Dask scheduler at {self._address} is gone; start it again and give the same "
            "command: what is finished is kept."
        )


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
            yield DaskWorkers(client, address)


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


# what to do about a worker that differs, by the first word of what it differs in
_REMEDIES = {
    **dict.fromkeys(("library", "Python", "numpy"), "install the same checkout there"),
    "solver": f"start it with the same {SOLVER_VARIABLE}",
}


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
    own = library_state(source)
    for worker, found in client.run(worker_state, source, on_error="return").items():
        if isinstance(found, BaseException):
            raise InswsnError(
                f"The Dask worker at {worker} cannot load this library: "
                f"{type(found).__name__}: {found}."
            )
        state, reason = found
        if reason:
            raise InswsnError(f"The Dask worker at {worker} cannot compute: {reason}")
        if state != own:
            pairs = zip(state.split(", "), own.split(", "), strict=True)
            other, here = next(pair for pair in pairs if pair[0] != pair[1])
            # what is left is the module of the experiment, which both of them have
            remedy = _REMEDIES.get(here.split()[0], "copy the module there")
            raise InswsnError(
                f"The Dask worker at {worker} has {other}, and this command {here}; {remedy}, and "
                "restart the worker: it keeps what it has once loaded."
            )
