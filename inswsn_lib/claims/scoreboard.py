"""Statements that a paper derives from its own numbers, each judged as it is recomputed."""

from __future__ import annotations

from dataclasses import dataclass

from inswsn_lib.claims.verdicts import Verdict, judge_own_cells


@dataclass(frozen=True)
class Statement:
    """A statement and what became of it.

    Attributes
    ----------
    paper, place, text : str
        Where it stands and what it says, in our words.
    published, rebuilt : tuple of two floats
        The ends of what the statement stands for, and of what the paper's own numbers give.
    unit : str
        Their unit; empty for a pure number.
    digits : int
        Digits after the point when they are written.
    """

    paper: str
    place: str
    text: str
    published: tuple[float, float]
    rebuilt: tuple[float, float]
    unit: str
    digits: int

    @property
    def verdict(self) -> Verdict:
        """The verdict by `judge_own_cells`."""
        return judge_own_cells(self.rebuilt, self.published)

    def cells(self) -> tuple[str, ...]:
        """Return paper, place, text, published, rebuilt and verdict, written for a table."""
        return (
            self.paper,
            self.place,
            self.text,
            self._write(self.published),
            self._write(self.rebuilt),
            str(self.verdict),
        )

    def _write(self, ends: tuple[float, float]) -> str:
        low, high = (f"{end:.{self.digits}f}" for end in ends)
        return f"{low if low == high else f'{low} to {high}'} {self.unit}".strip()


class Scoreboard:
    """Collects judged statements in the order in which a chapter comes to them."""

    #: The headings of the cells of a statement
    HEADINGS = ("paper", "place", "statement", "the paper says", "its numbers give", "verdict")

    def __init__(self) -> None:
        self.statements: list[Statement] = []

    def judge(
        self,
        paper: str,
        place: str,
        text: str,
        *,
        published: tuple[float, float],
        rebuilt: tuple[float, float],
        unit: str = "%",
        digits: int = 1,
    ) -> Verdict:
        """Add a statement and return its verdict; the parameters are those of `Statement`."""
        statement = Statement(paper, place, text, published, rebuilt, unit, digits)
        self.statements.append(statement)
        return statement.verdict

    def count(self, verdict: Verdict) -> int:
        """Return the number of statements with that verdict."""
        return sum(statement.verdict is verdict for statement in self.statements)
