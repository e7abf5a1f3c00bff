"""Verdicts on made results: every rule, its edges, and what cannot be typed."""

from __future__ import annotations

import math
from typing import Any

import pytest
from hypothesis import given, strategies as st
from inswsn_book.ledger import Claim, MissingCheck, QuantityCheck
from inswsn_book.results import Quantity, Results
from inswsn_book.verdicts import (
    Verdict,
    count_verdicts,
    judge_own_cells,
    judge_rebuilt,
    verdicts,
)

from inswsn_lib.errors import InswsnError

ends = st.tuples(st.integers(-9, 9), st.integers(-9, 9)).map(sorted)


@given(ends, ends)
def test_reproduced_exactly_when_some_number_lies_in_both(a: list[int], b: list[int]) -> None:
    common = set(range(a[0], a[1] + 1)) & set(range(b[0], b[1] + 1))
    verdict = judge_own_cells((a[0], a[1]), (b[0], b[1]))
    assert (verdict is Verdict.REPRODUCED) == bool(common)
    assert verdict in (Verdict.REPRODUCED, Verdict.CONTRADICTED)


@pytest.mark.parametrize("rebuilt", [(float("nan"), 1.0), (0.0, float("nan"))])
def test_what_is_not_a_number_reproduces_nothing(rebuilt: tuple[float, float]) -> None:
    assert judge_own_cells(rebuilt, (0.0, 1.0)) is Verdict.CONTRADICTED


INF = math.inf


@pytest.mark.parametrize(
    ("value", "rebuilt", "published", "reference", "verdict"),
    [
        # published 8 within 1, a quarter of it is 2
        (8.0, (7.5, 8.5), (7, 9), 8, Verdict.REPRODUCED),
        (8.0, (8.0, 8.0), (7, 9), 8, Verdict.REPRODUCED),
        (10.0, (9.1, 11.0), (7, 9), 8, Verdict.NOT_REPRODUCED),
        (3.0, (1.0, 6.9), (7, 9), 8, Verdict.NOT_REPRODUCED),  # wide, and all of it outside
        (8.5, (7.5, 9.5), (7, 9), 8, Verdict.REPRODUCED),  # as wide as a quarter: the value decides
        (9.4, (8.4, 10.4), (7, 9), 8, Verdict.NOT_REPRODUCED),
        (8.5, (7.48, 9.5), (7, 9), 8, Verdict.NOT_DECIDED),  # wider than a quarter, by a hundredth
        (9.4, (8.3, 10.4), (7, 9), 8, Verdict.NOT_DECIDED),
        (8.0, (6.0, 10.0), (7, 9), 8, Verdict.NOT_DECIDED),  # holds all of the tolerance
        (8.0, (6.0, 10.0), (4, 12), 8, Verdict.REPRODUCED),  # wide, and all of it inside
        (-8.5, (-9.6, -7.4), (-9, -7), -8, Verdict.NOT_DECIDED),  # a negative number has a size too
        # one-sided: at most 1
        (0.5, (0.2, 0.9), (-INF, 1), 1, Verdict.REPRODUCED),
        (1.5, (1.2, 1.9), (-INF, 1), 1, Verdict.NOT_REPRODUCED),
        (0.95, (0.9, 1.1), (-INF, 1), 1, Verdict.REPRODUCED),
        (0.9, (0.8, 1.1), (-INF, 1), 1, Verdict.NOT_DECIDED),
        # a published zero has no quarter
        (0.0, (-0.1, 0.2), (-0.1, 0.1), 0, Verdict.NOT_DECIDED),
        (0.05, (0.0, 0.1), (-0.1, 0.1), 0, Verdict.REPRODUCED),
        # what is not a number decides nothing
        (math.nan, (math.nan, math.nan), (7, 9), 8, Verdict.NOT_DECIDED),
        (8.5, (7.5, 9.5), (7, 9), math.nan, Verdict.NOT_DECIDED),
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


number = st.floats(-100, 100, allow_subnormal=False)


@given(st.tuples(number, number, number).map(sorted), st.tuples(number, number).map(sorted), number)
def test_no_verdict_goes_against_a_whole_interval(
    rebuilt: list[float], published: list[float], reference: float
) -> None:
    low, value, high = rebuilt
    verdict, reason = judge_rebuilt(value, (low, high), (published[0], published[1]), reference)
    inside = published[0] <= low and high <= published[1]
    outside = high < published[0] or published[1] < low
    assert (not inside) or verdict is Verdict.REPRODUCED
    assert (not outside) or verdict is Verdict.NOT_REPRODUCED
    if verdict is Verdict.NOT_DECIDED:
        assert high - low > 0.25 * abs(reference)
    assert reason.endswith(".")


@given(st.tuples(number, number, number).map(sorted), st.tuples(number, number).map(sorted), number,
       st.floats(1e-3, 1e3))  # fmt: skip
def test_a_change_of_unit_changes_no_verdict(
    rebuilt: list[float], published: list[float], reference: float, factor: float
) -> None:
    power = 2.0 ** round(math.log2(factor))  # exact in floating point
    low, value, high = rebuilt
    a = judge_rebuilt(value, (low, high), (published[0], published[1]), reference)
    low, value, high, first, last = (power * x for x in (*rebuilt, *published))
    assert judge_rebuilt(value, (low, high), (first, last), power * reference) == a


def found(value: float = 8.0, **changes: Any) -> Results:
    fields: dict[str, Any] = {
        "name": "x",
        "value": value,
        "unit": "m",
        "basis": "simulation",
        "how": "Made for a test.",
        "tolerance": 0.0,
    }
    quantity = Quantity(**(fields | changes))
    return Results(
        chapter="02", parameters={"width": 0.5, "word": "w"}, data={}, quantities=(quantity,),
        cells={"x": "ch02-007"},
    )  # fmt: skip


def claim(**changes: Any) -> Claim:
    fields: dict[str, Any] = {
        "id": "P1-T2-x",
        "paper": "P1",
        "place": "Table 2",
        "says": "It is 8 m.",
        "value": "8.0",
        "unit": "m",
        "kind": "numeric",
        "check": QuantityCheck(chapter="02", quantity="x"),
        "tolerance": "within 1",
        "why": "For a test.",
    }
    return Claim(**(fields | changes))


interval = {"interval": (7.0, 9.4), "interval_kind": "confidence 95 %", "runs": 100}


@pytest.mark.parametrize(
    ("results", "changes", "verdict"),
    [
        (found(), {}, Verdict.REPRODUCED),
        (found(), {"assumption": "That it is so."}, Verdict.ASSUMED),
        (found(9.2), {}, Verdict.NOT_REPRODUCED),
        (found(9.2), {"assumption": "That it is so."}, Verdict.NOT_REPRODUCED),
        (found(**interval), {}, Verdict.NOT_DECIDED),
        (found(**interval), {"tolerance": "within 20 %"}, Verdict.REPRODUCED),
        (found(8.4), {"tolerance": "within width"}, Verdict.REPRODUCED),
        (found(8.6), {"tolerance": "within width"}, Verdict.NOT_REPRODUCED),
        (found(8.04), {"tolerance": "digits"}, Verdict.REPRODUCED),
        (found(8.06), {"tolerance": "digits"}, Verdict.NOT_REPRODUCED),
        (found(8.06, basis="printed"), {"tolerance": "digits"}, Verdict.CONTRADICTED),
        (found(7.0, basis="printed"), {"tolerance": "at least 7"}, Verdict.REPRODUCED),
        (
            found(8.0, basis="printed", interval=(7.0, 9.0), interval_kind="rounding"),
            {},
            Verdict.REPRODUCED,
        ),
        (
            found(8.0, basis="printed", interval=(6.9, 9.0), interval_kind="rounding"),
            {},
            Verdict.NOT_DECIDED,
        ),
        (
            found(80.0, basis="printed", interval=(9.1, 99.0), interval_kind="rounding"),
            {},
            Verdict.CONTRADICTED,
        ),
        (found(9.0, basis="recorded"), {"tolerance": "at most 8.5"}, Verdict.NOT_REPRODUCED),
        (found(7.0), {"tolerance": "exactly 7", "value": None}, Verdict.REPRODUCED),
        (found(8.0, role="input"), {}, Verdict.INPUT),
        (found(10.0, role="input"), {}, Verdict.UNTESTABLE),
        (found(8.0, role="calibrated"), {}, Verdict.CALIBRATED),
        (found(80.0, role="calibrated"), {}, Verdict.CALIBRATED),
    ],
)
def test_the_verdict_follows_from_what_decides_it(
    results: Results, changes: dict[str, Any], verdict: Verdict
) -> None:
    (judged,) = verdicts([claim(**changes)], [results])
    assert judged.verdict is verdict
    assert judged.cell == "ch02-007"
    assert judged.as_json()["verdict"] == str(verdict)


def test_what_was_put_in_is_outside_the_headline_counts() -> None:
    assert [verdict for verdict in Verdict if not verdict.counts] == [
        Verdict.INPUT,
        Verdict.CALIBRATED,
    ]
    judged = verdicts([claim()], [found(role="input")]) + verdicts([claim()], [found()])
    assert count_verdicts(judged) == {Verdict.REPRODUCED: 1, Verdict.INPUT: 1}


def test_what_needs_what_is_missing_cannot_be_tested() -> None:
    check = MissingCheck(needs=("table",), reasons=("The table is lost.",))
    (judged,) = verdicts([claim(check=check, tolerance=None)], [])
    assert (judged.verdict, judged.reason) == (Verdict.UNTESTABLE, "The table is lost.")
    assert judged.as_json()["rebuilt"] is None


@pytest.mark.parametrize(
    ("changes", "results", "said"),
    [
        ({}, [], "decided by chapter 02, of which there are no results"),
        (
            {"check": QuantityCheck(chapter="02", quantity="y")},
            [found()],
            "decided by the quantity y, which chapter 02 does not record",
        ),
        ({"unit": "km"}, [found()], "is in km, and x in m"),
        (
            {"tolerance": "within size"},
            [found()],
            "the parameter size of chapter 02, which is None",
        ),
        ({"tolerance": "within word"}, [found()], "the parameter word of chapter 02, which is 'w'"),
    ],
)
def test_a_check_that_does_not_resolve(
    changes: dict[str, Any], results: list[Results], said: str
) -> None:
    with pytest.raises(InswsnError, match=said):
        verdicts([claim(**changes)], results)


@pytest.mark.parametrize(
    ("changes", "text"),
    [
        ({"tolerance": "digits"}, "8.0 (7.95 to 8.05) m"),
        ({}, "8.0 ± 1 m"),
        ({"tolerance": "within 10 %"}, "8.0 ± 0.8 m"),
        ({"tolerance": "at most 1", "value": None}, "at most 1 m"),
        ({"tolerance": "at least 1"}, "at least 1 m"),
        ({"tolerance": "within 0"}, "8.0 ± 0 m"),
        ({"tolerance": "exactly 8", "value": None}, "exactly 8 m"),
    ],
)
def test_what_a_claim_stands_for_is_written(changes: dict[str, Any], text: str) -> None:
    (judged,) = verdicts([claim(**changes)], [found()])
    assert judged.published_text == text


def test_two_results_of_one_chapter_are_refused() -> None:
    with pytest.raises(InswsnError, match="two results of chapter 02"):
        verdicts([claim()], [found(), found(9.0)])


def test_small_numbers_keep_their_digits() -> None:
    tiny = {"interval": (0.95e-9, 1.05e-9), "interval_kind": "rounding"}
    (judged,) = verdicts([claim(tolerance="at most 8")], [found(1e-9, **tiny)])
    assert judged.rebuilt_text == "1e-09 (9.5e-10 to 1.05e-09) m"


def test_what_was_found_is_written_to_the_digits_of_its_interval() -> None:
    (judged,) = verdicts([claim()], [found(**interval)])
    assert judged.rebuilt_text == "8.0 (7.0 to 9.4) m"
    narrow = interval | {"interval": (7.99, 8.0123)}
    (judged,) = verdicts([claim()], [found(**narrow)])
    assert judged.rebuilt_text == "8.000 (7.990 to 8.012) m"
    (judged,) = verdicts([claim()], [found(8.123456789)])
    assert judged.rebuilt_text == "8.12346 m"
    for value, text in ((-0.5, "-0.5"), (-1234567.0, "-1.23457e+06"), (1.7956e-16, "1.8e-16")):
        (judged,) = verdicts([claim()], [found(value)])
        assert judged.rebuilt_text == f"{text} m"
    (judged,) = verdicts(
        [claim()], [found(**(interval | {"value": 1.0, "interval": (0.9999999991, 1.0000000012)}))]
    )
    assert judged.rebuilt_text == "1 (0.9999999991 to 1.0000000012) m"
