"""What a page is told of the cells of its chapter, and of its parameters."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

from inswsn_book.live.cells import before
from inswsn_book.live.measured import Measured, sources_of
from inswsn_book.record.parameters import Parameter, chapter_schema, ends
from inswsn_book.record.project import Chapter, Project


def about_lesson(
    project: Project, chapter: Chapter, measured: Sequence[Measured]
) -> dict[str, Any]:
    """Return what its page is told: which cells run, as they did here, and which others each needs.

    The page shows all of them.
    """
    sources = sources_of(project, chapter.name)
    return {
        "cells": [
            {
                "needs": found.needs,
                "seconds": round(found.seconds, 1),
                "before": before(sources, place),
            }
            for place, (found, _) in enumerate(zip(measured, sources, strict=True))
        ],
        "parameters": fields(chapter_schema(project.root, chapter.id).parameters),
    }


def fields(parameters: tuple[Parameter, ...]) -> list[dict[str, Any]]:
    """Return what a field for each parameter that is a number has to know; None for no limit."""
    return [
        {"name": p.name, "value": p.default, "whole": p.kind == "int", "meaning": p.meaning}
        | _limits(p)
        for p in parameters
        if p.kind in ("int", "float")
    ]


def _limits(parameter: Parameter) -> dict[str, Any]:
    """Return the least and the greatest value, and whether it has to be above or below them."""
    low, high, above, below = ends(parameter.rule) or (-math.inf, math.inf, True, True)
    if parameter.kind == "int":
        low, high, above, below = low + above, high - below, False, False
    lowest, highest = math.isfinite(low), math.isfinite(high)
    return {
        "low": low if lowest else None,
        "high": high if highest else None,
        "above": above and lowest,
        "below": below and highest,
    }
