"""The process in which an entry runs: it reads lines of JSON, and answers each with one.

Started by `processes` as ``python -m inswsn_lib.benchmark.worker``. What the entry prints goes to
the standard error.
"""

from __future__ import annotations

import importlib
import importlib.util
import json
import os
import random
import sys
import traceback
from collections.abc import Callable
from pathlib import Path
from time import perf_counter
from types import ModuleType
from typing import Any

import numpy as np

from inswsn_lib.benchmark.events import Answer, read_event, read_task

_NETWORK = ("socket.connect", "socket.bind", "socket.getaddrinfo", "socket.sendto")
_PROGRAMS = ("subprocess.Popen", "os.system", "os.exec", "os.posix_spawn", "os.fork")
_WRITING = os.O_WRONLY | os.O_RDWR | os.O_CREAT


def guard(allowed: list[str], denied: list[str]) -> Callable[[str, tuple[Any, ...]], None]:
    """Return an audit hook that refuses files outside of some folders, network and programs.

    Parameters
    ----------
    allowed, denied : list of str
        Folders; of those that a file is in, the innermost counts. Only the first of those that are
        allowed may be written to, and where Python keeps what it compiled.
    """
    rules = {os.path.realpath(each): True for each in allowed}
    rules |= {os.path.realpath(each): False for each in denied}
    own = os.path.realpath(allowed[0])

    def may_open(path: str, writes: bool) -> bool:
        inside = [folder for folder in rules if path == folder or path.startswith(folder + os.sep)]
        if not inside or not rules[max(inside, key=len)]:
            return path == os.devnull
        return not writes or path.startswith(own + os.sep) or "__pycache__" in path

    def hook(event: str, given: tuple[Any, ...]) -> None:
        if event == "open" and not isinstance(given[0], int):
            path, mode, flags = given
            writes = bool(set(mode or "") & set("wax+") or (flags or 0) & _WRITING)
            if not may_open(os.path.realpath(os.fsdecode(path)), writes):
                raise PermissionError(f"an entry may not open {os.fsdecode(path)}")
        elif event in _NETWORK or event in _PROGRAMS:
            what = "use the network" if event in _NETWORK else "start programs"
            raise PermissionError(f"an entry may not {what}")

    return hook


class Worker:
    """An entry, what it has made for the task at hand, and how long that took."""

    entry: Any
    at_work: Any

    def load(self, root: str, module: str, file: str, name: str) -> dict[str, Any]:
        """Import an entry; return the numbers that it wants to be tuned, and if it is causal."""
        sys.path.append(root)
        found: Any = _from_file(file) if file else importlib.import_module(module)
        for part in name.split("."):
            found = getattr(found, part)
        self.entry = found
        return {
            "tunable": getattr(found, "tunable", {}),
            "causal": bool(getattr(found, "causal", True)),
        }

    def start(self, task: dict[str, Any], events: list[list[Any]] | None) -> dict[str, Any]:
        """Let the entry begin anew; one that is not causal is given all events at once."""
        random.seed(0)
        np.random.seed(0)  # noqa: NPY002  # for entries that use it
        whole = [] if events is None else [[read_event(event) for event in events]]
        self.at_work = self.entry(read_task(task), *whole)
        return {}

    def step(self, events: list[list[Any]]) -> dict[str, Any]:
        """Give events; return the answer to the last one, and the time that it all took."""
        read = [read_event(event) for event in events]
        begin = perf_counter()
        for event in read:
            answer = self.at_work.step(event)
        return {"seconds": perf_counter() - begin, "answer": _plain_answer(answer)}

    def serve(self, request: dict[str, Any]) -> dict[str, Any]:
        """Do what is asked."""
        ((name, given),) = request.items()
        done: dict[str, Any] = getattr(self, name)(**given)
        return done


def _from_file(file: str) -> ModuleType:
    spec = importlib.util.spec_from_file_location(f"entry_{Path(file).stem}", file)
    if spec is None or spec.loader is None:
        raise ImportError(f"{file} is not a Python file")
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module
    spec.loader.exec_module(module)
    return module


def _plain_answer(answer: Any) -> list[Any] | None:
    if answer is None:
        return None
    if not isinstance(answer, Answer):
        raise TypeError(f"step returned {type(answer).__name__}, not an Answer or None")
    parts = (answer.position, answer.velocity, answer.covariance)
    return [None if part is None else np.asarray(part, dtype=float).tolist() for part in parts]


def _told(error: BaseException, file: str) -> str:
    lines = [f.lineno for f in traceback.extract_tb(error.__traceback__) if f.filename == file]
    place = f" (line {lines[-1]} of {Path(file).name})" if lines else ""
    return f"{type(error).__name__}: {error}{place}"


def main() -> None:
    """Serve until the standard input ends."""
    with os.fdopen(os.dup(0), encoding="utf-8") as requests, os.fdopen(os.dup(1), "w") as replies:
        os.dup2(os.open(os.devnull, os.O_RDONLY), 0)
        os.dup2(2, 1)
        first = json.loads(requests.readline())
        own = [os.getcwd(), *first.pop("allowed")]  # noqa: PTH109
        sys.addaudithook(guard([*own, *filter(None, sys.path)], first.pop("denied")))
        worker, request = Worker(), {"load": first}
        while request:
            try:
                done = worker.serve(request)
            except BaseException as error:  # also an entry that would exit
                done = {"error": _told(error, first["file"])}
            replies.write(json.dumps(done) + "\n")
            replies.flush()
            request = json.loads(requests.readline() or "null")


if __name__ == "__main__":
    main()
