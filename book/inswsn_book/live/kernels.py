"""Kernels in which the pages of the served book run their cells: one a page, few at a time."""

from __future__ import annotations

import asyncio
import os
import subprocess
import sys
import time
from collections.abc import AsyncIterator, Mapping
from contextlib import asynccontextmanager
from dataclasses import asdict
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import zmq
from jupyter_client.asynchronous.client import AsyncKernelClient
from jupyter_client.kernelspec import KernelSpec
from jupyter_client.manager import AsyncKernelManager

from inswsn_book.live.cells import Plan
from inswsn_book.live.said import Said
from inswsn_book.project import RESULTS_VARIABLE
from inswsn_lib.errors import InswsnError

#: How many kernels there are at most: each holds what it has computed
MOST = 4
_START_TIMEOUT = 60  # s
_LOOK = 1.0  # s, how often it is seen whether a kernel that says nothing is alive
_COMMAND = (
    sys.executable, "-m", "ipykernel_launcher", "-f", "{connection_file}",
    "--InteractiveShell.xmode=Plain", "--InteractiveShell.colors=NoColor",
    "--IPKernelApp.exec_lines=from inswsn_book.live import again; again.record_again()",
)  # fmt: skip
_GONE = "The kernel has ended, with all that it had computed; the next run starts a new one.\n"


class BusyError(InswsnError):
    """What is asked for has to wait for another run."""


class Kernel:
    """The kernel of one page, in a temporary folder; it is started when the first cell runs."""

    def __init__(self, environment: Mapping[str, str]) -> None:
        self.busy = self.ended = False
        self._environment = environment
        self._stopped = self._ready = self._executing = False
        self._plan = Plan()
        self._folder = TemporaryDirectory(prefix="inswsn-")
        self._launching = asyncio.Lock()  # what is being launched is ended once it can be
        self._manager: AsyncKernelManager | None = None
        self._client: AsyncKernelClient | None = None

    async def answer(self, asked: dict[str, Any]) -> AsyncIterator[dict[str, Any]]:
        """Run what a page asks for and say what comes of it, as `cells.answer` does."""
        self._stopped = False
        for turn in self._plan.turns(asked):
            yield turn
            cell = turn["cell"]
            source = asked["sources"][cell]
            said = await self._run(source)
            if not said["error"]:
                self._plan.ran(cell, source)
            yield {"cell": cell, **said}
            if self._stopped or self.ended:
                return

    async def stop(self) -> None:
        """Interrupt the cell that runs, or see that the next one does not."""
        self._stopped = True
        if self._executing and self._manager is not None:
            await self._manager.interrupt_kernel()

    async def end(self) -> None:
        """End the process, and those of its group; remove its folder."""
        self.ended = True
        async with self._launching:
            if self._client is not None:
                self._client.stop_channels()
            if self._manager is not None:
                await self._manager.shutdown_kernel(now=True)
            self._client = self._manager = None
        self._folder.cleanup()

    async def _run(self, source: str) -> dict[str, Any]:
        said, began = Said(), time.perf_counter()
        try:
            if not self._ready:
                await self._start()
                began = time.perf_counter()
            if self._stopped:
                said.error = "Stopped before it began.\n"
            else:
                await self._execute(source, said)
        except (RuntimeError, zmq.ZMQError):  # it did not start, or is gone
            said.error = _GONE
            await self.end()
        return {"seconds": time.perf_counter() - began, **asdict(said)}

    async def _start(self) -> None:
        folder = Path(self._folder.name)
        async with self._launching:
            if self.ended:
                raise RuntimeError(_GONE)
            self._manager = await _launched(folder, self._environment)
            self._client = self._manager.client()
        self._client.start_channels()
        await self._client.wait_for_ready(timeout=_START_TIMEOUT)
        self._ready = True

    async def _execute(self, source: str, said: Said) -> None:
        assert self._client is not None
        assert self._manager is not None
        running = asyncio.ensure_future(
            self._client.execute_interactive(source, allow_stdin=False, output_hook=said.take)
        )
        self._executing = True
        try:
            while not running.done():
                await asyncio.wait([running], timeout=_LOOK)
                if self.ended or not await self._manager.is_alive():
                    raise RuntimeError(_GONE)
            running.result()
        finally:
            running.cancel()
            self._executing = False


async def _launched(folder: Path, environment: Mapping[str, str]) -> AsyncKernelManager:
    """Launch a kernel that works in a folder and writes no results but there."""
    manager = AsyncKernelManager(connection_file=str(folder / "kernel.json"))
    # by its path: whatever Jupyter finds by a name may be another one
    manager._kernel_spec = KernelSpec(argv=list(_COMMAND), language="python")
    # by files of its folder, which no other user may enter, where their paths are not too long for
    # a socket; else by ports of 127.0.0.1, and each message is signed
    if len(os.fsencode(folder / "kernel-5")) <= zmq.IPC_PATH_MAX_LEN:
        manager.transport, manager.ip = "ipc", str(folder / "kernel")
    own = {"IPYTHONDIR": str(folder / "ipython"), RESULTS_VARIABLE: str(folder / "results")}
    work = folder / "work"
    work.mkdir()
    with (folder / "kernel.log").open("w", encoding="utf-8") as log:
        await manager.start_kernel(
            cwd=str(work), env={**environment, **own}, stdout=log, stderr=subprocess.STDOUT
        )
    return manager


class Kernels:
    """The kernels by their pages, the least recently used first."""

    def __init__(self) -> None:
        self._open: dict[str, Kernel] = {}
        self._ended = False

    @property
    def pages(self) -> list[str]:
        """The pages that have one."""
        return list(self._open)

    @asynccontextmanager
    async def taken(self, page: str, environment: Mapping[str, str]) -> AsyncIterator[Kernel]:
        """Give the kernel of a page for one run; refuse if it has to wait for another."""
        kernel = self._open.get(page)
        if kernel is not None and kernel.busy:
            raise BusyError("This page runs code already: wait for it, or stop it.")
        idle = [each for each, other in self._open.items() if not other.busy]
        if self._ended or (kernel is None and len(self._open) >= MOST and not idle):
            raise BusyError(f"{MOST} pages run code already: wait for one, or stop it.")
        kernel = self._open.pop(page, None) or Kernel(environment)
        self._open[page] = kernel
        kernel.busy = True
        try:
            if len(self._open) > MOST:
                await self._open.pop(idle[0]).end()
            yield kernel
        finally:
            kernel.busy = False
            if kernel.ended:
                self._open.pop(page, None)

    async def stop(self, page: str) -> None:
        """Interrupt what a page runs."""
        if page in self._open:
            await self._open[page].stop()

    async def end(self) -> None:
        """End all kernels; there will be no more."""
        self._ended = True
        while self._open:
            await self._open.popitem()[1].end()
