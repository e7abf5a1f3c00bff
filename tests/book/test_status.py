"""The page of the build's state, on results made by hand."""

from __future__ import annotations

import re

from inswsn_book.ledger import Claim, MissingCheck, QuantityCheck
from inswsn_book.results import Provenance, Quantity, Results
from inswsn_book.status import status_text
from inswsn_book.verdicts import Judged, Verdict

NAMES = {"00": "00-one", "01": "01-two"}


def made(seconds: float, **changes: object) -> Provenance:
    fields = {
        "version": "1.0.0",
        "commit": "0123456789abcdef" + 24 * "0",
        "clean": True,
        "sources": {},
        "finished": "2026-11-22 06:00 UTC",
        "seconds": seconds,
        "python": "3.11.7",
        "system": "Linux x86_64",
        "cpu": "A processor",
        "cores": 2,
        "blas": ("openblas 1, 1 thread",),
        "packages": {"numpy": "2.4.0"},
    }
    return Provenance.model_validate(fields | changes)


def results(
    chapter: str, quantities: int, sentences: dict[str, bool], ran: Provenance | None
) -> Results:
    recorded = tuple(
        Quantity(
            name=f"q{i}", value=1.0, unit="m", basis="printed", how="Made by hand.", tolerance=0
        )
        for i in range(quantities)
    )
    return Results(
        chapter=chapter,
        parameters={},
        data={},
        quantities=recorded,
        sentences=sentences,
        provenance=ran,
    )


def judged(number: int, chapter: str | None, verdict: Verdict) -> Judged:
    check: QuantityCheck | MissingCheck
    if chapter is None:
        check = MissingCheck(needs=("lost",), reasons=("It is lost.",))
    else:
        check = QuantityCheck(chapter=chapter, quantity="q0")
    claim = Claim.model_construct(
        id=f"P1-{number}", paper="P1", place="", says="", kind="numeric", check=check, why=""
    )
    return Judged(claim, verdict, "")


def rows(text: str, name: str) -> list[list[str]]:
    """Read one table back, by its label, as rows of cells."""
    tables = re.findall(r"^:::::\{list-table\}(.*?)^:::::$", text, re.M | re.S)
    (table,) = (part for part in tables if f":name: {name}\n" in part)
    return [
        [cell[4:].strip().replace("\N{NO-BREAK SPACE}", " ") for cell in row.splitlines()]
        for row in re.split(r"^(?=\* -)", table.split("\n\n", 1)[1], flags=re.M)
        if row.strip()
    ]


JUDGED = [
    judged(1, "00", Verdict.REPRODUCED),
    judged(2, "00", Verdict.REPRODUCED),
    judged(3, "01", Verdict.NOT_REPRODUCED),
    judged(4, None, Verdict.UNTESTABLE),
]


def test_the_runs_and_their_sums() -> None:
    text = status_text(
        [
            results("00", 3, {"a": True, "b": True}, made(61.5)),
            results("01", 2, {"c": True, "d": False}, made(63.5, clean=False)),
        ],
        JUDGED,
        NAMES,
    )
    header, first, second, total = rows(text, "tbl-runs")
    assert header[0] == "chapter"
    assert first == [
        "{doc}`00 <chapters/00-one>`",
        "61.5 s",
        "2026-11-22 06:00 UTC",
        "`0123456789ab`",
        "3",
        "2 of 2",
        "2",
    ]
    assert second[3:] == ["`0123456789ab`, with changes", "2", "1 of 2", "1"]
    assert total == ["all", "2 min 5 s", "", "", "5", "3 of 4", "3"]


def test_a_run_that_is_unknown() -> None:
    ran = [results("00", 1, {}, None), results("01", 1, {}, made(2, commit=None, clean=None))]
    _, first, second, total = rows(status_text(ran, [], NAMES), "tbl-runs")
    assert first[1:4] == ["unknown", "unknown", "unknown"]
    assert second[3] == "unknown"
    assert total[1] == "2 s"


def test_the_verdicts_of_each_chapter() -> None:
    ran = [results("00", 1, {}, made(1)), results("01", 1, {}, made(1))]
    header, *body = rows(status_text(ran, JUDGED, NAMES), "tbl-verdicts")
    assert header == ["verdict", "00", "01", "in no chapter", "all"]
    table = {row[0]: row[1:] for row in body}
    assert table["reproduced"] == ["2", "0", "0", "2"]
    assert table["not reproduced"] == ["0", "1", "0", "1"]
    assert table["cannot be tested"] == ["0", "0", "1", "1"]
    assert table["all"] == ["2", "1", "1", "4"]
    assert set(table) == {str(verdict) for verdict in Verdict} | {"all"}


def test_a_machine_is_named_once() -> None:
    same = [results("00", 1, {}, made(1)), results("01", 1, {}, made(9))]
    _, *machines = rows(status_text(same, [], NAMES), "tbl-machines")
    assert machines == [
        [
            "00, 01",
            "A processor, 2 cores, Linux x86_64",
            "openblas 1, 1 thread",
            "Python 3.11.7, numpy 2.4.0",
        ]
    ]
    other = [same[0], results("01", 1, {}, made(1, cores=8))]
    _, *machines = rows(status_text(other, [], NAMES), "tbl-machines")
    assert [row[0] for row in machines] == ["00", "01"]
