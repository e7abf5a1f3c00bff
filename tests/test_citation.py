"""What is written by hand of citation and third parties, held to what it speaks of."""

from __future__ import annotations

import json
from importlib.resources import files
from pathlib import Path

import yaml
from inswsn_book.archive import SITE_PACKAGES
from jsonschema import Draft7Validator
from pybtex.database import parse_file

from inswsn_lib.logs.registry import KNOWN

# the official schema of version 1.2.0, which check-jsonschema brings
SCHEMA = files("check_jsonschema") / "builtin_schemas" / "vendor" / "citation-file-format.json"


def test_the_citation_is_valid_and_cites_the_papers_as_the_bibliography_does(root: Path) -> None:
    said = yaml.safe_load((root / "CITATION.cff").read_text(encoding="utf-8"))
    schema = Draft7Validator(json.loads(SCHEMA.read_text(encoding="utf-8")))
    assert list(schema.iter_errors(said)) == []
    assert list(schema.iter_errors(said | {"license": "mine"})) != []
    entries = parse_file(str(root / "book" / "references.bib"), "bibtex").entries
    papers = [entries[k].fields for k in ("xu2012ins", "li2012distributed", "li2015hybrid")]
    assert [(r["doi"], str(r["year"])) for r in said["references"]] == [
        (paper["doi"], paper["year"]) for paper in papers
    ]


def test_what_belongs_to_others_is_named(root: Path) -> None:
    text = (root / "THIRD-PARTY.md").read_text(encoding="utf-8")
    said = yaml.safe_load((root / "CITATION.cff").read_text(encoding="utf-8"))
    for word in (
        *(paper["doi"] for paper in said["references"]),
        *(digest for known in KNOWN.values() for digest in known.digests.values()),
        *(package for package in SITE_PACKAGES if package != "packaging"),
    ):
        assert word in text, word
