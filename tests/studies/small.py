"""A small list of assumptions and studies of it, for tests of the studies."""

from __future__ import annotations

from typing import Any

from study import Made, Run, Study


def _entry(name: str, **fields: Any) -> dict[str, Any]:
    said = {"unsaid": "It.", "place": "Section 1", "bounds": "Nothing.", "why": "So it is."}
    return {"id": name, "paper": name[:2]} | said | fields


def _alternative(name: str, scale: float) -> dict[str, Any]:
    return {
        "id": name, "set": f"{scale:g}", "why": "More.", "chapters": ["00"],
        "parameters": {"00": {"scale": scale}},
    }  # fmt: skip


SMALL: dict[str, Any] = {
    "headlines": [
        {"chapter": "00", "quantity": "twice", "short": "twice", "says": "twice it", "turns": 50},
        {"chapter": "00", "quantity": "twice", "over": "half", "short": "four", "says": "ratio"},
    ],
    "reduced": {"00": {"parameters": {}, "seeds": [1, 2]}},
    "printed": {"00": {}},
    "assumptions": [
        _entry(
            "P1-M-scale",
            chosen=[{"chapter": "00", "parameter": "scale"}],
            alternatives=[_alternative("three", 3.0), _alternative("ten", 10.0)],
            within=[{"chapter": "00", "reading": "half", "headline": "twice", "quantity": "half"}],
        ),
        _entry("P2-M-word", chosen=[{"text": "This word."}], varied="It cannot be."),
        _entry("P1-M-seed", chosen=[{"text": "Any."}], seeds=["00"]),
    ],
}


def run(identity: str, twice: float | None = None, **fields: Any) -> Run:
    """Return a run of chapter 00 with a value of its headline."""
    found = {} if twice is None else {"twice": twice, "twice/half": 4.0}
    made = {"chapter": "00", "parameters": {}, "headlines": found, "seconds": 1.0, "key": "0" * 64}
    return Run(id=identity, **made | fields)


def study(*runs: Run) -> Study:
    """Return a study of these runs."""
    made = Made(
        version="1.0.0", day="2026-11-22", commit=None, clean=None, sources={}, recorded=False,
        python="3.11", system="Linux", cpu="one", packages={},
    )  # fmt: skip
    return Study(made=made, runs=runs)
