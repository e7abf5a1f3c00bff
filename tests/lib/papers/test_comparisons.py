"""Comparisons within a printed table, on a table small enough to check by hand."""

from __future__ import annotations

import pandas as pd
import pytest

from inswsn_lib.papers import (
    AXES,
    COLUMNS,
    about,
    bounds,
    ordered_columns,
    orders_below,
    pooled_reductions,
    reductions,
    supported,
)


@pytest.fixture
def table() -> pd.DataFrame:
    rows = {
        "good": ["1.00", "3.00"] * 4,
        "bad": ["4.00", "6.00"] * 4,
        "worse": ["4.00", "9.00"] * 4,
    }
    return pd.DataFrame.from_dict(rows, orient="index", columns=list(COLUMNS))


def test_columns_are_in_printed_order() -> None:
    assert COLUMNS == ("rx1", "rx2", "ry1", "ry2", "vx1", "vx2", "vy1", "vy2")


def test_reductions_by_hand(table: pd.DataFrame) -> None:
    found = reductions(table, better="good", worse="bad")
    assert found["rx1"].value == pytest.approx(75)
    assert found["vy2"].value == pytest.approx(50)


def test_pooling_sums_before_it_divides(table: pd.DataFrame) -> None:
    low, high = bounds(pooled_reductions(table, "good", "bad", "12")["rx"])
    assert low < 60 < high  # 1 - (1 + 3)/(4 + 6)
    assert high - low < 0.5


def test_supported_counts_agreements(table: pd.DataFrame) -> None:
    stated = {axis: about("75", 2.5) for axis in AXES}
    counts = supported(table, stated, [("good", "bad")])
    assert counts.loc["bad to good"].tolist() == [4, 0, 0]


def test_a_tie_is_not_an_order(table: pd.DataFrame) -> None:
    assert ordered_columns(table, "good", "bad") == list(COLUMNS)
    assert ordered_columns(table, "good", "bad", "worse") == [c for c in COLUMNS if c[2] == "2"]


def test_orders_below_finds_every_order_that_fits() -> None:
    fragments = {"a": ["1.0"], "b": ["5.0", "2.0"]}
    assert orders_below(fragments, ["2.0", "6.0", "3.0"]) == [("a", "b")]
    assert orders_below(fragments, ["9", "9", "9"]) == [("a", "b"), ("b", "a")]
    assert orders_below(fragments, ["1", "1", "1"]) == []
