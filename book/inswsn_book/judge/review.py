"""What is written by hand on the papers and rests on results: errata, and rival readings.

``data/errata.yaml`` and ``data/readings.yaml`` hold texts. A text points at numbers as a claim
does, by chapter and quantity: in placeholders such as ``{01:cost.position.percent:.0f}``, and in
the evidence on which it rests. A published build whose results do not bear the evidence out is
refused. What may be wrong beyond the form of the files, such as an id used twice, the tests find.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from dataclasses import replace
from fnmatch import fnmatchcase
from pathlib import Path
from typing import Annotated, ClassVar, Literal, TypeVar

from pydantic import Field, ValidationError

from inswsn_book.judge.ledger import Claim, QuantityCheck
from inswsn_book.judge.verdicts import Judged, Named, Read, Verdict, verdicts
from inswsn_book.record.results import (
    Finite,
    Frozen,
    Name,
    Quantity,
    Results,
    first_problem,
    read_results,
)
from inswsn_lib.errors import InswsnError
from inswsn_lib.files import read_yaml

ERRATA = "data/errata.yaml"
READINGS = "data/readings.yaml"
#: What reruns of chapters with other parameters found, a file for each chapter
RERUNS = "data/reruns"

# {01:cost.position.percent:.0f} and {claim:P1-P-T}; a role, {ref}`...`, has no colon or a backtick
_PLACEHOLDER = re.compile(r"\{([\w-]+):([\w.-]+)(@low|@high)?(?::([^{}`]*))?\}(?!`)")

#: A text of one or more paragraphs in MyST Markdown, with placeholders
Prose = Annotated[str, Field(min_length=3)]
Line = Annotated[str, Field(min_length=3, pattern=r"^[^\n]+$")]
Paper = Literal["P1", "P2", "P3"]


class Pointer(Frozen):
    """The one way to name a number: a quantity of a chapter, or its ratio to another one."""

    chapter: Name
    quantity: Name
    over: Name | None = None


# Evidence: what decides whether a text may stand


class Sentence(Frozen):
    """A sentence that a chapter binds to a condition; it must hold."""

    chapter: Name
    sentence: Line


class Bound(Pointer):
    """A number that must lie within bounds, in its unit; one of them or both."""

    at_least: Finite | None = None
    at_most: Finite | None = None


class Ruling(Frozen):
    """A claim of the ledger that must have a certain verdict, assumed or not."""

    claim: str
    verdict: Verdict


Evidence = Sentence | Bound | Ruling


class Entry(Frozen):
    """A text of a file, of one paper, with an id that never changes, and what it rests on."""

    id: str
    paper: Paper
    evidence: tuple[Evidence, ...] = ()
    shown: ClassVar[tuple[str, ...]] = ()  # the fields with placeholders

    @property
    def anchor(self) -> str:
        """The label of its place in the book, such as ``"erratum-e-p1-01"``."""
        return f"{'erratum' if self.id.startswith('E') else 'reading'}-{self.id.lower()}"

    @property
    def texts(self) -> tuple[str, ...]:
        """The texts with placeholders."""
        return tuple(getattr(self, name) for name in self.shown)


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
            return self.results[chapter][name]
        except KeyError:
            raise InswsnError(f"chapter {chapter} records no quantity {name}.") from None

    def claim(self, identity: str) -> Judged:
        """Return a judged claim."""
        if identity not in self.judged:
            raise InswsnError(f"the ledger has no claim {identity}.")
        return self.judged[identity]

    def fitting(self, pattern: str) -> list[Judged]:
        """Return the claims whose ids fit a pattern; refuse one that fits none."""
        names = [name for name in self.judged if fnmatchcase(name, pattern)]
        if not names:
            raise InswsnError(f"the ledger has no claim that fits {pattern}.")
        return [self.judged[name] for name in names]

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
        try:
            return self.results[evidence.chapter].sentences[evidence.sentence]
        except KeyError as key:
            raise InswsnError(f"chapter {evidence.chapter} binds no sentence {key}.") from None

    def failed(self, evidence: Iterable[Evidence]) -> list[Evidence]:
        """Return the evidence that does not hold."""
        return [entry for entry in evidence if not self.holds(entry)]

    def fill(self, text: str) -> str:
        """Put numbers and verdicts in the place of placeholders.

        They are ``{01:name:.2f}`` for a number, ``{01:name@low:.2f}`` and ``@high`` for the ends of
        its interval, ``{01:name:.0%}`` for a share in per cent, and ``{claim:P1-P-T}`` for a claim
        with its verdict. A number is marked by its placeholder, for `inswsn verify`.
        """
        return _PLACEHOLDER.sub(self._filled, text.strip())

    def _filled(self, match: re.Match[str]) -> str:
        where, name, end, form = match.groups()
        if where == "claim":
            entry = self.claim(name)
            return f"{claim_link(entry.claim)} (*{entry.words}*)"
        quantity = self.quantity(where, name)
        try:
            ends = (quantity.value,) if end is None else quantity.interval or ()
            shown = format(ends[end == "@high"], form or "g")
        except (IndexError, ValueError):
            raise InswsnError(f"{match[0]} has a wrong format, or there is no interval.") from None
        shown = f"**{shown.replace('%', ' %').replace('-', '−')}**"
        return f'<span data-quantity="{match[0][1:-1]}">{shown}</span>'

    def numbers(self, texts: Iterable[str]) -> list[tuple[str, Quantity]]:
        """Return the quantities that texts show, each once, with its chapter."""
        found = [found for text in texts for found in _PLACEHOLDER.findall(text)]
        named = dict.fromkeys((where, name) for where, name, _, _ in found if where != "claim")
        return [(where, self.quantity(where, name)) for where, name in named]


def claim_link(claim: Claim) -> str:
    """Return a link to a claim's entry on the page of claims."""
    return f"[{claim.id}](#{claim.anchor})"


def escape_text(text: str) -> str:
    """Return plain text such that Markdown shows it as it is."""
    return re.sub(r"([\\`*_\[\]<>{}$~|^])", r"\\\1", text)


# Errata


class Erratum(Entry):
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
    shown: ClassVar[tuple[str, ...]] = ("printed", "derivation", "effect", "correction")


class Slip(Entry):
    """A slip of the pen that misleads nobody for long; slips count from 51."""

    id: Annotated[str, Field(pattern=r"^E-P[123]-[5-9]\d$")]
    place: Line
    printed: Line
    meant: Line
    shown: ClassVar[tuple[str, ...]] = ("place", "printed", "meant")


class Errata(Frozen):
    """All errors found."""

    errata: tuple[Erratum, ...]
    slips: tuple[Slip, ...] = ()


# Rival readings

#: How sure a statement on what was computed is, from the surest on
Certainty = Literal["printed", "best", "consistent", "rebuilt", "unexplained"]


class Anew(Frozen):
    """Claims that a reading judges by the quantities of its own run of the same computation.

    These have the names of those that decide, behind a prefix: ``square`` for
    ``square.table3.lssvm.rx1``. The chapter records them, or a rerun of it, see `with_reruns`. In
    `claims` ``*`` stands for any characters.
    """

    claims: Annotated[tuple[str, ...], Field(min_length=1)]
    prefix: Name
    tolerance: str | None = None  # in the place of the claim's own


class Reading(Frozen):
    """One way to read a place; `judged` and `anew` say by what it would judge claims instead."""

    name: Line
    found: Prose
    taken: bool = False
    judged: dict[str, QuantityCheck] = Field(default_factory=dict)
    anew: tuple[Anew, ...] = ()


class Question(Entry):
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
    shown: ClassVar[tuple[str, ...]] = ("why", "decides", "changes")

    @property
    def texts(self) -> tuple[str, ...]:
        """The texts with placeholders."""
        return (*(reading.found for reading in self.readings), *super().texts)

    def hanging(self, findings: Findings) -> list[Judged]:
        """Return the claims that hang on it; refuse a pattern that fits none."""
        found = {entry.claim.id for pattern in self.claims for entry in findings.fitting(pattern)}
        return [entry for name, entry in findings.judged.items() if name in found]


class Statement(Entry):
    """One statement on what the authors must have computed; `where` is the section it rests on."""

    id: str = "computed"
    says: Prose
    certainty: Certainty
    where: Annotated[str, Field(pattern=r"^[a-z0-9-]+$")]
    evidence: Annotated[tuple[Evidence, ...], Field(min_length=1)]
    shown: ClassVar[tuple[str, ...]] = ("says",)


class Readings(Frozen):
    """All questions, and what must have been computed."""

    questions: tuple[Question, ...]
    computed: tuple[Statement, ...] = ()


def with_reruns(root: Path, results: Iterable[Results]) -> list[Results]:
    """Return results with the quantities that `RERUNS` keeps of reruns, behind their prefixes."""
    kept = {path.stem: read_results(path).quantities for path in (root / RERUNS).glob("*.json")}
    whole = []
    for found in results:
        both = (*found.quantities, *kept.get(found.chapter, ()))
        quantities = tuple({quantity.name: quantity for quantity in both}.values())
        whole.append(found.model_copy(update={"quantities": quantities}))
    return whole


def judged_anew(reading: Reading, findings: Findings) -> list[tuple[Judged, Judged]]:
    """Return the claims that a reading judges by another quantity: as they are, and would be."""
    others: list[tuple[Judged, QuantityCheck, str | None]] = [
        (findings.claim(name), check, None) for name, check in reading.judged.items()
    ]
    for rule in reading.anew:
        for now in (entry for pattern in rule.claims for entry in findings.fitting(pattern)):
            if isinstance(now.claim.check, QuantityCheck):
                name = f"{rule.prefix}.{now.claim.check.quantity}"
                check = now.claim.check.model_copy(update={"quantity": name})
                others.append((now, check, rule.tolerance))
    pairs = []
    for now, check, tolerance in others:
        changed = {"check": check, "assumption": reading.name}
        changed |= {"tolerance": tolerance} if tolerance else {}
        other = now.claim.model_copy(update=changed)
        pairs.append((now, verdicts([other], findings.results.values())[0]))
    return pairs


def with_readings(
    judged: Sequence[Judged], readings: Readings, results: Iterable[Results]
) -> list[Judged]:
    """Return the claims with the verdict by each reading, where another one is computed."""
    findings, read = Findings(results, judged), dict[str, list[Read]]()
    for question in readings.questions:
        for reading in question.readings:
            for now, other in judged_anew(reading, findings):
                own = Read("as decided here", now.words, now.verdict.holds)
                new = Read(f"{question.id}: {reading.name}", other.words, other.verdict.holds)
                read.setdefault(now.claim.id, [own]).append(new)
    return [replace(entry, readings=tuple(read.get(entry.claim.id, ()))) for entry in judged]


def with_entries(judged: Sequence[Judged], entries: Sequence[Question | Erratum]) -> list[Judged]:
    """Return the claims with the readings and errata that name them."""
    named = [(Named(e.id, e.anchor, e.title), e.claims) for e in entries]
    return [
        replace(
            entry,
            hangs_on=tuple(
                name
                for name, patterns in named
                if any(fnmatchcase(entry.claim.id, pattern) for pattern in patterns)
            ),
        )
        for entry in judged
    ]


# Reading the files

_Model = TypeVar("_Model", bound=Frozen)


def load_entries(path: Path, model: type[_Model]) -> _Model:
    """Read a file of texts; refuse it with the entry that is not of the form."""
    content = read_yaml(path)
    try:
        return model.model_validate(content)
    except ValidationError as error:
        said = first_problem(error, content=content)
    raise InswsnError(f"{path} is not a list of {path.stem}: {said}.")


def require_evidence(entries: Iterable[Entry], findings: Findings) -> None:
    """Refuse texts whose evidence does not hold, or that name what is not there.

    A run with other parameters may overturn evidence; then its pages say so. What is published may
    not.
    """
    for entry in entries:
        try:
            failed = findings.failed(entry.evidence)
            for text in entry.texts:
                findings.fill(text)
        except InswsnError as error:
            raise InswsnError(f"{entry.id} of {entry.paper}: {error}") from None
        if failed:
            said = ", ".join(f"{key}: {value}" for key, value in failed[0] if value is not None)
            raise InswsnError(f"{entry.id} of {entry.paper}: its evidence does not hold ({said}).")
