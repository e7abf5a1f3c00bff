"""How one results file differs from another, quantity by quantity."""

from __future__ import annotations

from dataclasses import dataclass

from inswsn_lib.claims.results import Quantity, Results


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
    def beyond_tolerance(self) -> bool:
        """Whether it appeared, vanished, changed its unit, or moved by more than its tolerance."""
        if self.before is None or self.after is None or self.before.unit != self.after.unit:
            return True
        return not abs(self.after.value - self.before.value) <= self.before.tolerance

    def __str__(self) -> str:
        """Return one line: the name, the value before, the value after, the difference."""
        before = "absent" if self.before is None else f"{self.before.value:.10g} {self.before.unit}"
        after = "absent" if self.after is None else f"{self.after.value:.10g} {self.after.unit}"
        if self.before is None or self.after is None:
            return f"{self.name}: {before} -> {after}"
        difference = self.after.value - self.before.value
        return (
            f"{self.name}: {before} -> {after} "
            f"(change {difference:+.3g}, tolerance {self.before.tolerance:.3g})"
        )


def compare(before: Results, after: Results) -> list[Change]:
    """Return every quantity that differs at all between two results.

    Parameters
    ----------
    before, after : Results
        Two results of one chapter.

    Returns
    -------
    list of Change
        In the order of `after`; quantities that `after` lacks come last.
    """
    old = {quantity.name: quantity for quantity in before.quantities}
    new = {quantity.name: quantity for quantity in after.quantities}
    names = [*new, *(name for name in old if name not in new)]
    return [
        Change(name, old.get(name), new.get(name))
        for name in names
        if old.get(name) != new.get(name)
    ]
