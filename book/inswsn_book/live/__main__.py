"""``python -m inswsn_book.live``: have the book rendered with Python in it, from now on."""

from __future__ import annotations

import click

from inswsn_book.cli import run_command
from inswsn_book.progress import Progress
from inswsn_book.project import Project, find_root
from inswsn_book.running import build_book


@click.command()
@click.option("--off", is_flag=True, help="Without Python again.")
def main(off: bool) -> None:
    """Switch it on for the checkout, and build the book."""
    project = Project(find_root())
    if off:
        project.live.unlink(missing_ok=True)
    else:
        project.build.mkdir(parents=True, exist_ok=True)
        project.live.touch()
    with Progress() as progress:
        build_book(project, progress)


if __name__ == "__main__":
    run_command(main)
