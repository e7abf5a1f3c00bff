"""What the papers leave unsaid, as ``data/assumptions.yaml`` has it: the form of that file.

The book's page shows the file as it is. By this the study of sensitivity reads it, and a run of a
chapter, which is answered by its headlines and may be quick as those of the study are.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from dataclasses import fields
from pathlib import Path
from typing import Annotated

from pydantic import Field

from inswsn_book.judge.review import Findings, Line, Paper, Pointer, load_entries
from inswsn_book.record.parameters import Schema, Value, chapter_schema
from inswsn_book.record.project import Chapter, Project
from inswsn_book.record.results import Frozen, Name, Results
from inswsn_book.run.cores import asked_schema, core_name, load_core
from inswsn_book.run.store import Request
from inswsn_lib.errors import InswsnError
from inswsn_lib.files import read_text
from inswsn_lib.scenario import Setting, load_scenario

ASSUMPTIONS = "data/assumptions.yaml"

#: The scenario files below ``data/scenarios``, each of whose numbers has an entry or is a paper's.
SCENARIOS = ("p1", "p1-inertial", "p1-inertial-all-cells", "p2", "p3")

Number = float | str | list[float] | list[list[float]]


class Headline(Pointer):
    """A number that the sensitivity study watches; beyond `turns` the conclusion is another one."""

    short: Line  # heads a column
    says: Line  # what it is
    turns: float | None = None

    @property
    def key(self) -> str:
        """Its name within the chapter, such as ``"methods.lssvm/methods.rbf"``."""
        return self.quantity if self.over is None else f"{self.quantity}/{self.over}"

    def value(self, results: Results) -> float:
        """Return it from the results of its chapter."""
        return Findings([results], []).value(self)


class Reduced(Frozen):
    """How a chapter is run in the study: with fewer runs, other seeds, and without sections."""

    parameters: dict[str, Value]
    seeds: tuple[int, ...]
    skips: tuple[Line, ...] = ()


class Chosen(Frozen):
    """What stands in the place of the unsaid: a setting, a parameter, or a choice in words."""

    scenario: str | None = None
    setting: str | None = None
    chapter: Name | None = None
    parameter: str | None = None
    text: Line | None = None


class Edit(Frozen):
    """A passage of a chapter's source that is replaced; `old` stands there exactly once."""

    chapter: Name
    old: Annotated[str, Field(min_length=10)]
    new: str


class Alternative(Frozen):
    """What the study sets an assumption to, in which chapters, and how."""

    id: Annotated[str, Field(pattern=r"^[a-z0-9]+(-[a-z0-9]+)*$")]
    set: Annotated[str, Field(min_length=1, pattern=r"^[^\n]+$")]
    why: Line
    chapters: Annotated[tuple[Name, ...], Field(min_length=1)]
    values: dict[str, dict[str, Number]] = {}  # by scenario and setting
    factors: dict[str, dict[str, float]] = {}
    files: dict[str, str] = {}  # another scenario file in the place of one
    parameters: dict[Name, dict[str, Value]] = {}
    edits: tuple[Edit, ...] = ()


class Within(Pointer):
    """A reading that a chapter computes in each build, held against a headline or a quantity."""

    reading: Line
    headline: str | None = None
    against: Name | None = None
    says: Line | None = None


class Assumption(Frozen):
    """One thing that a paper leaves unsaid, and what was chosen."""

    id: Annotated[str, Field(pattern=r"^P[123]-M-[A-Za-z0-9]+$")]
    paper: Paper
    unsaid: Line
    place: Line  # where one would look for it
    bounds: Line  # whether what is printed bounds it
    chosen: Annotated[tuple[Chosen, ...], Field(min_length=1)]
    why: Line | None = None
    varied: Line | None = None  # why no rerun varies it, or what does
    alternatives: Annotated[tuple[Alternative, ...], Field(max_length=2)] = ()
    within: tuple[Within, ...] = ()
    seeds: tuple[Name, ...] = ()  # of the entry on chance: whose other seeds are alternatives


class Assumptions(Frozen):
    """What ``data/assumptions.yaml`` holds; `printed` says why a parameter is no assumption."""

    headlines: Annotated[tuple[Headline, ...], Field(min_length=1)]
    reduced: dict[Name, Reduced]
    printed: dict[Name, dict[str, Line]]
    assumptions: Annotated[tuple[Assumption, ...], Field(min_length=1)]

    def of_chapter(self, chapter: str) -> list[Headline]:
        """Return the headlines of a chapter."""
        return [headline for headline in self.headlines if headline.chapter == chapter]

    def headline(self, chapter: str, key: str) -> Headline:
        """Return the headline of that key."""
        return next(headline for headline in self.of_chapter(chapter) if headline.key == key)


def load_settings(root: Path) -> dict[str, dict[str, Setting]]:
    """Read all scenario files, by their names."""
    return {name: load_scenario(root / f"data/scenarios/{name}.yaml") for name in SCENARIOS}


def load_schemas(project: Project) -> dict[str, Schema]:
    """Read the parameters of the chapters that rebuild the papers, by number."""
    evidence = [c for c in project.chapters() if c.name.startswith("evidence/")]
    numbers = [c.id for c in evidence if not c.number]  # numbered ones retell a result
    return {number: chapter_schema(project.root, number) for number in numbers}


def load_assumptions(root: Path) -> Assumptions:
    """Read ``data/assumptions.yaml``; refuse it with the entry that is not of the form."""
    return load_entries(root / ASSUMPTIONS, Assumptions)


def without_sections(source: str, titles: Iterable[str], name: str) -> str:
    """Return a source without the sections of these titles."""
    for title in titles:
        # to the next heading of the same rank; a label before that heading goes, too
        source, found = re.subn(
            rf"^## {re.escape(title)}\n.*?(?=^## |\Z)", "", source, flags=re.MULTILINE | re.DOTALL
        )
        if found != 1:
            raise InswsnError(f"{name} has no section {title!r}, or more than one.")
    return source


def quick_request(root: Path, chapter: Chapter, values: Mapping[str, Value]) -> Request:
    """Return the request of a quick run, of as few runs as those of the study.

    It is one of the chapter's core, if this has all that is asked; else of the whole notebook.
    """
    reduced = load_assumptions(root).reduced.get(chapter.id, Reduced(parameters={}, seeds=()))
    schema, core = asked_schema(root, chapter, values), core_name(read_text(chapter.source))
    own = {field.name for field in fields(load_core(core))} if core else set[str]()
    few = {n: v for n, v in reduced.parameters.items() if n in own or core is None} | dict(values)
    if core and all(name in own or schema[name].scenario for name in values):
        return Request(chapter.id, few, core=True, brief=True)
    return Request(chapter.id, reduced.parameters | few)
