"""The sensitivity study, as ``data/sensitivity.json`` keeps it.

A run of the study is one run of one chapter: unchanged, with another seed, or with one alternative
of ``data/assumptions.yaml``. ``studies/sensitivity.py`` makes the study.
"""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any, Literal, TypeVar

from inswsn_book.record.parameters import Value
from inswsn_book.record.results import Digest, Finite, Frozen, Name, first_problem
from pydantic import Field, ValidationError

from inswsn_lib.errors import InswsnError

#: Where the study is kept.
SENSITIVITY = "data/sensitivity.json"
#: The id of the unchanged run of a chapter
BASELINE = "baseline"

_Model = TypeVar("_Model", bound=Frozen)


class Run(Frozen):
    """What came of a run."""

    id: Annotated[str, Field(pattern=r"^(baseline|seed-\d+|P[123]-M-[A-Za-z0-9]+/[a-z0-9-]+)$")]
    chapter: Name
    parameters: dict[str, Value]  # that differ from the published run
    headlines: dict[str, Finite] = {}  # by key; without those that it did not record
    verdicts: dict[str, str] = {}  # by the ids of the claims that the chapter decides
    overturned: Annotated[int, Field(ge=0)] = 0  # sentences of the page that do not hold in it
    failed: str | None = None  # the sentence with which it ended before its end
    seconds: Annotated[float, Field(ge=0)]
    key: Annotated[str, Field(pattern=r"^[0-9a-f-]{40,64}$")]  # of its request when it was made


class Made(Frozen):
    """What the study was made with."""

    version: str  # of inswsn
    day: Annotated[str, Field(pattern=r"^\d{4}-\d\d-\d\d$")]
    commit: Annotated[str, Field(pattern=r"^[0-9a-f]{40,64}$")] | None
    clean: bool | None
    sources: dict[str, Digest]  # the library, the locks, the assumptions and each chapter
    recorded: bool  # whether the recording of P3's chapter could be had
    python: str
    system: str
    cpu: str
    packages: dict[str, str]


class Study(Frozen):
    """What the file holds."""

    schema_version: Literal[1] = 1
    made: Made
    runs: Annotated[tuple[Run, ...], Field(min_length=1)]
    page: dict[str, Any] = {}  # what the book shows of them, see `effects.page_of`

    def run(self, chapter: str, identity: str) -> Run | None:
        """Return the run of a chapter with that id; None if there is none."""
        found = [run for run in self.runs if (run.chapter, run.id) == (chapter, identity)]
        return found[0] if found else None

    def seeds(self, chapter: str) -> list[Run]:
        """Return the unchanged runs of a chapter: the baseline and those with other seeds."""
        return [
            run
            for run in self.runs
            if run.chapter == chapter and (run.id == BASELINE or run.id.startswith("seed-"))
        ]


def read_study(path: Path) -> Study:
    """Read the study; refuse a file that is none."""
    return read_kept(path, Study, "studies")


def read_kept(path: Path, model: type[_Model], goal: str) -> _Model:
    """Read the file of a study, which that goal of the Makefile makes; refuse another one."""
    try:
        return model.model_validate_json(path.read_text(encoding="utf-8"))
    except FileNotFoundError:
        raise InswsnError(f"There is no {path}; make it with make {goal}.") from None
    except UnicodeDecodeError:
        raise InswsnError(f"{path} is not a study: it is not UTF-8.") from None
    except ValidationError as error:
        raise InswsnError(f"{path} is not a study: {first_problem(error)}.") from None
