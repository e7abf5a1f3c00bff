"""The results file of a chapter: its schema, and reading and writing it whole."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal, Self

from pydantic import BaseModel, ConfigDict, Field, ValidationError, model_validator

from inswsn_lib.errors import InswsnError
from inswsn_lib.files import write_whole

Name = Annotated[str, Field(pattern=r"^[a-z0-9]+([._-][a-z0-9]+)*$", max_length=80)]
Digest = Annotated[str, Field(pattern=r"^[0-9a-f]{64}$")]
Finite = Annotated[float, Field(allow_inf_nan=False)]


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
    interval_kind : {"rounding", "confidence 95 %"}, optional
        What the interval is: all values that the rounding of the printed cells allows, or a
        confidence interval over runs. Given exactly when `interval` is.
    runs : int
        Number of independent runs behind it; 1 for a computation without chance.
    basis : {"printed", "simulation", "emulation", "recorded"}
        What it was computed from.
    how : str
        How it was obtained, one sentence.
    tolerance : float
        How far a fresh build may be from the reference results, absolute, in `unit`.
    """

    name: Name
    value: Finite
    unit: Annotated[str, Field(min_length=1)]
    interval: tuple[Finite, Finite] | None = None
    interval_kind: Literal["rounding", "confidence 95 %"] | None = None
    runs: Annotated[int, Field(ge=1)] = 1
    basis: Literal["printed", "simulation", "emulation", "recorded"]
    how: Annotated[str, Field(min_length=10)]
    tolerance: Annotated[float, Field(ge=0, allow_inf_nan=False)]

    @model_validator(mode="after")
    def _interval_holds_value(self) -> Self:
        if (self.interval is None) != (self.interval_kind is None):
            raise ValueError("an interval and its kind go together")
        if self.interval is not None and not self.interval[0] <= self.value <= self.interval[1]:
            raise ValueError(f"the interval {self.interval} does not hold the value {self.value}")
        return self


class Results(_Record):
    """All that a chapter found in one run.

    Attributes
    ----------
    schema_version : int
        The version of this schema, 1.
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
    """

    schema_version: Literal[1] = 1
    chapter: Annotated[str, Field(pattern=r"^\d\d$")]
    parameters: dict[Name, bool | int | Finite | str]
    data: dict[str, Digest]
    quantities: tuple[Quantity, ...]
    sentences: dict[str, bool] = {}

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


def write_results(results: Results, path: Path) -> None:
    """Write a results file, whole or not at all.

    Parameters
    ----------
    results : Results
        What to write.
    path : Path
        Where; the folder is made if it is absent.

    Raises
    ------
    OSError
        If the folder cannot be written.
    """
    write_whole(path, results.model_dump_json(indent=1) + "\n")


def read_results(path: Path) -> Results:
    """Read and check a results file.

    Parameters
    ----------
    path : Path
        The file.

    Raises
    ------
    InswsnError
        If there is no such file, or it does not fit the schema; the sentence says where.
    """
    try:
        return Results.model_validate_json(path.read_text(encoding="utf-8"))
    except FileNotFoundError:
        raise InswsnError(f"There is no results file {path}.") from None
    except UnicodeDecodeError:
        raise InswsnError(f"{path} is not a results file: it is not UTF-8.") from None
    except ValidationError as error:
        first = error.errors()[0]
        place = ".".join(map(str, first["loc"])) or "the file"
        raise InswsnError(
            f"{path} is not a results file of this version: {place}: {first['msg']}."
        ) from None
