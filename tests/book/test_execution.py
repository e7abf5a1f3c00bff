"""A kernel that does not start."""

from __future__ import annotations

import os
import socket
import sys
from pathlib import Path
from typing import Any

import nbformat
import pytest
from inswsn_book import execution
from jupyter_client.provisioning.local_provisioner import LocalPortCache

NOTEBOOK = nbformat.v4.new_notebook(cells=[nbformat.v4.new_code_cell("6 * 7", id="answer")])


def execute(folder: Path, told: list[Any] | None = None) -> str:
    """Return what the one cell shows."""
    environment = os.environ | {"IPYTHONDIR": str(folder)}
    cells = [] if told is None else told
    executed = execution.execute_notebook(
        NOTEBOOK, {}, folder, sys.executable, environment,
        tell_cell=lambda *cell: cells.append(cell),
    )  # fmt: skip
    return str(executed.cells[0].outputs[0]["data"]["text/plain"])


@pytest.mark.parametrize("times", [1, 2])
def test_a_kernel_whose_port_was_taken_is_started_once_more(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, times: int
) -> None:
    chosen: list[int] = []
    free = LocalPortCache.find_available_port
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()

        def choose(ports: LocalPortCache, ip: str) -> int:
            chosen.append(taken.getsockname()[1] if len(chosen) < 5 * times else free(ports, ip))
            return chosen[-1]

        monkeypatch.setattr(LocalPortCache, "find_available_port", choose)
        told: list[Any] = []
        if times == 1:
            assert execute(tmp_path, told) == "42"
            assert told == [(1, 1, "answer")]
        else:
            with pytest.raises(RuntimeError, match="Kernel died before replying to kernel_info"):
                execute(tmp_path, told)
    assert len(chosen) == 10  # five ports a kernel, two kernels


def test_a_kernel_that_does_not_answer_is_started_once_more(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The first sleeps for three seconds and is given one; the second starts at once."""
    startup = tmp_path / "profile_default" / "startup"
    startup.mkdir(parents=True)
    (startup / "slow.py").write_text(
        "import os, time\nif not os.path.exists('been'):\n    open('been', 'w').close()\n"
        "    time.sleep(5)\n"
    )
    monkeypatch.setattr(execution, "_START_TIMEOUT", 3)
    assert execute(tmp_path) == "42"
    assert (tmp_path / "been").exists()
