"""The claims in a terminal, as JSON, and on their page."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from conftest import MINI_LEDGER, MiniProject, run_command
from inswsn_book.judging import judge_claims
from inswsn_book.project import Project


def test_claims_of_a_fresh_clone_need_no_build(project: Project) -> None:
    done = run_command(project.root, "claims", "--json")
    assert done.returncode == 0, done.stderr
    listed = json.loads(done.stdout)
    judged = judge_claims(project)
    assert [entry["id"] for entry in listed] == [entry.claim.id for entry in judged]
    fields = {"id", "paper", "place", "kind", "published", "rebuilt", "verdict", "chapter", "cell"}
    assert all(fields <= set(entry) for entry in listed)
    row = next(entry for entry in listed if entry["id"] == "P1-T1-10-mpos")
    assert row["published"]["value"] == "0.1452"
    assert row["rebuilt"]["value"] == pytest.approx((0.2903 + 0.1063) / 2)
    assert row["verdict"] == "contradicted by the paper itself"
    assert row["chapter"] == "00"
    assert row["cell"].startswith("ch00-")


def test_claims_are_selected_and_counted(project: Project) -> None:
    words = ("--paper", "P1", "--verdict", "contradicted by the paper itself", "--kind", "numeric")
    done = run_command(project.root, "claims", *words)
    lines = done.stdout.splitlines()
    selected = judge_claims(project, paper="P1", kind="numeric",
                            verdict="contradicted by the paper itself")  # fmt: skip
    assert len(selected) == 14  # seven means of Table 1, three and four percentages
    assert f"{len(selected)} claims, {len(selected)} of them in the headline counts:" in lines
    assert lines[-1].split(maxsplit=1) == ["14", "contradicted by the paper itself"]
    assert all(any(entry.claim.id in line for line in lines) for entry in selected)
    done = run_command(project.root, "claims", *words, "--json")
    assert [entry["id"] for entry in json.loads(done.stdout)] == [e.claim.id for e in selected]


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["--verdict", "maybe"], "--verdict is 'maybe'; it may be one of reproduced, "),
        (["--kind", "x"], "--kind is 'x'; it may be one of numeric, parameter, "),
        (["--paper", "P4"], "--paper is 'P4'; it may be one of P1, P2, P3."),
        (["--results", "nowhere"], "nowhere"),
        (["--results", "chapters"], "by chapter 00, of which there are no results."),
    ],
)
def test_a_wrong_selection_is_status_2(mini: MiniProject, words: list[str], said: str) -> None:
    done = run_command(mini.root, "claims", *words)
    assert done.returncode == 2
    assert said in done.stderr
    assert done.stdout == ""


def test_a_typed_verdict_stops_the_build(mini: MiniProject) -> None:
    ledger = mini.root / "data" / "claims" / "mini.yaml"
    ledger.write_text(MINI_LEDGER.replace("  why: It is", "  verdict: reproduced\n  why: It is"))
    done = run_command(mini.root, "book")
    assert done.returncode == 2
    assert "P1-M-twice: verdict: Extra inputs are not permitted" in done.stderr


def test_a_claim_whose_check_does_not_resolve_stops_the_build(mini: MiniProject) -> None:
    ledger = mini.root / "data" / "claims" / "mini.yaml"
    ledger.write_text(MINI_LEDGER.replace("quantity: twice", "quantity: thrice"))
    done = run_command(mini.root, "book")
    assert done.returncode == 2
    assert "decided by the quantity thrice, which chapter 00 does not record" in done.stderr
    assert not mini.site.exists()


def test_results_of_another_folder(mini: MiniProject, tmp_path: Path) -> None:
    out = tmp_path / "run"
    done = run_command(mini.root, "run", "00", "-p", "scale=3", "--out", str(out))
    assert done.returncode == 0, done.stderr
    done = run_command(mini.root, "claims", "--json", "--results", str(out))
    found = {entry["id"]: entry["verdict"] for entry in json.loads(done.stdout)}
    assert found == {
        "P1-M-twice": "contradicted by the paper itself",
        "P2-M-lost": "cannot be tested",
    }
