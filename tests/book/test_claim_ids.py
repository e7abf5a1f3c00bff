"""The ids of claims that have been published stay; verdicts may change, and are compared."""

from __future__ import annotations

import json
import re
from pathlib import Path

import pytest
from conftest import MiniProject, run_command
from hypothesis import given
from hypothesis import strategies as st
from inswsn_book.judging import read_verdicts
from inswsn_book.project import Project
from inswsn_book.publishing import compare_ids, publish, published_ids

from inswsn_lib.errors import InswsnError


def test_no_published_id_is_missing(project: Project) -> None:
    assert len(published_ids(project)) >= 357
    assert compare_ids(project)[0] == []


def test_publishing_adds_ids_and_keeps_those_that_are_there(built: MiniProject) -> None:
    ids, reference = "data/claim-ids.txt", "data/published/00.json"
    assert compare_ids(built) == ([], ["P1-M-twice", "P2-M-lost"])
    assert publish(built) == [ids, reference]
    assert publish(built) == []
    ledger = built.root / "data" / "claims" / "mini.yaml"
    text = ledger.read_text(encoding="utf-8")
    more = text[text.index("- id: P2-M-lost") :].replace("P2-M-lost", "P2-A-new")
    ledger.write_text(text + more, encoding="utf-8")
    assert publish(built) == [ids]
    assert published_ids(built) == ["P1-M-twice", "P2-A-new", "P2-M-lost"]


def test_a_lost_id_is_shown_and_stops_publishing(built: MiniProject) -> None:
    assert run_command(built.root, "publish").returncode == 0
    kept = (built.root / "data" / "claim-ids.txt").read_bytes()
    ledger = built.root / "data" / "claims" / "mini.yaml"
    text = ledger.read_text(encoding="utf-8")
    ledger.write_text(text.replace("P2-M-lost", "P2-M-other"), encoding="utf-8")
    done = run_command(built.root, "publish", "--check")
    assert "! the claim P2-M-lost has been published, and the ledger has it no more." in done.stdout
    assert "1 claims that have not been published, from P2-M-other on" in done.stdout
    done = run_command(built.root, "publish")
    assert done.returncode == 2
    assert "has no claim P2-M-lost, which has been published" in done.stderr
    assert (built.root / "data" / "claim-ids.txt").read_bytes() == kept


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
