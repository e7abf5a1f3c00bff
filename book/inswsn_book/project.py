"""The project as folders: where the sources are and where what is made goes."""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path

import inswsn_lib
from inswsn_book.files import text_digest, tree_digest
from inswsn_lib.errors import InswsnError

# What a chapter's numbers and outputs may depend on, of the machinery: what executes chapters, and
# what they import of it
_EXECUTING = (
    *("execution.py", "notebooks.py", "worker.py"),
    *("checkout.py", "files.py", "labs.py", "ledger.py", "parameters.py", "plugins.py"),
    *("record.py", "results.py", "show.py", "verdicts.py"),
)
_CHAPTER_NAME = re.compile(r"^\d\d-[a-z0-9]+(-[a-z0-9]+)*$")


@dataclass(frozen=True)
class Chapter:
    """One chapter.

    Attributes
    ----------
    name : str
        For example ``"00-the-published-numbers"``.
    source : Path
        The MyST notebook, written by hand.
    """

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
class Project:
    """The folders of a checkout.

    Attributes
    ----------
    root : Path
        The checkout.
    """

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
    def cache(self) -> Path:
        """Executed chapters by the content of what they were made from."""
        return self.build / "cache"

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

    @property
    def libraries(self) -> tuple[Path, Path]:
        """The folders of the two packages that run, which need not lie in the checkout."""
        return Path(inswsn_lib.__file__).parent, Path(__file__).parent

    def library_digest(self) -> str:
        """Return the digest of the source files of both packages."""
        return _packages_digest([f for p in self.libraries for f in p.rglob("*.py")])

    def computing_digest(self) -> str:
        """Return the digest of the source files that a chapter may compute with.

        They are all of the science, and of the machinery what executes chapters or is imported by
        them.
        """
        science, machinery = self.libraries
        own = [
            f for f in machinery.rglob("*.py") if f.relative_to(machinery).parts[0] in _EXECUTING
        ]
        return _packages_digest([*science.rglob("*.py"), *own])

    def chapters(self) -> list[Chapter]:
        """Return the chapters in the order of their numbers.

        Raises
        ------
        InswsnError
            If there is none, a name does not fit ``NN-words``, or a number is used twice.
        """
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
        numbers = [chapter.number for chapter in chapters]
        twice = sorted({number for number in numbers if numbers.count(number) > 1})
        if twice:
            raise InswsnError(f"The chapter number {twice[0]} is used twice.")
        return chapters


def _packages_digest(files: list[Path]) -> str:
    """Return one digest of source files, which are named from the folder of their package on."""
    science, machinery = Path(inswsn_lib.__file__).parent, Path(__file__).parent
    parts = [
        tree_digest(package.parent, [f for f in files if f.is_relative_to(package)])
        for package in (science, machinery)
    ]
    return text_digest("\n".join(parts))
