"""The command line: help, refusals in one sentence, and the server."""

from __future__ import annotations

import socket
import subprocess
import sys
import threading
import urllib.request
from pathlib import Path

import pytest
from conftest import MiniProject, run_command
from inswsn_book.serving import address, make_server

import inswsn_lib
from inswsn_lib.errors import InswsnError


def run(*words: str, cwd: Path) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, "-m", "inswsn_book", *words],
        cwd=cwd,
        capture_output=True,
        text=True,
        check=False,
    )


def test_help_and_version_need_no_checkout(tmp_path: Path) -> None:
    done = run("--help", cwd=tmp_path)
    assert done.returncode == 0
    for command in ("book", "lock", "notebooks", "publish", "serve"):
        assert command in done.stdout
    assert inswsn_lib.__version__ in run("--version", cwd=tmp_path).stdout
    assert run("book", "--help", cwd=tmp_path).returncode == 0


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["book"], "is not in a checkout of inswsn"),
        (["--root", "nowhere", "book"], "--root is 'nowhere'"),
        (["boook"], "No such command 'boook'"),
    ],
)
def test_a_mistake_is_one_sentence_and_status_2(
    tmp_path: Path, words: list[str], said: str
) -> None:
    done = run(*words, cwd=tmp_path)
    assert done.returncode == 2
    assert said in done.stderr
    assert "Traceback" not in done.stderr
    assert done.stdout == ""


def test_a_bad_option_is_refused_before_anything_runs(mini: MiniProject) -> None:
    done = run_command(mini.root, "book", "--jobs", "0")
    assert done.returncode == 2
    assert "--jobs" in done.stderr
    assert not mini.build.exists()


def test_notebooks_check(mini: MiniProject) -> None:
    done = run_command(mini.root, "notebooks", "--check")
    assert done.returncode == 2
    assert "chapters/00-mini.ipynb differs from its source." in done.stderr
    assert run_command(mini.root, "notebooks").stdout == "wrote chapters/00-mini.ipynb\n"
    assert run_command(mini.root, "notebooks", "--check").returncode == 0
    (mini.root / "chapters" / "01-gone.ipynb").write_text("{}")
    (mini.root / "chapters" / ".#00-mini.md").write_text("an editor's file")
    done = run_command(mini.root, "notebooks", "--check")
    assert done.returncode == 2
    assert "chapters/01-gone.ipynb has no source." in done.stderr
    # a twin that cannot be read is written anew
    (mini.root / "chapters" / "00-mini.ipynb").write_bytes(b"\xff")
    assert run_command(mini.root, "notebooks").stdout == "wrote chapters/00-mini.ipynb\n"


def test_serve_shows_the_site(tmp_path: Path) -> None:
    (tmp_path / "index.html").write_text("the book")
    with make_server(tmp_path, port=0) as server:
        threading.Thread(target=server.serve_forever, daemon=True).start()
        with urllib.request.urlopen(address(server), timeout=10) as page:
            assert page.read() == b"the book"
        server.shutdown()


def test_serve_refuses_without_a_book_or_a_port(mini: MiniProject, tmp_path: Path) -> None:
    done = run_command(mini.root, "serve", "--no-browser")
    assert done.returncode == 2
    assert "There is no built book" in done.stderr
    (tmp_path / "index.html").write_text("the book")
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        port = taken.getsockname()[1]
        with pytest.raises(InswsnError, match=f"Port {port} cannot be used"):
            make_server(tmp_path, port)
