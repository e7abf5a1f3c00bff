"""The errata: the errors found in the papers, ``data/errata.yaml``, and their page.

An erratum names the evidence that decides it: sentences that a chapter binds to a condition,
quantities with bounds, and claims with the verdict that they must have. A build whose results do
not bear one of them out is refused. The numbers of the texts come from the results.
"""

from __future__ import annotations

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
from inswsn_book.ledger import PAPERS
from inswsn_book.tables import list_table
from inswsn_lib.errors import InswsnError

#: Where it stands in a checkout.
ERRATA = "data/errata.yaml"

Kind = Literal["algebra", "number", "notation", "statement", "missing condition", "labelling"]
Identity = Annotated[str, Field(pattern=r"^E-P[123]-\d\d$")]
Line = Annotated[str, Field(min_length=3, pattern=r"^[^\n]+$")]


class Erratum(Entry):
    """One error of a paper.

    Attributes
    ----------
    id : str
        ``E-P1-01``; it never changes.
    paper : {"P1", "P2", "P3"}
    place : str
        Where it stands there.
    kind : str
        What is wrong: algebra, a number, notation, a statement, a missing condition, labelling.
    title : str
        What it is, in one line.
    printed : str
        What is printed, in a few words or a formula.
    derivation : str
        Why it is wrong, such that a reader can check it on the page.
    effect : str
        What changes in numbers.
    correction : str
        What is right, or that it cannot be told.
    changes : {"yes", "no", "unknown"}
        Whether a result of the paper changes.
    evidence : tuple of Evidence
        What decides it; all of it must hold.
    tested : str, optional
        The test of this project that confirms it by a small computation of its own.
    claims : tuple of str
        The claims of the ledger that it touches.
    """

    id: Identity
    paper: Literal["P1", "P2", "P3"]
    place: Line
    kind: Kind
    title: Line
    printed: Prose
    derivation: Prose
    effect: Prose
    correction: Prose
    changes: Literal["yes", "no", "unknown"]
    evidence: tuple[Evidence, ...] = ()
    tested: Annotated[str, Field(pattern=r"^test_\w+$")] | None = None
    claims: tuple[str, ...] = ()

    @model_validator(mode="after")
    def _parts_fit(self) -> Self:
        if not self.id.startswith(f"E-{self.paper}-"):
            raise ValueError(f"the id does not begin with E-{self.paper}-")
        if not self.evidence:
            raise ValueError("an erratum has evidence")
        return self

    @property
    def anchor(self) -> str:
        """The label of its section."""
        return anchor("erratum", self.id)


class Slip(Entry):
    """A slip of the pen that misleads nobody for long.

    Attributes
    ----------
    id : str
        ``E-P1-51``; slips count from 51. It never changes.
    paper : {"P1", "P2", "P3"}
    place, printed, meant : str
        Where it is, what is printed, and what is meant.
    evidence : tuple of Evidence
        What decides it, where print alone does not.
    """

    id: Identity
    paper: Literal["P1", "P2", "P3"]
    place: Line
    printed: Line
    meant: Line
    evidence: tuple[Evidence, ...] = ()

    @model_validator(mode="after")
    def _parts_fit(self) -> Self:
        if not self.id.startswith(f"E-{self.paper}-") or int(self.id[-2:]) <= 50:
            raise ValueError(f"the id of a slip begins with E-{self.paper}- and counts from 51")
        return self

    @property
    def anchor(self) -> str:
        """The label of its line."""
        return anchor("erratum", self.id)


class Errata(Entry):
    """All errors found.

    Attributes
    ----------
    errata : tuple of Erratum
    slips : tuple of Slip
    """

    errata: tuple[Erratum, ...]
    slips: tuple[Slip, ...] = ()

    @model_validator(mode="after")
    def _ids_are_unique(self) -> Self:
        ids = [entry.id for entry in self.errata] + [slip.id for slip in self.slips]
        refuse_repeated(ids)
        return self


def load_errata(root: Path) -> Errata:
    """Read ``data/errata.yaml``.

    Parameters
    ----------
    root : Path
        The checkout.

    Raises
    ------
    InswsnError
        If there is no such file or it is not of the form; the sentence names the entry.
    """
    return read_entries(root / ERRATA, Errata, "a list of errata", ("errata", "slips"))


def errata_page(errata: Errata, findings: Findings, *, strict: bool = True) -> str:
    """Return the errata as MyST Markdown: an overview, and a section for each.

    Parameters
    ----------
    errata : Errata
        From `load_errata`.
    findings : Findings
        What the chapters found.
    strict : bool
        Whether evidence that does not hold is refused. In a run with other parameters it need not
        hold; then the erratum says so.

    Raises
    ------
    InswsnError
        If evidence does not hold, or an erratum names what is not there.
    """
    parts = [_overview(errata), _sentence_of_counts(errata)]
    for paper in PAPERS:
        own = [entry for entry in errata.errata if entry.paper == paper]
        slips = [slip for slip in errata.slips if slip.paper == paper]
        if own or slips:
            parts.append(f"(errata-{paper.lower()})=\n## {paper}\n\n{cite(paper)}.\n")
        for entry in own:
            parts.append(named(ERRATA, entry.id, partial(_section, entry, findings, strict)))
        if slips:
            parts.append(_slips(paper, slips, findings, strict))
    return "\n".join(parts)


def _overview(errata: Errata) -> str:
    rows = [("erratum", "place", "kind", "what is wrong", "changes a result")]
    for entry in errata.errata:
        link = f"[{entry.id}](#{entry.anchor})"
        rows.append((link, entry.place, entry.kind, entry.title, entry.changes))
    caption = "Errors found, by paper. A section below derives each."
    return list_table(caption, "tbl-errata", rows)


def _sentence_of_counts(errata: Errata) -> str:
    words = []
    for paper in PAPERS:
        own = [entry for entry in errata.errata if entry.paper == paper]
        changing = sum(entry.changes == "yes" for entry in own)
        words.append(f"{len(own)} of {paper}, of which {changing} change a result")
    return f"These are {len(errata.errata)}: {'; '.join(words)}.\n"


def _section(entry: Erratum, findings: Findings, strict: bool) -> str:
    failed = [shown for shown in entry.evidence if not findings.holds(shown)]
    if failed and strict:
        raise InswsnError(f"its evidence does not hold: {findings.show(failed[0])}")
    texts = (entry.printed, entry.derivation, entry.effect, entry.correction)
    printed, derivation, effect, correction = (findings.fill(text.strip()) for text in texts)
    lines = [
        f"({entry.anchor})=",
        f"### {entry.id}. {entry.title}",
        "",
        f"{entry.paper}, {entry.place} · {entry.kind} · changes a result: **{entry.changes}**",
        "",
    ]
    if failed:
        lines += [":::{warning}", "In this run its evidence does not hold:", ""]
        lines += [f"- {findings.show(shown)}" for shown in failed] + [":::", ""]
    lines += [f"**Printed.** {printed}", "", f"**Why it is wrong.** {derivation}", ""]
    lines += [f"**Effect.** {effect}", "", f"**Correction.** {correction}", ""]
    if entry.claims:
        lines += [f"**Claims.** {_claims(entry.claims, findings)}", ""]
    if entry.tested:
        lines += [f"Worked out again, by itself, in the test `{entry.tested}`.", ""]
    return "\n".join([*lines, findings.basis(entry.evidence, *texts)])


def _claims(names: tuple[str, ...], findings: Findings) -> str:
    judged = [findings.claim(name) for name in names]
    return ", ".join(f"{claim_link(entry.claim)} ({entry.verdict})" for entry in judged) + "."


def _slips(paper: str, slips: list[Slip], findings: Findings, strict: bool) -> str:
    rows = [("slip", "place", "printed", "meant")]
    for slip in slips:
        rows.append(named(ERRATA, slip.id, partial(_slip, slip, findings, strict)))
    table = list_table("", f"tbl-slips-{paper.lower()}", rows, stub_columns=1)
    return f"### Slips of {paper}\n\n{table}"


def _slip(slip: Slip, findings: Findings, strict: bool) -> tuple[str, str, str, str]:
    failed = [shown for shown in slip.evidence if not findings.holds(shown)]
    if failed and strict:
        raise InswsnError(f"its evidence does not hold: {findings.show(failed[0])}")
    # a raw target, since a label before a table's row is not possible
    name = f'<span id="{slip.anchor}"></span>{slip.id}'
    place, printed, meant = map(findings.fill, (slip.place, slip.printed, slip.meant))
    return name, place, printed, meant
