"""The study of other surroundings: its cells, one chapter live, its page, and the stored study."""

from __future__ import annotations

import math
import re
from functools import partial
from pathlib import Path
from typing import Any

import made_results
import pytest
from conftest import MiniProject, Render
from elsewhere import (
    AGAIN,
    ELSEWHERE,
    MACHINE,
    Cell,
    Flipped,
    Moved,
    Study,
    Variant,
    compared,
    found_elsewhere,
    merged,
    moved_by,
    read_elsewhere,
    variants,
    write_elsewhere,
)
from inswsn_book.record.files import file_digest
from inswsn_book.record.progress import Quiet
from inswsn_book.record.project import Project
from inswsn_book.record.provenance import available_cores
from inswsn_book.record.results import Provenance, Results, write_results
from inswsn_book.run.compare import Change
from inswsn_book.run.store import ChapterError, run_all

from inswsn_lib.errors import InswsnError

quantity = partial(made_results.quantity, tolerance=0.5)
INTERVAL = {"interval": (0.5, 2.0), "interval_kind": "confidence 95 %"}


def cell(variant: str = AGAIN, chapter: str = "00", **fields: Any) -> Cell:
    made: dict[str, Any] = {
        "seconds": 10, "python": "3.11.7", "day": "2026-11-22", "commit": None, "clean": None,
        "cpu": "a processor", "system": "Linux", "compared": 4, "identical": 3, "sentences": 2,
        "judged": 1,
        "sources": dict.fromkeys(("chapter", "library", "locks", "reference"), "0" * 64),
    }  # fmt: skip
    return Cell(variant=variant, chapter=chapter, **made | fields)


# Deviations --------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("before", "after", "part", "deviation"),
    [
        ({}, {"value": 2.5}, "value", 3.0),
        ({}, {}, "value", 0.0),
        ({}, {"value": 1.25}, "value", 0.5),
        (INTERVAL, INTERVAL | {"interval": (0.5, 4.0)}, "upper end", 4.0),
        (INTERVAL, INTERVAL | {"interval": (0.25, 2.0)}, "lower end", 0.5),
        ({"tolerance": 0.0}, {"tolerance": 0.0}, "value", 0.0),
        # without a size
        ({"tolerance": 0.0}, {"tolerance": 0.0, "value": 2.0}, "value", None),
        (INTERVAL, {}, "value", None),  # one that lost its interval is another quantity
        (None, {}, "value", None),
        ({}, None, "value", None),
    ],
)
def test_a_deviation_is_the_farthest_number_in_tolerances(
    before: dict[str, Any] | None, after: dict[str, Any] | None, part: str, deviation: float | None
) -> None:
    old, new = (None if given is None else quantity(**given) for given in (before, after))
    change = Change("a", old, new)
    moved = moved_by(change)
    assert (moved.part, moved.deviation) == (part, deviation)
    assert moved.size == (math.inf if deviation is None else deviation)
    assert change.beyond_tolerance == (moved.size > 1)
    assert (moved.before is None, moved.after is None) == (before is None, after is None)


# Cells -------------------------------------------------------------------------------------------


@pytest.fixture
def provenance(published: dict[str, Results]) -> Provenance:
    """That of a reference, whose linear algebra had one thread."""
    return published["62"].provenance


def test_a_run_is_held_against_the_reference(mini: MiniProject, provenance: Provenance) -> None:
    (chapter,) = mini.chapters()

    def results(value: float) -> Results:
        twice = quantity("twice", value, basis="simulation")
        return made_results.results(twice, provenance=provenance, sentences={"So.": False})

    def held(value: float, threads: int = 1, blas: tuple[str, ...] = ()) -> Cell:
        mini.publish(results(value))
        by = provenance.model_copy(update={"blas": blas} if blas else {})
        variant = Variant(AGAIN, "3.11.7", threads)
        found = results(42.0).model_copy(update={"provenance": by})
        return compared(mini, variant, chapter, found)

    same = held(42.0)
    assert (same.compared, same.identical, same.beyond, same.farthest) == (1, 1, (), None)
    assert (same.overturned, same.judged, same.flipped) == (("So.",), 1, ())
    assert (same.cpu, same.reference_cpu) == (provenance.cpu, provenance.cpu)
    near = held(41.75)
    assert (near.identical, near.beyond) == (0, ())
    assert near.farthest.deviation == 0.5
    # 42 in print is 41.5 to 42.5: twice as far as 41.75 is from 42 is out of it, below
    assert (near.distances, near.hanging) == ({"twice": 0.25}, ("P1-M-twice",))
    assert (same.distances, same.hanging) == ({}, ())
    assert held(41.875).hanging == ()
    (beyond,) = held(41.0).beyond
    assert (beyond.name, beyond.deviation) == ("twice", 2.0)
    assert [f.claim for f in held(63.0).flipped] == ["P1-M-twice"]
    with pytest.raises(InswsnError, match=r"again: .*1 thread computed, not 2 threads"):
        held(42.0, threads=2)
    own = ("openblas of numpy, for Any, 2 threads", "openblas of scs, for Any, 1 thread")
    assert held(42.0, threads=2, blas=own).blas == own  # that of scs has one in any case
    failure = ChapterError("Chapter 00-mini failed:\n\nModuleNotFoundError: No module 'torch'\n")
    failed = compared(mini, Variant(AGAIN, "3.11.7"), chapter, failure)
    assert (failed.compared, failed.failed) == (0, "ModuleNotFoundError: No module 'torch'")
    assert failed.sources["library"] == mini.computing_digest()


def test_cells_that_are_run_again_take_the_place_of_the_old(tmp_path: Path) -> None:
    path = tmp_path / "study.json"
    with pytest.raises(InswsnError, match="make elsewhere"):
        read_elsewhere(path)
    old, new = [cell(), cell(chapter="01"), cell("scs")], cell(chapter="01", seconds=99)
    study = merged([new], old)
    assert study.cells == (old[0], new, old[2])
    write_elsewhere(study, path)
    assert read_elsewhere(path) == study
    path.write_text('{"cells": []}')
    with pytest.raises(InswsnError, match="is not a study: cells: Tuple should have at least 1"):
        read_elsewhere(path)


@pytest.mark.parametrize(
    ("changes", "name"),
    [
        ({}, AGAIN),
        ({"cpu": "Another"}, MACHINE),
        ({"blas": ("openblas of numpy, for Another, 1 thread",)}, MACHINE),  # a twin by its name
        ({"python": "3.12.1"}, "python-3.12"),
        ({"sources": {"chapter": "0" * 64}}, "another source of chapter 62"),
        (None, "does not say on what machine"),
    ],
)
def test_what_another_build_found(
    project: Project, published: dict[str, Results], provenance: Provenance, tmp_path: Path,
    changes: dict[str, Any] | None, name: str,
) -> None:  # fmt: skip
    chapter, made, said = project.by_id("62"), None, ""
    assert found_elsewhere(project, tmp_path, chapter) is None
    if changes is not None:
        sources = {"chapter": file_digest(chapter.source)}
        made = provenance.model_copy(update={"sources": sources} | changes)
    results = published["62"].model_copy(update={"provenance": made})
    write_results(results, tmp_path / "62.json")
    try:
        found = found_elsewhere(project, tmp_path, chapter)
        assert (found[0].id, found[1]) == (name, results)
    except InswsnError as error:
        said = str(error)
    assert said == "" or name in said
    assert bool(said) is (" " in name)


def words_of(cell: Cell) -> set[str]:
    """Return with how many threads the libraries of a run computed; that of scs has one."""
    return {library.rsplit(", ", 1)[1] for library in cell.blas if " of scs" not in library}


def test_a_short_chapter_in_every_variant_that_each_machine_has(
    project: Project, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """Live: the verdicts and values of the reference, within the stated tolerances."""
    monkeypatch.setattr(project, "store", tmp_path)
    chosen = [v for v in variants() if v.id != AGAIN]
    if available_cores() < 2:
        chosen = [v for v in chosen if v.threads == 1]
    asked = {v.id: v.request(project, project.by_id("61")) for v in chosen}
    assert asked.pop("scs") is None  # the chapter designs no filter
    chosen = [v for v in chosen if v.id in asked]
    given = [request for request in asked.values() if request is not None]
    for variant, done in zip(chosen, run_all(project, given, Quiet(), jobs=2), strict=True):
        found = compared(project, variant, project.by_id("61"), done.results)
        assert found.compared > 0
        assert found.beyond == found.overturned == found.flipped == ()
        assert words_of(found) == {"2 threads" if variant.id == "threads-2" else "1 thread"}
        if variant.id == "older-processor":
            # OpenBLAS calls what it has for processors before AVX by the name of the oldest
            assert all(re.search("Katmai|Prescott|Core2", library) for library in found.blas)


# Its page ----------------------------------------------------------------------------------------


@pytest.fixture
def page(render: Render) -> Render:
    """The page of a small study."""

    def shown(*cells: Cell, changed: tuple[str, ...] = ()) -> str:
        study = Study(cells=cells).model_dump(mode="json")
        return render("reproduce", elsewhere=study, changed_since=lambda _: changed)

    return shown


def rows_of(page: str, name: str) -> list[list[str]]:
    """Return the rows of a table below its head."""
    table = page.split(f":name: {name}\n")[1].split(":::::", maxsplit=1)[0]
    return [[part.strip() for part in row.split("\n  - ")] for row in table.split("* - ")[2:]]


def test_all_that_moved_is_told(page: Render, known: dict[str, Any]) -> None:
    number = "printed-numbers"
    far = Moved(
        name="a", unit="m", before=1.0, after=2.5, part="value", tolerance=0.5, deviation=3.0
    )
    moved = cell(
        "threads-2", number, identical=1, beyond=(far,), farthest=far, overturned=("One.", "Two."),
        flipped=(Flipped(claim="P1-X", before="reproduced", after=None),),
    )  # fmt: skip
    failed = cell("scs", number, failed="It broke.")
    text = page(cell(chapter=number), moved, failed, cell("scs", "61"), cell("scs", "62"),
                changed=("chapter 00", "locks"))  # fmt: skip
    for said in (
        "Of 3 verdicts, **1** changed.", "**2** failed to hold",
        "What could not be run: {ref}`printed-numbers <printed-numbers>` with SCS (It broke).",
        "With two threads this sentence does not hold: “Two.”",
        "With two threads P1-X is not judged, and was reproduced.",
        "Since then, these have changed: chapter 00, locks.",
    ):  # fmt: skip
        assert said in text, said
    (first,) = (row for row in rows_of(text, "tbl-elsewhere-chapters") if number in row[0])
    assert first[1:] == ["4", "same", "3, 1 beyond, 2 sentences, 1 verdict", "not run"]
    (row,) = (row for row in rows_of(text, "tbl-elsewhere") if row[0] == "two threads")
    assert row[1:] == [
        f"1 of {len([c for c in known['chapters'] if not c['lesson']])}",
        *("1 of 1", "2 of 2", "1 of 4", "1 of 4"),
        "3, {ref}`printed-numbers <printed-numbers>`",
    ]  # fmt: skip
    assert rows_of(text, f"tbl-elsewhere-{number}") == [["two threads", "`a`", "1 m", "2.5 m", "3"]]


# The stored study --------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def stored(project: Project) -> tuple[Cell, ...]:
    """The stored cells."""
    return read_elsewhere(project.root / ELSEWHERE).cells


def test_the_stored_runs_were_made_as_asked(stored: tuple[Cell, ...]) -> None:
    assert len({(c.variant, c.chapter) for c in stored}) == len(stored)
    assert {AGAIN, "threads-2", "older-processor"} <= {c.variant for c in stored}
    for found in stored:
        if found.failed is None:
            threads = "2 threads" if found.variant == "threads-2" else "1 thread"
            assert words_of(found) == {threads}
        if found.variant.startswith("python-"):
            assert found.variant == "python-" + ".".join(found.python.split(".")[:2])
            own = [c.python for c in stored if (c.variant, c.chapter) == (AGAIN, found.chapter)]
            assert found.python not in own


def test_nothing_is_beyond_its_tolerance_without_being_said_to_be(
    stored: tuple[Cell, ...], render: Render
) -> None:
    """Each deviation by its own numbers, and on the page by its name."""
    told = re.split(r"\n##", render("reproduce").split("## Beyond the tolerance")[1])[0]
    for found in stored:
        most = found.farthest
        if most is not None and most.deviation is not None:
            size = abs(most.after - most.before) / most.tolerance
            assert most.deviation == pytest.approx(size, rel=1e-9)
            assert size <= 1 or most.name in {moved.name for moved in found.beyond}
        assert all(f"`{moved.name}`" in told for moved in found.beyond)
        assert all(flip.claim in told for flip in found.flipped)
