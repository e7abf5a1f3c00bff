"""The archive of a release: whole, the same each time, described, only what is ours."""

from __future__ import annotations

import json
import os
import shutil
import zipfile
from hashlib import sha256
from pathlib import Path

import pytest
from conftest import Command, MiniProject, git
from inswsn_book.make.archive import main, write_archive
from inswsn_book.record.project import Project
from rocrate.rocrate import ROCrate


@pytest.fixture
def released(released_mini: Path, tmp_path: Path) -> MiniProject:
    """A copy of the release, at another place and with other times."""
    shutil.copytree(released_mini, tmp_path / "mini", symlinks=True)
    for path in (tmp_path / "mini").rglob("*"):
        os.utime(path, (1_000_000_000, 1_000_000_000))
    git(tmp_path / "mini", "status")
    return MiniProject(tmp_path / "mini")


@pytest.fixture(scope="module")
def archived(released_mini: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_archive(Project(released_mini), tmp_path_factory.mktemp("archive") / "mini.zip")


def test_two_archives_of_a_build_agree(
    released: MiniProject, archived: Path, inswsn: Command
) -> None:
    done = inswsn(released.root, command=main)
    assert done.returncode == 0, done.stderr
    again = released.build / f"inswsn-{released.about()['version']}.zip"
    assert again.read_bytes() == archived.read_bytes()
    assert f"wrote {again}" in done.stdout


def test_every_file_has_its_digest_and_every_run_its_description(
    archived: Path, released_mini: Path, tmp_path: Path
) -> None:
    with zipfile.ZipFile(archived) as opened:
        content = {name: opened.read(name) for name in opened.namelist()}
        opened.extractall(tmp_path)
    sums = dict(line.split("  ")[::-1] for line in content["SHA256SUMS"].decode().splitlines())
    assert sums == {n: sha256(c).hexdigest() for n, c in content.items() if n != "SHA256SUMS"}
    made = {"index.html", "site/index.html", "results/00.json", "verdicts.json"}
    assert made | {*git(released_mini, "ls-files").splitlines()} < sums.keys()
    assert any(name.startswith("licences/sphinx/") for name in sums)
    run = ROCrate(tmp_path).get("#run-00")
    assert {e["@id"] for e in run["result"]} == {"executed/00-mini.ipynb", "results/00.json"}
    assert {"data/papers/number.txt", "environment.lock"} <= {e["@id"] for e in run["object"]}
    described = json.loads(content["ro-crate-metadata.json"])["@graph"]
    assert len({entity["@id"] for entity in described}) == len(described)


def test_what_may_not_be_archived_is_refused(released: MiniProject, inswsn: Command) -> None:
    done = inswsn(released.root, "--output", "mini.tar", command=main)
    assert "--output must be a file that ends in .zip, not 'mini.tar'." in done.stderr
    released.page("A third page.")
    done = inswsn(released.root, command=main)
    assert (done.returncode, done.stdout) == (2, "")
    assert "changes that are not committed" in done.stderr
    git(released.root, "commit", "-q", "-a", "-m", "a third page")
    done = inswsn(released.root, command=main)
    assert (done.returncode, done.stdout) == (2, "")
    assert "is not up to date, since its sources have changed: make book." in done.stderr
