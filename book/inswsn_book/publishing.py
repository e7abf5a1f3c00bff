"""The reference results: how a build differs from them, and making a build the reference."""

from __future__ import annotations

from dataclasses import dataclass

from inswsn_book.compare import Change, compare, compare_conditions
from inswsn_book.project import Project
from inswsn_book.results import Results, write_results
from inswsn_book.runs import book_runs, reference_results


@dataclass(frozen=True)
class Difference:
    """How the build of one chapter differs from its reference results.

    Attributes
    ----------
    number : str
        The chapter's number.
    changes : list of Change
        Its quantities that differ.
    conditions : list of str
        Its parameters, data files and sentences that differ.
    """

    number: str
    changes: list[Change]
    conditions: list[str]

    @property
    def beyond_tolerance(self) -> list[str]:
        """What a fresh build may not differ in, one line each."""
        beyond = [str(change) for change in self.changes if change.beyond_tolerance]
        return [f"{self.number} {line}" for line in [*beyond, *self.conditions]]


def differences(project: Project) -> list[Difference]:
    """Return how the build of the present sources differs from the reference results.

    Raises
    ------
    InswsnError
        If a chapter has not been built as it is now.
    """
    found = []
    for run in book_runs(project):
        number, after = run.request.chapter, run.results
        before = reference_results(project, number)
        found.append(Difference(number, compare(before, after), compare_conditions(before, after)))
    return found


def orphan_references(project: Project) -> list[str]:
    """Return the names of reference results that have no chapter."""
    numbers = {chapter.number for chapter in project.chapters()}
    return sorted(p.name for p in project.published.glob("*.json") if p.stem not in numbers)


def publish(project: Project) -> list[str]:
    """Make the results of the present build the reference; return the changed chapters' numbers.

    Raises
    ------
    InswsnError
        If a chapter has not been built as it is now; then nothing is written.
    OSError
        If ``data/published`` cannot be written.
    """
    changed = [
        run.results
        for run in book_runs(project)
        if _is_newer(run.results, reference_results(project, run.request.chapter))
    ]
    for results in changed:
        write_results(results, project.published / f"{results.chapter}.json")
    return [results.chapter for results in changed]


def _is_newer(built: Results, reference: Results) -> bool:
    """Tell whether results differ, or are the same from a clean tree and the reference is not."""
    clean = [bool(r.provenance and r.provenance.clean) for r in (built, reference)]
    return built.found() != reference.found() or clean == [True, False]
