"""How one results file differs from another: quantities, conditions, verdicts."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from itertools import chain, zip_longest

from rich.console import Console
from rich.table import Table

from inswsn_book.ledger import Claim
from inswsn_book.results import Quantity, Results
from inswsn_book.verdicts import Judged, verdicts
from inswsn_lib.errors import InswsnError

# What a quantity is, beside its numbers
_KIND = ("unit", "interval_kind", "runs", "basis", "role")


@dataclass(frozen=True)
class Change:
    """One quantity in two results files; None where it is absent."""

    name: str
    before: Quantity | None
    after: Quantity | None

    @property
    def details(self) -> list[str]:
        """What differs beside the value, its wording and small changes of its interval."""
        if self.before is None or self.after is None:
            return []
        fields = [*_KIND, *([] if self._same_tolerance else ["tolerance"])]
        old, new = self.before.interval, self.after.interval
        if old and new and any(abs(b - a) > 1e-12 * abs(a) for a, b in zip(old, new, strict=True)):
            fields.append("interval")
        return self._differing(fields)

    @property
    def beyond_tolerance(self) -> bool:
        """Whether it appeared, vanished, became another quantity, or moved beyond its tolerance.

        The ends of its interval may move by the tolerance, as its value may.
        """
        before, after = self.before, self.after
        if before is None or after is None or self._differing(_KIND) or not self._same_tolerance:
            return True
        old = (before.value, *(before.interval or ()))
        new = (after.value, *(after.interval or ()))
        return not all(abs(b - a) <= before.tolerance for a, b in zip(old, new, strict=True))

    @property
    def _same_tolerance(self) -> bool:
        # a reference that had its tolerance widened would vouch for anything; one that is a share
        # of the value carries the value's rounding
        assert self.before is not None
        assert self.after is not None
        return math.isclose(self.before.tolerance, self.after.tolerance, rel_tol=1e-3)

    def _differing(self, fields: Iterable[str]) -> list[str]:
        return [
            f"{field} {getattr(self.before, field)} -> {getattr(self.after, field)}"
            for field in fields
            if getattr(self.before, field) != getattr(self.after, field)
        ]

    def __str__(self) -> str:
        """Return one line: the name, the value before, the value after, the difference."""
        before, after = (
            "absent" if quantity is None else f"{quantity.value:.10g} {quantity.unit}"
            for quantity in (self.before, self.after)
        )
        line = f"{self.name}: {before} -> {after}"
        if self.before is None or self.after is None:
            return line
        difference = self.after.value - self.before.value
        line += f" (change {difference:+.3g}, tolerance {self.before.tolerance:.3g})"
        others = [f for f in Quantity.model_fields if f not in ("name", "value", "unit")]
        return "; ".join([line, *self._differing(others)])


def pair_quantities(before: Results, after: Results) -> list[Change]:
    """Return every quantity of two results; those that `before` lacks come last."""
    old = {quantity.name: quantity for quantity in before.quantities}
    new = {quantity.name: quantity for quantity in after.quantities}
    return [Change(name, old.get(name), new.get(name)) for name in dict.fromkeys([*old, *new])]


def compare(before: Results, after: Results) -> list[Change]:
    """Return every quantity that differs at all between two results."""
    return [pair for pair in pair_quantities(before, after) if pair.before != pair.after]


@dataclass(frozen=True)
class Flip:
    """A claim whose verdict is another one by other results; None where nothing decides it."""

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
    """Return the claims of a chapter whose verdict differs between two results of it."""
    flips = [Flip(claim, _judge(claim, before), _judge(claim, after)) for claim in claims]
    return [
        flip
        for flip in flips
        if (flip.before and flip.before.verdict) != (flip.after and flip.after.verdict)
    ]


def _judge(claim: Claim, results: Results) -> Judged | None:
    try:
        return verdicts([claim], [results])[0]
    except InswsnError:  # the other version of the chapter did not record what decides it
        return None


def compare_conditions(before: Results, after: Results) -> list[str]:
    """Return a line for each parameter, data file, sentence, solver and cell that differs."""
    lines = []
    for field in ("parameters", "data", "sentences", "solvers", "cells"):
        old, new = getattr(before, field), getattr(after, field)
        lines += [
            f"{field}: {name}: {old.get(name, 'absent')} -> {new.get(name, 'absent')}"
            for name in dict.fromkeys([*new, *old])
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
    """Write what differs between two results: quantities, conditions, verdicts."""
    table = Table("quantity", *names, "change", "unit", box=None, pad_edge=False)
    pairs = pair_quantities(before, after)
    changed = [(pair, word) for pair in pairs if (word := _difference(pair))]
    for pair, word in changed:
        both = (pair.before, pair.after)
        values = ("absent" if q is None else f"{q.value:.6g}" for q in both)
        table.add_row(pair.name, *values, word, next(q.unit for q in both[::-1] if q))
    console.print(table)
    conditions = compare_conditions(before, after)
    flips = flipped_verdicts(claims, before, after)
    overturned = sum(line.startswith("sentences: ") for line in conditions)
    sentences = len(before.sentences.keys() | after.sentences.keys())
    for line in [
        *(f"{pair.name}: {'; '.join(pair.details)}" for pair, _ in changed if pair.details),
        *(line for line in conditions if not line.startswith("cells: ")),
        *_tables_that_differ(before, after),
        *(f"verdict {flip}" for flip in flips),
        f"{len(changed)} of {len(pairs)} quantities changed, {overturned} of {sentences} sentences "
        f"overturned, {len(flips)} of {len(claims)} verdicts flipped.",
    ]:
        console.print(line, markup=False, soft_wrap=True)


def _tables_that_differ(before: Results, after: Results) -> Iterator[str]:
    for name in sorted(before.tables.keys() & after.tables.keys()):
        old, new = (list(chain(*results.tables[name])) for results in (before, after))
        changed = sum(a != b for a, b in zip_longest(old, new))
        if changed:
            yield f"table {name}: {changed} of {max(len(old), len(new))} cells differ"


def _difference(pair: Change) -> str:
    """Return a word on how a quantity differs, none if it does not beyond rounding."""
    if pair.before is None or pair.after is None:
        return "new" if pair.before is None else "gone"
    difference = pair.after.value - pair.before.value
    if abs(difference) > 1e-12 * abs(pair.before.value):
        return f"{difference:+.3g}"
    return "otherwise" if pair.details else ""
