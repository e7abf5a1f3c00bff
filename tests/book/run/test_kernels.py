"""A notebook in a kernel of its own."""

from __future__ import annotations

import json
import os
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import nbformat
import pytest
from inswsn_book.run import kernels

CELL = nbformat.v4.new_code_cell("import os; print(os.getcwd())\n6 * 7", id="answer")


def execute(folder: Path) -> tuple[Any, list[Any]]:
    """Return the outputs of the one cell, and what was told of it as it started."""
    folder.mkdir(exist_ok=True)
    told: list[Any] = []
    executed = kernels.execute_notebook(
        nbformat.v4.new_notebook(cells=[CELL]), {}, folder,
        os.environ | {"IPYTHONDIR": str(folder), "PYTHONSAFEPATH": "1"},
        tell_cell=lambda *cell: told.append(cell),
    )  # fmt: skip
    return executed.cells[0].outputs, told


def test_kernels_side_by_side_work_in_folders_of_their_own(tmp_path: Path) -> None:
    """They are reached by files there, so that none takes what another one listens on."""
    folders = [tmp_path / str(i) for i in range(3)]
    with ThreadPoolExecutor(3) as pool:
        for folder, ((printed, shown), told) in zip(
            folders, pool.map(execute, folders), strict=True
        ):
            assert printed["text"] == f"{folder}\n"
            assert shown["data"]["text/plain"] == "42"
            assert told == [(1, 1, "answer")]


def test_a_folder_whose_path_is_too_long_for_a_socket_has_a_kernel(tmp_path: Path) -> None:
    folder = tmp_path / ("x" * 120)
    (printed, _), _ = execute(folder)
    assert printed["text"] == f"{folder}\n"


def test_the_kernel_is_this_interpreter_whatever_jupyter_knows(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    kernel = tmp_path / "kernels" / "python3" / "kernel.json"
    kernel.parent.mkdir(parents=True)
    other = {"argv": ["/nowhere", "-c", "0"], "env": {"OTHER": "1"}, "language": "python"}
    kernel.write_text(json.dumps(other | {"display_name": "Another"}))
    monkeypatch.setenv("JUPYTER_PATH", str(tmp_path))
    monkeypatch.setitem(CELL, "source", "import os, sys\nsys.executable, os.environ.get('OTHER')")
    assert execute(tmp_path / "own")[0][-1]["data"]["text/plain"] == repr((sys.executable, None))
