"""The study of other surroundings: one chapter live, and the stored file against its page."""

from __future__ import annotations

import json
import re
from pathlib import Path

import pytest
from elsewhere import AGAIN, ELSEWHERE, Study, compared, read_elsewhere, variants
from inswsn_book.progress import Quiet
from inswsn_book.project import Project
from inswsn_book.provenance import available_cores
from inswsn_book.runs import run, run_all

QUICK = "61"


@pytest.fixture(scope="module")
def study(project: Project) -> Study:
    """The stored study."""
    return read_elsewhere(project.root / ELSEWHERE)


def test_a_short_chapter_in_every_variant_that_each_machine_has(
    project: Project, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """Live: the verdicts and values of the reference, within the stated tolerances."""
    monkeypatch.setattr(project, "store", tmp_path)
    (chapter,) = (c for c in project.chapters() if c.number == QUICK)
    chosen = [v for v in variants() if v.id != AGAIN]
    if available_cores() < 2:
        chosen = [v for v in chosen if v.surroundings.threads == 1]

    asked = {variant.id: variant.request(project, chapter) for variant in chosen}
    assert asked.pop("scs") is None  # the chapter designs no filter
    requests = [request for request in asked.values() if request is not None]
    ran = run_all(project, requests, Quiet(), jobs=2)
    for variant, done in zip((v for v in chosen if v.id in asked), ran, strict=True):
        cell = compared(project, variant, chapter, done.results)
        assert cell.failed is None
        assert cell.compared > 0
        assert cell.beyond == cell.overturned == cell.flipped == ()
        words = {library.rsplit(", ", 1)[1] for library in cell.blas}
        assert words == {"2 threads" if variant.id == "threads-2" else "1 thread"}
        if variant.id == "older-processor":
            # OpenBLAS calls what it has for processors before AVX by the name of the oldest
            assert all(re.search("Katmai|Prescott|Core2", library) for library in cell.blas)


@pytest.mark.whole
def test_a_design_is_asked_of_scs(
    project: Project, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """Live, in the shortest chapter that designs a filter."""
    monkeypatch.setattr(project, "store", tmp_path)
    (variant,) = (v for v in variants() if v.id == "scs")
    request = variant.request(project, project.find("71"))
    assert request is not None
    cell = compared(project, variant, project.find("71"), run(project, request, Quiet()).results)
    assert any("scs" in name for name in cell.solvers)
    assert cell.flipped == ()


def test_each_chapter_stands_once_in_a_variant(study: Study) -> None:
    assert len({(c.variant, c.chapter) for c in study.cells}) == len(study.cells)
    assert {AGAIN, "threads-2", "older-processor"} <= {cell.variant for cell in study.cells}


def test_the_stored_machines_computed_as_asked(study: Study) -> None:
    for cell in study.cells:
        if cell.failed is None:
            words = {library.rsplit(", ", 1)[1] for library in cell.blas}
            assert words == {"2 threads" if cell.variant == "threads-2" else "1 thread"}
        if cell.variant.startswith("python-"):
            assert cell.variant == "python-" + ".".join(cell.python.split(".")[:2])
            own = [c.python for c in study.cells if (c.variant, c.chapter) == (AGAIN, cell.chapter)]
            assert cell.python not in own


def test_nothing_is_beyond_its_tolerance_without_being_listed(project: Project) -> None:
    """Each deviation in the JSON, by its own numbers."""
    cells = json.loads((project.root / ELSEWHERE).read_text())["cells"]
    for cell in cells:
        far = cell.get("farthest")
        if far and far.get("deviation") is not None:
            size = abs(far["after"] - far["before"]) / far["tolerance"]
            assert far["deviation"] == pytest.approx(size, rel=1e-9)
            if size > 1:
                assert far["name"] in {moved["name"] for moved in cell["beyond"]}
