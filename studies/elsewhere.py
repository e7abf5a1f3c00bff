"""Whether other surroundings give the same results, by reruns of every chapter: `make elsewhere`.

    python studies/elsewhere.py [--variant threads-2] [--only p1-training] [--jobs 2]

Executes the chapters again with one thing of their surroundings changed and holds what they find
against data/published. What comes of it is kept in data/elsewhere.json, from which the book's page
is made. One variant takes about as long as the book does. SCS takes longer; it is a parameter, and
only the chapters that declare it are run. The study may be stopped at any time: runs that have
ended are in the store and are not made again.

Cells that are not asked for stay as they were stored. What a build of the same chapters by another
Python or on another machine has found needs no run here: give the folder of its results files, such
as p1-lmi.json, as --results FOLDER. A second Python builds in a clone of its own:

    python3.13 -m venv .venv
    .venv/bin/python -m pip install --require-hashes -r environment.lock
    .venv/bin/python -m pip install --no-deps --no-build-isolation -e . -e book
    .venv/bin/python -m inswsn_book book
"""

from __future__ import annotations

import argparse
import math
import platform
import sys
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from datetime import UTC, datetime
from pathlib import Path
from typing import Annotated, Any, Literal

from inswsn_book.judge.ledger import LEDGER, Claim, claims_of, load_claims
from inswsn_book.record.files import file_digest, text_digest, tree_digest, write_whole
from inswsn_book.record.parameters import Value, chapter_schema
from inswsn_book.record.progress import Quiet
from inswsn_book.record.project import Chapter, Project
from inswsn_book.record.provenance import machine_facts, repository_state
from inswsn_book.record.results import Frozen, Name, Quantity, Results, read_results
from inswsn_book.run.compare import Change, flipped_verdicts, pair_quantities
from inswsn_book.run.store import Outcome, Request, Run, reference_results, run_all
from pydantic import Field
from sensitivity import plain_sentence
from study import read_kept

from inswsn_lib.errors import BuildError, InswsnError, ParameterError

ROOT = Path(__file__).parent.parent

#: Where the study is kept in a checkout.
ELSEWHERE = "data/elsewhere.json"
#: The variant in which nothing is changed
AGAIN = "again"
#: The variant whose results another machine has found
MACHINE = "other-machine"


class Moved(Frozen):
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


class Flipped(Frozen):
    """A claim whose verdict is another one; None where it could not be judged."""

    claim: str
    before: str | None
    after: str | None


class Cell(Frozen):
    """What came of one chapter in one variant."""

    variant: Annotated[str, Field(pattern=r"^(python-\d+\.\d+|[a-z]+(-[a-z0-9]+)*)$")]
    chapter: Name
    compared: int = 0  # quantities
    identical: int = 0  # those that are the same to the last bit, interval and all
    beyond: tuple[Moved, ...] = ()  # their tolerance
    farthest: Moved | None = None  # moved, in tolerances
    distances: dict[str, float] = Field(default_factory=dict)  # of all that moved, in their units
    hanging: tuple[str, ...] = ()  # claims with another verdict if a quantity moved twice as far
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


class Study(Frozen):
    """What the file holds: one cell for each chapter and variant."""

    schema_version: Literal[1] = 1
    cells: Annotated[tuple[Cell, ...], Field(min_length=1)]


def read_elsewhere(path: Path) -> Study:
    """Read the study; refuse a file that is none."""
    return read_kept(path, Study, "elsewhere")


# What a processor of 2008 could do, told to each library that chooses its code by the processor:
# OpenBLAS, numpy, the C library (exp, sin ...), torch and its MKL. One that knows no such variable
# goes on as before.
_OLDER = {
    "OPENBLAS_CORETYPE": "Prescott",
    "NPY_DISABLE_CPU_FEATURES": "X86_V3 X86_V4 AVX512_ICL AVX512_SPR",
    "GLIBC_TUNABLES": "glibc.cpu.hwcaps=-AVX2,-FMA,-AVX512F,-AVX",
    "ATEN_CPU_CAPABILITY": "default",
    "MKL_ENABLE_INSTRUCTIONS": "SSE4_2",
}


# What runs here, by variant; its page says what each is for. Nobody reads the first variable: it
# only asks for a run beside the one that the book has.
_CHANGES: dict[str, dict[str, Any]] = {
    AGAIN: {"variables": {"INSWSN_VARIANT": AGAIN}},
    "threads-2": {"threads": 2},
    "older-processor": {"variables": _OLDER},
    "hash-seed": {"variables": {"PYTHONHASHSEED": "1"}},
    "scs": {"parameters": {"solver": "scs"}},  # in the chapters that declare it
}


@dataclass(frozen=True)
class Variant:
    """One way in which the surroundings differ from those of the book."""

    id: str  # for another Python ``"python-3.13"``
    version: str  # of Python
    threads: int = 1
    variables: Mapping[str, str] = field(default_factory=dict)
    parameters: Mapping[str, Value] = field(default_factory=dict)

    def request(self, project: Project, chapter: Chapter) -> Request | None:
        """Return what is run of a chapter; None if it does not declare the parameters."""
        if not {*self.parameters} <= {*chapter_schema(project.root, chapter.id).defaults}:
            return None
        return Request(chapter.id, self.parameters, self.threads, self.variables)


def variants() -> list[Variant]:
    """Return the variants that run here."""
    own = platform.python_version()
    return [Variant(name, own, **changes) for name, changes in _CHANGES.items()]


def found_elsewhere(
    project: Project, folder: Path, chapter: Chapter
) -> tuple[Variant, Results] | None:
    """Return what another build found of a chapter; None if there is nothing of it.

    It may have another Python. With that of the reference, on the processor of the reference,
    nothing was changed; else the machine is another one. Two
    processors of one name may be unlike: then the linear algebra chooses other code on them.
    """
    path = folder / f"{chapter.id}.json"
    if not path.is_file():
        return None
    results = read_results(path)
    its = results.provenance
    if its is None:
        raise InswsnError(f"{path} does not say on what machine it was made.")
    if its.sources.get("chapter") != file_digest(chapter.source):
        raise InswsnError(f"{path} was made from another source of chapter {chapter.id}.")
    first = reference_results(project, chapter.id).provenance
    alike = first is not None and (first.cpu, first.blas) == (its.cpu, its.blas)
    name = AGAIN if alike else MACHINE
    versions = [its.python, first.python if first else its.python]
    minors = [version.rpartition(".")[0] for version in versions]
    if minors[0] != minors[1]:
        name = f"python-{minors[0]}"
    return Variant(name, its.python), results


def compared(
    project: Project,
    variant: Variant,
    chapter: Chapter,
    outcome: Results | BuildError | InswsnError,
) -> Cell:
    """Hold what came of a chapter in a variant against the reference results."""
    reference = reference_results(project, chapter.id)
    first = reference.provenance
    common: dict[str, Any] = {
        "variant": variant.id, "chapter": chapter.id, "python": variant.version,
        "reference_cpu": first.cpu if first else "",
    }  # fmt: skip
    digest = {"reference": text_digest(reference.found().model_dump_json())}
    if not isinstance(outcome, Results):
        commit, clean = repository_state(project.root)
        machine = machine_facts()
        sources = {
            "chapter": file_digest(chapter.source),
            "library": project.computing_digest(),
            "locks": tree_digest(project.root, project.locks),
        }
        return Cell(
            failed=plain_sentence(outcome), seconds=0, day=datetime.now(UTC).date().isoformat(),
            commit=commit, clean=clean, cpu=machine["cpu"], system=machine["system"],
            sources=sources | digest, **common,
        )  # fmt: skip
    made = outcome.provenance
    assert made is not None
    _check_machine(variant, chapter, made.blas)
    pairs = pair_quantities(reference, outcome)
    moved = [moved_by(pair) for pair in pairs if _moved(pair)]
    distances = {
        one.name: abs(one.after - one.before)
        for one in moved
        if one.before is not None and one.after is not None
    }
    claims = claims_of(load_claims(project.root / LEDGER), chapter.id)
    return Cell(
        **common,
        seconds=made.seconds,
        day=made.finished[:10],
        commit=made.commit,
        clean=made.clean,
        cpu=made.cpu,
        system=made.system,
        sources=made.sources | digest,
        compared=len(pairs),
        identical=len(pairs) - len(moved),
        beyond=tuple(moved_by(pair) for pair in pairs if pair.beyond_tolerance),
        farthest=max(moved, key=lambda one: one.size, default=None),
        distances=distances,
        hanging=hanging(claims, reference, distances),
        sentences=len(outcome.sentences),
        overturned=tuple(text for text, held in outcome.sentences.items() if not held),
        judged=len(claims),
        flipped=tuple(
            Flipped(
                claim=claim.id, before=old.words if old else None, after=new.words if new else None
            )
            for claim, old, new in flipped_verdicts(claims, reference, outcome)
        ),
        solvers=outcome.solvers,
        blas=made.blas,
    )


def hanging(
    claims: list[Claim], reference: Results, distances: Mapping[str, float]
) -> tuple[str, ...]:
    """Return the claims whose verdict changes if one quantity moves twice as far, either way."""
    found = set()
    for quantity in reference.quantities:
        for step in (2, -2) if quantity.name in distances else ():
            there = _shifted(reference, quantity.name, step * distances[quantity.name])
            found |= {claim.id for claim, *_ in flipped_verdicts(claims, reference, there)}
    return tuple(sorted(found))


def _shifted(results: Results, name: str, by: float) -> Results:
    """Return results in which one quantity, interval and all, is moved."""

    def moved(quantity: Quantity) -> Quantity:
        if quantity.name != name:
            return quantity
        ends = quantity.interval and tuple(end + by for end in quantity.interval)
        return quantity.model_copy(update={"value": quantity.value + by, "interval": ends})

    return results.model_copy(update={"quantities": tuple(map(moved, results.quantities))})


def _check_machine(variant: Variant, chapter: Chapter, blas: Iterable[str]) -> None:
    """Refuse a run whose linear algebra did not have the threads that were asked for.

    That which scs brings along has one, whatever is asked for.
    """
    asked = variant.threads
    words = f"{asked} thread{'s' if asked > 1 else ''}"
    wrong = [each for each in blas if " of scs" not in each and not each.endswith(f", {words}")]
    if wrong:
        raise InswsnError(f"Chapter {chapter.id}, {variant.id}: {wrong[0]} computed, not {words}.")


def _moved(pair: Change) -> bool:
    if pair.before is None or pair.after is None:
        return True
    fields = ("value", "interval", "interval_kind", "unit", "runs", "basis", "role", "tolerance")
    return any(getattr(pair.before, name) != getattr(pair.after, name) for name in fields)


def moved_by(pair: Change) -> Moved:
    """Return how far a quantity moved."""
    known = pair.before or pair.after
    assert known is not None
    numbers: list[tuple[Any, float | None, float | None]] = [("value", None, None)]
    if pair.before and pair.after:
        numbers = [("value", pair.before.value, pair.after.value)]
        if pair.before.interval and pair.after.interval:
            (low, high), (lower, higher) = pair.before.interval, pair.after.interval
            numbers += [("lower end", low, lower), ("upper end", high, higher)]
    part, before, after = max(numbers, key=lambda entry: abs((entry[2] or 0) - (entry[1] or 0)))
    distance = None if before is None or after is None else abs(after - before)
    deviation = 0.0 if distance == 0 else None
    if distance and known.slack > 0:
        deviation = distance / known.slack
    if pair.beyond_tolerance and deviation is not None and deviation <= 1:
        deviation = None  # not a number has moved, but what it is
    return Moved(
        name=pair.name,
        unit=known.unit,
        before=before if pair.after else getattr(pair.before, "value", None),
        after=after if pair.before else getattr(pair.after, "value", None),
        part=part,
        tolerance=known.slack,
        deviation=deviation,
        other=tuple(pair.kind),
    )


def merged(cells: Iterable[Cell], before: Iterable[Cell]) -> Study:
    """Return a study of cells, with earlier ones that they do not replace."""
    together = {(cell.variant, cell.chapter): cell for cell in (*before, *cells)}
    return Study(cells=tuple(together[key] for key in sorted(together)))


def write_elsewhere(study: Study, path: Path) -> None:
    """Write a study, whole or not at all."""
    write_whole(path, study.model_dump_json(indent=1) + "\n")


def asked_for(names: list[str]) -> list[Variant]:
    """Return the variants of these names; all that can be had if there are none."""
    found = variants()
    wrong = [name for name in names if name not in {variant.id for variant in found}]
    if wrong:
        must_be = "one of " + ", ".join(variant.id for variant in found)
        raise ParameterError("--variant", wrong[0], must_be)
    return [variant for variant in found if not names or variant.id in names]


def run_study(
    project: Project,
    todo: list[tuple[Variant, Chapter, Request]],
    jobs: int | None,
    progress: Quiet,
) -> None:
    """Run what has not been run, and put the cells of all that has ended into the file."""
    cells: list[Cell] = []

    def ended(place: int, outcome: Outcome) -> None:
        variant, chapter, _ = todo[place]
        found = outcome.results if isinstance(outcome, Run) else outcome
        cells.append(compared(project, variant, chapter, found))
        progress.say(line_of(cells[-1], chapter))

    try:
        run_all(project, [request for *_, request in todo], progress, ended, jobs=jobs)
    finally:
        keep(project, cells)


def keep(project: Project, cells: list[Cell]) -> None:
    """Put cells into the file, in the place of those that they replace."""
    path = project.root / ELSEWHERE
    before = read_elsewhere(path).cells if path.is_file() else ()
    if cells:
        write_elsewhere(merged(cells, before), path)


def file_results(project: Project, folder: Path, chapters: list[Chapter], progress: Quiet) -> None:
    """Hold the results of another build against the reference, and keep what comes of it."""
    cells = []
    for chapter in chapters:
        found = found_elsewhere(project, folder, chapter)
        if found is not None:
            cells.append(compared(project, found[0], chapter, found[1]))
            progress.say(line_of(cells[-1], chapter))
    if not cells:
        raise ParameterError(
            "--results", folder, "a folder with results files, such as p1-lmi.json"
        )
    keep(project, cells)


def line_of(cell: Cell, chapter: Chapter) -> str:
    """Return a line for the terminal."""
    how = f"failed: {cell.failed}" if cell.failed else (
        f"{cell.compared} quantities, {len(cell.beyond)} beyond tolerance, {len(cell.overturned)} "
        f"sentences overturned, {len(cell.flipped)} verdicts flipped, {cell.seconds:.0f} s"
    )  # fmt: skip
    return f"{cell.variant}: {chapter.name}: {how}"


def main() -> None:
    """Run what is due and write the file."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--variant", action="append", default=[], help="only this one; repeatable")
    parser.add_argument("--only", action="append", default=[], metavar="CHAPTER", help="repeatable")
    parser.add_argument("--jobs", type=int, default=1, help="chapters at once")
    parser.add_argument("--results", type=Path, help="a folder of what another build found")
    given = parser.parse_args()
    project = Project(ROOT.resolve())
    try:
        chapters = [project.find(word, evidence=True) for word in given.only] or [
            chapter for chapter in project.chapters() if not chapter.lesson
        ]
        with Quiet() as progress:
            if given.results is not None:
                file_results(project, given.results, chapters, progress)
                return
            chosen = asked_for(given.variant)
            todo = [
                (variant, chapter, request)
                for variant in chosen
                for chapter in chapters
                if (request := variant.request(project, chapter)) is not None
            ]
            progress.say(f"elsewhere: {len(todo)} runs, of which those kept are not made again")
            run_study(project, todo, given.jobs, progress)
    except InswsnError as error:
        sys.exit(str(error))
    except KeyboardInterrupt:
        sys.exit(130)


if __name__ == "__main__":
    main()
