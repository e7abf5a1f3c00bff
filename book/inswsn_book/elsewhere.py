"""The same results elsewhere: chapters executed again in other surroundings, and what then moves.

A *variant* changes one thing of what a chapter is executed in: the threads of the linear algebra,
the solver of convex problems, the instructions of the processor, the order of hashed sets, or
Python itself. A *cell* is one chapter in one variant, held against the reference results: each
quantity against its own tolerance, each bound sentence, and each verdict of the ledger. All cells
are kept in ``data/elsewhere.json``.
"""

from __future__ import annotations

import math
import subprocess
import sys
from collections.abc import Iterable
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Annotated, Any, Literal, NamedTuple

from pydantic import BaseModel, ConfigDict, Field

from inswsn_book.compare import Change, flipped_verdicts, pair_quantities
from inswsn_book.files import file_digest, text_digest, tree_digest, write_whole
from inswsn_book.ledger import LEDGER, claims_of, load_claims
from inswsn_book.project import Chapter, Project
from inswsn_book.provenance import machine_facts, repository_state
from inswsn_book.results import Results, read_results
from inswsn_book.runs import Surroundings, reference_results
from inswsn_book.study import plain_sentence, read_kept
from inswsn_lib.errors import BuildError, InswsnError, ParameterError

#: Where the study is kept in a checkout.
ELSEWHERE = "data/elsewhere.json"
#: The variant in which nothing is changed
AGAIN = "again"
#: The variant whose results another machine has found
MACHINE = "other-machine"

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
_SURROUNDINGS = {
    AGAIN: Surroundings(variables={"INSWSN_VARIANT": AGAIN}),
    "threads-2": Surroundings(threads=2),
    "older-processor": Surroundings(variables=_OLDER),
    "hash-seed": Surroundings(variables={"PYTHONHASHSEED": "1"}),
    "scs": Surroundings(solver="scs"),
}
_ORDER = (AGAIN, MACHINE, *list(_SURROUNDINGS)[1:])


@dataclass(frozen=True)
class Variant:
    """One way in which the surroundings differ from those of the book.

    Attributes
    ----------
    id : str
        For another Python ``"python-3.13"``.
    surroundings : Surroundings
    version : str
        Of Python.
    """

    id: str
    surroundings: Surroundings
    version: str


def variants(python: str | None = None) -> list[Variant]:
    """Return the variants that can be had.

    Parameters
    ----------
    python : str, optional
        The path of another interpreter, in an environment that has the locked packages and inswsn.

    Raises
    ------
    ParameterError
        If there is no such interpreter, it lacks inswsn, or has another library of that name.
    """
    own = _version_of(sys.executable)
    found = [Variant(name, given, own) for name, given in _SURROUNDINGS.items()]
    if python is not None:
        version = _version_of(python)
        name = "python-" + ".".join(version.split(".")[:2])
        found.append(Variant(name, Surroundings(python=python), version))
    return found


def _version_of(python: str) -> str:
    """Return the version of an interpreter that has this library."""
    ask = (
        "import platform\nfrom pathlib import Path\n"
        "from inswsn_book.project import Project\n"
        "print(platform.python_version(), Project(Path()).computing_digest())"
    )
    try:
        # from a folder without sources, so that only what is installed there counts
        done = subprocess.run(
            [python, "-c", ask], capture_output=True, text=True, check=True, cwd="/"
        )
    except (OSError, subprocess.CalledProcessError):
        raise ParameterError(
            "--python", python, "an interpreter in whose environment inswsn is installed"
        ) from None
    version, library = done.stdout.split()
    if library != Project(Path()).computing_digest():
        raise ParameterError(
            "--python", python, "an interpreter that has the inswsn of this checkout"
        )
    return version


class _Kept(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid")


class Moved(_Kept):
    """A quantity that is not what the reference says.

    Attributes
    ----------
    name, unit : str
    before, after : float or None
        In the reference and in the run; the number that moved most of the value and the ends of
        its interval. None where one of them does not record it.
    part : str
        Which of these it is.
    tolerance : float
    deviation : float or None
        In tolerances; None if it has no size, as where the tolerance is zero.
    other : tuple of str
        What else differs, such as the number of runs.
    """

    name: str
    unit: str
    before: float | None
    after: float | None
    part: Literal["value", "lower end", "upper end"]
    tolerance: float
    deviation: Annotated[float, Field(ge=0, allow_inf_nan=False)] | None
    other: tuple[str, ...] = ()

    @property
    def size(self) -> float:
        """The deviation, infinite if it has no size: to find the farthest."""
        return math.inf if self.deviation is None else self.deviation


class Flipped(_Kept):
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


class Cell(_Kept):
    """What came of one chapter in one variant.

    Attributes
    ----------
    variant, chapter : str
    compared, identical : int
        Quantities, and those of them that are the same to the last bit, interval and all.
    beyond : tuple of Moved
        Those beyond their tolerance.
    farthest : Moved or None
        The one that moved most, in tolerances; None if none did.
    sentences : int
        Sentences that were bound to conditions.
    overturned : tuple of str
        Those that no longer hold.
    judged : int
        Claims that the chapter decides.
    flipped : tuple of Flipped
        Those with another verdict.
    solvers : dict of str to str
        As the run recorded them.
    failed : str or None
        The sentence with which the run ended before its end.
    seconds : float
    python : str
        Its version.
    blas : tuple of str
        The linear algebra libraries of the run, with their threads and code paths.
    reference_cpu : str
        The processor that the reference results were made on.
    day, commit, clean, cpu, system, sources
        See `inswsn_book.study.Made`; `sources` has "chapter", "library", "locks" and
        "reference".
    """

    variant: Annotated[str, Field(pattern=r"^(python-\d+\.\d+|[a-z]+(-[a-z0-9]+)*)$")]
    chapter: Annotated[str, Field(pattern=r"^\d\d$")]
    compared: int = 0
    identical: int = 0
    beyond: tuple[Moved, ...] = ()
    farthest: Moved | None = None
    sentences: int = 0
    overturned: tuple[str, ...] = ()
    judged: int = 0
    flipped: tuple[Flipped, ...] = ()
    solvers: dict[str, str] = {}
    failed: str | None = None
    seconds: float
    python: str
    blas: tuple[str, ...] = ()
    reference_cpu: str = ""
    day: Annotated[str, Field(pattern=r"^\d{4}-\d\d-\d\d$")]
    commit: str | None
    clean: bool | None
    cpu: str
    system: str
    sources: dict[str, str]

    @property
    def processors(self) -> Processors:
        """The processor of the run, and that of the reference."""
        return Processors(self.cpu, self.reference_cpu)

    @property
    def designs(self) -> dict[str, str]:
        """How many designs each solver made, by its name."""
        whole = ", all designs"
        return {n.removesuffix(whole): t for n, t in self.solvers.items() if n.endswith(whole)}


class Study(_Kept):
    """What ``data/elsewhere.json`` holds: one cell for each chapter and variant."""

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
        return [*(n for n in _ORDER if n in found), *sorted(found - set(_ORDER))]

    @property
    def chapters(self) -> list[str]:
        """The chapters."""
        return sorted({cell.chapter for cell in self.cells})


def found_elsewhere(
    project: Project, folder: Path, chapter: Chapter
) -> tuple[Variant, Results] | None:
    """Return what another build found of a chapter; None if there is nothing of it.

    On the processor of the reference nothing was changed; else the machine is another one. Two
    processors of one name may be unlike: then the linear algebra chooses other code on them.

    Parameters
    ----------
    folder : Path
        Results files of chapters, named as those of the reference.

    Raises
    ------
    InswsnError
        If a file is no results file, does not say what it was made with, or was made from another
        source of the chapter.
    """
    path = folder / f"{chapter.number}.json"
    if not path.is_file():
        return None
    results = read_results(path)
    its = results.provenance
    if its is None:
        raise InswsnError(f"{path} does not say on what machine it was made.")
    if its.sources.get("chapter") != file_digest(chapter.source):
        raise InswsnError(f"{path} was made from another source of chapter {chapter.number}.")
    first = reference_results(project, chapter.number).provenance
    alike = first is not None and (first.cpu, first.blas) == (its.cpu, its.blas)
    name = AGAIN if alike else MACHINE
    return Variant(name, Surroundings(), its.python), results


def compared(
    project: Project,
    variant: Variant,
    chapter: Chapter,
    outcome: Results | BuildError | InswsnError,
) -> Cell:
    """Hold what came of a chapter in a variant against the reference results.

    Raises
    ------
    InswsnError
        If the machine did not compute as the variant asks, so that the run would tell nothing.
    """
    reference = reference_results(project, chapter.number)
    first = reference.provenance
    common: dict[str, Any] = {
        "variant": variant.id, "chapter": chapter.number, "python": variant.version,
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
    claims = claims_of(load_claims(project.root / LEDGER), chapter.number)
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
        sentences=len(outcome.sentences),
        overturned=tuple(text for text, held in outcome.sentences.items() if not held),
        judged=len(claims),
        flipped=tuple(
            Flipped(
                claim=flip.claim.id,
                before=str(flip.before.verdict) if flip.before else None,
                after=str(flip.after.verdict) if flip.after else None,
            )
            for flip in flipped_verdicts(claims, reference, outcome)
        ),
        solvers=outcome.solvers,
        blas=made.blas,
    )


def _check_machine(variant: Variant, chapter: Chapter, blas: Iterable[str]) -> None:
    """Refuse a run whose linear algebra did not have the threads that were asked for."""
    asked = variant.surroundings.threads
    words = f"{asked} thread{'s' if asked > 1 else ''}"
    wrong = [library for library in blas if not library.endswith(f", {words}")]
    if wrong:
        raise InswsnError(
            f"Chapter {chapter.number}, {variant.id}: {wrong[0]} computed, not {words}."
        )


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
    if distance and known.tolerance > 0:
        deviation = distance / known.tolerance
    if pair.beyond_tolerance and deviation is not None and deviation <= 1:
        deviation = None  # not a number has moved, but what it is
    return Moved(
        name=pair.name,
        unit=known.unit,
        before=before if pair.after else getattr(pair.before, "value", None),
        after=after if pair.before else getattr(pair.after, "value", None),
        part=part,
        tolerance=known.tolerance,
        deviation=deviation,
        other=tuple(text for text in pair.details if not text.startswith("interval (")),
    )


def merged(cells: Iterable[Cell], before: Iterable[Cell]) -> Study:
    """Return a study of cells, with earlier ones that they do not replace."""
    together = {(cell.variant, cell.chapter): cell for cell in (*before, *cells)}
    return Study(cells=tuple(together[key] for key in sorted(together)))


def write_elsewhere(study: Study, path: Path) -> None:
    """Write a study, whole or not at all."""
    write_whole(path, study.model_dump_json(indent=1, exclude_defaults=True) + "\n")


def read_elsewhere(path: Path) -> Study:
    """Read and check a study.

    Raises
    ------
    InswsnError
        If there is none, or it is not of the form; the sentence says where.
    """
    return read_kept(path, Study, "elsewhere")


def changed_since(project: Project, study: Study) -> list[str]:
    """Return what the cells were made from that is another now."""
    chapters = {chapter.number: chapter for chapter in project.chapters()}
    library, locks = project.computing_digest(), tree_digest(project.root, project.locks)
    changed = {
        f"chapter {cell.chapter}"
        for cell in study.cells
        if cell.chapter in chapters
        and cell.sources["chapter"] != file_digest(chapters[cell.chapter].source)
    }
    words = sorted(changed)
    words += ["the library"] * any(cell.sources["library"] != library for cell in study.cells)
    words += ["the locks"] * any(cell.sources["locks"] != locks for cell in study.cells)
    return words
