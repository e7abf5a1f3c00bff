"""What belongs to others: ``data/third-party.yaml``, and what is made from it."""

from __future__ import annotations

from importlib.metadata import PackageNotFoundError, distribution
from pathlib import Path
from typing import Annotated

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from inswsn_book.about import Spdx
from inswsn_book.references import Article
from inswsn_book.results import Digest
from inswsn_lib.errors import InswsnError
from inswsn_lib.files import read_yaml

#: Where it stands in a checkout.
THIRD_PARTY = "data/third-party.yaml"


class _Entry(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True)


class Recording(_Entry):
    """Recorded data that chapters or studies read and that are never kept here.

    Attributes
    ----------
    name, address, holder : str
        What it is called, where it is published, and whose it is.
    licence : str or None
        Its SPDX name; None if none is stated.
    stated : str
        Where that is stated, and of what.
    what : str
        What was recorded.
    chapters : tuple of str
        The chapters that read it, two digits each.
    results : tuple of str
        The kept files that were computed from it.
    files : dict of str to str
        Its files with their SHA-256.
    """

    name: str
    address: Annotated[str, Field(pattern=r"^https://\S+$")]
    holder: str
    licence: Spdx | None
    stated: str
    what: str
    chapters: tuple[Annotated[str, Field(pattern=r"^\d\d$")], ...]
    results: tuple[str, ...]
    files: Annotated[dict[str, Digest], Field(min_length=1)]


class SitePart(_Entry):
    """A program of which the built site holds parts.

    Attributes
    ----------
    package : str
        The Python package that brings it.
    licence : str
        Its SPDX name.
    files : tuple of str
        Files and folders below ``_static`` that it brings.
    parts : str or None
        What in them comes from others again.
    text : str or None
        Another package that ships the text of the same licence, if this one ships none.
    """

    package: str
    licence: Spdx
    files: Annotated[tuple[str, ...], Field(min_length=1)]
    parts: str | None = None
    text: str | None = None


class ThirdParty(_Entry):
    """All of it.

    Attributes
    ----------
    papers : dict of str to str
        On what terms each paper is published, by its short name.
    recorded : tuple of Recording
    site : tuple of SitePart
    """

    papers: dict[str, str]
    recorded: tuple[Recording, ...]
    site: tuple[SitePart, ...]


def load_third_party(root: Path) -> ThirdParty:
    """Read ``data/third-party.yaml``.

    Parameters
    ----------
    root : Path
        The checkout.

    Raises
    ------
    InswsnError
        If it is missing or not of the form; the sentence names the first field that is not.
    """
    path = root / THIRD_PARTY
    try:
        return ThirdParty.model_validate(read_yaml(path))
    except ValidationError as error:
        first = error.errors()[0]
        where = ".".join(str(part) for part in first["loc"]) or "the file"
        raise InswsnError(f"{path}: {where}: {first['msg']}.") from None


def licence_texts(third_party: ThirdParty) -> dict[str, str]:
    """Return the texts of the licences of what the built site holds, by names for their files.

    Raises
    ------
    InswsnError
        If a package is not installed, or ships no text of its licence.
    """
    texts: dict[str, str] = {}
    for part in third_party.site:
        found = _licence_files(part.text or part.package, part.licence if part.text else "")
        if not found:
            raise InswsnError(f"The package {part.package} ships no text of its licence.")
        texts |= {f"{part.package}/{name}": text for name, text in found.items()}
    return texts


def _licence_files(package: str, licence: str) -> dict[str, str]:
    """Return the licence files of a package; of one licence only, if it is named."""
    try:
        files = distribution(package).files or []
    except PackageNotFoundError:
        raise InswsnError(f"The package {package} is not installed.") from None
    word = licence.partition("-")[0].upper()
    return {
        file.name: file.read_text(encoding="utf-8")
        for file in files
        if "LICENSE" in file.name.upper() and word in file.name.upper()
    }


def third_party_text(third_party: ThirdParty, articles: list[Article]) -> str:
    """Return THIRD-PARTY.md: what belongs to others, and on what terms it is here.

    Parameters
    ----------
    third_party : ThirdParty
    articles : list of Article
        The papers.
    """
    return "\n".join(
        [
            "# What belongs to others",
            "",
            "Made from data/third-party.yaml by `make citation`; edit that file.",
            "",
            "## The papers",
            "",
            "Their numbers are here as facts (`data/papers`), their claims in our words "
            "(`data/claims.yaml`), and a few words are quoted with their place. No passage and no "
            "figure of theirs is here. They belong to their authors and publishers.",
            "",
            *(_article_line(article, third_party) for article in articles),
            "",
            "## Recorded data",
            "",
            "None is here or in the archive. A build fetches them, or reads them where "
            "`INSWSN_DATA` says, and they stay under the terms of those who own them. The results "
            "computed from them are ours; this says what they were computed from.",
            "",
            *map(_recording_line, third_party.recorded),
            "",
            "## In the built site",
            "",
            "The programs that render the book put style sheets, scripts, fonts and icons of "
            "theirs below `_static`. The archive holds the texts of these licences in `licences`.",
            "",
            "| package | licence that it states | files below `_static` | what comes from others |",
            "|---|---|---|---|",
            *map(_part_row, third_party.site),
            "",
        ]
    )


def _article_line(article: Article, third_party: ThirdParty) -> str:
    names = ", ".join(f"{given} {family}" for family, given in article.authors)
    terms = third_party.papers.get(article.name, "its terms are not known here")
    return (
        f"- **{article.name}** {names} ({article.year}), *{article.title}*, {article.journal}, "
        f"doi {article.doi}; {terms}."
    )


def _recording_line(recording: Recording) -> str:
    results = ", ".join(f"`{name}`" for name in recording.results)
    licence = recording.licence or "no licence"
    readers = ["a study", *(f"chapter {number}" for number in recording.chapters)]
    return (
        f"- **{recording.name}**: {recording.what}. By {recording.holder}, <{recording.address}>. "
        f"Stated: {licence}, in {recording.stated}. Read by {' and '.join(readers)}; computed "
        f"from it: {results}."
    )


def _part_row(part: SitePart) -> str:
    files = ", ".join(f"`{name}`" for name in part.files)
    return f"| {part.package} | {part.licence} | {files} | {part.parts or '–'} |"
