"""Verdicts on made results: every rule, its edges, and what cannot be typed."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import pytest
from hypothesis import given, strategies as st
from inswsn_book.judge.ledger import Claim, MissingCheck, QuantityCheck
from inswsn_book.judge.verdicts import (
    Read,
    Verdict,
    count_verdicts,
    judge_own_cells,
    judge_rebuilt,
    verdicts,
)
from inswsn_book.record.results import Results
from made_results import claim as made_claim, quantity, results

from inswsn_lib.errors import InswsnError

INF, NAN = math.inf, math.nan
REPRODUCED, NOT_REPRODUCED, NOT_DECIDED, CONTRADICTED, ADDS_UP, IDENTITY = (
    Verdict.REPRODUCED, Verdict.NOT_REPRODUCED, Verdict.NOT_DECIDED, Verdict.CONTRADICTED,
    Verdict.ADDS_UP, Verdict.IDENTITY,
)  # fmt: skip
ends = st.tuples(st.integers(-9, 9), st.integers(-9, 9)).map(sorted)


@given(ends, ends)
def test_own_cells_add_up_exactly_if_some_number_lies_in_both(a: list[int], b: list[int]) -> None:
    common = set(range(a[0], a[1] + 1)) & set(range(b[0], b[1] + 1))
    expected = ADDS_UP if common else CONTRADICTED
    assert judge_own_cells((a[0], a[1]), (b[0], b[1])) is expected


@pytest.mark.parametrize("rebuilt", [(NAN, 1.0), (0.0, NAN)])
def test_what_is_not_a_number_adds_up_to_nothing(rebuilt: tuple[float, float]) -> None:
    assert judge_own_cells(rebuilt, (0.0, 1.0)) is CONTRADICTED


@pytest.mark.parametrize(
    ("value", "rebuilt", "published", "reference", "verdict"),
    [
        # published 8 within 1, a quarter of it is 2
        (8.0, (7.5, 8.5), (7, 9), 8, REPRODUCED),
        (8.0, (8.0, 8.0), (7, 9), 8, REPRODUCED),
        (10.0, (9.1, 11.0), (7, 9), 8, NOT_REPRODUCED),
        (3.0, (1.0, 6.9), (7, 9), 8, NOT_REPRODUCED),  # wide, and all of it outside
        (8.5, (7.5, 9.5), (7, 9), 8, REPRODUCED),  # as wide as a quarter: the value decides
        (9.4, (8.4, 10.4), (7, 9), 8, NOT_REPRODUCED),
        (8.5, (7.48, 9.5), (7, 9), 8, NOT_DECIDED),  # wider than a quarter, by a hundredth
        (9.4, (8.3, 10.4), (7, 9), 8, NOT_DECIDED),
        (8.0, (6.0, 10.0), (7, 9), 8, NOT_DECIDED),  # holds all of the tolerance
        (8.0, (6.0, 10.0), (4, 12), 8, REPRODUCED),  # wide, and all of it inside
        (-8.5, (-9.6, -7.4), (-9, -7), -8, NOT_DECIDED),  # a negative number has a size too
        # one-sided: at most 1
        (0.5, (0.2, 0.9), (-INF, 1), 1, REPRODUCED),
        (1.5, (1.2, 1.9), (-INF, 1), 1, NOT_REPRODUCED),
        (0.95, (0.9, 1.1), (-INF, 1), 1, REPRODUCED),
        (0.9, (0.8, 1.1), (-INF, 1), 1, NOT_DECIDED),
        # a published zero has no quarter
        (0.0, (-0.1, 0.2), (-0.1, 0.1), 0, NOT_DECIDED),
        (0.05, (0.0, 0.1), (-0.1, 0.1), 0, REPRODUCED),
        # what is not a number decides nothing
        (NAN, (NAN, NAN), (7, 9), 8, NOT_DECIDED),
        (8.5, (7.5, 9.5), (7, 9), NAN, NOT_DECIDED),
    ],
)
def test_the_rule_for_what_was_built_again(
    value: float,
    rebuilt: tuple[float, float],
    published: tuple[float, float],
    reference: float,
    verdict: Verdict,
) -> None:
    assert judge_rebuilt(value, rebuilt, published, reference)[0] is verdict


# Claims and results ------------------------------------------------------------------------------


def found(value: float = 8.0, interval: tuple[float, float] | None = None, **about: Any) -> Results:
    fields = {"basis": "simulation"}
    if interval is not None:
        fields |= {"interval": interval, "interval_kind": "confidence 95 %"}
    one = quantity("x", value, **fields | about)
    given = {"width": 0.5, "word": "w"}
    return results(one, chapter="02", parameters=given, cells={"x": "ch02-007"})


def claim(tolerance: str | None = "within 1", **changes: Any) -> Claim:
    check = QuantityCheck(chapter="02", quantity="x")
    return made_claim(**{"check": check, "tolerance": tolerance} | changes)


WIDE = (7.0, 9.4)
PRINTED = {"basis": "printed"}
ALGEBRA = {"basis": "algebra"}
RUNS = {"interval_kind": "runs 95 %"}
SO = "That it is so."


@pytest.mark.parametrize(
    ("results", "on", "verdict"),
    [
        (found(), claim(), REPRODUCED),
        (found(9.2), claim(), NOT_REPRODUCED),
        (found(8.0, WIDE), claim(), NOT_DECIDED),
        (found(8.0, WIDE), claim("within 20 %"), REPRODUCED),
        (found(8.4), claim("within width"), REPRODUCED),
        (found(8.6), claim("within width"), NOT_REPRODUCED),
        (found(8.04), claim("digits"), REPRODUCED),
        (found(8.06), claim("digits"), NOT_REPRODUCED),
        (found(8.06, **PRINTED), claim("digits"), CONTRADICTED),
        (found(7.0, **PRINTED), claim("at least 7"), ADDS_UP),
        (found(8.0, (7.0, 9.0), **PRINTED), claim(), ADDS_UP),
        (found(8.0, (6.9, 9.0), **PRINTED), claim(), NOT_DECIDED),
        (found(80.0, (9.1, 99.0), **PRINTED), claim(), CONTRADICTED),
        (found(9.0, basis="recorded"), claim("at most 8.5"), NOT_REPRODUCED),
        (found(8.0, **ALGEBRA), claim(), IDENTITY),
        (found(9.2, **ALGEBRA), claim(), NOT_REPRODUCED),
        (found(8.0, WIDE, **ALGEBRA), claim(), NOT_DECIDED),
        # one draw, printed as 8.0: from 7.95 to 8.05
        (found(5.0, (2.0, 7.96), **RUNS), claim("drawn"), Verdict.LIKE_OURS),
        (found(5.0, (2.0, 7.94), **RUNS), claim("drawn"), NOT_REPRODUCED),
        (found(9.0, (8.04, 16.03), **RUNS), claim("drawn"), Verdict.LIKE_OURS),
        (found(8.0, (0.01, 8.0), **RUNS), claim("drawn"), Verdict.LIKE_OURS),  # narrower by a bit
        (found(8.0, (8.0, 16.0), **RUNS), claim("drawn"), NOT_DECIDED),  # holds twice the number
        (found(8.0, (0.0, 8.0), **RUNS), claim("drawn"), NOT_DECIDED),  # holds zero
        (found(8.0, (-4.0, 9.0), **RUNS), claim("drawn"), NOT_DECIDED),
        (found(-8.0, (-9.0, -2.0), **RUNS), claim("drawn", value="-8.0"), Verdict.LIKE_OURS),
        (found(-8.0, (-9.0, 0.5), **RUNS), claim("drawn", value="-8.0"), NOT_DECIDED),
        (found(0.0, (-0.1, 0.1), **RUNS), claim("drawn", value="0.0"), NOT_DECIDED),
        (found(9.0, (8.06, 90.0), **RUNS), claim("drawn"), NOT_REPRODUCED),
        (found(5.0, (2.0, 90.0), role="calibrated", **RUNS), claim("drawn"), Verdict.CALIBRATED),
        (found(7.0), claim("exactly 7", value=None), REPRODUCED),
        (found(7.0, role="input"), claim(), Verdict.INPUT),
        (found(9.0, role="input"), claim(), Verdict.INPUT),
        (found(10.0, role="input"), claim(), Verdict.UNTESTABLE),
        (found(80.0, role="calibrated"), claim(), Verdict.CALIBRATED),
    ],
)
def test_the_verdict_is_by_what_decides_it(results: Results, on: Claim, verdict: Verdict) -> None:
    (judged,) = verdicts([on], [results])
    assert judged.verdict is verdict
    assert judged.cell == "ch02-007"
    assert judged.as_json()["verdict"] == str(verdict)


@pytest.mark.parametrize(
    ("results", "words"),
    [
        (found(), "reproduced under a stated assumption"),
        (found(9.2), "not reproduced under a stated assumption"),
        (found(**PRINTED), "adds up in print under a stated assumption"),
        (found(**ALGEBRA), "identity under a stated assumption"),
        (found(9.2, **PRINTED), "contradicted by the paper itself under a stated assumption"),
        (found(8.0, WIDE), "not decided under a stated assumption"),
        (found(role="input"), "taken as input"),
        (found(10.0, role="input"), "cannot be tested"),
        (found(role="calibrated"), "calibrated"),
    ],
)
def test_an_assumption_shows_whatever_the_verdict(results: Results, words: str) -> None:
    bare, assumed = verdicts([claim(), claim(assumption=SO)], [results])
    assert (bare.verdict, assumed.verdict) == (assumed.verdict, bare.verdict)
    assert (bare.words, assumed.words) == (words.removesuffix(" under a stated assumption"), words)
    assert assumed.as_json()["verdict"] == assumed.row()["verdict"] == words
    assert count_verdicts([assumed, bare, assumed]).get(words) == 2 + (bare.words == words)


def test_a_draw_says_how_wide_the_runs_are_and_needs_them() -> None:
    (judged,) = verdicts([claim("drawn")], [found(5.0, (2.0, 18.0), **RUNS)])
    assert "interval of 95 % of ours, whose width is 2 times the printed" in judged.reason
    assert "decides nothing" in judged.reason
    for other in (found(8.0), found(8.0, (7.0, 9.0))):  # none, and a confidence interval
        with pytest.raises(InswsnError, match=r"P1-T2-x is of one draw, and x has no interval"):
            verdicts([claim("drawn")], [other])


@given(st.integers(-90, 90), st.integers(-90, 90).filter(bool), st.integers(0, 200))
def test_what_is_like_a_run_is_told_from_nothing_and_from_twice(
    low: int, printed: int, width: int
) -> None:
    runs = found(float(low), (float(low), float(low + width)), **RUNS)
    (judged,) = verdicts([claim("drawn", value=str(printed))], [runs])
    holds = low <= printed <= low + width
    assert (judged.verdict is NOT_REPRODUCED) is not holds
    if judged.verdict is Verdict.LIKE_OURS:
        assert not low <= 0 <= low + width
        assert not low <= 2 * printed <= low + width


@pytest.mark.parametrize(
    ("held", "behind"),
    [("", ""), ("y", ""), ("yy", ""), ("nn", ""),
     ("yn", ", flips with the reading (holds in 1 of 2)"),
     ("nyy", ", flips with the reading (holds in 2 of 3)")],
)  # fmt: skip
def test_a_verdict_tells_in_how_many_readings_it_holds(held: str, behind: str) -> None:
    (judged,) = verdicts([claim()], [found()])
    read = tuple(Read(f"reading {i}", "so or so", mark == "y") for i, mark in enumerate(held))
    judged = replace(judged, readings=read)
    assert judged.label == "reproduced" + behind
    assert judged.as_json()["flips"] is bool(behind)
    expected = [held.count("y"), len(held)] if held else None
    assert judged.as_json()["holds_in"] == expected


def test_what_was_put_in_is_outside_the_headline_counts() -> None:
    assert [v for v in Verdict if not v.counts] == [Verdict.INPUT, Verdict.CALIBRATED]
    judged = verdicts([claim()], [found(role="input")]) + verdicts([claim()], [found()])
    assert count_verdicts(judged) == {REPRODUCED: 1, Verdict.INPUT: 1}


def test_what_needs_what_is_missing_cannot_be_tested() -> None:
    check = MissingCheck(needs=("table",), reasons=("The table is lost.",))
    (judged,) = verdicts([claim(None, check=check)], [])
    assert (judged.verdict, judged.reason) == (Verdict.UNTESTABLE, "The table is lost.")
    assert judged.as_json()["rebuilt"] is None


@pytest.mark.parametrize(
    ("on", "results", "said"),
    [
        (claim(), [], "decided by chapter 02, of which there are no results"),
        (claim(), [found(), found(9.0)], "two results of chapter 02"),
        (claim(check=QuantityCheck(chapter="02", quantity="y")), [found()],
         "decided by the quantity y, which chapter 02 does not record"),
        (claim(unit="km"), [found()], "is in km, and x in m"),
        (claim("within size"), [found()], "the parameter size of chapter 02, which is None"),
        (claim("within word"), [found()], "the parameter word of chapter 02, which is 'w'"),
    ],
)  # fmt: skip
def test_a_check_that_does_not_resolve(on: Claim, results: list[Results], said: str) -> None:
    with pytest.raises(InswsnError, match=said):
        verdicts([on], results)


# In words ----------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("on", "text"),
    [
        (claim("digits"), "8.0 (7.95 to 8.05) m"),
        (claim("drawn"), "8.0 m is within 95 % of the runs, and these span less than it"),
        (claim(), "8.0 ± 1 m"),
        (claim("within 10 %"), "8.0 ± 0.8 m"),
        (claim("within 0"), "8.0 ± 0 m"),
        (claim("at most 1", value=None), "at most 1 m"),
        (claim("at least 1"), "at least 1 m"),
        (claim("exactly 8", value=None), "exactly 8 m"),
    ],
)
def test_what_a_claim_stands_for_is_written(on: Claim, text: str) -> None:
    runs = found(8.0, (8.0, 8.0), **RUNS)
    assert verdicts([on], [runs])[0].published_text == text


@pytest.mark.parametrize(
    ("results", "text"),
    [
        (found(8.0, WIDE), "8.0 (7.0 to 9.4)"),
        (found(8.0, (7.99, 8.0123)), "8.000 (7.990 to 8.012)"),
        (found(1.0, (0.9999999991, 1.0000000012)), "1 (0.9999999991 to 1.0000000012)"),
        (found(1e-9, (0.9512e-9, 1.0534e-9)), "1e-09 (9.51e-10 to 1.05e-09)"),
        (found(8.123456789), "8.12346"),
        (found(-1234567.0), "-1.23457e+06"),
        (found(1.7956e-16), "1.8e-16"),
    ],
)
def test_findings_are_written_to_the_digits_of_intervals(results: Results, text: str) -> None:
    (judged,) = verdicts([claim("at most 8")], [results])
    assert judged.rebuilt_text == f"{text} m"
