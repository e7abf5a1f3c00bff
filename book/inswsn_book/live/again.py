"""A chapter's record for cells that run again: it takes names again, and says what is untrue."""

from __future__ import annotations

from typing import Any

from inswsn_book import record
from inswsn_book.live.unrecorded import name_untrue
from inswsn_book.record import ChapterRecord
from inswsn_book.results import Quantity


class _Again(ChapterRecord):
    def quantity(self, name: str, value: float, unit: str, **fields: Any) -> Quantity:
        self._quantities.pop(name, None)
        return super().quantity(name, value, unit, **fields)

    def holds(self, sentence: str, condition: object) -> None:
        self._sentences.pop(sentence, None)
        super().holds(sentence, condition)
        name_untrue(sentence, condition)


def record_again() -> None:
    """Have what a chapter records replace what it has recorded by the same name, in this kernel."""
    record.ChapterRecord = _Again  # type: ignore[misc]
