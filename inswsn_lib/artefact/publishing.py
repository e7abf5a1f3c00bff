"""The reference results: how a build differs from them, and making a build the reference."""

from __future__ import annotations

from inswsn_lib.artefact.cache import chapter_key, lookup
from inswsn_lib.artefact.project import Chapter, Project
from inswsn_lib.claims import Change, Results, compare, read_results, write_results
from inswsn_lib.errors import InswsnError


def changes_since_published(project: Project) -> dict[str, list[Change]]:
    """Return how the build of the present sources differs from the reference results.

    Returns
    -------
    dict of str to list of Change
        By chapter number; a chapter without differences has an empty list.

    Raises
    ------
    InswsnError
        If a chapter has not been built as it is now.
    """
    return {
        chapter.number: compare(_reference(project, chapter), _built(project, chapter))
        for chapter in project.chapters()
    }


def publish(project: Project) -> list[str]:
    """Make the results of the present build the reference; return the changed chapters' numbers.

    Raises
    ------
    InswsnError
        If a chapter has not been built as it is now; then nothing is written.
    OSError
        If ``data/published`` cannot be written.
    """
    built = [(chapter, _built(project, chapter)) for chapter in project.chapters()]
    changed = [
        (chapter, results) for chapter, results in built if results != _reference(project, chapter)
    ]
    for chapter, results in changed:
        write_results(results, project.published / f"{chapter.number}.json")
    return [chapter.number for chapter, _ in changed]


def _built(project: Project, chapter: Chapter) -> Results:
    # from the cache and not from results/, where a run with other parameters may have written
    entry = lookup(project, chapter, chapter_key(project, chapter, {}))
    if entry is None:
        raise InswsnError(
            f"Chapter {chapter.number} has not been built as it is now; build it first: make book."
        )
    return entry.results


def _reference(project: Project, chapter: Chapter) -> Results:
    path = project.published / f"{chapter.number}.json"
    if not path.is_file():
        return Results(chapter=chapter.number, parameters={}, data={}, quantities=())
    return read_results(path)
