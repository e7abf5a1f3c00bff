"""Executes a notebook by papermill, in a kernel with an environment of its own.

papermill takes half a second to load, so this module is imported where something is executed.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import papermill
import zmq
from jupyter_client.kernelspec import KernelSpec
from papermill.clientwrap import PapermillNotebookClient
from papermill.engines import NBClientEngine, papermill_engines

_START_TIMEOUT = 60  # s


class _Engine(NBClientEngine):  # type: ignore[misc]  # papermill has no types
    """papermill's own engine, which tells of each cell as it starts, and of its kernel."""

    @classmethod
    def execute_managed_notebook(
        cls, nb_man: Any, kernel_name: str, *, options: dict[str, Any],
        tell_kernel: Callable[[Any], None], tell_cell: Callable[[int, int, str], None], **_: Any,
    ) -> None:  # fmt: skip
        """Execute the notebook; see papermill."""
        start, total = nb_man.cell_start, len(nb_man.nb.cells)

        def started(cell: Any, cell_index: int = -1, **details: Any) -> Any:
            tell_cell(cell_index + 1, total, cell.get("id", ""))
            return start(cell, cell_index=cell_index, **details)

        nb_man.cell_start = started
        client = PapermillNotebookClient(
            nb_man,
            kernel_name=kernel_name,
            timeout=None,
            startup_timeout=_START_TIMEOUT,
            coalesce_streams=True,  # what a cell prints comes in as many pieces as it likes
        )
        kernel = client.create_kernel_manager()
        # by its path: whatever Jupyter finds by a name may be another one
        command = [sys.executable, "-m", "ipykernel_launcher", "-f", "{connection_file}"]
        kernel._kernel_spec = KernelSpec(argv=command, language="python")
        folder = Path(options["cwd"])
        kernel.connection_file = str(folder / "kernel.json")
        # by files of its folder, where their path is no longer than a socket's may be: of network
        # ports another process may take one that was chosen
        if len(os.fsencode(folder / "kernel-5")) <= zmq.IPC_PATH_MAX_LEN:
            kernel.transport, kernel.ip = "ipc", str(folder / "kernel")
        tell_kernel(kernel)
        client.execute(**options)


papermill_engines.register("inswsn", _Engine)


def execute_notebook(
    notebook: Any,
    parameters: Mapping[str, object],
    folder: Path,
    environment: Mapping[str, str],
    tell_kernel: Callable[[Any], None] = lambda _: None,
    tell_cell: Callable[[int, int, str], None] = lambda *_: None,
) -> Any:
    """Return the executed notebook; its kernel works in `folder`.

    Raises what papermill and nbclient raise where a cell fails or the kernel dies; what the kernel
    itself says on standard error is in ``kernel.log``. Before that the manager of the kernel and,
    as each starts, the number of the cell, of how many, and its id are told.
    """
    with (folder / "kernel.log").open("w", encoding="utf-8") as log:
        return papermill.execute_notebook(
            notebook,
            None,
            parameters=dict(parameters),
            engine_name="inswsn",
            kernel_name="python3",
            progress_bar=False,
            options={"cwd": str(folder), "env": dict(environment), "stderr": log},
            tell_kernel=tell_kernel,
            tell_cell=tell_cell,
        )
