"""What the artefact is called, whose it is and where it can be had: ``data/about.yaml``."""

from __future__ import annotations

import tomllib
from pathlib import Path

from pydantic import BaseModel, ConfigDict, Field, ValidationError, model_validator

from inswsn_lib.errors import InswsnError
from inswsn_lib.files import read_yaml

#: Where it stands in a checkout.
ABOUT = "data/about.yaml"


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
    name: str | None = Field(None, min_length=1)
    family: str | None = Field(None, min_length=1)
    given: str | None = Field(None, min_length=1)
    orcid: str | None = Field(None, pattern=r"^https://orcid\.org/\d{4}-\d{4}-\d{4}-\d{3}[\dX]$")
    affiliation: str | None = Field(None, min_length=1)

    @model_validator(mode="after")
    def _group_or_person(self) -> Author:
        person = (self.family, self.given)
        if (self.name is None) == (self.family is None) or (self.name and any(person)):
            raise ValueError("an author has either a name, or a family and a given name")
        if self.family is not None and self.given is None:
            raise ValueError("a person has a family and a given name")
        return self

    @property
    def shown(self) -> str:
        """The name as a page shows it."""
        return self.name if self.name is not None else f"{self.given} {self.family}"


class Licences(BaseModel):
    """The licences of code and of text, by their SPDX names."""

    model_config = ConfigDict(extra="forbid", frozen=True)
    code: str
    text: str


class About(BaseModel):
    """What ``data/about.yaml`` holds, and the version.

    Attributes
    ----------
    title, abstract : str
    released : str
        Day of this version, ``2026-11-22``.
    authors : tuple of Author
    keywords : tuple of str
    repository : str or None
        Address of the repository on its public host, without a slash at its end; None if unset.
    doi : str or None
        Of the archived release; None if unset.
    licences : Licences
    version : str
        From ``pyproject.toml``.
    """

    model_config = ConfigDict(extra="forbid", frozen=True)
    title: str = Field(min_length=1)
    abstract: str = Field(min_length=1)
    released: str = Field(pattern=r"^\d{4}-\d\d-\d\d$")
    authors: tuple[Author, ...] = Field(min_length=1)
    keywords: tuple[str, ...] = Field(min_length=1)
    repository: str | None = Field(pattern=r"^https://[\w.-]+/[\w.-]+/[\w.-]*[\w-]$")
    doi: str | None = Field(pattern=r"^10\.\d{4,9}/\S+$")
    licences: Licences
    version: str


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
    try:
        return About(**raw, version=_version(root))
    except ValidationError as error:
        first = error.errors()[0]
        where = ".".join(str(part) for part in first["loc"]) or "an entry"
        raise InswsnError(
            f"{path}: {where} is {first['input']!r}: {first['msg'][:1].lower()}{first['msg'][1:]}."
        ) from None


def _version(root: Path) -> str:
    path = root / "pyproject.toml"
    try:
        return str(tomllib.loads(path.read_text(encoding="utf-8"))["project"]["version"])
    except (OSError, tomllib.TOMLDecodeError, KeyError):
        raise InswsnError(f"{path} names no version.") from None
