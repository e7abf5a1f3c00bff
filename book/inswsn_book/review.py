"""The texts of the pages that review the papers: the errata and the rival readings."""

from __future__ import annotations

from collections.abc import Sequence

from inswsn_book.errata import ERRATA, errata_page, load_errata
from inswsn_book.evidence import Findings
from inswsn_book.parameters import chapter_schema
from inswsn_book.project import Project
from inswsn_book.readings import (
    READINGS,
    computed_page,
    load_readings,
    readings_page,
    remaining_page,
)
from inswsn_book.results import Results
from inswsn_book.verdicts import Judged


def review_texts(
    project: Project, results: Sequence[Results], judged: Sequence[Judged]
) -> dict[str, str]:
    """Return the texts by the names of their files; none for a list that a checkout lacks.

    Parameters
    ----------
    project : Project
        The checkout.
    results : sequence of Results
        What the chapters that are shown have recorded.
    judged : sequence of Judged
        The claims, judged by them.

    Raises
    ------
    InswsnError
        If a list is not of its form, names what is not there, or rests on evidence that does not
        hold. A run with other parameters may overturn evidence; then the page says so.
    """
    findings, texts = Findings(results, judged), {}
    if (project.root / ERRATA).is_file():
        strict = _is_published(project, results)
        texts["errata.md"] = errata_page(load_errata(project.root), findings, strict=strict)
    if (project.root / READINGS).is_file():
        readings, strict = load_readings(project.root), _is_published(project, results)
        texts["computed.md"] = computed_page(readings, findings, strict=strict)
        texts["readings.md"] = readings_page(readings, findings)
        texts["readings-remaining.md"] = remaining_page(readings, findings)
    return texts


def _is_published(project: Project, results: Sequence[Results]) -> bool:
    """Tell whether all results are those of a run with the declared parameters."""
    return all(
        result.parameters == chapter_schema(project.root, result.chapter).check({})
        for result in results
    )
