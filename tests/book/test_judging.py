"""The claims judged by results: in a terminal, as JSON, and against those of another version."""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from pathlib import Path

import pytest
from conftest import Done, MiniProject
from hypothesis import given, strategies as st
from inswsn_book.judging import judge_claims, read_verdicts
from inswsn_book.project import Project
from inswsn_book.results import Quantity, Results, write_results

from inswsn_lib.errors import InswsnError

FIELDS = {
    "id",
    "paper",
    "place",
    "kind",
    "published",
    "rebuilt",
    "verdict",
    "reason",
    "chapter",
    "cell",
}


def test_claims_of_a_fresh_clone_need_no_build(
    project: Project, inswsn: Callable[..., Done]
) -> None:
    listed = json.loads(inswsn(project.root, "claims", "--json").stdout)
    assert all(set(entry) == FIELDS for entry in listed)
    (row,) = (entry for entry in listed if entry["id"] == "P1-T1-10-mpos")
    assert row["published"]["value"] == "0.1452"
    assert row["rebuilt"]["value"] == pytest.approx((0.2903 + 0.1063) / 2)
    assert row["verdict"] == "contradicted by the paper itself"
    assert row["chapter"] == "00"
    assert row["cell"].startswith("ch00-")


def test_claims_are_selected_and_counted(project: Project, inswsn: Callable[..., Done]) -> None:
    words = ("--paper", "P1", "--verdict", "contradicted by the paper itself", "--kind", "numeric")
    lines = inswsn(project.root, "claims", *words).stdout.splitlines()
    # seven means of Table 1, three and four percentages
    assert "14 claims, 14 of them in the headline counts:" in lines
    assert lines[-1].split(maxsplit=1) == ["14", "contradicted by the paper itself"]
    listed = json.loads(inswsn(project.root, "claims", *words, "--json").stdout)
    assert len(listed) == 14
    assert all(any(entry["id"] in line for line in lines) for entry in listed)
    assert {(e["paper"], e["kind"], e["verdict"]) for e in listed} == {
        ("P1", "numeric", "contradicted by the paper itself")
    }


def test_results_of_another_folder_go_first(mini: MiniProject, tmp_path: Path) -> None:
    def verdict(folder: Path | None) -> list[str]:
        return [str(entry.verdict) for entry in judge_claims(mini, folder)]

    for folder, value in ((mini.published, 42.0), (tmp_path / "run", 63.0)):
        twice = Quantity(
            name="twice", value=value, unit="m", how="For a test.", basis="printed", tolerance=0
        )
        made = Results(chapter="00", parameters={}, data={}, quantities=(twice,))
        write_results(made, folder / "00.json")
    assert verdict(None) == ["reproduced", "cannot be tested"]
    assert verdict(tmp_path / "run") == ["contradicted by the paper itself", "cannot be tested"]


def test_verdicts_are_compared_with_those_of_another_version(
    project: Project, inswsn: Callable[..., Done], tmp_path: Path
) -> None:
    before = tmp_path / "verdicts.json"
    entries = json.loads(inswsn(project.root, "claims", "--json").stdout)
    before.write_text(json.dumps(entries), encoding="utf-8")
    assert inswsn(project.root, "claims", "--against", str(before)).stdout == ""
    first, second = entries[:2]
    was, name = first["verdict"], second["id"]
    before.write_text(
        json.dumps([first | {"verdict": "guessed"}, second | {"id": "P2-gone"}, *entries[2:]]),
        encoding="utf-8",
    )
    assert inswsn(project.root, "claims", "--against", str(before)).stdout.splitlines() == [
        f"{first['id']}: guessed -> {was}",
        f"{name}: not there -> {second['verdict']}",
        f"P2-gone: {second['verdict']} -> not there",
    ]


@given(
    st.binary(max_size=200)
    | st.sampled_from([b"", b"{}", b"[1]", b'[{"id": "x"}]', b"3", b"[" * 100_000])
)
def test_any_bytes_are_verdicts_or_one_sentence(
    tmp_path_factory: pytest.TempPathFactory, content: bytes
) -> None:
    path = tmp_path_factory.mktemp("any") / "verdicts.json"
    path.write_bytes(content)
    said = ""
    try:
        assert read_verdicts(path) == {}
    except InswsnError as error:
        said = str(error)
    assert said == "" or re.fullmatch(r".*verdicts\.json holds no verdicts; .+\.", said)
