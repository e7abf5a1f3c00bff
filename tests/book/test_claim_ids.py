"""The ids of claims that have been published stay; verdicts may change, and are compared."""

from __future__ import annotations

import json
import re
from pathlib import Path

import pytest
from conftest import MiniProject, run_command
from hypothesis import given, strategies as st
from inswsn_book.judging import read_verdicts
from inswsn_book.ledger import LEDGER, load_claims
from inswsn_book.project import Project

from inswsn_lib.errors import InswsnError


def test_the_list_of_ids_is_that_of_the_ledger(project: Project) -> None:
    """An id that has been published stays; a new one is added to the list by hand."""
    text = (project.root / "data/claim-ids.txt").read_text(encoding="utf-8")
    listed = [line for line in text.splitlines() if line and not line.startswith("#")]
    assert len(listed) >= 384
    assert sorted(claim.id for claim in load_claims(project.root / LEDGER)) == sorted(listed)


def test_verdicts_are_compared_with_those_of_another_version(
    built: MiniProject, tmp_path: Path
) -> None:
    assert run_command(built.root, "publish").returncode == 0
    before = tmp_path / "verdicts.json"
    before.write_text(run_command(built.root, "claims", "--json").stdout, encoding="utf-8")
    same = run_command(built.root, "claims", "--against", str(before))
    assert (same.returncode, same.stdout) == (0, "")
    entries = json.loads(before.read_text(encoding="utf-8"))
    entries[0]["verdict"] = "not reproduced"
    entries[1]["id"] = "P2-M-gone"
    before.write_text(json.dumps(entries), encoding="utf-8")
    done = run_command(built.root, "claims", "--against", str(before))
    assert done.stdout.splitlines() == [
        "P1-M-twice: not reproduced -> reproduced",
        "P2-M-lost: not there -> cannot be tested",
        "P2-M-gone: cannot be tested -> not there",
    ]


@pytest.mark.parametrize("text", ["", "{}", "[1]", '[{"id": "x"}]', "3", "[" * 100_000])
def test_a_file_without_verdicts_is_one_sentence(tmp_path: Path, text: str) -> None:
    path = tmp_path / "verdicts.json"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(InswsnError, match="holds no verdicts; it may be a file written by"):
        read_verdicts(path)


@given(st.binary(max_size=200))
def test_any_bytes_are_verdicts_or_one_sentence(
    tmp_path_factory: pytest.TempPathFactory, content: bytes
) -> None:
    path = tmp_path_factory.mktemp("any") / "verdicts.json"
    path.write_bytes(content)
    said = ""
    try:
        read_verdicts(path)
    except InswsnError as error:
        said = str(error)
    assert said == "" or re.fullmatch(r".*verdicts\.json holds no verdicts; .+\.", said)
