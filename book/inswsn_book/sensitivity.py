"""The sensitivity study: chapters run again with one assumption changed, and what comes of it.

A cell of the study is one run of one chapter: unchanged, with another seed, or with one alternative
of ``data/assumptions.yaml``. It runs in a folder of its own that links to the checkout, with the
changed scenario or source in it. ``data/sensitivity.json`` keeps all cells.
"""

from __future__ import annotations

import json
import re
import tempfile
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from pydantic import ValidationError

from inswsn_book.assumptions import Alternative, Assumptions, Headline
from inswsn_book.execution import ChapterError, execute_once
from inswsn_book.files import file_digest, text_digest, tree_digest
from inswsn_book.ledger import LEDGER, claims_of, load_claims
from inswsn_book.parameters import Value
from inswsn_book.progress import Progress
from inswsn_book.project import Chapter, Project
from inswsn_book.results import Results
from inswsn_book.study import BASELINE, Run
from inswsn_book.verdicts import verdicts
from inswsn_lib.errors import InswsnError
from inswsn_lib.files import data_mirror, read_yaml

_LINKED = ("_config.yml", "environment.lock", "environment-torch.lock", "book")
_CHANGED = "Set for this run."


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
    assumptions : Assumptions
        From `load_assumptions`.
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


def _chapter(project: Project, number: str) -> Chapter:
    return next(chapter for chapter in project.chapters() if chapter.number == number)


def cell_key(project: Project, cell: Cell) -> str:
    """Return the digest of all that a cell is made from."""
    chapter = _chapter(project, cell.chapter)
    scenarios = (project.root / "data" / "scenarios").glob("*.yaml")
    facts = {
        "chapter": file_digest(chapter.source),
        "library": project.computing_digest(),
        "locks": tree_digest(project.root, project.locks),
        "scenarios": tree_digest(project.root, scenarios),
        "recorded": data_mirror() is not None,
        "parameters": cell.parameters,
        "change": None if cell.change is None else _what_changes(cell.change),
        "skips": cell.skips,
    }
    return text_digest(json.dumps(facts, sort_keys=True))


def _what_changes(change: Alternative) -> dict[str, Any]:
    return change.model_dump(include={"values", "factors", "files", "edits"})


def run_cell(
    project: Project, cell: Cell, headlines: Iterable[Headline], progress: Progress
) -> Run:
    """Run a chapter in a changed copy of the checkout and return what came of it.

    A run that fails is a result: a design that is not feasible, or a scene that cannot be.

    Parameters
    ----------
    project : Project
        The checkout.
    cell : Cell
    headlines : iterable of Headline
        Those of the chapter.
    progress : Progress
        Told of each cell of the notebook.
    """
    chapter, key = _chapter(project, cell.chapter), cell_key(project, cell)
    bare = Run(id=cell.id, chapter=cell.chapter, parameters=cell.parameters, seconds=0, key=key)
    with changed_checkout(project, cell) as other:
        try:
            _, results, _ = execute_once(
                other, Chapter(chapter.name, other.root / "chapters" / chapter.source.name),
                cell.parameters, progress,
            )  # fmt: skip
        except (InswsnError, ChapterError) as failure:
            return bare.model_copy(update={"failed": _sentence(str(failure), other.root)})
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


def _sentence(said: str, root: Path) -> str:
    """Return the last line of a failure, without the paths and the colours of this machine."""
    plain = re.sub(r"\x1b\[[0-9;]*m", "", said).replace(str(root), "")
    return [line.strip() for line in plain.splitlines() if line.strip()][-1][:300]


@contextmanager
def changed_checkout(project: Project, cell: Cell) -> Iterator[Project]:
    """Make a folder that is the checkout but for what a cell changes, and take it away again.

    Parameters
    ----------
    project : Project
        The checkout; files that stay as they are, are linked to.
    cell : Cell
        What is changed in scenarios and sources, and which sections are left out.

    Yields
    ------
    Project
        The folder.

    Raises
    ------
    InswsnError
        If a passage that is to be replaced does not stand in its chapter exactly once, or a chapter
        has no section of that title.
    """
    with tempfile.TemporaryDirectory(prefix="inswsn-sensitivity-") as name:
        root = Path(name).resolve()
        for linked in _LINKED:
            if (project.root / linked).exists():
                (root / linked).symlink_to(project.root / linked)
        for folder in ("chapters", "data", "data/scenarios"):
            (root / folder).mkdir()
            for path in (project.root / folder).iterdir():
                if path.name != "scenarios":
                    (root / folder / path.name).symlink_to(path)
        if cell.change is not None:
            _change_scenarios(root, cell.change)
            _change_sources(root, cell.change)
        _leave_out(next((root / "chapters").glob(f"{cell.chapter}-*.md")), cell.skips)
        yield Project(root)


def _change_scenarios(root: Path, change: Alternative) -> None:
    folder = root / "data" / "scenarios"
    for scenario, file in change.files.items():
        _replace(folder / f"{scenario}.yaml", (folder / f"{file}.yaml").read_text("utf-8"))
    for scenario in {*change.values, *change.factors}:
        path = folder / f"{scenario}.yaml"
        content = read_yaml(path)
        for key, value in change.values.get(scenario, {}).items():
            content[key] |= {"value": value, "source": "assumed", "why": _CHANGED}
        for key, factor in change.factors.get(scenario, {}).items():
            value = (np.asarray(content[key]["value"]) * factor).tolist()
            content[key] |= {"value": value, "source": "assumed", "why": _CHANGED}
        _replace(path, yaml.safe_dump(content, sort_keys=False))


def _change_sources(root: Path, change: Alternative) -> None:
    for edit in change.edits:
        path = next((root / "chapters").glob(f"{edit.chapter}-*.md"))
        source = path.read_text(encoding="utf-8")
        if source.count(edit.old) != 1:
            raise InswsnError(
                f"The passage that {change.id} replaces does not stand in {path.name} exactly once."
            )
        _replace(path, source.replace(edit.old, edit.new))


def _leave_out(path: Path, titles: Iterable[str]) -> None:
    source = path.read_text(encoding="utf-8")
    for title in titles:
        # to the next heading of the same rank; a label before that heading goes, too
        source, found = re.subn(
            rf"^## {re.escape(title)}\n.*?(?=^## |\Z)", "", source, flags=re.MULTILINE | re.DOTALL
        )
        if found != 1:
            raise InswsnError(f"{path.name} has no section {title!r}, or more than one.")
    _replace(path, source)


def _replace(path: Path, text: str) -> None:
    """Put a file in the place of a link."""
    path.unlink()
    path.write_text(text, encoding="utf-8")


class Working:
    """The finished runs of a study that is under way, so that it can be stopped and gone on with.

    Parameters
    ----------
    path : Path
        A file with one run a line; it need not be there.
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        self._runs: dict[str, Run] = {}
        if path.is_file():
            for line in path.read_text(encoding="utf-8", errors="replace").splitlines():
                try:
                    run = Run.model_validate_json(line)
                except ValidationError:  # the line that a kill cut short
                    continue
                self._runs[f"{run.chapter} {run.id} {run.key}"] = run

    def find(self, cell: Cell, key: str) -> Run | None:
        """Return the run of a cell if it was made from the same."""
        return self._runs.get(f"{cell.chapter} {cell.id} {key}")

    def add(self, run: Run) -> None:
        """Keep a run."""
        self._runs[f"{run.chapter} {run.id} {run.key}"] = run
        self._path.parent.mkdir(parents=True, exist_ok=True)
        # a line that a kill cut short has no end; what is empty is dropped when it is read
        with self._path.open("a", encoding="utf-8") as stream:
            stream.write("\n" + run.model_dump_json() + "\n")
