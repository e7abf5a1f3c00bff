"""What results must say for a written text to stand, and the numbers that they put into it.

The pages of errata and of rival readings are written by hand, but for their numbers and for their
right to be there: a text holds placeholders such as ``{01:cost.position.percent:.0f}`` and names
the evidence on which it rests.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import Annotated, Any, Self, TypeVar

from pydantic import BaseModel, ConfigDict, Field, ValidationError, model_validator

from inswsn_book.ledger import Claim
from inswsn_book.results import Finite, Name, Quantity, Results
from inswsn_book.verdicts import Judged, Verdict
from inswsn_lib.errors import InswsnError
from inswsn_lib.files import read_yaml

# {01:cost.position.percent:.0f} and {claim:P1-P-T}; a role, {ref}`...`, has no colon or a backtick
_PLACEHOLDER = re.compile(r"\{([A-Za-z0-9]+):([^{}:`]*)(?::([^{}`]*))?\}(?!`)")
_PAPER_TITLES = {"P1": "xu2012ins", "P2": "li2012distributed", "P3": "li2015hybrid"}

#: A text of one or more paragraphs in MyST Markdown, with placeholders.
Prose = Annotated[str, Field(min_length=3)]


class Entry(BaseModel):
    """Part of a file of texts: it may not be changed, and has no fields but its own."""

    model_config = ConfigDict(frozen=True, extra="forbid")


class Sentence(Entry):
    """A sentence that a chapter binds to a condition; it must hold.

    Attributes
    ----------
    chapter : str
        Two digits.
    sentence : str
        As the chapter binds it.
    """

    chapter: Annotated[str, Field(pattern=r"^\d\d$")]
    sentence: Annotated[str, Field(min_length=3)]


class Bound(Entry):
    """A quantity that must lie within bounds.

    Attributes
    ----------
    chapter : str
        Two digits.
    quantity : str
        Its name there.
    at_least, at_most : float, optional
        The ends, in the quantity's unit; one of them or both.
    """

    chapter: Annotated[str, Field(pattern=r"^\d\d$")]
    quantity: Name
    at_least: Finite | None = None
    at_most: Finite | None = None

    @model_validator(mode="after")
    def _has_a_bound(self) -> Self:
        if self.at_least is None and self.at_most is None:
            raise ValueError("a quantity that is evidence has at_least or at_most")
        return self


class Ruling(Entry):
    """A claim of the ledger that must have a certain verdict.

    Attributes
    ----------
    claim : str
        Its id.
    verdict : Verdict
        What it must be.
    """

    claim: str
    verdict: Verdict


Evidence = Sentence | Bound | Ruling


class Findings:
    """All that the chapters found: their results, and the claims judged by them.

    Parameters
    ----------
    results : iterable of Results
        One of each chapter.
    judged : iterable of Judged
        The claims of the ledger.
    """

    def __init__(self, results: Iterable[Results], judged: Iterable[Judged]) -> None:
        self.results = {result.chapter: result for result in results}
        self.judged = {entry.claim.id: entry for entry in judged}

    def quantity(self, chapter: str, name: str) -> Quantity:
        """Return a quantity of a chapter; `InswsnError` if there is none."""
        try:
            return self._chapter(chapter)[name]
        except KeyError:
            raise InswsnError(f"chapter {chapter} records no quantity {name}.") from None

    def claim(self, identity: str) -> Judged:
        """Return a judged claim; `InswsnError` if there is none."""
        try:
            return self.judged[identity]
        except KeyError:
            raise InswsnError(f"the ledger has no claim {identity}.") from None

    def _chapter(self, chapter: str) -> Results:
        try:
            return self.results[chapter]
        except KeyError:
            raise InswsnError(f"there are no results of chapter {chapter}.") from None

    def holds(self, evidence: Evidence) -> bool:
        """Tell whether evidence holds.

        Raises
        ------
        InswsnError
            If it names what is not there: a chapter, a sentence, a quantity or a claim.
        """
        if isinstance(evidence, Ruling):
            return self.claim(evidence.claim).verdict is evidence.verdict
        if isinstance(evidence, Bound):
            value = self.quantity(evidence.chapter, evidence.quantity).value
            low = evidence.at_least is None or value >= evidence.at_least
            return low and (evidence.at_most is None or value <= evidence.at_most)
        sentences = self._chapter(evidence.chapter).sentences
        if evidence.sentence not in sentences:
            raise InswsnError(
                f"chapter {evidence.chapter} binds no sentence {evidence.sentence!r}."
            )
        return sentences[evidence.sentence]

    def show(self, evidence: Evidence) -> str:
        """Return what evidence says, with a link, as one line of MyST Markdown."""
        if isinstance(evidence, Ruling):
            return f"Claim {claim_link(self.claim(evidence.claim).claim)}: {evidence.verdict}."
        if isinstance(evidence, Sentence):
            link = f"{{ref}}`chapter {evidence.chapter} <chapter-{evidence.chapter}-sentences>`"
            return f"Bound in {link}: {escape_text(evidence.sentence)}"
        quantity = self.quantity(evidence.chapter, evidence.quantity)
        ends = [
            f"{word} {end:g}"
            for word, end in (("at least", evidence.at_least), ("at most", evidence.at_most))
            if end is not None
        ]
        return (
            f"{chapter_link(evidence.chapter)}: `{quantity.name}` is {_number(quantity.value)}; "
            f"it must be {' and '.join(ends)}."
        )

    def fill(self, text: str) -> str:
        """Put numbers and verdicts in the place of placeholders.

        Parameters
        ----------
        text : str
            With ``{01:name:.2f}`` for a number, ``{01:name@low:.2f}`` and ``@high`` for the ends of
            its interval, ``{01:name:.0%}`` for a share in per cent, and ``{claim:P1-P-T}`` for a
            claim with its verdict.

        Raises
        ------
        InswsnError
            If a placeholder names nothing, or its format does not fit a number.
        """
        return _PLACEHOLDER.sub(self._filled, text)

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
        if end not in ("", "low", "high"):
            raise InswsnError(f"@{end} is no end of an interval; it may be @low or @high.")
        return self.quantity(chapter, base), {"low": 0, "high": 1}.get(end)

    def numbers(self, *texts: str) -> list[tuple[str, Quantity]]:
        """Return the quantities that texts show, each once, with its chapter."""
        found = {}
        for text in texts:
            for where, name, _ in _PLACEHOLDER.findall(text):
                if where != "claim":
                    quantity, _ = self._part(where, name)
                    found[where, quantity.name] = quantity
        return [(chapter, quantity) for (chapter, _), quantity in found.items()]

    def basis(self, evidence: Sequence[Evidence], *texts: str) -> str:
        """Return a folded list of what a text rests on: evidence, and where its numbers are from.

        Parameters
        ----------
        evidence : sequence of Evidence
            All of it.
        texts : str
            The texts with placeholders.
        """
        lines = [f"- {self.show(entry)}" for entry in evidence]
        for chapter, quantity in self.numbers(*texts):
            lines.append(f"- {chapter_link(chapter)}, `{quantity.name}`: {quantity.how}")
        if not lines:
            return ""
        body = "\n".join(lines)
        return f":::{{dropdown}} What this rests on\n:class-container: basis\n{body}\n:::\n"


def chapter_link(chapter: str) -> str:
    """Return a link to a chapter."""
    return f"{{ref}}`chapter {chapter} <chapter-{chapter}>`"


def claim_link(claim: Claim) -> str:
    """Return a link to a claim's entry on the page of claims."""
    return f"[{claim.id}](#{claim.anchor})"


def cite(paper: str) -> str:
    """Return the citation of a paper."""
    return f"{{cite:t}}`{_PAPER_TITLES[paper]}`"


def escape_text(text: str) -> str:
    """Return plain text such that Markdown shows it as it is."""
    return re.sub(r"([\\`*_\[\]<>{}$~|^])", r"\\\1", text)


def anchor(prefix: str, identity: str) -> str:
    """Return the label of an entry: ``"erratum-e-p1-01"``."""
    return f"{prefix}-{re.sub(r'[^a-z0-9]+', '-', identity.lower())}"


def _number(value: float) -> str:
    return f"{value:.6g}".replace("-", "−")


_Model = TypeVar("_Model", bound=BaseModel)
_Made = TypeVar("_Made")


def read_entries(path: Path, model: type[_Model], what: str, lists: Sequence[str]) -> _Model:
    """Read a file of texts and check its form.

    Parameters
    ----------
    path : Path
        The file.
    model : type
        The pydantic model of the whole file.
    what : str
        What the file is, for the sentence of an error.
    lists : sequence of str
        The lists of the file whose entries have ids.

    Raises
    ------
    InswsnError
        If there is no such file or it is not of the form; the sentence names the entry.
    """
    content = read_yaml(path)
    try:
        return model.model_validate(content)
    except ValidationError as error:
        first = error.errors()[0]
        place = _place([str(part) for part in first["loc"]], content, lists)
        said = first["msg"].removeprefix("Value error, ")
        raise InswsnError(f"{path} is not {what}: {place}: {said}.") from None


def _place(parts: list[str], content: Any, lists: Sequence[str]) -> str:
    """Return where in a file something is wrong, with an entry's id rather than its number."""
    listed = content.get(parts[0]) if isinstance(content, dict) and parts else None
    if len(parts) > 1 and parts[0] in lists and isinstance(listed, list):
        entry = listed[int(parts[1])]
        name = entry.get("id") if isinstance(entry, dict) else None
        parts[:2] = [str(name or f"{parts[0]} number {parts[1]}")]
    return ": ".join(parts) or "the file"


def named(file: str, identity: str, make: Callable[[], _Made]) -> _Made:
    """Return what is made; what is wrong in it is told with the file and the entry before it."""
    try:
        return make()
    except InswsnError as error:
        raise InswsnError(f"{file}: {identity}: {error}") from None


def refuse_repeated(ids: Sequence[str]) -> None:
    """Raise ``ValueError`` if an id is used twice; for the validators of lists of entries."""
    twice = sorted({identity for identity in ids if ids.count(identity) > 1})
    if twice:
        raise ValueError(f"the ids {', '.join(twice)} are used twice")
