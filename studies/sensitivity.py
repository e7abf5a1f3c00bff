"""How much each headline result moves when an assumption changes, by reruns: `make studies`.

    python studies/sensitivity.py [--only P1-M-B] [--jobs 2]

Runs the chapters again with one assumption of data/assumptions.yaml changed, everything else as
published but for fewer runs, and keeps what comes of it in data/sensitivity.json, from which the
book's page of assumptions is made. The unchanged chapters are run with the same settings and with
other seeds, which tells what is chance. It takes about an hour and a half of one core. It may be
stopped at any time: what has finished is kept in _build/sensitivity.jsonl and is not run again.

With --only the alternatives of one assumption are run and take their place in the file, whose
provenance then tells of the last run alone: good for a look, and the whole for keeps.
"""

from __future__ import annotations

import argparse
import datetime
import sys
from concurrent.futures import ThreadPoolExecutor, as_completed
from pathlib import Path

from inswsn_book.about import load_about
from inswsn_book.assumptions import (
    Assumptions,
    load_assumptions,
    problems_of,
)
from inswsn_book.files import file_digest, tree_digest
from inswsn_book.progress import Progress
from inswsn_book.project import Project
from inswsn_book.provenance import machine_facts, repository_state
from inswsn_book.sensitivity import Cell, Working, cell_key, cells_of, run_cell
from inswsn_book.study import (
    ASSUMPTIONS,
    SENSITIVITY,
    Made,
    Run,
    Study,
    merged,
    read_study,
    write_study,
)

from inswsn_lib.errors import InswsnError
from inswsn_lib.files import data_mirror

ROOT = Path(__file__).parent.parent


def made_from(project: Project, assumptions: Assumptions) -> Made:
    """Return what the study is made with."""
    machine = machine_facts()
    commit, clean = repository_state(project.root)
    return Made(
        version=load_about(project.root).version,  # that of the checkout
        day=datetime.datetime.now(datetime.UTC).date().isoformat(),
        commit=commit,
        clean=clean,
        sources={
            "library": project.computing_digest(),
            "locks": tree_digest(project.root, project.locks),
            "assumptions": file_digest(project.root / ASSUMPTIONS),
            **{
                f"chapter {chapter.number}": file_digest(chapter.source)
                for chapter in project.chapters()
                if chapter.number in assumptions.reduced
            },
        },
        recorded=data_mirror() is not None,
        python=machine["python"],
        system=machine["system"],
        cpu=machine["cpu"],
        packages=machine["packages"],
    )


def run_all(
    project: Project, assumptions: Assumptions, cells: list[Cell], jobs: int, progress: Progress
) -> list[Run]:
    """Run the cells that have not been run, each kept as it ends; return all."""
    working = Working(project.build / "sensitivity.jsonl")
    runs = [working.find(cell, cell_key(project, cell)) for cell in cells]
    due = [cell for cell, run in zip(cells, runs, strict=True) if run is None]
    due = sorted(due, key=lambda cell: (_second(assumptions, cell), _rank(due, cell)))
    progress.say(f"sensitivity: {len(due)} of {len(cells)} runs to be made")
    with ThreadPoolExecutor(max_workers=jobs) as pool:
        pending = [
            pool.submit(run_cell, project, cell, assumptions.of_chapter(cell.chapter), Quiet())
            for cell in due
        ]
        try:
            for number, future in enumerate(as_completed(pending), 1):
                run = future.result()
                working.add(run)
                runs.append(run)
                how = f"failed: {run.failed}" if run.failed else f"{run.seconds:.0f} s"
                progress.say(f"{number} of {len(due)}: chapter {run.chapter}, {run.id}: {how}")
        except BaseException:
            for future in pending:
                future.cancel()
            raise
    return [run for run in runs if run is not None]


def _second(assumptions: Assumptions, cell: Cell) -> int:
    """Return 0 for an unchanged run, 1 for a first alternative, 2 for a second; 0 comes first."""
    firsts = {f"{e.id}/{e.alternatives[0].id}" for e in assumptions.assumptions if e.alternatives}
    return 0 if cell.change is None else 1 if cell.id in firsts else 2


def _rank(cells: list[Cell], cell: Cell) -> int:
    """Return the place of a cell among those of its chapter, so that chapters take turns."""
    return [other for other in cells if other.chapter == cell.chapter].index(cell)


class Quiet(Progress):
    """Says nothing of the cells of a notebook; the study says when one is done."""

    def started(self, chapter: str, cells: int) -> None:
        """Say nothing."""

    def cell(self, chapter: str, index: int) -> None:
        """Say nothing."""

    def finished(self, chapter: str) -> None:
        """Say nothing."""


def main() -> None:
    """Run what is due and write the file."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--only", action="append", default=[], metavar="ID")
    parser.add_argument("--jobs", type=int, default=1, help="chapters at once")
    given = parser.parse_args()
    project = Project(ROOT.resolve())
    try:
        assumptions = load_assumptions(project.root)
        problems = problems_of(project, assumptions)
        if problems:
            raise InswsnError("\n".join(problems))
        made = made_from(project, assumptions)
        with Progress() as progress:
            cells = cells_of(assumptions, given.only)
            runs = run_all(project, assumptions, cells, given.jobs, progress)
        path = project.root / SENSITIVITY
        before = {(r.chapter, r.id): r for r in read_study(path).runs} if given.only else {}
        write_study(Study(made=made, runs=merged(runs, before)), path)
    except InswsnError as error:
        sys.exit(str(error))


if __name__ == "__main__":
    main()
