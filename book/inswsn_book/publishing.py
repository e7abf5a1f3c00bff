"""The reference: how a build differs from it, and making a build the reference.

It is the results in ``data/published``, and the ids of all claims that were ever published, in
``data/claim-ids.txt``: an id stays, whatever becomes of its verdict.
"""

from __future__ import annotations

from inswsn_book.compare import compare, compare_conditions
from inswsn_book.files import write_whole
from inswsn_book.ledger import LEDGER, load_claims
from inswsn_book.project import Project
from inswsn_book.results import Results, write_results
from inswsn_book.runs import book_runs, reference_results
from inswsn_lib.errors import InswsnError

#: The ids of all claims ever published, below the root of a checkout.
CLAIM_IDS = "data/claim-ids.txt"

_HEAD = """\
# The ids of all claims that have been published, one a line. None is ever removed, and none is
# given to another claim. `make publish` adds new ones; `make test` fails when the ledger lacks one.
"""


def changes(project: Project) -> list[str]:
    """Return a line for each thing that publishing changes; what a build may not change has a !."""
    lines = []
    for run in book_runs(project):
        number, after = run.request.chapter, run.results
        before = reference_results(project, number)
        for change in compare(before, after):
            lines.append(f"{'!' if change.beyond_tolerance else ' '} {number} {change}")
        lines += [f"! {number} {condition}" for condition in compare_conditions(before, after)]
    numbers = {chapter.number for chapter in project.chapters()}
    lines += [
        f"! data/published/{path.name} belongs to no chapter; remove it."
        for path in sorted(project.published.glob("*.json"))
        if path.stem not in numbers
    ]
    lost, new = compare_ids(project)
    lines += [
        f"! the claim {name} has been published, and the ledger has it no more." for name in lost
    ]
    if new:
        lines.append(f"  {len(new)} claims that have not been published, from {new[0]} on")
    return lines


def publish(project: Project) -> list[str]:
    """Make the present build the reference; return the files that were written.

    Nothing is written if a chapter has not been built as it is now, or a published id is lost.
    """
    lost, new = compare_ids(project)
    if lost:
        raise InswsnError(
            f"{LEDGER} has no claim {lost[0]}, which has been published; an id stays, and a claim "
            "that was a mistake says so."
        )
    changed = [
        run.results
        for run in book_runs(project)
        if _is_newer(run.results, reference_results(project, run.request.chapter))
    ]
    for results in changed:
        write_results(results, project.published / f"{results.chapter}.json")
    if new:
        lines = "".join(f"{name}\n" for name in sorted({*published_ids(project), *new}))
        write_whole(project.root / CLAIM_IDS, _HEAD + lines)
    return [CLAIM_IDS] * bool(new) + [f"data/published/{r.chapter}.json" for r in changed]


def _is_newer(built: Results, reference: Results) -> bool:
    """Tell whether results differ, or are the same from a clean tree and the reference is not."""
    clean = [bool(r.provenance and r.provenance.clean) for r in (built, reference)]
    return built.found() != reference.found() or clean == [True, False]


def published_ids(project: Project) -> list[str]:
    """Return the ids in ``data/claim-ids.txt``; none if there is no such file."""
    path = project.root / CLAIM_IDS
    lines = path.read_text(encoding="utf-8").splitlines() if path.is_file() else []
    return [line for line in map(str.strip, lines) if line and not line.startswith("#")]


def compare_ids(project: Project) -> tuple[list[str], list[str]]:
    """Return the published ids that the ledger lacks, and its ids that are not published."""
    published = published_ids(project)
    there = [claim.id for claim in load_claims(project.root / LEDGER)]
    return [n for n in published if n not in there], [n for n in there if n not in published]
