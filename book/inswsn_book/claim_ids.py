"""The ids of claims that have been published: they stay, whatever becomes of the verdicts."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from inswsn_book.files import write_whole
from inswsn_book.ledger import LEDGER, load_claims
from inswsn_book.project import Project
from inswsn_book.verdicts import Judged
from inswsn_lib.errors import InswsnError

#: The ids of all claims ever published, below the root of a checkout.
CLAIM_IDS = "data/claim-ids.txt"

_HEAD = """\
# The ids of all claims that have been published, one a line. None is ever removed, and none is
# given to another claim. `make publish` adds new ones; `make test` fails when the ledger lacks one.
"""


def published_ids(project: Project) -> list[str]:
    """Return the ids in ``data/claim-ids.txt``; none if there is no such file."""
    path = project.root / CLAIM_IDS
    if not path.is_file():
        return []
    lines = path.read_text(encoding="utf-8").splitlines()
    return [line for line in map(str.strip, lines) if line and not line.startswith("#")]


def lost_ids(project: Project) -> list[str]:
    """Return the published ids that the ledger no longer has."""
    there = set(_ledger_ids(project))
    return [name for name in published_ids(project) if name not in there]


def new_ids(project: Project) -> list[str]:
    """Return the ids of the ledger that have not been published."""
    known = set(published_ids(project))
    return [name for name in _ledger_ids(project) if name not in known]


def publish_ids(project: Project) -> list[str]:
    """Add the new ids to ``data/claim-ids.txt``; return them.

    Raises
    ------
    InswsnError
        If the ledger cannot be read, or lacks a published id; then nothing is written.
    """
    require_ids_kept(project)
    added = new_ids(project)
    if added:
        lines = "".join(f"{name}\n" for name in sorted({*published_ids(project), *added}))
        write_whole(project.root / CLAIM_IDS, _HEAD + lines)
    return added


def require_ids_kept(project: Project) -> None:
    """Raise `InswsnError` if the ledger lacks a published id."""
    lost = lost_ids(project)
    if lost:
        raise InswsnError(
            f"{LEDGER} has no claim {lost[0]}, which has been published; an id stays, and a claim "
            "that was a mistake says so."
        )


def _ledger_ids(project: Project) -> list[str]:
    return [claim.id for claim in load_claims(project.root / LEDGER)]


@dataclass(frozen=True)
class ChangedVerdict:
    """A claim whose verdict differs between two versions.

    Attributes
    ----------
    id : str
        The claim.
    before, after : str or None
        Its verdicts; None where it is not in the ledger.
    """

    id: str
    before: str | None
    after: str | None

    def __str__(self) -> str:
        """Return the line that a changelog has for it."""
        return f"{self.id}: {self.before or 'not there'} -> {self.after or 'not there'}"


def read_verdicts(path: Path) -> dict[str, str]:
    """Read the verdicts by id from a file that ``inswsn claims --json`` has written.

    Parameters
    ----------
    path : Path
        The file, for example ``verdicts.json`` of an archive.

    Raises
    ------
    InswsnError
        If it is not such a file.
    """
    try:
        entries = json.loads(path.read_text(encoding="utf-8"))
        if not isinstance(entries, list):
            raise TypeError
        return {str(entry["id"]): str(entry["verdict"]) for entry in entries}
    except (ValueError, TypeError, KeyError, RecursionError):
        raise InswsnError(
            f"{path} holds no verdicts; it may be a file written by inswsn claims --json."
        ) from None


def changed_verdicts(before: dict[str, str], judged: Sequence[Judged]) -> list[ChangedVerdict]:
    """Return the claims whose verdicts differ, those that are new, and those that are gone."""
    after = {entry.claim.id: str(entry.verdict) for entry in judged}
    return [
        ChangedVerdict(name, before.get(name), after.get(name))
        for name in [*after, *(name for name in before if name not in after)]
        if before.get(name) != after.get(name)
    ]


def verdicts_text(judged: Sequence[Judged]) -> str:
    """Return the claims with their verdicts as JSON: what ``inswsn claims --json`` prints."""
    listing = [entry.as_json() for entry in judged]
    return json.dumps(listing, indent=1, ensure_ascii=False, allow_nan=False)
