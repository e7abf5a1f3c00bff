"""The archive of a release: whole, the same each time, described, only what is ours."""

from __future__ import annotations

import hashlib
import json
import os
import shutil
import subprocess
import sys
import zipfile
from pathlib import Path

import pytest
from conftest import MiniProject, build_once, run_command, shared_folder
from filelock import FileLock
from rocrate.rocrate import ROCrate

IGNORED = "/_build/\n/results/\n/runs/\n*.egg-info/\n"


def git(root: Path, *words: str) -> None:
    who = ["-c", "user.name=a", "-c", "user.email=a@b.example", "-c", "commit.gpgsign=false"]
    subprocess.run(["git", "-C", str(root), *who, *words], check=True, capture_output=True)


def archive(root: Path, *words: str) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", "inswsn_book.archive", *words]
    return subprocess.run(command, cwd=root, capture_output=True, text=True, check=False)


@pytest.fixture(scope="session")
def released_mini(built_mini: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The small project as it is before `make archive`: published, committed, built."""
    if shutil.which("git") is None:
        pytest.skip("There is no git here, and an archive is made of what git keeps.")
    folder = shared_folder(tmp_path_factory) / "released-mini"
    with FileLock(folder.with_suffix(".made")):
        if not folder.exists():
            shutil.copytree(built_mini, folder)
            (folder / ".gitignore").write_text(IGNORED, encoding="utf-8")
            assert run_command(folder, "publish").returncode == 0
            git(folder, "init", "-q")
            git(folder, "add", "-A")
            git(folder, "commit", "-q", "-m", "all of it")
    build_once(folder, folder.with_suffix(".json"))
    return folder


@pytest.fixture
def released(released_mini: Path, tmp_path: Path) -> MiniProject:
    """A copy of it that a test may break."""
    shutil.copytree(released_mini, tmp_path / "mini", symlinks=True)
    return MiniProject(tmp_path / "mini")


@pytest.fixture(scope="session")
def archived(released_mini: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Its archive."""
    target = shared_folder(tmp_path_factory) / "released-mini.zip"
    with FileLock(target.with_suffix(".lock")):
        if not target.exists():
            done = archive(released_mini, "--output", str(target))
            assert done.returncode == 0, done.stderr
    return target


def test_two_archives_of_one_build_are_the_same(released: MiniProject, archived: Path) -> None:
    """From another folder, with other times."""
    for path in released.root.rglob("*"):
        os.utime(path, (1_000_000_000, 1_000_000_000))
    git(released.root, "status")
    done = archive(released.root)
    assert done.returncode == 0, done.stderr
    again = released.build / f"inswsn-{released.about()['version']}.zip"
    assert again.read_bytes() == archived.read_bytes()


def test_every_file_has_its_digest(archived: Path) -> None:
    with zipfile.ZipFile(archived) as opened:
        content = {name: opened.read(name) for name in opened.namelist()}
    sums = dict(line.split("  ")[::-1] for line in content["SHA256SUMS"].decode().splitlines())
    assert sums.keys() == content.keys() - {"SHA256SUMS"}
    assert all(hashlib.sha256(content[name]).hexdigest() == digest for name, digest in sums.items())
    assert {"index.html", "site/index.html", "results/00.json", "verdicts.json"} <= sums.keys()
    assert any(name.startswith("licences/sphinx/") for name in sums)


def test_the_description_names_each_run(archived: Path, tmp_path: Path) -> None:
    with zipfile.ZipFile(archived) as opened:
        opened.extractall(tmp_path)
    crate = ROCrate(tmp_path)
    run = crate.get("#run-00")
    assert {entity["@id"] for entity in run["result"]} == {
        "executed/00-mini.ipynb",
        "results/00.json",
    }
    assert {"data/papers/number.txt", "environment.lock"} <= {e["@id"] for e in run["object"]}
    described = json.loads((tmp_path / "ro-crate-metadata.json").read_text(encoding="utf-8"))
    ids = [entity["@id"] for entity in described["@graph"]]
    assert len(ids) == len(set(ids))


def test_what_may_not_be_archived_is_refused(released: MiniProject) -> None:
    page = released.root / "book" / "index.md"
    page.write_text("# Mini\n\nAnother page.\n", encoding="utf-8")
    done = archive(released.root)
    assert (done.returncode, done.stdout) == (2, "")
    assert "changes that are not committed" in done.stderr
    git(released.root, "commit", "-q", "-a", "-m", "another page")
    done = archive(released.root)
    assert done.returncode == 2
    assert "is not up to date; build it: make book." in done.stderr
