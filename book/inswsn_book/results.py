"""The results file of a chapter: its schema, and reading and writing it whole."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated, Any, Literal, Self

from pydantic import BaseModel, ConfigDict, Field, ValidationError, model_validator

from inswsn_book.files import text_digest, write_whole
from inswsn_lib.errors import InswsnError

Name = Annotated[str, Field(pattern=r"^[a-z0-9]+([._-][a-z0-9]+)*$", max_length=80)]
Digest = Annotated[str, Field(pattern=r"^[0-9a-f]{64}$")]
Finite = Annotated[float, Field(allow_inf_nan=False)]

IntervalKind = Literal["rounding", "confidence 95 %", "runs 95 %"]

#: The version of the results file that is written
SCHEMA_VERSION: Literal[2] = 2


class _Record(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid")


class Quantity(_Record):
    """One number that a chapter found.

    Attributes
    ----------
    name : str
        Lower-case words joined by dots, dashes or underscores; unique in the chapter.
    value : float
        The number.
    unit : str
        Its unit; ``"1"`` for a pure number.
    interval : tuple of two floats, optional
        Its interval, which holds the value.
    interval_kind : {"rounding", "confidence 95 %", "runs 95 %"}, optional
        What the interval is: all values that the rounding of the printed cells allows, a confidence
        interval of the value, or the interval that holds 95 % of the runs. Given exactly when
        `interval` is.
    runs : int
        Number of independent runs behind it; 1 for a computation without chance.
    basis : {"printed", "simulation", "emulation", "recorded"}
        What it was computed from.
    role : {"found", "input", "calibrated"}
        Whether the chapter found it, was given it, or fitted something to it. What was given or
        fitted never counts as reproduced.
    how : str
        How it was obtained, one sentence.
    tolerance : float
        How far a fresh build may be from the reference results, absolute, in `unit`.
    """

    name: Name
    value: Finite
    unit: Annotated[str, Field(min_length=1)]
    interval: tuple[Finite, Finite] | None = None
    interval_kind: IntervalKind | None = None
    runs: Annotated[int, Field(ge=1)] = 1
    basis: Literal["printed", "simulation", "emulation", "recorded"]
    role: Literal["found", "input", "calibrated"] = "found"
    how: Annotated[str, Field(min_length=10)]
    tolerance: Annotated[float, Field(ge=0, allow_inf_nan=False)]

    @model_validator(mode="after")
    def _interval_holds_value(self) -> Self:
        if (self.interval is None) != (self.interval_kind is None):
            raise ValueError("an interval and its kind go together")
        if self.interval is not None and not self.interval[0] <= self.value <= self.interval[1]:
            raise ValueError(f"the interval {self.interval} does not hold the value {self.value}")
        return self


class Provenance(_Record):
    """What a run was made with; it differs from machine to machine and is never compared.

    Attributes
    ----------
    version : str
        The version of inswsn.
    commit : str, optional
        The commit that was checked out; None outside a git checkout.
    clean : bool, optional
        Whether the work tree was that commit, without changes.
    sources : dict of str to str
        SHA-256 of the chapter's source, of the library and of the locks: they name what was run
        even where the tree was not clean.
    finished : str
        When the run ended, UTC.
    seconds : float
        How long it took.
    python, system, cpu : str
        The interpreter, the operating system and the processor.
    cores : int
        Cores that the run could use.
    blas : tuple of str
        The linear algebra libraries, each with its version and number of threads.
    packages : dict of str to str
        The versions of the packages that compute.
    """

    version: str
    commit: Annotated[str, Field(pattern=r"^[0-9a-f]{40,64}$")] | None
    clean: bool | None
    sources: dict[str, Digest]
    finished: str
    seconds: Annotated[float, Field(ge=0)]
    python: str
    system: str
    cpu: str
    cores: Annotated[int, Field(ge=1)]
    blas: tuple[str, ...]
    packages: dict[str, str]


class Results(_Record):
    """All that a chapter found in one run.

    Attributes
    ----------
    schema_version : int
        The version of this schema, 2. Files of version 1, which had no solvers, cells and
        provenance, are read as well.
    chapter : str
        The chapter's number, two digits.
    parameters : dict
        The parameters of the run.
    data : dict of str to str
        The files below ``data/`` that it read, with their SHA-256.
    quantities : tuple of Quantity
        In the order in which the chapter recorded them.
    sentences : dict of str to bool
        Sentences of the page that rest on results, and whether they hold in this run. In the
        published run all of them do, or the build fails.
    solvers : dict of str to str
        The solvers that the chapter called, with the status that they ended with.
    cells : dict of str to str
        The cell that recorded each quantity.
    provenance : Provenance, optional
        What the run was made with.
    """

    schema_version: Literal[2] = SCHEMA_VERSION
    chapter: Annotated[str, Field(pattern=r"^\d\d$")]
    parameters: dict[Name, bool | int | Finite | str]
    data: dict[str, Digest]
    quantities: tuple[Quantity, ...]
    sentences: dict[str, bool] = {}
    solvers: dict[str, str] = {}
    cells: dict[Name, str] = {}
    provenance: Provenance | None = None

    @model_validator(mode="before")
    @classmethod
    def _older_version_is_raised(cls, content: Any) -> Any:
        if isinstance(content, dict) and content.get("schema_version") == 1:
            return content | {"schema_version": SCHEMA_VERSION}
        return content

    @model_validator(mode="after")
    def _names_are_unique(self) -> Self:
        names = [quantity.name for quantity in self.quantities]
        twice = sorted({name for name in names if names.count(name) > 1})
        if twice:
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


def quantity_digest(quantity: Quantity) -> str:
    """Return the SHA-256 of all that a results file says of one quantity."""
    return text_digest(quantity.model_dump_json())


def write_results(results: Results, path: Path) -> None:
    """Write a results file, whole or not at all.

    Raises
    ------
    OSError
        If the folder cannot be written.
    """
    write_whole(path, results.model_dump_json(indent=1) + "\n")


def read_results(path: Path) -> Results:
    """Read and check a results file.

    Raises
    ------
    InswsnError
        If there is no such file, or it does not fit the schema; the sentence says where.
    """
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
        version = content.get("schema_version") if isinstance(content, dict) else None
        if isinstance(version, int) and version > SCHEMA_VERSION:
            raise InswsnError(
                f"{path} was written by a newer inswsn: its schema_version is {version}, and this "
                f"one reads up to {SCHEMA_VERSION}."
            )
        return Results.model_validate(content)
    except FileNotFoundError:
        raise InswsnError(f"There is no results file {path}.") from None
    except UnicodeDecodeError:
        raise InswsnError(f"{path} is not a results file: it is not UTF-8.") from None
    except json.JSONDecodeError as error:
        raise InswsnError(
            f"{path} is not a results file: it is not JSON, line {error.lineno}."
        ) from None
    except RecursionError:
        raise InswsnError(f"{path} is not a results file: it is nested too deeply.") from None
    except ValidationError as error:
        first = error.errors()[0]
        place = ".".join(map(str, first["loc"])) or "the file"
        raise InswsnError(
            f"{path} is not a results file of this version: {place}: {first['msg']}."
        ) from None
    except InswsnError:
        raise
    except ValueError as error:  # a number of thousands of digits
        raise InswsnError(f"{path} is not a results file: {str(error)[:200]}.") from None
