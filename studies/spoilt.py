"""Spoil recordings, and keep what is refused, found, or passed with what harm: `make spoilt`.

Each recording is written as a folder of CSV files, one of them is spoilt, and the folder is read as
a reader's own would be. Then its set-up is checked, and where nothing is found the standard filter
runs on it, whose error is compared with that on the recording as it was. No traceback may come of
it: whatever is no sentence of `InswsnError` is told as one.

What comes of it is kept in data/spoilt.json.
"""

from __future__ import annotations

import argparse
import datetime
import json
import shutil
import tempfile
import warnings
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path
from typing import Annotated, Any, Literal
from zlib import crc32

import numpy as np
from inswsn_book.record.files import file_digest, write_whole
from inswsn_book.record.provenance import repository_state
from inswsn_book.record.results import Digest, Finite, Frozen
from pydantic import Field
from spoilers import Spoiler, spoilers
from spoilt_bases import Base, bases

from inswsn_lib import logs
from inswsn_lib.errors import InswsnError
from inswsn_lib.streams import Recording

ROOT = Path(__file__).parent.parent
SPOILT = "data/spoilt.json"
SEED = 90
SOURCES = ("spoilt.py", "spoilers.py", "spoilt_bases.py", "made_recording.py")

Sizes = Literal["small", "large", "whole"]
# refused by the reader | found by a check | not found, but a check tells no more what it told
# before | the filter refuses | none of these | a fault of the library
Outcome = Literal["refused", "detected", "unknown", "stopped", "passed", "traceback"]


class Trial(Frozen):
    """What came of one spoilt recording."""

    recording: str
    kind: str
    file: str
    spoiler: str
    sizes: Sizes
    draw: Annotated[int, Field(ge=0)] = 0
    size: Finite | None = None  # in the spoiler's unit; None if it has no size
    unit: str = ""
    outcome: Outcome
    meant: bool = True  # whether a check is meant to tell it
    findings: tuple[str, ...] = ()  # names of those that are new
    named: bool | None = None  # whether the right name is among them; None if no check is meant
    harm: Finite | None = None  # error of the filter over that without the spoiling
    says: str = ""  # the sentence, or what the first finding says


class Made(Frozen):
    """What the study was made with."""

    version: str
    day: Annotated[str, Field(pattern=r"^\d{4}-\d\d-\d\d$")]
    commit: str | None
    clean: bool | None
    seed: int
    sources: dict[str, Digest]


class Study(Frozen):
    """What the file holds."""

    schema_version: Literal[1] = 1
    made: Made
    errors: dict[str, Finite]  # of the filter on each recording that is not spoilt, m
    trials: Annotated[tuple[Trial, ...], Field(min_length=1)]


@dataclass(frozen=True, eq=False)
class Unspoilt:
    """A recording as a folder of files, with what is found of it."""

    base: Base
    folder: Path
    findings: dict[tuple[str, str], bool | None]
    error: float

    @classmethod
    def of(cls, base: Base, folder: Path) -> Unspoilt:
        """Write and check a recording, and run the filter on it."""
        logs.write_csv(base.recording, folder)
        found = logs.check_set_up(logs.load("csv", folder))
        findings = {(f.name, f.subject): f.fits for f in found}
        return cls(base, folder, findings, base.error(base.recording))


def try_one(unspoilt: Unspoilt, spoiler: Spoiler, sizes: str, draw: int) -> Trial:
    """Spoil a recording and tell what comes of it."""
    key = f"{unspoilt.base.name} {spoiler.file} {spoiler.name} {sizes} {draw}"
    rng = np.random.default_rng([SEED, crc32(key.encode())])
    size = spoiler.draw(sizes, rng)
    with tempfile.TemporaryDirectory() as parent:
        folder = Path(parent, "recording")
        shutil.copytree(unspoilt.folder, folder)
        spoiler.change(folder / spoiler.file, size, rng)
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            found = outcome_of(unspoilt, spoiler, folder)
    says = str(found.pop("says", "")).replace(str(folder), "the folder")
    return Trial(
        recording=unspoilt.base.name,
        kind=unspoilt.base.kind,
        file=spoiler.file,
        spoiler=spoiler.name,
        sizes=sizes,
        draw=draw,
        size=None if np.isnan(size) else float(f"{size:.3g}"),
        unit=spoiler.unit,
        meant=bool(spoiler.right),
        says=says,
        **found,
    )


def outcome_of(unspoilt: Unspoilt, spoiler: Spoiler, folder: Path) -> dict[str, Any]:
    """Return what comes of a spoilt folder, as fields of a trial."""
    try:
        recording = logs.load("csv", folder)
    except InswsnError as error:
        return {"outcome": "refused", "says": str(error)}
    except Exception as error:  # what the study looks for
        return _traceback("reader", error)
    try:
        found = logs.check_set_up(recording)
    except Exception as error:
        return _traceback("checks", error)
    before = unspoilt.findings
    new = [f for f in found if f.fits is False and before.get((f.name, f.subject)) is not False]
    if new:
        names = tuple(dict.fromkeys(f.name for f in new))
        named = bool({*names} & {*spoiler.right}) if spoiler.right else None
        says = f"{new[0].name}: {new[0].subject}: {new[0].says}"
        return {"outcome": "detected", "findings": names, "named": named, "says": says}
    told = {(f.name, f.subject) for f in found if f.fits is not None}
    lost = {key for key, fits in before.items() if fits is not None} - told
    names = tuple(sorted({name for name, _ in lost}))
    return {"findings": names} | _harmed(unspoilt, recording, "unknown" if names else "passed")


def _harmed(unspoilt: Unspoilt, recording: Recording, outcome: Outcome) -> dict[str, Any]:
    """Return by how much the error of the filter grows."""
    try:
        with np.errstate(all="ignore"):
            error = unspoilt.base.error(recording)
    except InswsnError as error:
        return {"outcome": "stopped", "says": str(error)}
    except Exception as error:
        return _traceback("filter", error)
    return {"outcome": outcome, "harm": float(f"{error / unspoilt.error:.3g}")}


def _traceback(where: str, error: Exception) -> dict[str, Any]:
    return {"outcome": "traceback", "says": f"{where}: {type(error).__name__}: {error}"}


def trials_of(unspoilt: Unspoilt, ways: Iterable[Spoiler], draws: int) -> list[Trial]:
    """Spoil a recording by each way that it has the files for."""
    return [
        try_one(unspoilt, way, sizes, draw)
        for way in ways
        if way.fits(unspoilt.folder)
        for sizes in way.classes
        for draw in range(draws)
    ]


def study(found: list[Base], ways: Sequence[Spoiler], draws: int) -> Study:
    """Spoil recordings by each of some ways."""
    commit, clean = repository_state(ROOT)
    trials: list[Trial] = []
    errors = {}
    for base in found:
        with tempfile.TemporaryDirectory() as parent:
            unspoilt = Unspoilt.of(base, Path(parent, "recording"))
            errors[base.name] = float(f"{unspoilt.error:.3g}")
            trials += trials_of(unspoilt, ways, draws)
        print(f"{base.name}: {len(trials)} trials so far", flush=True)
    made = Made(
        version=version("inswsn"),
        day=datetime.datetime.now(datetime.UTC).date().isoformat(),
        commit=commit,
        clean=clean,
        seed=SEED,
        sources={name: file_digest(Path(__file__).parent / name) for name in SOURCES},
    )
    return Study(made=made, errors=errors, trials=tuple(trials))


def text_of(found: Study) -> str:
    """Return what is kept: a row or a trial a line."""
    whole = found.model_dump(mode="json")
    whole["trials"] = [
        trial.model_dump(mode="json", exclude_defaults=True) for trial in found.trials
    ]
    parts = []
    for name, value in whole.items():
        rows = ",\n  ".join(json.dumps(row) for row in value) if isinstance(value, list) else ""
        parts.append(f' "{name}": ' + (f"[\n  {rows}\n ]" if rows else json.dumps(value)))
    return "{\n" + ",\n".join(parts) + "\n}\n"


def main() -> None:
    """Spoil and write."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--draws", type=int, default=1, help="of each spoiler, size and recording")
    parser.add_argument("--out", type=Path, default=ROOT / SPOILT)
    given = parser.parse_args()
    found = study(bases(), spoilers(), given.draws)
    write_whole(given.out, text_of(found))


if __name__ == "__main__":
    main()
