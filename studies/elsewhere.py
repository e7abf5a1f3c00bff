"""Whether other surroundings give the same results, by reruns of every chapter: `make elsewhere`.

    python studies/elsewhere.py [--variant threads-2] [--only 02] [--python PATH] [--jobs 2]

Executes the chapters again with one thing of their surroundings changed (see
book/inswsn_book/elsewhere.py) and holds what they find against data/published. What comes of it
is kept in data/elsewhere.json, from which the book's page is made. One variant takes about as long
as the book does, SCS longer. The study may be stopped at any time: runs that have ended are kept in
_build/elsewhere and are not made again.

A second Python is one in whose environment the locked packages and inswsn are installed:

    python3.13 -m venv elsewhere
    elsewhere/bin/python -m pip install --require-hashes -r environment.lock
    elsewhere/bin/python -m pip install --no-deps --no-build-isolation -e .
    python studies/elsewhere.py --python elsewhere/bin/python

Without --python its cells stay as they were stored, as do all cells that are not asked for.

What a build of the same chapters on another machine has found needs no run here: give a folder of
its results files, such as 01.json, as --results FOLDER.
"""

from __future__ import annotations

import argparse
import os
import sys
from concurrent.futures import FIRST_EXCEPTION, ThreadPoolExecutor, wait
from pathlib import Path

from inswsn_book.elsewhere import (
    ELSEWHERE,
    Cell,
    Variant,
    compared,
    found_elsewhere,
    kept_run,
    merged,
    read_elsewhere,
    run,
    variants,
    write_elsewhere,
)
from inswsn_book.execution import longest_first
from inswsn_book.progress import Progress
from inswsn_book.project import Chapter, Project
from inswsn_book.provenance import repository_state
from inswsn_book.running import find_chapter

from inswsn_lib.errors import InswsnError, ParameterError

ROOT = Path(__file__).parent.parent


class Quiet(Progress):
    """Says nothing of the cells of a notebook; the study says when one is done."""

    def started(self, chapter: str, cells: int) -> None:
        """Say nothing."""

    def cell(self, chapter: str, index: int) -> None:
        """Say nothing."""

    def finished(self, chapter: str) -> None:
        """Say nothing."""


def asked_for(names: list[str], python: str | None) -> list[Variant]:
    """Return the variants of these names; all that can be had if there are none."""
    found = variants(python)
    wrong = [name for name in names if name not in {variant.id for variant in found}]
    if wrong:
        may_be = "one of " + ", ".join(variant.id for variant in found)
        if python is None:
            may_be += "; python-X.Y needs --python"
        raise ParameterError("--variant", wrong[0], may_be)
    return [variant for variant in found if not names or variant.id in names]


def run_all(
    project: Project, todo: list[tuple[Variant, Chapter]], jobs: int, progress: Progress
) -> None:
    """Run what has not been run, and put the cells of all into the file."""
    state = repository_state(project.root)  # before the file is written

    def one(variant: Variant, chapter: Chapter) -> Cell:
        ran = kept_run(project, variant, chapter)
        if ran is None:
            ran = run(project, variant, chapter, Quiet(), state)
        cell = compared(project, variant, chapter, ran)
        progress.say(said_of(cell, chapter))
        return cell

    pool = ThreadPoolExecutor(max_workers=jobs)
    try:
        pending = [pool.submit(one, variant, chapter) for variant, chapter in todo]
        wait(pending, return_when=FIRST_EXCEPTION)
        for future in pending:
            future.cancel()
        done, _ = wait(pending)
        ended = [future for future in done if not future.cancelled()]
        keep(project, [future.result() for future in ended if not future.exception()])
        for future in ended:
            future.result()  # raises what a run raised, after what the others found is kept
    finally:
        # an interrupt does not wait for the runs that are under way
        pool.shutdown(wait=False, cancel_futures=True)


def keep(project: Project, cells: list[Cell]) -> None:
    """Put cells into the file, in the place of those that they replace."""
    path = project.root / ELSEWHERE
    before = read_elsewhere(path).cells if path.is_file() else ()
    if cells:
        write_elsewhere(merged(cells, before), path)


def file_results(
    project: Project, folder: Path, chapters: list[Chapter], progress: Progress
) -> None:
    """Hold the results of another build against the reference, and keep what comes of it."""
    cells = []
    for chapter in chapters:
        found = found_elsewhere(project, folder, chapter)
        if found is not None:
            cells.append(compared(project, found[0], chapter, found[1]))
            progress.say(said_of(cells[-1], chapter))
    if not cells:
        raise ParameterError("--results", folder, "a folder with results files, such as 01.json")
    keep(project, cells)


def said_of(cell: Cell, chapter: Chapter) -> str:
    """Return a line for the terminal."""
    how = f"failed: {cell.failed}" if cell.failed else (
        f"{cell.compared} quantities, {len(cell.beyond)} beyond tolerance, "
        f"{len(cell.overturned)} sentences overturned, {len(cell.flipped)} verdicts flipped, "
        f"{cell.seconds:.0f} s"
    )  # fmt: skip
    return f"{cell.variant}: {chapter.name}: {how}"


def main() -> None:
    """Run what is due and write the file."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--variant", action="append", default=[], help="only this one; repeatable")
    parser.add_argument("--only", action="append", default=[], metavar="CHAPTER", help="repeatable")
    parser.add_argument("--python", help="another interpreter, in an environment with inswsn")
    parser.add_argument("--jobs", type=int, default=1, help="chapters at once")
    parser.add_argument("--results", type=Path, help="a folder of what another build found")
    given = parser.parse_args()
    project = Project(ROOT.resolve())
    try:
        if given.results is not None:
            chapters = [find_chapter(project, word) for word in given.only] or project.chapters()
            file_results(project, given.results, chapters, Progress())
            return
        chosen = asked_for(given.variant, given.python)
        chapters = [find_chapter(project, word) for word in given.only] or project.chapters()
        todo = [(v, chapter) for v in chosen for chapter in longest_first(project, chapters)]
        with Progress() as progress:
            progress.say(f"elsewhere: {len(todo)} runs, of which those kept are not made again")
            run_all(project, todo, given.jobs, progress)
    except InswsnError as error:
        sys.exit(str(error))
    except KeyboardInterrupt:
        # not after the runs that are under way: their workers end when this process is gone
        os._exit(130)


if __name__ == "__main__":
    main()
