"""Texts that rest on results: placeholders, evidence, errata, rival readings, bad files."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import pytest
from conftest import Render
from hypothesis import given, strategies as st
from inswsn_book.judge.ledger import MissingCheck, QuantityCheck
from inswsn_book.judge.review import (
    RERUNS,
    Anew,
    Bound,
    Entry,
    Errata,
    Evidence,
    Findings,
    Question,
    Reading,
    Readings,
    Ruling,
    Sentence,
    escape_text,
    judged_anew,
    load_entries,
    require_evidence,
    with_readings,
    with_reruns,
)
from inswsn_book.judge.verdicts import Judged, Verdict, verdicts
from inswsn_book.record.results import write_results
from made_results import claim, quantity, results
from markdown_it import MarkdownIt

from inswsn_lib.errors import InswsnError

CLAIM = claim(
    id="P1-M-twice", says="It is 42 m.", value="42", check={"chapter": "00", "quantity": "twice"}
)
RESULTS = results(
    quantity("twice", 42.25, interval=(41.5, 43.0), interval_kind="rounding"),
    quantity("share", 0.25),
    quantity("loss", -3.5),
    sentences={"It holds.": True, "It does not.": False},
)
FOUND = Findings([RESULTS], [Judged(CLAIM, Verdict.ADDS_UP, "It lies within.")])

# Placeholders ------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("text", "shown"),
    [
        ("{00:twice:.1f} m", "<00:twice:.1f **42.2**> m"),
        ("{00:twice}", "<00:twice **42.25**>"),
        (
            "{00:twice@low:.0f} to {00:twice@high:.0f}",
            "<00:twice@low:.0f **42**> to <00:twice@high:.0f **43**>",
        ),
        ("{00:share:.0%}", "<00:share:.0% **25 %**>"),
        ("{00:loss:.1f}", "<00:loss:.1f **−3.5**>"),
        ("{claim:P1-M-twice}", "[P1-M-twice](#claim-p1-m-twice) (*adds up in print*)"),
        ("{ref}`x <y>` and {prf:ref}`z` and $A_{f}$", "{ref}`x <y>` and {prf:ref}`z` and $A_{f}$"),
    ],
)
def test_placeholders_are_filled(text: str, shown: str) -> None:
    """A number bears its placeholder, written here as ``<placeholder **number**>``."""
    marked = re.sub(r"<(\S+) (\*\*.+?\*\*)>", r'<span data-quantity="\1">\2</span>', shown)
    assert FOUND.fill(text) == marked


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


def test_what_a_text_rests_on_names_each_number_once() -> None:
    texts = ["{00:twice:.1f}, {00:twice:.2f}", "{00:twice@low:.1f} and {00:share:.0%}"]
    assert [(where, q.name) for where, q in FOUND.numbers([*texts, "{claim:P1-M-twice}"])] == [
        ("00", "twice"), ("00", "share"),
    ]  # fmt: skip


@given(st.text("ab*_`[]{}$<>~|^\\ ", max_size=20))
def test_escaped_text_shows_every_character(text: str) -> None:
    shown = MarkdownIt().render(f"x{escape_text(text)}x")
    plain = shown.removeprefix("<p>").removesuffix("</p>\n")
    for code, sign in (("&lt;", "<"), ("&gt;", ">"), ("&quot;", '"'), ("&amp;", "&")):
        plain = plain.replace(code, sign)
    assert plain == f"x{text}x"


# Evidence ----------------------------------------------------------------------------------------


@given(st.floats(-1e6, 1e6), st.floats(-1e6, 1e6))
def test_a_bound_holds_exactly_when_the_value_is_within(value: float, end: float) -> None:
    found = Findings([RESULTS.model_copy(update={"quantities": (quantity("x", value),)})], [])
    assert found.holds(Bound(chapter="00", quantity="x", at_least=end)) == (value >= end)
    assert found.holds(Bound(chapter="00", quantity="x", at_most=end)) == (value <= end)


def bound(**fields: Any) -> Bound:
    return Bound(chapter="00", **fields)


@pytest.mark.parametrize(
    ("evidence", "holds"),
    [
        (Sentence(chapter="00", sentence="It holds."), True),
        (Sentence(chapter="00", sentence="It does not."), False),
        (Ruling(claim="P1-M-twice", verdict="adds up in print"), True),
        (Ruling(claim="P1-M-twice", verdict="contradicted by the paper itself"), False),
        (bound(quantity="twice", over="share", at_least=169, at_most=169), True),
        (bound(quantity="twice", over="share", at_least=169.01), False),
        (bound(quantity="twice", at_least=40, at_most=42), False),
    ],
)
def test_evidence_holds_or_its_entry_is_refused(evidence: Evidence, holds: bool) -> None:
    assert FOUND.holds(evidence) is holds
    entry = Entry(id="E-P1-01", paper="P1", evidence=(evidence,))
    if holds:
        require_evidence([entry], FOUND)
    else:
        with pytest.raises(InswsnError, match=r"^E-P1-01 of P1: its evidence does not hold \("):
            require_evidence([entry], FOUND)


@pytest.mark.parametrize(
    ("evidence", "said"),
    [
        (Sentence(chapter="00", sentence="Nobody said so."),
         "chapter 00 binds no sentence 'Nobody said so.'."),
        (Ruling(claim="P1-X", verdict="reproduced"), "the ledger has no claim P1-X."),
        (bound(quantity="none", at_least=1), "chapter 00 records no quantity none."),
        (bound(quantity="twice", over="none"), "chapter 00 records no quantity none."),
    ],
)  # fmt: skip
def test_evidence_that_names_nothing_is_refused(evidence: Evidence, said: str) -> None:
    with pytest.raises(InswsnError) as caught:
        require_evidence([Entry(id="E-P1-01", paper="P1", evidence=(evidence,))], FOUND)
    assert str(caught.value) == f"E-P1-01 of P1: {said}"


# The errata and the readings of the book; that their evidence holds is required by `known` --------


@pytest.fixture(scope="module")
def errata(known: dict[str, Any]) -> Errata:
    return known["errata"]


@pytest.fixture(scope="module")
def readings(known: dict[str, Any]) -> Readings:
    return known["readings"]


def test_the_entries_hold_together(errata: Errata, readings: Readings) -> None:
    """What their form does not say of each entry and of all of them."""
    titled = [*errata.errata, *errata.slips, *readings.questions]
    ids = [entry.id.lower() for entry in titled]
    assert sorted(set(ids)) == sorted(ids)
    assert [e.id for e in titled if e.paper not in e.id.split("-")] == []
    resting = [*errata.errata, *errata.slips, *readings.computed]
    bounds = [e for entry in resting for e in entry.evidence if isinstance(e, Bound)]
    assert all(b.at_least is not None or b.at_most is not None for b in bounds)
    assert all(sum(r.taken for r in q.readings) <= 1 for q in readings.questions)


def test_every_text_is_looked_at(errata: Errata, readings: Readings, findings: Findings) -> None:
    """A placeholder that is not there is refused in whichever text it stands."""
    for entry in (errata.errata[0], errata.slips[0], readings.questions[0], readings.computed[0]):
        for name in entry.shown:
            broken = entry.model_copy(update={name: "Off by {01:no.such.thing:.0f} %."})
            with pytest.raises(InswsnError, match=r"records no quantity no\.such\.thing"):
                require_evidence([broken], findings)


def test_a_page_of_another_run_says_what_no_longer_holds(
    errata: Errata, readings: Readings, render: Render
) -> None:
    wrong = Bound(chapter="printed-numbers", quantity="period.area1", at_least=0.9)
    first = errata.errata[0].model_copy(update={"evidence": (wrong,)})
    page = render("errata", errata=Errata(errata=(first,)))
    assert page.count("In this run its evidence does not hold:") == 1
    stated = readings.computed[0].model_copy(update={"evidence": (wrong,)})
    page = render("readings", readings=readings.model_copy(update={"computed": (stated,)}))
    assert page.count("In this run the evidence does not hold") == 1
    assert "does not hold:" not in render("errata") + render("readings")


def test_every_claim_hangs_on_a_question_or_is_listed(
    readings: Readings, findings: Findings, render: Render
) -> None:
    named = {e.claim.id for question in readings.questions for e in question.hanging(findings)}
    rest = render("readings").split("(readings-remaining)=")[1]
    listed = set(re.findall(r"\[(P[123]-[^\]]+)\]\(#claim-", rest))
    assert named | listed == set(findings.judged)
    assert not named & listed
    assert (len(named) > 250, len(listed) > 0) == (True, True)


def test_verdicts_are_judged_anew_by_a_reading(readings: Readings, findings: Findings) -> None:
    anew = {
        now.claim.id: (now.verdict, other.verdict, other.quantity)
        for question in readings.questions
        for reading in question.readings
        for now, other in judged_anew(reading, findings)
    }
    now, other, quantity = anew["P2-F-14"]
    assert (now, other) == (Verdict.IDENTITY, Verdict.NOT_REPRODUCED)
    assert quantity.value > 1  # the gain with one INS over what (9) certifies
    assert anew["P1-Th-2.3"][:2] == (Verdict.NOT_REPRODUCED, Verdict.IDENTITY)
    # both periods of the matrices exclude 1 s
    assert anew["P1-P-T"][:2] == (Verdict.CONTRADICTED, Verdict.CONTRADICTED)


def test_a_claim_has_its_verdict_by_each_reading_that_is_computed() -> None:
    """42 m hold by the quantity that decides and by a second one; a third is 0.25 m."""
    checks = {name: QuantityCheck(chapter="00", quantity=name) for name in ("twice", "share")}
    readings = [Reading(name="Rival", found="It is so.", judged={"P1-M-twice": checks["share"]}),
                Reading(name="Same", found="It is so.", judged={"P1-M-twice": checks["twice"]}),
                Reading(name="Not computed", found="It is so.", taken=True)]  # fmt: skip
    words = dict.fromkeys(("place", "title", "says", "why", "decides", "changes"), "For a test.")
    question = Question(id="R-P1-01", paper="P1", readings=readings, claims=("P1-M-*",), **words)
    known = Readings(questions=(question,))
    other = CLAIM.model_copy(update={"id": "P1-M-other"})
    found, unread = with_readings(verdicts([CLAIM, other], [RESULTS]), known, [RESULTS])
    assert found.readings == (
        ("as decided here", "adds up in print", True),
        ("R-P1-01: Rival", "contradicted by the paper itself under a stated assumption", False),
        ("R-P1-01: Same", "adds up in print under a stated assumption", True),
    )
    assert found.label == "adds up in print, flips with the reading (holds in 2 of 3)"
    assert (unread.readings, unread.label) == ((), "adds up in print")


def test_a_reading_judges_by_quantities_behind_a_prefix() -> None:
    """By its own 45 m the claim of 42 m fails to the digit, and holds within a tenth."""
    own = RESULTS.model_copy(
        update={"quantities": (*RESULTS.quantities, quantity("rival.twice", 45.0))}
    )
    missing = CLAIM.model_copy(
        update={"id": "P1-M-lost", "check": MissingCheck(needs=("x",), reasons=("Lost.",))}
    )
    findings = Findings([own], verdicts([CLAIM, missing], [own]))
    for tolerance, verdict in ((None, Verdict.CONTRADICTED), ("within 10 %", Verdict.ADDS_UP)):
        rule = Anew(claims=("P1-M-*",), prefix="rival", tolerance=tolerance)
        reading = Reading(name="Rival", found="It is so.", anew=(rule,))
        ((now, other),) = judged_anew(reading, findings)  # what cannot be tested is left out
        assert (now.claim.id, other.verdict, other.assumed) == ("P1-M-twice", verdict, True)
    nobody = Reading(name="x y", found="It is so.", anew=(Anew(claims=("P7*",), prefix="rival"),))
    with pytest.raises(InswsnError, match="no claim that fits P7"):
        judged_anew(nobody, findings)


def test_reruns_stand_beside_what_the_chapter_found(tmp_path: Path) -> None:
    """Only beside that of their own chapter, and once however often they are added."""
    kept, other = tmp_path / RERUNS / "00.json", results(chapter="01")
    kept.parent.mkdir(parents=True)
    write_results(results(quantity("rival.twice", 45.0)), kept)
    once = with_reruns(tmp_path, [RESULTS, other])
    assert once[0]["rival.twice"].value == 45.0
    assert once[0].quantities[:-1] == RESULTS.quantities
    assert once[1] == other
    assert with_reruns(tmp_path, once) == once


# A bad file --------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("errata: [{id: E-P1-01, paper: P1, kind: sloppy}]", "E-P1-01: evidence: Field required"),
        ("errata: [{paper: P1}]", "errata number 0: id: Field required"),
        ("{errata: [], verdicts: []}", "verdicts: Extra inputs are not permitted"),
        ("[1, 2]", "the file: Input should be a valid dictionary"),
    ],
)
def test_a_bad_file_gives_one_sentence(tmp_path: Path, text: str, said: str) -> None:
    path = tmp_path / "entries.yaml"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(InswsnError) as caught:
        load_entries(path, Errata)
    assert str(caught.value).startswith(f"{path} is not a list of entries: {said}")
    assert "\n" not in str(caught.value)
