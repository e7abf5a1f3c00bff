"""Provenance: what is told of the checkout and the machine, and where it is shown."""

from __future__ import annotations

import os
import platform
import subprocess
from importlib.metadata import version
from pathlib import Path

import pytest
from inswsn_book.pages import footer
from inswsn_book.project import Project
from inswsn_book.provenance import machine_facts, repository_state


def git(folder: Path, *words: str) -> str:
    names = {
        f"GIT_{who}_{what}": "a@b" for who in ("AUTHOR", "COMMITTER") for what in ("NAME", "EMAIL")
    }
    done = subprocess.run(
        ["git", "-C", str(folder), *words],
        check=True, capture_output=True, text=True, env=os.environ | names,
    )  # fmt: skip
    return done.stdout.strip()


def test_the_state_of_a_checkout(mini: Project) -> None:
    root = mini.root
    assert repository_state(root) == (None, None)
    git(root, "init", "-q")
    assert repository_state(root) == (None, None)  # no commit yet
    git(root, "add", ".")
    git(root, "commit", "-qm", "first")
    head = git(root, "rev-parse", "HEAD")
    assert repository_state(root) == (head, True)
    assert f"commit {head[:12]}, environment.lock" in footer(mini)
    (root / "data" / "papers" / "number.txt").write_text("1")
    assert repository_state(root) == (head, False)
    assert "with changes that were not committed" in footer(mini)
    # a copy that lies inside another repository has no commit of its own
    assert repository_state(root / "data") == (None, None)


def test_no_git_at_all(mini: Project, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PATH", "")
    assert repository_state(mini.root) == (None, None)
    assert "files that are not a git checkout" in footer(mini)


def test_what_is_told_of_the_machine() -> None:
    facts = machine_facts()
    assert facts["python"] == platform.python_version()
    assert facts["packages"]["numpy"] == version("numpy")
    assert "scikit-image" not in facts["packages"]
    assert facts["cores"] >= 1
    assert facts["cpu"].strip()
    assert all("thread" in library for library in facts["blas"])
