"""The lock: it fits what asks for it, and a stale one is told by name."""

from __future__ import annotations

import re
from collections.abc import Callable
from importlib import metadata
from pathlib import Path

import pytest
from conftest import MiniProject, run_command
from inswsn_book import environment
from inswsn_book.environment import lock_problems
from inswsn_book.project import Project
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name


def test_the_locks_fit(project: Project) -> None:
    assert lock_problems(project) == []


def swap(name: str, old: str, new: str) -> Callable[[Project], None]:
    def change(project: Project) -> None:
        path = project.root / name
        text = path.read_text()
        assert re.search(old, text, re.MULTILINE)
        path.write_text(re.sub(old, new, text, count=1, flags=re.MULTILINE))

    return change


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (
            swap("environment.in", r"\Z", "left-pad>=1\n"),
            "environment.in names left-pad, which environment.lock does not pin.",
        ),
        (
            swap("environment.in", r"^papermill==.*$", ""),
            "environment.lock pins papermill, which environment.in no longer names.",
        ),
        (
            swap("environment.in", r"^sphinx==.*$", "sphinx==8.1.0"),
            "environment.in asks for sphinx==8.1.0; environment.lock pins sphinx 7.4.7.",
        ),
        (
            swap("pyproject.toml", r'"numpy>=[^"]*"', '"numpy>=99"'),
            "pyproject.toml asks for numpy>=99",
        ),
        (
            swap("environment-torch.in", r"^torch==.*$", "torch==9.9.9"),
            "environment-torch.in asks for torch==9.9.9",
        ),
        (
            swap("environment.lock", r"^(click==\S+) \\$\n(    --hash.*\n)+", r"\1\n"),
            "environment.lock pins click without a hash.",
        ),
        (
            swap("environment-torch.lock", r" \\\n    --hash=sha256:6746[0-9a-f]*", ""),
            "environment-torch.lock pins torch without a hash.",
        ),
        (
            swap("environment.lock", r"^attrs==(.*\n)(    --hash.*\n)+(    #.*\n)+", ""),
            "environment.lock has been edited since it was made.",
        ),
    ],
)
def test_a_stale_lock_is_told_by_name(
    mini: MiniProject, change: Callable[[Project], None], said: str
) -> None:
    change(mini)
    assert any(said in problem for problem in lock_problems(mini)), lock_problems(mini)
    done = run_command(mini.root, "lock", "--check")
    assert done.returncode == 2
    assert said in done.stderr
    assert done.stderr.strip().endswith("The lock is stale; compile it with `make lock`.")


@pytest.mark.parametrize(("upgrade", "kept"), [(False, True), (True, False)])
def test_versions_stay_unless_newer_ones_are_asked_for(
    mini: MiniProject, monkeypatch: pytest.MonkeyPatch, upgrade: bool, kept: bool
) -> None:
    """The compiler keeps the versions that stand in the file it is to write."""
    found = []

    def compiler(command: list[str], _: Path) -> None:
        if "environment.in" in command:
            new = Path(command[command.index("-o") + 1])
            found.append(new.is_file() and "numpy==" in new.read_text())
            new.write_text("numpy==9.9\n")

    monkeypatch.setattr(environment, "_run", compiler)
    monkeypatch.setattr(environment, "_torch_lock", lambda _: "torch==9.9\n")
    environment.compile_locks(mini, upgrade=upgrade)
    assert found == [kept]
    assert (mini.root / "environment.lock").read_text().endswith("\nnumpy==9.9\n")


def test_a_missing_lock(mini: MiniProject) -> None:
    (mini.root / "environment-torch.lock").unlink()
    done = run_command(mini.root, "lock", "--check")
    assert done.returncode == 2
    assert "There is no environment-torch.lock" in done.stderr


def test_what_is_installed_is_what_the_lock_pins(project: Project) -> None:
    pins = dict(
        re.findall(
            r"^([a-z0-9.-]+)==([^\s;\\]+) \\$",
            (project.root / "environment.lock").read_text(),
            re.MULTILINE,
        )
    )
    assert len(pins) > 100
    assert {name: metadata.version(name) for name in pins} == pins


def test_torch_finds_what_it_needs_in_the_lock(project: Project) -> None:
    pinned = set(
        re.findall(
            r"^([a-z0-9.-]+)==", (project.root / "environment.lock").read_text(), re.MULTILINE
        )
    )
    needs = [Requirement(text) for text in metadata.requires("torch") or []]
    missing = {
        canonicalize_name(need.name)
        for need in needs
        if (need.marker is None or need.marker.evaluate({"extra": ""}))
        and canonicalize_name(need.name) not in pinned
    }
    assert missing == set()
