"""The sensitivity study: chapters run again with one assumption changed, and what comes of it.

A cell of the study is one run of one chapter: unchanged, with another seed, or with one alternative
of ``data/assumptions.yaml``, whose changed scenario or source is the overlay of its request.
``data/sensitivity.json`` keeps what came of all cells.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Literal, TypeVar

import numpy as np
import yaml
from pydantic import BaseModel, ConfigDict, Field, ValidationError

from inswsn_book.files import write_whole
from inswsn_book.ledger import LEDGER, claims_of, load_claims
from inswsn_book.parameters import Value
from inswsn_book.project import Project
from inswsn_book.results import Results
from inswsn_book.review import Alternative, Assumptions, Headline
from inswsn_book.runs import Outcome, Request, request_key
from inswsn_book.runs import Run as ChapterRun
from inswsn_book.verdicts import verdicts
from inswsn_lib.errors import InswsnError
from inswsn_lib.files import read_yaml

#: Where the study is kept.
SENSITIVITY = "data/sensitivity.json"
#: The id of the unchanged run of a chapter
BASELINE = "baseline"
_CHANGED = "Set for this run."
_Model = TypeVar("_Model", bound=BaseModel)


class Run(BaseModel):
    """What came of a cell.

    Attributes
    ----------
    id, chapter : str
        See `Cell`.
    parameters : dict
        Those that differ from the published run.
    headlines : dict of str to float
        By the key of the headline; one that the run did not record, or not as a finite number, is
        left out.
    verdicts : dict of str to str
        By the id of the claim, for the claims that the chapter decides.
    overturned : int
        Sentences of the page that do not hold in this run.
    failed : str or None
        The sentence with which the run ended before its end.
    seconds : float
        How long it took.
    key : str
        Of its request when it was made.
    """

    model_config = ConfigDict(frozen=True, extra="forbid")
    id: Annotated[str, Field(pattern=r"^(baseline|seed-\d+|P[123]-M-[A-Za-z0-9]+/[a-z0-9-]+)$")]
    chapter: Annotated[str, Field(pattern=r"^\d\d$")]
    parameters: dict[str, Value]
    headlines: dict[str, Annotated[float, Field(allow_inf_nan=False)]] = {}
    verdicts: dict[str, str] = {}
    overturned: Annotated[int, Field(ge=0)] = 0
    failed: str | None = None
    seconds: Annotated[float, Field(ge=0)]
    key: Annotated[str, Field(pattern=r"^[0-9a-f-]{40,64}$")]


class Made(BaseModel):
    """What the study was made with.

    Attributes
    ----------
    version : str
        Of inswsn.
    day : str
    commit : str or None
    clean : bool or None
    sources : dict of str to str
        SHA-256 of the library, the locks, the assumptions and each chapter.
    recorded : bool
        Whether the recording of P3's chapter could be had.
    python, system, cpu : str
    packages : dict of str to str
    """

    model_config = ConfigDict(frozen=True, extra="forbid")
    version: str
    day: Annotated[str, Field(pattern=r"^\d{4}-\d\d-\d\d$")]
    commit: Annotated[str, Field(pattern=r"^[0-9a-f]{40,64}$")] | None
    clean: bool | None
    sources: dict[str, Annotated[str, Field(pattern=r"^[0-9a-f]{64}$")]]
    recorded: bool
    python: str
    system: str
    cpu: str
    packages: dict[str, str]


class Study(BaseModel):
    """What ``data/sensitivity.json`` holds.

    Attributes
    ----------
    schema_version : int
    made : Made
    runs : tuple of Run
        One for each cell.
    """

    model_config = ConfigDict(frozen=True, extra="forbid")
    schema_version: Literal[1] = 1
    made: Made
    runs: Annotated[tuple[Run, ...], Field(min_length=1)]

    def run(self, chapter: str, identity: str) -> Run | None:
        """Return the run of a chapter with that id; None if there is none."""
        for run in self.runs:
            if run.chapter == chapter and run.id == identity:
                return run
        return None

    def seeds(self, chapter: str) -> list[Run]:
        """Return the unchanged runs of a chapter: the baseline and those with other seeds."""
        return [
            run
            for run in self.runs
            if run.chapter == chapter and (run.id == BASELINE or run.id.startswith("seed-"))
        ]


def write_study(study: Study, path: Path) -> None:
    """Write a study, whole or not at all."""
    write_whole(path, study.model_dump_json(indent=1) + "\n")


def read_study(path: Path) -> Study:
    """Read and check a study.

    Raises
    ------
    InswsnError
        If there is none, or it is not of the form; the sentence says where.
    """
    return read_kept(path, Study, "studies")


def read_kept(path: Path, model: type[_Model], make: str) -> _Model:
    """Read a study and check its form.

    Parameters
    ----------
    make : str
        The goal of the Makefile that makes it, for the sentence of an error.

    Raises
    ------
    InswsnError
        If there is no such file, or it is not of the form; the sentence says where.
    """
    try:
        return model.model_validate_json(path.read_text(encoding="utf-8"))
    except FileNotFoundError:
        raise InswsnError(f"There is no {path}; make it with make {make}.") from None
    except UnicodeDecodeError:
        raise InswsnError(f"{path} is not a study: it is not UTF-8.") from None
    except ValidationError as error:
        first = error.errors()[0]
        place = ".".join(map(str, first["loc"])) or "the file"
        raise InswsnError(f"{path} is not a study: {place}: {first['msg']}.") from None


def merged(runs: Iterable[Run], before: Mapping[tuple[str, str], Run]) -> tuple[Run, ...]:
    """Return runs together with earlier ones that they do not replace."""
    together = dict(before) | {(run.chapter, run.id): run for run in runs}
    return tuple(together[key] for key in sorted(together))


@dataclass(frozen=True)
class Cell:
    """One run of the study that is to be made.

    Attributes
    ----------
    id : str
        ``"baseline"``, ``"seed-2"`` or such as ``"P1-M-B/small"``.
    chapter : str
        Two digits.
    parameters : dict
        All that differ from the published run.
    change : Alternative or None
        What is changed beside parameters.
    skips : tuple of str
        Titles of sections of the chapter that are left out.
    """

    id: str
    chapter: str
    parameters: dict[str, Value] = field(default_factory=dict)
    change: Alternative | None = None
    skips: tuple[str, ...] = ()


def cells_of(assumptions: Assumptions, only: Iterable[str] = ()) -> list[Cell]:
    """Return the cells of the study, the unchanged runs of each chapter first.

    Parameters
    ----------
    only : iterable of str
        Only the alternatives of the entries with these ids, and the unchanged runs that they are
        held against. Default: all.

    Raises
    ------
    InswsnError
        If there is no entry of an id.
    """
    wanted = set(only)
    missing = wanted - {entry.id for entry in assumptions.assumptions}
    if missing:
        raise InswsnError(f"There is no assumption {min(missing)}.")
    entries = [entry for entry in assumptions.assumptions if not wanted or entry.id in wanted]
    changed = [
        Cell(
            f"{entry.id}/{other.id}",
            chapter,
            assumptions.reduced[chapter].parameters | other.parameters.get(chapter, {}),
            other,
            assumptions.reduced[chapter].skips,
        )
        for entry in entries
        for other in entry.alternatives
        for chapter in other.chapters
    ]
    chapters = {cell.chapter for cell in changed} | {c for entry in entries for c in entry.seeds}
    unchanged = []
    for chapter, reduced in assumptions.reduced.items():
        if chapter in chapters:
            runs: dict[str, dict[str, Value]] = {BASELINE: {}}
            runs |= {f"seed-{seed}": {"seed": seed} for seed in reduced.seeds}
            unchanged += [
                Cell(name, chapter, reduced.parameters | chance, skips=reduced.skips)
                for name, chance in runs.items()
            ]
    return unchanged + changed


def request_of(project: Project, cell: Cell) -> Request:
    """Return the request of a cell.

    Raises
    ------
    InswsnError
        If a passage that is to be replaced does not stand in its chapter exactly once, or a chapter
        has no section of a title that is left out.
    """
    overlay: dict[str, str] = {}
    if cell.change is not None:
        overlay |= _changed_scenarios(project.root, cell.change)
    source = project.find(cell.chapter).source
    before = source.read_text(encoding="utf-8")
    after = before if cell.change is None else _edited(before, cell.chapter, cell.change)
    after = _without(after, cell.skips, source.name)
    if after != before:
        overlay[f"chapters/{source.name}"] = after
    return Request(cell.chapter, cell.parameters, overlay=overlay)


def _changed_scenarios(root: Path, change: Alternative) -> dict[str, str]:
    """Return the texts of the scenario files that an alternative changes, by their paths."""
    folder = "data/scenarios"
    texts = {
        f"{folder}/{scenario}.yaml": (root / folder / f"{file}.yaml").read_text(encoding="utf-8")
        for scenario, file in change.files.items()
    }
    for scenario in {*change.values, *change.factors}:
        content = read_yaml(root / folder / f"{scenario}.yaml")
        values = dict(change.values.get(scenario, {}))
        for key, factor in change.factors.get(scenario, {}).items():
            values[key] = (np.asarray(content[key]["value"]) * factor).tolist()
        for key, value in values.items():
            content[key] |= {"value": value, "source": "assumed", "why": _CHANGED}
        texts[f"{folder}/{scenario}.yaml"] = yaml.safe_dump(content, sort_keys=False)
    return texts


def _edited(source: str, chapter: str, change: Alternative) -> str:
    for edit in change.edits:
        if edit.chapter != chapter:
            continue
        if source.count(edit.old) != 1:
            raise InswsnError(
                f"The passage that {change.id} replaces does not stand in chapter {chapter} "
                "exactly once."
            )
        source = source.replace(edit.old, edit.new)
    return source


def _without(source: str, titles: Iterable[str], name: str) -> str:
    """Return a source without the sections of these titles."""
    for title in titles:
        # to the next heading of the same rank; a label before that heading goes, too
        source, found = re.subn(
            rf"^## {re.escape(title)}\n.*?(?=^## |\Z)", "", source, flags=re.MULTILINE | re.DOTALL
        )
        if found != 1:
            raise InswsnError(f"{name} has no section {title!r}, or more than one.")
    return source


def run_of(
    project: Project,
    cell: Cell,
    headlines: Iterable[Headline],
    outcome: Outcome,
) -> Run:
    """Return what came of a cell.

    A run that fails is a result: a design that is not feasible, or a scene that cannot be.

    Parameters
    ----------
    outcome
        How `inswsn_book.runs.run_each` says that the cell's request has ended.
    """
    bare = Run(
        id=cell.id,
        chapter=cell.chapter,
        parameters=cell.parameters,
        seconds=0,
        key=request_key(project, request_of(project, cell)),
    )
    if not isinstance(outcome, ChapterRun):
        return bare.model_copy(update={"failed": plain_sentence(outcome)})
    results = outcome.results
    made = results.provenance
    return bare.model_copy(
        update={
            "headlines": _headlines(results, headlines),
            "verdicts": _verdicts(project, results),
            "overturned": sum(not held for held in results.sentences.values()),
            "seconds": made.seconds if made else 0,
        }
    )


def _headlines(results: Results, headlines: Iterable[Headline]) -> dict[str, float]:
    found = {}
    for headline in headlines:
        try:
            value = headline.value(results)
        except (InswsnError, ZeroDivisionError):
            continue
        if np.isfinite(value):
            found[headline.key] = value
    return found


def _verdicts(project: Project, results: Results) -> dict[str, str]:
    found = {}
    for claim in claims_of(load_claims(project.root / LEDGER), results.chapter):
        try:
            found[claim.id] = str(verdicts([claim], [results])[0].verdict)
        except InswsnError:  # this run did not record what decides it
            continue
    return found


def plain_sentence(failure: BaseException) -> str:
    """Return the last line of a failure, without the colours of a terminal and folders."""
    plain = re.sub(r"\x1b\[[0-9;]*m", "", str(failure))
    plain = re.sub(r"/\S*/(?=(chapters|data)/)", "", plain)  # of the checkout or an overlay
    lines = [line.strip() for line in plain.splitlines() if line.strip()]
    return lines[-1][:300] if lines else "It ended without a word."
