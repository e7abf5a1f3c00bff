"""The texts below ``book/generated`` that pages of the book include, made anew by each build."""

from __future__ import annotations

from collections.abc import Sequence

from inswsn_book.about import load_about
from inswsn_book.accessibility import accessibility_text
from inswsn_book.assumptions import ASSUMPTIONS
from inswsn_book.citation import citation_page, verdict_page
from inswsn_book.commands import commands_text
from inswsn_book.elsewhere_page import elsewhere_texts
from inswsn_book.front import front_texts
from inswsn_book.launching import launch_text
from inswsn_book.ledger import LEDGER, load_claims
from inswsn_book.pages import claims_counts, claims_list
from inswsn_book.project import Project
from inswsn_book.results import Results
from inswsn_book.review import review_texts
from inswsn_book.status import status_text
from inswsn_book.verdicts import verdicts


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
    about = load_about(project.root)
    chapters = project.chapters()
    names = {chapter.number: chapter.name for chapter in chapters}
    return {
        "accessibility.md": accessibility_text(project),
        "citation.md": citation_page(about),
        "citation-verdict.md": verdict_page(about, judged),
        "claims-counts.md": claims_counts(judged),
        "claims-list.md": claims_list(judged),
        "commands.md": commands_text(),
        "launch.md": launch_text(about, chapters),
        "status.md": status_text(results, judged, names),
        **elsewhere_texts(project),
        **front_texts(project, results, judged),
        **_assumption_texts(project, results),
        **review_texts(project, results, judged),
    }


def _assumption_texts(project: Project, results: Sequence[Results]) -> dict[str, str]:
    """Return the texts on the assumptions; to draw them, what simulates and plots is loaded."""
    if not (project.root / ASSUMPTIONS).is_file():
        return {}
    from inswsn_book.assumption_pages import assumption_texts  # noqa: PLC0415

    return assumption_texts(project, results)
