"""Puts Python into a site as it is rendered, while `make live` has switched that on."""

from __future__ import annotations

import shutil
from concurrent.futures import ThreadPoolExecutor
from dataclasses import asdict
from pathlib import Path

from inswsn_book.live.about import about_lesson
from inswsn_book.live.bundle import archive
from inswsn_book.live.html import SCRIPTS, policy_of, with_cells, with_policy
from inswsn_book.live.measured import Measured, measure
from inswsn_book.live.own_data import FIGURES
from inswsn_book.record.progress import Progress
from inswsn_book.record.project import Chapter, Project
from inswsn_book.run.store import Request, request_key
from inswsn_lib.errors import BuildError

#: The pages that take a reader's own file
OWN_DATA = ("which-filter", "your-own-data")


def lessons(project: Project) -> list[Chapter]:
    """Return the lessons."""
    return [chapter for chapter in project.chapters() if chapter.number and "/" not in chapter.name]


def pages(project: Project) -> list[Chapter]:
    """Return the chapters whose cells run in the page: lessons, and those that take a file."""
    return [*lessons(project), *(c for c in project.chapters() if c.name in OWN_DATA)]


def put_in(project: Project, site: Path, progress: Progress) -> None:
    """Put Python, the library and the buttons into a site that has been rendered.

    Raises
    ------
    BuildError
        If Python has not been made.
    """
    made, place = project.build / "live", site / "_static" / "live"
    if not made.is_dir():
        raise BuildError(f"There is no {made}: make wasm makes it.")
    chapters = pages(project)
    with ThreadPoolExecutor(2) as pool:
        measured = [*pool.map(lambda chapter: _measured(project, chapter), chapters)]
    project.memory.save()
    shutil.copytree(made, place)
    (place / "inswsn.zip").write_bytes(archive(project))
    megabytes = round(sum(path.stat().st_size for path in place.iterdir()) / 1e6)
    shutil.copy(project.root / "data" / "examples" / "ins-wsn.csv", place.parent)
    shutil.copytree(SCRIPTS, place.parent, dirs_exist_ok=True)
    noise = [{"name": name} | figure._asdict() for name, figure in FIGURES.items()]
    for chapter, found in zip(chapters, measured, strict=True):
        runs = sum(not cell.needs for cell in found)
        progress.say(f"{chapter.name}: {runs} of {len(found)} cells run in the page")
        path = site / "chapters" / f"{chapter.name}.html"
        if not path.is_file():
            continue
        about = about_lesson(project, chapter, found) | {"megabytes": megabytes}
        about["noise"] = noise if chapter.name == "your-own-data" else []
        page = with_cells(path.read_text(encoding="utf-8"), "../", about)
        path.write_text(with_policy(page, policy_of(page)), encoding="utf-8")


def _measured(project: Project, chapter: Chapter) -> list[Measured]:
    """Return what cells did, from an earlier build where nothing has changed that they load."""
    key = f"live {request_key(project, Request(chapter.id))}"
    known = project.memory.of(key, lambda: [asdict(m) for m in measure(project, chapter.name)])
    return [Measured(**cell) for cell in known]
