"""Executes one notebook by papermill in a process of its own and tells its parent how it goes.

Each line on standard output is one event in JSON: ``{"cell": 3, "of": 20, "id": "ch00-003"}`` as a
cell starts, and at last ``{"done": true, "machine": {...}}`` or ``{"failed": ...}``, which speaks
of the last cell.
"""

from __future__ import annotations

import json
import os
import signal
import sys
import threading
from pathlib import Path
from typing import Any

import papermill
from papermill.engines import NBClientEngine, papermill_engines
from papermill.exceptions import PapermillExecutionError

from inswsn_book.provenance import machine_facts

# What Jupyter says of a kernel that ends before its first cell, or does not answer. Its ports are
# chosen before it starts, so one that starts at the same moment may have taken them; then it is
# worth another try.
_NO_START = ("Kernel died before replying to kernel_info", "Kernel didn't respond in")
_START_TIMEOUT = 60  # s


def _tell(**event: Any) -> None:
    print(json.dumps(event), flush=True)


class ReportingEngine(NBClientEngine):  # type: ignore[misc]  # papermill has no types
    """papermill's own engine, which also reports each cell as it starts."""

    @classmethod
    def execute_managed_notebook(cls, nb_man: Any, kernel_name: str, **options: Any) -> Any:
        """Execute the notebook; see papermill."""
        start, total = nb_man.cell_start, len(nb_man.nb.cells)

        def reporting_start(cell: Any, cell_index: int = -1, **details: Any) -> Any:
            _tell(cell=cell_index, of=total, id=cell.get("id", ""))
            return start(cell, cell_index=cell_index, **details)

        nb_man.cell_start = reporting_start
        return super().execute_managed_notebook(nb_man, kernel_name, **options)


def _execute(source: Path, target: Path, parameters: dict[str, Any], folder: Path) -> None:
    papermill_engines.register("reporting", ReportingEngine)
    papermill.execute_notebook(
        str(source),
        str(target),
        parameters=parameters,
        engine_name="reporting",
        kernel_name="python3",
        cwd=str(folder),
        progress_bar=False,
        autosave_cell_every=0,
        start_timeout=_START_TIMEOUT,
    )


def run(source: Path, target: Path, parameters: dict[str, Any], folder: Path) -> int:
    """Execute `source` into `target` with its kernel in `folder`; return the exit status."""
    try:
        try:
            _execute(source, target, parameters, folder)
        except RuntimeError as error:
            if not str(error).startswith(_NO_START):
                raise
            _execute(source, target, parameters, folder)
    except PapermillExecutionError as error:
        _tell(
            failed=f"{error.ename}: {error.evalue}",
            name=error.ename,
            said=error.evalue,
            source=error.source,
            traceback="\n".join(error.traceback),
        )
        return 1
    except Exception as error:
        _tell(failed=f"{type(error).__name__}: {error}")
        return 1
    _tell(done=True, machine=machine_facts())
    return 0


def _end_with_parent() -> None:
    """Stop when the parent is gone, however it went: its end of standard input closes."""
    sys.stdin.read()
    os.kill(os.getpid(), signal.SIGTERM)


def main() -> None:
    """Run the job that the one argument describes in JSON."""
    # the parent asks a worker to stop by SIGTERM; nbclient shuts its kernel down on the way out
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(143))
    threading.Thread(target=_end_with_parent, daemon=True).start()
    job = json.loads(sys.argv[1])
    sys.exit(run(Path(job["source"]), Path(job["target"]), job["parameters"], Path(job["folder"])))


if __name__ == "__main__":
    main()
