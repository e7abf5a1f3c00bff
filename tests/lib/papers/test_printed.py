"""Printed numbers: the intervals against exact rational arithmetic."""

from __future__ import annotations

from collections.abc import Callable
from decimal import ROUND_HALF_EVEN, Decimal
from fractions import Fraction

import pytest
from hypothesis import given, strategies as st

from inswsn_lib.errors import ParameterError
from inswsn_lib.papers import (
    about,
    admits,
    bounds,
    derive,
    intersects,
    interval,
    mean,
    meet,
    reduction,
    span,
)

decimals = st.builds(
    lambda digits, places, sign: f"{sign * Decimal(digits).scaleb(-places):f}",
    st.integers(0, 10**6),
    st.integers(0, 5),
    st.sampled_from([1, -1]),
)


@pytest.mark.parametrize(
    ("text", "low", "high"),
    [
        ("0.1452", 0.14515, 0.14525),
        ("0.0900", 0.08995, 0.09005),
        ("85", 84.5, 85.5),
        ("-3.5", -3.55, -3.45),
        ("1e2", 99.5, 100.5),
    ],
)
def test_interval_is_half_a_unit_of_the_last_digit_either_side(
    text: str, low: float, high: float
) -> None:
    assert bounds(interval(text)) == pytest.approx((low, high), abs=1e-15)


@given(decimals, st.fractions(-1, 1))
def test_a_value_in_the_interval_rounds_to_the_text_and_one_outside_does_not(
    text: str, place: Fraction
) -> None:
    places = len(text.partition(".")[2])
    half = Fraction(1, 2 * 10**places)
    inside = Fraction(text) + place * half * Fraction(999, 1000)
    rounded = (Decimal(inside.numerator) / Decimal(inside.denominator)).quantize(
        Decimal(1).scaleb(-places), rounding=ROUND_HALF_EVEN
    )
    assert Fraction(rounded) == Fraction(text)
    low, high = bounds(interval(text))
    assert low <= inside <= high
    assert not low <= Fraction(text) + half * Fraction(1001, 1000) <= high


@given(decimals, decimals)
def test_interval_arithmetic_holds_the_exact_result(a: str, b: str) -> None:
    exact = (Fraction(a) + Fraction(b)) / 2
    low, high = bounds(mean(interval(a), interval(b)))
    assert low <= exact <= high
    assert derive(mean, a, b).value == pytest.approx(float(exact), rel=1e-12, abs=1e-12)


def test_reduction_by_hand() -> None:
    found = derive(reduction, "1.0", "4.0")
    assert found.value == pytest.approx(75.0)
    # 100 (1 - 1.05/3.95) and 100 (1 - 0.95/4.05)
    assert found.limits == pytest.approx((73.41772151898734, 76.5432098765432))


def test_what_intervals_have_in_common() -> None:
    assert bounds(about("85", 2.5)) == (82.5, 87.5)
    assert bounds(about("85", 0)) == (85.0, 85.0)
    assert admits(span(0.10, 0.15), "0.2")
    assert not admits(span(0.10, 0.1499), "0.2")
    assert admits(span(0.25, 0.3), "0.2")
    assert not admits(span(0.2501, 0.3), "0.2")
    assert intersects(span(0, 1), span(1, 2))
    assert not intersects(span(0, 1), span(1.1, 2))
    assert not intersects(span(1.1, 2), span(0, 1))
    assert bounds(meet(span(0, 2), span(1, 3))) == bounds(meet(span(1, 3), span(0, 2))) == (1, 2)
    assert bounds(mean(span(0, 1), span(2, 4), span(1, 1))) == (1, 2)


@pytest.mark.parametrize(
    "text",
    ["", "abc", "1,5", "NaN", "inf", None, "1e999", "1e-999999999", "1_0", "٣", " 1", "1.2.3"],
)
def test_what_is_not_a_printed_number(text: str) -> None:
    for read in (interval, lambda text: derive(reduction, text, "1"), lambda text: about(text, 1)):
        with pytest.raises(ParameterError, match=r"^text must be a printed decimal number"):
            read(text)


@pytest.mark.parametrize(
    ("call", "name"),
    [
        (lambda: about("85", -1), "half_width"),
        (lambda: about("85", float("nan")), "half_width"),
        (lambda: reduction(interval("1"), interval("0")), "before"),
        (lambda: reduction(interval("1"), span(0, 1)), "before"),
        (lambda: reduction(interval("1"), span(-1, 0)), "before"),
        (lambda: span(2, 1), "low"),
        (lambda: meet(span(0, 1), span(2, 3)), "y"),
        (mean, "cells"),
    ],
)
def test_a_refusal_names_its_parameter(call: Callable[[], object], name: str) -> None:
    with pytest.raises(ParameterError, match=f"^{name} must be"):
        call()
