"""The rival readings: their form, that no claim is left out, and verdicts judged anew."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import pytest
import yaml
from inswsn_book.evidence import Bound, Findings
from inswsn_book.judging import judge_claims
from inswsn_book.project import Project
from inswsn_book.readings import (
    READINGS,
    Readings,
    claims_named,
    computed_page,
    judged_anew,
    load_readings,
    readings_page,
    remaining_page,
)
from inswsn_book.results import read_results
from inswsn_book.review import review_texts
from inswsn_book.verdicts import Verdict

from inswsn_lib.errors import InswsnError


@pytest.fixture(scope="module")
def readings(root: Path) -> Readings:
    return load_readings(root)


@pytest.fixture(scope="module")
def findings(project: Project) -> Findings:
    files = sorted(project.published.glob("[0-9][0-9].json"))
    return Findings(map(read_results, files), judge_claims(project))


def test_every_claim_is_in_one_group_at_least(readings: Readings, findings: Findings) -> None:
    named = {
        entry.claim.id
        for question in readings.questions
        for entry in claims_named(question, findings)
    }
    listed = set(re.findall(r"\[(P[123]-[^\]]+)\]\(#", remaining_page(readings, findings)))
    assert named | listed == set(findings.judged)
    assert not named & listed
    assert len(named) > 250
    assert listed


def test_the_page_links_to_every_claim_and_holds_no_placeholder(
    readings: Readings, findings: Findings
) -> None:
    page = readings_page(readings, findings)
    whole = page + remaining_page(readings, findings) + computed_page(readings, findings)
    for name, entry in findings.judged.items():
        assert f"[{name}](#{entry.claim.anchor})" in whole
    for question in readings.questions:
        assert page.count(f"({question.anchor})=\n### {question.id}. ") == 1
        assert f"[{question.id}](#{question.anchor})" in page
        assert sum(reading.taken for reading in question.readings) == 1
    assert not re.search(r"\{\w+:[^}`]*\}(?!`)", whole)


def test_claims_are_found_by_patterns(readings: Readings, findings: Findings) -> None:
    question = next(entry for entry in readings.questions if entry.id == "R-P1-07")
    names = [entry.claim.id for entry in claims_named(question, findings)]
    assert [name for name in names if name.startswith("P1-T2-KF")] == [
        f"P1-T2-KF-{cell}" for cell in
        ("rx-1", "rx-2", "ry-1", "ry-2", "vx-1", "vx-2", "vy-1", "vy-2")
    ]  # fmt: skip
    assert not any(name.startswith("P1-T2-HF") for name in names)


def test_verdicts_are_judged_anew_by_a_reading(readings: Readings, findings: Findings) -> None:
    anew = {
        now.claim.id: (now.verdict, other.verdict, other.quantity)
        for question in readings.questions
        for reading in question.readings
        for now, other in judged_anew(reading, findings)
    }
    now, other, quantity = anew["P2-F-14"]
    assert (now, other) == (Verdict.ASSUMED, Verdict.NOT_REPRODUCED)
    assert quantity is not None
    assert quantity.value > 1  # the gain with one INS over what (9) certifies
    assert anew["P1-Th-2.3"][:2] == (Verdict.NOT_REPRODUCED, Verdict.ASSUMED)
    # both periods of the matrices exclude 1 s
    assert anew["P1-P-T"][:2] == (Verdict.CONTRADICTED, Verdict.CONTRADICTED)
    page = readings_page(readings, findings)
    assert "[P2-F-14](#claim-p2-f-14) would be *not reproduced* (1.40" in page
    assert "all 8 claims judged anew keep their verdicts" in page


def test_every_statement_on_what_was_computed_has_evidence_that_holds(
    root: Path, readings: Readings, findings: Findings
) -> None:
    chapters = "".join(p.read_text(encoding="utf-8") for p in (root / "chapters").glob("*.md"))
    assert {entry.paper for entry in readings.computed} == {"P1", "P2", "P3"}
    for entry in readings.computed:
        assert all(findings.holds(shown) for shown in entry.evidence), entry.says
        assert f"({entry.where})=" in chapters
    assert {"printed", "best", "unexplained"} <= {entry.certainty for entry in readings.computed}
    page = computed_page(readings, findings)
    assert page.count("*Unexplained*") == sum(
        entry.certainty == "unexplained" for entry in readings.computed
    )


def test_evidence_that_does_not_hold_is_refused(readings: Readings, findings: Findings) -> None:
    wrong = Bound(chapter="00", quantity="period.area1", at_least=0.9)
    first = readings.computed[0].model_copy(update={"evidence": (wrong,)})
    broken = readings.model_copy(update={"computed": (first,)})
    with pytest.raises(InswsnError) as caught:
        computed_page(broken, findings)
    assert str(caught.value).startswith(
        "data/readings.yaml: computed, P1, statement 1: its evidence does not hold: "
    )
    assert "In this run the evidence does not hold" in computed_page(broken, findings, strict=False)


def test_the_labels_that_texts_link_to_are_there(root: Path, readings: Readings) -> None:
    text = "".join(
        path.read_text(encoding="utf-8")
        for path in [*(root / "chapters").glob("*.md"), *(root / "book").glob("*.md")]
    )
    text += (root / "data/errata.yaml").read_text(encoding="utf-8")
    for entry in readings.questions:
        written = entry.model_dump_json()
        for label in re.findall(r"\{(?:prf:)?ref\}`(?:[^`<]*<)?([\w-]+)>?`", written):
            erratum = label.startswith("erratum-") and label[8:].upper() in text
            there = f"({label})=" in text or f":label: {label}\n" in text
            assert erratum or there, (entry.id, label)
        for label in re.findall(r"\{numref\}`([\w-]+)`", written):
            assert re.search(rf'(name="{label}"|:name: {label}\n)', text), (entry.id, label)


def one_question(**changes: Any) -> dict[str, Any]:
    entry = {
        "id": "R-P1-01",
        "paper": "P1",
        "place": "Section 1",
        "title": "What is it?",
        "says": "It is.",
        "readings": [
            {"name": "This", "found": "It fits.", "taken": True},
            {"name": "That", "found": "It does not."},
        ],
        "why": "It fits.",
        "decides": "A sentence.",
        "changes": "Nothing.",
        "claims": ["P1-P-T"],
    } | changes
    return {"questions": [entry]}


ONE = one_question()["questions"][0]["readings"]


@pytest.mark.parametrize(
    ("content", "said"),
    [
        (one_question(id="R-P3-01"), "R-P3-01: the id does not begin with R-P1-"),
        (one_question(readings=ONE[:1]), "R-P1-01: readings: Tuple should have at least 2 items"),
        (one_question(readings=[ONE[0]] * 2), "R-P1-01: more than one reading is taken"),
        (one_question(claims=[]), "R-P1-01: claims: Tuple should have at least 1 item"),
        (one_question(verdict="x"), "R-P1-01: verdict: Extra inputs are not permitted"),
        ({"questions": one_question()["questions"] * 2}, "the ids R-P1-01 are used twice"),
        (
            one_question() | {"computed": [{"paper": "P1", "says": "This.", "certainty": "sure",
                                            "where": "x", "evidence": []}]},
            "computed number 0: certainty: Input should be 'printed', 'best'",
        ),
        (None, "the file: Input should be a valid dictionary"),
    ],
)  # fmt: skip
def test_a_bad_file_gives_one_sentence(tmp_path: Path, content: Any, said: str) -> None:
    (tmp_path / "data").mkdir()
    (tmp_path / READINGS).write_text(yaml.safe_dump(content), encoding="utf-8")
    with pytest.raises(InswsnError) as caught:
        load_readings(tmp_path)
    assert said in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"claims": ["P9-*"]}, "no claim of the ledger fits P9-*."),
        ({"why": "As {claim:P1-none}."}, "the ledger has no claim P1-none."),
        (
            {"readings": [ONE[0], ONE[1] | {"judged": {"P1-P-T": {"chapter": "00",
                                                                  "quantity": "no.such"}}}]},
            "Claim P1-P-T is decided by the quantity no.such, which chapter 00 does not record.",
        ),
    ],
)  # fmt: skip
def test_what_is_not_there_gives_one_sentence(
    findings: Findings, changes: dict[str, Any], said: str
) -> None:
    broken = Readings.model_validate(one_question(**changes))
    with pytest.raises(InswsnError) as caught:
        readings_page(broken, findings)
    assert str(caught.value) == f"data/readings.yaml: R-P1-01: {said}"


def test_a_checkout_without_the_lists_has_no_texts_of_them(mini: Project) -> None:
    assert review_texts(mini, [], []) == {}
