"""A kernel that does not start."""

from __future__ import annotations

import json
import socket
from pathlib import Path
from typing import Any

import nbformat
import pytest
from inswsn_book import worker
from jupyter_client.provisioning.local_provisioner import LocalPortCache


@pytest.mark.parametrize(("times", "status"), [(1, 0), (2, 1)])
def test_a_kernel_whose_port_was_taken_is_started_once_more(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    times: int,
    status: int,
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
        cell = nbformat.v4.new_code_cell("6 * 7", id="answer")
        nbformat.write(nbformat.v4.new_notebook(cells=[cell]), tmp_path / "in.ipynb")
        got = worker.run(tmp_path / "in.ipynb", tmp_path / "out.ipynb", {}, tmp_path)
    assert got == status
    assert len(chosen) == 10  # five ports a kernel, two kernels
    events = [json.loads(line) for line in capsys.readouterr().out.splitlines()]
    if status:
        assert events == [{"failed": "RuntimeError: Kernel died before replying to kernel_info"}]
    else:
        assert [list(event) for event in events] == [["cell", "of", "id"], ["done", "machine"]]
        (answer,) = nbformat.read(tmp_path / "out.ipynb", 4).cells[0].outputs
        assert answer["data"]["text/plain"] == "42"


def test_a_kernel_that_does_not_answer_is_started_once_more(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Each sleeps for three seconds; the first is given one, the second the usual time, or one."""
    startup = tmp_path / "profile_default" / "startup"
    startup.mkdir(parents=True)
    (startup / "slow.py").write_text("import time\ntime.sleep(3)\n")
    monkeypatch.setenv("IPYTHONDIR", str(tmp_path))
    execute, usual = worker._execute, worker._START_TIMEOUT
    cell = nbformat.v4.new_code_cell("6 * 7", id="answer")
    nbformat.write(nbformat.v4.new_notebook(cells=[cell]), tmp_path / "in.ipynb")
    for then, status in ((usual, 0), (1, 1)):
        times = [1, then]

        def started(*job: Any, times: list[int] = times) -> None:
            monkeypatch.setattr(worker, "_START_TIMEOUT", times.pop(0))
            execute(*job)

        monkeypatch.setattr(worker, "_execute", started)
        got = worker.run(tmp_path / "in.ipynb", tmp_path / "out.ipynb", {}, tmp_path)
        assert (got, times) == (status, [])
        last = json.loads(capsys.readouterr().out.splitlines()[-1])
        told = "RuntimeError: Kernel didn't respond in 1 seconds"
        assert last == {"failed": told} if status else last["done"]
