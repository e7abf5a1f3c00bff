"""Verdicts, the scoreboard, and the comparison of two results files."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from inswsn_lib.claims import (
    Quantity,
    Results,
    Scoreboard,
    Verdict,
    compare,
    compare_conditions,
    judge_own_cells,
)

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


def test_the_scoreboard_keeps_order_and_counts() -> None:
    board = Scoreboard()
    board.judge("P1", "Table 1", "first", published=(1, 1), rebuilt=(1, 1), unit="", digits=0)
    board.judge("P2", "Sec. 4", "second", published=(0, 1), rebuilt=(4.6, 8.333), digits=2)
    assert board.count(Verdict.REPRODUCED) == board.count(Verdict.CONTRADICTED) == 1
    assert board.statements[0].cells() == ("P1", "Table 1", "first", "1", "1", "reproduced")
    assert board.statements[1].cells()[3:] == (
        "0.00 to 1.00 %",
        "4.60 to 8.33 %",
        "contradicted by the paper itself",
    )


def results(**values: float) -> Results:
    return Results(
        chapter="00",
        parameters={},
        data={},
        quantities=tuple(
            Quantity(
                name=name, value=value, unit="m", basis="printed", how="For a test.", tolerance=0.1
            )
            for name, value in values.items()
        ),
    )


def test_compare_names_every_change_and_only_those() -> None:
    before, after = (
        results(same=1.0, near=1.0, far=1.0, gone=1.0),
        results(same=1.0, near=1.05, far=1.2, new=1.0),
    )
    changes = {change.name: change for change in compare(before, after)}
    assert list(changes) == ["near", "far", "gone", "new"]
    assert {name: change.beyond_tolerance for name, change in changes.items()} == {
        "near": False,
        "far": True,
        "new": True,
        "gone": True,
    }
    assert str(changes["far"]) == "far: 1 m -> 1.2 m (change +0.2, tolerance 0.1)"
    assert str(changes["gone"]) == "gone: 1 m -> absent"
    assert compare(before, before) == []


@pytest.mark.parametrize(
    ("changes", "beyond"),
    [
        ({"unit": "km"}, True),
        ({"runs": 2}, True),
        ({"basis": "recorded"}, True),
        ({"interval": (0.95, 1.05)}, False),
        ({"interval": (0.5, 1.0)}, True),
        ({"interval": None, "interval_kind": None}, True),
        ({"how": "Otherwise, for a test."}, False),
    ],
)
def test_what_is_beyond_tolerance(changes: dict[str, object], beyond: bool) -> None:
    (quantity,) = results(x=1.0).quantities
    fields = quantity.model_dump() | {"interval": (1.0, 1.0), "interval_kind": "rounding"}
    before = results().model_copy(update={"quantities": (Quantity(**fields),)})
    after = results().model_copy(update={"quantities": (Quantity(**(fields | changes)),)})
    (change,) = compare(before, after)
    assert change.beyond_tolerance is beyond
    (field, *_) = changes
    assert field in str(change) or field == "unit"


def test_conditions_that_differ_are_named() -> None:
    before = results().model_copy(update={"parameters": {"a": 1}, "sentences": {"So.": True}})
    after = results().model_copy(update={"parameters": {"a": 2}, "data": {"data/x": "0" * 64}})
    assert compare_conditions(before, after) == [
        "parameters: a: 1 -> 2",
        f"data: data/x: absent -> {'0' * 64}",
        "sentences: So.: True -> absent",
    ]
    assert compare_conditions(before, before) == []
