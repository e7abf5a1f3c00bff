"""In the place of `inswsn_book.record`, and by that name, in the page: nothing is built there.

So a record has no use but to say where data are, what other chapters found, and which sentences of
the page a reader's own numbers make untrue.
"""

from __future__ import annotations

import json
from functools import cache
from pathlib import Path
from types import SimpleNamespace
from typing import Any

from inswsn_book.live.absent import AbsentError
from inswsn_lib.errors import InswsnError
from inswsn_lib.files import data_file


@cache
def _published() -> dict[str, dict[str, list[float]]]:
    """Return values, and ends of intervals, by chapter and name; ``bundle.py`` puts them here."""
    kept = data_file("published.json")
    return json.loads(kept.read_text(encoding="utf-8"))  # type: ignore[no-any-return]


def name_untrue(sentence: str, condition: object) -> None:
    """Say it if a sentence of the page does not hold; the page looks for these words."""
    if not condition:
        print(f"No longer true: {sentence}")


class ChapterRecord:
    """What cells ask of a record, each as `inswsn_book.record.ChapterRecord` has it."""

    def __init__(self, *_: object, **__: object) -> None:
        pass

    @property
    def schema(self) -> None:
        """Tell that the page has no table of parameters: its fields stand at their cell."""
        raise AbsentError("pandas")

    def data(self, name: str) -> Path:
        """Return the path of a file, if the page has it."""
        try:
            return data_file(name)
        except InswsnError:
            raise AbsentError(f"data/{name}") from None

    def reference(self, chapter: str, name: str) -> Any:
        """Return a number of another chapter, and its interval if it has one."""
        value, *interval = _published()[chapter][name]
        return SimpleNamespace(value=value, interval=tuple(interval) or None)

    def as_published(self, _: object) -> bool:
        """Tell that the page computes: it has not the numbers of a published run's intervals."""
        return False

    def holds(self, sentence: str, condition: object) -> None:
        """Say it if a sentence of the page does not hold."""
        name_untrue(sentence, condition)

    def keep(self, *_: object, **__: object) -> None:
        """Keep nothing."""

    quantity = note = say = quote = study = crossed = write = keep
