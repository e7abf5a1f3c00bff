"""The whole way from chapters to a site, under one lock."""

from __future__ import annotations

import shutil

import nbformat

from inswsn_book.execution import ChapterError
from inswsn_book.files import restore_site
from inswsn_book.notebooks import unrepeatable_outputs
from inswsn_book.pages import check_pages, render_book
from inswsn_book.progress import Progress
from inswsn_book.project import Project
from inswsn_book.results import write_results
from inswsn_book.runs import Request, Run, run_all


def build_book(
    project: Project, progress: Progress, *, fresh: bool = False, jobs: int | None = None
) -> None:
    """Execute what is due and render the book.

    Raises
    ------
    ChapterError
        If a chapter fails, or may not stand in the book as it is.
    RenderingError
        If the rendered book is not in order.
    InswsnError
        If a source cannot be read, or another build of this checkout is running.
    OSError
        If a folder cannot be written.
    """
    chapters = project.chapters()
    with project.build_lock():
        # what a build that was killed has left, and the site that it was swapping
        restore_site(project.site)
        for folder in project.build.glob("render-*"):
            shutil.rmtree(folder)
        check_pages(project, chapters)  # before the chapters, which take long
        requests = [Request(chapter.number) for chapter in chapters]
        runs = run_all(project, requests, progress, fresh=fresh, jobs=jobs, check=check_page)
        render_book(project, runs, progress, fresh=fresh)
        for run in runs:
            write_results(run.results, project.results / f"{run.request.chapter}.json")


def check_page(run: Run) -> None:
    """Refuse a run that may not stand in the book.

    Raises
    ------
    ChapterError
        If a sentence does not hold in it, or an output does not belong on a page.
    """
    assert run.notebook is not None
    untrue = [sentence for sentence, held in run.results.sentences.items() if not held]
    if untrue:
        listing = "\n".join(f"  {sentence}" for sentence in untrue)
        raise ChapterError(
            f"Chapter {run.request.chapter} has sentences that its results do not bear out:\n"
            + listing
        )
    problems = unrepeatable_outputs(nbformat.reads(run.notebook, as_version=4))
    if problems:
        raise ChapterError(f"Chapter {run.request.chapter}: " + "\n".join(problems))
