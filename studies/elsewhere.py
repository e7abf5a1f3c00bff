"""Whether other surroundings give the same results, by reruns of every chapter: `make elsewhere`.

    python studies/elsewhere.py [--variant threads-2] [--only 02] [--python PATH] [--jobs 2]

Executes the chapters again with one thing of their surroundings changed (see
book/inswsn_book/elsewhere.py) and holds what they find against data/published. What comes of it
is kept in data/elsewhere.json, from which the book's page is made. One variant takes about as long
as the book does, SCS longer. The study may be stopped at any time: runs that have ended are in
the store and are not made again.

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
import sys
from pathlib import Path

from inswsn_book.elsewhere import (
    ELSEWHERE,
    Cell,
    Variant,
    compared,
    found_elsewhere,
    merged,
    read_elsewhere,
    variants,
    write_elsewhere,
)
from inswsn_book.progress import Quiet
from inswsn_book.project import Chapter, Project
from inswsn_book.runs import Outcome, Request, Run, run_each

from inswsn_lib.errors import InswsnError, ParameterError

ROOT = Path(__file__).parent.parent


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


def run_study(
    project: Project, todo: list[tuple[Variant, Chapter]], jobs: int | None, progress: Quiet
) -> None:
    """Run what has not been run, and put the cells of all that has ended into the file."""
    cells: list[Cell] = []

    def ended(place: int, outcome: Outcome) -> None:
        variant, chapter = todo[place]
        found = outcome.results if isinstance(outcome, Run) else outcome
        cells.append(compared(project, variant, chapter, found))
        progress.say(line_of(cells[-1], chapter))

    requests = [
        Request(chapter.number, surroundings=variant.surroundings) for variant, chapter in todo
    ]
    try:
        run_each(project, requests, progress, ended, jobs=jobs)
    finally:
        keep(project, cells)


def keep(project: Project, cells: list[Cell]) -> None:
    """Put cells into the file, in the place of those that they replace."""
    path = project.root / ELSEWHERE
    before = read_elsewhere(path).cells if path.is_file() else ()
    if cells:
        write_elsewhere(merged(cells, before), path)


def file_results(project: Project, folder: Path, chapters: list[Chapter], progress: Quiet) -> None:
    """Hold the results of another build against the reference, and keep what comes of it."""
    cells = []
    for chapter in chapters:
        found = found_elsewhere(project, folder, chapter)
        if found is not None:
            cells.append(compared(project, found[0], chapter, found[1]))
            progress.say(line_of(cells[-1], chapter))
    if not cells:
        raise ParameterError("--results", folder, "a folder with results files, such as 01.json")
    keep(project, cells)


def line_of(cell: Cell, chapter: Chapter) -> str:
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
        chapters = [project.find(word) for word in given.only] or project.chapters()
        with Quiet() as progress:
            if given.results is not None:
                file_results(project, given.results, chapters, progress)
                return
            chosen = asked_for(given.variant, given.python)
            todo = [(variant, chapter) for variant in chosen for chapter in chapters]
            progress.say(f"elsewhere: {len(todo)} runs, of which those kept are not made again")
            run_study(project, todo, given.jobs, progress)
    except InswsnError as error:
        sys.exit(str(error))
    except KeyboardInterrupt:
        sys.exit(130)


if __name__ == "__main__":
    main()
