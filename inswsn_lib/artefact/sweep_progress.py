"""Progress of a sweep: one bar, or a plain line for each cell where there is no terminal."""

from __future__ import annotations

from types import TracebackType
from typing import Self

from rich import progress as bars
from rich.console import Console


class SweepProgress:
    """Shows runs done of all runs, cells that failed, and the time that is left.

    Parameters
    ----------
    console : rich.console.Console, optional
        Where to write. Default: standard error.
    """

    def __init__(self, console: Console | None = None) -> None:
        self._console = console or Console(stderr=True)
        self._live = self._console.is_terminal
        self._bars = bars.Progress(
            bars.TextColumn("{task.description}"),
            bars.BarColumn(bar_width=20),
            bars.TextColumn("{task.completed:,.0f} of {task.total:,.0f} runs"),
            bars.TextColumn("{task.fields[failed]}"),
            bars.TimeRemainingColumn(),
            console=self._console,
            disable=not self._live,
            # a task takes seconds, and the first ones of a cell longer than the others
            speed_estimate_period=120,
        )
        self._bar: bars.TaskID | None = None
        self._failed = 0

    def __enter__(self) -> Self:
        self._bars.start()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._bars.stop()

    def say(self, text: str) -> None:
        """Write one line, above the bar."""
        self._console.print(text, markup=False, highlight=False, soft_wrap=True)

    def started(self, name: str, done: int, total: int) -> None:
        """Say how many runs are there and how many there will be."""
        self._bar = self._bars.add_task(name, total=total, completed=done, failed="")

    def advanced(self, runs: int) -> None:
        """Say that so many more runs are kept."""
        if self._bar is not None:
            self._bars.advance(self._bar, runs)

    def cell(self, name: str, left: int) -> None:
        """Say that a cell is done, and how many are not."""
        if not self._live:
            self.say(f"{name}: done, {left} to go")

    def failed(self, name: str, reason: str) -> None:
        """Say that a cell has failed."""
        self._failed += 1
        if self._bar is not None:
            self._bars.update(self._bar, failed=f"{self._failed} failed")
        self.say(f"{name}: failed: {reason}")
