"""The form of the sensitivity study as it is kept: ``data/sensitivity.json``."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Annotated, Literal

from pydantic import BaseModel, ConfigDict, Field

from inswsn_book.files import write_whole
from inswsn_book.kept import read_kept
from inswsn_book.parameters import Value

#: Where the assumptions stand in a checkout.
ASSUMPTIONS = "data/assumptions.yaml"
#: Where the study of them is kept.
SENSITIVITY = "data/sensitivity.json"
#: The id of the unchanged run of a chapter
BASELINE = "baseline"


class Run(BaseModel):
    """What came of a cell.

    Attributes
    ----------
    id, chapter : str
        See `inswsn_book.sensitivity.Cell`.
    parameters : dict
        Those that differ from the published run.
    headlines : dict of str to float
        By the key of the headline; one that the run did not record, or not as a finite number, is
        left out.
    verdicts : dict of str to str
        By the id of the claim, for the claims that the chapter decides.
    overturned : int
        Sentences of the page that do not hold in this run.
    failed : str or None
        The sentence with which the run ended before its end.
    seconds : float
        How long it took.
    key : str
        Digest of all that it was made from, so that it need not be made again.
    """

    model_config = ConfigDict(frozen=True, extra="forbid")
    id: Annotated[str, Field(pattern=r"^(baseline|seed-\d+|P[123]-M-[A-Za-z0-9]+/[a-z0-9-]+)$")]
    chapter: Annotated[str, Field(pattern=r"^\d\d$")]
    parameters: dict[str, Value]
    headlines: dict[str, Annotated[float, Field(allow_inf_nan=False)]] = {}
    verdicts: dict[str, str] = {}
    overturned: Annotated[int, Field(ge=0)] = 0
    failed: str | None = None
    seconds: Annotated[float, Field(ge=0)]
    key: Annotated[str, Field(pattern=r"^[0-9a-f]{64}$")]


class Made(BaseModel):
    """What the study was made with.

    Attributes
    ----------
    version : str
        Of inswsn.
    day : str
    commit : str or None
    clean : bool or None
    sources : dict of str to str
        SHA-256 of the library, the locks, the assumptions and each chapter.
    recorded : bool
        Whether the recording of P3's chapter could be had.
    python, system, cpu : str
    packages : dict of str to str
    """

    model_config = ConfigDict(frozen=True, extra="forbid")
    version: str
    day: Annotated[str, Field(pattern=r"^\d{4}-\d\d-\d\d$")]
    commit: Annotated[str, Field(pattern=r"^[0-9a-f]{40,64}$")] | None
    clean: bool | None
    sources: dict[str, Annotated[str, Field(pattern=r"^[0-9a-f]{64}$")]]
    recorded: bool
    python: str
    system: str
    cpu: str
    packages: dict[str, str]


class Study(BaseModel):
    """What ``data/sensitivity.json`` holds.

    Attributes
    ----------
    schema_version : int
    made : Made
    runs : tuple of Run
        One for each cell.
    """

    model_config = ConfigDict(frozen=True, extra="forbid")
    schema_version: Literal[1] = 1
    made: Made
    runs: Annotated[tuple[Run, ...], Field(min_length=1)]

    def run(self, chapter: str, identity: str) -> Run | None:
        """Return the run of a chapter with that id; None if there is none."""
        for run in self.runs:
            if run.chapter == chapter and run.id == identity:
                return run
        return None

    def seeds(self, chapter: str) -> list[Run]:
        """Return the unchanged runs of a chapter: the baseline and those with other seeds."""
        return [
            run
            for run in self.runs
            if run.chapter == chapter and (run.id == BASELINE or run.id.startswith("seed-"))
        ]


def write_study(study: Study, path: Path) -> None:
    """Write a study, whole or not at all."""
    write_whole(path, study.model_dump_json(indent=1) + "\n")


def read_study(path: Path) -> Study:
    """Read and check a study.

    Raises
    ------
    InswsnError
        If there is none, or it is not of the form; the sentence says where.
    """
    return read_kept(path, Study, "studies")


def merged(runs: Iterable[Run], before: Mapping[tuple[str, str], Run]) -> tuple[Run, ...]:
    """Return runs together with earlier ones that they do not replace."""
    together = dict(before) | {(run.chapter, run.id): run for run in runs}
    return tuple(together[key] for key in sorted(together))
