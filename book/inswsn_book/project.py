"""The project as folders: where the checkout is, its sources, and where what is made goes."""

from __future__ import annotations

import os
import re
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any

from filelock import FileLock, Timeout

import inswsn_lib
from inswsn_book.files import text_digest, tree_digest
from inswsn_lib.errors import InswsnError, ParameterError
from inswsn_lib.files import read_yaml

#: Set by the executor, so that a chapter finds the project from any working folder.
ROOT_VARIABLE = "INSWSN_ROOT"
#: Set by the executor: the folder that results files go to, instead of ``results/``.
RESULTS_VARIABLE = "INSWSN_RESULTS"
#: Names the folder in which a reader's own modules are looked for; by default the working folder.
MODULES_VARIABLE = "INSWSN_MODULES"

_MARKERS = ("_config.yml", "environment.lock", "chapters", "data")
# What a chapter's numbers and outputs may depend on, of the machinery: what executes chapters, and
# what they import of it
_EXECUTING = (
    *("cores.py", "execution.py", "notebooks.py", "runs.py"),
    *("project.py", "files.py", "labs.py", "ledger.py", "parameters.py"),
    *("record.py", "results.py", "show.py", "verdicts.py"),
)
_CHAPTER_NAME = re.compile(r"^\d\d-[a-z0-9]+(-[a-z0-9]+)*$")


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
    """One chapter: its name, such as ``00-the-published-numbers``, and its MyST notebook."""

    name: str
    source: Path

    @property
    def number(self) -> str:
        """The two digits that the name begins with."""
        return self.name[:2]

    @property
    def twin(self) -> Path:
        """The generated notebook beside the source."""
        return self.source.with_suffix(".ipynb")


@dataclass(frozen=True)
class About:
    """What ``CITATION.cff`` says of this work."""

    title: str
    abstract: str
    version: str
    released: str  # the day of this version
    authors: tuple[str, ...]  # as a list of references has them, family name first
    keywords: tuple[str, ...]
    licence: str  # of the code, by its SPDX name
    repository: str | None  # its address on the public host
    doi: str | None  # of the archived release
    references: tuple[dict[str, Any], ...]  # the papers that it rebuilds

    @property
    def shown_authors(self) -> str:
        """The authors in one line: ``"A, B and C"``."""
        *others, last = self.authors
        return f"{', '.join(others)} and {last}" if others else last


@dataclass(frozen=True)
class Project:
    """The folders of a checkout, and what they hold."""

    root: Path

    @property
    def build(self) -> Path:
        """Everything that is made and not kept."""
        return self.root / "_build"

    @property
    def site(self) -> Path:
        """The rendered book."""
        return self.build / "html"

    @property
    def store(self) -> Path:
        """Runs of chapters by the content of what they were made from."""
        return self.build / "store"

    @property
    def results(self) -> Path:
        """The results files of the last build."""
        return self.root / "results"

    @property
    def published(self) -> Path:
        """The reference results."""
        return self.root / "data" / "published"

    @property
    def locks(self) -> tuple[Path, Path]:
        """The two files that pin the environment."""
        return self.root / "environment.lock", self.root / "environment-torch.lock"

    def about(self) -> About:
        """Read ``CITATION.cff``; refuse one that lacks a field."""
        path = self.root / "CITATION.cff"
        said = read_yaml(path)
        try:
            return About(
                title=said["title"],
                abstract=said["abstract"],
                version=said["version"],
                released=said["date-released"],
                authors=tuple(map(_listed, said["authors"])),
                keywords=tuple(said["keywords"]),
                licence=said["license"],
                repository=said.get("repository-code"),
                doi=said.get("doi"),
                references=tuple(said.get("references", ())),
            )
        except (KeyError, TypeError) as error:
            raise InswsnError(f"{path} is no citation file: it lacks {error}.") from None

    @property
    def libraries(self) -> tuple[Path, Path]:
        """The folders of the two packages that run, which need not lie in the checkout."""
        return Path(inswsn_lib.__file__).parent, Path(__file__).parent

    def library_digest(self) -> str:
        """Return the digest of the source files of both packages."""
        return self._digest([f for p in self.libraries for f in p.rglob("*.py")])

    def computing_digest(self) -> str:
        """Return the digest of what a chapter may compute with.

        That is all of the science, and of the machinery what executes chapters or is imported by
        them.
        """
        science, machinery = self.libraries
        own = [machinery / name for name in _EXECUTING if (machinery / name).is_file()]
        return self._digest([*science.rglob("*.py"), *own])

    def _digest(self, files: list[Path]) -> str:
        """Return one digest of source files, named from the folder of their package on."""
        parts = [
            tree_digest(package.parent, [f for f in files if f.is_relative_to(package)])
            for package in self.libraries
        ]
        return text_digest("\n".join(parts))

    def chapters(self) -> list[Chapter]:
        """Return the chapters in the order of their numbers, which are used once each."""
        chapters = [
            Chapter(path.stem, path) for path in sorted((self.root / "chapters").glob("[!.]*.md"))
        ]
        if not chapters:
            raise InswsnError(f"There is no chapter in {self.root / 'chapters'}.")
        for chapter in chapters:
            if not _CHAPTER_NAME.match(chapter.name):
                raise InswsnError(
                    f"chapters/{chapter.name}.md does not fit NN-words.md, lower case with dashes."
                )
        for first, second in pairwise(chapters):
            if first.number == second.number:
                raise InswsnError(f"The chapter number {first.number} is used twice.")
        return chapters

    def find(self, word: str) -> Chapter:
        """Return the chapter of a number such as ``"02"`` or ``"2"``, or of a whole name."""
        chapters = self.chapters()
        for chapter in chapters:
            if word in (chapter.number, str(int(chapter.number)), chapter.name):
                return chapter
        raise ParameterError(
            "NAME", word, "one of " + ", ".join(chapter.number for chapter in chapters)
        )

    @contextmanager
    def build_lock(self) -> Iterator[None]:
        """Hold the lock of the checkout's build; refuse if another build holds it."""
        self.build.mkdir(parents=True, exist_ok=True)
        lock = FileLock(self.build / ".lock")
        try:
            lock.acquire(timeout=0)
        except Timeout:
            raise InswsnError(
                f"Another build of {self.root} is running; wait for it, or stop it."
            ) from None
        try:
            yield
        finally:
            lock.release()


def _listed(author: dict[str, str]) -> str:
    """Return an author as a list of references has them: a group by its name."""
    return author.get("name") or f"{author['family-names']}, {author['given-names']}"
