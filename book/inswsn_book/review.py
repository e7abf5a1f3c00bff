"""What is written by hand on the papers and rests on results: errata, readings, assumptions.

``data/errata.yaml``, ``data/readings.yaml`` and ``data/assumptions.yaml`` hold texts. A text points
at numbers as a claim does, by chapter and quantity: in placeholders such as
``{01:cost.position.percent:.0f}``, and in the evidence on which it rests. A published build whose
results do not bear the evidence out is refused. The pages are templates in ``book/``. What a person
who edits the files may get wrong beyond their form, such as an id used twice, the tests find.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from fnmatch import fnmatchcase
from pathlib import Path
from typing import Annotated, Any, Literal, TypeVar

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from inswsn_book.ledger import Claim, MissingCheck, QuantityCheck
from inswsn_book.parameters import Schema, Value, chapter_schema
from inswsn_book.project import Project
from inswsn_book.results import Finite, Name, Quantity, Results
from inswsn_book.verdicts import Judged, Verdict, verdicts
from inswsn_lib.errors import InswsnError
from inswsn_lib.files import read_yaml
from inswsn_lib.scenario import Setting, load_scenario

ERRATA = "data/errata.yaml"
READINGS = "data/readings.yaml"
ASSUMPTIONS = "data/assumptions.yaml"

#: The scenario files below ``data/scenarios``, each of whose numbers has an entry or is a paper's.
SCENARIOS = ("p1", "p1-inertial", "p1-inertial-all-cells", "p2", "p3")
#: Chapters from this number on retell a result, or work on a reader's own recording: their
#: parameters stand for nothing that a paper could say.
RETELLING = "60"

# {01:cost.position.percent:.0f} and {claim:P1-P-T}; a role, {ref}`...`, has no colon or a backtick
_PLACEHOLDER = re.compile(r"\{([A-Za-z0-9]+):([^{}:`]*)(?::([^{}`]*))?\}(?!`)")
_ENDS = {"low": 0, "high": 1}

#: A text of one or more paragraphs in MyST Markdown, with placeholders
Prose = Annotated[str, Field(min_length=3)]
Line = Annotated[str, Field(min_length=3, pattern=r"^[^\n]+$")]
Paper = Literal["P1", "P2", "P3"]
Chapter = Annotated[str, Field(pattern=r"^\d\d$")]
Number = float | str | list[float] | list[list[float]]


class Entry(BaseModel):
    """Part of a file of texts: it may not be changed, and has no fields but its own."""

    model_config = ConfigDict(frozen=True, extra="forbid")


class Titled(Entry):
    """An entry with an id that never changes, of one paper."""

    id: str
    paper: Paper

    @property
    def anchor(self) -> str:
        """The label of its place in the book, such as ``"erratum-e-p1-01"``."""
        kind = {"E": "erratum", "R": "reading"}.get(self.id[0], "assumption")
        return f"{kind}-{self.id.lower()}"


class Pointer(Entry):
    """The one way to name a number: a quantity of a chapter, or its ratio to another one."""

    chapter: Chapter
    quantity: Name
    over: Name | None = None


# Evidence: what decides whether a text may stand


class Sentence(Entry):
    """A sentence that a chapter binds to a condition; it must hold."""

    chapter: Chapter
    sentence: Line


class Bound(Pointer):
    """A number that must lie within bounds, in its unit; one of them or both."""

    at_least: Finite | None = None
    at_most: Finite | None = None


class Ruling(Entry):
    """A claim of the ledger that must have a certain verdict."""

    claim: str
    verdict: Verdict


Evidence = Sentence | Bound | Ruling


class Findings:
    """All that the chapters found: their results, and the claims judged by them.

    What names a thing that is not there is refused.
    """

    def __init__(self, results: Iterable[Results], judged: Iterable[Judged]) -> None:
        self.results = {result.chapter: result for result in results}
        self.judged = {entry.claim.id: entry for entry in judged}

    def quantity(self, chapter: str, name: str) -> Quantity:
        """Return a quantity of a chapter."""
        try:
            return self._chapter(chapter)[name]
        except KeyError:
            raise InswsnError(f"chapter {chapter} records no quantity {name}.") from None

    def claim(self, identity: str) -> Judged:
        """Return a judged claim."""
        if identity not in self.judged:
            raise InswsnError(f"the ledger has no claim {identity}.")
        return self.judged[identity]

    def claims(self, identities: Iterable[str]) -> list[Judged]:
        """Return judged claims."""
        return [self.claim(identity) for identity in identities]

    def _chapter(self, chapter: str) -> Results:
        if chapter not in self.results:
            raise InswsnError(f"there are no results of chapter {chapter}.")
        return self.results[chapter]

    def quotient(self, chapter: str, quantity: str, over: str | None = None) -> float:
        """Return the value of a quantity, or that of one over another."""
        value = self.quantity(chapter, quantity).value
        return value if over is None else value / self.quantity(chapter, over).value

    def value(self, named: Pointer) -> float:
        """Return the number that is named."""
        return self.quotient(named.chapter, named.quantity, named.over)

    def holds(self, evidence: Evidence) -> bool:
        """Tell whether evidence holds."""
        if isinstance(evidence, Ruling):
            return self.claim(evidence.claim).verdict is evidence.verdict
        if isinstance(evidence, Bound):
            value = self.value(evidence)
            low = evidence.at_least is None or value >= evidence.at_least
            return low and (evidence.at_most is None or value <= evidence.at_most)
        sentences = self._chapter(evidence.chapter).sentences
        if evidence.sentence not in sentences:
            raise InswsnError(
                f"chapter {evidence.chapter} binds no sentence {evidence.sentence!r}."
            )
        return sentences[evidence.sentence]

    def failed(self, evidence: Iterable[Evidence]) -> list[Evidence]:
        """Return the evidence that does not hold."""
        return [entry for entry in evidence if not self.holds(entry)]

    def fill(self, text: str) -> str:
        """Put numbers and verdicts in the place of placeholders.

        They are ``{01:name:.2f}`` for a number, ``{01:name@low:.2f}`` and ``@high`` for the ends of
        its interval, ``{01:name:.0%}`` for a share in per cent, and ``{claim:P1-P-T}`` for a claim
        with its verdict.
        """
        return _PLACEHOLDER.sub(self._filled, text.strip())

    def _filled(self, match: re.Match[str]) -> str:
        where, name, form = match.groups()
        if where == "claim" and form is None:
            entry = self.claim(name)
            return f"{claim_link(entry.claim)} (*{entry.verdict}*)"
        if not re.fullmatch(r"\d\d", where):
            raise InswsnError(
                f"{match[0]} is no placeholder; it may be {{01:name:.2f}} or {{claim:P1-P-T}}."
            )
        quantity, end = self._part(where, name)
        value = quantity.value
        if end is not None:
            if quantity.interval is None:
                raise InswsnError(f"{match[0]} asks for an interval, and there is none.")
            value = quantity.interval[end]
        try:
            shown = format(value, form or "g")
        except ValueError:
            raise InswsnError(f"{match[0]} has a format that does not fit a number.") from None
        return f"**{shown.replace('%', ' %').replace('-', '−')}**"

    def _part(self, chapter: str, name: str) -> tuple[Quantity, int | None]:
        """Return a quantity, and which end of its interval is meant: 0, 1 or none."""
        base, _, end = name.partition("@")
        if end and end not in _ENDS:
            raise InswsnError(f"@{end} is no end of an interval; it may be @low or @high.")
        return self.quantity(chapter, base), _ENDS.get(end)

    def numbers(self, texts: Iterable[str]) -> list[tuple[str, Quantity]]:
        """Return the quantities that texts show, each once, with its chapter."""
        found = {}
        for text in texts:
            for where, name, _ in _PLACEHOLDER.findall(text):
                if where != "claim":
                    quantity, _ = self._part(where, name)
                    found[where, quantity.name] = quantity
        return [(chapter, quantity) for (chapter, _), quantity in found.items()]


def claim_link(claim: Claim) -> str:
    """Return a link to a claim's entry on the page of claims."""
    return f"[{claim.id}](#{claim.anchor})"


def escape_text(text: str) -> str:
    """Return plain text such that Markdown shows it as it is."""
    return re.sub(r"([\\`*_\[\]<>{}$~|^])", r"\\\1", text)


# Errata


class Erratum(Titled):
    """One error of a paper, with what must hold for it to stand."""

    id: Annotated[str, Field(pattern=r"^E-P[123]-[0-4]\d$")]
    place: Line
    kind: Literal["algebra", "number", "notation", "statement", "missing condition", "labelling"]
    title: Line
    printed: Prose  # what stands there
    derivation: Prose  # why it is wrong
    effect: Prose  # what changes in numbers
    correction: Prose
    changes: Literal["yes", "no", "unknown"]
    evidence: Annotated[tuple[Evidence, ...], Field(min_length=1)]
    # the test that confirms it by a small computation of its own
    tested: Annotated[str, Field(pattern=r"^test_\w+$")] | None = None
    claims: tuple[str, ...] = ()  # of the ledger that it touches

    @property
    def texts(self) -> tuple[str, ...]:
        """The texts with placeholders."""
        return self.printed, self.derivation, self.effect, self.correction


class Slip(Titled):
    """A slip of the pen that misleads nobody for long; slips count from 51."""

    id: Annotated[str, Field(pattern=r"^E-P[123]-[5-9]\d$")]
    place: Line
    printed: Line
    meant: Line
    evidence: tuple[Evidence, ...] = ()

    @property
    def texts(self) -> tuple[str, ...]:
        """The texts with placeholders."""
        return self.place, self.printed, self.meant


class Errata(Entry):
    """All errors found."""

    errata: tuple[Erratum, ...]
    slips: tuple[Slip, ...] = ()


# Rival readings

#: How sure a statement on what was computed is, from the surest on
Certainty = Literal["printed", "best", "consistent", "rebuilt", "unexplained"]


class Reading(Entry):
    """One way to read a place; `judged` names claims that it would judge by another quantity."""

    name: Line
    found: Prose
    taken: bool = False
    judged: dict[str, QuantityCheck] = Field(default_factory=dict)


class Question(Titled):
    """A place that admits more than one reading, of which at most one is taken.

    `claims` are those whose verdicts hang on it; ``*`` stands for any characters.
    """

    id: Annotated[str, Field(pattern=r"^R-P[123]-\d\d$")]
    place: Line
    title: Line
    says: Prose
    readings: Annotated[tuple[Reading, ...], Field(min_length=2)]
    why: Prose
    decides: Prose
    changes: Prose
    claims: Annotated[tuple[str, ...], Field(min_length=1)]

    @property
    def taken(self) -> str | None:
        """The name of the reading that the book takes."""
        return next((reading.name for reading in self.readings if reading.taken), None)

    @property
    def texts(self) -> tuple[str, ...]:
        """The texts with placeholders."""
        return *(reading.found for reading in self.readings), self.why, self.decides, self.changes

    def hanging(self, findings: Findings) -> list[Judged]:
        """Return the claims that hang on it; refuse a pattern that fits none."""
        found: set[str] = set()
        for pattern in self.claims:
            fitting = [name for name in findings.judged if fnmatchcase(name, pattern)]
            if not fitting:
                raise InswsnError(f"no claim of the ledger fits {pattern}.")
            found |= set(fitting)
        return [entry for name, entry in findings.judged.items() if name in found]


class Statement(Entry):
    """One statement on what the authors must have computed; `where` is the section it rests on."""

    paper: Paper
    says: Prose
    certainty: Certainty
    where: Annotated[str, Field(pattern=r"^[a-z0-9-]+$")]
    evidence: Annotated[tuple[Evidence, ...], Field(min_length=1)]


class Readings(Entry):
    """All questions, and what must have been computed."""

    questions: tuple[Question, ...]
    computed: tuple[Statement, ...] = ()


def judged_anew(reading: Reading, findings: Findings) -> list[tuple[Judged, Judged]]:
    """Return the claims that a reading judges by another quantity: as they are, and would be."""
    pairs = []
    for identity, check in reading.judged.items():
        now = findings.claim(identity)
        other = now.claim.model_copy(update={"check": check, "assumption": reading.name})
        pairs.append((now, verdicts([other], findings.results.values())[0]))
    return pairs


def other_claims(
    readings: Readings, findings: Findings
) -> list[tuple[str, tuple[str, ...], list[Judged]]]:
    """Return the claims that no question names, by what would change their verdicts.

    That is the kind (``print``, ``algebra``, ``data``, ``nothing`` or ``missing``, in this order)
    and what is missing.
    """
    named = {e.claim.id for question in readings.questions for e in question.hanging(findings)}
    groups: dict[tuple[str, tuple[str, ...]], list[Judged]] = {}
    for name, entry in findings.judged.items():
        if name not in named:
            groups.setdefault(_changed_by(entry), []).append(entry)
    order = ("print", "algebra", "data", "nothing", "missing")
    keys = sorted(groups, key=lambda key: (order.index(key[0]), " ".join(key[1])))
    return [(*key, groups[key]) for key in keys]


def _changed_by(entry: Judged) -> tuple[str, tuple[str, ...]]:
    if isinstance(entry.claim.check, MissingCheck):
        return "missing", entry.claim.check.reasons
    if entry.verdict in (Verdict.INPUT, Verdict.CALIBRATED, Verdict.UNTESTABLE):
        return "nothing", ()
    if entry.quantity is not None and entry.quantity.basis == "printed":
        return "print", ()
    return ("algebra" if entry.claim.kind == "formula" else "data"), ()


# Assumptions


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


class Reduced(Entry):
    """How a chapter is run in the study: with fewer runs, other seeds, and without sections."""

    parameters: dict[str, Value]
    seeds: tuple[int, ...]
    skips: tuple[Line, ...] = ()


class Chosen(Entry):
    """What stands in the place of the unsaid: a setting, a parameter, or a choice in words."""

    scenario: str | None = None
    setting: str | None = None
    chapter: Chapter | None = None
    parameter: str | None = None
    text: Line | None = None


class Edit(Entry):
    """A passage of a chapter's source that is replaced; `old` stands there exactly once."""

    chapter: Chapter
    old: Annotated[str, Field(min_length=10)]
    new: str


class Alternative(Entry):
    """What the study sets an assumption to, in which chapters, and how."""

    id: Annotated[str, Field(pattern=r"^[a-z0-9]+(-[a-z0-9]+)*$")]
    set: Annotated[str, Field(min_length=1, pattern=r"^[^\n]+$")]
    why: Line
    chapters: Annotated[tuple[Chapter, ...], Field(min_length=1)]
    values: dict[str, dict[str, Number]] = {}  # by scenario and setting
    factors: dict[str, dict[str, float]] = {}
    files: dict[str, str] = {}  # another scenario file in the place of one
    parameters: dict[Chapter, dict[str, Value]] = {}
    edits: tuple[Edit, ...] = ()


class Within(Pointer):
    """A reading that a chapter computes in each build, held against a headline or a quantity."""

    reading: Line
    headline: str | None = None
    against: Name | None = None
    says: Line | None = None


class Assumption(Titled):
    """One thing that a paper leaves unsaid, and what was chosen."""

    id: Annotated[str, Field(pattern=r"^P[123]-M-[A-Za-z0-9]+$")]
    unsaid: Line
    place: Line  # where one would look for it
    bounds: Line  # whether what is printed bounds it
    chosen: Annotated[tuple[Chosen, ...], Field(min_length=1)]
    why: Line | None = None
    varied: Line | None = None  # why no rerun varies it, or what does
    alternatives: Annotated[tuple[Alternative, ...], Field(max_length=2)] = ()
    within: tuple[Within, ...] = ()
    seeds: tuple[Chapter, ...] = ()  # of the entry on chance: whose other seeds are alternatives


class Assumptions(Entry):
    """What ``data/assumptions.yaml`` holds; `printed` says why a parameter is no assumption."""

    headlines: Annotated[tuple[Headline, ...], Field(min_length=1)]
    reduced: dict[Chapter, Reduced]
    printed: dict[Chapter, dict[str, Line]]
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
    numbers = [c.number for c in project.chapters() if c.number < RETELLING]
    return {number: chapter_schema(project.root, number) for number in numbers}


# Reading the files

_Model = TypeVar("_Model", bound=BaseModel)


def load_errata(root: Path) -> Errata:
    """Read ``data/errata.yaml``; refuse it with the entry that is not of the form."""
    return _load(root / ERRATA, Errata)


def load_readings(root: Path) -> Readings:
    """Read ``data/readings.yaml``; refuse it with the entry that is not of the form."""
    return _load(root / READINGS, Readings)


def load_assumptions(root: Path) -> Assumptions:
    """Read ``data/assumptions.yaml``; refuse it with the entry that is not of the form."""
    return _load(root / ASSUMPTIONS, Assumptions)


def _load(path: Path, model: type[_Model]) -> _Model:
    content = read_yaml(path)
    try:
        return model.model_validate(content)
    except ValidationError as error:
        first = error.errors()[0]
        place = _place([str(part) for part in first["loc"]], content)
        said = first["msg"].removeprefix("Value error, ")
        raise InswsnError(f"{path} is not a list of {path.stem}: {place}: {said}.") from None


def _place(parts: list[str], content: Any) -> str:
    """Return where in a file something is wrong, with an entry's id rather than its number."""
    listed = content.get(parts[0]) if isinstance(content, dict) and parts else None
    if len(parts) > 1 and isinstance(listed, list):
        entry = listed[int(parts[1])]
        name = entry.get("id") if isinstance(entry, dict) else None
        parts[:2] = [str(name or f"{parts[0]} number {parts[1]}")]
    return ": ".join(parts) or "the file"


def require_evidence(errata: Errata | None, readings: Readings | None, findings: Findings) -> None:
    """Refuse texts whose evidence does not hold, or that name what is not there.

    A run with other parameters may overturn evidence; then its pages say so. What is published may
    not.
    """
    entries: list[tuple[str, Sequence[Evidence], Sequence[str]]] = []
    if errata is not None:
        entries += [(f"{ERRATA}: {e.id}", e.evidence, e.texts) for e in errata.errata]
        entries += [(f"{ERRATA}: {s.id}", s.evidence, s.texts) for s in errata.slips]
    if readings is not None:
        entries += [(f"{READINGS}: {q.id}", (), q.texts) for q in readings.questions]
        entries += [
            (f"{READINGS}: computed, {s.paper}, {s.says[:40]!r}", s.evidence, (s.says,))
            for s in readings.computed
        ]
    for name, evidence, texts in entries:
        try:
            failed = findings.failed(evidence)
            for text in texts:
                findings.fill(text)
        except InswsnError as error:
            raise InswsnError(f"{name}: {error}") from None
        if failed:
            said = ", ".join(f"{key}: {value}" for key, value in failed[0] if value is not None)
            raise InswsnError(f"{name}: its evidence does not hold ({said}).")
