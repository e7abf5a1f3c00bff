"""The whole way from chapters to a site, under one lock."""

from __future__ import annotations

import shutil
from collections.abc import Iterator
from contextlib import contextmanager

from filelock import FileLock, Timeout

from inswsn_book.execution import execute_chapters
from inswsn_book.progress import Progress
from inswsn_book.project import Project
from inswsn_book.rendering import check_pages, render_book, restore_site
from inswsn_book.results import write_results
from inswsn_lib.errors import InswsnError


def build_book(
    project: Project, progress: Progress, *, fresh: bool = False, jobs: int | None = None
) -> None:
    """Execute what is due and render the book.

    Parameters
    ----------
    project : Project
        The checkout.
    progress : Progress
        Told how it goes.
    fresh : bool
        Ignore the cache and the last site.
    jobs : int, optional
        How many chapters at once. Default: one a core.

    Raises
    ------
    ChapterError
        If a chapter fails.
    RenderingError
        If the rendered book is not in order.
    InswsnError
        If a source cannot be read, or another build of this checkout is running.
    OSError
        If a folder cannot be written.
    """
    chapters = project.chapters()
    with alone(project):
        _clear_leftovers(project)
        check_pages(project, chapters)  # before the chapters, which take long
        executed = execute_chapters(project, chapters, progress, fresh=fresh, jobs=jobs)
        render_book(project, executed, progress, fresh=fresh)
        for entry in executed:
            write_results(entry.results, project.results / f"{entry.chapter.number}.json")


def _clear_leftovers(project: Project) -> None:
    """Clear away what a build that was killed has left, and put back the site it was swapping."""
    restore_site(project.site)
    for folder in project.build.glob("render-*"):
        shutil.rmtree(folder)


@contextmanager
def alone(project: Project) -> Iterator[None]:
    """Hold the lock of a checkout's build, so that what is read does not change.

    Parameters
    ----------
    project : Project
        The checkout.

    Raises
    ------
    InswsnError
        If another build of this checkout is running.
    """
    project.build.mkdir(parents=True, exist_ok=True)
    lock = FileLock(project.build / ".lock")
    try:
        lock.acquire(timeout=0)
    except Timeout:
        raise InswsnError(
            f"Another build of {project.root} is running; wait for it, or stop it."
        ) from None
    try:
        yield
    finally:
        lock.release()
