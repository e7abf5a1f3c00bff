"""Results of the benchmark: how they are told, and the rows that are kept for the book's page."""

from __future__ import annotations

import json
from collections.abc import Sequence
from datetime import UTC, datetime
from typing import Any

from inswsn_book import files
from inswsn_book.pages import read_json
from inswsn_book.project import Project
from inswsn_book.provenance import machine_facts, repository_state
from inswsn_lib import __version__
from inswsn_lib.benchmark import Result

#: Where the rows are, in a checkout
LEADERBOARD = "data/leaderboard.json"


def result_lines(result: Result) -> list[str]:
    """Return what a result says, in lines: one for each recording, and one for all."""
    lines = [f"{result.entry} on {result.track}, {result.trials} trials, {result.commit}"]
    row = result.row()
    for each in row["recordings"]:
        velocity = "no velocity" if each["velocity"] is None else f"{each['velocity']:.3g} m/s"
        lines.append(
            f"    {each['name']}: {each['position']:.3g} m, {velocity}; "
            f"best of the baselines: {each['best'].rpartition(':')[2]}"
        )
    nees = "" if row["nees"] is None else f" (NEES {row['nees']:.2g})"
    lines.append(
        f"    {result.word}: {result.ratio:.3g} of its error, {result.low:.3g} to "
        f"{result.high:.3g}; {result.consistency}{nees}; {row['cost']:.0f} us a step; "
        f"{'causal' if result.causal else 'not causal'}"
    )
    return lines + [f"    {sentence}" for sentence in result.left_out]


def keep_rows(project: Project, results: Sequence[Result]) -> str:
    """Keep the rows of results, each in the place of one of the same entry and track."""
    path = project.root / LEADERBOARD
    rows: dict[tuple[str, str], dict[str, Any]] = {}
    if path.is_file():
        rows = {(row["track"], row["entry"]): row for row in read_json(path)["rows"]}
    commit, clean = repository_state(project.root)
    facts = machine_facts()
    made = {
        "day": datetime.now(UTC).date().isoformat(),
        "inswsn": __version__,
        "library": commit,
        "clean": clean,
        **{name: facts[name] for name in ("python", "system", "cpu")},
    }
    rows |= {(r.track, r.entry): r.row() | {"made": made} for r in results}
    lines = ",\n".join(json.dumps(rows[key], allow_nan=False) for key in sorted(rows))
    files.write_whole(path, f'{{"rows": [\n{lines}\n]}}\n')
    return LEADERBOARD
