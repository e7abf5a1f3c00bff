"""What is written by hand of citation, third parties and binder, held to what it speaks of."""

from __future__ import annotations

import json
import os
import re
from importlib.resources import files
from pathlib import Path
from typing import Any

import pytest
import yaml
from conftest import MiniProject
from inswsn_book.archive import SITE_PACKAGES
from inswsn_book.project import Project
from jsonschema import Draft7Validator
from pybtex.database import parse_file

from inswsn_lib.errors import InswsnError
from inswsn_lib.recordings import gnss_imu

# the official schema of version 1.2.0, which check-jsonschema brings
SCHEMA = files("check_jsonschema") / "builtin_schemas" / "vendor" / "citation-file-format.json"


@pytest.fixture(scope="module")
def said(root: Path) -> dict[str, Any]:
    return dict(yaml.safe_load((root / "CITATION.cff").read_text(encoding="utf-8")))


def test_the_citation_is_valid_by_its_schema(said: dict[str, Any]) -> None:
    schema = Draft7Validator(json.loads(SCHEMA.read_text(encoding="utf-8")))
    assert list(schema.iter_errors(said)) == []
    assert list(schema.iter_errors(said | {"license": "mine"})) != []


def test_it_cites_the_papers_as_the_bibliography_does(said: dict[str, Any], root: Path) -> None:
    entries = parse_file(str(root / "book" / "references.bib"), "bibtex").entries
    keys = ("xu2012ins", "li2012distributed", "li2015hybrid")
    assert [r["doi"] for r in said["references"]] == [entries[k].fields["doi"] for k in keys]
    assert [str(r["year"]) for r in said["references"]] == [entries[k].fields["year"] for k in keys]


def test_pages_are_told_what_it_says(project: Project, said: dict[str, Any]) -> None:
    about = project.about()
    assert (about["title"], about["version"]) == (said["title"], said["version"])
    assert about["names"] == ["inswsn contributors"]
    assert len(about["references"]) == 3


def test_a_citation_that_lacks_a_field_is_refused(mini: MiniProject) -> None:
    path = mini.root / "CITATION.cff"
    path.write_text(path.read_text().replace("title:", "titel:", 1), encoding="utf-8")
    with pytest.raises(InswsnError, match="lacks 'title'"):
        mini.about()


def test_what_belongs_to_others_is_named(root: Path) -> None:
    text = (root / "THIRD-PARTY.md").read_text(encoding="utf-8")
    for word in (
        "10.1155/2012/707326",
        "10.3969/j.issn.1003-7985.2012.02.006",
        "10.1155/2015/176947",
    ):
        assert word in text
    for digest in gnss_imu.DRIVE.digests.values():
        assert digest in text
    for package in SITE_PACKAGES:
        assert package in text or package == "packaging"


def test_binder_makes_the_environment_of_the_lock(root: Path) -> None:
    script = root / "binder" / "postBuild"
    assert os.access(script, os.X_OK)
    assert "make environment" in script.read_text(encoding="utf-8")
    version = re.fullmatch(r"python-(\d\.\d+)\n", (root / "binder" / "runtime.txt").read_text())
    assert version is not None
    assert f"--python-version {version[1]}" in (root / "Makefile").read_text(encoding="utf-8")
