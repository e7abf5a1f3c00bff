"""The record of a page of evidence, whose words stand in a file of their own.

So a cell shows what is computed and not how it is told. What a number is, and how far it may be off
elsewhere, is written there, too, before it is computed.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, SupportsFloat

import pandas as pd
from pydantic import ValidationError

from inswsn_book.judge.ledger import LEDGER, claims_digest, claims_of, load_claims
from inswsn_book.judge.verdicts import Judged, verdicts
from inswsn_book.record import ChapterRecord
from inswsn_book.record.results import Finite, Frozen, IntervalKind, Quantity, first_problem
from inswsn_book.show import show_figure, show_table
from inswsn_lib.errors import InswsnError
from inswsn_lib.evaluation import Finding
from inswsn_lib.files import read_yaml
from inswsn_lib.papers import Derived

if TYPE_CHECKING:
    from matplotlib.figure import Figure

# {name:form}; behind a role there is a text, and before the group of a formula a command or a sign
_GAP = re.compile(r"(?<=(.))?\{([a-z]\w*)((?::[^{}]*)?)\}(?!`)", re.S)
# what a call may say of a quantity beside its name and value, which come first
_FIELDS = Quantity.model_fields.keys() - {"name", "value"}
_OF_FORMULA = re.compile(r"[\w^_}]")


class _Number(Frozen):
    """What is said of a quantity, or of all whose names differ in what is filled in."""

    how: str
    unit: str | None = None  # None: the call says it
    basis: Literal["printed", "algebra", "simulation", "emulation", "recorded"] | None = None
    role: Literal["found", "input", "calibrated"] = "found"
    tolerance: Finite | None = None
    share: Finite | None = None
    interval_kind: IntervalKind | None = None


class _Usual(Frozen):
    """What holds for the numbers of a page that say nothing else."""

    basis: Literal["printed", "algebra", "simulation", "emulation", "recorded"] = "simulation"
    tolerance: Finite = 1e-6
    share: Finite = 1e-3
    interval_kind: IntervalKind = "runs 95 %"


class _Shown(Frozen):
    caption: str
    alt: str = ""


class _Words(Frozen):
    usual: _Usual = _Usual()
    quantities: dict[str, _Number] = {}
    sentences: dict[str, str] = {}
    shown: dict[str, _Shown] = {}  # tables and figures


class EvidenceRecord(ChapterRecord):
    """A `ChapterRecord` that has its words from ``data/evidence/CHAPTER.yaml``.

    A word in braces there, such as ``{area}`` or ``{speed:.1f}``, is filled in by the call.
    """

    def __init__(
        self, chapter: str, parameters: Mapping[str, Any], root: Path | None = None
    ) -> None:
        super().__init__(chapter, parameters, root)
        path = self.data(f"evidence/{chapter}.yaml")
        try:
            self._words = _Words.model_validate(read_yaml(path))
        except ValidationError as error:
            raise InswsnError(f"{path}: {first_problem(error)}.") from None

    def keep(self, name: str, value: SupportsFloat | Derived, /, **given: Any) -> None:
        """Record a number by its name in the file of words, filled in.

        What is given and is a field of `Quantity`, such as ``interval`` and ``runs``, goes to it;
        the rest fills gaps. A number derived from printed cells has its interval with it.
        """
        said = self._said("quantities", name)
        fields = {key: given.pop(key) for key in [*given] if key in _FIELDS}
        fields = self._words.usual.model_dump() | said.model_dump(exclude_none=True) | fields
        if said.tolerance is not None and said.share is None:
            fields["share"] = 0.0  # one that is given stands in the place of both
        if isinstance(value, Derived):
            fields["interval"] = value.limits
            value = value.value
        if fields.get("interval") is None:
            del fields["interval_kind"]
        name, how = _filled(name, fields.pop("how"), values=given)
        self.quantity(name, float(value), how=how, **fields)

    def findings(self, found: Mapping[str, Finding], prefix: str = "", **given: Any) -> None:
        """Record what a core found: names, units, intervals and what they are come with it."""
        usual = {"tolerance": self._words.usual.tolerance, "share": self._words.usual.share}
        for name, f in found.items():
            said = {"basis": self._words.usual.basis, **usual, "interval_kind": f.kind, **given}
            ends = (f.low, f.high)
            self.quantity(prefix + name, f.value, f.unit, how=f.how, interval=ends, **said)

    def judge(self, prefix: str = "") -> list[Judged]:
        """Judge the claims that this chapter decides by what has been recorded so far.

        A prefix such as ``"P1-T2-"`` takes those alone whose ids begin with it. The build executes
        the chapter again when what the ledger says of its claims changes.
        """
        path = self._root / LEDGER
        self._data[f"{LEDGER}#{self._chapter}"] = claims_digest(path, self._chapter)
        mine = claims_of(load_claims(path), self._chapter)
        return verdicts([c for c in mine if c.id.startswith(prefix)], [self.results()])

    def bind(self, name: str, condition: object, /, **given: Any) -> None:
        """Bind a sentence, by its name in the file of words, as `holds` does."""
        (sentence,) = _filled(self._said("sentences", name), values=given)
        self.holds(sentence, condition)

    def table(self, frame: pd.DataFrame, *, name: str, fold: str = "", **given: Any) -> None:
        """Show a table with its caption, as `show_table` does."""
        (caption,) = _filled(self._said("shown", name).caption, values=given)
        show_table(frame, name=name, caption=caption, fold=fold)

    def figure(self, fig: Figure, *, name: str, **given: Any) -> None:
        """Show a figure with its caption and alternative text, as `show_figure` does."""
        said = self._said("shown", name)
        caption, alt = _filled(said.caption, said.alt, values=given)
        show_figure(fig, name=name, caption=caption, alt=alt)

    def _said(self, kind: str, name: str) -> Any:
        try:
            return getattr(self._words, kind)[name]
        except KeyError:
            file = f"data/evidence/{self._chapter}.yaml"
            raise InswsnError(f"{file} says nothing of {name!r} in {kind}.") from None


def _filled(*texts: str, values: Mapping[str, Any]) -> list[str]:
    """Fill the gaps of texts; refuse a gap without a value, and a value without a gap."""
    used = set()

    def fill(gap: re.Match[str]) -> str:
        before, name, form = gap.groups("")
        if name not in values:
            if _OF_FORMULA.match(before):
                return gap[0]
            raise InswsnError(f"Nothing is given for {gap[0]} of {texts[0]!r}.")
        used.add(name)
        return format(values[name], form[1:])

    filled = [_GAP.sub(fill, text) for text in texts]
    if idle := values.keys() - used:
        raise InswsnError(f"{texts[0]!r} has no gap for {min(idle)}.")
    return filled
