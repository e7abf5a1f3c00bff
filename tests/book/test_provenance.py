"""Provenance: what is told of the checkout and the machine."""

from __future__ import annotations

import platform
from importlib.metadata import version

import pytest
from conftest import MiniProject, git
from inswsn_book.provenance import machine_facts, repository_state
from inswsn_book.site import footer


def test_the_state_of_a_checkout(mini: MiniProject, monkeypatch: pytest.MonkeyPatch) -> None:
    root = mini.root
    assert repository_state(root) == (None, None)
    git(root, "init", "-q")
    assert repository_state(root) == (None, None)  # no commit yet
    assert "from files that are not a git checkout, env" in footer(mini)
    git(root, "add", ".")
    git(root, "commit", "-qm", "first")
    head = git(root, "rev-parse", "HEAD")
    assert repository_state(root) == (head, True)
    assert f"from commit {head[:12]}, environment.lock" in footer(mini)
    mini.number.write_text("1")
    assert repository_state(root) == (head, False)
    assert f"commit {head[:12]} with changes that were not committed, env" in footer(mini)
    # a copy that lies inside another repository has no commit of its own
    assert repository_state(root / "data") == (None, None)
    monkeypatch.setenv("PATH", "")  # no git at all
    assert repository_state(root) == (None, None)


def test_what_is_told_of_the_machine() -> None:
    facts = machine_facts()
    assert facts["python"] == platform.python_version()
    assert facts["packages"]["numpy"] == version("numpy")
    assert "scikit-image" not in facts["packages"]
    assert facts["cores"] >= 1
    assert facts["cpu"].strip()
    # numpy and scipy have a linear algebra each, with the one thread of these tests
    assert len(facts["blas"]) >= 1
    assert all(library.endswith(", 1 thread") for library in facts["blas"])
