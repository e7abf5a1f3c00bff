"""Puts Python into the built site: what `make live` does once the files of Python are there."""

from __future__ import annotations

import shutil
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import click

from inswsn_book.cli import run_command
from inswsn_book.live.about import about_lesson
from inswsn_book.live.bundle import archive
from inswsn_book.live.html import SCRIPTS, policy_of, with_cells, with_policy
from inswsn_book.live.measured import measure
from inswsn_book.live.own_data import FIGURES
from inswsn_book.project import Chapter, Project, find_root
from inswsn_lib.errors import BuildError

#: The page that takes a reader's own file; its cells are those of the library with all packages
OWN_DATA = "90-your-own-data"


def lessons(project: Project) -> list[Chapter]:
    """Return the lessons."""
    return [chapter for chapter in project.chapters() if chapter.name.startswith("0")]


def put_in(project: Project, site: Path) -> None:
    """Put Python, the library and the buttons into a built site.

    Raises
    ------
    BuildError
        If there is no built site, or Python has not been made.
    """
    made, place = project.build / "live", site / "_static" / "live"
    for folder, how in ((site, "make book"), (made, "make wasm")):
        if not folder.is_dir():
            raise BuildError(f"There is no {folder}: {how} makes it.")
    chapters = lessons(project)
    with ThreadPoolExecutor(2) as pool:
        measured = [*pool.map(lambda chapter: measure(project, chapter.name), chapters)]
    shutil.rmtree(place, ignore_errors=True)
    shutil.copytree(made, place)
    (place / "inswsn.zip").write_bytes(archive(project))
    megabytes = round(sum(path.stat().st_size for path in place.iterdir()) / 1e6)
    shutil.copy(project.root / "data" / "examples" / "ins-wsn.csv", place.parent)
    shutil.copytree(SCRIPTS, place.parent, dirs_exist_ok=True)
    noise = [{"name": name} | figure._asdict() for name, figure in FIGURES.items()]
    told = {OWN_DATA: {"files": True, "cells": [], "parameters": [], "noise": noise}}
    for chapter, found in zip(chapters, measured, strict=True):
        told[chapter.name] = about_lesson(chapter, found)
        runs = sum(not cell.needs for cell in found)
        click.echo(f"{chapter.name}: {runs} of {len(found)} cells run in the page")
    for name, about in told.items():
        path = site / "chapters" / f"{name}.html"
        about["megabytes"] = megabytes
        page = with_cells(path.read_text(encoding="utf-8"), "../", about)
        path.write_text(with_policy(page, policy_of(page)), encoding="utf-8")


@click.command()
def main() -> None:
    """Do it for the checkout."""
    project = Project(find_root())
    with project.build_lock():
        put_in(project, project.site)


if __name__ == "__main__":
    run_command(main)
