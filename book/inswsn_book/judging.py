"""The claims of the ledger, judged by results files: in a terminal, as JSON, against others."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path

from rich.console import Console
from rich.table import Table

from inswsn_book.ledger import LEDGER, load_claims
from inswsn_book.project import Project
from inswsn_book.results import Results, read_results
from inswsn_book.verdicts import Judged, count_verdicts, verdicts
from inswsn_lib.errors import InswsnError


def judge_claims(project: Project, folder: Path | None = None) -> list[Judged]:
    """Judge every claim by the reference results; those in a folder go before them."""
    results = _results_in(project.published)
    if folder is not None:
        results |= _results_in(folder)
    return verdicts(load_claims(project.root / LEDGER), results.values())


def _results_in(folder: Path) -> dict[str, Results]:
    """Return the results files of a folder by their chapters."""
    found = {}
    for path in sorted(folder.glob("[0-9][0-9].json")):
        results = read_results(path)
        if results.chapter != path.stem:
            raise InswsnError(f"{path} holds results of chapter {results.chapter}.")
        found[path.stem] = results
    return found


def select_claims(
    judged: Sequence[Judged],
    *,
    paper: str | None = None,
    kind: str | None = None,
    verdict: str | None = None,
) -> list[Judged]:
    """Return the claims of a paper, of a kind, and with a verdict; None stands for all."""
    return [
        entry
        for entry in judged
        if paper in (None, entry.claim.paper)
        and kind in (None, entry.claim.kind)
        and verdict in (None, entry.verdict)
    ]


def show_claims(judged: Sequence[Judged], console: Console) -> None:
    """Write a table of claims, and how many there are with each verdict."""
    table = Table("claim", "place", "holds if", "found", "verdict", "cell", box=None)
    for entry in judged:
        texts = (entry.published_text, entry.rebuilt_text, str(entry.verdict), entry.cell or "")
        table.add_row(entry.claim.id, entry.claim.place, *texts)
    console.print(table)
    counts = count_verdicts(judged)
    headline = sum(count for verdict, count in counts.items() if verdict.counts)
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
        entries = json.loads(path.read_text(encoding="utf-8"))
        if not isinstance(entries, list):
            raise TypeError
        return {str(entry["id"]): str(entry["verdict"]) for entry in entries}
    except (ValueError, TypeError, KeyError, RecursionError):
        raise InswsnError(
            f"{path} holds no verdicts; it may be a file written by inswsn claims --json."
        ) from None


def changed_verdicts(before: dict[str, str], judged: Sequence[Judged]) -> list[str]:
    """Return a line for each claim that has another verdict, is new, or is gone."""
    after = {entry.claim.id: str(entry.verdict) for entry in judged}
    return [
        f"{name}: {before.get(name, 'not there')} -> {after.get(name, 'not there')}"
        for name in dict.fromkeys([*after, *before])
        if before.get(name) != after.get(name)
    ]
