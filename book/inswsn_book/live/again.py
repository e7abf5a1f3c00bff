"""A chapter's record that takes a name again: a reader runs a cell as often as they like."""

from __future__ import annotations

from typing import Any

from inswsn_book import record
from inswsn_book.record import ChapterRecord
from inswsn_book.results import Quantity


class _Again(ChapterRecord):
    def quantity(self, name: str, value: float, unit: str, **fields: Any) -> Quantity:
        self._quantities.pop(name, None)
        return super().quantity(name, value, unit, **fields)

    def holds(self, sentence: str, condition: object) -> None:
        self._sentences.pop(sentence, None)
        super().holds(sentence, condition)


def record_again() -> None:
    """Have what a chapter records replace what it has recorded by the same name, in this kernel."""
    record.ChapterRecord = _Again  # type: ignore[misc]
