"""Executes a notebook by papermill, in a kernel with an interpreter and an environment of its own.

papermill takes half a second to load, so this module is imported where something is executed.
"""

from __future__ import annotations

import json
import subprocess
from collections.abc import Callable, Mapping
from functools import cache
from pathlib import Path
from typing import Any

import papermill
from papermill.clientwrap import PapermillNotebookClient
from papermill.engines import NBClientEngine, papermill_engines

# What Jupyter says of a kernel that ends before its first cell, or does not answer. Its ports are
# chosen before it starts, so one that starts at the same moment may have taken them; then it is
# worth another try.
_NO_START = ("Kernel died before replying to kernel_info", "Kernel didn't respond in")
_START_TIMEOUT = 60  # s


class _Engine(NBClientEngine):  # type: ignore[misc]  # papermill has no types
    """papermill's own engine, which tells of each cell as it starts, and of its kernel."""

    @classmethod
    def execute_managed_notebook(
        cls, nb_man: Any, kernel_name: str, *, python: str, options: dict[str, Any],
        tell_kernel: Callable[[Any], None], tell_cell: Callable[[int, int, str], None], **_: Any,
    ) -> None:  # fmt: skip
        """Execute the notebook; see papermill."""
        start, total = nb_man.cell_start, len(nb_man.nb.cells)

        def started(cell: Any, cell_index: int = -1, **details: Any) -> Any:
            tell_cell(cell_index + 1, total, cell.get("id", ""))
            return start(cell, cell_index=cell_index, **details)

        nb_man.cell_start = started
        client = PapermillNotebookClient(
            nb_man, kernel_name=kernel_name, timeout=None, startup_timeout=_START_TIMEOUT
        )
        kernel = client.create_kernel_manager()
        kernel.kernel_spec.argv[0] = python
        tell_kernel(kernel)
        client.execute(**options)


papermill_engines.register("inswsn", _Engine)


def execute_notebook(
    notebook: Any,
    parameters: Mapping[str, object],
    folder: Path,
    python: str,
    environment: Mapping[str, str],
    tell_kernel: Callable[[Any], None] = lambda _: None,
    tell_cell: Callable[[int, int, str], None] = lambda *_: None,
) -> Any:
    """Return the executed notebook; its kernel works in `folder`.

    Raises what papermill and nbclient raise where a cell fails or the kernel dies; what the kernel
    itself says on standard error is in ``kernel.log``. Before that the manager of the kernel and,
    as each starts, the number of the cell, of how many, and its id are told.
    """

    def execute() -> Any:
        with (folder / "kernel.log").open("w", encoding="utf-8") as log:
            return papermill.execute_notebook(
                notebook,
                None,
                parameters=dict(parameters),
                engine_name="inswsn",
                kernel_name="python3",
                progress_bar=False,
                python=python,
                options={"cwd": str(folder), "env": dict(environment), "stderr": log},
                tell_kernel=tell_kernel,
                tell_cell=tell_cell,
            )

    try:
        return execute()
    except RuntimeError as error:
        if not str(error).startswith(_NO_START):
            raise
    return execute()


@cache
def machine_of(python: str, environment: frozenset[tuple[str, str]]) -> dict[str, Any]:
    """Return `inswsn_book.provenance.machine_facts` of an interpreter in an environment."""
    ask = (
        "import json; from inswsn_book.provenance import machine_facts; "
        "print(json.dumps(machine_facts()))"
    )
    done = subprocess.run(
        [python, "-c", ask], env=dict(environment), capture_output=True, text=True, check=True
    )
    return dict(json.loads(done.stdout))
