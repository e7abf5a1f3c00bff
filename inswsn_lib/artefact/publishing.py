"""The reference results: how a build differs from them, and making a build the reference."""

from __future__ import annotations

from inswsn_lib.artefact.project import Project
from inswsn_lib.claims import Change, Results, compare, read_results, write_results
from inswsn_lib.errors import InswsnError


def changes_since_published(project: Project) -> dict[str, list[Change]]:
    """Return how the last build differs from the reference results.

    Returns
    -------
    dict of str to list of Change
        By chapter number; a chapter without differences has an empty list.

    Raises
    ------
    InswsnError
        If a chapter has no results from a build.
    """
    return {
        chapter.number: compare(_reference(project, chapter.number), _built(project, chapter.number))
        for chapter in project.chapters()
    }


def publish(project: Project) -> list[str]:
    """Make the results of the last build the reference; return the numbers of changed chapters.

    Raises
    ------
    InswsnError
        If a chapter has no results from a build; then nothing is written.
    OSError
        If ``data/published`` cannot be written.
    """
    built = {chapter.number: _built(project, chapter.number) for chapter in project.chapters()}
    changed = [
        number for number, results in built.items() if results != _reference(project, number)
    ]
    for number in changed:
        write_results(built[number], project.published / f"{number}.json")
    return changed


def _built(project: Project, number: str) -> Results:
    path = project.results / f"{number}.json"
    if not path.is_file():
        raise InswsnError(f"Chapter {number} has no results; build the book first: make book.")
    return read_results(path)


def _reference(project: Project, number: str) -> Results:
    path = project.published / f"{number}.json"
    if not path.is_file():
        return Results(chapter=number, parameters={}, data={}, quantities=())
    return read_results(path)
