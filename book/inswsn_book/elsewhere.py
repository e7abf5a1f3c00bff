"""The same results elsewhere, as ``data/elsewhere.json`` keeps them.

A *variant* changes one thing of what a chapter is executed in: the threads of the linear algebra,
the solver of convex problems, the instructions of the processor, the order of hashed sets, Python
itself, or the machine. A *cell* is one chapter in one variant, held against the reference results:
each quantity against its own tolerance, each bound sentence, and each verdict of the ledger.
``studies/elsewhere.py`` makes the cells.
"""

from __future__ import annotations

import math
from pathlib import Path
from typing import Annotated, Literal, NamedTuple

from pydantic import Field

from inswsn_book.files import file_digest, tree_digest
from inswsn_book.project import Project
from inswsn_book.study import Kept, read_kept

#: Where the study is kept in a checkout.
ELSEWHERE = "data/elsewhere.json"
#: The variant in which nothing is changed
AGAIN = "again"
#: The variant whose results another machine has found
MACHINE = "other-machine"
#: The variants in the order of the page; another Python comes last
ORDER = (AGAIN, MACHINE, "threads-2", "older-processor", "hash-seed", "scs")


class Moved(Kept):
    """A quantity that is not what the reference says; None where one does not record it.

    Its numbers are those that moved most, of the value and the ends of its interval.
    """

    name: str
    unit: str
    before: float | None
    after: float | None
    part: Literal["value", "lower end", "upper end"]
    tolerance: float
    # in tolerances; None if it has no size, as where the tolerance is zero
    deviation: Annotated[float, Field(ge=0, allow_inf_nan=False)] | None
    other: tuple[str, ...] = ()  # what else differs, such as the number of runs

    @property
    def size(self) -> float:
        """The deviation, infinite if it has no size: to find the farthest."""
        return math.inf if self.deviation is None else self.deviation


class Flipped(Kept):
    """A claim whose verdict is another one; None where it could not be judged."""

    claim: str
    before: str | None
    after: str | None


class Processors(NamedTuple):
    """The processor of a run, and that of what it is held against."""

    run: str
    reference: str

    @property
    def alike(self) -> bool:
        """Whether they have one name; two of one name may be unlike."""
        return self.run == self.reference


class Cell(Kept):
    """What came of one chapter in one variant."""

    variant: Annotated[str, Field(pattern=r"^(python-\d+\.\d+|[a-z]+(-[a-z0-9]+)*)$")]
    chapter: Annotated[str, Field(pattern=r"^\d\d$")]
    compared: int = 0  # quantities
    identical: int = 0  # those that are the same to the last bit, interval and all
    beyond: tuple[Moved, ...] = ()  # their tolerance
    farthest: Moved | None = None  # moved, in tolerances
    sentences: int = 0  # that were bound to conditions
    overturned: tuple[str, ...] = ()  # those that no longer hold
    judged: int = 0  # claims that the chapter decides
    flipped: tuple[Flipped, ...] = ()
    solvers: dict[str, str] = Field(default_factory=dict)  # as the run recorded them
    failed: str | None = None  # the sentence with which it ended before its end
    seconds: float
    python: str
    blas: tuple[str, ...] = ()
    reference_cpu: str = ""
    day: Annotated[str, Field(pattern=r"^\d{4}-\d\d-\d\d$")]
    commit: str | None
    clean: bool | None
    cpu: str
    system: str
    sources: dict[str, str]  # digests of the chapter, the library, the locks and the reference

    @property
    def processors(self) -> Processors:
        """The processor of the run, and that of the reference."""
        return Processors(self.cpu, self.reference_cpu)

    @property
    def designs(self) -> dict[str, str]:
        """How many designs each solver made, by its name."""
        whole = ", all designs"
        return {n.removesuffix(whole): t for n, t in self.solvers.items() if n.endswith(whole)}


class Study(Kept):
    """What the file holds: one cell for each chapter and variant."""

    schema_version: Literal[1] = 1
    cells: Annotated[tuple[Cell, ...], Field(min_length=1)]

    def of(self, variant: str) -> list[Cell]:
        """Return the cells of a variant, by chapter."""
        return [cell for cell in self.cells if cell.variant == variant]

    def cell(self, variant: str, chapter: str) -> Cell | None:
        """Return a cell, or None."""
        return next((cell for cell in self.of(variant) if cell.chapter == chapter), None)

    @property
    def variants(self) -> list[str]:
        """The variants, another Python last."""
        found = {cell.variant for cell in self.cells}
        return [*(n for n in ORDER if n in found), *sorted(found - set(ORDER))]

    @property
    def chapters(self) -> list[str]:
        """The chapters."""
        return sorted({cell.chapter for cell in self.cells})


def read_elsewhere(path: Path) -> Study:
    """Read the study; refuse a file that is none."""
    return read_kept(path, Study, "elsewhere")


def changed_since(project: Project, study: Study) -> list[str]:
    """Return what the cells were made from that is another now."""
    now = {chapter.number: file_digest(chapter.source) for chapter in project.chapters()}
    library, locks = project.computing_digest(), tree_digest(project.root, project.locks)
    words = {
        f"chapter {cell.chapter}"
        for cell in study.cells
        if cell.sources["chapter"] != now.get(cell.chapter, cell.sources["chapter"])
    }
    others = {"the library": library, "the locks": locks}
    return sorted(words) + [
        word
        for word, digest in others.items()
        if any(cell.sources[word.removeprefix("the ")] != digest for cell in study.cells)
    ]
