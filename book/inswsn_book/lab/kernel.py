"""What a kernel of `make lab` begins with: figures move, and a cell that records may run again."""

from __future__ import annotations

from typing import Any

from inswsn_book import record
from inswsn_book.live.unrecorded import name_untrue
from inswsn_book.record import ChapterRecord
from inswsn_book.record.results import Quantity
from inswsn_book.show import moving


class _Again(ChapterRecord):
    """Takes a name again in the place of before, and says what is untrue."""

    def quantity(self, name: str, value: float, unit: str, **fields: Any) -> Quantity:
        self._quantities.pop(name, None)
        return super().quantity(name, value, unit, **fields)

    def holds(self, sentence: str, condition: object) -> None:
        self._sentences.pop(sentence, None)
        super().holds(sentence, condition)
        name_untrue(sentence, condition)


def begin() -> None:
    """Have this kernel record so, and show figures by the widget; without anywidget, stills."""
    record.ChapterRecord = _Again  # type: ignore[misc]
    try:
        from inswsn_book.lab.widget import show  # noqa: PLC0415  # what it needs may be absent
    except ImportError:
        return
    moving.shown_to(show)
