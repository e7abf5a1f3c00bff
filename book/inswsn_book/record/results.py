"""The results file of a chapter: its schema, and reading and writing it whole."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated, Any, Literal, Self

from pydantic import BaseModel, ConfigDict, Field, ValidationError, model_validator

from inswsn_book.record.files import read_listed, text_digest, write_whole
from inswsn_lib.errors import InswsnError

Name = Annotated[str, Field(pattern=r"^[a-z0-9]+([._-][a-z0-9]+)*$", max_length=80)]
Digest = Annotated[str, Field(pattern=r"^[0-9a-f]{64}$")]
Finite = Annotated[float, Field(allow_inf_nan=False)]

IntervalKind = Literal["rounding", "confidence 95 %", "runs 95 %"]

#: The version of the results file that is written
SCHEMA_VERSION: Literal[5] = 5


class Frozen(BaseModel):
    """A model that may not be changed and has no fields but its own."""

    model_config = ConfigDict(frozen=True, extra="forbid")


class Quantity(Frozen):
    """One number that a chapter found.

    Its interval is all values that the rounding of the printed cells allows, a confidence interval
    of the value, or the interval that holds 95 % of the runs. What was given (``input``) or fitted
    (``calibrated``) never counts as reproduced.
    """

    name: Name
    value: Finite
    unit: Annotated[str, Field(min_length=1)]  # "1" for a pure number
    interval: tuple[Finite, Finite] | None = None
    interval_kind: IntervalKind | None = None
    runs: Annotated[int, Field(ge=1)] = 1  # independent ones; 1 for a computation without chance
    # what it was computed from; algebra: an identity or inequality, with no experiment built again
    basis: Literal["printed", "algebra", "simulation", "emulation", "recorded"]
    role: Literal["found", "input", "calibrated"] = "found"
    how: Annotated[str, Field(min_length=10)]  # it was obtained, one sentence
    # how far a fresh build may be from the reference results, absolute, in `unit`, or as a share of
    # the reference's value, whichever is more
    tolerance: Annotated[float, Field(ge=0, allow_inf_nan=False)]
    share: Annotated[float, Field(ge=0, le=1)] = 0.0

    @model_validator(mode="after")
    def _interval_holds_value(self) -> Self:
        if (self.interval is None) != (self.interval_kind is None):
            raise ValueError("an interval and its kind go together")
        if self.interval is not None and not self.interval[0] <= self.value <= self.interval[1]:
            raise ValueError(f"the interval {self.interval} does not hold the value {self.value}")
        return self

    @property
    def slack(self) -> float:
        """How far a fresh build may be from this value, in its unit."""
        return max(self.tolerance, self.share * abs(self.value))


class Provenance(Frozen):
    """What a run was made with; it differs from machine to machine and is never compared."""

    version: str  # of inswsn
    # the commit that was checked out, and whether the tree was that; None outside a git checkout
    commit: Annotated[str, Field(pattern=r"^[0-9a-f]{40,64}$")] | None
    clean: bool | None
    sources: dict[str, Digest]  # the chapter, the library and the locks
    finished: str  # UTC
    seconds: Annotated[float, Field(ge=0)]  # that the run took
    python: str
    system: str
    cpu: str
    cores: Annotated[int, Field(ge=1)]  # that the run could use
    blas: tuple[str, ...]  # the linear algebra libraries, with versions and threads
    packages: dict[str, str]  # that compute, with their versions
    # studies of recordings by their files in data/: computed in this run, or taken as they are kept
    studies: dict[str, bool] = {}
    only: str | None = None  # the part of the chapter that was run; None for all of it
    functions: dict[str, float] = {}  # those that took most of its seconds


class Results(Frozen):
    """All that a chapter found in one run.

    Files of older versions are read as well: 1 had no solvers, cells and provenance, 2 no tables, 3
    no tolerances that are shares, 4 no words.
    """

    schema_version: Literal[5] = SCHEMA_VERSION
    chapter: Name
    parameters: dict[Name, bool | int | Finite | str | list[Any]]  # its own and its scene's
    data: dict[str, Digest]  # the files that it read, as `inswsn_book.judge.ledger.data_digest`
    quantities: tuple[Quantity, ...]  # in the order in which they were recorded
    sentences: dict[str, bool] = {}  # of the page that rest on results, and whether they hold
    solvers: dict[str, str] = {}  # that it called, with the status that they ended with
    cells: dict[Name, str] = {}  # that recorded each quantity
    tables: dict[str, list[list[str]]] = {}  # as they are shown, by label; the header comes first
    # texts that are glued to the prose, by name, and captions, by label
    words: dict[str, str] = {}
    provenance: Provenance | None = None

    @model_validator(mode="after")
    def _names_are_unique(self) -> Self:
        names = [quantity.name for quantity in self.quantities]
        if twice := sorted({name for name in names if names.count(name) > 1}):
            raise ValueError(f"recorded twice: {', '.join(twice)}")
        return self

    def __getitem__(self, name: str) -> Quantity:
        """Return the quantity of that name; ``KeyError`` if there is none."""
        for quantity in self.quantities:
            if quantity.name == name:
                return quantity
        raise KeyError(name)

    def found(self) -> Self:
        """Return it without its provenance: what a run on another machine finds as well."""
        return self.model_copy(update={"provenance": None})


def first_problem(error: ValidationError, whole: str = "the file", content: Any = None) -> str:
    """Return what does not fit first, and where: an entry of `content` is named by its id."""
    first = error.errors()[0]
    place = [str(part) for part in first["loc"]]
    entries = content.get(place[0]) if isinstance(content, dict) and place else None
    if isinstance(entries, list) and len(place) > 1:
        entry = entries[int(place[1])]
        name = entry.get("id") if isinstance(entry, dict) else None
        place[:2] = [str(name or f"{place[0]} number {place[1]}")]
    return f"{': '.join(place) or whole}: {first['msg'].removeprefix('Value error, ')}"


def quantity_digest(quantity: Quantity) -> str:
    """Return the SHA-256 of all that a results file says of one quantity."""
    return text_digest(quantity.model_dump_json())


def results_text(results: Results) -> str:
    """Return the text of a results file."""
    return results.model_dump_json(indent=1) + "\n"


def write_results(results: Results, path: Path) -> None:
    """Write a results file, whole or not at all."""
    write_whole(path, results_text(results))


def read_results(path: Path) -> Results:
    """Read a results file; refuse one that is not there or does not fit, and say where."""
    if not path.exists():
        raise InswsnError(f"There is no results file {path}.")
    text = read_listed(path)
    try:
        content = json.loads(text)
        if isinstance(content, dict) and content.get("schema_version") in (1, 2, 3, 4):
            content["schema_version"] = SCHEMA_VERSION
        return Results.model_validate(content)
    except ValidationError as error:
        said = first_problem(error)
    except (ValueError, RecursionError) as error:  # no UTF-8, no JSON, or absurd in size
        said = str(error).splitlines()[0][:200]
    raise InswsnError(f"{path} is not a results file of this version: {said}.")
