"""The record that a chapter keeps."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from conftest import MiniProject
from inswsn_book.files import file_digest
from inswsn_book.ledger import data_digest
from inswsn_book.project import RESULTS_VARIABLE, ROOT_VARIABLE
from inswsn_book.record import ChapterRecord
from inswsn_book.results import Quantity, Results, read_results, write_results

from inswsn_lib.errors import InswsnError


@pytest.fixture
def record(mini: MiniProject, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> ChapterRecord:
    monkeypatch.setenv(RESULTS_VARIABLE, str(tmp_path / "results"))
    (mini.root / "data" / "a.txt").write_text("1")
    return ChapterRecord("00", parameters={"scale": 1.0}, root=mini.root)


def add(record: ChapterRecord, name: str = "x", **changes: object) -> None:
    fields: dict = {
        "value": 1.0,
        "unit": "m",
        "how": "Computed for a test.",
        "basis": "printed",
        "tolerance": 0.0,
    }
    record.quantity(name, **(fields | changes))


def test_it_writes_what_it_read_and_found(record: ChapterRecord, tmp_path: Path) -> None:
    path = record.data("a.txt")
    add(record, "x", interval=(0.5, 2.0))
    add(record, "y", basis="simulation", interval=(0.5, 2.0), runs=200)
    record.write()
    written = read_results(tmp_path / "results" / "00.json")
    assert written.data == {"data/a.txt": file_digest(path)}
    assert written.parameters == {"scale": 1.0}
    assert written["x"].interval_kind == "rounding"
    assert written["y"].interval_kind == "confidence 95 %"
    assert written["y"].runs == 200


def test_a_reference_quantity_is_noted_by_what_is_said_of_it(
    record: ChapterRecord, mini: MiniProject
) -> None:
    def publish(value: float, other: float = 0.0, **changes: object) -> None:
        fields = {"unit": "m", "how": "Made for a test.", "basis": "printed", "tolerance": 0.5}
        quantities = tuple(
            Quantity(name=n, value=v, **fields)  # type: ignore[arg-type]
            for n, v in (("twice", value), ("other", other))
        )
        made = Results(chapter="07", parameters={}, data={}, quantities=quantities)
        write_results(made.model_copy(update=changes), mini.published / "07.json")

    key = "data/published/07.json#twice"
    with pytest.raises(InswsnError, match=r"no results file"):
        record.reference("07", "twice")
    assert data_digest(mini.root, key) is None
    publish(42.0)
    assert record.reference("07", "twice").value == 42.0
    with pytest.raises(InswsnError, match=r"07\.json has no quantity 'thrice'"):
        record.reference("07", "thrice")
    noted = record.results().data
    assert list(noted) == [key]
    assert data_digest(mini.root, key) == noted[key]
    assert data_digest(mini.root, "data/published/07.json#thrice") is None
    # another quantity, or another run, is no change of this one
    publish(42.0, other=1.0, sentences={"It rains.": True})
    assert data_digest(mini.root, key) == noted[key]
    publish(42.4)
    assert data_digest(mini.root, key) not in (noted[key], None)
    (mini.published / "07.json").write_text("{")
    assert data_digest(mini.root, key) is None


def test_a_quantity_is_glued_for_the_text(record: ChapterRecord, displayed: list) -> None:
    add(record, "x", value=3.0)
    record.say("word", "reproduced")
    (number, words), (word, _) = displayed
    assert number == {"application/papermill.record/text/plain": "3"}
    assert words["scrapbook"]["name"] == "x"
    assert word == {"application/papermill.record/text/plain": "reproduced"}


def test_sentences_are_bound_to_conditions(record: ChapterRecord, tmp_path: Path) -> None:
    record.holds("The sky is blue.", True)
    record.holds("The sky is green.", False)
    record.write()
    written = read_results(tmp_path / "results" / "00.json")
    assert written.sentences == {"The sky is blue.": True, "The sky is green.": False}
    for untrue in (float("nan"), "False", [False], 1, None):
        with pytest.raises(InswsnError, match="it may be true or false"):
            record.holds("The sky is grey.", untrue)
    record.holds("The sky is high.", np.bool_(True))
    with pytest.raises(InswsnError, match="is bound already"):
        record.holds("The sky is blue.", True)


def test_refusals_are_one_sentence(record: ChapterRecord) -> None:
    with pytest.raises(InswsnError, match=r"^There is no file data/b.txt\.$"):
        record.data("b.txt")
    with pytest.raises(InswsnError, match=r"^The quantity 'x' cannot be recorded: value: .*\.$"):
        add(record, value=float("nan"))
    add(record)
    with pytest.raises(InswsnError, match=r"^The quantity 'x' is recorded already\.$"):
        add(record)


def test_outside_a_checkout_it_says_so(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv(ROOT_VARIABLE, raising=False)
    monkeypatch.chdir(tmp_path)
    with pytest.raises(InswsnError, match="is not in a checkout of inswsn"):
        ChapterRecord("00", parameters={})


def test_claims_are_judged_by_what_has_been_recorded_so_far(record: ChapterRecord) -> None:
    root = record._root
    claim = (
        "- {{id: {id}, paper: P1, place: Table 9, says: It is {value}., value: '{value}', unit: m, "
        "kind: numeric, check: {{chapter: '00', quantity: {quantity}}}, tolerance: within 10 %, "
        "why: A tenth.}}\n"
    )
    (root / "data" / "claims" / "mini.yaml").write_text(
        "claims:\n"
        + claim.format(id="P1-T9-1", value="3", quantity="x")
        + claim.format(id="P1-T9-2", value="5", quantity="x")
        + claim.format(id="P1-Z-1", value="7", quantity="later")
    )
    add(record, "x", value=3.1)
    judged = record.judge("P1-T9-")
    assert [(entry.claim.id, str(entry.verdict)) for entry in judged] == [
        ("P1-T9-1", "reproduced"),
        ("P1-T9-2", "contradicted by the paper itself"),
    ]
    with pytest.raises(InswsnError, match="P1-Z-1 is decided by the quantity later"):
        record.judge()
    add(record, "later", value=7.0)
    assert len(record.judge()) == 3
    assert "data/claims#00" in record.results().data
