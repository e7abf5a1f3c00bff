"""Progress on the terminal: bars, or plain lines where there is no terminal."""

from __future__ import annotations

import time
from typing import Any, Self

from rich import progress as bars
from rich.console import Console


class Progress:
    """Bars on standard error, of cells that are done, and lines above them; from any thread."""

    def __init__(self, console: Console | None = None) -> None:
        self._console = console or Console(stderr=True)
        self._live = self._console.is_terminal
        self._bars = bars.Progress(
            bars.TextColumn("{task.description}"),
            bars.BarColumn(bar_width=24),
            bars.TextColumn("cell {task.completed:.0f} of {task.total:.0f}"),
            bars.TimeElapsedColumn(),
            console=self._console,
            disable=not self._live,
        )
        self._tasks: dict[str, tuple[bars.TaskID, float]] = {}

    def __enter__(self) -> Self:
        self._bars.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._bars.stop()

    def say(self, text: str) -> None:
        """Write one line, above the bars."""
        self._console.print(text, markup=False, highlight=False, soft_wrap=True)

    def unchanged(self, name: str) -> None:
        """Say that a chapter is taken from the store."""
        self.say(f"{name}: unchanged")

    def started(self, name: str, cells: int) -> None:
        """Say that a chapter, or a sweep, of that many cells begins."""
        self._tasks[name] = self._bars.add_task(name, total=cells), time.monotonic()
        if not self._live:
            self.say(f"{name}: executing {cells} cells")

    def cell(self, name: str, number: int) -> None:
        """Say that it has come to the cell of that number."""
        self._bars.update(self._tasks[name][0], completed=number)

    def finished(self, name: str) -> None:
        """Say that it is done."""
        task, began = self._tasks[name]
        self._bars.update(task, completed=self._bars.tasks[task].total)
        if not self._live:
            self.say(f"{name}: executed in {time.monotonic() - began:.0f} s")


class Quiet(Progress):
    """Says nothing of chapters and cells, for a study or a sweep, which says what has ended."""

    def _nothing(self, *_: Any, **__: Any) -> Any:
        pass

    unchanged = started = cell = finished = _nothing
