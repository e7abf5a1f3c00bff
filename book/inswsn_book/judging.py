"""The claims of the ledger, judged by the results files of a folder, and shown in a terminal."""

from __future__ import annotations

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
    """Judge every claim of the ledger.

    Parameters
    ----------
    folder : Path, optional
        Where results files are that go before the reference results of their chapters.

    Raises
    ------
    InswsnError
        If the ledger or a results file cannot be read, or a claim's check does not resolve.
    """
    claims = load_claims(project.root / LEDGER)
    results = _results_in(project.published)
    if folder is not None:
        results |= _results_in(folder)
    return verdicts(claims, results.values())


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
        table.add_row(
            entry.claim.id,
            entry.claim.place,
            entry.published_text,
            entry.rebuilt_text,
            str(entry.verdict),
            entry.cell or "",
        )
    console.print(table)
    counts = count_verdicts(judged)
    headline = sum(count for verdict, count in counts.items() if verdict.counts)
    console.print(f"{len(judged)} claims, {headline} of them in the headline counts:")
    for verdict, count in counts.items():
        console.print(f"{count:5d}  {verdict}", highlight=False)
