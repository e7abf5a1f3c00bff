"""Texts that rest on results: evidence, placeholders, rival readings, assumptions, bad files."""

from __future__ import annotations

import copy
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import yaml
from assumptions import ASSUMPTIONS, Assumptions, load_assumptions
from hypothesis import given, strategies as st
from inswsn_book.ledger import Claim, QuantityCheck
from inswsn_book.project import Project
from inswsn_book.results import Quantity, Results
from inswsn_book.review import (
    ERRATA,
    READINGS,
    Bound,
    Errata,
    Findings,
    Readings,
    Ruling,
    Sentence,
    escape_text,
    judged_anew,
    load_entries,
    require_evidence,
)
from inswsn_book.verdicts import Judged, Verdict
from sensitivity import problems_of

from inswsn_lib.errors import InswsnError
from inswsn_lib.files import read_yaml

#: What the draft of the ledger of claims listed as left out by the papers.
DRAFTED = (
    *("P1-M-B", "P1-M-D", "P1-M-L", "P1-M-KFQR", "P1-M-INS", "P1-M-path", "P1-M-wsnv", "P1-M-bp"),
    *("P1-M-seed", "P1-M-normal", "P2-M-K", "P2-M-M", "P2-M-g", "P2-M-BDL", "P2-M-path"),
    *("P2-M-fkf", "P2-M-abs", "P2-M-gyro", "P2-M-seed", "P3-M-lssvm", "P3-M-QR", "P3-M-data"),
    *("P3-M-imu", "P3-M-rate", "P3-M-base"),
)

CLAIM = Claim(
    id="P1-M-twice",
    paper="P1",
    place="Section 1",
    says="Twice the number is 42 m.",
    value="42",
    unit="m",
    kind="numeric",
    check=QuantityCheck(chapter="00", quantity="twice"),
    tolerance="digits",
    why="It is printed in whole metres.",
)
RESULTS = Results(
    chapter="00",
    parameters={},
    data={},
    quantities=(
        Quantity(name="twice", value=42.25, unit="m", interval=(41.5, 43.0),
                 interval_kind="rounding", basis="printed", tolerance=0,
                 how="The number, scaled."),
        Quantity(name="share", value=0.25, unit="1", basis="printed", tolerance=0,
                 how="A share of the whole."),
        Quantity(name="loss", value=-3.5, unit="m", basis="printed", tolerance=0,
                 how="Less than nothing."),
    ),
    sentences={"It holds.": True, "It does not.": False},
)  # fmt: skip
FOUND = Findings([RESULTS], [Judged(CLAIM, Verdict.REPRODUCED, "It lies within.")])


@pytest.mark.parametrize(
    ("text", "shown"),
    [
        ("{00:twice:.1f} m", "**42.2** m"),
        ("{00:twice}", "**42.25**"),
        ("{00:twice@low:.0f} to {00:twice@high:.0f}", "**42** to **43**"),
        ("{00:share:.0%}", "**25 %**"),
        ("{00:loss:.1f}", "**−3.5**"),
        ("{claim:P1-M-twice}", "[P1-M-twice](#claim-p1-m-twice) (*reproduced*)"),
        ("{ref}`x <y>` and {prf:ref}`z` and $A_{f}$", "{ref}`x <y>` and {prf:ref}`z` and $A_{f}$"),
    ],
)
def test_placeholders_are_filled(text: str, shown: str) -> None:
    assert FOUND.fill(text) == shown


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("{00:none:.1f}", "chapter 00 records no quantity none."),
        ("{07:twice:.1f}", "chapter 07 records no quantity twice."),
        ("{00:twice:zz}", "{00:twice:zz} has a wrong format, or there is no interval."),
        ("{00:share@low}", "{00:share@low} has a wrong format, or there is no interval."),
        ("{claim:P1-none}", "the ledger has no claim P1-none."),
    ],
)
def test_a_bad_placeholder_gives_one_sentence(text: str, said: str) -> None:
    with pytest.raises(InswsnError) as caught:
        FOUND.fill(f"It is {text}.")
    assert str(caught.value) == said


@given(st.floats(-1e6, 1e6), st.floats(-1e6, 1e6))
def test_a_bound_holds_exactly_when_the_value_is_within(value: float, end: float) -> None:
    quantity = RESULTS.quantities[2].model_copy(update={"value": value})
    found = Findings([RESULTS.model_copy(update={"quantities": (quantity,)})], [])
    assert found.holds(Bound(chapter="00", quantity="loss", at_least=end)) == (value >= end)
    assert found.holds(Bound(chapter="00", quantity="loss", at_most=end)) == (value <= end)


def test_sentences_and_rulings_hold_or_not() -> None:
    assert FOUND.holds(Sentence(chapter="00", sentence="It holds."))
    assert not FOUND.holds(Sentence(chapter="00", sentence="It does not."))
    assert FOUND.holds(Ruling(claim="P1-M-twice", verdict=Verdict.REPRODUCED))
    assert not FOUND.holds(Ruling(claim="P1-M-twice", verdict=Verdict.CONTRADICTED))


@pytest.mark.parametrize(
    ("evidence", "said"),
    [
        (Sentence(chapter="00", sentence="Nobody said so."),
         "chapter 00 binds no sentence 'Nobody said so.'."),
        (Ruling(claim="P1-X", verdict=Verdict.REPRODUCED), "the ledger has no claim P1-X."),
        (Bound(chapter="00", quantity="none", at_least=1), "chapter 00 records no quantity none."),
    ],
)  # fmt: skip
def test_evidence_that_names_nothing_is_refused(
    evidence: Sentence | Ruling | Bound, said: str
) -> None:
    with pytest.raises(InswsnError) as caught:
        FOUND.holds(evidence)
    assert str(caught.value) == said


@given(st.text("ab*_`[]{}$<>~|^\\ ", max_size=20))
def test_escaped_text_shows_every_character(text: str) -> None:
    from markdown_it import MarkdownIt

    shown = MarkdownIt().render(f"x{escape_text(text)}x")
    plain = shown.removeprefix("<p>").removesuffix("</p>\n")
    for code, sign in (("&lt;", "<"), ("&gt;", ">"), ("&quot;", '"'), ("&amp;", "&")):
        plain = plain.replace(code, sign)
    assert plain == f"x{text}x"


def test_what_a_text_rests_on_names_each_number_once() -> None:
    texts = ["{00:twice:.1f}, {00:twice:.2f}", "{00:twice@low:.1f} and {00:share:.0%}"]
    assert [(where, q.name) for where, q in FOUND.numbers(texts)] == [
        ("00", "twice"), ("00", "share"),
    ]  # fmt: skip
    assert FOUND.numbers(["No number, but {claim:P1-M-twice}."]) == []


def test_a_number_may_be_a_ratio() -> None:
    of_two = Bound(chapter="00", quantity="twice", over="share", at_least=169, at_most=169)
    assert FOUND.holds(of_two)
    assert not FOUND.holds(of_two.model_copy(update={"at_least": 169.01}))
    with pytest.raises(InswsnError, match="records no quantity none"):
        FOUND.value(of_two.model_copy(update={"over": "none"}))


# Rival readings


@pytest.fixture(scope="module")
def readings(root: Path) -> Readings:
    return load_entries(root / READINGS, Readings)


def test_every_claim_is_in_one_group_and_on_the_page(
    readings: Readings, findings: Findings, render: Callable[..., str]
) -> None:
    named = {e.claim.id for question in readings.questions for e in question.hanging(findings)}
    page = render("readings")
    rest = page.split("(readings-remaining)=")[1]
    listed = set(re.findall(r"\[(P[123]-[^\]]+)\]\(#claim-", rest))
    assert named | listed == set(findings.judged)
    assert not named & listed
    assert len(named) > 250
    assert listed
    for name, entry in findings.judged.items():
        assert f"[{name}](#{entry.claim.anchor})" in page
    for question in readings.questions:
        assert page.count(f"({question.anchor})=\n### {question.id}. ") == 1
        assert f"[{question.id}](#{question.anchor})" in page
        assert any(reading.taken for reading in question.readings)
    assert not re.search(r"\{\w+:[^}`]*\}(?!`)", page)
    assert "[P2-F-14](#claim-p2-f-14) would be *not reproduced* (1.40" in page
    assert "all 8 claims judged anew keep their verdicts" in page


def test_claims_are_found_by_patterns(readings: Readings, findings: Findings) -> None:
    question = next(entry for entry in readings.questions if entry.id == "R-P1-07")
    names = [entry.claim.id for entry in question.hanging(findings)]
    assert [name for name in names if name.startswith("P1-T2-KF")] == [
        f"P1-T2-KF-{cell}" for cell in
        ("rx-1", "rx-2", "ry-1", "ry-2", "vx-1", "vx-2", "vy-1", "vy-2")
    ]  # fmt: skip
    assert not any(name.startswith("P1-T2-HF") for name in names)
    nowhere = question.model_copy(update={"claims": ("P9-*",)})
    with pytest.raises(InswsnError, match=r"no claim of the ledger fits P9-\*"):
        nowhere.hanging(findings)


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


def test_every_statement_on_what_was_computed_has_evidence_that_holds(
    root: Path, readings: Readings, findings: Findings, render: Callable[..., str]
) -> None:
    require_evidence([*readings.questions, *readings.computed], findings)
    chapters = "".join(p.read_text(encoding="utf-8") for p in (root / "chapters").glob("*.md"))
    assert {entry.paper for entry in readings.computed} == {"P1", "P2", "P3"}
    assert {"printed", "best", "unexplained"} <= {entry.certainty for entry in readings.computed}
    for entry in readings.computed:
        assert f"({entry.where})=" in chapters
    unexplained = [entry for entry in readings.computed if entry.certainty == "unexplained"]
    assert render("readings").count("*Unexplained*") == len(unexplained)


def test_a_statement_whose_evidence_does_not_hold(
    readings: Readings, findings: Findings, render: Callable[..., str]
) -> None:
    wrong = Bound(chapter="00", quantity="period.area1", at_least=0.9)
    first = readings.computed[0].model_copy(update={"evidence": (wrong,)})
    broken = readings.model_copy(update={"computed": (first,)})
    with pytest.raises(InswsnError, match=r"^computed of P1: .* does not hold"):
        require_evidence(broken.computed, findings)
    assert "In this run the evidence does not hold" in render("readings", readings=broken)


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


# What the papers leave unsaid


def test_the_list_fits_the_checkout(project: Project) -> None:
    assert problems_of(project, load_assumptions(project.root)) == []


def test_the_entries_hold_together(project: Project) -> None:
    """What their form does not say of each entry and of all of them."""
    errata = load_entries(project.root / ERRATA, Errata)
    readings = load_entries(project.root / READINGS, Readings)
    assumptions = load_assumptions(project.root)
    unsaid = assumptions.assumptions
    titled = [*errata.errata, *errata.slips, *readings.questions, *unsaid]
    ids = [entry.id.lower() for entry in titled]
    assert sorted(set(ids)) == sorted(ids)
    assert [e.id for e in titled if e.paper not in e.id.split("-")] == []
    resting = [*errata.errata, *errata.slips, *readings.computed]
    bounds = [e for entry in resting for e in entry.evidence if isinstance(e, Bound)]
    assert all(b.at_least is not None or b.at_most is not None for b in bounds)
    assert all(sum(r.taken for r in q.readings) <= 1 for q in readings.questions)
    headlines = {(h.chapter, h.key) for h in assumptions.headlines}
    kinds = ({"scenario", "setting"}, {"chapter", "parameter"}, {"text"})
    for entry in unsaid:
        others = entry.alternatives
        assert others or entry.seeds or entry.varied, entry.id
        assert len({other.id for other in others}) == len(others), entry.id
        assert {*entry.seeds, *(c for o in others for c in o.chapters)} <= set(assumptions.reduced)
        for choice in entry.chosen:
            assert {name for name, value in choice if value is not None} in kinds, entry.id
            assert choice.text is None or entry.why, entry.id
        for other in others:  # each of its chapters is changed, and no other
            touched = {*other.parameters, *(edit.chapter for edit in other.edits)}
            everywhere = other.values or other.factors or other.files
            assert touched <= set(other.chapters), (entry.id, other.id)
            assert everywhere or touched == set(other.chapters), (entry.id, other.id)
        for within in entry.within:  # against a headline, or a quantity that is explained
            assert (within.headline is None) == (within.against is not None), entry.id
            assert (within.against is None) == (within.says is None), entry.id
            assert within.headline is None or (within.chapter, within.headline) in headlines


def test_no_entry_of_the_draft_was_dropped(project: Project) -> None:
    ids = [entry.id for entry in load_assumptions(project.root).assumptions]
    assert set(DRAFTED) <= set(ids)
    assert len({name.lower() for name in ids}) == len(ids)


def test_a_number_without_an_entry_is_found(project: Project) -> None:
    """Each entry that covers something is taken away in turn; what it covered comes up."""
    content = read_yaml(project.root / ASSUMPTIONS)
    for taken in ("P1-M-path", "P3-M-gate", "P2-M-wsnr"):
        left = [entry for entry in content["assumptions"] if entry["id"] != taken]
        (gone,) = (entry for entry in content["assumptions"] if entry["id"] == taken)
        said = "\n".join(
            problems_of(project, Assumptions.model_validate(content | {"assumptions": left}))
        )
        for choice in gone["chosen"]:
            if "setting" in choice:
                assert f"{choice['setting']} of the scenario {choice['scenario']} has no" in said
            if "parameter" in choice:
                assert f"{choice['parameter']} of chapter {choice['chapter']} has no entry" in said


@pytest.mark.parametrize(
    ("entry", "change", "said"),
    [
        ("P1-M-path", {"chosen": [{"scenario": "p1", "setting": "sped"}]}, "no setting sped"),
        ("P1-M-B", {"chosen": [{"chapter": "01", "parameter": "noise"}]}, "no parameter noise"),
    ],
)
def test_a_name_that_is_nowhere_is_found(
    project: Project, entry: str, change: dict[str, Any], said: str
) -> None:
    content = read_yaml(project.root / ASSUMPTIONS)
    entries = [e | change if e["id"] == entry else e for e in content["assumptions"]]
    problems = problems_of(project, Assumptions.model_validate(content | {"assumptions": entries}))
    assert any(entry in problem and said in problem for problem in problems)


def test_a_parameter_cannot_be_both(project: Project) -> None:
    content = read_yaml(project.root / ASSUMPTIONS)
    content["printed"]["01"]["margin"] = "It is printed."
    problems = problems_of(project, Assumptions.model_validate(content))
    assert problems == [
        "The parameter margin of chapter 01 has an entry and a reason for having none."
    ]


def test_a_passage_that_is_not_there_is_found(project: Project) -> None:
    content = read_yaml(project.root / ASSUMPTIONS)
    (entry,) = (e for e in content["assumptions"] if e["id"] == "P1-M-L")
    entry["alternatives"][0]["edits"][0]["old"] = "nobody wrote this passage"
    problems = problems_of(project, Assumptions.model_validate(content))
    assert problems == [
        "P1-M-L/positions: the passage that it replaces does not stand in chapter 01 exactly once."
    ]


# Bad files


def errata_in(root: Path) -> Errata:
    return load_entries(root / ERRATA, Errata)


def readings_in(root: Path) -> Readings:
    return load_entries(root / READINGS, Readings)


def refusal(load: Callable[[Path], object], root: Path, name: str, content: object) -> str:
    """Return the one sentence with which a file of this content is refused."""
    (root / "data").mkdir()
    (root / name).write_text(yaml.safe_dump(content), encoding="utf-8")
    with pytest.raises(InswsnError) as caught:
        load(root)
    sentence = str(caught.value)
    assert sentence.startswith(str(root / name))
    assert sentence.endswith(".")
    assert "\n" not in sentence
    return sentence


def one_erratum(**changes: Any) -> dict[str, Any]:
    entry = {
        "id": "E-P1-01",
        "paper": "P1",
        "place": "Section 1",
        "kind": "algebra",
        "title": "A title",
        "printed": "One and one is three.",
        "derivation": "One and one is two.",
        "effect": "One less.",
        "correction": "Two.",
        "changes": "yes",
        "evidence": [{"claim": "P1-P-T", "verdict": "reproduced"}],
    } | changes
    return {"errata": [{name: value for name, value in entry.items() if value is not None}]}


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


SMALL: dict[str, Any] = {
    "headlines": [
        {"chapter": "00", "quantity": "twice", "short": "twice", "says": "twice it", "turns": 50},
        {"chapter": "00", "quantity": "twice", "over": "half", "short": "four", "says": "ratio"},
    ],
    "reduced": {"00": {"parameters": {}, "seeds": [1, 2]}},
    "printed": {"00": {}},
    "assumptions": [
        {
            "id": "P1-M-scale",
            "paper": "P1",
            "unsaid": "The scale.",
            "place": "Section 1",
            "bounds": "Nothing.",
            "chosen": [{"chapter": "00", "parameter": "scale"}],
            "alternatives": [
                {"id": "three", "set": "3", "why": "One more.", "chapters": ["00"],
                 "parameters": {"00": {"scale": 3.0}}},
                {"id": "ten", "set": "10", "why": "Many more.", "chapters": ["00"],
                 "parameters": {"00": {"scale": 10.0}}},
            ],
            "within": [
                {"chapter": "00", "reading": "half of it", "headline": "twice", "quantity": "half"}
            ],
        },
        {
            "id": "P2-M-word",
            "paper": "P2",
            "unsaid": "A word.",
            "place": "Section 2",
            "bounds": "Nothing.",
            "chosen": [{"text": "This word."}],
            "why": "It is short.",
            "varied": "It cannot be.",
        },
        {
            "id": "P1-M-seed",
            "paper": "P1",
            "unsaid": "The seed.",
            "place": "Section 1",
            "bounds": "Nothing.",
            "chosen": [{"text": "Any."}],
            "why": "There is none.",
            "seeds": ["00"],
        },
    ],
}  # fmt: skip


@pytest.mark.parametrize(
    ("content", "said"),
    [
        (one_erratum(kind="sloppy"), "E-P1-01: kind: Input should be 'algebra'"),
        (one_erratum(title=None), "E-P1-01: title: Field required"),
        (one_erratum(evidence=[]), "E-P1-01: evidence: Tuple should have at least 1 item"),
        (one_erratum(verdict="wrong"), "E-P1-01: verdict: Extra inputs are not permitted"),
        (one_erratum(id=None), "errata number 0: id: Field required"),
        ([1, 2], "the file: Input should be a valid dictionary"),
        ({"errata": [], "slips": [{"id": "E-P1-02", "paper": "P1", "place": "here",
                                   "printed": "this", "meant": "that"}]},
         "E-P1-02: id: String should match pattern"),
    ],
)  # fmt: skip
def test_bad_errata_give_one_sentence(tmp_path: Path, content: Any, said: str) -> None:
    assert said in refusal(errata_in, tmp_path, ERRATA, content)


@pytest.mark.parametrize(
    ("content", "said"),
    [
        (one_question(readings=ONE[:1]), "R-P1-01: readings: Tuple should have at least 2 items"),
        (one_question(claims=[]), "R-P1-01: claims: Tuple should have at least 1 item"),
        (one_question() | {"computed": [{"paper": "P1", "says": "This.", "certainty": "sure",
                                         "where": "x", "evidence": []}]},
         "computed number 0: evidence: Tuple should have at least 1 item"),
    ],
)  # fmt: skip
def test_bad_readings_give_one_sentence(tmp_path: Path, content: Any, said: str) -> None:
    assert said in refusal(readings_in, tmp_path, READINGS, content)


@pytest.mark.parametrize(
    ("path", "value", "said"),
    [
        (("assumptions", 0, "paper"), "P4", "P1-M-scale: paper: Input should be 'P1'"),
        (("assumptions", 0, "extra"), 1, "P1-M-scale: extra: Extra inputs"),
        (("assumptions", 1, "chosen"), [], "P2-M-word: chosen: Tuple should have at least 1"),
    ],
)
def test_bad_assumptions_give_one_sentence(
    tmp_path: Path, path: tuple[int | str, ...], value: object, said: str
) -> None:
    content: Any = copy.deepcopy(SMALL)
    place = content
    for part in path[:-1]:
        place = place[part]
    place[path[-1]] = value
    assert said in refusal(load_assumptions, tmp_path, ASSUMPTIONS, content)


def test_a_missing_file_gives_one_sentence(tmp_path: Path) -> None:
    with pytest.raises(InswsnError, match=r"^There is no .*errata\.yaml\.$"):
        errata_in(tmp_path)
