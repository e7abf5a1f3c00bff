"""Readings of a printed column: against columns made in a known way, and against brute force."""

from __future__ import annotations

from itertools import permutations

import pytest
from hypothesis import given, settings, strategies as st

from inswsn_lib.errors import ParameterError
from inswsn_lib.papers import (
    Reading,
    admits,
    chance_assignments,
    interval,
    offset_scores,
    rows_admitted,
    score,
    shifted_mean,
)

cells = st.integers(0, 9999).map(lambda n: f"{n / 1e4:.4f}")


def printed_with_offset(x: list[str], y: list[str], shift: int) -> list[str]:
    """Make a column as a spreadsheet with that slip would: round the mean of exact cells."""
    column = []
    for i, cell in enumerate(x):
        other = float(y[i + shift]) if 0 <= i + shift < len(y) else 0.0
        column.append(f"{(float(cell) + other) / 2:.4f}")
    return column


@settings(max_examples=50)
@given(st.lists(st.tuples(cells, cells), min_size=2, max_size=8), st.integers(-3, 3))
def test_the_offset_that_made_a_column_explains_all_of_it(
    rows: list[tuple[str, str]], shift: int
) -> None:
    x, y = [list(column) for column in zip(*rows, strict=True)]
    shift = max(-len(x) + 1, min(len(x) - 1, shift))
    scores = offset_scores(x, y, printed_with_offset(x, y, shift))
    assert scores[shift] == len(x)
    assert set(scores) == set(range(1 - len(x), len(x)))


def test_a_blank_counts_as_exactly_zero() -> None:
    (last,) = shifted_mean(["0.2903"], ["0.1063"], 1)
    assert admits(last, "0.1452")
    assert not admits(last, "0.1453")


def test_chance_assignments_against_brute_force() -> None:
    x = ["0.10", "0.20", "0.30", "0.40"]
    y = ["0.10", "0.10", "0.12", "0.50"]
    printed = ["0.10", "0.15", "0.21", "0.20"]
    pool = [*y, None]
    admitting = total = 0
    for order in permutations(range(5), 4):
        total += 1
        admitting += all(
            admits((interval(a) + (interval(pool[j]) if pool[j] else 0)) / 2, text)
            for a, j, text in zip(x, order, printed, strict=True)
        )
    assert admitting > 0
    assert chance_assignments(x, y, printed) == (admitting, total)


def test_score_counts_in_the_order_given() -> None:
    readings = [
        Reading("half", lambda: [interval("0.5"), interval("0.5")]),
        Reading("none", lambda: [interval("0.9"), interval("0.9")]),
    ]
    table = score(readings, ["0.5", "0.7"])
    assert table.to_numpy().tolist() == [["half", 1, 2], ["none", 0, 2]]


def test_columns_of_different_length_are_refused() -> None:
    with pytest.raises(ParameterError, match="2 rows"):
        shifted_mean(["0.1", "0.2"], ["0.1"], 0)
    with pytest.raises(ParameterError, match="2 rows"):
        rows_admitted([interval("0.1")], ["0.1", "0.2"])
