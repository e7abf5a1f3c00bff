"""Rendering the book: executed notebooks and pages in, a checked site out, swapped in whole."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Sequence
from hashlib import sha256
from pathlib import Path
from typing import Any

import nbformat

from inswsn_book.files import swap_folder, text_digest, tree_digest, write_whole
from inswsn_book.generated import generated_texts
from inswsn_book.inspection import inspect_site
from inswsn_book.launch_links import LAUNCH_VARIABLE, launch_setting
from inswsn_book.ledger import LEDGER, Claim, claims_of, load_claims
from inswsn_book.notebooks import notebook_text
from inswsn_book.pages import with_links_and_provenance
from inswsn_book.progress import Progress
from inswsn_book.project import Chapter, Project
from inswsn_book.results import Results, read_results, write_results
from inswsn_book.runs import Run
from inswsn_book.site_footer import FOOTER_VARIABLE, footer_text
from inswsn_lib.errors import BuildError, InswsnError
from inswsn_lib.files import read_yaml

_KEY_FILE = ".inswsn-key"
# The trees of all pages live until the end. To look for what is dead among them as often as Python
# does by default takes a quarter of the time; to look seldom takes a tenth more memory.
_JUPYTER_BOOK = (
    "import gc; gc.set_threshold(100_000, 20, 20); from jupyter_book.cli.main import main; main()"
)
# as Sphinx writes them: "place: WARNING: what", or the word first
_WARNING = re.compile(r"(^|: )(WARNING|ERROR|CRITICAL|SEVERE): ")


class RenderingError(BuildError):
    """The book could not be rendered, or what was rendered does not hold together."""


def render_book(
    project: Project, runs: Sequence[Run], progress: Progress, *, fresh: bool = False
) -> None:
    """Render the book to ``_build/html`` unless it is up to date.

    The site is built beside the old one, inspected, and only then put in its place: a failure
    leaves the last good site as it was. Every build starts from clean doctrees, since Sphinx does
    not repeat the warnings of pages that it does not read again.

    Parameters
    ----------
    project : Project
        The checkout.
    runs : sequence of Run
        Those of all chapters.
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
    key = _site_key(project, runs)
    if not fresh and _kept_key(project) == key:
        progress.say("book: unchanged")
        return
    progress.say("book: rendering")
    _place(project, runs)
    project.build.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(dir=project.build, prefix="render-") as name:
        stage = Path(name)
        site = _run_jupyter_book(project, project.root / "book", stage)
        if _site_key(project, runs) != key:
            raise RenderingError("Something changed while the book was rendered; build it again.")
        write_whole(site / _KEY_FILE, key)
        swap_folder(site, project.site)


def require_current_site(project: Project, runs: Sequence[Run]) -> None:
    """Raise `InswsnError` if there is no site, or it was rendered from something else.

    Parameters
    ----------
    project : Project
        The checkout.
    runs : sequence of Run
        Those of all chapters.
    """
    if not (project.site / "index.html").is_file():
        raise InswsnError(f"There is no built book in {project.site}; build it first: make book.")
    if _kept_key(project) != _site_key(project, runs):
        raise InswsnError(
            f"The built book in {project.site} is not up to date; build it again: make book."
        )


def _kept_key(project: Project) -> str | None:
    path = project.site / _KEY_FILE
    return path.read_text(encoding="utf-8") if path.is_file() else None


def render_run(project: Project, run: Run, target: Path) -> None:
    """Render the book with another run of one chapter in it.

    Parameters
    ----------
    project : Project
        The checkout, with a built book: its other chapters stand beside the run.
    run : Run
        Of one chapter.
    target : Path
        Where the site goes, in a folder that is there; nothing is there yet.

    Raises
    ------
    RenderingError
        If Sphinx warns or the site does not hold together.
    InswsnError
        If the book has not been built.
    """
    require_built(project)
    with tempfile.TemporaryDirectory(dir=target.parent, prefix="render-") as name:
        stage = Path(name)
        source = stage / "book"
        shutil.copytree(project.root / "book", source)
        claims = load_claims(project.root / LEDGER)
        chapter, results = project.find(run.request.chapter), run.results
        text = _page_text(nbformat.reads(run.notebook, as_version=4), results, claims)
        write_whole(source / "chapters" / f"{chapter.name}.ipynb", text)
        others = [read_results(path) for path in sorted((source / "generated").glob("*.json"))]
        shown = [results if other.chapter == results.chapter else other for other in others]
        _place_results(project, source, shown)
        _run_jupyter_book(project, source, stage).rename(target)


def require_built(project: Project) -> None:
    """Raise `InswsnError` if a chapter has no place in the book yet."""
    placed = project.root / "book" / "chapters"
    for chapter in project.chapters():
        results = project.root / "book" / "generated" / f"{chapter.number}.json"
        if not (placed / f"{chapter.name}.ipynb").is_file() or not results.is_file():
            raise InswsnError(
                f"Chapter {chapter.name} has not been built; build the book first: make book."
            )


def _site_key(project: Project, runs: Sequence[Run]) -> str:
    book = project.root / "book"
    made = {book / "chapters", book / "generated"}
    pages = [path for path in book.rglob("*") if path.is_file() and not made & set(path.parents)]
    sources = [*pages, *project.locks, project.root / "_config.yml", project.root / LEDGER]
    made_texts = generated_texts(project, [run.results for run in runs])
    facts = [tree_digest(project.root, sources), project.library_digest(), footer_text(project)]
    facts += [text_digest(run.notebook or "") for run in runs]
    facts += [f"{name} {text_digest(text)}" for name, text in sorted(made_texts.items())]
    return sha256("\n".join(facts).encode()).hexdigest()


def _place(project: Project, runs: Sequence[Run]) -> None:
    """Put the executed chapters, their results and the page of claims into the book."""
    claims = load_claims(project.root / LEDGER)
    book = project.root / "book"
    texts = {
        book / "chapters" / f"{project.find(run.request.chapter).name}.ipynb": _page_text(
            nbformat.reads(run.notebook, as_version=4), run.results, claims
        )
        for run in runs
    }
    _clear(book / "chapters", keep=set(texts))
    for path, text in texts.items():
        write_whole(path, text)
    _place_results(project, book, [run.results for run in runs])


def _clear(folder: Path, keep: set[Path]) -> None:
    for path in folder.glob("*"):
        if path.is_dir():
            shutil.rmtree(path)
        elif path not in keep:
            path.unlink()


def _page_text(notebook: Any, results: Results, claims: Sequence[Claim]) -> str:
    decided = claims_of(claims, results.chapter)
    return notebook_text(with_links_and_provenance(with_captions(notebook), results, decided))


def _place_results(project: Project, book: Path, results: Sequence[Results]) -> None:
    """Write the texts that pages include, and the results files that they rest on."""
    made = book / "generated"
    texts = {made / name: text for name, text in generated_texts(project, results).items()}
    files = {made / f"{result.chapter}.json": result for result in results}
    _clear(made, keep={*files, *texts})
    for path, text in texts.items():
        write_whole(path, text)
    for path, result in files.items():
        write_results(result, path)


def with_captions(notebook: Any) -> Any:
    """Move each figure's name, caption and alternative text to where MyST-NB looks for them.

    `inswsn_book.show.show_figure` leaves them in the metadata of the output; MyST-NB reads the
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


def _run_jupyter_book(project: Project, source: Path, stage: Path) -> Path:
    """Render and inspect a book; return the folder of the site."""
    command = [
        *(sys.executable, "-c", _JUPYTER_BOOK),
        *("build", str(source), "--config", "_config.yml", "--path-output", str(stage)),
        *("--all", "-W", "-n", "--keep-going", "-q"),
    ]
    done = subprocess.run(
        command,
        cwd=project.root,
        env=os.environ
        | {FOOTER_VARIABLE: footer_text(project), LAUNCH_VARIABLE: launch_setting(project)},
        capture_output=True,
        text=True,
        stdin=subprocess.DEVNULL,
        check=False,
    )
    said = done.stdout + done.stderr
    warnings = warnings_in(said)
    # jupyter-book's exit status alone is not to be trusted: it has been 0 after warnings
    if done.returncode != 0 or warnings:
        raise RenderingError(
            "Sphinx could not render the book without warnings:\n"
            + ("\n".join(warnings) if warnings else said.strip())
        )
    site = stage / "_build" / "html"
    problems = inspect_site(site)
    if problems:
        listing = "\n".join(f"  {problem}" for problem in problems)
        raise RenderingError(f"The rendered book does not hold together:\n{listing}")
    return site


def warnings_in(said: str) -> list[str]:
    """Return the lines of Sphinx's output that are warnings or errors."""
    return [line for line in said.splitlines() if _WARNING.search(line)]


def check_pages(project: Project, chapters: Sequence[Chapter]) -> None:
    """Refuse a configuration that cannot be read, and a contents list without every chapter.

    Parameters
    ----------
    project : Project
        The checkout.
    chapters : sequence of Chapter
        Its chapters.

    Raises
    ------
    InswsnError
        If `_config.yml` or `book/_toc.yml` cannot be read, or chapters and contents list differ.
    """
    read_yaml(project.root / "_config.yml")
    toc = read_yaml(project.root / "book" / "_toc.yml")
    listed = {
        name.removeprefix("chapters/") for name in _files(toc) if name.startswith("chapters/")
    }
    there = {chapter.name for chapter in chapters}
    for name in sorted(listed - there):
        raise InswsnError(f"book/_toc.yml lists chapters/{name}, and there is no such chapter.")
    for name in sorted(there - listed):
        raise InswsnError(f"book/_toc.yml does not list chapters/{name}; every chapter has a page.")


def _files(node: Any) -> Iterator[str]:
    """Return every name of a file in a contents list."""
    if isinstance(node, dict):
        for key, value in node.items():
            if key in ("file", "root") and isinstance(value, str):
                yield value
            else:
                yield from _files(value)
    elif isinstance(node, list):
        for value in node:
            yield from _files(value)
