"""How much each headline result moves when an assumption changes, by reruns: `make studies`.

    python studies/sensitivity.py [--only P1-M-B] [--jobs 2]

Runs the chapters again with one assumption of data/assumptions.yaml changed, everything else as
published but for fewer runs, and keeps what comes of it in data/sensitivity.json, from which the
book's page of assumptions is made. The unchanged chapters are run with the same settings and with
other seeds, which tells what is chance. It takes about an hour and a half of one core. It may be
stopped at any time: what has finished is in the store of runs and is not run again.

With --only the alternatives of one assumption are run and take their place in the file, whose
provenance then tells of the last run alone: good for a look, and the whole for keeps.
"""

from __future__ import annotations

import argparse
import datetime
import sys
from pathlib import Path

from inswsn_book.files import file_digest, tree_digest
from inswsn_book.progress import Quiet
from inswsn_book.project import Project
from inswsn_book.provenance import machine_facts, repository_state
from inswsn_book.review import ASSUMPTIONS, Assumptions, load_assumptions, problems_of
from inswsn_book.runs import Outcome, run_each
from inswsn_book.study import (
    SENSITIVITY,
    Made,
    Run,
    Study,
    cells_of,
    merged,
    read_study,
    request_of,
    run_of,
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
        version=project.about().version,  # that of the checkout
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


def run_study(
    project: Project, assumptions: Assumptions, only: list[str], jobs: int | None
) -> list[Run]:
    """Run the cells of the study and return what came of them."""
    cells = cells_of(assumptions, only)
    runs: list[Run] = []
    with Quiet() as progress:

        def ended(place: int, outcome: Outcome) -> None:
            cell = cells[place]
            run = run_of(project, cell, assumptions.of_chapter(cell.chapter), outcome)
            runs.append(run)
            how = f"failed: {run.failed}" if run.failed else f"{run.seconds:.0f} s"
            progress.say(f"{len(runs)} of {len(cells)}: chapter {run.chapter}, {run.id}: {how}")

        requests = [request_of(project, cell) for cell in cells]
        run_each(project, requests, progress, ended, jobs=jobs)
    return runs


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
        runs = run_study(project, assumptions, given.only, given.jobs)
        path = project.root / SENSITIVITY
        before = {(r.chapter, r.id): r for r in read_study(path).runs} if given.only else {}
        write_study(Study(made=made, runs=merged(runs, before)), path)
    except InswsnError as error:
        sys.exit(str(error))


if __name__ == "__main__":
    main()
