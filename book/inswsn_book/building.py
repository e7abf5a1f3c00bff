"""The whole way from chapters to a site, under one lock."""

from __future__ import annotations

import shutil

import nbformat

from inswsn_book.files import restore_site
from inswsn_book.notebooks import unrepeatable_outputs
from inswsn_book.pages import check_pages, render_book
from inswsn_book.progress import Progress
from inswsn_book.project import Project
from inswsn_book.results import write_results
from inswsn_book.runs import ChapterError, Request, Run, run_all


def build_book(
    project: Project, progress: Progress, *, fresh: bool = False, jobs: int | None = None
) -> None:
    """Execute what is due and render the book; refuse a chapter that may not stand in it."""
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
    """Refuse a run in which a sentence does not hold, or an output does not belong on a page."""
    number = run.request.chapter
    untrue = [f"  {sentence}" for sentence, held in run.results.sentences.items() if not held]
    if untrue:
        raise ChapterError(
            f"Chapter {number} has sentences that its results do not bear out:\n"
            + "\n".join(untrue)
        )
    if problems := unrepeatable_outputs(nbformat.reads(run.notebook, as_version=4)):
        raise ChapterError(f"Chapter {number}: " + "\n".join(problems))
