"""Executes one notebook in a process of its own: the parent's side of `inswsn_book.worker`."""

from __future__ import annotations

import json
import subprocess
import threading
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import nbformat

from inswsn_book.progress import Progress
from inswsn_lib.errors import BuildError, InswsnError, ParameterError

_STOP_SECONDS = 10.0


class ChapterError(BuildError):
    """A chapter failed; the message names the chapter and the cell and holds the traceback.

    Attributes
    ----------
    refusal : str or None
        The sentence in which the library refused what it was given, if that was the reason.
    """

    refusal: str | None = None


@dataclass
class Workers:
    """The processes that are running, so that all of them can be stopped."""

    stopping: threading.Event = field(default_factory=threading.Event)
    _processes: set[subprocess.Popen[str]] = field(default_factory=set)
    _guard: threading.Lock = field(default_factory=threading.Lock)

    def start(
        self, command: Sequence[str], environment: Mapping[str, str]
    ) -> subprocess.Popen[str]:
        """Start a process, which ends when this one does."""
        with self._guard:
            if self.stopping.is_set():
                raise ChapterError("stopped")
            process = subprocess.Popen(
                command,
                env=environment,
                stdin=subprocess.PIPE,  # its end tells the worker that this process is gone
                stdout=subprocess.PIPE,
                stderr=subprocess.PIPE,
                text=True,
                start_new_session=True,  # an interrupt reaches this process only; it stops them
            )
            self._processes.add(process)
        return process

    def ended(self, process: subprocess.Popen[str]) -> None:
        """Forget a process that has ended."""
        with self._guard:
            self._processes.discard(process)

    def stop(self) -> None:
        """Stop all that are running, and start no other."""
        with self._guard:
            self.stopping.set()
            running = list(self._processes)
        for process in running:
            process.terminate()
        for process in running:
            try:
                process.wait(_STOP_SECONDS)
            except subprocess.TimeoutExpired:
                process.kill()


def execute_notebook(
    name: str,
    notebook: Any,
    parameters: Mapping[str, object],
    folder: Path,
    python: str,
    environment: Mapping[str, str],
    workers: Workers,
    progress: Progress,
) -> tuple[Any, dict[str, Any]]:
    """Execute a notebook in a process whose kernel works in `folder`.

    Returns
    -------
    executed : nbformat.NotebookNode
    machine : dict
        The facts of the machine, `inswsn_book.provenance.machine_facts`, from that process.

    Raises
    ------
    ChapterError
        If a cell raises, or the process ends before its time.
    """
    progress.started(name, len(notebook.cells) + bool(parameters))
    source, target = folder / "source.ipynb", folder / "executed.ipynb"
    nbformat.write(notebook, source)
    job = {
        "source": str(source),
        "target": str(target),
        "parameters": dict(parameters),
        "folder": str(folder),
    }
    process = workers.start([python, "-m", "inswsn_book.worker", json.dumps(job)], environment)
    try:
        machine = _follow(name, process, progress)
    finally:
        workers.ended(process)
    return nbformat.read(target, as_version=4), machine


def _follow(name: str, process: subprocess.Popen[str], progress: Progress) -> dict[str, Any]:
    """Read a worker's events until it ends; return its machine, or raise if it failed."""
    assert process.stdout is not None
    assert process.stderr is not None
    noise: list[str] = []
    reader = threading.Thread(target=noise.extend, args=(process.stderr,), daemon=True)
    reader.start()
    event: dict[str, Any] = {}
    place = "before its first cell"
    for line in process.stdout:
        try:
            event = json.loads(line)
        except json.JSONDecodeError:
            noise.append(line)
            continue
        if "id" in event:
            place = f"in cell {event['cell'] + 1} of {event['of']} ({event['id']})"
            progress.cell(name, event["cell"] + 1)
    process.wait()
    reader.join()
    if event.get("done"):
        return dict(event["machine"])
    if "failed" not in event:
        raise ChapterError(
            f"Chapter {name} ended {place} with status {process.returncode}:\n" + "".join(noise)
        )
    source = f"\n\n{event['source']}\n" if event.get("source") else "\n"
    said = event.get("traceback") or event["failed"]
    failure = ChapterError(f"Chapter {name} failed {place}:{source}\n{said}")
    if event.get("name") in (InswsnError.__name__, ParameterError.__name__):
        failure.refusal = event["said"]
    raise failure
