"""The study of other surroundings: one chapter live, and the stored file against its page."""

from __future__ import annotations

import json
import re
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest

from inswsn_lib.artefact.elsewhere import (
    AGAIN,
    ELSEWHERE,
    Study,
    Variant,
    compared,
    kept_run,
    read_elsewhere,
    run,
    variants,
)
from inswsn_lib.artefact.elsewhere_page import EXPLANATIONS, elsewhere_texts
from inswsn_lib.artefact.progress import Progress
from inswsn_lib.artefact.project import Project
from inswsn_lib.artefact.provenance import available_cores
from inswsn_lib.errors import InswsnError

QUICK = "61"


@pytest.fixture(scope="module")
def study(project: Project) -> Study:
    """The stored study."""
    return read_elsewhere(project.root / ELSEWHERE)


def test_a_short_chapter_in_every_variant_that_each_machine_has(
    project: Project, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """Live: the verdicts and values of the reference, within the stated tolerances."""
    monkeypatch.setattr(Project, "build", property(lambda _: tmp_path))
    (chapter,) = (c for c in project.chapters() if c.number == QUICK)
    chosen = [v for v in variants() if v.id != AGAIN]
    if available_cores() < 2:
        chosen = [v for v in chosen if v.surroundings.threads == 1]

    def one(variant: Variant) -> None:
        ran = run(project, variant, chapter, Progress(), (None, None))
        assert kept_run(project, variant, chapter) == ran
        cell = compared(project, variant, chapter, ran)
        assert cell.failed is None
        assert cell.compared > 0
        assert cell.beyond == cell.overturned == cell.flipped == ()
        words = {library.rsplit(", ", 1)[1] for library in cell.blas}
        assert words == {"2 threads" if variant.id == "threads-2" else "1 thread"}
        if variant.id == "older-processor":
            # OpenBLAS calls what it has for processors before AVX by the name of the oldest
            assert all(re.search("Katmai|Prescott|Core2", library) for library in cell.blas)

    with ThreadPoolExecutor(2) as pool:
        list(pool.map(one, chosen))


def test_another_python_must_be_one(project: Project) -> None:
    with pytest.raises(InswsnError, match=r"--python is .*; it may be an interpreter"):
        variants("/no/such/python")


def test_what_has_not_been_run_is_said_not_to_have_been(project: Project, study: Study) -> None:
    assert len({(c.variant, c.chapter) for c in study.cells}) == len(study.cells)
    assert {AGAIN, "threads-2", "older-processor"} <= set(study.variants)
    texts = elsewhere_texts(project)
    rows = texts["elsewhere-chapters.md"].split("* - ")[2:]
    for chapter, row in zip(study.chapters, rows, strict=True):
        entries = [entry.strip() for entry in row.split("\n  - ")[1:]]
        for name, entry in zip(study.variants, entries, strict=True):
            cell = study.cell(name, chapter)
            ran = cell is not None and cell.failed is None
            assert entry.startswith("not run") != ran
    for missing in {c.number for c in project.chapters()} - set(study.chapters):
        assert f"chapter {missing}" in texts["elsewhere-made.md"].split("Not run elsewhere yet")[1]


def test_the_stored_machines_computed_as_asked(study: Study) -> None:
    for cell in study.cells:
        if cell.failed is None:
            words = {library.rsplit(", ", 1)[1] for library in cell.blas}
            assert words == {"2 threads" if cell.variant == "threads-2" else "1 thread"}
        if cell.variant.startswith("python-"):
            assert cell.variant == "python-" + ".".join(cell.python.split(".")[:2])
            first = study.cell(AGAIN, cell.chapter)
            assert first is None or first.python != cell.python


def test_the_table_by_plain_arithmetic(project: Project) -> None:
    """From the JSON alone: what the row of each variant says."""
    cells = json.loads((project.root / ELSEWHERE).read_text())["cells"]
    table = elsewhere_texts(project)["elsewhere-table.md"]
    rows = [
        [entry.strip() for entry in re.split(r"\n  - ", part)] for part in table.split("* - ")[2:]
    ]
    chapters = {cell["chapter"] for cell in cells}
    names = {cell["variant"] for cell in cells}
    assert len(rows) == len(names)
    told = {tuple(row[1:5]) for row in rows}
    for name in names:
        own = [c for c in cells if c["variant"] == name and "failed" not in c]
        assert (
            f"{len(own)} of {len(chapters)}",
            str(sum(c["compared"] for c in own)),
            str(sum(c.get("identical", 0) for c in own)),
            str(sum(len(c.get("beyond", [])) for c in own)),
        ) in told
    flips = {row[7].removesuffix("```").strip() for row in rows}
    for name in names:
        own = [c for c in cells if c["variant"] == name and "failed" not in c]
        flipped = sum(len(c.get("flipped", [])) for c in own)
        assert f"{flipped} of {sum(c.get('judged', 0) for c in own)}" in flips


def test_nothing_is_beyond_its_tolerance_without_being_said_to_be(project: Project) -> None:
    """Each deviation in the JSON, by its own numbers, and on the page by its name."""
    cells = json.loads((project.root / ELSEWHERE).read_text())["cells"]
    texts = elsewhere_texts(project)
    for cell in cells:
        far = cell.get("farthest")
        if far and far.get("deviation") is not None:
            size = abs(far["after"] - far["before"]) / far["tolerance"]
            assert far["deviation"] == pytest.approx(size, rel=1e-9)
            if size > 1:
                assert far["name"] in {moved["name"] for moved in cell["beyond"]}
        for moved in cell.get("beyond", []):
            assert f"`{moved['name']}`" in texts["elsewhere-moved.md"]
        for flip in cell.get("flipped", []):
            assert flip["claim"] in texts["elsewhere-moved.md"]
    assert (project.root / EXPLANATIONS).is_file()
