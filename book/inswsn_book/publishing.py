"""The reference: how a build differs from it, and making a build the reference.

It is the results in ``data/published``, and the ids of all claims that were ever published, in
``data/claim-ids.txt``: an id stays, whatever becomes of its verdict.
"""

from __future__ import annotations

from dataclasses import dataclass

from inswsn_book.compare import Change, compare, compare_conditions
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


@dataclass(frozen=True)
class Difference:
    """How the build of one chapter differs from its reference: in quantities, and otherwise."""

    number: str
    changes: list[Change]
    conditions: list[str]

    @property
    def beyond_tolerance(self) -> list[str]:
        """What a fresh build may not differ in, one line each."""
        beyond = [str(change) for change in self.changes if change.beyond_tolerance]
        return [f"{self.number} {line}" for line in [*beyond, *self.conditions]]


def differences(project: Project) -> list[Difference]:
    """Return how the build of the present sources differs; refuse one that is not current."""
    found = []
    for run in book_runs(project):
        number, after = run.request.chapter, run.results
        before = reference_results(project, number)
        found.append(Difference(number, compare(before, after), compare_conditions(before, after)))
    return found


def changes(project: Project) -> list[str]:
    """Return a line for each thing that publishing changes; what a build may not change has a !."""
    lines = []
    for difference in differences(project):
        for change in difference.changes:
            mark = "!" if change.beyond_tolerance else " "
            lines.append(f"{mark} {difference.number} {change}")
        lines += [f"! {difference.number} {condition}" for condition in difference.conditions]
    numbers = {chapter.number for chapter in project.chapters()}
    lines += [
        f"! data/published/{path.name} belongs to no chapter; remove it."
        for path in sorted(project.published.glob("*.json"))
        if path.stem not in numbers
    ]
    lines += [
        f"! the claim {name} has been published, and the ledger has it no more."
        for name in lost_ids(project)
    ]
    if added := new_ids(project):
        lines.append(f"  {len(added)} claims that have not been published, from {added[0]} on")
    return lines


def publish(project: Project) -> list[str]:
    """Make the present build the reference; return the files that were written.

    Nothing is written if a chapter has not been built as it is now, or a published id is lost.
    """
    require_ids_kept(project)
    changed = [
        run.results
        for run in book_runs(project)
        if _is_newer(run.results, reference_results(project, run.request.chapter))
    ]
    written = []
    if added := new_ids(project):
        lines = "".join(f"{name}\n" for name in sorted({*published_ids(project), *added}))
        write_whole(project.root / CLAIM_IDS, _HEAD + lines)
        written.append(CLAIM_IDS)
    for results in changed:
        write_results(results, project.published / f"{results.chapter}.json")
        written.append(f"data/published/{results.chapter}.json")
    return written


def _is_newer(built: Results, reference: Results) -> bool:
    """Tell whether results differ, or are the same from a clean tree and the reference is not."""
    clean = [bool(r.provenance and r.provenance.clean) for r in (built, reference)]
    return built.found() != reference.found() or clean == [True, False]


def published_ids(project: Project) -> list[str]:
    """Return the ids in ``data/claim-ids.txt``; none if there is no such file."""
    path = project.root / CLAIM_IDS
    lines = path.read_text(encoding="utf-8").splitlines() if path.is_file() else []
    return [line for line in map(str.strip, lines) if line and not line.startswith("#")]


def lost_ids(project: Project) -> list[str]:
    """Return the published ids that the ledger no longer has."""
    there = {claim.id for claim in load_claims(project.root / LEDGER)}
    return [name for name in published_ids(project) if name not in there]


def new_ids(project: Project) -> list[str]:
    """Return the ids of the ledger that have not been published."""
    known = set(published_ids(project))
    return [claim.id for claim in load_claims(project.root / LEDGER) if claim.id not in known]


def require_ids_kept(project: Project) -> None:
    """Refuse a ledger that lacks a published id."""
    if lost := lost_ids(project):
        raise InswsnError(
            f"{LEDGER} has no claim {lost[0]}, which has been published; an id stays, and a claim "
            "that was a mistake says so."
        )
