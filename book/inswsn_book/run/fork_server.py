"""Forks kernels from one process that has loaded what each of them would load for itself.

This file is that process's script too, so it imports nothing of the packages. A kernel that loads
numpy, scipy, pandas and matplotlib itself takes ten times the processor time of a forked one.
"""

from __future__ import annotations

import gc
import itertools
import json
import os
import select
import signal
import socket
import subprocess
import sys
import threading
from collections.abc import Iterable, Mapping
from contextlib import suppress
from importlib import import_module
from typing import BinaryIO

_LOADED = (
    "ipykernel.kernelapp", "numpy", "scipy.linalg", "pandas", "matplotlib.pyplot", "pydantic",
)  # fmt: skip

#: What many chapters load besides: for the later kernels of a build of many
_OFTEN = ("numba", "scipy.optimize", "scipy.stats", "sklearn.linear_model")
_MANY = 3  # kernels


class Forked:
    """A process that another one has forked, with the methods of `subprocess.Popen` for it.

    It holds the other end of a pipe while it lives, whose first line is its number.
    """

    stdin = stdout = stderr = None

    def __init__(self, pipe: BinaryIO, pid: int) -> None:
        self.pid, self._pipe, self._ended = pid, pipe, False

    def poll(self) -> int | None:
        """Return None while the process lives; its status then is not known, and 0 is returned."""
        if not self._ended:
            self._ended = bool(select.select([self._pipe], [], [], 0)[0])
        return 0 if self._ended else None

    def wait(self) -> int:
        """Wait until the process has ended."""
        select.select([self._pipe], [], [])
        return 0

    def send_signal(self, number: int) -> None:
        """Send a signal, unless the process has ended."""
        if self.poll() is None:
            with suppress(ProcessLookupError):
                os.kill(self.pid, number)

    def terminate(self) -> None:
        """Ask the process to end."""
        self.send_signal(signal.SIGTERM)

    def kill(self) -> None:
        """End the process."""
        self.send_signal(signal.SIGKILL)


class Forker:
    """A process that forks kernels; it is started when the first is asked for.

    It ends with this one, whatever ends it: the socket between them is closed then.
    """

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._running: tuple[subprocess.Popen[bytes], socket.socket] | None = None

    def fork(
        self, words: list[str], environment: Mapping[str, str], folder: str, log: int
    ) -> Forked | None:
        """Return a kernel of the command line `words`, whose standard error goes to `log`.

        None if it cannot be had: the caller starts one by itself then, and learns why.
        """
        request = {"words": words, "environment": dict(environment), "folder": folder}
        mine, its = os.pipe()
        with self._lock:
            try:
                self._running = self._running or _start(environment)
                requests = self._running[1]
                socket.send_fds(requests, [b"\n"], [log, its])
                requests.sendall(json.dumps(request).encode() + b"\n")
            except OSError:  # it is gone; the next kernel may have another
                self._running = None
            finally:
                os.close(its)
        pipe = os.fdopen(mine, "rb", buffering=0)  # it is open while the kernel lives
        number = pipe.readline()
        if not number:  # nobody holds the other end
            pipe.close()
            return None
        return Forked(pipe, int(number))


def _start(environment: Mapping[str, str]) -> tuple[subprocess.Popen[bytes], socket.socket]:
    mine, its = socket.socketpair()
    with its:
        process = subprocess.Popen(
            [sys.executable, __file__, str(its.fileno())],
            env=environment, pass_fds=[its.fileno()], start_new_session=True,
            stdin=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
        )  # fmt: skip
    return process, mine


def _serve(requests: socket.socket) -> None:
    """Fork a kernel for each request until the other end is closed."""
    # matplotlib reads it as it is loaded; a kernel sets it before
    os.environ["MPLBACKEND"] = "module://matplotlib_inline.backend_inline"
    _load(_LOADED)
    signal.signal(signal.SIGCHLD, signal.SIG_IGN)  # nobody waits for those that end
    for count in itertools.count(1):
        byte, descriptors, *_ = socket.recv_fds(requests, 1, 2)
        text = bytearray()
        while byte and not text.endswith(b"\n"):
            byte = requests.recv(65536)
            text += byte
        if not byte:
            return
        if os.fork() == 0:
            requests.close()
            _become_kernel(json.loads(text), *descriptors)
        for descriptor in descriptors:
            os.close(descriptor)
        if count == _MANY:
            _load(_OFTEN)


def _load(names: Iterable[str]) -> None:
    for name in names:
        import_module(name)
    gc.collect()
    gc.freeze()  # what is shared stays shared


def _become_kernel(request: dict[str, object], log: int, pipe: int) -> None:
    import ipykernel.kernelapp as app  # noqa: PLC0415
    import ipykernel_launcher  # type: ignore[import-untyped]  # noqa: PLC0415
    import numpy as np  # noqa: PLC0415

    os.setsid()
    signal.signal(signal.SIGCHLD, signal.SIG_DFL)
    os.set_inheritable(pipe, False)
    os.write(pipe, f"{os.getpid()}\n".encode())
    os.dup2(log, 2)
    os.close(log)
    os.chdir(str(request["folder"]))
    os.environ.clear()
    os.environ.update(request["environment"])  # type: ignore[call-overload]
    np.random.seed()  # as it is in a process that loads it  # noqa: NPY002
    sys.argv = [ipykernel_launcher.__file__, *request["words"]]  # type: ignore[misc]
    # it ends with its parent, which is read from the environment before there is this one
    os.environ["JPY_PARENT_PID"] = str(os.getppid())
    parent = f"--IPKernelApp.parent_handle={os.getppid()}"
    app.launch_new_instance([*request["words"], parent])  # type: ignore[misc]
    sys.exit()


if __name__ == "__main__":
    _serve(socket.socket(fileno=int(sys.argv[1])))
