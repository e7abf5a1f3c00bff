"""``python -m inswsn_book.make.live``: have the book rendered with Python in it, from now on."""

from __future__ import annotations

import click

from inswsn_book.live.measured import measure
from inswsn_book.live.site import pages
from inswsn_book.make.chapters import build_book
from inswsn_book.make.cli import run_command
from inswsn_book.record.progress import Progress
from inswsn_book.record.project import Project, find_root


@click.command()
@click.option("--off", is_flag=True, help="Without Python again.")
@click.option("--count", is_flag=True, help="Say how many cells of each page run, and build none.")
def main(off: bool, count: bool) -> None:
    """Switch it on for the checkout, and build the book."""
    project = Project(find_root())
    if count:
        for chapter in pages(project):
            needs = [cell.needs for cell in measure(project, chapter.name)]
            print(f"{chapter.name}: {needs.count('')} of {len(needs)}")
        return
    if off:
        project.live.unlink(missing_ok=True)
    else:
        project.build.mkdir(parents=True, exist_ok=True)
        project.live.touch()
    with Progress() as progress:
        build_book(project, progress)


if __name__ == "__main__":
    run_command(main)
