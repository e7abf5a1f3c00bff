"""Cells of the study of other surroundings: a chapter in a variant, held against the reference."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import pytest
from conftest import MiniProject
from elsewhere import (
    AGAIN,
    MACHINE,
    Cell,
    Variant,
    compared,
    found_elsewhere,
    merged,
    moved_by,
    read_elsewhere,
    write_elsewhere,
)
from inswsn_book.compare import Change
from inswsn_book.files import file_digest
from inswsn_book.progress import Quiet
from inswsn_book.project import Project
from inswsn_book.results import Quantity, read_results, write_results
from inswsn_book.runs import ChapterError, Request, Surroundings, run

from inswsn_lib.errors import InswsnError

BASE: dict[str, Any] = {
    "name": "a", "value": 1.0, "unit": "m", "basis": "simulation", "tolerance": 0.5,
    "how": "By some computation.",
}  # fmt: skip


def cell(variant: str = AGAIN, chapter: str = "00", **fields: Any) -> Cell:
    made: dict[str, Any] = {
        "seconds": 10, "python": "3.11.7", "day": "2026-11-22", "commit": None, "clean": None,
        "cpu": "a processor", "system": "Linux", "compared": 4, "identical": 3, "sentences": 2,
        "judged": 1,
        "sources": dict.fromkeys(("chapter", "library", "locks", "reference"), "0" * 64),
    }  # fmt: skip
    return Cell(variant=variant, chapter=chapter, **made | fields)


@pytest.mark.parametrize(
    ("changes", "part", "deviation"),
    [
        ({"value": 2.5}, "value", 3.0),
        ({}, "value", 0.0),
        ({"value": 1.25}, "value", 0.5),
        ({"interval": (0.5, 4.0), "interval_kind": "confidence 95 %"}, "upper end", 4.0),
        ({"interval": (0.25, 2.0), "interval_kind": "confidence 95 %"}, "lower end", 0.5),
    ],
)
def test_a_deviation_is_the_farthest_number_in_tolerances(
    changes: dict[str, Any], part: str, deviation: float
) -> None:
    before = BASE
    if "interval" in changes:
        before = BASE | {"interval": (0.5, 2.0), "interval_kind": "confidence 95 %"}
    moved = moved_by(Change("a", Quantity(**before), Quantity(**before | changes)))
    assert (moved.part, moved.deviation) == (part, deviation)


def test_another_quantity_of_the_same_value_is_beyond_and_has_no_size() -> None:
    """One that lost its interval is another one, and not the nearest of all."""
    whole = Quantity(**BASE | {"interval": (0.5, 2.0), "interval_kind": "confidence 95 %"})
    change = Change("a", whole, Quantity(**BASE))
    assert change.beyond_tolerance
    lost = moved_by(change)
    assert (lost.deviation, lost.size) == (None, math.inf)


def test_a_deviation_without_a_size() -> None:
    zero = Quantity(**BASE | {"tolerance": 0.0})
    assert moved_by(Change("a", zero, zero)).deviation == 0
    changed = zero.model_copy(update={"value": 2.0})
    assert moved_by(Change("a", zero, changed)).deviation is None
    new = moved_by(Change("a", None, zero))
    assert (new.before, new.after, new.deviation) == (None, 1.0, None)
    gone = moved_by(Change("a", zero, None))
    assert (gone.before, gone.after, gone.deviation) == (1.0, None, None)


def variant(name: str = AGAIN, **given: Any) -> Variant:
    return Variant(name, Surroundings(**given), "3.11.7")


def test_a_run_is_held_against_the_reference(mini: MiniProject) -> None:
    """Its one number is twice 21; the reference is made to say otherwise afterwards."""
    (chapter,) = mini.chapters()
    found = run(mini, Request("00"), Quiet()).results

    def held(value: float) -> Cell:
        first = found.quantities[0].model_copy(update={"value": value})
        reference = found.model_copy(update={"quantities": (first,)})
        write_results(reference, mini.published / "00.json")
        return compared(mini, variant(), chapter, found)

    same = held(42.0)
    assert (same.compared, same.identical, same.beyond, same.farthest) == (1, 1, (), None)
    assert same.sources["library"] == mini.computing_digest()
    near = held(41.75)
    assert (near.identical, near.beyond) == (0, ())
    assert near.farthest is not None
    assert near.farthest.deviation == 0.5
    (beyond,) = held(41.0).beyond
    assert (beyond.name, beyond.deviation) == ("twice", 2.0)
    with pytest.raises(InswsnError, match=r"threads-2: .*1 thread computed, not 2 threads"):
        compared(mini, variant("threads-2", threads=2), chapter, found)


def test_a_chapter_that_fails_is_told_in_one_sentence(mini: MiniProject) -> None:
    (chapter,) = mini.chapters()
    failure = ChapterError("Chapter 00-mini failed:\n\nModuleNotFoundError: No module 'torch'\n")
    failed = compared(mini, variant(), chapter, failure)
    assert (failed.compared, failed.failed) == (0, "ModuleNotFoundError: No module 'torch'")
    assert failed.cpu


def test_cells_that_are_run_again_take_the_place_of_the_old(tmp_path: Path) -> None:
    old = [cell(), cell(chapter="01"), cell("scs")]
    new = cell(chapter="01", seconds=99)
    study = merged([new], old)
    assert study.cells == (old[0], new, old[2])
    write_elsewhere(study, tmp_path / "study.json")
    assert read_elsewhere(tmp_path / "study.json") == study
    for text, said in (("{", "is not a study"), ('{"cells": []}', "at least 1 item")):
        (tmp_path / "study.json").write_text(text)
        with pytest.raises(InswsnError, match=said):
            read_elsewhere(tmp_path / "study.json")
    with pytest.raises(InswsnError, match="make elsewhere"):
        read_elsewhere(tmp_path / "none.json")


def test_what_another_build_found(project: Project, tmp_path: Path) -> None:
    (chapter,) = (c for c in project.chapters() if c.number == "62")
    assert found_elsewhere(project, tmp_path, chapter) is None
    results = read_results(project.published / "62.json")
    provenance = results.provenance
    assert provenance is not None
    sources = provenance.sources | {"chapter": file_digest(chapter.source)}
    provenance = provenance.model_copy(update={"sources": sources})
    there = provenance.model_copy(update={"cpu": "Another"})
    write_results(results.model_copy(update={"provenance": there}), tmp_path / "62.json")
    found = found_elsewhere(project, tmp_path, chapter)
    assert found is not None
    same = compared(project, found[0], chapter, found[1])
    assert (same.variant, same.cpu) == (MACHINE, "Another")
    assert same.compared == same.identical == len(results.quantities)
    assert same.commit == provenance.commit
    other = provenance.model_copy(update={"python": "3.12.1"})
    write_results(results.model_copy(update={"provenance": other}), tmp_path / "62.json")
    found = found_elsewhere(project, tmp_path, chapter)
    assert found is not None
    assert found[0].id == "python-3.12"
    twin = provenance.model_copy(update={"blas": ("openblas of numpy, for Another, 1 thread",)})
    write_results(results.model_copy(update={"provenance": twin}), tmp_path / "62.json")
    found = found_elsewhere(project, tmp_path, chapter)
    assert found is not None
    assert found[0].id == MACHINE
    same_machine = results.model_copy(update={"provenance": provenance})
    write_results(same_machine, tmp_path / "62.json")
    found = found_elsewhere(project, tmp_path, chapter)
    assert found is not None
    assert found[0].id == AGAIN
    older = provenance.model_copy(update={"sources": provenance.sources | {"chapter": "0" * 64}})
    write_results(results.model_copy(update={"provenance": older}), tmp_path / "62.json")
    with pytest.raises(InswsnError, match="another source of chapter 62"):
        found_elsewhere(project, tmp_path, chapter)
    write_results(results.model_copy(update={"provenance": None}), tmp_path / "62.json")
    with pytest.raises(InswsnError, match="does not say on what machine"):
        found_elsewhere(project, tmp_path, chapter)
