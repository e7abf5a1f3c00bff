"""The rival readings of the papers, ``data/readings.yaml``, and their page.

Where a paper admits more than one reading, an entry names them, says which one the book takes and
why, what came of each, and what would decide. A reading may name quantities by which claims would
be judged if it were the right one; those verdicts are computed. A list at the end covers the claims
that no entry names, by rules on how their verdicts came about.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from fnmatch import fnmatchcase
from functools import partial
from pathlib import Path
from typing import Annotated, Literal, Self

from pydantic import Field, model_validator

from inswsn_book.evidence import (
    Entry,
    Evidence,
    Findings,
    Prose,
    anchor,
    cite,
    claim_link,
    named,
    read_entries,
    refuse_repeated,
)
from inswsn_book.ledger import PAPERS, MissingCheck, QuantityCheck
from inswsn_book.tables import list_table
from inswsn_book.verdicts import Judged, Verdict, count_verdicts, verdicts
from inswsn_lib.errors import InswsnError

#: Where it stands in a checkout.
READINGS = "data/readings.yaml"

Line = Annotated[str, Field(min_length=3, pattern=r"^[^\n]+$")]
Paper = Literal["P1", "P2", "P3"]

#: How sure a statement on what was computed is, from the surest on.
CERTAINTIES = {
    "printed": "proved from printed digits",
    "best": "best of the hypotheses that were named before scoring",
    "consistent": "fits what is printed, and so do others",
    "rebuilt": "follows in our simulation; the paper's own data could say otherwise",
    "unexplained": "unexplained",
}


class Reading(Entry):
    """One way to read a place.

    Attributes
    ----------
    name : str
        The reading, in a few words.
    found : str
        What it would mean, and what came of it.
    taken : bool
        Whether it is the one that the book takes.
    judged : dict of str to QuantityCheck
        Claims that would be judged by another quantity if the reading were right.
    """

    name: Line
    found: Prose
    taken: bool = False
    judged: dict[str, QuantityCheck] = Field(default_factory=dict)


class Question(Entry):
    """A place that admits more than one reading.

    Attributes
    ----------
    id : str
        ``R-P1-01``; it never changes.
    paper : {"P1", "P2", "P3"}
    place : str
        Where it is.
    title : str
        The question.
    says : str
        What the paper says, in a few words.
    readings : tuple of Reading
        Two or more; at most one is taken.
    why : str
        Why the book takes what it takes.
    decides : str
        What evidence would decide: a sentence of the authors, a data file, a figure.
    changes : str
        Which verdicts would change then, and to what as far as it is computed.
    claims : tuple of str
        The claims whose verdicts hang on it; ``*`` stands for any characters.
    """

    id: Annotated[str, Field(pattern=r"^R-P[123]-\d\d$")]
    paper: Paper
    place: Line
    title: Line
    says: Prose
    readings: Annotated[tuple[Reading, ...], Field(min_length=2)]
    why: Prose
    decides: Prose
    changes: Prose
    claims: Annotated[tuple[str, ...], Field(min_length=1)]

    @model_validator(mode="after")
    def _parts_fit(self) -> Self:
        if not self.id.startswith(f"R-{self.paper}-"):
            raise ValueError(f"the id does not begin with R-{self.paper}-")
        if sum(reading.taken for reading in self.readings) > 1:
            raise ValueError("more than one reading is taken")
        return self

    @property
    def anchor(self) -> str:
        """The label of its section."""
        return anchor("reading", self.id)


class Statement(Entry):
    """One statement on what the authors must have computed.

    Attributes
    ----------
    paper : {"P1", "P2", "P3"}
    says : str
        The statement, in plain words.
    certainty : str
        One of `CERTAINTIES`.
    where : str
        The label of the section that it rests on.
    evidence : tuple of Evidence
        What decides it; all of it must hold.
    """

    paper: Paper
    says: Prose
    certainty: Literal["printed", "best", "consistent", "rebuilt", "unexplained"]
    where: Annotated[str, Field(pattern=r"^[a-z0-9-]+$")]
    evidence: Annotated[tuple[Evidence, ...], Field(min_length=1)]


class Readings(Entry):
    """All questions, and what must have been computed.

    Attributes
    ----------
    questions : tuple of Question
    computed : tuple of Statement
    """

    questions: tuple[Question, ...]
    computed: tuple[Statement, ...] = ()

    @model_validator(mode="after")
    def _ids_are_unique(self) -> Self:
        ids = [entry.id for entry in self.questions]
        refuse_repeated(ids)
        return self


def load_readings(root: Path) -> Readings:
    """Read ``data/readings.yaml``.

    Parameters
    ----------
    root : Path
        The checkout.

    Raises
    ------
    InswsnError
        If there is no such file or it is not of the form; the sentence names the entry.
    """
    return read_entries(root / READINGS, Readings, "a list of readings", ("questions", "computed"))


def claims_named(question: Question, findings: Findings) -> list[Judged]:
    """Return the claims that hang on a question, in the order of the ledger.

    Raises
    ------
    InswsnError
        If a pattern fits no claim.
    """
    for pattern in question.claims:
        if not any(fnmatchcase(name, pattern) for name in findings.judged):
            raise InswsnError(f"no claim of the ledger fits {pattern}.")
    return [
        entry
        for name, entry in findings.judged.items()
        if any(fnmatchcase(name, pattern) for pattern in question.claims)
    ]


def computed_page(readings: Readings, findings: Findings, *, strict: bool = True) -> str:
    """Return what the authors must have computed as MyST Markdown, paper by paper.

    Parameters
    ----------
    readings : Readings
        From `load_readings`.
    findings : Findings
        What the chapters found.
    strict : bool
        Whether evidence that does not hold is refused; else the statement says so.

    Raises
    ------
    InswsnError
        If evidence does not hold, or a statement names what is not there.
    """
    parts = []
    for paper in PAPERS:
        own = [entry for entry in readings.computed if entry.paper == paper]
        if not own:
            continue
        lines = [f"### {paper}", ""]
        for number, entry in enumerate(own, 1):
            name = f"computed, {paper}, statement {number}"
            lines.append(named(READINGS, name, partial(_statement, entry, findings, strict)))
        basis = findings.basis(
            [shown for entry in own for shown in entry.evidence], *(entry.says for entry in own)
        )
        parts.append("\n".join([*lines, "", basis]))
    return "\n".join(parts)


def readings_page(readings: Readings, findings: Findings) -> str:
    """Return the rival readings as MyST Markdown: an overview, and a section for each.

    Raises
    ------
    InswsnError
        If an entry names what is not there.
    """
    parts = [_overview(readings)]
    for paper in PAPERS:
        own = [entry for entry in readings.questions if entry.paper == paper]
        if own:
            parts.append(f"(readings-{paper.lower()})=\n## {paper}\n\n{cite(paper)}.\n")
        parts += [named(READINGS, entry.id, partial(_section, entry, findings)) for entry in own]
    return "\n".join(parts)


def remaining_page(readings: Readings, findings: Findings) -> str:
    """Return the claims that no question names, grouped by what would change their verdicts.

    Parameters
    ----------
    readings : Readings
        From `load_readings`.
    findings : Findings
        What the chapters found.
    """
    named = {
        entry.claim.id
        for question in readings.questions
        for entry in claims_named(question, findings)
    }
    left = [entry for name, entry in findings.judged.items() if name not in named]
    groups: dict[str, list[Judged]] = {}
    for entry in left:
        groups.setdefault(_rule(entry), []).append(entry)
    lines = [
        f"{len(findings.judged)} claims are in the ledger. {len(named)} are named above; the other "
        f"{len(left)} are below, by what would change their verdicts.\n"
    ]
    for rule in dict.fromkeys([*_RULES, *sorted(groups)]):
        if rule in groups:
            lines += [f"{rule}\n: {_listed(groups[rule])}\n"]
    return "\n".join(lines)


_NOTHING = (
    "Nothing, since they are no findings: what was put in because it is printed, or what the "
    "simulation was fitted to. Another print of the number would change what is put in; the "
    "authors' data, what is fitted."
)
_PRINT = (
    "Another print, or a correction by the authors. These verdicts follow from printed digits and "
    "their rounding alone."
)
_ALGEBRA = (
    "A counterexample, or an error in our algebra. These are equations, tried on random systems or "
    "against an independent program; no data of the authors bear on them. Where the entry on the "
    "page of claims states an assumption, evidence against that would count as well."
)
_DATA = (
    "An error in our computation; or data and settings, of the authors or of others, with which "
    "the same computation would come out otherwise. Where the entry on the page of claims states "
    "an assumption, evidence against that would count as well."
)
_RULES = (_PRINT, _ALGEBRA, _DATA, _NOTHING)


def _rule(entry: Judged) -> str:
    """Return what would change the verdict on a claim."""
    claim = entry.claim
    if isinstance(claim.check, MissingCheck):
        return f"What is missing: {' '.join(claim.check.reasons)}"
    if entry.verdict in (Verdict.INPUT, Verdict.CALIBRATED, Verdict.UNTESTABLE):
        return _NOTHING
    if entry.quantity is not None and entry.quantity.basis == "printed":
        return _PRINT
    return _ALGEBRA if claim.kind == "formula" else _DATA


def _overview(readings: Readings) -> str:
    rows = [("entry", "place", "question", "taken here")]
    for entry in readings.questions:
        taken = next((reading.name for reading in entry.readings if reading.taken), "none")
        rows.append((f"[{entry.id}](#{entry.anchor})", entry.place, entry.title, taken))
    table = list_table("Places that admit more than one reading.", "tbl-readings", rows)
    return f"(readings-overview)=\n## The places and what is taken\n\n{table}"


def _section(entry: Question, findings: Findings) -> str:
    hanging = claims_named(entry, findings)
    lines = [
        f"({entry.anchor})=",
        f"### {entry.id}. {entry.title}",
        "",
        f"{entry.paper}, {entry.place}. {findings.fill(entry.says.strip())}",
        "",
    ]
    for reading in entry.readings:
        taken = " *(taken here)*" if reading.taken else ""
        text = _indented(f"{findings.fill(reading.found.strip())}{_anew(reading, findings)}")
        lines += [f"{findings.fill(reading.name)}{taken}", f": {text}", ""]
    for title, text in (
        ("Why", entry.why),
        ("What would decide", entry.decides),
        ("What would change", entry.changes),
    ):
        lines += [f"**{title}.** {findings.fill(text.strip())}", ""]
    counts = ", ".join(f"{count} {verdict}" for verdict, count in count_verdicts(hanging).items())
    lines += [
        f":::{{dropdown}} Claims that hang on it: {len(hanging)} ({counts})",
        _listed(hanging),
        ":::",
        "",
    ]
    texts = [reading.found for reading in entry.readings]
    return "\n".join([*lines, findings.basis((), *texts, entry.why, entry.decides, entry.changes)])


def _indented(text: str) -> str:
    """Return a text as the body of a definition: what follows its first line is indented."""
    first, *others = text.splitlines()
    return "\n".join([first, *(f"  {line}" if line else "" for line in others)])


def judged_anew(reading: Reading, findings: Findings) -> list[tuple[Judged, Judged]]:
    """Return the claims that a reading judges by another quantity: as they are, and as they were.

    Raises
    ------
    InswsnError
        If a claim or a quantity is not there, or its unit is not the claim's.
    """
    pairs = []
    for identity, check in reading.judged.items():
        now = findings.claim(identity)
        other = now.claim.model_copy(update={"check": check, "assumption": reading.name})
        pairs.append((now, verdicts([other], findings.results.values())[0]))
    return pairs


def _anew(reading: Reading, findings: Findings) -> str:
    pairs = judged_anew(reading, findings)
    if not pairs:
        return ""
    kept = [now for now, other in pairs if now.verdict is other.verdict]
    words = [
        f"{claim_link(now.claim)} would be *{other.verdict}* ({other.rebuilt_text} where "
        f"{other.published_text} is asked), and not *{now.verdict}*"
        for now, other in pairs
        if now.verdict is not other.verdict
    ]
    if kept:
        every = "the claim" if len(pairs) == 1 else f"all {len(pairs)} claims"
        which = f"{len(kept)} of the {len(pairs)} claims" if words else every
        keeps = "keeps its verdict" if len(kept) == 1 else "keep their verdicts"
        words.append(f"{which} judged anew {keeps}")
    return f"\n\nBy this reading: {'; '.join(words)}."


def _statement(entry: Statement, findings: Findings, strict: bool) -> str:
    failed = [shown for shown in entry.evidence if not findings.holds(shown)]
    if failed and strict:
        raise InswsnError(f"its evidence does not hold: {findings.show(failed[0])}")
    says = " ".join(findings.fill(entry.says).split())
    doubt = " (In this run the evidence does not hold.)" if failed else ""
    certainty = CERTAINTIES[entry.certainty]
    return f"- {says} *{certainty[:1].upper()}{certainty[1:]}*; {{ref}}`{entry.where}`.{doubt}"


def _listed(entries: Iterable[Judged] | Sequence[Judged]) -> str:
    return ", ".join(f"{claim_link(entry.claim)} ({entry.verdict})" for entry in entries) + "."
