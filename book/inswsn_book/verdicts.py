"""Verdicts: computed from results by stated rules, never typed."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from enum import StrEnum
from typing import Any

from inswsn_book.ledger import Claim, MissingCheck, QuantityCheck
from inswsn_book.results import Quantity, Results
from inswsn_lib.errors import InswsnError

# A rebuilt interval that is wider than this share of the published value decides nothing.
_WIDEST = 0.25
_ROUNDING = 1e-6

Ends = tuple[float, float]


class Verdict(StrEnum):
    """What became of a claim."""

    REPRODUCED = "reproduced"
    ASSUMED = "reproduced under a stated assumption"
    NOT_REPRODUCED = "not reproduced"
    CONTRADICTED = "contradicted by the paper itself"
    NOT_DECIDED = "not decided"
    UNTESTABLE = "cannot be tested"
    INPUT = "taken as input"
    CALIBRATED = "calibrated"

    @property
    def counts(self) -> bool:
        """Whether it is in the headline counts; what was put in is no finding."""
        return self not in (Verdict.INPUT, Verdict.CALIBRATED)


@dataclass(frozen=True)
class Judged:
    """A claim with its verdict, and why."""

    claim: Claim
    verdict: Verdict
    reason: str
    published: Ends | None = None  # the ends of what the claim stands for
    quantity: Quantity | None = None  # what decided it
    cell: str | None = None  # that recorded the quantity

    @property
    def published_text(self) -> str:
        """When the claim holds, with its unit, such as ``"85 ± 2.5 %"``, ``"at most 1"``."""
        if self.published is None:
            return "–"
        low, high = self.published
        if math.isinf(low):
            text = f"at most {high:g}"
        elif math.isinf(high):
            text = f"at least {low:g}"
        elif not isinstance(self.claim.value, str):
            text = f"exactly {low:g}"
        elif self.claim.tolerance == "digits":
            text = f"{self.claim.value} ({low:g} to {high:g})"
        else:
            text = f"{self.claim.value} ± {(high - low) / 2:.4g}"
        return _with_unit(text, self.claim.unit)

    @property
    def rebuilt_text(self) -> str:
        """The deciding quantity, interval and unit, such as ``"70.20 (70.19 to 70.21) %"``."""
        if self.quantity is None:
            return "–"
        value, unit = self.quantity.value, self.quantity.unit
        low, high = self.quantity.interval or (value, value)
        if low == high:  # of a number that is rounding error, two digits say it all
            return _with_unit(f"{value:.2g}" if abs(value) < _ROUNDING else f"{value:.6g}", unit)
        form = _form(low, high)
        return _with_unit(f"{value:{form}} ({low:{form}} to {high:{form}})", unit)

    def row(self) -> dict[str, str]:
        """Return its row in a chapter's table of verdicts; the claim links to its entry."""
        return {
            "claim": f"[{self.claim.id}](#{self.claim.anchor})",
            "the paper says": self.claim.says,
            "holds if": self.published_text,
            "found": self.rebuilt_text,
            "verdict": str(self.verdict),
        }

    def as_json(self) -> dict[str, Any]:
        """Return it as plain data: the form of ``inswsn claims --json``."""
        ends = self.published and [e if math.isfinite(e) else None for e in self.published]
        printed = self.claim.model_dump(include={"value", "unit", "tolerance"})
        fields = {"value", "unit", "interval", "basis", "runs"}
        return {
            **self.claim.model_dump(include={"id", "paper", "place", "kind"}),
            "published": printed | {"interval": ends},
            "rebuilt": self.quantity and self.quantity.model_dump(include=fields),
            "verdict": str(self.verdict),
            "reason": self.reason,
            "chapter": self.claim.chapter,
            "cell": self.cell,
        }


def _form(low: float, high: float) -> str:
    """Return the format that shows two digits of the width of an interval."""
    width = math.floor(math.log10(high - low))
    if width >= -7:
        return f".{max(0, 1 - width)}f"
    size = math.floor(math.log10(max(abs(low), abs(high))))  # small numbers: in powers of ten
    return f".{2 + max(0, size - width)}g"


def _with_unit(text: str, unit: str) -> str:
    return text if unit == "1" else f"{text} {unit}"


def verdicts(claims: Iterable[Claim], results: Iterable[Results]) -> list[Judged]:
    """Judge claims by the results of the chapters that decide them.

    The rule follows from what the deciding quantity is, so that what was put in cannot count as
    found:

    - a quantity whose role is ``input``: *taken as input* if it is what the paper prints, else
      *cannot be tested* in this run; ``calibrated``: *calibrated*;
    - a quantity from printed digits alone (basis ``printed``): *reproduced* if the interval that
      the rounding of the cells allows and the interval of the claim have a number in common, and
      *not decided* if they have but the first is wider than a quarter of the published value; else
      *contradicted by the paper itself*;
    - any other: *reproduced* if its interval lies in that of the claim, *not reproduced* if it lies
      outside. If it straddles an end: *not decided* if it is wider than a quarter of the published
      value, else its value decides.

    A claim with an assumption is at best *reproduced under a stated assumption*. A claim that needs
    what is missing *cannot be tested*. A check that does not resolve is refused: no results of its
    chapter, no such quantity, another unit, a tolerance that is no parameter of the run.
    """
    by_chapter: dict[str, Results] = {}
    for result in results:
        if by_chapter.setdefault(result.chapter, result) is not result:
            raise InswsnError(f"There are two results of chapter {result.chapter}; one may judge.")
    return [_judge(claim, by_chapter) for claim in claims]


def count_verdicts(judged: Iterable[Judged]) -> dict[Verdict, int]:
    """Return how many claims have each verdict, in the order of `Verdict`, without zeros."""
    counts = Counter(entry.verdict for entry in judged)
    return {verdict: counts[verdict] for verdict in Verdict if counts[verdict]}


def _judge(claim: Claim, results: Mapping[str, Results]) -> Judged:
    if isinstance(claim.check, MissingCheck):
        return Judged(claim, Verdict.UNTESTABLE, " ".join(claim.check.reasons))
    found, quantity = _resolve(claim, claim.check, results)
    published = claim.published(found.parameters)
    verdict, reason = _rule(claim, quantity, published)
    if verdict is Verdict.REPRODUCED and claim.assumption:
        verdict, reason = Verdict.ASSUMED, f"{reason} Assumed: {claim.assumption}"
    return Judged(claim, verdict, reason, published, quantity, found.cells.get(quantity.name))


def _resolve(
    claim: Claim, check: QuantityCheck, results: Mapping[str, Results]
) -> tuple[Results, Quantity]:
    by, name = f"chapter {check.chapter}", check.quantity
    if check.chapter not in results:
        raise InswsnError(f"Claim {claim.id} is decided by {by}, of which there are no results.")
    try:
        quantity = results[check.chapter][name]
    except KeyError:
        raise InswsnError(
            f"Claim {claim.id} is decided by the quantity {name}, which {by} does not record."
        ) from None
    if quantity.unit != claim.unit:
        raise InswsnError(f"Claim {claim.id} is in {claim.unit}, and {name} in {quantity.unit}.")
    return results[check.chapter], quantity


def _rule(claim: Claim, quantity: Quantity, published: Ends) -> tuple[Verdict, str]:
    if quantity.role == "calibrated":
        return Verdict.CALIBRATED, "The simulation was fitted to this cell, among others."
    if quantity.role == "input":
        return _judge_input(quantity, published)
    rebuilt = quantity.interval or (quantity.value, quantity.value)
    if quantity.basis != "printed":
        return judge_rebuilt(quantity.value, rebuilt, published, claim.reference)
    if judge_own_cells(rebuilt, published) is Verdict.CONTRADICTED:
        return Verdict.CONTRADICTED, "No numbers that round to the printed cells allow it."
    if _too_wide(rebuilt, claim.reference):
        return Verdict.NOT_DECIDED, (
            "The printed cells allow it, and so much else that they decide nothing: the "
            "interval of their rounding is wider than a quarter of the published value."
        )
    return Verdict.REPRODUCED, "The printed cells, within their rounding, allow it."


def _judge_input(quantity: Quantity, published: Ends) -> tuple[Verdict, str]:
    if published[0] <= quantity.value <= published[1]:
        return Verdict.INPUT, "The run was given what the paper prints."
    given = f"{quantity.value:.6g} {quantity.unit}"
    return Verdict.UNTESTABLE, f"The run was given {given} instead of what the paper prints."


def judge_own_cells(rebuilt: Ends, published: Ends) -> Verdict:
    """Judge a statement that a paper derives from its own printed numbers.

    Reproduced if what these give, within their rounding, and what the statement stands for have a
    value in common, else contradicted by the paper itself.
    """
    # an end that is not a number compares as false, and then nothing is reproduced
    meets = rebuilt[0] <= rebuilt[1] >= published[0] <= published[1] >= rebuilt[0]
    return Verdict.REPRODUCED if meets else Verdict.CONTRADICTED


def judge_rebuilt(
    value: float, rebuilt: Ends, published: Ends, reference: float
) -> tuple[Verdict, str]:
    """Judge a claim by an experiment that was built again.

    The ends of the rebuilt interval are twice the number if there is no chance in it; those of what
    the claim stands for may be infinite. The width of the rebuilt interval is measured by the
    published number, `reference`.
    """
    if published[0] <= rebuilt[0] <= rebuilt[1] <= published[1]:
        return Verdict.REPRODUCED, "The whole rebuilt interval lies within the tolerance."
    if rebuilt[1] < published[0] or published[1] < rebuilt[0]:
        return Verdict.NOT_REPRODUCED, "The whole rebuilt interval lies outside the tolerance."
    if _too_wide(rebuilt, reference):
        return Verdict.NOT_DECIDED, (
            "The rebuilt interval reaches over an end of the tolerance and is wider than a "
            "quarter of the published value."
        )
    if published[0] <= value <= published[1]:
        return Verdict.REPRODUCED, "The rebuilt number lies within the tolerance."
    return Verdict.NOT_REPRODUCED, "The rebuilt number lies outside the tolerance."


def _too_wide(rebuilt: Ends, reference: float) -> bool:
    return not rebuilt[1] - rebuilt[0] <= _WIDEST * abs(reference)
