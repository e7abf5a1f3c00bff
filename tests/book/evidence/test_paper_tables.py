"""A paper's own table in a lesson: computed, or taken from the evidence."""

from __future__ import annotations

from pathlib import Path

import pytest
from conftest import MiniProject
from inswsn_book.lessons.printed import Cell, show_printed
from inswsn_book.record import ChapterRecord
from inswsn_book.record.project import RESULTS_VARIABLE
from inswsn_book.record.results import Quantity

from inswsn_lib.evaluation import Finding

CELLS = [
    Cell("KF, x", "2.9170", "t.kf.x", "f.kf.x", "none"),
    Cell("INS, x", "7.8", "t.ins.x", "the same", "none"),
]
FOUND = {
    "t.kf.x": Finding(0.05, 0.04, 0.06, "m", "Mean absolute error, KF.", "runs 95 %"),
    "f.kf.x": Finding(0.04, 0.03, 0.05, "m", "Mean absolute error, KF tuned.", "runs 95 %"),
    "t.ins.x": Finding(8.0, 8.0, 8.0, "m", "Mean absolute error, INS.", "runs 95 %"),
    "h.share": Finding(49.0, 48.0, 50.0, "%", "One over the other, in all."),
}  # fmt: skip


def shown(
    mini: MiniProject, scale: float, displayed: list, monkeypatch: pytest.MonkeyPatch, folder: Path
) -> tuple[dict[str, Quantity], list[list[str]], int]:
    """Return what is recorded, the cells that are shown, and how often something was computed."""
    monkeypatch.setenv(RESULTS_VARIABLE, str(folder))
    calls = []

    def compute() -> dict[str, Finding]:
        calls.append(scale)
        return FOUND

    def reference(_: ChapterRecord, chapter: str, name: str) -> Quantity:
        assert chapter == "evidence"
        value = 2 * FOUND[name].value
        return Quantity(name=name, value=value, unit="m", how="As published before.",
                        basis="simulation", tolerance=0.1)  # fmt: skip

    monkeypatch.setattr(ChapterRecord, "reference", reference)
    record = ChapterRecord("00", parameters={"scale": scale}, root=mini.root)
    found = show_printed(
        record,
        "evidence",
        CELLS,
        compute,
        by=["scale"],
        name="tbl-a",
        caption="A table.",
        first=["h.share"],
    )
    (table,) = [words["table"] for _, words in displayed if "table" in words]
    return found, table["cells"], len(calls)


def test_with_other_parameters_it_is_computed_once(
    mini: MiniProject, displayed: list, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    found, cells, calls = shown(mini, 1.0, displayed, monkeypatch, tmp_path)
    assert calls == 1
    assert [*found] == ["h.share", "t.kf.x", "f.kf.x", "t.ins.x"]
    assert (found["t.kf.x"].value, found["t.kf.x"].interval) == (0.05, (0.04, 0.06))
    assert cells == [
        ["cell", "printed", "rebuilt", "on equal terms", "recorded"],
        ["KF, x", "2.9170", "0.05 (0.04 to 0.06)", "0.04 (0.03 to 0.05)", "none"],
        ["INS, x", "7.8", "8", "the same", "none"],
    ]


def test_a_long_table_is_folded_and_its_numbers_have_the_digits_asked_for(
    mini: MiniProject, displayed: list, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setenv(RESULTS_VARIABLE, str(tmp_path))
    record = ChapterRecord("00", parameters={"scale": 1.0}, root=mini.root)
    gamma = Finding(4.00551, 4.00551, 4.00551, "1", "Least gamma, area 1.")
    found = show_printed(
        record, "evidence", [Cell("gamma", "4.0055", "g.printed", "one method", "none")],
        lambda: {"g.printed": gamma}, by=["scale"], name="tbl-g", caption="A table.",
        fold="All of it", basis="algebra", digits=5,
    )  # fmt: skip
    (shown,) = [data for data, words in displayed if "table" in words]
    lines = shown["text/markdown"].splitlines()
    assert (lines[0], lines[-1]) == ("````{dropdown} All of it", "````")
    assert "  - 4.0055" in lines
    assert (found["g.printed"].basis, found["g.printed"].interval) == ("algebra", None)


def test_as_published_it_is_what_the_evidence_has(
    mini: MiniProject, displayed: list, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    found, cells, calls = shown(mini, 2.0, displayed, monkeypatch, tmp_path)
    assert calls == 0
    assert found["h.share"].value == 98
    assert cells[1] == ["KF, x", "2.9170", "0.1", "0.08", "none"]
