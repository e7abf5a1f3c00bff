"""The record of a page of evidence, whose words stand in a file of their own."""

from __future__ import annotations

from pathlib import Path

import matplotlib.pyplot as plt
import pandas as pd
import pytest
from conftest import MiniProject
from inswsn_book.evidence.page import EvidenceRecord

from inswsn_lib.errors import InswsnError
from inswsn_lib.evaluation import Finding
from inswsn_lib.papers import Derived, span

WORDS = """
usual: {basis: simulation, tolerance: 1.0e-6, share: 1.0e-3}
quantities:
  speed: {unit: m/s, how: How fast it goes.}
  "area{a}.error": {unit: m, basis: printed, tolerance: 0.5, how: "{name}, area {a}, {far:.1f} m."}
  any: {how: What has its unit from the call.}
sentences:
  slow: "The car is slower than {limit} m/s, $v_{\\\\infty}$."
shown:
  tbl-speeds: {caption: "Speeds of {cars:d} cars."}
  fig-speeds: {caption: Speeds., alt: "A bar, {high:.0f} m/s high."}
"""


@pytest.fixture
def record(mini: MiniProject) -> EvidenceRecord:
    folder = mini.root / "data" / "evidence"
    folder.mkdir()
    (folder / "00.yaml").write_text(WORDS, encoding="utf-8")
    return EvidenceRecord("00", {"scale": 2.0}, mini.root)


def test_a_number_has_what_is_said_of_it_and_what_is_usual(record: EvidenceRecord) -> None:
    record.keep("speed", 3.0, runs=7, interval=(2.0, 4.0))
    (speed,) = record.results().quantities
    assert (speed.unit, speed.how, speed.runs) == ("m/s", "How fast it goes.", 7)
    assert (speed.basis, speed.tolerance, speed.share) == ("simulation", 1e-6, 1e-3)
    assert speed.interval_kind == "runs 95 %"


def test_a_tolerance_that_is_said_stands_in_the_place_of_both(record: EvidenceRecord) -> None:
    record.keep("area{a}.error", Derived(1.5, span(1.0, 2.0)), a=1, far=2.04, name="KF")
    (error,) = record.results().quantities
    assert (error.name, error.how) == ("area1.error", "KF, area 1, 2.0 m.")
    assert (error.value, error.interval) == (1.5, (1.0, 2.0))
    assert (error.tolerance, error.share) == (0.5, 0.0)


def test_findings_bring_what_they_are(record: EvidenceRecord) -> None:
    record.findings({"x": Finding(2.0, 1.0, 3.0, "%", "One over another.")}, "best.", runs=5)
    (found,) = record.results().quantities
    assert (found.name, found.unit, found.runs) == ("best.x", "%", 5)
    assert (found.how, found.interval_kind) == ("One over another.", "confidence 95 %")


def test_a_sentence_is_bound_as_it_is_filled_in(record: EvidenceRecord) -> None:
    record.bind("slow", True, limit=5)
    assert record.results().sentences == {"The car is slower than 5 m/s, $v_{\\infty}$.": True}


def test_tables_and_figures_have_their_captions(
    record: EvidenceRecord, displayed: list[tuple[dict[str, str], dict[str, object]]]
) -> None:
    record.table(pd.DataFrame({"speed": [1.0, 2.0]}), name="tbl-speeds", cars=2)
    record.figure(plt.figure(), name="fig-speeds", high=1.6)
    said = str(displayed)
    assert "Speeds of 2 cars." in said
    assert "A bar, 2 m/s high." in said


@pytest.mark.parametrize(
    ("name", "given", "sentence"),
    [
        ("pace", {}, r"00\.yaml says nothing of 'pace' in quantities"),
        ("area{a}.error", {"a": 1, "name": "KF"}, r"Nothing is given for \{far:\.1f\} of"),
        ("speed", {"far": 1.0}, "'speed' has no gap for far"),
        ("any", {}, "unit"),
    ],
)
def test_what_does_not_fit_is_refused(
    record: EvidenceRecord, name: str, given: dict[str, float], sentence: str
) -> None:
    with pytest.raises((InswsnError, TypeError), match=sentence):
        record.keep(name, 1.0, **given)


def test_a_file_of_words_that_says_what_nobody_reads_is_refused(mini: MiniProject) -> None:
    folder = Path(mini.root / "data" / "evidence")
    folder.mkdir()
    (folder / "00.yaml").write_text("quantities: {x: {how: X., units: m}}", encoding="utf-8")
    with pytest.raises(InswsnError, match=r"00\.yaml: .*units"):
        EvidenceRecord("00", {"scale": 2.0}, mini.root)
