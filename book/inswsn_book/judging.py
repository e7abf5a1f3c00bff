"""The claims of the ledger, judged by results files: in a terminal, as JSON, against others."""

from __future__ import annotations

import json
import sys
from collections.abc import Iterable, Sequence
from dataclasses import replace
from pathlib import Path

from rich.console import Console
from rich.table import Table

from inswsn_book.files import check_listed
from inswsn_book.ledger import KINDS, LEDGER, PAPERS, load_claims
from inswsn_book.project import Project
from inswsn_book.results import Frozen, Results, read_results
from inswsn_book.review import READINGS, Readings, load_entries, with_readings
from inswsn_book.verdicts import VERDICTS, Earlier, Judged, count_verdicts, verdicts
from inswsn_lib.errors import InswsnError, ParameterError
from inswsn_lib.files import WRITTEN, read_text

#: The verdicts of each release, below the root of a checkout
RELEASES = "data/verdicts"


class Release(Frozen):
    """All verdicts of a release, in its words, by the id of the claim."""

    version: str
    day: str
    verdicts: dict[str, str]


def judge(root: Path, results: Iterable[Results]) -> list[Judged]:
    """Judge the claims of a checkout by the results of all chapters that decide them.

    With each stands what other readings of the papers would make of it, and what releases made.
    """
    known = tuple(results)
    judged = verdicts(load_claims(root / LEDGER), known)
    if (root / READINGS).is_file():
        judged = with_readings(judged, load_entries(root / READINGS, Readings), known)
    paths = sorted((root / RELEASES).glob("*.yaml"))
    releases = [load_entries(path, Release) for path in paths]
    return [replace(entry, earlier=_earlier(entry, releases)) for entry in judged]


def _earlier(entry: Judged, releases: Iterable[Release]) -> tuple[Earlier, ...]:
    """Return the releases in which a claim had another verdict."""
    had = [(r.version, r.day, r.verdicts.get(entry.claim.id, entry.words)) for r in releases]
    return tuple(Earlier(*release) for release in had if release[-1] != entry.words)


def judge_claims(
    project: Project, folder: Path | None = None, **wanted: str | None
) -> list[Judged]:
    """Judge the claims by the reference results; those in a folder go before them.

    Of a ``paper``, of a ``kind``, with a ``verdict``, where these are not None. A verdict without
    *under a stated assumption* stands for those with it as well.
    """
    words = {"paper": PAPERS, "kind": KINDS, "verdict": VERDICTS}
    asked = {name: word for name, word in wanted.items() if word is not None}
    for name, word in asked.items():
        if word not in words[name]:
            raise ParameterError(f"--{name}", word, "one of " + ", ".join(words[name]))
    folders = [project.published] if folder is None else [project.published, folder]
    paths = {path.name: path for each in folders for path in each.glob("[!l]*.json")}
    check_listed(project.published)
    judged = judge(project.root, map(read_results, paths.values()))
    for name, word in asked.items():
        judged = [e for e in judged if word in (e.verdict, e.words, getattr(e.claim, name, None))]
    return judged


def show_claims(judged: Sequence[Judged]) -> None:
    """Write a table of claims, and how many there are with each verdict."""
    console = Console(width=None if sys.stdout.isatty() else 150)
    table = Table("claim", "place", "holds if", "found", "verdict", "cell", box=None)
    for entry in judged:
        texts = (entry.published_text, entry.rebuilt_text, entry.label, entry.cell or "")
        table.add_row(entry.claim.id, entry.claim.place, *texts)
    console.print(table)
    counts = count_verdicts(judged)
    headline = sum(entry.verdict.counts for entry in judged)
    console.print(f"{len(judged)} claims, {headline} of them in the headline counts:")
    for verdict, count in counts.items():
        console.print(f"{count:5d}  {verdict}", highlight=False)


def verdicts_text(judged: Sequence[Judged]) -> str:
    """Return the claims with their verdicts as JSON: what ``inswsn claims --json`` prints."""
    listing = [entry.as_json() for entry in judged]
    return json.dumps(listing, indent=1, ensure_ascii=False, allow_nan=False)


def read_verdicts(path: Path) -> dict[str, str]:
    """Read the verdicts by id from a file of `verdicts_text`; another file is refused."""
    try:
        entries = json.loads(read_text(path, WRITTEN))
        if not isinstance(entries, list):
            raise TypeError
        return {str(entry["id"]): str(entry["verdict"]) for entry in entries}
    except (ValueError, TypeError, KeyError, RecursionError):
        raise InswsnError(
            f"{path} holds no verdicts; it must be a file written by inswsn claims --json."
        ) from None
