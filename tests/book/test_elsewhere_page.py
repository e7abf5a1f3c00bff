"""Cells of the study of other surroundings, and the page that is made of them."""

from __future__ import annotations

import json
import math
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from conftest import MiniProject
from inswsn_book import execution
from inswsn_book.compare import Change
from inswsn_book.elsewhere import (
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
    kept_run,
    merged,
    moved_by,
    read_elsewhere,
    run,
    run_key,
    write_elsewhere,
)
from inswsn_book.elsewhere_page import (
    EXPLANATIONS,
    chapters_table,
    elsewhere_texts,
    reason,
    summary,
    tolerances,
    variants_list,
    variants_table,
)
from inswsn_book.execution import Surroundings, chosen_surroundings
from inswsn_book.progress import Progress
from inswsn_book.project import Project
from inswsn_book.results import Quantity, read_results, write_results

from inswsn_lib.errors import InswsnError, ParameterError

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


def far(name: str = "a", deviation: float | None = 3.0) -> Moved:
    return Moved(
        name=name, unit="m", before=1.0, after=2.5, part="value", tolerance=0.5, deviation=deviation
    )


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
    assert tolerances(lost) == "another quantity"


def test_a_deviation_without_a_size() -> None:
    zero = Quantity(**BASE | {"tolerance": 0.0})
    assert moved_by(Change("a", zero, zero)).deviation == 0
    changed = zero.model_copy(update={"value": 2.0})
    assert moved_by(Change("a", zero, changed)).deviation is None
    new = moved_by(Change("a", None, zero))
    assert (new.before, new.after, new.deviation) == (None, 1.0, None)
    gone = moved_by(Change("a", zero, None))
    assert (gone.before, gone.after, gone.deviation) == (1.0, None, None)


@pytest.fixture
def plain() -> Callable[..., Variant]:
    def make(name: str = "threads-2", **given: Any) -> Variant:
        return Variant(name, name, "", Surroundings(**given), "3.11.7")

    return make


def test_a_run_is_kept_and_held_against_the_reference(
    mini: MiniProject, plain: Callable[..., Variant], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Its one number is twice 2.5; the reference is made to say otherwise afterwards."""
    monkeypatch.setenv("INSWSN_SOLVER", "mosek")  # the caller's does not reach a study
    (chapter,) = mini.chapters()
    variant = plain(AGAIN, variables={"PYTHONHASHSEED": "7"})
    assert kept_run(mini, variant, chapter) is None
    ran = run(mini, variant, chapter, Progress(), ("0" * 40, True))
    assert kept_run(mini, variant, chapter) == ran
    assert ran.results is not None
    write_results(ran.results, mini.published / "00.json")
    same = compared(mini, variant, chapter, ran)
    assert (same.compared, same.identical, same.beyond, same.farthest) == (1, 1, (), None)
    assert (same.commit, same.clean) == ("0" * 40, True)

    first = ran.results.quantities[0]
    near = first.model_copy(update={"value": first.value - 0.25})
    write_results(
        ran.results.model_copy(update={"quantities": (near,)}), mini.published / "00.json"
    )
    moved = compared(mini, variant, chapter, ran)
    assert (moved.identical, moved.beyond) == (0, ())
    assert moved.farthest is not None
    assert moved.farthest.deviation == 0.5
    away = first.model_copy(update={"value": first.value - 1.0})
    write_results(
        ran.results.model_copy(update={"quantities": (away,)}), mini.published / "00.json"
    )
    (beyond,) = compared(mini, variant, chapter, ran).beyond
    assert (beyond.name, beyond.deviation) == ("twice", 2.0)


def test_a_chapter_that_fails_is_told_in_one_sentence(
    mini: MiniProject, plain: Callable[..., Variant]
) -> None:
    (chapter,) = mini.chapters()
    source = chapter.source.read_text()
    chapter.source.write_text(
        source.replace("number = float", "import no_such_module\nnumber = float")
    )
    ran = run(mini, plain(AGAIN), chapter, Progress(), (None, None))
    assert ran.failed == "ModuleNotFoundError: No module named 'no_such_module'"
    assert kept_run(mini, plain(AGAIN), chapter) is None  # what it lacked may be there now
    failed = compared(mini, plain(AGAIN), chapter, ran)
    assert (failed.compared, failed.failed) == (0, ran.failed)
    assert reason(failed) == "no_such_module for Python 3.11.7 could not be had here"


def test_a_run_without_the_threads_that_were_asked_for_is_refused(
    mini: MiniProject, plain: Callable[..., Variant]
) -> None:
    (chapter,) = mini.chapters()
    variant = plain("threads-2", threads=2, variables={"OPENBLAS_NUM_THREADS": "1"})
    with pytest.raises(InswsnError, match=r"threads-2: .*1 thread computed, not 2 threads"):
        run(mini, variant, chapter, Progress(), (None, None))
    assert kept_run(mini, variant, chapter) is None


def test_a_key_knows_the_surroundings(mini: MiniProject, plain: Callable[..., Variant]) -> None:
    (chapter,) = mini.chapters()
    made = [
        plain(), plain("scs"), plain(threads=2), plain(solver="scs"), plain(variables={"A": "1"}),
        Variant("threads-2", "", "", Surroundings(), "3.13.5"),
    ]  # fmt: skip
    assert len({run_key(mini, variant, chapter) for variant in made}) == len(made)


def test_only_a_run_of_ones_own_listens_to_the_variable(
    mini: MiniProject, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("INSWSN_SOLVER", "scs")
    for surroundings, solver in (
        (Surroundings(), "clarabel"),
        (chosen_surroundings(), "scs"),
    ):
        told = execution._environment(mini, mini.root, surroundings)
        assert told["INSWSN_SOLVER"] == solver
    assert chosen_surroundings().solver == "scs"
    assert Surroundings().solver == "clarabel"
    monkeypatch.setenv("INSWSN_SOLVER", "")
    assert chosen_surroundings() == Surroundings()
    monkeypatch.setenv("INSWSN_SOLVER", "mosek")
    with pytest.raises(ParameterError, match=r"INSWSN_SOLVER is .mosek.; it may be one of"):
        chosen_surroundings()


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


def test_the_sentences_follow_the_cells() -> None:
    none = Study(cells=(cell(), cell("threads-2", identical=4)))
    text = summary(none, 3)
    assert "In 1 way of changing the surroundings, 1 execution of chapters was held" in text
    assert "of 3 that 3 chapters would make" in text
    assert "Of 4 comparisons of a quantity with its own tolerance, 4 agreed" in text
    assert "**none** went beyond" in text
    assert "Of 1 verdicts, **none** changed. Of 2 sentences" in text
    assert "**none** was overturned" in text
    assert "With nothing changed, 3 of 4 quantities" in text
    assert "another processor" in text  # the cell does not say that of the reference
    flipped = cell(
        "threads-2", identical=1, beyond=(far(),), farthest=far(),
        overturned=("One.", "Two."), flipped=(Flipped(claim="P1-X", before="a", after=None),),
    )  # fmt: skip
    some = Study(
        cells=(cell(reference_cpu="a processor"), flipped, cell("scs", failed="It broke."))
    )
    text = summary(some, 3)
    assert "1 agreed to the last bit, 2 moved within the tolerance, and **1** went beyond" in text
    assert "Of 1 verdicts, **1** changed." in text
    assert "**2** were overturned" in text
    assert "another processor" not in text
    assert "What could not be run: {ref}`chapter 00 <chapter-00>` (It broke)." in text
    rows = chapters_table(some, ["00", "01"]).split("* - ")[2:]
    assert [re.findall(r"  - (.*)", row) for row in rows] == [
        ["4", "same", "3, 1 beyond, 2 sentences, 1 verdict", "not run"],
        ["–", "not run", "not run", "not run"],
    ]
    row = variants_table(some, 2).split("* - two threads")[1].split("* -")[0]
    assert re.findall(r"  - (.*)", row) == [
        "1 of 2", "1 of 1", "2 of 2", "1 of 4", "1 of 4", "3, {ref}`chapter 00 <chapter-00>`",
    ]  # fmt: skip


@pytest.mark.parametrize(
    ("names", "said"),
    [
        ([], "00, scs: 'a' is not as in the reference, and data/elsewhere.yaml does not say why"),
        (["a"], "'A sentence.' is not as"),
        (["a", "A sent*"], "'P1-X' is not as"),
        (["a", "A sentence.", "P1-X", "b*"], r"it: nothing like 'b\*' moved in chapter 00, scs"),
        (["a", "A sentence.", "P1-*"], None),
    ],
)
def test_what_moves_is_explained_and_what_is_explained_moves(
    mini: MiniProject, names: list[str], said: str | None
) -> None:
    moved = cell(
        "scs", beyond=(far(),), farthest=far(), overturned=("A sentence.",),
        flipped=(Flipped(claim="P1-X", before="reproduced", after="contradicted"),),
    )  # fmt: skip
    write_elsewhere(Study(cells=(cell(), moved)), mini.root / ELSEWHERE)
    entry = {"id": "it", "variants": ["scs"], "chapter": "00", "names": names, "why": "So it is."}
    entries = [entry] if names else []
    (mini.root / EXPLANATIONS).write_text(json.dumps({"explanations": entries}))
    if said is not None:
        with pytest.raises(InswsnError, match=said):
            elsewhere_texts(mini)
        return
    text = elsewhere_texts(mini)["elsewhere-moved.md"]
    assert "So it is." in text
    assert "`a`\n  - 1 m\n  - 2.5 m\n  - 3" in text
    assert "this sentence does not hold: “A sentence.”" in text
    assert "P1-X is contradicted, and was reproduced." in text


def test_what_another_build_found(project: Project, tmp_path: Path) -> None:
    (chapter,) = (c for c in project.chapters() if c.number == "62")
    assert found_elsewhere(project, tmp_path, chapter) is None
    results = read_results(project.published / "62.json")
    provenance = results.provenance
    assert provenance is not None
    there = provenance.model_copy(update={"cpu": "Another", "python": "3.12.1"})
    write_results(results.model_copy(update={"provenance": there}), tmp_path / "62.json")
    found = found_elsewhere(project, tmp_path, chapter)
    assert found is not None
    same = compared(project, found[0], chapter, found[1])
    assert (same.variant, same.cpu, same.python) == (MACHINE, "Another", "3.12.1")
    assert same.compared == same.identical == len(results.quantities)
    assert same.commit == provenance.commit
    third = same.model_copy(update={"cpu": "Third", "reference_cpu": "First"})
    alike = same.model_copy(update={"cpu": "Twin", "reference_cpu": "Twin"})
    assert variants_list(Study(cells=(third, same, alike))).endswith(
        f" Runs are from Another, their references from {provenance.cpu}."
        " Runs are from Third, their references from First."
        " Runs and their references are from two unlike processors that are called Twin.\n"
    )
    twin = provenance.model_copy(update={"blas": ("openblas of numpy, for Another, 1 thread",)})
    write_results(results.model_copy(update={"provenance": twin}), tmp_path / "62.json")
    found = found_elsewhere(project, tmp_path, chapter)
    assert found is not None
    assert found[0].id == MACHINE
    write_results(results, tmp_path / "62.json")
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


def test_a_checkout_without_explanations_has_no_texts(mini: MiniProject) -> None:
    assert elsewhere_texts(mini) == {}


def test_the_reference_is_read_as_it_is(project: Any) -> None:
    """A chapter against its own reference: all quantities the same."""
    (chapter,) = (c for c in project.chapters() if c.number == "62")
    results = read_results(project.published / "62.json")
    from inswsn_book.elsewhere import Ran

    ran = Ran(
        results=results, seconds=1, day="2026-11-22", commit=None, clean=None, cpu="", system="",
        sources={},
    )  # fmt: skip
    same = compared(project, Variant(AGAIN, "", "", Surroundings(), "3"), chapter, ran)
    assert (same.compared, same.identical) == (len(results.quantities),) * 2
    assert same.flipped == same.overturned == ()
