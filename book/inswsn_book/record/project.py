"""The project as folders: where the checkout is, its sources, and where what is made goes."""

from __future__ import annotations

import os
import re
from contextlib import AbstractContextManager
from dataclasses import dataclass
from pathlib import Path
from threading import Lock
from typing import Any

from filelock import FileLock, Timeout

import inswsn_lib
from inswsn_book.record.files import Memory
from inswsn_book.record.imports import Imports, code_files
from inswsn_lib.errors import InswsnError, ParameterError
from inswsn_lib.files import read_text, read_yaml

#: Set by the executor, so that a chapter finds the project from any working folder.
ROOT_VARIABLE = "INSWSN_ROOT"
#: Set by the executor: the folder that results files go to, instead of ``results/``.
RESULTS_VARIABLE = "INSWSN_RESULTS"
#: Names the folder in which a reader's own modules are looked for; by default the working folder.
MODULES_VARIABLE = "INSWSN_MODULES"

_MARKERS = ("_config.yml", "environment.lock", "chapters", "data")
# What executes chapters. What chapters import of the machinery is told by their code.
EXECUTING = tuple(
    f"inswsn_book.{name}" for name in ("run.cores", "run.kernels", "run.store", "record.notebooks")
)
_CHAPTER_NAME = re.compile(r"^(\d-|evidence/)?[a-z0-9]+(-[a-z0-9]+)*$")


def is_checkout(folder: Path) -> bool:
    """Tell whether `folder` is the root of a checkout of this project."""
    return all((folder / marker).exists() for marker in _MARKERS)


def find_root(start: Path | None = None) -> Path:
    """Return the checkout at or above a folder: what the executor set, else the working folder."""
    if start is None:
        start = Path(os.environ.get(ROOT_VARIABLE) or Path.cwd())
    start = start.resolve()
    for folder in (start, *start.parents):
        if is_checkout(folder):
            return folder
    raise InswsnError(
        f"{start} is not in a checkout of inswsn: go into one, or name it with --root."
    )


def results_folder(root: Path) -> Path:
    """Return the folder of results files: what ``INSWSN_RESULTS`` names, else ``results``."""
    return Path(os.environ.get(RESULTS_VARIABLE) or root / "results")


@dataclass(frozen=True)
class Chapter:
    """A chapter: its path below ``chapters`` without suffix, and its MyST notebook."""

    name: str
    source: Path

    @property
    def number(self) -> str:
        """The digits that the name of its file begins with: of a lesson one, of others two."""
        first = self.source.stem.partition("-")[0]
        return first if first.isdigit() else ""

    @property
    def id(self) -> str:
        """``lesson-`` and the number of a lesson; of another chapter its number or its name."""
        return f"lesson-{self.number}" if self.lesson else self.number or self.source.stem

    @property
    def lesson(self) -> bool:
        """Whether it is one of the lessons, which count from 1 in the order of reading."""
        return len(self.number) == 1 and self.name == self.source.stem

    @property
    def twin(self) -> Path:
        """The generated notebook beside the source."""
        return self.source.with_suffix(".ipynb")


class Project:
    """The folders of a checkout, and what they hold."""

    def __init__(self, root: Path) -> None:
        self.root = root
        self.build = root / "_build"  # everything that is made and not kept
        self.site = self.build / "html"  # the rendered book
        self.store = self.build / "store"  # runs of chapters
        self.live = self.build / "live-is-on"  # there while Python is put into the site
        self.results = root / "results"  # of the last build
        self.published = root / "data" / "published"  # the reference results
        self.locks = root / "environment.lock", root / "environment-torch.lock"
        # the folders of the two packages that run, which need not lie in the checkout
        self.libraries = Path(inswsn_lib.__file__).parent, Path(__file__).parents[1]
        self.memory = Memory(self.build / "memory")  # of what has been read of code
        self._imports: tuple[object, Imports] | None = None
        self.parsing = Lock()  # Python 3.11 must not make two syntax trees at the same time

    def about(self) -> dict[str, Any]:
        """Return what ``CITATION.cff`` says, and ``names`` of its authors, family names first."""
        path = self.root / "CITATION.cff"
        said = read_yaml(path)
        for field in ("title", "abstract", "version", "date-released", "authors", "license"):
            if not isinstance(said, dict) or field not in said:
                raise InswsnError(f"{path} is not a citation file: it lacks '{field}'.")
        try:
            names = [
                a.get("name") or f"{a['family-names']}, {a['given-names']}" for a in said["authors"]
            ]
        except (KeyError, TypeError, AttributeError):
            raise InswsnError(f"{path} is not a citation file: it lacks authors' names.") from None
        return {"doi": None, "repository-code": None, **said, "names": names}

    def imports(self) -> Imports:
        """Return what the modules of both packages take from one another, as they are now."""
        paths = [path for folder in self.libraries for path in code_files(folder)]
        now = [(p, p.stat().st_mtime_ns, p.stat().st_size) for p in paths]
        with self.parsing:
            if self._imports is None or self._imports[0] != now:
                self._imports = now, Imports(self.libraries, self.memory)
            return self._imports[1]

    def computing_digest(self) -> str:
        """Return the digest of all code of both packages that a chapter may compute with."""
        imports = self.imports()
        science = {name for name in imports.modules if name.startswith(self.libraries[0].name)}
        return imports.digest(science | (imports.modules & {*EXECUTING}))

    def chapters(self) -> list[Chapter]:
        """Return the chapters: the lessons, then the others as the table of contents has them."""
        folder, toc = self.root / "chapters", self.root / "book" / "_toc.yml"
        listed = re.findall(r"file: *chapters/(\S+)", read_text(toc) if toc.is_file() else "")
        sources = [*folder.glob("[!.]*.md"), *folder.glob("evidence/[!.]*.md")]
        names = {path.relative_to(folder).with_suffix("").as_posix(): path for path in sources}
        chapters = [Chapter(name, path) for name, path in names.items()]
        places = {name: place for place, name in enumerate(listed)}
        last = len(listed)
        chapters.sort(key=lambda c: (not c.lesson, places.get(c.name, last), c.name))
        if not chapters:
            raise InswsnError(f"There is no chapter in {folder}.")
        used = set[str]()
        for chapter in chapters:
            if not _CHAPTER_NAME.match(chapter.name):
                raise InswsnError(
                    f"chapters/{chapter.name}.md does not fit N-words.md, words.md or "
                    "evidence/words.md, lower case with dashes."
                )
            if chapter.id in used:
                raise InswsnError(f"The chapter name {chapter.id} is used twice.")
            used.add(chapter.id)
        return chapters

    def renamed(self) -> dict[str, dict[str, Any]]:
        """Return what `book/renamed.yaml` says of old ``chapters``, ``pages`` and ``cells``."""
        path = self.root / "book" / "renamed.yaml"
        found = read_yaml(path) if path.is_file() else {}
        return {"chapters": {}, "pages": {}, "cells": {}, **found}

    def by_id(self, identity: str) -> Chapter:
        """Return the chapter of an id."""
        known = {chapter.id: chapter for chapter in self.chapters()}
        if identity not in known:
            raise ParameterError("chapter", identity, "one of " + ", ".join(known))
        return known[identity]

    def find(self, word: str) -> Chapter:
        """Return the chapter of a name such as ``"p1-training"``, or of a number such as ``"2"``.

        A name of an earlier release is refused, with what it is now.
        """
        chapters = self.chapters()
        for chapter in chapters:
            if word and word in (chapter.name, chapter.source.stem, chapter.id, chapter.number):
                return chapter
        former = self.renamed()["chapters"]
        if now := [former[old] for old in (f"lesson-{word}", word) if old in former]:
            raise InswsnError(f"{word} is called {' or '.join(now)} now.")
        known = ", ".join(chapter.number or chapter.id for chapter in chapters)
        raise ParameterError("NAME", word, f"one of {known}")

    def build_lock(self) -> AbstractContextManager[object]:
        """Hold the lock of the checkout's build; refuse if another build holds it."""
        self.build.mkdir(parents=True, exist_ok=True)
        try:
            return FileLock(self.build / ".lock").acquire(timeout=0)
        except Timeout:
            raise InswsnError(
                f"Another build of {self.root} is running; wait for it, or stop it."
            ) from None
