"""Judge the simulated claims of P1 and P2 again where errors of fixes last: `make studies`.

    python studies/lasting.py
    python studies/lasting.py --unread

Runs the chapters that simulate P1 and P2 as they are published but for `correlation_time`, and
keeps the quantities that decide their simulated claims in data/reruns, from which the readings of
data/readings.yaml judge them. It takes about ten minutes of one core. With --unread nothing is
run: the simulated claims of all papers are listed that no reading judges anew, and it fails if one
of P1 or P2 has no verdict for one of the times.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterable
from pathlib import Path

from inswsn_book.judge.claims import judge_claims
from inswsn_book.judge.ledger import LEDGER, QuantityCheck, claims_of, load_claims
from inswsn_book.judge.review import RERUNS
from inswsn_book.judge.verdicts import Judged
from inswsn_book.record.progress import Quiet
from inswsn_book.record.project import Project
from inswsn_book.record.results import Results, write_results
from inswsn_book.run.store import Request, Run, run_all

from inswsn_lib.errors import InswsnError

ROOT = Path(__file__).parent.parent
#: The chapters with simulated fixes
CHAPTERS = ("p1-training", "p1-outages", "p2-fusion")
#: Correlation times of the errors of fixes, s: the third is that of the fixes recorded in a room
TIMES = (1.0, 2.0, 3.2)


def prefix(time: float) -> str:
    """Return what stands before the quantities of the run with that correlation time."""
    return f"lasting-{time:g}s"


def simulated(judged: Iterable[Judged]) -> list[Judged]:
    """Return the claims that a simulation decides, without what was put in or fitted."""
    return [
        entry
        for entry in judged
        if entry.quantity and (entry.quantity.basis, entry.quantity.role) == ("simulation", "found")
    ]


def unread(judged: Iterable[Judged]) -> list[str]:
    """Return the simulated claims that no reading judges anew."""
    return [entry.claim.id for entry in simulated(judged) if not entry.readings]


def without_lasting(judged: Iterable[Judged]) -> list[str]:
    """Return the claims of `CHAPTERS` that are simulated and not judged for each of `TIMES`."""
    return [
        entry.claim.id
        for entry in simulated(judged)
        if entry.claim.chapter in CHAPTERS
        and not all(
            any(read.name.endswith(f"last {time:g} s") for read in entry.readings) for time in TIMES
        )
    ]


def kept(project: Project, runs: Iterable[Run]) -> Results:
    """Return what is kept of the runs of one chapter."""
    found = [run.results for run in runs]
    claims = claims_of(load_claims(project.root / LEDGER), found[0].chapter)
    names = {c.check.quantity for c in claims if isinstance(c.check, QuantityCheck)}
    quantities = [
        quantity.model_copy(update={"name": f"{prefix(time)}.{quantity.name}"})
        for time, results in zip(TIMES, found, strict=True)
        for quantity in results.quantities
        if quantity.name in names and (quantity.basis, quantity.role) == ("simulation", "found")
    ]
    return Results(
        chapter=found[0].chapter,
        parameters={"correlation_time": list(TIMES)},
        data={},
        quantities=tuple(quantities),
        provenance=found[-1].provenance,
    )


def main() -> None:
    """Run what is due and write the files, or list what is unread."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--unread", action="store_true", help="list claims without a reading")
    parser.add_argument("--jobs", type=int, default=1, help="chapters at once")
    given, project = parser.parse_args(), Project(ROOT.resolve())
    try:
        if given.unread:
            judged = judge_claims(project)
            print(*unread(judged), sep="\n")
            if missing := without_lasting(judged):
                raise InswsnError(f"Not judged where errors of fixes last: {', '.join(missing)}.")
            return
        requests = [Request(c, {"correlation_time": t}) for c in CHAPTERS for t in TIMES]
        with Quiet() as progress:
            runs = run_all(project, requests, progress, jobs=given.jobs)
        for chapter in CHAPTERS:
            own = kept(project, [run for run in runs if run.request.chapter == chapter])
            write_results(own, project.root / RERUNS / f"{chapter}.json")
    except InswsnError as error:
        sys.exit(str(error))


if __name__ == "__main__":
    main()
