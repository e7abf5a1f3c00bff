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
from inswsn_book.run import fork_server, kernels
from inswsn_book.run.fork_server import Forker

linux = pytest.mark.skipif(sys.platform != "linux", reason="Elsewhere none is forked.")
CELL = nbformat.v4.new_code_cell("import os; print(os.getcwd())\n6 * 7", id="answer")


def execute(folder: Path, *, forked: bool = False) -> tuple[Any, list[Any]]:
    """Return the outputs of the one cell, and what was told of it as it started."""
    folder.mkdir(exist_ok=True)
    told: list[Any] = []
    executed = kernels.execute_notebook(
        nbformat.v4.new_notebook(cells=[CELL]), {}, folder,
        os.environ | {"IPYTHONDIR": str(folder), "PYTHONSAFEPATH": "1"}, forked,
        tell_cell=lambda *cell: told.append(cell),
    )  # fmt: skip
    return executed.cells[0].outputs, told


def value(folder: Path, *, forked: bool = False) -> str:
    """Return the value of the last line of the cell."""
    return str(execute(folder, forked=forked)[0][-1]["data"]["text/plain"])


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
    assert value(tmp_path / "own") == repr((sys.executable, None))


# Forked kernels -----------------------------------------------------------------------------------

SEEN = """
import os, signal, sys, matplotlib
sorted(os.environ), os.getcwd(), os.environ["IPYTHONDIR"], sys.executable, sys.path, sys.flags, \\
    sys.argv, matplotlib.get_backend(), os.getsid(0) == os.getpid(), sys.stdin.fileno(), \\
    [signal.getsignal(n) for n in (signal.SIGCHLD, signal.SIGINT, signal.SIGTERM)], \\
    [n for n in sys.modules if n.startswith("inswsn")], __name__, sys.modules["__main__"]
"""


@linux
def test_a_forked_kernel_sees_what_one_that_is_started_sees(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(kernels, "_FORKER", Forker())  # of the surroundings of this test
    monkeypatch.setitem(CELL, "source", SEEN)
    seen = [value(tmp_path, forked=forked) for forked in (False, True)]
    assert kernels._FORKER._running  # it has not started a kernel in place of a fork
    assert seen[0] == seen[1]


@linux
def test_forked_kernels_draw_for_themselves(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    chances = "import numpy, random, uuid; numpy.random.random(), random.random(), uuid.uuid4()"
    monkeypatch.setitem(CELL, "source", chances)
    first, second = (value(tmp_path, forked=True) for _ in range(2))
    assert not {*first.strip("()").split(", ")} & {*second.strip("()").split(", ")}


@linux
def test_what_a_forked_kernel_says_on_standard_error_is_its_own(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for word in ("one", "two"):
        monkeypatch.setitem(CELL, "source", f"import os; os.write(2, b'{word}')")
        execute(tmp_path / word, forked=True)
    logs = [(tmp_path / word / "kernel.log").read_text() for word in ("one", "two")]
    assert "one" in logs[0]
    assert "one" not in logs[1]
    assert "two" in logs[1]


@linux
def test_where_none_is_forked_one_is_started(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    forker = Forker()
    monkeypatch.setattr(kernels, "_FORKER", forker)
    monkeypatch.setattr(fork_server, "__file__", str(tmp_path / "nothing.py"))
    assert value(tmp_path / "none", forked=True) == "42"
    monkeypatch.undo()
    monkeypatch.setattr(kernels, "_FORKER", forker)
    for _ in range(2):  # the end of the first is noticed, and another one had
        assert value(tmp_path / "then", forked=True) == "42"
    process, _ = forker._running or pytest.fail("There is none.")
    process.kill()
    process.wait()
    assert value(tmp_path / "dead", forked=True) == "42"
