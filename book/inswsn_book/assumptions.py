"""What the papers leave unsaid and what stands in its place: ``data/assumptions.yaml``.

An entry says what a paper leaves out, names the settings of scenarios and the parameters of
chapters that stand in its place, and lists the alternatives to which the sensitivity study
(``studies/sensitivity.py``) sets them. Values, units, sources and reasons are not in the entry:
they are read from where the chapters read them.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, Any, Literal, Self

from pydantic import BaseModel, ConfigDict, Field, ValidationError, model_validator

from inswsn_book.parameters import Value, chapter_schema
from inswsn_book.project import Project
from inswsn_book.results import Results
from inswsn_lib.errors import InswsnError
from inswsn_lib.files import read_yaml
from inswsn_lib.scenario import Setting, load_scenario

#: Where the assumptions stand in a checkout.
ASSUMPTIONS = "data/assumptions.yaml"
#: The scenario files below ``data/scenarios``, each of whose numbers has an entry or is a paper's.
SCENARIOS = ("p1", "p1-inertial", "p1-inertial-all-cells", "p2", "p3")
#: Chapters from this number on retell a result, or work on a reader's own recording: their
#: parameters stand for nothing that a paper could say.
RETELLING = "60"

Text = Annotated[str, Field(min_length=3, pattern=r"^[^\n]+$")]
Chapter = Annotated[str, Field(pattern=r"^\d\d$")]
Word = Annotated[str, Field(pattern=r"^[a-z0-9]+(-[a-z0-9]+)*$")]
Number = float | str | list[float] | list[list[float]]


class _Entry(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid")


class Headline(_Entry):
    """A result that the study watches: a quantity of a chapter, or the ratio of two.

    Attributes
    ----------
    chapter : str
        Two digits.
    quantity : str
        Its name in the chapter's results.
    over : str or None
        The quantity that it is divided by.
    short : str
        A few words for the head of a column.
    says : str
        What it is, with its unit if it has one.
    turns : float or None
        The value on whose other side the conclusion would be another one.
    """

    chapter: Chapter
    quantity: str
    over: str | None = None
    short: Text
    says: Text
    turns: float | None = None

    @property
    def key(self) -> str:
        """Its name within the chapter, such as ``"methods.lssvm/methods.rbf"``."""
        return self.quantity if self.over is None else f"{self.quantity}/{self.over}"

    def value(self, results: Results) -> float:
        """Return it from the results of its chapter.

        Raises
        ------
        InswsnError
            If the results do not hold it.
        """
        return quotient(results, self.quantity, self.over)


def quotient(results: Results, quantity: str, over: str | None) -> float:
    """Return a quantity, or one over another.

    Parameters
    ----------
    results : Results
        Of a chapter.
    quantity : str
    over : str or None
        The quantity to divide by; None for 1.

    Raises
    ------
    InswsnError
        If the results do not hold one of them.
    """
    try:
        value = results[quantity].value
        return value if over is None else value / results[over].value
    except KeyError as missing:
        raise InswsnError(
            f"The results of chapter {results.chapter} hold no quantity {missing.args[0]}, "
            f"which {ASSUMPTIONS} names."
        ) from None


class Reduced(_Entry):
    """How a chapter is run in the study.

    Attributes
    ----------
    parameters : dict
        What is set to have fewer runs.
    seeds : tuple of int
        Other seeds for which the unchanged chapter is run, to tell what is chance; none for a
        chapter without chance.
    skips : tuple of str
        Titles of sections that are left out: no headline and no verdict rests on them.
    """

    parameters: dict[str, Value]
    seeds: tuple[int, ...]
    skips: tuple[Text, ...] = ()


class Chosen(_Entry):
    """What stands in the place of the unsaid: a setting, a parameter, or a choice in words.

    Attributes
    ----------
    scenario, setting : str or None
        The name of a scenario file, without its ending, and of a number in it.
    chapter, parameter : str or None
        A chapter and one of its parameters.
    text : str or None
        A choice that is no number.
    """

    scenario: str | None = None
    setting: str | None = None
    chapter: Chapter | None = None
    parameter: str | None = None
    text: Text | None = None

    @model_validator(mode="after")
    def _one_kind(self) -> Self:
        pairs = (
            (self.scenario, self.setting),
            (self.chapter, self.parameter),
            (self.text, self.text),
        )
        if any((a is None) != (b is None) for a, b in pairs) or (
            sum(a is not None for a, _ in pairs) != 1
        ):
            raise ValueError(
                "a choice is a scenario with a setting, a chapter with a parameter, or a text"
            )
        return self


class Edit(_Entry):
    """A passage of a chapter's source that is replaced, for what no parameter sets.

    Attributes
    ----------
    chapter : str
    old, new : str
        `old` stands in the source exactly once.
    """

    chapter: Chapter
    old: Annotated[str, Field(min_length=10)]
    new: str


class Alternative(_Entry):
    """What the study sets an assumption to.

    Attributes
    ----------
    id : str
        Unique in the entry.
    set : str
        The other choice, for a table.
    why : str
        Why this one.
    chapters : tuple of str
        The chapters that are run again.
    values, factors : dict
        By scenario and setting: the other value, or what the value is multiplied by.
    files : dict of str to str
        By scenario: another scenario file that takes its place.
    parameters : dict
        By chapter and parameter.
    edits : tuple of Edit
        In the sources of chapters.
    """

    id: Word
    set: Annotated[str, Field(min_length=1, pattern=r"^[^\n]+$")]
    why: Text
    chapters: Annotated[tuple[Chapter, ...], Field(min_length=1)]
    values: dict[str, dict[str, Number]] = {}
    factors: dict[str, dict[str, float]] = {}
    files: dict[str, str] = {}
    parameters: dict[Chapter, dict[str, Value]] = {}
    edits: tuple[Edit, ...] = ()

    @model_validator(mode="after")
    def _changes_each_of_its_chapters(self) -> Self:
        everywhere = bool(self.values or self.factors or self.files)
        touched = {*self.parameters, *(edit.chapter for edit in self.edits)}
        if touched - set(self.chapters):
            raise ValueError(f"it changes chapter {min(touched - set(self.chapters))} and does not "
                             "run it")  # fmt: skip
        if not everywhere and set(self.chapters) - touched:
            raise ValueError(f"it runs chapter {min(set(self.chapters) - touched)} unchanged")
        return self


class Within(_Entry):
    """A reading that a chapter computes in each build, beside the one it chose.

    Attributes
    ----------
    chapter : str
    reading : str
        The other choice, for a table.
    quantity, over : str
        What it gives, or the ratio of two quantities.
    headline : str or None
        The key of the headline that it is held against.
    against : str or None
        Or the quantity; then `says` tells what it is.
    says : str or None
    """

    chapter: Chapter
    reading: Text
    quantity: str
    over: str | None = None
    headline: str | None = None
    against: str | None = None
    says: Text | None = None

    @model_validator(mode="after")
    def _held_against_one_thing(self) -> Self:
        if (self.headline is None) == (self.against is None) or (
            (self.against is None) != (self.says is None)
        ):
            raise ValueError("a reading is held against a headline, or against a quantity that is "
                             "explained")  # fmt: skip
        return self


class Assumption(_Entry):
    """One thing that a paper leaves unsaid.

    Attributes
    ----------
    id : str
        Such as ``"P1-M-B"``; it never changes.
    paper : {"P1", "P2", "P3"}
    unsaid : str
        What is left out.
    place : str
        Where one would look for it.
    bounds : str
        Whether what is printed bounds or determines it.
    chosen : tuple of Chosen
        What stands in its place.
    why : str or None
        The reason for a choice in words.
    varied : str or None
        Why no rerun varies it, or what does.
    alternatives : tuple of Alternative
        To what the study sets it.
    within : tuple of Within
        Other readings that the chapters compute.
    seeds : tuple of str
        For the entry on chance: the chapters whose other seeds are its alternatives.
    """

    id: Annotated[str, Field(pattern=r"^P[123]-M-[A-Za-z0-9]+$")]
    paper: Literal["P1", "P2", "P3"]
    unsaid: Text
    place: Text
    bounds: Text
    chosen: Annotated[tuple[Chosen, ...], Field(min_length=1)]
    why: Text | None = None
    varied: Text | None = None
    alternatives: Annotated[tuple[Alternative, ...], Field(max_length=2)] = ()
    within: tuple[Within, ...] = ()
    seeds: tuple[Chapter, ...] = ()

    @model_validator(mode="after")
    def _whole(self) -> Self:
        if not self.id.startswith(self.paper):
            raise ValueError(f"{self.id} is not of {self.paper}")
        if self.why is None and any(choice.text for choice in self.chosen):
            raise ValueError("a choice in words needs a reason, why")
        if not (self.alternatives or self.seeds or self.varied):
            raise ValueError("it has no alternatives, and varied does not say why")
        ids = [alternative.id for alternative in self.alternatives]
        if len(set(ids)) < len(ids):
            raise ValueError("two alternatives have one id")
        return self

    @property
    def anchor(self) -> str:
        """Its label in the book, ``"assumption-p1-m-b"``."""
        return f"assumption-{self.id.lower()}"


class Assumptions(_Entry):
    """What ``data/assumptions.yaml`` holds.

    Attributes
    ----------
    headlines : tuple of Headline
    reduced : dict of str to Reduced
        By chapter.
    printed : dict
        By chapter and parameter: why it is no assumption.
    assumptions : tuple of Assumption
    """

    headlines: Annotated[tuple[Headline, ...], Field(min_length=1)]
    reduced: dict[Chapter, Reduced]
    printed: dict[Chapter, dict[str, Text]]
    assumptions: Annotated[tuple[Assumption, ...], Field(min_length=1)]

    @model_validator(mode="after")
    def _fits_together(self) -> Self:
        names = [entry.id.lower() for entry in self.assumptions]
        for name in names:
            if names.count(name) > 1:
                raise ValueError(f"the id {name} is used twice")
        keys = [(headline.chapter, headline.key) for headline in self.headlines]
        for entry in self.assumptions:
            run = {*entry.seeds, *(c for a in entry.alternatives for c in a.chapters)}
            if run - set(self.reduced):
                raise ValueError(
                    f"{entry.id}: reduced has no chapter {min(run - set(self.reduced))}"
                )
            for reading in entry.within:
                if reading.headline and (reading.chapter, reading.headline) not in keys:
                    raise ValueError(f"{entry.id}: there is no headline {reading.headline}")
        return self

    def of_chapter(self, chapter: str) -> list[Headline]:
        """Return the headlines of a chapter."""
        return [headline for headline in self.headlines if headline.chapter == chapter]

    def headline(self, chapter: str, key: str) -> Headline:
        """Return the headline of that key; ``KeyError`` if there is none."""
        for headline in self.of_chapter(chapter):
            if headline.key == key:
                return headline
        raise KeyError(key)


def load_assumptions(root: Path) -> Assumptions:
    """Read ``data/assumptions.yaml``.

    Parameters
    ----------
    root : Path
        The checkout.

    Raises
    ------
    InswsnError
        If it is missing or not of the form; the sentence names the entry.
    """
    path = root / ASSUMPTIONS
    content = read_yaml(path)
    if not isinstance(content, dict):
        raise InswsnError(f"{path} holds no assumptions.")
    try:
        return Assumptions.model_validate(content)
    except ValidationError as error:
        first = error.errors()[0]
        place = _place(content, first["loc"])
        said = first["msg"].removeprefix("Value error, ")
        said = said if said.startswith("P") else said[:1].lower() + said[1:]  # an id stays
        raise InswsnError(f"{path}: {place}{said}.") from None


def _place(content: dict[str, Any], location: tuple[int | str, ...]) -> str:
    """Return where an error is, with the id of the entry in the place of its number."""
    parts = [str(part) for part in location]
    if len(parts) > 1 and parts[0] == "assumptions" and isinstance(location[1], int):
        entry = content["assumptions"][location[1]]
        if isinstance(entry, dict) and "id" in entry:
            parts[:2] = [str(entry["id"])]
    return f"{'.'.join(parts)}: " if parts else ""


def load_settings(root: Path) -> dict[str, dict[str, Setting]]:
    """Read all scenario files, by their names."""
    return {name: load_scenario(root / f"data/scenarios/{name}.yaml") for name in SCENARIOS}


def problems_of(project: Project, assumptions: Assumptions) -> list[str]:
    """Return all in which the assumptions do not fit the checkout, a sentence each.

    Every setting of a scenario whose source is not the paper, and every parameter of a chapter, has
    an entry or a reason why it needs none; and what an entry names is there.

    Parameters
    ----------
    project : Project
        The checkout.
    assumptions : Assumptions
        From `load_assumptions`.

    Raises
    ------
    InswsnError
        If a scenario or a chapter cannot be read.
    """
    settings = load_settings(project.root)
    parameters = {
        chapter.number: set(chapter_schema(project.root, chapter.number).defaults)
        for chapter in project.chapters()
        if chapter.number < RETELLING
    }
    return [
        *_names_that_are_nowhere(assumptions, settings, parameters),
        *_without_an_entry(assumptions, settings, parameters),
        *_edits_that_do_not_fit(project, assumptions),
    ]


def _names_that_are_nowhere(
    assumptions: Assumptions,
    settings: dict[str, dict[str, Setting]],
    parameters: dict[str, set[str]],
) -> Iterator[str]:
    for entry in assumptions.assumptions:
        named = [(c.scenario, c.setting) for c in entry.chosen if c.scenario and c.setting]
        set_ = [(c.chapter, c.parameter) for c in entry.chosen if c.chapter and c.parameter]
        for other in entry.alternatives:
            for by_scenario in (other.values, other.factors):
                named += [(s, key) for s, keys in by_scenario.items() for key in keys]
            set_ += [(c, key) for c, keys in other.parameters.items() for key in keys]
            for scenario, file in other.files.items():
                if scenario not in settings or file not in settings:
                    yield f"{entry.id}: there is no scenario {scenario} or {file}."
        for scenario, key in named:
            if key not in settings.get(scenario, {}):
                yield f"{entry.id}: the scenario {scenario} has no setting {key}."
        for chapter, key in set_:
            if key not in parameters.get(chapter, set()):
                yield f"{entry.id}: chapter {chapter} has no parameter {key}."


def _without_an_entry(
    assumptions: Assumptions,
    settings: dict[str, dict[str, Setting]],
    parameters: dict[str, set[str]],
) -> Iterator[str]:
    chosen = [choice for entry in assumptions.assumptions for choice in entry.chosen]
    covered = {(choice.scenario, choice.setting) for choice in chosen}
    # the fit to all cells has the same numbers, fitted otherwise
    covered |= {("p1-inertial-all-cells", key) for s, key in covered if s == "p1-inertial"}
    for scenario, keys in settings.items():
        for key, setting in keys.items():
            if setting.source != "paper" and (scenario, key) not in covered:
                yield f"The setting {key} of the scenario {scenario} has no entry."
    stand = {(choice.chapter, choice.parameter) for choice in chosen}
    for chapter, names in parameters.items():
        printed = set(assumptions.printed.get(chapter, {}))
        for name in sorted(printed - names):
            yield f"printed: chapter {chapter} has no parameter {name}."
        for name in sorted(names):
            if ((chapter, name) in stand) == (name in printed):
                yield (
                    f"The parameter {name} of chapter {chapter} has an entry and a reason for "
                    "having none." if name in printed
                    else f"The parameter {name} of chapter {chapter} has no entry."
                )  # fmt: skip


def _edits_that_do_not_fit(project: Project, assumptions: Assumptions) -> Iterator[str]:
    sources = {c.number: c.source.read_text(encoding="utf-8") for c in project.chapters()}
    for entry in assumptions.assumptions:
        for other in entry.alternatives:
            for edit in other.edits:
                if sources.get(edit.chapter, "").count(edit.old) != 1:
                    yield (
                        f"{entry.id}/{other.id}: the passage that it replaces does not stand in "
                        f"chapter {edit.chapter} exactly once."
                    )
