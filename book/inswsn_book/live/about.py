"""What a page is told of the cells of its chapter, and of its parameters."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

from inswsn_book.live.measured import Measured
from inswsn_book.parameters import Parameter, ends, notebook_schema, read_myst
from inswsn_book.project import Chapter
from inswsn_lib.files import read_text

#: The tag of a cell of which its page shows nothing
UNSEEN = "remove-cell"


def about_chapter(chapter: Chapter) -> dict[str, Any]:
    """Return what its page is told on the reader's own machine: every cell runs.

    A cell that the page does not show comes with its source: others need it.
    """
    notebook = read_myst(read_text(chapter.source), chapter.source.name)
    cells = [
        {"needs": "", "seconds": 0} | ({"source": cell.source} if _unseen(cell) else {})
        for cell in notebook.cells
        if cell.cell_type == "code"
    ]
    return {
        "kernel": True,
        "cells": cells,
        "parameters": fields(notebook_schema(notebook, chapter.source.name).parameters),
    }


def about_lesson(chapter: Chapter, measured: Sequence[Measured]) -> dict[str, Any]:
    """Return what its page is told where Python runs in the page: cells run as they did here."""
    cells = [{"needs": m.needs, "seconds": round(m.seconds, 1)} for m in measured]
    return about_chapter(chapter) | {"kernel": False, "files": True, "cells": cells}


def _unseen(cell: Any) -> bool:
    return UNSEEN in cell.metadata.get("tags", [])


def fields(parameters: tuple[Parameter, ...]) -> list[dict[str, Any]]:
    """Return what a field for each parameter that is a number has to know; None for no limit."""
    return [
        {"name": p.name, "value": p.default, "whole": p.kind == "int", "meaning": p.meaning}
        | dict(zip(("low", "high"), _limits(p), strict=True))
        for p in parameters
        if p.kind in ("int", "float")
    ]


def _limits(parameter: Parameter) -> tuple[float | None, float | None]:
    """Return the least and the greatest value; of what is no whole number, the open ends too."""
    low, high, above, below = ends(parameter.rule) or (-math.inf, math.inf, True, True)
    if parameter.kind == "int":
        low, high = low + above, high - below
    return (low if math.isfinite(low) else None), (high if math.isfinite(high) else None)
