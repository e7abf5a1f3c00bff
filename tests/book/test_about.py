"""What the work is called and whose it is: CITATION.cff, or one sentence."""

from __future__ import annotations

import tomllib
from datetime import date
from pathlib import Path

import pytest
import yaml
from conftest import MiniProject, run_command
from inswsn_book.project import Project


def test_the_kept_file_is_read(project: Project) -> None:
    about = project.about()
    said = tomllib.loads((project.root / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    assert about["version"] == said["version"]
    assert about["license"] == said["license"]
    assert date.fromisoformat(about["date-released"])
    assert about["names"]


def test_nothing_else_names_the_authors_or_the_title(root: Path) -> None:
    """One setting to change: no other file that is written by hand has a copy of it."""
    about = Project(root).about()
    said = tomllib.loads((root / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    assert "authors" not in said
    config = (root / "_config.yml").read_text(encoding="utf-8")
    assert about["title"] not in config
    assert "; ".join(about["names"]) not in config


@pytest.mark.parametrize("field", ["title", "version", "authors", "date-released"])
def test_a_file_that_lacks_a_field_is_one_sentence(mini: MiniProject, field: str) -> None:
    path = mini.root / "CITATION.cff"
    said = yaml.safe_load(path.read_text(encoding="utf-8"))
    del said[field]
    path.write_text(yaml.safe_dump(said), encoding="utf-8")
    done = run_command(mini.root, "book")
    assert done.returncode == 2
    (sentence,) = (line for line in done.stderr.splitlines() if line.startswith("inswsn: "))
    assert f"CITATION.cff is no citation file: it lacks '{field}'." in sentence
