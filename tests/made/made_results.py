"""A quantity, results and a claim of which a test states only what it is about."""

from __future__ import annotations

from typing import Any

from inswsn_book.judge.ledger import Claim
from inswsn_book.record.results import Quantity, Results


def quantity(name: str = "x", value: float = 1.0, **fields: Any) -> Quantity:
    given = {"unit": "m", "basis": "printed", "how": "For a test.", "tolerance": 0.0}
    return Quantity(name=name, value=value, **given | fields)


def results(*quantities: Quantity, **fields: Any) -> Results:
    given: dict[str, Any] = {"chapter": "00", "parameters": {}, "data": {}}
    return Results(quantities=quantities, **given | fields)


def claim(**fields: Any) -> Claim:
    given = {
        "id": "P1-T2-x", "paper": "P1", "place": "Table 2", "says": "It is 8 m.", "value": "8.0",
        "unit": "m", "kind": "numeric", "check": {"chapter": "00", "quantity": "x"},
        "tolerance": "digits", "why": "For a test.",
    }  # fmt: skip
    return Claim(**given | fields)
