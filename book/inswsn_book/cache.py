"""Executed chapters, kept by the content of everything they were made from."""

from __future__ import annotations

import json
import shutil
import sys
from dataclasses import dataclass
from hashlib import sha256
from pathlib import Path
from typing import Any

from inswsn_book.files import file_digest, tree_digest, write_whole
from inswsn_book.ledger import data_digest
from inswsn_book.project import Chapter, Project
from inswsn_book.results import Results, read_results, write_results
from inswsn_lib.errors import InswsnError
from inswsn_lib.files import data_mirror

# Raised when the form of the cache, or the way in which chapters are executed, changes.
_FORM = 4


@dataclass(frozen=True)
class Executed:
    """One executed chapter.

    Attributes
    ----------
    chapter : Chapter
        The chapter.
    notebook : Path
        The executed notebook, without times and paths.
    results : Results
        What it recorded.
    """

    chapter: Chapter
    notebook: Path
    results: Results


def chapter_key(project: Project, chapter: Chapter, parameters: dict[str, Any]) -> str:
    """Return the digest of what a chapter is made from, but for the data it reads.

    It covers the chapter's source, the library but for what of `artefact` does not execute
    chapters, the locks, the parameters, Python's version, and
    whether there is a local folder with recorded data, not which one or what is in it: a chapter
    executed without recorded data is due once they can be had, and the other way round. The
    project's own data files are known once the chapter has run: they stand in its results with
    their digests, and `lookup` checks them.
    """
    facts = {
        "form": _FORM,
        "chapter": chapter.name,
        "source": file_digest(chapter.source),
        "library": project.computing_digest(),
        "locks": tree_digest(project.root, project.locks),
        "parameters": parameters,
        "python": sys.version_info[:3],
        "recorded data": data_mirror() is not None,
    }
    return sha256(json.dumps(facts, sort_keys=True).encode()).hexdigest()


def lookup(project: Project, chapter: Chapter, key: str) -> Executed | None:
    """Return the executed chapter for `key` if the cache has it and its data are unchanged."""
    folder = _entry(project, chapter, key)
    try:
        results = read_results(folder / "results.json")
    except InswsnError:
        return None
    notebook, kept = folder / "executed.ipynb", folder / "executed.sha256"
    if not kept.is_file() or kept.read_bytes() != (_digest_of(notebook) or "").encode():
        return None
    for name, digest in results.data.items():
        if data_digest(project.root, name) != digest:
            return None
    return Executed(chapter, notebook, results)


def built_as_now(project: Project, chapter: Chapter) -> Executed:
    """Return the executed chapter for the present sources and the default parameters.

    It comes from the cache and not from ``results/``, where a run with other parameters may have
    written.

    Raises
    ------
    InswsnError
        If the chapter has not been built as it is now.
    """
    entry = lookup(project, chapter, chapter_key(project, chapter, {}))
    if entry is None:
        raise InswsnError(
            f"Chapter {chapter.number} has not been built as it is now; build it first: make book."
        )
    return entry


def store(
    project: Project, chapter: Chapter, key: str, notebook: str, results: Results
) -> Executed:
    """Keep an executed chapter, and drop what the cache held of it for other keys but the last.

    So who builds with recorded data and without them by turns executes nothing twice.
    """
    folder = _entry(project, chapter, key)
    write_whole(folder / "executed.ipynb", notebook)
    write_whole(folder / "executed.sha256", file_digest(folder / "executed.ipynb"))
    # the results come last: an entry without them is not an entry
    write_results(results, folder / "results.json")
    others = [other for other in folder.parent.iterdir() if other != folder]
    whole = [other for other in others if (other / "results.json").is_file()]
    last = max(whole, key=lambda other: other.stat().st_mtime_ns, default=None)
    for other in others:
        if other != last:
            shutil.rmtree(other, ignore_errors=True)
    return Executed(chapter, folder / "executed.ipynb", results)


def _digest_of(path: Path) -> str | None:
    return file_digest(path) if path.is_file() else None


def _entry(project: Project, chapter: Chapter, key: str) -> Path:
    return project.cache / chapter.name / key[:32]
