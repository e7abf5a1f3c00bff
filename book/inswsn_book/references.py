"""The papers that the artefact rebuilds, as ``book/references.bib`` knows them."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from pybtex.database import Entry, parse_file
from pybtex.exceptions import PybtexError
from pybtex.richtext import Text

from inswsn_book.about import About
from inswsn_lib.errors import InswsnError

#: Where it stands in a checkout.
REFERENCES = "book/references.bib"


@dataclass(frozen=True)
class Article:
    """One paper.

    Attributes
    ----------
    name : str
        What the book calls it: P1.
    title, journal, doi : str
    year : int
    volume, number : str or None
    pages : tuple of str
        The first and the last page, or the number of the article alone.
    authors : tuple of (str, str)
        Family and given names.
    """

    name: str
    title: str
    journal: str
    doi: str
    year: int
    volume: str | None
    number: str | None
    pages: tuple[str, ...]
    authors: tuple[tuple[str, str], ...]

    @property
    def address(self) -> str:
        """Where its DOI leads."""
        return f"https://doi.org/{self.doi}"


def read_articles(root: Path, about: About) -> list[Article]:
    """Read the papers that the artefact rebuilds.

    Parameters
    ----------
    root : Path
        The checkout.
    about : About
        It names them by their keys.

    Raises
    ------
    InswsnError
        If the file cannot be read, holds no entry for a paper, or the entry lacks a field.
    """
    path = root / REFERENCES
    try:
        entries = parse_file(str(path), "bibtex").entries
    except (PybtexError, OSError, UnicodeDecodeError) as error:
        said = " ".join(str(error).split())
        raise InswsnError(f"{path} cannot be read: {said.rstrip('.')}.") from None
    articles = []
    for name, key in about.papers.items():
        if key not in entries:
            raise InswsnError(f"{path} has no entry {key}, the key of {name} in data/about.yaml.")
        try:
            articles.append(_article(name, entries[key]))
        except (KeyError, ValueError) as error:
            raise InswsnError(f"{path}: the entry {key} lacks {error.args[0]}.") from None
    return articles


def _article(name: str, entry: Entry) -> Article:
    fields = entry.fields
    if not str(fields["year"]).isdigit():
        raise ValueError("a year in digits")
    return Article(
        name=name,
        title=_plain(fields["title"]),
        journal=_plain(fields["journal"]),
        doi=fields["doi"],
        year=int(fields["year"]),
        volume=fields.get("volume"),
        number=fields.get("number"),
        pages=tuple(part for part in fields.get("pages", "").split("-") if part),
        authors=tuple(
            (
                _plain(" ".join([*person.prelast_names, *person.last_names])),
                _plain(" ".join([*person.first_names, *person.middle_names])),
            )
            for person in entry.persons["author"]
        ),
    )


def _plain(text: str) -> str:
    """Return a text without the braces and commands of LaTeX."""
    return str(Text.from_latex(text))
