"""Chapters as notebooks: read from the MyST sources, the same bytes every time."""

from __future__ import annotations

import re
from collections.abc import Iterable
from typing import Any

from inswsn_book.record.parameters import notebook_schema, read_myst
from inswsn_book.record.project import Chapter
from inswsn_lib.files import read_text

_KERNEL = {"display_name": "Python 3", "language": "python", "name": "python3"}


def read_source(chapter: Chapter, source: str | None = None) -> Any:
    """Read a chapter's source, or the one that is given, as a notebook without outputs.

    One that is none is refused. The id of a cell is the chapter's id and the cell's place, for
    example ``printed-numbers-003`` or ``lesson-2-003``.
    """
    import nbformat  # noqa: PLC0415  # takes half a second

    notebook = read_myst(source or read_text(chapter.source), chapter.source.name)
    prefix = cell_prefix(chapter.id)
    for place, cell in enumerate(notebook.cells):
        cell["id"] = f"{prefix}-{place:03d}"
    notebook_schema(notebook, chapter.source.name)
    notebook.metadata = nbformat.from_dict(
        {"kernelspec": dict(_KERNEL), "language_info": {"name": "python"}}
    )
    notebook.nbformat, notebook.nbformat_minor = 4, 5
    nbformat.validate(notebook)
    return notebook


def cell_prefix(chapter: str) -> str:
    """Return what the ids of a chapter's cells begin with."""
    return f"ch{chapter}" if chapter.isdigit() else chapter


def read_notebook(text: str) -> Any:
    """Return the notebook of the text of an .ipynb file."""
    import nbformat  # noqa: PLC0415  # takes half a second

    return nbformat.reads(text, as_version=4)


def notebook_text(notebook: Any) -> str:
    """Return a notebook as the text of an .ipynb file, with a line end at its end."""
    import nbformat  # noqa: PLC0415  # takes half a second

    return str(nbformat.writes(notebook)) + "\n"


def with_answer(text: str, answer: Iterable[str]) -> str:
    """Return the text of a notebook with what its run answers below the title."""
    notebook, said = read_notebook(text), "\n\n".join(answer)
    box = f"\n\n```{{admonition}} What this run answers\n:class: important\n\n{said}\n```"
    title = re.search(r"^# .*$", notebook.cells[0].source, re.M)
    at = title.end() if title else 0
    source = notebook.cells[0].source
    notebook.cells[0].source = source[:at] + box + source[at:]
    return notebook_text(notebook)


def woven(source: Any, executed: Any) -> tuple[Any, dict[str, str]]:
    """Put what the code cells of an executed notebook gave into a notebook with other prose.

    Returns that notebook, and the new id of each code cell by its old one. The code cells are the
    same, but for one that papermill has put behind that of the parameters.
    """
    given = [cell for cell in executed.cells if cell.cell_type == "code"]
    cells, ids = [], dict[str, str]()
    for cell in source.cells:
        cells.append(cell)
        cell.metadata.setdefault("tags", [])  # as papermill does
        if cell.cell_type == "code":
            done = cells[-1] = given.pop(0)
            ids[done["id"]] = cell["id"]
            done["id"] = cell["id"]
            if given and "injected-parameters" in given[0].metadata.get("tags", []):
                cells.append(given.pop(0))
    source.cells, source.metadata = cells, executed.metadata
    return source, ids


def strip_run(notebook: Any) -> Any:
    """Remove what differs from one execution to the next: times, paths, counters, a drawn id."""
    notebook.metadata.pop("papermill", None)
    notebook.metadata.pop("widgets", None)
    notebook.metadata["language_info"] = {"name": "python"}
    for cell in notebook.cells:
        for key in ("papermill", "execution"):
            cell.metadata.pop(key, None)
        if "injected-parameters" in cell.metadata.get("tags", []):
            cell["id"] = "injected-parameters"  # papermill draws one
    return notebook
