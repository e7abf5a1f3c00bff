"""Rendering the book: executed notebooks and pages in, a checked site out, swapped in whole."""

from __future__ import annotations

import re
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from hashlib import sha256
from pathlib import Path
from typing import Any

import nbformat

from inswsn_lib.artefact.cache import Executed
from inswsn_lib.artefact.inspection import inspect_site
from inswsn_lib.artefact.notebooks import notebook_text
from inswsn_lib.artefact.progress import Progress
from inswsn_lib.artefact.project import Project
from inswsn_lib.errors import BuildError
from inswsn_lib.files import tree_digest, write_whole

_KEY_FILE = ".inswsn-key"
_WARNING = re.compile(r"\b(WARNING|ERROR|CRITICAL|SEVERE)\b")


class RenderingError(BuildError):
    """The book could not be rendered, or what was rendered does not hold together."""


def render_book(
    project: Project, chapters: Sequence[Executed], progress: Progress, *, fresh: bool = False
) -> None:
    """Render the book to ``_build/html`` unless it is up to date.

    The site is built beside the old one, inspected, and only then put in its place: a failure
    leaves the last good site as it was. Every build starts from clean doctrees, since Sphinx does
    not repeat the warnings of pages that it does not read again.

    Parameters
    ----------
    project : Project
        The checkout.
    chapters : sequence of Executed
        The executed chapters, all of them.
    progress : Progress
        Told whether it is rendered or up to date.
    fresh : bool
        Render even if nothing has changed.

    Raises
    ------
    RenderingError
        If Sphinx warns, a link inside the site leads nowhere, an image is missing, or one has no
        alternative text.
    OSError
        If a folder cannot be written.
    """
    key = _site_key(project, chapters)
    key_file = project.site / _KEY_FILE
    if not fresh and key_file.is_file() and key_file.read_text(encoding="utf-8") == key:
        progress.say("book: unchanged")
        return
    progress.say("book: rendering")
    _place_chapters(project, chapters)
    project.build.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(dir=project.build, prefix="render-") as name:
        stage = Path(name)
        _run_jupyter_book(project, stage)
        site = stage / "_build" / "html"
        problems = inspect_site(site)
        if problems:
            listing = "\n".join(f"  {problem}" for problem in problems)
            raise RenderingError(f"The rendered book does not hold together:\n{listing}")
        write_whole(site / _KEY_FILE, key)
        _swap(site, project.site, stage / "old")


def _site_key(project: Project, chapters: Sequence[Executed]) -> str:
    made = (project.root / "book" / "chapters", project.root / "book" / "generated")
    pages = [
        path
        for path in (project.root / "book").rglob("*")
        if path.is_file() and not any(folder in path.parents for folder in made)
    ]
    sources = [*pages, *project.library(), *project.locks, project.root / "_config.yml"]
    facts = [tree_digest(project.root, sources)]
    facts += [sha256(executed.notebook.read_bytes()).hexdigest() for executed in chapters]
    return sha256("\n".join(facts).encode()).hexdigest()


def _place_chapters(project: Project, chapters: Sequence[Executed]) -> None:
    folder = project.root / "book" / "chapters"
    wanted = {f"{executed.chapter.name}.ipynb" for executed in chapters}
    for path in folder.glob("*"):
        if path.name not in wanted:
            path.unlink()
    for executed in chapters:
        notebook = nbformat.read(executed.notebook, as_version=4)
        text = notebook_text(with_captions(notebook))
        write_whole(folder / f"{executed.chapter.name}.ipynb", text)


def with_captions(notebook: Any) -> Any:
    """Move each figure's name, caption and alternative text to where MyST-NB looks for them.

    `inswsn_lib.plotting.show_figure` leaves them in the metadata of the output; MyST-NB reads the
    metadata of the cell.

    Parameters
    ----------
    notebook : nbformat.NotebookNode
        An executed notebook; it is changed in place.

    Returns
    -------
    nbformat.NotebookNode
        The same notebook.

    Raises
    ------
    RenderingError
        If a cell shows more than one figure: they would share one caption.
    """
    for cell in notebook.cells:
        shown = [
            output["metadata"]["inswsn"]
            for output in cell.get("outputs", [])
            if "inswsn" in output.get("metadata", {})
        ]
        if len(shown) > 1:
            raise RenderingError(f"Cell {cell['id']} shows {len(shown)} figures; a cell shows one.")
        for figure in shown:
            cell.metadata["mystnb"] = {
                "image": {"alt": figure["alt"]},
                "figure": {"caption": figure["caption"], "name": figure["name"]},
            }
    return notebook


def _run_jupyter_book(project: Project, stage: Path) -> None:
    command = [
        *(sys.executable, "-c", "from jupyter_book.cli.main import main; main()"),
        *("build", "book", "--config", "_config.yml", "--path-output", str(stage)),
        *("--all", "-W", "-n", "--keep-going", "-q"),
    ]
    done = subprocess.run(
        command,
        cwd=project.root,
        capture_output=True,
        text=True,
        stdin=subprocess.DEVNULL,
        check=False,
    )
    said = done.stdout + done.stderr
    warnings = [line for line in said.splitlines() if _WARNING.search(line)]
    # jupyter-book's exit status alone is not to be trusted: it has been 0 after warnings
    if done.returncode != 0 or warnings:
        raise RenderingError(
            "Sphinx could not render the book without warnings:\n"
            + ("\n".join(warnings) if warnings else said.strip())
        )


def _swap(new: Path, site: Path, old: Path) -> None:
    """Put the new site in the place of the old one; put the old one back if that fails."""
    if site.exists():
        site.rename(old)
    try:
        new.rename(site)
    except OSError:
        if old.exists():
            shutil.move(old, site)
        raise
