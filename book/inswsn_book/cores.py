"""The core of a chapter: what it computes over many runs, as a dataclass of the science library.

The head of a chapter's source names it, ``core: package.module:Class``. Its fields are parameters
of the chapter, and its method ``scores`` returns `inswsn_lib.evaluation.Scores`. A parameter that
is no field changes other sections of the chapter only.
"""

from __future__ import annotations

import json
import re
from collections.abc import Iterator, Mapping
from dataclasses import fields
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any

from inswsn_book.files import file_digest
from inswsn_book.parameters import Value
from inswsn_book.project import Chapter
from inswsn_book.results import Quantity, Results
from inswsn_lib.errors import InswsnError
from inswsn_lib.files import read_text

if TYPE_CHECKING:
    from inswsn_lib.evaluation import Scores

#: The file of a run in which the words of a core's scores are kept, and who leads
SCORES = "scores.json"
# What a core may read, beside its parameters
_SCENARIOS = "data/scenarios"


def core_name(source: str) -> str | None:
    """Return what the source of a chapter names as its core; None if it names none."""
    head = source.partition("\n---\n")[0]
    found = re.search(r"^core: *(\S+:\S+)$", head, re.MULTILINE)
    return found[1] if found else None


def load_core(name: str) -> type[Any]:
    """Return the class of that name; refuse one that is not there."""
    module, _, kind = name.partition(":")
    try:
        return getattr(import_module(module), kind)  # type: ignore[no-any-return]
    except (ImportError, AttributeError) as error:
        raise InswsnError(f"There is no core {name}: {error}.") from None


def run_core(
    root: Path, chapter: Chapter, values: Mapping[str, Value], threads: int
) -> tuple[Results, dict[str, str]]:
    """Compute the core of a chapter; return its scores as results and as the file `SCORES`."""
    from threadpoolctl import threadpool_limits  # noqa: PLC0415  # the parent needs no numerics

    name = core_name(read_text(chapter.source))
    if name is None:
        raise InswsnError(f"Chapter {chapter.id} has no core.")
    core = load_core(name)
    own = {field.name for field in fields(core)}
    with threadpool_limits(threads):
        scores: Scores = core(**{n: v for n, v in values.items() if n in own}).scores()
    scenarios = sorted((root / _SCENARIOS).glob("*.yaml"))
    results = Results(
        chapter=chapter.id,
        parameters=dict(values),
        data={f"{_SCENARIOS}/{path.name}": file_digest(path) for path in scenarios},
        quantities=tuple(_quantities(scores)),
    )
    best, error, after, lead = scores.leader()
    words = {
        "methods": {m: n for m, n in scores.methods.items() if m not in scores.baselines},
        "headline": scores.headline,
        "leader": {
            "best": best, "error": error, "next": after,
            "lead": lead.percent if after else None, "within": lead.within if after else None,
        },
    }  # fmt: skip
    return results, {SCORES: json.dumps(words, ensure_ascii=False)}


def _quantities(scores: Scores) -> Iterator[Quantity]:
    for row in scores.table().to_dict("records"):
        median = row["median"]
        yield Quantity(
            name=f"{row['method']}.{row['column']}",
            value=median,
            unit=row["unit"],
            interval=(row["low"], row["high"]),
            interval_kind="runs 95 %",
            runs=row["runs"],
            basis="simulation",
            how=f"{row['column']}, {scores.methods[row['method']]}: median over runs.",
            tolerance=1e-6,
            share=1e-3,
        )
