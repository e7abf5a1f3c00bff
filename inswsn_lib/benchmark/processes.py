"""An entry by its name, and the process in which it runs."""

from __future__ import annotations

import importlib.util
import inspect
import json
import os
import subprocess
import sys
import tempfile
import threading
from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack, suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Self

import pooch

from inswsn_lib.benchmark.events import Answer, Event, Task, plain_event, plain_task
from inswsn_lib.checks import array, covariance
from inswsn_lib.errors import InswsnError, ParameterError
from inswsn_lib.files import data_mirror

# What of the environment an entry has: how to find programs' libraries, and words
_KEPT = ("PATH", "LD_LIBRARY_PATH", "DYLD_LIBRARY_PATH", "SYSTEMROOT", "LANG", "LC_ALL", "TMPDIR")
_LIBRARY = Path(__file__).parents[1]
_THREADS = ("OMP", "OPENBLAS", "MKL", "NUMBA")


class EntryError(InswsnError):
    """An entry cannot be judged: it fails, says nothing, peeks, or is not causal."""


@dataclass(frozen=True)
class EntryName:
    """Where an entry is: an attribute of a module, or of a file."""

    shown: str
    root: Path
    module: str
    file: Path | None
    attribute: str

    @property
    def folder(self) -> Path:
        """The folder that it may read."""
        top = self.root / self.module.partition(".")[0]
        return top if self.module and top.is_dir() else self.root


def find_entry(entry: str | Callable[..., Any]) -> EntryName:
    """Return where an entry is, given by its name or itself."""
    given = entry if isinstance(entry, str) else _name_of(entry)
    place, _, attribute = given.rpartition(":")
    if not place or not attribute:
        raise ParameterError("entry", given, "module:Class or path/to/file.py:Class")
    if place.endswith(".py"):
        file = Path(place).resolve()
        if not file.is_file():
            raise ParameterError("entry", given, "in a file that exists")
        shown = f"{file.name}:{attribute}"
        return EntryName(shown, file.parent, "", file, attribute)
    spec = None
    with suppress(ImportError, ValueError):
        spec = importlib.util.find_spec(place)
    if spec is None or spec.origin is None:
        raise ParameterError("entry", given, "in a module that can be imported")
    up = place.count(".") + (Path(spec.origin).name == "__init__.py")
    return EntryName(given, Path(spec.origin).resolve().parents[up], place, None, attribute)


def _name_of(entry: Callable[..., Any]) -> str:
    file = None
    with suppress(TypeError, OSError):
        file = inspect.getsourcefile(entry)
    name = getattr(entry, "__qualname__", "<locals>")
    if file is None or "<" in name or not Path(file).is_file():
        raise ParameterError("entry", entry, "a class or function at the top level of a file")
    module = entry.__module__
    known = module != "__main__" and module in sys.modules and "." in module
    return f"{module if known else file}:{name}"


class EntryProcess:
    """A process with an entry, whose requests are answered one by one.

    Parameters
    ----------
    entry : EntryName
    timeout : float
        After which a request is given up, s.

    Attributes
    ----------
    causal : bool
    tunable : dict of str to (start, ratio)
    seconds : float
        That the entry took for its last answers.
    """

    def __init__(self, entry: EntryName, timeout: float) -> None:
        self.entry, self.timeout = entry, timeout
        self._stack, self._late, self.seconds = ExitStack(), False, 0.0

    def __enter__(self) -> Self:
        """Start it and let it import the entry."""
        folder = self._stack.enter_context(tempfile.TemporaryDirectory())
        kept = {name: os.environ[name] for name in _KEPT if name in os.environ}
        threads = {f"{name}_NUM_THREADS": "1" for name in _THREADS}
        self._process = subprocess.Popen(
            [sys.executable, "-P", "-X", "utf8", "-m", "inswsn_lib.benchmark.worker"],
            cwd=folder,
            env=kept | threads | {"PYTHONHASHSEED": "0", "PYTHONPATH": _path()},
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            encoding="utf-8",
        )
        try:
            declared = self._request(_loading(self.entry))
            self.causal: bool = declared["causal"]
            self.tunable: dict[str, list[float]] = declared["tunable"]
        except BaseException:
            self.__exit__()
            raise
        return self

    def __exit__(self, *_: object) -> None:
        """End it."""
        self._process.kill()
        with suppress(OSError):
            self._process.communicate()
        self._stack.close()

    def answers(
        self, task: Task, events: Sequence[Event], numbers: Mapping[str, float]
    ) -> list[Answer | None]:
        """Return the answer to each question, which comes before later events are given.

        Parameters
        ----------
        task : Task
        events : sequence of Event
        numbers : mapping of str to float
            That are tuned.
        """
        told = plain_task(replace(task, numbers=dict(numbers)))
        plain = [plain_event(event) for event in events]
        whole = None if self.causal else plain
        self._request({"start": {"task": told, "events": whole}})
        found, batch, self.seconds = [], [], 0.0
        for event in plain:
            batch.append(event)
            if event[1] == "ask":
                got = self._request({"step": {"events": batch}})
                self.seconds += got["seconds"]
                found.append(self._read(got["answer"]))
                batch = []
        return found

    def _request(self, request: dict[str, Any]) -> dict[str, Any]:
        stdin, stdout = self._process.stdin, self._process.stdout
        assert stdin is not None
        assert stdout is not None
        watch = threading.Timer(self.timeout, self._give_up)
        watch.start()
        try:
            stdin.write(json.dumps(request) + "\n")
            stdin.flush()
            got = stdout.readline()
        except BrokenPipeError:
            got = ""
        finally:
            watch.cancel()
        if self._late:
            raise EntryError(f"{self.entry.shown} has not answered within {self.timeout:g} s.")
        if not got:
            status = self._process.wait()
            raise EntryError(f"The process of {self.entry.shown} has ended with status {status}.")
        found: dict[str, Any] = json.loads(got)
        if "error" in found:
            raise EntryError(f"{self.entry.shown} failed: {found['error']}.")
        return found

    def _give_up(self) -> None:
        self._late = True
        self._process.kill()

    def _read(self, plain: list[Any] | None) -> Answer | None:
        """Return an answer that is what it may be."""
        if plain is None:
            return None
        position, velocity, P = plain
        try:
            position = array("position", position, (2,))
            if velocity is not None:
                velocity = array("velocity", velocity, (2,))
            if P is not None:
                n = 2 if velocity is None else 4
                P = covariance("covariance", P, (2, 2), (n, n))
        except ParameterError as error:
            raise EntryError(f"{self.entry.shown} gave an invalid answer: {error}") from None
        return Answer(position, velocity, P)


def _path() -> str:
    """Return where the library is, for a process that is not told of its surroundings."""
    return str(_LIBRARY.parent)


def _loading(entry: EntryName) -> dict[str, Any]:
    """Return the first request."""
    denied = [data_mirror(), Path(pooch.os_cache("inswsn"))]
    return {
        "allowed": [str(entry.folder), sys.prefix, sys.base_prefix, str(_LIBRARY)],
        "denied": [str(path) for path in denied if path is not None],
        "root": str(entry.root),
        "module": entry.module,
        "file": str(entry.file) if entry.file else "",
        "name": entry.attribute,
    }
