"""Verdicts: computed from results by stated rules, never typed."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from enum import StrEnum
from typing import Any, NamedTuple

from inswsn_book.judge.ledger import DRAWN, Claim, MissingCheck, QuantityCheck
from inswsn_book.record.results import Quantity, Results
from inswsn_lib.errors import InswsnError

# A rebuilt interval that is wider than this share of the published value decides nothing.
_WIDEST = 0.25
_ROUNDING = 1e-6
_DECIDES_NOTHING = " So wide, it may as well hold zero or twice that value, and decides nothing."

Ends = tuple[float, float]


#: What a reader asks first of a claim; each verdict belongs to one of them
OUTCOMES = ("holds", "does not hold", "cannot be decided")


class Verdict(StrEnum):
    """What became of a claim; whether that rests on an assumption is told by `Judged.words`."""

    REPRODUCED = "reproduced"
    ADDS_UP = "adds up in print"
    IDENTITY = "identity"
    LIKE_OURS = "like one of our runs"
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

    @property
    def holds(self) -> bool:
        """Whether what the paper says holds."""
        return self.outcome == OUTCOMES[0]

    @property
    def outcome(self) -> str:
        """Which of the three `OUTCOMES` it belongs to."""
        held = (Verdict.REPRODUCED, Verdict.ADDS_UP, Verdict.IDENTITY, Verdict.LIKE_OURS)
        failed = (Verdict.NOT_REPRODUCED, Verdict.CONTRADICTED)
        return OUTCOMES[0 if self in held else 1 if self in failed else 2]


# What stands behind a verdict that rests on an assumption of ours, be it positive or negative
_ASSUMED = " under a stated assumption"
#: All verdicts in words, in order, without and with an assumption
VERDICTS = tuple(verdict + behind for verdict in Verdict for behind in ("", _ASSUMED))


class Earlier(NamedTuple):
    """The verdict of a release that a claim has no longer, in its words."""

    version: str
    day: str
    verdict: str


class Named(NamedTuple):
    """A reading or an erratum that names a claim: its id, its place in the book, its title."""

    id: str
    anchor: str
    title: str


class Read(NamedTuple):
    """A claim by one reading of its paper: the reading, and the verdict in words."""

    name: str
    verdict: str
    holds: bool


@dataclass(frozen=True)
class Judged:
    """A claim with its verdict, and why."""

    claim: Claim
    verdict: Verdict
    reason: str
    published: Ends | None = None  # the ends of what the claim stands for
    quantity: Quantity | None = None  # what decided it
    cell: str | None = None  # that recorded the quantity
    readings: tuple[Read, ...] = ()  # the one that decides first; none if no other is computed
    earlier: tuple[Earlier, ...] = ()  # releases in which the verdict was another one
    hangs_on: tuple[Named, ...] = ()  # readings and errata that name it

    @property
    def assumed(self) -> bool:
        """Whether the verdict rests on an assumption; what was put in or not tested has none."""
        tested = self.verdict.counts and self.verdict is not Verdict.UNTESTABLE
        return tested and self.claim.assumption is not None

    @property
    def words(self) -> str:
        """The verdict in words, such as ``"not reproduced under a stated assumption"``."""
        return self.verdict + _ASSUMED * self.assumed

    @property
    def holds_in(self) -> tuple[int, int]:
        """In how many of its readings the claim holds, and how many there are."""
        return sum(reading.holds for reading in self.readings), len(self.readings)

    @property
    def flips(self) -> bool:
        """Whether it holds in some of its readings and in others not."""
        return 0 < self.holds_in[0] < self.holds_in[1]

    @property
    def label(self) -> str:
        """The words, and in how many readings the claim holds where that differs."""
        share = "{} of {}".format(*self.holds_in)
        return f"{self.words}, flips with the reading (holds in {share})" * self.flips or self.words

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
        elif self.claim.tolerance == DRAWN:
            number = _with_unit(self.claim.value, self.claim.unit)
            return f"{number} is within 95 % of the runs, and these span less than it"
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
            "verdict": self.words,
        }

    def as_json(self) -> dict[str, Any]:
        """Return it as plain data: the form of ``inswsn claims --json``."""
        ends = self.published and [e if math.isfinite(e) else None for e in self.published]
        printed = self.claim.model_dump(include={"value", "unit", "tolerance"})
        fields = {"value", "unit", "interval", "basis", "runs"}
        return {
            **self.claim.model_dump(include={"id", "paper", "place", "kind", "says", "why"}),
            "published": printed | {"interval": ends},
            "rebuilt": self.quantity and self.quantity.model_dump(include=fields),
            "verdict": self.words,
            "assumption": self.claim.assumption if self.assumed else None,
            "readings": [{"name": r.name, "verdict": r.verdict} for r in self.readings],
            "holds_in": list(self.holds_in) if self.readings else None,
            "flips": self.flips,
            "hangs_on": [named.id for named in self.hangs_on],
            "earlier": {earlier.version: earlier.verdict for earlier in self.earlier},
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
    found, and arithmetic not as an experiment:

    - a quantity whose role is ``input``: *taken as input* if it is what the paper prints, else
      *cannot be tested* in this run; ``calibrated``: *calibrated*;
    - from printed digits alone (basis ``printed``): *adds up in print* if the interval that the
      rounding of the cells allows and the interval of the claim have a number in common, and *not
      decided* if they have but the first is wider than a quarter of the published value; else
      *contradicted by the paper itself*;
    - any other, if the claim's tolerance is ``drawn``, since the paper prints one draw: does it lie
      in the interval of 95 % of the runs, give or take half a unit of its last digit? If not, *not
      reproduced*. If so, *like one of our runs* where that interval is narrower than the printed
      value is large, else *not decided*. An interval that holds a number and is narrower than it
      holds neither zero nor twice the number: it could have told what is printed from no effect, no
      error, or twice as much. That is one rule for sizes and percentages, whatever the paper;
    - any other: *reproduced* if its interval lies in that of the claim, *not reproduced* if it lies
      outside. If it straddles an end: *not decided* if it is wider than a quarter of the published
      value, else its value decides. What is *reproduced* is called *identity* if nothing was built
      again (basis ``algebra``): an identity or inequality that was checked.

    Behind a verdict that rests on an assumption, be it positive or negative, stands *under a stated
    assumption*. A claim that needs what is missing *cannot be tested*. A check that does not
    resolve is refused: no results of its chapter, no such quantity, another unit, a tolerance that
    is no parameter of the run, a draw without an interval of the runs.
    """
    by_chapter: dict[str, Results] = {}
    for result in results:
        if by_chapter.setdefault(result.chapter, result) is not result:
            raise InswsnError(f"There are two results of chapter {result.chapter}, not one.")
    return [_judge(claim, by_chapter) for claim in claims]


def count_verdicts(judged: Iterable[Judged]) -> dict[str, int]:
    """Return how many claims have each verdict, in words, in the order of `Verdict`."""
    counts = Counter(entry.words for entry in judged)
    return {word: counts[word] for word in VERDICTS if counts[word]}


def _judge(claim: Claim, results: Mapping[str, Results]) -> Judged:
    if isinstance(claim.check, MissingCheck):
        return Judged(claim, Verdict.UNTESTABLE, " ".join(claim.check.reasons))
    found, quantity = _resolve(claim, claim.check, results)
    published = claim.published(found.parameters)
    verdict, reason = _rule(claim, quantity, published)
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
        return Verdict.CALIBRATED, "What was computed was fitted to this, among others."
    if quantity.role == "input":
        return _judge_input(quantity, published)
    if claim.tolerance == DRAWN:
        return judge_draw(claim, quantity, published)
    rebuilt = quantity.interval or (quantity.value, quantity.value)
    if quantity.basis == "printed":
        return _judge_printed(rebuilt, published, claim.reference)
    verdict, reason = judge_rebuilt(quantity.value, rebuilt, published, claim.reference)
    algebra = quantity.basis == "algebra"
    return _CHECKED.get(verdict, (verdict, reason)) if algebra else (verdict, reason)


# What becomes of a verdict where nothing was built again
_CHECKED = {
    Verdict.REPRODUCED: (Verdict.IDENTITY, "It was checked, and holds."),
    Verdict.NOT_REPRODUCED: (Verdict.NOT_REPRODUCED, "It was checked, and does not hold."),
}


def _judge_printed(rebuilt: Ends, published: Ends, reference: float) -> tuple[Verdict, str]:
    verdict = judge_own_cells(rebuilt, published)
    if not verdict.holds:
        return verdict, "No numbers that round to the printed cells allow it."
    if _too_wide(rebuilt, reference):
        return Verdict.NOT_DECIDED, (
            "The printed cells allow it, and so much else that they decide nothing: the "
            "interval of their rounding is wider than a quarter of the published value."
        )
    return verdict, "The printed cells, within their rounding, allow it."


def _judge_input(quantity: Quantity, published: Ends) -> tuple[Verdict, str]:
    if published[0] <= quantity.value <= published[1]:
        return Verdict.INPUT, "The run was given what the paper prints."
    given = f"{quantity.value:.6g} {quantity.unit}"
    return Verdict.UNTESTABLE, f"The run was given {given} instead of what the paper prints."


def judge_own_cells(rebuilt: Ends, published: Ends) -> Verdict:
    """Judge a statement that a paper derives from its own printed numbers.

    It adds up in print if what these give, within their rounding, and what the statement stands for
    have a value in common; else it is contradicted by the paper itself.
    """
    return Verdict.ADDS_UP if _meets(rebuilt, published) else Verdict.CONTRADICTED


def _meets(one: Ends, other: Ends) -> bool:
    # an end that is not a number compares as false, and then nothing meets
    return one[0] <= one[1] >= other[0] <= other[1] >= one[0]


def judge_draw(claim: Claim, quantity: Quantity, published: Ends) -> tuple[Verdict, str]:
    """Judge one printed draw by the interval of 95 % of the runs; another interval is refused.

    The rule, and why an interval that decides is narrower than the number, stand at `verdicts`.
    """
    if quantity.interval is None or quantity.interval_kind != "runs 95 %":
        raise InswsnError(
            f"Claim {claim.id} is of one draw, and {quantity.name} has no interval of the runs."
        )
    low, high = quantity.interval
    narrow = high - low < abs(claim.reference)
    where, verdict = "outside", Verdict.NOT_REPRODUCED
    if _meets(quantity.interval, published):
        where, verdict = "within", Verdict.LIKE_OURS if narrow else Verdict.NOT_DECIDED
    wide = f"{(high - low) / abs(claim.reference):.2g} times" if claim.reference else "more than"
    return verdict, (
        f"One draw is printed. It lies {where} the interval of 95 % of ours, whose width is {wide} "
        "the printed value." + _DECIDES_NOTHING * (verdict is Verdict.NOT_DECIDED)
    )


def judge_rebuilt(
    value: float, rebuilt: Ends, published: Ends, reference: float
) -> tuple[Verdict, str]:
    """Judge a claim by an experiment that was built again.

    The ends of the rebuilt interval are twice the number if there is no chance in it; those of what
    the claim stands for may be infinite. The width of the rebuilt interval is measured by the
    published number, `reference`.
    """
    what = "whole rebuilt interval" if rebuilt[0] < rebuilt[1] else "rebuilt number"
    if published[0] <= rebuilt[0] <= rebuilt[1] <= published[1]:
        return Verdict.REPRODUCED, f"The {what} lies within the tolerance."
    if rebuilt[1] < published[0] or published[1] < rebuilt[0]:
        return Verdict.NOT_REPRODUCED, f"The {what} lies outside the tolerance."
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
