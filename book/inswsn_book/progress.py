"""Progress on the terminal: bars, or plain lines where there is no terminal."""

from __future__ import annotations

import time
from typing import Any, Self

from rich import progress as bars
from rich.console import Console


class Bars:
    """Bars on a terminal, by default standard error, and lines above them; from any thread."""

    def __init__(self, console: Console | None, *columns: bars.ProgressColumn) -> None:
        self._console = console or Console(stderr=True)
        self._live = self._console.is_terminal
        self._bars = bars.Progress(*columns, console=self._console, disable=not self._live)

    def __enter__(self) -> Self:
        self._bars.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._bars.stop()

    def say(self, text: str) -> None:
        """Write one line, above the bars."""
        self._console.print(text, markup=False, highlight=False, soft_wrap=True)


class Progress(Bars):
    """Shows chapter, cell and elapsed time."""

    def __init__(self, console: Console | None = None) -> None:
        super().__init__(
            console,
            bars.TextColumn("{task.description}"),
            bars.BarColumn(bar_width=24),
            bars.TextColumn("cell {task.completed:.0f} of {task.total:.0f}"),
            bars.TimeElapsedColumn(),
        )
        self._tasks: dict[str, bars.TaskID] = {}
        self._starts: dict[str, float] = {}

    def unchanged(self, chapter: str) -> None:
        """Say that a chapter is taken from the store."""
        self.say(f"{chapter}: unchanged")

    def started(self, chapter: str, cells: int) -> None:
        """Say that a chapter of that many cells begins."""
        self._starts[chapter] = time.monotonic()
        self._tasks[chapter] = self._bars.add_task(chapter, total=cells)
        if not self._live:
            self.say(f"{chapter}: executing {cells} cells")

    def cell(self, chapter: str, number: int) -> None:
        """Say that a chapter has come to the cell of that number."""
        self._bars.update(self._tasks[chapter], completed=number)

    def finished(self, chapter: str) -> None:
        """Say that a chapter is done."""
        task = self._tasks[chapter]
        self._bars.update(task, completed=self._bars.tasks[task].total)
        if not self._live:
            seconds = time.monotonic() - self._starts[chapter]
            self.say(f"{chapter}: executed in {seconds:.0f} s")


class Quiet(Progress):
    """Says nothing of chapters and cells, for a study or a sweep, which says what has ended."""

    def _nothing(self, *_: Any, **__: Any) -> Any:
        pass

    unchanged = started = cell = finished = _nothing
