"""The record that a chapter keeps."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from conftest import MINI_LEDGER, MiniProject
from inswsn_book.evidence.page import EvidenceRecord
from inswsn_book.judge.ledger import data_digest
from inswsn_book.make.plain import stale_twins
from inswsn_book.record import ChapterRecord
from inswsn_book.record.files import file_digest
from inswsn_book.record.project import RESULTS_VARIABLE
from inswsn_book.record.results import Quantity, Results, read_results

from inswsn_lib.errors import InswsnError

BASE = {"unit": "m", "how": "Computed for a test.", "basis": "printed", "tolerance": 0.0}


@pytest.fixture
def record(mini: MiniProject, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> ChapterRecord:
    monkeypatch.setenv(RESULTS_VARIABLE, str(tmp_path / "results"))
    return ChapterRecord("00", parameters={"scale": 1.0}, root=mini.root)


def add(record: ChapterRecord, name: str = "x", value: float = 1.0, **changes: object) -> None:
    record.quantity(name, value, **BASE | changes)


def test_a_note_has_a_tolerance_that_is_a_share_of_it(record: ChapterRecord) -> None:
    how = "Computed for a test."
    plain = record.note("a", 1234.5, "m", how)
    assert (plain.tolerance, plain.share, plain.slack) == (1e-6, 1e-3, pytest.approx(1.2345))
    assert (plain.basis, plain.interval_kind) == ("simulation", None)
    drawn = record.note("b", np.float64(-2), "m", how, relative=0.1, runs=9, interval=(-3, -1))
    assert (drawn.slack, drawn.runs, drawn.interval_kind) == (0.2, 9, "runs 95 %")
    other = {"kind": "confidence 95 %", "interval": (0, 1), "basis": "recorded", "tolerance": 0.0}
    own = record.note("c", 0.0, "m", how, runs=2, **other)
    assert (own.slack, own.basis, own.interval_kind) == (0.0, "recorded", "confidence 95 %")
    assert record.note("d", 0.0, "m", how, absolute=3e-4).slack == 3e-4


def test_it_writes_what_it_read_and_found(
    record: ChapterRecord, mini: MiniProject, tmp_path: Path, displayed: list
) -> None:
    assert record.data("papers/number.txt") == mini.number
    own = tmp_path / "own.csv"
    own.touch()
    record.data(str(own))
    add(record, "x", 3.0, interval=(0.5, 4.0))
    add(record, "y", basis="simulation", interval=(0.5, 2.0), runs=200)
    record.say("word", "reproduced")
    record.holds("The sky is blue.", np.bool_(True))
    record.holds("The sky is green.", False)
    record.write_file("note.csv", "a,b\n")
    record.solver("HiGHS", "optimal")
    assert record.write() == read_results(tmp_path / "results" / "00.json")
    written = read_results(tmp_path / "results" / "00.json")
    assert written.data == {
        "data/papers/number.txt": file_digest(mini.number), str(own): file_digest(own)
    }  # fmt: skip
    assert (written.parameters, written.solvers) == ({"scale": 1.0}, {"HiGHS": "optimal"})
    assert (written["x"].interval_kind, written["y"].interval_kind, written["y"].runs) == (
        "rounding", "confidence 95 %", 200,
    )  # fmt: skip
    assert written.sentences == {"The sky is blue.": True, "The sky is green.": False}
    assert (tmp_path / "results" / "note.csv").read_text() == "a,b\n"
    # made known to the text, and to the build
    glued = [(data["application/papermill.record/text/plain"], m["scrapbook"]["name"])
             for data, m in displayed]  # fmt: skip
    assert glued == [("3", "x"), ("1", "y"), ("'reproduced'", "word")]


@pytest.mark.parametrize(
    ("call", "said"),
    [
        (lambda r: r.data("b.txt"), r"^There is no file data/b\.txt\.$"),
        (lambda r: add(r, value=float("nan")), r"^The quantity 'x' cannot be recorded: value: "),
        (lambda r: [add(r), add(r)], r"^The quantity 'x' is recorded already\.$"),
        (lambda r: [r.holds("So.", True), r.holds("So.", True)], "is bound already"),
        *((lambda r, held=held: r.holds("So.", held), "is .*; it must be true or false")
          for held in (float("nan"), "False", [False], 1, None)),
        (lambda r: r.reference("07", "x"), r"There is no results file .*07\.json"),
    ],
)  # fmt: skip
def test_refusals(
    record: ChapterRecord, displayed: list, call: Callable[[ChapterRecord], object], said: str
) -> None:
    with pytest.raises(InswsnError, match=said):
        call(record)


@pytest.mark.parametrize(
    ("parameters", "said"),
    [({"scale": 1000.0}, "scale must be a number in"), ({}, "keeps no record of its parameter")],
)
def test_papermill_is_held_to_declarations(mini: MiniProject, parameters: dict, said: str) -> None:
    with pytest.raises(InswsnError, match=said):
        ChapterRecord("00", parameters=parameters, root=mini.root)


@pytest.mark.parametrize(("name", "status"), [("scal", 1), ("scale", 0)])
def test_papermill_sets_no_name_that_the_chapter_does_not_declare(
    mini: MiniProject, tmp_path: Path, name: str, status: int
) -> None:
    """Papermill itself warns, and goes on with the published numbers."""
    (chapter,) = mini.chapters()
    twin = tmp_path / "mini.ipynb"
    twin.write_text(str(stale_twins(mini)[chapter.twin]), encoding="utf-8")
    done = subprocess.run(
        [sys.executable, "-m", "papermill", str(twin), str(twin.with_name("x")), "-p", name, "3"],
        cwd=mini.root, capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert done.returncode == status, done.stderr
    said = "parameter must be one of scale (the nearest is scale), not 'scal'."
    assert (said in done.stderr) is (status == 1)
    assert (mini.results / "00.json").exists() is (status == 0)


def test_a_reference_is_noted_by_what_is_said_of_it(
    record: ChapterRecord, mini: MiniProject, displayed: list
) -> None:
    def publish(value: float, other: float = 0.0, **changes: object) -> None:
        quantities = tuple(
            Quantity(name=n, value=v, **BASE) for n, v in (("twice", value), ("other", other))
        )
        made = Results(chapter="07", parameters={}, data={}, quantities=quantities)
        mini.publish(made.model_copy(update=changes))

    key = "data/published/07.json#twice"
    assert data_digest(mini.root, key) is None
    publish(42.0)
    assert record.reference("07", "twice").value == 42.0
    record.quote("07", "twice", ".1f", "half", unit=2)
    data, words = displayed.pop()
    assert data["application/papermill.record/text/plain"] == "'21.0'"
    assert words["scrapbook"]["name"] == "half"
    with pytest.raises(InswsnError, match=r"07\.json has no quantity 'thrice'"):
        record.reference("07", "thrice")
    noted = record.results().data
    assert list(noted) == [key]
    assert data_digest(mini.root, key) == noted[key]
    # another quantity, or another run, is no change of this one
    publish(42.0, other=1.0, sentences={"It rains.": True})
    assert data_digest(mini.root, key) == noted[key]
    publish(42.4)
    assert data_digest(mini.root, key) not in (noted[key], None)
    (mini.published / "07.json").write_text("{")
    assert data_digest(mini.root, key) is None


@pytest.mark.usefixtures("displayed")
def test_claims_are_judged_by_what_has_been_recorded_so_far(mini: MiniProject) -> None:
    other = MINI_LEDGER.partition("claims:\n")[2].partition("- {id: P2")[0]
    other = other.replace("P1-M-twice", "P1-Z-1").replace("twice}", "later}")
    mini.ledger.write_text(MINI_LEDGER + other)
    words = mini.root / "data/evidence/00.yaml"
    words.parent.mkdir()
    words.write_text("{}")
    record = EvidenceRecord("00", {"scale": 1.0}, mini.root)
    add(record, "twice", 42.4)
    assert [(e.claim.id, str(e.verdict)) for e in record.judge("P1-M-")] == [
        ("P1-M-twice", "adds up in print")
    ]
    with pytest.raises(InswsnError, match="P1-Z-1 is decided by the quantity later"):
        record.judge()
    add(record, "later", 43.0)
    assert [str(e.verdict) for e in record.judge()] == [
        "adds up in print", "contradicted by the paper itself",
    ]  # fmt: skip
    noted = record.results().data["data/claims#00"]
    assert noted == data_digest(mini.root, "data/claims#00")
