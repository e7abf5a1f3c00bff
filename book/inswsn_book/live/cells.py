"""The code cells of a lesson: which of them one needs, and what it says when it runs.

This runs in the page too, so it needs nothing but the standard library.
"""

from __future__ import annotations

import ast
import builtins
import contextlib
import dis
import io
import linecache
import time
import traceback
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass, field
from functools import cache
from types import CodeType
from typing import Any

from inswsn_book.live.absent import AbsentError


@dataclass
class Said:
    """What a cell has said: its text, its figures (name, content), and how it ended.

    `needs` is a package that is not there; `error` an error as Python prints it.
    """

    text: str = ""
    figures: list[tuple[str, str]] = field(default_factory=list)
    needs: str = ""
    error: str = ""


def names(source: str) -> tuple[set[str], set[str]]:
    """Return the names that a cell needs from before it, and those that it binds."""
    needed: set[str] = set()
    bound = set(dir(builtins)) | {"__name__"}
    for load, name in _names(compile(source, "<cell>", "exec")):
        if not load:
            bound.add(name)
        elif name not in bound:
            needed.add(name)
    return needed, bound - set(dir(builtins)) - {"__name__"}


def _names(code: CodeType) -> Iterator[tuple[bool, str]]:
    """Say in order which names of a module are loaded (True) and stored; functions load theirs."""
    for step in dis.get_instructions(code):
        if isinstance(step.argval, CodeType):
            yield from ((load, name) for load, name in _names(step.argval) if load)
        elif step.opname in ("LOAD_NAME", "LOAD_GLOBAL"):
            yield True, step.argval
        elif step.opname in ("STORE_NAME", "STORE_GLOBAL"):
            yield False, step.argval


class Plan:
    """Which cells have run, and which have to run for what a reader asks for.

    Each name comes from the last cell above that binds it. Cells are numbered from 0.
    """

    def __init__(self) -> None:
        self._ran: dict[int, tuple[str, int]] = {}  # source and turn
        self._turn = 0

    def needed(self, sources: Sequence[str], wanted: Sequence[int]) -> list[int]:
        """Return the cells that are to run, in order: those wanted, and what they need above.

        What is needed does not run again if it has, and nothing that it needs has since.
        """
        above = {cell: before(sources, cell) for cell in range(len(sources))}
        found = set(wanted)
        for cell in sorted({i for each in wanted for i in above[each]}):
            source, turn = self._ran.get(cell, ("", -1))
            anew = found.intersection(above[cell])
            later = [i for i in above[cell] if i in self._ran and self._ran[i][1] > turn]
            if turn < 0 or source != sources[cell] or anew or later:
                found.add(cell)
        return sorted(found)

    def below(self, sources: Sequence[str], cell: int) -> list[int]:
        """Return the cells that need one, in order."""
        return [i for i in range(cell + 1, len(sources)) if cell in before(sources, i)]

    def asked(self, asked: dict[str, Any]) -> list[int]:
        """Return the cells that are to run for what a page asks; see `answer`."""
        sources, wanted = asked["sources"], list(asked["wanted"])
        if asked.get("below"):
            wanted += self.below(sources, wanted[0])
        return [cell for cell in self.needed(sources, wanted) if asked["runs"][cell]]

    def turns(self, asked: dict[str, Any]) -> Iterator[dict[str, Any]]:
        """Say of each cell that is to run that it starts; until `ran` is called, it has not run.

        A cell that needs one that did not end well is left out.
        """
        cells = self.asked(asked)
        failed: set[int] = set()
        for place, cell in enumerate(cells, 1):
            if failed.isdisjoint(before(asked["sources"], cell)):
                self._ran.pop(cell, None)
                yield {"cell": cell, "starts": place, "of": len(cells)}
            if cell not in self._ran:
                failed.add(cell)

    def ran(self, cell: int, source: str) -> None:
        """Take down that a cell has run to its end."""
        self._turn += 1
        self._ran[cell] = source, self._turn


def before(sources: Sequence[str], cell: int) -> list[int]:
    """Return which cells a cell needs, itself or through others, in order.

    A cell that cannot be compiled needs none: it will say why.
    """
    found: set[int] = set()
    waiting = [cell]
    while waiting:
        here = waiting.pop()
        for name in _split(sources[here])[0]:
            binding = [i for i in range(here) if name in _split(sources[i])[1]]
            if binding and binding[-1] not in found:
                found.add(binding[-1])
                waiting.append(binding[-1])
    return sorted(found)


@cache
def _split(source: str) -> tuple[frozenset[str], frozenset[str]]:
    try:
        needed, bound = names(source)
    except SyntaxError:
        return frozenset(), frozenset()
    return frozenset(needed), frozenset(bound)


class Lesson:
    """The names of a lesson, and its cells as they run one by one."""

    def __init__(self) -> None:
        self.scope: dict[str, Any] = {"__name__": "__main__"}
        self._figures: list[tuple[str, str]] = []

    def show(self, name: str, content: str) -> None:
        """Take a figure that the running cell shows: its name, and its content as JSON."""
        self._figures.append((name, content))

    def run(self, number: int, source: str) -> Said:
        """Run a cell; what it prints and shows is returned, and the value of its last line."""
        place, out = f"<cell {number}>", io.StringIO()
        # so that a traceback shows the lines
        linecache.cache[place] = (len(source), None, source.splitlines(True), place)
        self._figures = []
        said = Said()
        with contextlib.redirect_stdout(out), contextlib.redirect_stderr(out):
            try:
                self._execute(source, place)
            except AbsentError as error:
                said.needs = str(error.name)
            except BaseException as error:  # whatever a reader's code raises, KeyboardInterrupt too
                said.error = _as_python_shows(error)
        said.text, said.figures = out.getvalue(), self._figures
        return said

    def _execute(self, source: str, place: str) -> None:
        tree = ast.parse(source, place)
        last = tree.body[-1] if tree.body else None
        if not isinstance(last, ast.Expr) or source.rstrip().endswith(";"):
            exec(compile(tree, place, "exec"), self.scope)
            return
        tree.body.pop()
        exec(compile(tree, place, "exec"), self.scope)
        value = eval(compile(ast.Expression(last.value), place, "eval"), self.scope)
        if value is not None:
            print(repr(value))


def _as_python_shows(error: BaseException) -> str:
    """Return a traceback from the cell on: what runs the cell is nobody's mistake."""
    seen = error.__traceback__
    while seen is not None and not seen.tb_frame.f_code.co_filename.startswith("<cell "):
        seen = seen.tb_next
    return "".join(traceback.format_exception(type(error), error, seen))


def answer(lesson: Lesson, plan: Plan, asked: dict[str, Any]) -> Iterator[dict[str, Any]]:
    """Run what a page asks for; say of each cell when it starts, and what it has said.

    Parameters
    ----------
    asked
        ``sources`` of all cells, ``wanted``, numbers of cells, ``runs``, whether each cell can, and
        ``below`` if the cells below the first wanted that need it are wanted, too. What needs a
        cell that fails is left out.
    """
    for turn in plan.turns(asked):
        yield turn
        cell = turn["cell"]
        source = asked["sources"][cell]
        said = timed(lesson, cell, source)
        if not (said["needs"] or said["error"]):
            plan.ran(cell, source)
        yield {"cell": cell, **said}


def timed(lesson: Lesson, cell: int, source: str) -> dict[str, Any]:
    """Run a cell; return what it said, and in how many seconds."""
    began = time.perf_counter()
    said = lesson.run(cell + 1, source)
    return {"seconds": time.perf_counter() - began, **asdict(said)}


def lesson_in_the_page() -> Lesson:
    """Return a lesson whose figures that move are told to it, and have no still picture."""
    from inswsn_book.show import moving  # noqa: PLC0415  # loads what absent packages stand in for

    lesson = Lesson()
    moving.shown_to(lesson.show)
    return lesson
