"""The site of the book: what is staged is rendered by Sphinx, changed pages alone if that will do.

Sphinx's own folders are kept in ``_build/pages``, and the site is a copy that is put in its place
whole: a failure leaves the last good site as it was. Sphinx does not repeat the warnings of pages
that it does not read again, so what it keeps is used again only after a rendering without any.
"""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
from collections.abc import Sequence
from contextlib import suppress
from html import escape
from pathlib import Path

from inswsn_book.make.slim import classes_of, slim
from inswsn_book.record import files
from inswsn_book.record.imports import code_files
from inswsn_book.record.progress import Progress
from inswsn_book.record.project import ROOT_VARIABLE, Project
from inswsn_book.record.provenance import repository_state
from inswsn_book.run.store import Run
from inswsn_lib.errors import BuildError, InswsnError
from inswsn_lib.files import read_yaml

_KEY_FILE = ".inswsn-key"
#: Set for the Sphinx that renders one page of the book
ALONE = "INSWSN_ALONE"
#: What stands at the foot of a page until the page is copied: the commit is no reason to render
FOOTER = "inswsn-footer-inswsn"
# The trees of all pages live until the end. To look for what is dead among them as often as Python
# does by default takes a quarter of the time; to look seldom takes a tenth more memory. All modules
# are loaded before it is known what to render. When the command ends, however it does, its end of
# the pipe is closed, and all of this group ends as well.
_SPHINX = """
import gc, os, signal, sys, threading
from pathlib import Path
from jupyter_book.sphinx import build_sphinx
import inswsn_book.make.sphinx_ext, sphinx.builders.html, sphinx_book_theme
stage = Path(sys.stdin.readline().rstrip("\\n") or sys.exit(1))
end = lambda: os.read(0, 1) or os.killpg(0, signal.SIGKILL)
threading.Thread(target=end, daemon=True).start()
gc.set_threshold(100_000, 20, 20)
done = build_sphinx(
    stage / "source", stage / "html", doctreedir=stage / "doctrees", noconfig=True,
    path_config="_config.yml", quiet=True, confoverrides={
        "external_toc_path": str(stage / "source/_toc.yml"), "latex_individualpages": False,
    },
)
sys.stdout.flush()
os._exit(1 if done else 0)  # to take all trees apart takes seconds
"""
#: A warning as Sphinx writes it: "place: WARNING: what", or the word first
WARNING = re.compile(r"(^|: )(WARNING|ERROR|CRITICAL|SEVERE): ")
_COLOUR = re.compile(r"\x1b\[[\d;]*m")


class RenderingError(BuildError):
    """The book could not be rendered, or what was rendered does not hold together."""


def render_book(
    project: Project, runs: Sequence[Run], progress: Progress, *, fresh: bool = False
) -> None:
    """Render the book to ``_build/html`` unless it is up to date."""
    key = _site_key(project, runs)
    why = "it is asked for" if fresh else _why_due(project, key)
    if not why:
        progress.say("book: unchanged")
        return
    progress.say(f"book: rendering, since {why}")
    kept, base = project.build / "pages", _base_key(project)
    sound = kept / "sound"  # names what the kept folders were made with; gone while they change
    if fresh or not sound.is_file() or sound.read_text(encoding="utf-8") != base:
        shutil.rmtree(kept, ignore_errors=True)
    sound.unlink(missing_ok=True)
    _render(project, runs, kept)
    if _site_key(project, runs) != key:
        raise RenderingError("Something changed while the book was rendered; build it again.")
    with files.temporary_folder(project.build) as folder:
        site = _copied(project, runs, kept / "html", folder / "site")
        if project.live.exists():
            from inswsn_book.live.site import put_in  # noqa: PLC0415  # takes long

            put_in(project, site, progress)
        files.write_whole(site / _KEY_FILE, key)
        files.seal_folder(site)
        files.replace_folder(project.site, site)
    files.write_whole(sound, base)


def render_run(project: Project, run: Run, target: Path) -> None:
    """Render the page of a run, with links to the built book; without one they are plain words."""
    chapter = f"chapters/{project.by_id(run.request.chapter).name}"
    with files.temporary_folder(target.parent) as stage:
        _render(project, [run], stage, alone=chapter)
        _copied(project, [run], stage / "html", target)


def _render(
    project: Project, runs: Sequence[Run], stage: Path, *, alone: str | None = None
) -> None:
    """Render runs and pages into the folder ``html`` of a stage.

    A page that is alone may lack what it names.
    """
    source = stage / "source"
    with subprocess.Popen(
        [sys.executable, "-I", "-X", "utf8", "-c", _SPHINX],
        cwd=project.root,
        env=os.environ | {ROOT_VARIABLE: str(project.root), ALONE: "yes" if alone else ""},
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        encoding="utf-8",
        start_new_session=True,
    ) as sphinx:
        assert sphinx.stdin is not None
        assert sphinx.stdout is not None
        warnings = _staged(project, runs, source, alone)  # while it is loaded
        with suppress(BrokenPipeError):  # it says why it has ended
            os.write(sphinx.stdin.fileno(), f"{stage}\n".encode())
        said = sphinx.stdout.read()
    # without colours, and what is to be edited lies in book/
    said = _COLOUR.sub("", said).replace(str(source), "book")
    warnings += [line for line in said.splitlines() if WARNING.search(line)]
    # the exit status alone is not to be trusted: it is 0 after warnings
    if sphinx.returncode != 0 or (warnings and not alone):
        raise RenderingError(
            "Sphinx could not render the book without warnings:\n"
            + ("\n".join(warnings) if warnings else said.strip())
        )


def _staged(project: Project, runs: Sequence[Run], source: Path, alone: str | None) -> list[str]:
    from inswsn_book.make.pages import stage_book  # noqa: PLC0415  # takes long

    warnings = stage_book(project, runs, source)
    if alone is not None:
        toc = f"format: jb-book\nroot: {alone}\n"
        if (source / "bibliography.md").is_file():  # citations are resolved there
            toc += "chapters:\n- file: bibliography\n"
        files.write_whole(source / "_toc.yml", toc)
    return warnings


def _copied(project: Project, runs: Sequence[Run], html: Path, site: Path) -> Path:
    """Copy what Sphinx has written, each page with its foot, and what they use; return it.

    Notebooks to download are those that read anywhere, in the place of the staged ones.
    """
    from inswsn_book.make.pages import plain_notebooks  # noqa: PLC0415  # takes long

    foot, classes = escape(footer(project)), set[str]()

    def copy(source: str, target: str) -> str:
        if source.endswith(".html"):
            page = Path(source).read_text(encoding="utf-8").replace(FOOTER, foot)
            classes.update(classes_of(page))
            Path(target).write_text(page, encoding="utf-8", newline="\n")
            return target
        return str(shutil.copyfile(source, target))

    shutil.copytree(html, site, copy_function=copy)
    slim(site, classes)
    plain = plain_notebooks(project, runs)
    for path in site.rglob("*.ipynb"):
        path.write_text(plain[path.stem], encoding="utf-8", newline="\n")
    return site


def require_current_site(project: Project, runs: Sequence[Run]) -> None:
    """Raise `InswsnError` if there is no site, or it is not what is rendered of all this."""
    if why := _why_due(project, _site_key(project, runs)):
        raise InswsnError(f"The book in {project.site} is not up to date, since {why}: make book.")


def _why_due(project: Project, key: str) -> str:
    """Return why the site must be rendered; nothing if it need not be."""
    kept = project.site / _KEY_FILE
    if not kept.is_file() or kept.read_bytes() != key.encode():
        return "its sources have changed"
    return files.few(files.damages(project.site))


def _site_key(project: Project, runs: Sequence[Run]) -> str:
    """Return a digest of all that a site is made from; what is made of it is not looked at."""
    root = project.root
    sources = [*(root / "book").rglob("*"), *(root / "data").rglob("*")]
    sources += [chapter.source for chapter in project.chapters()]
    kept = [path for path in sources if "__pycache__" not in path.parts and path.is_file()]
    # docstrings and signatures are on the page of the library
    code = [files.tree_digest(p.parent, code_files(p)) for p in project.libraries]
    facts = [_base_key(project), files.tree_digest(root, kept), *code, footer(project)]
    if project.live.exists():
        python = [path for path in (project.build / "live").rglob("*") if path.is_file()]
        facts.append(files.tree_digest(project.build, python))
    facts += [files.text_digest(run.notebook or "") for run in runs]
    facts += [files.text_digest(run.results.model_dump_json()) for run in runs]
    return files.text_digest("\n".join(facts))


def _base_key(project: Project) -> str:
    """Return a digest of what every page is made with; where it changes, all are rendered."""
    root, machinery = project.root, project.libraries[1]
    style = [path for path in (root / "book" / "_static").rglob("*") if path.is_file()]
    named = [root / "_config.yml", root / "CITATION.cff"]
    named += [root / "book" / name for name in ("_toc.yml", "references.bib")]
    paths = [path for path in (*project.locks, *style, *named) if path.is_file()]
    code = files.tree_digest(machinery.parent, code_files(machinery))
    return files.text_digest(files.tree_digest(root, paths) + code)


def footer(project: Project) -> str:
    """Return the line at the foot of every page: what the site was built from."""
    commit, clean = repository_state(project.root)
    state = "" if clean is None or clean else " with changes that were not committed"
    source = f"commit {commit[:12]}{state}" if commit else "files that are not a git checkout"
    lock = files.file_digest(project.locks[0])
    return (
        f"Built by inswsn {project.about()['version']} from {source}, "
        f"environment.lock SHA-256 {lock[:12]}…"
    )


def check_pages(project: Project) -> None:
    """Refuse a configuration that cannot be read, and a contents list without every chapter."""
    read_yaml(project.root / "_config.yml")
    toc = project.root / "book" / "_toc.yml"
    read_yaml(toc)
    listed = set(re.findall(r"file: *chapters/(\S+)", toc.read_text(encoding="utf-8")))
    for name in sorted(listed ^ {chapter.name for chapter in project.chapters()}):
        lacks = "lists chapters/{}, and there is no such chapter"
        lacks = lacks if name in listed else "does not list chapters/{}; every chapter has a page"
        raise InswsnError(f"book/_toc.yml {lacks.format(name)}.")
