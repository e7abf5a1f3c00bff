"""A release: the tag, the notes, the files, and the scripts that speak to the public host."""

from __future__ import annotations

import os
import re
import subprocess
from hashlib import sha256
from pathlib import Path

import nbformat
import pytest
from conftest import MiniProject, run_command
from inswsn_book.about import load_about
from inswsn_book.release import release_notes

CHANGELOG = "# Changelog\n\n## {version} (today)\n\n- This is new.\n\n## 0.0.1\n\n- This is old.\n"


@pytest.fixture
def versioned(mini: MiniProject) -> MiniProject:
    """The small project as version 4.5.6, with a changelog."""
    path = mini.root / "pyproject.toml"
    path.write_text(re.sub(r'^version = ".*"$', 'version = "4.5.6"', path.read_text(), flags=re.M))
    (mini.root / "CHANGELOG.md").write_text(CHANGELOG.format(version="4.5.6"))
    return mini


def test_the_tag_of_this_version(versioned: MiniProject) -> None:
    assert run_command(versioned.root, "tag", "v4.5.6").returncode == 0


@pytest.mark.parametrize("tag", ["4.5.6", "v4.5.7", "v4.5.6-rc1", "", "v4.5.6; touch owned"])
def test_another_tag(versioned: MiniProject, tag: str) -> None:
    done = run_command(versioned.root, "tag", tag)
    assert done.returncode == 2
    assert f"TAG is {tag!r}" in done.stderr
    assert "v4.5.6" in done.stderr


@pytest.mark.parametrize("version", ["4.5", "4.5.60", "unreleased"])
def test_a_version_without_notes(versioned: MiniProject, version: str) -> None:
    (versioned.root / "CHANGELOG.md").write_text(CHANGELOG.format(version=version))
    done = run_command(versioned.root, "tag", "v4.5.6")
    assert done.returncode == 2
    assert "CHANGELOG.md has no section on 4.5.6" in done.stderr


def test_the_notes_are_those_of_the_version(versioned: MiniProject) -> None:
    assert release_notes(versioned) == "- This is new.\n"


def test_nothing_is_gathered_before_it_is_made(versioned: MiniProject) -> None:
    done = run_command(versioned.root, "assets")
    assert done.returncode == 2
    assert "make archive" in done.stderr
    versioned.build.mkdir(exist_ok=True)
    (versioned.build / "inswsn-4.5.6.zip").write_bytes(b"zip")
    done = run_command(versioned.root, "assets")
    assert done.returncode == 2
    assert "Chapter 00 has not been built as it is now" in done.stderr
    assert not (versioned.build / "release").exists()


def test_what_is_gathered(built: MiniProject) -> None:
    version = load_about(built.root).version
    (built.root / "CHANGELOG.md").write_text(CHANGELOG.format(version=version))
    (built.build / f"inswsn-{version}.zip").write_bytes(b"the archive")
    old = built.build / "release" / "assets" / "left-over.txt"
    old.parent.mkdir(parents=True)
    old.write_text("of another version")
    done = run_command(built.root, "assets")
    assert done.returncode == 0, done.stderr
    folder = built.build / "release"
    names = {path.name for path in (folder / "assets").iterdir()}
    assert names == {f"inswsn-{version}.zip", "00-mini.ipynb", "SHA256SUMS"}
    sums = dict(
        reversed(line.split("  "))
        for line in (folder / "assets" / "SHA256SUMS").read_text().splitlines()
    )
    assert sums == {
        name: sha256((folder / "assets" / name).read_bytes()).hexdigest()
        for name in names - {"SHA256SUMS"}
    }
    notebook = nbformat.read(folder / "assets" / "00-mini.ipynb", as_version=4)
    assert any(cell.get("outputs") for cell in notebook.cells)
    assert "## Provenance" in notebook.cells[-1].source
    assert (folder / "NOTES.md").read_text() == "- This is new.\n"


@pytest.fixture
def host(root: Path, tmp_path: Path) -> Path:
    """A folder with the scripts, and a gh that writes down how it was called.

    It fails where the file ``fails-NAME`` exists, for the word of its call that NAME is, and it
    answers what is in the file ``answers``.
    """
    (tmp_path / ".ci").mkdir()
    for name in ("release", "report"):
        (tmp_path / ".ci" / name).write_text((root / ".ci" / name).read_text())
    (tmp_path / "bin").mkdir()
    gh = tmp_path / "bin" / "gh"
    gh.write_text(
        f'#!/bin/sh\necho "$*" >> "{tmp_path}/called"\n'
        f'[ -e "{tmp_path}/fails-$2" ] && exit 1\n'
        f'[ "$2" = list ] && cat "{tmp_path}/answers"\nexit 0\n'
    )
    gh.chmod(0o755)
    (tmp_path / "answers").write_text("")
    return tmp_path


def call(host: Path, name: str, **variables: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        ["bash", str(host / ".ci" / name)],
        env=os.environ | {"PATH": f"{host / 'bin'}:{os.environ['PATH']}"} | variables,
        capture_output=True,
        text=True,
        check=False,
        cwd=host,
    )


def test_a_release_is_made_with_its_files(host: Path) -> None:
    assets = host / "_build/release/assets"
    assets.mkdir(parents=True)
    (host / "_build/release/NOTES.md").write_text("notes")
    for name in ("a.zip", "b.ipynb"):
        (assets / name).write_text("")
    (host / "fails-view").touch()  # there is none yet
    done = call(host, "release", TAG="v1.0.0")
    assert done.returncode == 0, done.stderr
    assert (host / "called").read_text().splitlines()[1] == (
        "release create v1.0.0 --verify-tag --title inswsn v1.0.0 "
        "--notes-file _build/release/NOTES.md "
        "_build/release/assets/a.zip _build/release/assets/b.ipynb"
    )


def test_a_release_that_is_there_gets_its_files_again(host: Path) -> None:
    (host / "_build/release/assets").mkdir(parents=True)
    (host / "_build/release/assets/a.zip").write_text("")
    (host / "_build/release/NOTES.md").write_text("notes")
    assert call(host, "release", TAG="v1.0.0").returncode == 0
    assert (host / "called").read_text().splitlines()[1] == (
        "release upload v1.0.0 --clobber _build/release/assets/a.zip"
    )


def test_a_release_of_nothing(host: Path) -> None:
    done = call(host, "release", TAG="v1.0.0")
    assert done.returncode == 2
    assert "make assets" in done.stderr
    assert not (host / "called").exists()
    assert "make release TAG=" in call(host, "release", TAG="").stderr


RESULTS = {"LOCKED": "success", "NEWEST": "failure", "RUN_URL": "https://host.example/run/7"}


def test_a_failed_week_opens_an_issue(host: Path) -> None:
    assert call(host, "report", **RESULTS).returncode == 0
    last = (host / "called").read_text().splitlines()[-1]
    assert last.startswith("issue create --title The weekly build fails --body ")
    assert "locks: success" in last
    assert "allows: failure" in last
    assert "https://host.example/run/7" in last


def test_the_next_failed_week_comments_on_it(host: Path) -> None:
    (host / "answers").write_text("12\n")
    assert call(host, "report", **RESULTS).returncode == 0
    assert (host / "called").read_text().splitlines()[-1].startswith("issue comment 12 --body ")


def test_a_report_that_cannot_be_made_fails(host: Path) -> None:
    (host / "fails-create").touch()
    assert call(host, "report", **RESULTS).returncode != 0
    assert call(host, "report", LOCKED="success", RUN_URL="x", NEWEST="").returncode != 0
