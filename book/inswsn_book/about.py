"""What the artefact is called, whose it is and where it can be had: ``data/about.yaml``."""

from __future__ import annotations

import tomllib
from datetime import date
from pathlib import Path
from typing import Annotated, Any

from packaging.licenses import InvalidLicenseExpression, canonicalize_license_expression
from pydantic import (
    AfterValidator,
    BaseModel,
    ConfigDict,
    Field,
    ValidationError,
    model_validator,
)

from inswsn_lib.errors import InswsnError
from inswsn_lib.files import read_yaml

#: Where it stands in a checkout.
ABOUT = "data/about.yaml"

_SHOWN = 60  # characters of a value that a sentence repeats


def _day(text: str) -> str:
    date.fromisoformat(text)  # its ValueError says what is wrong with the day
    return text


def _spdx(text: str) -> str:
    try:
        known = canonicalize_license_expression(text)
    except InvalidLicenseExpression:
        raise ValueError("it may be the SPDX name of a licence, such as CC-BY-4.0") from None
    if known != text:
        raise ValueError(f"it may be written {known}, as SPDX does")
    if " " in text or text.startswith("LicenseRef-"):
        raise ValueError("it may be the SPDX name of one licence, such as CC-BY-4.0")
    return text


# What one of CITATION.cff, BibTeX and HTML would take for something else.
_FORBIDDEN = frozenset("{}\\$^~")


def _line(text: str) -> str:
    if not text or text != text.strip() or not text.isprintable() or _FORBIDDEN & set(text):
        raise ValueError("it may be one line without spaces at its ends and without { } \\ $ ^ ~")
    return text


def _address(text: str | None) -> str | None:
    if text is not None and (text.endswith(".git") or text.startswith("https://www.")):
        raise ValueError("it may be written without www. and without .git")
    return text


def _once(several: tuple[Any, ...]) -> tuple[Any, ...]:
    if len(set(several)) < len(several):
        raise ValueError("it may name each one once")
    return several


Words = Annotated[str, AfterValidator(_line)]
Spdx = Annotated[str, AfterValidator(_spdx)]


class Author(BaseModel):
    """One author: a group by its name, or a person by family and given name.

    Attributes
    ----------
    name : str or None
        Of a group.
    family, given : str or None
        Of a person.
    orcid : str or None
        The address, ``https://orcid.org/0000-0002-1825-0097``.
    affiliation : str or None
        Of a person.
    """

    model_config = ConfigDict(extra="forbid", frozen=True)
    name: Words | None = None
    family: Words | None = None
    given: Words | None = None
    orcid: str | None = Field(None, pattern=r"^https://orcid\.org/\d{4}-\d{4}-\d{4}-\d{3}[\dX]$")
    affiliation: Words | None = None

    @model_validator(mode="after")
    def _group_or_person(self) -> Author:
        person = (self.family, self.given)
        if (self.name is None) == (self.family is None) or (self.name and any(person)):
            raise ValueError("an author has either a name, or a family and a given name")
        if self.family is not None and self.given is None:
            raise ValueError("a person has a family and a given name")
        if self.name is not None and (self.orcid or self.affiliation):
            raise ValueError("a group has no orcid and no affiliation")
        return self

    @property
    def shown(self) -> str:
        """The name as a page shows it."""
        return self.name if self.name is not None else f"{self.given} {self.family}"

    @property
    def listed(self) -> str:
        """The name as a list of references has it, family name first."""
        return self.name if self.name is not None else f"{self.family}, {self.given}"


class Licences(BaseModel):
    """The licences of code and of text, by their SPDX names."""

    model_config = ConfigDict(extra="forbid", frozen=True)
    code: Spdx
    text: Spdx


class About(BaseModel):
    """What ``data/about.yaml`` holds, and the version.

    Attributes
    ----------
    title, abstract : str
    released : str
        Day of this version, ``2026-11-22``.
    authors : tuple of Author
    keywords : tuple of str
    papers : dict of str to str
        The key of each paper in ``book/references.bib``, by its short name such as P1.
    repository : str or None
        Address of the repository on its public host, without a slash at its end; None if unset.
    doi : str or None
        Of the archived release; None if unset.
    licences : Licences
    version : str
        From ``pyproject.toml``.
    """

    model_config = ConfigDict(extra="forbid", frozen=True)
    title: Words
    abstract: Words
    released: Annotated[str, Field(pattern=r"^\d{4}-\d\d-\d\d$"), AfterValidator(_day)]
    authors: Annotated[tuple[Author, ...], Field(min_length=1), AfterValidator(_once)]
    keywords: Annotated[tuple[Words, ...], Field(min_length=1), AfterValidator(_once)]
    papers: Annotated[dict[Annotated[str, Field(pattern=r"^P\d$")], Words], Field(min_length=1)]
    repository: Annotated[
        str | None,
        Field(pattern=r"^https://[a-z0-9.-]+/[\w.-]+/[\w.-]*[\w-]$"),
        AfterValidator(_address),
    ]
    doi: str | None = Field(pattern=r"^10\.\d{4,9}/[\w.;()/:-]+$")
    licences: Licences
    version: str

    @property
    def shown_authors(self) -> str:
        """The authors in one line: ``"A, B and C"``."""
        names = [author.shown for author in self.authors]
        return " and ".join([", ".join(names[:-1]), names[-1]] if len(names) > 1 else names)

    @property
    def year(self) -> str:
        """The year of the release."""
        return self.released[:4]


def load_about(root: Path) -> About:
    """Read ``data/about.yaml``, and the version from ``pyproject.toml``.

    Parameters
    ----------
    root : Path
        The checkout.

    Raises
    ------
    InswsnError
        If a file is missing or is not of the form; the sentence names the first field that is not.
    """
    path = root / ABOUT
    raw = read_yaml(path)
    if not isinstance(raw, dict):
        raise InswsnError(f"{path} is not a mapping of settings.")
    if "version" in raw:
        raise InswsnError(f"{path} has a version; the version stands in pyproject.toml alone.")
    try:
        return About.model_validate({**raw, "version": _version(root)})
    except ValidationError as error:
        raise InswsnError(f"{path}: {_sentence(error.errors()[0])}") from None


def _sentence(problem: Any) -> str:
    """Return what is wrong with the first field that is."""
    where = ".".join(str(part) for part in problem["loc"]) or "an entry"
    if problem["type"] == "missing":
        return f"{where} is missing."
    said = problem["msg"].removeprefix("Value error, ")
    value = repr(problem["input"])
    value = value if len(value) <= _SHOWN else f"{value[:_SHOWN]}…"
    return f"{where} is {value}: {said[:1].lower()}{said[1:]}."


def _version(root: Path) -> str:
    path = root / "pyproject.toml"
    try:
        return str(tomllib.loads(path.read_text(encoding="utf-8"))["project"]["version"])
    except (OSError, ValueError, KeyError, TypeError):
        raise InswsnError(f"{path} names no version.") from None
