"""How one results file differs from another, quantity by quantity."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

from rich.console import Console
from rich.table import Table

from inswsn_book.ledger import Claim
from inswsn_book.results import Quantity, Results
from inswsn_book.verdicts import Judged, verdicts
from inswsn_lib.errors import InswsnError


@dataclass(frozen=True)
class Change:
    """One quantity in two results files.

    Attributes
    ----------
    name : str
        The quantity.
    before, after : Quantity or None
        The quantity in each file; None where it is absent.
    """

    name: str
    before: Quantity | None
    after: Quantity | None

    @property
    def unit(self) -> str:
        """The unit of the quantity, in the later results if both have it."""
        quantity = self.after or self.before
        return quantity.unit if quantity else ""

    @property
    def details(self) -> list[str]:
        """What differs beside the value, its wording and small changes of its interval."""
        if self.before is None or self.after is None:
            return []
        found = [
            f"{field} {getattr(self.before, field)} -> {getattr(self.after, field)}"
            for field in ("unit", "interval_kind", "runs", "basis", "role", "tolerance")
            if getattr(self.before, field) != getattr(self.after, field)
            and not (field == "tolerance" and _same_tolerance(self.before, self.after))
        ]
        old, new = self.before.interval, self.after.interval
        if old and new and any(abs(b - a) > 1e-12 * abs(a) for a, b in zip(old, new, strict=True)):
            found.append(f"interval {old} -> {new}")
        return found

    @property
    def beyond_tolerance(self) -> bool:
        """Whether it appeared, vanished, became another quantity, or moved beyond its tolerance.

        The ends of its interval may move by the tolerance, as its value may.
        """
        if self.before is None or self.after is None:
            return True
        before, after = self.before, self.after
        fixed = ("unit", "interval_kind", "runs", "basis", "role")
        if any(getattr(before, field) != getattr(after, field) for field in fixed):
            return True
        # a reference that had its tolerance widened would vouch for anything
        if not _same_tolerance(before, after):
            return True
        old = (before.value, *(before.interval or ()))
        new = (after.value, *(after.interval or ()))
        return not all(abs(b - a) <= before.tolerance for a, b in zip(old, new, strict=True))

    def __str__(self) -> str:
        """Return one line: the name, the value before, the value after, the difference."""
        before = "absent" if self.before is None else f"{self.before.value:.10g} {self.before.unit}"
        after = "absent" if self.after is None else f"{self.after.value:.10g} {self.after.unit}"
        if self.before is None or self.after is None:
            return f"{self.name}: {before} -> {after}"
        difference = self.after.value - self.before.value
        others = [
            f"{field} {getattr(self.before, field)} -> {getattr(self.after, field)}"
            for field in Quantity.model_fields
            if field not in ("name", "value", "unit")
            and getattr(self.before, field) != getattr(self.after, field)
        ]
        return (
            f"{self.name}: {before} -> {after} "
            f"(change {difference:+.3g}, tolerance {self.before.tolerance:.3g})"
            + "".join(f"; {other}" for other in others)
        )


def _same_tolerance(before: Quantity, after: Quantity) -> bool:
    # one that is a share of the value carries the value's rounding
    return math.isclose(before.tolerance, after.tolerance, rel_tol=1e-3)


def pair_quantities(before: Results, after: Results) -> list[Change]:
    """Return every quantity of two results, whether it differs or not.

    Returns
    -------
    list of Change
        In the order of `before`; quantities that `before` lacks come last.
    """
    old = {quantity.name: quantity for quantity in before.quantities}
    new = {quantity.name: quantity for quantity in after.quantities}
    return [Change(name, old.get(name), new.get(name)) for name in dict.fromkeys([*old, *new])]


def compare(before: Results, after: Results) -> list[Change]:
    """Return every quantity that differs at all between two results.

    Returns
    -------
    list of Change
        In the order of `before`; quantities that `before` lacks come last.
    """
    return [pair for pair in pair_quantities(before, after) if pair.before != pair.after]


@dataclass(frozen=True)
class Flip:
    """A claim whose verdict is not the same by two results.

    Attributes
    ----------
    claim : Claim
        The claim.
    before, after : Judged or None
        The verdict by each; None where the results lack what decides it.
    """

    claim: Claim
    before: Judged | None
    after: Judged | None

    def __str__(self) -> str:
        """Return one line: the claim, the verdict before, the verdict after, and why."""
        before, after = (
            "without a verdict" if judged is None else str(judged.verdict)
            for judged in (self.before, self.after)
        )
        why = f" ({self.after.reason})" if self.after else ""
        return f"{self.claim.id}: {before} -> {after}{why}"


def flipped_verdicts(claims: Iterable[Claim], before: Results, after: Results) -> list[Flip]:
    """Return the claims whose verdict differs between two results.

    Parameters
    ----------
    before, after : Results
        Two results of that chapter, which may be of different versions.
    """
    pairs = [Flip(claim, _judge(claim, before), _judge(claim, after)) for claim in claims]
    return [pair for pair in pairs if _verdict(pair.before) != _verdict(pair.after)]


def _judge(claim: Claim, results: Results) -> Judged | None:
    try:
        return verdicts([claim], [results])[0]
    except InswsnError:  # the other version of the chapter did not record what decides it
        return None


def _verdict(judged: Judged | None) -> str | None:
    return None if judged is None else judged.verdict


def compare_conditions(before: Results, after: Results) -> list[str]:
    """Return every way in which two results differ beside their quantities.

    Returns
    -------
    list of str
        One line for each parameter, data file, sentence, solver and cell that differs.
    """
    lines = []
    for field in ("parameters", "data", "sentences", "solvers", "cells"):
        old, new = getattr(before, field), getattr(after, field)
        lines += [
            f"{field}: {name}: {old.get(name, 'absent')} -> {new.get(name, 'absent')}"
            for name in [*new, *(name for name in old if name not in new)]
            if old.get(name) != new.get(name)
        ]
    return lines


def show_comparison(
    before: Results,
    after: Results,
    claims: Sequence[Claim],
    names: tuple[str, str],
    console: Console,
) -> None:
    """Write two results side by side: quantities, sentences that differ, verdicts that flipped."""
    table = Table("quantity", *names, "change", "unit", box=None, pad_edge=False)
    changes = [(pair, _difference(pair)) for pair in pair_quantities(before, after)]
    for pair, difference in changes:
        table.add_row(pair.name, _value(pair.before), _value(pair.after), difference, pair.unit)
    console.print(table)
    changed = sum(bool(difference) for _, difference in changes)

    def say(line: str) -> None:
        console.print(line, markup=False, soft_wrap=True)

    for pair, _ in changes:
        if pair.details:
            say(f"{pair.name}: {'; '.join(pair.details)}")
    for line in compare_conditions(before, after):
        if not line.startswith(("sentences: ", "cells: ")):
            say(line)
    overturned = _overturned(before.sentences, after.sentences)
    for line in overturned:
        say(line)
    flips = flipped_verdicts(claims, before, after)
    for flip in flips:
        say(f"verdict {flip}")
    sentences = len(set(before.sentences) | set(after.sentences))
    say(
        f"{changed} of {len(changes)} quantities changed, "
        f"{len(overturned)} of {sentences} sentences overturned, "
        f"{len(flips)} of {len(claims)} verdicts flipped."
    )


def _overturned(before: Mapping[str, bool], after: Mapping[str, bool]) -> list[str]:
    """Return a line for each sentence that holds in one run and not in the other."""
    lines = []
    for sentence in dict.fromkeys([*before, *after]):
        old, new = before.get(sentence), after.get(sentence)
        if old != new and False in (old, new):
            lines.append(f"{'no longer holds' if new is False else 'holds now'}: {sentence}")
        elif old != new:
            lines.append(f"{'gone' if new is None else 'new'}: {sentence}")
    return lines


def _value(quantity: Quantity | None) -> str:
    return "absent" if quantity is None else f"{quantity.value:.6g}"


def _difference(pair: Change) -> str:
    if pair.before is None or pair.after is None:
        return "new" if pair.before is None else "gone"
    difference = pair.after.value - pair.before.value
    if abs(difference) > 1e-12 * abs(pair.before.value):
        return f"{difference:+.3g}"
    return "otherwise" if pair.details else ""
