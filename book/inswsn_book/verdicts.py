"""Verdicts: computed from results by stated rules, never typed."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from enum import StrEnum
from typing import Any

from inswsn_book.ledger import Claim, MissingCheck
from inswsn_book.results import Quantity, Results
from inswsn_lib.errors import InswsnError

# A rebuilt interval that is wider than this share of the published value decides nothing.
_WIDEST = 0.25
_ROUNDING = 1e-6


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
        """Whether it is in the headline counts: what was put in is no finding."""
        return self not in (Verdict.INPUT, Verdict.CALIBRATED)


@dataclass(frozen=True)
class Judged:
    """A claim with its verdict.

    Attributes
    ----------
    claim : Claim
        The claim.
    verdict : Verdict
        What became of it.
    reason : str
        Why, one sentence.
    published : tuple of two floats, optional
        The ends of what the claim stands for; None if it cannot be tested.
    quantity : Quantity, optional
        What decided it.
    cell : str, optional
        The cell that recorded the quantity.
    """

    claim: Claim
    verdict: Verdict
    reason: str
    published: tuple[float, float] | None = None
    quantity: Quantity | None = None
    cell: str | None = None

    @property
    def published_text(self) -> str:
        """When the claim holds, written with its unit: ``"85 ± 2.5 %"``, ``"at most 1"``."""
        claim = self.claim
        if self.published is None:
            return "–"
        low, high = self.published
        if math.isinf(low):
            return _with_unit(f"at most {high:g}", claim.unit)
        if math.isinf(high):
            return _with_unit(f"at least {low:g}", claim.unit)
        if not isinstance(claim.value, str):
            return _with_unit(f"exactly {low:g}", claim.unit)
        if claim.tolerance == "digits":
            return _with_unit(f"{claim.value} ({low:g} to {high:g})", claim.unit)
        return _with_unit(f"{claim.value} ± {(high - low) / 2:.4g}", claim.unit)

    @property
    def rebuilt_text(self) -> str:
        """The deciding quantity with its interval and unit: ``"70.20 (70.19 to 70.21) %"``."""
        if self.quantity is None:
            return "–"
        value, unit = self.quantity.value, self.quantity.unit
        low, high = self.quantity.interval or (value, value)
        if low == high:  # of a number that is rounding error, two digits say it all
            return _with_unit(f"{value:.2g}" if abs(value) < _ROUNDING else f"{value:.6g}", unit)
        digits = max(0, 1 - math.floor(math.log10(high - low)))
        if digits > 8:  # small numbers: two digits of the width in powers of ten
            size = max(abs(low), abs(high))
            some = 2 + max(0, math.floor(math.log10(size)) - math.floor(math.log10(high - low)))
            return _with_unit(f"{value:.{some}g} ({low:.{some}g} to {high:.{some}g})", unit)
        return _with_unit(f"{value:.{digits}f} ({low:.{digits}f} to {high:.{digits}f})", unit)

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
        return {
            "id": self.claim.id,
            "paper": self.claim.paper,
            "place": self.claim.place,
            "kind": self.claim.kind,
            "published": {
                "value": self.claim.value,
                "unit": self.claim.unit,
                "tolerance": self.claim.tolerance,
                "interval": None if self.published is None else list(map(_finite, self.published)),
            },
            "rebuilt": None
            if self.quantity is None
            else {
                "value": self.quantity.value,
                "unit": self.quantity.unit,
                "interval": self.quantity.interval,
                "basis": self.quantity.basis,
                "runs": self.quantity.runs,
            },
            "verdict": str(self.verdict),
            "reason": self.reason,
            "chapter": self.claim.chapter,
            "cell": self.cell,
        }


def verdicts(claims: Iterable[Claim], results: Iterable[Results]) -> list[Judged]:
    """Judge claims by the results of the chapters.

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
    what is missing *cannot be tested*.

    Parameters
    ----------
    results : iterable of Results
        The results of every chapter that decides one of them.

    Raises
    ------
    InswsnError
        If a claim's check does not resolve: there are no results of its chapter, its quantity is
        not among them or has another unit, or its tolerance is no parameter of the run.
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
    found, quantity = _resolve(claim, claim.check.chapter, claim.check.quantity, results)
    published = claim.published(found.parameters)
    verdict, reason = _rule(claim, quantity, published)
    if verdict is Verdict.REPRODUCED and claim.assumption:
        verdict, reason = Verdict.ASSUMED, f"{reason} Assumed: {claim.assumption}"
    return Judged(claim, verdict, reason, published, quantity, found.cells.get(quantity.name))


def _resolve(
    claim: Claim, chapter: str, name: str, results: Mapping[str, Results]
) -> tuple[Results, Quantity]:
    found = results.get(chapter)
    if found is None:
        raise InswsnError(
            f"Claim {claim.id} is decided by chapter {chapter}, of which there are no results."
        )
    try:
        quantity = found[name]
    except KeyError:
        raise InswsnError(
            f"Claim {claim.id} is decided by the quantity {name}, which chapter {chapter} does "
            "not record."
        ) from None
    if quantity.unit != claim.unit:
        raise InswsnError(
            f"Claim {claim.id} is in {claim.unit}, and the quantity {name} of chapter {chapter} "
            f"in {quantity.unit}."
        )
    return found, quantity


def _rule(claim: Claim, quantity: Quantity, published: tuple[float, float]) -> tuple[Verdict, str]:
    if quantity.role == "input":
        if published[0] <= quantity.value <= published[1]:
            return Verdict.INPUT, "The run was given what the paper prints."
        given = f"{quantity.value:.6g} {quantity.unit}"
        return Verdict.UNTESTABLE, f"The run was given {given} instead of what the paper prints."
    if quantity.role == "calibrated":
        return Verdict.CALIBRATED, "The simulation was fitted to this cell, among others."
    rebuilt = quantity.interval or (quantity.value, quantity.value)
    if quantity.basis == "printed":
        verdict = judge_own_cells(rebuilt, published)
        if verdict is Verdict.REPRODUCED and _too_wide(rebuilt, claim.reference):
            return Verdict.NOT_DECIDED, (
                "The printed cells allow it, and so much else that they decide nothing: the "
                "interval of their rounding is wider than a quarter of the published value."
            )
        return verdict, _OWN[verdict]
    return judge_rebuilt(quantity.value, rebuilt, published, claim.reference)


_OWN = {
    Verdict.REPRODUCED: "The printed cells, within their rounding, allow it.",
    Verdict.CONTRADICTED: "No numbers that round to the printed cells allow it.",
}


def judge_own_cells(rebuilt: tuple[float, float], published: tuple[float, float]) -> Verdict:
    """Judge a statement that a paper derives from its own printed numbers.

    Parameters
    ----------
    rebuilt : tuple of two floats
        Lower and upper end of what the printed numbers, within their rounding, give.
    published : tuple of two floats
        Lower and upper end of what the printed statement stands for.

    Returns
    -------
    Verdict
        Reproduced if the two intervals have a value in common, else contradicted by the paper
        itself.
    """
    # an end that is not a number compares as false, and then nothing is reproduced
    meets = rebuilt[0] <= rebuilt[1] >= published[0] <= published[1] >= rebuilt[0]
    return Verdict.REPRODUCED if meets else Verdict.CONTRADICTED


def judge_rebuilt(
    value: float, rebuilt: tuple[float, float], published: tuple[float, float], reference: float
) -> tuple[Verdict, str]:
    """Judge a claim by an experiment that was built again.

    Parameters
    ----------
    rebuilt : tuple of two floats
        The ends of its interval; twice the number if there is no chance in it.
    published : tuple of two floats
        The ends of what the claim stands for, its tolerance included; they may be infinite.
    reference : float
        The published number; the width of the rebuilt interval is measured by it.
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


def _too_wide(rebuilt: tuple[float, float], reference: float) -> bool:
    return not rebuilt[1] - rebuilt[0] <= _WIDEST * abs(reference)


def _with_unit(text: str, unit: str) -> str:
    return text if unit == "1" else f"{text} {unit}"


def _finite(end: float) -> float | None:
    return end if math.isfinite(end) else None
