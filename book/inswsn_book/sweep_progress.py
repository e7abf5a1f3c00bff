"""Progress of a sweep: one bar, or a plain line for each cell where there is no terminal."""

from __future__ import annotations

from rich import progress as bars
from rich.console import Console

from inswsn_book.progress import Bars


class SweepProgress(Bars):
    """Shows runs done of all runs, cells that failed, and the time that is left.

    Of a chapter that is executed in each cell it counts cells in place of runs.

    Parameters
    ----------
    console : rich.console.Console, optional
        Where to write. Default: standard error.
    """

    def __init__(self, console: Console | None = None) -> None:
        super().__init__(
            console,
            bars.TextColumn("{task.description}"),
            bars.BarColumn(bar_width=20),
            bars.TextColumn("{task.completed:,.0f} of {task.total:,.0f} {task.fields[counted]}"),
            bars.TextColumn("{task.fields[failed]}"),
            bars.TimeRemainingColumn(),
            # a task takes seconds, and the first ones of a cell longer than the others
            speed_estimate_period=120,
        )
        self._bar: bars.TaskID | None = None
        self._failed = 0

    def started(self, name: str, done: int, total: int, counted: str = "runs") -> None:
        """Say how many runs, or what else is counted, are there and how many there will be."""
        self._bar = self._bars.add_task(
            name, total=total, completed=done, failed="", counted=counted
        )

    def advanced(self, count: int) -> None:
        """Say that so many more are kept."""
        if self._bar is not None:
            self._bars.advance(self._bar, count)

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
