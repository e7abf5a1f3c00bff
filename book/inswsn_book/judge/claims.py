"""The claims of the ledger, judged by results files: in a terminal, as JSON, against others."""

from __future__ import annotations

import json
import re
import sys
from collections.abc import Iterable, Sequence
from dataclasses import replace
from pathlib import Path

from rich.console import Console
from rich.table import Table

from inswsn_book.judge.ledger import KINDS, LEDGER, PAPERS, load_claims
from inswsn_book.judge.review import (
    ERRATA,
    READINGS,
    Errata,
    Readings,
    load_entries,
    with_entries,
    with_readings,
    with_reruns,
)
from inswsn_book.judge.verdicts import VERDICTS, Earlier, Judged, count_verdicts, verdicts
from inswsn_book.record.files import check_listed
from inswsn_book.record.parameters import nearest
from inswsn_book.record.project import Project
from inswsn_book.record.results import Frozen, Results, read_results
from inswsn_lib.errors import InswsnError, ParameterError
from inswsn_lib.files import WRITTEN, read_text

#: The verdicts of each release, below the root of a checkout
RELEASES = "data/verdicts"
_ROLE = re.compile(r"\{\w+\}`([^<`]*?)(?: <[^>`]*>)?`")
_FORMULAS = {r"\infty": "∞", r"\gamma": "γ", "_∞": "∞", r"\mathrm": "", "$": "", "{": "", "}": ""}


class Release(Frozen):
    """All verdicts of a release, in its words, by the id of the claim."""

    version: str
    day: str
    verdicts: dict[str, str]


def judge(root: Path, results: Iterable[Results]) -> list[Judged]:
    """Judge the claims of a checkout by the results of all chapters that decide them.

    With each stands what other readings of the papers would make of it, and what releases made.
    """
    known = with_reruns(root, results)
    judged = verdicts(load_claims(root / LEDGER), known)
    if (root / READINGS).is_file():
        readings = load_entries(root / READINGS, Readings)
        judged = with_readings(judged, readings, known)
        errata = load_entries(root / ERRATA, Errata).errata
        judged = with_entries(judged, [*readings.questions, *errata])
    paths = sorted((root / RELEASES).glob("*.yaml"))
    releases = [load_entries(path, Release) for path in paths]
    return [replace(entry, earlier=_earlier(entry, releases)) for entry in judged]


def _earlier(entry: Judged, releases: Iterable[Release]) -> tuple[Earlier, ...]:
    """Return the releases in which a claim had another verdict."""
    had = [(r.version, r.day, r.verdicts.get(entry.claim.id, entry.words)) for r in releases]
    return tuple(Earlier(*release) for release in had if release[-1] != entry.words)


def judge_claims(
    project: Project, folder: Path | None = None, identity: str | None = None, **wanted: str | None
) -> list[Judged]:
    """Judge the claims by the reference results; those in a folder go before them.

    A run of a part goes before what it has computed again. Of an id that claim
    alone; of a ``paper``, of a ``kind``, with a ``verdict``, where these are not None. A verdict
    without *under a stated assumption* stands for those with it as well.
    """
    words = {"paper": PAPERS, "kind": KINDS, "verdict": VERDICTS}
    asked = {name: word for name, word in wanted.items() if word is not None}
    for name, word in asked.items():
        if word not in words[name]:
            raise ParameterError(f"--{name}", word, "one of " + ", ".join(words[name]))
    folders = [project.published] if folder is None else [project.published, folder]
    paths = {path.name: path for each in folders for path in each.glob("[!l]*.json")}
    check_listed(project.published)
    judged = judge(project.root, [_whole(project, read_results(path)) for path in paths.values()])
    if identity is not None:
        ids = {entry.claim.id: entry for entry in judged}
        if identity not in ids:
            raise ParameterError("ID", identity, "the id of a claim" + nearest(identity, ids))
        judged = [ids[identity]]
    for name, word in asked.items():
        judged = [e for e in judged if word in (e.verdict, e.words, getattr(e.claim, name, None))]
    return judged


def _whole(project: Project, results: Results) -> Results:
    """Return a run of a part of a chapter with the reference for all the rest."""
    if results.provenance is None or results.provenance.only is None:
        return results
    new = {quantity.name: quantity for quantity in results.quantities}
    whole = read_results(project.published / f"{results.chapter}.json")
    quantities = tuple(new.get(quantity.name, quantity) for quantity in whole.quantities)
    update = {"quantities": quantities, "parameters": results.parameters}
    return whole.model_copy(update=update)


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


def plain(text: str) -> str:
    """Return a text without the marks of formulas and links."""
    text = _ROLE.sub(r"\1", text)
    for mark, sign in _FORMULAS.items():
        text = text.replace(mark, sign)
    return re.sub(r"\\(\w+)", r"\1", text)


def entry_text(entry: Judged) -> str:
    """Return all that is known of one claim, as its entry on the page of claims has it."""
    claim, number = entry.claim, entry.quantity
    lines = [f"{claim.id}  {claim.paper}, {claim.place}; {claim.kind}", claim.says, ""]
    lines += [f"Verdict: {entry.label}. {entry.reason}"]
    lines += [f"  in {old.version}: {old.verdict}" for old in entry.earlier]
    if number:
        lines += [f"Holds if: {entry.published_text}. Found: {entry.rebuilt_text}"]
        lines += [f"  {number.name}, {number.runs} run{'s' * (number.runs > 1)}: {number.how}"]
    lines += [f"Assumed: {claim.assumption}"] if claim.assumption else []
    lines += [f"By reading: {read.name}: {read.verdict}" for read in entry.readings]
    lines += [f"Named in {named.id}: {named.title}" for named in entry.hangs_on]
    lines += [f"Check: {claim.why}"]
    if entry.cell:
        lines += [f"Alone: inswsn run {claim.chapter} --only {claim.id} (cell {entry.cell})"]
    return plain("\n".join(lines))


def verdicts_text(judged: Sequence[Judged]) -> str:
    """Return the claims with their verdicts as JSON: what ``inswsn claims --json`` prints."""
    listing = [entry.as_json() for entry in judged]
    return json.dumps(listing, indent=1, ensure_ascii=False, allow_nan=False)


def read_verdicts(path: Path) -> dict[str, str]:
    """Read the verdicts by id from a file of `verdicts_text`, or of a release; else refuse it."""
    if path.suffix == ".yaml":
        return load_entries(path, Release).verdicts
    try:
        entries = json.loads(read_text(path, WRITTEN))
        if not isinstance(entries, list):
            raise TypeError
        return {str(entry["id"]): str(entry["verdict"]) for entry in entries}
    except (ValueError, TypeError, KeyError, RecursionError):
        raise InswsnError(
            f"{path} holds no verdicts; it must be a file written by inswsn claims --json."
        ) from None
