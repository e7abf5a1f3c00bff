"""The claims judged by results: in a terminal, as JSON, and against those of another version."""

from __future__ import annotations

import json
import re
from pathlib import Path

import pytest
from conftest import Command, MiniProject
from hypothesis import given, strategies as st
from inswsn_book.judge.claims import Release, judge, judge_claims, read_verdicts
from inswsn_book.judge.review import load_entries
from inswsn_book.record.files import write_listed
from inswsn_book.record.project import Project
from inswsn_book.record.results import results_text
from made_results import quantity, results

import inswsn_lib
from inswsn_lib.errors import InswsnError

CONTRADICTED = "contradicted by the paper itself"


@pytest.fixture
def listed(project: Project, inswsn: Command) -> list[dict]:
    """The claims as JSON; a fresh clone needs no build."""
    return json.loads(inswsn(project.root, "claims", "--json").stdout)


def test_a_claim_with_its_verdict(listed: list[dict]) -> None:
    (row,) = (entry for entry in listed if entry["id"] == "P1-T1-10-mpos")
    assert row["published"]["value"] == "0.1452"
    assert row["rebuilt"]["value"] == pytest.approx((0.2903 + 0.1063) / 2)
    assert (row["verdict"], row["chapter"]) == (CONTRADICTED, "printed-numbers")
    assert row["cell"].startswith("print")


def test_what_is_printed_of_one_run_is_held_against_single_runs(listed: list[dict]) -> None:
    """Sizes and percentages of all papers by one rule, whatever a bound allows."""
    simulated = [e for e in listed if e["rebuilt"] and e["rebuilt"]["basis"] == "simulation"]
    printed = [
        e
        for e in simulated
        if isinstance(e["published"]["value"], str)
        and e["rebuilt"]["interval"]
        and not e["published"]["tolerance"].startswith("at ")
    ]
    assert {(e["paper"], e["published"]["tolerance"]) for e in printed} == {
        (paper, "drawn") for paper in ("P1", "P2", "P3")
    }
    for entry in printed:
        value, (low, high) = float(entry["published"]["value"]), entry["rebuilt"]["interval"]
        alike = entry["verdict"].startswith("like one of our runs")
        assert not alike or 0 < low <= high < 2 * value


def test_claims_are_selected_and_counted(project: Project, inswsn: Command) -> None:
    words = ("--paper", "P1", "--verdict", CONTRADICTED, "--kind", "numeric")
    lines = inswsn(project.root, "claims", *words).stdout.splitlines()
    # seven means of Table 1, three and four percentages; none rests on an assumption
    assert "14 claims, 14 of them in the headline counts:" in lines
    assert lines[-1].split(maxsplit=1) == ["14", CONTRADICTED]
    chosen = json.loads(inswsn(project.root, "claims", *words, "--json").stdout)
    assert len(chosen) == 14
    assert all(any(entry["id"] in line for line in lines) for entry in chosen)
    told = {(entry["paper"], entry["kind"], entry["verdict"]) for entry in chosen}
    assert told == {("P1", "numeric", CONTRADICTED)}


def test_all_of_one_claim_is_told(project: Project, inswsn: Command) -> None:
    text = inswsn(project.root, "claims", "P1-Z-01").stdout
    parts = ["HF gives optimal", "Verdict: not reproduced under a stated assumption", "Assumed: "]
    parts += ["Named in R-P1-07: What was the Kalman filter?", "Named in E-P1-18: "]
    parts += ["overall.hf-over-kf, 256 runs: ", "inswsn run p1-outages --only P1-Z-01"]
    assert [said for said in parts if said not in text] == []
    assert "$" not in text
    for words, said in (
        (["P1-Z-1"], "the nearest is P1-Z-0"),
        (["P1-Z-01", "--paper", "P2"], "ID"),
    ):
        refused = inswsn(project.root, "claims", *words)
        assert (refused.returncode, said in refused.stderr) == (2, True), refused.stderr


def test_results_of_another_folder_go_first(mini: MiniProject, tmp_path: Path) -> None:
    for folder, value in ((mini.published, 42.0), (tmp_path / "run", 63.0)):
        write_listed(folder, {"00.json": results_text(results(quantity("twice", value)))})
    for folder, verdict in ((None, "adds up in print"), (tmp_path / "run", CONTRADICTED)):
        found = [str(entry.verdict) for entry in judge_claims(mini, folder)]
        assert found == [verdict, "cannot be tested"]


def test_a_bare_verdict_stands_for_those_with_an_assumption_as_well(
    project: Project, listed: list[dict]
) -> None:
    for words in ("not reproduced", "not reproduced under a stated assumption"):
        found = judge_claims(project, verdict=words)
        expected = [row["id"] for row in listed if row["verdict"].startswith(words)]
        assert [entry.claim.id for entry in found] == expected
    assert any(row["assumption"] for row in listed if row["verdict"].startswith("not reproduced"))
    assert {row["id"] for row in listed if row["verdict"] == "not reproduced"} > set()


def test_a_claim_tells_what_a_release_made_of_it(mini: MiniProject) -> None:
    folder = mini.root / "data/verdicts"
    folder.mkdir()
    for version, verdict in (("1.0.0", "reproduced"), ("1.1.0", "adds up in print")):
        text = f"version: {version}\nday: 2026-11-22\nverdicts: {{P1-M-twice: {verdict}}}\n"
        (folder / f"{version}.yaml").write_text(text)
    first, second = judge(mini.root, [results(quantity("twice", 42.0))])
    assert first.earlier == (("1.0.0", "2026-11-22", "reproduced"),)
    assert first.as_json()["earlier"] == {"1.0.0": "reproduced"}
    assert second.earlier == ()  # it was not in these


def test_verdicts_of_releases_are_of_claims_that_there_are_and_the_last_are_those_of_now(
    listed: list[dict], project: Project
) -> None:
    now = {row["id"]: row["verdict"] for row in listed}
    for path in (project.root / "data/verdicts").glob("*.yaml"):
        release = load_entries(path, Release)
        assert release.version == path.stem
        assert set(release.verdicts) <= set(now)
        assert release.verdicts == now or release.version != inswsn_lib.__version__


def test_the_changes_since_a_release_are_those_that_are_listed(
    project: Project, inswsn: Command
) -> None:
    folder = project.root / "data/verdicts"
    done = inswsn(project.root, "claims", "--against", str(folder / "2.0.0.yaml"))
    changed = [line.partition(":")[0] for line in done.stdout.splitlines() if "absent" not in line]
    told = (folder / "changes.md").read_text("utf-8").split("## 3.0.0")[1].split("## 2.0.0")[0]
    lists = [line.rpartition(": ")[2] for line in told.splitlines() if line.startswith("- ")]
    assert sorted(re.findall(r"P\d[-.\w]*\w", " ".join(lists))) == sorted(changed)
    counts = [int(number) for number in re.findall(r"\*, (\d+) \(", told)]
    assert sum(counts) == len(changed)


def test_verdicts_are_compared_with_those_of_another_version(
    project: Project, inswsn: Command, listed: list[dict], tmp_path: Path
) -> None:
    before = tmp_path / "verdicts.json"
    before.write_text(json.dumps(listed))
    assert inswsn(project.root, "claims", "--against", str(before)).stdout == ""
    first, second, *others = listed
    changed = [first | {"verdict": "guessed"}, second | {"id": "P2-gone"}, *others]
    before.write_text(json.dumps(changed))
    assert inswsn(project.root, "claims", "--against", str(before)).stdout.splitlines() == [
        f"{first['id']}: guessed -> {first['verdict']}",
        f"{second['id']}: absent -> {second['verdict']}",
        f"P2-gone: {second['verdict']} -> absent",
    ]


NONE = [b"", b"{}", b"[1]", b'[{"id": "x"}]', b"3", b"[" * 100_000]


@given(st.binary(max_size=200) | st.sampled_from(NONE))
def test_any_bytes_are_verdicts_or_one_sentence(
    tmp_path_factory: pytest.TempPathFactory, content: bytes
) -> None:
    path, said = tmp_path_factory.mktemp("any") / "verdicts.json", ""
    path.write_bytes(content)
    try:
        assert read_verdicts(path) == {}
    except InswsnError as error:
        said = str(error)
    assert said == "" or re.fullmatch(r".*verdicts\.json holds no verdicts; .+\.", said)
