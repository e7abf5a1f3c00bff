"""A part of a chapter: the cells that a claim needs, by the names that they take."""

from __future__ import annotations

import builtins
import subprocess
from collections.abc import Callable, Mapping

import pytest
from conftest import Command, Done, MiniProject
from inswsn_book.judge.ledger import LEDGER, QuantityCheck, claims_of, load_claims
from inswsn_book.make.answer import published_cells
from inswsn_book.record.parameters import read_myst
from inswsn_book.record.project import Project
from inswsn_book.record.results import Results
from inswsn_book.run.part import Cell, aligned, alone, needed

from inswsn_lib.errors import ParameterError

# a chapter by hand: each cell, and the cells that the last one needs because of it
CASES: Mapping[str, tuple[list[str], list[int]]] = {
    "what is bound": (["a = 1", "b = 2", "a"], [0, 2]),
    "the last binding alone": (["a = 1", "a = 2", "a"], [1, 2]),
    "a binding from itself": (["a = 1", "a = a + 1", "a"], [0, 1, 2]),
    "a change by an index": (["a = {}", "b = a", "a['x'] = 1", "a"], [0, 2, 3]),
    "a change by an attribute": (["a = f", "a.x.y = 1", "a"], [0, 1, 2]),
    "a change by a method": (["a = []", "a.append(1)", "a"], [0, 1, 2]),
    "an addition in place": (["a = 1", "a += 1", "a"], [0, 1, 2]),
    "a loop's name": (["for a in (1, 2):\n    b = a", "b"], [0, 1]),
    "a binding that may not be": (["a = 1", "if c:\n    a = 2", "a"], [0, 1, 2]),
    "an import": (["import numpy as np", "from math import pi", "np.pi"], [0, 2]),
    "a function's names": (["a = 1", "def f():\n    return a", "f()"], [0, 1, 2]),
    "names of a function bound later": (["def f():\n    return a", "a = 1", "f()"], [0, 1, 2]),
    "a binding either way": (["a = 1", "if c:\n    a = 2\nelse:\n    a = 3", "a"], [1, 2]),
    "a loop's own name": (["a = 1", "for a in (1, 2):\n    print(a)"], [1]),
    "a loop without a turn": (["b = 1", "for a in ():\n    b = 2", "b"], [0, 1, 2]),
    "an inner name is no other": (["a = 1", "b = [a for a in (1, 2)]", "b"], [1, 2]),
    "what was recorded": (["record.quantity(1)", "x = 1", "record.judge('c')"], [0, 2]),
    "what was not asked for": (["record.quantity(1)", "x = 1", "x"], [1, 2]),
}


@pytest.mark.parametrize(("sources", "expected"), CASES.values(), ids=CASES)
def test_a_cell_needs_what_it_takes(sources: list[str], expected: list[int]) -> None:
    recording = [i for i, source in enumerate(sources) if source.startswith("record.quantity")]
    assert needed([Cell(s) for s in sources], [len(sources) - 1], recording) == expected


EVIDENCE = ["p1-lmi", "p1-outages", "p1-training", "p2-fusion", "p3-vehicle", "printed-numbers"]


@pytest.mark.parametrize("chapter", EVIDENCE)
def test_each_claim_has_a_part_that_takes_nothing_from_elsewhere(
    chapter: str, project: Project, published: dict[str, Results]
) -> None:
    found, places = project.find(chapter), published[chapter].cells
    source = found.source.read_text(encoding="utf-8")
    claims = claims_of(load_claims(project.root / LEDGER), chapter)
    cells = len(read_myst(source, chapter).cells)
    checked = [c for c in claims if isinstance(c.check, QuantityCheck)]
    of_cell = {places[c.check.quantity]: c.id for c in checked}  # one of those it decides
    twin = published_cells(project.find(chapter))
    parts = [alone(source, chapter, claim, places, claims, twin) for claim in of_cell.values()]
    assert len(parts) > 1
    for part in parts:
        bound: set[str] = {*dir(builtins), "__name__", "display"}
        kept = [c for c in read_myst(part.source, chapter).cells if c.cell_type == "code"]
        assert len(kept) < cells
        for cell in map(Cell, (each.source for each in kept)):
            assert not cell.taken - cell.later - bound, cell.source
            bound |= cell.changed | cell.made
        assert all(cell.later <= bound for cell in (Cell(each.source) for each in kept))


def test_cells_of_an_edited_chapter_are_those_that_were_published() -> None:
    published = {2: "a = 1", 3: "b = a", 5: "keep(b)", 7: "gone()"}
    edited = {2: "import x", 4: "a = 2", 5: "b = a", 6: "c = 0", 8: "keep(b)"}
    assert aligned(published, edited) == {2: 4, 3: 5, 5: 8}
    assert aligned(published, published) == {place: place for place in published}


def test_the_claim_that_is_asked_for_is_told(
    built: MiniProject, inswsn: Callable[..., Done]
) -> None:
    assert inswsn(built.root, "publish").returncode == 0
    built.chapter("raise SystemExit('a cell that the claim does not need')")
    done = inswsn(built.root, "run", "00", "--only", "P1-M-twice", "-p", "scale=3")
    assert done.returncode == 0, done.stderr
    *answer, where = done.stdout.splitlines()
    assert answer == [
        "00 with scale = 3.0 (published: 2.0):",
        "- P1-M-twice: holds if 42 (41.5 to 42.5) m; published 42 m, now 63 m: contradicted by the "
        "paper itself (published: adds up in print)",
        "0 of 0 sentences computed here are no longer true.",
        "1 of 1 verdicts computed here differ: P1-M-twice (adds up in print -> contradicted by the "
        "paper itself).",
    ]
    assert "--html" not in where
    (folder,) = (built.root / "runs").iterdir()
    by_part = inswsn(built.root, "claims", "P1-M-twice", "--results", str(folder))
    assert "Found: 63 m" in by_part.stdout
    whole = inswsn(built.root, "compare", "data/published/00.json", str(folder / "00.json"))
    assert whole.stdout.startswith("Compared is what both hold, since one is a run of a part")
    assert "1 of 1 quantities changed" in whole.stdout
    refused = inswsn(built.root, "run", "00", "--only", "P1-M-twice", "--html")
    assert (refused.returncode, "--html" in refused.stderr) == (2, True)
    # a run of the whole chapter goes to a folder of its own, and so does one of an edited checkout
    assert inswsn(built.root, "run", "00", "--fresh", "-p", "scale=3").returncode != 0
    assert [*(built.root / "runs").iterdir()] == [folder]


def test_a_run_of_an_edited_checkout_says_so(built: MiniProject, inswsn: Command) -> None:
    assert inswsn(built.root, "publish").returncode == 0
    for words in (["init", "-q"], ["add", "."], ["commit", "-qm", "as it was"]):
        who = ["-c", "user.name=a", "-c", "user.email=a@b"]
        subprocess.run(["git", "-C", str(built.root), *who, *words], check=True)
    clean = inswsn(built.root, "run", "00", "--only", "P1-M-twice").stdout
    built.chapter("# nothing\n")
    edited = inswsn(built.root, "run", "00", "--only", "P1-M-twice").stdout
    assert clean.startswith("00 with its published parameters:")
    assert edited.startswith("00 with its published parameters, edited: chapters/00-mini.md:")
    assert len([*(built.root / "runs").iterdir()]) == 2


def test_a_name_that_is_nowhere_is_refused_with_the_nearest(
    project: Project, published: dict[str, Results]
) -> None:
    source = project.find("p1-training").source.read_text(encoding="utf-8")
    places = published["p1-training"].cells
    with pytest.raises(ParameterError, match=r"--only .*the nearest is p1-training-table2"):
        alone(source, "p1-training", "p1-training-tabel2", places, ())
