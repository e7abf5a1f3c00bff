"""The texts below ``book/generated`` that pages of the book include, made anew by each build."""

from __future__ import annotations

from collections.abc import Sequence

from inswsn_lib.artefact.assumption_pages import assumption_texts
from inswsn_lib.artefact.pages import claims_counts, claims_list
from inswsn_lib.artefact.project import Project
from inswsn_lib.claims import LEDGER, Results, load_claims, verdicts


def generated_texts(project: Project, results: Sequence[Results]) -> dict[str, str]:
    """Return the texts by the names of their files.

    Parameters
    ----------
    project : Project
        The checkout.
    results : sequence of Results
        What the chapters that are shown have recorded.

    Raises
    ------
    InswsnError
        If a source cannot be read.
    """
    judged = verdicts(load_claims(project.root / LEDGER), results)
    return {
        "claims-counts.md": claims_counts(judged),
        "claims-list.md": claims_list(judged),
        **assumption_texts(project, results),
    }
