"""The comparison of two results files: quantities, conditions, verdicts."""

from __future__ import annotations

import pytest
from inswsn_book.compare import (
    Change,
    compare_conditions,
    comparison,
    flipped_verdicts,
    pair_quantities,
)
from inswsn_book.ledger import Claim, QuantityCheck
from inswsn_book.results import Quantity, Results


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


def compare(before: Results, after: Results) -> list[Change]:
    return [pair for pair in pair_quantities(before, after) if pair.before != pair.after]


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
        ({"role": "input"}, True),
        ({"tolerance": 1e9}, True),
        ({"tolerance": 0.11}, True),
        ({"tolerance": 0.1 * (1 + 1e-12)}, False),
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


def claim(quantity: str, value: str = "1.0") -> Claim:
    return Claim(
        id=f"P1-{quantity}", paper="P1", place="Table 1", says="For a test.", value=value,
        unit="m", kind="numeric", check=QuantityCheck(chapter="00", quantity=quantity),
        tolerance="within 0.1", why="For a test.",
    )  # fmt: skip


def test_flipped_verdicts_and_only_those() -> None:
    claims = [claim("same"), claim("moved"), claim("gone"), claim("new"), claim("never")]
    flips = flipped_verdicts(
        claims, results(same=1.0, moved=1.0, gone=1.0), results(same=1.05, moved=1.2, new=9.0)
    )
    assert [claim.id for claim, _, _ in flips] == ["P1-moved", "P1-gone", "P1-new"]
    assert [old and str(old.verdict) for _, old, _ in flips] == ["reproduced", "reproduced", None]
    lines = comparison(results(gone=1.0), results(new=9.0), claims)
    assert "verdict P1-gone: reproduced -> without a verdict" in lines
    assert lines[-2].startswith(
        "verdict P1-new: without a verdict -> contradicted by the paper itself (No "
    )


def test_results_of_two_versions_of_a_chapter_are_compared() -> None:
    old = results(x=1.0)
    new = results(x=1.0, y=2.0).model_copy(
        update={"cells": {"x": "ch00-001"}, "solvers": {"HiGHS": "optimal"}}
    )
    assert [change.name for change in compare(old, new)] == ["y"]
    assert compare_conditions(old, new) == [
        "solvers: HiGHS: absent -> optimal",
        "cells: x: absent -> ch00-001",
    ]
    assert flipped_verdicts([claim("x")], old, new) == []
