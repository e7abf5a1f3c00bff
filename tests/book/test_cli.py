"""The command line: help, and refusals in one sentence."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest
from conftest import MiniProject, run_command

import inswsn_lib


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
    for command in ("book", "chapters", "run", "compare", "sweep", "claims", "publish"):
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
